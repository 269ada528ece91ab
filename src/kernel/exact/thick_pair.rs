//! The proximity of two triangles whose thickness differs from corner to corner.
//!
//! What counts is the *reach* of two points: their distance, and by how much both thicknesses there are less than the
//! largest. Thickness is linear in a triangle, so the reach is a convex function of both points, and the triangles touch if
//! its minimum is at most the contact distance. Like a minimum of the distance, it lies between a vertex and the inside of a
//! face, between the insides of two edges, or between a vertex and an edge. Each of these has a closed form. On a plane with
//! the slope g, the point that is nearest to a vertex at the height h is not the foot of the perpendicular, but
//! g h / √(1 − g²) beside it, towards where the triangle is thicker. Where the thickness does not change along a feature,
//! everything is as in `triangle_pair`.

use glam::{DVec2, DVec3};

use super::{
    tolerances::{AT_END, PARALLEL_SINE, TIE},
    triangle_pair::{PairProximity, Proximity, examine_pair},
};
use crate::kernel::mesh::{
    barycentric::{corner_weights, edge_weights, normalized, point_at},
    feature::{Feature, FeatureKind, FeaturePair},
    thickness::lack_at,
};

/// Distances that exceed the range by less than this share may do so by rounding.
const SLACK: f64 = 1.0e-9;

/// One triangle, with what lacks at its corners, in the unit of the pair's frame.
#[derive(Clone, Copy)]
struct Thick {
    corners: [DVec3; 3],
    lacks: [f64; 3],
}

impl Thick {
    fn edge(&self, edge: usize) -> DVec3 {
        self.corners[(edge + 1) % 3] - self.corners[edge]
    }

    /// By how much what lacks grows along an edge.
    fn growth(&self, edge: usize) -> f64 {
        self.lacks[(edge + 1) % 3] - self.lacks[edge]
    }

    fn is_even(&self) -> bool {
        self.lacks[0] == self.lacks[1] && self.lacks[0] == self.lacks[2]
    }
}

/// What is known about two triangles of different thickness.
#[derive(Default)]
pub(super) struct ThickProximity {
    /// Where the reach is least between two features, and where an edge pierces a face. `distance` is that of the
    /// triangles.
    pub(super) pair: PairProximity,
    /// The reach of each proximity.
    pub(super) reaches: Vec<f64>,
    /// The least reach, 0 if the triangles cross.
    pub(super) least: f64,
}

impl ThickProximity {
    /// Examines two triangles: the least reach, and all features whose reach is at most `range` or more by rounding.
    pub(super) fn examine(&mut self, corners: &[[DVec3; 3]; 2], lacks: [[f64; 3]; 2], range: f64) {
        let least_lack = |lacks: [f64; 3]| lacks.into_iter().fold(f64::INFINITY, f64::min);
        // The reach is at least the distance and what lacks everywhere.
        let near = (range - least_lack(lacks[0]) - least_lack(lacks[1])).max(0.0);
        examine_pair(&corners[0], &corners[1], near, &mut self.pair);
        let origin = corners[0][0];
        let side = |side: usize| Thick { corners: corners[side].map(|corner| corner - origin), lacks: lacks[side] };
        let (a, b) = (side(0), side(1));
        self.reaches.clear();
        if self.pair.distance > near * (1.0 + SLACK) && self.pair.proximities.is_empty() {
            self.least = f64::INFINITY;
            return;
        }
        if a.is_even() && b.is_even() {
            let lack = a.lacks[0] + b.lacks[0];
            let reach = |proximity: &Proximity| match proximity.features.kind() {
                FeatureKind::EdgeFace => 0.0,
                _ => proximity.distance + lack,
            };
            self.reaches.extend(self.pair.proximities.iter().map(reach));
            self.least = if self.pair.distance == 0.0 { 0.0 } else { self.pair.distance + lack };
            return;
        }
        let crosses = self.pair.proximities.iter().any(|found| found.features.kind() == FeatureKind::EdgeFace);
        self.pair.proximities.retain(|found| found.features.kind() == FeatureKind::EdgeFace);
        self.reaches.resize(self.pair.proximities.len(), 0.0);
        let mut least = f64::INFINITY;
        for corner in 0..3 {
            for (own, other, own_is_a) in [(&a, &b, true), (&b, &a, false)] {
                least = least.min(self.add(vertex_face(own, other, corner), own_is_a, range));
            }
        }
        for edges in 0..9 {
            least = least.min(self.add(edge_edge(&a, &b, edges / 3, edges % 3), true, range));
        }
        let mut boundary = f64::INFINITY;
        for (own, other) in [(&a, &b), (&b, &a)] {
            for place in 0..9 {
                boundary = boundary.min(vertex_edge(own, other, place / 3, place % 3).reach);
            }
        }
        if !crosses && boundary <= least {
            let most = (boundary * (1.0 + TIE)).min(range);
            for (own, other, own_is_a) in [(&a, &b, true), (&b, &a, false)] {
                for place in 0..9 {
                    let found = vertex_edge(own, other, place / 3, place % 3);
                    // The end of an edge is the start of the next one. Two vertices are reported from the first triangle
                    // only.
                    let is_reported = match found.features.b {
                        Feature::Vertex(corner) => own_is_a && usize::from(corner) == place % 3,
                        _ => true,
                    };
                    if is_reported {
                        self.add(Some(found), own_is_a, most);
                    }
                }
            }
        }
        self.least = if crosses || self.pair.distance == 0.0 { 0.0 } else { least.min(boundary) };
    }

    /// Adds a proximity if it is within a reach. Returns its reach.
    fn add(&mut self, found: Option<Found>, own_is_a: bool, most: f64) -> f64 {
        let Some(Found { features, weights, separation, reach }) = found else { return f64::INFINITY };
        if reach <= most {
            let [barycentric_a, barycentric_b] = weights;
            let distance = separation.length();
            let found = Proximity { features, barycentric_a, barycentric_b, separation, distance };
            self.pair.proximities.push(if own_is_a { found } else { found.swapped() });
            self.reaches.push(reach);
        }
        reach
    }
}

/// Two features at the points where their reach is least.
struct Found {
    features: FeaturePair,
    weights: [[f64; 3]; 2],
    /// From the point on the second triangle to the point on the first.
    separation: DVec3,
    reach: f64,
}

impl Found {
    fn new(a: &Thick, b: &Thick, features: FeaturePair, weights: [[f64; 3]; 2]) -> Self {
        let separation = point_at(&a.corners, &weights[0]) - point_at(&b.corners, &weights[1]);
        let reach = separation.length() + lack_at(&a.lacks, &weights[0]) + lack_at(&b.lacks, &weights[1]);
        Self { features, weights, separation, reach }
    }
}

/// How far beside the closest point the reach is least, for a slope and a height: the slope's share of this. `None` if the
/// slope is so steep that the reach is least at the border.
fn beside(slope_squared: f64, height: f64) -> Option<f64> {
    (slope_squared < 1.0).then(|| height / (1.0 - slope_squared).sqrt())
}

/// A vertex of `own` over the inside of the face of `other`.
fn vertex_face(own: &Thick, other: &Thick, vertex: usize) -> Option<Found> {
    let [u, w] = [other.edge(0), -other.edge(2)];
    let normal = u.cross(w);
    let squared = normal.length_squared();
    let from_corner = own.corners[vertex] - other.corners[0];
    let height = normal.dot(from_corner);
    let gradient = (w.cross(normal) * other.growth(0) - normal.cross(u) * other.growth(2)) / squared;
    let beside = beside(gradient.length_squared(), height.abs() / squared.sqrt())?;
    let point = own.corners[vertex] - normal * (height / squared) - gradient * beside;
    let area = |edge: usize| normal.cross(other.edge(edge)).dot(point - other.corners[edge]);
    let areas = [area(1), area(2), area(0)];
    // Also if the face has no area.
    if !areas.iter().all(|&area| area > 0.0) {
        return None;
    }
    let features = FeaturePair { a: Feature::Vertex(vertex as u8), b: Feature::Face };
    Some(Found::new(own, other, features, [corner_weights(vertex), normalized(areas)]))
}

/// The insides of two edges. The squared distance is a quadratic form of the places along both edges, and the slope is
/// measured by its inverse.
fn edge_edge(a: &Thick, b: &Thick, edge_a: usize, edge_b: usize) -> Option<Found> {
    let (u, v) = (a.edge(edge_a), b.edge(edge_b));
    let normal = u.cross(v);
    let squared = normal.length_squared();
    let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
    if squared <= PARALLEL_SINE * PARALLEL_SINE * uu * vv {
        return None;
    }
    let between = b.corners[edge_b] - a.corners[edge_a];
    let height = normal.dot(between).abs() / squared.sqrt();
    let closest = DVec2::new(between.cross(v).dot(normal), between.cross(u).dot(normal)) / squared;
    let growth = DVec2::new(a.growth(edge_a), b.growth(edge_b));
    let slope = DVec2::new(vv * growth.x + uv * growth.y, uv * growth.x + uu * growth.y) / squared;
    let along = closest - slope * beside(growth.dot(slope), height)?;
    let is_inside = along.min_element() > 0.0 && along.max_element() < 1.0;
    let features = FeaturePair { a: Feature::Edge(edge_a as u8), b: Feature::Edge(edge_b as u8) };
    is_inside.then(|| Found::new(a, b, features, [edge_weights(edge_a, along.x), edge_weights(edge_b, along.y)]))
}

/// A vertex of `own` and an edge of `other`, ends included.
fn vertex_edge(own: &Thick, other: &Thick, vertex: usize, edge: usize) -> Found {
    let (along, squared) = (other.edge(edge), other.edge(edge).length_squared());
    let from_start = own.corners[vertex] - other.corners[edge];
    let growth = other.growth(edge);
    let foot = if squared > 0.0 { from_start.dot(along) / squared } else { 0.0 };
    let height = (from_start - along * foot).length();
    let place = match beside(growth * growth / squared, height) {
        Some(beside) => foot - growth / squared * beside,
        None if growth < 0.0 => 1.0,
        // Also if the edge has no length.
        None => 0.0,
    };
    let (start, end) = (edge, (edge + 1) % 3);
    let (feature, weights) = if place <= AT_END {
        (Feature::Vertex(start as u8), corner_weights(start))
    } else if place >= 1.0 - AT_END {
        (Feature::Vertex(end as u8), corner_weights(end))
    } else {
        (Feature::Edge(edge as u8), edge_weights(edge, place))
    };
    let features = FeaturePair { a: Feature::Vertex(vertex as u8), b: feature };
    Found::new(own, other, features, [corner_weights(vertex), weights])
}
