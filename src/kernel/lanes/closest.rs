//! The closest features of eight pairs of triangles, as well as f32 can tell.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use super::{Lanes, Mask, VectorLanes, edges};
use crate::kernel::exact::FeatureCase;

/// The shortest connection of two triangles found so far. Of triangles that cross it is that of the closest pair of a
/// vertex and a face or of two edges.
#[derive(Clone, Copy)]
pub(in crate::kernel) struct Connection {
    squared: Lanes,
    /// Between the closest points, either way round.
    pub(in crate::kernel) direction: VectorLanes,
    /// Which features it joins, the bits being the number of a [`FeatureCase`], where that was asked for.
    pub(in crate::kernel) case: Lanes,
}

/// Where a position along an edge is strictly between its ends.
#[inline(always)]
fn inside(along: Lanes) -> Mask {
    along.greater_than(Lanes::ZERO).and(Lanes::splat(1.0).greater_than(along))
}

impl Connection {
    pub(in crate::kernel) const NONE: Self =
        Self { squared: Lanes([f32::INFINITY; super::WIDTH]), direction: VectorLanes::ZERO, case: Lanes::ZERO };

    /// Between the closest features; which they are is found only if `CASE`.
    #[inline(always)]
    pub(in crate::kernel) fn closest<const CASE: bool>(a: &[VectorLanes; 3], b: &[VectorLanes; 3]) -> Self {
        let mut closest = Self::NONE;
        let (edges_a, edges_b) = (edges(a), edges(b));
        closest.vertices_and_edges::<CASE>(a, b, &edges_b, true);
        closest.vertices_and_edges::<CASE>(b, a, &edges_a, false);
        closest.vertices_and_face::<CASE>(a, b, &edges_b, true);
        closest.vertices_and_face::<CASE>(b, a, &edges_a, false);
        for k in 0..3 {
            for l in 0..3 {
                let case = FeatureCase::edges(k, l);
                closest.edges::<CASE>(b[l] - a[k], edges_a[k], edges_b[l], case);
            }
        }
        closest
    }

    #[inline(always)]
    fn offer<const CASE: bool>(
        &mut self,
        possible: Mask,
        squared: Lanes,
        direction: VectorLanes,
        FeatureCase(case): FeatureCase,
    ) {
        let better = possible.and(self.squared.greater_than(squared));
        self.squared = Lanes::select(better, squared, self.squared);
        self.direction = VectorLanes::select(better, direction, self.direction);
        if CASE {
            self.case = Lanes::select(better, Lanes::splat(f32::from_bits(u32::from(case))), self.case);
        }
    }

    #[inline(always)]
    fn vertices_and_edges<const CASE: bool>(
        &mut self,
        vertices: &[VectorLanes; 3],
        corners: &[VectorLanes; 3],
        edges: &[VectorLanes; 3],
        vertices_of_a: bool,
    ) {
        for l in 0..3 {
            let inverse = edges[l].dot(edges[l]).recip();
            for k in 0..3 {
                let from_start = vertices[k] - corners[l];
                let along = (from_start.dot(edges[l]) * inverse).max(Lanes::ZERO).min(Lanes::splat(1.0));
                let connection = from_start - edges[l].scaled(along);
                let squared = connection.dot(connection);
                let possible = self.squared.greater_than(squared);
                self.offer::<CASE>(possible, squared, connection, FeatureCase::vertex_edge(vertices_of_a, k, l));
            }
        }
    }

    #[inline(always)]
    fn vertices_and_face<const CASE: bool>(
        &mut self,
        vertices: &[VectorLanes; 3],
        corners: &[VectorLanes; 3],
        edges: &[VectorLanes; 3],
        vertices_of_a: bool,
    ) {
        let normal = edges[0].cross(edges[1]);
        let inverse = normal.dot(normal).recip();
        let inward = [normal.cross(edges[0]), normal.cross(edges[1]), normal.cross(edges[2])];
        for k in 0..3 {
            let height = normal.dot(vertices[k] - corners[0]);
            let over_face = inward[0]
                .dot(vertices[k] - corners[0])
                .min(inward[1].dot(vertices[k] - corners[1]))
                .min(inward[2].dot(vertices[k] - corners[2]))
                .greater_than(Lanes::ZERO);
            let connection = normal.scaled(height * inverse);
            let case = FeatureCase::vertex_face(vertices_of_a, k);
            self.offer::<CASE>(over_face, height * height * inverse, connection, case);
        }
    }

    /// Two edges, `between` from the start of one to the start of the other.
    #[inline(always)]
    fn edges<const CASE: bool>(&mut self, between: VectorLanes, u: VectorLanes, v: VectorLanes, case: FeatureCase) {
        let normal = u.cross(v);
        let inverse = normal.dot(normal).recip();
        let height = normal.dot(between);
        let along_u = between.cross(v).dot(normal) * inverse;
        let along_v = between.cross(u).dot(normal) * inverse;
        let possible = inside(along_u).and(inside(along_v));
        self.offer::<CASE>(possible, height * height * inverse, normal.scaled(height * inverse), case);
    }
}
