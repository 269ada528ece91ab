//! Boxes that the triangles of a mesh sweep in a step, and a tree over them that is kept from step to step.
//!
//! The broad phase of continuous detection: [`sweep`](super::sweep()) asks the boxes of one mesh about those of another. Only
//! the larger of two meshes needs the tree, and a mesh that rests keeps boxes and tree as they are.

use glam::{DVec3, Vec3};

use super::sweep::SweptMesh;
use crate::kernel::{bvh::tree::BoxTree, mesh::bounds::Aabb};

/// A tree is built anew once its boxes have grown by this factor relative to the whole.
const REBUILD_DECAY: f32 = 1.5;

/// What [`SweepTree::update_tree`] had to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TreeWork {
    /// Nothing: the boxes are those that the tree was fitted to.
    Kept,
    /// The tree follows boxes that have changed.
    Refitted,
    /// The tree was built, for the first time or because its boxes had outgrown it.
    Built,
}

/// The box that each triangle of a mesh sweeps in a step, which of them are fast, and a tree over the boxes.
///
/// Made by default, then [updated](Self::update) whenever an end of the step changes; its memory is kept.
#[derive(Clone, Debug, Default)]
pub struct SweepTree {
    boxes: Vec<Aabb>,
    fast: Vec<bool>,
    /// The reach of each triangle, where these tell how far apart triangles are.
    reaches: Vec<f64>,
    fast_count: usize,
    bounds: Aabb,
    fast_bounds: Aabb,
    tree: BoxTree,
    /// Whether the tree is fitted to the boxes as they are.
    has_tree: bool,
}

impl SweepTree {
    /// Brings the boxes up to date, and which triangles are fast; one pass over the triangles. The tree is left as it is:
    /// [`update_tree`](Self::update_tree) lets it follow.
    ///
    /// Boxes are rounded outward. A triangle with a coordinate that is not finite has none, and meets nothing.
    ///
    /// # Panics
    /// If the mesh has fewer positions than its triangles name.
    pub fn update(&mut self, mesh: &SweptMesh<'_>) {
        self.reaches.clear();
        self.update_boxes(mesh, |_| mesh.reach);
    }

    /// The same where more is known: each triangle has a reach of its own, instead of that of the mesh, and of two triangles
    /// without a common vertex, of one mesh or of two that both have such reaches, the distance when the step begins is more
    /// than the sum of both reaches. So those are left out that move less than this sum relative to each other, fast or not.
    ///
    /// Minus infinity where nothing is known of a triangle, which is fast then however slow.
    ///
    /// # Panics
    /// If the mesh has fewer positions than its triangles name, or there are not as many reaches as triangles.
    pub fn update_with_reaches(&mut self, mesh: &SweptMesh<'_>, reaches: &[f64]) {
        self.update_boxes(mesh, |triangle| reaches[triangle]);
        self.update_reaches(reaches);
    }

    /// The reaches alone, of a mesh that rests as it did before: none of its triangles is fast.
    ///
    /// # Panics
    /// If there are not as many reaches as triangles.
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

    /// Of the fast triangles only those count as such from now on for which `is_asked`: pairs of others are known by now.
    pub fn keep_fast(&mut self, is_asked: impl Fn(usize) -> bool) {
        self.fast_bounds = Aabb::EMPTY;
        self.fast_count = 0;
        for (triangle, fast) in self.fast.iter_mut().enumerate() {
            *fast &= is_asked(triangle);
            if *fast {
                self.fast_count += 1;
                self.fast_bounds = self.fast_bounds.union(&self.boxes[triangle]);
            }
        }
    }

    /// No triangle counts as fast from now on: pairs of two of them are known.
    pub fn forget_fast(&mut self) {
        self.fast.fill(false);
        self.fast_bounds = Aabb::EMPTY;
        self.fast_count = 0;
    }

    /// Lets the tree follow the boxes: not at all where none has changed, else by refitting it, and by building it where
    /// there is none or it has decayed.
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

    /// How many triangles are fast.
    #[must_use]
    pub fn fast_count(&self) -> usize {
        self.fast_count
    }

    /// The box around all that the mesh sweeps.
    #[must_use]
    pub fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// The box that each triangle sweeps.
    #[must_use]
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The tree over them, where it follows them.
    pub(super) fn tree(&self) -> Option<&BoxTree> {
        self.has_tree.then_some(&self.tree)
    }

    /// Whether a triangle is fast.
    #[must_use]
    pub fn is_fast(&self, triangle: u32) -> bool {
        self.fast[triangle as usize]
    }

    /// The reach of a triangle, where reaches tell how far apart triangles are.
    pub(super) fn known_reach(&self, triangle: u32) -> Option<f64> {
        self.reaches.get(triangle as usize).copied()
    }

    /// The box around all that fast triangles sweep.
    pub(super) fn fast_bounds(&self) -> &Aabb {
        &self.fast_bounds
    }
}

/// The smallest box of single precision around some finite points.
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

/// The largest number of single precision that is not larger.
fn rounded_down(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) > value { nearest.next_down() } else { nearest }
}

/// The smallest number of single precision that is not smaller.
pub(super) fn rounded_up(value: f64) -> f32 {
    -rounded_down(-value)
}
