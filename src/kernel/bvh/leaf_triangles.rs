//! The triangles of a tree's leaves with their planes, eight side by side, by which a traversal drops pairs before they
//! are created.
//!
//! A triangle of one leaf is compared with the eight of another one without gathering. Neighbors are found by their
//! vertices. Other pairs are tested by slabs along the normals of both planes and along the line between the centroids.
//! The remaining pairs are tested by slabs along better and better directions, which an iteration finds from one
//! triangle to the other. If the projections of two triangles on a unit vector are farther apart than some distance, so
//! are the triangles, however the vector was rounded. Everything is relative to the center of the leaf, so rounding
//! depends on the size and distance of the leaves, wherever the surface is.

mod close_pairs;
mod facing;
mod lane_numbers;
mod leaf_mesh;
mod lower_bounds;

use fearless_simd::{f32x8, prelude::*, u32x8};
use glam::Vec3;

pub(in crate::kernel) use self::close_pairs::{ClosePairs, Groups};
use self::lane_numbers::LaneNumbers;
pub use self::leaf_mesh::LeafMesh;
use super::tree::{BoxTree, LEAF_WIDTH};
use crate::kernel::{
    mesh::{bounds::Aabb, topology::SurfaceTopology},
    simd::{
        approach::Corners,
        lanes::{
            LARGEST_EXTENT,
            fused::{cross, dot, minus, plus, project},
        },
        parallel::{Parallel, Sequential},
        prefetch::prefetch_whole,
        slab::{LEAST_SQUARED, RANGE_SLACK, ROUNDING},
    },
};

/// The error of an f32 normal, relative to the square of the leaf's extent: for both edges some units in the last place
/// of the extent (6e-8 each), times the other edge.
const NORMAL_ROUNDING: f32 = 5.0e-7;

/// Leaves that one task updates.
const BLOCKS_AT_ONCE: usize = 1024;

/// How many leaves are gathered before the first of them is read again in whole rows. A processor stalls on rows that
/// it has just written number by number.
const GATHERED_AHEAD: usize = 16;

/// How many blocks ahead of the written one to prefetch.
const BLOCKS_AHEAD: usize = 4;

/// Marks the corners of an unused lane. Not a vertex of any triangle.
const NO_VERTEX: u32 = u32::MAX;

type Row = [f32; LEAF_WIDTH];

/// The triangles of one leaf.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Block {
    /// By corner and axis, relative to `origin`.
    corners: [[Row; 3]; 3],
    /// Unit vectors except for rounding, or zero if a triangle has practically no area.
    normals: [Row; 3],
    /// The interval of each triangle's own projections on its normal.
    low: Row,
    high: Row,
    /// How far each normal may be from the one in f64, as a sine. Too large to be useful where there is no normal.
    doubt: Row,
    origin: Vec3,
    /// No projection of a corner on a unit vector exceeds this.
    extent: f32,
    /// How far the patches of the triangles may be from them. 0 if they are flat.
    height: f32,
}

impl Block {
    const EMPTY: Self = Self {
        corners: [[[0.0; LEAF_WIDTH]; 3]; 3],
        normals: [[0.0; LEAF_WIDTH]; 3],
        low: [0.0; LEAF_WIDTH],
        high: [0.0; LEAF_WIDTH],
        doubt: [0.0; LEAF_WIDTH],
        origin: Vec3::ZERO,
        extent: 0.0,
        height: 0.0,
    };
}

/// The welded vertices of the triangles of one leaf, corner by corner.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Vertices([[u32; LEAF_WIDTH]; 3]);

/// Where triangles are needed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Region {
    /// In every leaf.
    Everywhere,
    /// In leaves whose boxes overlap a box.
    Within(Aabb),
}

/// Whether a leaf's triangles are up to date.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LeafState {
    Old,
    Needed,
    Current,
}

/// The triangles of a [`BoxTree`]'s leaves.
#[derive(Clone, Debug, Default)]
pub struct LeafTriangles {
    blocks: Vec<Block>,
    states: Vec<LeafState>,
    vertices: Vec<Vertices>,
    /// The leaves of a region.
    found: Vec<u32>,
}

impl LeafTriangles {
    /// Updates the triangles to the leaves of `tree`, which is over the triangles of `mesh`.
    pub fn update(&mut self, tree: &BoxTree, mesh: &LeafMesh<'_>) {
        self.update_on(&Sequential, tree, mesh);
    }

    /// Like [`update`](Self::update), in tasks that `parallel` may distribute.
    pub fn update_on(&mut self, parallel: &impl Parallel, tree: &BoxTree, mesh: &LeafMesh<'_>) {
        self.name_vertices(tree, mesh.topology);
        self.begin_update(tree);
        self.update_within(parallel, tree, &[Region::Everywhere], mesh);
    }

    /// Stores the vertices of the triangles in `tree`'s leaves, which is all that is needed without slabs. They stay
    /// valid until items move to other leaves.
    pub(crate) fn name_vertices(&mut self, tree: &BoxTree, topology: &SurfaceTopology) {
        self.vertices.clear();
        self.vertices.extend((0..tree.leaf_count()).map(|leaf| {
            let mut vertices = Vertices([[NO_VERTEX; LEAF_WIDTH]; 3]);
            for (lane, &triangle) in tree.leaf_items(leaf).iter().enumerate() {
                for (corner, &vertex) in topology.welded_triangles()[triangle as usize].iter().enumerate() {
                    vertices.0[corner][lane] = vertex;
                }
            }
            vertices
        }));
    }

    /// Marks all triangles as out of date, after those in the leaves of `tree` have moved.
    pub(crate) fn begin_update(&mut self, tree: &BoxTree) {
        self.blocks.resize(tree.leaf_count(), Block::EMPTY);
        self.states.clear();
        self.states.resize(tree.leaf_count(), LeafState::Old);
    }

    /// Updates the triangles in the leaves of `tree` that are needed and out of date, in tasks that `parallel` may
    /// distribute. The vertices of all leaves must have been [stored](Self::name_vertices).
    pub(crate) fn update_within(
        &mut self,
        parallel: &impl Parallel,
        tree: &BoxTree,
        regions: &[Region],
        mesh: &LeafMesh<'_>,
    ) {
        let Self { blocks, states, found, .. } = self;
        let mut requested_count = 0_usize;
        let mut ask = |state: &mut LeafState| {
            if *state == LeafState::Old {
                *state = LeafState::Needed;
                requested_count += 1;
            }
        };
        for region in regions {
            match region {
                Region::Everywhere => states.iter_mut().for_each(&mut ask),
                Region::Within(bounds) => {
                    found.clear();
                    tree.leaves_within(bounds, found);
                    for &leaf in &*found {
                        ask(&mut states[leaf as usize]);
                    }
                }
            }
        }
        if requested_count == 0 {
            return;
        }
        let tasks = blocks.chunks_mut(BLOCKS_AT_ONCE).zip(states.chunks_mut(BLOCKS_AT_ONCE)).enumerate();
        parallel.run_tasks(tasks, requested_count.div_ceil(BLOCKS_AT_ONCE), |(task, (blocks, states))| {
            dispatch!(simd => {
                for first in (0..blocks.len()).step_by(GATHERED_AHEAD) {
                    let end = (first + GATHERED_AHEAD).min(blocks.len());
                    for place in first..end {
                        if states[place] == LeafState::Needed {
                            prefetch_whole(blocks, place + BLOCKS_AHEAD);
                            blocks[place].gather(tree, task * BLOCKS_AT_ONCE + place, mesh);
                        }
                    }
                    for place in first..end {
                        if states[place] == LeafState::Needed {
                            blocks[place].measure_planes(simd);
                            states[place] = LeafState::Current;
                        }
                    }
                }
            });
        });
    }

    /// Whether all needed triangles in the leaves of `tree` are up to date.
    pub(crate) fn are_current(&self, tree: &BoxTree, region: Region) -> bool {
        let is_current = |state: &LeafState| *state == LeafState::Current;
        match region {
            Region::Everywhere => self.states.iter().all(is_current),
            Region::Within(bounds) => {
                let mut leaves = Vec::new();
                tree.leaves_within(&bounds, &mut leaves);
                leaves.iter().all(|&leaf| self.states.get(leaf as usize).is_some_and(is_current))
            }
        }
    }
}

impl Block {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn corner<S: Simd>(&self, simd: S, corner: usize) -> [f32x8<S>; 3] {
        let [x, y, z] = &self.corners[corner];
        [f32x8::from_slice(simd, x), f32x8::from_slice(simd, y), f32x8::from_slice(simd, z)]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn gather(&mut self, tree: &BoxTree, leaf: usize, mesh: &LeafMesh<'_>) {
        let (triangles, positions) = (mesh.topology.triangles(), mesh.positions);
        let bounds = tree.leaf_bounds(leaf);
        self.origin = (bounds.min + bounds.max) * 0.5;
        self.extent = (bounds.max - bounds.min).element_sum();
        self.height = mesh.height(tree.leaf_items(leaf));
        for (lane, &triangle) in tree.leaf_items(leaf).iter().enumerate() {
            let triangle = triangle as usize;
            for corner in 0..3 {
                let place = positions[triangles[triangle][corner] as usize] - self.origin;
                self.corners[corner][0][lane] = place.x;
                self.corners[corner][1][lane] = place.y;
                self.corners[corner][2][lane] = place.z;
            }
        }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn measure_planes<S: Simd>(&mut self, simd: S) {
        let [a, b, c] = [self.corner(simd, 0), self.corner(simd, 1), self.corner(simd, 2)];
        let (u, v) = (minus(b, a), minus(c, a));
        let normal = cross(u, v);
        let squared = dot(normal, normal);
        let reliable = squared.simd_gt(LEAST_SQUARED) & squared.simd_lt(f32::MAX);
        let scale = reliable.select(f32x8::splat(simd, 1.0) / squared.sqrt(), f32x8::splat(simd, 0.0));
        let normal = [normal[0] * scale, normal[1] * scale, normal[2] * scale];
        // An unreliable normal may be infinite, and infinity times zero is NaN.
        let zero = f32x8::splat(simd, 0.0);
        let normal =
            [reliable.select(normal[0], zero), reliable.select(normal[1], zero), reliable.select(normal[2], zero)];
        let heights = [dot(normal, a), dot(normal, b), dot(normal, c)];
        for axis in 0..3 {
            normal[axis].store_slice(&mut self.normals[axis]);
        }
        let doubt = scale * (self.extent * self.extent * NORMAL_ROUNDING);
        reliable.select(doubt, f32x8::splat(simd, f32::MAX)).store_slice(&mut self.doubt);
        heights[0].min(heights[1]).min(heights[2]).store_slice(&mut self.low);
        heights[0].max(heights[1]).max(heights[2]).store_slice(&mut self.high);
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn splat<S: Simd>(simd: S, [x, y, z]: [f32; 3]) -> [f32x8<S>; 3] {
    [f32x8::splat(simd, x), f32x8::splat(simd, y), f32x8::splat(simd, z)]
}

/// Which pairs a traversal drops.
#[derive(Clone, Copy, Debug)]
pub struct PairCull<'a> {
    /// The triangles of both trees, starting with the tree that is visited leaf by leaf. In a self-collision both are
    /// the same.
    pub triangles: [&'a LeafTriangles; 2],
    /// Drops triangles of one surface that share a welded vertex.
    pub neighbors: bool,
    /// Drops triangles that a slab separates by more than this, in the unit of the positions, 0 or more, and by how far
    /// their patches may be from them. Infinite if slabs drop none. Not an `Option`: compilers multiply its payload before they check whether there is one. An
    /// unset payload may be subnormal, and then each product takes as long as a hundred others.
    pub slabs: f32,
    /// For each leaf of a self-collision, the first leaf from its own on with which it is compared. Empty if all are.
    pub search_from: &'a [u32],
    /// Whether only slabs along the normals count, and only if they hold with the normals in f64. Meant for a method
    /// that tests these slabs itself, so that it drops the same pairs wherever they come from. Otherwise any direction
    /// counts, as it is rounded.
    pub planes_only: bool,
}

impl<'a> PairCull<'a> {
    /// Tells which triangles of two leaves are neighbors. Reports none unless neighbors are to be dropped.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn neighbors_between(&self, leaves: [usize; 2]) -> Neighbors<'a> {
        let [first, second] = self.triangles;
        Neighbors(if self.neighbors {
            Some([&first.vertices[leaves[0]].0, &second.vertices[leaves[1]].0])
        } else {
            None
        })
    }

    /// The first leaf from `leaf` on with which it is compared in a self-collision.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn search_from(&self, leaf: usize) -> u32 {
        self.search_from.get(leaf).copied().unwrap_or(leaf as u32)
    }

    /// Whether slabs drop any pairs.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn has_slabs(&self) -> bool {
        self.slabs < f32::INFINITY
    }

    /// Tells which triangles of two leaves slabs separate. Requires [slabs](Self::has_slabs): otherwise the triangles
    /// of the leaves are not up to date.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn between(&self, leaves: [usize; 2]) -> Separation<'a> {
        debug_assert!(
            (0..2).all(|side| self.triangles[side].states[leaves[side]] == LeafState::Current),
            "a leaf has triangles where they are no longer"
        );
        let (own, other) = (&self.triangles[0].blocks[leaves[0]], &self.triangles[1].blocks[leaves[1]]);
        let offset = own.origin - other.origin;
        let extent = own.extent + other.extent + offset.abs().element_sum();
        let range = self.slabs + own.height + other.height;
        let needed = if extent <= LARGEST_EXTENT { range * RANGE_SLACK + extent * ROUNDING } else { f32::INFINITY };
        Separation { own, other, offset, extent, needed, planes_only: self.planes_only }
    }
}

/// The vertices of the triangles of two leaves, if neighbors are to be dropped.
pub(in crate::kernel) struct Neighbors<'a>(Option<[&'a [[u32; LEAF_WIDTH]; 3]; 2]>);

impl Neighbors<'_> {
    /// Reports no neighbors.
    pub(in crate::kernel) const NONE: Self = Self(None);

    /// The lanes of the second leaf that share a vertex with the triangle in a lane of the first.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of_lane<S: Simd>(&self, simd: S, lane: usize) -> u32 {
        let Some([[a, b, c], others]) = self.0 else { return 0 };
        let (first, second) = (u32x8::from_slice(simd, &others[0]), u32x8::from_slice(simd, &others[1]));
        let third = u32x8::from_slice(simd, &others[2]);
        // Equal numbers have an XOR of 0, so one comparison covers all nine.
        let (a, b, c) = (u32x8::splat(simd, a[lane]), u32x8::splat(simd, b[lane]), u32x8::splat(simd, c[lane]));
        let of_first = (first ^ a).min(first ^ b).min(first ^ c);
        let of_second = (second ^ a).min(second ^ b).min(second ^ c);
        let of_third = (third ^ a).min(third ^ b).min(third ^ c);
        of_first.min(of_second).min(of_third).simd_eq(0).to_bitmask() as u32
    }
}

/// The triangles of two leaves, and what separation tests need.
pub(in crate::kernel) struct Separation<'a> {
    own: &'a Block,
    other: &'a Block,
    /// From the frame of the first leaf to that of the second.
    offset: Vec3,
    /// No projection of a corner on a unit vector exceeds this.
    extent: f32,
    /// A gap wider than this proves that triangles are separated.
    needed: f32,
    planes_only: bool,
}

impl Separation<'_> {
    /// The rounding error of a projection.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn rounding(&self) -> f32 {
        self.extent * ROUNDING
    }

    /// Which of up to eight pairs of lanes are separated, along either normal or along the line between the centroids.
    /// The latter separates triangles that lie side by side in nearly one plane.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn separated<S: Simd>(&self, simd: S, pairs: &LanePairs<S>, corners: &Corners<S>) -> u32 {
        let needed = self.needed;
        if needed == f32::INFINITY {
            return 0;
        }
        let [own_gap, other_gap] = self.plane_gaps(simd, pairs, corners);
        if self.planes_only {
            let own_doubt = pairs.row_of_first(simd, &self.own.doubt);
            let other_doubt = pairs.row_of_second(simd, &self.other.doubt);
            let apart = own_gap.simd_gt(own_doubt * self.extent + needed)
                | other_gap.simd_gt(other_doubt * self.extent + needed);
            return apart.to_bitmask() as u32;
        }
        let by_planes = own_gap.simd_gt(needed) | other_gap.simd_gt(needed);
        let (gap, between) = line_gap(corners);
        let squared = dot(between, between);
        let along_line = gap.simd_gt(squared.sqrt() * needed) & squared.simd_gt(LEAST_SQUARED);
        (by_planes | along_line).to_bitmask() as u32
    }

    /// The corners of the triangles of the first leaf and of the second, in the frame of the second.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn corners<S: Simd>(&self, simd: S, pairs: &LanePairs<S>) -> Corners<S> {
        let [a, b, c] = &self.other.corners;
        let others = [pairs.of_second(simd, a), pairs.of_second(simd, b), pairs.of_second(simd, c)];
        let [a, b, c] = &self.own.corners;
        let offset = splat(simd, self.offset.to_array());
        let corners = [
            plus(pairs.of_first(simd, a), offset),
            plus(pairs.of_first(simd, b), offset),
            plus(pairs.of_first(simd, c), offset),
        ];
        [corners, others]
    }

    /// The gaps between the triangles along the normal of the first, and of the second.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn plane_gaps<S: Simd>(&self, simd: S, pairs: &LanePairs<S>, [corners, others]: &Corners<S>) -> [f32x8<S>; 2] {
        let (own, other) = (self.own, self.other);
        let normal = pairs.of_first(simd, &own.normals);
        let shift = dot(normal, splat(simd, self.offset.to_array()));
        let (low, high) = project(others, normal);
        let (own_low, own_high) = (pairs.row_of_first(simd, &own.low), pairs.row_of_first(simd, &own.high));
        let own_gap = (low - (own_high + shift)).max((own_low + shift) - high);
        let (low, high) = project(corners, pairs.of_second(simd, &other.normals));
        let (other_low, other_high) = (pairs.row_of_second(simd, &other.low), pairs.row_of_second(simd, &other.high));
        [own_gap, (low - other_high).max(other_low - high)]
    }
}

/// The gap between triangles along the line between their centroids, multiplied by the length of the direction, and the
/// direction.
#[cfg_attr(not(unoptimized), inline(always))]
fn line_gap<S: Simd>([corners, others]: &Corners<S>) -> (f32x8<S>, [f32x8<S>; 3]) {
    let between = minus(plus(plus(others[0], others[1]), others[2]), plus(plus(corners[0], corners[1]), corners[2]));
    let ((low, high), (own_low, own_high)) = (project(others, between), project(corners, between));
    ((low - own_high).max(own_low - high), between)
}

/// Eight pairs of a lane of one leaf and a lane of another.
pub(in crate::kernel) struct LanePairs<S: Simd> {
    firsts: LaneNumbers<S>,
    seconds: LaneNumbers<S>,
}

impl<S: Simd> LanePairs<S> {
    /// Each of `pairs` is eight times the lane of the first leaf, plus the lane of the second.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new(simd: S, pairs: &[u32; LEAF_WIDTH]) -> Self {
        let pairs = u32x8::from_slice(simd, pairs);
        Self { firsts: LaneNumbers(pairs >> 3), seconds: LaneNumbers(pairs & 7) }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn items(
        &self,
        simd: S,
        firsts: &[u32; LEAF_WIDTH],
        seconds: &[u32; LEAF_WIDTH],
    ) -> [u32x8<S>; 2] {
        let (firsts, seconds) = (u32x8::from_slice(simd, firsts), u32x8::from_slice(simd, seconds));
        [self.firsts.of(firsts.bitcast()).bitcast(), self.seconds.of(seconds.bitcast()).bitcast()]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn row_of_first(&self, simd: S, row: &Row) -> f32x8<S> {
        self.firsts.of(f32x8::from_slice(simd, row))
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn row_of_second(&self, simd: S, row: &Row) -> f32x8<S> {
        self.seconds.of(f32x8::from_slice(simd, row))
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn of_first(&self, simd: S, [x, y, z]: &[Row; 3]) -> [f32x8<S>; 3] {
        [self.row_of_first(simd, x), self.row_of_first(simd, y), self.row_of_first(simd, z)]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn of_second(&self, simd: S, [x, y, z]: &[Row; 3]) -> [f32x8<S>; 3] {
        [self.row_of_second(simd, x), self.row_of_second(simd, y), self.row_of_second(simd, z)]
    }
}
