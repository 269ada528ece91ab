//! Meshes with their trees, for tests of tree traversals.

use bevy_circumsphere::kernel::{
    bvh::{
        leaf_triangles::{LeafMesh, LeafTriangles},
        tree::BoxTree,
    },
    mesh::{bounds::triangle_bounds, topology::SurfaceTopology},
};
use circumsphere_support::scenes::Mesh;
use glam::{DVec3, Vec3};

use crate::truth::{exact, positions};

/// A mesh with its tree, as in the broad phase.
pub struct Surface {
    pub topology: SurfaceTopology,
    pub positions: Vec<Vec3>,
    pub tree: BoxTree,
    pub triangles: LeafTriangles,
}

impl Surface {
    /// `range` is the distance at which pairs matter. Every box grows by half of it.
    pub fn new(positions: Vec<Vec3>, triangles: &[[u32; 3]], range: f32) -> Self {
        let topology = SurfaceTopology::new(&positions, triangles).expect("the mesh is valid");
        let mut bounds = Vec::new();
        triangle_bounds(&positions, triangles, 0.5 * range, &mut bounds);
        let mut surface =
            Self { tree: BoxTree::new(&bounds), topology, positions, triangles: LeafTriangles::default() };
        surface.triangles.update(&surface.tree, &LeafMesh::flat(&surface.topology, &surface.positions));
        surface
    }

    pub fn of_mesh(mesh: &Mesh, range: f32) -> Self {
        Self::new(positions(mesh), &mesh.triangles, range)
    }

    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        exact(self.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize]))
    }
}
