//! Last step of the solver: no vertex of a body with [`SweptCollision`](crate::SweptCollision) goes through anything.
//!
//! The way of every vertex, from where the tick began to where it was solved to be, is swept against the ways of all that
//! it may meet. Where two features would meet, both stop short of it, and the ways that are left are swept again, until
//! nothing meets. Where nothing moves, nothing can: in the worst case a body stays where it was.

use std::sync::Arc;

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use glam::{DVec3, Vec3};

use super::{
    gather::{MeetingTriangles, Scene},
    particles::Particles,
};
use crate::{
    kernel::{
        ccd::{ImpactCause, PairImpact, SweepBuffers, SweepTree, SweptMesh, sweep},
        exact::Feature,
        pose::Pose,
        topology::SurfaceTopology,
    },
    surface::SurfaceLayers,
};

/// Features are kept apart by this share of the contact distance, or half of what they began with where that is less.
const KEPT_APART: f64 = 0.02;

/// This share of the way to an impact is gone.
const SHARE_OF_WAY: f64 = 0.9;

/// Two triangles that are apart cannot meet while their vertices move by less than this share of the distance, each.
const SHARE_OF_DISTANCE: f64 = 0.49;

/// Rounds after which what meets is not moved at all, and after which whole bodies are not.
const GENTLE_ROUNDS: usize = 8;
const MOST_ROUNDS: usize = 24;

/// What the guard did in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Guarded {
    /// Impacts on the ways that were solved for.
    pub(super) impacts: usize,
    /// Vertices that were stopped.
    pub(super) stopped: usize,
    /// Impacts that remained: those of bodies that were hit by what nothing stops.
    pub(super) remaining: usize,
}

/// A surface that no solver moves: where it was, where it is, and the boxes between.
#[derive(Default)]
struct Obstacle {
    seen: Vec<Vec3>,
    pose: Pose,
    start: Vec<DVec3>,
    end: Vec<DVec3>,
}

impl Obstacle {
    /// Follows a surface; whether anything has changed.
    fn follow(&mut self, positions: &[Vec3], pose: &Pose, is_new: bool) -> bool {
        let is_same = !is_new && self.pose.has_bits_of(pose) && self.seen == positions;
        if is_same && self.start == self.end {
            return false;
        }
        std::mem::swap(&mut self.start, &mut self.end);
        self.end.clear();
        self.end.extend(positions.iter().map(|position| pose.transform_point(position.as_dvec3())));
        if is_new || self.start.len() != self.end.len() {
            self.start.clone_from(&self.end);
        }
        self.seen.clear();
        self.seen.extend_from_slice(positions);
        self.pose = *pose;
        true
    }
}

/// One mesh of a tick.
struct Mesh {
    /// Its place among the active surfaces.
    place: usize,
    entity: Entity,
    topology: Arc<SurfaceTopology>,
    layers: SurfaceLayers,
    thickness: f64,
    meets_itself: bool,
    /// Its first particle, where it is a body.
    first: Option<usize>,
    obstacle: Obstacle,
    /// Of a body that is not guarded, or stands: infinite.
    reach: f64,
    tree: SweepTree,
    /// Whether the tree may not be that of its ways.
    stale: bool,
}

impl Mesh {
    fn swept<'a>(&'a self, particles: &'a Particles) -> SweptMesh<'a> {
        let (start, end) = match self.first {
            Some(first) => {
                let own = first..first + self.topology.vertex_count();
                (&particles.start[own.clone()], &particles.position[own])
            }
            None => (&self.obstacle.start[..], &self.obstacle.end[..]),
        };
        SweptMesh { topology: &self.topology, start, end, reach: self.reach }
    }

    /// Brings the boxes up to date with the ways.
    fn follow_ways(&mut self, particles: &Particles) {
        if !self.stale {
            return;
        }
        let mut tree = std::mem::take(&mut self.tree);
        tree.update(&self.swept(particles));
        tree.update_tree();
        self.tree = tree;
        self.stale = false;
    }
}

/// Two meshes that may meet on their ways.
#[derive(Clone, Copy)]
struct MeshPair {
    places: [usize; 2],
    separation: f64,
}

/// What is kept of a mesh between ticks: its boxes, and where it was if nothing moves it here.
struct Kept {
    obstacle: Obstacle,
    tree: SweepTree,
    tick: u64,
}

/// Keeps trees and obstacles from tick to tick.
#[derive(Default)]
pub(super) struct Guard {
    kept: EntityHashMap<Kept>,
    meshes: Vec<Mesh>,
    pairs: Vec<MeshPair>,
    /// The share of its way that each particle goes.
    shares: Vec<f64>,
    solved: Vec<DVec3>,
    impacts: Vec<PairImpact>,
    /// What meets on the ways that were solved for, with the places of both meshes.
    found: Vec<([usize; 2], PairImpact)>,
    buffers: SweepBuffers,
    tick: u64,
}

impl Guard {
    /// Looks what would go through something on its way from where the tick began to where it was solved to be. `first` tells
    /// the first particle of a surface that is a body. Returns how many impacts there are.
    pub(super) fn begin(
        &mut self,
        particles: &Particles,
        scene: &Scene<'_, '_>,
        first: impl Fn(Entity) -> Option<usize>,
    ) -> usize {
        self.tick += 1;
        self.pairs.clear();
        self.found.clear();
        if scene.is_any_swept() {
            self.gather(particles, scene, first);
            self.find(particles, |_| true);
        }
        self.found.len()
    }

    /// Looks again, after the tick was solved again.
    pub(super) fn look_again(&mut self, particles: &Particles, scene: &Scene<'_, '_>) -> usize {
        for mesh in self.meshes.iter_mut().filter(|mesh| mesh.first.is_some()) {
            mesh.stale = true;
            mesh.follow_ways(particles);
        }
        self.pair_meshes(scene);
        self.find(particles, |_| true);
        self.found.len()
    }

    /// What was found last: the places of both surfaces among the active ones, and how they meet.
    pub(super) fn found(&self) -> impl Iterator<Item = ([usize; 2], MeetingTriangles)> {
        self.found.iter().map(|(places, found)| {
            let impact = &found.impact;
            let meeting = MeetingTriangles {
                triangles: [found.triangle_a, found.triangle_b],
                features: impact.features,
                barycentrics: [impact.barycentric_a, impact.barycentric_b],
                normal: impact.normal,
            };
            (places.map(|place| self.meshes[place].place), meeting)
        })
    }

    /// Lists what meets, of the pairs with a mesh that is `asked` about.
    fn find(&mut self, particles: &Particles, asked: impl Fn(&Mesh) -> bool) {
        let Self { meshes, pairs, found, impacts, buffers, .. } = self;
        found.clear();
        for &MeshPair { places: [a, b], separation } in &*pairs {
            let (mesh_a, mesh_b) = (&meshes[a], &meshes[b]);
            if !(asked(mesh_a) || asked(mesh_b)) {
                continue;
            }
            impacts.clear();
            let (swept_a, swept_b) = (mesh_a.swept(particles), mesh_b.swept(particles));
            sweep(&swept_a, &mesh_a.tree, &swept_b, &mesh_b.tree, a == b, separation, buffers, impacts);
            let met = impacts.iter().filter(|found| is_met(found.impact.cause));
            found.extend(met.map(|&impact| ([a, b], impact)));
        }
    }

    /// Stops what would still go through something.
    pub(super) fn stop(&mut self, particles: &mut Particles) -> Guarded {
        let mut guarded = Guarded { impacts: self.found.len(), ..Guarded::default() };
        if !self.found.is_empty() {
            self.run(particles, &mut guarded);
        }
        let Self { kept, meshes, tick, .. } = self;
        for Mesh { entity, obstacle, tree, .. } in meshes.drain(..) {
            kept.insert(entity, Kept { obstacle, tree, tick: *tick });
        }
        kept.retain(|_, kept| kept.tick == *tick);
        guarded
    }

    /// Lists the meshes of this tick, and which of them are near enough to meet.
    fn gather(&mut self, particles: &Particles, scene: &Scene<'_, '_>, first: impl Fn(Entity) -> Option<usize>) {
        let Self { kept, meshes, tick, .. } = self;
        let mut has_obstacle_moved = false;
        for (place, surface) in scene.active.surfaces.iter().enumerate() {
            let Some((positions, _)) = scene.positions.get(surface.entity).ok() else { continue };
            let first = first(surface.entity);
            let (mut obstacle, tree, last) = match kept.remove(&surface.entity) {
                Some(kept) => (kept.obstacle, kept.tree, kept.tick),
                None => (Obstacle::default(), SweepTree::default(), 0),
            };
            let mut stale = true;
            if first.is_none() {
                stale = obstacle.follow(&positions.0, &surface.pose, last + 1 != *tick || surface.fresh);
                has_obstacle_moved |= stale && obstacle.start != obstacle.end;
            }
            meshes.push(Mesh {
                place,
                entity: surface.entity,
                topology: Arc::clone(&surface.topology),
                layers: surface.layers,
                thickness: f64::from(surface.thickness),
                meets_itself: surface.self_collision,
                first,
                obstacle,
                reach: if first.is_some() && scene.is_swept(surface.entity) { 0.0 } else { f64::INFINITY },
                tree,
                stale,
            });
        }
        // What was apart when the tick began and moves by less than half of that stays apart. Detection has seen obstacles
        // where they have moved to: of how far they were it tells nothing.
        if !has_obstacle_moved {
            for mesh in meshes.iter_mut().filter(|mesh| mesh.reach == 0.0) {
                mesh.reach = SHARE_OF_DISTANCE * scene.nearest(mesh.entity).unwrap_or(mesh.thickness);
            }
        }
        for mesh in &mut *meshes {
            mesh.follow_ways(particles);
        }
        self.pair_meshes(scene);
    }

    fn pair_meshes(&mut self, scene: &Scene<'_, '_>) {
        let Self { meshes, pairs, .. } = self;
        pairs.clear();
        for (place, mesh) in meshes.iter().enumerate() {
            for (other_place, other) in meshes.iter().enumerate().skip(place) {
                let is_same = place == other_place;
                let may_meet = if is_same { mesh.meets_itself } else { mesh.layers.interacts_with(other.layers) };
                if !may_meet || mesh.tree.fast_count() + other.tree.fast_count() == 0 {
                    continue;
                }
                let contact_distance = mesh.thickness + other.thickness;
                let reach = contact_distance as f32;
                if !mesh.tree.bounds().grown(reach).overlaps(other.tree.bounds()) {
                    continue;
                }
                let nearest = scene.nearest_of(mesh.entity, other.entity).unwrap_or(contact_distance);
                let separation = (KEPT_APART * contact_distance).min(0.5 * nearest);
                pairs.push(MeshPair { places: [place, other_place], separation });
            }
        }
    }

    fn run(&mut self, particles: &mut Particles, guarded: &mut Guarded) {
        self.shares.clear();
        self.shares.resize(particles.len(), 1.0);
        self.solved.clone_from(&particles.position);
        let most = MOST_ROUNDS + self.meshes.len() + 1;
        for round in 0..most {
            // Nothing has moved since what was found for the first round.
            if round > 0 {
                self.find(particles, |mesh| mesh.stale);
            }
            guarded.remaining = 0;
            let mut is_clear = true;
            for ([a, b], found) in &self.found {
                let held = hold(&self.meshes[*a], &self.meshes[*b], particles, &mut self.shares, found, round);
                is_clear &= !held;
                guarded.remaining += usize::from(!held);
            }
            if is_clear {
                break;
            }
            self.shorten(particles);
        }
        let stopped = (0..particles.len()).filter(|&particle| self.shares[particle] < 1.0);
        guarded.stopped = stopped.clone().count();
        for particle in stopped {
            particles.velocity[particle] *= self.shares[particle];
        }
    }

    /// Lets particles go the shares of their ways, and the trees follow.
    fn shorten(&mut self, particles: &mut Particles) {
        let Self { meshes, shares, solved, .. } = self;
        for mesh in meshes {
            let Some(first) = mesh.first else {
                mesh.stale = false;
                continue;
            };
            mesh.stale = false;
            for (vertex, &weld) in mesh.topology.weld().iter().enumerate() {
                let share = shares[first + weld as usize];
                let particle = first + vertex;
                let position = if share < 1.0 {
                    particles.start[particle] + (solved[particle] - particles.start[particle]) * share
                } else {
                    solved[particle]
                };
                mesh.stale |= position != particles.position[particle];
                particles.position[particle] = position;
                shares[particle] = share;
            }
            if mesh.stale {
                mesh.follow_ways(particles);
                mesh.stale = true;
            }
        }
    }
}

/// Whether two triangles meet on their ways; what is together when these begin cannot be kept apart.
fn is_met(cause: ImpactCause) -> bool {
    !matches!(cause, ImpactCause::Within | ImpactCause::Crossing)
}

/// Shortens the ways of what meets; `false` where nothing of it can be stopped any more.
fn hold(
    mesh_a: &Mesh,
    mesh_b: &Mesh,
    particles: &Particles,
    shares: &mut [f64],
    found: &PairImpact,
    round: usize,
) -> bool {
    let mut is_held = false;
    let features = [found.impact.features.a, found.impact.features.b];
    for ((mesh, triangle), feature) in
        [(mesh_a, found.triangle_a), (mesh_b, found.triangle_b)].into_iter().zip(features)
    {
        let Some(first) = mesh.first else { continue };
        let mut shorten = |particle: usize, share: f64| {
            if particles.inverse_mass[particle] > 0.0 && shares[particle] > 0.0 {
                shares[particle] *= share;
                is_held = true;
            }
        };
        if round >= MOST_ROUNDS {
            (first..first + mesh.topology.vertex_count()).for_each(|particle| shorten(particle, 0.0));
            continue;
        }
        let corners = mesh.topology.welded_triangles()[triangle as usize];
        let share = if round < GENTLE_ROUNDS { SHARE_OF_WAY * found.impact.time } else { 0.0 };
        let takes_part = |corner: usize| match feature {
            _ if round >= GENTLE_ROUNDS => true,
            Feature::Vertex(vertex) => vertex as usize == corner,
            Feature::Edge(edge) => (edge as usize + 2) % 3 != corner,
            Feature::Face => true,
        };
        for corner in (0..3).filter(|&corner| takes_part(corner)) {
            shorten(first + corners[corner] as usize, share);
        }
    }
    is_held
}
