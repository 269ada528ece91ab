//! Which contacts may act in a tick, by the relative speed of their sides.

use glam::DVec3;

use super::{Gatherer, Side};
use crate::{
    contacts::StoredPair,
    kernel::{contact::CompactContact, mesh::topology::SurfaceTopology, simd::parallel::Parallel},
    response::{particles::Particles, record::weights_of, scene::Scene, solver::Solver},
};

/// A contact is watched if its sides may come together at this multiple of their relative speed. They may move apart
/// now: what trembles comes back.
const HASTE: f64 = 1.25;

/// Separation, in contact distances, within which a contact is watched even if its sides do not move.
const NEAR: f64 = 0.02;

/// Depth, in contact distances, to which something at rest may fall in one tick before its contacts hold it.
const SHALLOW: f64 = 0.75;

/// Depth, in contact distances, at which a contact that was not watched has to be.
const MISSED: f64 = 0.25;

/// Contacts per task: another thread does not pay off for fewer.
const PART: usize = 2048;

/// The tick for which contacts are chosen.
#[derive(Clone, Copy, Debug)]
pub(in crate::response) struct Watch {
    /// Duration of the tick or part, in seconds.
    pub(in crate::response) duration: f64,
    /// How far something falls from rest in that time, in world units.
    pub(in crate::response) fall: f64,
}

impl Watch {
    /// How far, in world units, a contact at rest may be from acting and is still watched.
    pub(in crate::response) fn slack(fall: f64, contact_distance: f64) -> f64 {
        (NEAR * contact_distance).max(fall - SHALLOW * contact_distance)
    }
}

impl Gatherer {
    /// Whether each contact of a pair may act in the tick.
    pub(super) fn watch(
        &mut self,
        scene: &Scene<'_, '_>,
        pair: &StoredPair,
        sides: [Side<'_>; 2],
        watch: Watch,
    ) -> Vec<bool> {
        let mut may_act = std::mem::take(&mut self.may_act);
        may_act.clear();
        may_act.resize(pair.contacts.len(), false);
        let parts = pair.contacts.chunks(PART).zip(may_act.chunks_mut(PART));
        scene.threads().run_tasks(parts, pair.contacts.len().div_ceil(PART), |(records, may_act)| {
            for (record, may_act) in records.iter().zip(may_act) {
                *may_act = self.may_act(scene, pair, sides, record, watch);
            }
        });
        may_act
    }

    /// Whether a contact may act in the tick.
    fn may_act(
        &self,
        scene: &Scene<'_, '_>,
        pair: &StoredPair,
        sides: [Side<'_>; 2],
        record: &CompactContact,
        watch: Watch,
    ) -> bool {
        let contact_distance = f64::from(pair.contact_distance);
        let separation = f64::from(record.distance) - contact_distance;
        let left = separation - Watch::slack(watch.fall, contact_distance);
        if left <= 0.0 {
            return true;
        }
        let ahead = |particle: usize| self.ahead[particle].as_dvec3();
        left <= HASTE * relative_way(scene, pair, sides, record, ahead).length()
    }

    /// Notes how far every particle would move in the tick if nothing pushed it.
    pub(super) fn look_ahead(&mut self, particles: &Particles, watch: Watch) {
        self.ahead.clear();
        self.ahead.extend((0..particles.len()).map(|particle| {
            let way = if particles.inverse_mass[particle] > 0.0 {
                particles.velocity[particle] * watch.duration
            } else {
                particles.end[particle] - particles.start[particle]
            };
            way.as_vec3()
        }));
    }

    /// Makes constraints of contacts that were not watched, and whose sides have come together all the same, because
    /// something else has pushed them. Returns whether there are any.
    pub(in crate::response) fn add_missed(&mut self, solver: &mut Solver, scene: &Scene<'_, '_>) -> bool {
        let unwatched = std::mem::take(&mut self.unwatched);
        let before = solver.contacts.len();
        for of_pair in unwatched.chunk_by(|[one, _], [other, _]| one == other) {
            let pair = &scene.store.pairs[of_pair[0][0] as usize];
            let sides = self.sides(pair);
            let contact_distance = f64::from(pair.contact_distance);
            let farthest: f64 = sides.into_iter().map(|side| farthest(&solver.particles, scene, side)).sum();
            let friction = scene.friction(pair.a.entity(), pair.b.entity());
            self.find_tangled(&mut solver.particles, scene, pair);
            for &[_, place] in of_pair {
                let record = &pair.contacts[place as usize];
                let left = f64::from(record.distance) - (1.0 - MISSED) * contact_distance;
                if left >= farthest {
                    continue;
                }
                let particles = &solver.particles;
                let done = |particle: usize| particles.position[particle] - particles.start[particle];
                let way = relative_way(scene, pair, sides, record, done);
                let normal = pair.frame_pose.transform_direction(record.normal.as_dvec3());
                if left >= normal.dot(way) {
                    continue;
                }
                self.add_contact(solver, scene, pair, sides, record, friction);
            }
        }
        self.unwatched = unwatched;
        solver.contacts.len() > before
    }
}

/// How far the contact point of the first side moves relative to that of the second. `way` says it of a particle. What
/// the solver does not move is at the end of its own way.
fn relative_way(
    scene: &Scene<'_, '_>,
    pair: &StoredPair,
    [a, b]: [Side<'_>; 2],
    record: &CompactContact,
    way: impl Fn(usize) -> DVec3,
) -> DVec3 {
    let weights = weights_of(record);
    let way_of = |side: Side<'_>, triangle: u32, weights: [f64; 3]| {
        let corners =
            |topology: &SurfaceTopology| topology.welded_triangles()[triangle as usize].into_iter().zip(weights);
        match side {
            Side::Body { first, topology } => {
                corners(topology).fold(DVec3::ZERO, |sum, (corner, weight)| sum + way(first + corner as usize) * weight)
            }
            Side::Driven { entity, topology } => scene.motions.course(entity).map_or(DVec3::ZERO, |course| {
                let way = |corner: usize| course.ahead.point(corner) - course.now.point(corner);
                corners(topology).fold(DVec3::ZERO, |sum, (corner, weight)| sum + way(corner as usize) * weight)
            }),
            Side::Shape { entity } => scene.motions.course(entity).map_or(DVec3::ZERO, |course| {
                let point = pair.frame_pose.transform_point(record.point_b.as_dvec3());
                course.ahead.pose.transform_point(course.now.pose.inverse().transform_point(point)) - point
            }),
        }
    };
    way_of(a, record.triangle_a, weights[0]) - way_of(b, record.triangle_b, weights[1])
}

/// Upper bound of how far any point of a side has moved in the tick. Infinite for what the game moves.
fn farthest(particles: &Particles, scene: &Scene<'_, '_>, side: Side<'_>) -> f64 {
    match side {
        Side::Body { first, topology } => {
            let own = first..first + topology.vertex_count();
            let squares = own.map(|particle| particles.position[particle].distance_squared(particles.start[particle]));
            squares.fold(0.0, f64::max).sqrt()
        }
        Side::Driven { entity, .. } | Side::Shape { entity } => match scene.motions.course(entity) {
            Some(_) => f64::INFINITY,
            None => 0.0,
        },
    }
}
