//! Last stage: what the stages found becomes the store of this tick.
//!
//! Contacts are sorted by key and made unique, and a two-sided contact keeps the side it was on in the last tick.

use std::{collections::HashMap, sync::Arc};

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use glam::{DVec3, Vec3};

use super::store::{ContactSide, ContactStore, StoredPair};
use crate::{
    detection::{
        CandidateTrianglePairs, DetectionDiagnostics, MeetingCaps, OverlappingTrianglePairs, RefinedTrianglePairs,
        SphereQuery, SurfacePair, broad_phase::OtherSide, with_balls,
    },
    kernel::{
        circumsphere::Ball,
        contact::{CompactContact, TouchingPair},
        exact::{Feature, FeaturePair, rigid_shape::barycentric_of},
        sphere_pairs::{CapPair, box_gap},
        topology::SurfaceTopology,
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// Gathers contacts into the [`ContactStore`].
pub struct ContactsPlugin;

impl Plugin for ContactsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<ContactStore>();
        app.add_systems(SurfaceDetection, gather_contacts.in_set(SurfaceDetectionSystems::Contacts));
    }
}

/// What one pair of surfaces has found.
#[derive(Default)]
struct Found {
    contacts: Vec<CompactContact>,
    touching: Vec<TouchingPair>,
    nearest: f64,
}

impl Found {
    /// Counts two triangles at a `distance` by their spheres, and tells whether their contact is to be reported.
    fn admit(&mut self, pair: &SurfacePair, [triangle_a, triangle_b]: [u32; 2], distance: f64, gap: f64) -> bool {
        self.nearest = self.nearest.min(distance.max(0.0));
        if distance <= f64::from(pair.contact_distance) {
            self.touching.push(TouchingPair { triangle_a, triangle_b, distance: gap.max(0.0) });
        }
        distance <= f64::from(pair.reported_distance)
    }
}

#[expect(clippy::too_many_arguments, reason = "the last stage reads every stage before it")]
fn gather_contacts(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    overlapping: Res<OverlappingTrianglePairs>,
    meeting: Res<MeetingCaps>,
    mut refined: ResMut<RefinedTrianglePairs>,
    mut store: ResMut<ContactStore>,
    mut previous: Local<ContactStore>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    spheres: SphereQuery,
    positions: Query<&SurfacePositions>,
) {
    let start = diagnostics.start();
    std::mem::swap(&mut *store, &mut *previous);
    store.tick = previous.tick + 1;
    store.pairs.clear();
    store.contacts.clear();
    store.touching.clear();
    let places: HashMap<(ContactSide, ContactSide), usize> =
        previous.pairs.iter().enumerate().map(|(place, pair)| ((pair.a, pair.b), place)).collect();

    let mut found = Found::default();
    for (place, pair) in candidates.pairs.iter().enumerate() {
        found.contacts.clear();
        found.touching.clear();
        found.nearest = f64::INFINITY;
        match pair.method {
            ContactMethod::Refined | ContactMethod::Polygon => {
                let refined = &mut refined.pairs[place];
                std::mem::swap(&mut found.contacts, &mut refined.contacts);
                found.touching.extend_from_slice(&refined.touching);
                found.nearest = refined.nearest;
            }
            ContactMethod::Circumsphere => gather_caps(&active, &positions, pair, &meeting.pairs[place], &mut found),
            ContactMethod::BoundingSphere => {
                gather_balls(&active, &spheres, &positions, pair, &overlapping.pairs[place], &mut found);
            }
        }
        if found.contacts.is_empty() && found.nearest > f64::from(pair.range) {
            continue;
        }
        // Stable: neighboring faces of a shape report a shared edge alike up to the sign of a zero, and the first one
        // of them has to stay the first whatever the order of the candidates.
        found.contacts.sort_by_key(|contact| (contact.key, contact.triangle_a, contact.triangle_b));
        found.contacts.dedup_by_key(|contact| contact.key);
        found.touching.sort_unstable_by_key(|pair| (pair.triangle_a, pair.triangle_b));

        let stored = stored_pair(&active, pair, &store, &found);
        if keeps_sides(&active, pair)
            && let Some(&before) = places.get(&(stored.a, stored.b))
        {
            let before = &previous.contacts[previous.pairs[before].contacts.clone()];
            let same_surface = pair.is_self().then_some(&*stored.topology_a);
            keep_sides(&mut found.contacts, before, same_surface);
        }
        store.contacts.extend_from_slice(&found.contacts);
        store.touching.extend_from_slice(&found.touching);
        store.pairs.push(stored);
    }
    index_entities(&mut store);
    diagnostics.finish("contacts", start, candidates.pairs.len(), store.contacts.len());
}

fn stored_pair(active: &ActiveSurfaces, pair: &SurfacePair, store: &ContactStore, found: &Found) -> StoredPair {
    let first = &active.surfaces[pair.first];
    let (b, topology_b, events_b, order_b) = match pair.second {
        OtherSide::Surface(second) => {
            let second = &active.surfaces[second];
            (ContactSide::Surface(second.entity), Some(Arc::clone(&second.topology)), second.events, second.order)
        }
        OtherSide::Shape(place) => {
            let shape = &active.shapes[place];
            (ContactSide::Shape(shape.entity), None, shape.events, shape.order)
        }
    };
    StoredPair {
        a: ContactSide::Surface(first.entity),
        b,
        contact_distance: pair.contact_distance,
        nearest: found.nearest,
        contacts: store.contacts.len()..store.contacts.len() + found.contacts.len(),
        touching: store.touching.len()..store.touching.len() + found.touching.len(),
        frame_pose: pair.frame_pose,
        topology_a: Arc::clone(&first.topology),
        topology_b,
        events: [first.events, events_b],
        order: (matches!(pair.second, OtherSide::Shape(_)), first.order, order_b),
    }
}

fn index_entities(store: &mut ContactStore) {
    store.by_entity.clear();
    for (place, pair) in store.pairs.iter().enumerate() {
        store.by_entity.push((pair.a.entity(), place as u32));
        if pair.a.entity() != pair.b.entity() {
            store.by_entity.push((pair.b.entity(), place as u32));
        }
    }
    store.by_entity.sort_unstable();
}

/// Whether the sides of a pair are known only from the ticks before.
fn keeps_sides(active: &ActiveSurfaces, pair: &SurfacePair) -> bool {
    let OtherSide::Surface(second) = pair.second else { return false };
    let (first, second) = (&active.surfaces[pair.first], &active.surfaces[second]);
    let remembered = !first.fresh && !second.fresh;
    let exact = pair.method >= ContactMethod::Refined;
    remembered && exact && (pair.is_self() || !(first.one_sided || second.one_sided))
}

/// A contact whose normal has turned round since the last tick has passed through: it keeps the side it was on, and
/// its distance is negative. Both lists are sorted by key. `same_surface` is the surface of a self-collision.
fn keep_sides(contacts: &mut [CompactContact], before: &[CompactContact], same_surface: Option<&SurfaceTopology>) {
    // In a self-collision either of the two features may have come first.
    let normal = |contact: &CompactContact| match same_surface {
        Some(topology) if contact.is_swapped(topology) => -contact.normal,
        _ => contact.normal,
    };
    let mut before = before.iter().peekable();
    for contact in contacts {
        while before.next_if(|other| other.key < contact.key).is_some() {}
        let Some(last) = before.next_if(|other| other.key == contact.key) else { continue };
        if normal(contact).dot(normal(last)) < 0.0 {
            contact.normal = -contact.normal;
            contact.distance = -contact.distance;
        }
    }
}

/// The corners of both triangles of a pair in its frame.
struct Corners<'a> {
    topologies: [&'a SurfaceTopology; 2],
    positions: [&'a [Vec3]; 2],
}

impl Corners<'_> {
    fn of(&self, side: usize, triangle: u32) -> [DVec3; 3] {
        self.topologies[side].triangles()[triangle as usize]
            .map(|vertex| self.positions[side][vertex as usize].as_dvec3())
    }

    /// A contact of two whole triangles. `normal` points from the second to the first; `distance` is in world units.
    fn face_contact(
        &self,
        pair: &SurfacePair,
        triangles: [u32; 2],
        points: [Vec3; 2],
        normal: Vec3,
        distance: f64,
    ) -> CompactContact {
        CompactContact::between_triangles(
            self.topologies,
            triangles,
            pair.is_self(),
            FeaturePair { a: Feature::Face, b: Feature::Face },
            barycentric_of(&self.of(0, triangles[0]), points[0].as_dvec3()),
            barycentric_of(&self.of(1, triangles[1]), points[1].as_dvec3()),
            points[1].as_dvec3(),
            normal.as_dvec3(),
            distance,
        )
    }
}

fn with_corners(
    active: &ActiveSurfaces,
    positions: &Query<&SurfacePositions>,
    pair: &SurfacePair,
    gather: impl FnOnce(&Corners<'_>),
) {
    let OtherSide::Surface(second) = pair.second else { return };
    let (first, second) = (&active.surfaces[pair.first], &active.surfaces[second]);
    let (Ok(own), Ok(other)) = (positions.get(first.entity), positions.get(second.entity)) else { return };
    gather(&Corners { topologies: [&first.topology, &second.topology], positions: pair.positions(&own.0, &other.0) });
}

fn gather_caps(
    active: &ActiveSurfaces,
    positions: &Query<&SurfacePositions>,
    pair: &SurfacePair,
    meeting: &[CapPair],
    found: &mut Found,
) {
    let scale = pair.frame_pose.scale();
    with_corners(active, positions, pair, |corners| {
        for &CapPair { triangle_a, triangle_b, contact, distance } in meeting {
            let gap = f64::from(contact.gap) * scale;
            if found.admit(pair, [triangle_a, triangle_b], distance * scale, gap) {
                let points = [contact.point_a, contact.point_b];
                let contact = corners.face_contact(pair, [triangle_a, triangle_b], points, -contact.direction, gap);
                found.contacts.push(contact);
            }
        }
    });
}

fn gather_balls(
    active: &ActiveSurfaces,
    spheres: &SphereQuery,
    positions: &Query<&SurfacePositions>,
    pair: &SurfacePair,
    overlapping: &[[u32; 2]],
    found: &mut Found,
) {
    let scale = pair.frame_pose.scale();
    with_balls(active, spheres, pair, |a, b| {
        with_corners(active, positions, pair, |corners| {
            for &[triangle_a, triangle_b] in overlapping {
                let (Ball { center, radius }, other) = (a.ball(triangle_a), b.ball(triangle_b));
                let normal = (center - other.center).normalize_or(Vec3::Y);
                let gap = f64::from(center.distance(other.center) - radius - other.radius) * scale;
                // Candidates reach as far as the margin: without it, only what their boxes let through would be here.
                let boxes = box_gap(&corners.of(0, triangle_a), &corners.of(1, triangle_b)) * scale;
                if found.admit(pair, [triangle_a, triangle_b], gap.max(boxes), gap) {
                    let points = [center - normal * radius, other.center + normal * other.radius];
                    found.contacts.push(corners.face_contact(pair, [triangle_a, triangle_b], points, normal, gap));
                }
            }
        });
    });
}
