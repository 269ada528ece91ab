//! The results of the swept stage. `contacts` reads them.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use crate::kernel::{
    ccd::ImpactCause,
    mesh::{feature::FeaturePair, ids::TriangleId, topology::SurfaceTopology},
};

/// The first impact of two triangles of a pair of surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SweptImpact {
    /// 0 at the start of the motion, 1 at its end. Never later than the true time.
    pub time: f64,
    /// Why the search for the time ended: see [`ImpactCause`].
    pub cause: ImpactCause,
    /// Triangle of the first surface. In a self-collision, the lower one.
    pub triangle_a: TriangleId,
    /// Triangle of the second surface. For a shape that is tested by formula, one of those that stand for it.
    pub triangle_b: TriangleId,
    /// The part of a compound. Otherwise 0.
    pub part_b: u32,
    /// The features that meet: a vertex and a face, or two edges. An edge and a face if they cross at the start.
    pub features: FeaturePair,
    /// Weights of the first triangle's corners at that time. They sum to 1.
    pub barycentric_a: [f32; 3],
    /// Weights of the second triangle's corners at that time. They sum to 1.
    pub barycentric_b: [f32; 3],
    /// World unit vector from the first surface to the second at that time. Zero if they touch or cross at the start.
    pub normal: Vec3,
}

/// Two surfaces that meet during their motion, or one that meets itself.
#[derive(Clone, Debug)]
pub struct SweptPair {
    /// The first surface by its [order](crate::SurfaceOrder). Rigid shapes come last.
    pub a: Entity,
    /// The second surface. In a self-collision, the same.
    pub b: Entity,
    /// The first impact of each pair of triangles, sorted by part, first triangle, and second triangle.
    pub impacts: Vec<SweptImpact>,
    /// The index of the earliest impact. If several are at the same time, the first in the list.
    pub(crate) earliest: usize,
    pub(crate) topology_a: Arc<SurfaceTopology>,
    /// `None` for a shape that is tested by formula.
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

/// Whether anything reads impacts. Without this resource, something may.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub(crate) struct ImpactsRead(pub(crate) bool);

/// Exists in every system that reads impacts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ImpactReader;

impl FromWorld for ImpactReader {
    fn from_world(world: &mut World) -> Self {
        world.insert_resource(ImpactsRead(true));
        Self
    }
}

/// The impacts of the last detection, between whatever has [`SweptCollision`](crate::SweptCollision) and other surfaces
/// and rigid shapes. Pairs that do not meet are left out.
///
/// Most systems read it through [`SurfaceImpacts`](crate::SurfaceImpacts). With
/// [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin), which sweeps bodies by itself, it is only filled if one
/// does.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct SweptImpacts {
    /// The pairs, sorted by the order of both sides.
    pub pairs: Vec<SweptPair>,
}
