//! The distance of two quadratic patches, by subdivision until bounds from above and below meet.

use std::{cmp::Ordering, collections::BinaryHeap};

use glam::DVec3;

use crate::closest_features;

/// A quadratic Bézier triangle: its corners, and one control point for each edge. Edge `k` joins corners `k` and
/// `k + 1`.
#[derive(Clone, Copy, Debug)]
pub struct ReferencePatch {
    /// The corners.
    pub corners: [DVec3; 3],
    /// The control points of the edges.
    pub middles: [DVec3; 3],
}

impl ReferencePatch {
    /// The patch over a triangle whose edges are bent: the middle of edge `k` is a quarter of `offsets[k]` away from the
    /// middle of its chord.
    #[must_use]
    pub fn bent(corners: [DVec3; 3], offsets: [DVec3; 3]) -> Self {
        let middle = |k: usize| (corners[k] + corners[(k + 1) % 3] + offsets[k]) * 0.5;
        Self { corners, middles: [middle(0), middle(1), middle(2)] }
    }

    /// The point with these weights of the corners.
    #[must_use]
    pub fn point(&self, [a, b, c]: [f64; 3]) -> DVec3 {
        self.corners[0] * (a * a)
            + self.corners[1] * (b * b)
            + self.corners[2] * (c * c)
            + (self.middles[0] * (a * b) + self.middles[1] * (b * c) + self.middles[2] * (c * a)) * 2.0
    }

    /// The four parts between the middles of the edges, by de Casteljau's construction.
    fn parts(&self) -> [Self; 4] {
        let [p, q, r] = self.corners;
        let [pq, qr, rp] = self.middles;
        let half = |one: DVec3, other: DVec3| (one + other) * 0.5;
        let on = |start: DVec3, middle: DVec3, end: DVec3| (start + middle * 2.0 + end) * 0.25;
        let (m, n, o) = (on(p, pq, q), on(q, qr, r), on(r, rp, p));
        // The control points of the inner edges.
        let (at_p, at_q, at_r) = ((pq + qr + rp + p) * 0.25, (pq + qr + rp + q) * 0.25, (qr + rp + pq + r) * 0.25);
        [
            Self { corners: [p, m, o], middles: [half(p, pq), at_p, half(rp, p)] },
            Self { corners: [m, q, n], middles: [half(pq, q), half(q, qr), at_q] },
            Self { corners: [o, n, r], middles: [at_r, half(qr, r), half(r, rp)] },
            Self { corners: [m, n, o], middles: [at_q, at_r, at_p] },
        ]
    }

    /// No point of the patch is farther than this from the point of the flat triangle with the same weights.
    fn height(&self) -> f64 {
        let bend = |k: usize| {
            let chord = (self.corners[k] + self.corners[(k + 1) % 3]) * 0.5;
            self.middles[k].distance(chord)
        };
        // 2 Σ w_i w_j is at most two thirds.
        bend(0).max(bend(1)).max(bend(2)) * 2.0 / 3.0
    }
}

struct Pair {
    lower: f64,
    patches: [ReferencePatch; 2],
}

impl PartialEq for Pair {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Pair {}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Pair {
    /// The pair that may be closest comes first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.lower.total_cmp(&self.lower)
    }
}

/// The least distance of two patches, at most `tolerance` too large. Infinite if it is larger than `limit`.
#[must_use]
pub fn patch_distance(a: &ReferencePatch, b: &ReferencePatch, limit: f64, tolerance: f64) -> f64 {
    let mut best = f64::INFINITY;
    let mut open = BinaryHeap::new();
    let look = |patches: [ReferencePatch; 2], best: &mut f64, open: &mut BinaryHeap<Pair>| {
        let flat = closest_features(&patches[0].corners, &patches[1].corners);
        let heights = patches[0].height() + patches[1].height();
        let (at_a, at_b) = (patches[0].point(flat.barycentric_a), patches[1].point(flat.barycentric_b));
        *best = best.min(at_a.distance(at_b));
        open.push(Pair { lower: (flat.distance - heights).max(0.0), patches });
    };
    look([*a, *b], &mut best, &mut open);
    while let Some(Pair { lower, patches: [first, second] }) = open.pop() {
        if lower > limit {
            return f64::INFINITY;
        }
        if best - lower <= tolerance {
            break;
        }
        // Divides the one that is farther from its triangle.
        if first.height() >= second.height() {
            first.parts().into_iter().for_each(|part| look([part, second], &mut best, &mut open));
        } else {
            second.parts().into_iter().for_each(|part| look([first, part], &mut best, &mut open));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(seed: f64, center: DVec3) -> ReferencePatch {
        let at = |n: f64| DVec3::new((seed * n).sin(), (seed * n * 1.7).sin(), (seed * n * 2.9).sin());
        ReferencePatch::bent(
            [center + at(1.0), center + at(2.0), center + at(3.0)],
            [at(4.0) * 0.3, at(5.0) * 0.3, at(6.0) * 0.3],
        )
    }

    #[test]
    fn parts_are_pieces_of_the_patch() {
        let whole = patch(1.3, DVec3::ZERO);
        let corner = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let half = |one: [f64; 3], other: [f64; 3]| [0, 1, 2].map(|k| (one[k] + other[k]) * 0.5);
        let [p, q, r] = corner;
        let (m, n, o) = (half(p, q), half(q, r), half(r, p));
        for (part, domain) in whole.parts().iter().zip([[p, m, o], [m, q, n], [o, n, r], [m, n, o]]) {
            for weights in [[0.2, 0.3, 0.5], [0.6, 0.4, 0.0], [0.1, 0.0, 0.9], [0.0, 0.5, 0.5]] {
                let inner = [0, 1, 2].map(|k| (0..3).map(|corner| weights[corner] * domain[corner][k]).sum());
                assert!(part.point(weights).distance(whole.point(inner)) < 1.0e-14);
            }
        }
    }

    #[test]
    fn the_distance_is_that_of_the_closest_of_many_points() {
        const STEPS: usize = 60;
        for seed in [0.7, 1.9, 3.3] {
            let (a, b) = (patch(seed, DVec3::ZERO), patch(seed + 0.4, DVec3::X * 2.5));
            let points = |patch: &ReferencePatch| {
                let patch = *patch;
                let grid = (0..=STEPS).flat_map(|i| (0..=STEPS - i).map(move |j| (i, j)));
                let point = move |(i, j)| {
                    let (u, v) = (i as f64 / STEPS as f64, j as f64 / STEPS as f64);
                    patch.point([1.0 - u - v, u, v])
                };
                grid.map(point).collect::<Vec<DVec3>>()
            };
            let sampled = points(&a).into_iter().fold(f64::INFINITY, |least, p| {
                points(&b).into_iter().fold(least, |least, q| least.min(p.distance(q)))
            });
            let found = patch_distance(&a, &b, f64::INFINITY, 1.0e-6);
            assert!(found <= sampled + 1.0e-6 && sampled - found < 0.05, "{found} {sampled}");
        }
    }
}
