//! From entities to the solver: bodies become particles, and contacts become constraints on them.
//!
//! All vertices of bodies are particles in world space. Of other objects, only the vertices that contacts touch are.
//! Contacts are taken in the order of the store.

mod driven;
mod internal_edges;
mod tangled;
mod watch;

use std::sync::Arc;

use arrayvec::ArrayVec;
use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_platform::collections::{HashMap, HashSet};
use glam::{DVec3, Vec3};

pub(super) use self::watch::Watch;
use self::{driven::Driven, watch::Unwatched};
use super::{
    anchors::Anchors,
    body::XpbdBody,
    contact::{ContactConstraint, Features},
    forces::{SurfaceForces, SurfaceWind},
    inside::Insides,
    meeting::{MeetingCorners, MeetingTriangles},
    motion::Motions,
    particles::Particles,
    reaction::{NO_REACTION, Reactions},
    record::{MoveBack, completed, detected_sum, edges_of, face_of, flat, untangling, weighted},
    scene::Scene,
    solver::{Solver, SolverBody},
};
use crate::{
    contacts::StoredPair,
    kernel::{
        contact::CompactContact,
        mesh::{
            feature::{Feature, FeatureKind},
            ids::VertexId,
            topology::SurfaceTopology,
        },
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
    known: HashSet<Features4>,
    /// How far each particle would move in the tick if nothing pushed it, for contacts of bodies.
    ahead: Vec<Vec3>,
    /// Whether each contact of the current pair may act.
    may_act: Vec<bool>,
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

/// The particles of a feature pair. The flag is `true` for two edges.
type Features4 = (bool, [u32; 4]);

/// One side of a pair, as the solver sees it.
#[derive(Clone, Copy)]
enum Side<'a> {
    Body { first: usize, topology: &'a SurfaceTopology },
    Driven { entity: Entity, topology: &'a SurfaceTopology },
    Shape { entity: Entity },
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
            let friction = scene.friction(pair.a.entity(), pair.b.entity());
            self.find_tangled(&mut solver.particles, scene, pair);
            let may_act = self.watch(team, scene, pair, sides, watch);
            for ((place, record), &may_act) in (0..).zip(pair.contacts.iter()).zip(&may_act) {
                if may_act {
                    self.add_contact(solver, scene, pair, sides, record, friction);
                } else {
                    let particles = [(sides[0], record.triangle_a), (sides[1], record.triangle_b)];
                    let particles = particles.map(|(side, triangle)| side.particles(triangle));
                    self.unwatched.push(Unwatched { pair: pair_place, place, particles });
                }
            }
            self.may_act = may_act;
        }
    }

    /// Makes a constraint of a contact, unless there is one of the same features. A vertex beyond the rim of a face is
    /// close to several of its features, and the records all give the same feature pair.
    fn add_contact(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        pair: &StoredPair,
        sides: [Side<'_>; 2],
        record: &CompactContact,
        friction: [f64; 2],
    ) {
        let constraint = self.constraint(&mut solver.particles, scene, pair, sides, record, friction);
        let Some(mut constraint) = constraint else { return };
        if !self.is_new(&constraint.parts) {
            return;
        }
        let entities = [pair.a.entity(), pair.b.entity()];
        let point = || pair.frame_pose.transform_point(record.point_b.as_dvec3());
        self.ask_reaction(&mut constraint, scene, entities, point, solver);
        solver.contacts.push(&constraint, &solver.particles);
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
        if !self.is_new(&named) {
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

    /// Whether a feature pair has no constraint yet. Remembers it. Planes always count as new.
    fn is_new(&mut self, features: &Features) -> bool {
        match features {
            Features::VertexFace(places) => self.known.insert((false, *places)),
            Features::EdgeEdge(places) => self.known.insert((true, *places)),
            Features::Plane { .. } => true,
        }
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

    fn constraint(
        &mut self,
        particles: &mut Particles,
        scene: &Scene<'_, '_>,
        pair: &StoredPair,
        [side_a, side_b]: [Side<'_>; 2],
        record: &CompactContact,
        friction: [f64; 2],
    ) -> Option<ContactConstraint> {
        let distance = f64::from(pair.contact_distance_at(record));
        // The first side is pushed against the normal.
        let normal = -pair.frame_pose.transform_direction(record.normal.as_dvec3()).normalize_or_zero();
        if normal == DVec3::ZERO {
            return None;
        }
        let [triangle_a, triangle_b] = self.triangles_below(particles, scene, pair, [side_a, side_b], record);
        let a = self.corners(particles, scene, &side_a, &pair.poses[0], triangle_a)?;
        let b = self.corners(particles, scene, &side_b, &pair.poses[1], triangle_b);
        // A body that is depenetrated moves in one direction as a whole. Its own contacts with the solid would pull
        // against it.
        let is_leaving = |corners: [u32; 3], other: ContactSide| {
            corners.iter().any(|&corner| self.insides.is_leaving(other.entity(), corner))
        };
        let goes_back = self.back.is_some() && record.features.kind() == FeatureKind::EdgeFace;
        if !goes_back && (is_leaving(a, pair.b) || b.is_some_and(|b| is_leaving(b, pair.a))) {
            return None;
        }
        // A triangle that crosses the boundary keeps only its vertex contacts: its vertices may still rest on the
        // boundary.
        let crosses = |side: ContactSide, other: ContactSide, triangle: u32, feature: Feature| {
            !matches!(feature, Feature::Vertex(_)) && self.is_crossing(side.entity(), other.entity(), triangle)
        };
        let is_crossing = record.features.kind() == FeatureKind::EdgeFace;
        if !is_crossing
            && (crosses(pair.a, pair.b, record.triangle_a, record.features.a)
                || b.is_some() && crosses(pair.b, pair.a, record.triangle_b, record.features.b))
        {
            return None;
        }
        let Some(b) = b else {
            let Side::Shape { entity } = side_b else { return None };
            let shape = (entity, self.rigid_body(entity));
            return Some(against_shape(scene, particles, pair, record, (a, shape, normal), friction));
        };
        let has_inside = pair.one_sided.contains(&true);
        // A pair that the guard kept apart has not passed through, even if a rotation brought it to the other side of
        // the normal.
        let is_apart = pair.nearest > 0.0 && [pair.a, pair.b].iter().any(|side| scene.is_swept(side.entity()));
        let is_wrong_side = record.distance < 0.0 && !has_inside && is_apart;
        let normal = if is_wrong_side { -normal } else { normal };
        let penetrated = record.distance < 0.0 && !is_wrong_side;
        let (features, normal) = match (record.features.a, record.features.b) {
            // Between patches, which the particles do not know: what detection found holds for the tick.
            _ if pair.is_smooth && !is_crossing => (flat(particles, record, [a, b], normal, distance), normal),
            (Feature::Vertex(corner), Feature::Face) => (face_of(a[corner as usize], b), normal),
            (Feature::Face, Feature::Vertex(corner)) => (face_of(b[corner as usize], a), -normal),
            (Feature::Edge(edge_a), Feature::Edge(edge_b)) => (edges_of(a, edge_a, b, edge_b), normal),
            (Feature::Vertex(corner), _) if !penetrated => (face_of(a[corner as usize], b), normal),
            (_, Feature::Vertex(corner)) if !penetrated => (face_of(b[corner as usize], a), -normal),
            (Feature::Edge(_), Feature::Face) | (Feature::Face, Feature::Edge(_)) => {
                let firsts = [pair.a, pair.b].map(|side| self.first_particle(side.entity()));
                return if has_inside && pair.a != pair.b {
                    None
                } else {
                    let move_back =
                        self.back.map_or_else(|| MoveBack::Edge { crowd: self.crowd([a, b]) }, MoveBack::Part);
                    untangling(particles, pair, record, [a, b], firsts, move_back)
                };
            }
            _ => (flat(particles, record, [a, b], normal, distance), normal),
        };
        // Next to a crossing, a contact would hold features on the wrong side.
        let is_tangled = |corners: [u32; 3]| corners.iter().any(|corner| self.tangled.contains_key(corner));
        if !penetrated && is_tangled(a) && is_tangled(b) {
            return None;
        }
        Some(ContactConstraint { parts: features, normal, distance, friction, reaction: NO_REACTION, recovers: false })
    }
}

/// A contact with a rigid shape. The contact point on the shape moves with the shape.
fn against_shape(
    scene: &Scene<'_, '_>,
    particles: &mut Particles,
    pair: &StoredPair,
    record: &CompactContact,
    (corners, (shape, body), normal): ([u32; 3], (Entity, Option<u32>), DVec3),
    friction: [f64; 2],
) -> ContactConstraint {
    let now = pair.poses[1];
    let start = pair.frame_pose.transform_point(record.point_b.as_dvec3());
    let ahead = scene.motions.course(shape).map(|course| course.ahead.pose);
    let end = ahead.map_or(start, |ahead| ahead.transform_point(now.inverse().transform_point(start)));
    let place = particles.len() as u32;
    particles.push_on_body(body, [start, end]);
    let weights = completed(record.features.a, record.barycentric_a);
    let mut entries: ArrayVec<(u32, f64), 6> = ArrayVec::new();
    entries.extend(corners.into_iter().zip(weights).filter(|&(_, weight)| weight != 0.0));
    entries.push((place, -1.0));
    let distance = f64::from(pair.contact_distance_at(record));
    let separation = f64::from(record.distance) - distance;
    let offset = separation - normal.dot(detected_sum(particles, &entries));
    let features = Features::Plane { particles: entries, offset };
    ContactConstraint { parts: features, normal, distance, friction, reaction: NO_REACTION, recovers: false }
}
