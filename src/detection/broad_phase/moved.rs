//! Brings those triangles of a surface into the frame of a pair that may be near the other surface.
//!
//! Where two surfaces have poses of their own, the boxes of one of them are needed in the other's frame. Only what can reach
//! the other's box is moved: two bodies that touch at a corner cost what the corner costs, and a body in many pairs is not
//! moved as a whole for each.

use glam::Vec3;

use super::{Frame, OtherSide, SurfacePair};
use crate::{
    detection::bounds::frame_growth,
    kernel::{
        bvh::moved_triangles::MovingMesh,
        mesh::{bounds::Aabb, ids::VertexId, topology::SurfaceTopology},
        pose::Pose,
    },
    surface::{ActiveSurface, ActiveSurfaces},
};

/// Moves triangles of a pair's other surface into the frame of the pair.
///
/// Every triangle that is paired has to be moved first.
pub(super) struct TriangleMover<'a> {
    topology: &'a SurfaceTopology,
    mesh: MovingMesh<'a>,
    moved: &'a mut Vec<Vec3>,
    rounding: &'a mut f32,
}

impl SurfacePair {
    /// Whether one of two surfaces has to be moved into the frame of the pair.
    #[must_use]
    pub fn is_moved(&self) -> bool {
        matches!(self.second, OtherSide::Surface(_)) && self.relative_pose != Pose::IDENTITY
    }

    /// The surface that has to be moved, if [any](Self::is_moved) has.
    pub fn moved_surface<'a>(&self, active: &'a ActiveSurfaces) -> Option<&'a ActiveSurface> {
        let OtherSide::Surface(second) = self.second else { return None };
        self.is_moved().then(|| match self.frame {
            Frame::First => &active.surfaces[second],
            Frame::Second => &active.surfaces[self.first],
        })
    }

    /// Begins to move the triangles of `surface`, which is [`moved_surface`](Self::moved_surface), from its own `positions`;
    /// `margin` is that of the settings.
    pub(super) fn mover<'a>(
        &'a mut self,
        surface: &'a ActiveSurface,
        positions: &'a [Vec3],
        margin: f32,
    ) -> TriangleMover<'a> {
        self.moved_positions.clear();
        self.moved_rounding = 0.0;
        TriangleMover {
            topology: &surface.topology,
            mesh: MovingMesh {
                pose: &self.relative_pose,
                positions,
                triangles: surface.topology.triangles(),
                growth: frame_growth(surface.thickness, margin, self.frame_pose.scale()),
            },
            moved: &mut self.moved_positions,
            rounding: &mut self.moved_rounding,
        }
    }
}

impl TriangleMover<'_> {
    /// Appends some triangles, each with its box in the frame of the pair, grown by the surface's thickness and half the margin.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub(super) fn move_triangles(&mut self, triangles: &[u32], bounds: &mut Vec<(u32, Aabb)>) {
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
        // Half a unit in the last place of the largest coordinate, along each of three axes.
        let largest = mesh.move_triangles(triangles, moved, bounds);
        **rounding = rounding.max(f32::EPSILON * largest);
    }

    /// The same of all triangles.
    pub(super) fn move_all(&mut self, bounds: &mut Vec<(u32, Aabb)>) {
        let all: Vec<u32> = (0..self.mesh.triangles.len() as u32).collect();
        self.move_triangles(&all, bounds);
    }
}

/// Moves all vertices that are welded to one of them: whether those that were together still are is asked in the frame of the pair,
/// too. Returns the largest coordinate of any of them, by its magnitude.
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
    // Of which no triangle may be left but collapsed ones.
    move_vertex(welded);
    largest
}
