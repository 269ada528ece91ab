//! Regular and irregular surfaces with their curved edges.

use bevy_circumsphere::{
    geometry::SurfaceTopology,
    kernel::mesh::{curved_edges::CurvedEdges, smooth_normal::CreaseAngle},
};
use circumsphere_support::{
    random::Random,
    scenes::{Mesh, crumpled_sheet, duplicate_vertices, icosphere, ragged_slivers},
};
use circumsphere_truth::{CurvedMesh, ReferencePatch, exact_weld};
use glam::{DVec3, Vec3};

use crate::bodies::rotation;

/// A surface that was built at rest and has moved since.
#[derive(Clone)]
pub struct Surface {
    pub rest: Vec<Vec3>,
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

/// A surface with its curved edges.
pub struct Curved {
    pub surface: Surface,
    pub topology: SurfaceTopology,
    pub edges: CurvedEdges,
}

impl Surface {
    pub fn of(mesh: &Mesh) -> Self {
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        Self { rest: positions.clone(), positions, triangles: mesh.triangles.clone() }
    }

    /// Moved, turned, and scaled.
    pub fn placed(&self, seed: f64, scale: f32) -> Self {
        let turn = rotation(seed).as_mat3();
        let place = |points: &[Vec3]| points.iter().map(|&point| (turn * point + 0.3) * scale).collect();
        Self { rest: place(&self.rest), positions: place(&self.positions), triangles: self.triangles.clone() }
    }

    pub fn curved(self, crease: f32) -> Curved {
        let topology = SurfaceTopology::new(&self.rest, &self.triangles).expect("the mesh is valid");
        let mut edges = CurvedEdges::default();
        edges.update(&topology, &self.positions, CreaseAngle::new(crease));
        Curved { surface: self, topology, edges }
    }

    /// Offsets by the definition, of positions that may have moved a little.
    pub fn truth(&self, positions: &[DVec3], crease: f32) -> Vec<([u32; 2], DVec3)> {
        let rest: Vec<DVec3> = self.rest.iter().map(|point| point.as_dvec3()).collect();
        let mesh = CurvedMesh::new(positions, &self.triangles, &exact_weld(&rest), f64::from(crease));
        mesh.offsets().into_iter().collect()
    }

    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|vertex| self.positions[vertex as usize].as_dvec3())
    }

    /// Divides an edge of a triangle, and of the triangle beyond, at a share of its length.
    fn divide_edge(&mut self, triangle: usize, share: f32) {
        let [a, b, c] = self.triangles[triangle];
        let is_beyond = |other: &[u32; 3]| (0..3).any(|k| [other[k], other[(k + 1) % 3]] == [b, a]);
        let Some(beyond) = self.triangles.iter().position(is_beyond) else { return };
        let d = self.triangles[beyond].into_iter().find(|&vertex| vertex != a && vertex != b).expect("a third corner");
        let middle = self.rest.len() as u32;
        self.rest.push(self.rest[a as usize].lerp(self.rest[b as usize], 0.5));
        self.positions.push(self.positions[a as usize].lerp(self.positions[b as usize], share));
        (self.triangles[triangle], self.triangles[beyond]) = ([a, middle, c], [b, middle, d]);
        self.triangles.extend([[middle, b, c], [middle, a, d]]);
    }
}

impl Curved {
    pub fn patch(&self, triangle: usize) -> ReferencePatch {
        let offset = |edge: u32| self.edges.offsets()[edge as usize].as_dvec3();
        ReferencePatch::bent(self.surface.corners(triangle), self.topology.triangle_edges()[triangle].map(offset))
    }

    pub fn patches(&self) -> impl Iterator<Item = ReferencePatch> {
        (0..self.surface.triangles.len()).map(|triangle| self.patch(triangle))
    }

    pub fn edge(&self) -> f64 {
        self.topology.mean_edge_length(&self.surface.positions)
    }

    /// The largest offset in mean edges.
    pub fn largest_offset(&self) -> f64 {
        self.edges.offsets().iter().map(|offset| offset.as_dvec3().length()).fold(0.0, f64::max) / self.edge()
    }
}

/// A ball with bumps, holes, sheets that meet at a vertex, slivers, triangles without area, inverted triangles, and
/// edges with three triangles.
pub fn damaged_ball(seed: u64) -> Surface {
    let mut random = Random::new(seed);
    let mut surface = Surface::of(&icosphere(3, 1.0));
    surface.triangles.retain(|_| random.below(25) != 0);
    let bump = [0.005, 0.02, 0.06, 0.15][seed as usize % 4];
    for position in &mut surface.positions {
        *position += bump * Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
    }
    let count = surface.triangles.len();
    // A share of 0 leaves two triangles without area: the new vertex lies on an old one.
    for share in [0.0, 0.0, 0.0, 0.001, 0.01, 0.1, 0.5] {
        surface.divide_edge(random.below(count as u64) as usize, share);
    }
    for _ in 0..4 {
        let [a, b, _] = surface.triangles[random.below(count as u64) as usize];
        let fin = (surface.positions[a as usize] + surface.positions[b as usize]) * 0.6;
        surface.triangles.push([a, b, surface.rest.len() as u32]);
        surface.rest.push(fin);
        surface.positions.push(fin);
        surface.triangles[random.below(count as u64) as usize].swap(0, 1);
    }
    surface
}

pub fn irregular_surfaces() -> Vec<Surface> {
    let mut surfaces: Vec<Surface> = (0..8).map(damaged_ball).collect();
    surfaces.push(Surface::of(&crumpled_sheet(600, 0.3)));
    surfaces.push(Surface::of(&ragged_slivers(5)));
    surfaces.push(Surface::of(&duplicate_vertices(&icosphere(2, 1.0))));
    surfaces
}

pub fn weights(random: &mut Random) -> [f64; 3] {
    let (mut u, mut v) = (random.unit(), random.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    [1.0 - u - v, u, v]
}
