//! Spatial hashes find the candidates of brute force, and the contacts are those of the tree.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings,
    detection::{
        DetectionDiagnostics, HierarchicalSpatialHashBroadPhasePlugin, SpatialHashBroadPhasePlugin,
        TreeBroadPhasePlugin,
    },
    prelude::*,
};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{cuboid, icosphere, torus};
use glam::{Quat, Vec3};

use crate::{
    methods::{app_with_brute_force, candidates, mixed_scene},
    world::{Called, THIN, app, at, ball, fingerprint, insert, sheet, spawn, store},
};

fn app_with(broad_phase: impl Plugin) -> App {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(), broad_phase));
    app
}

fn hash_apps() -> [App; 3] {
    [
        app_with(SpatialHashBroadPhasePlugin::default()),
        app_with(HierarchicalSpatialHashBroadPhasePlugin::default()),
        // Cells that are much too large, and boxes that are much too large for the cells.
        app_with(SpatialHashBroadPhasePlugin { cell_size: Some(0.01) }),
    ]
}

/// Smooth and flat bodies of different sizes on different layers, one of which is disabled.
fn varied_scene(app: &mut App, method: ContactMethod) {
    let layers = |memberships, filters| SurfaceLayers { memberships, filters };
    spawn(app, &sheet(), (THIN, method, Called("sheet")));
    let smooth = (THIN, method, SurfaceShape::Smooth, SelfCollision);
    spawn(app, &ball(), (smooth, Called("smooth ball"), at(0.1, 0.5, 0.2).with_scale(Vec3::splat(1.1))));
    let ring = torus(0.8, 0.2, 16, 8);
    spawn(app, &ring, (smooth, Called("smooth ring"), at(0.3, 0.2, 0.0), layers(2, u32::MAX)));
    spawn(app, &ball(), (THIN, method, Called("on another layer"), at(0.2, 0.5, 0.2), layers(2, 2)));
    spawn(app, &ball(), (THIN, method, SurfaceDisabled, Called("disabled"), at(0.15, 0.5, 0.2)));
    let tiny = at(0.2, 0.05, 0.4).with_scale(Vec3::splat(0.001));
    spawn(app, &icosphere(1, 30.0), (THIN, method, Called("tiny"), tiny));
    spawn(app, &cuboid([40.0, 1.0, 40.0], 1), (THIN, method, Called("ground"), at(0.0, -1.02, 0.0)));
}

fn move_everything(app: &mut App, tick: usize) {
    let mut moved = app.world_mut().query::<(&mut SurfacePositions, &mut bevy_transform::components::Transform)>();
    for (mut positions, mut transform) in moved.iter_mut(app.world_mut()) {
        transform.rotation *= Quat::from_rotation_y(0.2);
        for position in &mut positions.0 {
            position.x *= 1.0 + 0.2 * tick as f32 * position.y;
        }
    }
}

fn toggle_disabled(app: &mut App) {
    let mut named = app.world_mut().query::<(Entity, &Called)>();
    let found = named.iter(app.world()).find(|(_, called)| called.0 == "disabled").map(|(entity, _)| entity);
    let Some(entity) = found else { return };
    if app.world().get::<SurfaceDisabled>(entity).is_some() {
        app.world_mut().entity_mut(entity).remove::<SurfaceDisabled>();
    } else {
        insert(app, entity, SurfaceDisabled);
    }
}

#[test]
fn spatial_hashes_give_the_candidates_of_brute_force_and_the_contacts_of_the_tree() {
    for scene in [mixed_scene, varied_scene] {
        for method in ContactMethod::ALL {
            let [mut tree, mut brute_force] = [app(), app_with_brute_force()];
            let mut hashes = hash_apps();
            for app in [&mut tree, &mut brute_force].into_iter().chain(&mut hashes) {
                scene(app, method);
            }
            let mut touching = 0;
            for tick in 0..4 {
                for app in [&mut tree, &mut brute_force].into_iter().chain(&mut hashes) {
                    if tick > 0 {
                        move_everything(app, tick);
                    }
                    if tick == 2 {
                        toggle_disabled(app);
                    }
                    app.update();
                }
                touching += store(&tree).touching_count();
                let (expected, pairs) = (fingerprint(&tree), candidates(&mut brute_force));
                for (number, hash) in hashes.iter_mut().enumerate() {
                    assert!(candidates(hash) == pairs, "{method:?}, hash {number}, tick {tick}: other candidates");
                    assert_eq!(fingerprint(hash), expected, "{method:?}, hash {number}, tick {tick}");
                }
            }
            assert!(touching > 100, "{method:?}: {touching} touching pairs");
        }
    }
}

#[test]
fn diagnostics_count_the_cells_of_a_spatial_hash() {
    let cells = |mut app: App| {
        varied_scene(&mut app, ContactMethod::Exact);
        app.update();
        let diagnostics = app.world().resource::<DetectionDiagnostics>();
        [diagnostics.occupied_cells, diagnostics.crowded_cells, diagnostics.large_triangles]
    };
    assert_eq!(cells(app()), [0; 3]);
    let [automatic, hierarchical, fine] = hash_apps().map(cells);
    assert!(automatic[0] > 20 && hierarchical[0] > 20, "{automatic:?} {hierarchical:?}");
    assert!(fine[2] > 20, "{fine:?}");
    let coarse = cells(app_with(SpatialHashBroadPhasePlugin { cell_size: Some(100.0) }));
    assert!(coarse[1] > 0 && coarse[0] < automatic[0], "{coarse:?}");
}

/// Nothing changes in a hash between ticks, so a kept pair keeps its candidates.
#[test]
fn pairs_at_rest_are_not_hashed_again() {
    let mut app = app_with(HierarchicalSpatialHashBroadPhasePlugin::default());
    app.insert_resource(CircumsphereSettings { threads: 1, ..Default::default() });
    varied_scene(&mut app, ContactMethod::Exact);
    app.update();
    let first = fingerprint(&app);
    app.update();
    assert_eq!(app.world().resource::<DetectionDiagnostics>().occupied_cells, 0);
    assert_eq!(fingerprint(&app), first);
}
