//! The contact methods and both broad phases on the same scenes.

use std::collections::BTreeSet;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ActiveSurfaces,
    detection::{BruteForceBroadPhasePlugin, CandidateTrianglePairs, OtherSide, PairFates, TreeBroadPhasePlugin},
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{cuboid, icosphere, merge, torus};
use glam::{Quat, Vec3};

use crate::world::{Called, THIN, app, app_in, at, fingerprint, insert, place, spawn, store};

/// An app whose broad phase compares every box with every other.
pub fn app_with_brute_force() -> App {
    let mut app = App::new();
    app.add_plugins((
        DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(),
        BruteForceBroadPhasePlugin,
    ));
    app
}

/// Two spheres that cross, one of them rotated.
fn crossing_spheres(app: &mut App, methods: [ContactMethod; 2]) -> [Entity; 2] {
    let turned = at(0.7, 0.3, 0.1).with_rotation(Quat::from_rotation_x(0.4));
    [
        spawn(app, &icosphere(2, 1.0), (THIN, methods[0], Called("first"))),
        spawn(app, &icosphere(2, 1.0), (THIN, methods[1], Called("second"), turned)),
    ]
}

fn touching_set(app: &App) -> BTreeSet<[u32; 2]> {
    store(app).touching().map(|pair| [pair.triangle_a, pair.triangle_b]).collect()
}

fn touching(method: [ContactMethod; 2]) -> BTreeSet<[u32; 2]> {
    let mut app = app();
    crossing_spheres(&mut app, method);
    app.update();
    touching_set(&app)
}

#[test]
fn exact_methods_agree_and_coarse_ones_enclose_them() {
    let [balls, caps, closest, refined, polygon] = ContactMethod::ALL.map(|method| touching([method; 2]));
    assert!(refined.len() > 100, "{} pairs touch", refined.len());
    assert_eq!(refined, polygon);
    assert_eq!(refined, closest);
    // A triangle lies in its enclosing ball, so touching triangles have touching balls.
    assert!(refined.is_subset(&balls), "{} are missing", refined.difference(&balls).count());
    assert!(balls.len() > refined.len());
    // Where bodies overlap deeply, their caps face the same way and no longer meet. The exact methods find the pairs
    // that the cone test misses.
    assert!(caps.len() < refined.len());
}

#[test]
fn offset_spheres_find_round_bodies_that_meet_face_to_face() {
    let touching = |method: ContactMethod| {
        let mut app = app();
        let [_, second] = crossing_spheres(&mut app, [method; 2]);
        let direction = Vec3::new(0.6, 0.48, 0.64);
        place(&mut app, second, direction * 1.96);
        app.update();
        touching_set(&app)
    };
    let (exact, caps) = (touching(ContactMethod::Polygon), touching(ContactMethod::Circumsphere));
    let found = caps.intersection(&exact).count();
    assert!(exact.len() > 20 && 2 * found > exact.len(), "{found} of {}", exact.len());
}

#[test]
fn exact_methods_give_the_same_contacts() {
    let contacts = |method: ContactMethod| {
        let mut app = app();
        crossing_spheres(&mut app, [method; 2]);
        app.update();
        fingerprint(&app)
    };
    assert_eq!(contacts(ContactMethod::Exact), contacts(ContactMethod::Polygon));
}

#[test]
fn of_two_methods_the_more_exact_one_decides() {
    for first in ContactMethod::ALL {
        for second in ContactMethod::ALL {
            assert_eq!(touching([first, second]), touching([first.max(second); 2]), "{first:?} and {second:?}");
        }
    }
}

#[test]
fn no_method_gives_anything_that_is_not_a_number() {
    for method in ContactMethod::ALL {
        for margin in [0.0, 0.3] {
            let mut app = app();
            app.insert_resource(CircumsphereSettings { margin, ..Default::default() });
            crossing_spheres(&mut app, [method; 2]);
            // Two bodies at the same place: concentric balls have no direction.
            spawn(&mut app, &icosphere(2, 1.0), (THIN, method, Called("twin")));
            // Triangles without area.
            let mut needle = cuboid([0.5, 0.5, 0.5], 1);
            needle.positions.iter_mut().for_each(|position| position[1] = 0.0);
            needle.positions[0] = needle.positions[1];
            spawn(&mut app, &needle, (THIN, method, SelfCollision, Called("flat")));
            for tick in 0..3 {
                app.update();
                let store = store(&app);
                assert!(
                    store.pairs().len() >= 2 && store.contact_count() > 10,
                    "{method:?}: {}",
                    store.contact_count()
                );
                for contact in store.contacts() {
                    let what = format!("{method:?} in tick {tick}: {contact:?}");
                    assert!(contact.distance.is_finite() && contact.point_b.is_finite(), "{what}");
                    assert!((contact.normal.length() - 1.0).abs() < 1.0e-5, "{what}");
                    for weights in [contact.barycentric_a, contact.barycentric_b] {
                        let last = 1.0 - weights[0] - weights[1];
                        assert!(
                            weights.iter().chain([&last]).all(|weight| (-1.0e-5..1.000_01).contains(weight)),
                            "{what}"
                        );
                    }
                }
                assert!(store.touching().all(|pair| pair.distance >= 0.0 && pair.distance.is_finite()));
            }
        }
    }
}

/// A surface against itself, surfaces with relative poses and either as the frame, and every kind of shape.
pub fn mixed_scene(app: &mut App, method: ContactMethod) {
    let tilted = Quat::from_rotation_x(0.6) * Quat::from_rotation_z(0.3);
    let two = merge(&[icosphere(1, 0.5), icosphere(1, 0.5).translate([0.4, 0.2, 0.1])]);
    let mut surface = |name, mesh, transform: Transform| {
        spawn(app, &mesh, (THIN, method, SelfCollision, Called(name), transform));
    };
    surface("spheres", two, Transform::default());
    surface("ring", torus(0.8, 0.2, 16, 8), at(0.2, 0.1, 0.0).with_rotation(tilted));
    surface("small box", cuboid([1.0, 1.0, 1.0], 1), at(0.5, 0.4, 0.1).with_scale(Vec3::splat(0.25)));
    surface("mirrored box", cuboid([0.3, 0.3, 0.3], 4), at(-0.4, 0.1, 0.2).with_scale(Vec3::new(-1.5, 1.5, 1.5)));
    surface("far below", icosphere(1, 1.0), at(0.0, -9.0, 0.0));
    let octahedron = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|corner| corner * 0.4);
    for (name, shape) in [
        ("ball", SharedShape::ball(0.4)),
        ("cuboid", SharedShape::cuboid(0.3, 0.2, 0.1)),
        ("capsule", SharedShape::capsule_y(0.3, 0.1)),
        ("hull", SharedShape::convex_hull(&octahedron).expect("an octahedron is convex")),
        ("half-space", SharedShape::halfspace(Vec3::new(0.6, 0.8, 0.0))),
        ("cylinder", SharedShape::cylinder(0.2, 0.3)),
    ] {
        let transform = at(0.3, -0.2, 0.1).with_rotation(tilted).with_scale(Vec3::splat(1.25));
        app.world_mut().spawn((RigidShape(shape), Called(name), transform));
    }
}

pub type Candidates = BTreeSet<(String, String, [u32; 2])>;

/// The candidate pairs, and the pairs that slabs dropped before they became candidates.
pub fn candidates(app: &mut App) -> [Candidates; 2] {
    let read = |fates: PairFates,
                candidates: Res<CandidateTrianglePairs>,
                active: Res<ActiveSurfaces>,
                names: Query<&Called>| {
        let name = |entity: Entity| names.get(entity).expect("the entity has a name").0.to_owned();
        let (mut sets, mut count) = ([Candidates::new(), Candidates::new()], 0);
        for (place, pair) in candidates.pairs().iter().enumerate() {
            let first = name(active.surfaces[pair.first].entity);
            let second = match pair.second {
                OtherSide::Surface(place) => name(active.surfaces[place].entity),
                OtherSide::Shape(place) => name(active.shapes[place].entity),
            };
            let mut told = Vec::new();
            fates.of(place, &mut told);
            count += told.len();
            for (number, (triangles, _)) in told.into_iter().enumerate() {
                sets[usize::from(number >= pair.triangles.len())].insert((first.clone(), second.clone(), triangles));
            }
        }
        assert_eq!(sets[0].len() + sets[1].len(), count, "a pair is listed twice");
        sets
    };
    app.world_mut().run_system_once(read).expect("candidates can be read")
}

#[test]
fn the_tree_finds_the_candidates_of_brute_force_but_for_those_that_slabs_drop() {
    for method in ContactMethod::ALL {
        let culls = !matches!(method, ContactMethod::BoundingSphere | ContactMethod::Polygon);
        let mut dropped_by_slabs = 0;
        for margin in [0.0, 0.2] {
            let [mut tree, mut brute_force] = [app(), app_with_brute_force()];
            for app in [&mut tree, &mut brute_force] {
                // Without memory, so that all candidates come from the tree.
                app.insert_resource(CircumsphereSettings { margin, memory: false, ..Default::default() });
                mixed_scene(app, method);
            }
            for tick in 0..3 {
                for app in [&mut tree, &mut brute_force] {
                    // Everything moves and deforms, so trees are refitted and rebuilt.
                    let mut moved = app.world_mut().query::<(&mut SurfacePositions, &mut Transform)>();
                    for (mut positions, mut transform) in moved.iter_mut(app.world_mut()) {
                        transform.rotation *= Quat::from_rotation_y(0.3);
                        for position in &mut positions.0 {
                            position.x *= 1.0 + 0.4 * tick as f32 * position.y;
                        }
                    }
                    app.update();
                }
                let ([found, dropped], [all, nothing]) = (candidates(&mut tree), candidates(&mut brute_force));
                let what = format!("{method:?}, margin {margin}, tick {tick}");
                assert!(found.union(&dropped).eq(&all), "{what}: the pairs differ from brute force");
                assert!(found.is_disjoint(&dropped) && nothing.is_empty(), "{what}");
                assert!(culls || dropped.is_empty(), "{what}: slabs drop pairs of a method that does not use them");
                dropped_by_slabs += dropped.len();
                for second in ["spheres", "ring", "ball", "cuboid", "capsule", "hull", "half-space", "cylinder"] {
                    assert!(found.iter().any(|(_, other, _)| other == second), "nothing near the {second}");
                }
                assert!(fingerprint(&tree) == fingerprint(&brute_force), "{what}: the contacts differ");
            }
        }
        println!("{method:?}: slabs drop {dropped_by_slabs}");
        assert!(!culls || dropped_by_slabs > 1_000);
    }
}

#[test]
fn a_surface_that_meets_only_shapes_is_refined_whatever_its_method() {
    let contacts = |method: ContactMethod| {
        let mut app = app_in(Update);
        let surface = spawn(&mut app, &icosphere(2, 1.0), (THIN, Called("surface")));
        insert(&mut app, surface, method);
        app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), Called("floor"), at(0.0, -0.9, 0.0)));
        app.update();
        fingerprint(&app)
    };
    let exact = contacts(ContactMethod::Polygon);
    assert!(!exact.is_empty());
    for method in ContactMethod::ALL {
        assert_eq!(contacts(method), exact, "{method:?}");
    }
}
