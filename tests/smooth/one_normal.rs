//! `SmoothNormals` and the patches of smooth surfaces follow the same normals.

use bevy_circumsphere::kernel::mesh::{
    feature::Feature,
    smooth_normal::{CreaseAngle, NormalCone, SurfacePlace},
};
use circumsphere_support::{
    random::Random,
    scenes::{capsule, crumpled_sheet, cuboid, cylinder_side, icosphere, torus},
};
use circumsphere_truth::{CurvedMesh, exact_weld};
use glam::DVec3;

use crate::{bodies::CREASE, surfaces::Surface};

/// The sine of the crease angle is rounded to f32, which decides how far the faces beyond a bent edge count.
const ROUNDING: f64 = 1.0e-6;

#[test]
fn normals_at_corners_are_those_that_patches_follow() {
    let mut random = Random::new(5);
    let meshes = [
        icosphere(2, 1.0),
        torus(1.0, 0.4, 14, 9),
        capsule(0.5, 0.7, 12, 5, 3),
        cuboid([1.0, 0.6, 0.4], 3),
        cylinder_side(0.5, 1.0, 9, 3),
        crumpled_sheet(300, 0.3),
    ];
    let (mut corners, mut single, mut creased) = (0, 0, 0);
    for mesh in &meshes {
        let curved = Surface::of(mesh).curved(CREASE);
        let positions = &curved.surface.positions;
        let exact: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
        let weld = exact_weld(&exact);
        let truth = CurvedMesh::new(&exact, &mesh.triangles, &weld, f64::from(CREASE)).corner_normals();
        for (triangle, normals) in truth.iter().enumerate() {
            for (corner, normal) in normals.iter().enumerate() {
                let mut barycentric = [0.0; 3];
                barycentric[corner] = 1.0;
                let place = SurfacePlace {
                    topology: &curved.topology,
                    positions,
                    triangle: triangle as u32,
                    feature: Feature::Vertex(corner as u8),
                    one_sided: true,
                    barycentric,
                };
                let cone = NormalCone::of(&place, CreaseAngle::new(CREASE));
                // Each normal of a corner is one of the directions there. Where the surface is smooth, it is the only one.
                assert!(
                    cone.nearest(*normal).distance(*normal) < ROUNDING,
                    "{triangle} {corner}: {normal} {}",
                    cone.nearest(*normal)
                );
                let other = DVec3::from([(); 3].map(|()| f64::from(random.signed_unit()))).normalize();
                let is_only = cone.nearest(other).distance(*normal) < ROUNDING;
                corners += 1;
                single += usize::from(is_only);
                creased += usize::from(!is_only);
            }
        }
    }
    println!("{corners} corners, {single} with one normal, {creased} at creases and borders");
    assert!(single > 2_000 && creased > 300);
}
