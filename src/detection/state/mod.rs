//! What the stages know about each surface in this detection, in the order of
//! [`ActiveSurfaces`](crate::ActiveSurfaces).
//!
//! The bounds stage copies checked positions once. Later stages index this list and query no positions. Everything here
//! carries the version of the positions that it was computed from.

use std::sync::OnceLock;

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use glam::Vec3;

use self::{bounds::TriangleBounds, queried::Queried, rows::SurfaceRows, tree::SurfaceTree};
use crate::{
    kernel::{
        bvh::tree::BoxTree,
        capacity,
        mesh::{bounds::Aabb, topology::SurfaceTopology},
        pair::SurfaceSide,
        pose::Pose,
        smooth::patch::Patch,
    },
    surface::{ActiveSurface, SurfaceLayers},
};

pub(super) mod bounds;
pub(super) mod queried;
pub(super) mod rows;
pub(super) mod tree;

/// What the stages know about one surface.
#[doc(hidden)]
#[derive(Default)]
pub struct SurfaceState {
    pub(super) bounds: TriangleBounds,
    pub(super) tree: SurfaceTree,
    pub(super) rows: SurfaceRows,
    pub(super) queried: Queried,
    /// Whether it had an inside in the last detection.
    pub(super) one_sided: bool,
    /// By which layers queries filter it.
    pub(super) query_layers: SurfaceLayers,
    /// Whether positions, triangles, or growth have changed in this detection.
    pub(super) has_moved: bool,
}

impl SurfaceState {
    /// The positions that were tested, in the surface's own frame.
    #[must_use]
    pub fn positions(&self) -> &[Vec3] {
        self.bounds.positions()
    }

    /// One box per triangle in the surface's own frame, grown by its thickness and half the margin, and on a smooth surface
    /// by how far any patch may be from its triangle.
    #[must_use]
    pub fn triangle_boxes(&self) -> &[Aabb] {
        self.bounds.triangles()
    }

    /// The triangles of those positions. `None` before the first detection.
    #[must_use]
    pub fn topology(&self) -> Option<&SurfaceTopology> {
        self.bounds.topology().map(|topology| &**topology)
    }

    /// Its pose in its last detection. `None` before the first.
    #[must_use]
    pub fn pose(&self) -> Option<&Pose> {
        self.bounds.in_world.as_ref().map(|(pose, _)| pose)
    }

    /// Whether it had an inside in its last detection.
    pub(crate) fn is_one_sided(&self) -> bool {
        self.one_sided
    }

    /// By which layers queries filter it.
    pub(crate) fn query_layers(&self) -> SurfaceLayers {
        self.query_layers
    }

    /// The tree over the current triangle boxes, brought up to date now if no stage has needed that.
    pub(crate) fn query_tree(&self) -> &BoxTree {
        self.queried.tree(&self.tree, &self.bounds)
    }

    /// The triangles in the surface's own frame, with the patches over all of them if it is smooth. Those are computed now
    /// if no query has needed them. `None` before the first detection.
    pub(crate) fn query_side(&self) -> Option<SurfaceSide<'_>> {
        let curved = self.queried.patches(&self.bounds);
        Some(SurfaceSide { curved, ..SurfaceSide::flat(self.topology()?, self.positions()) })
    }

    /// Whether the surface is smooth.
    #[must_use]
    pub fn is_smooth(&self) -> bool {
        self.bounds.curved().is_some()
    }

    /// The patches over some triangles, in the surface's own frame. `None` if the surface has another mesh by now. Those
    /// that nothing was near are computed now.
    #[must_use]
    pub fn patches(&self, topology: &SurfaceTopology, triangles: &[u32]) -> Option<Vec<Patch>> {
        if !self.bounds.is_of(topology) {
            return None;
        }
        let side = self.query_side().filter(|side| side.curved.is_some())?;
        Some(triangles.iter().map(|&triangle| Patch::of(&side, triangle)).collect())
    }

    /// Increases by 1 whenever positions, triangles, or growth change. Unique among all surfaces.
    #[must_use]
    pub fn version(&self) -> u64 {
        self.bounds.version()
    }

    /// The tree over the triangle boxes. Built in the surface's first detection, and refitted in every detection whose
    /// broad phase searches it: see [`is_tree_current`](Self::is_tree_current).
    #[must_use]
    pub fn tree(&self) -> &BoxTree {
        self.tree.tree()
    }

    /// The boxes of the regions that a traversal of the tree against itself leaves out because they are flat: see
    /// [`NormalConeCullingPlugin`](crate::detection::NormalConeCullingPlugin).
    #[must_use]
    pub fn flat_regions(&self) -> Vec<Aabb> {
        let mut boxes = Vec::new();
        if self.is_tree_current() {
            self.tree.visit_flat_regions(|bounds| boxes.push(*bounds));
        }
        boxes
    }

    /// Whether the tree matches the current boxes.
    #[must_use]
    pub fn is_tree_current(&self) -> bool {
        self.tree.matches_boxes(&self.bounds)
    }
}

/// What the stages know about each surface. Only the stages write it.
#[doc(hidden)]
#[derive(Resource, Default)]
pub struct SurfaceStates {
    /// The active surfaces of the last detection, in their order.
    entities: Vec<Entity>,
    states: Vec<SurfaceState>,
    /// The states of surfaces that took no part in it.
    inactive: EntityHashMap<SurfaceState>,
    /// The tree over the boxes of the active surfaces in the world, if a query has needed it.
    in_world: OnceLock<BoxTree>,
}

impl SurfaceStates {
    /// What is known about a surface, from the last detection in which it took part.
    #[must_use]
    pub fn get(&self, entity: Entity) -> Option<&SurfaceState> {
        let place = self.entities.iter().position(|other| *other == entity);
        place.map_or_else(|| self.inactive.get(&entity), |place| self.states.get(place))
    }

    /// The active surfaces of the last detection, with their states, in their order.
    pub(crate) fn active(&self, place: u32) -> (Entity, &SurfaceState) {
        (self.entities[place as usize], &self.states[place as usize])
    }

    /// The tree over their boxes in the world.
    pub(crate) fn world_tree(&self) -> &BoxTree {
        self.in_world.get_or_init(|| {
            let bounds = |state: &SurfaceState| state.bounds.in_world.map_or(Aabb::EMPTY, |(_, in_world)| in_world);
            BoxTree::new(&self.states.iter().map(bounds).collect::<Vec<Aabb>>())
        })
    }

    /// Sorts the states like the active surfaces. Drops the states of surfaces that no longer exist.
    pub(super) fn align(&mut self, surfaces: &[ActiveSurface], exists: impl Fn(Entity) -> bool) {
        let Self { entities, states, inactive, in_world } = self;
        in_world.take();
        let are_aligned = entities.iter().copied().eq(surfaces.iter().map(|surface| surface.entity));
        if !are_aligned {
            inactive.extend(entities.drain(..).zip(states.drain(..)));
            entities.extend(surfaces.iter().map(|surface| surface.entity));
            states.extend(entities.iter().map(|entity| inactive.remove(entity).unwrap_or_default()));
            capacity::trim(entities, surfaces.len());
            capacity::trim(states, surfaces.len());
        }
        let count = inactive.len();
        inactive.retain(|entity, _| exists(*entity));
        if inactive.len() < count {
            let left = inactive.len();
            inactive.shrink_to(2 * left);
        }
    }

    pub(super) fn all(&self) -> &[SurfaceState] {
        &self.states
    }

    pub(super) fn all_mut(&mut self) -> &mut [SurfaceState] {
        &mut self.states
    }
}
