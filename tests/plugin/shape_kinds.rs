//! A rigid shape of every kind, about one unit across.

use bevy_circumsphere::prelude::*;
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid};
use glam::{IVec3, Vec3};
use parry3d::{math::Pose, utils::Array2};

use crate::world::points;

pub fn trimesh(mesh: &Mesh) -> SharedShape {
    SharedShape::trimesh(points(mesh), mesh.triangles.clone()).expect("the mesh has triangles")
}

/// Shapes whose sizes are halves and quarters of `size`, so that points of a grid lie on them exactly.
pub fn shapes(size: f32) -> Vec<(&'static str, SharedShape)> {
    let (half, quarter) = (0.5 * size, 0.25 * size);
    let octahedron = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].map(|corner| corner * half);
    let corners = [Vec3::new(-half, 0.0, -half), Vec3::new(half, 0.0, -half), Vec3::new(0.0, quarter, half)];
    let [a, b, c] = corners;
    let heights = (0..9_u8).map(|place| quarter * f32::from(place % 3)).collect();
    let at = |x: f32| Pose::from_translation(Vec3::new(x * size, 0.0, 0.0));
    let parts = vec![
        (at(-0.25), SharedShape::cuboid(quarter, half, quarter)),
        (at(0.25), SharedShape::cylinder(half, quarter)),
        (at(0.0), SharedShape::ball(quarter)),
    ];
    let cube = cuboid([half; 3], 2);
    let sheet = grid(2, 2, size, size, Diagonals::Alternating);
    let mut shapes = vec![
        ("closed trimesh", trimesh(&cube)),
        ("open trimesh", trimesh(&sheet)),
        ("cone", SharedShape::cone(half, half)),
        ("cylinder", SharedShape::cylinder(half, quarter)),
        ("triangle", SharedShape::triangle(a, b, c)),
        ("segment", SharedShape::segment(a, b)),
        ("polyline", SharedShape::polyline(vec![a, b, c, Vec3::splat(quarter)], None)),
        ("heightfield", SharedShape::heightfield(Array2::new(3, 3, heights), Vec3::new(size, 1.0, size))),
        ("voxels", SharedShape::voxels(Vec3::splat(half), &[IVec3::ZERO, IVec3::X, IVec3::NEG_Y])),
        ("cuboid", SharedShape::cuboid(half, quarter, half)),
        ("plate", SharedShape::cuboid(half, 0.0, half)),
        ("ball", SharedShape::ball(half)),
        ("point", SharedShape::ball(0.0)),
        ("capsule", SharedShape::capsule_y(quarter, quarter)),
        ("half-space", SharedShape::halfspace(Vec3::Y)),
        ("compound", SharedShape::compound(parts)),
        ("rounded cuboid", SharedShape::round_cuboid(quarter, quarter, quarter, quarter)),
        ("rounded cylinder", SharedShape::round_cylinder(quarter, quarter, quarter)),
        ("rounded cone", SharedShape::round_cone(quarter, quarter, quarter)),
        ("rounded triangle", SharedShape::round_triangle(a, b, c, quarter)),
    ];
    shapes.extend(SharedShape::convex_hull(&octahedron).map(|hull| ("hull", hull)));
    shapes.extend(SharedShape::round_convex_hull(&octahedron, quarter).map(|hull| ("rounded hull", hull)));
    shapes
}
