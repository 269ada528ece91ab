//! Exact proximity of a triangle and a rigid shape, both in the shape's own frame.
//!
//! A ball is a point with a radius and a capsule a segment with one, so both reduce to the exact pair test of a
//! degenerate triangle. A cuboid or convex hull is its faces, with the depth of vertices inside it from the planes. A
//! half-space is one plane. Any other shape of parry is asked through parry, in f32.

use glam::{DVec3, Vec3};
use parry3d::{
    math::Pose as ParryPose,
    query,
    shape::{ConvexPolyhedron, Cuboid, SharedShape, Triangle, TypedShape},
    transformation::try_convex_hull,
};

use super::{
    barycentric::{barycentric_of, corner_weights, point_at},
    feature::{Feature, FeaturePair},
    side::face_normal,
    triangle_pair::{PairProximity, Proximity, examine_pair},
};
use crate::kernel::{
    bounds::Aabb,
    ids::{EdgeId, VertexId},
    smooth_normal::NormalCone,
    topology::SurfaceTopology,
};

/// How far the shape may reach beyond the plane through a contact's point, square to its normal, relative to the shape's
/// size. A contact beyond is not the way out but through the shape, on its far side. Far above what f32 corners tilt the
/// narrow faces of a convex hull, far below what a far side errs by.
const SUPPORT_SLACK: f64 = 1.0e-3;

/// Why a shape cannot be tested against surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShapeError {
    /// The shape's size is NaN or infinite.
    #[error("the shape has a size that is not finite")]
    NonFinite,
    /// A radius, an extent or a border of the shape is less than 0.
    #[error("the shape has a negative size")]
    Negative,
    /// The normal of a half-space is zero.
    #[error("the half-space has no normal")]
    NoNormal,
    /// parry has no contact query between a triangle and this shape.
    #[error("there is no contact query between a triangle and this kind of shape")]
    Unsupported,
}

/// A shape prepared for exact tests.
#[derive(Clone)]
pub enum ShapeGeometry {
    /// All points within `radius` of the segment from `start` to `end`: a capsule, or a ball where both are the same.
    Rounded {
        /// One end of the segment.
        start: DVec3,
        /// The other end.
        end: DVec3,
        /// Distance from the segment to the surface.
        radius: f64,
    },
    /// All points on the other side of the plane through the origin.
    HalfSpace {
        /// Unit normal, pointing out of the solid.
        normal: DVec3,
    },
    /// A convex polyhedron.
    Polytope(Box<ConvexPolytope>),
    /// Any other shape.
    Other(SharedShape),
}

impl core::fmt::Debug for ShapeGeometry {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::Rounded { .. } => "Rounded",
            Self::HalfSpace { .. } => "HalfSpace",
            Self::Polytope(_) => "Polytope",
            Self::Other(_) => "Other",
        })
    }
}

/// A convex polyhedron as a closed triangle mesh with the planes of its faces.
#[derive(Clone)]
pub struct ConvexPolytope {
    corners: Vec<[DVec3; 3]>,
    bounds: Vec<Aabb>,
    normals: Vec<DVec3>,
    topology: SurfaceTopology,
    center: DVec3,
    size: f64,
    /// Whether it has a volume: a plate, a rod or a point has no inside.
    solid: bool,
}

/// A triangle's feature close to a shape, or inside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeProximity {
    /// Which part of the triangle.
    pub feature: Feature,
    /// Which part of the shape, by a number that is stable for the shape; 0 where it has only one part.
    pub shape_feature: u32,
    /// Whether the triangle and the surface of the shape cross here, with no vertex inside to tell how deep.
    pub crossing: bool,
    /// Weights of the triangle's corners; they sum to 1.
    pub barycentric: [f64; 3],
    /// The closest point of the shape's surface.
    pub shape_point: DVec3,
    /// Unit vector out of the shape.
    pub normal: DVec3,
    /// Distance from the shape's surface, negative inside.
    pub distance: f64,
}

impl ShapeGeometry {
    /// Prepares a shape.
    ///
    /// # Errors
    /// Where its size is not finite, or parry cannot test it against a triangle.
    pub fn new(shape: &SharedShape) -> Result<Self, ShapeError> {
        let finite = |values: &[Vec3]| {
            if values.iter().all(|value| value.is_finite()) { Ok(()) } else { Err(ShapeError::NonFinite) }
        };
        let size = |size: Vec3| {
            finite(&[size])?;
            if size.min_element() < 0.0 { Err(ShapeError::Negative) } else { Ok(()) }
        };
        if let Some(ball) = shape.as_ball() {
            size(Vec3::splat(ball.radius))?;
            return Ok(Self::Rounded { start: DVec3::ZERO, end: DVec3::ZERO, radius: f64::from(ball.radius) });
        }
        if let Some(capsule) = shape.as_capsule() {
            finite(&[capsule.segment.a, capsule.segment.b])?;
            size(Vec3::splat(capsule.radius))?;
            return Ok(Self::Rounded {
                start: capsule.segment.a.as_dvec3(),
                end: capsule.segment.b.as_dvec3(),
                radius: f64::from(capsule.radius),
            });
        }
        if let Some(half_space) = shape.as_halfspace() {
            finite(&[half_space.normal])?;
            let normal = half_space.normal.as_dvec3().try_normalize().ok_or(ShapeError::NoNormal)?;
            return Ok(Self::HalfSpace { normal });
        }
        // Not the polyhedron's own triangles: parry joins facets that are nearly in one plane and may cut the polygon
        // into triangles that face inward, for which every point inside is outside.
        let hull = |polyhedron: &ConvexPolyhedron| {
            try_convex_hull(polyhedron.points()).unwrap_or_else(|_| polyhedron.to_trimesh())
        };
        if let Some(polyhedron) = shape.as_convex_polyhedron() {
            finite(polyhedron.points())?;
        }
        if let Some(cuboid) = shape.as_cuboid() {
            size(cuboid.half_extents)?;
        }
        let mesh = shape.as_cuboid().map(Cuboid::to_trimesh).or_else(|| shape.as_convex_polyhedron().map(hull));
        if let Some((points, triangles)) = mesh {
            finite(&points)?;
            return ConvexPolytope::new(&points, &triangles).map(|polytope| Self::Polytope(Box::new(polytope)));
        }
        // parry panics over a border that is negative or not a number.
        size(Vec3::splat(border_radius(shape).unwrap_or(0.0)))?;
        let bounds = shape.compute_local_aabb();
        finite(&[bounds.mins, bounds.maxs])?;
        let probe = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
        query::contact(&ParryPose::IDENTITY, &probe, &ParryPose::IDENTITY, shape.as_ref(), 0.0)
            .map_err(|_| ShapeError::Unsupported)?;
        Ok(Self::Other(shape.clone()))
    }

    /// The box around the shape, in its own frame; `None` for a half-space, which has none.
    #[must_use]
    pub fn bounds(&self) -> Option<Aabb> {
        match self {
            Self::Rounded { start, end, radius } => {
                Some(Aabb::from_points([start.as_vec3(), end.as_vec3()]).grown(*radius as f32))
            }
            Self::HalfSpace { .. } => None,
            Self::Polytope(polytope) => {
                Some(polytope.bounds.iter().fold(Aabb::EMPTY, |whole, bounds| whole.union(bounds)))
            }
            Self::Other(shape) => {
                let bounds = shape.compute_local_aabb();
                Some(Aabb { min: bounds.mins, max: bounds.maxs })
            }
        }
    }

    /// The directions in which a contact at `shape_feature` may point out of the shape, given the one that it does: of a
    /// box, its faces' normals there. Any direction where the shape is asked through parry, which does not tell.
    #[must_use]
    pub fn normal_cone(&self, shape_feature: u32, outward: DVec3) -> NormalCone {
        match self {
            Self::Rounded { radius, .. } => NormalCone::single(outward, radius.recip()),
            Self::HalfSpace { normal } => NormalCone::single(*normal, 0.0),
            Self::Polytope(polytope) => polytope.normal_cone(shape_feature),
            Self::Other(_) => NormalCone::anything(),
        }
    }

    /// Appends the proximities of a triangle within `range` (0 or more) of the shape, or inside it, and returns the
    /// least signed distance among them, infinite where there is none. `scratch` is overwritten.
    pub fn examine(
        &self,
        triangle: &[DVec3; 3],
        range: f64,
        scratch: &mut PairProximity,
        found: &mut Vec<ShapeProximity>,
    ) -> f64 {
        let before = found.len();
        match self {
            Self::Rounded { start, end, radius } => {
                examine_rounded(triangle, [*start, *end], *radius, range, scratch, found);
            }
            Self::HalfSpace { normal } => examine_half_space(triangle, *normal, range, found),
            Self::Polytope(polytope) => polytope.examine(triangle, range, scratch, found),
            Self::Other(shape) => examine_with_parry(triangle, shape, range, found),
        }
        found[before..].iter().map(|proximity| proximity.distance).fold(f64::INFINITY, f64::min)
    }
}

fn border_radius(shape: &SharedShape) -> Option<f32> {
    match shape.as_typed_shape() {
        TypedShape::RoundCuboid(shape) => Some(shape.border_radius),
        TypedShape::RoundTriangle(shape) => Some(shape.border_radius),
        TypedShape::RoundCylinder(shape) => Some(shape.border_radius),
        TypedShape::RoundCone(shape) => Some(shape.border_radius),
        TypedShape::RoundConvexPolyhedron(shape) => Some(shape.border_radius),
        _ => None,
    }
}

/// Corners in storage precision, for boxes and for parry.
fn rounded(corners: &[DVec3; 3]) -> [Vec3; 3] {
    [corners[0].as_vec3(), corners[1].as_vec3(), corners[2].as_vec3()]
}

fn examine_rounded(
    triangle: &[DVec3; 3],
    [start, end]: [DVec3; 2],
    radius: f64,
    range: f64,
    scratch: &mut PairProximity,
    found: &mut Vec<ShapeProximity>,
) {
    examine_pair(triangle, &[start, end, end], range + radius, scratch);
    let before = found.len();
    for proximity in &scratch.proximities {
        // The segment stands for a triangle whose third corner repeats the second, a ball for one of three equal
        // corners: whatever is there twice has the same number and is taken once.
        let shape_feature = match proximity.features.b {
            _ if start == end => 0,
            Feature::Vertex(corner) => u32::from(corner.min(1)),
            _ => 2,
        };
        let feature = proximity.features.a;
        if found[before..].iter().any(|known| (known.feature, known.shape_feature) == (feature, shape_feature)) {
            continue;
        }
        let crossing = proximity.distance <= 0.0;
        let normal = if crossing {
            face_normal(triangle).try_normalize().unwrap_or(DVec3::Y)
        } else {
            proximity.separation / proximity.distance
        };
        let axis_point = point_at(&[start, end, end], &proximity.barycentric_b);
        let slack = SUPPORT_SLACK * start.distance(end);
        if !crossing && [start, end].iter().any(|point| normal.dot(*point - axis_point) > slack) {
            continue;
        }
        found.push(ShapeProximity {
            feature,
            shape_feature,
            crossing: false,
            barycentric: proximity.barycentric_a,
            shape_point: axis_point + normal * radius,
            normal,
            distance: proximity.distance - radius,
        });
    }
}

fn examine_half_space(triangle: &[DVec3; 3], normal: DVec3, range: f64, found: &mut Vec<ShapeProximity>) {
    for (vertex, &position) in triangle.iter().enumerate() {
        let distance = normal.dot(position);
        if distance <= range {
            found.push(ShapeProximity {
                feature: Feature::Vertex(vertex as u8),
                shape_feature: 0,
                crossing: false,
                barycentric: corner_weights(vertex),
                shape_point: position - normal * distance,
                normal,
                distance,
            });
        }
    }
}

fn examine_with_parry(triangle: &[DVec3; 3], shape: &SharedShape, range: f64, found: &mut Vec<ShapeProximity>) {
    let [a, b, c] = rounded(triangle);
    let parry_triangle = Triangle::new(a, b, c);
    let contact =
        query::contact(&ParryPose::IDENTITY, &parry_triangle, &ParryPose::IDENTITY, shape.as_ref(), range as f32);
    if let Ok(Some(contact)) = contact {
        found.push(ShapeProximity {
            feature: Feature::Face,
            shape_feature: 0,
            crossing: false,
            barycentric: barycentric_of(triangle, contact.point1.as_dvec3()),
            shape_point: contact.point2.as_dvec3(),
            normal: contact.normal2.as_dvec3(),
            distance: f64::from(contact.dist),
        });
    }
}

impl ConvexPolytope {
    fn new(points: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, ShapeError> {
        let topology = SurfaceTopology::new(points, triangles).map_err(|_| ShapeError::Unsupported)?;
        let corners: Vec<[DVec3; 3]> =
            triangles.iter().map(|corners| corners.map(|vertex| points[vertex as usize].as_dvec3())).collect();
        let whole = Aabb::from_points(points.iter().copied());
        let center = points.iter().map(|point| point.as_dvec3()).sum::<DVec3>() / points.len().max(1) as f64;
        let volume = corners.iter().map(|[a, b, c]| (*a - center).dot((*b - center).cross(*c - center))).sum::<f64>();
        Ok(Self {
            size: (whole.max - whole.min).as_dvec3().length(),
            solid: volume > 0.0,
            bounds: corners.iter().map(|corners| Aabb::from_points(rounded(corners))).collect(),
            normals: corners.iter().map(face_normal).collect(),
            center,
            corners,
            topology,
        })
    }

    /// The face whose plane a point is farthest outside of, and that signed distance: negative inside the polyhedron,
    /// infinite where it has no inside.
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

    fn examine(&self, triangle: &[DVec3; 3], range: f64, scratch: &mut PairProximity, found: &mut Vec<ShapeProximity>) {
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

    /// Whether the whole polyhedron lies behind the plane through `point` square to `normal`.
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
        let (normal, distance) = if pierces || proximity.distance <= 0.0 {
            (self.way_out(triangle, face, proximity.features), 0.0)
        } else {
            let direction = proximity.separation / proximity.distance;
            // The feature of a triangle may be near the surface of the polyhedron from within.
            if self.deepest_plane(point).1 < 0.0 {
                (-direction, -proximity.distance)
            } else {
                (direction, proximity.distance)
            }
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

    /// Where a crossing tells no direction: out of the face that is crossed, or of the triangle away from the center.
    fn way_out(&self, triangle: &[DVec3; 3], face: usize, features: FeaturePair) -> DVec3 {
        if features.a != Feature::Face {
            return self.normals[face];
        }
        let normal = face_normal(triangle);
        let away = triangle[0] - self.center;
        let oriented = if normal.dot(away) < 0.0 { -normal } else { normal };
        oriented.try_normalize().unwrap_or(self.normals[face])
    }

    fn normal_cone(&self, feature_number: u32) -> NormalCone {
        let (faces, edges) = (self.corners.len() as u32, self.topology.edges().len() as u32);
        let own = [feature_number];
        let around = if feature_number < faces {
            &own
        } else if feature_number < faces + edges {
            self.topology.triangles_of_edge(EdgeId(feature_number - faces))
        } else {
            self.topology.triangles_of_vertex(VertexId(feature_number - faces - edges))
        };
        NormalCone::between(around.iter().map(|face| self.normals[*face as usize]))
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
