//! Last step of the response: the guard, which keeps bodies with [`SweptCollision`](crate::SweptCollision) from passing
//! through things.
//!
//! It sweeps the trajectory of every vertex, from the beginning of the tick to its solved position, against the
//! trajectories of everything that it may collide with. Features that would collide are moved beyond the plane between
//! them, and changed trajectories are swept again until nothing collides. If impacts persist, vertices are joined into
//! impact zones (X. Provot 1997; D. Harmon et al. 2008, "Robust treatment of simultaneous collisions"). A zone stops,
//! or moves along with the kinematic object that pushes it. Bodies between two kinematic objects may cross each other,
//! and may stay inside an object if no way is left.

mod gather;
mod impacts;
mod mesh;
mod project;
mod ways;

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_platform::collections::HashMap;
use glam::DVec3;

pub(super) use self::gather::is_large;
use self::{
    impacts::{deeper, is_met, keep_first},
    mesh::{Kept, Mesh, MeshName, MeshPair},
    project::{Answers, Planes},
    ways::{Carry, MOST_ROUNDS, Ways, hold, way_of},
};
use super::{gather::Gatherer, meeting::MeetingTriangles, particles::Particles, scene::Scene};
use crate::{
    detection::Sweeping,
    kernel::{
        bvh::tree::BoxTree,
        ccd::{ImpactCause, ImpactList, PairImpact, Sweep},
        exact::triangle_pair::PairProximity,
        mesh::bounds::Aabb,
        simd::parallel::Team,
        xpbd::RigidBodies,
    },
    surface::{ContactFilter, PairFilter},
};

/// Rounds that project the ends of trajectories, then rounds that stop or carry along colliding vertices, then rounds
/// that do so with whole bodies. Impacts that persist are between objects that nothing stops.
const PROJECTIONS: usize = 12;
const LAST_ROUNDS: usize = 12;

/// Terminates a list of particles.
const NO_PARTICLE: u32 = u32::MAX;

/// A body is jammed if it collides with itself in more places than this factor times its number of vertices. Resolving
/// all of them takes longer than a game can wait, and would lock the body in that state.
const MOST_OWN_IMPACTS: usize = 1;

/// What the guard did in a tick.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Guarded {
    /// Impacts along the solved trajectories.
    pub(super) impacts: usize,
    /// Vertices that were moved or stopped.
    pub(super) stopped: usize,
    /// Impacts that remain: bodies hit by objects that nothing stops.
    pub(super) remaining: usize,
    /// Bodies that collide with themselves in so many places that they are no longer kept from crossing themselves.
    pub(super) jammed: Vec<Entity>,
}
/// State of the guard. Trees and obstacles are kept between ticks.
#[derive(Default)]
pub(super) struct Guard {
    kept: HashMap<MeshName, Kept>,
    meshes: Vec<Mesh>,
    pairs: Vec<MeshPair>,
    /// The boxes of all meshes, a tree over them, and the pairs that overlap.
    bounds: Vec<Aabb>,
    tree: BoxTree,
    places: Vec<[u32; 2]>,
    /// Mesh index of each surface.
    by_entity: EntityHashMap<usize>,
    /// How colliding objects carry particles along.
    carried: Vec<Option<Carry>>,
    /// Separating planes of all impacts.
    planes: Planes,
    /// Impact zones, as a union-find forest: each particle names another one of its zone, or itself.
    zones: Vec<u32>,
    /// The particles of every impact that could not be resolved in this round. `NO_PARTICLE` terminates each list.
    refused: Vec<u32>,
    /// Particles whose trajectories have changed in this round.
    changed: Vec<bool>,
    /// Particles that move with what carries them, or stay where they began.
    stopped: Vec<bool>,
    /// Solved positions.
    solved: Vec<DVec3>,
    impacts: Vec<PairImpact>,
    /// Mesh indices of jammed bodies. They may cross themselves.
    jammed: Vec<usize>,
    /// Impacts along the current trajectories.
    found: Vec<(MeshPair, PairImpact)>,
    sweeping: Sweeping,
    scratch: PairProximity,
    filter: Option<ContactFilter>,
    /// Whether the tick is not solved again: what remains is stopped.
    is_solved: bool,
    tick: u64,
}

impl Guard {
    /// Sweeps everything from the beginning of the tick to the solved positions. Returns the number of impacts.
    pub(super) fn begin(
        &mut self,
        team: &dyn Team,
        particles: &Particles,
        scene: &Scene<'_, '_>,
        gatherer: &Gatherer,
    ) -> usize {
        self.tick += 1;
        self.filter = scene.filter.as_deref().cloned();
        self.pairs.clear();
        self.found.clear();
        self.jammed.clear();
        self.is_solved = false;
        if scene.is_any_swept() {
            self.gather(team, particles, scene, |entity| gatherer.first_particle(entity));
            self.find(team, particles, gatherer, |_| true);
        }
        self.solved.clone_from(&particles.position);
        self.found.len()
    }

    /// Sweeps again after the tick was solved again. Returns the number of impacts.
    pub(super) fn look_again(
        &mut self,
        team: &dyn Team,
        particles: &Particles,
        scene: &Scene<'_, '_>,
        gatherer: &Gatherer,
    ) -> usize {
        let Self { meshes, solved, found, .. } = self;
        for mesh in &mut *meshes {
            let Some(first) = mesh.first else {
                if let Some(course) = scene.motions.course(mesh.name.entity)
                    && let Some(end) = &course.pushed
                {
                    mesh.obstacle.end_at([&course.now.pose, end]);
                    mesh.follow_ways(team, particles);
                    mesh.stale = true;
                }
                continue;
            };
            let own = first..first + mesh.topology.vertex_count();
            // A body without new impacts has the same solved positions as before.
            if particles.position[own.clone()] != solved[own] {
                mesh.follow_ways(team, particles);
                mesh.stale = true;
            }
        }
        found.retain(|(pair, _)| pair.places.into_iter().all(|place| !meshes[place].stale));
        self.solved.clone_from(&particles.position);
        self.pair_again(scene);
        self.find(team, particles, gatherer, |mesh| mesh.stale);
        self.meshes.iter_mut().for_each(|mesh| mesh.stale = false);
        self.found.len()
    }

    /// Finds the pairs of meshes that may collide along their current trajectories.
    fn pair_again(&mut self, scene: &Scene<'_, '_>) {
        self.pair_meshes(scene);
        let jammed = &self.jammed;
        self.pairs.retain(|pair| pair.places[0] != pair.places[1] || !jammed.contains(&pair.places[0]));
    }

    /// Finds the impacts of meshes that have changed. A mesh that was pushed may reach others that it was not near
    /// before.
    fn find_again(&mut self, team: &dyn Team, particles: &Particles, scene: &Scene<'_, '_>, gatherer: &Gatherer) {
        self.pair_again(scene);
        self.found.clear();
        self.find(team, particles, gatherer, |mesh| mesh.stale);
    }

    /// The impacts found last.
    pub(super) fn found(&self, particles: &Particles) -> Vec<MeetingTriangles> {
        let meetings = self.found.iter().map(|(MeshPair { places: [a, b], .. }, found)| {
            let impact = &found.impact;
            MeetingTriangles {
                sides: [
                    self.meshes[*a].side(particles, found.triangle_a),
                    self.meshes[*b].side(particles, found.triangle_b),
                ],
                features: impact.features,
                barycentrics: [impact.barycentric_a, impact.barycentric_b],
                normal: -impact.normal,
            }
        });
        meetings.collect()
    }

    /// Appends the impacts of pairs with at least one mesh for which `requested` returns true.
    fn find(&mut self, team: &dyn Team, particles: &Particles, gatherer: &Gatherer, requested: impl Fn(&Mesh) -> bool) {
        let Self { meshes, pairs, found, impacts, sweeping, jammed, scratch, filter: game, is_solved, .. } = self;
        for pair in &*pairs {
            let MeshPair { places: [a, b], separation, clearance, .. } = *pair;
            let separation = if *is_solved { separation } else { clearance };
            let (mesh_a, mesh_b) = (&meshes[a], &meshes[b]);
            if !(requested(mesh_a) || requested(mesh_b)) {
                continue;
            }
            let (swept_a, swept_b) = (mesh_a.swept(particles), mesh_b.swept(particles));
            let sides = ((swept_a, &mesh_a.tree), (swept_b, &mesh_b.tree));
            let filter = PairFilter::between(&mesh_a.filter, &mesh_b.filter, a == b, game.as_ref());
            let is_round = mesh_a.radius + mesh_b.radius > 0.0;
            let list = match filter {
                // A pair that the game leaves out may be the one in which features are tested.
                Some(_) => ImpactList::Triangles,
                // What is within a radius and being pushed out must not hide what is behind it.
                None if mesh_b.shape.is_some() && !is_round => ImpactList::Solid,
                None => ImpactList::Features,
            };
            let sweep = Sweep { a: sides.0, b: sides.1, same_surface: a == b, list, separation };
            sweeping.run(&sweep, filter.as_ref(), &team, impacts);
            let before = found.len();
            let is_leaving = |found: &PairImpact| {
                let (features, ways) = (found.impact.features, (particles, gatherer));
                mesh_a.is_leaving(found.triangle_a, features.a, mesh_b, ways)
                    || mesh_b.is_leaving(found.triangle_b, features.b, mesh_a, ways)
            };
            found.extend(impacts.iter().filter(|impact| !is_leaving(impact)).filter_map(|&impact| {
                match impact.impact.cause {
                    ImpactCause::Within if is_round => {
                        Some((*pair, deeper(&swept_a, &swept_b, impact, separation, scratch)?))
                    }
                    cause => is_met(cause).then_some((*pair, impact)),
                }
            }));
            if list == ImpactList::Solid {
                keep_first(found, before);
            }
            if a == b && impacts.len() > MOST_OWN_IMPACTS * mesh_a.topology.vertex_count() {
                found.truncate(before);
                jammed.push(a);
            }
        }
        pairs.retain(|pair| pair.places[0] != pair.places[1] || !jammed.contains(&pair.places[0]));
    }

    /// Stops everything that would still pass through something, in a part of the tick that lasts `duration` seconds.
    pub(super) fn stop(
        &mut self,
        team: &dyn Team,
        (particles, bodies): (&mut Particles, &mut RigidBodies),
        scene: &Scene<'_, '_>,
        duration: f64,
        gatherer: &mut Gatherer,
    ) -> Guarded {
        // For the solver they were too close.
        self.is_solved = true;
        if !self.found.is_empty() {
            self.found.clear();
            self.find(team, particles, gatherer, |_| true);
        }
        let jammed = self.jammed.iter().map(|&place| self.meshes[place].name.entity).collect();
        let mut guarded = Guarded { impacts: self.found.len(), jammed, ..Guarded::default() };
        if !self.found.is_empty() {
            self.run(team, (particles, bodies), scene, duration, gatherer, &mut guarded);
        }
        let Self { kept, meshes, tick, .. } = self;
        for Mesh { name, obstacle, reaches, tree, .. } in meshes.drain(..) {
            kept.insert(name, Kept { obstacle, reaches, tree, tick: *tick });
        }
        kept.retain(|_, kept| kept.tick == *tick);
        guarded
    }

    fn run(
        &mut self,
        team: &dyn Team,
        (particles, bodies): (&mut Particles, &mut RigidBodies),
        scene: &Scene<'_, '_>,
        duration: f64,
        gatherer: &mut Gatherer,
        guarded: &mut Guarded,
    ) {
        self.planes.clear();
        for _ in 0..PROJECTIONS {
            let Self { meshes, found, planes, changed, solved, .. } = self;
            let answers = Answers { scene, gatherer, bodies };
            for impact in &*found {
                planes.add(particles, solved, meshes, impact, &answers, duration);
            }
            changed.clear();
            changed.resize(particles.len(), false);
            planes.project(particles, changed);
            self.follow(team, particles);
            self.find_again(team, particles, scene, gatherer);
            if self.found.is_empty() {
                break;
            }
        }
        self.planes.settle_velocities(particles, bodies, &mut gatherer.reactions);
        let is_elsewhere = |(solved, position): &(&DVec3, &DVec3)| solved != position;
        guarded.stopped += self.solved.iter().zip(&particles.position).filter(is_elsewhere).count();
        if !self.found.is_empty() {
            self.hold(team, particles, scene, duration, gatherer, guarded);
        }
    }

    /// Stops impacts that projection did not resolve.
    fn hold(
        &mut self,
        team: &dyn Team,
        particles: &mut Particles,
        scene: &Scene<'_, '_>,
        duration: f64,
        gatherer: &Gatherer,
        guarded: &mut Guarded,
    ) {
        self.stopped.clear();
        self.stopped.resize(particles.len(), false);
        self.carried.clear();
        self.carried.resize(particles.len(), None);
        self.zones.clear();
        self.zones.extend(0..particles.len() as u32);
        for round in 0..MOST_ROUNDS + LAST_ROUNDS {
            if round > 0 {
                self.find_again(team, particles, scene, gatherer);
            }
            let mut is_clear = true;
            self.refused.clear();
            self.changed.clear();
            self.changed.resize(particles.len(), false);
            let Self { meshes, found, refused, stopped, carried, changed, zones, .. } = self;
            let mut ways = Ways { particles: &*particles, stopped, carried, changed, zones };
            for (pair, found) in &*found {
                let [a, b] = pair.places;
                let held = hold(&meshes[a], &meshes[b], &mut ways, found, round);
                is_clear &= !held;
                if !held {
                    refused.extend(meshes[a].corners(found.triangle_a).into_iter().flatten());
                    refused.extend(meshes[b].corners(found.triangle_b).into_iter().flatten());
                    refused.push(NO_PARTICLE);
                }
            }
            if round < MOST_ROUNDS {
                ways.go_by_zones();
            }
            // Impacts whose particles were moved by others are tested again in the next round.
            let left =
                |corners: &&[u32]| !corners.is_empty() && !corners.iter().any(|&corner| changed[corner as usize]);
            guarded.remaining += refused.split(|&corner| corner == NO_PARTICLE).filter(left).count();
            if is_clear {
                break;
            }
            for particle in (0..particles.len()).filter(|&particle| self.stopped[particle]) {
                let start = particles.start[particle];
                particles.position[particle] = start + way_of(self.carried[particle], start);
            }
            self.follow(team, particles);
        }
        for particle in (0..particles.len()).filter(|&particle| self.stopped[particle]) {
            guarded.stopped += 1;
            let start = particles.start[particle];
            particles.velocity[particle] = way_of(self.carried[particle], start) / duration;
        }
    }

    /// Updates welded vertices and trees after particles have changed.
    fn follow(&mut self, team: &dyn Team, particles: &mut Particles) {
        let Self { meshes, changed, .. } = self;
        for mesh in meshes {
            let Some(first) = mesh.first else {
                mesh.stale = false;
                mesh.tree.ask_only(|_| false);
                continue;
            };
            for (vertex, &weld) in mesh.topology.weld().iter().enumerate() {
                let (particle, weld) = (first + vertex, first + weld as usize);
                changed[particle] |= changed[weld];
                particles.position[particle] = particles.position[weld];
            }
            mesh.stale = (first..first + mesh.topology.vertex_count()).any(|particle| changed[particle]);
            if mesh.stale {
                mesh.follow_ways(team, particles);
                mesh.stale = true;
            }
            // Unchanged triangles have been tested already.
            let is_changed = |corners: &[u32; 3]| corners.iter().any(|&corner| changed[first + corner as usize]);
            let triangles = mesh.topology.welded_triangles();
            mesh.tree.ask_only(|triangle| is_changed(&triangles[triangle]));
        }
    }
}
