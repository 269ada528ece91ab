//! Smooth surfaces: the quadratic patches over their triangles, how far apart they are, and their contacts.

mod closest_lanes;
mod features;
mod newton;
pub mod patch;
mod patch_lanes;
pub mod refine;

use glam::DVec3;

use self::patch::Patch;
use super::{mesh::curved_edges::CurvedEdges, pair::SurfaceSide};

/// A smooth or flat surface in the frame of a pair.
#[derive(Clone, Copy)]
pub struct SmoothSide<'a> {
    /// The surface.
    pub surface: &'a SurfaceSide<'a>,
    /// Its curved edges. `None` if it is flat.
    pub edges: Option<&'a CurvedEdges>,
}

impl SmoothSide<'_> {
    /// How far the patch of a triangle may be from it, in the unit of the pair's frame.
    #[inline]
    pub(crate) fn height(&self, triangle: u32) -> f64 {
        let Some(edges) = self.edges else { return 0.0 };
        f64::from(edges.height(triangle)) * self.surface.moved.map_or(1.0, |moved| moved.pose.scale())
    }

    /// The patch of a triangle.
    #[must_use]
    pub fn patch(&self, triangle: u32) -> Patch {
        let corners = self.surface.corners(triangle);
        let Some(edges) = self.edges else { return Patch { corners, offsets: [DVec3::ZERO; 3] } };
        let offsets = edges.of_triangle(self.surface.topology, triangle).map(|offset| {
            let offset = offset.as_dvec3();
            self.surface.moved.map_or(offset, |moved| moved.pose.transform_direction(offset) * moved.pose.scale())
        });
        Patch { corners, offsets }
    }
}
