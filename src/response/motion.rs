//! Trajectories of everything that the game moves and the solver does not: animated surfaces, rigid shapes, and pinned
//! vertices.
//!
//! The game has written where these are at the end of the tick. Detection and solver see them where the last tick left
//! them, like the bodies, and they move to their ends while the solver steps. If one of them moves farther than an edge
//! near a body, the tick is split into parts with a detection each. If what holds a body has jumped, the body comes along.

mod course;
mod jump;
mod rigid;

use std::sync::Arc;

use bevy_ecs::{
    change_detection::Tick,
    entity::{EntityHashMap, EntityHashSet, EntityIndexMap},
    prelude::*,
};
use bevy_time::Time;
use glam::{DVec3, Vec3};

pub(super) use self::jump::carry;
use self::{
    course::{Course, Region, Stand, Track},
    rigid::{Masses, Pushed},
};
use super::{body::XpbdBody, sleep::Sleep};
use crate::{
    kernel::{
        exact::rigid_shape::ShapeGeometry,
        mesh::{bounds::Aabb, topology::SurfaceTopology},
        pose::Pose,
    },
    surface::{ActiveSurface, ActiveSurfaces, DeformableSurface, SurfacePositions, SweptTarget, TetrahedralBody},
};

/// Largest number of parts of a tick. With fewer, no kinematic object moves farther between two detections than the
/// mean edge of the finest body near it.
const MOST_PARTS: u32 = 8;

/// The state of an object that the solver does not move, at the end of the last tick.
#[derive(Clone, Debug, Default)]
struct Trace {
    stand: Stand,
    /// The last change of its positions.
    changed: Option<Tick>,
    /// From 1 on; 0 before the first.
    tick: u64,
}

/// The trajectories of everything that the solver does not move.
#[derive(Resource, Clone, Debug, Default)]
pub(super) struct Motions {
    tick: u64,
    traces: EntityHashMap<Trace>,
    courses: EntityHashMap<Course>,
    parts: u32,
    part: u32,
    /// Largest displacement of any object near a body within one part, in world units.
    longest: f64,
    /// Sleeping bodies that something comes near, so fast that contacts might not show it in time.
    approached: Vec<Entity>,
    /// Rigid bodies that contacts push, in the order of their shapes.
    pushed: EntityIndexMap<Pushed>,
    /// Bodies that are carried along in this tick because what holds them has jumped.
    carried: Vec<Entity>,
    /// Rigid bodies whose masses cannot be used. The log has warned of them.
    massless: EntityHashSet,
}

/// Where a body may be in this tick, its mean displacement, and its mean edge.
struct Reach {
    entity: Entity,
    is_asleep: bool,
    /// The farthest displacement of a vertex.
    way: f64,
    region: Region,
    motion: DVec3,
    mean_edge: f64,
}

impl Motions {
    /// What the next tick depends on.
    pub(super) fn remembered(&self) -> Self {
        Self { tick: self.tick, traces: self.traces.clone(), ..Self::default() }
    }

    /// Number of parts of the tick, 1 or more.
    pub(super) fn parts(&self) -> u32 {
        self.parts.max(1)
    }

    /// The shares of the tick at which the current part begins and ends.
    pub(super) fn shares(&self) -> [f64; 2] {
        [self.part, self.part + 1].map(|part| f64::from(part) / f64::from(self.parts()))
    }

    /// Largest displacement of any object near a body within one part of the tick, in world units.
    pub(super) fn longest(&self) -> f64 {
        self.longest
    }

    /// The trajectory of an object that moves in the current part.
    pub(super) fn course(&self, entity: Entity) -> Option<&Course> {
        self.courses.get(&entity)
    }

    /// The vertices of a body as the game has written them, if it has moved pinned ones.
    pub(super) fn pins_of(&self, entity: Entity) -> Option<&[Vec3]> {
        self.courses.get(&entity).filter(|course| course.is_of_pins).map(|course| &*course.to.positions)
    }

    /// Bodies that are carried along in this tick because what holds them has jumped.
    pub(super) fn carried(&self) -> &[Entity] {
        &self.carried
    }

    pub(super) fn is_last_part(&self) -> bool {
        self.part + 1 >= self.parts()
    }

    /// Sleeping bodies that something comes near, so fast that contacts might not show it in time.
    pub(super) fn approached(&self) -> &[Entity] {
        &self.approached
    }

    /// Records the trajectory of an object if it has moved since the last tick, or if contacts push it. A surface has
    /// triangles, positions, and the last change of these; a shape that is tested by formula has none.
    fn follow(
        &mut self,
        entity: Entity,
        mesh: Option<(&Arc<SurfaceTopology>, &[Vec3], Tick)>,
        (pose, is_pushed): (&Pose, bool),
        fresh: bool,
    ) {
        let (positions, changed) = mesh.map_or((&[][..], None), |(_, positions, changed)| (positions, Some(changed)));
        let tick = self.tick;
        let trace = self.traces.entry(entity).or_default();
        let is_known =
            trace.tick > 0 && trace.tick + 1 == tick && !fresh && trace.stand.positions.len() == positions.len();
        let deforms = changed.is_none_or(|_| trace.changed != changed) && trace.stand.positions != positions;
        if is_known && !is_pushed && !deforms && trace.stand.pose.has_bits_of(pose) {
            (trace.tick, trace.changed) = (tick, changed);
            return;
        }
        let from = std::mem::take(&mut trace.stand);
        trace.stand.set(positions, pose);
        (trace.tick, trace.changed) = (tick, changed);
        if is_known || is_pushed {
            let to = trace.stand.clone();
            let from = if is_known { from } else { to.clone() };
            let topology = mesh.map(|(topology, ..)| Arc::clone(topology));
            self.courses.insert(entity, Course { topology, ..Course::new(from, to, false) });
        }
    }

    /// Resets to a tick in which nothing moves.
    fn stand_still(&mut self) {
        self.courses.clear();
        self.approached.clear();
        self.pushed.clear();
        self.carried.clear();
        (self.parts, self.part, self.longest) = (1, 0, 0.0);
    }

    /// Drops trajectories that come near no body, and decides how many parts the tick needs.
    fn plan(&mut self, bodies: &[Reach], track: impl Fn(Entity, &Course) -> Track) {
        let (mut parts, mut longest) = (1, 0.0_f64);
        let Self { courses, approached, .. } = self;
        for sleeper in bodies.iter().filter(|body| body.is_asleep) {
            let mut fast = bodies.iter().filter(|body| !body.is_asleep && body.way > body.mean_edge);
            if fast.any(|body| body.region.overlaps(&sleeper.region)) {
                approached.push(sleeper.entity);
            }
        }
        courses.retain(|&entity, course| {
            if course.is_of_pins {
                return true;
            }
            let track = track(entity, course);
            let mut is_near = false;
            for body in bodies.iter().filter(|body| body.region.overlaps(&track.region)) {
                is_near = true;
                let way = track.way(&body.region, body.motion);
                if body.is_asleep && way > 0.0 {
                    approached.push(body.entity);
                }
                longest = longest.max(way);
                let fits = |count: &u32| way <= f64::from(*count) * body.mean_edge;
                if body.mean_edge > 0.0 {
                    parts = (parts..MOST_PARTS).find(fits).unwrap_or(MOST_PARTS);
                }
            }
            is_near
        });
        self.parts = parts;
        self.longest = longest / f64::from(self.parts);
        self.part = 0;
        for course in self.courses.values_mut() {
            course.ahead = course.from.clone();
        }
        self.look_ahead();
    }

    /// Advances every trajectory to the part that begins.
    fn look_ahead(&mut self) {
        let share = f64::from(self.part + 1) / f64::from(self.parts());
        for Course { from, to, deforms, now, ahead, .. } in self.courses.values_mut() {
            std::mem::swap(now, ahead);
            ahead.become_between(from, to, share, *deforms);
        }
        self.look_ahead_pushed();
    }
}

/// Finds out what the game has moved, and where to. If the transform of a body has moved, the body keeps its place in
/// the world, and its pinned vertices move with the transform.
pub(super) fn begin(
    time: Option<Res<Time>>,
    active: Res<ActiveSurfaces>,
    sleep: Res<Sleep>,
    masses: Masses<'_, '_>,
    mut motions: ResMut<Motions>,
    mut surfaces: Query<(
        &mut SurfacePositions,
        Option<&mut XpbdBody>,
        Option<(&DeformableSurface, Option<&TetrahedralBody>)>,
    )>,
) {
    let motions = &mut *motions;
    motions.stand_still();
    let duration = time.map_or(0.0, |time| time.delta_secs_f64());
    if duration <= 0.0 {
        // While the clock is stopped, motion is deferred to the next tick. An object that jumps forgets where it was.
        let all = active.surfaces.iter().map(|surface| (surface.entity, surface.fresh));
        let all = all.chain(active.shapes.iter().map(|shape| (shape.entity, shape.fresh)));
        for (jumped, _) in all.filter(|(_, fresh)| *fresh) {
            motions.traces.remove(&jumped);
            if let Ok((_, Some(mut body), _)) = surfaces.get_mut(jumped) {
                body.stood = None;
            }
        }
        return;
    }
    motions.tick += 1;
    for surface in &active.surfaces {
        let Ok((mut positions, mut body, mesh)) = surfaces.get_mut(surface.entity) else { continue };
        if let Some((body, (mesh, inside))) = body.as_mut().zip(mesh)
            && body.is_of_another(mesh.topology())
            && let Ok(made) = body.with_mesh(mesh, inside, &positions, &surface.pose)
        {
            **body = made;
        }
        match body {
            Some(mut body) if can_move(surface, &positions, &body, &sleep) => {
                let pins = keep_in_the_world(surface, &mut positions, &mut body);
                motions.courses.extend(pins.map(|course| (surface.entity, course)));
            }
            _ => {
                let changed = positions.last_changed();
                let mesh = (&surface.topology, &*positions.0, changed);
                let is_pushed = surface.rigid && motions.weigh(surface.entity, &surface.pose, &masses);
                motions.follow(surface.entity, Some(mesh), (&surface.pose, is_pushed), surface.fresh);
            }
        }
    }
    for shape in &active.shapes {
        let is_pushed = motions.weigh(shape.entity, &shape.pose, &masses);
        motions.follow(shape.entity, None, (&shape.pose, is_pushed), shape.fresh);
    }
    let tick = motions.tick;
    motions.traces.retain(|_, trace| trace.tick == tick);
}

/// Whether the solver moves a body.
fn can_move(surface: &ActiveSurface, positions: &SurfacePositions, body: &XpbdBody, sleep: &Sleep) -> bool {
    !sleep.is_asleep(surface.entity) && body.check(&surface.topology, positions.0.len()).is_ok()
}

/// Drops trajectories that come near no body, and decides how many parts the tick needs.
pub(super) fn plan(
    time: Option<Res<Time>>,
    active: Res<ActiveSurfaces>,
    sleep: Res<Sleep>,
    mut motions: ResMut<Motions>,
    bodies: Query<(&SurfacePositions, &XpbdBody, Option<&DeformableSurface>)>,
) {
    let duration = time.map_or(0.0, |time| time.delta_secs_f64());
    if duration <= 0.0 {
        return;
    }
    let bodies = active.surfaces.iter().filter_map(|surface| {
        let (positions, body, mesh) = bodies.get(surface.entity).ok()?;
        let is_asleep = sleep.is_asleep(surface.entity);
        let mean_edge = mesh.map_or(0.0, |mesh| f64::from(mesh.mean_edge()) * surface.pose.scale());
        // What comes near a sleeping body wakes it.
        (is_asleep || can_move(surface, positions, body, &sleep))
            .then(|| Reach { is_asleep, ..reach_of(surface, &positions.0, body, mean_edge, duration) })
    });
    let bodies: Vec<Reach> = bodies.collect();
    if bodies.is_empty() {
        motions.courses.clear();
    }
    let shapes: EntityHashMap<&ShapeGeometry> =
        active.shapes.iter().map(|shape| (shape.entity, &*shape.geometry)).collect();
    let whole = Region::around(bodies.iter().flat_map(|body| [body.region.low, body.region.high]));
    motions.plan(&bodies, |entity, course| {
        let Some(geometry) = shapes.get(&entity) else {
            let ends =
                (0..course.from.positions.len()).map(|vertex| [course.from.point(vertex), course.to.point(vertex)]);
            return Track::new(ends.collect(), course.topology.clone());
        };
        let own = course.to.pose.inverse();
        let corners = geometry.bounds().map_or_else(
            || whole.corners().map(|corner| own.transform_point(corner)),
            |Aabb { min, max }| Region { low: min.as_dvec3(), high: max.as_dvec3() }.corners(),
        );
        let ends = corners.map(|corner| [&course.from, &course.to].map(|stand| stand.pose.transform_point(corner)));
        let mut track = Track::new(ends.to_vec(), None);
        if geometry.bounds().is_none() {
            // A half-space is everywhere.
            track.region = whole;
        }
        track
    });
}

/// The region in which a body may be until the tick ends.
fn reach_of(surface: &ActiveSurface, positions: &[Vec3], body: &XpbdBody, mean_edge: f64, duration: f64) -> Reach {
    let points = positions.iter().map(|position| surface.pose.transform_point(position.as_dvec3()));
    let squared = body.velocities.iter().map(|velocity| velocity.as_dvec3().length_squared());
    let way = squared.fold(0.0, f64::max).sqrt() * duration;
    let region = Region::around(points).grown(way + mean_edge + 2.0 * f64::from(surface.thickness));
    let (sum, count) = body
        .free_vertices()
        .fold((DVec3::ZERO, 0usize), |(sum, count), (velocity, _)| (sum + velocity.as_dvec3(), count + 1));
    let motion = sum * (duration / count.max(1) as f64);
    Reach { entity: surface.entity, is_asleep: false, way, region, motion, mean_edge }
}

/// If the transform of a body has moved since its positions were last written, its vertices keep their place in the
/// world, except those that the game has written. If pinned vertices have moved, with the transform or because the game
/// has written them, returns their trajectory and moves them to its beginning.
fn keep_in_the_world(
    surface: &ActiveSurface,
    positions: &mut Mut<SurfacePositions>,
    body: &mut XpbdBody,
) -> Option<Course> {
    let last = body.stood?;
    if surface.fresh || body.written.len() != positions.0.len() {
        return None;
    }
    let is_same_pose = last.has_bits_of(&surface.pose);
    let is_pinned = |vertex: usize| body.inverse_masses[vertex] <= 0.0;
    let any_pin_moved = (0..positions.0.len())
        .any(|vertex| is_pinned(vertex) && (!is_same_pose || positions.0[vertex] != body.written[vertex]));
    if is_same_pose && !any_pin_moved {
        return None;
    }
    let course = any_pin_moved.then(|| {
        let from = Stand { positions: body.written.clone(), pose: last };
        Course::new(from, Stand { positions: positions.0.clone(), pose: surface.pose }, true)
    });
    let own = surface.pose.inverse();
    for (vertex, position) in positions.0.iter_mut().enumerate() {
        let written = body.written[vertex];
        if is_pinned(vertex) || *position == written {
            *position = if is_same_pose {
                written
            } else {
                own.transform_point(last.transform_point(written.as_dvec3())).as_vec3()
            };
        }
    }
    course
}

/// Moves everything to the beginning of the current part, for detection, and tells the swept stage where it goes.
pub(super) fn rewind(
    mut active: ResMut<ActiveSurfaces>,
    motions: Res<Motions>,
    mut surfaces: Query<(&mut SurfacePositions, Option<&mut SweptTarget>)>,
) {
    show(&mut active, &motions, &mut surfaces, true);
}

/// Moves everything back to where the game has written it.
pub(super) fn restore(
    mut active: ResMut<ActiveSurfaces>,
    motions: Res<Motions>,
    mut surfaces: Query<(&mut SurfacePositions, Option<&mut SweptTarget>)>,
) {
    show(&mut active, &motions, &mut surfaces, false);
}

/// Proceeds to the next part of the tick.
pub(super) fn advance(mut motions: ResMut<Motions>) {
    motions.part += 1;
    motions.look_ahead();
}

/// Shows kinematic objects at the beginning of the current part, with their sweep targets, or at the end of the tick.
fn show(
    active: &mut ActiveSurfaces,
    motions: &Motions,
    surfaces: &mut Query<(&mut SurfacePositions, Option<&mut SweptTarget>)>,
    is_on_its_way: bool,
) {
    if motions.courses.is_empty() {
        return;
    }
    let course_of = |entity| motions.courses.get(&entity).filter(|course| !course.is_of_pins);
    for shape in &mut active.shapes {
        let Some(course) = course_of(shape.entity) else { continue };
        shape.pose = course.shown(is_on_its_way).pose;
        shape.target = is_on_its_way.then_some(course.ahead.pose);
    }
    for surface in &mut active.surfaces {
        let Some(course) = course_of(surface.entity) else { continue };
        let stand = course.shown(is_on_its_way);
        surface.pose = stand.pose;
        let Ok((mut positions, target)) = surfaces.get_mut(surface.entity) else { continue };
        if course.deforms {
            positions.0.clone_from(&stand.positions);
        }
        if let Some(mut target) = target {
            target.0.clear();
            if is_on_its_way {
                let (own, ahead) = (stand.pose.inverse(), &course.ahead);
                let vertices = 0..ahead.positions.len();
                target.0.extend(vertices.map(|vertex| own.transform_point(ahead.point(vertex)).as_vec3()));
            }
        }
    }
}
