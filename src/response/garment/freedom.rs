//! How far the vertices of a garment may get from their places on the skin.

use bevy_mesh::{Mesh, VertexAttributeValues};
use glam::Vec3;

use super::{
    components::{GarmentPaint, XpbdGarment},
    error::XpbdGarmentError,
};
use crate::{
    geometry::{SurfaceTopology, VertexId},
    kernel::mesh::edge_distances::nearest_along_edges,
    surface::SurfaceMeshError,
};

/// How far vertices may move.
#[derive(Clone, Debug)]
pub(super) enum Freedom {
    /// A share of the longest distance.
    Painted(Vec<f32>),
    /// The distance to the pinned vertices along the edges.
    ByDistance(Vec<f32>),
}

impl Freedom {
    /// Reads the paint of a mesh. `Ok(None)` if nothing is painted.
    pub(super) fn painted(mesh: &Mesh, paint: GarmentPaint, expected: usize) -> Result<Option<Self>, XpbdGarmentError> {
        let Some(attribute) = paint.attribute() else { return Ok(None) };
        let values = mesh.try_attribute_option(attribute).map_err(|_| SurfaceMeshError::OnlyInRenderWorld)?;
        let Some(values) = values else {
            return if paint == GarmentPaint::Attribute { Ok(None) } else { Err(XpbdGarmentError::NotPainted(paint)) };
        };
        let found = values.len();
        if found != expected {
            return Err(XpbdGarmentError::PaintCount { paint, expected, found });
        }
        let channel = match paint {
            GarmentPaint::Green => 1,
            GarmentPaint::Blue => 2,
            GarmentPaint::Alpha => 3,
            _ => 0,
        };
        let shares: Vec<f32> = match values {
            VertexAttributeValues::Float32(values) => values.clone(),
            VertexAttributeValues::Float32x4(colors) => colors.iter().map(|color| color[channel]).collect(),
            VertexAttributeValues::Unorm8x4(colors) => {
                colors.iter().map(|color| f32::from(color[channel]) / f32::from(u8::MAX)).collect()
            }
            other => return Err(XpbdGarmentError::PaintFormat { paint, format: other.into() }),
        };
        match shares.iter().position(|share| !(share.is_finite() && *share >= 0.0)) {
            Some(vertex) => {
                Err(XpbdGarmentError::PaintValue { vertex: VertexId(vertex as u32), value: shares[vertex] })
            }
            None => Ok(Some(Self::Painted(shares))),
        }
    }

    /// Pins the upper edge of each connected part. `positions` are finite, in world space.
    pub(super) fn by_distance(topology: &SurfaceTopology, positions: &[Vec3], pinned_height: f32) -> Self {
        let (components, count) = topology.components();
        let mut heights = vec![[f32::INFINITY, f32::NEG_INFINITY]; count];
        let corners = || {
            topology.welded_triangles().iter().zip(components).flat_map(|(corners, &component)| {
                corners.map(|corner| (corner, positions[corner as usize].y, component as usize))
            })
        };
        for (_, height, component) in corners() {
            let [low, high] = heights[component];
            heights[component] = [low.min(height), high.max(height)];
        }
        let pinned = corners().filter(|&(_, height, component)| {
            let [low, high] = heights[component];
            height >= high - (high - low) * pinned_height
        });
        let nearest = nearest_along_edges(topology, positions, pinned.map(|(corner, ..)| corner));
        Self::ByDistance(nearest.into_iter().map(|found| found.map_or(f32::INFINITY, |(_, length)| length)).collect())
    }

    /// The longest distance of a vertex from its place.
    pub(super) fn longest(&self, vertex: VertexId, garment: &XpbdGarment) -> f32 {
        match self {
            Self::Painted(shares) => shares[vertex.index()] * garment.longest,
            Self::ByDistance(distances) => distances[vertex.index()].min(garment.longest),
        }
    }
}
