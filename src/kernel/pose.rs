//! Similarity transforms: where a surface or a shape stands in the world, and relative to one another.
//!
//! Rotation, translation and uniform scale, possibly mirrored, kept in f64: relative poses are composed before
//! anything is rounded, so that two neighbors far from the origin meet as precisely as near it. Used by the bounds and
//! broad phase stages to bring a pair into one frame.

use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};

/// Largest relative difference of the three scale factors, and largest cosine between two axes, that still count as a
/// uniform scale: f32 rounding of a chain of parent transforms stays well below it.
pub(crate) const SIMILARITY_TOLERANCE: f64 = 1.0e-3;

/// A rotation, a translation and a uniform scale (negative determinant: mirrored).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    linear: DMat3,
    translation: DVec3,
    scale: f64,
}

/// Why a transform is no [`Pose`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PoseError {
    /// A coefficient is NaN or infinite.
    #[error("the transform is not finite")]
    NonFinite,
    /// The scale is 0.
    #[error("the transform has a scale of zero")]
    ZeroScale,
    /// The scale differs between the axes, or the axes are not at right angles.
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
    /// The pose that changes nothing.
    pub const IDENTITY: Self = Self { linear: DMat3::IDENTITY, translation: DVec3::ZERO, scale: 1.0 };

    /// Reads an affine transform; its coefficients are taken as exact.
    ///
    /// # Errors
    /// Where it is not finite, or is anything but rotation, translation, uniform scale and mirroring.
    pub fn from_affine(affine: &Affine3A) -> Result<Self, PoseError> {
        let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
        let linear = DMat3::from_cols(x.as_dvec3(), y.as_dvec3(), z.as_dvec3());
        Self::from_double_affine(&DAffine3 { matrix3: linear, translation: affine.translation.as_dvec3() })
    }

    /// Reads an affine transform that was composed in f64.
    ///
    /// # Errors
    /// Like [`from_affine`](Self::from_affine).
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

    /// How much longer a length becomes. More than 0.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Whether the pose turns outward normals inward.
    #[must_use]
    pub fn is_mirrored(&self) -> bool {
        self.linear.determinant() < 0.0
    }

    /// The pose as an affine transform.
    #[must_use]
    pub fn to_affine(&self) -> DAffine3 {
        DAffine3 { matrix3: self.linear, translation: self.translation }
    }

    /// The pose that undoes this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let linear = self.linear.inverse();
        Self { linear, translation: -(linear * self.translation), scale: self.scale.recip() }
    }

    /// First `inner`, then this pose.
    #[must_use]
    pub fn after(&self, inner: &Self) -> Self {
        Self {
            linear: self.linear * inner.linear,
            translation: self.linear * inner.translation + self.translation,
            scale: self.scale * inner.scale,
        }
    }

    /// This pose as seen from `frame`, exactly the identity where both are the same.
    #[must_use]
    pub fn relative_to(&self, frame: &Self) -> Self {
        if self == frame { Self::IDENTITY } else { frame.inverse().after(self) }
    }

    /// Whether both move every point to the same bits, down to the sign of a zero.
    #[must_use]
    pub fn has_bits_of(&self, other: &Self) -> bool {
        let bits = |pose: &Self| {
            let [a, b, c, d, e, f, g, h, i] = pose.linear.to_cols_array();
            let [x, y, z] = pose.translation.to_array();
            [a, b, c, d, e, f, g, h, i, x, y, z, pose.scale].map(f64::to_bits)
        };
        bits(self) == bits(other)
    }

    /// Moves a point.
    #[must_use]
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.linear * point + self.translation
    }

    /// Turns a direction, without scaling it.
    #[must_use]
    pub fn transform_direction(&self, direction: DVec3) -> DVec3 {
        self.linear * direction / self.scale
    }

    /// Turns a direction back that [`transform_direction`](Self::transform_direction) has turned.
    #[must_use]
    pub fn inverse_transform_direction(&self, direction: DVec3) -> DVec3 {
        self.linear.transpose() * direction / self.scale
    }

    /// Writes the moved `positions` into `moved`, rounded once.
    pub fn transform_points(&self, positions: &[Vec3], moved: &mut Vec<Vec3>) {
        moved.clear();
        moved.extend(positions.iter().map(|position| self.transform_point(position.as_dvec3()).as_vec3()));
    }
}
