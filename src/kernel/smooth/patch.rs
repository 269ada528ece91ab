//! The quadratic patch over a triangle of a smooth surface, see [`curved_edges`](crate::kernel::mesh::curved_edges).

use glam::{DAffine3, DVec3};

use crate::kernel::{
    mesh::{barycentric::point_at, curved_edges::MOST_OF_EDGE},
    pair::SurfaceSide,
};

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
        let Some(curved) = side.curved else { return Self::flat(corners) };
        let offsets = curved.of_triangle(triangle).map(|offset| {
            let offset = offset.as_dvec3();
            side.moved.map_or(offset, |moved| moved.pose.transform_direction(offset) * moved.pose.scale())
        });
        Self { corners, offsets }
    }

    /// A flat one.
    #[must_use]
    pub const fn flat(corners: [DVec3; 3]) -> Self {
        Self { corners, offsets: [DVec3::ZERO; 3] }
    }

    /// Whether it is its triangle.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.offsets == [DVec3::ZERO; 3]
    }

    /// The patch in another frame.
    #[must_use]
    pub fn moved(&self, into: &DAffine3) -> Self {
        Self {
            corners: self.corners.map(|corner| into.transform_point3(corner)),
            offsets: self.offsets.map(|offset| into.transform_vector3(offset)),
        }
    }

    /// How far it may be from its triangle.
    #[must_use]
    pub fn height(&self) -> f64 {
        let [first, second, third] = self.offsets.map(DVec3::length_squared);
        first.max(second).max(third).sqrt() * f64::from(MOST_OF_EDGE) * (1.0 + 4.0 * f64::EPSILON)
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

/// A part of a patch: again a patch, over a triangle of its weights.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) struct PatchPart {
    pub(in crate::kernel) patch: Patch,
    /// The weights of its corners in the whole patch.
    pub(in crate::kernel) weights: [[f64; 3]; 3],
}

impl PatchPart {
    pub(in crate::kernel) const fn whole(patch: Patch) -> Self {
        Self { patch, weights: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] }
    }

    /// The four parts between the corners and the middles of the edges. Along lines that are half as long, offsets are a
    /// quarter. What lies on an edge depends on nothing but that edge, so parts of neighbors join without gaps.
    pub(in crate::kernel) fn halved(&self) -> [Self; 4] {
        let Self { patch: Patch { corners: [a, b, c], offsets }, weights: [at_a, at_b, at_c] } = self;
        let offsets = offsets.map(|offset| offset * 0.25);
        let [ab, bc, ca] = [(a + b) * 0.5 + offsets[0], (b + c) * 0.5 + offsets[1], (c + a) * 0.5 + offsets[2]];
        let between =
            |one: &[f64; 3], other: &[f64; 3]| std::array::from_fn(|corner| 0.5 * (one[corner] + other[corner]));
        let [at_ab, at_bc, at_ca] = [between(at_a, at_b), between(at_b, at_c), between(at_c, at_a)];
        let part = |corners, weights| Self { patch: Patch { corners, offsets }, weights };
        [
            part([*a, ab, ca], [*at_a, at_ab, at_ca]),
            part([ab, *b, bc], [at_ab, *at_b, at_bc]),
            part([ca, bc, *c], [at_ca, at_bc, *at_c]),
            part([bc, ca, ab], [at_bc, at_ca, at_ab]),
        ]
    }

    /// The length of its edges, by weights: 1 for a whole patch.
    pub(in crate::kernel) fn size(&self) -> f64 {
        (0..3).map(|corner| (self.weights[0][corner] - self.weights[1][corner]).abs()).fold(0.0, f64::max)
    }

    /// The weights in the whole patch of a point with these weights in the part.
    pub(in crate::kernel) fn in_whole(&self, own: &[f64; 3]) -> [f64; 3] {
        std::array::from_fn(|corner| (0..3).map(|k| own[k] * self.weights[k][corner]).sum())
    }
}
