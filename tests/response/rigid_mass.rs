//! Rigid bodies with a mass, which surfaces push while the solver steps. The game that moves them is a few lines here.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{cloth, cuboid, icosphere};
use glam::{DQuat, DVec3, Mat3, Vec3};

use crate::harness::{LOSSLESS, Scene, TICK, mean, ticks_in};

/// A rigid body that a game moves.
struct Rigid {
    entity: Entity,
    /// Its shapes, and where they are from its center of mass.
    parts: Vec<(Entity, Vec3)>,
    /// 1 for axes along which it moves, and about which it turns; 0 for those that are locked.
    free: [DVec3; 2],
    mass: f64,
    /// Principal moments of inertia, in the body's own axes.
    inertia: DVec3,
    place: DVec3,
    turn: DQuat,
    velocity: DVec3,
    spin: DVec3,
    gravity: DVec3,
}

impl Rigid {
    fn new(scene: &mut Scene, shape: SharedShape, mass: f64, inertia: DVec3, place: DVec3) -> Self {
        Self::of_parts(scene, vec![(shape, Vec3::ZERO)], mass, inertia, place)
    }

    fn of_parts(scene: &mut Scene, shapes: Vec<(SharedShape, Vec3)>, mass: f64, inertia: DVec3, place: DVec3) -> Self {
        let world = scene.app.world_mut();
        let entity = world.spawn_empty().id();
        let part = |(shape, arm)| (world.spawn((RigidShape(shape), RigidPart(entity))).id(), arm);
        let rigid = Self {
            entity,
            parts: shapes.into_iter().map(part).collect(),
            free: [DVec3::ONE; 2],
            mass,
            inertia,
            place,
            turn: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            spin: DVec3::ZERO,
            gravity: DVec3::ZERO,
        };
        rigid.write(scene);
        rigid
    }

    fn ball(scene: &mut Scene, radius: f64, mass: f64, place: DVec3) -> Self {
        let inertia = DVec3::splat(0.4 * mass * radius * radius);
        Self::new(scene, SharedShape::ball(radius as f32), mass, inertia, place)
    }

    fn write(&self, scene: &mut Scene) {
        let turn = self.turn.as_quat();
        let axes = Mat3::from_quat(turn);
        let [moves, turns] = self.free.map(DVec3::as_vec3);
        let turns = Mat3::from_diagonal(turns);
        let inverse_inertia = axes * Mat3::from_diagonal((1.0 / self.inertia).as_vec3()) * axes.transpose();
        let mass = RigidMass {
            inverse_mass: moves * (1.0 / self.mass) as f32,
            inverse_inertia: turns * inverse_inertia * turns,
            center_of_mass: self.place.as_vec3(),
        };
        scene.app.world_mut().entity_mut(self.entity).insert(mass);
        for &(part, arm) in &self.parts {
            let at = Transform::from_translation(self.place.as_vec3() + turn * arm).with_rotation(turn);
            scene.app.world_mut().entity_mut(part).insert(at);
        }
    }

    /// Moves the body, then everything else, and applies what has pushed the body.
    fn tick(&mut self, scene: &mut Scene, step: f64) -> RigidPush {
        self.velocity += self.gravity * step;
        self.place += self.velocity * step;
        self.turn = (DQuat::from_scaled_axis(self.spin * step) * self.turn).normalize();
        self.write(scene);
        scene.tick(step);
        let push = *scene.app.world().get::<RigidPush>(self.entity).unwrap();
        self.velocity += push.velocity.as_dvec3();
        self.spin += push.angular_velocity.as_dvec3();
        self.place += push.translation.as_dvec3();
        self.turn = (push.rotation.as_dquat() * self.turn).normalize();
        push
    }

    fn angular(&self) -> DVec3 {
        let own = self.turn.inverse() * self.spin;
        self.turn * (self.inertia * own)
    }

    fn kinetic_energy(&self) -> f64 {
        0.5 * self.mass * self.velocity.length_squared() + 0.5 * self.spin.dot(self.angular())
    }
}

/// Momentum of a body, and its angular momentum about the origin.
fn momenta(scene: &Scene, body: Entity) -> [DVec3; 2] {
    let moving = scene.body(body);
    let parts = scene.positions(body).iter().zip(&moving.velocities).zip(&moving.inverse_masses);
    parts.filter(|(_, inverse)| **inverse > 0.0).fold([DVec3::ZERO; 2], |[sum, moment], ((at, velocity), inverse)| {
        let momentum = velocity.as_dvec3() / f64::from(*inverse);
        [sum + momentum, moment + at.as_dvec3().cross(momentum)]
    })
}

fn swept() -> impl Bundle {
    (SurfaceThickness::World(0.01), SelfCollision, SweptCollision)
}

/// A canvas of 1.44 kg that is held all around, or a cloth at its corners only.
fn trampoline(scene: &mut Scene, at_corners: bool, drag: f32) -> Entity {
    let is_end = |place: u32| place == 0 || place == 24;
    let is_held = move |&vertex: &u32| {
        let [x, y] = [is_end(vertex % 25), is_end(vertex / 25)];
        if at_corners { x && y } else { x || y }
    };
    let pins = (0..25 * 25).filter(is_held).map(VertexId);
    let material = XpbdMaterial { area_density: 1.0, drag, ..XpbdMaterial::CLOTH };
    scene.add_changed(&cloth(25, 0.05), material, |body| body.pinned(pins), swept())
}

/// Whatever a ball weighs, a canvas throws it no higher than it fell from, at any rate of ticks.
#[test]
fn a_canvas_throws_no_ball_higher_than_it_fell_from() {
    const HEIGHT: f64 = 0.6;
    for rate in [30.0, 64.0, 120.0] {
        for mass in [0.005, 0.05, 0.2, 0.5, 5.0] {
            let mut scene = Scene::new();
            trampoline(&mut scene, false, 10.0);
            let mut ball = Rigid::ball(&mut scene, 0.2, mass, DVec3::new(0.03, HEIGHT, 0.02));
            ball.gravity = DVec3::NEG_Y * 9.81;
            let mut pushed = 0.0;
            for tick in 0..ticks_in(8.0, rate) {
                pushed += f64::from(ball.tick(&mut scene, 1.0 / rate).velocity.y) * mass;
                let energy = 9.81 * ball.place.y + ball.kinetic_energy() / mass;
                assert!(
                    energy < 1.02 * 9.81 * HEIGHT,
                    "{mass} kg at {rate} Hz, tick {tick}: {energy} J/kg at {}",
                    ball.place
                );
            }
            assert!(pushed > 4.0 * 9.81 * mass, "{mass} kg at {rate} Hz: the canvas has carried it: {pushed} Ns");
            assert!(ball.place.y > -HEIGHT, "{mass} kg at {rate} Hz: it is on the canvas: {}", ball.place);
        }
    }
}

/// A ball on a cloth that is held at its corners comes to rest. It swings, and what springs back must not come late.
#[test]
fn a_ball_on_a_slack_cloth_comes_to_rest() {
    for (mass, rate) in [(0.05, 64.0), (0.2, 64.0), (0.2, 30.0), (1.0, 120.0)] {
        let mut scene = Scene::new();
        trampoline(&mut scene, true, XpbdMaterial::CLOTH.drag);
        let mut ball = Rigid::ball(&mut scene, 0.1, mass, DVec3::new(0.02, 0.4, 0.0));
        ball.gravity = DVec3::NEG_Y * 9.81;
        let ticks = ticks_in(20.0, rate);
        let mut fastest = 0.0_f64;
        for tick in 0..ticks {
            ball.tick(&mut scene, 1.0 / rate);
            if tick >= ticks * 9 / 10 {
                fastest = fastest.max(ball.velocity.length());
            }
        }
        assert!(fastest < 0.15, "{mass} kg at {rate} Hz: {fastest} m/s at {}", ball.place);
        assert!(ball.place.y > -1.0 && ball.place.length() < 1.2, "{mass} kg at {rate} Hz: {}", ball.place);
    }
}

/// What a free cloth and a rigid body exchange is neither lost nor gained, for bodies of any mass, also of several shapes,
/// with arms, made of triangles, and so fast that the tick is split. And no energy comes from nowhere.
#[test]
fn momentum_is_kept_and_energy_does_not_grow() {
    type Shape = fn() -> (SharedShape, DVec3);
    let shapes: [(&str, Shape); 3] = [
        ("ball", || (SharedShape::ball(0.2), DVec3::splat(0.4 * 0.04))),
        ("cuboid", || (SharedShape::cuboid(0.3, 0.1, 0.2), DVec3::new(0.05, 0.13, 0.1) / 3.0)),
        ("trimesh", || {
            let mesh = icosphere(2, 0.2);
            let points = mesh.positions.iter().map(|&point| point.into()).collect();
            let shape = SharedShape::trimesh(points, mesh.triangles.clone()).unwrap();
            (shape, DVec3::splat(0.4 * 0.04))
        }),
    ];
    for (name, shape) in shapes {
        for (mass, speed) in [(0.01, 3.0), (0.3, 3.0), (0.3, 40.0), (100.0, 3.0)] {
            let mut scene = Scene::new();
            scene.settings().gravity = Vec3::ZERO;
            let body = scene.add(&cloth(25, 0.05), LOSSLESS, swept());
            let (shape, inertia) = shape();
            let mut rigid = Rigid::new(&mut scene, shape, mass, inertia * mass, DVec3::new(0.1, 0.5, 0.05));
            rigid.tick(&mut scene, TICK);
            rigid.velocity = DVec3::new(0.0, -speed, 0.3);
            rigid.spin = DVec3::new(1.0, 2.0, -0.5);
            let [start, start_angular] =
                [rigid.velocity * mass, rigid.place.cross(rigid.velocity * mass) + rigid.angular()];
            let first = rigid.kinetic_energy();
            let mut exchanged = [0.0_f64; 2];
            let mut split = 1;
            for tick in 0..120 {
                rigid.tick(&mut scene, TICK);
                split = split.max(scene.diagnostics().parts);
                let [sum, moment] = momenta(&scene, body);
                exchanged = [exchanged[0].max(sum.length()), exchanged[1].max(moment.length())];
                let off = (sum + rigid.velocity * mass - start).length();
                assert!(
                    off < 5e-5 * exchanged[0].max(1e-6),
                    "{name}, {mass} kg, {speed} m/s, tick {tick}: {off} of {exchanged:?}"
                );
                let energy = rigid.kinetic_energy() + scene.body(body).kinetic_energy();
                assert!(energy < 1.01 * first, "{name}, {mass} kg, {speed} m/s, tick {tick}: {energy} of {first} J");
            }
            let angular = rigid.place.cross(rigid.velocity * mass) + rigid.angular();
            let off = (momenta(&scene, body)[1] + angular - start_angular).length();
            // The cloth itself keeps it to a few percent. The cuboid's own motion has no gyroscopic torque here.
            if name != "cuboid" && speed < 10.0 {
                assert!(off < 0.05 * exchanged[1], "{name}, {mass} kg: {off} of {exchanged:?}");
            }
            assert!(exchanged[0] > 0.1 * start.length().min(1.0), "{name}, {mass} kg, {speed} m/s: they have met");
            assert!(speed < 10.0 || split > 1, "{name}: the tick is split");
        }
    }
}

/// A body without a mass, and one that nothing can move, push a cloth as a shape that the game moves does.
#[test]
fn what_cannot_be_moved_is_as_a_shape_that_the_game_moves() {
    let run = |mass: Option<RigidMass>, ticks: u8| {
        let mut scene = Scene::new();
        scene.settings().gravity = Vec3::ZERO;
        let body = scene.add(&cloth(15, 0.05), LOSSLESS, swept());
        let ball = (RigidShape(SharedShape::ball(0.15)), SurfaceReaction::default());
        let ball = scene.app.world_mut().spawn(ball).id();
        if let Some(mass) = mass {
            scene.app.world_mut().entity_mut(ball).insert(mass);
        }
        for tick in 0..ticks {
            let at = Transform::from_xyz(0.02, 0.4 - 0.02 * f32::from(tick), 0.0);
            scene.app.world_mut().entity_mut(ball).insert(at);
            scene.run(1);
        }
        let push = scene.app.world().get::<RigidPush>(ball).copied().unwrap_or_default();
        let reaction = *scene.app.world().get::<SurfaceReaction>(ball).unwrap();
        (scene.positions(body).to_vec(), push, reaction)
    };
    let fixed = RigidMass { inverse_mass: Vec3::ZERO, inverse_inertia: Mat3::ZERO, center_of_mass: Vec3::ZERO };
    let unusable = [Vec3::NAN, -Vec3::ONE].map(|inverse_mass| RigidMass { inverse_mass, ..fixed });
    // Contacts with what has a mass come in another order, so single vertices go other ways after a while.
    for (ticks, of_vertices, of_mean) in [(14, 1.0e-6, 1.0e-6), (18, 5.0e-3, 2.0e-4)] {
        let (expected, _, reaction) = run(None, ticks);
        assert!(reaction.impulse.y > 1.0e-3, "the ball pushes the cloth up: {reaction:?}");
        for mass in unusable {
            assert_eq!(run(Some(mass), ticks), (expected.clone(), RigidPush::default(), reaction), "{mass:?}");
        }
        let (found, push, reaction_of_fixed) = run(Some(fixed), ticks);
        assert_eq!(push, RigidPush::default());
        let farthest = found.iter().zip(&expected).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        let apart = mean(&found).distance(mean(&expected));
        assert!(farthest < of_vertices && apart < of_mean, "tick {ticks}: {farthest} m apart, {apart} in the mean");
        let off = reaction_of_fixed.impulse.distance(reaction.impulse);
        assert!(off < 0.05 * reaction.impulse.length(), "tick {ticks}: {reaction_of_fixed:?} and {reaction:?}");
    }
}

/// A plate of two shapes that belong to one body tilts when a cloth hits one of them, as the body of one compound shape does.
/// And locked axes stay.
#[test]
fn shapes_of_one_body_move_together_and_locked_axes_stay() {
    let run = |is_compound: bool, locked: bool| {
        let mut scene = Scene::new();
        scene.settings().gravity = Vec3::ZERO;
        let material = XpbdMaterial { area_density: 2.0, ..LOSSLESS };
        let cloth = scene.add(&cloth(9, 0.05).translate([0.5, 0.15, 0.0]), material, swept());
        scene.body_mut(cloth).velocities.fill(Vec3::NEG_Y);
        let (arm, inertia) = (Vec3::X * 0.5, DVec3::new(0.02, 0.6, 0.6));
        let pad = SharedShape::cuboid(0.2, 0.05, 0.2);
        let pads = if is_compound {
            let parts = [arm, -arm].map(|arm| (parry3d::math::Pose::from_translation(arm), pad.clone()));
            vec![(SharedShape::compound(parts.to_vec()), Vec3::ZERO)]
        } else {
            [arm, -arm].map(|arm| (pad.clone(), arm)).to_vec()
        };
        let mut plate = Rigid::of_parts(&mut scene, pads, 1.0, inertia, DVec3::ZERO);
        if locked {
            plate.free = [DVec3::X, DVec3::ZERO];
        }
        for _ in 0..60 {
            plate.tick(&mut scene, TICK);
        }
        (plate.place, plate.velocity, plate.spin)
    };
    let [one, two] = [true, false].map(|is_compound| run(is_compound, false));
    // The cloth hits the arm at x > 0 from above.
    assert!(one.1.y < -0.01 && one.2.z < -0.05, "{one:?}");
    assert!(
        one.1.distance(two.1) < 0.02 * one.1.length() && one.2.distance(two.2) < 0.02 * one.2.length(),
        "{one:?} {two:?}"
    );
    let (place, velocity, spin) = run(false, true);
    assert_eq!([place.y, place.z, velocity.y, spin.length()], [0.0; 4], "{place} {velocity} {spin}");
}

/// A crate lies on a soft block at rest, and does not sink through it.
#[test]
fn a_crate_comes_to_rest_on_a_soft_block() {
    for mass in [0.5, 5.0] {
        let mut scene = Scene::new();
        scene.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
        let extra = (SurfaceThickness::World(0.01), SweptCollision);
        scene.add(&cuboid([0.6, 0.15, 0.6], 8).translate([0.0, 0.17, 0.0]), XpbdMaterial::SOFT, extra);
        let half = 0.2;
        let inertia = DVec3::splat(mass * 2.0 * half * half / 3.0);
        let shape = SharedShape::cuboid(half as f32, half as f32, half as f32);
        let mut load = Rigid::new(&mut scene, shape, mass, inertia, DVec3::new(0.05, 0.6, 0.0));
        load.gravity = DVec3::NEG_Y * 9.81;
        let mut fastest = 0.0_f64;
        for tick in 0..600 {
            load.tick(&mut scene, TICK);
            if tick > 540 {
                fastest = fastest.max(load.velocity.length());
            }
        }
        let bottom = load.place.y - half;
        assert!(fastest < 0.1 && (0.1..0.4).contains(&bottom), "{mass} kg: {fastest} m/s, bottom at {bottom}");
    }
}
