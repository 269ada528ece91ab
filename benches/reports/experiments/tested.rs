//! What the experiments compare.

use bevy_circumsphere::{ContactMethod, SurfaceShape};

/// A contact method, and for `Circumsphere` which spheres it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tested {
    /// Enclosing balls.
    BoundingSphere,
    /// The spheres of the source paper, on flat surfaces.
    Circumsphere,
    /// The spheres that osculate smooth surfaces.
    Osculating,
    /// Flat triangles.
    Exact,
    /// Flat triangles, the slow way.
    Polygon,
}

impl Tested {
    pub const ALL: [Self; 5] = [Self::BoundingSphere, Self::Circumsphere, Self::Osculating, Self::Exact, Self::Polygon];

    pub const fn method(self) -> ContactMethod {
        match self {
            Self::BoundingSphere => ContactMethod::BoundingSphere,
            Self::Circumsphere | Self::Osculating => ContactMethod::Circumsphere,
            Self::Exact => ContactMethod::Exact,
            Self::Polygon => ContactMethod::Polygon,
        }
    }

    /// The shape of every surface.
    pub const fn shape(self) -> SurfaceShape {
        match self {
            Self::Osculating => SurfaceShape::Smooth,
            Self::BoundingSphere | Self::Circumsphere | Self::Exact | Self::Polygon => SurfaceShape::Flat,
        }
    }
}
