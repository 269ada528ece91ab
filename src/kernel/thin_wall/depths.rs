//! The depth of the middle below the corners of thin triangles.

use std::collections::BTreeMap;

use super::{
    body::Body,
    pairing::{Opposite, Pairing, opposite_plane},
    segments::Segments,
    settings::ThinWallSettings,
};
use crate::kernel::mesh::barycentric::barycentric_of;

/// Where to look for the face opposite a corner, as shares of the way to the triangle's center. What is opposite the
/// corner itself may already be beyond an edge.
const PROBES: [f64; 3] = [0.1, 0.4, 1.0];

/// A plane is not followed to a corner where it would be so many times deeper than below the triangle.
const MOST_GROWTH: f64 = 3.0;

/// Half the thickness of a wall at a vertex.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Depth {
    /// The depth of the middle below the face.
    pub(super) depth: f64,
    /// Half the thickness across the middle surface.
    pub(super) half: f64,
}

/// The depths at the corners of each thin triangle, the same for all triangles of a segment around a vertex.
pub(super) struct CornerDepths(Vec<[Depth; 3]>);

/// A value at a corner, on its way to the mean over the segment around its vertex.
struct Entry {
    vertex: usize,
    segment: u32,
    corner: (usize, usize),
    weight: f64,
    depth: Depth,
}

impl CornerDepths {
    pub(super) fn new(
        body: &Body,
        pairing: &Pairing,
        segments: &Segments,
        settings: &ThinWallSettings,
        is_thin: &[bool],
    ) -> Self {
        let (mut entries, mut gaps) = (Vec::new(), Vec::new());
        for triangle in (0..body.triangle_count()).filter(|&triangle| is_thin[triangle]) {
            let corners = &body.facets.corners[triangle];
            let center = (corners[0] + corners[1] + corners[2]) / 3.0;
            let Some(mean) = mean_depth(pairing, triangle).filter(|_| pairing.is_paired[triangle]) else {
                gaps.push(triangle);
                continue;
            };
            for k in 0..3 {
                let is_plausible =
                    |found: &Opposite| found.depth > body.rounding && found.depth <= MOST_GROWTH * mean.depth;
                let found = PROBES.iter().find_map(|&share| {
                    let probe = corners[k].lerp(center, share);
                    let plane = opposite_plane(body, settings, triangle, probe, pairing.range)?;
                    plane.at(corners[k], body.normals[triangle]).filter(is_plausible)
                });
                let depth = found.map_or(mean, |found| Depth { depth: found.depth, half: found.half });
                let (u, v) = (corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]);
                let weight = corner_angle(u, v);
                let vertex = body.vertices(triangle)[k];
                entries.push(Entry { vertex, segment: segments.of[triangle], corner: (triangle, k), weight, depth });
            }
        }
        let mut known = BTreeMap::new();
        entries.sort_by_key(|entry| (entry.vertex, entry.segment, entry.corner));
        let mut depths = vec![[Depth::default(); 3]; body.triangle_count()];
        for around in entries.chunk_by(|a, b| (a.vertex, a.segment) == (b.vertex, b.segment)) {
            let depth = median(around);
            for &Entry { corner: (triangle, k), .. } in around {
                depths[triangle][k] = depth;
            }
            known.insert((around[0].vertex, around[0].segment), depth);
        }
        fill_gaps(body, segments, gaps, known, &mut depths);
        Self(depths)
    }

    pub(super) fn of(&self, triangle: usize) -> &[Depth; 3] {
        &self.0[triangle]
    }

    /// How far the depths between the corners are from the measured ones: the squares, in half-thicknesses, times the
    /// area that they stand for.
    pub(super) fn squared_error(&self, body: &Body, pairing: &Pairing, triangle: usize) -> f64 {
        let samples = pairing.of(triangle);
        let share = body.areas[triangle] / samples.len().max(1) as f64;
        let errors = samples.iter().filter_map(|sample| {
            let measured = sample.opposite?;
            let weights = barycentric_of(&body.facets.corners[triangle], sample.point);
            let between: f64 = (0..3).map(|k| weights[k] * self.0[triangle][k].depth).sum();
            Some(((between - measured.depth) / measured.half).powi(2))
        });
        share * errors.sum::<f64>()
    }
}

/// The angle between two directions.
pub(super) fn corner_angle(u: glam::DVec3, v: glam::DVec3) -> f64 {
    f64::from(bevy_math::ops::atan2(u.cross(v).length() as f32, u.dot(v) as f32))
}

/// Gives the triangles `gaps`, which have no depth of their own, that of the corners around them, from the outside
/// inwards.
fn fill_gaps(
    body: &Body,
    segments: &Segments,
    mut gaps: Vec<usize>,
    mut known: BTreeMap<(usize, u32), Depth>,
    depths: &mut [[Depth; 3]],
) {
    while !gaps.is_empty() {
        let mut found = Vec::new();
        let before = gaps.len();
        gaps.retain(|&triangle| {
            let corners = body.vertices(triangle).map(|vertex| known.get(&(vertex, segments.of[triangle])).copied());
            let (mut sum, mut count) = (Depth::default(), 0.0);
            for depth in corners.iter().flatten() {
                sum = Depth { depth: sum.depth + depth.depth, half: sum.half + depth.half };
                count += 1.0;
            }
            if count == 0.0 {
                return true;
            }
            let mean = Depth { depth: sum.depth / count, half: sum.half / count };
            depths[triangle] = corners.map(|depth| depth.unwrap_or(mean));
            found.push(triangle);
            false
        });
        if gaps.len() == before {
            break;
        }
        for triangle in found {
            for (vertex, depth) in body.vertices(triangle).into_iter().zip(depths[triangle]) {
                known.entry((vertex, segments.of[triangle])).or_insert(depth);
            }
        }
    }
}

/// The mean over the samples of a triangle.
fn mean_depth(pairing: &Pairing, triangle: usize) -> Option<Depth> {
    let opposites = pairing.of(triangle).iter().filter_map(|sample| sample.opposite);
    let (depth, half, count) = opposites
        .fold((0.0, 0.0, 0.0), |(depth, half, count), found| (depth + found.depth, half + found.half, count + 1.0));
    (count > 0.0).then(|| Depth { depth: depth / count, half: half / count })
}

/// The weighted median, by depth. A triangle that sees another wall does not count.
fn median(entries: &[Entry]) -> Depth {
    let mut order: Vec<(f64, Depth)> = entries.iter().map(|entry| (entry.weight, entry.depth)).collect();
    order.sort_by(|a, b| a.1.depth.total_cmp(&b.1.depth));
    let total: f64 = order.iter().map(|(weight, _)| weight).sum();
    let mut before = 0.0;
    for &(weight, depth) in &order {
        before += weight;
        if before >= 0.5 * total {
            return depth;
        }
    }
    order.last().map_or(Depth::default(), |last| last.1)
}
