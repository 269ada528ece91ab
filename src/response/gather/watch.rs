//! Which contacts may act in a tick, by the relative speed of their sides.

use glam::DVec3;

use super::{Between, Gatherer, Side};
use crate::{
    contacts::StoredPair,
    kernel::{contact::CompactContact, mesh::topology::SurfaceTopology},
    response::{particles::Particles, record::weights_of, scene::Scene, solver::Solver},
};

/// A contact is watched if its sides may come together in the rest of the tick at this multiple of their relative speed.
/// They may move apart now: what trembles comes back.
const HASTE: f64 = 1.25;

/// A particle is pushed if it becomes twice as fast, and would move this much farther in a tick than it would have, in
/// contact distances.
const PUSHED: f64 = 0.1;

/// Number of substeps between two looks at what has been pushed.
const PAUSE: u32 = 2;

/// Separation, in contact distances, within which a contact is watched even if its sides do not move. Between patches,
/// several push the same vertices.
const NEAR: f64 = 0.005;
const NEAR_OF_PATCHES: f64 = 0.02;

/// Depth, in contact distances, to which something at rest may fall in one tick before its contacts hold it.
const SHALLOW: f64 = 0.75;

/// Depth, in contact distances, at which a contact that was not watched has to be.
const MISSED: f64 = 0.25;

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
    pub(in crate::response) fn slack(fall: f64, contact_distance: f64, is_smooth: bool) -> f64 {
        let near = if is_smooth { NEAR_OF_PATCHES } else { NEAR };
        (near * contact_distance).max(fall - SHALLOW * contact_distance)
    }

    /// How far a contact is from being watched whatever its way, after its sides have come together by `closed`.
    fn left(self, pair: &StoredPair, record: &CompactContact, closed: f64) -> f64 {
        let contact_distance = f64::from(pair.contact_distance_at(record));
        let separation = f64::from(record.distance) - contact_distance - closed;
        separation - Self::slack(self.fall, contact_distance, pair.is_smooth)
    }

    /// Whether a contact may act in the rest of the tick, when `share` of it has passed.
    fn may_act(self, pair: &StoredPair, record: &CompactContact, ways: Ways, share: f64) -> bool {
        self.left(pair, record, ways.closed(pair, record)) <= HASTE * (1.0 - share) * ways.ahead.length()
    }
}

/// A contact that is not watched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unwatched {
    /// Its pair, by place in the store.
    pub(super) pair: u32,
    /// Its place in the pair.
    pub(super) place: u32,
    /// The particles of both triangles; [`NONE`] of one that belongs to no body.
    pub(super) particles: [[u32; 3]; 2],
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
    /// Whether a contact may act in the tick.
    pub(super) fn may_act(
        &self,
        scene: &Scene<'_, '_>,
        &Between { pair, sides, .. }: &Between<'_>,
        record: &CompactContact,
        watch: Watch,
    ) -> bool {
        let of = |particle: usize| [DVec3::ZERO, self.ahead[particle].as_dvec3()];
        // What is this near is watched, however it moves.
        watch.left(pair, record, 0.0) <= 0.0
            || watch.may_act(pair, record, ways(scene, pair, sides, record, 0.0, of), 0.0)
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

    /// Makes constraints of contacts that have not been watched, and that may act now that something has pushed them, in
    /// the rest of the tick from a substep on. Returns whether there are any. Not those of patches: their planes are of the
    /// beginning of the tick, and a ball in a valley that met them later would tremble.
    pub(in crate::response) fn add_pushed(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        watch: Watch,
        substep: u32,
    ) -> bool {
        if substep % PAUSE != 1 || self.unwatched.is_empty() || !self.note_pushed(solver, scene, watch) {
            return false;
        }
        let share = f64::from(substep - 1) / f64::from(watch.substeps);
        let pushed = std::mem::take(&mut self.pushed);
        let is_pushed = |contact: &Unwatched| {
            let particles = contact.particles.as_flattened().iter();
            particles.fold(false, |is_any, &particle| is_any | pushed.get(particle as usize).is_some_and(|&own| own))
        };
        let is_any_new = self.add_unwatched(solver, scene, is_pushed, |solver, pair, [a, b], record| {
            let of = |particle: usize| {
                let [done, velocity] = solver.rows.state(particle);
                [done, velocity * watch.duration]
            };
            !pair.is_smooth && watch.may_act(pair, record, ways(scene, pair, [a, b], record, share, of), share)
        });
        self.pushed = pushed;
        is_any_new
    }

    /// Notes which particles have become much faster since contacts with them were looked at. Returns whether there are
    /// any.
    fn note_pushed(&mut self, solver: &Solver, scene: &Scene<'_, '_>, watch: Watch) -> bool {
        let Self { ahead, pushed, .. } = self;
        let distances = scene.store.pairs.iter().map(|pair| f64::from(pair.contact_distance));
        let least = (PUSHED * distances.fold(f64::INFINITY, f64::min)) as f32;
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
        self.add_unwatched(
            solver,
            scene,
            |_| true,
            |solver, pair, sides, record| {
                let left = f64::from(record.distance) - (1.0 - MISSED) * f64::from(pair.contact_distance_at(record));
                let is_driven = |side: &Side<'_>| match side {
                    Side::Body { .. } => false,
                    Side::Driven { entity, .. } | Side::Shape { entity } => scene.motions.course(*entity).is_some(),
                };
                if left >= 2.0 * farthest && !sides.iter().any(is_driven) {
                    return false;
                }
                let particles = &solver.particles;
                let of = |particle: usize| [particles.position[particle] - particles.start[particle], DVec3::ZERO];
                left < ways(scene, pair, sides, record, 1.0, of).closed(pair, record)
            },
        )
    }

    /// Makes constraints of those contacts that have not been watched for which `may_be`, which is quick, and `must_be` say
    /// so. Returns whether there are any.
    fn add_unwatched(
        &mut self,
        solver: &mut Solver,
        scene: &Scene<'_, '_>,
        may_be: impl Fn(&Unwatched) -> bool,
        must_be: impl Fn(&Solver, &StoredPair, [Side<'_>; 2], &CompactContact) -> bool,
    ) -> bool {
        let mut unwatched = std::mem::take(&mut self.unwatched);
        let before = solver.contacts.len();
        // The contacts of a pair follow one another.
        let (mut last_pair, mut last_tangled) = (None, None);
        unwatched.retain(|contact| {
            if !may_be(contact) {
                return true;
            }
            let pair = &scene.store.pairs[contact.pair as usize];
            let sides = match last_pair {
                Some((place, sides)) if place == contact.pair => sides,
                _ => self.sides(pair),
            };
            last_pair = Some((contact.pair, sides));
            let record = &pair.contacts[contact.place as usize];
            if !must_be(solver, pair, sides, record) {
                return true;
            }
            if last_tangled != Some(contact.pair) {
                last_tangled = Some(contact.pair);
                self.find_tangled(&mut solver.particles, scene, pair);
            }
            let friction = scene.friction(pair.a.entity(), pair.b.entity());
            self.add_contact(solver, scene, &Between { pair, sides, friction }, record);
            false
        });
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
            Side::Body { first, topology } => {
                corners(topology).fold([DVec3::ZERO; 2], |[done, ahead], (corner, weight)| {
                    let [own, own_ahead] = of(first + corner as usize);
                    [done + own * weight, ahead + own_ahead * weight]
                })
            }
            Side::Driven { entity, topology } => driven(scene.motions.course(entity).map_or(DVec3::ZERO, |course| {
                let end = |corner: usize| course.end().transform_point(course.ahead.positions[corner].as_dvec3());
                let way = |corner: usize| end(corner) - course.now.point(corner);
                corners(topology).fold(DVec3::ZERO, |sum, (corner, weight)| sum + way(corner as usize) * weight)
            })),
            Side::Shape { entity } => driven(scene.motions.course(entity).map_or(DVec3::ZERO, |course| {
                let point = pair.frame_pose.transform_point(record.point_b.as_dvec3());
                course.end().transform_point(course.now.pose.inverse().transform_point(point)) - point
            })),
        }
    };
    let (a, b) = (ways_of(a, record.triangle_a, weights[0]), ways_of(b, record.triangle_b, weights[1]));
    Ways { done: a[0] - b[0], ahead: a[1] - b[1] }
}
