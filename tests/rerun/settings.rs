//! Settings have their documented effect, also when they change while the app runs.

use std::collections::BTreeSet;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    SurfaceDetectionSystems,
    debug::{LevelOfDetail, RerunSettings},
    prelude::*,
};
use bevy_ecs::prelude::*;
use glam::Vec3;

use crate::{
    recording::bits,
    world::{Recorded, Scene, contacts, everything, nothing, positions},
};

#[test]
fn layers_are_recorded_every_so_many_ticks_and_then_as_they_are() {
    for (every, expected) in
        [(0, vec![1, 2, 3, 4, 5, 6, 7]), (1, vec![1, 2, 3, 4, 5, 6, 7]), (3, vec![3, 6]), (9, vec![])]
    {
        let mut recorded = Recorded::new(RerunSettings { every, ..everything() });
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        let mut ticks = Vec::new();
        for tick in 1..=7 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            let layers: Vec<&str> = recorded.last.layers().into_iter().filter(|&layer| layer != "log").collect();
            if layers.is_empty() {
                assert!(recorded.last.clears().is_empty());
                continue;
            }
            ticks.push(tick);
            let timed = recorded.last.rows.iter().filter(|row| !row.times.is_empty());
            assert!(timed.clone().count() > 40 && timed.clone().all(|row| row.tick() == i64::from(tick)));
            for (name, entity) in scene.surfaces() {
                let shown = recorded.viewer.of(&["meshes", name]).expect("the viewer shows it");
                let expected = bits(positions(recorded.app.world(), entity).iter().map(Vec3::to_array));
                assert_eq!(bits(shown.vectors::<3>("Mesh3D:vertex_positions")), expected);
            }
            let shown = recorded.viewer.below(&["contacts", "points"]);
            let shown: usize = shown.values().map(|shown| shown.floats("distance").len()).sum();
            assert_eq!(shown, contacts(&mut recorded.app).len());
        }
        assert_eq!(ticks, expected, "every {every}");
    }
}

#[test]
fn what_leaves_between_recorded_ticks_is_gone_in_the_next_one() {
    let mut recorded = Recorded::new(RerunSettings { every: 3, ..everything() });
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
    for _ in 0..4 {
        recorded.tick();
    }
    let shows = |recorded: &Recorded| recorded.viewer.0.keys().filter(|path| path.join(" ").contains("ball")).count();
    assert!(shows(&recorded) > 5);
    recorded.app.world_mut().despawn(scene.ball);
    recorded.tick();
    assert!(recorded.last.clears().is_empty(), "this tick is not recorded");
    recorded.tick();
    let left: Vec<_> =
        recorded.viewer.0.keys().filter(|path| path[0] != "series" && path.join(" ").contains("ball")).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// A layer, and how to switch it off.
type Switch = (&'static str, fn(&mut RerunSettings));

const SWITCHES: [Switch; 11] = [
    ("series", |settings| settings.series = false),
    ("meshes", |settings| settings.meshes = LevelOfDetail::Off),
    ("shapes", |settings| settings.shapes = false),
    ("contacts", |settings| settings.contacts = false),
    ("penetrations", |settings| settings.penetrations = false),
    ("pairs", |settings| settings.pairs = LevelOfDetail::Off),
    ("spheres", |settings| settings.spheres = LevelOfDetail::Off),
    ("cones", |settings| settings.cones = LevelOfDetail::Off),
    ("curvature", |settings| settings.curvature = LevelOfDetail::Off),
    ("recipe_age", |settings| settings.recipe_age = LevelOfDetail::Off),
    ("tree", |settings| settings.tree_levels = 0),
];

#[test]
fn each_layer_can_be_left_out_and_no_other_goes_with_it() {
    let layers = |settings: RerunSettings| -> BTreeSet<String> {
        let mut recorded = Recorded::new(settings);
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        let mut layers = BTreeSet::new();
        for tick in 0..2 {
            scene.advance(&mut recorded.app, tick);
            layers.extend(recorded.tick().layers().into_iter().map(str::to_owned));
        }
        layers.retain(|layer| !layer.is_empty() && layer != "log");
        layers
    };
    let all = layers(everything());
    assert_eq!(all, SWITCHES.iter().map(|&(layer, _)| layer.to_owned()).collect());
    for (layer, switch_off) in SWITCHES {
        let mut settings = everything();
        switch_off(&mut settings);
        let mut expected = all.clone();
        expected.remove(layer);
        assert_eq!(layers(settings), expected, "without {layer}");
    }
    assert!(layers(nothing()).is_empty());
}

#[test]
fn a_layer_that_is_switched_off_leaves_and_comes_back() {
    for (layer, switch_off) in SWITCHES.into_iter().filter(|&(layer, _)| layer != "series") {
        let mut recorded = Recorded::new(everything());
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        scene.advance(&mut recorded.app, 0);
        recorded.tick();
        let before = recorded.viewer.below(&[layer]).len();
        assert!(before > 0, "{layer}");
        switch_off(&mut recorded.settings());
        for _ in 0..2 {
            recorded.tick();
            assert!(recorded.viewer.below(&[layer]).is_empty(), "{layer} stays");
        }
        *recorded.settings() = everything();
        recorded.tick();
        assert_eq!(recorded.viewer.below(&[layer]).len(), before, "{layer}");
        assert!(recorded.viewer.of(&["meshes", "sheet"]).is_some_and(|mesh| mesh.has("Mesh3D:triangle_indices")));
    }
}

#[test]
fn the_default_is_what_its_documentation_says() {
    let RerunSettings {
        every,
        bytes_per_tick,
        series,
        times,
        meshes,
        shapes,
        contacts,
        penetrations,
        patches,
        tetrahedra,
        pairs,
        spheres,
        cones,
        curvature,
        recipe_age,
        tree_levels,
        cells,
    } = RerunSettings::default();
    assert_eq!((every, bytes_per_tick, tree_levels), (1, 4_000_000, 4));
    assert!(series && times && shapes && contacts && penetrations);
    assert_eq!((meshes, recipe_age), (LevelOfDetail::All, LevelOfDetail::Off));
    assert_eq!([patches, tetrahedra, pairs, spheres, cones, curvature, cells], [LevelOfDetail::NearContacts; 7]);
}

/// A change that a game makes to a surface at some moment within a tick.
#[derive(Resource, Clone, Copy)]
struct Mischief(fn(&mut World));

fn do_mischief(world: &mut World) {
    if let Some(&Mischief(mischief)) = world.get_resource() {
        mischief(world);
    }
}

/// The ball, which rests on a shape.
fn ball_of(world: &mut World) -> Entity {
    let mut names = world.query::<(Entity, &Name)>();
    names.iter(world).find(|(_, name)| name.as_str() == "ball").expect("the entity exists").0
}

#[test]
fn surfaces_that_change_within_a_tick_are_recorded_without_a_panic_or_a_wrong_row() {
    const DEEDS: [fn(&mut World); 5] = [
        |world| {
            let ball = ball_of(world);
            world.despawn(ball);
        },
        |world| {
            let ball = ball_of(world);
            world.get_mut::<SurfacePositions>(ball).expect("the entity is a surface").0.truncate(7);
        },
        |world| {
            let ball = ball_of(world);
            world.get_mut::<SurfacePositions>(ball).expect("the entity is a surface").0.extend([Vec3::NAN; 9]);
        },
        |world| {
            let ball = ball_of(world);
            world.entity_mut(ball).remove::<DeformableSurface>().remove::<SurfacePositions>();
        },
        |world| {
            let ball = ball_of(world);
            world.get_mut::<SurfacePositions>(ball).expect("the entity is a surface").0.fill(Vec3::NAN);
        },
    ];
    for (number, deed) in DEEDS.into_iter().enumerate() {
        for moment in [0, 1, 2] {
            let mut recorded = Recorded::with(everything(), DeformableCollisionPlugins::new(Update), |app| {
                match moment {
                    0 => app.add_systems(Update, do_mischief.in_set(DeformableSystems::Predict)),
                    1 => app.add_systems(Update, do_mischief.in_set(DeformableSystems::Respond)),
                    // After detection, before anything of it is recorded.
                    _ => app.add_systems(
                        bevy_circumsphere::SurfaceDetection,
                        do_mischief.after(SurfaceDetectionSystems::Contacts),
                    ),
                };
            });
            let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
            recorded.tick();
            let on = bevy_transform::components::Transform::from_xyz(0.1, 0.3, 0.2);
            crate::world::spawn_shape(&mut recorded.app, "rest", SharedShape::ball(0.1), on);
            let of_ball = |recorded: &Recorded| {
                recorded.last.rows.iter().filter(|row| row.path.join(" ").contains("ball")).count()
            };
            assert!(of_ball(&recorded) > 8, "the ball takes part");
            recorded.tick();
            assert!(recorded.viewer.of(&["contacts", "points", "ball with rest"]).is_some());
            scene.advance(&mut recorded.app, 1);
            recorded.app.insert_resource(Mischief(deed));
            recorded.tick();
            recorded.app.world_mut().remove_resource::<Mischief>();
            let shown = recorded.viewer.below(&["contacts", "points"]);
            let shown: usize = shown.values().map(|shown| shown.floats("distance").len()).sum();
            assert_eq!(shown, contacts(&mut recorded.app).len(), "deed {number} at {moment}");
            for normals in recorded.viewer.below(&["contacts", "normals"]).values() {
                let arrows = normals.vectors::<3>("Arrows3D:vectors");
                let is_right = |arrow: &[f32; 3]| Vec3::from_array(*arrow).is_finite();
                assert!(arrows.iter().all(is_right), "deed {number} at {moment}: {arrows:?}");
            }
            let depths = recorded.last.below(&["series"]);
            let timed = depths.iter().filter(|row| !row.times.is_empty());
            assert!(timed.clone().count() > 10);
            for row in timed {
                assert!(row.components.scalar().is_finite(), "deed {number} at {moment}: {:?}", row.path);
            }
            recorded.tick();
            let shows_ball = recorded.viewer.below(&["meshes"]).into_keys().any(|path| path == ["ball"]);
            assert!(!shows_ball, "deed {number} at {moment}");
            assert!(recorded.viewer.of(&["meshes", "sheet"]).is_some());
        }
    }
}
