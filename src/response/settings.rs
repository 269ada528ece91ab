//! Settings of the response, with their defaults and reasons.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

/// How bodies move and how contacts are resolved. The defaults suit cloth and soft bodies of everyday size, in meters,
/// kilograms, and seconds.
///
/// Changes take effect in the next tick. A value out of range is replaced by the nearest one in range, and NaN by the
/// default.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Resource, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct XpbdSettings {
    /// Acceleration of all vertices that have mass, in world units per second squared. Default 9.81 downwards along y.
    pub gravity: Vec3,
    /// Number of substeps that a tick is split into, from 1 to 1000. Default 10. Each substep integrates and solves.
    /// Contacts are detected once per tick, or once per part of a tick that is split, and evaluated again in each
    /// substep. More substeps make materials stiffer and stacks firmer: the error falls with their square (Macklin et
    /// al. 2019, "Small Steps in Physics Simulation").
    pub substeps: u32,
    /// Passes over all constraints per substep, from 1 to 1000. Default 1: more substeps pay off better than more
    /// iterations.
    pub iterations: u32,
    /// Highest speed at which bodies that are closer than their contact distance when a tick begins are pushed apart,
    /// in contact distances per second. A body that falls onto something is stopped whatever its speed. 0 or more.
    /// Default 100: fast enough that stacks do not sink into themselves, and slow enough that an overlap at spawn is
    /// resolved over several substeps.
    pub push_out_speed: f32,
    /// Bodies sleep once they, and the bodies near them, have crept slower than this for half a second, in world units per
    /// second: no vertex has gone farther than half of it. They are then not solved until something that moves comes
    /// near, something that they touched moves or disappears, or the game changes them. 0 or more; with 0, bodies never
    /// sleep. Default 0.002: slower than a player sees. A body that nothing holds, or that touches something with a
    /// [`RigidMass`](super::RigidMass) or a [`SurfaceReaction`](super::SurfaceReaction), stays awake.
    pub sleep_speed: f32,
}

impl Default for XpbdSettings {
    fn default() -> Self {
        Self {
            gravity: Vec3::new(0.0, -9.81, 0.0),
            substeps: 10,
            iterations: 1,
            push_out_speed: 100.0,
            sleep_speed: 0.002,
        }
    }
}

/// Upper limit of substeps and of iterations.
const MOST_STEPS: u32 = 1000;

impl XpbdSettings {
    pub(super) fn in_range(&self) -> Self {
        let default = Self::default();
        Self {
            gravity: if self.gravity.is_finite() { self.gravity } else { default.gravity },
            substeps: self.substeps.clamp(1, MOST_STEPS),
            iterations: self.iterations.clamp(1, MOST_STEPS),
            push_out_speed: if self.push_out_speed.is_nan() {
                default.push_out_speed
            } else {
                self.push_out_speed.clamp(0.0, f32::MAX)
            },
            sleep_speed: if self.sleep_speed.is_nan() { default.sleep_speed } else { self.sleep_speed.max(0.0) },
        }
    }
}
