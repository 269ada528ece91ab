//! From entities to the solver: bodies become particles, and contacts become constraints on them.
//!
//! All vertices of bodies are particles in world space. Of other objects, only the vertices that contacts touch are.
//! Contacts are taken in the order of the store.

mod constraint;
mod driven;
mod internal_edges;
mod tangled;
mod watch;
mod wave;

use std::sync::Arc;

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_platform::collections::HashMap;
use glam::{DVec3, Vec3};

pub(super) use self::watch::Watch;
use self::{
    driven::Driven,
    watch::Unwatched,
    wave::{Fate, Wave},
};
use super::{
    anchors::Anchors,
    body::XpbdBody,
    contact::{ContactConstraint, Features},
    forces::{SurfaceForces, SurfaceWind},
    inside::Insides,
    known::KnownFeatures,
    meeting::{MeetingCorners, MeetingTriangles},
    motion::Motions,
    particles::Particles,
    reaction::{NO_REACTION, Reactions},
    record::{edges_of, face_of, weighted},
    scene::Scene,
    solver::{Solver, SolverBody},
};
use crate::{
    contacts::StoredPair,
    kernel::{
        contact::CompactContact,
        mesh::{feature::Feature, ids::VertexId, topology::SurfaceTopology},
        pose::Pose,
        simd::parallel::Team,
        xpbd::coloring::NONE,
    },
    surface::{ActiveSurface, ContactSide},
};

/// Turns the contacts of a tick into constraints.
#[derive(Default)]
pub(super) struct Gatherer {
    driven: EntityHashMap<Driven>,
    bodies: EntityHashMap<usize>,
    anchors: Anchors,
    tick: u64,
    known: KnownFeatures,
    /// How far each particle would move in the tick if nothing pushed it, for contacts of bodies.
    ahead: Vec<Vec3>,
    wave: Wave,
    /// Whether each of those particles has been pushed.
    pushed: Vec<bool>,
    /// The contacts that are not watched.
    unwatched: Vec<Unwatched>,
    /// The particles of all triangles that cross in the current pair, with how often each one's triangles do.
    tangled: HashMap<u32, u32>,
    /// Unit vector along which the first side of the current pair moves back against the second, if a part of either is
    /// cut off.
    back: Option<DVec3>,
    pub(super) insides: Insides,
    pub(super) reactions: Reactions,
    /// The numbers of the rigid bodies that shapes belong to.
    rigid_bodies: EntityHashMap<u32>,
}

/// One side of a pair, as the solver sees it.
#[derive(Clone, Copy)]
enum Side<'a> {
    Body { first: usize, topology: &'a SurfaceTopology },
    Driven { entity: Entity, topology: &'a SurfaceTopology },
    Shape { entity: Entity },
}

/// A pair, as the solver sees it.
#[derive(Clone, Copy)]
struct Between<'a> {
    pair: &'a StoredPair,
    sides: [Side<'a>; 2],
    friction: [f64; 2],
}

impl<'a> Side<'a> {
    const fn topology(self) -> Option<&'a SurfaceTopology> {
        match self {
            Self::Body { topology, .. } | Self::Driven { topology, .. } => Some(topology),
            Self::Shape { .. } => None,
        }
    }

    /// The particles of a triangle's corners; [`NONE`] if it belongs to no body.
    fn particles(self, triangle: u32) -> [u32; 3] {
        match self {
            Self::Body { first, topology } => {
                topology.welded_triangles()[triangle as usize].map(|vertex| first as u32 + vertex)
            }
            Self::Driven { .. } | Self::Shape { .. } => [NONE; 3],
        }
    }
}

impl Gatherer {
    /// Forgets the particles of the last tick.
    pub(super) fn begin(&mut self) {
        self.tick += 1;
        self.anchors.begin();
        self.bodies.clear();
        self.rigid_bodies.clear();
        self.reactions.begin_part();
        for driven in self.driven.values_mut() {
            for vertex in driven.used.drain(..) {
                driven.slots[vertex as usize] = NONE;
            }
        }
    }

    /// Makes the vertices of a body particles. Pinned vertices are kinematic: they move to where the game has written
    /// them.
    pub(super) fn add_body(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        surface: &ActiveSurface,
        positions: &[Vec3],
        body: &XpbdBody,
    ) {
        let Solver { particles, bodies, .. } = solver;
        let first = particles.len();
        let world = |position: Vec3| surface.pose.transform_point(position.as_dvec3());
        let course = scene.motions.course(surface.entity);
        let weld = surface.topology.weld();
        for (vertex, &position) in positions.iter().enumerate() {
            let inverse_mass = f64::from(body.inverse_masses[vertex]);
            if inverse_mass > 0.0 {
                particles.push_moved(world(position), body.velocities[vertex].as_dvec3(), inverse_mass);
            } else {
                let ends = course.map(|course| [&course.now, &course.ahead].map(|stand| stand.point(vertex)));
                let [start, end] = ends.unwrap_or([world(position); 2]);
                particles.push_driven(start, end);
            }
            let own = weld[vertex] as usize;
            if own != vertex && inverse_mass <= 0.0 && particles.inverse_mass[first + own] > 0.0 {
                particles.pin(first + own, first + vertex);
            }
        }
        let (topology, rest) = (Arc::clone(&surface.topology), Arc::clone(&body.rest));
        let air = scene.winds.get(surface.entity).ok().map(SurfaceWind::air);
        bodies.push(SolverBody { first, topology, rest, material: body.material, scale: surface.pose.scale(), air });
        self.bodies.insert(surface.entity, first);
        if let Ok(tethers) = scene.tethers.get(surface.entity) {
            let particle_of = |vertex: VertexId| Some(first as u32 + weld.get(vertex.index())?);
            tethers.in_part(scene.motions.shares(), particle_of).for_each(|tether| solver.tether(&tether));
        }
        self.anchors.attach(solver, surface.entity);
        if let Ok(SurfaceForces(forces)) = scene.forces.get(surface.entity)
            && forces.len() == weld.len()
        {
            let acting = weld.iter().zip(forces).filter(|(_, force)| force.is_finite() && **force != Vec3::ZERO);
            solver.forces.extend(acting.map(|(&own, &force)| ((first + own as usize) as u32, force)));
        }
    }

    /// Lets contacts push the rigid bodies of shapes that are near something.
    pub(super) fn add_rigid_bodies(&mut self, solver: &mut Solver, motions: &mut Motions) {
        motions.hand_over(&mut solver.rigid_bodies, |shape, body| {
            self.rigid_bodies.insert(shape, body);
        });
    }

    /// The number of the rigid body that a shape belongs to, if contacts push that.
    pub(super) fn rigid_body(&self, shape: Entity) -> Option<u32> {
        self.rigid_bodies.get(&shape).copied()
    }

    /// Whether something that the solver does not move has a mass or wants its reaction.
    pub(super) fn answers(&self, scene: &Scene<'_, '_>, entity: Entity) -> bool {
        !self.bodies.contains_key(&entity) && (self.rigid_bodies.contains_key(&entity) || scene.wants_reaction(entity))
    }

    pub(super) fn first_particle(&self, entity: Entity) -> Option<usize> {
        self.bodies.get(&entity).copied()
    }

    /// Makes constraints of those contacts with a body on at least one side that may act.
    pub(super) fn add_contacts(&mut self, team: &dyn Team, solver: &mut Solver, scene: &Scene<'_, '_>, watch: Watch) {
        self.look_ahead(&solver.particles, watch);
        self.known.clear();
        self.unwatched.clear();
        for (pair_place, pair) in (0..).zip(&scene.store.pairs) {
            let sides = self.sides(pair);
            if !sides.iter().any(|side| matches!(side, Side::Body { .. })) {
                continue;
            }
            self.find_tangled(&mut solver.particles, scene, pair);
            let between = Between { pair, sides, friction: scene.friction(pair.a.entity(), pair.b.entity()) };
            let mut wave = std::mem::take(&mut self.wave);
            let mut place = 0;
            for records in pair.contacts.chunks(Wave::SIZE) {
                wave.fill(self, team, (&solver.particles, scene), &between, records, watch);
                for (record, (fate, made)) in records.iter().zip(wave.fates()) {
                    match (fate, made) {
                        (Fate::Unwatched, _) => {
                            let particles = [(sides[0], record.triangle_a), (sides[1], record.triangle_b)];
                            let particles = particles.map(|(side, triangle)| side.particles(triangle));
                            self.unwatched.push(Unwatched { pair: pair_place, place, particles });
                        }
                        (Fate::Later, _) => self.add_contact(solver, scene, &between, record),
                        (Fate::Made, Some(made)) => self.add_constraint(solver, scene, pair, record, made),
                        (Fate::Made | Fate::Dropped, _) => {}
                    }
                    place += 1;
                }
            }
            self.wave = wave;
        }
    }

    /// Makes a constraint of a contact, unless there is one of the same features.
    fn add_contact(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        between: &Between<'_>,
        record: &CompactContact,
    ) {
        if let Some(mut constraint) = self.constraint(&mut solver.particles, scene, between, record) {
            self.add_constraint(solver, scene, between.pair, record, &mut constraint);
        }
    }

    /// Adds the constraint of a contact, unless there is one of the same features. A vertex beyond the rim of a face is
    /// close to several of its features, and the records all give the same feature pair.
    fn add_constraint(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        pair: &StoredPair,
        record: &CompactContact,
        constraint: &mut ContactConstraint,
    ) {
        if !self.known.is_new(&constraint.parts) {
            return;
        }
        let entities = [pair.a.entity(), pair.b.entity()];
        let point = || pair.frame_pose.transform_point(record.point_b.as_dvec3());
        self.ask_reaction(constraint, scene, entities, point, solver);
        solver.contacts.push(constraint, &solver.particles);
    }

    /// Asks for the impulse of a contact between two entities at a point, if one of them is not a body and wants it.
    fn ask_reaction(
        &mut self,
        constraint: &mut ContactConstraint,
        scene: &Scene<'_, '_>,
        entities: [Entity; 2],
        point: impl FnOnce() -> DVec3,
        solver: &mut Solver,
    ) {
        let Some(entity) = entities.into_iter().find(|entity| self.answers(scene, *entity)) else { return };
        let (point, is_first) = (point(), constraint.is_first_driven(&solver.particles));
        constraint.reaction = self.reactions.number(entity, point, is_first);
        if let Some(body) = self.rigid_body(entity) {
            solver.rigid_bodies.push_at(constraint.reaction, body, point, is_first);
        }
    }

    /// Whether a particle is being depenetrated from a surface or shape.
    pub(super) fn is_leaving(&self, surface: Entity, particle: u32) -> bool {
        self.insides.is_leaving(surface, particle)
    }

    /// Whether a triangle of a body crosses the boundary of a solid from which the body is depenetrated, or is next to
    /// one that does.
    pub(super) fn is_crossing(&self, body: Entity, solid: Entity, triangle: u32) -> bool {
        self.insides.is_crossing(body, solid, triangle)
    }

    /// Adds depenetration constraints for all points inside a solid, and returns their number.
    pub(super) fn lead_out(&mut self, solver: &mut Solver, scene: &Scene<'_, '_>) -> usize {
        let Self { insides, bodies, .. } = self;
        let before = solver.contacts.len();
        insides.lead_out(solver, scene, |entity| bodies.get(&entity).copied());
        solver.contacts.len() - before
    }

    /// Forgets objects that no contact has touched in this tick.
    pub(super) fn end(&mut self) {
        let Self { driven, tick, .. } = self;
        driven.retain(|_, driven| driven.tick == *tick);
    }

    /// Makes a constraint of two triangles that would collide. Returns `false` if it exists already, or if the impact
    /// has no usable normal or features.
    pub(super) fn add_impact(&mut self, solver: &mut Solver, scene: &Scene<'_, '_>, found: &MeetingTriangles) -> bool {
        let Some(normal) = found.normal.try_normalize() else { return false };
        let [a, b] = &found.sides;
        let [corners_a, corners_b] = [a, b].map(|side| match side.corners {
            MeetingCorners::Body(corners) => corners,
            MeetingCorners::Driven { starts, ends, vertices } => std::array::from_fn(|corner| {
                let body = self.rigid_body(side.entity);
                let on_path = |body: u32| solver.rigid_bodies.on_path(body, ends[corner]);
                let ends = [starts[corner], body.map_or(ends[corner], on_path)];
                if let Some((corners, count)) = vertices {
                    let vertex = corners[corner] as usize;
                    let slots = self.slots(side.entity, count);
                    return slots.particle(&mut solver.particles, vertex, body, || Some(ends)).unwrap_or(NONE);
                }
                solver.particles.push_on_body(body, ends);
                solver.particles.len() as u32 - 1
            }),
        });
        let named = match (found.features.a, found.features.b) {
            (Feature::Vertex(corner), Feature::Face) => face_of(corners_a[corner as usize], corners_b),
            (Feature::Face, Feature::Vertex(corner)) => face_of(corners_b[corner as usize], corners_a),
            (Feature::Edge(edge_a), Feature::Edge(edge_b)) => edges_of(corners_a, edge_a, corners_b, edge_b),
            _ => return false,
        };
        if !self.known.is_new(&named) {
            return false;
        }
        let entries = weighted([corners_a, corners_b], found.barycentrics);
        let thicknesses = [a, b].into_iter().zip(found.barycentrics);
        let distance =
            thicknesses.map(|(side, weights)| DVec3::from(side.thickness).dot(DVec3::from(weights))).sum::<f64>();
        let features = Features::Plane { particles: entries, offset: -distance };
        let friction = scene.friction(a.entity, b.entity);
        let mut constraint =
            ContactConstraint { parts: features, normal, distance, friction, reaction: NO_REACTION, recovers: false };
        let at = |particle: u32| solver.particles.start[particle as usize];
        let point: DVec3 = (0..3).map(|corner| at(corners_a[corner]) * found.barycentrics[0][corner]).sum();
        self.ask_reaction(&mut constraint, scene, [a.entity, b.entity], || point, solver);
        solver.contacts.push(&constraint, &solver.particles);
        true
    }

    /// The particle slots of a static or kinematic surface.
    fn slots(&mut self, entity: Entity, vertex_count: usize) -> &mut Driven {
        let driven = self.driven.entry(entity).or_default();
        driven.tick = self.tick;
        driven.slots.resize(vertex_count, NONE);
        driven
    }

    fn sides<'a>(&self, pair: &'a StoredPair) -> [Side<'a>; 2] {
        [self.side(pair.a, Some(&pair.topology_a)), self.side(pair.b, pair.topology_b.as_ref())]
    }

    fn side<'a>(&self, side: ContactSide, topology: Option<&'a Arc<SurfaceTopology>>) -> Side<'a> {
        let entity = side.entity();
        match (self.bodies.get(&entity), topology) {
            (Some(&first), Some(topology)) => Side::Body { first, topology },
            (None, Some(topology)) => Side::Driven { entity, topology },
            (_, None) => Side::Shape { entity },
        }
    }

    /// The particles of a triangle's corners.
    fn corners(
        &mut self,
        particles: &mut Particles,
        scene: &Scene<'_, '_>,
        side: &Side<'_>,
        pose: &Pose,
        triangle: u32,
    ) -> Option<[u32; 3]> {
        match side {
            Side::Body { .. } => Some(side.particles(triangle)),
            Side::Driven { entity, topology } => {
                let body = self.rigid_body(*entity);
                let slots = self.slots(*entity, topology.vertex_count());
                let [a, b, c] = topology.welded_triangles()[triangle as usize].map(|vertex| {
                    let vertex = vertex as usize;
                    slots.particle(particles, vertex, body, || scene.ends(*entity, pose, vertex))
                });
                Some([a?, b?, c?])
            }
            Side::Shape { .. } => None,
        }
    }
}
