//! The contacts of pairs whose spheres overlap: of enclosing balls, and of caps that pass the cone test.
//!
//! Reads the pairs that the overlap stage has kept, in the order of the contacts they may give, and the rows of both sides;
//! writes touching pairs and contacts, eight pairs at a time.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f64x8, mask32x8, mask64x8, prelude::*};
use glam::{DVec3, Vec3};

use super::{
    cone::cap_contact,
    contact::{CompactContact, FacePlace, TouchingPair},
    lanes::{
        CapContactLanes, CapLanes, CornerLanes, SetLanes, TrianglePairLanes, VectorLanes, WIDTH, first_lanes, rounded,
        stored, transposed, widened,
    },
    pair::{FoundPairs, PairSettings},
    prefetch::{ask_ahead, ask_for_room},
    sphere_pairs::{BallSide, CapSide, facing_caps, keep},
};

/// Eight contacts of two whole triangles by their spheres, in the frame of the pair.
struct FaceContacts<S: Simd> {
    triangles: TrianglePairLanes<S>,
    /// Contact points on the first and the second side.
    points: [VectorLanes<S>; 2],
    /// From the second side to the first.
    normal: VectorLanes<S>,
    /// From one point to the other, along the normal.
    gap: f64x8<S>,
    /// What the distance of the two is at least, as far as the method knows; at least 0.
    distance: f64x8<S>,
    /// Where there is any contact.
    meet: mask32x8<S>,
}

impl<S: Simd> FaceContacts<S> {
    /// Counts the pairs by their distances, and reports their contacts. A pair that is listed twice in a row has one.
    #[inline(always)]
    fn push(self, simd: S, pairs: &[[u32; 2]], settings: &PairSettings, found: &mut FoundPairs) {
        ask_for_room(&mut found.contacts);
        ask_for_room(&mut found.touching);
        let distance = self.distance * settings.scale;
        // Along the normal the two may be farther apart than what counts as the pair's distance.
        let gap = (self.gap * settings.scale).min(distance);
        let meet = self.meet.to_bitmask() & first_lanes(pairs.len());
        let met = mask64x8::from_bitmask(simd, meet).select(distance, f64x8::splat(simd, f64::INFINITY));
        found.nearest = found.nearest.min(met.reduce_min().max(0.0));

        let positive = gap.max(0.0).to_array();
        for lane in SetLanes((met.simd_le(settings.contact_distance).to_bitmask() & meet) as u32) {
            let [triangle_a, triangle_b] = pairs[lane];
            found.touching.push(TouchingPair { triangle_a, triangle_b, distance: positive[lane] });
        }

        let [points_a, points_b] = self.points;
        let ([a, b], [c, d]) = (self.triangles.a.barycentrics(points_a), self.triangles.b.barycentrics(points_b));
        let rows = transposed([a, b, c, d, points_b.x, points_b.y, points_b.z, self.normal.x]);
        let rows = rows.map(stored);
        let rest = [stored(self.normal.y), stored(self.normal.z), stored(rounded(gap))];
        for lane in SetLanes((met.simd_le(settings.reported_distance).to_bitmask() & meet) as u32) {
            let [a, b, c, d, x, y, z, normal_x] = rows[lane];
            let place = FacePlace {
                barycentrics: [[a, b], [c, d]],
                point_b: Vec3::new(x, y, z),
                normal: Vec3::new(normal_x, rest[0][lane], rest[1][lane]),
                distance: rest[2][lane],
            };
            let contact = CompactContact::between_faces(pairs[lane], settings.same_surface, place);
            if found.contacts.last().is_none_or(|last| last.key != contact.key) {
                found.contacts.push(contact);
            }
        }
    }
}

/// Appends the contacts of pairs whose enclosing balls overlap.
pub fn ball_contacts(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    found.touching.reserve(overlapping.len());
    found.contacts.reserve(overlapping.len());
    dispatch!(Level::new(), simd => {
        for (block, pairs) in overlapping.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, overlapping, block);
            ball_contacts_in_lanes(simd, a, b, pairs).push(simd, pairs, settings, found);
        }
    });
}

#[inline(always)]
fn ball_contacts_in_lanes<S: Simd>(simd: S, a: &BallSide<'_>, b: &BallSide<'_>, pairs: &[[u32; 2]]) -> FaceContacts<S> {
    let rows = [a.gather::<0, S>(simd, pairs), b.gather::<1, S>(simd, pairs)];
    let triangles = TrianglePairLanes {
        a: CornerLanes::new::<0>(&a.surface, pairs, &rows[0].corners()),
        b: CornerLanes::new::<1>(&b.surface, pairs, &rows[1].corners()),
    };
    let [own, other] = [rows[0].center(), rows[1].center()];
    let [own_radius, other_radius] = [rows[0].radius(), rows[1].radius()];
    let between = own.widened() - other.widened();
    let normal = between.normalized_or(DVec3::Y).rounded();
    let gap = between.dot(between).sqrt() - widened(own_radius) - widened(other_radius);
    FaceContacts {
        points: [own - normal.scaled(own_radius), other.plus(normal.scaled(other_radius))],
        normal,
        gap,
        // Candidates reach as far as the margin: without it, only what their boxes let through would be here.
        distance: gap.max(triangles.box_gap()),
        meet: mask32x8::splat(simd, true),
        triangles,
    }
}

/// Appends the pairs that pass the cone test to `meeting`, and what contacts they amount to to `found`.
pub fn meeting_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    meeting: &mut Vec<[u32; 2]>,
    found: &mut FoundPairs,
) {
    meeting.reserve(overlapping.len());
    found.touching.reserve(overlapping.len());
    found.contacts.reserve(overlapping.len());
    dispatch!(Level::new(), simd => {
        for (block, pairs) in overlapping.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, overlapping, block);
            let contacts = cap_contacts_in_lanes(simd, a, b, pairs, settings);
            keep(pairs, contacts.meet.to_bitmask(), meeting);
            contacts.push(simd, pairs, settings, found);
        }
    });
}

#[inline(always)]
fn cap_contacts_in_lanes<S: Simd>(
    simd: S,
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    pairs: &[[u32; 2]],
    settings: &PairSettings,
) -> FaceContacts<S> {
    let rows = [a.gather::<0, S>(simd, pairs), b.gather::<1, S>(simd, pairs)];
    let [cap_a, cap_b] = facing_caps(a, b, &rows);
    let triangles = TrianglePairLanes {
        a: CornerLanes::new::<0>(&a.surface, pairs, &rows[0].corners()),
        b: CornerLanes::new::<1>(&b.surface, pairs, &rows[1].corners()),
    };
    let (mut contact, mut meet, extraordinary) = cap_a.contact(&cap_b);
    let extraordinary = extraordinary.to_bitmask() & first_lanes(pairs.len());
    if extraordinary != 0 {
        settle(simd, &cap_a, &cap_b, extraordinary, &mut contact, &mut meet);
    }
    let between = cap_a.center.widened() - cap_b.center.widened();
    let spheres = between.dot(between).sqrt() - widened(cap_a.radius) - widened(cap_b.radius);
    // Boxes always: candidates reach as far as the margin, and the pairs must not depend on it.
    let mut distance = spheres.max(triangles.box_gap());
    if settings.cull {
        distance = distance.max(triangles.gap_along_normals_and(contact.direction.widened()));
    }
    FaceContacts {
        triangles,
        points: [contact.point_a, contact.point_b],
        normal: contact.direction.negated(),
        gap: widened(contact.gap),
        distance,
        meet,
    }
}

/// Tests the pairs that eight at a time cannot be told of, one by one.
#[cold]
#[inline(never)]
fn settle<S: Simd>(
    simd: S,
    a: &CapLanes<S>,
    b: &CapLanes<S>,
    extraordinary: u64,
    contacts: &mut CapContactLanes<S>,
    meet: &mut mask32x8<S>,
) {
    let mut vectors = [contacts.point_a.stored(), contacts.point_b.stored(), contacts.direction.stored()];
    for lane in (0..WIDTH).filter(|&lane| extraordinary & (1 << lane) != 0) {
        let contact = cap_contact(&a.get(lane), &b.get(lane));
        meet.set(lane, contact.is_some());
        if let Some(contact) = contact {
            for (vectors, vector) in vectors.iter_mut().zip([contact.point_a, contact.point_b, contact.direction]) {
                vectors.set(lane, vector);
            }
            contacts.gap[lane] = contact.gap;
        }
    }
    let [point_a, point_b, direction] = &vectors;
    contacts.point_a = VectorLanes::load(simd, point_a);
    contacts.point_b = VectorLanes::load(simd, point_b);
    contacts.direction = VectorLanes::load(simd, direction);
}
