//! Moves what the exact test found on flat triangles to the patches of smooth surfaces.
//!
//! The exact test runs with distances that are wider by how far the patches may be from their triangles, so it finds
//! every pair that may touch. Here each pair of triangles gets the distance of its patches. Each contact keeps its
//! features, and its points move to where the curved features are closest. Two patches whose closest points lie inside
//! both have one more contact there.

use fearless_simd::{f32x8, f64x8, mask32x8, prelude::*};
use glam::{DVec3, Vec3};

use super::{
    closest_lanes::WeightLanes,
    edge_inside::closest_edge_inside,
    feature_lanes::{FeatureLanes, closest_of_features},
    gather::GatheredPatches,
    newton::closest_inside,
    patch::Patch,
    patch_lanes::{MeetingLanes, closest},
};
use crate::kernel::{
    contact::{CompactContact, FacePlace, TouchingPair},
    exact::{PairProximity, examine_pair},
    mesh::{
        feature::{Feature, FeatureKind},
        ids::EdgeId,
    },
    pair::{PairSettings, SurfaceSide},
    simd::{
        lanes::{DoubleVectorLanes, SetLanes, VectorLanes, WIDTH, first_lanes, stored, widened},
        prefetch::Prefetch,
    },
};

/// How many blocks ahead to prefetch.
const BLOCKS_AHEAD: usize = 2;

/// Points closer than this, relative to the size of their pair, have no direction. The contact keeps the one it had.
const LEAST_LENGTH: f64 = 1.0e-6;

/// A point that counts a corner by less than this may be closest on the edge opposite it.
const NEAR_BORDER: f64 = 0.05;

/// Moves contacts to the patches. Those beyond the reported distance become empty. `settings` has the distances that
/// count for the patches.
pub fn refine_contacts(sides: [&SurfaceSide<'_>; 2], settings: &PairSettings, contacts: &mut [CompactContact]) {
    dispatch!(simd => {
        for block in 0..contacts.len().div_ceil(WIDTH) {
            for ahead in contacts.iter().skip((block + BLOCKS_AHEAD) * WIDTH).take(WIDTH) {
                sides[0].prefetch(ahead.triangle_a);
                sides[1].prefetch(ahead.triangle_b);
            }
            let end = contacts.len().min((block + 1) * WIDTH);
            refine_eight(simd, sides, settings, &mut contacts[block * WIDTH..end]);
        }
    });
}

/// Where a feature is in a patch that begins with its corner `turn`.
#[derive(Clone, Copy, Default)]
struct Turned {
    turn: u8,
    is_edge: bool,
    is_face: bool,
}

impl Turned {
    fn of(feature: Feature) -> Self {
        match feature {
            Feature::Vertex(turn) => Self { turn: turn % 3, is_edge: false, is_face: false },
            Feature::Edge(turn) => Self { turn: turn % 3, is_edge: true, is_face: false },
            Feature::Face => Self { turn: 0, is_edge: false, is_face: true },
        }
    }

    /// The weights of the first two corners, given those of the second and the third from `turn` on.
    fn turned_back(self, second: f32, third: f32) -> [f32; 2] {
        let weights = [1.0 - second - third, second, third];
        [weights[usize::from(3 - self.turn) % 3], weights[usize::from(4 - self.turn) % 3]]
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn refine_eight<S: Simd>(
    simd: S,
    [a, b]: [&SurfaceSide<'_>; 2],
    settings: &PairSettings,
    contacts: &mut [CompactContact],
) {
    let count = contacts.len();
    let mut triangles = [[0; WIDTH]; 2];
    let mut turned = [[Turned::default(); WIDTH]; 2];
    let mut weights = [[[0.0; WIDTH]; 2]; 2];
    let mut normals = [Vec3::ZERO; WIDTH];
    for lane in 0..WIDTH {
        let contact = &contacts[lane.min(count - 1)];
        (triangles[0][lane], triangles[1][lane]) = (contact.triangle_a, contact.triangle_b);
        normals[lane] = contact.normal;
        let sides = [(contact.features.a, contact.barycentric_a), (contact.features.b, contact.barycentric_b)];
        for (side, (feature, [first, second])) in sides.into_iter().enumerate() {
            let own = Turned::of(feature);
            let all = [first, second, 1.0 - first - second];
            turned[side][lane] = own;
            for weight in 0..2 {
                weights[side][weight][lane] = all[(usize::from(own.turn) + weight + 1) % 3];
            }
        }
    }
    let turns = [turned[0].map(|turned| turned.turn), turned[1].map(|turned| turned.turn)];
    let gathered_a = GatheredPatches::new(simd, a, &triangles[0], turns[0]);
    let gathered_b = GatheredPatches::new(simd, b, &triangles[1], turns[1]);
    let is_bent = (gathered_a.heights() + gathered_b.heights()).simd_gt(0.0);
    let origin = gathered_a.corners[0];
    let (patch_a, patch_b) = (gathered_a.relative(origin), gathered_b.relative(origin));
    let size = patch_a.largest().max(patch_b.largest()).max(f32::MIN_POSITIVE);
    let scale = f32x8::splat(simd, 1.0) / size;
    let features = [feature_lanes(simd, &turned[0]), feature_lanes(simd, &turned[1])];
    let [[au, av], [bu, bv]] = &weights;
    let start = [
        WeightLanes([f32x8::from_slice(simd, au), f32x8::from_slice(simd, av)]),
        WeightLanes([f32x8::from_slice(simd, bu), f32x8::from_slice(simd, bv)]),
    ];
    let patches = [&patch_a.scaled(scale), &patch_b.scaled(scale)];
    let [own, other] = closest_of_features(simd, patches, &features, start);
    // In f64, because large triangles may be close to each other.
    let (point_a, point_b) = (gathered_a.point(simd, origin, &own), gathered_b.point(simd, origin, &other));
    let between = point_b - point_a;
    let old = VectorLanes::of(simd, normals).widened();
    let (one, zero) = (f64x8::splat(simd, 1.0), f64x8::splat(simd, 0.0));
    let sign = between.dot(old).simd_lt(zero).select(-one, one);
    let length = between.dot(between).sqrt();
    let distance = sign * length * settings.scale;
    let has_direction = length.simd_gt(widened(size) * LEAST_LENGTH);
    let normal = DoubleVectorLanes::select(has_direction, between.scaled(sign / length), old).rounded();

    let (normals, points) = (normal.stored(), origin.plus(point_b).rounded().stored());
    let weights = [[stored(own.0[0]), stored(own.0[1])], [stored(other.0[0]), stored(other.0[1])]];
    let mut distances = [0.0; WIDTH];
    distance.store_slice(&mut distances);
    let is_bent = is_bent.to_bitmask() as u32;
    for (lane, contact) in contacts.iter_mut().enumerate() {
        // Whether surfaces cross is decided by their patches, pair by pair.
        if contact.features.kind() == FeatureKind::EdgeFace {
            continue;
        }
        let is_bent = is_bent >> lane & 1 != 0;
        let distance = if is_bent { distances[lane] } else { f64::from(contact.distance) };
        if distance > settings.reported_distance {
            contact.drop_name();
        } else if is_bent {
            contact.normal = normals.get(lane);
            contact.barycentric_a = turned[0][lane].turned_back(weights[0][0][lane], weights[0][1][lane]);
            contact.barycentric_b = turned[1][lane].turned_back(weights[1][0][lane], weights[1][1][lane]);
            contact.point_b = points.get(lane);
            contact.distance = distance as f32;
        }
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn feature_lanes<S: Simd>(simd: S, turned: &[Turned; WIDTH]) -> FeatureLanes<S> {
    let (mut edges, mut faces) = (0_u64, 0_u64);
    for (lane, turned) in turned.iter().enumerate() {
        edges |= u64::from(turned.is_edge) << lane;
        faces |= u64::from(turned.is_face) << lane;
    }
    FeatureLanes { is_edge: mask32x8::from_bitmask(simd, edges), is_face: mask32x8::from_bitmask(simd, faces) }
}

/// Computes the distances of pairs of triangles between their patches, in world units, at least 0, and appends the
/// contacts between the insides of patches.
pub fn refine_touching(
    sides: [&SurfaceSide<'_>; 2],
    settings: &PairSettings,
    touching: &mut [TouchingPair],
    contacts: &mut Vec<CompactContact>,
) {
    dispatch!(simd => refine_blocks(simd, sides, settings, touching, contacts));
}

#[cfg_attr(not(unoptimized), inline(always))]
fn refine_blocks<S: Simd>(
    simd: S,
    sides: [&SurfaceSide<'_>; 2],
    settings: &PairSettings,
    touching: &mut [TouchingPair],
    contacts: &mut Vec<CompactContact>,
) {
    let scale = settings.scale as f32;
    for block in 0..touching.len().div_ceil(WIDTH) {
        for ahead in touching.iter().skip((block + BLOCKS_AHEAD) * WIDTH).take(WIDTH) {
            sides[0].prefetch(ahead.triangle_a);
            sides[1].prefetch(ahead.triangle_b);
        }
        let end = touching.len().min((block + 1) * WIDTH);
        let pairs = &mut touching[block * WIDTH..end];
        let pair = |lane: usize| pairs[lane.min(pairs.len() - 1)];
        let triangles: [[u32; WIDTH]; 2] =
            [std::array::from_fn(|lane| pair(lane).triangle_a), std::array::from_fn(|lane| pair(lane).triangle_b)];
        let gathered_a = GatheredPatches::new(simd, sides[0], &triangles[0], [0; WIDTH]);
        let gathered_b = GatheredPatches::new(simd, sides[1], &triangles[1], [0; WIDTH]);
        let heights = gathered_a.heights() + gathered_b.heights();
        let flat = f32x8::from_slice(simd, &std::array::from_fn::<f32, WIDTH, _>(|lane| pair(lane).distance as f32));
        let bulge = heights * (scale * 1.000_01);
        let is_bent = heights.simd_gt(0.0);
        if !is_bent.any_true() {
            continue;
        }
        let origin = gathered_a.corners[0];
        let found = closest(simd, &gathered_a.relative(origin), &gathered_b.relative(origin));
        let (distances, bulges) = (stored(found.distance * scale), stored(bulge));
        let requested = first_lanes(pairs.len()) as u32 & is_bent.to_bitmask() as u32;
        let reached = (found.distance * scale).simd_le(settings.reported_distance as f32);
        // No distance is larger than that of the triangles by more than the patches are away from them. If it seems so,
        // the triangles are too slender for f32.
        let is_too_large = (found.distance * scale).simd_gt((flat + bulge) * 1.000_1).to_bitmask() as u32;
        for lane in SetLanes(requested) {
            let pair = &mut pairs[lane];
            pair.distance = if is_too_large >> lane & 1 == 0 {
                // Beside a very large triangle, f32 is coarser than the patches are high.
                f64::from(distances[lane]).max(pair.distance - f64::from(bulges[lane]))
            } else {
                distance_at_flat_points(sides, settings, pair)
            };
        }
        let reached = requested & reached.to_bitmask() as u32;
        let [at_first, at_second] = found.edge_inside;
        let lanes = [found.may_be_inside, at_first, at_second].map(|lanes| reached & lanes.to_bitmask() as u32);
        if lanes != [0; 3] {
            add_contacts(sides, settings, &found, lanes, pairs, contacts);
        }
    }
}

/// The distance of two patches at the closest points of their triangles.
#[cold]
fn distance_at_flat_points(sides: [&SurfaceSide<'_>; 2], settings: &PairSettings, pair: &TouchingPair) -> f64 {
    let triangles = [pair.triangle_a, pair.triangle_b];
    let patches = [Patch::of(sides[0], triangles[0]), Patch::of(sides[1], triangles[1])];
    let mut found = PairProximity::default();
    examine_pair(&patches[0].corners, &patches[1].corners, pair.distance / settings.scale, &mut found);
    let closest = found.proximities.iter().min_by(|one, other| one.distance.total_cmp(&other.distance));
    closest.map_or(pair.distance, |closest| {
        let points = [patches[0].point(&closest.barycentric_a), patches[1].point(&closest.barycentric_b)];
        points[0].distance(points[1]) * settings.scale
    })
}

/// A pair of patches with points at which they are nearly closest.
struct NearPatches<'a> {
    sides: [&'a SurfaceSide<'a>; 2],
    settings: &'a PairSettings,
    triangles: [u32; 2],
    patches: [Patch; 2],
    weights: [[f64; 3]; 2],
}

impl NearPatches<'_> {
    /// Adds a contact between an edge of the patch of one side and the inside of the other. Both triangles at the edge
    /// have the same points, and the first of them reports them.
    fn add_at_edge(&self, side: usize, contacts: &mut Vec<CompactContact>) {
        let Self { sides, settings, triangles, patches, weights } = self;
        // Opposite the corner that counts least.
        let own = weights[side];
        let opposite = (0..3).min_by(|&one, &other| own[one].total_cmp(&own[other])).unwrap_or_default();
        let (topology, edge) = (sides[side].topology, (opposite + 1) % 3);
        let number = EdgeId(topology.triangle_edges()[triangles[side] as usize][edge]);
        if own[opposite] > NEAR_BORDER || topology.triangles_of_edge(number).first() != Some(&triangles[side]) {
            return;
        }
        let inner = 1 - side;
        let start = [own, weights[inner]];
        let Some(found) = closest_edge_inside([&patches[side], &patches[inner]], edge, start) else { return };
        let weights = if side == 0 { found } else { [found[1], found[0]] };
        let points = [patches[0].point(&weights[0]), patches[1].point(&weights[1])];
        let between = points[1] - points[0];
        let Some(normal) = between.try_normalize() else { return };
        let distance = between.length() * settings.scale;
        let outward = if inner == 0 { normal } else { -normal };
        if distance <= settings.reported_distance && !self.is_inward(inner, &weights[inner], outward) {
            contacts.push(self.contact(weights, points, normal, distance));
        }
    }

    /// Whether a direction away from one of the patches leads into its body. What is inside a body has its own way out,
    /// by its vertices.
    fn is_inward(&self, side: usize, weights: &[f64; 3], direction: DVec3) -> bool {
        let surface = self.sides[side];
        let outward = self.patches[side].normal(weights) * if surface.mirrored { -1.0 } else { 1.0 };
        !self.settings.same_surface && surface.one_sided && outward.dot(direction) < 0.0
    }

    fn contact(&self, weights: [[f64; 3]; 2], points: [DVec3; 2], normal: DVec3, distance: f64) -> CompactContact {
        let place = FacePlace {
            barycentrics: weights.map(|[first, second, _]| [first as f32, second as f32]),
            point_b: points[1].as_vec3(),
            normal: normal.as_vec3(),
            distance: distance as f32,
        };
        CompactContact::between_faces(self.triangles, self.settings.same_surface, place)
    }
}

/// Finds the closest points of patches that are closest inside both, or between an edge and an inside, and adds a
/// contact there.
#[cfg_attr(not(unoptimized), inline(always))]
fn add_contacts<S: Simd>(
    sides: [&SurfaceSide<'_>; 2],
    settings: &PairSettings,
    found: &MeetingLanes<S>,
    lanes: [u32; 3],
    pairs: &mut [TouchingPair],
    contacts: &mut Vec<CompactContact>,
) {
    let [WeightLanes([a, b]), WeightLanes([c, d])] = found.weights;
    let weights = [[stored(a), stored(b)], [stored(c), stored(d)]];
    let between = found.between.stored();
    let [inside, at_first, at_second] = lanes;
    for lane in SetLanes(inside | at_first | at_second) {
        let pair = &mut pairs[lane];
        let triangles = [pair.triangle_a, pair.triangle_b];
        let weights = weights.map(|[second, third]| {
            let [second, third] = [f64::from(second[lane]), f64::from(third[lane])];
            [1.0 - second - third, second, third]
        });
        let patches = [Patch::of(sides[0], triangles[0]), Patch::of(sides[1], triangles[1])];
        let near = NearPatches { sides, settings, triangles, patches, weights };
        let Some(start) = between.get(lane).as_dvec3().try_normalize() else { continue };
        let meeting = if inside >> lane & 1 != 0 { closest_inside(&patches, weights, start) } else { None };
        let Some(meeting) = meeting else {
            for (side, lanes) in [at_first, at_second].into_iter().enumerate() {
                if (inside | lanes) >> lane & 1 != 0 {
                    near.add_at_edge(side, contacts);
                }
            }
            continue;
        };
        let distance = meeting.distance * settings.scale;
        if distance > pair.distance * (1.0 + 1.0e-4) {
            continue;
        }
        pair.distance = distance.max(0.0);
        let [first, second] = &meeting.weights;
        if !near.is_inward(0, first, meeting.normal) && !near.is_inward(1, second, -meeting.normal) {
            contacts.push(near.contact(meeting.weights, meeting.points, meeting.normal, distance));
        }
    }
}
