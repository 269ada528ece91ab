//! A character that Bevy loads from glTF and animates: where its vertices are, and what touches what.

use std::path::{Path, PathBuf};

use bevy_app::App;
use bevy_circumsphere::{
    ContactStore, SurfaceDetection, SurfaceDetectionSystems,
    prelude::*,
    response::{XpbdGarment, XpbdTethers},
};
use bevy_ecs::prelude::*;
use circumsphere_gltf::{Cast, character_app, file, load, shoot};
use circumsphere_truth::{compare, exact_weld, touching_pairs_between_tree, touching_pairs_tree, triangles_cross};
use glam::{DVec3, Vec3};

fn assets() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets")
}

fn cast(garment: Option<&str>) -> Cast {
    Cast { skin: file::SKIN.to_owned(), garment: garment.map(str::to_owned) }
}

fn named(app: &mut App, wanted: &str) -> Entity {
    let mut surfaces = app.world_mut().query_filtered::<(Entity, &Name), With<DeformableSurface>>();
    let found = surfaces.iter(app.world()).find(|(_, name)| name.as_str() == wanted);
    found.unwrap_or_else(|| panic!("{wanted} is a surface")).0
}

#[test]
fn the_files_in_assets_are_those_that_the_code_makes() {
    let files: [(_, _, fn() -> Vec<u8>, _); 2] = [
        ("character.glb", "--make", file::character_file, [2, 1, 1]),
        ("person.glb", "--make-person", circumsphere_gltf::person_file, [2, 1, 2]),
    ];
    for (name, option, make, counts) in files {
        let committed = std::fs::read(assets().join(name)).expect("it is there");
        assert!(committed == make(), "run the program with `{option} assets/{name}`");
        // It is valid to a reader that is not Bevy's loader.
        let gltf = bevy_gltf::gltf::Gltf::from_slice(&committed).expect("valid");
        assert_eq!([gltf.meshes().count(), gltf.skins().count(), gltf.animations().count()], counts, "{name}");
    }
}

/// The truth is the formula that the file was made from, in f64.
#[test]
fn the_skin_is_where_the_animation_has_it() {
    let mut app = character_app(&assets(), cast(None));
    load(&mut app, "character.glb").expect("it can be loaded");
    let skin = named(&mut app, file::SKIN);
    let character = file::character();
    assert!(character.rest().triangles.len() >= 10_000);
    for tick in 1..=240 {
        app.update();
        let expected = character.positions(f64::from(tick) / 60.0);
        let found = &app.world().get::<SurfacePositions>(skin).expect("it is a surface").0;
        let farthest = expected.iter().zip(found).map(|(expected, found)| Vec3::from(*expected).distance(*found));
        let farthest = farthest.fold(0.0, f32::max);
        assert!(farthest < 5.0e-5, "tick {tick}: {farthest}");
    }
}

/// What the last detection of a tick has seen.
#[derive(Resource, Default)]
struct Seen(Vec<(Entity, Vec<DVec3>)>);

#[test]
fn contacts_are_those_of_the_truth_and_nothing_crosses() {
    let mut app = character_app(&assets(), cast(Some(file::SKIRT)));
    app.init_resource::<Seen>();
    app.add_systems(
        SurfaceDetection,
        (|mut seen: ResMut<Seen>, surfaces: Query<(Entity, &SurfacePositions)>| {
            let positions = |positions: &SurfacePositions| positions.0.iter().map(|at| at.as_dvec3()).collect();
            seen.0 = surfaces.iter().map(|(entity, at)| (entity, positions(at))).collect();
        })
        .before(SurfaceDetectionSystems::Bounds),
    );
    load(&mut app, "character.glb").expect("it can be loaded");
    let (skin, skirt) = (named(&mut app, file::SKIN), named(&mut app, file::SKIRT));
    let triangles = [skin, skirt].map(|entity| {
        app.world().get::<DeformableSurface>(entity).expect("it is a surface").topology().triangles().to_vec()
    });
    let mut matched = [0; 2];
    for tick in 1..=300 {
        app.update();
        if tick % 2 != 0 {
            continue;
        }
        let seen = &app.world().resource::<Seen>().0;
        let at = |entity: Entity| &seen.iter().find(|(other, _)| *other == entity).expect("it was seen").1;
        let store = app.world().resource::<ContactStore>();
        let found = |a: Entity, b: Entity| -> Vec<(u32, u32, f64)> {
            let pairs = store.pairs().iter().filter(|pair| {
                let sides = [pair.a.entity(), pair.b.entity()];
                sides == [a, b] || sides == [b, a]
            });
            pairs
                .flat_map(|pair| {
                    let turned = pair.a.entity() != a;
                    pair.touching.iter().map(move |touching| {
                        let (first, second) = (touching.triangle_a, touching.triangle_b);
                        let (first, second) = if turned { (second, first) } else { (first, second) };
                        (first, second, touching.distance)
                    })
                })
                .collect()
        };
        let distance = 0.008;
        let (band, reach) = (1.0e-4, distance * 1.01);
        let own = touching_pairs_tree(at(skirt), &triangles[1], &exact_weld(at(skirt)), reach);
        let other = touching_pairs_between_tree(at(skin), &triangles[0], at(skirt), &triangles[1], reach);
        for (place, (found, truth)) in [(found(skirt, skirt), own), (found(skin, skirt), other)].into_iter().enumerate()
        {
            let comparison = compare(&found, &truth, distance, band);
            assert!(comparison.is_exact(), "tick {tick}, {place}: {comparison:?}");
            matched[place] += comparison.matched;
        }
        let [skin_at, skirt_at] = [at(skin), at(skirt)];
        let corners = |at: &[DVec3], triangle: &[u32; 3]| triangle.map(|corner| at[corner as usize]);
        for pair in touching_pairs_between_tree(skin_at, &triangles[0], skirt_at, &triangles[1], 1.0e-9) {
            let a = corners(skin_at, &triangles[0][pair.triangle_a as usize]);
            let b = corners(skirt_at, &triangles[1][pair.triangle_b as usize]);
            assert!(!triangles_cross(&a, &b), "tick {tick}: {pair:?}");
        }
    }
    println!("{matched:?} pairs matched");
    // The leg swings against the skirt, and the skirt folds.
    assert!(matched.iter().all(|&count| count > 250), "{matched:?}");
}

/// What an artist paints in the file arrives: half of the skirt is pinned, and the other half is as without paint.
#[test]
fn paint_in_the_file_says_how_far_the_skirt_moves() {
    let (rings, segments) = file::SKIRT_SIZE;
    let paint: Vec<f32> =
        (0..(rings + 1) * segments).map(|vertex| if vertex % segments < segments / 2 { 0.0 } else { 0.4 }).collect();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    std::fs::write(folder.join("painted.glb"), file::painted_character_file(&paint)).expect("it can be written");
    let mut app = character_app(folder, cast(Some(file::SKIRT)));
    load(&mut app, "painted.glb").expect("it can be loaded");
    let skirt = named(&mut app, file::SKIRT);
    let tethers = &app.world().get::<XpbdTethers>(skirt).expect("it is worn").tethers;
    assert_eq!(tethers.len(), paint.len());
    for tether in tethers {
        assert_eq!(tether.longest, paint[tether.vertex.index()] * XpbdGarment::default().longest);
    }
}

/// The truth is the share of the leg from which the file was made. The skirt, which hangs before the thigh, has no joints.
#[test]
fn a_bullet_hits_the_joint_that_moves_the_place() {
    let mut app = character_app(&assets(), cast(None));
    load(&mut app, "character.glb").expect("it can be loaded");
    let (skin, skirt) = (named(&mut app, file::SKIN), named(&mut app, file::SKIRT));
    let character = file::character();
    let (mut torso, mut leg) = (0, 0);
    for tick in 0..60 {
        app.update();
        let shot = shoot(&mut app, file::SKIN, tick as f32 / 59.0).expect("there is a skin");
        if shot.hit.entity == skirt {
            assert_eq!(shot.joint, None, "tick {tick}");
            continue;
        }
        assert_eq!(shot.hit.entity, skin, "tick {tick}");
        let corners = character.rest().triangles[shot.hit.triangle.expect("a surface has triangles").index()];
        let shares = corners.map(|corner| character.leg_shares()[corner as usize] as f32);
        let share: f32 = shares.iter().zip(shot.hit.barycentric).map(|(share, weight)| share * weight).sum();
        if share > 0.5 {
            assert_eq!(shot.joint.as_deref(), Some("Leg"), "tick {tick}");
            leg += 1;
        } else if share < 0.5 {
            assert_eq!(shot.joint.as_deref(), Some("Torso"), "tick {tick}");
            torso += 1;
        }
    }
    assert!(torso > 15 && leg > 15, "{torso} {leg}");
}

#[test]
fn a_file_that_cannot_be_loaded_says_why() {
    let mut app = character_app(&assets(), cast(None));
    let message = load(&mut app, "cloth_fall.glb").expect_err("it is not there");
    assert!(message.contains("cloth_fall.glb"), "{message}");
}
