//! Depenetration: finds which vertices of a body are inside a solid, and the direction in which the whole body is
//! pushed out.
//!
//! A body that was spawned inside a solid, or squeezed into it, is too deep for contacts to push it out. The search
//! runs only with a reason: two surfaces come near each other, they cross, or part of one was inside the other before.

mod solid;

use arrayvec::ArrayVec;
use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_platform::collections::{HashMap, HashSet};
use glam::DVec3;

use self::solid::{Exit, Solid};
use super::{
    contact::{ContactConstraint, Features, SolverContacts},
    particles::Particles,
    reaction::NO_REACTION,
    scene::Scene,
    solver::Solver,
    untangle::{CutOff, PiercingEdge, cut_off},
};
use crate::{
    detection::moved_box,
    kernel::mesh::{feature::Feature, ids::VertexId},
    surface::{ActiveShape, ActiveSurface, ContactFilter, FilterSide, PairFilter},
};

/// Depth, in thicknesses, up to which contacts alone push out of a shape tested by formula.
const SHALLOW: f64 = 4.0;

/// Deep penetration is resolved as if the contact distance was this share of its depth: 6 depths per second at the
/// default push-out speed.
const DEPTHS_OF_PACE: f64 = 0.06;

/// Largest number of vertices times triangles tested for one pair of surfaces in a tick. Beyond it, vertices inside
/// stay there.
const MOST_LOOKS: usize = 20_000_000;

/// Number of detections for which a direction is kept before the search runs again.
const CHOSEN_FOR: u32 = 16;

/// Factor on the length of the previous direction in the comparison, if that direction has made progress.
const FAITH: f64 = 0.5;

/// Approximate number of inside points that are followed along each direction.
const MOST_FOLLOWED: usize = 8;

/// Cosine of the angle below which two directions count as the same.
const SAME: f64 = 0.99;

/// The previous direction has made progress if at most this share of its length is left at the next search.
const LEFT: f64 = 0.75;

/// Number of passes over the solids after which a direction that leads from solid into solid is given up.
const MOST_SOLIDS: usize = 16;

/// Remembers which surfaces were near each other, and how bodies leave solids.
#[derive(Clone, Default)]
pub(super) struct Insides {
    near: HashSet<(Entity, Entity)>,
    before: HashSet<(Entity, Entity)>,
    /// The chosen direction of each pair of body and solid.
    ways: HashMap<(Entity, Entity), Chosen>,
    /// The particles that are being pushed out, for each surface or shape.
    leaving: EntityHashMap<HashSet<u32>>,
    /// Triangles of a body that cross the boundary of a solid, and triangles next to them, for each pair of body and
    /// solid.
    crossing: HashMap<(Entity, Entity), HashSet<u32>>,
}

/// The direction in which a body leaves a solid.
#[derive(Clone, Copy, Debug)]
struct Chosen {
    /// Unit vector.
    direction: DVec3,
    /// Number of detections since it was chosen.
    age: u32,
    /// Distance to the exit when it was chosen.
    depth: f64,
}

/// The points of a body that are inside a solid, and their common exit. With different directions, they would hold each
/// other back or tear the body apart.
struct WayOut {
    points: Vec<BodyPoint>,
    exit: Exit,
    /// Distance from the deepest point to the exit.
    depth: f64,
}

/// A vertex of a body, or a point on one of its triangles.
#[derive(Clone, Debug)]
struct BodyPoint {
    /// Particles with their weights.
    entries: ArrayVec<(u32, f64), 3>,
    /// Position at the beginning of the tick.
    at: DVec3,
}

impl BodyPoint {
    fn new(entries: impl IntoIterator<Item = (u32, f64)>, particles: &Particles) -> Self {
        let entries: ArrayVec<(u32, f64), 3> = entries.into_iter().collect();
        let at = entries.iter().map(|&(particle, weight)| particles.start[particle as usize] * weight).sum();
        Self { entries, at }
    }
}

/// A place where a triangle of a body crosses the boundary of another side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    pub(super) triangle: u32,
    /// An edge if the triangle's edge pierces a face of the other side, or the face if it is pierced.
    pub(super) feature: Feature,
    /// Barycentric weights of the triangle's corners.
    pub(super) weights: [f64; 3],
}

/// The inputs of the search for an exit.
#[derive(Clone, Copy)]
struct Surroundings<'a> {
    scene: &'a Scene<'a, 'a>,
    particles: &'a Particles,
    /// The first particle of an entity, if it is a body.
    first: &'a dyn Fn(Entity) -> Option<usize>,
}

/// A body whose particles start at `first`.
#[derive(Clone, Copy)]
struct Body<'a> {
    surface: &'a ActiveSurface,
    first: usize,
}

impl Body<'_> {
    /// Whether a vertex inside a solid is led out of it: a triangle around it may touch the triangle of the solid that is
    /// nearest to it.
    fn may_touch(self, vertex: &BodyPoint, solid: &Solid<'_>, filter: &PairFilter<'_>) -> bool {
        let Some(nearest) = solid.nearest_triangle(vertex.at) else { return false };
        let number = VertexId(vertex.entries[0].0 - self.first as u32);
        self.surface.topology.triangles_of_vertex(number).iter().any(|&own| filter.allows([own, nearest]))
    }

    fn particles(self) -> std::ops::Range<usize> {
        self.first..self.first + self.surface.topology.vertex_count()
    }
}

impl Insides {
    /// What the next detection depends on.
    pub(super) fn remembered(&self) -> Self {
        Self { near: self.near.clone(), ways: self.ways.clone(), ..Self::default() }
    }

    /// Whether a particle is being pushed out of a surface or shape.
    pub(super) fn is_leaving(&self, surface: Entity, particle: u32) -> bool {
        !self.leaving.is_empty() && self.leaving.get(&surface).is_some_and(|particles| particles.contains(&particle))
    }

    /// Whether a triangle of a body crosses the boundary of a solid, or is next to one that does.
    pub(super) fn is_crossing(&self, body: Entity, solid: Entity, triangle: u32) -> bool {
        let triangles = || self.crossing.get(&(body, solid));
        !self.crossing.is_empty() && triangles().is_some_and(|triangles| triangles.contains(&triangle))
    }

    /// Allows triangles of a body to pass through another surface.
    pub(super) fn let_pass(&mut self, body: Entity, other: Entity, triangles: &HashSet<u32>) {
        self.crossing.entry((body, other)).or_default().extend(triangles);
    }

    /// Allows particles to leave a surface or shape.
    pub(super) fn let_leave(&mut self, surface: Entity, particles: impl Iterator<Item = u32>) {
        self.leaving.entry(surface).or_default().extend(particles);
    }

    /// Adds constraints that push bodies out of solids. `first` returns the first particle of a body.
    pub(super) fn lead_out(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        first: impl Fn(Entity) -> Option<usize>,
    ) {
        std::mem::swap(&mut self.near, &mut self.before);
        self.near.clear();
        self.leaving.clear();
        self.crossing.clear();
        for surface in &scene.active.surfaces {
            let Some(place) = first(surface.entity) else { continue };
            let body = Body { surface, first: place };
            for other in &scene.active.surfaces {
                let is_near = || surface.world_bounds.overlaps(&other.world_bounds);
                if !(other.one_sided && surface.entity != other.entity && surface.meets(other) && is_near()) {
                    continue;
                }
                let filter = FilterSide::of_surface(other);
                let names = (other.entity, other.fresh, &filter);
                let surroundings = Surroundings { scene, particles: &solver.particles, first: &first };
                let solid = || surroundings.placed(other);
                let Some(way) = self.find(surroundings, body, names, 0.0, solid) else { continue };
                let distance = f64::from(surface.thickness) + f64::from(other.thickness);
                let end = end_of(scene, other, way.exit.at);
                way.lead_out(&mut solver.particles, &mut solver.contacts, end, distance);
            }
            for shape in &scene.active.shapes {
                if !is_near(surface, shape, scene) {
                    continue;
                }
                let [pose, ahead] = scene.poses(shape);
                let shallow = SHALLOW * f64::from(surface.thickness);
                let solid = || Some(Solid::shape(&shape.geometry, pose));
                let filter = FilterSide::of_shape(shape);
                let names = (shape.entity, shape.fresh, &filter);
                let surroundings = Surroundings { scene, particles: &solver.particles, first: &first };
                let way = self.find(surroundings, body, names, shallow, solid);
                let Some(way) = way else { continue };
                let end = ahead.transform_point(pose.inverse().transform_point(way.exit.at));
                way.lead_out(&mut solver.particles, &mut solver.contacts, end, f64::from(surface.thickness));
            }
        }
        let Self { ways, near, .. } = self;
        ways.retain(|pair, _| near.contains(pair));
    }

    /// Finds the exit of a body from a solid near it, and lets the vertices inside leave. `None` if nothing is deeper than
    /// `shallow`: contacts resolve that.
    fn find<'a>(
        &mut self,
        surroundings: Surroundings<'a>,
        body: Body<'_>,
        (entity, fresh, other): (Entity, bool, &FilterSide),
        shallow: f64,
        solid: impl FnOnce() -> Option<Solid<'a>>,
    ) -> Option<WayOut> {
        let Surroundings { scene, particles, .. } = surroundings;
        let surface = body.surface;
        let pair = (surface.entity, entity);
        self.near.insert(pair);
        let is_new = !self.before.contains(&pair) || surface.fresh || fresh;
        let contacts_reach = SHALLOW * f64::from(surface.thickness);
        let before = self.ways.remove(&pair);
        if !(is_new || before.is_some() || scene.is_deep_in(surface.entity, entity, contacts_reach)) {
            return None;
        }
        let solid = solid()?;
        let crossing = scene.crossing_of(surface.entity, entity);
        let inside = Inside::new(particles, body, &solid, (other, scene.filter.as_deref()), shallow, &crossing)?;
        let triangles = crossing.iter().flat_map(|place| surface.topology.triangles_beside(place.triangle));
        self.crossing.insert(pair, triangles.collect());
        let margin = 2.0 * f64::from(surface.thickness);
        let threaded = inside.is_threaded().then(|| threaded(&crossing, body, particles)).flatten();
        if let Some(part) = &threaded {
            let leaving = part.vertices.iter().map(|&vertex| body.first as u32 + vertex);
            self.leaving.entry(entity).or_default().extend(leaving);
        }
        let opposite = self.ways.get(&(entity, surface.entity)).map(|other| -other.direction);
        let back = threaded.map(|part| part.back);
        let kept = opposite.or(back).or(before.filter(|before| before.age < CHOSEN_FOR).map(|before| before.direction));
        let new = |exit: Exit| Chosen { direction: exit.outward, age: 0, depth: inside.depth(exit) };
        let (exit, chosen) = if let Some(exit) = kept.and_then(|along| inside.way_along(along, &[&solid], margin)) {
            let before = before.unwrap_or_else(|| new(exit));
            (exit, Chosen { direction: exit.outward, age: before.age + 1, ..before })
        } else {
            let around = surroundings.around(surface, entity);
            let all: Vec<&Solid<'_>> = std::iter::once(&solid).chain(&around).collect();
            let exit = inside.best_way(&solid, &all, margin, before)?;
            (exit, new(exit))
        };
        self.ways.insert(pair, chosen);
        let way = inside.led(exit);
        self.leaving.entry(entity).or_default().extend(way.vertices());
        Some(way)
    }
}

/// Whether a body may touch a shape.
fn is_near(body: &ActiveSurface, shape: &ActiveShape, scene: &Scene<'_, '_>) -> bool {
    let [pose, _] = scene.poses(shape);
    body.layers.interacts_with(shape.layers)
        && shape.geometry.bounds().is_none_or(|bounds| moved_box(&bounds, &pose).overlaps(&body.world_bounds))
}

impl<'a> Surroundings<'a> {
    /// A surface at its position at the beginning of the tick.
    fn placed(self, surface: &'a ActiveSurface) -> Option<Solid<'a>> {
        let count = surface.topology.vertex_count();
        let at = |vertex: usize| Some(self.scene.ends(surface.entity, &surface.pose, vertex)?[0]);
        let points: Option<Vec<DVec3>> = match (self.first)(surface.entity) {
            Some(first) => Some(self.particles.start[first..first + count].to_vec()),
            None => (0..count).map(at).collect(),
        };
        Some(Solid::surface(&surface.topology, points?, surface.one_sided))
    }

    /// Every solid or sheet that the body collides with and cannot push away, except the given solid.
    fn around(self, body: &ActiveSurface, solid: Entity) -> Vec<Solid<'a>> {
        let is_firm =
            |other: &&ActiveSurface| other.entity != solid && (self.first)(other.entity).is_none() && body.meets(other);
        let surfaces = self.scene.active.surfaces.iter().filter(is_firm).filter_map(|other| self.placed(other));
        let meets = |other: &&ActiveShape| other.entity != solid && body.layers.interacts_with(other.layers);
        let shapes = self.scene.active.shapes.iter().filter(meets);
        surfaces.chain(shapes.map(|other| Solid::shape(&other.geometry, self.scene.poses(other)[0]))).collect()
    }
}

/// Position, at the end of the tick, of a point on a surface: it moves with the nearest vertex. A body's point stays.
fn end_of(scene: &Scene<'_, '_>, surface: &ActiveSurface, point: DVec3) -> DVec3 {
    let Some(course) = scene.motions.course(surface.entity) else { return point };
    let vertices = 0..surface.topology.vertex_count();
    let away = |vertex: &usize| course.now.point(*vertex).distance_squared(point);
    let nearest = vertices.min_by(|one, other| away(one).total_cmp(&away(other)));
    nearest.map_or(point, |vertex| point + course.ahead.point(vertex) - course.now.point(vertex))
}

/// For every triangle of a body with more than one crossing, the mean of its crossings.
fn between(crossing: &[Crossing], body: Body<'_>, particles: &Particles) -> impl Iterator<Item = BodyPoint> {
    crossing.chunk_by(|one, other| one.triangle == other.triangle).filter(|places| places.len() > 1).map(
        move |places| {
            let corners = body.surface.topology.welded_triangles()[places[0].triangle as usize];
            let mean =
                |corner: usize| places.iter().map(|place| place.weights[corner]).sum::<f64>() / places.len() as f64;
            let entries = [0, 1, 2].map(|corner| (body.first as u32 + corners[corner], mean(corner)));
            BodyPoint::new(entries, particles)
        },
    )
}

/// The smaller part of a body that a solid cuts off by piercing it. It moves back to the larger part.
fn threaded(crossing: &[Crossing], body: Body<'_>, particles: &Particles) -> Option<CutOff> {
    let topology = &body.surface.topology;
    let piercing: Vec<PiercingEdge> = crossing
        .iter()
        .filter_map(|place| {
            let Feature::Edge(edge) = place.feature else { return None };
            let corners = topology.welded_triangles()[place.triangle as usize];
            let points = corners.map(|vertex| particles.start[body.first + vertex as usize]);
            let piercing = PiercingEdge::new(topology, place.triangle, edge, points, DVec3::normalize_or_zero);
            (piercing.normal != DVec3::ZERO).then_some(piercing)
        })
        .collect();
    cut_off(topology.vertex_count(), topology.edges(), &piercing)
}

/// The points of a body that are inside a solid.
struct Inside {
    points: Vec<BodyPoint>,
    /// A representative point inside.
    from: DVec3,
}

impl Inside {
    /// Collects the vertices inside, and points between the crossings of triangles. `None` if there are too many to
    /// test, or if nothing is deeper than `shallow`.
    fn new(
        particles: &Particles,
        body: Body<'_>,
        solid: &Solid<'_>,
        other: (&FilterSide, Option<&ContactFilter>),
        shallow: f64,
        crossing: &[Crossing],
    ) -> Option<Self> {
        let at = |particle: usize| particles.start[particle];
        let is_free = |&particle: &usize| particles.inverse_mass[particle] > 0.0;
        let near: Vec<usize> =
            body.particles().filter(is_free).filter(|&particle| solid.may_contain(at(particle))).collect();
        if near.len() * solid.cost() > MOST_LOOKS {
            return None;
        }
        let vertices = near.into_iter().map(|particle| BodyPoint::new([(particle as u32, 1.0)], particles));
        let inside = |point: &BodyPoint| solid.contains(point.at, 0.0);
        let mut points: Vec<BodyPoint> = vertices.filter(inside).collect();
        let own = FilterSide::of_surface(body.surface);
        if let Some(filter) = PairFilter::between(&own, other.0, false, other.1) {
            points.retain(|point| body.may_touch(point, solid, &filter));
        }
        let vertex_count = points.len();
        points.extend(between(crossing, body, particles).filter(inside));
        if points.len() == vertex_count && !points.iter().any(|point| solid.contains(point.at, shallow)) {
            return None;
        }
        let center = points.iter().map(|point| point.at).sum::<DVec3>() / points.len().max(1) as f64;
        // The center of the points may be outside a solid that is not convex.
        let away = |point: &DVec3| point.distance_squared(center);
        let nearest = points.iter().map(|point| point.at).min_by(|one, other| away(one).total_cmp(&away(other)))?;
        let middle = body.particles().map(at).sum::<DVec3>() / body.particles().len().max(1) as f64;
        let from = [middle, center].into_iter().find(|&point| solid.contains(point, 0.0)).unwrap_or(nearest);
        Some(Self { points, from })
    }

    /// Whether triangles pass through the solid although no vertex is inside.
    fn is_threaded(&self) -> bool {
        self.points.iter().all(|point| point.entries.len() > 1)
    }

    /// The nearest place along a direction with room for all points between the solids.
    fn way_along(&self, direction: DVec3, solids: &[&Solid<'_>], margin: f64) -> Option<Exit> {
        let [lowest, highest] = self.ends(direction)?;
        let room = direction.dot(highest - lowest) + margin;
        let free = |from: DVec3| Some(from + direction * free_from(from, direction, solids, room)?);
        // Any point may have farther to go than the representative one.
        let step = self.points.len().div_ceil(MOST_FOLLOWED);
        let followed = self.points.iter().step_by(step).map(|point| point.at).chain([self.from, lowest]);
        let mut farthest: Option<DVec3> = None;
        for from in followed {
            let at = free(from)?;
            farthest = farthest.filter(|farthest| direction.dot(*farthest) >= direction.dot(at)).or(Some(at));
        }
        let at = farthest?;
        Some(Exit { at, outward: direction })
    }

    /// The lowest and the highest of the points along a direction.
    fn ends(&self, direction: DVec3) -> Option<[DVec3; 2]> {
        let points = || self.points.iter().map(|point| point.at);
        let by_height = |one: &DVec3, other: &DVec3| direction.dot(*one).total_cmp(&direction.dot(*other));
        Some([points().min_by(by_height)?, points().max_by(by_height)?])
    }

    fn depth(&self, way: Exit) -> f64 {
        self.ends(way.outward).map_or(0.0, |[lowest, _]| way.outward.dot(way.at - lowest))
    }

    /// The shortest exit among the previous direction, the direction to the nearest boundary point, and the fixed
    /// directions. If none leads to free space, the nearest exit of the solid.
    fn best_way(&self, solid: &Solid<'_>, solids: &[&Solid<'_>], margin: f64, before: Option<Chosen>) -> Option<Exit> {
        let nearest = solid.nearest_exit(self.from);
        let taken = before.map(|before| before.direction);
        let tried = taken.into_iter().chain(nearest.map(|exit| exit.outward)).chain(directions());
        let ways = tried.filter_map(|direction| self.way_along(direction, solids, margin));
        let cost = |way: &Exit| {
            let depth = self.depth(*way);
            match before.filter(|before| before.direction.dot(way.outward) > SAME) {
                Some(before) if depth <= LEFT * before.depth => depth * FAITH,
                _ => depth,
            }
        };
        ways.min_by(|one, other| cost(one).total_cmp(&cost(other))).or(nearest)
    }

    fn led(self, exit: Exit) -> WayOut {
        let depth = self.depth(exit).max(0.0);
        WayOut { points: self.points, exit, depth }
    }
}

/// Distance to travel from a point along a direction until the next `room` is free of all solids.
fn free_from(point: DVec3, direction: DVec3, solids: &[&Solid<'_>], room: f64) -> Option<f64> {
    let mut free = 0.0;
    for _ in 0..MOST_SOLIDS {
        let before = free;
        for solid in solids {
            free = solid.free_from(point, direction, free, room)?;
        }
        if free == before {
            return Some(free);
        }
    }
    None
}

/// The 26 unit vectors to the faces, edges, and corners of a cube.
fn directions() -> impl Iterator<Item = DVec3> {
    let places = (0..27).map(|place| [place % 3, place / 3 % 3, place / 9].map(|step| f64::from(step) - 1.0));
    places.filter_map(|place| DVec3::from_array(place).try_normalize())
}

impl WayOut {
    /// The particles among the points. Points on triangles are left out.
    fn vertices(&self) -> impl Iterator<Item = u32> {
        self.points.iter().filter(|point| point.entries.len() == 1).map(|point| point.entries[0].0)
    }

    /// Adds a constraint for every point: to get beyond the plane through the exit, which moves to `end`. The deepest
    /// point sets the speed.
    fn lead_out(&self, particles: &mut Particles, contacts: &mut SolverContacts, end: DVec3, distance: f64) {
        let exit = particles.len() as u32;
        particles.push_driven(self.exit.at, end);
        let pace = distance.max(self.depth * DEPTHS_OF_PACE);
        for point in &self.points {
            let entries = point.entries.iter().copied().chain([(exit, -1.0)]).collect();
            let features = Features::Plane { particles: entries, offset: -distance };
            let normal = self.exit.outward;
            let constraint = ContactConstraint {
                parts: features,
                normal,
                distance: pace,
                friction: [0.0; 2],
                reaction: NO_REACTION,
                recovers: false,
            };
            contacts.push(&constraint, particles);
        }
    }
}
