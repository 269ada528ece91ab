//! Carries bodies along when what holds them jumps: a character that is set back to its start, and wears cloth.
//!
//! A jump that the game has not marked with [`Teleported`](crate::Teleported) looks like a motion of kilometers a second.
//! To sweep it would take seconds, and would drag the cloth through itself. Instead, the body, and whatever else has made
//! the same jump, begins the tick where the jump has brought it.

use bevy_ecs::prelude::*;
use bevy_time::Time;
use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::{MOST_PARTS, Motions, Region, course::Course};
use crate::{
    kernel::pose::Pose,
    response::{body::XpbdBody, tethers::XpbdTethers},
    surface::{ActiveSurface, ActiveSurfaces, DeformableSurface, SurfacePositions},
};

/// What holds a body has jumped if it moves farther in a tick than it did before, by more than this share of the body's size,
/// and by more than the parts of a tick can follow. What stops at once has not jumped.
const JUMP: f64 = 0.25;

/// Rounds in which the rotation of a jump is found, from each guess. Where points are nearly on a line, each round leaves most of
/// the angle about it.
const ROUNDS: usize = 128;

/// A later guess is taken if it fits better by this share. What lies on a line fits turned about it as well.
const BETTER: f64 = 1.0e-6;

/// What holds a body: where it was, where it would be now if it went on as before, and where it is.
#[derive(Clone, Copy)]
struct Hold {
    start: DVec3,
    along: DVec3,
    end: DVec3,
}

/// Carries bodies along, with whatever else has made the same jump.
pub(in crate::response) fn carry(
    time: Option<Res<Time>>,
    mut active: ResMut<ActiveSurfaces>,
    mut motions: ResMut<Motions>,
    mut bodies: Query<(&mut SurfacePositions, &mut XpbdBody, &DeformableSurface, Option<&mut XpbdTethers>)>,
) {
    let duration = time.map_or(0.0, |time| time.delta_secs_f64());
    if duration <= 0.0 {
        return;
    }
    let Motions { courses, carried, .. } = &mut *motions;
    let mut jumps = Vec::new();
    for surface in &mut active.surfaces {
        let Ok((mut positions, mut body, mesh, mut tethers)) = bodies.get_mut(surface.entity) else { continue };
        let pins = courses.get(&surface.entity);
        let is_still = pins.is_none() && tethers.as_ref().is_none_or(|tethers| tethers.holding().is_some());
        if is_still || surface.fresh || body.check(&surface.topology, positions.0.len()).is_err() {
            continue;
        }
        let farthest = f64::from(MOST_PARTS) * f64::from(mesh.mean_edge()) * surface.pose.scale();
        let holds = holds_of(surface, &positions, &body, pins, tethers.as_deref(), duration);
        let Some(jump) = jump_of(surface, &positions, holds, farthest) else { continue };
        let own = surface.pose.inverse();
        for (vertex, position) in positions.0.iter_mut().enumerate() {
            if body.inverse_masses[vertex] > 0.0 || pins.is_some() {
                let world = surface.pose.transform_point(position.as_dvec3());
                *position = own.transform_point(jump.transform_point(world)).as_vec3();
            }
        }
        for velocity in &mut body.velocities {
            *velocity = jump.transform_direction(velocity.as_dvec3()).as_vec3();
        }
        if let Some(tethers) = &mut tethers {
            tethers.bypass_change_detection().carry(&jump);
        }
        if let Some(course) = courses.get_mut(&surface.entity) {
            course.from.pose = jump.after(&course.from.pose);
        }
        surface.fresh = true;
        jumps.push(jump);
        carried.push(surface.entity);
    }
    if jumps.is_empty() {
        return;
    }
    for surface in &mut active.surfaces {
        surface.fresh |= follows(courses.get_mut(&surface.entity), &jumps);
    }
    for shape in &mut active.shapes {
        shape.fresh |= follows(courses.get_mut(&shape.entity), &jumps);
    }
}

/// What holds a body: what it is pinned by, or else all tethers. Their vertices do not move as their targets do, but do so on
/// average.
fn holds_of<'a>(
    surface: &'a ActiveSurface,
    positions: &'a SurfacePositions,
    body: &'a XpbdBody,
    pins: Option<&'a Course>,
    tethers: Option<&'a XpbdTethers>,
    duration: f64,
) -> impl Iterator<Item = Hold> + Clone + 'a {
    let pinned = (0..positions.0.len()).filter(|&vertex| body.inverse_masses[vertex] <= 0.0);
    let is_pinned =
        pinned.clone().next().is_some() || tethers.is_some_and(|tethers| tethers.ends(true).next().is_some());
    let pinned = pinned.map(move |vertex| match pins {
        Some(course) => (vertex, [course.from.point(vertex), course.to.point(vertex)]),
        None => (vertex, [surface.pose.transform_point(positions.0[vertex].as_dvec3()); 2]),
    });
    let tethered = tethers.into_iter().flat_map(move |tethers| tethers.ends(is_pinned));
    pinned.chain(tethered).filter_map(move |(vertex, [start, end])| {
        Some(Hold { start, along: start + body.velocities.get(vertex)?.as_dvec3() * duration, end })
    })
}

/// The motion of what holds a body, less that of before, if it is a jump: rigid, and too far for the body to follow.
fn jump_of(
    surface: &ActiveSurface,
    positions: &SurfacePositions,
    holds: impl Iterator<Item = Hold> + Clone,
    farthest: f64,
) -> Option<Pose> {
    let spread = |way: &dyn Fn(&Hold) -> DVec3| {
        let add = |(sum, count), hold| (sum + way(&hold).length_squared(), count + 1.0);
        let (sum, count) = holds.clone().fold((0.0, 0.0_f64), add);
        (sum / count.max(1.0)).sqrt()
    };
    let way = spread(&|hold| hold.end - hold.start);
    let farther = way - spread(&|hold| hold.along - hold.start);
    if farther <= farthest {
        return None;
    }
    let Region { low, high } =
        Region::around(positions.0.iter().map(|position| surface.pose.transform_point(position.as_dvec3())));
    if farther <= JUMP * low.distance(high) {
        return None;
    }
    let jump = rigid_motion(holds.clone());
    let left = spread(&|hold| hold.end - jump.transform_point3(hold.along));
    // What is stretched or torn apart has not jumped.
    (left < 0.5 * way).then(|| Pose::from_double_affine(&jump).ok()).flatten()
}

/// Lets the course of something that has made one of the jumps begin behind it. Returns whether it has.
fn follows(course: Option<&mut Course>, jumps: &[Pose]) -> bool {
    let Some(course) = course.filter(|course| !course.is_of_pins) else { return false };
    let Course { from, to, .. } = &*course;
    let farthest = |jump: &Pose| {
        let begin = jump.after(&from.pose);
        let distance = |[start, end]: [DVec3; 2]| begin.transform_point(start).distance(to.pose.transform_point(end));
        let vertices = from.positions.iter().zip(&to.positions);
        let vertices = vertices.map(|(start, end)| distance([start, end].map(|point| point.as_dvec3())));
        // A shape without vertices is where its frame is.
        let axes = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].into_iter().filter(|_| from.positions.is_empty());
        vertices.chain(axes.map(|point| distance([point; 2]))).fold(0.0, f64::max)
    };
    let stays = farthest(&Pose::default());
    let nearest = jumps.iter().map(|jump| (farthest(jump), jump)).min_by(|(one, _), (other, _)| one.total_cmp(other));
    let Some((_, jump)) = nearest.filter(|(left, _)| *left < 0.5 * stays) else { return false };
    course.from.pose = jump.after(&course.from.pose);
    true
}

/// The rigid motion that brings what holds a body as near to where it is as possible (M. Müller et al. 2016, "A Robust Method to
/// Extract the Rotational Part of Deformations", from several guesses, because a guess that is off by half a turn stays
/// there).
fn rigid_motion(holds: impl Iterator<Item = Hold> + Clone) -> DAffine3 {
    let count = holds.clone().count().max(1) as f64;
    let from = holds.clone().map(|hold| hold.along).sum::<DVec3>() / count;
    let to = holds.clone().map(|hold| hold.end).sum::<DVec3>() / count;
    let spread = holds.fold(DMat3::ZERO, |sum, hold| {
        let (along, end) = (hold.along - from, hold.end - to);
        sum + DMat3::from_cols(end * along.x, end * along.y, end * along.z)
    });
    let agreement = |rotation: &DMat3| (0..3).map(|column| rotation.col(column).dot(spread.col(column))).sum::<f64>();
    let turned = |guess: DQuat| {
        let mut turn = guess;
        for _ in 0..ROUNDS {
            let rotation = DMat3::from_quat(turn);
            let across: DVec3 = (0..3).map(|column| rotation.col(column).cross(spread.col(column))).sum();
            let step = across / (agreement(&rotation).abs() + f64::MIN_POSITIVE);
            let angle = step.length();
            if !(angle.is_finite() && angle > 1.0e-9) {
                break;
            }
            turn = (DQuat::from_axis_angle(step / angle, angle) * turn).normalize();
        }
        DMat3::from_quat(turn)
    };
    let half_turns = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| DQuat::from_xyzw(axis.x, axis.y, axis.z, 0.0));
    let best = half_turns.into_iter().fold(turned(DQuat::IDENTITY), |best, guess| {
        let next = turned(guess);
        if agreement(&next) > agreement(&best) + BETTER * agreement(&best).abs() { next } else { best }
    });
    DAffine3 { matrix3: best, translation: to - best * from }
}

#[cfg(test)]
mod tests {
    use circumsphere_support::random::Random;

    use super::*;

    fn held([along, end]: [DVec3; 2]) -> Hold {
        Hold { start: along, along, end }
    }

    #[test]
    fn a_rigid_motion_is_found_whatever_its_angle() {
        let mut random = Random::new(5);
        let mut vector = || DVec3::from_array(std::array::from_fn(|_| f64::from(random.signed_unit())));
        for angle in [0.0, 1.0e-6, 0.3, 1.6, 2.5, 3.1, core::f64::consts::PI] {
            for _ in 0..20 {
                let rotation = DMat3::from_axis_angle(vector().normalize_or(DVec3::Y), angle);
                let motion = DAffine3 { matrix3: rotation, translation: 100.0 * vector() };
                let holds: Vec<Hold> = (0..30)
                    .map(|_| {
                        let along = vector() * DVec3::new(0.2, 0.1, 0.3) + 7.0;
                        held([along, motion.transform_point3(along)])
                    })
                    .collect();
                let found = rigid_motion(holds.iter().copied());
                for Hold { along, end, .. } in holds {
                    let off = found.transform_point3(along).distance(end);
                    assert!(off < 1.0e-6, "an angle of {angle}: off by {off}");
                }
            }
        }
    }

    /// One or two points do not say how the rest turns about them: it does not.
    #[test]
    fn what_few_points_hold_does_not_turn_more_than_they_do() {
        let [first, second] = [[DVec3::ZERO, DVec3::Y * 50.0], [DVec3::X, DVec3::new(1.0, 50.0, 0.0)]].map(held);
        for holds in [vec![first], vec![first; 2], vec![first, second]] {
            let found = rigid_motion(holds.iter().copied());
            let off = found.transform_point3(DVec3::Z).distance(DVec3::new(0.0, 50.0, 1.0));
            assert!(off < 1.0e-9, "{} points: {found:?}", holds.len());
        }
    }
}
