//! The picture of one tick: every usable surface and shape, in a fixed order.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::Vec3;

use super::components::{ContactMethod, SurfaceLayers};
use crate::kernel::{
    exact::rigid_shape::ShapeGeometry,
    mesh::{bounds::Aabb, topology::SurfaceTopology},
    pose::Pose,
};

/// One side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ContactSide {
    /// A deformable surface.
    Surface(Entity),
    /// A [rigid shape](super::RigidShape), whether a solid or made of triangles.
    Shape(Entity),
}

impl ContactSide {
    /// The entity, whatever it is.
    #[must_use]
    pub const fn entity(self) -> Entity {
        match self {
            Self::Surface(entity) | Self::Shape(entity) => entity,
        }
    }
}

/// A surface that takes part in this tick.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a component of its own, read once")]
pub struct ActiveSurface {
    /// Its entity.
    pub entity: Entity,
    /// Its triangles.
    pub topology: Arc<SurfaceTopology>,
    /// Where it stands in the world.
    pub pose: Pose,
    /// Half its contact distance in world units.
    pub thickness: f32,
    /// How it is tested.
    pub method: ContactMethod,
    /// Whom it meets.
    pub layers: SurfaceLayers,
    /// Whether it meets itself.
    pub self_collision: bool,
    /// Whether it has an inside.
    pub one_sided: bool,
    /// Whether it is a [`RigidShape`](super::RigidShape) made of triangles: it meets no other of these.
    pub rigid: bool,
    /// Whether it asked for messages and events.
    pub events: bool,
    /// Whether nothing remembered of it holds: new, re-made, teleported, or back from a pause.
    pub fresh: bool,
    /// Its box in world units, grown by thickness and half the margin. Written by the bounds stage.
    pub world_bounds: Aabb,
    pub(crate) order: SideOrder,
}

/// Triangles inside a shape, and how far it reaches beyond them: of a ball its center, of a capsule its axis.
#[derive(Debug)]
pub(crate) struct ShapePart {
    pub(crate) topology: Arc<SurfaceTopology>,
    pub(crate) positions: Vec<Vec3>,
    /// In the shape's own unit.
    pub(crate) radius: f64,
}

impl ActiveSurface {
    /// Whether two surfaces are to be tested against each other.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        !(self.rigid && other.rigid) && self.layers.interacts_with(other.layers)
    }

    /// The side of a contact that it is.
    pub(crate) fn side(&self) -> ContactSide {
        if self.rigid { ContactSide::Shape(self.entity) } else { ContactSide::Surface(self.entity) }
    }
}

/// A rigid shape tested by formula that takes part in this tick.
#[derive(Clone)]
pub struct ActiveShape {
    /// Its entity.
    pub entity: Entity,
    /// The shape, in its own frame.
    pub geometry: Arc<ShapeGeometry>,
    /// Triangles that stand for it where motions are swept; none of a half-space.
    pub(crate) parts: Arc<[ShapePart]>,
    /// Where it stands in the world.
    pub pose: Pose,
    /// Where a solver takes it in this tick: that way is swept, instead of the one since the last detection.
    pub(crate) target: Option<Pose>,
    /// Whom it meets.
    pub layers: SurfaceLayers,
    /// Whether nothing remembered of it holds: new, replaced, teleported, or back from a pause.
    pub fresh: bool,
    /// Whether it asked for messages and events.
    pub events: bool,
    pub(crate) order: SideOrder,
}

/// Rigid shapes come last; then the game's wish decides, then registration, then (of what was spawned before the plugin) the
/// entity.
pub(crate) type SideOrder = (bool, u32, u64, u32);

/// Everything that takes part in this tick, ordered by [`SurfaceOrder`](super::SurfaceOrder), then by registration; rigid shapes
/// come after surfaces.
#[derive(Resource, Default)]
pub struct ActiveSurfaces {
    /// The surfaces; those of rigid shapes last.
    pub surfaces: Vec<ActiveSurface>,
    /// The rigid shapes that are tested by formula.
    pub shapes: Vec<ActiveShape>,
}
