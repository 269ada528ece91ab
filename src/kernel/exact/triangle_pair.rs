//! The distance of two triangles, and the feature pairs that realize it.
//!
//! Two triangles that do not cross are closest between a vertex and the inside of a face, between the insides of two
//! edges, or between a vertex and an edge, ends included. These 6 + 9 + 18 cases are examined. A crossing shows as an
//! edge that pierces a face, wherever the features are: deeply crossing triangles need not have features near each
//! other. Coplanar crossings have edges that cross, or a vertex inside the other face.

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{
    cases::Cases,
    screen::ScreenedPair,
    tolerances::{AT_END, PARALLEL_SINE, ROUND_OFF, SQUARE_SLACK, TIE},
};
use crate::kernel::mesh::{
    barycentric::{corner_weights, edge_weights, normalized, point_at},
    feature::{Feature, FeaturePair},
};

/// The largest number of proximities of one pair: 6 vertex–face, 9 edge–edge, 6 edge–face, and one for each vertex of
/// one triangle and edge of the other, 18.
pub const MAX_PROXIMITIES: usize = 39;

/// The largest distance between the points at which a piercing edge and the pierced face meet, relative to the pair's
/// edges. An edge that lies in the plane of the face except for rounding pierces it nowhere in particular. The vertices
/// and edges around there are then as close as the rounding.
const PIERCING_TOLERANCE: f64 = 1.0e-10;

/// A pair of features that are close to each other, or that cross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proximity {
    /// The features of the two triangles.
    pub features: FeaturePair,
    /// Weights of the first triangle's corners. They sum to 1.
    pub barycentric_a: [f64; 3],
    /// Weights of the second triangle's corners. They sum to 1.
    pub barycentric_b: [f64; 3],
    /// From the point on the second triangle to the point on the first. Zero if an edge pierces a face.
    pub separation: DVec3,
    /// Length of `separation`, at least 0.
    pub distance: f64,
}

impl Proximity {
    /// The same proximity, with the triangles swapped.
    pub(super) fn swapped(self) -> Self {
        Self {
            features: self.features.swapped(),
            barycentric_a: self.barycentric_b,
            barycentric_b: self.barycentric_a,
            separation: -self.separation,
            distance: self.distance,
        }
    }
}

/// What is known about a pair of triangles.
#[derive(Clone, Debug, Default)]
pub struct PairProximity {
    /// Distance of the two triangles, 0 if an edge of one pierces the other. Exact up to the requested range. A pair
    /// that is farther apart has some value above the range.
    pub distance: f64,
    /// Vertex–face and edge–edge pairs that face each other within range, or beyond it by rounding; every edge–face
    /// pair that pierces; and those vertex–edge and vertex–vertex pairs that are the closest of all, several if they
    /// are equally close.
    pub proximities: Proximities,
}

/// The proximities of one pair of triangles.
pub type Proximities = ArrayVec<Proximity, MAX_PROXIMITIES>;

/// A triangle with what every case needs.
struct Sides {
    corners: [DVec3; 3],
    edges: [DVec3; 3],
    inverse_lengths_squared: [f64; 3],
    normal: DVec3,
    inverse_normal_squared: f64,
    /// In the plane, perpendicular to each edge, toward the inside.
    inward: [DVec3; 3],
}

impl Sides {
    fn new(corners: [DVec3; 3]) -> Self {
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let inverse_lengths_squared = edges.map(inverse_length_squared);
        let normal = edges[0].cross(edges[1]);
        let inward = edges.map(|edge| normal.cross(edge));
        let inverse_normal_squared = normal.length_squared().recip();
        Self { corners, edges, inverse_lengths_squared, normal, inverse_normal_squared, inward }
    }
}

/// Examines two triangles: their distance, and all feature pairs within `range` (0 or more) that count, see
/// [`PairProximity`]. Degenerate triangles count as the segment or point that they are.
pub fn examine_pair(a: &[DVec3; 3], b: &[DVec3; 3], range: f64, found: &mut PairProximity) {
    let (a, b) = local_sides(a, b);
    let boundary = least_boundary_distance_squared(&a, &b).min(least_boundary_distance_squared(&b, &a));
    let nothing = ROUND_OFF * largest_coordinate(&a).max(largest_coordinate(&b));
    let range_squared = square_of_range(range, nothing);
    found.proximities.clear();
    let mut nearest = boundary;
    for vertex in 0..3 {
        nearest = nearest.min(vertex_face(&a, &b, vertex, range_squared, true, &mut found.proximities));
        nearest = nearest.min(vertex_face(&b, &a, vertex, range_squared, false, &mut found.proximities));
    }
    for edge_a in 0..3 {
        for edge_b in 0..3 {
            nearest = nearest.min(edge_edge(&a, &b, edge_a, edge_b, range_squared, &mut found.proximities));
        }
    }
    let crossing = pierce(&a, &b, true, Cases::ALL, found) | pierce(&b, &a, false, Cases::ALL, found);
    found.conclude(&a, &b, crossing, range_squared, (boundary, u32::MAX), nearest, nothing);
}

/// Like [`examine_pair`], for a pair that was screened with the same range. Finds only feature pairs in `wanted`, and
/// boundary features if they are closest.
#[inline]
pub(in crate::kernel) fn examine_screened(
    pair: &ScreenedPair,
    corners: &[[DVec3; 3]; 2],
    range: f64,
    wanted: Cases,
    found: &mut PairProximity,
) {
    let (a, b) = local_sides(&corners[0], &corners[1]);
    let nothing = ROUND_OFF * pair.largest;
    let range_squared = square_of_range(range, nothing);
    let cases = pair.cases.and(wanted);
    found.proximities.clear();
    for vertex in 0..3 {
        if cases.contain(Cases::vertex_face(true, vertex)) {
            vertex_face(&a, &b, vertex, range_squared, true, &mut found.proximities);
        }
        if cases.contain(Cases::vertex_face(false, vertex)) {
            vertex_face(&b, &a, vertex, range_squared, false, &mut found.proximities);
        }
    }
    for edge_a in 0..3 {
        for edge_b in 0..3 {
            if cases.contain(Cases::edges(edge_a, edge_b)) {
                edge_edge(&a, &b, edge_a, edge_b, range_squared, &mut found.proximities);
            }
        }
    }
    let mut crossing =
        pair.cases.may_cross() && pierce(&a, &b, true, cases, found) | pierce(&b, &a, false, cases, found);
    if !crossing && pair.cases.may_cross() {
        // Of the others, one is enough.
        let others = pair.cases.without(wanted);
        let before = found.proximities.len();
        crossing = pierce(&a, &b, true, others, found) || pierce(&b, &a, false, others, found);
        found.proximities.truncate(before);
    }
    found.conclude(&a, &b, crossing, range_squared, (pair.boundary, pair.on_boundary), pair.nearest, nothing);
}

/// The squared distance up to which features are examined. Distances up to `nothing` count as 0.
fn square_of_range(range: f64, nothing: f64) -> f64 {
    let range = range.max(nothing);
    range * range * (1.0 + SQUARE_SLACK)
}

/// Both triangles, relative to the first corner of the first one.
#[inline]
fn local_sides(a: &[DVec3; 3], b: &[DVec3; 3]) -> (Sides, Sides) {
    let origin = a[0];
    let local = |corners: &[DVec3; 3]| Sides::new([corners[0] - origin, corners[1] - origin, corners[2] - origin]);
    (local(a), local(b))
}

impl PairProximity {
    /// Determines the distance, and adds the boundary features if they are closest. Distances are squared, except for
    /// `nothing`: smaller distances count as 0. `on_boundary` selects the boundary features to examine, see
    /// [`ScreenedPair`].
    #[expect(clippy::too_many_arguments, reason = "shared by the two ways of examining a pair")]
    #[inline]
    fn conclude(
        &mut self,
        a: &Sides,
        b: &Sides,
        crossing: bool,
        range: f64,
        (boundary, on_boundary): (f64, u32),
        nearest: f64,
        nothing: f64,
    ) {
        if !crossing && boundary <= range && boundary <= nearest {
            let most = (boundary * (1.0 + TIE)).min(range);
            boundary_proximities(&a.corners, &b.corners, true, most, on_boundary, &mut self.proximities);
            boundary_proximities(&b.corners, &a.corners, false, most, on_boundary >> 9, &mut self.proximities);
        }
        self.distance = if crossing { 0.0 } else { nearest.sqrt() };
        if self.distance <= nothing {
            self.distance = 0.0;
            for proximity in self.proximities.iter_mut().filter(|proximity| proximity.distance <= nothing) {
                proximity.distance = 0.0;
            }
        }
    }
}

fn largest_coordinate(triangle: &Sides) -> f64 {
    triangle.corners.iter().fold(0.0, |largest: f64, corner| largest.max(corner.abs().max_element()))
}

fn inverse_length_squared(edge: DVec3) -> f64 {
    let squared = edge.length_squared();
    if squared > 0.0 { squared.recip() } else { 0.0 }
}

/// Where along an edge a point is closest, 0–1, and the squared distance, given the vector from the edge's start to the
/// point.
#[inline]
fn place_on_edge(from_start: DVec3, edge: DVec3, inverse_length_squared: f64) -> (f64, f64) {
    let along = (from_start.dot(edge) * inverse_length_squared).clamp(0.0, 1.0);
    (along, (from_start - edge * along).length_squared())
}

fn least_boundary_distance_squared(own: &Sides, other: &Sides) -> f64 {
    let mut least = f64::INFINITY;
    for vertex in 0..3 {
        for edge in 0..3 {
            let from_start = own.corners[vertex] - other.corners[edge];
            least = least.min(place_on_edge(from_start, other.edges[edge], other.inverse_lengths_squared[edge]).1);
        }
    }
    least
}

/// The closest boundary features, for a pair that was screened with the same range and does not cross.
#[inline]
pub(in crate::kernel) fn examine_boundaries(
    pair: &ScreenedPair,
    [a, b]: &[[DVec3; 3]; 2],
    range: f64,
    found: &mut Proximities,
) {
    let nothing = pair.nothing();
    let most = (pair.boundary * (1.0 + TIE)).min(square_of_range(range, nothing));
    let (a, b) = (a.map(|corner| corner - a[0]), b.map(|corner| corner - a[0]));
    boundary_proximities(&a, &b, true, most, pair.on_boundary, found);
    boundary_proximities(&b, &a, false, most, pair.on_boundary >> 9, found);
    for proximity in found.iter_mut().filter(|proximity| proximity.distance <= nothing) {
        proximity.distance = 0.0;
    }
}

/// The vertices of `own` that are within a squared distance of an edge of `other`, or of its start: the end of an edge
/// is the start of the next one. Two vertices are reported from the first triangle only. `requested` selects the cases, by
/// bit `3 v + e` for vertex `v` and edge `e`.
#[inline]
fn boundary_proximities(
    own: &[DVec3; 3],
    other: &[DVec3; 3],
    own_is_a: bool,
    most: f64,
    requested: u32,
    found: &mut Proximities,
) {
    let mut left = requested & 0x1ff;
    while left != 0 {
        let (vertex, edge) = (left.trailing_zeros() as usize / 3, left.trailing_zeros() as usize % 3);
        left &= left - 1;
        let along_edge = other[(edge + 1) % 3] - other[edge];
        let from_start = own[vertex] - other[edge];
        let (along, distance_squared) = place_on_edge(from_start, along_edge, inverse_length_squared(along_edge));
        let at_start = along <= AT_END;
        if distance_squared > most || along >= 1.0 - AT_END || at_start && !own_is_a {
            continue;
        }
        let (feature, weights) = if at_start {
            (Feature::Vertex(edge as u8), corner_weights(edge))
        } else {
            (Feature::Edge(edge as u8), edge_weights(edge, along))
        };
        let proximity = Proximity {
            features: FeaturePair { a: Feature::Vertex(vertex as u8), b: feature },
            barycentric_a: corner_weights(vertex),
            barycentric_b: weights,
            separation: own[vertex] - point_at(other, &weights),
            distance: distance_squared.sqrt(),
        };
        found.push(if own_is_a { proximity } else { proximity.swapped() });
    }
}

/// A vertex of `own` over the inside of the face of `other`. Returns the squared distance, infinite if the vertex is
/// not over the face or is beyond the range.
fn vertex_face(
    own: &Sides,
    other: &Sides,
    vertex: usize,
    range_squared: f64,
    vertex_of_a: bool,
    found: &mut Proximities,
) -> f64 {
    let position = own.corners[vertex];
    let height = other.normal.dot(position - other.corners[0]);
    let distance_squared = height * height * other.inverse_normal_squared;
    // The distance from a face without area is NaN.
    if distance_squared > range_squared || distance_squared.is_nan() {
        return f64::INFINITY;
    }
    let area = |k: usize| other.inward[k].dot(position - other.corners[k]);
    let areas = [area(1), area(2), area(0)];
    if areas[0] <= 0.0 || areas[1] <= 0.0 || areas[2] <= 0.0 {
        return f64::INFINITY;
    }
    let features = FeaturePair { a: Feature::Vertex(vertex as u8), b: Feature::Face };
    let (weights, face_weights) = (corner_weights(vertex), normalized(areas));
    let separation = other.normal * (height * other.inverse_normal_squared);
    let distance = distance_squared.sqrt();
    let proximity = Proximity { features, barycentric_a: weights, barycentric_b: face_weights, separation, distance };
    found.push(if vertex_of_a { proximity } else { proximity.swapped() });
    distance_squared
}

/// The insides of two edges. With the edges `u` and `v`, `n = u × v`, and `r` from the start of one to the start of the
/// other, the closest points of the lines are at `(r × v)·n/|n|²` and `(r × u)·n/|n|²`, at the distance `|n·r|/|n|`.
fn edge_edge(a: &Sides, b: &Sides, edge_a: usize, edge_b: usize, range_squared: f64, found: &mut Proximities) -> f64 {
    let (u, v) = (a.edges[edge_a], b.edges[edge_b]);
    let normal = u.cross(v);
    let normal_squared = normal.length_squared();
    let between = b.corners[edge_b] - a.corners[edge_a];
    let height = normal.dot(between);
    let inverse = normal_squared.recip();
    let distance_squared = height * height * inverse;
    let parallel = normal_squared <= PARALLEL_SINE * PARALLEL_SINE * u.length_squared() * v.length_squared();
    if parallel || distance_squared > range_squared {
        return f64::INFINITY;
    }
    let (along_a, along_b) = (between.cross(v).dot(normal), between.cross(u).dot(normal));
    // If the edges end in one point, these are usually exactly 0 or the whole, which a quotient need not be.
    let inside = |along: f64| along > 0.0 && along < normal_squared;
    if !(inside(along_a) && inside(along_b)) {
        return f64::INFINITY;
    }
    let (along_a, along_b) = (along_a * inverse, along_b * inverse);
    found.push(Proximity {
        features: FeaturePair { a: Feature::Edge(edge_a as u8), b: Feature::Edge(edge_b as u8) },
        barycentric_a: edge_weights(edge_a, along_a),
        barycentric_b: edge_weights(edge_b, along_b),
        separation: normal * (-height * inverse),
        distance: distance_squared.sqrt(),
    });
    distance_squared
}

/// Edges of `own` that pierce the face of `other`: their ends are on different sides of its plane, and its three edges
/// pass the piercing edge on the same side.
fn pierce(own: &Sides, other: &Sides, edge_of_a: bool, cases: Cases, found: &mut PairProximity) -> bool {
    let height = |corner: DVec3| other.normal.dot(corner - other.corners[0]);
    let heights = [height(own.corners[0]), height(own.corners[1]), height(own.corners[2])];
    let mut pierced = false;
    for edge in (0..3).filter(|&edge| cases.contain(Cases::piercing(edge_of_a, edge))) {
        let (from, to) = (heights[edge], heights[(edge + 1) % 3]);
        if (from > 0.0) == (to > 0.0) && (from < 0.0) == (to < 0.0) {
            continue;
        }
        let start = own.corners[edge];
        let (p, q, r) = (other.corners[0] - start, other.corners[1] - start, other.corners[2] - start);
        let volume = |from: DVec3, to: DVec3| own.edges[edge].dot(from.cross(to));
        let volumes = [volume(q, r), volume(r, p), volume(p, q)];
        let least = volumes[0].min(volumes[1]).min(volumes[2]);
        let largest = volumes[0].max(volumes[1]).max(volumes[2]);
        // All three have one sign. All zero means an edge without length, or one in line with a face without area.
        if (least < 0.0 && largest > 0.0) || least == largest && least == 0.0 {
            continue;
        }
        let along = (from / (from - to)).clamp(0.0, 1.0);
        let weights = edge_weights(edge, along);
        let Some(face_weights) = met_at(other, start + own.edges[edge] * along, own.edges[edge], volumes) else {
            continue;
        };
        pierced = true;
        let features = FeaturePair { a: Feature::Edge(edge as u8), b: Feature::Face };
        let proximity = Proximity {
            features,
            barycentric_a: weights,
            barycentric_b: face_weights,
            separation: DVec3::ZERO,
            distance: 0.0,
        };
        found.proximities.push(if edge_of_a { proximity } else { proximity.swapped() });
    }
    pierced
}

/// Weights of the point of `face` that a piercing edge meets. They come from the volumes, which are exact for slivers,
/// or, where the edge is too nearly in the plane for that, from the areas around the point. `None` if the two points do
/// not coincide.
fn met_at(face: &Sides, point_on_edge: DVec3, edge: DVec3, volumes: [f64; 3]) -> Option<[f64; 3]> {
    let size_squared = edge.length_squared() + face.edges[0].length_squared() + face.edges[1].length_squared();
    let meets = |weights: &[f64; 3]| {
        let apart = point_at(&face.corners, weights) - point_on_edge;
        apart.length_squared() <= PIERCING_TOLERANCE * PIERCING_TOLERANCE * size_squared
    };
    let weights = normalized(volumes);
    if meets(&weights) {
        return Some(weights);
    }
    let area = |k: usize| face.normal.dot(face.edges[k].cross(point_on_edge - face.corners[k])).max(0.0);
    Some(normalized([area(1), area(2), area(0)])).filter(meets)
}
