//! Thin walls as sheets: generated panels with known middle surfaces, recordings, and meshes with defects.

mod defects;
mod hollow;
mod panels;
mod recordings;
mod region_tree;
mod scene;
mod shells;
mod truth;

use bevy_circumsphere::geometry::thin_wall::{Deviation, ThinWallSettings, ThinWalls};
use circumsphere_support::scenes::Mesh;
use glam::{DVec3, Vec3};

fn positions(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

fn area(positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    let area = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|corner| positions[corner as usize].as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    };
    triangles.iter().map(area).sum()
}

fn sheet(walls: &ThinWalls) -> &[[u32; 3]] {
    &walls.triangles[..walls.sheet_regions.len()]
}

fn corners_of(walls: &ThinWalls, corners: &[u32; 3]) -> [DVec3; 3] {
    corners.map(|corner| walls.positions[corner as usize].as_dvec3())
}

/// Finds the walls of a mesh, and checks what holds for every mesh.
fn find(mesh: &Mesh) -> (ThinWalls, Deviation) {
    let positions = positions(mesh);
    let settings = ThinWallSettings::default();
    let (walls, deviation) = ThinWalls::find(&positions, &mesh.triangles, &settings).expect("a valid mesh");
    // Sums of f64 in different orders.
    let tolerance = 1e-9 * walls.area_before;
    assert!((walls.area_before - area(&positions, &mesh.triangles)).abs() <= tolerance);
    let left: f64 = walls.left_out.iter().map(|left| left.area).sum();
    assert!((walls.abstracted_area + left - walls.area_before).abs() <= tolerance, "all area is accounted for");
    let regions: f64 = walls.regions.iter().map(|region| region.area).sum();
    assert!((regions - walls.abstracted_area).abs() <= tolerance, "regions have the area of the walls");
    let not_thin: f64 = walls.left_out.iter().filter(|left| !left.reason.is_thin()).map(|left| left.area).sum();
    assert!((walls.thin_area + not_thin - walls.area_before).abs() <= tolerance);

    assert_eq!(walls.positions.len(), walls.half_thickness.len());
    assert!(walls.positions.iter().all(|position| position.is_finite()));
    assert!(walls.half_thickness.iter().all(|half| half.is_finite() && *half >= 0.0));
    assert!(walls.triangles.iter().flatten().all(|&corner| (corner as usize) < walls.positions.len()));
    assert!(walls.sheet_regions.iter().all(|&region| (region as usize) < walls.regions.len()));
    for (number, region) in walls.regions.iter().enumerate() {
        assert!(region.parent.is_none_or(|parent| parent < number), "parents are larger, so there is no cycle");
        assert!(region.thickness_min <= region.thickness_max);
    }
    if !walls.regions.is_empty() {
        // What is left is bitwise what it was.
        let left: Vec<[Vec3; 3]> = walls.triangles[walls.sheet_regions.len()..]
            .iter()
            .map(|corners| corners.map(|corner| walls.positions[corner as usize]))
            .collect();
        let before = |&triangle: &u32| mesh.triangles[triangle as usize].map(|corner| positions[corner as usize]);
        assert_eq!(left, walls.left.iter().map(before).collect::<Vec<_>>());
    }
    (walls, deviation)
}

/// Nothing is thin, and nothing has changed.
fn assert_unchanged(mesh: &Mesh, walls: &ThinWalls) {
    assert_eq!(walls.regions, []);
    assert_eq!((walls.thin_area, walls.abstracted_area), (0.0, 0.0));
    assert_eq!(walls.positions, positions(mesh));
    assert_eq!(walls.triangles, mesh.triangles);
    assert!(walls.half_thickness.iter().all(|&half| half == 0.0));
}

/// The middles of the edges that only one triangle of the sheets has, where vertices at equal positions are one.
fn borders(walls: &ThinWalls) -> Vec<DVec3> {
    let bits = |corner: u32| walls.positions[corner as usize].to_array().map(|value| (value + 0.0).to_bits());
    let mut edges = std::collections::BTreeMap::new();
    for corners in sheet(walls) {
        for k in 0..3 {
            let ends = [corners[k], corners[(k + 1) % 3]];
            let mut key = ends.map(bits);
            key.sort_unstable();
            edges.entry(key).or_insert_with(Vec::new).push(ends);
        }
    }
    edges
        .into_values()
        .filter(|users| users.len() == 1)
        .map(|users| {
            let [a, b] = users[0].map(|corner| walls.positions[corner as usize].as_dvec3());
            a.midpoint(b)
        })
        .collect()
}
