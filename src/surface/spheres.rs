//! Per-triangle sphere data: components that the sphere stages write, for everybody to read.
//!
//! Each is empty until a pair of its surface is tested by spheres, and again once the surface's own method is more exact.

use std::ops::Deref;

use bevy_ecs::prelude::*;

use crate::kernel::spheres::{
    circumsphere::{Ball, OffsetSpheres},
    cone::SafetyCones,
    curvature::Curvatures,
};

/// What sphere data was computed from. Data with the same source need not be computed again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SphereSource {
    /// The version of the surface's positions.
    pub(crate) version: u64,
    /// Which settings it was computed with, counted by the sphere stages.
    pub(crate) settings: u64,
}

/// Declares a component that hands out its data read-only.
macro_rules! sphere_data {
    ($(#[$docs:meta])* $name:ident($data:ty)) => {
        $(#[$docs])*
        #[derive(Component, Clone, Debug, Default)]
        pub struct $name {
            pub(crate) data: $data,
            pub(crate) source: Option<SphereSource>,
        }

        impl Deref for $name {
            type Target = $data;

            fn deref(&self) -> &$data {
                &self.data
            }
        }
    };
}

sphere_data! {
    /// Curvature and dihedral angles of a surface's triangles, from the last tick in which the `Circumsphere` method tested a pair
    /// of it.
    TriangleCurvature(Curvatures)
}

sphere_data! {
    /// The smallest ball around each triangle, from the last tick in which the `BoundingSphere` method tested a pair of the surface.
    EnclosingBalls(Vec<Ball>)
}

sphere_data! {
    /// The offset sphere of each triangle, from the last tick in which the `Circumsphere` method tested a pair of the surface.
    Circumspheres(OffsetSpheres)
}

sphere_data! {
    /// The safety cone of each triangle, from the last tick in which the `Circumsphere` method tested a pair of the surface.
    TriangleCones(SafetyCones)
}
