//! The systems of the response: choose margins for detection, solve the tick, and write the result back.

use core::time::Duration;

use bevy_ecs::{entity::EntityHashMap, prelude::*};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use bevy_time::Time;
use glam::{DVec3, Vec3};

use super::{
    body::XpbdBody,
    error::{MOST_COORDINATE, XpbdBodyError},
    gather::{Gatherer, Watch},
    guard::{self, Guard},
    margins::BodyMargins,
    motion::{self, Motions},
    particles::Particles,
    reaction::SurfaceReaction,
    rigid_body::RigidPush,
    scene::Scene,
    settings::XpbdSettings,
    sleep::Sleep,
    solver::{Solved, Solver},
    thick::warn_of_thick,
};
use crate::{
    detection::ImpactsRead,
    diagnostics::StageWatch,
    kernel::{
        mesh::{ids::VertexId, topology::SurfaceTopology},
        pose::Pose,
        simd::parallel::{Sequential, Team},
    },
    schedule::run_detection,
    surface::{ActiveSurface, ActiveSurfaces, Named, SurfacePositions, SweptCollision, SweptTarget},
};

/// What the response did in the last tick. If the tick was split, fields that say so describe its last part only, and
/// the others are sums over all parts.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Resource, Clone, Debug, Default))]
pub struct XpbdDiagnostics {
    /// Bodies that were carried along, because their pins or the targets of their tethers have jumped without
    /// [`Teleported`](crate::Teleported): rigidly, and farther than in the tick before, by more than a quarter of the body's
    /// size and more than 8 of its mean edges. Their contacts of earlier ticks are forgotten.
    pub carried: Vec<Entity>,
    /// Number of parts that the tick was split into, each with its own detection, from 1 to 8. More than 1 if a
    /// kinematic surface or shape near a body moves farther than the body's mean edge, relative to the body.
    pub parts: u32,
    /// Bodies that were moved, in the last part.
    pub bodies: usize,
    /// Bodies that slept, in the last part: see [`XpbdSettings::sleep_speed`].
    pub asleep: usize,
    /// Contacts that the solver watched, in the last part: those with a body on at least one side that may act in the
    /// tick, and depenetration constraints.
    pub contacts: usize,
    /// Contact solves over all substeps and iterations. If the tick was solved again, only its last solution counts.
    pub contact_solves: usize,
    /// Contacts that pushed in the last substep, in the last part.
    pub pressing: usize,
    /// Time to make constraints of contacts.
    pub gathering: Duration,
    /// Time to solve, and to solve again with contacts that were not expected to act.
    pub solving: Duration,
    /// How often the tick was solved again, with contacts that were not expected to act, or with constraints against
    /// impacts that were found along the trajectories of bodies.
    pub solved_again: usize,
    /// Impacts along the trajectories of bodies with [`SweptCollision`](crate::SweptCollision) that contacts did not
    /// prevent.
    pub impacts: usize,
    /// Vertices that the guard moved or stopped because of them.
    pub vertices_stopped: usize,
    /// Impacts that could not be prevented, because two kinematic objects squeeze a body so that no way is left. The
    /// body may be inside one of them. If this is not 0 or `jammed` is not empty, the log warns once per episode.
    pub impacts_remaining: usize,
    /// Bodies squeezed so that they collided with themselves nearly everywhere. They were not kept from crossing
    /// themselves. A body is listed once for each part of the tick in which that happened.
    pub jammed: Vec<Entity>,
    /// Vertices, and points between vertices, that were inside a solid at the beginning of the last part. They are
    /// depenetrated.
    pub inside: usize,
    /// Time to look for impacts and to solve again.
    pub guarding: Duration,
    /// Bodies that could not be moved, with the reason. They stay in place until it is fixed. In the last part.
    pub refused: Vec<(Entity, XpbdBodyError)>,
}

/// State that the response keeps between stages and ticks.
#[derive(Resource, Default)]
pub(super) struct Response {
    solver: Solver,
    pub(super) gatherer: Gatherer,
    guard: Guard,
    /// The bodies of this tick, in the order of the solver.
    moved: Vec<Entity>,
    /// The margins of each body.
    pub(super) margins: EntityHashMap<BodyMargins>,
    /// How far something falls from rest in this tick or part, in world units.
    pub(super) fall: f32,
    refused: Vec<Entity>,
    /// Bodies that left the computable range, in this tick and in the last one.
    stopped: Vec<Entity>,
    stopped_last: Vec<Entity>,
    /// Whether the warning about a fast body without [`SweptCollision`] has been logged.
    has_warned_of_speed: bool,
    /// Number of ticks until a squeezed body is warned about again.
    squeezed_for: u32,
}

/// Number of ticks without a squeezed body after which the warning may repeat.
const CALM_TICKS: u32 = 60;

/// Smallest number of substeps of a part. With fewer, vertices lag behind the kinematic object that pushes them.
const LEAST_SUBSTEPS: u32 = 4;

/// With fewer particles than this, more than one thread does not pay off.
const LEAST_SHARED: usize = 1024;

/// How often a tick is solved again with contacts that were not expected to act.
const MOST_MISSED: usize = 2;

/// Largest number of solutions of an unsplit tick, and of a part.
const MOST_SOLUTIONS: usize = 4;
const MOST_SOLUTIONS_OF_PART: usize = 3;

/// Tells the swept stage where bodies with [`SweptCollision`] would move at their velocities. Not where gravity would
/// pull them: what lies still would be swept for nothing.
pub(super) fn aim(
    time: Option<Res<Time>>,
    active: Res<ActiveSurfaces>,
    (motions, sleep, read): (Res<Motions>, Res<Sleep>, Res<ImpactsRead>),
    mut bodies: Query<(&SurfacePositions, &XpbdBody, &mut SweptTarget), With<SweptCollision>>,
) {
    if !read.0 {
        return;
    }
    let duration = time.map_or(0.0, |time| time.delta_secs_f64()) / f64::from(motions.parts());
    for surface in &active.surfaces {
        let Ok((positions, body, mut target)) = bodies.get_mut(surface.entity) else { continue };
        target.0.clear();
        if sleep.is_asleep(surface.entity) || body.check(&surface.topology, positions.0.len()).is_err() {
            continue;
        }
        let own = surface.pose.inverse();
        let motions = body.velocities.iter().zip(&body.inverse_masses);
        target.0.extend(positions.0.iter().zip(motions).map(|(&position, (velocity, &inverse_mass))| {
            if inverse_mass <= 0.0 {
                return position;
            }
            let world = surface.pose.transform_point(position.as_dvec3());
            own.transform_point(world + velocity.as_dvec3() * duration).as_vec3()
        }));
    }
}

/// Solves the tick in all its parts. Each part begins with a detection, which has already run for the first.
pub(super) fn respond_in_parts(world: &mut World) {
    *world.resource_mut::<XpbdDiagnostics>() = XpbdDiagnostics::default();
    world.resource_mut::<Response>().gatherer.reactions.begin_tick();
    let parts = world.resource::<Motions>().parts();
    for part in 0..parts {
        if part > 0 {
            run(world, motion::advance);
            run(world, aim);
            run(world, motion::rewind);
            run_detection(world);
            run(world, motion::restore);
        }
        run(world, respond);
        if part + 1 < parts {
            run(world, write_back);
        }
    }
    let carried = world.resource::<Motions>().carried().to_vec();
    let mut diagnostics = world.resource_mut::<XpbdDiagnostics>();
    (diagnostics.parts, diagnostics.carried) = (parts, carried);
    run(world, warn_of_squeezed);
    run(world, write_reactions);
}

fn write_reactions(
    active: Res<ActiveSurfaces>,
    response: Res<Response>,
    mut motions: ResMut<Motions>,
    mut reactions: Query<&mut SurfaceReaction>,
    mut pushes: Query<(Entity, &mut RigidPush)>,
) {
    response.gatherer.reactions.write(&active, &mut reactions);
    motions.end_pushes(&mut pushes);
}

/// Warns once per episode that bodies are squeezed with no way left.
fn warn_of_squeezed(diagnostics: Res<XpbdDiagnostics>, mut response: ResMut<Response>) {
    let XpbdDiagnostics { impacts_remaining, jammed, .. } = &*diagnostics;
    if *impacts_remaining == 0 && jammed.is_empty() {
        response.squeezed_for = response.squeezed_for.saturating_sub(1);
        return;
    }
    if response.squeezed_for == 0 {
        let by_themselves =
            if jammed.is_empty() { String::new() } else { format!("; these may cross themselves: {jammed:?}") };
        log::warn!(
            "bodies are squeezed with no way left and may be inside the objects that squeeze them ({impacts_remaining} \
             impacts remain{by_themselves}): leave more room between kinematic objects, and keep thicknesses below a quarter \
             of the shortest edges. This warning repeats only after {CALM_TICKS} ticks without squeezing"
        );
    }
    response.squeezed_for = CALM_TICKS;
}

fn run<M>(world: &mut World, system: impl IntoSystem<(), (), M> + 'static) {
    if let Err(error) = world.run_system_cached(system) {
        log::error!("a step of the response did not run: {error}");
    }
}

/// Solves one part of the tick.
fn respond(
    time: Option<Res<Time>>,
    settings: Res<XpbdSettings>,
    mut scene: Scene,
    mut sleep: ResMut<Sleep>,
    mut response: ResMut<Response>,
    mut diagnostics: ResMut<XpbdDiagnostics>,
) {
    let response = &mut *response;
    response.moved.clear();
    response.solver.clear();
    diagnostics.refused.clear();
    let parts = scene.motions.parts();
    let duration = time.map_or(0.0, |time| time.delta_secs_f64()) / f64::from(parts);
    if duration <= 0.0 {
        return;
    }
    let mut settings = settings.in_range();
    settings.substeps = settings.substeps.div_ceil(parts).max(LEAST_SUBSTEPS.min(settings.substeps));
    let start = StageWatch::start("gather");
    sleep.wake_touched(&scene);
    diagnostics.asleep = sleep.count();
    let Response { solver, gatherer, guard, moved, refused, fall, .. } = response;
    gatherer.begin();
    gatherer.add_rigid_bodies(solver, &mut scene.motions);
    let awake = scene.active.surfaces.iter().filter(|surface| !sleep.is_asleep(surface.entity));
    for surface in awake {
        let Ok((positions, Some(body), inside)) = scene.positions.get(surface.entity) else { continue };
        match body.check(&surface.topology, positions.0.len()).and_then(|()| body.check_inside(inside)) {
            Ok(()) => {
                if body.stood.is_none() {
                    warn_of_thick(surface, body, scene.name(surface.entity));
                }
                gatherer.add_body(solver, &scene, surface, &positions.0, body);
                moved.push(surface.entity);
            }
            Err(error) => {
                if !refused.contains(&surface.entity) {
                    log::warn!("body {} is not moved: {error}", Named(surface.entity, scene.name(surface.entity)));
                }
                diagnostics.refused.push((surface.entity, error));
            }
        }
    }
    refused.clear();
    refused.extend(diagnostics.refused.iter().map(|&(entity, _)| entity));
    diagnostics.bodies = moved.len();
    solver.contacts.begin(&solver.particles);
    diagnostics.inside = gatherer.lead_out(solver, &scene);
    let watch = Watch { duration, substeps: settings.substeps, fall: f64::from(*fall) };
    let most = if parts > 1 { MOST_SOLUTIONS_OF_PART } else { MOST_SOLUTIONS };
    let (threads, is_large) = (scene.threads(), solver.particles.len() >= LEAST_SHARED || guard::is_large(&scene));
    let (scene, diagnostics, gathering) = (&mut scene, &mut *diagnostics, Some(start));
    let mut part = Part { settings, watch, most, gathering, scene, solver, gatherer, guard, diagnostics };
    if is_large {
        threads.with_team(&mut |team| part.run(team));
    } else {
        part.run(&Sequential);
    }
}

/// One part of the tick whose bodies have been gathered.
struct Part<'a, 'w, 's> {
    settings: XpbdSettings,
    watch: Watch,
    /// The most solutions.
    most: usize,
    /// Measures how long gathering takes.
    gathering: Option<StageWatch>,
    scene: &'a mut Scene<'w, 's>,
    solver: &'a mut Solver,
    gatherer: &'a mut Gatherer,
    guard: &'a mut Guard,
    diagnostics: &'a mut XpbdDiagnostics,
}

impl Part<'_, '_, '_> {
    fn run(&mut self, team: &dyn Team) {
        self.gather_contacts(team);
        let solved = self.solve(team);
        self.guard(team, solved);
    }

    fn gather_contacts(&mut self, team: &dyn Team) {
        let Self { watch, scene, solver, gatherer, diagnostics, gathering, .. } = self;
        gatherer.add_contacts(team, solver, scene, *watch);
        diagnostics.gathering += gathering.take().map_or(Duration::ZERO, StageWatch::stop);
    }

    fn solve(&mut self, team: &dyn Team) -> Solved {
        let Self { settings, watch, scene, solver, gatherer, diagnostics, .. } = self;
        let start = StageWatch::start("solve");
        solver.begin();
        let mut solved = solver.advance(team, watch.duration, settings, &mut |solver, substep| {
            gatherer.add_pushed(solver, scene, *watch, substep)
        });
        scene.motions.push(&solver.rigid_bodies);
        for _ in 0..MOST_MISSED {
            if !gatherer.add_missed(solver, scene) {
                break;
            }
            solver.begin_again();
            solved = solver.advance(team, watch.duration, settings, &mut |_, _| false);
            scene.motions.push(&solver.rigid_bodies);
            diagnostics.solved_again += 1;
        }
        diagnostics.contacts = solver.contacts.len();
        diagnostics.solving += start.stop();
        solved
    }

    /// Looks for what passes through something, solves again with what it finds, and stops what remains.
    fn guard(&mut self, team: &dyn Team, mut solved: Solved) {
        let &mut Self { ref settings, watch: Watch { duration, .. }, most, .. } = self;
        let Self { scene, solver, gatherer, guard, diagnostics, .. } = self;
        let start = StageWatch::start("guard");
        solver.follow_welds();
        let mut met = guard.begin(team, &solver.particles, scene, gatherer);
        let mut solutions = 1;
        while met > 0 && solutions < most {
            let mut is_any_new = false;
            for meeting in guard.found(&solver.particles) {
                is_any_new |= gatherer.add_impact(solver, scene, &meeting);
            }
            if !is_any_new {
                break;
            }
            solutions += 1;
            solver.begin_again();
            solved = solver.advance(team, duration, settings, &mut |_, _| false);
            scene.motions.push(&solver.rigid_bodies);
            solver.follow_welds();
            met = guard.look_again(team, &solver.particles, scene, gatherer);
        }
        solver.react(duration / f64::from(settings.substeps), &mut gatherer.reactions);
        diagnostics.solved_again += solutions - 1;
        diagnostics.contact_solves += solved.contact_solves;
        diagnostics.pressing = solved.pressing;
        gatherer.end();
        let Solver { particles, rigid_bodies, .. } = &mut **solver;
        let guarded = guard.stop(team, (particles, rigid_bodies), scene, duration, gatherer);
        scene.motions.keep_pushed(rigid_bodies);
        diagnostics.impacts += guarded.impacts;
        diagnostics.vertices_stopped += guarded.stopped;
        diagnostics.impacts_remaining += guarded.remaining;
        diagnostics.jammed.extend(guarded.jammed);
        diagnostics.guarding += start.stop();
    }
}

/// Writes positions and velocities to the bodies. A body with a vertex out of the computable range is not written: it
/// keeps its positions, and its velocities are set to zero.
pub(super) fn write_back(
    active: Res<ActiveSurfaces>,
    motions: Res<Motions>,
    (time, mut sleep): (Option<Res<Time>>, ResMut<Sleep>),
    mut response: ResMut<Response>,
    mut diagnostics: ResMut<XpbdDiagnostics>,
    mut bodies: Query<(&mut SurfacePositions, &mut XpbdBody, Has<SweptCollision>, Option<&Name>)>,
) {
    let response = &mut *response;
    response.stopped_last.clear();
    std::mem::swap(&mut response.stopped, &mut response.stopped_last);
    let duration = time.map_or(0.0, |time| time.delta_secs_f64()) / f64::from(motions.parts());
    let mut surfaces = active.surfaces.iter();
    for (&entity, solved) in response.moved.iter().zip(&response.solver.bodies) {
        let Some(surface) = surfaces.find(|surface| surface.entity == entity) else { return };
        let Ok((mut positions, mut body, is_swept, name)) = bodies.get_mut(entity) else { continue };
        let own = surface.pose.inverse();
        let particles = &response.solver.particles;
        if let Some(vertex) = first_out_of_range(&surface.topology, solved.first, particles, &own) {
            body.velocities.fill(Vec3::ZERO);
            let error = XpbdBodyError::OutOfRange(vertex);
            if !response.stopped_last.contains(&entity) {
                log::warn!("body {} was stopped: {error}", Named(entity, name));
            }
            response.stopped.push(entity);
            diagnostics.refused.push((entity, error));
            continue;
        }
        let vertices = solved.first..solved.first + surface.topology.vertex_count();
        sleep.follow(entity, &particles.position[vertices], duration);
        if !is_swept && !response.has_warned_of_speed && is_fast(surface, solved.first, particles) {
            response.has_warned_of_speed = true;
            log::warn!(
                "body {} moved farther than its thickness, {}, between two detections: add SweptCollision, or it may pass \
                 through things. This warning appears once, for the first such body",
                Named(entity, name),
                surface.least_thickness()
            );
        }
        for (vertex, &weld) in surface.topology.weld().iter().enumerate() {
            let particle = solved.first + weld as usize;
            positions.0[vertex] = own.transform_point(particles.position[particle]).as_vec3();
            body.velocities[vertex] = particles.velocity[particle].as_vec3();
        }
        if motions.is_last_part()
            && let Some(pins) = motions.pins_of(entity)
        {
            for (vertex, &weld) in surface.topology.weld().iter().enumerate() {
                if weld as usize == vertex && body.inverse_masses[vertex] <= 0.0 {
                    positions.0[vertex] = pins[vertex];
                }
            }
        }
        body.written.clone_from(&positions.0);
        body.stood = Some(surface.pose);
    }
}

/// Whether a vertex of a body has moved farther than the body's thickness since contacts were detected.
fn is_fast(surface: &ActiveSurface, first: usize, particles: &Particles) -> bool {
    let most = f64::from(surface.least_thickness());
    let own = first..first + surface.topology.vertex_count();
    let mut ends = particles.start[own.clone()].iter().zip(&particles.position[own]);
    ends.any(|(start, end)| start.distance_squared(*end) > most * most)
}

/// The first vertex of a body that is out of range or NaN: its position in the world, its position in the surface's own
/// frame, or its velocity.
fn first_out_of_range(topology: &SurfaceTopology, first: usize, particles: &Particles, own: &Pose) -> Option<VertexId> {
    let is_in_range = |vector: DVec3| vector.abs().max_element() <= MOST_COORDINATE && !vector.is_nan();
    let is_lost = |&weld: &u32| {
        let particle = first + weld as usize;
        let position = particles.position[particle];
        let vectors = [position, own.transform_point(position), particles.velocity[particle]];
        !vectors.into_iter().all(is_in_range)
    };
    topology.weld().iter().position(is_lost).map(|vertex| VertexId(vertex as u32))
}
