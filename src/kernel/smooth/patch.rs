//! The quadratic patch over a triangle of a smooth surface, see [`curved_edges`](crate::kernel::mesh::curved_edges).

use glam::DVec3;

use crate::kernel::{mesh::barycentric::point_at, pair::SurfaceSide};

/// The patch over one triangle. Without offsets, the triangle itself.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    /// The corners of the triangle, which lie on the patch.
    pub corners: [DVec3; 3],
    /// The offsets of its edges. Edge `k` joins corners `k` and `k + 1`.
    pub offsets: [DVec3; 3],
}

/// A patch at one point, with its derivatives by the weights of the second and the third corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    pub(super) point: DVec3,
    pub(super) tangents: [DVec3; 2],
    /// Second derivatives: twice by the second weight, by both, and twice by the third. The same everywhere.
    pub(super) seconds: [DVec3; 3],
}

impl Patch {
    /// The patch of a triangle in the frame of its pair.
    #[must_use]
    pub fn of(side: &SurfaceSide<'_>, triangle: u32) -> Self {
        let corners = side.corners(triangle);
        let Some(curved) = side.curved else { return Self { corners, offsets: [DVec3::ZERO; 3] } };
        let offsets = curved.of_triangle(triangle).map(|offset| {
            let offset = offset.as_dvec3();
            side.moved.map_or(offset, |moved| moved.pose.transform_direction(offset) * moved.pose.scale())
        });
        Self { corners, offsets }
    }

    /// The point with these weights of the corners, which sum to 1.
    #[must_use]
    pub fn point(&self, weights: &[f64; 3]) -> DVec3 {
        let [a, b, c] = *weights;
        let [first, second, third] = self.offsets;
        point_at(&self.corners, weights) + first * (a * b) + second * (b * c) + third * (c * a)
    }

    /// The unit normal there, on the side of the triangle's. Zero if there is none.
    #[must_use]
    pub fn normal(&self, weights: &[f64; 3]) -> DVec3 {
        let [along_second, along_third] = self.tangents(weights);
        along_second.cross(along_third).normalize_or_zero()
    }

    fn tangents(&self, &[a, b, c]: &[f64; 3]) -> [DVec3; 2] {
        let [p, q, r] = self.corners;
        let [first, second, third] = self.offsets;
        [q - p + first * (a - b) + (second - third) * c, r - p + third * (a - c) + (second - first) * b]
    }

    pub(super) fn local(&self, weights: &[f64; 3]) -> Local {
        let [first, second, third] = self.offsets;
        Local {
            point: self.point(weights),
            tangents: self.tangents(weights),
            seconds: [first * -2.0, second - first - third, third * -2.0],
        }
    }

    /// The longest edge of the triangle.
    pub(super) fn size(&self) -> f64 {
        let [p, q, r] = self.corners;
        p.distance_squared(q).max(q.distance_squared(r)).max(r.distance_squared(p)).sqrt()
    }
}
