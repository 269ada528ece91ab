//! Boxes that the triangles of a mesh sweep in a step, and a tree over them that is kept from step to step.
//!
//! The broad phase of continuous detection: [`sweep`](super::sweep()) tests the boxes of one mesh against those of
//! another. Only the larger of two meshes needs the tree. A mesh at rest keeps its boxes and its tree.
//!
//! Boxes are those in a frame that moves with the mesh, by its [drift](SweptMesh::drift). In such a frame, what moves as a
//! whole is at rest, and its boxes are as small as its triangles.

use glam::{DVec3, Vec3, Vec3A};

use super::sweep::SweptMesh;
use crate::kernel::{
    bvh::tree::BoxTree,
    mesh::bounds::Aabb,
    simd::parallel::{LEAST_SHARE, Parallel, Sequential},
};

/// A tree is rebuilt once its boxes have grown by this factor, relative to the whole.
const REBUILD_DECAY: f32 = 1.5;

/// Vertices or triangles per task.
const PART: usize = 1024;

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

/// The box that each triangle of a mesh sweeps in a step, how far it moves, and a tree over the boxes.
///
/// Create it with `default`, then [update](Self::update) it whenever an end of the step changes. Its memory is kept.
#[derive(Clone, Debug, Default)]
pub struct SweepTree {
    drift: DVec3,
    boxes: Vec<Aabb>,
    /// How far each triangle moves relative to the drift. NaN if a coordinate is not finite.
    ways: Vec<f64>,
    reaches: Reaches,
    /// Whether each triangle is asked about.
    asked: Vec<bool>,
    fast_count: usize,
    /// The least that a triangle lacks to be fast.
    slack: f64,
    asked_count: usize,
    bounds: Aabb,
    fast_bounds: Aabb,
    asked_bounds: Aabb,
    tree: BoxTree,
    /// Whether the tree is fitted to the current boxes.
    has_tree: bool,
    /// Whether every triangle has a box, and welded vertices are one point.
    is_whole: bool,
    /// What each vertex sweeps. Only used while boxes are updated.
    vertices: Vec<SweptVertex>,
    /// What parts of the triangles sweep. Likewise.
    parts: Vec<SweptPart>,
}

/// How far a triangle may move without being fast.
#[derive(Clone, Debug)]
enum Reaches {
    /// The same for all.
    One(f64),
    /// For each triangle. Bounds distances, too.
    Each(Vec<f64>),
}

impl Default for Reaches {
    fn default() -> Self {
        Self::One(0.0)
    }
}

/// What a vertex sweeps relative to the drift of its mesh: a box that is rounded outward, and the square of its way.
#[derive(Clone, Copy, Debug, Default)]
struct SweptVertex {
    low: Vec3A,
    high: Vec3A,
    /// NaN if a coordinate is not finite.
    squared: f64,
}

impl SweptVertex {
    fn new(start: DVec3, end: DVec3) -> Self {
        // More than the error of rounding to f32 and of the sum below.
        let away = |at: Vec3A| at.abs() * (2.0 * f32::EPSILON) + f32::MIN_POSITIVE;
        let narrowed = |at: DVec3| at.as_vec3a().clamp(Vec3A::splat(-f32::MAX), Vec3A::splat(f32::MAX));
        let (low, high) = (narrowed(start.min(end)), narrowed(start.max(end)));
        let squared = if start.is_finite() && end.is_finite() { (end - start).length_squared() } else { f64::NAN };
        Self { low: low - away(low), high: high + away(high), squared }
    }
}

/// What consecutive triangles sweep.
#[derive(Clone, Copy, Debug)]
struct SweptPart {
    bounds: Aabb,
    /// Whether a box is different from before.
    is_changed: bool,
    is_finite: bool,
}

impl Default for SweptPart {
    /// No triangles.
    fn default() -> Self {
        Self { bounds: Aabb::EMPTY, is_changed: false, is_finite: true }
    }
}

impl SweptPart {
    /// Updates the boxes and the ways of triangles.
    fn update(vertices: &[SweptVertex], triangles: &[[u32; 3]], boxes: &mut [Aabb], ways: &mut [f64]) -> Self {
        let mut all = Self::default();
        for (corners, (kept, way)) in triangles.iter().zip(boxes.iter_mut().zip(ways)) {
            let [a, b, c] = corners.map(|corner| &vertices[corner as usize]);
            let is_finite = !(a.squared + b.squared + c.squared).is_nan();
            let swept = if is_finite {
                Aabb { min: a.low.min(b.low).min(c.low).into(), max: a.high.max(b.high).max(c.high).into() }
            } else {
                Aabb::EMPTY
            };
            all.is_changed |= swept != *kept;
            all.is_finite &= is_finite;
            all.bounds = all.bounds.union(&swept);
            *kept = swept;
            *way = if is_finite { a.squared.max(b.squared).max(c.squared).sqrt() } else { f64::NAN };
        }
        all
    }
}

impl SweepTree {
    /// Updates the boxes, and which triangles are fast. All triangles are asked about. Does not change the tree:
    /// [`update_tree`](Self::update_tree) does.
    ///
    /// Boxes are rounded outward. A triangle with a coordinate that is not finite has no box, and meets nothing.
    ///
    /// # Panics
    /// If the mesh has fewer positions than its triangles name.
    pub fn update(&mut self, mesh: &SweptMesh<'_>) {
        self.reaches = Reaches::One(mesh.reach);
        self.update_boxes(&Sequential, mesh);
        self.ask_all();
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
        self.update_with_reaches_on(&Sequential, mesh, reaches);
    }

    /// Like [`update_with_reaches`](Self::update_with_reaches), in tasks that `parallel` may distribute.
    ///
    /// # Panics
    /// Likewise.
    pub fn update_with_reaches_on(&mut self, parallel: &impl Parallel, mesh: &SweptMesh<'_>, reaches: &[f64]) {
        self.update_boxes(parallel, mesh);
        self.update_reaches(reaches);
    }

    /// Updates the reaches alone, for a mesh that moves as it did. All triangles are asked about.
    ///
    /// # Panics
    /// If the numbers of reaches and triangles differ.
    pub fn update_reaches(&mut self, reaches: &[f64]) {
        assert_eq!(self.boxes.len(), reaches.len(), "every triangle has a reach");
        let mut kept = match std::mem::take(&mut self.reaches) {
            Reaches::Each(kept) => kept,
            Reaches::One(_) => Vec::new(),
        };
        kept.clear();
        kept.extend_from_slice(reaches);
        self.reaches = Reaches::Each(kept);
        self.ask_all();
    }

    fn update_boxes(&mut self, parallel: &impl Parallel, mesh: &SweptMesh<'_>) {
        let Self { drift, boxes, ways, bounds, vertices, has_tree, is_whole, parts, .. } = self;
        *drift = mesh.drift;
        let vertex_count = mesh.start.len().min(mesh.end.len());
        vertices.resize(vertex_count, SweptVertex::default());
        let ends = mesh.start.chunks(PART).zip(mesh.end.chunks(PART)).zip(vertices.chunks_mut(PART));
        parallel.run_tasks(ends, vertex_count / LEAST_SHARE, |((starts, ends), vertices)| {
            for ((&start, &end), vertex) in starts.iter().zip(ends).zip(vertices) {
                *vertex = SweptVertex::new(start + mesh.drift, end);
            }
        });
        let is_one = |(vertex, &weld): (usize, &u32)| {
            [mesh.start, mesh.end].into_iter().all(|positions| positions[vertex] == positions[weld as usize])
        };
        *is_whole = !mesh.topology.is_welded() || mesh.topology.weld().iter().enumerate().all(is_one);
        let triangles = mesh.topology.triangles();
        *has_tree &= boxes.len() == triangles.len();
        boxes.resize(triangles.len(), Aabb::EMPTY);
        ways.resize(triangles.len(), 0.0);
        parts.clear();
        parts.resize(triangles.len().div_ceil(PART), SweptPart::default());
        let tasks = triangles.chunks(PART).zip(boxes.chunks_mut(PART).zip(ways.chunks_mut(PART))).zip(&mut *parts);
        parallel.run_tasks(tasks, triangles.len() / LEAST_SHARE, |((triangles, (boxes, ways)), part)| {
            *part = SweptPart::update(vertices, triangles, boxes, ways);
        });
        *bounds = parts.iter().fold(Aabb::EMPTY, |all, part| all.union(&part.bounds));
        *has_tree &= parts.iter().all(|part| !part.is_changed);
        *is_whole &= parts.iter().all(|part| part.is_finite);
    }

    fn ask_all(&mut self) {
        self.asked.clear();
        self.asked.resize(self.boxes.len(), true);
        (self.asked_count, self.asked_bounds) = (self.boxes.len(), self.bounds);
        (self.fast_count, self.fast_bounds, self.slack) = (0, Aabb::EMPTY, f64::INFINITY);
        for triangle in 0..self.boxes.len() {
            self.slack = self.slack.min(self.reach(triangle) - self.ways[triangle]);
            if self.is_fast(triangle as u32, 0.0) {
                self.fast_count += 1;
                self.fast_bounds = self.fast_bounds.union(&self.boxes[triangle]);
            }
        }
    }

    /// Asks only about triangles for which `is_asked` is true. Pairs of two others must already be known.
    pub fn ask_only(&mut self, is_asked: impl Fn(usize) -> bool) {
        (self.asked_count, self.asked_bounds) = (0, Aabb::EMPTY);
        for (triangle, asked) in self.asked.iter_mut().enumerate() {
            *asked = is_asked(triangle);
            if *asked {
                self.asked_count += 1;
                self.asked_bounds = self.asked_bounds.union(&self.boxes[triangle]);
            }
        }
    }

    /// Updates the tree to the boxes. Keeps it if none has changed, refits it otherwise, and builds it if there is none
    /// or it has decayed.
    pub fn update_tree(&mut self) -> TreeWork {
        self.update_tree_on(&Sequential)
    }

    /// Like [`update_tree`](Self::update_tree), in tasks that `parallel` may distribute.
    pub fn update_tree_on(&mut self, parallel: &impl Parallel) -> TreeWork {
        if self.has_tree {
            return TreeWork::Kept;
        }
        self.has_tree = true;
        if self.tree.len() == self.boxes.len() {
            self.tree.refit_on(parallel, &self.boxes);
            if self.tree.decay() <= REBUILD_DECAY {
                return TreeWork::Refitted;
            }
        }
        self.tree.rebuild(&self.boxes);
        TreeWork::Built
    }

    /// The number of triangles that are fast in the frame of the boxes.
    #[must_use]
    pub fn fast_count(&self) -> usize {
        self.fast_count
    }

    /// The number of triangles that are asked about.
    #[must_use]
    pub fn asked_count(&self) -> usize {
        self.asked_count
    }

    /// The motion of the frame of the boxes.
    #[must_use]
    pub fn drift(&self) -> DVec3 {
        self.drift
    }

    /// The box around everything that the mesh sweeps, in the frame of the boxes.
    pub(super) fn bounds(&self) -> &Aabb {
        &self.bounds
    }

    /// A box around everything that the mesh sweeps, in the frame of its positions.
    #[must_use]
    pub fn bounds_at_rest(&self) -> Aabb {
        self.bounds.moved_along(&outward_box([DVec3::ZERO, -self.drift]), 0.0)
    }

    /// The box that each triangle sweeps, in the frame that moves with the drift.
    #[must_use]
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The tree over the boxes, if it is up to date.
    pub(super) fn tree(&self) -> Option<&BoxTree> {
        self.has_tree.then_some(&self.tree)
    }

    /// Whether a triangle has a box: all its coordinates are finite.
    pub(super) fn has_box(&self, triangle: u32) -> bool {
        !self.ways[triangle as usize].is_nan()
    }

    /// Whether every triangle has a box, and welded vertices are one point.
    pub(super) fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Whether a triangle is fast, in a frame that moves by `farther` relative to that of the boxes.
    #[must_use]
    pub fn is_fast(&self, triangle: u32, farther: f64) -> bool {
        self.ways[triangle as usize] + farther > self.reach(triangle as usize)
    }

    fn reach(&self, triangle: usize) -> f64 {
        match &self.reaches {
            Reaches::One(reach) => *reach,
            Reaches::Each(reaches) => reaches[triangle],
        }
    }

    /// Whether a triangle of this mesh or of another one may be fast, in the frame of either.
    #[must_use]
    pub fn is_any_fast(&self, other: &Self) -> bool {
        let farther = self.drift.distance(other.drift);
        // Rounding may make a triangle fast that lacks as much.
        farther > 0.999 * self.slack.min(other.slack)
    }

    pub(super) fn is_asked(&self, triangle: u32) -> bool {
        self.asked[triangle as usize]
    }

    pub(super) fn is_all_asked(&self) -> bool {
        self.asked_count == self.asked.len()
    }

    /// The reach of a triangle, if reaches bound the distances of triangles.
    pub(super) fn known_reach(&self, triangle: u32) -> Option<f64> {
        match &self.reaches {
            Reaches::One(_) => None,
            Reaches::Each(reaches) => reaches.get(triangle as usize).copied(),
        }
    }

    /// The box around everything that fast triangles sweep, in the frame of the boxes.
    pub(super) fn fast_bounds(&self) -> &Aabb {
        &self.fast_bounds
    }

    /// The box around everything that triangles sweep that are asked about, in the frame of the boxes.
    pub(super) fn asked_bounds(&self) -> &Aabb {
        &self.asked_bounds
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
