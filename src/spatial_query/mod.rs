//! Rays, closest points, overlaps, and casts of shapes on surfaces, by the trees that detection keeps.
//!
//! Queries read the results of the last detection. They transform themselves into the frame of a surface in f64, search its
//! tree, and test triangles in the kernel. A tree that no stage has needed is brought up to date by the first query.

mod cast;
mod closest;
mod filter;
mod hits;
#[cfg(feature = "picking")]
mod picking;
mod ray;
mod shape;
mod target;

use bevy_ecs::{prelude::*, system::SystemParam};

#[cfg(feature = "picking")]
pub use self::picking::SurfacePickingPlugin;
pub use self::{
    filter::SurfaceQueryFilter,
    hits::{ClosestPoint, RayHit, ShapeHit, SurfaceOverlap},
};
use crate::{detection::SurfaceStates, surface::ActiveSurfaces};

/// Queries surfaces and rigid shapes where the last detection saw them. Read it after
/// [`DeformableSystems::Detect`](crate::DeformableSystems::Detect), or at any time for the state of the last tick. Before
/// the first detection there is nothing to find.
///
/// - Surfaces need no partner and no other component. One that only queries should see has [`QueryOnly`](crate::QueryOnly).
///   What is disabled, quarantined, or without positions is not found.
/// - The nearer of several results wins. At equal distances, surfaces come before solids, in the order of
///   [`SurfaceOrder`](crate::SurfaceOrder) and registration, and lower triangles before higher ones. Results do not depend
///   on threads.
/// - Several systems may query at the same time. The first query after a surface has moved may have to refit its tree, if
///   nothing was near the surface in this tick. That takes time in proportion to its triangles.
/// - What a response or the game moves after detection is seen there by the next one.
/// - [Smooth](crate::SurfaceShape::Smooth) surfaces are seen as their patches, which the first query after they have moved
///   computes for all triangles. A ray is followed to within a millionth of a patch's height above its triangle. Closest
///   points, overlaps, and casts of shapes search a patch, and may take a place that is closest nearby for the closest:
///   a moving shape may then enter a patch by 0.004 of the size of the two.
#[derive(SystemParam)]
pub struct SurfaceQuery<'w> {
    states: Res<'w, SurfaceStates>,
    active: Res<'w, ActiveSurfaces>,
}
