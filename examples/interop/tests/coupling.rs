//! Rigid bodies and deformable surfaces push each other, with both engines.

use bevy::prelude::*;
use bevy_circumsphere::{prelude::*, response::XpbdBody};
use circumsphere_interop::scenes::{
    Avian, BALL, CRATE, Engine, Rapier, Scene, ball_in_space, ball_on_cloth, crate_on_mattress,
};
use circumsphere_truth::point_triangle;
use glam::DVec3;

const TICKS: usize = 1_000;

/// What a scene looks like after a tick.
struct Look {
    /// Center of the body.
    center: DVec3,
    velocity: [Vec3; 2],
    /// The surface's vertices in the world.
    vertices: Vec<DVec3>,
    triangles: Vec<[DVec3; 3]>,
}

fn look<E: Engine>(scene: &Scene) -> Look {
    let world = scene.app.world();
    let center = world.get::<Transform>(scene.body).expect("it is there").translation.as_dvec3();
    let positions = world.get::<SurfacePositions>(scene.surface).expect("it is there");
    let vertices: Vec<DVec3> = positions.0.iter().map(|position| position.as_dvec3()).collect();
    let topology = world.get::<DeformableSurface>(scene.surface).expect("it is there").topology();
    let triangles =
        topology.triangles().iter().map(|corners| corners.map(|corner| vertices[corner as usize])).collect();
    Look { center, velocity: E::velocity(world, scene.body), vertices, triangles }
}

/// The solid angle of a triangle, as seen from a point (Van Oosterom and Strackee).
fn solid_angle(point: DVec3, triangle: &[DVec3; 3]) -> f64 {
    let [a, b, c] = triangle.map(|corner| corner - point);
    let [la, lb, lc] = [a, b, c].map(DVec3::length);
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(below)
}

/// Whether a point is above a cloth that rests in the plane y = 0 and is held at its border. Both shapes have the same
/// border and enclose what the cloth has bulged over. A point in there is on one side of the plane and on the other of
/// the cloth.
fn is_above(point: DVec3, cloth: &[[DVec3; 3]], at_rest: &[[DVec3; 3]]) -> bool {
    let angle = |triangles: &[[DVec3; 3]]| triangles.iter().map(|triangle| solid_angle(point, triangle)).sum::<f64>();
    let windings = (angle(cloth) - angle(at_rest)) / (4.0 * std::f64::consts::PI);
    assert!((windings - windings.round()).abs() < 1.0e-6, "both have one border: {windings}");
    (point.y > 0.0) == (windings.round() as i32 % 2 == 0)
}

/// The distance of a point from triangles.
fn distance(point: DVec3, triangles: &[[DVec3; 3]]) -> f64 {
    triangles.iter().map(|triangle| point_triangle(point, triangle).distance).fold(f64::INFINITY, f64::min)
}

fn kinetic_energy(scene: &Scene, look: &Look, mass: f32) -> f64 {
    let surface = scene.app.world().get::<XpbdBody>(scene.surface).expect("it is a body");
    surface.kinetic_energy() + 0.5 * f64::from(mass * look.velocity[0].length_squared())
}

#[test]
fn the_test_for_sides_sees_both() {
    let mut scene = ball_on_cloth::<Avian>(0.2);
    let at_rest = look::<Avian>(&scene).triangles;
    for _ in 0..200 {
        scene.app.update();
    }
    let sagged = look::<Avian>(&scene);
    // In the middle of the pocket, just above the cloth and just below it.
    let lowest = sagged.vertices.iter().copied().min_by(|a, b| a.y.total_cmp(&b.y)).expect("it has vertices");
    assert!(lowest.y < -0.05, "the ball has pressed the cloth below its border: {lowest}");
    for (offset, expected) in [(0.01, true), (-0.01, false), (0.02 - lowest.y, true), (-0.5, false)] {
        assert_eq!(is_above(lowest + DVec3::Y * offset, &sagged.triangles, &at_rest), expected, "{offset}");
    }
}

fn a_ball_is_stopped<E: Engine>(mass: f32) {
    let mut scene = ball_on_cloth::<E>(mass);
    let start = look::<E>(&scene);
    let drop = f64::from(mass) * 9.81 * start.center.y;
    let mut late = 0.0_f64;
    let mut nearest = f64::INFINITY;
    for tick in 0..TICKS {
        scene.app.update();
        let now = look::<E>(&scene);
        assert!(is_above(now.center, &now.triangles, &start.triangles), "{}, tick {tick}: it has passed", E::NAME);
        let apart = distance(now.center, &now.triangles) - f64::from(BALL);
        nearest = nearest.min(apart);
        // Neither gains energy. The cloth's own fall adds less than that.
        let energy = kinetic_energy(&scene, &now, mass);
        assert!(energy < drop + 2.0, "{}, tick {tick}: {energy} J of {drop} J", E::NAME);
        if tick >= TICKS / 2 {
            late = late.max(f64::from(now.velocity[0].length()));
        }
    }
    println!("{}, {mass} kg: nearest {nearest:.4} m, late speed {late:.3} m/s", E::NAME);
    assert!(nearest > 0.0, "{}: the cloth was in the ball by {nearest}", E::NAME);
    assert!(late < 0.2, "{}: it still moves at {late}", E::NAME);
}

#[test]
fn a_ball_that_falls_into_a_cloth_is_stopped_by_it() {
    for mass in [0.01, 0.2, 3.0] {
        a_ball_is_stopped::<Avian>(mass);
    }
    for mass in [0.05, 0.5, 10.0] {
        a_ball_is_stopped::<Rapier>(mass);
    }
}

fn a_crate_lies<E: Engine>(mass: f32) {
    let mut scene = crate_on_mattress::<E>(mass);
    let mut late = 0.0_f32;
    for tick in 0..TICKS {
        scene.app.update();
        let now = look::<E>(&scene);
        assert!(now.center.is_finite() && now.center.length() < 2.0, "{}, tick {tick}: {}", E::NAME, now.center);
        if tick >= TICKS / 2 {
            late = late.max(now.velocity[0].length());
        }
    }
    let now = look::<E>(&scene);
    println!("{}, {mass} kg: at {:.3}, late speed {late:.4} m/s", E::NAME, now.center);
    // On the mattress, which is 0.3 m high, and not beside it.
    let height = now.center.y - f64::from(CRATE);
    assert!((0.1..0.4).contains(&height), "{}: {height}", E::NAME);
    assert!(late < 0.1, "{}: it still moves at {late}", E::NAME);
}

#[test]
fn a_crate_lies_on_a_soft_body() {
    for mass in [1.0, 10.0] {
        a_crate_lies::<Avian>(mass);
    }
    for mass in [2.0, 5.0] {
        a_crate_lies::<Rapier>(mass);
    }
}

/// Momentum of the cloth and of the ball, in newton seconds.
fn momentum(scene: &Scene, look: &Look, mass: f32) -> [DVec3; 2] {
    let cloth = scene.app.world().get::<XpbdBody>(scene.surface).expect("it is a body");
    let parts = cloth.velocities.iter().zip(&cloth.inverse_masses);
    let cloth = parts.map(|(velocity, inverse)| velocity.as_dvec3() / f64::from(*inverse)).sum();
    [cloth, f64::from(mass) * look.velocity[0].as_dvec3()]
}

fn momentum_is_kept<E: Engine>(mass: f32) {
    let mut scene = ball_in_space::<E>(mass);
    // The cloth has none.
    let start = f64::from(mass) * DVec3::new(0.0, -3.0, 0.5);
    let (mut worst, mut exchanged) = (0.0_f64, 0.0_f64);
    for tick in 0..TICKS {
        scene.app.update();
        let now = look::<E>(&scene);
        if tick == 0 {
            continue;
        }
        let [cloth, ball] = momentum(&scene, &now, mass);
        exchanged = exchanged.max(cloth.length());
        worst = worst.max((cloth + ball - start).length());
    }
    println!("{}, {mass} kg: {exchanged:.4} Ns exchanged, {worst:.2e} lost of {:.4}", E::NAME, start.length());
    assert!(exchanged > 0.1 * start.length().min(1.0), "{}: they have met: {exchanged}", E::NAME);
    // Of what was exchanged, which is less than all of it.
    assert!(worst < 0.01 * exchanged, "{}, {mass} kg: {worst} of {exchanged}", E::NAME);
}

#[test]
fn momentum_is_kept_in_a_closed_scene() {
    for mass in [0.1, 100.0] {
        momentum_is_kept::<Avian>(mass);
    }
    for mass in [0.3, 10.0] {
        momentum_is_kept::<Rapier>(mass);
    }
}
