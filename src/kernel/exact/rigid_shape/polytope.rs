//! Contacts of a triangle with a cuboid or a convex hull, rounded or not.
//!
//! The pair test of two triangles finds what is close to each face. Vertices inside are as deep as the nearest plane. A
//! border reduces every distance, inside a convex solid as well as outside.

use glam::{DVec3, Vec3};

use super::{SUPPORT_SLACK, ShapeError, ShapeFoot, ShapeProximity, rounded};
use crate::kernel::{
    exact::triangle_pair::{PairProximity, Proximity, examine_pair},
    mesh::{
        barycentric::{corner_weights, point_at},
        bounds::Aabb,
        feature::{Feature, FeaturePair},
        ids::{EdgeId, VertexId},
        side::{closest_feature, face_normal},
        smooth_normal::NormalCone,
        topology::SurfaceTopology,
    },
};

/// Limit for twice a face's area, relative to the square of the polyhedron's size. Below it, rounding of the f32
/// corners may tilt the face by more than [`SUPPORT_SLACK`]: a height of 1e-3 over the whole length, with some reserve.
const SLIVER: f64 = 1.0e-3;

/// A convex polyhedron as a closed triangle mesh with the planes of its faces, and a border around it, or a shape of
/// several triangles without an inside.
#[derive(Clone)]
pub struct ConvexPolytope {
    corners: Vec<[DVec3; 3]>,
    bounds: Vec<Aabb>,
    /// Unit normals. Zero if a face has no reliable plane.
    normals: Vec<DVec3>,
    /// Unit vectors out of the polyhedron at each face, including those without a plane.
    ways_out: Vec<DVec3>,
    topology: SurfaceTopology,
    center: DVec3,
    size: f64,
    /// All points within this distance belong to the shape.
    border: f64,
    /// Whether it has a volume. A plate, a rod, or a point has no inside.
    solid: bool,
}

impl ConvexPolytope {
    pub(super) fn new(points: &[Vec3], triangles: &[[u32; 3]], border: f64) -> Result<Self, ShapeError> {
        let topology = SurfaceTopology::new(points, triangles).map_err(|_| ShapeError::Unsupported)?;
        let corners: Vec<[DVec3; 3]> =
            triangles.iter().map(|corners| corners.map(|vertex| points[vertex as usize].as_dvec3())).collect();
        let whole = Aabb::from_points(points.iter().copied());
        let center = points.iter().map(|point| point.as_dvec3()).sum::<DVec3>() / points.len().max(1) as f64;
        let volume = corners.iter().map(|[a, b, c]| (*a - center).dot((*b - center).cross(*c - center))).sum::<f64>();
        let size = (whole.max.as_dvec3() - whole.min.as_dvec3()).length();
        let solid = volume > 0.0;
        let normals: Vec<DVec3> = corners.iter().map(|corners| plane_normal(corners, points, size, solid)).collect();
        let mut polytope = Self {
            size,
            border,
            solid,
            bounds: corners.iter().map(|corners| Aabb::from_points(rounded(corners))).collect(),
            normals,
            ways_out: Vec::new(),
            center,
            corners,
            topology,
        };
        polytope.ways_out = (0..polytope.corners.len()).map(|face| polytope.way_out_of_face(face)).collect();
        Ok(polytope)
    }

    /// The normal of a face. For a face without a plane, that of a neighbor, otherwise away from the center, otherwise
    /// upward.
    fn way_out_of_face(&self, face: usize) -> DVec3 {
        let edges = self.topology.triangle_edges()[face];
        let around = edges.iter().flat_map(|edge| self.topology.triangles_of_edge(EdgeId(*edge)));
        let with_plane = core::iter::once(face as u32)
            .chain(around.copied())
            .map(|neighbor| self.normals[neighbor as usize])
            .find(|normal| *normal != DVec3::ZERO);
        let middle = self.corners[face].iter().sum::<DVec3>() / 3.0;
        with_plane.or_else(|| (middle - self.center).try_normalize()).unwrap_or(DVec3::Y)
    }

    /// The box around it, including its border.
    pub(super) fn bounds(&self) -> Aabb {
        let core = self.bounds.iter().fold(Aabb::EMPTY, |whole, bounds| whole.union(bounds));
        if self.border > 0.0 { core.grown(self.border as f32) } else { core }
    }

    pub(super) const fn topology(&self) -> &SurfaceTopology {
        &self.topology
    }

    pub(super) const fn border(&self) -> f64 {
        self.border
    }

    /// The number of faces, edges, and vertices together.
    pub(super) fn feature_count(&self) -> usize {
        self.corners.len() + self.topology.edges().len() + self.topology.vertex_count()
    }

    /// The corners of each face.
    pub(super) fn faces(&self) -> &[[DVec3; 3]] {
        &self.corners
    }

    /// The planes of its faces, moved outward by the border: unit normals, and heights along them. None if it has no
    /// inside.
    pub(super) fn planes(&self) -> impl Iterator<Item = (DVec3, f64)> {
        let faces = self.normals.iter().zip(&self.corners).filter(|(normal, _)| self.solid && **normal != DVec3::ZERO);
        faces.map(|(normal, corners)| (*normal, normal.dot(corners[0]) + self.border))
    }

    /// The place on the surface that is closest to a point.
    pub(super) fn foot(&self, point: DVec3) -> ShapeFoot {
        let (face, depth) = self.deepest_plane(point);
        if depth <= 0.0 {
            let number = self.feature_number(face, Feature::Face);
            return ShapeFoot::flat(depth, self.normals[face], number).bordered(self.border);
        }
        let Some((face, feature, place, distance)) = self.closest(point) else {
            return ShapeFoot::flat(f64::INFINITY, DVec3::Y, 0);
        };
        let normal = (point - place).try_normalize().unwrap_or(self.ways_out[face]);
        let number = self.feature_number(face, feature);
        let corners = &self.corners[face];
        let foot = match feature {
            Feature::Face => ShapeFoot::flat(distance, normal, number),
            Feature::Edge(edge) => {
                let along = corners[(usize::from(edge) + 1) % 3] - corners[usize::from(edge)];
                ShapeFoot::around_edge(distance, normal, along, number)
            }
            Feature::Vertex(_) => ShapeFoot::around_point(distance, normal, number),
        };
        foot.bordered(self.border)
    }

    /// The face that is closest to a point, its feature and place, and the distance.
    fn closest(&self, point: DVec3) -> Option<(usize, Feature, DVec3, f64)> {
        let places = self.corners.iter().enumerate().map(|(face, corners)| {
            let (feature, place) = closest_feature(corners, point);
            (face, feature, place, place.distance(point))
        });
        places.min_by(|one, other| one.3.total_cmp(&other.3))
    }

    /// The face whose plane a point is farthest outside of, and that signed distance: negative inside the polyhedron,
    /// infinite if it has no inside.
    fn deepest_plane(&self, point: DVec3) -> (usize, f64) {
        if !self.solid {
            return (0, f64::INFINITY);
        }
        let mut deepest = (0, f64::NEG_INFINITY);
        for (face, normal) in self.normals.iter().enumerate() {
            let distance = normal.dot(point - self.corners[face][0]);
            // A face without area has no plane.
            if *normal != DVec3::ZERO && distance > deepest.1 {
                deepest = (face, distance);
            }
        }
        deepest
    }

    pub(super) fn examine(
        &self,
        triangle: &[DVec3; 3],
        range: f64,
        scratch: &mut PairProximity,
        found: &mut Vec<ShapeProximity>,
    ) {
        let before = found.len();
        self.examine_core(triangle, range + self.border, scratch, found);
        if self.border > 0.0 {
            self.add_vertices_in_border(triangle, found, before);
            for proximity in &mut found[before..] {
                proximity.shape_point += proximity.normal * self.border;
                proximity.distance -= self.border;
                // The border gives the depth.
                proximity.crossing = false;
            }
        }
    }

    /// Adds vertices inside the border, over an edge or a corner, that are not the closest of the triangle. They have a
    /// depth too.
    fn add_vertices_in_border(&self, triangle: &[DVec3; 3], found: &mut Vec<ShapeProximity>, before: usize) {
        for (vertex, &position) in triangle.iter().enumerate() {
            let named = Feature::Vertex(vertex as u8);
            if found[before..].iter().any(|proximity| proximity.feature == named) {
                continue;
            }
            let Some((face, feature, place, distance)) = self.closest(position) else { continue };
            if distance <= self.border {
                found.push(ShapeProximity {
                    feature: named,
                    shape_feature: self.feature_number(face, feature),
                    crossing: false,
                    barycentric: corner_weights(vertex),
                    shape_point: place,
                    normal: (position - place).try_normalize().unwrap_or(self.ways_out[face]),
                    distance,
                });
            }
        }
    }

    /// Whether a feature number is that of a face.
    pub(super) fn is_face(&self, feature_number: u32) -> bool {
        (feature_number as usize) < self.corners.len()
    }

    fn examine_core(
        &self,
        triangle: &[DVec3; 3],
        range: f64,
        scratch: &mut PairProximity,
        found: &mut Vec<ShapeProximity>,
    ) {
        let depths = triangle.map(|corner| self.deepest_plane(corner));
        for (vertex, &(face, distance)) in depths.iter().enumerate() {
            if distance <= 0.0 {
                found.push(ShapeProximity {
                    feature: Feature::Vertex(vertex as u8),
                    shape_feature: self.feature_number(face, Feature::Face),
                    crossing: false,
                    barycentric: corner_weights(vertex),
                    shape_point: triangle[vertex] - self.normals[face] * distance,
                    normal: self.normals[face],
                    distance,
                });
            }
        }
        let reach = Aabb::from_points(rounded(triangle)).grown(range as f32);
        for (face, corners) in self.corners.iter().enumerate() {
            if !reach.overlaps(&self.bounds[face]) {
                continue;
            }
            examine_pair(triangle, corners, range, scratch);
            for proximity in &scratch.proximities {
                let inside =
                    matches!(proximity.features.a, Feature::Vertex(vertex) if depths[vertex as usize].1 <= 0.0);
                if !inside {
                    let proximity = self.face_proximity(triangle, face, proximity);
                    if proximity.distance == 0.0 || self.supports(proximity.shape_point, proximity.normal) {
                        found.push(proximity);
                    }
                }
            }
        }
    }

    /// Whether the whole polyhedron is behind the plane through `point` that is perpendicular to `normal`.
    fn supports(&self, point: DVec3, normal: DVec3) -> bool {
        let slack = SUPPORT_SLACK * self.size;
        self.corners.iter().flatten().all(|corner| normal.dot(*corner - point) <= slack)
    }

    fn face_proximity(&self, triangle: &[DVec3; 3], face: usize, proximity: &Proximity) -> ShapeProximity {
        let point = point_at(triangle, &proximity.barycentric_a);
        let shape_point = point_at(&self.corners[face], &proximity.barycentric_b);
        let pierces = matches!(
            proximity.features,
            FeaturePair { a: Feature::Edge(_), b: Feature::Face }
                | FeaturePair { a: Feature::Face, b: Feature::Edge(_) }
        );
        // A separation that is too short to have a direction counts as none.
        let direction = if pierces || proximity.distance <= 0.0 { None } else { proximity.separation.try_normalize() };
        let (normal, distance) = if let Some(direction) = direction {
            // The triangle's feature may be near the surface of the polyhedron from inside.
            if self.deepest_plane(point).1 < 0.0 {
                (-direction, -proximity.distance)
            } else {
                (direction, proximity.distance)
            }
        } else {
            (self.way_out(triangle, face, proximity.features), 0.0)
        };
        ShapeProximity {
            feature: proximity.features.a,
            shape_feature: self.feature_number(face, proximity.features.b),
            crossing: pierces,
            barycentric: proximity.barycentric_a,
            shape_point,
            normal,
            distance,
        }
    }

    /// The normal where a crossing has no direction: out of the crossed face, or that of the triangle, away from the
    /// center.
    fn way_out(&self, triangle: &[DVec3; 3], face: usize, features: FeaturePair) -> DVec3 {
        if features.a != Feature::Face {
            return self.ways_out[face];
        }
        let normal = face_normal(triangle);
        let away = triangle[0] - self.center;
        let oriented = if normal.dot(away) < 0.0 { -normal } else { normal };
        let out = oriented.try_normalize().unwrap_or(self.ways_out[face]);
        if self.border == 0.0 {
            return out;
        }
        // A rounded edge has only the directions between those of its faces.
        let around = NormalCone::between(self.faces_around(self.feature_number(face, features.b)));
        around.nearest(out).try_normalize().unwrap_or(self.ways_out[face])
    }

    pub(super) fn normal_cone(&self, feature_number: u32, outward: DVec3) -> NormalCone {
        if self.border > 0.0 && !self.is_face(feature_number) {
            return NormalCone::single(outward, self.border.recip());
        }
        NormalCone::between(self.faces_around(feature_number))
    }

    /// The normals of the faces that meet at a feature.
    fn faces_around(&self, feature_number: u32) -> impl Iterator<Item = DVec3> {
        let (faces, edges) = (self.corners.len() as u32, self.topology.edges().len() as u32);
        let (own, around) = if feature_number < faces {
            (Some(feature_number), &[][..])
        } else if feature_number < faces + edges {
            (None, self.topology.triangles_of_edge(EdgeId(feature_number - faces)))
        } else {
            (None, self.topology.triangles_of_vertex(VertexId(feature_number - faces - edges)))
        };
        own.into_iter().chain(around.iter().copied()).map(|face| self.normals[face as usize])
    }

    /// Faces come first, then edges, then vertices.
    fn feature_number(&self, face: usize, feature: Feature) -> u32 {
        let (faces, edges) = (self.corners.len() as u32, self.topology.edges().len() as u32);
        match feature {
            Feature::Face => face as u32,
            Feature::Edge(edge) => faces + self.topology.triangle_edges()[face][edge as usize],
            Feature::Vertex(corner) => faces + edges + self.topology.welded_triangles()[face][corner as usize],
        }
    }
}

/// Unit normal of a face. Zero if it has no area, or is a sliver so narrow that its plane cuts off other corners.
fn plane_normal(corners: &[DVec3; 3], points: &[Vec3], size: f64, solid: bool) -> DVec3 {
    let normal = face_normal(corners);
    let twice_area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
    let is_sliver = solid && twice_area < SLIVER * size * size;
    let cuts = |point: &Vec3| normal.dot(point.as_dvec3() - corners[0]) > SUPPORT_SLACK * size;
    if is_sliver && points.iter().any(cuts) { DVec3::ZERO } else { normal }
}
