//! Which features of eight pairs of triangles count, and how far apart the triangles are, side by side, before any pair is
//! looked at alone.
//!
//! The arithmetic is that of `triangle_pair`, operation by operation, so that a feature passes here exactly where it
//! passes there and a distance is the same number. Only edges that pierce a face are told by the signs of volumes that
//! are computed another way: what may be of either sign passes, and is left to the exact test.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f32x4, f32x8, f64x8, mask64x8, prelude::*, u64x8};
use glam::DVec3;

use super::{
    cases::{BoundaryCases, Cases},
    triangle_pair::{AT_END, PARALLEL_SINE, ROUND_OFF, TIE},
};
use crate::kernel::{
    corner_rows::CornerRow,
    lanes::{DoubleVectorLanes, WIDTH, first_lanes, widened},
    pose::Pose,
};

/// A volume of three edges may be of either sign where it is below this share of the cube of the pair's largest
/// coordinate: seven times what its rounding amounts to.
const VOLUME_ROUNDING: f64 = 1.0e-12;

/// An edge pierces a face beyond doubt where its rise over the face, times the pair's size, is more than this share of the fourth
/// power of the largest coordinate: then the volumes' rounding moves the point of piercing by less than a tenth of what
/// `triangle_pair` allows, 3e-13 of that power over the rise and the size against 1e-10.
const FIRM_PIERCING: f64 = 3.0e-2;

/// A pair of triangles that may be within range.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct ScreenedPair {
    /// What of it counts, or may.
    pub(in crate::kernel) cases: Cases,
    /// Least squared distance of a vertex of either from an edge of the other.
    pub(super) boundary: f64,
    /// Which vertices and edges are that close, or nearly: bit `3 v + e` for vertex `v` of the first triangle and edge `e` of
    /// the second, nine bits further for a vertex of the second.
    pub(super) on_boundary: u32,
    /// Squared distance of the two, unless they cross.
    pub(super) nearest: f64,
    /// Its root.
    distance: f64,
    /// The largest coordinate of either.
    pub(super) largest: f64,
    /// Which of the vertices over faces and pairs of edges is closest, the first of those that are equally close; none
    /// where boundaries are closer.
    pub(in crate::kernel) closest: Cases,
}

impl ScreenedPair {
    /// The distance below which the pair's features touch as far as f64 tells.
    pub(in crate::kernel) fn nothing(&self) -> f64 {
        ROUND_OFF * self.largest
    }

    /// Whether there is no distance between the two.
    pub(in crate::kernel) fn touches(&self) -> bool {
        self.distance <= self.nothing()
    }
}

/// A lower bound of a distance in f32.
#[inline]
pub(in crate::kernel) fn rounded_down(distance: f64) -> f32 {
    // The conversion rounds to the nearest, at most by half of that.
    (distance * (1.0 - f64::from(f32::EPSILON))).max(0.0) as f32
}

/// What distances are asked about. They are in world units, of which one unit of the frame of the pairs is `scale`.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct ScreenLimits {
    pub(in crate::kernel) scale: f64,
    /// Up to where the nearest pair is looked for.
    pub(in crate::kernel) range: f64,
    pub(in crate::kernel) contact_distance: f64,
}

/// Some of the eight pairs of a screen, one bit each.
#[derive(Clone, Copy, Default)]
pub(in crate::kernel) struct Screened {
    /// Those that may be within the range.
    pub(in crate::kernel) possible: u32,
    /// Those of them of which there is no telling whether they cross.
    pub(in crate::kernel) doubtful: u32,
    /// Those with a vertex of either on the boundary of the other, without any distance.
    pub(in crate::kernel) meeting: u32,
    /// Of those without doubt: those within the range.
    pub(in crate::kernel) near: u32,
    /// Those within the contact distance.
    pub(in crate::kernel) touching: u32,
    /// Those with features inside of faces or edges that are within the range, or cross.
    pub(in crate::kernel) with_cases: u32,
    /// Those with nothing closer than what is on the boundaries of both.
    pub(in crate::kernel) on_boundary: u32,
}

/// Eight pairs of triangles and what is known of them.
pub(in crate::kernel) struct PairScreen {
    cases: [u64; WIDTH],
    closest: [u64; WIDTH],
    boundary: [f64; WIDTH],
    on_boundary: [u64; WIDTH],
    nearest: [f64; WIDTH],
    distance: [f64; WIDTH],
    largest: [f64; WIDTH],
    world_distance: [f64; WIDTH],
    boundary_cases: [u64; WIDTH],
}

impl PairScreen {
    pub(in crate::kernel) const WIDTH: usize = WIDTH;

    pub(in crate::kernel) fn new() -> Self {
        Self {
            cases: [0; WIDTH],
            closest: [0; WIDTH],
            boundary: [0.0; WIDTH],
            on_boundary: [0; WIDTH],
            nearest: [0.0; WIDTH],
            distance: [0.0; WIDTH],
            largest: [0.0; WIDTH],
            world_distance: [0.0; WIDTH],
            boundary_cases: [0; WIDTH],
        }
    }

    /// Screens pairs, of which the first `count` are asked about. The triangles of either side are given in the frame of the
    /// side's `pose`, if it has one.
    pub(in crate::kernel) fn screen(
        &mut self,
        sides: [&[&CornerRow; WIDTH]; 2],
        poses: [Option<&Pose>; 2],
        count: usize,
        limits: &ScreenLimits,
    ) -> Screened {
        let mut screened = Screened::default();
        dispatch!(Level::new(), simd => screened = self.screen_in_lanes(simd, sides, poses, limits));
        let asked = first_lanes(count) as u32;
        Screened {
            possible: screened.possible & asked,
            doubtful: screened.doubtful & asked,
            meeting: screened.meeting & asked,
            near: screened.near & asked,
            touching: screened.touching & asked,
            ..screened
        }
    }

    /// One of the pairs.
    #[inline]
    pub(in crate::kernel) fn pair(&self, place: usize) -> ScreenedPair {
        ScreenedPair {
            cases: Cases(self.cases[place] as u32),
            boundary: self.boundary[place],
            on_boundary: self.on_boundary[place] as u32,
            nearest: self.nearest[place],
            distance: self.distance[place],
            largest: self.largest[place],
            closest: Cases(self.closest[place] as u32),
        }
    }

    /// The distances of the pairs in world units, 0 where they cross; without meaning where that is in doubt.
    pub(in crate::kernel) fn distances(&self) -> &[f64; WIDTH] {
        &self.world_distance
    }

    /// What of a pair is on the boundaries of both, where nothing is closer.
    pub(in crate::kernel) fn boundary_cases(&self, place: usize) -> BoundaryCases {
        BoundaryCases(self.boundary_cases[place])
    }

    /// Lower bounds of the distances of the pairs, as they were screened: within the range or not, the distance but for
    /// rounding, and 0 of pairs that may cross.
    #[inline]
    pub(in crate::kernel) fn lower_bounds(&self) -> [f32; WIDTH] {
        let mut bounds = [0.0; WIDTH];
        for place in 0..WIDTH {
            let apart = rounded_down(self.distance[place] - ROUND_OFF * self.largest[place]);
            let may_cross = self.cases[place] & u64::from(Cases::PIERCING.0) != 0;
            bounds[place] = if may_cross { 0.0 } else { apart };
        }
        bounds
    }

    #[inline(always)]
    fn screen_in_lanes<S: Simd>(
        &mut self,
        simd: S,
        sides: [&[&CornerRow; WIDTH]; 2],
        poses: [Option<&Pose>; 2],
        limits: &ScreenLimits,
    ) -> Screened {
        let zero = f64x8::splat(simd, 0.0);
        let mut triangles = [corners_in_lanes(simd, sides[0], poses[0]), corners_in_lanes(simd, sides[1], poses[1])];
        let origin = triangles[0][0];
        let mut largest = zero;
        for corners in &mut triangles {
            for corner in corners {
                *corner = *corner - origin;
                largest = largest.max(corner.x.abs()).max(corner.y.abs()).max(corner.z.abs());
            }
        }
        let nothing = largest * ROUND_OFF;
        let range = nothing.max(limits.range / limits.scale);
        let range_squared = range * range;
        let (a, b) = (Side::new(simd, triangles[0]), Side::new(simd, triangles[1]));

        let (mut boundaries, mut alongs) = ([zero; 18], [zero; 18]);
        vertices_and_edges(simd, &a, &b, &mut boundaries[..9], &mut alongs[..9]);
        vertices_and_edges(simd, &b, &a, &mut boundaries[9..], &mut alongs[9..]);
        let mut boundary = boundaries[0];
        for &distance_squared in &boundaries[1..] {
            boundary = boundary.min(distance_squared);
        }
        let tie = boundary * (1.0 + TIE);
        let mut on_boundary = u64x8::splat(simd, 0);
        for (place, &distance_squared) in boundaries.iter().enumerate() {
            on_boundary = distance_squared.simd_le(tie).select(on_boundary | (1u64 << place), on_boundary);
        }
        on_boundary.store_slice(&mut self.on_boundary);
        let mut found = Found { cases: u64x8::splat(simd, 0), nearest: boundary, closest: u64x8::splat(simd, 0) };
        found.add(!boundary.simd_gt(range_squared), Cases::BOUNDARY);
        let heights_over_b = vertices_over_face(simd, &a, &b, range_squared, true, &mut found);
        let heights_over_a = vertices_over_face(simd, &b, &a, range_squared, false, &mut found);
        let mut volumes = [[zero; 3]; 3];
        for edge_a in 0..3 {
            for edge_b in 0..3 {
                volumes[edge_a][edge_b] = edge_edge(simd, &a, &b, [edge_a, edge_b], range_squared, &mut found);
            }
        }
        let cube = largest * largest * largest;
        let (rounding, firm) = (cube * VOLUME_ROUNDING, cube * largest * FIRM_PIERCING);
        let mut certain = u64x8::splat(simd, 0);
        for edge in 0..3 {
            let [along_a, along_b] = [volumes[edge], [volumes[0][edge], volumes[1][edge], volumes[2][edge]]];
            for (of_a, own, other, heights, volumes) in
                [(true, &a, &b, &heights_over_b, along_a), (false, &b, &a, &heights_over_a, along_b)]
            {
                let (possible, clear) = may_pierce(simd, heights, edge, volumes, rounding);
                let case = Cases::piercing(of_a, edge);
                found.add(possible, case);
                let size_squared = own.lengths_squared[edge] + other.lengths_squared[0] + other.lengths_squared[1];
                let (from, to) = (heights[edge], heights[(edge + 1) % 3]);
                let fall = from - to;
                let is_firm = clear & (fall * fall * size_squared).simd_gt(firm * firm);
                certain = is_firm.select(certain | u64::from(case.0), certain);
            }
        }
        found.cases.store_slice(&mut self.cases);
        found.closest.store_slice(&mut self.closest);
        found.nearest.store_slice(&mut self.nearest);
        let distance = found.nearest.sqrt();
        distance.store_slice(&mut self.distance);
        boundary.store_slice(&mut self.boundary);
        largest.store_slice(&mut self.largest);

        let none = u64x8::splat(simd, 0);
        let piercing = found.cases & u64::from(Cases::PIERCING.0);
        let crossing = !piercing.simd_eq(none);
        let doubtful = !(piercing & !certain).simd_eq(none);
        let apart = (crossing | distance.simd_le(nothing)).select(zero, distance) * limits.scale;
        apart.store_slice(&mut self.world_distance);
        let is_certain = !found.cases.simd_eq(none) & !doubtful;
        let on_boundary = !(found.cases & u64::from(Cases::BOUNDARY.0)).simd_eq(none)
            & boundary.simd_le(found.nearest)
            & !crossing
            & is_certain;
        if on_boundary.any_true() {
            boundary_cases(simd, &boundaries, &alongs, tie.min(range_squared)).store_slice(&mut self.boundary_cases);
        }
        Screened {
            possible: (!found.cases.simd_eq(none)).to_bitmask() as u32,
            doubtful: doubtful.to_bitmask() as u32,
            meeting: boundary.simd_eq(zero).to_bitmask() as u32,
            near: (is_certain & !apart.simd_gt(limits.range)).to_bitmask() as u32,
            touching: (is_certain & apart.simd_le(limits.contact_distance)).to_bitmask() as u32,
            with_cases: (!(found.cases & !u64::from(Cases::BOUNDARY.0)).simd_eq(none)).to_bitmask() as u32,
            on_boundary: on_boundary.to_bitmask() as u32,
        }
    }
}

/// The corners of eight triangles, one number to the lanes, moved as [`Pose::transform_point`] does it.
#[inline(always)]
fn corners_in_lanes<S: Simd>(simd: S, rows: &[&CornerRow; WIDTH], pose: Option<&Pose>) -> [DoubleVectorLanes<S>; 3] {
    let numbers = numbers_in_lanes(simd, rows);
    let corner = |place: usize| DoubleVectorLanes {
        x: numbers[3 * place],
        y: numbers[3 * place + 1],
        z: numbers[3 * place + 2],
    };
    let corners = [corner(0), corner(1), corner(2)];
    match pose {
        Some(pose) => [moved(simd, pose, corners[0]), moved(simd, pose, corners[1]), moved(simd, pose, corners[2])],
        None => corners,
    }
}

/// The nine numbers of eight triangles: squares of four rows and four columns are turned round.
#[inline(always)]
fn numbers_in_lanes<S: Simd>(simd: S, rows: &[&CornerRow; WIDTH]) -> [f64x8<S>; 9] {
    let row = |lane: usize| rows[lane].corners.as_flattened();
    let square = |first_row: usize, first: usize| {
        let load = |place: usize| f32x4::from_slice(simd, &row(first_row + place)[first..first + 4]);
        let ((a, b), (c, d)) = (load(0).interleave(load(2)), load(1).interleave(load(3)));
        let ((first, second), (third, fourth)) = (a.interleave(c), b.interleave(d));
        [first, second, third, fourth]
    };
    let [low, high] = [[square(0, 0), square(4, 0)], [square(0, 4), square(4, 4)]];
    let last = [row(0)[8], row(1)[8], row(2)[8], row(3)[8], row(4)[8], row(5)[8], row(6)[8], row(7)[8]];
    let column = |halves: &[[f32x4<S>; 4]; 2], place: usize| widened(halves[0][place].combine(halves[1][place]));
    [
        column(&low, 0),
        column(&low, 1),
        column(&low, 2),
        column(&low, 3),
        column(&high, 0),
        column(&high, 1),
        column(&high, 2),
        column(&high, 3),
        widened(f32x8::from_slice(simd, &last)),
    ]
}

#[inline(always)]
fn moved<S: Simd>(simd: S, pose: &Pose, point: DoubleVectorLanes<S>) -> DoubleVectorLanes<S> {
    let affine = pose.to_affine();
    let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
    let along = |axis: DVec3, factor: f64x8<S>| DoubleVectorLanes::splat(simd, axis).scaled(factor);
    let turned = along(x, point.x).plus(along(y, point.y)).plus(along(z, point.z));
    turned.plus(DoubleVectorLanes::splat(simd, affine.translation))
}

/// A triangle of each pair with what every case needs.
struct Side<S: Simd> {
    corners: [DoubleVectorLanes<S>; 3],
    edges: [DoubleVectorLanes<S>; 3],
    lengths_squared: [f64x8<S>; 3],
    normal: DoubleVectorLanes<S>,
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    fn new(_: S, corners: [DoubleVectorLanes<S>; 3]) -> Self {
        let edges = [(corners[1] - corners[0]), (corners[2] - corners[1]), (corners[0] - corners[2])];
        let lengths_squared = [edges[0].dot(edges[0]), edges[1].dot(edges[1]), edges[2].dot(edges[2])];
        Self { corners, edges, lengths_squared, normal: edges[0].cross(edges[1]) }
    }
}

/// The cases found so far, one bit each, the least squared distance, and whose it is.
struct Found<S: Simd> {
    cases: u64x8<S>,
    nearest: f64x8<S>,
    closest: u64x8<S>,
}

impl<S: Simd> Found<S> {
    #[inline(always)]
    fn add(&mut self, possible: mask64x8<S>, Cases(case): Cases) {
        self.cases = possible.select(self.cases | u64::from(case), self.cases);
    }

    /// A distance counts wherever there is one, a case only within the range.
    #[inline(always)]
    fn add_distance(
        &mut self,
        possible: mask64x8<S>,
        within_range: mask64x8<S>,
        case: Cases,
        distance_squared: f64x8<S>,
    ) {
        self.add(possible & within_range, case);
        let nearer = possible & distance_squared.simd_lt(self.nearest);
        self.nearest = nearer.select(distance_squared, self.nearest);
        self.closest = nearer.select(u64x8::splat(self.cases.simd, u64::from(case.0)), self.closest);
    }
}

/// The squared distance of every vertex of one from every edge of the other, and where along the edge it is closest.
#[inline(always)]
fn vertices_and_edges<S: Simd>(
    simd: S,
    own: &Side<S>,
    other: &Side<S>,
    distances_squared: &mut [f64x8<S>],
    alongs: &mut [f64x8<S>],
) {
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    for edge in 0..3 {
        let squared = other.lengths_squared[edge];
        let inverse = squared.simd_gt(zero).select(one / squared, zero);
        for vertex in 0..3 {
            let from_start = own.corners[vertex] - other.corners[edge];
            let along = (from_start.dot(other.edges[edge]) * inverse).max(zero).min(one);
            let between = from_start - other.edges[edge].scaled(along);
            distances_squared[3 * vertex + edge] = between.dot(between);
            alongs[3 * vertex + edge] = along;
        }
    }
}

/// The [`BoundaryCases`] within a squared distance.
#[inline(always)]
fn boundary_cases<S: Simd>(
    simd: S,
    distances_squared: &[f64x8<S>; 18],
    alongs: &[f64x8<S>; 18],
    most: f64x8<S>,
) -> u64x8<S> {
    let mut cases = u64x8::splat(simd, 0);
    for place in 0..18 {
        let is_case = distances_squared[place].simd_le(most) & !alongs[place].simd_ge(1.0 - AT_END);
        let at_start = alongs[place].simd_le(AT_END);
        if place < 9 {
            let case = at_start.select(
                u64x8::splat(simd, BoundaryCases::of_vertices(place)),
                u64x8::splat(simd, 1 << place),
            );
            cases = is_case.select(cases | case, cases);
        } else {
            cases = (is_case & !at_start).select(cases | 1u64 << place, cases);
        }
    }
    cases
}

/// Returns how high each vertex is, in lengths of the face's normal.
#[inline(always)]
fn vertices_over_face<S: Simd>(
    simd: S,
    own: &Side<S>,
    other: &Side<S>,
    range_squared: f64x8<S>,
    vertex_of_a: bool,
    found: &mut Found<S>,
) -> [f64x8<S>; 3] {
    let inward =
        [other.normal.cross(other.edges[0]), other.normal.cross(other.edges[1]), other.normal.cross(other.edges[2])];
    let inverse = f64x8::splat(simd, 1.0) / other.normal.dot(other.normal);
    let mut heights = [inverse; 3];
    for vertex in 0..3 {
        let from_first = own.corners[vertex] - other.corners[0];
        let height = other.normal.dot(from_first);
        let distance_squared = height * height * inverse;
        // Of a face without an area it is no number, or infinite.
        let mut possible = distance_squared.simd_lt(f64::INFINITY);
        for k in 0..3 {
            let from_corner = own.corners[vertex] - other.corners[k];
            let area = inward[k].dot(from_corner);
            possible &= !area.simd_le(0.0);
        }
        let within_range = distance_squared.simd_le(range_squared);
        found.add_distance(possible, within_range, Cases::vertex_face(vertex_of_a, vertex), distance_squared);
        heights[vertex] = height;
    }
    heights
}

/// Returns six times the volume between the edges, but for the sign.
#[inline(always)]
fn edge_edge<S: Simd>(
    simd: S,
    a: &Side<S>,
    b: &Side<S>,
    [edge_a, edge_b]: [usize; 2],
    range_squared: f64x8<S>,
    found: &mut Found<S>,
) -> f64x8<S> {
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let (u, v) = (a.edges[edge_a], b.edges[edge_b]);
    let normal = u.cross(v);
    let normal_squared = normal.dot(normal);
    let between = b.corners[edge_b] - a.corners[edge_a];
    let height = normal.dot(between);
    let inverse = one / normal_squared;
    let distance_squared = height * height * inverse;
    let lengths_squared = a.lengths_squared[edge_a] * (PARALLEL_SINE * PARALLEL_SINE) * b.lengths_squared[edge_b];
    let along_a = between.cross(v).dot(normal) * inverse;
    let along_b = between.cross(u).dot(normal) * inverse;
    let inside = along_a.simd_gt(zero) & along_a.simd_lt(one) & along_b.simd_gt(zero) & along_b.simd_lt(one);
    let possible = inside & !normal_squared.simd_le(lengths_squared);
    let within_range = !distance_squared.simd_gt(range_squared);
    found.add_distance(possible, within_range, Cases::edges(edge_a, edge_b), distance_squared);
    height
}

/// Whether the ends of an edge may lie on different sides of a face's plane, and the face's three edges pass it on the same
/// side; and whether there is no doubt about either.
#[inline(always)]
fn may_pierce<S: Simd>(
    simd: S,
    heights: &[f64x8<S>; 3],
    edge: usize,
    volumes: [f64x8<S>; 3],
    rounding: f64x8<S>,
) -> (mask64x8<S>, mask64x8<S>) {
    let zero = f64x8::splat(simd, 0.0);
    let (from, to) = (heights[edge], heights[(edge + 1) % 3]);
    let same_side = (from.simd_gt(zero) & to.simd_gt(zero)) | (from.simd_lt(zero) & to.simd_lt(zero));
    let least = volumes[0].min(volumes[1]).min(volumes[2]);
    let largest = volumes[0].max(volumes[1]).max(volumes[2]);
    let passed_on_both_sides = least.simd_lt(-rounding) & largest.simd_gt(rounding);
    let on_both_sides = (from.simd_gt(zero) & to.simd_lt(zero)) | (from.simd_lt(zero) & to.simd_gt(zero));
    let passed_on_one_side = least.simd_gt(rounding) | largest.simd_lt(-rounding);
    (!(same_side | passed_on_both_sides), on_both_sides & passed_on_one_side)
}
