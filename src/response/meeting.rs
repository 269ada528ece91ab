//! Two triangles that would collide, as the guard hands them to the solver.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::kernel::mesh::feature::FeaturePair;

/// One side of a predicted impact.
#[derive(Clone, Copy)]
pub(super) struct MeetingSide {
    pub(super) entity: Entity,
    /// How far the surface or shape extends beyond each corner.
    pub(super) thickness: [f64; 3],
    pub(super) corners: MeetingCorners,
}

/// The corners of a triangle in a predicted impact.
#[derive(Clone, Copy)]
pub(super) enum MeetingCorners {
    /// Particles of a body.
    Body([u32; 3]),
    /// Points that move from `starts` to `ends`, whatever pushes them. For a surface, `vertices` holds their vertex
    /// numbers and the surface's number of vertices.
    Driven { starts: [DVec3; 3], ends: [DVec3; 3], vertices: Option<([u32; 3], usize)> },
}

/// Two triangles that would collide along their trajectories.
pub(super) struct MeetingTriangles {
    pub(super) sides: [MeetingSide; 2],
    pub(super) features: FeaturePair,
    pub(super) barycentrics: [[f64; 3]; 2],
    /// From the second triangle to the first, in world space.
    pub(super) normal: DVec3,
}
