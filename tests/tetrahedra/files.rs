//! Real bodies against brute force with exact predicates.

use bevy_circumsphere::{
    geometry::{SurfaceTopology, TetrahedralTopology},
    kernel::tetrahedra::{containment::ContainmentSearch, penetration::SurfaceSearch},
};
use circumsphere_support::{
    recording::recordings_folder,
    tetrahedra::{TetrahedralMesh, read_tetrahedral_mesh},
};
use circumsphere_truth::point_triangle;
use glam::{DVec3, Vec3};
use robust::{Coord3D, orient3d};

/// The given bodies, each with the vertices and tetrahedra that it must have.
const BODIES: [(&str, usize, usize); 5] = [
    ("bar-186", 86, 186),
    ("torus", 200, 491),
    ("mat20x20", 800, 2_166),
    ("cow_head", 1_328, 5_029),
    ("sphere1K", 1_760, 6_851),
];

pub fn bodies() -> Vec<(&'static str, TetrahedralMesh)> {
    let Some(folder) = recordings_folder() else { return Vec::new() };
    BODIES
        .into_iter()
        .map(|(name, vertices, tetrahedra)| {
            let mesh = read_tetrahedral_mesh(&folder.join("tetrahedra").join(name).with_extension("msh"));
            let mesh = mesh.expect("the file is valid");
            assert_eq!((mesh.positions.len(), mesh.tetrahedra.len()), (vertices, tetrahedra), "{name}");
            (name, mesh)
        })
        .collect()
}

fn points(mesh: &TetrahedralMesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

/// Whether a tetrahedron contains a point, by the signs of the four parts and of the whole.
fn contains(corners: [DVec3; 4], point: DVec3) -> bool {
    let volume = |[a, b, c, d]: [DVec3; 4]| {
        let [a, b, c, d] = [a, b, c, d].map(|point| Coord3D { x: point.x, y: point.y, z: point.z });
        orient3d(a, b, c, d)
    };
    let whole = volume(corners);
    whole != 0.0
        && (0..4).all(|corner| {
            let mut part = corners;
            part[corner] = point;
            volume(part) * whole.signum() >= 0.0
        })
}

/// A place for the second body where the two overlap: its center goes near a vertex of the first.
fn overlapping(first: &[Vec3], second: &[Vec3]) -> Vec<Vec3> {
    let center = second.iter().sum::<Vec3>() / second.len() as f32;
    let target = first[first.len() / 3];
    second.iter().map(|&position| position + (target - center)).collect()
}

#[test]
fn bodies_agree_with_brute_force() {
    let bodies = bodies();
    let (mut inside, mut deep) = (0, 0);
    for (first, (name, mesh)) in bodies.iter().enumerate() {
        let positions = points(mesh);
        let topology = TetrahedralTopology::new(&positions, &mesh.tetrahedra).expect("the body is valid");
        let surface = SurfaceTopology::new(&positions, topology.surface()).expect("the surface is valid");
        assert!(surface.is_closed(), "{name}");
        assert!(topology.report().inverted.is_empty(), "{name}: {:?}", topology.report());
        for (other_name, other) in
            bodies.iter().enumerate().filter(|(second, _)| *second != first).map(|(_, body)| body)
        {
            let other = overlapping(&positions, &points(other));
            let mut found = Vec::new();
            let targets = other.iter().map(|point| point.as_dvec3());
            ContainmentSearch::default().find(&topology, &positions, targets, None, &mut found);
            let own: Vec<[usize; 2]> =
                found.iter().map(|found| [found.vertex.index(), found.tetrahedron.index()]).collect();
            let mut truth = Vec::new();
            for (vertex, point) in other.iter().enumerate() {
                let lowest = mesh.tetrahedra.iter().position(|corners| {
                    let (corners, point) =
                        (corners.map(|corner| positions[corner as usize].as_dvec3()), point.as_dvec3());
                    let is_near = (0..3).all(|axis| {
                        let along = corners.map(|corner| corner[axis]);
                        along.iter().any(|&at| at <= point[axis]) && along.iter().any(|&at| at >= point[axis])
                    });
                    is_near && contains(corners, point)
                });
                truth.extend(lowest.map(|tetrahedron| [vertex, tetrahedron]));
            }
            assert_eq!(own, truth, "{other_name} in {name}");
            inside += own.len();
            let mut search = SurfaceSearch::default();
            search.update(&surface, &positions);
            for &[vertex, _] in own.iter().step_by(7) {
                let point = other[vertex].as_dvec3();
                let found = search.penetration(&surface, &positions, point).expect("the surface has triangles");
                let distances = surface.triangles().iter().map(|corners| {
                    point_triangle(point, &corners.map(|corner| positions[corner as usize].as_dvec3())).distance
                });
                let least = distances.fold(f64::INFINITY, f64::min);
                // Rounding of f64 at the size of the bodies.
                assert!((found.depth - least).abs() < 1.0e-12 * (1.0 + point.length()), "{name}: {found:?} {least}");
                deep += 1;
            }
        }
    }
    if !bodies.is_empty() {
        println!("{inside} vertices inside, {deep} depths compared");
        assert!(inside > 600 && deep > 90, "{inside} vertices inside, {deep} depths");
    }
}
