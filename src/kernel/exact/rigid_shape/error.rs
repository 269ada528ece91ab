//! Why a shape is rejected.

/// Why a shape cannot be tested against surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShapeError {
    /// A size, a point, or the pose of a part is NaN or infinite.
    #[error("the shape has a size that is not finite")]
    NonFinite,
    /// A radius, an extent, or a border of the shape is negative.
    #[error("the shape has a negative size")]
    Negative,
    /// A size or a coordinate is larger than 1e15.
    #[error("the shape has a size or a coordinate beyond 1e15: use larger units, or cut the shape into smaller ones")]
    TooLarge,
    /// The normal of a half-space is zero.
    #[error("the half-space has no normal")]
    NoNormal,
    /// A compound has no part, contains a half-space or another compound, or has too many features to number.
    #[error(
        "a compound is made of one or more solid convex shapes, with fewer than 2^28 faces, edges and vertices: give other \
         shapes their own `RigidShape`"
    )]
    Part,
    /// parry could not find the faces of a convex polyhedron.
    #[error("the faces of the convex polyhedron cannot be found: build it from points that are farther apart")]
    NoFaces,
    /// The kind of shape is not supported.
    #[error("there is no contact query between a triangle and this kind of shape")]
    Unsupported,
}
