//! What queries find, in world units.

use bevy_ecs::prelude::*;
use glam::Vec3;

use crate::kernel::mesh::ids::TriangleId;

/// Where a ray meets a surface or shape.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RayHit {
    /// The surface or shape.
    pub entity: Entity,
    /// The triangle, in the game's numbering. `None` for a rigid shape that is a solid.
    pub triangle: Option<TriangleId>,
    /// Weights of the triangle's corners at the point, 0 or more. They sum to 1. Zeros for a solid.
    pub barycentric: [f32; 3],
    /// From the origin of the ray, in lengths of its direction: a distance if the direction is a unit vector.
    pub distance: f32,
    /// The point, in the world.
    pub point: Vec3,
    /// World unit normal of the triangle, or of the patch at the point: its corners are counter-clockwise as seen from where it points, or clockwise if
    /// the pose is mirrored, so that it points out of a closed surface in either case. Out of the solid for a solid. If the
    /// triangle has no area, against the ray.
    pub normal: Vec3,
    /// Whether the ray comes from behind, so that the normal points along with it.
    pub is_back_face: bool,
}

/// The point of a surface or shape that is closest to another point.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ClosestPoint {
    /// The surface or shape.
    pub entity: Entity,
    /// The triangle, in the game's numbering. Of several at the same distance, the lowest. `None` for a rigid shape that is
    /// a solid.
    pub triangle: Option<TriangleId>,
    /// Weights of the triangle's corners at the point, 0 or more. They sum to 1. Zeros for a solid.
    pub barycentric: [f32; 3],
    /// Distance of the two points in world units. Negative inside a solid, or inside a surface that
    /// [has an inside](crate::Sidedness).
    pub distance: f32,
    /// The point, in the world.
    pub point: Vec3,
}

/// A triangle or a solid that overlaps a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceOverlap {
    /// The surface or shape.
    pub entity: Entity,
    /// The triangle, in the game's numbering. `None` for a rigid shape that is a solid.
    pub triangle: Option<TriangleId>,
}

/// Where a moving shape first meets a surface or shape.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ShapeHit {
    /// The surface or shape.
    pub entity: Entity,
    /// The triangle, in the game's numbering. `None` for a rigid shape that is a solid.
    pub triangle: Option<TriangleId>,
    /// How far the shape moves until then, in lengths of the direction. 0 if it overlaps at the start.
    pub distance: f32,
    /// Where they meet, in the world, on the surface or shape that is hit.
    pub point: Vec3,
    /// World unit vector there, from what is hit to the moving shape. Against the direction if they overlap at the start.
    pub normal: Vec3,
}
