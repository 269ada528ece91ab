//! A snapshot of a surface's positions, with the boxes of its triangles.

use std::{
    mem,
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use bevy_ecs::{change_detection::Tick, prelude::*};
use bevy_platform::sync::atomic::AtomicU64;
use bytemuck::cast_slice;
use glam::Vec3;

use crate::{
    detection::{
        pairs::{GROWTH_SLACK, moved_box},
        parallel::Threads,
    },
    kernel::{
        bvh::leaf_triangles::LeafMesh,
        mesh::{
            bounds::{Aabb, bounds_of_moved, point_bounds, triangle_bounds_on},
            curved_edges::CurvedEdges,
            motion::Motion,
            smooth_normal::CreaseAngle,
            topology::SurfaceTopology,
        },
        pose::Pose,
        simd::parallel::{Parallel, Sequential},
    },
    surface::SurfacePositions,
};

/// A snapshot of a surface's checked positions, and the boxes of its triangles in its own frame, grown by its thickness
/// and half the margin, and on a smooth surface by how far any patch may be from its triangle. Changes only if
/// positions, triangles, or growth differ, bit by bit, from those of the last detection.
#[derive(Debug, Default)]
pub struct TriangleBounds {
    /// One box per triangle, computed on first request.
    triangles: OnceLock<Vec<Aabb>>,
    /// Memory for the boxes.
    spare: Mutex<Vec<Aabb>>,
    /// Whether they have been requested.
    are_requested: AtomicBool,
    /// The box of the whole surface.
    whole: Aabb,
    /// The box of the whole surface in the world, for the last pose.
    pub(in crate::detection) in_world: Option<(Pose, Aabb)>,
    /// Increases by 1 whenever positions, triangles, or growth change, and starts [far from those](first_version) of
    /// other surfaces. Results computed from a version are valid while it stays the same.
    version: u64,
    /// The motion from the positions of the previous version to those of this one.
    motion: Motion,
    positions: Vec<Vec3>,
    /// The change tick of the surface's positions when they were read.
    seen: Option<Tick>,
    topology: Option<Arc<SurfaceTopology>>,
    /// Whether every vertex is a corner, so that the box of the vertices is that of the triangles.
    names_every_vertex: bool,
    growth: f32,
    /// How far any patch of a smooth surface may be from its triangle. 0 if it is flat.
    bulge: f32,
    /// The creases of a smooth surface. `None` if it is flat.
    crease: Option<CreaseAngle>,
    curved: CurvedEdges,
    /// How badly the mesh fits a smooth surface, if it has just become one.
    unevenness: Option<f32>,
}

/// The first version of a surface, so far from those of all others that they never reach it.
fn first_version() -> u64 {
    static SURFACES: AtomicU64 = AtomicU64::new(0);
    1 + (SURFACES.fetch_add(1, Ordering::Relaxed) << u32::BITS)
}

impl TriangleBounds {
    /// One box per triangle. If nothing is near a flat surface, nothing requests them, and they are not computed. If they
    /// were requested before the surface changed, or if it is smooth, they are computed at once, otherwise on the first
    /// request.
    #[must_use]
    pub fn triangles(&self) -> &[Aabb] {
        self.triangles_on(&Sequential)
    }

    /// Like [`triangles`](Self::triangles), computed in tasks that `parallel` may distribute.
    pub(in crate::detection) fn triangles_on(&self, parallel: &impl Parallel) -> &[Aabb] {
        self.are_requested.store(true, Ordering::Relaxed);
        if let Some(triangles) = self.triangles.get() {
            return triangles;
        }
        // Not inside `get_or_init`, which would block other callers: a task that we wait for might request the same
        // boxes.
        let mut triangles = mem::take(&mut *self.spare.lock().unwrap_or_else(PoisonError::into_inner));
        if let Some(topology) = &self.topology {
            triangle_bounds_on(parallel, &self.positions, topology.triangles(), self.growth, &mut triangles);
        }
        self.triangles.get_or_init(|| triangles)
    }

    /// Computes the patches of a smooth surface where they are wanted. `wants` tells whether something is near a box.
    pub(in crate::detection) fn bend(&mut self, threads: usize, wants: impl Fn(&Aabb) -> bool) {
        let (Some(crease), Some(topology), Some(triangles)) = (self.crease, &self.topology, self.triangles.get())
        else {
            return;
        };
        for (triangle, _) in triangles.iter().enumerate().filter(|(_, bounds)| wants(bounds)) {
            self.curved.want(triangle as u32);
        }
        self.curved.bend_on(&Threads(threads), topology, &self.positions, crease);
    }

    /// The curved edges of a smooth surface. `None` if it is flat.
    pub(in crate::detection) fn curved(&self) -> Option<&CurvedEdges> {
        self.crease.is_some().then_some(&self.curved)
    }

    /// The curved edges of a smooth surface with all patches, in the memory of others.
    pub(in crate::detection) fn with_all_patches(&self, mut curved: CurvedEdges) -> CurvedEdges {
        if let (Some(topology), Some(crease)) = (&self.topology, self.crease) {
            curved.update(topology, &self.positions, crease);
        }
        curved
    }

    /// How badly the mesh fits a smooth surface, once after it has become one.
    pub(in crate::detection) fn take_unevenness(&mut self) -> Option<f32> {
        self.unevenness.take()
    }

    /// How far any patch may be from its triangle, in the surface's own frame. 0 if it is flat. Does not depend on which
    /// patches have been computed.
    pub(in crate::detection) fn bulge(&self) -> f32 {
        self.bulge
    }

    /// The triangles, for the leaves of a tree.
    pub(in crate::detection) fn leaf_mesh<'a>(&'a self, topology: &'a SurfaceTopology) -> LeafMesh<'a> {
        let heights = self.curved().map_or(&[][..], CurvedEdges::heights);
        LeafMesh { heights, ..LeafMesh::flat(topology, &self.positions) }
    }

    /// The positions in the surface's own frame.
    pub(in crate::detection) fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// The triangles. `None` before the first snapshot.
    pub(in crate::detection) fn topology(&self) -> Option<&Arc<SurfaceTopology>> {
        self.topology.as_ref()
    }

    /// Whether the snapshot is of a surface with these triangles.
    pub(in crate::detection) fn is_of(&self, topology: &SurfaceTopology) -> bool {
        self.topology.as_ref().is_some_and(|own| std::ptr::eq(&raw const **own, topology))
    }

    /// The number of triangles.
    pub(in crate::detection) fn triangle_count(&self) -> usize {
        self.topology.as_ref().map_or(0, |topology| topology.triangles().len())
    }

    /// Increases by 1 whenever positions, triangles, or growth change. Unique among all surfaces.
    pub(in crate::detection) fn version(&self) -> u64 {
        self.version
    }

    /// The box of the whole surface.
    pub(in crate::detection) fn whole(&self) -> &Aabb {
        &self.whole
    }

    /// The motion of the surface in its own frame since an earlier version.
    pub(in crate::detection) fn motion_since(&self, version: u64) -> Motion {
        match self.version.checked_sub(version) {
            Some(0) => Motion::REST,
            Some(1) => self.motion,
            _ => Motion::UNKNOWN,
        }
    }

    /// Takes a snapshot of the surface, whose positions are finite. Returns whether anything has changed.
    pub(in crate::detection) fn update(
        &mut self,
        positions: &Ref<SurfacePositions>,
        topology: &Arc<SurfaceTopology>,
        growth: f32,
        crease: Option<CreaseAngle>,
        threads: usize,
    ) -> bool {
        let changed = positions.last_changed();
        let positions = &*positions.0;
        let same_mesh = self.topology.as_ref().is_some_and(|other| Arc::ptr_eq(other, topology));
        let same_positions = self.seen == Some(changed) || has_bits_of(&self.positions, positions);
        self.seen = Some(changed);
        if same_mesh && self.growth == growth && self.crease == crease && same_positions {
            return false;
        }
        self.motion = if same_mesh { Motion::between(&self.positions, positions) } else { Motion::UNKNOWN };
        let mut spare = mem::take(self.spare.get_mut().unwrap_or_else(PoisonError::into_inner));
        if let Some(triangles) = self.triangles.take() {
            spare = triangles;
        }
        let is_new = !same_mesh || self.crease.is_none();
        (self.crease, self.growth, self.bulge) = (crease, growth, 0.0);
        if crease.is_none() {
            self.curved = CurvedEdges::default();
        }
        self.version = if self.topology.is_none() { first_version() } else { self.version + 1 };
        if !same_mesh {
            self.names_every_vertex = topology.names_every_vertex();
            self.topology = Some(Arc::clone(topology));
        }
        let are_expected = mem::take(self.are_requested.get_mut());
        if let Some(crease) = crease {
            // Patches follow where something is near.
            self.whole = self.curved.begin_on(&Threads(threads), topology, positions, growth, &mut spare);
            self.bulge = self.curved.largest();
            self.triangles = OnceLock::from(spare);
            self.unevenness = is_new.then(|| topology.unevenness_on(&Threads(threads), positions, crease));
        } else if self.names_every_vertex && !are_expected {
            self.whole = point_bounds(positions, growth);
            *self.spare.get_mut().unwrap_or_else(PoisonError::into_inner) = spare;
        } else {
            // The triangle boxes are expected to be needed. Or the surface uses only some of many vertices that it
            // shares with others.
            self.whole = triangle_bounds_on(&Threads(threads), positions, topology.triangles(), growth, &mut spare);
            self.triangles = OnceLock::from(spare);
        }
        self.in_world = None;
        self.positions.clear();
        self.positions.extend_from_slice(positions);
        true
    }

    /// Updates the box of the whole surface in the world, after [`update`](Self::update). This is the box of the
    /// transformed box, and for few vertices at most the box of the transformed vertices.
    pub(in crate::detection) fn update_in_world(&mut self, pose: &Pose) {
        if self.in_world.is_some_and(|(other, _)| other == *pose) {
            return;
        }
        let mut bounds = moved_box(&self.whole, pose);
        if *pose != Pose::IDENTITY && self.positions.len() <= MOST_TURNED_VERTICES {
            let growth = (f64::from(self.growth + self.bulge) * pose.largest_scale()) as f32 * GROWTH_SLACK;
            let vertices = bounds_of_moved(pose, &self.positions).grown(growth);
            bounds = Aabb { min: bounds.min.max(vertices.min), max: bounds.max.min(vertices.max) };
        }
        self.in_world = Some((*pose, bounds));
    }
}

/// Up to this many vertices, the box of a surface in the world is as small as possible. The box around a rotated box is
/// up to five times as large for a ball, and meets that many more surfaces. Transforming all vertices takes a tenth of
/// the time of computing triangle boxes. On a larger surface this would be noticeable whenever it moves as a whole,
/// when its triangle boxes do not change.
const MOST_TURNED_VERTICES: usize = 16_384;

/// Whether two lists of positions are equal bit by bit, including the sign of zero, because contacts preserve it.
fn has_bits_of(positions: &[Vec3], others: &[Vec3]) -> bool {
    cast_slice::<Vec3, u8>(positions) == cast_slice::<Vec3, u8>(others)
}
