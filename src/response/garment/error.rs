//! Why a garment cannot be worn.

use bevy_ecs::prelude::*;
use bevy_mesh::VertexFormat;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::components::GarmentPaint;
use crate::{
    geometry::VertexId,
    response::error::XpbdBodyError,
    surface::{QuarantineReason, SurfaceMeshError},
};

/// Why a garment cannot be worn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum XpbdGarmentError {
    /// The garment names no skin, or no mesh below the root has the name of the skin.
    #[error("it has no skin: set XpbdGarment::skins, or check the name of the skin in XpbdGarments")]
    NoSkin,
    /// A skin was despawned.
    #[error("its skin {0} does not exist")]
    MissingSkin(Entity),
    /// A skin is no surface and will not become one, or is the garment itself.
    #[error("its skin {0} is no other surface: insert SurfaceFromMesh or DeformableSurface")]
    SkinIsNoSurface(Entity),
    /// The skin or the garment cannot be placed in the world.
    #[error("it cannot be placed on its skin: {0}")]
    Pose(QuarantineReason),
    /// The mesh has not the attribute that the paint should be in.
    #[error("its mesh has no attribute {0}, in which its paint should be")]
    NotPainted(GarmentPaint),
    /// The attribute has another format.
    #[error("the attribute {paint} of its mesh has the format {format:?}, which holds no paint")]
    PaintFormat {
        /// The paint.
        paint: GarmentPaint,
        /// The format of the attribute.
        format: VertexFormat,
    },
    /// The number of values does not match the number of vertices.
    #[error("the attribute {paint} of its mesh has {found} values for {expected} vertices")]
    PaintCount {
        /// The paint.
        paint: GarmentPaint,
        /// Number of vertices.
        expected: usize,
        /// Number of values.
        found: usize,
    },
    /// A value is negative, NaN, or infinite.
    #[error("vertex {} is painted {value}; paint must be finite and 0 or more", .vertex.0)]
    PaintValue {
        /// The vertex.
        vertex: VertexId,
        /// Its value.
        value: f32,
    },
    /// A setting is out of range.
    #[error("{what} is {value}; it must be {range}")]
    Setting {
        /// Name of the setting.
        what: &'static str,
        /// Its value.
        value: f32,
        /// Its valid range.
        range: &'static str,
    },
    /// The mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] SurfaceMeshError),
    /// The surface cannot be a body.
    #[error(transparent)]
    Body(#[from] XpbdBodyError),
}

/// A garment is not worn. Sent once, until it is worn or there is another reason. A garment that was worn before keeps
/// its body, and its tethers to skins that are still there.
#[derive(Message, EntityEvent, Clone, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Message, Event, Clone, Debug, PartialEq))]
pub struct XpbdGarmentNotWorn {
    /// The garment.
    pub entity: Entity,
    /// The reason.
    pub reason: XpbdGarmentError,
}
