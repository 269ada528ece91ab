//! Meshes that are not thin, or not even sound. None may panic, and none may lose area: `find` checks it.

use bevy_circumsphere::geometry::{
    TopologyError,
    thin_wall::{ThinWallSettings, ThinWalls},
};
use circumsphere_support::scenes::{
    Diagonals, Mesh, Panel, cuboid, grid, icosphere, merge, panel, ragged_slivers, torus, triangle_soup,
};
use glam::Vec3;

use super::{assert_unchanged, find};

#[test]
fn invalid_meshes_are_rejected() {
    let settings = ThinWallSettings::default();
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    assert_eq!(ThinWalls::find(&corners, &[], &settings), Err(TopologyError::NoTriangles));
    let outside = ThinWalls::find(&corners, &[[0, 1, 3]], &settings);
    assert_eq!(outside, Err(TopologyError::VertexOutOfRange { triangle: 0, vertex: 3, vertices: 3 }));
    for value in [f32::NAN, f32::INFINITY] {
        let broken = [Vec3::ZERO, Vec3::X, Vec3::new(0.0, value, 0.0)];
        let found = ThinWalls::find(&broken, &[[0, 1, 2]], &settings);
        assert!(matches!(found, Err(TopologyError::NonFinitePosition { vertex: 2, .. })), "{found:?}");
    }
}

#[test]
fn what_is_not_thin_stays_bitwise() {
    let rod = cuboid([0.05, 1.0, 0.05], 6);
    for mesh in [icosphere(2, 1.0), cuboid([1.0, 0.8, 0.6], 3), rod, torus(1.0, 0.4, 24, 12)] {
        let (walls, deviation) = find(&mesh);
        assert_unchanged(&mesh, &walls);
        assert_eq!(deviation.hausdorff, 0.0);
    }
}

#[test]
fn open_sheets_have_no_thickness_to_find() {
    let sheet = grid(6, 6, 1.0, 1.0, Diagonals::Alternating);
    let (walls, _) = find(&sheet);
    assert_unchanged(&sheet, &walls);
    // Two sheets that face away from each other, without a rim, are the sides of one wall.
    let mut lower = sheet.clone().translate([0.0, -0.05, 0.0]);
    lower.triangles.iter_mut().for_each(|corners| corners.reverse());
    let open = merge(&[sheet.clone(), lower]);
    let (walls, _) = find(&open);
    assert_eq!(walls.regions.len(), 1);
    assert_eq!(walls.triangles.len(), sheet.triangles.len());
    // Two sheets that face each other are no wall.
    let upper = sheet.clone().translate([0.0, 0.05, 0.0]);
    let mut flipped = upper.clone();
    flipped.triangles.iter_mut().for_each(|corners| corners.reverse());
    let gap = merge(&[sheet, flipped]);
    let (walls, _) = find(&gap);
    assert_unchanged(&gap, &walls);
}

#[test]
fn meshes_without_area_are_left() {
    let point = Mesh { positions: vec![[1.0, 2.0, 3.0]; 3], triangles: vec![[0, 1, 2], [0, 0, 0]] };
    let line = Mesh { positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], triangles: vec![[0, 1, 2]] };
    for mesh in [point, line] {
        let (walls, _) = find(&mesh);
        assert_unchanged(&mesh, &walls);
    }
}

#[test]
fn duplicates_follow_their_originals() {
    let mut mesh = panel(&Panel { longest_side: 10.0, ..Panel::default() });
    let count = mesh.triangles.len();
    mesh.triangles.extend_from_within(..);
    let (walls, _) = find(&mesh);
    assert_eq!(walls.regions.len(), 1);
    assert!(walls.triangles.len() < count, "{} triangles", walls.triangles.len());
    // Both faces of a triangle: no thickness.
    let mut sheet = grid(4, 4, 1.0, 1.0, Diagonals::Uniform);
    let flipped: Vec<[u32; 3]> = sheet.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    sheet.triangles.extend(flipped);
    let (walls, _) = find(&sheet);
    assert_unchanged(&sheet, &walls);
}

#[test]
fn crossing_and_defective_meshes_lose_no_area() {
    let plate = panel(&Panel::default());
    // Two plates that cross without a common edge.
    let crossing = merge(&[plate.clone(), plate.clone().rotate([1.0, 0.0, 0.0], 1.3)]);
    let (walls, _) = find(&crossing);
    assert!(walls.abstracted_area >= 0.9 * walls.area_before, "{:?}", walls.left_out);
    find(&triangle_soup(200, 3));
    find(&ragged_slivers(5));
    // An edge of four triangles.
    let blocks = merge(&[cuboid([0.5, 0.02, 0.5], 2), cuboid([0.5, 0.02, 0.5], 2).translate([1.0, 0.04, 0.0])]);
    find(&blocks);
    // Flipped triangles.
    let mut flipped = plate;
    flipped.triangles.iter_mut().step_by(7).for_each(|corners| corners.reverse());
    find(&flipped);
}
