//! The stages of the response: a margin for detection, the solver, and what it found written back.

use std::time::{Duration, Instant};

use bevy_ecs::prelude::*;
use bevy_time::Time;
use glam::{DVec3, Vec3};

use super::{
    body::{MOST_COORDINATE, XpbdBody, XpbdBodyError},
    gather::{Gatherer, Scene, Watch},
    guard::Guard,
    motion::{self, Motions},
    particles::Particles,
    settings::XpbdSettings,
    solver::{Solved, Solver},
};
use crate::{
    kernel::{
        mesh::{ids::VertexId, topology::SurfaceTopology},
        pose::Pose,
    },
    schedule::run_detection,
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, DeformableSurface, SurfacePositions, SweptCollision, SweptTarget},
};

/// What the response did in the last tick.
#[derive(Resource, Clone, Debug, Default)]
pub struct XpbdDiagnostics {
    /// Into how many parts the tick was cut, each with a detection of its own, 16 at most: more than one where the game moves
    /// something near a body farther than half of the body's mean edge, as seen from the body.
    pub parts: u32,
    /// How many bodies were moved.
    pub bodies: usize,
    /// Contacts that the solver watched: those with a body on one side, within the margin.
    pub contacts: usize,
    /// How often one of them was solved for, over all substeps and iterations.
    pub contact_solves: usize,
    /// Contacts that pushed in the last substep.
    pub pressing: usize,
    /// Making constraints of contacts.
    pub gathering: Duration,
    /// Solving.
    pub solving: Duration,
    /// How often the tick was solved again, with what bodies would have met on their ways.
    pub solved_again: usize,
    /// Impacts on the ways of bodies with [`SweptCollision`](crate::SweptCollision) that contacts had not prevented.
    pub impacts: usize,
    /// Vertices that were stopped short of them.
    pub vertices_stopped: usize,
    /// Impacts that could not be prevented, because two driven things squeeze a body so that no way is left: it may be inside
    /// of one of them. Where it is not 0, or `jammed` not empty, the log has it, once an episode.
    pub impacts_remaining: usize,
    /// Bodies that were squeezed so that they met themselves nearly everywhere: they were not kept from crossing themselves.
    /// Once for each part of the tick.
    pub jammed: Vec<Entity>,
    /// Vertices, and points between vertices, that were inside of a solid when the last part of the tick began: they are led out.
    pub inside: usize,
    /// Looking for impacts, and solving again.
    pub guarding: Duration,
    /// Bodies that could not be moved in this tick and why: they stand until that is mended.
    pub refused: Vec<(Entity, XpbdBodyError)>,
}

/// What the response keeps from stage to stage and from tick to tick.
#[derive(Resource, Default)]
pub(super) struct Response {
    solver: Solver,
    gatherer: Gatherer,
    guard: Guard,
    /// The bodies of this tick, in the order of the solver's.
    moved: Vec<Entity>,
    /// The margin that was chosen last: another one is the game's.
    margin: Option<f32>,
    /// For how many ticks in a row it has been wider than needed.
    too_wide: u32,
    /// The least margin of this tick, in world units.
    slack: f32,
    refused: Vec<Entity>,
    /// Bodies that left the range of what can be computed, in this tick and in the last one.
    stopped: Vec<Entity>,
    stopped_last: Vec<Entity>,
    /// Whether a fast body without [`SweptCollision`] has been warned of.
    has_warned_of_speed: bool,
    /// For how many more ticks squeezed bodies are not warned of again.
    squeezed_for: u32,
}

/// Bodies that have not been squeezed for so many ticks are warned of again.
const CALM_TICKS: u32 = 60;

/// Margins in mean edges of the finest body: at rest, and at most.
const LEAST_MARGIN: f32 = 0.125;
const MOST_MARGIN: f32 = 0.5;

/// For how many ticks a margin may be wider than needed: lists of near triangles hold for one margin, and are lost with it.
const WIDE_TICKS: u32 = 8;

/// Steps of a part of a tick, at least: fewer leave what a driven side pushes behind.
const LEAST_SUBSTEPS: u32 = 4;

/// How often a tick is solved at most.
const MOST_SOLUTIONS: usize = 4;
const MOST_SOLUTIONS_OF_PART: usize = 3;

/// Widens the margin to what bodies will move by in this tick, in powers of two: what may touch within the tick is
/// detected when it begins. A margin that the game has set stays.
pub(super) fn choose_margin(
    time: Option<Res<Time>>,
    settings: Res<XpbdSettings>,
    active: Res<ActiveSurfaces>,
    motions: Res<Motions>,
    bodies: Query<(&DeformableSurface, &XpbdBody)>,
    mut detection: ResMut<CircumsphereSettings>,
    mut response: ResMut<Response>,
) {
    let Some(time) = time else { return };
    let (mut finest, mut squared_speeds, mut vertices) = (f32::INFINITY, 0.0, 0usize);
    for surface in &active.surfaces {
        if let Ok((mesh, body)) = bodies.get(surface.entity) {
            finest = finest.min(mesh.mean_edge() * surface.pose.scale() as f32);
            squared_speeds += body.velocities.iter().map(|velocity| velocity.length_squared()).sum::<f32>();
            vertices += body.velocities.len();
        }
    }
    if !finest.is_finite() || finest <= 0.0 {
        return;
    }
    response.slack = LEAST_MARGIN * finest;
    if detection.margin != 0.0 && response.margin != Some(detection.margin) {
        return;
    }
    let speed = (squared_speeds / vertices.max(1) as f32).sqrt();
    let duration = time.delta_secs() / motions.parts() as f32;
    // Both sides of a contact may be as fast. Only what falls onto something that is held comes nearer by falling.
    let way = (2.0 * speed + settings.in_range().gravity.length() * duration) * duration + motions.longest() as f32;
    let mut margin = LEAST_MARGIN * finest;
    while margin < way.min(MOST_MARGIN * finest) {
        margin *= 2.0;
    }
    let last = response.margin.unwrap_or(margin);
    response.too_wide = if margin < last { response.too_wide + 1 } else { 0 };
    if (1..=WIDE_TICKS).contains(&response.too_wide) {
        margin = last;
    }
    response.margin = Some(margin);
    if detection.margin != margin {
        detection.margin = margin;
    }
}

/// Tells the swept stage where bodies with [`SweptCollision`] would go if nothing pushed them.
pub(super) fn aim(
    time: Option<Res<Time>>,
    settings: Res<XpbdSettings>,
    active: Res<ActiveSurfaces>,
    motions: Res<Motions>,
    mut bodies: Query<(&SurfacePositions, &XpbdBody, &mut SweptTarget), With<SweptCollision>>,
) {
    let duration = time.map_or(0.0, |time| time.delta_secs_f64()) / f64::from(motions.parts());
    let fall = settings.in_range().gravity.as_dvec3() * duration;
    for surface in &active.surfaces {
        let Ok((positions, body, mut target)) = bodies.get_mut(surface.entity) else { continue };
        target.0.clear();
        if body.check(&surface.topology, positions.0.len()).is_err() {
            continue;
        }
        let own = surface.pose.inverse();
        let motions = body.velocities.iter().zip(&body.inverse_masses);
        target.0.extend(positions.0.iter().zip(motions).map(|(&position, (velocity, &inverse_mass))| {
            if inverse_mass <= 0.0 {
                return position;
            }
            let world = surface.pose.transform_point(position.as_dvec3());
            own.transform_point(world + (velocity.as_dvec3() + fall) * duration).as_vec3()
        }));
    }
}

/// Solves the tick, in as many parts as it is cut into. Each begins with a detection; that of the first has run.
pub(super) fn respond_in_parts(world: &mut World) {
    *world.resource_mut::<XpbdDiagnostics>() = XpbdDiagnostics::default();
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
    world.resource_mut::<XpbdDiagnostics>().parts = parts;
    run(world, warn_of_squeezed);
}

/// Says once an episode that bodies are squeezed so that no way is left for them.
fn warn_of_squeezed(diagnostics: Res<XpbdDiagnostics>, mut response: ResMut<Response>) {
    let XpbdDiagnostics { impacts_remaining, jammed, .. } = &*diagnostics;
    if *impacts_remaining == 0 && jammed.is_empty() {
        response.squeezed_for = response.squeezed_for.saturating_sub(1);
        return;
    }
    if response.squeezed_for == 0 {
        let by_themselves =
            if jammed.is_empty() { String::new() } else { format!("; they may cross themselves: {jammed:?}") };
        log::warn!(
            "bodies are squeezed so that no way is left, and may be inside of what squeezes them ({impacts_remaining} impacts \
             remain{by_themselves}): leave more room between what the game moves. This is said again after {CALM_TICKS} ticks \
             without"
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
    scene: Scene,
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
    let start = Instant::now();
    let Response { solver, gatherer, guard, moved, refused, slack, .. } = response;
    gatherer.begin();
    for surface in &scene.active.surfaces {
        let Ok((positions, Some(body))) = scene.positions.get(surface.entity) else { continue };
        match body.check(&surface.topology, positions.0.len()) {
            Ok(()) => {
                gatherer.add_body(solver, &scene, surface, &positions.0, body);
                moved.push(surface.entity);
            }
            Err(error) => {
                if !refused.contains(&surface.entity) {
                    log::warn!("body {} stands still: {error}", surface.entity);
                }
                diagnostics.refused.push((surface.entity, error));
            }
        }
    }
    refused.clear();
    refused.extend(diagnostics.refused.iter().map(|&(entity, _)| entity));
    diagnostics.inside = gatherer.lead_out(solver, &scene);
    gatherer.add_contacts(solver, &scene, Watch { duration, slack: f64::from(*slack) });
    diagnostics.bodies = moved.len();
    diagnostics.contacts = solver.contacts.len();
    diagnostics.gathering += start.elapsed();
    let start = Instant::now();
    solver.remember();
    let solved = solver.advance(duration, &settings);
    diagnostics.solving += start.elapsed();
    let start = Instant::now();
    solver.follow_welds();
    let mut met = guard.begin(&solver.particles, &scene, gatherer);
    let mut solved_again = Solved::default();
    let mut solutions = 1;
    let most = if parts > 1 { MOST_SOLUTIONS_OF_PART } else { MOST_SOLUTIONS };
    while met > 0 && solutions < most {
        let mut is_any_new = false;
        for meeting in guard.found(&solver.particles) {
            is_any_new |= gatherer.add_impact(solver, &scene, &meeting);
        }
        if !is_any_new {
            break;
        }
        solutions += 1;
        solver.begin_again();
        solved_again = solver.advance(duration, &settings);
        solver.follow_welds();
        met = guard.look_again(&solver.particles, &scene, gatherer);
    }
    let solved = if solutions > 1 { solved_again } else { solved };
    diagnostics.solved_again += solutions - 1;
    diagnostics.contact_solves += solved.contact_solves;
    diagnostics.pressing = solved.pressing;
    gatherer.end();
    let guarded = guard.stop(&mut solver.particles, &scene, duration, gatherer);
    diagnostics.impacts += guarded.impacts;
    diagnostics.vertices_stopped += guarded.stopped;
    diagnostics.impacts_remaining += guarded.remaining;
    diagnostics.jammed.extend(guarded.jammed);
    diagnostics.guarding += start.elapsed();
}

/// Writes positions and velocities to the bodies. A body with a vertex out of the computable range is not written: it keeps its
/// positions and loses its velocity.
pub(super) fn write_back(
    active: Res<ActiveSurfaces>,
    motions: Res<Motions>,
    mut response: ResMut<Response>,
    mut diagnostics: ResMut<XpbdDiagnostics>,
    mut bodies: Query<(&mut SurfacePositions, &mut XpbdBody, Has<SweptCollision>)>,
) {
    let response = &mut *response;
    response.stopped_last.clear();
    std::mem::swap(&mut response.stopped, &mut response.stopped_last);
    let mut surfaces = active.surfaces.iter();
    for (&entity, solved) in response.moved.iter().zip(&response.solver.bodies) {
        let Some(surface) = surfaces.find(|surface| surface.entity == entity) else { return };
        let Ok((mut positions, mut body, is_swept)) = bodies.get_mut(entity) else { continue };
        let own = surface.pose.inverse();
        let particles = &response.solver.particles;
        if let Some(vertex) = first_out_of_range(&surface.topology, solved.first, particles, &own) {
            body.velocities.fill(Vec3::ZERO);
            let error = XpbdBodyError::OutOfRange(vertex);
            if !response.stopped_last.contains(&entity) {
                log::warn!("body {entity} is stopped: {error}");
            }
            response.stopped.push(entity);
            diagnostics.refused.push((entity, error));
            continue;
        }
        if !is_swept && !response.has_warned_of_speed && is_fast(surface, solved.first, particles) {
            response.has_warned_of_speed = true;
            log::warn!(
                "body {entity} has moved farther than its thickness, {}, between two detections: give it SweptCollision, or it \
                 may pass through things. This is said once, of the first such body",
                surface.thickness
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

/// Whether a vertex of a body has moved farther than its thickness since contacts were detected.
fn is_fast(surface: &ActiveSurface, first: usize, particles: &Particles) -> bool {
    let most = f64::from(surface.thickness);
    let own = first..first + surface.topology.vertex_count();
    let mut ends = particles.start[own.clone()].iter().zip(&particles.position[own]);
    ends.any(|(start, end)| start.distance_squared(*end) > most * most)
}

/// The first vertex of a body whose solved position, in the world or in the surface's own frame, or whose velocity is too
/// large or no number.
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
