//! The contacts of pairs whose spheres overlap: of enclosing balls, and of caps that pass the cone test.
//!
//! Reads pairs of triangles and the rows of both sides, eight pairs at a time. The spheres alone determine a contact of
//! spheres, so a tick only [finds](FoundSpheres) which pairs are in contact and how far apart they are, in any order.
//! Points and normals are [written](FoundPairs) from the same pairs, in the order of the contacts, where they are wanted.

use fearless_simd::{f32x8, f64x8, mask32x8, mask64x8, prelude::*};
use glam::{DVec3, Vec3};

use self::estimate::{Estimate, Limits, estimate};
use super::{
    cap_lanes::{CapContactLanes, CapLanes},
    cone::cap_contact,
    pairs::{BallSide, CapSide, ListedPairs, append_first, balls_within, facing_caps},
    rows::RowLanes,
};
use crate::kernel::{
    contact::{CompactContact, FacePlace, TouchingPair},
    pair::{FoundPairs, PairSettings, SurfaceSide},
    simd::{
        lanes::{
            CornerLanes, SetLanes, TrianglePairLanes, VectorLanes, WIDTH, first_lanes, rounded, stored, transposed,
            widened,
        },
        prefetch::{ask_ahead, ask_for_room},
    },
};

mod estimate;

/// Eight contacts of two whole triangles by their spheres, in the pair's frame.
pub(in crate::kernel) struct FaceContacts<S: Simd> {
    pub(super) triangles: TrianglePairLanes<S>,
    /// Contact points on the first and the second side.
    pub(super) points: [VectorLanes<S>; 2],
    /// From the first side to the second.
    pub(super) normal: VectorLanes<S>,
    /// From one point to the other, along the normal.
    pub(super) gap: f64x8<S>,
    /// Lower bound of the distance of the triangles, as the method knows it. At least 0.
    pub(super) distance: f64x8<S>,
    /// What the thicknesses of both triangles lack to the largest ones of their surfaces, in world units.
    pub(super) lack: f64x8<S>,
    /// Where there is a contact.
    pub(super) meet: mask32x8<S>,
}

/// How far apart eight pairs are, in world units.
struct Distances<S: Simd> {
    gap: f64x8<S>,
    least: f64,
    touching: u32,
    reported: u32,
}

/// Consumes contacts.
pub(in crate::kernel) trait ContactSink {
    /// Reserves capacity for the contacts of at most `count` pairs.
    fn reserve(&mut self, count: usize);

    /// Takes the contacts of eight pairs.
    fn push<S: Simd>(&mut self, simd: S, pairs: &[[u32; 2]], contacts: FaceContacts<S>, settings: &PairSettings);
}

/// A pair of triangles that are in contact by their spheres.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SphereContact {
    /// Triangle of the first surface, as the caller numbered it.
    pub triangle_a: u32,
    /// Triangle of the second surface.
    pub triangle_b: u32,
    /// Signed distance of the two contact points in world units. Negative if the spheres, or caps, have passed each
    /// other. The pair touches if also the boxes of its triangles, and for caps their planes, come within the contact
    /// distance.
    pub distance: f32,
}

impl SphereContact {
    /// The contacts of `pairs` with their `distances`, without those that are infinite.
    pub(crate) fn listed(pairs: &[[u32; 2]], distances: &[f32]) -> impl Iterator<Item = Self> {
        let contacts = pairs.iter().zip(distances).filter(|(_, distance)| **distance < f32::INFINITY);
        contacts.map(|(&[triangle_a, triangle_b], &distance)| Self { triangle_a, triangle_b, distance })
    }
}

/// Which pairs of a list are in contact, and how far apart they are.
#[derive(Clone, Debug)]
pub struct FoundSpheres {
    /// The [`SphereContact::distance`] of each pair. Infinite if it has no reported contact.
    pub distances: Vec<f32>,
    /// The number of pairs with a reported contact.
    pub reported: usize,
    /// The number of these pairs that touch.
    pub touching: usize,
    /// Distance of the nearest pair in world units, at least 0. Infinite if no pair meets.
    pub nearest: f64,
}

impl Default for FoundSpheres {
    fn default() -> Self {
        Self { distances: Vec::new(), reported: 0, touching: 0, nearest: f64::INFINITY }
    }
}

impl FoundSpheres {
    /// Clears the list and keeps its memory.
    pub fn clear(&mut self) {
        self.distances.clear();
        (self.reported, self.touching, self.nearest) = (0, 0, f64::INFINITY);
    }

    /// Appends the results of a later part of the list.
    pub fn append(&mut self, later: &mut Self) {
        self.distances.append(&mut later.distances);
        self.reported += later.reported;
        self.touching += later.touching;
        self.nearest = self.nearest.min(later.nearest);
    }

    /// The contacts of `pairs`, which must be the list that this was found for.
    pub fn contacts(&self, pairs: &[[u32; 2]]) -> impl Iterator<Item = SphereContact> {
        SphereContact::listed(pairs, &self.distances)
    }

    /// Adds the results of eight pairs, without those that are not `listed`.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn add<S: Simd>(&mut self, simd: S, listed: u64, [touching, reported]: [u32; 2], gaps: f32x8<S>) {
        self.touching += touching.count_ones() as usize;
        self.reported += reported.count_ones() as usize;
        ask_for_room(&mut self.distances);
        let nowhere = f32x8::splat(simd, f32::INFINITY);
        let gaps = mask32x8::from_bitmask(simd, u64::from(reported)).select(gaps, nowhere);
        let gaps = gaps.compress(mask32x8::from_bitmask(simd, listed));
        append_first(&stored(gaps), listed.count_ones() as usize, &mut self.distances);
    }
}

/// For pairs that meet.
impl ContactSink for FoundSpheres {
    fn reserve(&mut self, count: usize) {
        self.distances.reserve(count);
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn push<S: Simd>(&mut self, simd: S, pairs: &[[u32; 2]], contacts: FaceContacts<S>, settings: &PairSettings) {
        let distances = contacts.distances(simd, pairs.len(), settings);
        self.nearest = self.nearest.min(distances.least);
        let meeting = contacts.meet.to_bitmask() & first_lanes(pairs.len());
        self.add(simd, meeting, [distances.touching, distances.reported], rounded(distances.gap));
    }
}

impl<S: Simd> FaceContacts<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn distances(&self, simd: S, count: usize, settings: &PairSettings) -> Distances<S> {
        let distance = self.distance * settings.scale;
        let meet = self.meet.to_bitmask() & first_lanes(count);
        let met = mask64x8::from_bitmask(simd, meet).select(distance + self.lack, f64x8::splat(simd, f64::INFINITY));
        Distances {
            // Along the normal the triangles may be farther apart than what counts as the pair's distance.
            gap: (self.gap * settings.scale).min(distance),
            least: met.reduce_min().max(0.0),
            touching: (met.simd_le(settings.contact_distance).to_bitmask() & meet) as u32,
            reported: (met.simd_le(settings.reported_distance).to_bitmask() & meet) as u32,
        }
    }
}

impl ContactSink for FoundPairs {
    fn reserve(&mut self, count: usize) {
        self.touching.reserve(count);
        self.contacts.reserve(count);
    }

    /// A pair that is listed twice in a row has one contact.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn push<S: Simd>(&mut self, simd: S, pairs: &[[u32; 2]], contacts: FaceContacts<S>, settings: &PairSettings) {
        let found = self;
        ask_for_room(&mut found.contacts);
        ask_for_room(&mut found.touching);
        let distances = contacts.distances(simd, pairs.len(), settings);
        found.nearest = found.nearest.min(distances.least);

        let positive = distances.gap.max(0.0).to_array();
        for lane in SetLanes(distances.touching) {
            let [triangle_a, triangle_b] = pairs[lane];
            found.touching.push(TouchingPair { triangle_a, triangle_b, distance: positive[lane] });
        }

        let FaceContacts { triangles, points: [points_a, points_b], normal, .. } = contacts;
        let ([a, b], [c, d]) = (triangles.a.barycentrics(points_a), triangles.b.barycentrics(points_b));
        let rows = transposed([a, b, c, d, points_b.x, points_b.y, points_b.z, normal.x]);
        let rows = rows.map(stored);
        let rest = [stored(normal.y), stored(normal.z), stored(rounded(distances.gap))];
        for lane in SetLanes(distances.reported) {
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

/// What the thicknesses of eight pairs of triangles lack to the largest ones of their surfaces. A sphere stands for its whole
/// triangle, so the thickest corner counts.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn lack<S: Simd>(simd: S, a: &SurfaceSide<'_>, b: &SurfaceSide<'_>, pairs: &[[u32; 2]]) -> f64x8<S> {
    if a.is_evenly_thick() && b.is_evenly_thick() {
        return f64x8::splat(simd, 0.0);
    }
    let of_pair = |[triangle_a, triangle_b]: [u32; 2]| a.least_lack(triangle_a) + b.least_lack(triangle_b);
    f64x8::from_slice(simd, &std::array::from_fn::<f64, WIDTH, _>(|lane| of_pair(pairs[lane.min(pairs.len() - 1)])))
}

/// Appends the candidates whose enclosing balls come within range to `overlapping`, and their distances to `found`.
pub fn overlapping_ball_contacts(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    found: &mut FoundSpheres,
) {
    overlapping.reserve(candidates.len());
    found.reserve(candidates.len());
    let limits = Limits::new(settings, a.surface.rounding() + b.surface.rounding());
    let is_even = a.surface.is_evenly_thick() && b.surface.is_evenly_thick();
    dispatch!(simd => {
        for (block, pairs) in candidates.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, candidates, block);
            let rows = [a.gather::<0, _>(simd, pairs), b.gather::<1, _>(simd, pairs)];
            let within = balls_within(&rows, pairs, settings);
            ListedPairs::new(simd, pairs).append(simd, within, overlapping);
            let lack = lack(simd, &a.surface, &b.surface, pairs);
            let known = if is_even { estimate(&rows, within as u32, &limits) } else { None };
            let is_decided = match &known {
                Some(known) => known.meets || found.nearest == 0.0 || within == 0,
                None => false,
            };
            if !is_decided {
                let mut contacts = ball_contacts_in_lanes(simd, &rows, lack);
                contacts.meet = mask32x8::from_bitmask(simd, within);
                if known.is_none() {
                    found.push(simd, pairs, contacts, settings);
                } else {
                    found.nearest = found.nearest.min(contacts.distances(simd, pairs.len(), settings).least);
                }
            }
            // The numbers must not depend on what was found before, which is another list on another thread.
            if let Some(Estimate { touching, reported, gaps, meets }) = known {
                if meets {
                    found.nearest = 0.0;
                }
                found.add(simd, within, [touching, reported], gaps);
            }
        }
    });
}

/// Appends the contacts of pairs whose enclosing balls overlap.
pub fn ball_contacts(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    found.reserve(overlapping.len());
    dispatch!(simd => {
        for (block, pairs) in overlapping.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, overlapping, block);
            let rows = [a.gather::<0, _>(simd, pairs), b.gather::<1, _>(simd, pairs)];
            let lack = lack(simd, &a.surface, &b.surface, pairs);
            found.push(simd, pairs, ball_contacts_in_lanes(simd, &rows, lack), settings);
        }
    });
}

#[cfg_attr(not(unoptimized), inline(always))]
fn ball_contacts_in_lanes<S: Simd>(simd: S, rows: &[RowLanes<S>; 2], lack: f64x8<S>) -> FaceContacts<S> {
    let triangles = TrianglePairLanes {
        a: CornerLanes::new(rows[0].exact_corners()),
        b: CornerLanes::new(rows[1].exact_corners()),
    };
    let [own, other] = [rows[0].center(), rows[1].center()];
    let [own_radius, other_radius] = [rows[0].radius(), rows[1].radius()];
    let between = other.widened() - own.widened();
    let normal = between.normalized_or(DVec3::NEG_Y).rounded();
    let gap = between.dot(between).sqrt() - widened(own_radius) - widened(other_radius);
    FaceContacts {
        points: [own.plus(normal.scaled(own_radius)), other - normal.scaled(other_radius)],
        normal,
        gap,
        // Candidates extend to the margin. Without it, only those whose boxes overlap would be here.
        distance: gap.max(triangles.box_gap()),
        lack,
        meet: mask32x8::splat(simd, true),
        triangles,
    }
}

/// Appends the contacts of pairs that all pass the cone test, see [`meeting_caps`].
pub fn cap_contacts(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    meeting: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    found.reserve(meeting.len());
    dispatch!(simd => {
        for (block, pairs) in meeting.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, meeting, block);
            found.push(simd, pairs, cap_contacts_in_lanes(simd, a, b, pairs, settings), settings);
        }
    });
}

/// Appends the pairs that pass the cone test to `meeting`, and their contacts to `found`.
#[expect(private_bounds, reason = "only lists of this crate take contacts eight at a time")]
pub fn meeting_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    meeting: &mut Vec<[u32; 2]>,
    found: &mut impl ContactSink,
) {
    meeting.reserve(overlapping.len());
    found.reserve(overlapping.len());
    dispatch!(simd => {
        for (block, pairs) in overlapping.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, overlapping, block);
            let contacts = cap_contacts_in_lanes(simd, a, b, pairs, settings);
            let meets = contacts.meet.to_bitmask() & first_lanes(pairs.len());
            ListedPairs::new(simd, pairs).append(simd, meets, meeting);
            found.push(simd, pairs, contacts, settings);
        }
    });
}

#[cfg_attr(not(unoptimized), inline(always))]
fn cap_contacts_in_lanes<S: Simd>(
    simd: S,
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    pairs: &[[u32; 2]],
    settings: &PairSettings,
) -> FaceContacts<S> {
    let rows = [a.gather::<0, _>(simd, pairs), b.gather::<1, _>(simd, pairs)];
    let [cap_a, cap_b] = facing_caps(a, b, &rows);
    let triangles = TrianglePairLanes {
        a: CornerLanes::new(rows[0].exact_corners()),
        b: CornerLanes::new(rows[1].exact_corners()),
    };
    let (mut contact, mut meet, extraordinary) = cap_a.contact(&cap_b);
    let extraordinary = extraordinary.to_bitmask() & first_lanes(pairs.len());
    if extraordinary != 0 {
        decide_alone(simd, &cap_a, &cap_b, extraordinary, &mut contact, &mut meet);
    }
    let between = cap_a.center.widened() - cap_b.center.widened();
    let spheres = between.dot(between).sqrt() - widened(cap_a.radius) - widened(cap_b.radius);
    // Boxes always count: candidates extend to the margin, and the pairs must not depend on it.
    let mut distance = spheres.max(triangles.box_gap());
    if settings.cull {
        // The axes are the normals of the triangles. The triangles are no nearer than their gap along any direction.
        distance = distance.max(triangles.gap_along([cap_a.axis, cap_b.axis, contact.direction]));
    }
    FaceContacts {
        triangles,
        points: [contact.point_a, contact.point_b],
        normal: contact.direction,
        gap: widened(contact.gap),
        distance,
        lack: lack(simd, &a.surface, &b.surface, pairs),
        meet,
    }
}

/// Tests the pairs that cannot be decided eight at a time, one by one.
#[cold]
#[inline(never)]
fn decide_alone<S: Simd>(
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
