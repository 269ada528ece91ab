//! What counts as a thin wall.

use bevy_math::ops;

/// What counts as a thin wall.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct ThinWallSettings {
    /// The largest angle between one side and the reverse of the other, in radians. Default: 30°. Clamped to 0 to 60°.
    pub opposed_angle: f32,
    /// Faces that meet at a larger angle are of different walls, in radians. Default: 35°. Clamped to 0 to 90°.
    pub crease_angle: f32,
    /// How many times as wide as thick a wall must be. Default: 4. At least 1.
    pub least_extent: f32,
    /// The same for walls that are attached to others. Default: 2. At least 1.
    pub least_rib_extent: f32,
}

impl Default for ThinWallSettings {
    fn default() -> Self {
        Self {
            opposed_angle: 30_f32.to_radians(),
            crease_angle: 35_f32.to_radians(),
            least_extent: 4.0,
            least_rib_extent: 2.0,
        }
    }
}

impl ThinWallSettings {
    pub(super) fn opposed_cosine(&self) -> f64 {
        f64::from(ops::cos(self.opposed_angle.clamp(0.0, 60_f32.to_radians())))
    }

    pub(super) fn crease_cosine(&self) -> f64 {
        f64::from(ops::cos(self.crease_angle.clamp(0.0, 90_f32.to_radians())))
    }
}
