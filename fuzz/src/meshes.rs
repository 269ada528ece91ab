//! Small meshes for the fuzz targets of the kernel, and what can be expected of their coordinates.

use bevy_circumsphere::kernel::{mesh::topology::SurfaceTopology, pair::SurfaceSide};
use glam::Vec3;

use crate::input::{Coordinates, Input};

/// The most triangles of one surface. Small inputs are mutated most effectively.
const MOST_TRIANGLES: usize = 4;

/// Coordinates in this range, and zero, leave room for the products of lengths in the reference, which multiplies up to
/// eight of them in f64.
const LEAST_SANE: f32 = 1.0e-15;
const LARGEST_SANE: f32 = 1.0e15;

/// A surface and the current positions of its vertices.
pub struct FuzzedSurface {
    pub topology: SurfaceTopology,
    pub positions: Vec<Vec3>,
}

impl FuzzedSurface {
    /// A surface of up to four triangles. If `welds` is set, vertices at the same place are one, as in a mesh at rest.
    /// Otherwise, the mesh has been deformed from another shape.
    pub fn new(input: &mut Input<'_>, written: Coordinates) -> Self {
        let triangle_count = 1 + input.below(MOST_TRIANGLES);
        let vertex_count = 3 + input.below(3 * MOST_TRIANGLES - 2);
        let welds = input.byte().is_multiple_of(2);
        let triangles: Vec<[u32; 3]> = (0..triangle_count)
            .map(|triangle| {
                // By default (zero bytes), triangles share no vertices.
                std::array::from_fn(|corner| ((3 * triangle + corner + input.below(256)) % vertex_count) as u32)
            })
            .collect();
        let positions = input.points(vertex_count, written);
        let apart: Vec<Vec3> = (0..vertex_count).map(|vertex| Vec3::splat(vertex as f32)).collect();
        let welded = SurfaceTopology::new(&positions, &triangles).ok().filter(|_| welds);
        let topology = welded.unwrap_or_else(|| {
            SurfaceTopology::new(&apart, &triangles).expect("finite positions and indices in range are accepted")
        });
        Self { topology, positions }
    }

    pub fn side(&self, one_sided: bool, mirrored: bool) -> SurfaceSide<'_> {
        let Self { topology, positions } = self;
        SurfaceSide { one_sided, mirrored, ..SurfaceSide::flat(topology, positions) }
    }

    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }

    pub fn is_finite(&self) -> bool {
        self.positions.iter().all(|position| position.is_finite())
    }

    /// Whether the reference can judge coordinates of this magnitude.
    pub fn is_sane(&self) -> bool {
        self.positions
            .iter()
            .flat_map(|position| position.to_array())
            .all(|coordinate| coordinate == 0.0 || (LEAST_SANE..=LARGEST_SANE).contains(&coordinate.abs()))
    }
}
