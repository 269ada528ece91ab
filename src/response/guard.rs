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
        bounds::Aabb,
        ccd::{ImpactCause, PairImpact, SweepBuffers, SweepTree, SweptMesh, sweep},
        exact::Feature,
        pose::Pose,
        topology::SurfaceTopology,
        tree::BoxTree,
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
    /// Whether it is a body that nothing goes through.
    is_guarded: bool,
    /// How far each triangle may move without meeting anything that moves no farther than its own reach.
    reaches: Vec<f64>,
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
        SweptMesh { topology: &self.topology, start, end, reach: 0.0 }
    }

    /// Brings the boxes up to date with the ways.
    fn follow_ways(&mut self, particles: &Particles) {
        let mut tree = std::mem::take(&mut self.tree);
        tree.update_with_reaches(&self.swept(particles), &self.reaches);
        tree.update_tree();
        self.tree = tree;
        self.stale = false;
    }

    /// Lets every triangle reach as far as what touches nothing may, `distance` being how far it is from everything.
    fn reach_all(&mut self, distance: f64) {
        self.reaches.clear();
        self.reaches.resize(self.topology.triangles().len(), SHARE_OF_DISTANCE * distance);
    }

    /// A triangle that is as far as `distance` from another one reaches no farther than that allows.
    fn reach_less(&mut self, triangle: u32, distance: f64) {
        let reach = &mut self.reaches[triangle as usize];
        *reach = reach.min(SHARE_OF_DISTANCE * distance);
    }

    /// Where detection has seen a vertex at the end of its way, what it has found of distances tells nothing of the beginning.
    fn forget_driven(&mut self, particles: &Particles) {
        let Self { topology, reaches, obstacle, first, .. } = self;
        // Vertices of a body follow those that they are welded to, those of other surfaces need not.
        let triangles = if first.is_some() { topology.welded_triangles() } else { topology.triangles() };
        let is_driven = |vertex: u32| match *first {
            Some(first) => {
                let particle = first + vertex as usize;
                particles.inverse_mass[particle] <= 0.0 && particles.start[particle] != particles.end[particle]
            }
            None => obstacle.start[vertex as usize] != obstacle.end[vertex as usize],
        };
        for (reach, corners) in reaches.iter_mut().zip(triangles) {
            if corners.iter().any(|&corner| is_driven(corner)) {
                *reach = f64::NEG_INFINITY;
            }
        }
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
    reaches: Vec<f64>,
    tree: SweepTree,
    tick: u64,
}

/// Keeps trees and obstacles from tick to tick.
#[derive(Default)]
pub(super) struct Guard {
    kept: EntityHashMap<Kept>,
    meshes: Vec<Mesh>,
    pairs: Vec<MeshPair>,
    /// The boxes of all meshes, a tree over them, and which of them overlap.
    bounds: Vec<Aabb>,
    tree: BoxTree,
    places: Vec<[u32; 2]>,
    /// The places of surfaces among the meshes.
    by_entity: EntityHashMap<usize>,
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
        for Mesh { entity, obstacle, reaches, tree, .. } in meshes.drain(..) {
            kept.insert(entity, Kept { obstacle, reaches, tree, tick: *tick });
        }
        kept.retain(|_, kept| kept.tick == *tick);
        guarded
    }

    /// Lists the meshes of this tick, and which of them are near enough to meet.
    fn gather(&mut self, particles: &Particles, scene: &Scene<'_, '_>, first: impl Fn(Entity) -> Option<usize>) {
        let Self { kept, meshes, by_entity, tick, .. } = self;
        by_entity.clear();
        for (place, surface) in scene.active.surfaces.iter().enumerate() {
            let Some((positions, _)) = scene.positions.get(surface.entity).ok() else { continue };
            let first = first(surface.entity);
            let (mut obstacle, reaches, tree, last) = match kept.remove(&surface.entity) {
                Some(kept) => (kept.obstacle, kept.reaches, kept.tree, kept.tick),
                None => (Obstacle::default(), Vec::new(), SweepTree::default(), 0),
            };
            let mut has_moved = || obstacle.follow(&positions.0, &surface.pose, last + 1 != *tick || surface.fresh);
            let stale = first.is_some() || has_moved();
            by_entity.insert(surface.entity, meshes.len());
            meshes.push(Mesh {
                place,
                entity: surface.entity,
                topology: Arc::clone(&surface.topology),
                layers: surface.layers,
                thickness: f64::from(surface.thickness),
                meets_itself: surface.self_collision,
                first,
                obstacle,
                is_guarded: first.is_some() && scene.is_swept(surface.entity),
                reaches,
                tree,
                stale,
            });
        }
        self.reach(particles, scene);
        for mesh in &mut self.meshes {
            if mesh.stale {
                mesh.follow_ways(particles);
            } else {
                mesh.tree.update_reaches(&mesh.reaches);
            }
        }
        self.pair_meshes(scene);
    }

    /// Tells every triangle how far it reaches, by how far detection has found it from the others: surfaces that do not touch
    /// are farther apart than the contact distance, which is the sum of what each may come near.
    fn reach(&mut self, particles: &Particles, scene: &Scene<'_, '_>) {
        let Self { meshes, by_entity, .. } = self;
        for mesh in &mut *meshes {
            let clear = 2.0 * mesh.thickness;
            // Other methods than the exact ones do not list all that touches.
            let is_exact = scene.active.surfaces[mesh.place].method.is_exact();
            mesh.reach_all(if is_exact { clear } else { scene.nearest(mesh.entity).unwrap_or(clear).min(clear) });
        }
        for (sides, touching) in scene.touching() {
            let places = sides.map(|side| by_entity.get(&side).copied());
            // Only what meets a body that nothing goes through is looked at. Some lists are written when they are read.
            if !places.iter().flatten().any(|&place| meshes[place].is_guarded) {
                continue;
            }
            for pair in touching.iter() {
                for (place, triangle) in places.into_iter().zip([pair.triangle_a, pair.triangle_b]) {
                    if let Some(place) = place {
                        meshes[place].reach_less(triangle, pair.distance);
                    }
                }
            }
        }
        for mesh in meshes {
            mesh.forget_driven(particles);
        }
    }

    fn pair_meshes(&mut self, scene: &Scene<'_, '_>) {
        let Self { meshes, pairs, bounds, tree, places, .. } = self;
        bounds.clear();
        bounds.extend(meshes.iter().map(|mesh| mesh.tree.bounds().grown(mesh.thickness as f32)));
        tree.rebuild(bounds);
        places.clear();
        tree.self_pairs(places);
        places.extend((0..).zip(&*meshes).filter(|(_, mesh)| mesh.meets_itself).map(|(place, _)| [place, place]));
        places.sort_unstable();
        pairs.clear();
        for &pair in &*places {
            let places = pair.map(|place| place as usize);
            let [mesh, other] = places.map(|place| &meshes[place]);
            let may_meet = pair[0] == pair[1] || mesh.layers.interacts_with(other.layers);
            let is_any_fast = mesh.tree.fast_count() + other.tree.fast_count() > 0;
            if may_meet && is_any_fast && (mesh.is_guarded || other.is_guarded) {
                let contact_distance = mesh.thickness + other.thickness;
                let nearest = scene.nearest_of(mesh.entity, other.entity).unwrap_or(contact_distance);
                pairs.push(MeshPair { places, separation: (KEPT_APART * contact_distance).min(0.5 * nearest) });
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
