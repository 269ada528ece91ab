//! The contacts of pairs whose spheres overlap: of enclosing balls, and of caps that pass the cone test.
//!
//! Reads the pairs that the overlap stage has kept, in the order of the contacts they may give, and the rows of both sides;
//! writes touching pairs and contacts, eight pairs at a time.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f64x8, mask32x8, prelude::*};
use glam::DVec3;

use super::{
    cone::cap_contact,
    contact::{CompactContact, FacePlace, TouchingPair},
    lanes::{
        CapContactLanes, CapLanes, CornerLanes, TrianglePairLanes, VectorLanes, VectorRows, WIDTH, first_lanes,
        stored, widened,
    },
    pair::{FoundPairs, PairSettings},
    sphere_pairs::{BallSide, CapSide, facing_caps, keep},
};

/// Eight contacts of two whole triangles by their spheres, in the frame of the pair.
struct FaceContacts<S: Simd> {
    /// Contact points on the first and the second side.
    points: [VectorLanes<S>; 2],
    /// From the second side to the first.
    normal: VectorLanes<S>,
    /// From one point to the other, along the normal.
    gap: f64x8<S>,
    /// What the distance of the two is at least, as far as the method knows; at least 0.
    distance: f64x8<S>,
    /// One bit where there is any contact.
    meet: u64,
}

/// What is written of eight contacts, lane by lane.
struct WrittenContacts {
    barycentrics: [[[f32; WIDTH]; 2]; 2],
    point_b: VectorRows,
    normal: VectorRows,
    /// In world units, like the distance.
    gap: [f64; WIDTH],
    distance: [f64; WIDTH],
    meet: u64,
}

impl<S: Simd> FaceContacts<S> {
    #[inline(always)]
    fn write(self, triangles: &TrianglePairLanes<S>, settings: &PairSettings) -> WrittenContacts {
        let distance = self.distance * settings.scale;
        // Along the normal the two may be farther apart than what counts as the pair's distance.
        let gap = (self.gap * settings.scale).min(distance);
        let ([a, b], [c, d]) =
            (triangles.a.barycentrics(self.points[0]), triangles.b.barycentrics(self.points[1]));
        WrittenContacts {
            barycentrics: [[stored(a), stored(b)], [stored(c), stored(d)]],
            point_b: self.points[1].stored(),
            normal: self.normal.stored(),
            gap: gap.to_array(),
            distance: distance.to_array(),
            meet: self.meet,
        }
    }
}

impl WrittenContacts {
    /// Counts the pairs by their distances, and reports their contacts. A pair that is listed twice in a row has one.
    #[inline(always)]
    fn push(&self, pairs: &[[u32; 2]], settings: &PairSettings, found: &mut FoundPairs) {
        for (lane, &[triangle_a, triangle_b]) in pairs.iter().enumerate().take(WIDTH) {
            if self.meet & (1 << lane) == 0 {
                continue;
            }
            let (distance, gap) = (self.distance[lane], self.gap[lane]);
            found.nearest = found.nearest.min(distance.max(0.0));
            if distance <= settings.contact_distance {
                found.touching.push(TouchingPair { triangle_a, triangle_b, distance: gap.max(0.0) });
            }
            if distance <= settings.reported_distance {
                let weights = |side: usize| self.barycentrics[side].each_ref().map(|weights| weights[lane]);
                let place = FacePlace {
                    barycentrics: [weights(0), weights(1)],
                    point_b: self.point_b.get(lane),
                    normal: self.normal.get(lane),
                    distance: gap as f32,
                };
                let contact = CompactContact::between_faces([triangle_a, triangle_b], settings.same_surface, place);
                if found.contacts.last().is_none_or(|last| last.key != contact.key) {
                    found.contacts.push(contact);
                }
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
        for pairs in overlapping.chunks(WIDTH) {
            ball_contacts_in_lanes(simd, a, b, pairs, settings).push(pairs, settings, found);
        }
    });
}

#[inline(always)]
fn ball_contacts_in_lanes<S: Simd>(
    simd: S,
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    pairs: &[[u32; 2]],
    settings: &PairSettings,
) -> WrittenContacts {
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
    let contacts = FaceContacts {
        points: [own - normal.scaled(own_radius), other.plus(normal.scaled(other_radius))],
        normal,
        gap,
        // Candidates reach as far as the margin: without it, only what their boxes let through would be here.
        distance: gap.max(triangles.box_gap()),
        meet: u64::MAX,
    };
    contacts.write(&triangles, settings)
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
        for pairs in overlapping.chunks(WIDTH) {
            let contacts = cap_contacts_in_lanes(simd, a, b, pairs, settings);
            keep(pairs, contacts.meet, meeting);
            contacts.push(pairs, settings, found);
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
) -> WrittenContacts {
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
    let contacts = FaceContacts {
        points: [contact.point_a, contact.point_b],
        normal: contact.direction.negated(),
        gap: widened(contact.gap),
        distance,
        meet: meet.to_bitmask(),
    };
    contacts.write(&triangles, settings)
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
