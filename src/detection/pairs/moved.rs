//! Transforms those triangles of a surface into the frame of a pair that may be near the other surface.
//!
//! If two surfaces have different poses, the boxes of one are needed in the frame of the other. Only what can reach the
//! other's box is transformed. Two bodies that touch at a corner only pay for the corner, and a body in many pairs is
//! not transformed as a whole for each of them.

use arrayvec::ArrayVec;
use glam::Vec3;

use crate::{
    detection::pairs::{Frame, GROWTH_SLACK, OtherSide, SurfacePair, frame_growth},
    kernel::{
        bvh::moved_triangles::MovingMesh,
        mesh::{bounds::Aabb, ids::VertexId, topology::SurfaceTopology},
        pose::Pose,
    },
    surface::{ActiveSurface, ActiveSurfaces},
};

/// Transforms triangles of a pair's other surface into the pair's frame.
///
/// Every triangle that is paired must be transformed first.
pub(in crate::detection) struct TriangleMover<'a> {
    topology: &'a SurfaceTopology,
    mesh: MovingMesh<'a>,
    moved: &'a mut Vec<Vec3>,
    rounding: &'a mut f32,
}

impl SurfacePair {
    /// Whether one of two surfaces must be transformed into the pair's frame.
    #[must_use]
    pub fn is_moved(&self) -> bool {
        matches!(self.second, OtherSide::Surface(_)) && self.relative_pose != Pose::IDENTITY
    }

    /// The surface that must be transformed, if [one](Self::is_moved) must.
    pub fn moved_surface<'a>(&self, active: &'a ActiveSurfaces) -> Option<&'a ActiveSurface> {
        let OtherSide::Surface(second) = self.second else { return None };
        self.is_moved().then(|| match self.frame {
            Frame::First => &active.surfaces[second],
            Frame::Second => &active.surfaces[self.first],
        })
    }

    /// Begins to transform the triangles of `surface`, which is [`moved_surface`](Self::moved_surface), from its own
    /// `positions`.
    pub(in crate::detection) fn mover<'a>(
        &'a mut self,
        surface: &'a ActiveSurface,
        positions: &'a [Vec3],
    ) -> TriangleMover<'a> {
        self.moved_positions.clear();
        self.moved_rounding = 0.0;
        TriangleMover {
            topology: &surface.topology,
            mesh: MovingMesh {
                pose: &self.relative_pose,
                positions,
                triangles: surface.topology.triangles(),
                growth: frame_growth(surface.thickness, surface.margin, self.frame_pose.scale())
                    + (f64::from(self.bulge) / self.frame_pose.scale()) as f32 * GROWTH_SLACK,
            },
            moved: &mut self.moved_positions,
            rounding: &mut self.moved_rounding,
        }
    }
}

impl TriangleMover<'_> {
    /// Appends some triangles, each with its box in the pair's frame, grown by the surface's thickness and half the
    /// margin.
    ///
    /// # Panics
    /// If a triangle does not exist.
    pub(in crate::detection) fn move_triangles(&mut self, triangles: &[u32], bounds: &mut Vec<(u32, Aabb)>) {
        let Self { topology, mesh, moved, rounding } = self;
        if moved.is_empty() {
            moved.resize(mesh.positions.len(), Vec3::NAN);
        }
        if topology.is_welded() {
            for &triangle in triangles {
                for vertex in mesh.triangles[triangle as usize] {
                    if moved[vertex as usize].is_nan() {
                        let largest = move_welded(topology, mesh, vertex, moved);
                        **rounding = rounding.max(f32::EPSILON * largest);
                    }
                }
            }
        }
        // Bounds half a unit in the last place of the largest coordinate, along each of three axes.
        let largest = mesh.move_triangles(triangles, moved, bounds);
        **rounding = rounding.max(f32::EPSILON * largest);
    }

    /// Transforms all triangles.
    pub(in crate::detection) fn move_all(&mut self, bounds: &mut Vec<(u32, Aabb)>) {
        const AT_ONCE: usize = 256;
        let all = 0..self.mesh.triangles.len() as u32;
        for first in all.clone().step_by(AT_ONCE) {
            let some: ArrayVec<u32, AT_ONCE> = (first..all.end).take(AT_ONCE).collect();
            self.move_triangles(&some, bounds);
        }
    }
}

/// Transforms all vertices that are welded to `vertex`, because contacts also check in the pair's frame whether they
/// are still together. Returns the largest magnitude of their coordinates.
fn move_welded(topology: &SurfaceTopology, mesh: &MovingMesh<'_>, vertex: u32, moved: &mut [Vec3]) -> f32 {
    let welded = topology.weld()[vertex as usize];
    let mut largest = 0.0;
    let mut move_vertex = |vertex: u32| {
        let place = mesh.pose.transform_point(mesh.positions[vertex as usize].as_dvec3()).as_vec3();
        moved[vertex as usize] = place;
        largest = f32::max(largest, place.abs().max_element());
    };
    for &triangle in topology.triangles_of_vertex(VertexId(welded)) {
        for other in mesh.triangles[triangle as usize] {
            if topology.weld()[other as usize] == welded {
                move_vertex(other);
            }
        }
    }
    // Its only triangles may be collapsed ones.
    move_vertex(welded);
    largest
}
