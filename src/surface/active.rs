//! The snapshot of one tick: all usable surfaces and shapes, in a fixed order.
//!
//! `Prepare` fills it, the bounds stage adds boxes, and the other stages read it.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use super::{
    components::{ContactMethod, SurfaceLayers, SurfaceShape},
    vertex_thickness::ThicknessList,
};
use crate::kernel::{
    exact::{rest_pairs::RestPairs, rigid_shape::ShapeGeometry},
    mesh::{bounds::Aabb, thickness::VaryingThickness, topology::SurfaceTopology},
    pose::Pose,
};

/// One side of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ContactSide {
    /// A deformable surface.
    Surface(Entity),
    /// A [rigid shape](super::RigidShape), either a solid or made of triangles.
    Shape(Entity),
}

impl ContactSide {
    /// The entity of the surface or shape.
    #[must_use]
    pub const fn entity(self) -> Entity {
        match self {
            Self::Surface(entity) | Self::Shape(entity) => entity,
        }
    }
}

/// A surface that takes part in this tick.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each mirrors a component of its own")]
pub struct ActiveSurface {
    /// Its entity.
    pub entity: Entity,
    /// Its triangles.
    pub topology: Arc<SurfaceTopology>,
    /// Its pose in the world.
    pub pose: Pose,
    /// Half the distance at which two such surfaces touch, in world units. The largest, if it [varies](super::VertexThickness).
    pub thickness: f32,
    /// The thickness at each vertex, if it varies.
    pub(crate) vertex_thickness: Option<Arc<ThicknessList>>,
    /// How it is tested.
    pub method: ContactMethod,
    /// Which surfaces and shapes it meets. None if it is [`QueryOnly`](super::QueryOnly).
    pub layers: SurfaceLayers,
    /// By which layers queries filter it.
    pub query_layers: SurfaceLayers,
    /// Whether it is tested against itself.
    pub self_collision: bool,
    /// Whether it has an inside.
    pub one_sided: bool,
    /// Which surface its mesh stands for.
    pub shape: SurfaceShape,
    /// Whether it is a [`RigidShape`](super::RigidShape) made of triangles. These do not meet each other.
    pub rigid: bool,
    /// Whether it has contact messages and events enabled.
    pub events: bool,
    /// How many ticks in a row its contacts may be absent without ending.
    pub event_hold: u32,
    /// Whether results of earlier ticks are invalid: the surface is new, has a new mesh or frame, was teleported, or
    /// took no part in the last tick.
    pub fresh: bool,
    /// The margins that a solver needs, in world units: against itself, and against other sides.
    pub(crate) solver_margins: [f32; 2],
    /// Contacts with itself are reported up to this distance beyond the contact distance, in world units; at most the
    /// other margin. Written by the bounds stage.
    pub own_margin: f32,
    /// Contacts with another side are reported up to the mean of both margins beyond the contact distance, in world
    /// units: the [margin](field@crate::CircumsphereSettings::margin) of the settings, or more if a solver needs it.
    /// Written by the bounds stage.
    pub margin: f32,
    /// Its box in the world, in world units, grown by thickness and half the margin. Written by the bounds stage.
    pub world_bounds: Aabb,
    /// The layers of each triangle, if they differ.
    pub(crate) triangle_layers: Option<Arc<[SurfaceLayers]>>,
    /// Pairs of its own triangles that make no contact.
    pub(crate) rest_pairs: Option<Arc<RestPairs>>,
    pub(crate) order: SideOrder,
}

/// Triangles inside a solid, and how far the solid extends beyond them. For a ball, its center. For a capsule, its
/// axis.
#[derive(Debug)]
pub(crate) struct ShapePart {
    pub(crate) topology: Arc<SurfaceTopology>,
    pub(crate) positions: Vec<Vec3>,
    /// How far the solid extends beyond the triangles, in the shape's own unit.
    pub(crate) radius: f64,
}

impl ActiveSurface {
    /// Whether two surfaces are tested against each other.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        !(self.rigid && other.rigid) && self.layers.interacts_with(other.layers)
    }

    /// The thickness at its vertices, if it varies.
    pub(crate) fn varying_thickness(&self) -> Option<VaryingThickness<'_>> {
        self.vertex_thickness.as_ref().map(|list| list.varying(self.pose.scale()))
    }

    /// The least thickness of the surface, in world units.
    pub(crate) fn least_thickness(&self) -> f32 {
        self.vertex_thickness.as_ref().map_or(self.thickness, |list| list.least * self.pose.scale() as f32)
    }

    /// The surface as a side of a contact.
    pub(crate) fn side(&self) -> ContactSide {
        if self.rigid { ContactSide::Shape(self.entity) } else { ContactSide::Surface(self.entity) }
    }
}

/// A rigid shape that is tested by formula and takes part in this tick.
#[derive(Clone, Debug)]
pub struct ActiveShape {
    /// Its entity.
    pub entity: Entity,
    /// The shape, in its own frame.
    pub(crate) geometry: Arc<ShapeGeometry>,
    /// Triangles that stand for it in sweeps. Empty for a half-space.
    pub(crate) parts: Arc<[ShapePart]>,
    /// Its pose in the world.
    pub pose: Pose,
    /// The pose to which a solver moves it in this tick. If present, this motion is swept instead of the one since the
    /// last detection.
    pub(crate) target: Option<Pose>,
    /// The margin that a solver needs, in world units.
    pub(crate) solver_margin: f32,
    /// As for a [surface](ActiveSurface::margin).
    pub margin: f32,
    /// Which surfaces it meets. None if it is [`QueryOnly`](super::QueryOnly).
    pub layers: SurfaceLayers,
    /// By which layers queries filter it.
    pub query_layers: SurfaceLayers,
    /// Whether results of earlier ticks are invalid: the shape is new, was replaced or teleported, or took no part in
    /// the last tick.
    pub fresh: bool,
    /// Whether it has contact messages and events enabled.
    pub events: bool,
    /// How many ticks in a row its contacts may be absent without ending.
    pub event_hold: u32,
    pub(crate) order: SideOrder,
}

/// Sorts sides: rigid shapes last, then by `SurfaceOrder`, then by registration, then by entity. The entity only
/// matters for what was spawned before the plugin was added, because that has no registration.
pub(crate) type SideOrder = (bool, u32, u64, u32);

/// Everything that takes part in this tick, sorted by [`SurfaceOrder`](super::SurfaceOrder), then by registration.
/// Rigid shapes come after surfaces.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct ActiveSurfaces {
    /// The surfaces. Rigid shapes made of triangles come last.
    pub surfaces: Vec<ActiveSurface>,
    /// The rigid shapes that are tested by formula.
    pub shapes: Vec<ActiveShape>,
}
