//! Generated motions of a vertex and a face or of two edges, from easy to degenerate, and their reference distances.

use crate::common::Random;
use bevy_circumsphere::kernel::ccd::{FeatureImpact, edge_edge_impact, vertex_face_impact};
use circumsphere_truth::{point_triangle, segment_segment};
use glam::{DQuat, DVec3};

/// The features that the four points form: a vertex and the corners of a face, or the ends of two edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    VertexFace,
    EdgeEdge,
}

pub const KINDS: [Kind; 2] = [Kind::VertexFace, Kind::EdgeEdge];

/// Four points at the start and at the end of a step.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    pub kind: Kind,
    pub start: [DVec3; 4],
    pub end: [DVec3; 4],
}

impl Kind {
    /// The number of points in the first feature.
    pub fn first_count(self) -> usize {
        match self {
            Self::VertexFace => 1,
            Self::EdgeEdge => 2,
        }
    }

    /// The reference distance of the features.
    pub fn distance(self, points: &[DVec3; 4]) -> f64 {
        let [p, q, r, s] = *points;
        match self {
            Self::VertexFace => point_triangle(p, &[q, r, s]).distance,
            Self::EdgeEdge => segment_segment(p, q, r, s).distance,
        }
    }
}

impl Motion {
    /// The points at a given time, relative to the first point, so that rounding depends only on their distances.
    pub fn at(&self, time: f64) -> [DVec3; 4] {
        let offset = |points: &[DVec3; 4], k: usize| points[k] - points[0];
        std::array::from_fn(|k| offset(&self.start, k) * (1.0 - time) + offset(&self.end, k) * time)
    }

    pub fn distance_at(&self, time: f64) -> f64 {
        self.kind.distance(&self.at(time))
    }

    /// The largest coordinate difference between the two features. Resolutions are relative to it.
    pub fn size(&self) -> f64 {
        let first = self.kind.first_count();
        let of = |points: &[DVec3; 4]| {
            let pairs = (0..first).flat_map(|k| (first..4).map(move |l| points[k] - points[l]));
            pairs.map(|difference| difference.abs().max_element()).fold(0.0, f64::max)
        };
        of(&self.start).max(of(&self.end))
    }

    pub fn impact(&self, separation: f64) -> Option<FeatureImpact> {
        match self.kind {
            Kind::VertexFace => vertex_face_impact(&self.start, &self.end, separation),
            Kind::EdgeEdge => edge_edge_impact(&self.start, &self.end, separation),
        }
    }

    pub fn map(&self, change: impl Fn(DVec3) -> DVec3) -> Self {
        Self { kind: self.kind, start: self.start.map(&change), end: self.end.map(&change) }
    }
}

/// The kinds of motions that [`motion`] generates.
pub const FAMILIES: [&str; 12] = [
    "random",
    "touching at some time",
    "passing nearby",
    "grazing",
    "integer grid",
    "nearly in one plane",
    "nearly on one line",
    "far in one step",
    "turning",
    "coinciding or still points",
    "lengths of 1e-6 to 1e6",
    "far from the origin",
];

/// Signed weights of the four points, positive for the first feature, that connect two points in the interiors of the
/// features, on their boundaries, or at corners.
fn connection(kind: Kind, random: &mut Random) -> [f64; 4] {
    let weights = random.weights();
    let (along, other) = (random.unit(), random.unit());
    match (kind, random.below(3)) {
        (Kind::VertexFace, 0) => [1.0, -weights[0], -weights[1], -weights[2]],
        (Kind::VertexFace, 1) => [1.0, along - 1.0, -along, 0.0],
        (Kind::EdgeEdge, 0) => [1.0 - other, other, along - 1.0, -along],
        (Kind::EdgeEdge, 1) => [1.0, 0.0, along - 1.0, -along],
        _ => [1.0, 0.0, -1.0, 0.0],
    }
}

/// Four points that touch at a random time, up to rounding and `clearance`. `grazing` removes all but a small share of
/// the normal velocity.
fn meeting(kind: Kind, random: &mut Random, clearance: f64, grazing: bool) -> Motion {
    let first = kind.first_count();
    let mut points: [DVec3; 4] = std::array::from_fn(|_| random.vector());
    let mut velocities: [DVec3; 4] = std::array::from_fn(|_| random.vector());
    let weights = connection(kind, random);
    let sum = |vectors: &[DVec3; 4]| (0..4).map(|k| vectors[k] * weights[k]).sum::<DVec3>();
    let across = match kind {
        Kind::VertexFace => (points[2] - points[1]).cross(points[3] - points[1]),
        Kind::EdgeEdge => (points[1] - points[0]).cross(points[3] - points[2]),
    }
    .normalize_or(DVec3::X);
    let direction = if random.below(2) == 0 { across } else { random.direction() };
    let shift = direction * clearance - sum(&points);
    let approach = across * (sum(&velocities).dot(across) * (1.0 - random.power_of_ten(-12.0, 0.0)));
    for k in 0..first {
        points[k] += shift;
        if grazing {
            velocities[k] -= approach;
        }
    }
    let time = random.unit();
    Motion {
        kind,
        start: std::array::from_fn(|k| points[k] - velocities[k] * time),
        end: std::array::from_fn(|k| points[k] + velocities[k] * (1.0 - time)),
    }
}

/// A motion of one of [`FAMILIES`].
pub fn motion(random: &mut Random, family: usize, kind: Kind) -> Motion {
    let first = kind.first_count();
    let small = random.power_of_ten(-13.0, 0.0);
    let scattered =
        |random: &mut Random, stretch: DVec3| -> [DVec3; 4] { std::array::from_fn(|_| random.vector() * stretch) };
    let between = |random: &mut Random, stretch: DVec3| {
        let (start, end) = (scattered(random, stretch), scattered(random, stretch));
        Motion { kind, start, end }
    };
    match FAMILIES[family] {
        "random" => between(random, DVec3::ONE),
        "touching at some time" => meeting(kind, random, 0.0, false),
        "passing nearby" => meeting(kind, random, small, false),
        "grazing" => meeting(kind, random, small, true),
        "integer grid" => {
            let mut grid = || std::array::from_fn(|_| random.grid_point(2));
            Motion { kind, start: grid(), end: grid() }
        }
        "nearly in one plane" => between(random, DVec3::new(1.0, 1.0, small)),
        "nearly on one line" => between(random, DVec3::new(1.0, small, small)),
        "far in one step" => {
            let mut motion = between(random, DVec3::ONE);
            let way = random.vector() * random.power_of_ten(0.0, 6.0);
            let before = random.unit();
            for k in 0..first {
                motion.start[k] -= way * before;
                motion.end[k] += way * (1.0 - before);
            }
            motion
        }
        "turning" => {
            let start = scattered(random, DVec3::ONE);
            let turn = DQuat::from_axis_angle(random.direction(), random.range(-3.1, 3.1));
            let (center, shift) = (random.vector(), random.vector() * 0.3);
            let turned = |k: usize| if k < first { start[k] } else { turn * (start[k] - center) + center + shift };
            Motion { kind, start, end: std::array::from_fn(turned) }
        }
        "coinciding or still points" => {
            let Motion { mut start, mut end, .. } = between(random, DVec3::ONE);
            let [k, l, m] = [0; 3].map(|_| random.below(4));
            match random.below(4) {
                0 => (start[k], end[k]) = (start[l], end[l]),
                1 => start[k] = start[l],
                2 => end = start,
                _ => (start[k], end[k]) = ((start[l] + start[m]) * 0.5, (end[l] + end[m]) * 0.5),
            }
            Motion { kind, start, end }
        }
        "lengths of 1e-6 to 1e6" => {
            let length = random.power_of_ten(-6.0, 6.0);
            meeting(kind, random, 0.0, false).map(|point| point * length)
        }
        _ => {
            let shift = random.direction() * random.power_of_ten(3.0, 6.0);
            meeting(kind, random, 0.0, false).map(|point| point + shift)
        }
    }
}
