//! A character in a skirt walks, turns, and swings its leg. No part of the skirt is inside the body in any tick.

use std::time::{Duration, Instant};

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{
    CHARACTER_LEG, CHARACTER_SPEEDS, CHARACTER_TORSO, Character, CharacterFineness, character_skirt,
    character_waist_vertices,
};
use glam::{DQuat, DVec3, Quat, Vec3};

use crate::{
    harness::{Scene, ticks_in},
    holds::RATES,
    truth::{Closed, Place, Solid, doubles},
};

/// Long enough to walk at full speed for two seconds.
const SECONDS: f64 = 3.0;

/// The bound is generous, since machines are noisy and this is no release build. Faulty ticks took seconds.
const SLOWEST: Duration = Duration::from_millis(500);

/// A slow machine is slow in every tick.
const MOST_RATIO: f64 = 4.0;

/// The rounding of coordinates below 16 m, and of a pose.
const ROUNDING: f64 = 4e-6;

/// The outcome of a walk.
#[derive(Default)]
struct Walk {
    /// The largest number of vertices inside the body in a tick, and the first tick with one.
    most_inside: usize,
    first_inside: Option<usize>,
    not_finite: usize,
    /// The largest distance of a pin from where it was put.
    pins_off: f64,
    times: Vec<Duration>,
}

impl Walk {
    fn look(&mut self, tick: usize, positions: &[Vec3], is_inside: impl Fn(DVec3) -> bool) {
        self.not_finite += positions.iter().filter(|position| !position.is_finite()).count();
        let inside = doubles(positions).into_iter().filter(|&position| is_inside(position)).count();
        self.most_inside = self.most_inside.max(inside);
        if inside > 0 {
            self.first_inside.get_or_insert(tick);
        }
    }

    /// Whether the run can stop: it has failed, and ticks get slower and slower.
    fn is_lost(&self) -> bool {
        self.most_inside > 100 || self.times[1..].iter().any(|&time| time > 4 * SLOWEST)
    }

    /// The slowest tick except the first, and the median.
    fn slowest_and_median(&self) -> [Duration; 2] {
        let mut times = self.times[1..].to_vec();
        times.sort_unstable();
        [times[times.len() - 1], times[times.len() / 2]]
    }

    fn report(&self, name: &str, failures: &mut Vec<String>) {
        let [slowest, median] = self.slowest_and_median();
        let ratio = slowest.as_secs_f64() / median.as_secs_f64();
        let line = format!(
            "{name}: at most {} inside (first in tick {:?}), {} not finite, pins off by {:.1e} m, \
             slowest tick {slowest:.1?}, {ratio:.1} times the median {median:.1?}",
            self.most_inside, self.first_inside, self.not_finite, self.pins_off
        );
        println!("{line}");
        if self.most_inside > 0
            || self.not_finite > 0
            || self.pins_off > ROUNDING
            || slowest > SLOWEST && ratio > MOST_RATIO
        {
            failures.push(line);
        }
    }
}

/// The number of rings of the skirt, and of segments around it.
pub const SKIRT: (usize, usize) = (14, 36);

/// Adds the skirt, and returns the positions of its pins at the start.
pub fn add_skirt(scene: &mut Scene) -> (Entity, Vec<[f32; 3]>) {
    let (rings, segments) = SKIRT;
    let skirt = character_skirt(rings, segments);
    let waist = skirt.positions[character_waist_vertices(segments)].to_vec();
    let pins = character_waist_vertices(segments).map(|vertex| VertexId(vertex as u32));
    let skirt =
        scene.add_changed(&skirt, XpbdMaterial::CLOTH, |body| body.pinned(pins), (SelfCollision, SweptCollision));
    (skirt, waist)
}

/// Moves the pins with the skin of the waist, and checks where they are after the tick.
fn tick(scene: &mut Scene, skirt: Entity, pins: &[[f32; 3]], rate: f64, walk: &mut Walk) {
    let mut positions = scene.app.world_mut().get_mut::<SurfacePositions>(skirt).unwrap();
    for (vertex, &pin) in pins.iter().enumerate() {
        positions.0[vertex] = Vec3::from(pin);
    }
    let start = Instant::now();
    scene.tick(1.0 / rate);
    walk.times.push(start.elapsed());
    let off = scene.positions(skirt).iter().zip(pins).map(|(at, &pin)| at.distance(Vec3::from(pin)));
    walk.pins_off = off.map(f64::from).fold(walk.pins_off, f64::max);
}

/// The skin is a surface whose positions the game writes in the world.
fn walk_skinned(fineness: CharacterFineness, speed: f64, rate: f64, is_swept: bool) -> Walk {
    let character = Character::new(fineness, speed);
    let mut scene = Scene::new();
    let body = scene.add_obstacle(character.rest(), SurfaceFrame::World);
    if is_swept {
        scene.app.world_mut().entity_mut(body).insert(SweptCollision);
    }
    let (skirt, waist) = add_skirt(&mut scene);
    let mut walk = Walk::default();
    for number in 0..ticks_in(SECONDS, rate) {
        let time = number as f64 / rate;
        let skin: Vec<Vec3> = character.positions(time).into_iter().map(Vec3::from).collect();
        scene.app.world_mut().get_mut::<SurfacePositions>(body).unwrap().0.clone_from(&skin);
        tick(&mut scene, skirt, &character.follow_torso(time, &waist), rate, &mut walk);
        let closed = Closed::new(doubles(&skin), character.rest().triangles.clone());
        walk.look(number, scene.positions(skirt), |position| closed.contains(position));
        if walk.is_lost() {
            break;
        }
    }
    walk
}

/// Torso and leg.
const CAPSULES: [([f32; 3], [f32; 3], f32); 2] = [CHARACTER_TORSO, CHARACTER_LEG];

/// Adds torso and leg as capsules.
pub fn add_capsules(scene: &mut Scene) -> [Entity; 2] {
    CAPSULES.map(|(low, high, radius)| {
        let shape = SharedShape::capsule(Vec3::from(low), Vec3::from(high), radius);
        scene.app.world_mut().spawn(RigidShape(shape)).id()
    })
}

/// Moves the capsules to these translations and rotations.
pub fn pose_capsules(scene: &mut Scene, capsules: &[Entity], poses: [([f32; 3], [f32; 4]); 2]) {
    for (&capsule, (translation, rotation)) in capsules.iter().zip(poses) {
        let rotation = Quat::from_array(rotation).normalize();
        let transform = Transform::from_translation(Vec3::from(translation)).with_rotation(rotation);
        scene.app.world_mut().entity_mut(capsule).insert(transform);
    }
}

/// Torso and leg are capsules. Each is an entity that the game moves by its transform.
fn walk_rigid(speed: f64, rate: f64) -> Walk {
    let character = Character::new(CharacterFineness::Coarse, speed);
    let mut scene = Scene::new();
    let shapes = add_capsules(&mut scene);
    let (skirt, waist) = add_skirt(&mut scene);
    let mut walk = Walk::default();
    for number in 0..ticks_in(SECONDS, rate) {
        let time = number as f64 / rate;
        let poses = [character.torso_pose(time), character.leg_pose(time)];
        pose_capsules(&mut scene, &shapes, poses);
        tick(&mut scene, skirt, &character.follow_torso(time, &waist), rate, &mut walk);
        let places = poses.map(|(translation, rotation)| Place {
            turn: DQuat::from_array(rotation.map(f64::from)).normalize(),
            offset: Vec3::from(translation).as_dvec3(),
        });
        walk.look(number, scene.positions(skirt), |position| {
            places.iter().zip(CAPSULES).any(|(place, (low, high, radius))| {
                let [low, high] = [low, high].map(|end| Vec3::from(end).as_dvec3());
                let own = place.to_own(position) - 0.5 * (low + high);
                Solid::Capsule(0.5 * low.distance(high), radius.into()).depth(own) > ROUNDING
            })
        });
        if walk.is_lost() {
            break;
        }
    }
    walk
}

fn skinned(fineness: CharacterFineness, speed: f64) {
    let mut failures = Vec::new();
    for rate in RATES {
        for is_swept in [true, false] {
            let name = format!("{fineness:?} at {speed} m/s, {rate} Hz, swept {is_swept}");
            walk_skinned(fineness, speed, rate, is_swept).report(&name, &mut failures);
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_skirt_stays_outside_a_skinned_body_that_turns_on_the_spot() {
    skinned(CharacterFineness::Coarse, CHARACTER_SPEEDS[0]);
}

#[test]
fn a_skirt_stays_outside_a_skinned_body_that_walks() {
    skinned(CharacterFineness::Coarse, CHARACTER_SPEEDS[1]);
}

#[test]
fn a_skirt_stays_outside_a_skinned_body_that_runs() {
    skinned(CharacterFineness::Coarse, CHARACTER_SPEEDS[2]);
}

#[test]
fn a_skirt_stays_outside_a_skinned_body_that_sprints() {
    skinned(CharacterFineness::Coarse, CHARACTER_SPEEDS[3]);
}

#[test]
#[ignore = "takes minutes"]
fn a_skirt_stays_outside_a_finer_skinned_body_at_every_speed() {
    for speed in CHARACTER_SPEEDS {
        skinned(CharacterFineness::Fine, speed);
    }
}

fn rigid(speeds: &[f64]) {
    let mut failures = Vec::new();
    for &speed in speeds {
        for rate in RATES {
            walk_rigid(speed, rate).report(&format!("rigid at {speed} m/s, {rate} Hz"), &mut failures);
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_skirt_stays_outside_a_rigid_body_that_stands_walks_or_runs() {
    rigid(&CHARACTER_SPEEDS[..3]);
}

#[test]
fn a_skirt_stays_outside_a_rigid_body_that_sprints() {
    rigid(&CHARACTER_SPEEDS[3..]);
}
