//! How badly a mesh fits a smooth body.
//!
//! Seen from a vertex, a smooth body falls away from its tangent plane to the other end of an edge. Two things tell
//! whether the normals at the vertices describe such a body:
//!
//! - From both ends of an edge, the body falls by nearly the same height. Where vertices lie beside the body, the heights
//!   have opposite signs.
//! - The height is small compared with the triangles that the normal was taken from. Where a large face meets the narrow
//!   strips of a rounded edge, as in CAD meshes, the strips alone decide how the face would bulge.

use glam::{Vec3, Vec3A};

use super::CurvedEdges;
use crate::kernel::{
    mesh::{fans::NONE, smooth_normal::CreaseAngle, topology::SurfaceTopology},
    simd::parallel::{Parallel, Sequential},
};

/// Above this [unevenness](CurvedEdges::unevenness), patches are no closer to a body than flat triangles.
pub const MOST_UNEVEN: f32 = 0.7;

/// Heights below this share of an edge are rounding.
const FLAT: f32 = 1.0e-4;

/// An edge does not fit at all if its middle bulges by this share of the least height of a triangle around its ends.
const LARGEST_BULGE: f32 = 0.5;

impl CurvedEdges {
    /// How badly the mesh fits a smooth body, from 0 to 1, after an [update](Self::update) to the same positions: the
    /// mean over all smooth edges of the larger of both deviations above, weighted by heights. 0 if all faces are flat
    /// or end at creases, as in a plane or a box.
    #[must_use]
    pub fn unevenness(&self, topology: &SurfaceTopology, positions: &[Vec3]) -> f32 {
        let fans = topology.fans();
        // For each slot, the least height of a triangle of its fan.
        let mut least = vec![f32::INFINITY; fans.slots().len()];
        for fan in 0..fans.len() {
            let slots = fans.fan(fan).0;
            let heights = fans.slots()[slots.clone()].iter().map(|slot| self.faces[slot.triangle as usize].height());
            let lowest = heights.filter(|height| *height > 0.0).fold(f32::INFINITY, f32::min);
            least[slots].fill(lowest);
        }
        let (mut sum, mut weights) = (0.0_f64, 0.0_f64);
        for (sides, &softness) in fans.edges().iter().zip(&self.softness) {
            if sides.triangles.contains(&NONE) {
                continue;
            }
            let along = Vec3A::from(positions[sides.ends[1] as usize]) - Vec3A::from(positions[sides.ends[0] as usize]);
            let [start, end] = sides.slots[0].map(|slot| self.normals[slot as usize]);
            let (rise, other) = (along.dot(start), -along.dot(end));
            let height = rise.abs() + other.abs();
            if height > FLAT * along.length() {
                let difference = (rise - other).abs() / height;
                let smallest =
                    sides.slots[0].map(|slot| least[slot as usize]).into_iter().fold(f32::INFINITY, f32::min);
                let bulge = height * 0.125 / (smallest * LARGEST_BULGE);
                let weight = f64::from(softness * height);
                sum += weight * f64::from(difference.max(bulge.min(1.0)));
                weights += weight;
            }
        }
        if weights > 0.0 { (sum / weights) as f32 } else { 0.0 }
    }
}

impl SurfaceTopology {
    /// How badly the mesh at these positions fits a [smooth surface](crate::SurfaceShape::Smooth), from 0 to 1, given the
    /// [`crease_angle`](field@crate::CircumsphereSettings::crease_angle) in radians. Good meshes of round bodies are below
    /// 0.4, even coarse ones. Above 0.7 the patches are no closer to a body than flat triangles: vertices lie beside the
    /// body by more than a tenth of what it bends over an edge, or large faces meet narrow rounded edges.
    ///
    /// Positions must be finite, one for each vertex.
    #[must_use]
    pub fn unevenness(&self, positions: &[Vec3], crease_angle: f32) -> f32 {
        self.unevenness_on(&Sequential, positions, CreaseAngle::new(crease_angle))
    }

    pub(crate) fn unevenness_on(&self, parallel: &impl Parallel, positions: &[Vec3], crease: CreaseAngle) -> f32 {
        let mut edges = CurvedEdges::default();
        edges.update_on(parallel, self, positions, crease);
        edges.unevenness(self, positions)
    }
}
