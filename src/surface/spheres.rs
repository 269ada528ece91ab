//! Sphere data per triangle, in read-only components that the sphere stages write.
//!
//! Each is empty until a pair of its surface is tested by spheres. It is emptied when the surface's own method becomes
//! more exact.

use std::ops::Deref;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::kernel::spheres::{
    circumsphere::{Ball, OffsetSpheres},
    cone::SafetyCones,
    curvature::Curvatures,
};

/// What sphere data was computed from. Data from the same source is up to date.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SphereSource {
    /// The version of the surface's positions.
    pub(crate) version: u64,
    /// The version of the settings.
    pub(crate) settings: u64,
}

/// Declares a component with read-only data.
macro_rules! sphere_data {
    ($(#[$docs:meta])* $name:ident($data:ty)) => {
        $(#[$docs])*
        #[derive(Component, Clone, Debug, Default)]
        #[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug, Default))]
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
    /// The curvature and dihedral angles of a surface's triangles, from the last tick in which the `Circumsphere`
    /// method tested a pair of the surface.
    TriangleCurvature(Curvatures)
}

sphere_data! {
    /// The enclosing ball of each triangle, or of its patch if the surface is smooth, from the last tick in which the
    /// `BoundingSphere` method tested a pair of the surface.
    EnclosingBalls(Vec<Ball>)
}

sphere_data! {
    /// The offset sphere of each triangle, from the last tick in which the `Circumsphere` method tested a pair of the
    /// surface.
    Circumspheres(OffsetSpheres)
}

sphere_data! {
    /// The safety cone of each triangle, from the last tick in which the `Circumsphere` method tested a pair of the
    /// surface.
    TriangleCones(SafetyCones)
}
