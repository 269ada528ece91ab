//! How much of a layer is shown.

#[cfg(any(feature = "reflect", feature = "gizmos"))]
use bevy_reflect::prelude::*;

/// How much of a layer is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(any(feature = "reflect", feature = "gizmos"), derive(Reflect), reflect(Clone, Debug, PartialEq))]
pub enum LevelOfDetail {
    /// Nothing.
    Off,
    /// Triangles that touch others, and triangles that share a vertex with them. For pairs: those of two such triangles
    /// that no slab separates.
    NearContacts,
    /// Everything.
    All,
}
