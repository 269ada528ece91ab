//! Sheets that cross to begin with, when nobody knows their sides.

use bevy_circumsphere::{ContactStore, prelude::*, response::*};
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;

use crate::harness::Scene;

fn crossings(scene: &Scene) -> usize {
    let store = scene.app.world().resource::<ContactStore>();
    store.contacts().filter(|contact| contact.features.kind() == FeatureKind::EdgeFace).count()
}

#[test]
fn a_corner_that_pokes_through_a_sheet_comes_back() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let thickness = SurfaceThickness::World(0.004);
    let border = |vertex: u32| [vertex % 11, vertex / 11].iter().any(|&place| place == 0 || place == 10);
    let pins = (0..121).filter(|&vertex| border(vertex)).map(VertexId);
    let held = grid(10, 10, 0.5, 0.5, Diagonals::Alternating);
    scene.add_changed(&held, XpbdMaterial::CLOTH, |body| body.pinned(pins), thickness);
    // A sheet that stands on its corner, which is some centimeters below the held one.
    let loose = grid(10, 10, 0.5, 0.5, Diagonals::Alternating)
        .rotate([0.0, 1.0, 0.0], 0.785)
        .rotate([0.0, 0.0, 1.0], 1.3)
        .translate([0.013, 0.31, 0.017]);
    scene.add(&loose, XpbdMaterial::CLOTH, thickness);
    scene.tick(1.0 / 60.0);
    assert!(crossings(&scene) > 3, "the test would show nothing: {}", crossings(&scene));
    let mut clear = 0;
    for _ in 0..240 {
        scene.tick(1.0 / 60.0);
        clear = if crossings(&scene) == 0 { clear + 1 } else { 0 };
    }
    assert!(clear > 60, "{clear} ticks without a crossing, {} left", crossings(&scene));
}

#[test]
fn sheets_that_cross_in_their_middles_come_apart() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let sheet = grid(10, 10, 0.5, 0.5, Diagonals::Alternating);
    let upright = sheet.clone().rotate([1.0, 0.0, 0.0], 1.2).translate([0.013, 0.02, 0.017]);
    for mesh in [sheet, upright] {
        scene.add(&mesh, XpbdMaterial::CLOTH, (SelfCollision, SweptCollision));
    }
    scene.run(1);
    assert!(crossings(&scene) > 10, "the test would show nothing: {}", crossings(&scene));
    scene.run(120);
    assert_eq!(crossings(&scene), 0);
}
