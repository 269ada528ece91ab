//! What is wrong in a scene, judged in f64 without the detection that played it: triangles that cross, vertices inside.

use std::f64::consts::TAU;

use bevy_circumsphere::{
    kernel::reference::{exact_weld, touching_pairs_tree},
    prelude::*,
};
use bevy_ecs::prelude::*;
use glam::DVec3;

use super::Stage;

/// How many pairs of triangles cross, of those that may meet: of bodies with each other, with obstacles, and with
/// themselves where they are self-colliding. Takes a second for 20,000 triangles.
pub fn crossing_pairs(stage: &Stage) -> usize {
    let (mut positions, mut triangles, mut weld, mut owners) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (owner, entity) in stage.surfaces().enumerate() {
        let own = stage.world_positions(entity);
        let first = positions.len() as u32;
        // Neighbors are told by the mesh at rest: vertices that come to coincide later are none.
        let rest = if owner < stage.bodies.len() { exact_weld(stage.rest(entity)) } else { exact_weld(&own) };
        weld.extend(rest.iter().map(|vertex| first + vertex));
        let own_triangles = stage.surface(entity).topology().triangles();
        triangles.extend(own_triangles.iter().map(|corners| corners.map(|corner| first + corner)));
        owners.extend(own_triangles.iter().map(|_| owner));
        positions.extend(own);
    }
    let is_body = |owner: usize| owner < stage.bodies.len();
    let meets_itself: Vec<bool> =
        stage.surfaces().map(|entity| stage.app.world().get::<SelfCollision>(entity).is_some()).collect();
    let counts = |a: usize, b: usize| if a == b { meets_itself[a] } else { is_body(a) || is_body(b) };
    touching_pairs_tree(&positions, &triangles, &weld, 0.0)
        .iter()
        .filter(|pair| counts(owners[pair.triangle_a as usize], owners[pair.triangle_b as usize]))
        .count()
}

/// How many vertices of bodies have a coordinate that is not finite.
pub fn vertices_nowhere(stage: &Stage) -> usize {
    let nowhere = |&entity: &Entity| stage.positions(entity).iter().filter(|position| !position.is_finite()).count();
    stage.bodies.iter().map(nowhere).sum()
}

/// How many vertices of bodies are inside another surface that is closed.
pub fn vertices_inside(stage: &Stage) -> usize {
    let world: Vec<(Entity, Vec<DVec3>)> =
        stage.surfaces().map(|entity| (entity, stage.world_positions(entity))).collect();
    let mut count = 0;
    for (entity, positions) in &world {
        let topology = stage.surface(*entity).topology();
        if !topology.is_closed() {
            continue;
        }
        let closed = Closed::new(positions, topology.triangles());
        for (_, points) in world.iter().take(stage.bodies.len()).filter(|(other, _)| other != entity) {
            count += points.iter().filter(|&&point| closed.contains(point)).count();
        }
    }
    count
}

/// A closed surface, whichever way it is wound.
pub struct Closed<'a> {
    positions: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    low: DVec3,
    high: DVec3,
}

impl<'a> Closed<'a> {
    pub fn new(positions: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        Self { positions, triangles, low, high }
    }

    /// Whether the surface winds around the point.
    pub fn contains(&self, point: DVec3) -> bool {
        if point.cmplt(self.low).any() || point.cmpgt(self.high).any() {
            return false;
        }
        let angle = |corners: &[u32; 3]| solid_angle(corners.map(|corner| self.positions[corner as usize] - point));
        // All of the sphere of directions, 4 π, or none of it.
        self.triangles.iter().map(angle).sum::<f64>().abs() > TAU
    }
}

/// The signed solid angle of a triangle as seen from the origin (van Oosterom and Strackee 1983).
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let [length_a, length_b, length_c] = [a.length(), b.length(), c.length()];
    let volume = a.dot(b.cross(c));
    let rest = length_a * length_b * length_c + a.dot(b) * length_c + b.dot(c) * length_a + c.dot(a) * length_b;
    2.0 * volume.atan2(rest)
}
