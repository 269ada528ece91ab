//! What the response reads from the world.

use bevy_ecs::{prelude::*, system::SystemParam};
use glam::DVec3;

use super::{
    body::{SurfaceFriction, XpbdBody},
    forces::{SurfaceForces, SurfaceWind},
    inside::Crossing,
    motion::Motions,
    reaction::SurfaceReaction,
    record::completed,
    tethers::XpbdTethers,
};
use crate::{
    contacts::{ContactStore, StoredPair},
    detection::{SharedList, Threads},
    kernel::{contact::TouchingPair, mesh::feature::FeatureKind, pose::Pose},
    settings::CircumsphereSettings,
    surface::{ActiveShape, ActiveSurfaces, ContactFilter, SurfacePositions, SweptCollision, TetrahedralBody},
};

/// A surface, with its body and its tetrahedra if it has any.
type PositionsOf = (Ref<'static, SurfacePositions>, Option<&'static XpbdBody>, Option<&'static TetrahedralBody>);

/// What the response reads from the world.
#[derive(SystemParam)]
pub(super) struct Scene<'w, 's> {
    pub(super) active: Res<'w, ActiveSurfaces>,
    pub(super) motions: ResMut<'w, Motions>,
    pub(super) positions: Query<'w, 's, PositionsOf>,
    pub(super) store: Res<'w, ContactStore>,
    pub(super) tethers: Query<'w, 's, &'static XpbdTethers>,
    pub(super) winds: Query<'w, 's, &'static SurfaceWind>,
    pub(super) forces: Query<'w, 's, &'static SurfaceForces>,
    pub(super) filter: Option<Res<'w, ContactFilter>>,
    detection: Res<'w, CircumsphereSettings>,
    reactions: Query<'w, 's, (), With<SurfaceReaction>>,
    names: Query<'w, 's, &'static Name>,
    frictions: Query<'w, 's, &'static SurfaceFriction>,
    swept: Query<'w, 's, (), With<SweptCollision>>,
}

impl Scene<'_, '_> {
    /// The threads that may work.
    pub(super) fn threads(&self) -> Threads {
        Threads(self.detection.threads)
    }

    pub(super) fn name(&self, entity: Entity) -> Option<&Name> {
        self.names.get(entity).ok()
    }

    pub(super) fn is_any_swept(&self) -> bool {
        !self.swept.is_empty()
    }

    /// Whether the impulses of an entity's contacts are to be written to it.
    pub(super) fn wants_reaction(&self, entity: Entity) -> bool {
        !self.reactions.is_empty() && self.reactions.contains(entity)
    }

    pub(super) fn is_swept(&self, entity: Entity) -> bool {
        self.swept.contains(entity)
    }

    /// Whether the solver moves a surface, unless it sleeps.
    pub(super) fn is_body(&self, entity: Entity) -> bool {
        self.positions.get(entity).is_ok_and(|(_, body, _)| body.is_some())
    }

    /// Whether pinned vertices or tethers hold a body.
    pub(super) fn is_held(&self, entity: Entity) -> bool {
        let is_pinned = |body: &XpbdBody| body.inverse_masses.iter().any(|&inverse_mass| inverse_mass <= 0.0);
        let body = self.positions.get(entity).ok().and_then(|(_, body, _)| body);
        body.is_some_and(is_pinned) || self.tethers.contains(entity)
    }

    /// Distance from a surface to the nearest other side in the contact store, at most the contact distance.
    pub(super) fn nearest(&self, entity: Entity) -> Option<f64> {
        let distances = self.store.pairs_of(entity).map(|pair| pair.clearance().min(f64::from(pair.contact_distance)));
        distances.reduce(f64::min)
    }

    /// The touching pairs of triangles of two surfaces, or of a surface and a shape.
    pub(super) fn touching(&self) -> impl Iterator<Item = ([Entity; 2], &SharedList<TouchingPair>)> {
        self.store.pairs.iter().map(|pair| ([pair.a.entity(), pair.b.entity()], &pair.touching))
    }

    /// Distance between two surfaces, or less, if detection stored a pair of them.
    pub(super) fn nearest_of(&self, a: Entity, b: Entity) -> Option<f64> {
        self.store.pairs_between(a, b).next().map(StoredPair::clearance)
    }

    /// Whether contacts show that a body is inside a solid: they cross, or are deeper than `shallow`.
    pub(super) fn is_deep_in(&self, body: Entity, solid: Entity, shallow: f64) -> bool {
        let mut records = self.store.pairs_between(body, solid).flat_map(|pair| pair.contacts.iter());
        records.any(|record| record.features.kind() == FeatureKind::EdgeFace || f64::from(record.distance) < -shallow)
    }

    /// The places where triangles of a body cross another side, sorted by triangle.
    pub(super) fn crossing_of(&self, body: Entity, other: Entity) -> Vec<Crossing> {
        let mut crossing = Vec::new();
        for pair in self.store.pairs_between(body, other) {
            let records = pair.contacts.iter().filter(|record| record.features.kind() == FeatureKind::EdgeFace);
            crossing.extend(records.map(|record| {
                let (triangle, feature, weights) = if pair.a.entity() == body {
                    (record.triangle_a, record.features.a, record.barycentric_a)
                } else {
                    (record.triangle_b, record.features.b, record.barycentric_b)
                };
                Crossing { triangle, feature, weights: completed(feature, weights) }
            }));
        }
        crossing.sort_by_key(|crossing| crossing.triangle);
        crossing
    }

    /// Start and end of a vertex in this part of the tick, for a surface that the solver does not move. `pose` is used
    /// if it is static.
    pub(super) fn ends(&self, entity: Entity, pose: &Pose, vertex: usize) -> Option<[DVec3; 2]> {
        if let Some(course) = self.motions.course(entity) {
            return Some([course.now.point(vertex), course.ahead.point(vertex)]);
        }
        let (positions, ..) = self.positions.get(entity).ok()?;
        Some([pose.transform_point(positions.0.get(vertex)?.as_dvec3()); 2])
    }

    /// Pose of a shape at the beginning and at the end of this part of the tick.
    pub(super) fn poses(&self, shape: &ActiveShape) -> [Pose; 2] {
        let course = self.motions.course(shape.entity);
        course.map_or([shape.pose; 2], |course| [course.now.pose, *course.end()])
    }

    pub(super) fn friction(&self, a: Entity, b: Entity) -> [f64; 2] {
        let of = |entity| self.frictions.get(entity).copied().unwrap_or_default();
        of(a).between(of(b))
    }
}
