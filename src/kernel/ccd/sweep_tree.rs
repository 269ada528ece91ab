//! Boxes that the triangles of a mesh sweep in a step, and a tree over them that is kept from step to step.
//!
//! The broad phase of continuous detection: [`sweep`](super::sweep()) tests the boxes of one mesh against those of
//! another. Only the larger of two meshes needs the tree. A mesh at rest keeps its boxes and its tree.

use glam::{DVec3, Vec3};

use super::sweep::SweptMesh;
use crate::kernel::{bvh::tree::BoxTree, mesh::bounds::Aabb};

/// A tree is rebuilt once its boxes have grown by this factor, relative to the whole.
const REBUILD_DECAY: f32 = 1.5;

/// What [`SweepTree::update_tree`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeWork {
    /// Nothing: the boxes have not changed.
    Kept,
    /// The tree was refitted to boxes that have changed.
    Refitted,
    /// The tree was built, for the first time or because its boxes had grown too large.
    Built,
}

/// The box that each triangle of a mesh sweeps in a step, which of them are fast, and a tree over the boxes.
///
/// Create it with `default`, then [update](Self::update) it whenever an end of the step changes. Its memory is kept.
#[derive(Clone, Debug, Default)]
pub struct SweepTree {
    boxes: Vec<Aabb>,
    fast: Vec<bool>,
    /// The reach of each triangle. Empty unless reaches bound the distances of triangles.
    reaches: Vec<f64>,
    fast_count: usize,
    bounds: Aabb,
    fast_bounds: Aabb,
    tree: BoxTree,
    /// Whether the tree is fitted to the current boxes.
    has_tree: bool,
}

impl SweepTree {
    /// Updates the boxes, and which triangles are fast, in one pass over the triangles. Does not change the tree:
    /// [`update_tree`](Self::update_tree) does.
    ///
    /// Boxes are rounded outward. A triangle with a coordinate that is not finite has no box, and meets nothing.
    ///
    /// # Panics
    /// If the mesh has fewer positions than its triangles name.
    pub fn update(&mut self, mesh: &SweptMesh<'_>) {
        self.reaches.clear();
        self.update_boxes(mesh, |_| mesh.reach);
    }

    /// Like [`update`](Self::update), with a reach for each triangle instead of the mesh's. These also bound distances:
    /// two triangles without a common vertex, of one mesh or of two that both have such reaches, must be farther apart
    /// at the start of the step than the sum of both reaches. Pairs that move less than this sum relative to each other
    /// are left out, fast or not.
    ///
    /// If nothing is known about a triangle, its reach is minus infinity. It then counts as fast, however slowly it
    /// moves.
    ///
    /// # Panics
    /// If the mesh has fewer positions than its triangles name, or the numbers of reaches and triangles differ.
    pub fn update_with_reaches(&mut self, mesh: &SweptMesh<'_>, reaches: &[f64]) {
        self.update_boxes(mesh, |triangle| reaches[triangle]);
        self.update_reaches(reaches);
    }

    /// Updates the reaches alone, for a mesh that is still at rest: none of its triangles is fast.
    ///
    /// # Panics
    /// If the numbers of reaches and triangles differ.
    pub fn update_reaches(&mut self, reaches: &[f64]) {
        assert_eq!(self.boxes.len(), reaches.len(), "every triangle has a reach");
        self.reaches.clear();
        self.reaches.extend_from_slice(reaches);
    }

    fn update_boxes(&mut self, mesh: &SweptMesh<'_>, reach: impl Fn(usize) -> f64) {
        let count = mesh.topology.triangles().len();
        self.has_tree &= self.boxes.len() == count;
        self.boxes.resize(count, Aabb::EMPTY);
        self.fast.clear();
        [self.bounds, self.fast_bounds] = [Aabb::EMPTY; 2];
        for (triangle, kept) in self.boxes.iter_mut().enumerate() {
            let corners = mesh.triangle(triangle as u32);
            let all = corners.start.iter().chain(&corners.end);
            let is_finite = all.clone().all(|corner| corner.is_finite());
            let bounds = if is_finite { outward_box(all.copied()) } else { Aabb::EMPTY };
            self.has_tree &= bounds == *kept;
            *kept = bounds;
            self.bounds = self.bounds.union(&bounds);
            let is_fast = is_finite && corners.way() > reach(triangle);
            self.fast.push(is_fast);
            if is_fast {
                self.fast_bounds = self.fast_bounds.union(&bounds);
            }
        }
        self.fast_count = self.fast.iter().filter(|&&is_fast| is_fast).count();
    }

    /// A fast triangle stays fast only if `is_requested` is true for it. Pairs of the others must already be known.
    pub fn keep_fast(&mut self, is_requested: impl Fn(usize) -> bool) {
        self.fast_bounds = Aabb::EMPTY;
        self.fast_count = 0;
        for (triangle, fast) in self.fast.iter_mut().enumerate() {
            *fast &= is_requested(triangle);
            if *fast {
                self.fast_count += 1;
                self.fast_bounds = self.fast_bounds.union(&self.boxes[triangle]);
            }
        }
    }

    /// Treats no triangle as fast from now on. Pairs of fast triangles must already be known.
    pub fn forget_fast(&mut self) {
        self.fast.fill(false);
        self.fast_bounds = Aabb::EMPTY;
        self.fast_count = 0;
    }

    /// Updates the tree to the boxes. Keeps it if none has changed, refits it otherwise, and builds it if there is none
    /// or it has decayed.
    pub fn update_tree(&mut self) -> TreeWork {
        if self.has_tree {
            return TreeWork::Kept;
        }
        self.has_tree = true;
        if self.tree.len() == self.boxes.len() {
            self.tree.refit(&self.boxes);
            if self.tree.decay() <= REBUILD_DECAY {
                return TreeWork::Refitted;
            }
        }
        self.tree.rebuild(&self.boxes);
        TreeWork::Built
    }

    /// The number of fast triangles.
    #[must_use]
    pub fn fast_count(&self) -> usize {
        self.fast_count
    }

    /// The box around everything that the mesh sweeps.
    #[must_use]
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// The box that each triangle sweeps.
    #[must_use]
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The tree over the boxes, if it is up to date.
    pub(super) fn tree(&self) -> Option<&BoxTree> {
        self.has_tree.then_some(&self.tree)
    }

    /// Whether a triangle is fast.
    #[must_use]
    pub fn is_fast(&self, triangle: u32) -> bool {
        self.fast[triangle as usize]
    }

    /// The reach of a triangle, if reaches bound the distances of triangles.
    pub(super) fn known_reach(&self, triangle: u32) -> Option<f64> {
        self.reaches.get(triangle as usize).copied()
    }

    /// The box around everything that fast triangles sweep.
    pub(super) fn fast_bounds(&self) -> &Aabb {
        &self.fast_bounds
    }
}

/// The smallest f32 box around some finite points.
#[must_use]
pub fn outward_box(points: impl IntoIterator<Item = DVec3>) -> Aabb {
    let (low, high) = points
        .into_iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(point), high.max(point)));
    Aabb {
        min: Vec3::new(rounded_down(low.x), rounded_down(low.y), rounded_down(low.z)),
        max: Vec3::new(-rounded_down(-high.x), -rounded_down(-high.y), -rounded_down(-high.z)),
    }
}

/// The largest f32 that is not larger.
fn rounded_down(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) > value { nearest.next_down() } else { nearest }
}

/// The smallest f32 that is not smaller.
pub(super) fn rounded_up(value: f64) -> f32 {
    -rounded_down(-value)
}
