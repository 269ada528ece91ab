//! Last step of the solver: no vertex of a body with [`SweptCollision`](crate::SweptCollision) goes through anything.
//!
//! The way of every vertex, from where the tick began to where it was solved to be, is swept against the ways of all that
//! it may meet. Where two features would meet, both stop short of it, and the ways that are left are swept again, until
//! nothing meets. Where nothing moves, nothing can: in the worst case a body stays where it was.

use std::sync::Arc;

use bevy_ecs::{change_detection::Tick, entity::EntityHashMap, prelude::*};
use bevy_platform::collections::HashMap;
use glam::{DMat3, DVec3, Vec3};

use super::{
    gather::{Gatherer, MeetingCorners, MeetingSide, MeetingTriangles, Scene},
    particles::Particles,
};
use crate::{
    kernel::{
        bounds::Aabb,
        ccd::{
            CommonVertices, ImpactCause, PairImpact, SweepBuffers, SweepTree, SweptMesh, sweep, triangle_pair_impact,
        },
        exact::{
            Feature,
            rigid_shape::ShapeGeometry,
            triangle_pair::{PairProximity, examine_pair},
        },
        pose::Pose,
        topology::SurfaceTopology,
        tree::BoxTree,
    },
    surface::{ActiveShape, SurfaceLayers},
};

/// Features are kept apart by this share of the contact distance, or half of what they began with where that is less.
const KEPT_APART: f64 = 0.02;

/// Features that have come nearer than this share of the contact distance come no nearer.
const LEAST_APART: f64 = 0.005;

/// Positions are rounded to f32 between ticks: by less than this share of the size of what they are near.
const ROUNDING: f64 = 1.0e-6;

/// This share of the way to an impact is gone.
const SHARE_OF_WAY: f64 = 0.9;

/// Two triangles that are apart cannot meet while their vertices move by less than this share of the distance, each.
const SHARE_OF_DISTANCE: f64 = 0.49;

/// Rounds after which what meets is not moved at all, and after which whole bodies are not; and how many of those there are at
/// most: what still meets then is squeezed between things that nothing stops.
const GENTLE_ROUNDS: usize = 4;
const MOST_ROUNDS: usize = 12;
const LAST_ROUNDS: usize = 12;

/// A body that meets itself on its way in more places than so many times its vertices is squeezed into nothing: to look after
/// them all takes longer than a game can wait, and holds them there.
const MOST_OWN_IMPACTS: usize = 1;

/// What the guard did in a tick.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Guarded {
    /// Impacts on the ways that were solved for.
    pub(super) impacts: usize,
    /// Vertices that were stopped.
    pub(super) stopped: usize,
    /// Impacts that remained: those of bodies that were hit by what nothing stops.
    pub(super) remaining: usize,
    /// Bodies that meet themselves in so many places that they are no longer kept from crossing themselves.
    pub(super) jammed: Vec<Entity>,
}

/// Triangles that no solver moves: where they begin and end, and what that is known by.
#[derive(Default)]
struct Obstacle {
    /// When the positions changed last, and where they stood, while they are at rest.
    at_rest: Option<(Tick, Pose)>,
    start: Vec<DVec3>,
    end: Vec<DVec3>,
    /// How it turns, where it is a rigid shape on its way.
    turn: Option<DMat3>,
}

impl Obstacle {
    /// Follows something at rest; whether anything has changed. Without a tick, it may have.
    fn rest(&mut self, positions: &[Vec3], changed: Option<Tick>, pose: &Pose) -> bool {
        let is_same = |&(seen, stood): &(Tick, Pose)| Some(seen) == changed && stood.has_bits_of(pose);
        if self.at_rest.as_ref().is_some_and(is_same) && self.start.len() == positions.len() {
            return false;
        }
        self.at_rest = changed.map(|changed| (changed, *pose));
        self.start.clear();
        self.start.extend(positions.iter().map(|position| pose.transform_point(position.as_dvec3())));
        self.end.clone_from(&self.start);
        true
    }

    /// Follows something on its way.
    fn move_on(&mut self, positions: [&[Vec3]; 2], poses: [&Pose; 2]) {
        self.at_rest = None;
        self.turn = None;
        for ((points, positions), pose) in [&mut self.start, &mut self.end].into_iter().zip(positions).zip(poses) {
            points.clear();
            points.extend(positions.iter().map(|position| pose.transform_point(position.as_dvec3())));
        }
    }
}

/// One mesh of a tick: a surface, or triangles inside a rigid shape.
struct Mesh {
    name: MeshName,
    topology: Arc<SurfaceTopology>,
    layers: SurfaceLayers,
    /// How far it reaches beyond its triangles: what is within the sum touches.
    thickness: f64,
    /// How much of that is solid: nothing is to get in there.
    radius: f64,
    meets_itself: bool,
    /// Whether all that touches it is listed with its distance.
    is_exact: bool,
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

/// The entity of a surface or shape, and which of the shape's parts a mesh is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct MeshName {
    entity: Entity,
    part: u32,
}

/// A surface is one part.
const SURFACE: u32 = u32::MAX;

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

    /// Whether a corner of a triangle is on its way out of another mesh: nothing holds it there.
    fn is_leaving(&self, triangle: u32, other: &Self, gatherer: &Gatherer) -> bool {
        let Some(first) = self.first.filter(|_| other.name.part == SURFACE) else { return false };
        let corners = self.topology.welded_triangles()[triangle as usize];
        corners.iter().any(|&corner| gatherer.is_leaving(other.name.entity, first as u32 + corner))
    }

    /// One side of an impact, for the solver.
    fn side(&self, particles: &Particles, triangle: u32) -> MeetingSide {
        let triangle = self.topology.welded_triangles()[triangle as usize];
        let corners = match self.first {
            Some(first) => MeetingCorners::Body(triangle.map(|vertex| first as u32 + vertex)),
            None => {
                let of = |points: &[DVec3]| triangle.map(|vertex| points[vertex as usize]);
                let swept = self.swept(particles);
                let is_surface = self.name.part == SURFACE;
                let vertices = is_surface.then(|| (triangle, self.topology.vertex_count()));
                MeetingCorners::Driven { starts: of(swept.start), ends: of(swept.end), vertices }
            }
        };
        MeetingSide { entity: self.name.entity, thickness: self.thickness, corners }
    }
}

/// Two meshes that may meet on their ways.
#[derive(Clone, Copy)]
struct MeshPair {
    places: [usize; 2],
    separation: f64,
}

/// What is kept of a mesh between ticks: its boxes, and where it was if nothing moves it here.
#[derive(Default)]
struct Kept {
    obstacle: Obstacle,
    reaches: Vec<f64>,
    tree: SweepTree,
    tick: u64,
}

/// Keeps trees and obstacles from tick to tick.
#[derive(Default)]
pub(super) struct Guard {
    kept: HashMap<MeshName, Kept>,
    meshes: Vec<Mesh>,
    pairs: Vec<MeshPair>,
    /// The boxes of all meshes, a tree over them, and which of them overlap.
    bounds: Vec<Aabb>,
    tree: BoxTree,
    places: Vec<[u32; 2]>,
    /// The places of surfaces among the meshes.
    by_entity: EntityHashMap<usize>,
    /// The triangle that stands for a half-space.
    plane: Option<Arc<SurfaceTopology>>,
    /// How particles are carried along by what they met.
    carried: Vec<Option<Carry>>,
    /// How particles give way besides, that are squeezed between things that are driven.
    slides: Vec<DVec3>,
    /// Which particles go together, once what meets is not moved any more: each names another one of its zone, or itself.
    zones: Vec<u32>,
    /// Which particles have changed their ways in this round.
    changed: Vec<bool>,
    /// The share of the rest of its way that each particle goes.
    shares: Vec<f64>,
    solved: Vec<DVec3>,
    impacts: Vec<PairImpact>,
    /// The places of bodies that are so squeezed that they may rather cross themselves.
    jammed: Vec<usize>,
    /// What meets on the ways that were solved for.
    found: Vec<(MeshPair, PairImpact)>,
    buffers: SweepBuffers,
    scratch: PairProximity,
    tick: u64,
}

impl Guard {
    /// Looks what would go through something on its way from where the tick began to where it was solved to be. `first` tells
    /// the first particle of a surface that is a body. Returns how many impacts there are.
    pub(super) fn begin(&mut self, particles: &Particles, scene: &Scene<'_, '_>, gatherer: &Gatherer) -> usize {
        self.tick += 1;
        self.pairs.clear();
        self.found.clear();
        self.jammed.clear();
        if scene.is_any_swept() {
            self.gather(particles, scene, |entity| gatherer.first_particle(entity));
            self.find(particles, gatherer, |_| true);
        }
        self.found.len()
    }

    /// Looks again, after the tick was solved again.
    pub(super) fn look_again(&mut self, particles: &Particles, scene: &Scene<'_, '_>, gatherer: &Gatherer) -> usize {
        for mesh in self.meshes.iter_mut().filter(|mesh| mesh.first.is_some()) {
            mesh.stale = true;
            mesh.follow_ways(particles);
        }
        self.pair_meshes(scene);
        let jammed = &self.jammed;
        self.pairs.retain(|pair| pair.places[0] != pair.places[1] || !jammed.contains(&pair.places[0]));
        self.find(particles, gatherer, |_| true);
        self.found.len()
    }

    /// What was found last.
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
                normal: impact.normal,
            }
        });
        meetings.collect()
    }

    /// Lists what meets, of the pairs with a mesh that is `asked` about.
    fn find(&mut self, particles: &Particles, gatherer: &Gatherer, asked: impl Fn(&Mesh) -> bool) {
        let Self { meshes, pairs, found, impacts, buffers, jammed, scratch, .. } = self;
        found.clear();
        for pair in &*pairs {
            let MeshPair { places: [a, b], separation, .. } = *pair;
            let (mesh_a, mesh_b) = (&meshes[a], &meshes[b]);
            if !(asked(mesh_a) || asked(mesh_b)) {
                continue;
            }
            impacts.clear();
            let (swept_a, swept_b) = (mesh_a.swept(particles), mesh_b.swept(particles));
            sweep(&swept_a, &mesh_a.tree, &swept_b, &mesh_b.tree, a == b, separation, buffers, impacts);
            let before = found.len();
            let is_round = mesh_a.radius + mesh_b.radius > 0.0;
            let is_leaving = |impact: &PairImpact| {
                mesh_a.is_leaving(impact.triangle_a, mesh_b, gatherer)
                    || mesh_b.is_leaving(impact.triangle_b, mesh_a, gatherer)
            };
            found.extend(impacts.iter().filter(|impact| !is_leaving(impact)).filter_map(|&impact| {
                match impact.impact.cause {
                    ImpactCause::Within if is_round => {
                        Some((*pair, deeper(&swept_a, &swept_b, impact, separation, scratch)?))
                    }
                    cause => is_met(cause).then_some((*pair, impact)),
                }
            }));
            if a == b && found.len() - before > MOST_OWN_IMPACTS * mesh_a.topology.vertex_count() {
                found.truncate(before);
                jammed.push(a);
            }
        }
        pairs.retain(|pair| pair.places[0] != pair.places[1] || !jammed.contains(&pair.places[0]));
    }

    /// Stops what would still go through something, in a part of the tick that takes so many seconds.
    pub(super) fn stop(&mut self, particles: &mut Particles, duration: f64, gatherer: &Gatherer) -> Guarded {
        let jammed = self.jammed.iter().map(|&place| self.meshes[place].name.entity).collect();
        let mut guarded = Guarded { impacts: self.found.len(), jammed, ..Guarded::default() };
        if !self.found.is_empty() {
            self.run(particles, duration, gatherer, &mut guarded);
        }
        let Self { kept, meshes, tick, .. } = self;
        for Mesh { name, obstacle, reaches, tree, .. } in meshes.drain(..) {
            kept.insert(name, Kept { obstacle, reaches, tree, tick: *tick });
        }
        kept.retain(|_, kept| kept.tick == *tick);
        guarded
    }

    /// Lists the meshes of this tick, and which of them are near enough to meet.
    fn gather(&mut self, particles: &Particles, scene: &Scene<'_, '_>, first: impl Fn(Entity) -> Option<usize>) {
        self.by_entity.clear();
        for surface in &scene.active.surfaces {
            let Ok((positions, _)) = scene.positions.get(surface.entity) else { continue };
            let first = first(surface.entity);
            let name = MeshName { entity: surface.entity, part: SURFACE };
            let mut kept = self.kept.remove(&name).unwrap_or_default();
            let stale = match scene.motions.course(surface.entity) {
                _ if first.is_some() => true,
                Some(course) => {
                    let stands = [&course.now, &course.ahead];
                    kept.obstacle.move_on(stands.map(|stand| &*stand.positions), stands.map(|stand| &stand.pose));
                    true
                }
                None => kept.obstacle.rest(&positions.0, Some(positions.last_changed()), &surface.pose),
            };
            self.by_entity.insert(surface.entity, self.meshes.len());
            self.meshes.push(Mesh {
                name,
                topology: Arc::clone(&surface.topology),
                layers: surface.layers,
                thickness: f64::from(surface.thickness),
                radius: 0.0,
                meets_itself: surface.self_collision,
                // Other methods than the exact ones do not list all that touches.
                is_exact: surface.method.is_exact(),
                first,
                obstacle: kept.obstacle,
                is_guarded: first.is_some() && scene.is_swept(surface.entity),
                reaches: kept.reaches,
                tree: kept.tree,
                stale,
            });
        }
        for shape in &scene.active.shapes {
            self.gather_shape(particles, scene, shape);
        }
        self.reach(scene);
        for mesh in &mut self.meshes {
            if mesh.stale {
                mesh.follow_ways(particles);
            } else {
                mesh.tree.update_reaches(&mesh.reaches);
            }
        }
        self.pair_meshes(scene);
    }

    fn gather_shape(&mut self, particles: &Particles, scene: &Scene<'_, '_>, shape: &ActiveShape) {
        let course = scene.motions.course(shape.entity);
        let poses = course.map_or([&shape.pose; 2], |course| [&course.now.pose, &course.ahead.pose]);
        let mesh = |name, topology: &Arc<SurfaceTopology>, radius, kept: Kept| Mesh {
            name,
            topology: Arc::clone(topology),
            layers: shape.layers,
            thickness: radius,
            radius,
            meets_itself: false,
            is_exact: true,
            first: None,
            obstacle: kept.obstacle,
            is_guarded: false,
            reaches: kept.reaches,
            tree: kept.tree,
            stale: true,
        };
        if let ShapeGeometry::HalfSpace { normal } = &*shape.geometry {
            let name = MeshName { entity: shape.entity, part: 0 };
            let mut kept = self.kept.remove(&name).unwrap_or_default();
            let Some(ends) = plane_under(particles, *normal, poses) else { return };
            [kept.obstacle.start, kept.obstacle.end] = ends;
            kept.obstacle.turn = turn_between(poses);
            let topology = self.plane.get_or_insert_with(|| {
                let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
                Arc::new(SurfaceTopology::new(&corners, &[[0, 1, 2]]).expect("three finite corners make a triangle"))
            });
            let mesh = mesh(name, topology, 0.0, kept);
            self.meshes.push(mesh);
        }
        for (part, solid) in (0..).zip(&*shape.parts) {
            let name = MeshName { entity: shape.entity, part };
            let mut kept = self.kept.remove(&name).unwrap_or_default();
            kept.obstacle.move_on([&solid.positions; 2], poses);
            kept.obstacle.turn = turn_between(poses);
            let radius = solid.radius * shape.pose.scale();
            self.meshes.push(mesh(name, &solid.topology, radius, kept));
        }
    }

    /// Tells every triangle how far it reaches, by how far detection has found it from the others: surfaces that do not touch
    /// are farther apart than the contact distance, which is the sum of what each may come near. Shapes do not reach out: how
    /// far a surface is from one is the surface's reach alone.
    fn reach(&mut self, scene: &Scene<'_, '_>) {
        let Self { meshes, by_entity, .. } = self;
        for mesh in &mut *meshes {
            let clear = match mesh.name.part {
                SURFACE => 2.0 * mesh.thickness,
                _ => 0.0,
            };
            let nearest = || scene.nearest(mesh.name.entity).unwrap_or(clear).min(clear);
            mesh.reach_all(if mesh.is_exact { clear } else { nearest() });
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
                pairs.push(MeshPair::new(scene, places, mesh, other));
            }
        }
    }

    fn run(&mut self, particles: &mut Particles, duration: f64, gatherer: &Gatherer, guarded: &mut Guarded) {
        self.shares.clear();
        self.shares.resize(particles.len(), 1.0);
        self.carried.clear();
        self.carried.resize(particles.len(), None);
        self.slides.clear();
        self.slides.resize(particles.len(), DVec3::ZERO);
        self.zones.clear();
        self.zones.extend(0..particles.len() as u32);
        self.solved.clone_from(&particles.position);
        for round in 0..MOST_ROUNDS + LAST_ROUNDS {
            // Nothing has moved since what was found for the first round.
            if round > 0 {
                self.find(particles, gatherer, |mesh| mesh.stale);
            }
            let mut is_clear = true;
            self.changed.clear();
            self.changed.resize(particles.len(), false);
            let Self { meshes, found, shares, carried, slides, changed, zones, .. } = self;
            let mut ways = Ways { particles: &*particles, shares, carried, slides, changed, zones };
            for (pair, found) in &*found {
                let [a, b] = pair.places;
                let held = hold(&meshes[a], &meshes[b], &mut ways, found, round);
                is_clear &= !held;
                guarded.remaining += usize::from(!held);
            }
            if (GENTLE_ROUNDS..MOST_ROUNDS).contains(&round) {
                ways.go_by_zones();
            }
            if is_clear {
                break;
            }
            self.shorten(particles);
        }
        let is_stopped = |&particle: &usize| self.shares[particle] < 1.0 || self.carried[particle].is_some();
        for particle in (0..particles.len()).filter(is_stopped) {
            guarded.stopped += 1;
            let start = particles.start[particle];
            let along = (way_of(self.carried[particle], start) + self.slides[particle]) / duration;
            particles.velocity[particle] = along + (particles.velocity[particle] - along) * self.shares[particle];
        }
    }

    /// Lets particles go the shares of their ways, and the trees follow.
    fn shorten(&mut self, particles: &mut Particles) {
        let Self { meshes, shares, carried, slides, changed, solved, .. } = self;
        for mesh in meshes {
            let Some(first) = mesh.first else {
                mesh.stale = false;
                mesh.tree.forget_fast();
                continue;
            };
            for (vertex, &weld) in mesh.topology.weld().iter().enumerate() {
                let (particle, weld) = (first + vertex, first + weld as usize);
                let (share, carry) = (shares[weld], carried[weld]);
                changed[particle] |= changed[weld];
                (shares[particle], carried[particle], slides[particle]) = (share, carry, slides[weld]);
                if share < 1.0 || carry.is_some() {
                    let start = particles.start[particle];
                    let start = start + way_of(carry, start) + slides[weld];
                    particles.position[particle] = start + (solved[particle] - start) * share;
                }
            }
            mesh.stale = (first..first + mesh.topology.vertex_count()).any(|particle| changed[particle]);
            if mesh.stale {
                mesh.follow_ways(particles);
                mesh.stale = true;
            }
            // What has not changed has been looked at.
            let is_changed = |corners: &[u32; 3]| corners.iter().any(|&corner| changed[first + corner as usize]);
            let triangles = mesh.topology.welded_triangles();
            mesh.tree.keep_fast(|triangle| is_changed(&triangles[triangle]));
        }
    }
}

impl MeshPair {
    fn new(scene: &Scene<'_, '_>, places: [usize; 2], mesh: &Mesh, other: &Mesh) -> Self {
        let reach = |mesh: &Mesh| mesh.thickness - mesh.radius;
        let contact_distance = reach(mesh) + reach(other);
        let radius = mesh.radius + other.radius;
        let (a, b) = (mesh.name.entity, other.name.entity);
        let nearest = scene.nearest_of(a, b).unwrap_or(contact_distance);
        let kept = KEPT_APART * contact_distance;
        // What is pressed on for many ticks would be halved to nothing.
        let floor = (nearest - ROUNDING * radius).clamp(0.0, LEAST_APART * contact_distance);
        Self { places, separation: radius + kept.min((0.5 * nearest).max(floor)) }
    }
}

/// A triangle in the boundary of a half-space that is under, or over, all that bodies may reach: where it begins and ends.
fn plane_under(particles: &Particles, normal: DVec3, poses: [&Pose; 2]) -> Option<[Vec<DVec3>; 2]> {
    let bodies = (0..particles.len()).filter(|&particle| particles.inverse_mass[particle] > 0.0);
    let points = bodies.flat_map(|particle| [particles.start[particle], particles.position[particle]]);
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = points.fold(empty, |(low, high), point| (low.min(point), high.max(point)));
    let size = (high - low).length();
    if !size.is_finite() {
        return None;
    }
    let center = poses[0].inverse().transform_point((low + high) * 0.5);
    let center = center - normal * normal.dot(center);
    let (u, v) = normal.any_orthonormal_pair();
    // The circle inside a triangle with corners so far from its center is half as large.
    let reach = (4.0 * size + f64::MIN_POSITIVE.sqrt()) / poses[0].scale();
    let root = 0.75_f64.sqrt();
    let thirds = [(1.0, 0.0), (-0.5, root), (-0.5, -root)];
    let corners = thirds.map(|(cosine, sine)| center + (u * cosine + v * sine) * reach);
    Some(poses.map(|pose| corners.iter().map(|&corner| pose.transform_point(corner)).collect()))
}

/// What has been pressed into a round shape gets no deeper: when two triangles that begin within their separation come nearer.
fn deeper(
    a: &SweptMesh<'_>,
    b: &SweptMesh<'_>,
    found: PairImpact,
    separation: f64,
    scratch: &mut PairProximity,
) -> Option<PairImpact> {
    let (a, b) = (a.triangle(found.triangle_a), b.triangle(found.triangle_b));
    examine_pair(&a.start, &b.start, separation, scratch);
    let distance = scratch.distance;
    if !(distance > 0.0 && distance.is_finite()) {
        return None;
    }
    let impact = triangle_pair_impact(&a, &b, &CommonVertices::NONE, distance * (1.0 - ROUNDING))?;
    is_met(impact.cause).then_some(PairImpact { impact, ..found })
}

/// Whether two triangles meet on their ways; what is together when these begin cannot be kept apart.
fn is_met(cause: ImpactCause) -> bool {
    !matches!(cause, ImpactCause::Within | ImpactCause::Crossing)
}

/// How something that is driven takes along what it has met: it turns about a point, and that point moves.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Carry {
    from: DVec3,
    to: DVec3,
    turn: DMat3,
}

impl Carry {
    /// How a point moves that begins at `start`.
    fn way(&self, start: DVec3) -> DVec3 {
        self.turn * (start - self.from) + self.to - start
    }

    /// Of several, that along which a point moves farther counts.
    fn longer(one: Option<Self>, other: Option<Self>, start: DVec3) -> Option<Self> {
        let length = |carry: &Option<Self>| carry.map_or(0.0, |carry| carry.way(start).length_squared());
        if length(&other) > length(&one) { other } else { one }
    }
}

/// How a point moves that something carries along, or nothing.
fn way_of(carry: Option<Carry>, start: DVec3) -> DVec3 {
    carry.map_or(DVec3::ZERO, |carry| carry.way(start))
}

/// How a pose turns into another one, with how it grows.
fn turn_between([from, to]: [&Pose; 2]) -> Option<DMat3> {
    (!from.has_bits_of(to)).then(|| to.to_affine().matrix3 * from.to_affine().matrix3.inverse())
}

/// The turn that brings a triangle, given by its corners, from where it begins to where it ends; none where it has no area.
fn turn_of(start: [DVec3; 3], end: [DVec3; 3]) -> DMat3 {
    let frame = |[a, b, c]: [DVec3; 3]| {
        let along = (b - a).try_normalize()?;
        let normal = along.cross(c - a).try_normalize()?;
        Some(DMat3::from_cols(along, normal, along.cross(normal)))
    };
    let (Some(start), Some(end)) = (frame(start), frame(end)) else { return DMat3::IDENTITY };
    end * start.transpose()
}

/// The ways of particles, as they are shortened.
struct Ways<'a> {
    particles: &'a Particles,
    shares: &'a mut [f64],
    carried: &'a mut [Option<Carry>],
    slides: &'a mut [DVec3],
    changed: &'a mut [bool],
    zones: &'a mut [u32],
}

impl Ways<'_> {
    /// The particle that stands for a zone.
    fn zone(&mut self, mut particle: u32) -> u32 {
        while self.zones[particle as usize] != particle {
            let above = self.zones[self.zones[particle as usize] as usize];
            self.zones[particle as usize] = above;
            particle = above;
        }
        particle
    }

    fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.zone(one), self.zone(other));
        self.zones[one.max(other) as usize] = one.min(other);
    }

    /// Lets all particles of a zone go along with what moves one of them farthest: as they are, they do not meet each other.
    fn go_by_zones(&mut self) {
        for particle in 0..self.zones.len() as u32 {
            let zone = self.zone(particle);
            if zone != particle {
                let start = self.particles.start[zone as usize];
                let longest = Carry::longer(self.carried[zone as usize], self.carried[particle as usize], start);
                self.carried[zone as usize] = longest;
            }
        }
        for particle in 0..self.zones.len() as u32 {
            let zone = self.zone(particle) as usize;
            let particle = particle as usize;
            if zone == particle && self.shares[particle] > 0.0 || self.particles.inverse_mass[particle] <= 0.0 {
                continue;
            }
            if self.carried[particle] != self.carried[zone] || self.shares[particle] > 0.0 {
                self.carried[particle] = self.carried[zone];
                self.shares[particle] = 0.0;
                self.changed[particle] = true;
            }
        }
    }

    /// How one side of an impact takes along what it meets: nothing does where it stands, or is a body that nothing carries.
    fn carry(&self, mesh: &Mesh, triangle: u32, barycentric: &[f64; 3]) -> Option<Carry> {
        let corners = mesh.topology.welded_triangles()[triangle as usize];
        let at = |points: [DVec3; 3]| -> DVec3 {
            points.iter().zip(barycentric).map(|(&point, weight)| point * *weight).sum()
        };
        let carry = |start: [DVec3; 3], end: [DVec3; 3], turn: Option<DMat3>| {
            let turn = turn.unwrap_or_else(|| turn_of(start, end));
            (start != end).then(|| Carry { from: at(start), to: at(end), turn })
        };
        let Some(first) = mesh.first else {
            let Obstacle { start, end, turn, .. } = &mesh.obstacle;
            let of = |points: &[DVec3]| corners.map(|corner| points[corner as usize]);
            return carry(of(start), of(end), *turn);
        };
        let places = corners.map(|corner| first + corner as usize);
        let point = at(places.map(|place| self.particles.start[place]));
        let own = places.map(|place| {
            let (start, end) = (self.particles.start[place], self.particles.end[place]);
            if self.particles.inverse_mass[place] > 0.0 || start == end {
                return self.carried[place];
            }
            Some(Carry { from: start, to: end, turn: DMat3::IDENTITY })
        });
        own.into_iter().fold(None, |longest, carry| Carry::longer(longest, carry, point))
    }
}

/// Shortens the ways of what meets, as seen from what moves whatever happens: where that is a driven side, or a body that such a
/// one pushes, the others are carried along. `false` where nothing of it can be held any more.
fn hold(mesh_a: &Mesh, mesh_b: &Mesh, ways: &mut Ways<'_>, found: &PairImpact, round: usize) -> bool {
    if mesh_a.first.is_none() && mesh_b.first.is_none() {
        return false;
    }
    let carry_a = ways.carry(mesh_a, found.triangle_a, &found.impact.barycentric_a);
    let carry_b = ways.carry(mesh_b, found.triangle_b, &found.impact.barycentric_b);
    // What is driven, and away from it.
    let pushed = match (mesh_a.first, mesh_b.first) {
        (None, _) => Some((carry_a, -found.impact.normal)),
        (_, None) => Some((carry_b, found.impact.normal)),
        _ => None,
    };
    let is_between_bodies = mesh_a.first.is_some() && mesh_b.first.is_some();
    let is_carried = carry_a.is_some() || carry_b.is_some();
    if round >= MOST_ROUNDS && is_between_bodies && is_carried {
        // Bodies may rather cross each other than what pushes them.
        return false;
    }
    let mut is_held = false;
    let mut zone = None;
    let features = [found.impact.features.a, found.impact.features.b];
    for ((mesh, triangle), feature) in
        [(mesh_a, found.triangle_a), (mesh_b, found.triangle_b)].into_iter().zip(features)
    {
        let Some(first) = mesh.first else { continue };
        let mut shorten = |particle: usize, share: f64| {
            if ways.particles.inverse_mass[particle] <= 0.0 {
                return;
            }
            // What is squeezed between two that move differently goes with the one that moves it farther.
            let start = ways.particles.start[particle];
            let own = ways.carried[particle];
            if let Some((driven, away)) = pushed
                && round >= MOST_ROUNDS
                && own != driven
                && ways.shares[particle] <= 0.0
            {
                // What something else carries already gives way to the side.
                let toward = (way_of(own, start) + ways.slides[particle] - way_of(driven, start)).dot(away);
                if toward < 0.0 {
                    ways.slides[particle] -= away * toward;
                    ways.changed[particle] = true;
                    is_held = true;
                }
                return;
            }
            let carry = Carry::longer(Carry::longer(own, carry_a, start), carry_b, start);
            if carry != own || ways.shares[particle] > 0.0 {
                ways.carried[particle] = carry;
                ways.shares[particle] *= share;
                ways.changed[particle] = true;
                is_held = true;
            }
        };
        if round >= MOST_ROUNDS && !is_carried {
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
        if (GENTLE_ROUNDS..MOST_ROUNDS).contains(&round) {
            for corner in corners {
                let particle = first as u32 + corner;
                if ways.particles.inverse_mass[particle as usize] > 0.0 {
                    ways.join(*zone.get_or_insert(particle), particle);
                }
            }
        }
    }
    is_held
}
