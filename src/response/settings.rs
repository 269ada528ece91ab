//! Settings of the response, with their defaults and reasons.

use bevy_ecs::prelude::*;
use glam::Vec3;

/// How bodies are moved and contacts answered. The defaults suit cloth and soft bodies of everyday size, in meters,
/// kilograms and seconds.
///
/// Changes take effect in the next tick; a value out of range is replaced by the nearest one in range.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct XpbdSettings {
    /// Acceleration of everything that has mass, in world units per second squared. Default 9.81 downwards along y.
    pub gravity: Vec3,
    /// Into how many steps a tick is cut, 1 or more. Default 10. Every step integrates and solves; contacts are detected
    /// once a tick and evaluated anew in every step. More steps make materials stiffer and stacks firmer: the error falls
    /// with their square (Macklin et al. 2019, "Small Steps in Physics Simulation").
    pub substeps: u32,
    /// How often a step goes over all constraints, 1 or more. Default 1: more substeps pay more.
    pub iterations: u32,
    /// The fastest that bodies are pushed apart which are nearer than their contact distance when a tick begins, in contact
    /// distances per second; what falls onto something is stopped whatever its speed. 0 or more. Default 100: fast enough that
    /// stacks do not sink into themselves, and slow enough that an overlap at spawn is undone over some substeps.
    pub push_out_speed: f32,
}

impl Default for XpbdSettings {
    fn default() -> Self {
        Self { gravity: Vec3::new(0.0, -9.81, 0.0), substeps: 10, iterations: 1, push_out_speed: 100.0 }
    }
}

/// Most substeps and most iterations that are carried out.
const MOST_STEPS: u32 = 1000;

impl XpbdSettings {
    /// The settings with every value in range.
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
        }
    }
}
