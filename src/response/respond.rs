//! The stages of the response: a margin for detection, the solver, and what it found written back.

use std::time::{Duration, Instant};

use bevy_ecs::prelude::*;
use bevy_time::Time;

use super::{
    body::XpbdBody,
    gather::{Gatherer, Scene, Watch},
    guard::Guard,
    settings::XpbdSettings,
    solver::Solver,
};
use crate::{
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, DeformableSurface, SurfacePositions},
};

/// What the response did in the last tick.
#[derive(Resource, Clone, Debug, Default)]
pub struct XpbdDiagnostics {
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
    /// Impacts on the ways of bodies with [`SweptCollision`](crate::SweptCollision) that contacts had not prevented.
    pub impacts: usize,
    /// Vertices that were stopped short of them.
    pub vertices_stopped: usize,
    /// Impacts that could not be prevented: something that nothing moves has hit a body.
    pub impacts_remaining: usize,
    /// Looking for impacts.
    pub guarding: Duration,
    /// Bodies that could not be moved in this tick and why: they stand until that is mended.
    pub refused: Vec<(Entity, super::XpbdBodyError)>,
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
    /// The least margin of this tick, in world units.
    slack: f32,
    refused: Vec<Entity>,
}

/// Margins in mean edges of the finest body: at rest, and at most.
const LEAST_MARGIN: f32 = 0.125;
const MOST_MARGIN: f32 = 0.5;

/// Widens the margin to what bodies will move by in this tick, in powers of two: what may touch within the tick is
/// detected when it begins. A margin that the game has set stays.
pub(super) fn choose_margin(
    time: Option<Res<Time>>,
    settings: Res<XpbdSettings>,
    active: Res<ActiveSurfaces>,
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
    let way = (speed + settings.in_range().gravity.length() * time.delta_secs()) * time.delta_secs();
    let mut margin = LEAST_MARGIN * finest;
    while margin < (2.0 * way).min(MOST_MARGIN * finest) {
        margin *= 2.0;
    }
    // Not at every hesitation of the fastest vertex: lists of near triangles hold for one margin.
    if let Some(last) = response.margin
        && last <= 2.0 * margin
        && margin < last
    {
        margin = last;
    }
    response.margin = Some(margin);
    if detection.margin != margin {
        detection.margin = margin;
    }
}

/// Solves the tick.
pub(super) fn respond(
    time: Option<Res<Time>>,
    settings: Res<XpbdSettings>,
    scene: Scene,
    mut response: ResMut<Response>,
    mut diagnostics: ResMut<XpbdDiagnostics>,
) {
    let response = &mut *response;
    *diagnostics = XpbdDiagnostics::default();
    response.moved.clear();
    response.solver.clear();
    let duration = time.map_or(0.0, |time| time.delta_secs_f64());
    if duration <= 0.0 {
        return;
    }
    let settings = settings.in_range();
    let start = Instant::now();
    let Response { solver, gatherer, guard, moved, refused, slack, .. } = response;
    gatherer.begin();
    for surface in &scene.active.surfaces {
        let Ok((positions, Some(body))) = scene.positions.get(surface.entity) else { continue };
        match body.check(positions.0.len()) {
            Ok(()) => {
                gatherer.add_body(solver, surface, &positions.0, body);
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
    gatherer.add_contacts(solver, &scene, Watch { duration, slack: f64::from(*slack) });
    gatherer.end(&scene);
    diagnostics.bodies = moved.len();
    diagnostics.contacts = solver.contacts.len();
    diagnostics.gathering = start.elapsed();
    let start = Instant::now();
    let solved = solver.advance(duration, &settings);
    diagnostics.contact_solves = solved.contact_solves;
    diagnostics.pressing = solved.pressing;
    diagnostics.solving = start.elapsed();
    let start = Instant::now();
    solver.follow_welds();
    let guarded = guard.stop(&mut solver.particles, &scene, |entity| gatherer.first_particle(entity));
    diagnostics.impacts = guarded.impacts;
    diagnostics.vertices_stopped = guarded.stopped;
    diagnostics.impacts_remaining = guarded.remaining;
    diagnostics.guarding = start.elapsed();
}

/// Writes positions and velocities to the bodies.
pub(super) fn write_back(
    active: Res<ActiveSurfaces>,
    response: Res<Response>,
    mut bodies: Query<(&mut SurfacePositions, &mut XpbdBody)>,
) {
    let mut surfaces = active.surfaces.iter();
    for (&entity, solved) in response.moved.iter().zip(&response.solver.bodies) {
        let Some(surface) = surfaces.find(|surface| surface.entity == entity) else { return };
        let Ok((mut positions, mut body)) = bodies.get_mut(entity) else { continue };
        let own = surface.pose.inverse();
        let particles = &response.solver.particles;
        for (vertex, &weld) in surface.topology.weld().iter().enumerate() {
            let particle = solved.first + weld as usize;
            positions.0[vertex] = own.transform_point(particles.position[particle]).as_vec3();
            body.velocities[vertex] = particles.velocity[particle].as_vec3();
        }
        body.written.clone_from(&positions.0);
    }
}
