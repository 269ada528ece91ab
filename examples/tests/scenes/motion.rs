//! Driven parts of a scene must be where their paths put them, and free bodies must follow a parabola.

use bevy_circumsphere::response::{XpbdBody, XpbdSettings};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{
    Character, CharacterFineness, FIGURE_LIMBS, character_waist_vertices, instrument_pose, level_ball, level_ferry,
    level_lift, organ, pelvis_offset, skirt, skirt_waist_vertices, walking_figure,
};
use glam::{DVec3, Quat, Vec3};

use crate::{
    play,
    scenes::{
        Scene, Stage, TICK, Variation,
        bullet_cloth::{Shot, Target},
    },
    small, varied,
};

/// Rounding of coordinates of about a meter.
const ROUNDING: f32 = 4.0 * f32::EPSILON;

fn named(stage: &Stage, entities: &[Entity], name: &str) -> Entity {
    let is_named = |&&entity: &&Entity| stage.app.world().get::<Name>(entity).is_some_and(|own| own.as_str() == name);
    *entities.iter().find(is_named).expect("the scene has a surface of that name")
}

/// When the scene's last tick ended, in seconds.
fn time(scene: &Scene) -> f64 {
    f64::from(scene.stage.ticks) * TICK.as_secs_f64()
}

#[test]
fn limbs_walk_and_the_waist_of_the_skirt_goes_with_the_pelvis() {
    let mut scene = small("skirt", 1);
    let start: Vec<Vec3> = scene.stage.positions(scene.stage.bodies[0]).to_vec();
    play(&mut scene, 45);
    let figure = walking_figure(time(&scene));
    let standing = walking_figure(0.0);
    for ((name, limb), before) in FIGURE_LIMBS.iter().zip(&figure).zip(&standing) {
        let entity = named(&scene.stage, &scene.stage.obstacles, name);
        let found = scene.stage.positions(entity);
        assert!(found.iter().zip(&limb.positions).all(|(found, &expected)| *found == Vec3::from(expected)), "{name}");
        assert_ne!(limb.positions, before.positions, "{name} stands still, so the test proves nothing");
    }
    let segments = 24;
    assert_eq!(skirt(8, segments).positions.len(), start.len(), "the small skirt has 8 rings of 24");
    let offset = Vec3::from(pelvis_offset(time(&scene)));
    assert!(offset.length() > 0.005, "the pelvis has barely moved");
    let found = scene.stage.positions(scene.stage.bodies[0]);
    for vertex in skirt_waist_vertices(segments) {
        assert!(found[vertex].distance(start[vertex] + offset) <= ROUNDING, "{vertex}");
    }
}

#[test]
fn the_instrument_follows_its_poses_and_the_held_part_of_the_organ_stays() {
    let mut scene = small("soft_tissue", 1);
    let tool = named(&scene.stage, &scene.stage.obstacles, "instrument");
    for ticks in [1, 30, 39] {
        play(&mut scene, ticks);
        let (translation, rotation) = instrument_pose(time(&scene));
        let transform = scene.stage.app.world().get::<Transform>(tool).expect("it has a transform");
        assert_eq!(transform.translation, Vec3::from(translation));
        assert_eq!(transform.rotation, Quat::from_array(rotation));
    }
    // One second after its start, the instrument presses: it has moved free vertices, but no held ones.
    let organ_body = scene.stage.bodies[0];
    let inverse_masses = &scene.stage.app.world().get::<XpbdBody>(organ_body).expect("it is a body").inverse_masses;
    let (mut held, mut moved) = (0, 0);
    for ((found, start), &inverse_mass) in
        scene.stage.positions(organ_body).iter().zip(organ(2).positions).zip(inverse_masses)
    {
        let way = found.distance(Vec3::from(start));
        if inverse_mass == 0.0 {
            assert_eq!(way, 0.0);
            held += 1;
        } else {
            moved += usize::from(way > 1.0e-4);
        }
    }
    assert!(held > 10 && moved > 10, "{held} vertices are held, {moved} have moved");
}

#[test]
fn the_character_walks_and_the_waist_of_its_skirt_goes_with_it() {
    let mut scene = small("walking_skirt", 1);
    let start: Vec<Vec3> = scene.stage.positions(scene.stage.bodies[0]).to_vec();
    play(&mut scene, 20);
    let character = Character::new(CharacterFineness::Coarse, Variation::default().walking_speed);
    let expected = character.positions(time(&scene));
    let found = scene.stage.positions(scene.stage.obstacles[0]);
    assert!(found.iter().zip(&expected).all(|(found, &expected)| *found == Vec3::from(expected)));
    assert_ne!(expected, character.rest().positions, "it stands still, so the test proves nothing");
    let waist: Vec<[f32; 3]> = character_waist_vertices(24).map(|vertex| start[vertex].to_array()).collect();
    let found = scene.stage.positions(scene.stage.bodies[0]);
    for (found, expected) in found.iter().zip(character.follow_torso(time(&scene), &waist)) {
        assert!(found.distance(Vec3::from(expected)) <= ROUNDING);
    }
}

#[test]
fn platforms_and_the_fast_ball_of_the_level_follow_their_paths() {
    let mut scene = small("level", 1);
    let speed = Variation::default().ball_speed;
    for ticks in [1, 30, 35] {
        play(&mut scene, ticks);
        let now = time(&scene);
        for (name, expected) in
            [("lift", level_lift(now)), ("ferry", level_ferry(now).0), ("ball", level_ball(now, speed))]
        {
            let entity = named(&scene.stage, &scene.stage.shapes, name);
            let transform = scene.stage.app.world().get::<Transform>(entity).expect("it has a transform");
            assert_eq!(transform.translation, Vec3::from(expected), "{name}");
        }
    }
}

#[test]
fn what_nothing_holds_falls_as_far_as_the_steps_of_a_tick_add_up_to() {
    let mut scene = small("pile", 1);
    let body = scene.stage.bodies[0];
    let center = |scene: &Scene| -> DVec3 {
        let points = scene.stage.world_positions(body);
        points.iter().sum::<DVec3>() / points.len() as f64
    };
    let start = center(&scene);
    let ticks = 5;
    play(&mut scene, ticks);
    let settings = *scene.stage.app.world().resource::<XpbdSettings>();
    let step = TICK.as_secs_f64() / f64::from(settings.substeps);
    let material = scene.stage.app.world().get::<XpbdBody>(body).expect("it is a body").material;
    let kept = 1.0 - f64::from(material.drag) * step;
    let (mut speed, mut fallen) = (0.0, 0.0);
    for _ in 0..ticks * settings.substeps {
        speed = speed * kept - f64::from(settings.gravity.y) * step;
        fallen += speed * step;
    }
    let found = start - center(&scene);
    // Velocities and the gravity of the settings are stored in single precision.
    assert!((found.y - fallen).abs() < 1.0e-5, "{} is not {fallen}", found.y);
    assert!(found.x.abs().max(found.z.abs()) < 1.0e-5);
}

#[test]
fn a_shot_flies_at_its_speed_and_meets_nothing_in_the_first_tick() {
    for target in [Target::Sheet, Target::SheetBySheet, Target::Closed] {
        for speed in [2.0, 1000.0] {
            let mut scene = varied("bullet_cloth", &Variation { shot: Shot { target, speed }, ..Variation::default() });
            let shot = *scene.stage.bodies.last().expect("something is shot");
            let lowest = |scene: &Scene| {
                scene.stage.world_positions(shot).iter().map(|point| point.y).fold(f64::INFINITY, f64::min)
            };
            let start = lowest(&scene);
            play(&mut scene, 1);
            let way = start - lowest(&scene);
            // Thicknesses are 2 mm. In the first tick, gravity adds less than 3 mm, and a drag of 2 per second takes
            // less than a fiftieth: each of ten steps loses another three-hundredth.
            let expected = 0.002 * f64::from(speed);
            assert!((0.98 * expected..expected + 0.003).contains(&way), "{target:?} {speed}: {way}");
            assert_eq!(scene.tunnelled(), 0, "{target:?} {speed}");
        }
    }
}
