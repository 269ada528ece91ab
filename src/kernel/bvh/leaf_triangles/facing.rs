//! How the triangles of a leaf look against a direction.

use fearless_simd::prelude::*;
use glam::Vec3;

use super::{Block, LeafTriangles, NO_VERTEX, NORMAL_ROUNDING, splat};
use crate::kernel::simd::lanes::fused::{cross, dot, minus};

impl LeafTriangles {
    /// The sum of the normals of a leaf's triangles.
    pub(in crate::kernel::bvh) fn sum_of_normals(&self, leaf: usize) -> Vec3 {
        self.blocks[leaf].normals.map(|row| row.into_iter().sum()).into()
    }

    /// Whether all triangles of a leaf, seen against `axis`, a unit vector, are counter-clockwise, and their altitudes
    /// longer than `range`.
    pub(in crate::kernel::bvh) fn has_longer_altitudes(&self, leaf: usize, axis: Vec3, range: f32) -> bool {
        let used = self.vertices[leaf].0[0].map(|vertex| vertex != NO_VERTEX);
        let used = used.into_iter().rev().fold(0, |bits, is_used| bits << 1 | u32::from(is_used));
        dispatch!(simd => self.blocks[leaf].longer_altitudes(simd, axis, range) & used == used)
    }
}

impl Block {
    /// One bit for each triangle that, seen against `axis`, is counter-clockwise and has altitudes longer than `range`.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn longer_altitudes<S: Simd>(&self, simd: S, axis: Vec3, range: f32) -> u32 {
        let [a, b, c] = [self.corner(simd, 0), self.corner(simd, 1), self.corner(simd, 2)];
        let (u, v, w) = (minus(b, a), minus(c, a), minus(c, b));
        let twice_area = dot(cross(u, v), splat(simd, axis.to_array()));
        // Sides are no longer in the plane than in space.
        let longest = dot(u, u).max(dot(v, v)).max(dot(w, w)).sqrt();
        let needed = longest * range + self.extent * self.extent * NORMAL_ROUNDING;
        twice_area.simd_gt(needed).to_bitmask() as u32
    }
}
