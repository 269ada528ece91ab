//! What the swept stage found in the last detection.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::Vec3;

use crate::kernel::{
    ccd::ImpactCause,
    mesh::{feature::FeaturePair, ids::TriangleId, topology::SurfaceTopology},
};

/// The first impact of two triangles of a pair of surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweptImpact {
    /// 0 where the motion begins, 1 where it ends. Never later than the true time.
    pub time: f64,
    /// Why the search for the time ended there: see [`ImpactCause`].
    pub cause: ImpactCause,
    /// A triangle of the first surface; of one surface with itself the lower one.
    pub triangle_a: TriangleId,
    /// A triangle of the second surface; of a shape tested by formula one of those that stand for it.
    pub triangle_b: TriangleId,
    /// Which part of a compound; 0 of anything else.
    pub part_b: u32,
    /// What of the triangles meets: a vertex and a face or two edges; an edge and a face where they cross to begin with.
    pub features: FeaturePair,
    /// Weights of the first triangle's corners at that time; they sum to 1.
    pub barycentric_a: [f32; 3],
    /// Weights of the second triangle's corners at that time; they sum to 1.
    pub barycentric_b: [f32; 3],
    /// World unit vector from the second surface to the first, at that time. Zero where they cross, or touch, to begin
    /// with.
    pub normal: Vec3,
}

/// Two surfaces that meet on their way, or one that meets itself.
#[derive(Clone, Debug)]
pub struct SweptPair {
    /// The first surface by its [order](crate::SurfaceOrder). Rigid shapes come last.
    pub a: Entity,
    /// The second one: the same in a self-collision.
    pub b: Entity,
    /// The first impact of each two triangles, by the part, the first triangle, then the second.
    pub impacts: Vec<SweptImpact>,
    /// The place of the earliest impact; of several at the same time the first in the list.
    pub(crate) earliest: usize,
    pub(crate) topology_a: Arc<SurfaceTopology>,
    /// None of a shape tested by formula.
    pub(crate) topology_b: Option<Arc<SurfaceTopology>>,
}

impl SweptPair {
    pub(crate) fn new(
        [a, b]: [Entity; 2],
        impacts: Vec<SweptImpact>,
        (topology_a, topology_b): (Arc<SurfaceTopology>, Option<Arc<SurfaceTopology>>),
    ) -> Self {
        let mut pair = Self { a, b, impacts, earliest: 0, topology_a, topology_b };
        pair.find_earliest();
        pair
    }

    pub(crate) fn find_earliest(&mut self) {
        self.earliest = 0;
        for (place, impact) in self.impacts.iter().enumerate() {
            if impact.time < self.impacts[self.earliest].time {
                self.earliest = place;
            }
        }
    }
}

/// The impacts of the last detection, of what has [`SweptCollision`](crate::SweptCollision) with other surfaces and rigid shapes.
/// Pairs that do not meet are left out.
///
/// Most systems read it through [`SurfaceImpacts`](crate::SurfaceImpacts).
#[derive(Resource, Clone, Debug, Default)]
pub struct SweptImpacts {
    /// The pairs, in the order of both sides.
    pub pairs: Vec<SweptPair>,
}
