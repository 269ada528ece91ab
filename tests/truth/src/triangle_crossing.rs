//! Whether two closed triangles share a point, decided by exact signs without tolerances.
//!
//! The intersection of two triangles is convex, and its extreme points lie on an edge of one of them. So the triangles
//! share a point if and only if an edge of one meets the other. All answers come from the signs of Shewchuk's adaptive
//! predicates (J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates",
//! 1997) and from comparisons of input coordinates.

use glam::{DVec2, DVec3};
use robust::{Coord, Coord3D};
use std::cmp::Ordering;

/// Whether two closed triangles have at least one point in common.
///
/// Exact for finite coordinates that are 0 or have a magnitude from 1e-60 to 1e60, which includes every f32, even
/// subnormal ones. Beyond that, products of three coordinates and their rounding errors leave the range of f64. A
/// triangle without area counts as a segment or a point. Touching in one point, sharing a vertex or an edge, and
/// overlapping in one plane all count.
/// overlapping in one plane all count.
#[must_use]
pub fn triangles_cross(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    if !boxes_meet(a, b) {
        return false;
    }
    (0..3).any(|k| segment_meets_triangle(a[k], a[(k + 1) % 3], b))
        || (0..3).any(|k| segment_meets_triangle(b[k], b[(k + 1) % 3], a))
}

/// A projection onto a coordinate plane. Dropping a coordinate does not round.
#[derive(Clone, Copy)]
enum Projection {
    DropX,
    DropY,
    DropZ,
}

const PROJECTIONS: [Projection; 3] = [Projection::DropX, Projection::DropY, Projection::DropZ];

impl Projection {
    fn apply(self, point: DVec3) -> DVec2 {
        match self {
            Projection::DropX => DVec2::new(point.y, point.z),
            Projection::DropY => DVec2::new(point.z, point.x),
            Projection::DropZ => DVec2::new(point.x, point.y),
        }
    }
}

/// Whether the axis-aligned boxes of two point sets overlap. Only comparisons, so exact.
fn boxes_meet<const N: usize>(a: &[DVec3; N], b: &[DVec3; N]) -> bool {
    let low = |points: &[DVec3; N]| points.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = |points: &[DVec3; N]| points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    low(a).cmple(high(b)).all() && low(b).cmple(high(a)).all()
}

/// The side of the plane through `triangle` on which `point` lies. `Equal` means exactly on it.
pub(super) fn side_of_plane(triangle: &[DVec3; 3], point: DVec3) -> Ordering {
    let coord = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    sign(robust::orient3d(coord(triangle[0]), coord(triangle[1]), coord(triangle[2]), coord(point)))
}

/// The turn of the path a → b → c. `Equal` means exactly collinear.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> Ordering {
    let coord = |p: DVec2| Coord { x: p.x, y: p.y };
    sign(robust::orient2d(coord(a), coord(b), coord(c)))
}

fn sign(determinant: f64) -> Ordering {
    // Not `total_cmp`, which orders -0.0 before 0.0.
    determinant.partial_cmp(&0.0).unwrap_or(Ordering::Equal)
}

/// A projection in which three points are not collinear, if there is one. The points then span a plane, and the
/// projection is one-to-one on it.
fn faithful_projection(a: DVec3, b: DVec3, c: DVec3) -> Option<Projection> {
    PROJECTIONS
        .into_iter()
        .find(|projection| turn(projection.apply(a), projection.apply(b), projection.apply(c)) != Ordering::Equal)
}

/// Whether the closed segment from `p` to `q` meets the closed triangle.
fn segment_meets_triangle(p: DVec3, q: DVec3, triangle: &[DVec3; 3]) -> bool {
    let [t0, t1, t2] = *triangle;
    let Some(projection) = faithful_projection(t0, t1, t2) else {
        // All corners are collinear: the triangle is the union of its edges.
        return (0..3).any(|k| segments_meet(p, q, triangle[k], triangle[(k + 1) % 3]));
    };
    match (side_of_plane(triangle, p), side_of_plane(triangle, q)) {
        (Ordering::Equal, Ordering::Equal) => {
            // A segment in the triangle's plane starts inside the triangle or crosses one of its edges.
            let corners = triangle.map(|corner| projection.apply(corner));
            let (p, q) = (projection.apply(p), projection.apply(q));
            point_in_triangle(p, &corners)
                || (0..3).any(|k| segments_meet_in_plane(p, q, corners[k], corners[(k + 1) % 3]))
        }
        (side_p, side_q) if side_p == side_q => false,
        // The segment meets the plane in one point, which is in the triangle if the line passes all edges on one side.
        _ => all_on_one_side([
            side_of_plane(&[p, q, t0], t1),
            side_of_plane(&[p, q, t1], t2),
            side_of_plane(&[p, q, t2], t0),
        ]),
    }
}

/// Whether no two of three signs are opposite. `Equal` is compatible with both.
fn all_on_one_side(signs: [Ordering; 3]) -> bool {
    !(signs.contains(&Ordering::Less) && signs.contains(&Ordering::Greater))
}

/// Whether a point lies in a closed triangle with area, all in one plane.
fn point_in_triangle(point: DVec2, triangle: &[DVec2; 3]) -> bool {
    all_on_one_side([0, 1, 2].map(|k| turn(triangle[k], triangle[(k + 1) % 3], point)))
}

/// Whether two closed segments in one plane meet. Either may be a point.
fn segments_meet_in_plane(p: DVec2, q: DVec2, r: DVec2, s: DVec2) -> bool {
    let (turn_r, turn_s) = (turn(p, q, r), turn(p, q, s));
    let (turn_p, turn_q) = (turn(r, s, p), turn(r, s, q));
    let splits = |one: Ordering, other: Ordering| one != other && one != Ordering::Equal && other != Ordering::Equal;
    if splits(turn_r, turn_s) && splits(turn_p, turn_q) {
        return true;
    }
    // Otherwise, they can meet only where an end of one lies on the other.
    (turn_r == Ordering::Equal && between(p, q, r))
        || (turn_s == Ordering::Equal && between(p, q, s))
        || (turn_p == Ordering::Equal && between(r, s, p))
        || (turn_q == Ordering::Equal && between(r, s, q))
}

/// Whether a point on the line through `a` and `b` lies in the box of the two, and so on their segment.
fn between(a: DVec2, b: DVec2, point: DVec2) -> bool {
    let low = a.min(b);
    let high = a.max(b);
    low.cmple(point).all() && point.cmple(high).all()
}

/// Whether two closed segments in space meet. Either may be a point.
fn segments_meet(p: DVec3, q: DVec3, r: DVec3, s: DVec3) -> bool {
    if side_of_plane(&[p, q, r], s) != Ordering::Equal {
        return false;
    }
    let projection =
        [(p, q, r), (p, q, s), (r, s, p), (r, s, q)].into_iter().find_map(|(a, b, c)| faithful_projection(a, b, c));
    match projection {
        Some(projection) => {
            segments_meet_in_plane(projection.apply(p), projection.apply(q), projection.apply(r), projection.apply(s))
        }
        // Four collinear points, or two pairs of equal points. Along a line every coordinate is monotone, so the
        // segments meet where their boxes do. The boxes of two distinct points never meet.
        None => boxes_meet(&[p, q], &[r, s]),
    }
}
