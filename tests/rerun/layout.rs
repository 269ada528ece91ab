//! The layout that travels with a recording: scene, log, and curves. Layers that would cover the rest are hidden.

use std::collections::{BTreeMap, BTreeSet};

use bevy_circumsphere::prelude::*;
use circumsphere_support::scenes::Mesh;
use glam::{
    Vec3,
    camera::rh::{proj::directx, view},
};
use rerun::{
    external::arrow::array::{Array, BooleanArray},
    log::LogMsg,
};

use crate::{
    recording::{Recording, Row},
    world::{Recorded, Scene, THIN, everything, sheet, spawn},
};

fn recorded_layout() -> Recording {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
    scene.advance(&mut recorded.app, 0);
    recorded.tick();
    std::mem::take(&mut recorded.last)
}

/// The rows of one kind of part, by the part's identifier.
fn parts<'a>(recording: &'a Recording, kind: &str) -> BTreeMap<String, &'a Row> {
    let own = recording.layout.iter().filter(|row| row.path.len() == 2 && row.path[0] == kind);
    own.map(|row| (row.path[1].clone(), row)).collect()
}

#[test]
fn the_layout_is_activated_once_and_comes_before_anything_is_shown() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    let mut activations = 0;
    for tick in 0..4 {
        scene.advance(&mut recorded.app, tick);
        recorded.tick();
        assert_eq!(recorded.last.layout.is_empty(), tick > 0, "the layout is sent once, in the first tick");
        let stores: BTreeSet<String> = recorded
            .last
            .messages
            .iter()
            .filter(|message| message.store_id().is_blueprint())
            .map(|message| message.store_id().recording_id().to_string())
            .collect();
        for message in &recorded.last.messages {
            if let LogMsg::BlueprintActivationCommand(activation) = message {
                assert!(activation.make_active && activation.make_default);
                assert!(activation.blueprint_id.is_blueprint());
                assert_eq!(stores, BTreeSet::from([activation.blueprint_id.recording_id().to_string()]));
                activations += 1;
            }
        }
        let applications: BTreeSet<String> =
            recorded.last.messages.iter().map(|message| message.store_id().application_id().to_string()).collect();
        assert!(applications.len() <= 1, "the layout belongs to the recording's application: {applications:?}");
    }
    assert_eq!(activations, 1);
}

#[test]
fn there_is_a_scene_a_log_and_curves_and_every_part_stands_in_the_layout() {
    let recording = recorded_layout();
    let views = parts(&recording, "view");
    let class = |row: &Row| row.components.texts("ViewBlueprint:class_identifier")[0].clone();
    let mut classes: BTreeMap<String, usize> = BTreeMap::new();
    for row in views.values() {
        *classes.entry(class(row)).or_default() += 1;
        assert!(!row.components.texts("ViewBlueprint:display_name")[0].is_empty());
    }
    assert_eq!((classes["3D"], classes["TextLog"]), (1, 1));
    assert!(classes["TimeSeries"] >= 3, "{classes:?}");

    // Each view is reached once from the root.
    let containers = parts(&recording, "container");
    let children: Vec<String> =
        containers.values().flat_map(|row| row.components.texts("ContainerBlueprint:contents")).collect();
    let reached: BTreeSet<&str> = children.iter().map(|path| path.rsplit('/').next().expect("it has a part")).collect();
    let unescaped: BTreeSet<String> = reached.iter().map(|part| part.replace('\\', "")).collect();
    assert_eq!(children.len(), unescaped.len());
    let root: Vec<&String> = containers.keys().filter(|identifier| !unescaped.contains(*identifier)).collect();
    assert_eq!(root.len(), 1, "exactly one container is the root");
    assert!(views.keys().all(|identifier| unescaped.contains(identifier)));
    let viewport = recording.layout.iter().find(|row| row.path == ["viewport"]).expect("there is a viewport");
    assert!(viewport.components.has("ViewportBlueprint:root_container"));

    // Everything that a view refers to is recorded.
    let origins: Vec<String> =
        views.values().map(|row| row.components.texts("ViewBlueprint:space_origin")[0].clone()).collect();
    for origin in origins.iter().filter(|origin| *origin != "/" && *origin != "/log") {
        let parts: Vec<&str> = origin.trim_start_matches('/').split('/').collect();
        assert!(!recording.below(&parts).is_empty(), "nothing is recorded below {origin}");
    }
}

#[test]
fn layers_that_hide_the_rest_are_hidden_and_the_others_are_not() {
    let recording = recorded_layout();
    let mut hidden = BTreeSet::new();
    for row in &recording.layout {
        if let Some(visible) = row.components.0.get("EntityBehavior:visible") {
            let visible = visible.as_any().downcast_ref::<BooleanArray>().expect("the value is a boolean");
            assert_eq!((visible.len(), visible.value(0)), (1, false));
            let overrides = row.path.iter().position(|part| part == "overrides").expect("the row is an override");
            assert_eq!(row.path.last().map(String::as_str), Some("visualizers"));
            hidden.insert(row.path[overrides + 1].clone());
        }
    }
    let expected = ["pairs", "spheres", "cones", "curvature", "recipe_age", "tree", "cells"].map(str::to_owned);
    assert_eq!(hidden, BTreeSet::from(expected));
    // Only a hash has cells.
    hidden.remove("cells");
    assert!(hidden.iter().all(|layer| recording.layers().contains(&layer.as_str())));
    assert!(["meshes", "contacts", "penetrations", "shapes"].iter().all(|layer| recording.layers().contains(layer)));
}

#[test]
fn the_eye_looks_at_the_surfaces_though_they_come_late() {
    for empty_ticks in [0, 3] {
        let mut recorded = Recorded::new(everything());
        let mut layout = Vec::new();
        for _ in 0..empty_ticks {
            layout.append(&mut recorded.tick().layout.clone());
        }
        let at = bevy_transform::components::Transform::from_xyz(300.0, 20.0, -7.0);
        spawn(&mut recorded.app, "far", &sheet(2), (THIN, at));
        layout.append(&mut recorded.tick().layout.clone());
        let eyes: Vec<&Row> =
            layout.iter().filter(|row| row.path.last().is_some_and(|part| part == "EyeControls3D")).collect();
        assert_eq!(eyes.len(), 1, "after {empty_ticks} empty ticks");
        let target = eyes[0].components.vectors::<3>("EyeControls3D:look_target")[0];
        let position = eyes[0].components.vectors::<3>("EyeControls3D:position")[0];
        let (target, position) = (Vec3::from_array(target), Vec3::from_array(position));
        // The box of the sheet is grown by its thickness, equally on all sides. The tolerance is that of f32 at 300.
        assert!(target.distance(Vec3::new(300.0, 20.0, -7.0)) < 1.0e-3, "{target}");
        let distance = target.distance(position);
        assert!((1.0..10.0).contains(&distance), "the sheet is 2.8 across, seen from {distance}");
    }
}

/// The viewer's default field of view is 55° high. Views of scenes are wider than high.
#[test]
fn the_eye_sees_the_whole_scene_and_is_not_farther_away_than_it_must_be() {
    for size in [Vec3::ONE, Vec3::new(20.0, 0.1, 20.0), Vec3::new(0.1, 30.0, 0.1), Vec3::new(100.0, 1.0, 2.0)] {
        let mut recorded = Recorded::new(everything());
        let place = Vec3::new(-3.0, 40.0, 5.0);
        let mesh = Mesh {
            positions: vec![
                (place - size).into(),
                (place + size).into(),
                (place + size * Vec3::new(1.0, -1.0, -1.0)).into(),
            ],
            triangles: vec![[0, 1, 2]],
        };
        spawn(&mut recorded.app, "box", &mesh, THIN);
        let layout = recorded.tick().layout.clone();
        let eye = layout.iter().find(|row| row.path.last().is_some_and(|part| part == "EyeControls3D"));
        let at = |name| Vec3::from(eye.expect("there is an eye").components.vectors::<3>(name)[0]);
        let (position, target) = (at("EyeControls3D:position"), at("EyeControls3D:look_target"));
        let view = view::look_at_mat4(position, target, Vec3::Y);
        let seen = directx::perspective(55.0_f32.to_radians(), 1.5, 1.0e-3, 1.0e4) * view;
        let corners = (0..8_u32).map(|corner| {
            let sign = |axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
            seen.project_point3(place + size * Vec3::new(sign(0), sign(1), sign(2)))
        });
        let outermost = corners.map(|corner| corner.x.abs().max(corner.y.abs())).fold(0.0, f32::max);
        assert!((0.8..1.0).contains(&outermost), "{size}: {outermost}");
    }
}
