//! Recipes: how a triangle's sphere follows its vertices, and the shape that it was made for, for one triangle and for
//! eight.
//!
//! Where the sphere is, relative to the longest edge, is only recomputed for a triangle whose shape has changed. See
//! `circumsphere`, which stores recipes in blocks of eight.

use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::Vec3;

use super::circumsphere::{
    LongestEdgeFrame, OBTUSE_REACH, RecipeSettings, curvature_factor, edge_lengths, farthest_corner, longest,
};
use crate::kernel::simd::lanes::{EdgeChoice, FrameLanes, TriangleLanes, VectorLanes, WIDTH, load_first, tangent};

/// How one triangle's sphere follows its vertices, and the shape that it was made for.
///
/// The in-plane center is stored as a multiple of half the longest edge, across that edge. Barycentric coordinates
/// would give the same center for the shape that they were made for, but diverge when a thin triangle changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::kernel) struct Recipe {
    pub(in crate::kernel) longest_edge: u8,
    pub(in crate::kernel) inward: f32,
    pub(in crate::kernel) height_ratio: f32,
    lengths: [f32; 3],
    dihedrals: [f32; 3],
    /// The [number of refits](super::circumsphere::OffsetSpheres) when it was made.
    made_at: u32,
}

impl Recipe {
    /// Takes the corners, and the corners relative to the first one.
    pub(in crate::kernel) fn new(
        corners: [Vec3; 3],
        local: [Vec3; 3],
        curvature: f32,
        dihedrals: [f32; 3],
        settings: RecipeSettings,
        made_at: u32,
    ) -> Self {
        let lengths = edge_lengths(corners);
        let edge = longest(lengths);
        let frame = LongestEdgeFrame::new(corners, corners[0], edge);
        let inward = frame.cotangent.max(-OBTUSE_REACH);
        let mut recipe = Self { longest_edge: edge as u8, inward, height_ratio: 0.0, lengths, dihedrals, made_at };
        let Some(normal) = frame.normal else { return recipe };
        let center = frame.point_across(inward);
        let radius = farthest_corner(local, center);
        let factor = curvature_factor(curvature, radius, settings.curvature_threshold);
        let mut height = (settings.sphere_offset * radius * factor).min(f32::MAX);
        for k in 0..3 {
            if dihedrals[k] > 0.0 {
                let edge = corners[(k + 1) % 3] - corners[k];
                let along = if lengths[k] > 0.0 { edge / lengths[k] } else { Vec3::ZERO };
                let clearance = normal.dot(along.cross(center - local[k])).max(0.0);
                height = height.min(clearance / bevy_math::ops::tan(0.5 * dihedrals[k]).abs().max(f32::MIN_POSITIVE));
            }
        }
        if radius > 0.0 {
            recipe.height_ratio = height / radius;
        }
        recipe
    }

    pub(in crate::kernel) fn shape_change(&self, lengths: [f32; 3], dihedrals: [f32; 3]) -> f32 {
        (0..3).fold(0.0, |change: f32, k| {
            // A length of 0 has no relative change: any other length is a new shape.
            let stretch = if self.lengths[k] > 0.0 {
                (lengths[k] / self.lengths[k] - 1.0).abs()
            } else if lengths[k] > 0.0 {
                f32::INFINITY
            } else {
                0.0
            };
            change.max(stretch).max((dihedrals[k] - self.dihedrals[k]).abs())
        })
    }
}

/// The stored recipes of eight triangles. Aligned, so that no row of eight numbers crosses a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
pub(in crate::kernel) struct RecipeBlock {
    /// One bit for each triangle whose longest edge is the second, and one for each whose longest edge is the third.
    longest_edge: [u8; 2],
    inward: [f32; WIDTH],
    height_ratio: [f32; WIDTH],
    lengths: [[f32; WIDTH]; 3],
    dihedrals: [[f32; WIDTH]; 3],
    made_at: [u32; WIDTH],
}

impl RecipeBlock {
    pub(in crate::kernel) const EMPTY: Self = Self {
        longest_edge: [0; 2],
        inward: [0.0; WIDTH],
        height_ratio: [0.0; WIDTH],
        lengths: [[0.0; WIDTH]; 3],
        dihedrals: [[0.0; WIDTH]; 3],
        made_at: [0; WIDTH],
    };

    pub(in crate::kernel) fn made_at(&self, lane: usize) -> u32 {
        self.made_at[lane]
    }

    pub(in crate::kernel) fn get(&self, lane: usize) -> Recipe {
        let [second, third] = self.longest_edge.map(|edge| edge >> lane & 1);
        Recipe {
            longest_edge: second + 2 * third,
            inward: self.inward[lane],
            height_ratio: self.height_ratio[lane],
            lengths: self.lengths.map(|lengths| lengths[lane]),
            dihedrals: self.dihedrals.map(|dihedrals| dihedrals[lane]),
            made_at: self.made_at[lane],
        }
    }

    pub(in crate::kernel) fn set(&mut self, lane: usize, recipe: &Recipe) {
        for (edge, bits) in (1..).zip(&mut self.longest_edge) {
            *bits = *bits & !(1 << lane) | u8::from(recipe.longest_edge == edge) << lane;
        }
        self.inward[lane] = recipe.inward;
        self.height_ratio[lane] = recipe.height_ratio;
        for k in 0..3 {
            self.lengths[k][lane] = recipe.lengths[k];
            self.dihedrals[k][lane] = recipe.dihedrals[k];
        }
        self.made_at[lane] = recipe.made_at;
    }
}

/// The recipes of eight triangles.
pub(in crate::kernel) struct RecipeLanes<S: Simd> {
    pub(in crate::kernel) longest_edge: EdgeChoice<S>,
    pub(in crate::kernel) inward: f32x8<S>,
    pub(in crate::kernel) height_ratio: f32x8<S>,
    lengths: [f32x8<S>; 3],
    dihedrals: [f32x8<S>; 3],
}

impl<S: Simd> RecipeLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn load(simd: S, block: &RecipeBlock) -> Self {
        let ([a, b, c], [d, e, f]) = (&block.lengths, &block.dihedrals);
        Self {
            longest_edge: EdgeChoice::from_bits(simd, block.longest_edge),
            inward: f32x8::from_slice(simd, &block.inward),
            height_ratio: f32x8::from_slice(simd, &block.height_ratio),
            lengths: [f32x8::from_slice(simd, a), f32x8::from_slice(simd, b), f32x8::from_slice(simd, c)],
            dihedrals: [f32x8::from_slice(simd, d), f32x8::from_slice(simd, e), f32x8::from_slice(simd, f)],
        }
    }

    /// Writes all recipes. `made` has a bit for each recipe that was made just now.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn store(&self, block: &mut RecipeBlock, made: u64, made_at: u32) {
        block.longest_edge = self.longest_edge.bits();
        self.inward.store_slice(&mut block.inward);
        self.height_ratio.store_slice(&mut block.height_ratio);
        for k in 0..3 {
            self.lengths[k].store_slice(&mut block.lengths[k]);
            self.dihedrals[k].store_slice(&mut block.dihedrals[k]);
        }
        for (lane, refit) in block.made_at.iter_mut().enumerate() {
            *refit = if made & (1 << lane) == 0 { *refit } else { made_at };
        }
    }

    /// [`Recipe::shape_change`], for lengths that are not 0.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn shape_change(&self, shape: &ShapeLanes<S>) -> f32x8<S> {
        let mut change = f32x8::splat(shape.curvatures.simd, 0.0);
        for k in 0..3 {
            let stretch = (shape.lengths[k] / self.lengths[k] - 1.0).abs();
            change = change.max(stretch).max((shape.dihedrals[k] - self.dihedrals[k]).abs());
        }
        change
    }

    /// Places the in-plane centers by the recipes.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn place(&self, shape: &ShapeLanes<S>) -> PlacedLanes<S> {
        let frame = shape.frame(self.longest_edge);
        PlacedLanes::new(frame, self.inward, shape)
    }

    /// [`Recipe::new`], stored where `stale`. Returns the in-plane centers by recipes that are made now.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn refresh(
        &mut self,
        stale: mask32x8<S>,
        shape: &ShapeLanes<S>,
        settings: &RecipeSettings,
    ) -> PlacedLanes<S> {
        let edge = EdgeChoice::longest(&shape.lengths);
        let frame = shape.frame(edge);
        let inward = frame.cotangent.max(-OBTUSE_REACH);
        let placed = PlacedLanes::new(frame, inward, shape);
        let PlacedLanes { frame, center, farthest: radius, .. } = &placed;
        let (center, radius) = (*center, *radius);
        let bent = shape.curvatures.abs() * radius / settings.curvature_threshold;
        let factor = curvature_factors(bent.max(0.0).min(1.0));
        let mut height = (radius * settings.sphere_offset * factor).min(f32::MAX);
        for k in 0..3 {
            let along = shape.corners.edge(k).over(shape.lengths[k]);
            let clearance = frame.normal.dot(along.cross(center - shape.local.0[k])).max(0.0);
            let dihedral = shape.dihedrals[k].max(0.0);
            let slope = tangent(dihedral * 0.5).max(f32::MIN_POSITIVE);
            height = dihedral.simd_gt(0.0).select(height.min(clearance / slope), height);
        }
        self.longest_edge = edge.where_else(stale, self.longest_edge);
        self.inward = stale.select(inward, self.inward);
        self.height_ratio = stale.select(height / radius, self.height_ratio);
        for k in 0..3 {
            self.lengths[k] = stale.select(shape.lengths[k], self.lengths[k]);
            self.dihedrals[k] = stale.select(shape.dihedrals[k], self.dihedrals[k]);
        }
        placed
    }
}

/// The in-plane centers of eight triangles, relative to their first corners.
pub(in crate::kernel) struct PlacedLanes<S: Simd> {
    pub(in crate::kernel) frame: FrameLanes<S>,
    /// The in-plane center.
    pub(in crate::kernel) center: VectorLanes<S>,
    /// The distance of the farthest corner from the in-plane center.
    pub(in crate::kernel) farthest: f32x8<S>,
    /// Where that is exact.
    pub(in crate::kernel) exact: mask32x8<S>,
}

impl<S: Simd> PlacedLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(frame: FrameLanes<S>, inward: f32x8<S>, shape: &ShapeLanes<S>) -> Self {
        let center = frame.point_across(inward);
        let (farthest, exact_farthest) = shape.local.farthest_corner(center);
        Self { exact: frame.exact & exact_farthest, frame, center, farthest }
    }
}

/// [`curvature_factor`] for numbers from 0 to 1.
#[cfg_attr(not(unoptimized), inline(always))]
fn curvature_factors<S: Simd>(t: f32x8<S>) -> f32x8<S> {
    let one = f32x8::splat(t.simd, 1.0);
    (one - t * 3.0 * t + t * 2.0 * t * t).max(0.0).min(1.0)
}

/// What the recipes of eight triangles are made from and compared with.
pub(in crate::kernel) struct ShapeLanes<S: Simd> {
    pub(in crate::kernel) corners: TriangleLanes<S>,
    /// The corners relative to the first one, so that distance from the origin costs no precision.
    local: TriangleLanes<S>,
    lengths: [f32x8<S>; 3],
    dihedrals: [f32x8<S>; 3],
    curvatures: f32x8<S>,
}

impl<S: Simd> ShapeLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gather(
        simd: S,
        corners: TriangleLanes<S>,
        lengths: [f32x8<S>; 3],
        curvatures: &[f32],
        dihedrals: &[[f32; 3]],
    ) -> Self {
        let dihedrals = VectorLanes::of_arrays(simd, dihedrals);
        Self {
            corners,
            local: corners.relative_to(corners.0[0]),
            lengths,
            dihedrals: [dihedrals.x, dihedrals.y, dihedrals.z],
            curvatures: load_first(simd, curvatures),
        }
    }

    /// The triangles relative to one edge and the first corner.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn frame(&self, edge: EdgeChoice<S>) -> FrameLanes<S> {
        FrameLanes::new(&self.corners, self.corners.0[0], edge, &self.lengths)
    }
}
