//! From a contact to its constraint, or to none if it would hold what has to move apart.

use arrayvec::ArrayVec;
use bevy_ecs::prelude::*;
use glam::DVec3;

use super::{Between, Gatherer, Side};
use crate::{
    contacts::StoredPair,
    kernel::{
        contact::CompactContact,
        mesh::feature::{Feature, FeatureKind},
    },
    response::{
        contact::{ContactConstraint, Features},
        particles::Particles,
        reaction::NO_REACTION,
        record::{MoveBack, completed, detected_sum, edges_of, face_of, flat, normal_of, untangling},
        scene::Scene,
    },
    surface::ContactSide,
};

impl Gatherer {
    /// The constraint of a contact. Vertices of its triangles that have no particles get some.
    pub(super) fn constraint(
        &mut self,
        particles: &mut Particles,
        scene: &Scene<'_, '_>,
        between: &Between<'_>,
        record: &CompactContact,
    ) -> Option<ContactConstraint> {
        let &Between { pair, sides: [side, other], friction } = between;
        let normal = normal_of(pair, record)?;
        let triangles = self.triangles_below(particles, scene, between, record);
        let corners = self.corners(particles, scene, &side, &pair.poses[0], triangles[0])?;
        let Side::Shape { entity } = other else {
            let others = self.corners(particles, scene, &other, &pair.poses[1], triangles[1])?;
            return self.surface_constraint(particles, scene, between, (record, normal), [corners, others]);
        };
        let shape = (entity, self.rigid_body(entity));
        let is_held = !self.is_let_through(pair, record, corners, None);
        is_held.then(|| against_shape(scene, particles, pair, record, (corners, shape, normal), friction))
    }

    /// Whether a contact would hold what is depenetrated or crosses a boundary. The particles of its triangles are given.
    fn is_let_through(&self, pair: &StoredPair, record: &CompactContact, a: [u32; 3], b: Option<[u32; 3]>) -> bool {
        let is_crossing = record.features.kind() == FeatureKind::EdgeFace;
        // A body that is depenetrated moves in one direction as a whole. Its own contacts with the solid would pull
        // against it.
        let is_leaving = |corners: [u32; 3], other: ContactSide| {
            corners.iter().any(|&corner| self.insides.is_leaving(other.entity(), corner))
        };
        let goes_back = self.back.is_some() && is_crossing;
        if !goes_back && (is_leaving(a, pair.b) || b.is_some_and(|b| is_leaving(b, pair.a))) {
            return true;
        }
        // A triangle that crosses the boundary keeps only its vertex contacts: its vertices may still rest on the
        // boundary.
        let crosses = |side: ContactSide, other: ContactSide, triangle: u32, feature: Feature| {
            !matches!(feature, Feature::Vertex(_)) && self.is_crossing(side.entity(), other.entity(), triangle)
        };
        !is_crossing
            && (crosses(pair.a, pair.b, record.triangle_a, record.features.a)
                || b.is_some() && crosses(pair.b, pair.a, record.triangle_b, record.features.b))
    }

    /// The constraint of a contact between two triangles of surfaces, whose particles are given, as is its direction.
    pub(super) fn surface_constraint(
        &self,
        particles: &Particles,
        scene: &Scene<'_, '_>,
        &Between { pair, friction, .. }: &Between<'_>,
        (record, normal): (&CompactContact, DVec3),
        [a, b]: [[u32; 3]; 2],
    ) -> Option<ContactConstraint> {
        if self.is_let_through(pair, record, a, Some(b)) {
            return None;
        }
        let distance = f64::from(pair.contact_distance_at(record));
        let is_crossing = record.features.kind() == FeatureKind::EdgeFace;
        let has_inside = pair.one_sided.contains(&true);
        // A pair that the guard kept apart has not passed through, even if a rotation brought it to the other side of
        // the normal.
        let is_apart = pair.nearest > 0.0 && [pair.a, pair.b].iter().any(|side| scene.is_swept(side.entity()));
        let is_wrong_side = record.distance < 0.0 && !has_inside && is_apart;
        let normal = if is_wrong_side { -normal } else { normal };
        let penetrated = record.distance < 0.0 && !is_wrong_side;
        let (features, normal) = match (record.features.a, record.features.b) {
            // Between patches, which the particles do not know: what detection found holds for the tick.
            _ if pair.is_smooth && !is_crossing => (flat(particles, record, [a, b], normal, distance), normal),
            (Feature::Vertex(corner), Feature::Face) => (face_of(a[corner as usize], b), normal),
            (Feature::Face, Feature::Vertex(corner)) => (face_of(b[corner as usize], a), -normal),
            (Feature::Edge(edge_a), Feature::Edge(edge_b)) => (edges_of(a, edge_a, b, edge_b), normal),
            (Feature::Vertex(corner), _) if !penetrated => (face_of(a[corner as usize], b), normal),
            (_, Feature::Vertex(corner)) if !penetrated => (face_of(b[corner as usize], a), -normal),
            (Feature::Edge(_), Feature::Face) | (Feature::Face, Feature::Edge(_)) => {
                let firsts = [pair.a, pair.b].map(|side| self.first_particle(side.entity()));
                return if has_inside && pair.a != pair.b {
                    None
                } else {
                    let move_back =
                        self.back.map_or_else(|| MoveBack::Edge { crowd: self.crowd([a, b]) }, MoveBack::Part);
                    untangling(particles, pair, record, [a, b], firsts, move_back)
                };
            }
            _ => (flat(particles, record, [a, b], normal, distance), normal),
        };
        // Next to a crossing, a contact would hold features on the wrong side.
        let is_tangled = |corners: [u32; 3]| corners.iter().any(|corner| self.tangled.contains_key(corner));
        if !penetrated && is_tangled(a) && is_tangled(b) {
            return None;
        }
        Some(ContactConstraint { parts: features, normal, distance, friction, reaction: NO_REACTION, recovers: false })
    }
}

/// A contact with a rigid shape. The contact point on the shape moves with the shape.
fn against_shape(
    scene: &Scene<'_, '_>,
    particles: &mut Particles,
    pair: &StoredPair,
    record: &CompactContact,
    (corners, (shape, body), normal): ([u32; 3], (Entity, Option<u32>), DVec3),
    friction: [f64; 2],
) -> ContactConstraint {
    let now = pair.poses[1];
    let start = pair.frame_pose.transform_point(record.point_b.as_dvec3());
    let ahead = scene.motions.course(shape).map(|course| course.ahead.pose);
    let end = ahead.map_or(start, |ahead| ahead.transform_point(now.inverse().transform_point(start)));
    let place = particles.len() as u32;
    particles.push_on_body(body, [start, end]);
    let weights = completed(record.features.a, record.barycentric_a);
    let mut entries: ArrayVec<(u32, f64), 6> = ArrayVec::new();
    entries.extend(corners.into_iter().zip(weights).filter(|&(_, weight)| weight != 0.0));
    entries.push((place, -1.0));
    let distance = f64::from(pair.contact_distance_at(record));
    let separation = f64::from(record.distance) - distance;
    let offset = separation - normal.dot(detected_sum(particles, &entries));
    let features = Features::Plane { particles: entries, offset };
    ContactConstraint { parts: features, normal, distance, friction, reaction: NO_REACTION, recovers: false }
}
