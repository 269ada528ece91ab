//! The features of eight pairs of triangles, case by case.

use fearless_simd::{f64x8, mask64x8, prelude::*, u64x8};

use super::rows::Rows;
use crate::kernel::{
    exact::{cases::Cases, tolerances::PARALLEL_SINE},
    simd::lanes::DoubleVectorLanes,
};

/// The smallest squared distance, and its case.
struct Nearest<S: Simd> {
    distance_squared: f64x8<S>,
    case: u64x8<S>,
}

impl<S: Simd> Nearest<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn none(simd: S) -> Self {
        Self { distance_squared: f64x8::splat(simd, f64::INFINITY), case: u64x8::splat(simd, 0) }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn add(&mut self, distance_squared: f64x8<S>, case: u64x8<S>) {
        let nearer = distance_squared.simd_lt(self.distance_squared);
        self.distance_squared = nearer.select(distance_squared, self.distance_squared);
        self.case = nearer.select(case, self.case);
    }
}

/// The cases found, one bit each, the smallest squared distance, and its case.
pub(super) struct Found<S: Simd> {
    pub(super) cases: u64x8<S>,
    /// The smallest squared distance of a vertex from an edge.
    pub(super) boundary: f64x8<S>,
    pub(super) nearest: f64x8<S>,
    pub(super) closest: u64x8<S>,
}

#[cfg_attr(not(unoptimized), inline(always))]
fn with_case<S: Simd>(cases: u64x8<S>, is_case: mask64x8<S>, case: u64x8<S>) -> u64x8<S> {
    is_case.select(cases | case, cases)
}

const fn bit(case: Cases) -> u64 {
    case.0 as u64
}

const VERTICES_OF_A: [u64; 3] =
    [bit(Cases::vertex_face(true, 0)), bit(Cases::vertex_face(true, 1)), bit(Cases::vertex_face(true, 2))];

const EDGES: [[u64; 3]; 3] = [
    [bit(Cases::edges(0, 0)), bit(Cases::edges(0, 1)), bit(Cases::edges(0, 2))],
    [bit(Cases::edges(1, 0)), bit(Cases::edges(1, 1)), bit(Cases::edges(1, 2))],
    [bit(Cases::edges(2, 0)), bit(Cases::edges(2, 1)), bit(Cases::edges(2, 2))],
];

/// All cases except edges through faces, up to a squared distance, which is finite. Everything between a corner or edge
/// of the first triangle and one of the second is done at once, so that the vector between them is read once.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn features<S: Simd>(simd: S, rows: &mut Rows, limit: f64x8<S>) -> Found<S> {
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let nowhere = f64x8::splat(simd, f64::INFINITY);
    let mut boundary = nowhere;
    let mut cases = u64x8::splat(simd, 0);
    let (mut faces, mut edges) = (Nearest::none(simd), Nearest::none(simd));
    let mut areas_over_a = [nowhere; 3];
    let normal_a = DoubleVectorLanes::load(simd, &rows.normals[0]);
    let normal_b = DoubleVectorLanes::load(simd, &rows.normals[1]);
    let inverse_normal_a = one / normal_a.dot(normal_a);
    let inverse_normal_b = one / normal_b.dot(normal_b);
    for i in 0..3 {
        let u = DoubleVectorLanes::load(simd, &rows.edges[0][i]);
        let inverse_u = rows.inverses[0][i].load(simd);
        let sine_u = rows.lengths_squared[0][i].load(simd) * (PARALLEL_SINE * PARALLEL_SINE);
        let inward_u = DoubleVectorLanes::load(simd, &rows.inward[0][i]);
        let mut area_over_b = nowhere;
        for j in 0..3 {
            let way = DoubleVectorLanes::load(simd, &rows.ways[i][j]);
            let v = DoubleVectorLanes::load(simd, &rows.edges[1][j]);
            let (along, distance_squared) = on_edge(simd, way, v, rows.inverses[1][j].load(simd));
            boundary = boundary.min(distance_squared);
            rows.boundaries[3 * i + j].store(distance_squared);
            rows.alongs[3 * i + j].store(along);
            let (along, distance_squared) = on_edge(simd, way, u, inverse_u);
            boundary = boundary.min(distance_squared);
            rows.boundaries[9 + 3 * j + i].store(distance_squared);
            rows.alongs[9 + 3 * j + i].store(along);

            area_over_b = area_over_b.min(DoubleVectorLanes::load(simd, &rows.inward[1][j]).dot(way));
            areas_over_a[j] = areas_over_a[j].min(inward_u.dot(way));

            let normal = u.cross(v);
            let normal_squared = normal.dot(normal);
            let crosses = normal_squared.simd_gt(sine_u * rows.lengths_squared[1][j].load(simd));
            let (along_a, along_b) = (way.cross(v).dot(normal), u.cross(way).dot(normal));
            let (least, largest) = (along_a.min(along_b), along_a.max(along_b));
            let inside = crosses & least.simd_gt(zero) & largest.simd_lt(normal_squared);
            let height = normal.dot(way);
            let distance_squared = inside.select(height * height * (one / normal_squared), nowhere);
            let case = u64x8::splat(simd, EDGES[i][j]);
            cases = with_case(cases, distance_squared.simd_le(limit), case);
            edges.add(distance_squared, case);
            rows.volumes[i][j].store(height);
        }
        let height = normal_b.dot(DoubleVectorLanes::load(simd, &rows.ways[i][0]));
        let case = u64x8::splat(simd, VERTICES_OF_A[i]);
        let distance_squared = over_face(area_over_b, height, inverse_normal_b, nowhere);
        cases = with_case(cases, distance_squared.simd_le(limit), case);
        faces.add(distance_squared, case);
        rows.heights[0][i].store(height);
    }
    for j in 0..3 {
        let height = normal_a.dot(DoubleVectorLanes::load(simd, &rows.ways[0][j]));
        let case = u64x8::splat(simd, bit(Cases::vertex_face(false, j)));
        let distance_squared = over_face(areas_over_a[j], height, inverse_normal_a, nowhere);
        cases = with_case(cases, distance_squared.simd_le(limit), case);
        faces.add(distance_squared, case);
        rows.heights[1][j].store(height);
    }
    // Of equally close cases, boundaries come first, then vertices over faces, then edges.
    faces.add(edges.distance_squared, edges.case);
    let nearest = faces.distance_squared.min(boundary);
    let closest = faces.distance_squared.simd_lt(boundary).select(faces.case, u64x8::splat(simd, 0));
    Found { cases, boundary, nearest, closest }
}

/// Where along an edge a point is closest, 0 to 1, and the squared distance, given the vector between the edge's start
/// and the point.
#[cfg_attr(not(unoptimized), inline(always))]
fn on_edge<S: Simd>(
    simd: S,
    from_start: DoubleVectorLanes<S>,
    edge: DoubleVectorLanes<S>,
    inverse: f64x8<S>,
) -> (f64x8<S>, f64x8<S>) {
    let (zero, one) = (f64x8::splat(simd, 0.0), f64x8::splat(simd, 1.0));
    let along = (from_start.dot(edge) * inverse).max(zero).min(one);
    let between = from_start - edge.scaled(along);
    (along, between.dot(between))
}

/// For a face without area, no area is positive, and the distance is NaN or infinite.
#[cfg_attr(not(unoptimized), inline(always))]
fn over_face<S: Simd>(least_area: f64x8<S>, height: f64x8<S>, inverse: f64x8<S>, nowhere: f64x8<S>) -> f64x8<S> {
    least_area.simd_gt(0.0).select(height * height * inverse, nowhere)
}

/// The smallest and the largest volume between an edge of one triangle and the other's edges.
#[cfg_attr(not(unoptimized), inline(always))]
fn volumes<S: Simd>(simd: S, rows: &Rows, side: usize, edge: usize) -> (f64x8<S>, f64x8<S>) {
    let volumes = &rows.volumes;
    let [a, b, c] = if side == 0 {
        [&volumes[edge][0], &volumes[edge][1], &volumes[edge][2]]
    } else {
        [&volumes[0][edge], &volumes[1][edge], &volumes[2][edge]]
    };
    let [a, b, c] = [a.load(simd), b.load(simd), c.load(simd)];
    (a.min(b).min(c), a.max(b).max(c))
}

/// How high the ends of an edge are over the other triangle's face.
#[cfg_attr(not(unoptimized), inline(always))]
fn ends<S: Simd>(simd: S, rows: &Rows, side: usize, edge: usize) -> (f64x8<S>, f64x8<S>) {
    let heights = &rows.heights[side];
    (heights[edge].load(simd), heights[(edge + 1) % 3].load(simd))
}

/// The edges whose ends may be on different sides of the other face's plane, and which that face's edges may all pass
/// on the same side.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn may_pierce<S: Simd>(simd: S, rows: &Rows, rounding: f64x8<S>) -> u64x8<S> {
    let mut cases = u64x8::splat(simd, 0);
    for edge in 0..3 {
        for side in 0..2 {
            let (least, largest) = volumes(simd, rows, side, edge);
            let (from, to) = ends(simd, rows, side, edge);
            let on_one_side = (from * to).simd_gt(0.0);
            let passed_on_both_sides = least.simd_lt(-rounding) & largest.simd_gt(rounding);
            let possible = !(on_one_side | passed_on_both_sides);
            let case = u64x8::splat(simd, bit(Cases::piercing(side == 0, edge)));
            cases = with_case(cases, possible, case);
        }
    }
    cases
}

/// The edges that certainly pierce a face: neither condition of [`may_pierce`] is in doubt.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn certainly_pierce<S: Simd>(simd: S, rows: &Rows, rounding: f64x8<S>, firm: f64x8<S>) -> u64x8<S> {
    let mut cases = u64x8::splat(simd, 0);
    for edge in 0..3 {
        for side in 0..2 {
            let (least, largest) = volumes(simd, rows, side, edge);
            let (from, to) = ends(simd, rows, side, edge);
            let passed_on_one_side = least.simd_gt(rounding) | largest.simd_lt(-rounding);
            let (own, other) = (&rows.lengths_squared[side], &rows.lengths_squared[1 - side]);
            let size_squared = own[edge].load(simd) + other[0].load(simd) + other[1].load(simd);
            let fall = from - to;
            let is_firm = (fall * fall * size_squared).simd_gt(firm * firm);
            let certain = (from * to).simd_lt(0.0) & passed_on_one_side & is_firm;
            let case = u64x8::splat(simd, bit(Cases::piercing(side == 0, edge)));
            cases = with_case(cases, certain, case);
        }
    }
    cases
}
