//! First impacts of two moving meshes, or of one with itself: from positions at both ends of a step to a sorted list.
//!
//! Continuous detection as a whole, for a caller that keeps one [`SweepTree`] per mesh: the boxes that triangles sweep,
//! then known distances at the start, then [`first_impacts`]. Only fast triangles are swept, so the cost of a step
//! depends on how many there are.

use std::ops::Range;

use glam::DVec3;

use super::{
    pair_list::{MovingSide, PairImpact, feature_impacts, first_impacts, impacts_with_solid},
    stars::PlainStars,
    sweep_tree::{SweepTree, outward_box, rounded_up},
    triangle_pair::{MovingTriangle, has_features},
};
use crate::kernel::{
    bvh::{
        leaf_triangles::{LeafTriangles, PairCull},
        tree::{BoxTree, LEAF_WIDTH},
    },
    mesh::{
        bounds::{Aabb, pairs_between_brute_force},
        topology::{SurfaceTopology, share_corner},
    },
    simd::parallel::{LEAST_SHARE, Parallel, Sequential},
};

/// Leaves of eight triangles whose pairs are found and tested at a time. Limits how many candidates wait.
pub const SWEEP_PART: usize = 4;

/// Leaves of a side's tree, or as many triangles as they have, that are looked at in one task.
const LEAVES_OF_PART: usize = 128;

/// A convex solid with more triangles than a part can have is queried, so that all its pairs with a triangle are tested
/// together.
const MANY_TRIANGLES: usize = SWEEP_PART * LEAF_WIDTH;

/// A mesh whose vertices move in straight lines from the start of a step to its end.
///
/// All positions of one sweep are in one frame, the same for both meshes and for both ends.
#[derive(Clone, Copy, Debug)]
pub struct SweptMesh<'a> {
    /// Its triangles.
    pub topology: &'a SurfaceTopology,
    /// Its vertices at the start of the step.
    pub start: &'a [DVec3],
    /// Its vertices at the end of the step. May be the same slice, if the mesh is at rest.
    pub end: &'a [DVec3],
    /// A common motion of its vertices, such as [`drift`] or zero. Boxes are those in a frame that moves by it, so that they
    /// become smaller and fewer triangles are fast. Impacts are the same with any.
    pub drift: DVec3,
    /// A triangle is fast if one of its vertices moves farther than this, in the frame in which a pair of meshes is swept:
    /// that of the larger one's drift. 0 or more, and infinite if no triangle is fast.
    ///
    /// Pairs in which neither triangle is fast are not tested. If such a pair passes through each other, the triangles
    /// are within the sum of both reaches at the start and at the end of the step, because one can move no farther than
    /// that relative to the other. This holds in any frame.
    pub reach: f64,
}

impl SweptMesh<'_> {
    /// The corners of a triangle at both ends of the step.
    #[must_use]
    pub fn triangle(&self, triangle: u32) -> MovingTriangle {
        let vertices = self.topology.triangles()[triangle as usize];
        let corners = |positions: &[DVec3]| vertices.map(|vertex| positions[vertex as usize]);
        MovingTriangle { start: corners(self.start), end: corners(self.end) }
    }

    fn side(&self) -> MovingSide<'_, DVec3> {
        MovingSide { topology: self.topology, start: self.start, end: self.end }
    }
}

/// The common motion of the vertices: their mean motion. Zero if there are no vertices, if a motion is not finite, and
/// if the vertices would move no less without it, as when most of them rest while some move.
///
/// In a frame that moves by it, paths stay straight and impacts stay the same, boxes become smaller, and fewer triangles
/// are fast.
#[must_use]
pub fn drift(start: &[DVec3], end: &[DVec3]) -> DVec3 {
    let motions = || start.iter().zip(end).map(|(start, end)| *end - *start);
    let mean = motions().sum::<DVec3>() / start.len().min(end.len()) as f64;
    let ways = motions().fold([DVec3::ZERO; 2], |[at_rest, drifting], motion| {
        [at_rest + motion.abs(), drifting + (motion - mean).abs()]
    });
    let [at_rest, drifting] = ways.map(DVec3::element_sum);
    // Written so that NaN becomes zero.
    if drifting < at_rest { mean } else { DVec3::ZERO }
}

/// Which impacts a sweep lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImpactList {
    /// The first impact of each pair of triangles.
    Triangles,
    /// The impact of each pair of features, a vertex and a face or two edges, in one of the pairs of triangles around them,
    /// and the pairs of triangles that cross at the start. If welded vertices of a mesh are apart, or a coordinate is not
    /// finite, this lists what `Triangles` does.
    Features,
    /// Like `Features`, if the second mesh encloses a convex solid, and what is behind the first impact of a triangle of the
    /// first mesh does not matter: most of that is left out.
    Solid,
}

/// Two meshes that are swept against each other, or one against itself, with their boxes.
#[derive(Clone, Copy, Debug)]
pub struct Sweep<'a> {
    /// The first mesh and its boxes, which must be [up to date](SweepTree::update).
    pub a: (SweptMesh<'a>, &'a SweepTree),
    /// The second mesh and its boxes. The same as the first in a sweep of one mesh against itself.
    pub b: (SweptMesh<'a>, &'a SweepTree),
    /// Whether both are one surface. If so, triangles are paired once, the lower one first, and features that share a
    /// welded vertex are left out.
    pub same_surface: bool,
    /// Which impacts are listed.
    pub list: ImpactList,
    /// The distance that counts as an impact, 0 or more.
    pub separation: f64,
}

/// The triangles of one side that may meet the other side, in leaves.
#[derive(Clone, Debug, Default)]
pub struct SweepLeaves {
    items: Vec<(u32, Aabb)>,
    /// The items of parts of the side. Only used while they are collected.
    parts: Vec<Vec<(u32, Aabb)>>,
    leaves: BoxTree,
    /// For one surface that is swept against itself: which of its triangles are in the leaves.
    has: Vec<bool>,
    /// Likewise, what is known of its stars.
    stars: PlainStars,
    /// Likewise, the pairs of triangles with a common vertex that have to be tested, the lower one first.
    around: Vec<[u32; 2]>,
    /// Likewise, the vertices of the triangles in the leaves, and of those in the tree that is queried.
    triangles: [LeafTriangles; 2],
}

impl SweepLeaves {
    /// The number of leaves, into which [`Sweep::append_part`] can be split.
    #[must_use]
    pub fn len(&self) -> usize {
        self.leaves.leaf_count()
    }

    /// Whether nothing can meet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Sweep<'_> {
    /// Whether the first side is cut into leaves, and the tree of the second one is queried. Of two meshes, the larger
    /// one's tree is queried, if it is up to date, or that of a large convex solid.
    fn asks_second(&self) -> bool {
        let size = |tree: &SweepTree| (tree.tree().is_some(), tree.boxes().len());
        let is_large = self.list == ImpactList::Solid && size(self.b.1) > (true, MANY_TRIANGLES);
        self.same_surface || is_large || size(self.b.1) >= size(self.a.1)
    }

    /// The side that is cut into leaves, and the side whose tree is queried. The pair is swept in the frame of the latter.
    fn sides(&self) -> [&SweepTree; 2] {
        if self.asks_second() { [self.a.1, self.b.1] } else { [self.b.1, self.a.1] }
    }

    /// How the frame of the pair moves relative to that of the side that is cut into leaves.
    fn way_of_frame(&self) -> DVec3 {
        let [own, other] = self.sides();
        other.drift() - own.drift()
    }

    /// A box around [that way](Self::way_of_frame).
    fn box_of_way(&self) -> Aabb {
        outward_box([DVec3::ZERO, self.way_of_frame()])
    }

    /// The box of a triangle of the side that is cut into leaves, in the frame of the pair, whose way a box encloses, grown by
    /// the separation.
    fn grown_box(&self, triangle: u32, way: &Aabb) -> Aabb {
        let [own, _] = self.sides();
        own.boxes()[triangle as usize].moved_along(way, rounded_up(self.separation))
    }

    /// Finds the triangles of one side that may meet the other side, in tasks that `parallel` may distribute.
    ///
    /// # Panics
    /// If a mesh and its boxes do not have the same number of triangles.
    pub fn collect(&self, parallel: &impl Parallel, leaves: &mut SweepLeaves) {
        for (mesh, tree) in [&self.a, &self.b] {
            assert_eq!(mesh.topology.triangles().len(), tree.boxes().len(), "the boxes are updated before a sweep");
        }
        leaves.items.clear();
        leaves.has.clear();
        leaves.around.clear();
        let [own, other] = self.sides();
        if self.same_surface {
            // Of every pair, at least one.
            let is_all_asked = own.is_all_asked();
            let has = |triangle: u32| if is_all_asked { own.is_fast(triangle, 0.0) } else { own.is_asked(triangle) };
            leaves.has.extend((0..own.boxes().len() as u32).map(has));
        }
        let farther = self.way_of_frame().length();
        let way = self.box_of_way();
        let SweepLeaves { items, parts, has, .. } = &mut *leaves;
        let needed = |triangle: u32| {
            let bounds = self.grown_box(triangle, &way);
            let is_needed = if self.same_surface {
                has[triangle as usize]
            } else {
                bounds.overlaps(if own.is_fast(triangle, farther) { other.bounds() } else { other.fast_bounds() })
                    && (own.is_asked(triangle) || bounds.overlaps(other.asked_bounds()))
            };
            is_needed.then_some((triangle, bounds))
        };
        // In the order of the tree, the triangles of a leaf are near each other.
        let count = own.boxes().len();
        let leaf_count = own.tree().map_or(count.div_ceil(LEAF_WIDTH), BoxTree::leaf_count);
        let part_count = leaf_count.div_ceil(LEAVES_OF_PART);
        parts.resize_with(parts.len().max(part_count), Vec::new);
        let parts = &mut parts[..part_count];
        parallel.run_tasks(parts.iter_mut().enumerate(), count / LEAST_SHARE, |(part, found)| {
            found.clear();
            let first = part * LEAVES_OF_PART;
            for leaf in first..(first + LEAVES_OF_PART).min(leaf_count) {
                if let Some(tree) = own.tree() {
                    found.extend(tree.leaf_items(leaf).iter().filter_map(|&item| needed(item)));
                } else {
                    let next = count.min((leaf + 1) * LEAF_WIDTH);
                    found.extend(((leaf * LEAF_WIDTH) as u32..next as u32).filter_map(needed));
                }
            }
        });
        items.extend(parts.iter().flatten());
        leaves.leaves.collect_leaves(&leaves.items);
        if self.same_surface && !leaves.items.is_empty() {
            let SweepLeaves { leaves, has, stars, around, triangles: [triangles, of_tree], .. } = leaves;
            let has = |triangle: u32| has[triangle as usize];
            stars.find(parallel, &self.a.0, self.separation, has);
            stars.append_pairs(self.a.0.topology, has, around);
            around.retain(|pair| pair.iter().all(|&triangle| own.has_box(triangle)));
            if let Some(tree) = own.tree() {
                triangles.name_vertices(leaves, self.a.0.topology);
                of_tree.name_vertices(tree, self.a.0.topology);
            }
        }
    }

    /// Appends the first impact of each pair with a triangle in some leaves. Returns the number of pairs that were looked at
    /// one by one.
    ///
    /// All parts together, in any order, append what [`sweep`] finds before it sorts.
    pub fn append_part(
        &self,
        leaves: &SweepLeaves,
        part: Range<usize>,
        candidates: &mut Vec<[u32; 2]>,
        impacts: &mut Vec<PairImpact>,
    ) -> usize {
        candidates.clear();
        let [own, other] = self.sides();
        let around = {
            let share = |leaf: usize| leaf * leaves.around.len() / leaves.len();
            &leaves.around[share(part.start)..share(part.end)]
        };
        if let Some(tree) = other.tree() {
            let cull = self.same_surface.then_some(PairCull {
                triangles: leaves.triangles.each_ref(),
                neighbors: true,
                slabs: f32::INFINITY,
                search_from: &[],
                planes_only: false,
            });
            leaves.leaves.pairs_of(part, tree, cull.as_ref(), candidates);
        } else {
            let items: Vec<u32> = part.flat_map(|leaf| leaves.leaves.leaf_items(leaf)).copied().collect();
            let way = self.box_of_way();
            let boxes: Vec<Aabb> = items.iter().map(|&item| self.grown_box(item, &way)).collect();
            pairs_between_brute_force(&boxes, other.boxes(), candidates);
            for pair in &mut *candidates {
                pair[0] = items[pair[0] as usize];
            }
            if self.same_surface {
                let corners = self.a.0.topology.welded_triangles();
                candidates.retain(|&[a, b]| !share_corner(corners[a as usize], corners[b as usize]));
            }
        }
        let (asks_second, farther) = (self.asks_second(), self.way_of_frame().length());
        let is_requested = |[first, second]: [u32; 2]| {
            (own.is_fast(first, farther) || other.is_fast(second, 0.0))
                && (own.is_asked(first) || other.is_asked(second))
        };
        let mut count = 0;
        candidates.retain_mut(|pair| {
            let [first, second] = *pair;
            if self.same_surface {
                *pair = [first.min(second), first.max(second)];
                if first == second || first > second && leaves.has[second as usize] {
                    return false;
                }
            } else if !asks_second {
                *pair = [second, first];
            }
            if !is_requested([first, second]) {
                return false;
            }
            count += 1;
            self.may_meet(*pair)
        });
        let others = candidates.len();
        candidates.extend(around.iter().filter(|&&pair| is_requested(pair)));
        count += candidates.len() - others;
        let (a, b) = (self.a.0.side(), self.b.0.side());
        match self.kept_list() {
            ImpactList::Solid => impacts_with_solid(&a, &b, candidates, self.separation, impacts),
            ImpactList::Features => feature_impacts(&a, &b, self.same_surface, candidates, self.separation, impacts),
            ImpactList::Triangles => first_impacts(&a, &b, self.same_surface, candidates, self.separation, impacts),
        }
        count
    }

    /// Which impacts are listed of meshes that may be torn.
    fn kept_list(&self) -> ImpactList {
        let are_whole = self.a.1.is_whole() && self.b.1.is_whole();
        if are_whole { self.list } else { ImpactList::Triangles }
    }

    /// Whether two triangles without a common vertex may meet in features that this pair tests, given what is known of their
    /// distance at the start.
    fn may_meet(&self, [a, b]: [u32; 2]) -> bool {
        let ((mesh_a, tree_a), (mesh_b, tree_b)) = (&self.a, &self.b);
        let (Some(reach_a), Some(reach_b)) = (tree_a.known_reach(a), tree_b.known_reach(b)) else { return true };
        let clear = reach_a + reach_b - self.separation;
        if clear <= 0.0 {
            return true;
        }
        let tested = [mesh_a.side().firsts(a), mesh_b.side().firsts(b)];
        if self.kept_list() != ImpactList::Triangles && !has_features(tested) {
            return false;
        }
        let [motions_a, motions_b] = [mesh_a.triangle(a).motions(), mesh_b.triangle(b).motions()];
        let sum = |[a, b, c]: [DVec3; 3]| a + b + c;
        let common = (sum(motions_a) + sum(motions_b)) * (1.0 / 6.0);
        let squared = |[a, b, c]: [DVec3; 3]| {
            let squared = |motion: DVec3| (motion - common).length_squared();
            squared(a).max(squared(b)).max(squared(c))
        };
        squared(motions_a).sqrt() + squared(motions_b).sqrt() >= clear
    }
}

/// The buffers of [`sweep`], kept for their memory.
#[derive(Clone, Debug, Default)]
pub struct SweepBuffers {
    leaves: SweepLeaves,
    candidates: Vec<[u32; 2]>,
}

/// Appends the first impact of each pair of triangles that comes within `separation`, if at least one of the two is
/// fast. Impacts are sorted by the triangle of the first mesh, then by that of the second. Returns the number of pairs
/// that were looked at one by one.
///
/// Both trees must be [updated](SweepTree::update) to the current meshes. The tree over the larger mesh should follow
/// its boxes too ([`SweepTree::update_tree`]), otherwise each of its boxes is tested for each triangle of the other
/// mesh. If `same_surface` is set, both meshes are the same, triangles that share welded vertices meet by features that
/// do not, and the lower triangle comes first. A time is never later than the first time at which the distance of two
/// triangles is at most `separation`, 0 or more. This does not account for positions that the caller has rounded: add
/// that error to `separation`.
///
/// ```
/// use bevy_circumsphere::kernel::{
///     ccd::{SweepBuffers, SweepTree, SweptMesh, sweep},
///     mesh::topology::SurfaceTopology,
/// };
/// use glam::{DVec3, Vec3};
///
/// let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let topology = SurfaceTopology::new(&corners, &[[0, 1, 2]])?;
/// let floor = corners.map(Vec3::as_dvec3);
/// let [above, below] = [1.0, -3.0].map(|height| floor.map(|corner| corner + DVec3::Z * height));
/// let resting = SweptMesh { topology: &topology, start: &floor, end: &floor, drift: DVec3::ZERO, reach: 0.01 };
/// let falling = SweptMesh { start: &above, end: &below, ..resting };
/// let mut trees = [SweepTree::default(), SweepTree::default()];
/// trees[0].update(&resting);
/// trees[0].update_tree();
/// trees[1].update(&falling);
/// let mut impacts = Vec::new();
/// sweep(&resting, &trees[0], &falling, &trees[1], false, 0.0, &mut SweepBuffers::default(), &mut impacts);
/// assert!((impacts[0].impact.time - 0.25).abs() < 1.0e-12);
/// # Ok::<(), bevy_circumsphere::kernel::mesh::validation::TopologyError>(())
/// ```
///
/// # Panics
/// If a mesh and its boxes do not have the same number of triangles.
#[expect(clippy::too_many_arguments, reason = "two sides, how to sweep them, and the caller's buffers")]
pub fn sweep(
    a: &SweptMesh<'_>,
    tree_a: &SweepTree,
    b: &SweptMesh<'_>,
    tree_b: &SweepTree,
    same_surface: bool,
    separation: f64,
    buffers: &mut SweepBuffers,
    impacts: &mut Vec<PairImpact>,
) -> usize {
    let sweep = Sweep { a: (*a, tree_a), b: (*b, tree_b), same_surface, list: ImpactList::Triangles, separation };
    sweep.collect(&Sequential, &mut buffers.leaves);
    let (first, mut candidates) = (impacts.len(), 0);
    let count = buffers.leaves.len();
    for start in (0..count).step_by(SWEEP_PART) {
        let part = start..(start + SWEEP_PART).min(count);
        candidates += sweep.append_part(&buffers.leaves, part, &mut buffers.candidates, impacts);
    }
    sort_impacts(&mut impacts[first..]);
    candidates
}

/// Sorts impacts into the order of [`sweep`], those of one pair by their features.
pub fn sort_impacts(impacts: &mut [PairImpact]) {
    impacts.sort_unstable_by_key(|found| (found.triangle_a, found.triangle_b, found.impact.features));
}
