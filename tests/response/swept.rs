//! Bodies with swept collision: nothing goes through anything, at any speed.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_math::ops;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, grid, icosphere},
};
use glam::Vec3;

use crate::harness::Scene;

/// Half the contact distance, in meters.
const THICKNESS: f32 = 0.002;

/// Shoots a ball at a sheet that is pinned along its border. Returns whether the ball is behind the sheet in the end.
/// Each of them may be swept.
fn goes_through(thicknesses_a_tick: f32, [sheet_is_swept, ball_is_swept]: [bool; 2], random: &mut Random) -> bool {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let cells = 12u32;
    let sheet = grid(cells as usize, cells as usize, 0.5, 0.5, Diagonals::Alternating);
    let row = cells + 1;
    let border = |vertex: u32| [vertex % row, vertex / row].iter().any(|&place| place == 0 || place == cells);
    let pins = (0..row * row).filter(|&vertex| border(vertex)).map(VertexId);
    let thickness = SurfaceThickness::World(THICKNESS);
    let sheet = scene.add_changed(&sheet, XpbdMaterial::CLOTH, |body| body.pinned(pins), thickness);
    let way = thicknesses_a_tick * THICKNESS;
    let direction = Vec3::new(0.1 * random.signed_unit(), -1.0, 0.1 * random.signed_unit());
    let aim = Vec3::new(0.1 * random.signed_unit(), 0.0, 0.1 * random.signed_unit());
    let start = aim + Vec3::Y * 0.04 - direction * (1.3 * way);
    let ball = icosphere(1, 0.03).translate(start.to_array());
    let velocity = direction * (way * 60.0);
    let body = scene.add_changed(&ball, XpbdMaterial::SOFT, |body| body.moving(velocity), thickness);
    for (entity, is_swept) in [(sheet, sheet_is_swept), (body, ball_is_swept)] {
        if is_swept {
            scene.app.world_mut().entity_mut(entity).insert(SweptCollision);
        }
    }
    scene.run(12);
    scene.positions(body).iter().any(|position| !position.is_finite())
        || scene.positions(body).iter().all(|position| position.y < 0.0) && !scene_holds(&scene, body)
}

/// Whether a body below the sheet's plane lies in a pocket that it has pushed into the sheet, so that the sheet is
/// there too.
fn scene_holds(scene: &Scene, body: bevy_ecs::entity::Entity) -> bool {
    let lowest = scene.positions(body).iter().map(|position| position.y).fold(f32::MAX, f32::min);
    scene.app.world().iter_entities().filter(|entity| entity.id() != body).any(|entity| {
        entity
            .get::<SurfacePositions>()
            .is_some_and(|positions| positions.0.iter().any(|position| position.y < lowest + THICKNESS))
    })
}

#[test]
fn a_ball_never_goes_through_a_sheet() {
    let mut random = Random::new(3);
    let mut without = 0;
    for speed in [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0] {
        for _ in 0..3 {
            assert!(!goes_through(speed, [false, true], &mut random), "{speed}");
            assert!(!goes_through(speed, [true, false], &mut random), "{speed}, only the resting sheet is swept");
            without += usize::from(goes_through(speed, [false, false], &mut random));
        }
    }
    assert!(without > 3, "without sweeping, only {without} go through");
}

#[test]
fn what_the_game_moves_while_the_clock_stands_passes_through_nothing() {
    const RADIUS: f32 = 0.15;
    for jumps in [false, true] {
        let mut scene = Scene::new();
        let flag = grid(12, 12, 1.0, 1.0, Diagonals::Alternating).rotate([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2);
        let upper = (0..).zip(&flag.positions).filter(|(_, at)| at[1] > 0.499).map(|(vertex, _)| VertexId(vertex));
        let upper: Vec<VertexId> = upper.collect();
        let flag = scene.add_changed(&flag, XpbdMaterial::CLOTH, |body| body.pinned(upper), SweptCollision);
        let at = |z: f32| Transform::from_xyz(0.0, 0.0, z);
        let ball = scene.app.world_mut().spawn((RigidShape(SharedShape::ball(RADIUS)), at(-0.3))).id();
        scene.tick(1.0 / 60.0);
        // During a pause, the game moves the ball to the flag's other side.
        scene.app.world_mut().entity_mut(ball).insert(at(0.3));
        if jumps {
            scene.app.world_mut().entity_mut(ball).insert(Teleported);
        }
        scene.tick(0.0);
        for _ in 0..3 {
            scene.tick(1.0 / 60.0);
        }
        let before = scene.positions(flag).iter().filter(|position| position.z > 0.3).count();
        let inside = scene.positions(flag).iter().filter(|position| position.distance(Vec3::Z * 0.3) < RADIUS).count();
        assert_eq!(inside, 0);
        assert_eq!(before == 0, jumps, "{before} vertices are beyond the ball's center");
    }
}

/// A flag is pinned beside a pole, with wind along it or across, and a heavy ball flies through flag and pole: the flag has
/// no way left, and its vertices beside pins carry hardly any weight of the impacts. It stays whole, and near its pins.
#[test]
fn a_flag_that_is_crushed_against_its_pole_stays_near_it() {
    const POLE: f32 = 0.035;
    const BALL: f32 = 0.11;
    let poles =
        [SharedShape::cylinder(1.7, POLE), SharedShape::capsule_y(1.7, POLE), SharedShape::cuboid(POLE, 1.7, POLE)];
    for (pole, wind) in poles.into_iter().flat_map(|pole| [0.0, 1.6, 3.1].map(|wind| (pole.clone(), wind))) {
        let mut scene = Scene::new();
        let columns = 14;
        let flag = grid(columns, 9, 0.7, 0.45, Diagonals::Alternating)
            .rotate([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2)
            .translate([POLE + 0.025 + 0.35, 0.0, 0.0]);
        let pins = (0..10).map(|row| VertexId(row * (columns as u32 + 1)));
        let material = XpbdMaterial { area_density: 0.25, drag: 0.0, ..XpbdMaterial::CLOTH };
        let wind = Vec3::new(ops::cos(wind), 0.0, ops::sin(wind)) * 6.0;
        let parts = (
            SurfaceThickness::World(0.008),
            SelfCollision,
            SweptCollision,
            SurfaceWind { velocity: wind, ..SurfaceWind::default() },
        );
        let flag = scene.add_changed(&flag, material, |body| body.pinned(pins), parts);
        scene.app.world_mut().spawn((RigidShape(pole), Transform::default()));
        let at = |tick: usize| {
            Transform::from_translation(Vec3::new(0.1, 0.05, 1.5) + Vec3::new(-0.15, 0.0, -8.0) * (tick as f32 / 60.0))
        };
        let ball = scene.app.world_mut().spawn((RigidShape(SharedShape::ball(BALL)), at(0))).id();
        let mut stopped = 0;
        for tick in 0..60 {
            scene.app.world_mut().entity_mut(ball).insert(at(tick));
            scene.run(1);
            stopped += scene.diagnostics().vertices_stopped;
            assert!(scene.diagnostics().refused.is_empty(), "{:?}", scene.diagnostics());
            // The ball drags it along, and lets it go.
            let most = 2.0 * (0.8 + at(tick).translation.length());
            let farthest = scene.positions(flag).iter().map(|position| position.length()).fold(0.0, f32::max);
            assert!(farthest < most, "tick {tick}, wind {wind}: {farthest}");
        }
        assert!(stopped > 0, "the ball misses the flag");
    }
}

/// What falls in the last moment of a tick to just before a sheet begins the next one so close that it passes through in
/// the first substep. The solver stops it, not the guard.
#[test]
fn sheets_that_fall_flat_onto_sheets_are_stopped_by_the_solver() {
    let (mut stopped, mut landed) = (0, 0);
    for drop in (0..24).map(|drop| 0.4 + 0.004 * drop as f32) {
        let mut scene = Scene::new();
        let thickness = SurfaceThickness::World(0.004);
        for height in [0.05, 0.05 + drop] {
            let sheet = grid(12, 12, 0.3, 0.3, Diagonals::Alternating).translate([0.0, height, 0.0]);
            scene.add(&sheet, XpbdMaterial::CLOTH, (thickness, SelfCollision, SweptCollision));
        }
        scene.app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), Transform::default()));
        for _ in 0..40 {
            scene.run(1);
            stopped += scene.diagnostics().vertices_stopped;
        }
        landed += usize::from(scene.diagnostics().pressing > 300);
    }
    assert_eq!((stopped, landed), (0, 24));
}
