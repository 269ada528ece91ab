//! Which contacts may act in a tick, by the relative speed of their sides.

use glam::DVec3;

use super::{Gatherer, Side};
use crate::{
    contacts::StoredPair,
    kernel::{contact::CompactContact, mesh::topology::SurfaceTopology, simd::parallel::Parallel},
    response::{particles::Particles, record::weights_of, scene::Scene, solver::Solver},
};

/// A contact is watched once its sides may come together within this many substeps at their relative speed. They may
/// move apart now: what trembles comes back.
const SOON: f64 = 4.0;

/// Otherwise it is looked at again before they come together at this multiple of their relative speed, if that is in
/// this tick: something else may push them.
const HASTE: f64 = 4.0;

/// A particle is pushed if it becomes twice as fast, and would move this much farther in a tick than it would have, in
/// contact distances.
const PUSHED: f64 = 0.1;

/// The least number of substeps between two looks at contacts.
const PAUSE: u32 = 2;

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
    /// Number of substeps.
    pub(in crate::response) substeps: u32,
    /// How far something falls from rest in that time, in world units.
    pub(in crate::response) fall: f64,
}

impl Watch {
    /// How far, in world units, a contact at rest may be from acting and is still watched.
    pub(in crate::response) fn slack(fall: f64, contact_distance: f64) -> f64 {
        (NEAR * contact_distance).max(fall - SHALLOW * contact_distance)
    }

    /// The substep before which a contact has to be looked at again, counted from 1; 0 if it has to be watched now,
    /// before the given substep.
    fn due(self, pair: &StoredPair, record: &CompactContact, ways: Ways, substep: u32) -> u32 {
        let contact_distance = f64::from(pair.contact_distance);
        let separation = f64::from(record.distance) - contact_distance - ways.closed(pair, record);
        let left = separation - Self::slack(self.fall, contact_distance);
        let way = ways.ahead.length() / f64::from(self.substeps);
        if left <= SOON * way {
            return 0;
        }
        #[expect(clippy::cast_sign_loss, reason = "no contact that is due has passed")]
        let later = (left / (HASTE * way)) as u32;
        substep.saturating_add(later.max(PAUSE))
    }
}

/// A contact that is not watched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unwatched {
    /// Its pair, by place in the store.
    pub(super) pair: u32,
    /// Its place in the pair.
    pub(super) place: u32,
    /// The substep before which it is looked at again.
    pub(super) due: u32,
}

/// How the contact point of the first side moves relative to that of the second.
#[derive(Clone, Copy, Debug)]
struct Ways {
    /// Since the beginning of the tick.
    done: DVec3,
    /// In the duration of the tick, at the speed that it has now.
    ahead: DVec3,
}

impl Ways {
    /// How far the sides have come together.
    fn closed(self, pair: &StoredPair, record: &CompactContact) -> f64 {
        pair.frame_pose.transform_direction(record.normal.as_dvec3()).dot(self.done)
    }
}

impl Gatherer {
    /// When each contact of a pair has to be looked at again; 0 for those that have to be watched from the beginning.
    pub(super) fn watch(
        &mut self,
        scene: &Scene<'_, '_>,
        pair: &StoredPair,
        sides: [Side<'_>; 2],
        watch: Watch,
    ) -> Vec<u32> {
        let mut due = std::mem::take(&mut self.due);
        due.clear();
        due.resize(pair.contacts.len(), 0);
        let parts = pair.contacts.chunks(PART).zip(due.chunks_mut(PART));
        let of = |particle: usize| [DVec3::ZERO, self.ahead[particle].as_dvec3()];
        scene.threads().run_tasks(parts, pair.contacts.len().div_ceil(PART), |(records, due)| {
            for (record, due) in records.iter().zip(due) {
                *due = watch.due(pair, record, ways(scene, pair, sides, record, 0.0, of), 1);
            }
        });
        due
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

    /// Makes constraints of contacts that have not been watched, and that may act in the next substeps. Returns whether
    /// there are any.
    pub(in crate::response) fn add_due(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        watch: Watch,
        substep: u32,
    ) -> bool {
        if substep % PAUSE != 1 {
            return false;
        }
        let share = f64::from(substep - 1) / f64::from(watch.substeps);
        let is_any_pushed = self.note_pushed(solver, watch);
        let pushed = std::mem::take(&mut self.pushed);
        let is_pushed = |side: Side<'_>, triangle: u32| match side {
            Side::Body { first, topology } => {
                let corners = topology.welded_triangles()[triangle as usize];
                corners.into_iter().any(|corner| pushed[first + corner as usize])
            }
            Side::Driven { .. } | Side::Shape { .. } => false,
        };
        let is_any_new = self.add_unwatched(solver, scene, |solver, pair, [a, b], unwatched| {
            let record = &pair.contacts[unwatched.place as usize];
            let is_pushed = || is_pushed(a, record.triangle_a) || is_pushed(b, record.triangle_b);
            if unwatched.due <= substep || is_any_pushed && is_pushed() {
                let of = |particle: usize| {
                    let [done, velocity] = solver.rows.state(particle);
                    [done, velocity * watch.duration]
                };
                unwatched.due = watch.due(pair, record, ways(scene, pair, [a, b], record, share, of), substep);
            }
        });
        self.pushed = pushed;
        is_any_new
    }

    /// Notes which particles have become much faster since contacts with them were looked at. Returns whether there are
    /// any.
    fn note_pushed(&mut self, solver: &Solver, watch: Watch) -> bool {
        let Self { ahead, pushed, least_distance, .. } = self;
        let least = (PUSHED * *least_distance) as f32;
        pushed.clear();
        pushed.extend(ahead.iter_mut().enumerate().map(|(particle, ahead)| {
            let [_, velocity] = solver.rows.state(particle);
            let now = (velocity * watch.duration).as_vec3();
            let is_pushed = now.length() > 2.0 * ahead.length() + least;
            if is_pushed {
                *ahead = now;
            }
            is_pushed
        }));
        pushed.contains(&true)
    }

    /// Makes constraints of contacts that were not watched, and whose sides have come together all the same, because
    /// something else has pushed them. Returns whether there are any.
    pub(in crate::response) fn add_missed(&mut self, solver: &mut Solver, scene: &Scene<'_, '_>) -> bool {
        let moved = |particle: usize| solver.particles.position[particle] - solver.particles.start[particle];
        let squares = (0..solver.particles.len()).map(|particle| moved(particle).length_squared());
        let farthest = squares.fold(0.0, f64::max).sqrt();
        self.add_unwatched(solver, scene, |solver, pair, sides, unwatched| {
            let record = &pair.contacts[unwatched.place as usize];
            let left = f64::from(record.distance) - (1.0 - MISSED) * f64::from(pair.contact_distance);
            let is_driven = |side: &Side<'_>| match side {
                Side::Body { .. } => false,
                Side::Driven { entity, .. } | Side::Shape { entity } => scene.motions.course(*entity).is_some(),
            };
            if left >= 2.0 * farthest && !sides.iter().any(is_driven) {
                return;
            }
            let particles = &solver.particles;
            let of = |particle: usize| [particles.position[particle] - particles.start[particle], DVec3::ZERO];
            if left < ways(scene, pair, sides, record, 1.0, of).closed(pair, record) {
                unwatched.due = 0;
            }
        })
    }

    /// Makes constraints of contacts that have not been watched. `look` sets when they are due, to 0 for those that are to
    /// be watched now. Returns whether there are any.
    fn add_unwatched(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        look: impl Fn(&Solver, &StoredPair, [Side<'_>; 2], &mut Unwatched),
    ) -> bool {
        let mut unwatched = std::mem::take(&mut self.unwatched);
        let before = solver.contacts.len();
        for of_pair in unwatched.chunk_by_mut(|one, other| one.pair == other.pair) {
            let pair = &scene.store.pairs[of_pair[0].pair as usize];
            let sides = self.sides(pair);
            for contact in &mut *of_pair {
                look(solver, pair, sides, contact);
            }
            if of_pair.iter().all(|contact| contact.due > 0) {
                continue;
            }
            let friction = scene.friction(pair.a.entity(), pair.b.entity());
            self.find_tangled(&mut solver.particles, scene, pair);
            for contact in of_pair.iter().filter(|contact| contact.due == 0) {
                let record = &pair.contacts[contact.place as usize];
                self.add_contact(solver, scene, pair, sides, record, friction);
            }
        }
        unwatched.retain(|contact| contact.due > 0);
        self.unwatched = unwatched;
        solver.contacts.len() > before
    }
}

/// How the contact point of the first side moves relative to that of the second, when `share` of the tick has passed.
/// `of` says of a particle how far it has moved, and how far it would move in the duration of the tick.
fn ways(
    scene: &Scene<'_, '_>,
    pair: &StoredPair,
    [a, b]: [Side<'_>; 2],
    record: &CompactContact,
    share: f64,
    of: impl Fn(usize) -> [DVec3; 2],
) -> Ways {
    let weights = weights_of(record);
    let ways_of = |side: Side<'_>, triangle: u32, weights: [f64; 3]| {
        let corners =
            |topology: &SurfaceTopology| topology.welded_triangles()[triangle as usize].into_iter().zip(weights);
        let driven = |way: DVec3| [way * share, way];
        match side {
            Side::Body { first, topology } => corners(topology).fold([DVec3::ZERO; 2], |[done, ahead], (corner, weight)| {
                let [own, own_ahead] = of(first + corner as usize);
                [done + own * weight, ahead + own_ahead * weight]
            }),
            Side::Driven { entity, topology } => driven(scene.motions.course(entity).map_or(DVec3::ZERO, |course| {
                let way = |corner: usize| course.ahead.point(corner) - course.now.point(corner);
                corners(topology).fold(DVec3::ZERO, |sum, (corner, weight)| sum + way(corner as usize) * weight)
            })),
            Side::Shape { entity } => driven(scene.motions.course(entity).map_or(DVec3::ZERO, |course| {
                let point = pair.frame_pose.transform_point(record.point_b.as_dvec3());
                course.ahead.pose.transform_point(course.now.pose.inverse().transform_point(point)) - point
            })),
        }
    };
    let (a, b) = (ways_of(a, record.triangle_a, weights[0]), ways_of(b, record.triangle_b, weights[1]));
    Ways { done: a[0] - b[0], ahead: a[1] - b[1] }
}
