//! Depth and direction against closed forms and brute force.

use bevy_circumsphere::{
    geometry::{SurfaceTopology, TetrahedralTopology},
    kernel::tetrahedra::penetration::{Penetration, SurfaceSearch},
};
use circumsphere_support::{
    random::Random,
    tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box},
};
use circumsphere_truth::point_triangle;
use glam::{DVec3, Vec3};

struct Body {
    positions: Vec<Vec3>,
    surface: SurfaceTopology,
    search: SurfaceSearch,
}

impl Body {
    fn new(mesh: &TetrahedralMesh) -> Self {
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let topology = TetrahedralTopology::new(&positions, &mesh.tetrahedra).expect("valid");
        let surface = SurfaceTopology::new(&positions, topology.surface()).expect("valid");
        let mut search = SurfaceSearch::default();
        search.update(&surface, &positions);
        Self { positions, surface, search }
    }

    fn penetration(&self, point: DVec3) -> Penetration {
        self.search.penetration(&self.surface, &self.positions, point).expect("the surface has triangles")
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.surface.triangles()[triangle].map(|vertex| self.positions[vertex as usize].as_dvec3())
    }
}

fn random_point(random: &mut Random) -> DVec3 {
    DVec3::new(random.signed_unit().into(), random.signed_unit().into(), random.signed_unit().into())
}

#[test]
fn depth_in_a_box_is_the_distance_to_the_nearest_side() {
    let half = DVec3::new(1.0, 0.5, 0.75);
    let body = Body::new(&tetrahedral_box([6, 4, 5], half.to_array()));
    let mut random = Random::new(7);
    for _ in 0..2_000 {
        let point = random_point(&mut random) * half;
        let rooms = half - point.abs();
        let axis = (0..3).min_by(|&one, &other| rooms[one].total_cmp(&rooms[other])).expect("three axes");
        let found = body.penetration(point);
        assert!((found.depth - rooms[axis]).abs() < 1.0e-14, "{point}: {found:?}");
        let mut rooms_sorted = rooms.to_array();
        rooms_sorted.sort_by(f64::total_cmp);
        if rooms_sorted[1] - rooms_sorted[0] > 1.0e-12 {
            let mut outward = DVec3::ZERO;
            outward[axis] = point[axis].signum();
            assert!(found.direction.distance(outward) < 1.0e-12, "{point}: {found:?}");
        }
    }
}

#[test]
fn depth_in_a_ball_is_what_its_radius_leaves() {
    let (cubes, radius) = (16, 2.0);
    let body = Body::new(&tetrahedral_ball(cubes, radius));
    // The surface is a polyhedron inside the sphere. Its longest edge stands for an arc whose height is the largest
    // error of the depth.
    let edges = body.surface.edges().iter();
    let longest = edges
        .map(|edge| edge.map(|vertex| body.positions[vertex as usize].as_dvec3()))
        .map(|[from, to]| from.distance(to))
        .fold(0.0, f64::max);
    let sagitta = radius - (radius * radius - longest * longest / 3.0).sqrt();
    let mut random = Random::new(8);
    let mut count = 0;
    for _ in 0..2_000 {
        let point = random_point(&mut random) * radius;
        let expected = radius - point.length();
        if expected < sagitta || expected > 0.8 * radius {
            continue;
        }
        count += 1;
        let found = body.penetration(point);
        assert!(found.depth <= expected + 1.0e-12 && found.depth >= expected - sagitta, "{point}: {found:?}");
        // The way to the nearest point of a polyhedron ends within its edge of the true one.
        let cosine = found.direction.dot(point.normalize());
        assert!(cosine > 0.9, "{point}: {cosine}");
        assert!((found.direction.length() - 1.0).abs() < 1.0e-14);
    }
    assert!(count > 500, "{count}");
}

#[test]
fn points_on_the_surface_have_depth_0_and_its_outward_normal() {
    let body = Body::new(&tetrahedral_box([4; 3], [1.0; 3]));
    let on_face = body.penetration(DVec3::new(0.1, 0.2, 1.0));
    assert_eq!((on_face.depth, on_face.direction), (0.0, DVec3::Z));
    let on_inner_edge = body.penetration(DVec3::new(-1.0, 0.5, 0.25));
    assert_eq!(on_inner_edge.depth, 0.0);
    assert!(on_inner_edge.direction.distance(-DVec3::X) < 1.0e-15);
    let on_edge = body.penetration(DVec3::new(1.0, 0.3, -1.0));
    assert!(on_edge.direction.distance(DVec3::new(1.0, 0.0, -1.0).normalize()) < 1.0e-15);
    let on_corner = body.penetration(DVec3::ONE);
    // Angles in f32 weigh the faces around a vertex.
    assert!(on_corner.direction.distance(DVec3::ONE.normalize()) < 1.0e-6, "{on_corner:?}");
    // Closer to the surface than a coordinate can be told from it.
    let beneath = body.penetration(DVec3::new(0.1, 0.2, 1.0 - f64::EPSILON));
    assert_eq!(beneath.direction, DVec3::Z);
}

#[test]
fn the_nearest_point_is_that_of_brute_force() {
    let mut random = Random::new(9);
    let mut mesh = tetrahedral_ball(6, 1.0);
    // Dents, so that nearest points are on faces, edges, and vertices.
    for position in &mut mesh.positions {
        *position = position.map(|coordinate| coordinate * (1.0 + 0.1 * random.signed_unit()));
    }
    let body = Body::new(&mesh);
    for _ in 0..500 {
        let point = random_point(&mut random);
        let found = body.penetration(point);
        let distances =
            (0..body.surface.triangles().len()).map(|triangle| point_triangle(point, &body.corners(triangle)).distance);
        let (nearest, least) = distances.enumerate().min_by(|one, other| one.1.total_cmp(&other.1)).expect("some");
        assert!((found.depth - least).abs() < 1.0e-14, "{point}: {found:?} {nearest} {least}");
        let end = point_triangle(point + found.direction * found.depth, &body.corners(found.triangle.index()));
        assert!(end.distance < 1.0e-14, "the way ends on its triangle");
    }
}

#[test]
fn a_refitted_search_finds_what_a_new_one_finds() {
    let mesh = tetrahedral_ball(6, 1.0);
    let mut kept = Body::new(&mesh);
    let mut random = Random::new(10);
    for turn in 1..6 {
        let turn = 0.5 * f64::from(turn);
        let twist = |position: &[f32; 3]| {
            let [x, y, z] = position.map(f64::from);
            let (sine, cosine) = (turn * z).sin_cos();
            [x * cosine - y * sine, x * sine + y * cosine, z].map(|coordinate| coordinate as f32)
        };
        let positions = mesh.positions.iter().map(twist).collect();
        let fresh = Body::new(&TetrahedralMesh { positions, tetrahedra: mesh.tetrahedra.clone() });
        kept.positions.clone_from(&fresh.positions);
        kept.search.update(&kept.surface, &kept.positions);
        for _ in 0..100 {
            let point = random_point(&mut random);
            assert_eq!(kept.penetration(point), fresh.penetration(point));
        }
    }
}

#[test]
fn a_tip_that_pierces_its_own_body_leaves_by_the_side_that_it_came_in() {
    // Two boxes in one body, the tip of the second in the top of the first.
    let mut mesh = tetrahedral_box([4; 3], [1.0; 3]);
    let tip = [[0.0, 0.0, 0.8], [0.3, 0.0, 1.8], [-0.3, 0.3, 1.8], [-0.3, -0.3, 1.8]];
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(tip);
    mesh.tetrahedra.push([first, first + 1, first + 2, first + 3]);
    let body = Body::new(&mesh);
    let found = body.search.own_penetration(&body.surface, &body.positions, first).expect("the top is there");
    assert!((found.depth - 0.2).abs() < 1.0e-7, "the tip is an f32: {found:?}");
    assert!(found.direction.distance(DVec3::Z) < 1.0e-12);
}
