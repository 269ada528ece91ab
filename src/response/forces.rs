//! What else acts on a body, besides gravity and contacts: wind, and forces of the game.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use super::body::XpbdBody;
use crate::kernel::{mesh::ids::VertexId, xpbd::Air};

/// The wind that a body is in: drag and lift on every triangle, by its motion relative to the wind. For gusts, change it
/// from tick to tick. It acts from both sides, so it suits sheets.
///
/// The body's [`drag`](super::XpbdMaterial::drag) slows it down as well, relative to the ground: set that to 0 if wind is
/// to carry the body along. A value that is not finite, and a negative density, count as 0.
///
/// ```
/// # use bevy_circumsphere::{prelude::*, response::*};
/// # use glam::Vec3;
/// # let mut world = bevy_ecs::world::World::new();
/// # let corners = [Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::X + Vec3::Z];
/// # let (surface, positions) = DeformableSurface::from_mesh(&corners, &[[0, 2, 1], [1, 2, 3]])?;
/// let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
/// let flag = XpbdBody::new(&surface, &positions, material)?.pinned([VertexId(0), VertexId(2)]);
/// world.spawn((surface, positions, flag, SurfaceWind { velocity: Vec3::X * 8.0, ..SurfaceWind::default() }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SurfaceWind {
    /// Velocity in the world, in meters per second. Default 0: still air.
    pub velocity: Vec3,
    /// Density of the air in kilograms per cubic meter; 0 or more. Default 1.2, air at sea level.
    pub density: f32,
    /// Drag coefficient, of the force along the wind on a triangle that faces it. Default 1.
    pub drag: f32,
    /// Lift coefficient, of the force across a triangle that the wind meets at an angle. Default 0.5.
    pub lift: f32,
}

impl Default for SurfaceWind {
    fn default() -> Self {
        Self { velocity: Vec3::ZERO, density: 1.2, drag: 1.0, lift: 0.5 }
    }
}

impl SurfaceWind {
    pub(super) fn air(&self) -> Air {
        let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
        Air {
            velocity: if self.velocity.is_finite() { self.velocity } else { Vec3::ZERO },
            density: finite(self.density).max(0.0),
            coefficients: [finite(self.drag), finite(self.lift)],
        }
    }
}

/// Forces on the vertices of a body, in newtons in the world, one for each vertex. They act for as long as they are
/// there. Pinned vertices ignore them, and so does a body with another number of vertices; a force that is not finite is
/// left out. Forces on welded vertices add up.
///
/// For an impulse, use [`XpbdBody::apply_impulse`].
#[derive(Component, Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceForces(pub Vec<Vec3>);

impl XpbdBody {
    /// Changes the velocity of a vertex by an impulse in newton seconds, in the world. A pinned vertex and one out of
    /// range ignore it. Vertices at one place, such as along a seam of texture coordinates, move as one: give the impulse
    /// to each of them, or to the first.
    pub fn apply_impulse(&mut self, vertex: VertexId, impulse: Vec3) {
        if let (Some(velocity), Some(&inverse_mass)) =
            (self.velocities.get_mut(vertex.index()), self.inverse_masses.get(vertex.index()))
        {
            *velocity += impulse * inverse_mass;
        }
    }
}
