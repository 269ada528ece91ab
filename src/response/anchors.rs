//! What holds each vertex of a stiff cloth: the nearest pinned vertex, and how far away it can be at most.

use std::sync::Arc;

use bevy_ecs::{entity::EntityHashMap, prelude::*};

use super::{
    rest::RestShape,
    solver::{Solver, SolverBody},
};
use crate::kernel::mesh::{edge_distances::nearest_along_edges, ids::VertexId, topology::SurfaceTopology};

/// The anchors of all bodies, found again when other vertices are pinned. They follow from the bodies of a tick alone.
#[derive(Default)]
pub(super) struct Anchors {
    bodies: EntityHashMap<BodyAnchors>,
    tick: u64,
}

struct BodyAnchors {
    rest: Arc<RestShape>,
    is_pinned: Vec<bool>,
    /// For each group of pins, the nearest of them to each vertex along the edges, and the length of the way at rest.
    nearest: Vec<Vec<Option<(u32, f32)>>>,
    tick: u64,
}

impl Anchors {
    /// Begins a tick: forgets bodies that did not take part in the last one.
    pub(super) fn begin(&mut self) {
        self.bodies.retain(|_, body| body.tick == self.tick);
        self.tick += 1;
    }

    /// Attaches the vertices of the body that was added last to the solver. Only if its edges are as stiff as the solver
    /// can make them: all others may stretch.
    pub(super) fn attach(&mut self, solver: &mut Solver, entity: Entity) {
        let Some(body) = solver.bodies.last() else { return };
        let &SolverBody { first, scale, material, .. } = body;
        if material.stretch_compliance > 0.0 {
            return;
        }
        let (topology, rest) = (Arc::clone(&body.topology), Arc::clone(&body.rest));
        let inverse_masses = &solver.particles.inverse_mass[first..];
        let is_pinned = || topology.weld().iter().map(|&own| inverse_masses[own as usize] <= 0.0);
        if !is_pinned().any(|is_pinned| is_pinned) {
            return;
        }
        let is_known =
            |known: &BodyAnchors| Arc::ptr_eq(&known.rest, &rest) && known.is_pinned.iter().copied().eq(is_pinned());
        let tick = self.tick;
        let known = if let Some(known) = self.bodies.remove(&entity).filter(is_known) {
            BodyAnchors { tick, ..known }
        } else {
            let is_pinned: Vec<bool> = is_pinned().collect();
            let groups = groups_of(&topology, &is_pinned);
            let along_edges = |pins: Vec<u32>| nearest_along_edges(&topology, &rest.positions, pins.into_iter());
            let nearest = groups.into_iter().map(along_edges).collect();
            BodyAnchors { rest, is_pinned, nearest, tick }
        };
        for nearest in &known.nearest {
            let free =
                (0..).zip(topology.weld()).filter(|&(vertex, &own)| vertex == own && !known.is_pinned[own as usize]);
            let attached = free.filter_map(|(vertex, _)| Some((vertex, nearest[vertex as usize]?)));
            solver.attach(attached.map(|(vertex, (anchor, length))| {
                ([vertex, anchor].map(|vertex| first + vertex as usize), f64::from(length) * scale)
            }));
        }
        self.bodies.insert(entity, known);
    }
}

/// With more groups of pins than this, all pins are one group.
const MOST_GROUPS: usize = 4;

/// The pins in groups, joined by triangles. A vertex is held by the nearest pin of each group: a flag by the near corners
/// of both its ends, a skirt by the vertex of the belt above.
fn groups_of(topology: &SurfaceTopology, is_pinned: &[bool]) -> Vec<Vec<u32>> {
    let pins = || (0..).zip(is_pinned).filter(|&(_, &is_pinned)| is_pinned).map(|(vertex, _)| vertex);
    let mut is_left = is_pinned.to_vec();
    let (mut groups, mut open) = (Vec::new(), Vec::new());
    for seed in pins() {
        let mut group = Vec::new();
        open.push(seed);
        while let Some(pin) = open.pop() {
            if !std::mem::take(&mut is_left[pin as usize]) {
                continue;
            }
            group.push(pin);
            let around = topology.triangles_of_vertex(VertexId(pin));
            let corners = around.iter().flat_map(|&triangle| topology.triangles()[triangle as usize]);
            open.extend(corners.filter(|&corner| is_left[corner as usize]));
        }
        if !group.is_empty() {
            groups.push(group);
        }
    }
    if groups.len() > MOST_GROUPS { vec![pins().collect()] } else { groups }
}
