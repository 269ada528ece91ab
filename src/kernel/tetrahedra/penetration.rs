//! How deep a point is in a body, and the shortest way out: the nearest point of the body's surface.

use glam::{DVec3, Vec3};

use crate::kernel::{
    bvh::tree::BoxTree,
    mesh::{
        bounds::{Aabb, triangle_bounds},
        feature::Feature,
        ids::TriangleId,
        side::{closest_feature, face_normal, outward_direction, rise},
        topology::SurfaceTopology,
    },
};

/// A point this close to the surface is on it, in parts of the largest coordinate of the nearest triangle relative to
/// the point: above the rounding of the closest point, so that what leads there is more than rounding.
const ON_SURFACE: f64 = 1.0e-13;

/// A tree whose nodes have grown by this factor is rebuilt.
const MOST_DECAY: f32 = 2.0;

/// The way out of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Penetration {
    /// Distance to the nearest point of the surface, 0 or more.
    pub depth: f64,
    /// Unit vector to that point. On the surface, its outward direction. Zero there if no triangle around has an area.
    pub direction: DVec3,
    /// The triangle of the surface that has the nearest point. The lowest, where several have.
    pub triangle: TriangleId,
}

/// The surface of a body at its current positions, for queries of the nearest point.
#[derive(Clone, Debug, Default)]
pub struct SurfaceSearch {
    tree: BoxTree,
    bounds: Vec<Aabb>,
}

impl SurfaceSearch {
    /// Fits the search to the current positions.
    ///
    /// # Panics
    /// If there are fewer positions than the surface has vertices.
    pub fn update(&mut self, topology: &SurfaceTopology, positions: &[Vec3]) {
        triangle_bounds(positions, topology.triangles(), 0.0, &mut self.bounds);
        if self.tree.len() == self.bounds.len() {
            self.tree.refit(&self.bounds);
            if self.tree.decay() <= MOST_DECAY {
                return;
            }
        }
        self.tree.rebuild(&self.bounds);
    }

    /// The way from a point to the nearest point of the surface. `None` only if the surface has no triangle.
    #[must_use]
    pub fn penetration(&self, topology: &SurfaceTopology, positions: &[Vec3], point: DVec3) -> Option<Penetration> {
        self.nearest(topology, positions, point, |_, _, _| true)
    }

    /// Like [`penetration`](Self::penetration), for a vertex of the same surface or of the inside of its body. The
    /// triangles around the vertex do not count, nor do those where the way would lead into the body, as next to a
    /// vertex that sticks out. If nothing else is there, the latter count.
    #[must_use]
    pub fn own_penetration(&self, topology: &SurfaceTopology, positions: &[Vec3], vertex: u32) -> Option<Penetration> {
        let point = positions[vertex as usize].as_dvec3();
        let own = topology.weld()[vertex as usize];
        let is_other = |triangle: u32| !topology.welded_triangles()[triangle as usize].contains(&own);
        self.nearest(topology, positions, point, |triangle, feature, way| {
            is_other(triangle) && rise(topology, positions, triangle as usize, feature, way) > 0.0
        })
        .or_else(|| self.nearest(topology, positions, point, |triangle, _, _| is_other(triangle)))
    }

    /// The nearest point of the triangles that `counts` accepts, given the triangle, its closest feature, and the way
    /// there.
    fn nearest(
        &self,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        point: DVec3,
        counts: impl Fn(u32, Feature, DVec3) -> bool,
    ) -> Option<Penetration> {
        let corners = |triangle: u32| {
            topology.triangles()[triangle as usize].map(|vertex| positions[vertex as usize].as_dvec3() - point)
        };
        let mut best: Option<(f64, u32, Feature, DVec3)> = None;
        self.tree.nearest(point, f64::INFINITY, |triangle| {
            let (feature, way) = closest_feature(&corners(triangle), DVec3::ZERO);
            let squared = way.length_squared();
            let is_better = |(least, other, ..): &(f64, u32, _, _)| (squared, triangle) < (*least, *other);
            if !best.as_ref().is_none_or(is_better) || !counts(triangle, feature, way) {
                return None;
            }
            best = Some((squared, triangle, feature, way));
            Some(squared.sqrt())
        });
        let (squared, triangle, feature, way) = best?;
        let (depth, corners) = (squared.sqrt(), corners(triangle));
        let reach = corners.iter().fold(0.0, |reach: f64, corner| reach.max(corner.abs().max_element()));
        let direction = if depth <= ON_SURFACE * reach {
            outward_direction(topology, positions, triangle as usize, feature).normalize_or_zero()
        } else if feature == Feature::Face {
            // More precise than a short way.
            let normal = face_normal(&corners);
            if normal.dot(way) < 0.0 { -normal } else { normal }
        } else {
            way / depth
        };
        Some(Penetration { depth, direction, triangle: TriangleId(triangle) })
    }
}
