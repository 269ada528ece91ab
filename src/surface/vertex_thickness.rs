//! Thickness that differs from vertex to vertex.

use std::sync::Arc;

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::quarantine::QuarantineReason;
use crate::kernel::mesh::{ids::VertexId, thickness::VaryingThickness, topology::SurfaceTopology};

/// Half the distance at which two such surfaces touch, for each vertex of a surface, in place of
/// [`SurfaceThickness`](super::SurfaceThickness). For sheets that stand for walls, such as those of
/// [`thin_wall`](crate::geometry). In the unit of the surface's positions: the scale of its pose applies.
///
/// In between, thickness is interpolated linearly. So a triangle with its thickness is the convex hull of the balls at its
/// corners, and triangles touch where these hulls meet. With [`Exact`](super::ContactMethod), `Closest`, and `Polygon` this is
/// exact, also against rigid shapes. With the sphere methods, and for pairs of triangles of
/// [smooth](super::SurfaceShape::Smooth) surfaces, each triangle counts as thick as its thickest corner.
/// [`Contact::contact_distance`](crate::Contact::contact_distance) is the sum of the thicknesses at the contact points. The
/// response keeps bodies that far apart.
///
/// Default: without the component, the thickness is the same everywhere. A surface whose number of vertices differs, or with a
/// thickness that is negative or not finite, is [quarantined](QuarantineReason::VertexThicknessCount).
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # use glam::Vec3;
/// # let mut world = bevy_ecs::world::World::new();
/// let (wedge, positions) = DeformableSurface::from_mesh(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]])?;
/// world.spawn((wedge, positions, VertexThickness::new([0.01, 0.03, 0.01])));
/// # Ok::<(), TopologyError>(())
/// ```
#[derive(Component, Clone, Debug, PartialEq)]
#[component(immutable)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(from = "Vec<f32>", into = "Vec<f32>"))]
pub struct VertexThickness(Arc<ThicknessList>);

/// The thickness at each vertex, and what was found in it.
#[derive(Debug)]
pub(crate) struct ThicknessList {
    values: Box<[f32]>,
    pub(crate) least: f32,
    pub(crate) largest: f32,
    first_unusable: Option<u32>,
}

/// NaN is equal to itself, so that a component is equal to its clone.
impl PartialEq for ThicknessList {
    fn eq(&self, other: &Self) -> bool {
        let bits = |list: &Self| list.values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        bits(self) == bits(other)
    }
}

impl ThicknessList {
    /// One for each vertex, in the unit of the positions.
    #[cfg(feature = "rerun")]
    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    /// With the world length of a unit of the positions.
    pub(crate) fn varying(&self, scale: f64) -> VaryingThickness<'_> {
        VaryingThickness { at_vertices: &self.values, largest: self.largest, scale }
    }
}

impl VertexThickness {
    /// The thickness at each vertex, in the order of the mesh that the surface was made from. Finite, 0 or more.
    #[must_use]
    pub fn new(values: impl IntoIterator<Item = f32>) -> Self {
        let values: Box<[f32]> = values.into_iter().collect();
        let least = values.iter().copied().fold(f32::INFINITY, f32::min);
        let largest = values.iter().copied().fold(0.0, f32::max);
        let first_unusable = values.iter().position(|value| !(value.is_finite() && *value >= 0.0));
        let first_unusable = first_unusable.map(|vertex| vertex as u32);
        Self(Arc::new(ThicknessList { values, least, largest, first_unusable }))
    }

    /// The thickness at each vertex.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.0.values
    }

    /// The list, shared, if it fits a mesh.
    pub(super) fn checked(&self, topology: &SurfaceTopology) -> Result<Arc<ThicknessList>, QuarantineReason> {
        let (expected, found) = (topology.vertex_count(), self.0.values.len());
        if expected != found {
            return Err(QuarantineReason::VertexThicknessCount { expected, found });
        }
        if let Some(vertex) = self.0.first_unusable {
            let thickness = self.0.values[vertex as usize];
            return Err(QuarantineReason::VertexThickness { vertex: VertexId(vertex), thickness });
        }
        Ok(Arc::clone(&self.0))
    }
}

impl From<Vec<f32>> for VertexThickness {
    fn from(values: Vec<f32>) -> Self {
        Self::new(values)
    }
}

impl From<VertexThickness> for Vec<f32> {
    fn from(thickness: VertexThickness) -> Self {
        thickness.0.values.to_vec()
    }
}
