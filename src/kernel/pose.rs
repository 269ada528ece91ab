//! Similarity transforms: the pose of a surface or shape in the world, or relative to another.
//!
//! A pose combines rotation, translation, and uniform scale, possibly mirrored, in f64. Relative poses are composed
//! before anything is rounded, so two neighbors far from the origin meet as precisely as near it. The bounds and
//! broad-phase stages use poses to transform a pair into one frame.

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};

/// Tolerance for a uniform scale: the largest relative difference of the three scale factors, and the largest cosine
/// between two axes. f32 rounding of a chain of parent transforms stays well below it.
const SIMILARITY_TOLERANCE: f64 = 1.0e-3;

/// A rotation, a translation, and a uniform scale. A negative determinant means that the pose is mirrored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    linear: DMat3,
    translation: DVec3,
    scale: f64,
}

/// Why a transform is not a [`Pose`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PoseError {
    /// A coefficient is NaN or infinite.
    #[error("the transform is not finite")]
    NonFinite,
    /// The scale is 0.
    #[error("the transform has a scale of zero")]
    ZeroScale,
    /// The scale differs between the axes, or the axes are not perpendicular.
    #[error(
        "the transform scales its axes differently or shears them: use a uniform scale, or bake it into the positions"
    )]
    NonUniformScale,
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The identity pose.
    pub const IDENTITY: Self = Self { linear: DMat3::IDENTITY, translation: DVec3::ZERO, scale: 1.0 };

    /// Converts an affine transform. Its coefficients are taken as exact.
    ///
    /// # Errors
    /// If the transform is not finite, or is anything but rotation, translation, uniform scale, and mirroring.
    pub fn from_affine(affine: &Affine3A) -> Result<Self, PoseError> {
        let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
        let linear = DMat3::from_cols(x.as_dvec3(), y.as_dvec3(), z.as_dvec3());
        Self::from_double_affine(&DAffine3 { matrix3: linear, translation: affine.translation.as_dvec3() })
    }

    /// Converts an affine transform that was composed in f64.
    ///
    /// # Errors
    /// The same as [`from_affine`](Self::from_affine).
    pub fn from_double_affine(affine: &DAffine3) -> Result<Self, PoseError> {
        if !affine.is_finite() {
            return Err(PoseError::NonFinite);
        }
        let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
        let lengths = [x.length(), y.length(), z.length()];
        let largest = lengths.iter().copied().fold(0.0, f64::max);
        if largest <= 0.0 {
            return Err(PoseError::ZeroScale);
        }
        let uneven = lengths.iter().any(|length| (length / largest - 1.0).abs() > SIMILARITY_TOLERANCE);
        let skewed = [x.dot(y), y.dot(z), z.dot(x)]
            .iter()
            .any(|product| product.abs() > SIMILARITY_TOLERANCE * largest * largest);
        if uneven || skewed {
            return Err(PoseError::NonUniformScale);
        }
        let linear = DMat3::from_cols(x, y, z);
        let scale = ((x.length_squared() + y.length_squared() + z.length_squared()) / 3.0).sqrt();
        Ok(Self { linear, translation: affine.translation, scale })
    }

    /// The factor by which lengths are scaled. Greater than 0.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// An upper bound of the factor by which any length is scaled: a pose that is not exactly a similarity stretches one
    /// axis more than another.
    pub(crate) fn largest_scale(&self) -> f64 {
        self.scale * (1.0 + SIMILARITY_TOLERANCE)
    }

    /// Whether the pose is mirrored, which flips outward normals inward.
    #[must_use]
    pub fn is_mirrored(&self) -> bool {
        self.linear.determinant() < 0.0
    }

    /// The pose as an affine transform.
    #[must_use]
    pub fn to_affine(&self) -> DAffine3 {
        DAffine3 { matrix3: self.linear, translation: self.translation }
    }

    /// The inverse pose.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let linear = self.linear.inverse();
        Self { linear, translation: -(linear * self.translation), scale: self.scale.recip() }
    }

    /// Composes two poses: applies `inner` first, then this pose.
    #[must_use]
    pub fn after(&self, inner: &Self) -> Self {
        Self {
            linear: self.linear * inner.linear,
            translation: self.linear * inner.translation + self.translation,
            scale: self.scale * inner.scale,
        }
    }

    /// This pose relative to `frame`. Exactly the identity if both are equal.
    #[must_use]
    pub fn relative_to(&self, frame: &Self) -> Self {
        if self == frame { Self::IDENTITY } else { frame.inverse().after(self) }
    }

    /// Whether both poses are bit-identical, signs of zeros included, so that they transform every point to the same
    /// bits.
    #[must_use]
    pub fn has_bits_of(&self, other: &Self) -> bool {
        let bits = |pose: &Self| {
            let [a, b, c, d, e, f, g, h, i] = pose.linear.to_cols_array();
            let [x, y, z] = pose.translation.to_array();
            [a, b, c, d, e, f, g, h, i, x, y, z, pose.scale].map(f64::to_bits)
        };
        bits(self) == bits(other)
    }

    /// Transforms a point.
    #[must_use]
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.linear * point + self.translation
    }

    /// Transforms a direction without scaling it.
    #[must_use]
    pub fn transform_direction(&self, direction: DVec3) -> DVec3 {
        self.linear * direction / self.scale
    }

    /// Inverts [`transform_direction`](Self::transform_direction).
    #[must_use]
    pub fn inverse_transform_direction(&self, direction: DVec3) -> DVec3 {
        self.linear.transpose() * direction / self.scale
    }

    /// Writes the transformed `positions` into `moved`, rounded once to f32.
    pub fn transform_points(&self, positions: &[Vec3], moved: &mut Vec<Vec3>) {
        moved.clear();
        moved.extend(positions.iter().map(|position| self.transform_point(position.as_dvec3()).as_vec3()));
    }
}
