//! Surfaces that are queried and touch nothing.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

/// While present, a surface or shape is seen by [`SurfaceQuery`](crate::SurfaceQuery) and touches nothing, not even
/// itself: for what is only aimed at or clicked on. Its [`SurfaceLayers`](crate::SurfaceLayers) still filter queries.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct QueryOnly;
