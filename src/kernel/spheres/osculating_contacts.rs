//! The contacts of pairs of smooth triangles by their osculating spheres, one for each pair.
//!
//! Where the line between the centers lies in both cones, so that it meets both spheres over their triangles, the
//! contact is that of two spheres, whether they are apart or have passed each other. At rims no such line exists.
//! There the closest points of the flat triangles are moved onto the caps, and each in turn to the point of its cap
//! that is closest to the other one.

use fearless_simd::{f32x8, mask32x8, prelude::*};

use super::{
    contacts::{ContactSink, FaceContacts, lack},
    osculating::OsculatingLanes,
    pairs::ListedPairs,
};
use crate::kernel::{
    pair::{PairSettings, SurfaceSide},
    simd::{
        lanes::{CornerLanes, TriangleLanes, TrianglePairLanes, VectorLanes, WIDTH, first_lanes, widened},
        prefetch::{Prefetch, ask_ahead, ask_for_room, prefetch},
    },
    smooth::{
        closest_lanes::{ClosestLanes, FaceLanes, WeightLanes},
        gather::{corners_of, relative},
    },
};

/// How often both points of a contact at a rim are moved.
const STEPS: usize = 2;

/// Two spheres that are nearly flat have no line of centers: their curvatures together, times the radius of a triangle,
/// are less than this.
const LEAST_CURVATURE: f32 = 1.0e-4;

/// A line of centers may leave a cone by this much, as a weight of a corner, so that neighbors leave no gap between
/// them.
const CONE_SLACK: f32 = 1.0e-4;

/// Points closer than this, relative to the size of the pair, have no direction.
const SAME: f32 = 1.0e-5;

/// One side of pairs with a smooth surface.
#[derive(Clone, Copy)]
pub struct OsculatingSide<'a> {
    /// The surface in the pair's frame.
    pub surface: SurfaceSide<'a>,
    /// The signed curvatures of its spheres in its own frame. Empty if the surface is flat.
    pub curvatures: &'a [f32],
}

impl Prefetch for OsculatingSide<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn prefetch(&self, triangle: u32) {
        prefetch(self.surface.topology.triangles(), triangle);
        prefetch(self.curvatures, triangle);
    }
}

/// Appends the pairs that come within range to `passing`, and their contacts to `found`.
#[expect(private_bounds, reason = "only lists of this crate take contacts eight at a time")]
pub fn osculating_contacts(
    a: &OsculatingSide<'_>,
    b: &OsculatingSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    passing: &mut Vec<[u32; 2]>,
    found: &mut impl ContactSink,
) {
    passing.reserve(candidates.len());
    found.reserve(candidates.len());
    dispatch!(simd => {
        for (block, pairs) in candidates.chunks(WIDTH).enumerate() {
            ask_ahead(a, b, candidates, block);
            ask_for_room(passing);
            let contacts = contacts_in_lanes(simd, a, b, pairs, settings);
            let meets = contacts.meet.to_bitmask() & first_lanes(pairs.len());
            ListedPairs::new(simd, pairs).append(simd, meets, passing);
            found.push(simd, pairs, contacts, settings);
        }
    });
}

/// One triangle of each of eight pairs with its cap.
struct CapOfPair<S: Simd> {
    corners: [VectorLanes<S>; 3],
    face: FaceLanes<S>,
    sphere: OsculatingLanes<S>,
}

impl<S: Simd> CapOfPair<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn point(&self, WeightLanes([second, third]): &WeightLanes<S>) -> VectorLanes<S> {
        let [p, q, r] = self.corners;
        p.plus((q - p).scaled(*second)).plus((r - p).scaled(*third))
    }

    /// Whether a point of the sphere lies in the cone of its cap.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn is_below(&self, simd: S, point: VectorLanes<S>) -> mask32x8<S> {
        let WeightLanes([second, third]) = self.face.foot(simd, self.sphere.below(point)).weights;
        let first = f32x8::splat(simd, 1.0) - second - third;
        first.simd_ge(-CONE_SLACK) & second.simd_ge(-CONE_SLACK) & third.simd_ge(-CONE_SLACK)
    }

    /// The closest point of the cap to another point: its foot on the sphere, or a point over the border.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn closest(&self, simd: S, point: VectorLanes<S>) -> VectorLanes<S> {
        let foot = self.sphere.below(self.sphere.foot(point));
        let over = self.face.foot(simd, foot);
        let [p, q, r] = self.corners;
        let mut best = on_segment(p, q, foot);
        for other in [on_segment(q, r, foot), on_segment(r, p, foot)] {
            let is_closer = other.1.simd_lt(best.1);
            best = (VectorLanes::select(is_closer, other.0, best.0), is_closer.select(other.1, best.1));
        }
        self.sphere.foot(VectorLanes::select(over.is_inside, self.point(&over.weights), best.0))
    }
}

/// The closest point of a segment, and its squared distance.
#[cfg_attr(not(unoptimized), inline(always))]
fn on_segment<S: Simd>(
    start: VectorLanes<S>,
    end: VectorLanes<S>,
    point: VectorLanes<S>,
) -> (VectorLanes<S>, f32x8<S>) {
    let along = end - start;
    let share = along.dot(point - start) / along.dot(along).max(f32::MIN_POSITIVE);
    let closest = start.plus(along.scaled(share.max(0.0).min(1.0)));
    let between = closest - point;
    (closest, between.dot(between))
}

/// Points of both caps, and what lies between them.
struct Place<S: Simd> {
    points: [VectorLanes<S>; 2],
    normal: VectorLanes<S>,
    gap: f32x8<S>,
}

#[cfg_attr(not(unoptimized), inline(always))]
fn contacts_in_lanes<S: Simd>(
    simd: S,
    a: &OsculatingSide<'_>,
    b: &OsculatingSide<'_>,
    pairs: &[[u32; 2]],
    settings: &PairSettings,
) -> FaceContacts<S> {
    let (own, other) = (triangles::<0>(pairs), triangles::<1>(pairs));
    let corners = [corners_of(simd, &a.surface, &own), corners_of(simd, &b.surface, &other)];
    let origin = corners[0][0];
    let (local_a, local_b) = (relative(&corners[0], origin), relative(&corners[1], origin));
    let mut size = f32x8::splat(simd, f32::MIN_POSITIVE);
    for corner in [local_a[1], local_a[2], local_b[0], local_b[1], local_b[2]] {
        size = size.max(corner.x.abs()).max(corner.y.abs()).max(corner.z.abs());
    }
    let scale = f32x8::splat(simd, 1.0) / size;
    let cap_a = cap(simd, a, &local_a, scale, curvatures(simd, a, &own) * size);
    let cap_b = cap(simd, b, &local_b, scale, curvatures(simd, b, &other) * size);
    // A sheet shows the side that faces the other triangle.
    let between = cap_b.sphere.center - cap_a.sphere.center;
    let (cap_a, cap_b) = (facing(simd, a, cap_a, between), facing(simd, b, cap_b, between.negated()));

    let flat = ClosestLanes::of(simd, &cap_a.corners, &cap_b.corners);
    let at_rim = at_rim(simd, &cap_a, &cap_b, &flat.weights);
    let (between_centers, is_between) = between_centers(simd, &cap_a, &cap_b);
    let points = [
        VectorLanes::select(is_between, between_centers.points[0], at_rim.points[0]),
        VectorLanes::select(is_between, between_centers.points[1], at_rim.points[1]),
    ];
    let normal = VectorLanes::select(is_between, between_centers.normal, at_rim.normal);
    let gap = widened(is_between.select(between_centers.gap, at_rim.gap) * size);
    let [point_a, point_b] = [points[0].scaled(size).widened(), points[1].scaled(size).widened()];
    let [first, second] = corners;
    FaceContacts {
        points: [origin.plus(point_a).rounded(), origin.plus(point_b).rounded()],
        normal,
        gap,
        distance: gap.max(0.0),
        lack: lack(simd, &a.surface, &b.surface, pairs),
        meet: mask32x8::from_bitmask(simd, (gap * settings.scale).simd_le(settings.range).to_bitmask()),
        triangles: TrianglePairLanes { a: CornerLanes::new(first), b: CornerLanes::new(second) },
    }
}

/// The triangles of one side. The last pair fills unused lanes.
#[cfg_attr(not(unoptimized), inline(always))]
fn triangles<const SIDE: usize>(pairs: &[[u32; 2]]) -> [u32; WIDTH] {
    std::array::from_fn(|lane| pairs[lane.min(pairs.len() - 1)][SIDE])
}

/// The curvatures in the pair's frame.
#[cfg_attr(not(unoptimized), inline(always))]
fn curvatures<S: Simd>(simd: S, side: &OsculatingSide<'_>, triangles: &[u32; WIDTH]) -> f32x8<S> {
    if side.curvatures.is_empty() {
        return f32x8::splat(simd, 0.0);
    }
    let own = std::array::from_fn::<_, WIDTH, _>(|lane| side.curvatures[triangles[lane] as usize]);
    f32x8::from_slice(simd, &own) * side.surface.moved.map_or(1.0, |moved| (1.0 / moved.pose.scale()) as f32)
}

#[cfg_attr(not(unoptimized), inline(always))]
fn cap<S: Simd>(
    simd: S,
    side: &OsculatingSide<'_>,
    &[p, q, r]: &[VectorLanes<S>; 3],
    scale: f32x8<S>,
    curvature: f32x8<S>,
) -> CapOfPair<S> {
    let corners = [p.scaled(scale), q.scaled(scale), r.scaled(scale)];
    let sphere = OsculatingLanes::new(simd, &TriangleLanes(corners), curvature);
    // A mirrored triangle has its normal inside. The curvature is that of the outside.
    let mirrored = mask32x8::splat(simd, side.surface.mirrored);
    let normal = VectorLanes::select(mirrored, sphere.normal.negated(), sphere.normal);
    CapOfPair { corners, face: FaceLanes::new(simd, &corners), sphere: OsculatingLanes { normal, ..sphere } }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn facing<S: Simd>(simd: S, side: &OsculatingSide<'_>, cap: CapOfPair<S>, towards: VectorLanes<S>) -> CapOfPair<S> {
    if side.surface.one_sided {
        return cap;
    }
    let sphere = cap.sphere.turned(cap.sphere.normal.dot(towards).simd_lt(f32x8::splat(simd, 0.0)));
    CapOfPair { sphere, ..cap }
}

/// The contact along the line between the centers, and where it is one: the line lies in both cones, and the spheres
/// are closest there.
#[cfg_attr(not(unoptimized), inline(always))]
fn between_centers<S: Simd>(simd: S, a: &CapOfPair<S>, b: &CapOfPair<S>) -> (Place<S>, mask32x8<S>) {
    let (own, other) = (&a.sphere, &b.sphere);
    let between = other.center - own.center;
    let line = own.normal.scaled(other.curvature * own.cosine).plus(between.scaled(own.curvature * other.curvature))
        - other.normal.scaled(own.curvature * other.cosine);
    let length = line.dot(line).sqrt();
    let scale = f32x8::splat(simd, 1.0) / length.max(f32::MIN_POSITIVE);
    let normal = line.scaled(scale);
    let along_a = (between.scaled(other.curvature) - other.normal.scaled(other.cosine)).scaled(scale);
    let along_b = (between.scaled(own.curvature).plus(own.normal.scaled(own.cosine))).scaled(-scale);
    let at_a = own.center.plus(along_a - own.normal.scaled(along_a.dot(own.normal)));
    let at_b = other.center.plus(along_b - other.normal.scaled(along_b.dot(other.normal)));
    let points = [own.over(at_a), other.over(at_b)];
    let gap = (points[1] - points[0]).dot(normal);
    let together = own.curvature + other.curvature;
    let radius = own.squared_radius.min(other.squared_radius).sqrt();
    let is_convex =
        (together * radius).simd_gt(LEAST_CURVATURE) & (together + own.curvature * other.curvature * gap).simd_gt(0.0);
    let faces = normal.dot(own.normal).simd_gt(0.0) & normal.dot(other.normal).simd_lt(0.0);
    let over_both = a.is_below(simd, points[0]) & b.is_below(simd, points[1]);
    (Place { points, normal, gap }, is_convex & faces & over_both & length.simd_gt(0.0))
}

/// The contact near the closest points of the flat triangles.
#[cfg_attr(not(unoptimized), inline(always))]
fn at_rim<S: Simd>(simd: S, a: &CapOfPair<S>, b: &CapOfPair<S>, weights: &[WeightLanes<S>; 2]) -> Place<S> {
    let one = f32x8::splat(simd, 1.0);
    let flat = [a.point(&weights[0]), b.point(&weights[1])];
    let before = flat[1] - flat[0];
    // Triangles that cross have passed each other along their normals.
    let across = (a.sphere.normal - b.sphere.normal).normalized().0;
    let crosses = before.dot(before).simd_lt(SAME * SAME);
    let direction = VectorLanes::select(crosses, across, before);
    let mut points = [a.sphere.foot(flat[0]), b.sphere.foot(flat[1])];
    for _ in 0..STEPS {
        points[0] = a.closest(simd, points[1]);
        points[1] = b.closest(simd, points[0]);
    }
    let between = points[1] - points[0];
    let length = between.dot(between).sqrt();
    let sign = between.dot(direction).simd_lt(0.0).select(-one, one);
    let has_direction = length.simd_gt(SAME);
    let unit = between.scaled(sign / length.max(f32::MIN_POSITIVE));
    let normal = VectorLanes::select(has_direction, unit, direction.normalized().0);
    Place { points, normal, gap: length * sign }
}
