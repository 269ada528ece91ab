//! The system parameter that reads the impacts of fast motion, which the swept stage found in the last detection.
//!
//! An impact is when two moving triangles first meet. A contact is how two triangles are placed now. Neither implies
//! the other.

use std::fmt::{self, Debug, Formatter};

use arrayvec::ArrayVec;
use bevy_ecs::{prelude::*, system::SystemParam};
use glam::Vec3;

use super::reading::{StencilEntry, stencil_side};
use crate::{
    detection::{ImpactReader, SweptImpact, SweptImpacts, SweptPair},
    kernel::{
        ccd::ImpactCause,
        mesh::{
            feature::{Feature, FeatureKind},
            ids::TriangleId,
            topology::SurfaceTopology,
        },
    },
};

/// Reads the impacts of the last detection. Does not borrow positions, so a solver can write them at the same time.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// fn stop_in_time(impacts: SurfaceImpacts) {
///     for impact in impacts.iter().filter(|impact| impact.time() < 1.0) {
///         println!("{} meets {} at {}", impact.a(), impact.b(), impact.time());
///     }
/// }
/// # bevy_ecs::system::IntoSystem::into_system(stop_in_time);
/// ```
#[derive(SystemParam)]
pub struct SurfaceImpacts<'w, 's> {
    found: Res<'w, SweptImpacts>,
    _reader: Local<'s, ImpactReader>,
}

impl SurfaceImpacts<'_, '_> {
    /// All impacts, each once, in the order of [`SweptImpacts`].
    pub fn iter(&self) -> impl Iterator<Item = Impact<'_>> {
        self.found.pairs.iter().flat_map(|pair| pair.read(false))
    }

    /// The impacts of one surface, with `entity` as the first side of each. An impact of two surfaces belongs to both
    /// of them. [`iter`](Self::iter) returns it once.
    pub fn impacts_with(&self, entity: Entity) -> impl Iterator<Item = Impact<'_>> {
        let pairs = self.found.pairs.iter().filter(move |pair| pair.a == entity || pair.b == entity);
        pairs.flat_map(move |pair| pair.read(pair.a != entity))
    }

    /// The impacts between two surfaces, with `a` as the first side of each. Pass the same entity twice for the impacts
    /// of a surface with itself.
    pub fn between(&self, a: Entity, b: Entity) -> impl Iterator<Item = Impact<'_>> {
        self.pairs_between(a, b).flat_map(move |pair| pair.read(pair.a != a))
    }

    /// The earliest impact between two surfaces, with `a` as its first side. If several are at the same time, the one
    /// whose triangles come first.
    #[must_use]
    pub fn first(&self, a: Entity, b: Entity) -> Option<Impact<'_>> {
        self.pairs_between(a, b).find_map(|pair| pair.read(pair.a != a).nth(pair.earliest))
    }

    fn pairs_between(&self, a: Entity, b: Entity) -> impl Iterator<Item = &SweptPair> {
        self.found.pairs.iter().filter(move |pair| [pair.a, pair.b] == [a, b] || [pair.b, pair.a] == [a, b])
    }
}

impl SweptPair {
    fn read(&self, swapped: bool) -> impl Iterator<Item = Impact<'_>> {
        self.impacts.iter().map(move |record| Impact { pair: self, record, swapped })
    }
}

/// An impact, seen from one of its sides.
#[derive(Clone, Copy)]
pub struct Impact<'a> {
    pair: &'a SweptPair,
    record: &'a SweptImpact,
    swapped: bool,
}

/// Omits the surfaces, which the impact only refers to.
impl Debug for Impact<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut impact = formatter.debug_struct("Impact");
        impact.field("a", &self.a()).field("b", &self.b()).field("features", &self.features());
        impact.field("triangles", &self.triangles()).field("normal", &self.normal());
        impact.field("time", &self.time()).field("cause", &self.cause()).finish_non_exhaustive()
    }
}

impl Impact<'_> {
    /// Puts two values of the record, of its first and second side, into the order in which the impact is seen.
    fn pick<T>(&self, first: T, second: T) -> (T, T) {
        if self.swapped { (second, first) } else { (first, second) }
    }

    /// The first side.
    #[must_use]
    pub fn a(&self) -> Entity {
        self.pick(self.pair.a, self.pair.b).0
    }

    /// The second side.
    #[must_use]
    pub fn b(&self) -> Entity {
        self.pick(self.pair.a, self.pair.b).1
    }

    /// When the triangles meet: 0 at the start of the motion, 1 at its end. Never later than the true time.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.record.time
    }

    /// Whether the triangles reach each other during the motion, or touch or cross at its start, or the search was
    /// stopped.
    #[must_use]
    pub fn cause(&self) -> ImpactCause {
        self.record.cause
    }

    /// The kinds of features that meet.
    #[must_use]
    pub fn kind(&self) -> FeatureKind {
        self.record.features.kind()
    }

    /// The features of the first and second side, by their indices within the triangles.
    #[must_use]
    pub fn features(&self) -> (Feature, Feature) {
        self.pick(self.record.features.a, self.record.features.b)
    }

    /// The triangles of the first and second side, in the game's numbering. `None` for a rigid shape that is tested by
    /// formula.
    #[must_use]
    pub fn triangles(&self) -> (Option<TriangleId>, Option<TriangleId>) {
        let of_b = self.pair.topology_b.as_ref().map(|_| self.record.triangle_b);
        self.pick(Some(self.record.triangle_a), of_b)
    }

    /// The weights of the corners of the first and second triangle where they meet. Each triple sums to 1. Meaningless
    /// for a rigid shape that is tested by formula.
    #[must_use]
    pub fn barycentrics(&self) -> ([f32; 3], [f32; 3]) {
        self.pick(self.record.barycentric_a, self.record.barycentric_b)
    }

    /// World unit normal from the first side to the second, when they meet. Zero if they touch or cross at the start.
    #[must_use]
    pub fn normal(&self) -> Vec3 {
        if self.swapped { -self.record.normal } else { self.record.normal }
    }

    /// The vertices that meet, with signed weights: at most three per side, none of a rigid shape that is tested by
    /// formula. A rigid shape made of triangles has entries, although its vertices must not be moved.
    #[must_use]
    pub fn stencil(&self) -> ArrayVec<StencilEntry, 6> {
        let normal = self.normal();
        let mut stencil = ArrayVec::new();
        let mut side =
            |entity: Entity, topology: &SurfaceTopology, triangle: TriangleId, weights: [f32; 3], sign: f32| {
                stencil.extend(stencil_side(entity, topology.triangles()[triangle.index()], weights, (sign, normal)));
            };
        let (sign_a, sign_b) = self.pick(-1.0, 1.0);
        let SweptPair { topology_a, topology_b, .. } = self.pair;
        side(self.pair.a, topology_a, self.record.triangle_a, self.record.barycentric_a, sign_a);
        if let Some(topology_b) = topology_b {
            side(self.pair.b, topology_b, self.record.triangle_b, self.record.barycentric_b, sign_b);
        }
        stencil
    }
}
