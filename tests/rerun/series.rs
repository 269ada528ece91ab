//! Curves in the recording match the diagnostics, and the contacts and positions of the ticks.

use std::collections::BTreeMap;

use bevy_app::prelude::*;
use bevy_circumsphere::{debug::RerunSettings, detection::DetectionDiagnostics, geometry::ContactKey, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use glam::Vec3;

use crate::{
    recording::Recording,
    world::{
        Recorded, Scene, THICKNESS, THIN, contacts, everything, move_positions, nothing, place, sheet, spawn,
        spawn_shape,
    },
};

fn only_series() -> RerunSettings {
    RerunSettings { series: true, ..nothing() }
}

/// The values of a tick's curves in one plot below `series`, by name.
fn curves(recording: &Recording, plot: &str) -> BTreeMap<String, f64> {
    let rows = recording.below(&["series", plot]).into_iter().filter(|row| !row.times.is_empty());
    rows.map(|row| (row.path[2..].join("|"), row.components.scalar())).collect()
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found} is not {expected} (tolerance {tolerance})");
}

#[test]
fn times_and_counts_are_those_of_the_diagnostics() {
    for method in ContactMethod::ALL {
        let mut recorded = Recorded::new(only_series());
        let scene = Scene::spawn(&mut recorded.app, method);
        let (mut times, mut counts) = (0, 0);
        for tick in 0..4 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            let diagnostics = recorded.app.world().resource::<DetectionDiagnostics>();
            let milliseconds = curves(&recorded.last, "milliseconds");
            for stage in &diagnostics.stages {
                assert_eq!(milliseconds[stage.name], stage.duration.as_secs_f64() * 1.0e3, "{}", stage.name);
                times += 1;
            }
            // A stage that only pairs at rest would need does not run.
            let ran = |name: &String| diagnostics.stages.iter().any(|stage| stage.name == name);
            let others = milliseconds.iter().filter(|(name, _)| !ran(name) && *name != "recording");
            assert!(others.clone().all(|(_, &time)| time == 0.0), "{:?}", others.collect::<Vec<_>>());
            assert_eq!(milliseconds["recording"] > 0.0, tick > 0, "the time that recording the previous tick took");
            let found = curves(&recorded.last, "counts");
            assert_eq!(found["examined"], diagnostics.pairs_examined as f64);
            assert_eq!(found["recipes refreshed"], diagnostics.recipes_refreshed as f64);
            for stage in diagnostics.stages.iter().filter(|stage| stage.pairs_out > 0 && stage.name != "pair surfaces")
            {
                let curve =
                    if stage.name == "contacts" { "contacts".to_owned() } else { format!("after {}", stage.name) };
                assert_eq!(found[&curve], stage.pairs_out as f64);
                counts += 1;
            }
            let contacts = contacts(&mut recorded.app).len() as f64;
            assert_eq!(found["contacts"], contacts, "{method:?}");
        }
        assert!(times >= 16 && counts >= 8, "{method:?}: {times} times, {counts} counts");
    }
}

#[test]
fn a_stage_that_did_not_run_falls_to_zero() {
    let mut recorded = Recorded::new(only_series());
    let app = &mut recorded.app;
    spawn(app, "below", &sheet(3), (THIN, ContactMethod::Circumsphere));
    let above =
        spawn(app, "above", &sheet(3), (THIN, ContactMethod::Circumsphere, Transform::from_xyz(0.1, 0.03, 0.1)));
    recorded.tick();
    let counts = curves(&recorded.last, "counts");
    assert!(counts["after broad phase"] > 10.0 && counts["after cone"] > 0.0, "{counts:?}");
    assert!(curves(&recorded.last, "milliseconds")["refit"] > 0.0);
    place(&mut recorded.app, above, |transform| transform.translation.y = 5.0);
    recorded.tick();
    let after = curves(&recorded.last, "counts");
    assert_eq!(after.keys().collect::<Vec<_>>(), counts.keys().collect::<Vec<_>>());
    assert!(after.values().all(|&count| count == 0.0), "{after:?}");
    assert_eq!(curves(&recorded.last, "milliseconds")["refit"], 0.0);
}

/// The normal of each contact of a tick.
type Normals = BTreeMap<([Entity; 2], ContactKey), Vec3>;

#[test]
fn churn_and_normal_jump_are_those_between_two_ticks() {
    for method in ContactMethod::ALL {
        let mut recorded = Recorded::new(only_series());
        let scene = Scene::spawn(&mut recorded.app, method);
        let mut last = Normals::new();
        let (mut churned, mut turned) = (0, 0);
        for tick in 0..6 {
            scene.advance(&mut recorded.app, tick);
            if tick == 4 {
                place(&mut recorded.app, scene.ball, |transform| transform.translation.x += 0.1);
            }
            recorded.tick();
            let now: Normals = contacts(&mut recorded.app)
                .iter()
                .map(|contact| ((contact.sides, contact.key), contact.normal))
                .collect();
            let both: Vec<(Vec3, Vec3)> =
                last.iter().filter_map(|(name, &then)| Some((then, *now.get(name)?))).collect();
            let either = last.len() + now.len() - both.len();
            let churn = (either - both.len()) as f64 / either as f64;
            let jump = both.iter().map(|(then, now)| {
                let (then, now) = (then.as_dvec3(), now.as_dvec3());
                then.cross(now).length().atan2(then.dot(now)) / std::f64::consts::TAU
            });
            let jump = jump.fold(0.0, f64::max);
            let steadiness = curves(&recorded.last, "steadiness");
            assert_close(steadiness["contact churn"], churn, 1.0e-12, "churn");
            // The arc cosine of f32 unit vectors keeps half of their digits where they agree.
            assert_close(steadiness["normal jump in turns"], jump, 1.0e-4, "normal jump");
            churned += usize::from(churn > 0.0 && churn < 1.0);
            turned += usize::from(jump > 1.0e-3);
            last = now;
        }
        assert!(churned >= 3 && turned >= 2, "{method:?}: {churned} churned, {turned} turned");
    }
}

#[test]
fn jitter_of_an_oscillation_is_four_times_its_amplitude() {
    const AMPLITUDE: f32 = 1.0 / 256.0;
    let mut recorded = Recorded::new(only_series());
    let app = &mut recorded.app;
    // Edges along x and z are 0.25 long, and diagonals √2 times as long.
    spawn(app, "resting", &sheet(8), THIN);
    let shaken =
        spawn(app, "shaken", &sheet(8), (THIN, Transform::from_xyz(0.0, 0.03, 0.0).with_scale(Vec3::splat(2.0))));
    let mean_edge = {
        let (straight, diagonal) = (2.0 * 8.0 * 9.0, 64.0);
        2.0 * 0.25 * (straight + diagonal * 2.0_f64.sqrt()) / (straight + diagonal)
    };
    let mut compared = 0;
    for tick in 0..8 {
        let side = if tick % 2 == 0 { AMPLITUDE } else { -AMPLITUDE };
        move_positions(&mut recorded.app, shaken, |position| Vec3::new(position.x, side, position.z));
        recorded.tick();
        let steadiness = curves(&recorded.last, "steadiness");
        let (resting, shaken) = (steadiness.get("jitter of resting"), steadiness.get("jitter of shaken"));
        // The motion from one side to the other, in units of twice the thickness. Both are rounded to f32.
        let way = if tick == 0 { 0.0 } else { 2.0 * 2.0 * f64::from(AMPLITUDE) / (2.0 * f64::from(THICKNESS)) };
        assert_close(curves(&recorded.last, "motion")["largest motion"], way, 1.0e-6 * way, "motion");
        if tick < 2 {
            assert_eq!((resting, shaken), (None, None), "two ticks are not enough");
        } else {
            assert_eq!(resting, Some(&0.0));
            // The motion is twice as large as in the surface's own frame. Positions are exact in f32, and the mean edge
            // is rounded to f32.
            let expected = 4.0 * 2.0 * f64::from(AMPLITUDE) / mean_edge;
            assert_close(*shaken.expect("the bodies touch"), expected, 1.0e-6 * expected, "jitter");
            assert_close(steadiness["largest jitter"], expected, 1.0e-6 * expected, "largest jitter");
            compared += 1;
        }
    }
    assert_eq!(compared, 6);
}

#[test]
fn a_jump_that_was_announced_is_no_jitter() {
    let mut recorded = Recorded::new(only_series());
    let app = &mut recorded.app;
    spawn(app, "resting", &sheet(8), THIN);
    let jumping = spawn(app, "jumping", &sheet(4), (THIN, Transform::from_xyz(0.0, 0.03, 0.0)));
    for tick in 0..10 {
        if tick == 4 {
            recorded.app.world_mut().entity_mut(jumping).insert(Teleported);
            place(&mut recorded.app, jumping, |transform| transform.translation.x += 0.5);
        }
        recorded.tick();
        let steadiness = curves(&recorded.last, "steadiness");
        let jitter = steadiness.get("jitter of jumping").copied();
        assert!(tick < 2 || jitter.is_some(), "it touches from the first tick on");
        assert_eq!(jitter.unwrap_or(0.0), 0.0, "at {tick}");
        assert_eq!(steadiness["largest jitter"], 0.0, "at {tick}");
    }
}

#[test]
fn curves_know_nothing_of_the_time_before_they_were_switched_on_again() {
    let mut recorded = Recorded::new(only_series());
    let app = &mut recorded.app;
    spawn(app, "resting", &sheet(8), THIN);
    let above = spawn(app, "above", &sheet(4), (THIN, Transform::from_xyz(0.0, 0.03, 0.0)));
    for _ in 0..4 {
        recorded.tick();
    }
    assert_eq!(curves(&recorded.last, "steadiness")["contact churn"], 0.0);
    recorded.settings().series = false;
    recorded.tick();
    assert!(recorded.last.below(&["series"]).is_empty());
    place(&mut recorded.app, above, |transform| transform.translation.x += 0.37);
    recorded.tick();
    recorded.tick();
    recorded.settings().series = true;
    for tick in 0..4 {
        recorded.tick();
        let steadiness = curves(&recorded.last, "steadiness");
        assert_eq!(steadiness["largest jitter"], 0.0, "{tick} ticks later");
        // As in the very first tick, all contacts are new.
        assert_eq!(steadiness["contact churn"], if tick == 0 { 1.0 } else { 0.0 }, "{tick} ticks later");
        assert_eq!(steadiness["normal jump in turns"], 0.0, "{tick} ticks later");
    }
}

/// The surface that a response pushes, and how far.
#[derive(Resource)]
struct Push(Entity, Vec3);

fn push(push: Res<Push>, mut positions: Query<&mut SurfacePositions>) {
    for position in &mut positions.get_mut(push.0).expect("the entity is a surface").0 {
        *position += push.1;
    }
}

#[test]
fn overlap_left_is_what_a_response_has_not_pushed_out() {
    // A sheet over a floor, deeper in it at one side. Lengths are in the sheet's frame, which is half as large.
    for (pushed, with_pose) in [(0.0, false), (0.01, false), (0.05, false), (-0.02, false), (0.04, true)] {
        let mut recorded = Recorded::with(only_series(), DeformableCollisionPlugins::new(Update), |app| {
            app.add_systems(Update, push.in_set(DeformableSystems::Respond));
        });
        let app = &mut recorded.app;
        spawn_shape(app, "floor", SharedShape::halfspace(Vec3::Y), ());
        let scale = if with_pose { 0.5 } else { 1.0 };
        let transform = Transform::from_xyz(0.0, -0.01, 0.0).with_scale(Vec3::splat(scale));
        let upper = spawn(app, "upper", &sheet(2), (SurfaceThickness::World(0.03), transform));
        move_positions(app, upper, |position| Vec3::new(position.x, 0.005 * position.x / scale, position.z));
        app.insert_resource(Push(upper, Vec3::new(0.0, pushed / scale, 0.0)));
        recorded.tick();
        let depths = curves(&recorded.last, "depths");
        // The deepest vertex is at −0.015, and the contact distance is 0.03.
        let (distance, tolerance) = (-0.015, 8.0 * f64::from(f32::EPSILON));
        let pushed = f64::from(pushed);
        assert_close(depths["penetration found"], -distance, tolerance, "penetration found");
        assert_close(depths["overlap found"], 0.03 - distance, tolerance, "overlap found");
        assert_close(depths["penetration left"], (-distance - pushed).max(0.0), tolerance, "penetration left");
        assert_close(depths["overlap left"], (0.03 - distance - pushed).max(0.0), tolerance, "overlap left");
    }
}

#[test]
fn both_sides_of_a_contact_and_every_vertex_by_its_share_count_for_what_is_left() {
    // Two sheets. The vertices of the upper one lie above the inside of the lower one's triangles. Both move, and
    // together they remove half of the overlap.
    #[derive(Resource)]
    struct Both([(Entity, Vec3); 2]);
    fn part(both: Res<Both>, mut positions: Query<&mut SurfacePositions>) {
        for (entity, push) in both.0 {
            for position in &mut positions.get_mut(entity).expect("the entity is a surface").0 {
                *position += push;
            }
        }
    }
    let mut recorded = Recorded::with(only_series(), DeformableCollisionPlugins::new(Update), |app| {
        app.add_systems(Update, part.in_set(DeformableSystems::Respond));
    });
    let app = &mut recorded.app;
    let lower = spawn(app, "lower", &sheet(3), SurfaceThickness::World(0.03));
    let upper = spawn(app, "upper", &sheet(2), (SurfaceThickness::World(0.03), Transform::from_xyz(0.11, 0.04, 0.07)));
    app.insert_resource(Both([(lower, Vec3::new(0.0, -0.004, 0.0)), (upper, Vec3::new(0.0, 0.006, 0.0))]));
    recorded.tick();
    assert!(contacts(&mut recorded.app).len() > 8);
    let depths = curves(&recorded.last, "depths");
    // Slanted contacts are farther apart and open by less, so none of them is the deepest.
    let tolerance = 16.0 * f64::from(f32::EPSILON);
    assert_close(depths["overlap found"], 0.02, tolerance, "overlap found");
    assert_close(depths["overlap left"], 0.01, tolerance, "overlap left");
    assert_eq!((depths["penetration found"], depths["penetration left"]), (0.0, 0.0));
}

#[test]
fn curves_of_surfaces_that_are_gone_end() {
    let mut recorded = Recorded::new(only_series());
    spawn(&mut recorded.app, "resting", &sheet(4), THIN);
    let (mut rows, mut jitters) = (Vec::new(), 0);
    for number in 0..10 {
        let at = Transform::from_xyz(0.0, 0.03, 0.0);
        let passing = spawn(&mut recorded.app, &format!("passing {number}"), &sheet(2), (THIN, at));
        for _ in 0..4 {
            recorded.tick();
            let curves = curves(&recorded.last, "steadiness");
            jitters += usize::from(curves.contains_key(&format!("jitter of passing {number}")));
        }
        rows.push(curves(&recorded.last, "steadiness").len());
        recorded.app.world_mut().despawn(passing);
    }
    assert!(jitters >= 20, "only {jitters} jitter values");
    assert!(rows.iter().all(|&count| count == rows[0]), "the number of curves grows: {rows:?}");
}

#[test]
fn every_curve_has_one_value_a_tick_and_its_name_once() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
    let mut named = BTreeMap::new();
    for tick in 0..5 {
        scene.advance(&mut recorded.app, tick);
        recorded.tick();
        let mut values = BTreeMap::new();
        for row in recorded.last.below(&["series"]) {
            let of = if row.times.is_empty() { &mut named } else { &mut values };
            *of.entry(row.path.clone()).or_insert(0) += 1;
            if row.times.is_empty() {
                assert_eq!(row.components.texts("SeriesLines:names"), [row.path[2].clone()]);
                assert_eq!(row.components.wholes("SeriesLines:colors").len(), 1);
            }
        }
        assert!(values.len() > 20 && values.values().chain(named.values()).all(|&count| count == 1));
        assert!(values.keys().eq(named.keys()), "a curve without a name, or without a value");
    }
}
