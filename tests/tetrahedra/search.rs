//! The search for containments against brute force in integers.

use bevy_circumsphere::{
    geometry::{SurfaceTopology, TetrahedralTopology},
    kernel::tetrahedra::containment::{Containment, ContainmentSearch},
};
use circumsphere_support::{
    random::Random,
    tetrahedra::{tetrahedral_ball, tetrahedral_box},
};
use glam::Vec3;

use crate::exact::{Grid, Whole, parts_inside};

fn search(positions: &[Vec3], tetrahedra: &[[u32; 4]], points: &[Vec3], own: Option<&[u32]>) -> Vec<Containment> {
    let topology = TetrahedralTopology::new(positions, tetrahedra).expect("the tetrahedra are valid");
    let mut found = Vec::new();
    let points = points.iter().map(|point| point.as_dvec3());
    ContainmentSearch::default().find(&topology, positions, points, own, &mut found);
    found
}

/// The lowest tetrahedron that contains each point, in integers.
fn brute_force(positions: &[Whole], tetrahedra: &[[u32; 4]], points: &[Whole], is_own: bool) -> Vec<[u32; 2]> {
    let mut found = Vec::new();
    for (vertex, point) in (0..).zip(points) {
        let lowest = tetrahedra.iter().position(|corners| {
            let is_corner = is_own && corners.contains(&vertex);
            !is_corner && parts_inside(corners.map(|corner| positions[corner as usize]), *point).is_some()
        });
        found.extend(lowest.map(|tetrahedron| [vertex, tetrahedron as u32]));
    }
    found
}

fn pairs(found: &[Containment]) -> Vec<[u32; 2]> {
    found.iter().map(|found| [found.vertex.0, found.tetrahedron.0]).collect()
}

#[test]
fn random_tetrahedra_and_points_agree_with_brute_force() {
    let mut random = Random::new(1);
    for grid in [Grid::COARSE, Grid::FINE] {
        let mut hits = 0;
        for _ in 0..20 {
            let positions: Vec<Whole> = (0..120).map(|_| grid.random(&mut random)).collect();
            let tetrahedra: Vec<[u32; 4]> =
                (0..150).map(|_| [(); 4].map(|()| random.below(positions.len() as u64) as u32)).collect();
            let points: Vec<Whole> = (0..300).map(|_| grid.random(&mut random)).collect();
            let to_points = |wholes: &[Whole]| wholes.iter().map(|&whole| grid.point(whole)).collect::<Vec<_>>();
            let found = search(&to_points(&positions), &tetrahedra, &to_points(&points), None);
            assert_eq!(pairs(&found), brute_force(&positions, &tetrahedra, &points, false));
            hits += found.len();
        }
        assert!(hits > 2_000, "{hits} points were inside");
    }
}

#[test]
fn own_tetrahedra_do_not_count() {
    let (grid, mut random) = (Grid::FINE, Random::new(2));
    let mut hits = 0;
    for _ in 0..20 {
        let positions: Vec<Whole> = (0..200).map(|_| grid.random(&mut random)).collect();
        let tetrahedra: Vec<[u32; 4]> =
            (0..300).map(|_| [(); 4].map(|()| random.below(positions.len() as u64) as u32)).collect();
        let points: Vec<Vec3> = positions.iter().map(|&whole| grid.point(whole)).collect();
        let weld: Vec<u32> = (0..points.len() as u32).collect();
        let found = search(&points, &tetrahedra, &points, Some(&weld));
        assert_eq!(pairs(&found), brute_force(&positions, &tetrahedra, &positions, true));
        hits += found.len();
    }
    assert!(hits > 1_000, "{hits} vertices were inside");
}

#[test]
fn a_body_that_does_not_overlap_itself_contains_none_of_its_vertices() {
    let mesh = tetrahedral_ball(6, 1.0);
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let topology = TetrahedralTopology::new(&positions, &mesh.tetrahedra).expect("valid");
    let surface = SurfaceTopology::new(&positions, topology.surface()).expect("valid");
    assert_eq!(search(&positions, &mesh.tetrahedra, &positions, Some(surface.weld())), []);
    // With other numbers they are all inside, each in its lowest tetrahedron.
    let all = search(&positions, &mesh.tetrahedra, &positions, None);
    assert_eq!(all.len(), positions.len());
    for found in all {
        let around = |corners: &[u32; 4]| corners.contains(&found.vertex.0);
        assert_eq!(mesh.tetrahedra.iter().position(around), Some(found.tetrahedron.index()));
    }
}

#[test]
fn points_on_shared_faces_are_in_the_lowest_tetrahedron() {
    // Two lattices, one twice as fine: half of the fine points are in the inside of a cell, the others are on faces,
    // edges, and vertices that many tetrahedra share.
    let body = tetrahedral_box([4; 3], [1.0; 3]);
    let points = tetrahedral_box([16; 3], [2.0; 3]);
    let whole = |position: &[f32; 3]| position.map(|coordinate| (coordinate * 4.0) as i64);
    let [positions, wholes] = [&body, &points].map(|mesh| mesh.positions.iter().map(whole).collect::<Vec<Whole>>());
    let [own, other] =
        [&body, &points].map(|mesh| mesh.positions.iter().copied().map(Vec3::from_array).collect::<Vec<_>>());
    let found = search(&own, &body.tetrahedra, &other, None);
    assert_eq!(pairs(&found), brute_force(&positions, &body.tetrahedra, &wholes, false));
    assert_eq!(found.len(), 9 * 9 * 9, "all points of the finer lattice in the closed box");
}

#[test]
fn sizes_and_places_do_not_matter() {
    // Tiny tetrahedra beside huge ones, and coordinates that saturate the cells.
    for (scale, offset) in [(1.0, 0.0), (1.0e-6, 1.0), (1.0e6, 0.0), (1.0e-30, 0.0), (1.0e30, 0.0)] {
        let mut positions = Vec::new();
        let mut tetrahedra = Vec::new();
        for mesh in [tetrahedral_box([6; 3], [0.01; 3]), tetrahedral_box([1; 3], [100.0; 3])] {
            let first = positions.len() as u32;
            positions.extend(mesh.positions.iter().map(|&position| Vec3::from_array(position) * scale + offset));
            tetrahedra.extend(mesh.tetrahedra.iter().map(|corners| corners.map(|corner| corner + first)));
        }
        let points = [0.0, 0.004, 0.02, 50.0, 99.0, 101.0].map(|at| Vec3::splat(at * scale + offset));
        let found = search(&positions, &tetrahedra, &points, None);
        let expected = |point: Vec3| {
            let corners = |corners: &[u32; 4]| corners.map(|corner| positions[corner as usize].as_dvec3());
            let inside = |names: &[u32; 4]| {
                bevy_circumsphere::kernel::tetrahedra::inside::barycentric_inside(&corners(names), point.as_dvec3())
            };
            tetrahedra.iter().position(|names| inside(names).is_some())
        };
        let expected: Vec<[u32; 2]> = (0..)
            .zip(points)
            .filter_map(|(vertex, point)| expected(point).map(|tetrahedron| [vertex, tetrahedron as u32]))
            .collect();
        assert_eq!(pairs(&found), expected, "scale {scale}");
        assert_eq!(found.len(), 5, "scale {scale}");
    }
}

#[test]
fn points_that_are_not_finite_are_in_nothing() {
    let mesh = tetrahedral_box([2; 3], [1.0; 3]);
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let points = [Vec3::NAN, Vec3::INFINITY, Vec3::new(0.0, f32::NAN, 0.0), Vec3::new(0.1, 0.2, 0.3)];
    let found = search(&positions, &mesh.tetrahedra, &points, None);
    assert_eq!(found.iter().map(|found| found.vertex.0).collect::<Vec<_>>(), [3]);
}
