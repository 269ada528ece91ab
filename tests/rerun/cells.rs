//! The recording shows the occupied cells of a spatial hash.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    debug::{LevelOfDetail, RerunSettings},
    detection::{
        DetectionDiagnostics, HierarchicalSpatialHashBroadPhasePlugin, SpatialHashBroadPhasePlugin, SurfaceStates,
        TreeBroadPhasePlugin,
    },
    prelude::*,
};
use glam::Vec3;

use crate::{
    triangles::{Box3, assert_posed, boxes},
    world::{Recorded, Scene, everything, nothing},
};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Hash {
    Uniform,
    Hierarchical,
}

fn recorded(hash: Hash, cells: LevelOfDetail) -> (Recorded, Scene) {
    let plugins = DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>();
    let settings = RerunSettings { cells, ..nothing() };
    let mut recorded = match hash {
        Hash::Uniform => Recorded::with(settings, plugins.add(SpatialHashBroadPhasePlugin::default()), |_| {}),
        Hash::Hierarchical => {
            Recorded::with(settings, plugins.add(HierarchicalSpatialHashBroadPhasePlugin::default()), |_| {})
        }
    };
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    (recorded, scene)
}

#[test]
fn every_occupied_cell_is_drawn_once_with_the_number_of_its_triangles() {
    for hash in [Hash::Uniform, Hash::Hierarchical] {
        let (mut recorded, scene) = recorded(hash, LevelOfDetail::All);
        for tick in 0..3 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            let diagnostics = recorded.app.world().resource::<DetectionDiagnostics>();
            let shown = recorded.viewer.below(&["cells"]);
            let counts: Vec<u32> = shown.values().flat_map(|components| components.wholes("triangles")).collect();
            let drawn: usize = shown.values().map(|components| boxes(components).len()).sum();
            assert_eq!(drawn, counts.len());
            // Surfaces that rest keep their pairs, so in later ticks fewer cells are filled.
            assert!(drawn == diagnostics.occupied_cells || tick > 0 && drawn > diagnostics.occupied_cells, "{drawn}");
            assert!(drawn > 50 && counts.iter().all(|&count| count > 0), "{drawn}");
            assert_eq!(shown.len() > 2, hash == Hash::Hierarchical, "{:?}", shown.keys());
        }
    }
}

#[test]
fn cells_of_a_surface_alone_are_a_grid_over_the_boxes_of_its_triangles() {
    let (mut recorded, scene) = recorded(Hash::Uniform, LevelOfDetail::All);
    for other in [scene.ball, scene.sheet] {
        recorded.app.world_mut().despawn(other);
    }
    recorded.tick();
    let shown = recorded.viewer.of(&["cells", "crumpled", "level 00"]).expect("the surface meets itself");
    assert_posed(&recorded, scene.crumpled, shown);
    let cells = boxes(shown);
    let side = (cells[0].1 - cells[0].0).x;
    let near = 1.0e-5 * side;
    for (low, high) in &cells {
        assert!((*high - *low - side).abs().max_element() < near, "{low} {high}");
        assert!((*low / side - (*low / side).round()).abs().max_element() < 1.0e-4, "{low}");
    }
    let states = recorded.app.world().resource::<SurfaceStates>();
    let triangles = states.get(scene.crumpled).expect("it is a surface").triangle_boxes();
    // A triangle is in a cell if its box reaches the cell; one that touches it within rounding may be or not.
    let reaching = |(low, high): &Box3, by: f32| {
        triangles
            .iter()
            .filter(|bounds| (bounds.min - by).cmple(*high).all() && (bounds.max + by).cmpge(*low).all())
            .count()
    };
    for (cell, count) in cells.iter().zip(shown.wholes("triangles")) {
        let [least, most] = [-near, near].map(|by| reaching(cell, by) as u32);
        assert!((least.max(1)..=most).contains(&count), "{cell:?}: {count}, not from {least} to {most}");
    }
    // Whatever a box contains is in a drawn cell.
    for bounds in triangles {
        for share in [Vec3::ZERO, Vec3::ONE, Vec3::splat(0.5), Vec3::X, Vec3::new(0.2, 0.9, 0.7)] {
            let point = bounds.min + share * (bounds.max - bounds.min);
            let is_in = |(low, high): &Box3| (*low - near).cmple(point).all() && (*high + near).cmpge(point).all();
            assert!(cells.iter().any(is_in), "{point}");
        }
    }
}

#[test]
fn only_cells_near_contacts_are_drawn_if_asked_and_none_without_a_hash() {
    let drawn = |level: LevelOfDetail| -> Vec<Vec<[u32; 6]>> {
        let (mut recorded, _) = recorded(Hash::Uniform, level);
        recorded.tick();
        let bits = |(low, high): Box3| [low.x, low.y, low.z, high.x, high.y, high.z].map(f32::to_bits);
        let shown = recorded.viewer.below(&["cells"]);
        shown.values().map(|components| boxes(components).into_iter().map(bits).collect()).collect()
    };
    let [off, near, all] = [LevelOfDetail::Off, LevelOfDetail::NearContacts, LevelOfDetail::All].map(drawn);
    let count = |cells: &[Vec<[u32; 6]>]| cells.iter().map(Vec::len).sum::<usize>();
    assert!(off.is_empty() && count(&near) > 0 && count(&near) < count(&all), "{} {}", count(&near), count(&all));
    let all: Vec<[u32; 6]> = all.concat();
    assert!(near.concat().iter().all(|cell| all.contains(cell)));

    let mut recorded = Recorded::new(everything());
    let _ = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    recorded.tick();
    assert!(recorded.viewer.below(&["cells"]).is_empty());
}
