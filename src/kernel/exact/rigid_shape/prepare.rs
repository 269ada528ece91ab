//! Reads parry's shapes: checks every number first, then asks parry for the faces of polyhedra.

use std::panic::{AssertUnwindSafe, catch_unwind};

use glam::{DQuat, DVec3, Vec3};
use parry3d::{
    math::Pose as ParryPose,
    shape::{ConvexPolyhedron, SharedShape, TypedShape},
    transformation::try_convex_hull,
};

use super::{
    ShapeError, ShapeGeometry,
    compound::{Compound, Part},
    frustum::Frustum,
    polytope::ConvexPolytope,
};

/// The limit of sizes and coordinates. Products of larger ones, as parry forms in f32, would overflow, and no game is
/// as large.
const LARGEST: f32 = 1.0e15;

impl ShapeGeometry {
    /// Prepares a shape: a ball, capsule, cuboid, convex polyhedron, cylinder, or cone, rounded or not, a triangle, a
    /// segment, a half-space, or a compound of these except half-spaces.
    ///
    /// # Errors
    /// If a size is not finite, negative, or beyond 1e15, or the kind of shape is not supported. See [`ShapeError`].
    pub fn new(shape: &SharedShape) -> Result<Self, ShapeError> {
        // A custom shape may panic, and so may parry, on points that no check foresees. Reading a shape changes nothing
        // in it, so it stays valid after a panic.
        catch_unwind(AssertUnwindSafe(|| prepare(shape))).unwrap_or(Err(ShapeError::Unsupported))
    }
}

fn prepare(shape: &SharedShape) -> Result<ShapeGeometry, ShapeError> {
    match shape.as_typed_shape() {
        TypedShape::Ball(ball) => capsule([Vec3::ZERO; 2], ball.radius),
        TypedShape::Capsule(solid) => capsule([solid.segment.a, solid.segment.b], solid.radius),
        TypedShape::Segment(segment) => capsule([segment.a, segment.b], 0.0),
        TypedShape::HalfSpace(half_space) => {
            points(&[half_space.normal])?;
            let normal = half_space.normal.as_dvec3().try_normalize().ok_or(ShapeError::NoNormal)?;
            Ok(ShapeGeometry::HalfSpace { normal })
        }
        TypedShape::Cuboid(solid) => cuboid(solid.half_extents, 0.0),
        TypedShape::RoundCuboid(solid) => cuboid(solid.inner_shape.half_extents, solid.border_radius),
        TypedShape::ConvexPolyhedron(solid) => polyhedron(solid, 0.0),
        TypedShape::RoundConvexPolyhedron(solid) => polyhedron(&solid.inner_shape, solid.border_radius),
        TypedShape::Cylinder(solid) => frustum(solid.half_height, solid.radius, 1.0, 0.0),
        TypedShape::RoundCylinder(solid) => {
            frustum(solid.inner_shape.half_height, solid.inner_shape.radius, 1.0, solid.border_radius)
        }
        TypedShape::Cone(solid) => frustum(solid.half_height, solid.radius, 0.0, 0.0),
        TypedShape::RoundCone(solid) => {
            frustum(solid.inner_shape.half_height, solid.inner_shape.radius, 0.0, solid.border_radius)
        }
        TypedShape::Triangle(flat) => triangle([flat.a, flat.b, flat.c], 0.0),
        TypedShape::RoundTriangle(flat) => {
            let inner = &flat.inner_shape;
            triangle([inner.a, inner.b, inner.c], flat.border_radius)
        }
        TypedShape::Compound(compound) => {
            let parts = compound.shapes().iter().map(|(pose, shape)| part(pose, shape)).collect::<Result<_, _>>()?;
            Compound::new(parts).map(|compound| ShapeGeometry::Compound(Box::new(compound)))
        }
        _ => Err(ShapeError::Unsupported),
    }
}

fn points(points: &[Vec3]) -> Result<(), ShapeError> {
    if !points.iter().all(|point| point.is_finite()) {
        Err(ShapeError::NonFinite)
    } else if points.iter().any(|point| point.abs().max_element() > LARGEST) {
        Err(ShapeError::TooLarge)
    } else {
        Ok(())
    }
}

fn sizes(sizes: [f32; 3]) -> Result<(), ShapeError> {
    points(&[Vec3::from(sizes)])?;
    if sizes.iter().any(|size| *size < 0.0) { Err(ShapeError::Negative) } else { Ok(()) }
}

fn capsule(ends: [Vec3; 2], radius: f32) -> Result<ShapeGeometry, ShapeError> {
    points(&ends)?;
    sizes([radius; 3])?;
    let [start, end] = ends.map(Vec3::as_dvec3);
    Ok(ShapeGeometry::Rounded { start, end, radius: f64::from(radius) })
}

fn frustum(half_height: f32, radius: f32, top: f64, border: f32) -> Result<ShapeGeometry, ShapeError> {
    sizes([half_height, radius, border])?;
    let [half_height, radius, border] = [half_height, radius, border].map(f64::from);
    Ok(ShapeGeometry::Convex(Frustum::new(half_height, radius, radius * top, border)))
}

fn cuboid(half: Vec3, border: f32) -> Result<ShapeGeometry, ShapeError> {
    sizes(half.to_array())?;
    sizes([border; 3])?;
    let (points, triangles) = parry3d::shape::Cuboid::new(half).to_trimesh();
    polytope(&points, &triangles, border)
}

fn polyhedron(solid: &ConvexPolyhedron, border: f32) -> Result<ShapeGeometry, ShapeError> {
    points(solid.points())?;
    sizes([border; 3])?;
    // Not the polyhedron's own triangles: parry joins facets that are nearly in one plane, and may cut the polygon into
    // triangles that face inward, for which every point inside is outside.
    let hull = || try_convex_hull(solid.points()).unwrap_or_else(|_| solid.to_trimesh());
    // parry panics on some points that are nearly in one plane.
    let (points, triangles) = catch_unwind(AssertUnwindSafe(hull)).map_err(|_| ShapeError::NoFaces)?;
    polytope(&points, &triangles, border)
}

fn triangle(corners: [Vec3; 3], border: f32) -> Result<ShapeGeometry, ShapeError> {
    points(&corners)?;
    sizes([border; 3])?;
    polytope(&corners, &[[0, 1, 2], [0, 2, 1]], border)
}

fn polytope(corners: &[Vec3], triangles: &[[u32; 3]], border: f32) -> Result<ShapeGeometry, ShapeError> {
    points(corners)?;
    ConvexPolytope::new(corners, triangles, f64::from(border))
        .map(|polytope| ShapeGeometry::Polytope(Box::new(polytope)))
}

fn part(pose: &ParryPose, shape: &SharedShape) -> Result<Part, ShapeError> {
    let [x, y, z, w] = [pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w].map(f64::from);
    points(&[pose.translation])?;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    let length = rotation.length();
    if !(length.is_finite() && length > 0.0) {
        return Err(ShapeError::NonFinite);
    }
    let geometry = prepare(shape)?;
    if matches!(geometry, ShapeGeometry::HalfSpace { .. } | ShapeGeometry::Compound(_)) {
        return Err(ShapeError::Part);
    }
    let translation =
        DVec3::new(f64::from(pose.translation.x), f64::from(pose.translation.y), f64::from(pose.translation.z));
    Ok(Part::new(geometry, rotation / length, translation))
}
