//! Random worlds of soft bodies and cloths that tumble between moving rigid shapes: platforms, pistons, and rotors.
//!
//! `CIRCUMSPHERE_WORLDS` sets the number of worlds (10 by default). `CIRCUMSPHERE_WORLD` plays a single one. A body
//! between two shapes may find no way out if one of them moves. Such worlds are counted separately and must stay
//! finite.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_math::ops;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, cuboid, grid, icosphere},
};
use glam::{DVec3, Quat, Vec3};
use parry3d::math::Pose;

use crate::{
    harness::{Scene, TICK},
    truth::{Closed, Place, Solid, doubles},
};

const WORLDS_VARIABLE: &str = "CIRCUMSPHERE_WORLDS";
const WORLD_VARIABLE: &str = "CIRCUMSPHERE_WORLD";
const WORLDS: u64 = 10;
const TICKS: usize = 300;

/// Half the contact distance, in meters.
const THICKNESS: f32 = 0.003;

/// The rounding of coordinates of a few meters, and of a pose.
const ROUNDING: f64 = 5e-6;

/// Half the width of the room, and its height, in meters.
const ROOM: f32 = 0.8;

/// How a shape moves.
#[derive(Clone, Copy, Debug)]
enum Motion {
    Still,
    /// To and fro by `reach`, with a period of `seconds`.
    Slides {
        reach: Vec3,
        seconds: f32,
    },
    /// Around an axis, in radians per second.
    Turns {
        axis: Vec3,
        speed: f32,
    },
}

struct Mover {
    entity: Entity,
    solid: Solid,
    place: Vec3,
    motion: Motion,
}

impl Mover {
    fn pose(&self, tick: usize) -> (Vec3, Quat) {
        let time = tick as f32 * TICK as f32;
        match self.motion {
            Motion::Still => (self.place, Quat::IDENTITY),
            Motion::Slides { reach, seconds } => {
                let share = 0.5 - 0.5 * ops::cos(std::f32::consts::TAU * time / seconds);
                (self.place + reach * share, Quat::IDENTITY)
            }
            Motion::Turns { axis, speed } => (self.place, Quat::from_axis_angle(axis, speed * time)),
        }
    }

    /// The pose in f64, as the transform has it.
    fn placed(&self, tick: usize) -> Place {
        let (offset, turn) = self.pose(tick);
        Place { turn: turn.as_dquat().normalize(), offset: offset.as_dvec3() }
    }

    fn depth(&self, tick: usize, point: DVec3) -> f64 {
        self.solid.depth(self.placed(tick).to_own(point))
    }

    /// The direction in which the shape pushes a triangle that is within `distance` of it.
    fn push(&self, tick: usize, corners: [DVec3; 3], distance: f64) -> Option<DVec3> {
        let placed = self.placed(tick);
        let pose = parry3d_f64::math::Pose::from_parts(placed.offset, placed.turn);
        let [a, b, c] = corners;
        let triangle = parry3d_f64::shape::Triangle::new(a, b, c);
        let shape: &dyn parry3d_f64::shape::Shape = match self.solid {
            Solid::Cuboid(half) => &parry3d_f64::shape::Cuboid::new(half),
            Solid::HalfSpace => &parry3d_f64::shape::HalfSpace::new(DVec3::Y),
            _ => unreachable!("movers are boxes and a floor"),
        };
        let at = parry3d_f64::math::Pose::IDENTITY;
        let contact = parry3d_f64::query::contact(&pose, shape, &at, &triangle, distance).expect("parry tests both")?;
        Some(contact.normal1)
    }
}

/// A box, as one of the shapes that games use for it.
fn box_shape(half: Vec3, random: &mut Random) -> SharedShape {
    match random.below(4) {
        0 => {
            let mesh = cuboid(half.to_array(), 2);
            let positions = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
            SharedShape::trimesh(positions, mesh.triangles).unwrap()
        }
        1 => {
            let part = SharedShape::cuboid(0.5 * half.x, half.y, half.z);
            let at = |x: f32| Pose::from_translation(Vec3::new(x, 0.0, 0.0));
            SharedShape::compound(vec![(at(-0.5 * half.x), part.clone()), (at(0.5 * half.x), part)])
        }
        _ => SharedShape::cuboid(half.x, half.y, half.z),
    }
}

fn add_mover(scene: &mut Scene, shape: SharedShape, solid: Solid, place: Vec3, motion: Motion) -> Mover {
    let entity = scene.app.world_mut().spawn((RigidShape(shape), Transform::from_translation(place))).id();
    Mover { entity, solid, place, motion }
}

fn add_box(scene: &mut Scene, half: Vec3, place: Vec3, motion: Motion, random: &mut Random) -> Mover {
    add_mover(scene, box_shape(half, random), Solid::Cuboid(half.as_dvec3()), place, motion)
}

/// The outcome of a world.
#[derive(Clone, Debug, Default, PartialEq)]
struct Fate {
    /// The largest number of vertices inside a closed solid in a tick, and the first tick with one.
    inside: usize,
    first: Option<usize>,
    not_finite: usize,
    /// The first tick in which something was between two shapes that close in.
    squeezed: Option<usize>,
    /// Vertices that have left the room, which is open only at its top.
    escaped: usize,
}

/// Whether two shapes, at least one of them moving, push in opposite directions.
fn are_opposed(movers: &[Mover], touched: &[(usize, DVec3)]) -> bool {
    let moves = |number: usize| !matches!(movers[number].motion, Motion::Still);
    touched.iter().enumerate().any(|(index, &(first, push))| {
        touched[index + 1..]
            .iter()
            .any(|&(second, other)| first != second && (moves(first) || moves(second)) && push.dot(other) < -0.2)
    })
}

/// The shapes that are near a triangle, and the direction in which each pushes it.
fn touched_by(movers: &[Mover], tick: usize, corners: [DVec3; 3]) -> Vec<(usize, DVec3)> {
    let push =
        |(number, mover): (usize, &Mover)| Some((number, mover.push(tick, corners, 4.0 * f64::from(THICKNESS))?));
    movers.iter().enumerate().filter_map(push).collect()
}

/// A world, its moving shapes, and its bodies.
fn build(number: u64) -> (Scene, Vec<Mover>, Vec<Entity>) {
    let mut random = Random::new(0x7004_b000 + number);
    let mut scene = Scene::new();
    let mut movers = Vec::new();
    // A floor, and four walls 20 cm thick.
    movers.push(add_mover(&mut scene, SharedShape::halfspace(Vec3::Y), Solid::HalfSpace, Vec3::ZERO, Motion::Still));
    for (axis, half) in [(Vec3::X, Vec3::new(0.1, 1.5, 1.0)), (Vec3::Z, Vec3::new(1.0, 1.5, 0.1))] {
        for side in [1.0, -1.0] {
            let place = axis * (side * (ROOM + 0.1)) + 1.4 * Vec3::Y;
            movers.push(add_box(&mut scene, half, place, Motion::Still, &mut random));
        }
    }
    for _ in 0..2 + random.below(3) {
        let speed = 0.3 + 4.7 * random.unit() as f32;
        let place =
            Vec3::new(0.4 * random.signed_unit(), 0.4 + 0.25 * random.unit() as f32, 0.4 * random.signed_unit());
        let mover = match random.below(3) {
            0 => {
                let reach = Vec3::Y * (0.1 + 0.3 * random.unit() as f32);
                let seconds = std::f32::consts::PI * reach.y / speed;
                add_box(&mut scene, Vec3::new(0.3, 0.04, 0.3), place, Motion::Slides { reach, seconds }, &mut random)
            }
            1 => {
                let reach = Vec3::X * (0.1 + 0.3 * random.unit() as f32);
                let seconds = std::f32::consts::PI * reach.x / speed;
                let place = Vec3::new(-0.5, place.y, place.z);
                add_box(&mut scene, Vec3::new(0.1, 0.2, 0.2), place, Motion::Slides { reach, seconds }, &mut random)
            }
            _ => {
                let axis = if random.below(2) == 0 { Vec3::Y } else { Vec3::Z };
                add_box(
                    &mut scene,
                    Vec3::new(0.3, 0.06, 0.06),
                    place,
                    Motion::Turns { axis, speed: 2.0 * speed },
                    &mut random,
                )
            }
        };
        movers.push(mover);
    }
    let mut bodies = Vec::new();
    for body in 0..3 + random.below(3) {
        let height = 1.15 + 0.25 * body as f32;
        let place = [0.45 * random.signed_unit(), height, 0.45 * random.signed_unit()];
        let (mesh, material): (Mesh, XpbdMaterial) = match random.below(3) {
            0 => (icosphere(2, 0.09), XpbdMaterial::SOFT),
            1 => (cuboid([0.07, 0.08, 0.09], 4), XpbdMaterial::SOFT),
            _ => (grid(9, 9, 0.4, 0.4, Diagonals::Alternating), XpbdMaterial::CLOTH),
        };
        let mesh = mesh.rotate([0.0, 1.0, 0.0], 3.0 * random.signed_unit()).translate(place);
        bodies.push(scene.add(&mesh, material, (SurfaceThickness::World(THICKNESS), SweptCollision)));
    }
    (scene, movers, bodies)
}

fn play(number: u64) -> Fate {
    let (mut scene, movers, bodies) = build(number);
    let mut fate = Fate::default();
    for tick in 0..TICKS {
        for mover in &movers {
            let (offset, turn) = mover.pose(tick);
            if !matches!(mover.motion, Motion::Still) {
                let transform = Transform::from_translation(offset).with_rotation(turn);
                scene.app.world_mut().entity_mut(mover.entity).insert(transform);
            }
        }
        scene.tick(TICK);
        let mut inside = 0;
        let all: Vec<Vec<DVec3>> = bodies.iter().map(|&body| doubles(scene.positions(body))).collect();
        let not_finite = all.iter().flatten().filter(|position| !position.is_finite()).count();
        fate.not_finite = fate.not_finite.max(not_finite);
        if not_finite > 0 {
            break;
        }
        for (points, &body) in all.iter().zip(&bodies) {
            let topology = scene.app.world().get::<DeformableSurface>(body).unwrap().topology();
            for &position in points {
                inside += movers.iter().filter(|mover| mover.depth(tick, position) > ROUNDING).count();
                let beside = position.x.abs().max(position.z.abs()) > f64::from(ROOM) + 0.2;
                fate.escaped += usize::from(tick + 1 == TICKS && (beside && position.y < 2.9 || position.y < -0.01));
            }
            // A cloth is squeezed if one of its triangles is between two shapes. A soft body keeps its volume, so it is
            // squeezed if any two of its triangles are.
            let touched: Vec<Vec<(usize, DVec3)>> = topology
                .triangles()
                .iter()
                .map(|triangle| touched_by(&movers, tick, triangle.map(|corner| points[corner as usize])))
                .collect();
            let is_squeezed = if topology.is_closed() {
                are_opposed(&movers, &touched.concat())
            } else {
                touched.iter().any(|touched| are_opposed(&movers, touched))
            };
            if is_squeezed {
                fate.squeezed.get_or_insert(tick);
            }
        }
        for (index, &body) in bodies.iter().enumerate() {
            let topology = scene.app.world().get::<DeformableSurface>(body).unwrap().topology();
            if !topology.is_closed() {
                continue;
            }
            let closed = Closed::new(all[index].clone(), topology.triangles().to_vec());
            let others = all.iter().enumerate().filter(|&(other, _)| other != index).flat_map(|(_, points)| points);
            inside += others.filter(|&&point| closed.contains(point)).count();
        }
        if inside > 0 {
            fate.first.get_or_insert(tick);
        }
        fate.inside = fate.inside.max(inside);
    }
    fate
}

#[test]
fn nothing_gets_into_or_through_what_moves() {
    let alone = std::env::var(WORLD_VARIABLE).ok().map(|number| number.parse().expect("the number of a world"));
    let count = std::env::var(WORLDS_VARIABLE).map_or(WORLDS, |count| count.parse().expect("a number of worlds"));
    let numbers = alone.map_or(0..count, |number| number..number + 1);
    let (mut squeezed, mut squeezed_wrong) = (0, 0);
    let mut lines = Vec::new();
    for number in numbers.clone() {
        let Ok(fate) = catch_unwind(AssertUnwindSafe(|| play(number))) else {
            lines.push(format!("world {number} panicked"));
            continue;
        };
        // Failures before the squeeze have nothing to do with it. A squeeze begins within a tick and is seen only at
        // its end: if the body is inside one shape, it may touch the other one only in the next tick.
        let is_squeezed = fate.squeezed.is_some_and(|tick| fate.first.is_none_or(|first| tick <= first + 1));
        squeezed += usize::from(is_squeezed);
        let is_wrong = fate.inside > 0 || fate.escaped > 0;
        if is_squeezed && is_wrong && fate.not_finite == 0 {
            squeezed_wrong += 1;
            println!("world {number}, squeezed: {fate:?}");
        } else if is_wrong || fate.not_finite > 0 {
            lines.push(format!("world {number}: {fate:?}"));
        }
    }
    let worlds = numbers.end - numbers.start;
    println!(
        "{worlds} worlds of {TICKS} ticks: {} wrong; {squeezed} squeezed apart, {squeezed_wrong} of them with something inside",
        lines.len()
    );
    assert!(lines.is_empty(), "{}", lines.join("\n"));
}
