//! Brute force in f64: the least of |x − y| − t(x) − t(y) over two triangles, between two bounds.
//!
//! Triangles are halved until the bounds agree. For a unit vector d, |x − y| is at least d · (y − x), which is linear, so its
//! least over two parts with their thicknesses is at corners. Nothing is shared with the code that is tested.

use std::{cmp::Ordering, collections::BinaryHeap};

use glam::DVec3;

/// A triangle with the thickness at its corners. A segment or a point has corners twice.
#[derive(Clone, Copy, Debug)]
pub struct Thick {
    pub corners: [DVec3; 3],
    pub thickness: [f64; 3],
}

impl Thick {
    pub fn point(corner: DVec3, thickness: f64) -> Self {
        Self { corners: [corner; 3], thickness: [thickness; 3] }
    }

    pub fn segment(ends: [DVec3; 2], thickness: f64) -> Self {
        Self { corners: [ends[0], ends[1], ends[1]], thickness: [thickness; 3] }
    }

    fn middle(&self) -> (DVec3, f64) {
        (self.corners.iter().sum::<DVec3>() / 3.0, self.thickness.iter().sum::<f64>() / 3.0)
    }

    fn places(&self) -> [(DVec3, f64); 4] {
        let corner = |corner: usize| (self.corners[corner], self.thickness[corner]);
        [self.middle(), corner(0), corner(1), corner(2)]
    }

    /// The longest edge, and its length.
    fn longest(&self) -> (usize, f64) {
        let length = |edge: usize| self.corners[edge].distance(self.corners[(edge + 1) % 3]);
        (0..3).map(|edge| (edge, length(edge))).max_by(|one, other| one.1.total_cmp(&other.1)).expect("three edges")
    }

    fn halved(&self, edge: usize) -> [Self; 2] {
        let (from, to) = (edge, (edge + 1) % 3);
        let corner = (self.corners[from] + self.corners[to]) * 0.5;
        let thickness = (self.thickness[from] + self.thickness[to]) * 0.5;
        let mut halves = [*self; 2];
        for (half, replaced) in halves.iter_mut().zip([to, from]) {
            (half.corners[replaced], half.thickness[replaced]) = (corner, thickness);
        }
        halves
    }
}

/// Bounds of the least of |x − y| − t(x) − t(y).
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub least: f64,
    pub most: f64,
}

struct Part {
    least: f64,
    sides: [Thick; 2],
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Part {}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Part {
    /// The part with the lowest bound comes first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.least.total_cmp(&self.least)
    }
}

fn lower_bound([a, b]: &[Thick; 2]) -> f64 {
    let along = |direction: DVec3| {
        let least = |side: &Thick, direction: DVec3| {
            (0..3)
                .map(|corner| direction.dot(side.corners[corner]) - side.thickness[corner])
                .fold(f64::INFINITY, f64::min)
        };
        least(b, direction) + least(a, -direction)
    };
    let normal = |side: &Thick| (side.corners[1] - side.corners[0]).cross(side.corners[2] - side.corners[0]);
    let between = b.middle().0 - a.middle().0;
    let directions = [between, normal(a), -normal(a), normal(b), -normal(b)];
    directions.into_iter().filter_map(DVec3::try_normalize).map(along).fold(along(DVec3::ZERO), f64::max)
}

fn upper_bound([a, b]: &[Thick; 2]) -> f64 {
    let others = b.places();
    let all = a.places().into_iter().flat_map(|own| others.map(|other| (own, other)));
    all.map(|((x, tx), (y, ty))| x.distance(y) - tx - ty).fold(f64::INFINITY, f64::min)
}

/// Bounds that differ by at most `tolerance`, or both have the sign that is asked for, or that are as close as 20,000 parts
/// make them.
pub fn least(a: Thick, b: Thick, tolerance: f64, only_sign: bool) -> Bounds {
    let sides = [a, b];
    let mut most = upper_bound(&sides);
    let mut parts = BinaryHeap::from([Part { least: lower_bound(&sides), sides }]);
    for _ in 0..20_000 {
        let Some(Part { least, sides }) = parts.pop() else { break };
        if most - least <= tolerance || only_sign && (least > 0.0 || most <= 0.0) {
            return Bounds { least, most };
        }
        let longest = [sides[0].longest(), sides[1].longest()];
        let side = usize::from(longest[1].1 > longest[0].1);
        for half in sides[side].halved(longest[side].0) {
            let mut sides = sides;
            sides[side] = half;
            most = most.min(upper_bound(&sides));
            parts.push(Part { least: lower_bound(&sides), sides });
        }
    }
    Bounds { least: parts.peek().map_or(most, |part| part.least), most }
}
