//! Contacts in the recording match those of the store, value by value, in the tick at which they are shown.

use std::collections::{BTreeMap, BTreeSet};

use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, icosphere};
use glam::Vec3;

use crate::{
    recording::{Components, Path, bits, path},
    world::{
        Made, Recorded, Scene, Seen, THIN, by_pair, contacts, everything, place, sheet, spawn, spawn_shape,
        world_affine,
    },
};

/// The mean length of a mesh's edges, each counted once.
fn mean_edge(mesh: &Mesh) -> f64 {
    let edges: BTreeSet<[u32; 2]> = mesh
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    let point = |vertex: u32| Vec3::from_array(mesh.positions[vertex as usize]).as_dvec3();
    edges.iter().map(|&[a, b]| point(a).distance(point(b))).sum::<f64>() / edges.len() as f64
}

#[track_caller]
fn assert_numbers(components: &Components, contacts: &[&Seen]) {
    let of = |number: fn(&Seen) -> f32| contacts.iter().map(|contact| number(contact).to_bits()).collect::<Vec<_>>();
    let logged = |name: &str| components.floats(name).into_iter().map(f32::to_bits).collect::<Vec<_>>();
    assert_eq!(logged("distance"), of(|contact| contact.distance));
    assert_eq!(logged("separation"), of(|contact| contact.separation));
    for (side, name) in ["triangle_a", "triangle_b"].into_iter().enumerate() {
        let expected: Vec<Option<u32>> = contacts.iter().map(|contact| contact.triangles[side]).collect();
        assert_eq!(components.optional_wholes(name), expected);
    }
}

/// Counts of what was compared.
#[derive(Debug, Default)]
struct Tally {
    contacts: usize,
    of_itself: usize,
    with_shapes: usize,
    passed: usize,
    crossings: usize,
    near: usize,
}

/// Compares everything that is shown of contacts with the contacts of the tick.
fn compare(recorded: &mut Recorded, scene: &Scene, tally: &mut Tally) {
    let contacts = contacts(&mut recorded.app);
    let by_pair = by_pair(&contacts);
    let world = recorded.app.world();
    let mut expected_paths: BTreeSet<Path> = BTreeSet::new();
    let mut colors: BTreeMap<&str, BTreeSet<u32>> = BTreeMap::new();
    for (&[a, b], contacts) in &by_pair {
        let name = scene.pair_name(a, b);
        let points =
            recorded.viewer.of(&["contacts", "points", &name]).unwrap_or_else(|| panic!("{name} is not shown"));
        let first = bits(contacts.iter().map(|contact| contact.points[0].to_array()));
        assert_eq!(bits(points.vectors::<3>("Points3D:positions")), first, "{name}");
        assert_numbers(points, contacts);
        for (contact, color) in contacts.iter().zip(points.wholes("Points3D:colors")) {
            let class = match contact {
                contact if contact.has_passed() => "passed",
                contact if contact.separation <= 0.0 => "touching",
                _ => "near",
            };
            colors.entry(class).or_default().insert(color);
        }
        let normals = recorded.viewer.of(&["contacts", "normals", &name]).expect("the viewer shows it");
        assert_eq!(bits(normals.vectors::<3>("Arrows3D:origins")), first);
        let finer = [a, b]
            .into_iter()
            .filter_map(|side| Some((side, world.get::<Made>(side)?)))
            .map(|(side, made)| mean_edge(&made.0) * world_affine(world, side).matrix3.determinant().abs().cbrt())
            .fold(f64::INFINITY, f64::min);
        let arrows = normals.vectors::<3>("Arrows3D:vectors");
        assert_eq!(arrows.len(), contacts.len());
        for (arrow, contact) in arrows.into_iter().zip(contacts) {
            let expected = contact.normal.as_dvec3() * 0.5 * finer;
            // The mean edge, the scale of the pose, and each product are rounded to f32.
            assert!(
                Vec3::from_array(arrow).as_dvec3().distance(expected) < 1.0e-6 * finer,
                "{arrow:?} is not {expected}"
            );
        }
        expected_paths.extend([path(&["points", &name]), path(&["normals", &name])]);

        let (crossings, passed): (Vec<&Seen>, Vec<&Seen>) =
            contacts.iter().filter(|contact| contact.has_passed()).partition(|contact| contact.is_crossing);
        let shown = recorded.viewer.of(&["penetrations", "crossings", &name]);
        assert_eq!(shown.is_some(), !crossings.is_empty(), "{name}");
        if let Some(shown) = shown {
            let first = bits(crossings.iter().map(|contact| contact.points[0].to_array()));
            assert_eq!(bits(shown.vectors::<3>("Points3D:positions")), first);
            assert_numbers(shown, &crossings);
        }
        let shown = recorded.viewer.of(&["penetrations", "depths", &name]);
        assert_eq!(shown.is_some(), !passed.is_empty(), "{name}");
        if let Some(shown) = shown {
            let lines: Vec<Vec<[f32; 3]>> =
                passed.iter().map(|contact| contact.points.map(|point| point.to_array()).to_vec()).collect();
            assert_eq!(shown.strips(), lines);
            assert_numbers(shown, &passed);
        }
        tally.contacts += contacts.len();
        tally.of_itself += if a == b { contacts.len() } else { 0 };
        tally.with_shapes += contacts.iter().filter(|contact| contact.triangles[1].is_none()).count();
        tally.passed += passed.len();
        tally.crossings += crossings.len();
        tally.near += contacts.iter().filter(|contact| contact.separation > 0.0).count();
    }
    if !contacts.is_empty() {
        expected_paths.insert(path(&["deepest"]));
    }
    let found: BTreeSet<Path> = recorded.viewer.below(&["contacts"]).into_keys().collect();
    assert_eq!(found, expected_paths);
    // Each class has one color, and no two classes share a color.
    assert!(colors.values().all(|colors| colors.len() == 1), "{colors:x?}");
    assert_eq!(colors.values().flatten().collect::<BTreeSet<_>>().len(), colors.len(), "{colors:x?}");
}

#[test]
fn contacts_are_those_of_the_store_for_every_method() {
    for method in ContactMethod::ALL {
        let mut recorded = Recorded::new(everything());
        recorded.app.insert_resource(CircumsphereSettings { margin: 0.01, ..Default::default() });
        let scene = Scene::spawn(&mut recorded.app, method);
        let mut tally = Tally::default();
        for tick in 0..5 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            compare(&mut recorded, &scene, &mut tally);
        }
        let Tally { contacts, of_itself, with_shapes, passed, crossings, near } = tally;
        assert!(contacts > 500 && of_itself > 50 && with_shapes > 50 && near > 20, "{method:?}: {tally:?}");
        assert!(passed > 20, "{method:?}: {tally:?}");
        assert!(!method.is_exact() || crossings > 20, "{method:?}: {tally:?}");
    }
}

/// More labels could hide each other, as deep contacts are often close together.
#[test]
fn only_the_deepest_contact_has_a_label_with_its_separation() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    for tick in 0..3 {
        scene.advance(&mut recorded.app, tick);
        recorded.tick();
        let seen = contacts(&mut recorded.app);
        assert!(by_pair(&seen).len() > 3);
        let deepest = seen.iter().map(|contact| contact.separation).fold(f32::INFINITY, f32::min);
        let below = recorded.viewer.below(&[]);
        let labelled = below.values().filter(|row| row.has("Points3D:labels")).count();
        assert_eq!(labelled, 1);
        let shown = recorded.viewer.of(&["contacts", "deepest"]).expect("the viewer shows it");
        assert_eq!(shown.floats("separation"), [deepest]);
        let labels = shown.texts("Points3D:labels");
        assert_eq!((labels.len(), shown.vectors::<3>("Points3D:positions").len()), (1, 1));
        let label: f32 = labels[0].parse().expect("it is a number");
        // Labels have three digits.
        assert!((label - deepest).abs() <= 0.005 * deepest.abs(), "{label} is not {deepest}");
    }
}

#[test]
fn nothing_of_an_earlier_tick_is_left_in_a_tick_without_contacts() {
    let mut recorded = Recorded::new(everything());
    let app = &mut recorded.app;
    spawn(app, "sheet", &sheet(4), THIN);
    let ball = spawn(app, "ball", &icosphere(1, 0.3), (THIN, Transform::from_xyz(0.0, 0.2, 0.0)));
    spawn_shape(app, "post", SharedShape::ball(0.1), Transform::from_xyz(0.5, 0.0, 0.5));
    let of_a_tick = ["contacts", "penetrations", "pairs", "spheres", "cones"];
    let shown = |recorded: &Recorded| of_a_tick.map(|layer| recorded.viewer.below(&[layer]).len());
    recorded.tick();
    let [contacts_shown, penetrations, pairs, ..] = shown(&recorded);
    assert!(contacts_shown >= 5 && penetrations >= 1 && pairs >= 2);

    place(&mut recorded.app, ball, |transform| transform.translation.y = 9.0);
    let post = Name::new("post");
    let mut posts = recorded.app.world_mut().query::<(&Name, &mut Transform)>();
    for (name, mut transform) in posts.iter_mut(recorded.app.world_mut()) {
        if *name == post {
            transform.translation.y = -9.0;
        }
    }
    recorded.tick();
    assert_eq!(shown(&recorded), [0; 5]);
    assert!(recorded.last.clears().len() >= 6);
    recorded.tick();
    assert!(recorded.last.clears().is_empty(), "nothing is left to clear");

    place(&mut recorded.app, ball, |transform| transform.translation.y = 0.2);
    recorded.tick();
    assert!(shown(&recorded)[0] >= 3);
    let points = recorded.viewer.of(&["contacts", "points", "sheet with ball"]).expect("the surfaces touch again");
    assert!(points.has("Points3D:colors") && points.has("Points3D:radii"), "cleared components are logged again");
}

#[test]
fn pairs_whose_names_read_alike_are_not_mixed_up() {
    let mut recorded = Recorded::new(everything());
    let app = &mut recorded.app;
    // Ambiguous names: "a with b" with "c", and "a" with "b with c"; "d with itself", and "d" with "itself".
    let sets = [("a with b", "c"), ("a", "b with c"), ("d", "itself")];
    let mut pairs = Vec::new();
    for (place, (first, second)) in sets.into_iter().enumerate() {
        let at = |height: f32| Transform::from_xyz(0.0, 5.0 * place as f32 + height, 0.0);
        let first = spawn(app, first, &sheet(2 + place), (THIN, at(0.0)));
        pairs.push([first, spawn(app, second, &sheet(2 + place), (THIN, at(0.03)))]);
    }
    let folded = crate::world::crumpled();
    app.world_mut().entity_mut(pairs[2][0]).despawn();
    let at = |height: f32| Transform::from_xyz(0.0, 10.0 + height, 0.0);
    spawn(app, "d", &folded, (THIN, SelfCollision, at(0.0)));
    recorded.tick();
    let contacts = contacts(&mut recorded.app);
    let found = by_pair(&contacts);
    assert_eq!(found.len(), 4, "{:?}", found.keys());
    let points = recorded.last.below(&["contacts", "points"]);
    let paths: BTreeSet<&Path> = points.iter().map(|row| &row.path).collect();
    assert_eq!(points.len(), found.len());
    assert_eq!(paths.len(), found.len(), "pairs share a path: {paths:?}");
    let shown: usize = recorded
        .viewer
        .below(&["contacts", "points"])
        .values()
        .map(|shown| shown.vectors::<3>("Points3D:positions").len())
        .sum();
    assert_eq!(shown, contacts.len());
}

/// If there are many pairs, each row covers all of them, and each instance names its pair.
#[test]
fn of_many_pairs_of_surfaces_there_is_one_entity_that_names_them() {
    let mut recorded = Recorded::new(everything());
    let app = &mut recorded.app;
    spawn(app, "floor", &sheet(16), THIN);
    for number in 0..60 {
        let place = Transform::from_xyz(0.25 * (number % 8) as f32 - 0.9, 0.03, 0.25 * (number / 8) as f32 - 0.9);
        spawn(app, &format!("tile {number}"), &sheet(1), (THIN, place.with_scale(Vec3::splat(0.05))));
    }
    recorded.tick();
    let seen = contacts(&mut recorded.app);
    let by_pair = by_pair(&seen);
    assert!(by_pair.len() >= 55, "{} pairs", by_pair.len());
    let points = recorded.viewer.of(&["contacts", "points", "all pairs"]).expect("the viewer shows them");
    let mut shown: Vec<(String, u32)> =
        points.texts("pair").into_iter().zip(points.floats("separation").iter().map(|value| value.to_bits())).collect();
    let world = recorded.app.world();
    let named = |contact: &Seen| {
        let [a, b] = contact.sides.map(|side| world.get::<Name>(side).expect("the entity has a name"));
        (format!("{a} with {b}"), contact.separation.to_bits())
    };
    let mut expected: Vec<(String, u32)> = seen.iter().map(named).collect();
    shown.sort_unstable();
    expected.sort_unstable();
    assert_eq!(shown, expected);
    assert_eq!(recorded.viewer.below(&["contacts", "points"]).len(), 1);
    let touching = recorded.viewer.of(&["pairs", "touching", "all pairs"]).expect("the viewer shows them");
    assert_eq!(touching.texts("pair").len(), touching.wholes("triangle_a").len());
    assert!(touching.texts("pair").len() >= 55);
}
