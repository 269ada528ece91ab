//! Bodies at rest fall asleep, and wake for everything that a player would see them miss.

use bevy_circumsphere::{ContactStore, prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid, icosphere};
use glam::Vec3;

use crate::harness::{Scene, mean};

/// Ticks in which everything in these scenes comes to rest and falls asleep.
const REST: usize = 400;

fn cloth(width: f32, height: f32) -> Mesh {
    grid(10, 10, width, width, Diagonals::Alternating).rotate([0.0, 1.0, 0.0], 0.2).translate([0.01, height, 0.02])
}

fn scene() -> Scene {
    let mut scene = Scene::new();
    scene.settings().sleep_speed = XpbdSettings::default().sleep_speed;
    scene
}

/// A crate on legs of cloth: two cloths and a soft ball above each other on a platform, and a cloth far away, asleep.
struct Stack {
    scene: Scene,
    platform: Entity,
    bodies: [Entity; 3],
    apart: Entity,
}

impl Stack {
    fn asleep() -> Self {
        let mut scene = scene();
        let shape = |scene: &mut Scene, at: [f32; 3]| {
            let transform = Transform::from_translation(at.into());
            scene.app.world_mut().spawn((RigidShape(SharedShape::cuboid(0.5, 0.1, 0.5)), transform)).id()
        };
        let platform = shape(&mut scene, [0.0, -0.1, 0.0]);
        shape(&mut scene, [5.0, -0.1, 0.0]);
        let extra = || (SelfCollision, SurfaceThickness::World(0.005));
        let bodies = [
            scene.add(&cloth(0.6, 0.02), XpbdMaterial::CLOTH, extra()),
            scene.add(&cloth(0.4, 0.04), XpbdMaterial::CLOTH, extra()),
            scene.add(&cuboid([0.05; 3], 3).translate([0.0, 0.12, 0.0]), XpbdMaterial::SOFT, extra()),
        ];
        let apart = scene.add(&cloth(0.4, 0.02).translate([5.0, 0.0, 0.0]), XpbdMaterial::CLOTH, extra());
        scene.run(REST);
        assert_eq!((scene.diagnostics().asleep, scene.diagnostics().bodies), (4, 0), "{:?}", scene.diagnostics());
        Self { scene, platform, bodies, apart }
    }

    /// The numbers of bodies that sleep in each of the next ticks.
    fn next(&mut self, ticks: usize) -> Vec<usize> {
        (0..ticks)
            .map(|_| {
                self.scene.run(1);
                self.scene.diagnostics().asleep
            })
            .collect()
    }

    fn heights(&self) -> [f64; 3] {
        self.bodies.map(|body| mean(self.scene.positions(body)).y)
    }
}

#[test]
fn what_sleeps_stays_to_the_bit_and_sleeps_again_when_woken() {
    let mut stack = Stack::asleep();
    let state = |stack: &Stack| stack.bodies.map(|body| stack.scene.positions(body).to_vec());
    let before = state(&stack);
    assert!(stack.next(100).iter().all(|&asleep| asleep == 4) && state(&stack) == before);
    let heights = stack.heights();
    stack.scene.body_mut(stack.bodies[1]).velocities[0].y = 0.3;
    assert_eq!(stack.next(1), [1], "the island of the impulse wakes, the cloth apart does not");
    stack.scene.run(REST);
    assert_eq!(stack.next(1), [4]);
    for (before, after) in heights.into_iter().zip(stack.heights()) {
        assert!((before - after).abs() < 0.01, "{before} to {after}");
    }
}

/// Crates side by side, farther apart than they touch but within the margin that awake bodies have: they fall asleep
/// though detection no longer lists them as a pair then. Each wakes without the other.
#[test]
fn neighbors_that_do_not_touch_sleep() {
    let mut scene = scene();
    let floor = RigidShape(SharedShape::cuboid(2.0, 0.1, 2.0));
    scene.app.world_mut().spawn((floor, Transform::from_xyz(0.0, -0.1, 0.0)));
    let crates = [0.0, 0.1107].map(|x| {
        let mesh = cuboid([0.05; 3], 3).translate([x, 0.056, 0.0]);
        scene.add(&mesh, XpbdMaterial::SOFT, SurfaceThickness::World(0.005))
    });
    let [mut near, mut touching] = [0; 2];
    for _ in 0..REST {
        scene.run(1);
        let store = scene.app.world().resource::<ContactStore>();
        let between = store.pairs().iter().find(|pair| [pair.a.entity(), pair.b.entity()] == crates);
        near += between.map_or(0, |_| 1);
        touching += between.map_or(0, |pair| usize::from(pair.nearest <= f64::from(pair.contact_distance)));
    }
    assert!(near > 10 && touching == 0, "a pair in {near} ticks, touching in {touching}");
    for _ in 0..50 {
        assert_eq!(scene.diagnostics().asleep, 2);
        scene.run(1);
    }
}

#[test]
fn bodies_wake_for_what_moves_them() {
    type Change = fn(&mut Stack);
    let changes: [(&str, usize, Change); 9] = [
        ("a platform that moves", 1, |stack| {
            let mut platform = stack.scene.app.world_mut().get_mut::<Transform>(stack.platform).unwrap();
            platform.translation.y += 0.02;
        }),
        ("a platform that is gone", 1, |stack| {
            stack.scene.app.world_mut().despawn(stack.platform);
        }),
        ("a platform that is disabled", 1, |stack| {
            stack.scene.app.world_mut().entity_mut(stack.platform).insert(SurfaceDisabled);
        }),
        ("a body that is gone", 1, |stack| {
            stack.scene.app.world_mut().despawn(stack.bodies[1]);
        }),
        ("gravity", 0, |stack| stack.scene.settings().gravity.y = -1.0),
        ("wind", 1, |stack| {
            let wind = SurfaceWind { velocity: Vec3::new(3.0, 4.0, 0.0), ..SurfaceWind::default() };
            stack.scene.app.world_mut().entity_mut(stack.bodies[2]).insert(wind);
        }),
        ("positions that the game writes", 1, |stack| {
            let mut positions = stack.scene.app.world_mut().get_mut::<SurfacePositions>(stack.bodies[0]).unwrap();
            positions.0[0].y += 0.01;
        }),
        ("a tether", 1, |stack| {
            let target = TetherTarget::World(Vec3::Y);
            let tethers = XpbdTethers::new([Tether::pin(VertexId(0), target)]);
            stack.scene.app.world_mut().entity_mut(stack.bodies[1]).insert(tethers);
        }),
        ("a shape that appears", 1, |stack| {
            let transform = Transform::from_xyz(0.0, 0.05, 0.0);
            stack.scene.app.world_mut().spawn((RigidShape(SharedShape::ball(0.05)), transform));
        }),
    ];
    for (what, asleep, change) in changes {
        let mut stack = Stack::asleep();
        let before = stack.bodies.map(|body| stack.scene.positions(body).to_vec());
        change(&mut stack);
        let counts = stack.next(2);
        assert!(counts.contains(&asleep), "{what}: {counts:?} asleep");
        stack.scene.run(10);
        let is_there = |body: &Entity| stack.scene.app.world().get_entity(*body).is_ok();
        let moved = stack.bodies.iter().zip(before).filter(|(body, _)| is_there(body));
        let moved = moved.filter(|(body, before)| *stack.scene.positions(**body) != before[..]).count();
        assert!(moved >= 2, "{what}: {moved} bodies moved");
        assert!(stack.scene.fastest(stack.apart) < 0.1, "{what}: the cloth apart");
    }
}

/// A ball at 10 m/s meets a sleeping sheet that hangs by its upper edge: both go on with the momentum that they have.
#[test]
fn a_shot_meets_a_sleeping_cloth_as_if_it_were_awake() {
    let after = |sleep_speed: f32, is_swept: bool| {
        let mut scene = Scene::new();
        scene.settings().sleep_speed = sleep_speed;
        let sheet = grid(12, 12, 0.6, 0.6, Diagonals::Alternating).rotate([1.0, 0.0, 0.0], 1.570_796_4);
        let top = sheet.positions.iter().map(|position| position[1]).fold(f32::MIN, f32::max);
        let is_top = |position: &[f32; 3]| position[1] > top - 1e-3;
        let pins = (0..).map(VertexId).zip(&sheet.positions).filter(|(_, at)| is_top(at)).map(|(vertex, _)| vertex);
        let pins: Vec<VertexId> = pins.collect();
        let extra = || (SelfCollision, SurfaceThickness::World(0.005));
        let sheet = scene.add_changed(&sheet, XpbdMaterial::CLOTH, |body| body.pinned(pins), extra());
        scene.run(REST);
        assert_eq!(scene.diagnostics().asleep, usize::from(sleep_speed > 0.0));
        let ball = icosphere(2, 0.05).translate([0.0, 0.0, -0.5]);
        let ball = scene.add_changed(&ball, XpbdMaterial::SOFT, |body| body.moving(Vec3::Z * 10.0), extra());
        if is_swept {
            scene.app.world_mut().entity_mut(ball).insert(SweptCollision);
        }
        scene.run(8);
        assert_eq!(scene.diagnostics().asleep, 0);
        [sheet, ball].map(|body| mean(scene.positions(body)))
    };
    for is_swept in [false, true] {
        let [awake, woken] = [0.0, 0.002].map(|sleep_speed| after(sleep_speed, is_swept));
        for (awake, woken) in awake.into_iter().zip(woken) {
            assert!(awake.distance(woken) < 0.03, "swept: {is_swept}: {awake} awake, {woken} woken");
        }
    }
}

#[test]
fn what_nothing_holds_and_what_is_weighed_stays_awake() {
    let mut scene = scene();
    scene.settings().gravity = Vec3::ZERO;
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
    let drifting = scene.add_changed(&cloth(0.4, 0.0), material, |body| body.moving(Vec3::X * 0.001), ());
    scene.run(240);
    let x = mean(scene.positions(drifting)).x;
    assert!((x - 0.014).abs() < 2e-4 && scene.diagnostics().asleep == 0, "{x}");

    let mut stack = Stack::asleep();
    stack.scene.app.world_mut().entity_mut(stack.platform).insert(SurfaceReaction::default());
    stack.scene.body_mut(stack.bodies[0]).velocities[0].y = 0.1;
    stack.scene.run(REST);
    let reaction = *stack.scene.app.world().get::<SurfaceReaction>(stack.platform).unwrap();
    assert!(reaction.impulse.y < 0.0 && stack.next(1) == [1], "{reaction:?}");
}

/// A pendulum stands still where it turns back, and a slow one does for several ticks.
#[test]
fn a_pendulum_swings_on() {
    let mut scene = scene();
    let strip = grid(2, 20, 0.05, 0.5, Diagonals::Alternating);
    let end = strip.positions.iter().map(|position| position[2]).fold(f32::MIN, f32::max);
    let is_end = |position: &[f32; 3]| position[2] > end - 1e-3;
    let pins: Vec<VertexId> =
        (0..).map(VertexId).zip(&strip.positions).filter(|(_, at)| is_end(at)).map(|(vertex, _)| vertex).collect();
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
    let strip = scene.add_changed(&strip, material, |body| body.pinned(pins), ());
    let (mut turns, mut last) = (0, 0.0);
    for _ in 0..600 {
        let before = mean(scene.positions(strip)).z;
        scene.run(1);
        let way = mean(scene.positions(strip)).z - before;
        turns += usize::from(way * last < 0.0);
        last = way;
        assert_eq!(scene.diagnostics().asleep, 0);
    }
    assert!(turns > 8, "{turns}");
}
