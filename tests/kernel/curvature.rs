//! Both curvature estimators against closed forms.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use bevy_circumsphere::kernel::{
    mesh::{ids::EdgeId, topology::SurfaceTopology},
    spheres::curvature::{CurvatureEstimator, Curvatures},
};
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, cylinder_side, grid, icosphere, saddle};
use glam::{DVec3, Vec3};

use crate::{
    common::Random,
    truth::{ROUNDING, circumcircle, corners, exact, positions, random_rotation},
};

const ESTIMATORS: [CurvatureEstimator; 2] = [CurvatureEstimator::SignedEdge, CurvatureEstimator::DualAngleDeficit];

fn measure(mesh: &Mesh, estimator: CurvatureEstimator) -> (SurfaceTopology, Curvatures) {
    measure_at(&positions(mesh), &mesh.triangles, estimator)
}

fn measure_at(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    estimator: CurvatureEstimator,
) -> (SurfaceTopology, Curvatures) {
    let topology = SurfaceTopology::new(positions, triangles).expect("the mesh is valid");
    let mut curvatures = Curvatures::default();
    curvatures.measure(&topology, positions, estimator);
    assert_eq!(curvatures.curvatures.len(), triangles.len());
    assert_eq!(curvatures.dihedrals.len(), triangles.len());
    (topology, curvatures)
}

/// Triangles with a neighbor across every edge.
fn inner(topology: &SurfaceTopology) -> Vec<usize> {
    (0..topology.triangles().len())
        .filter(|&triangle| {
            topology.triangle_edges()[triangle].iter().all(|&edge| topology.triangles_of_edge(EdgeId(edge)).len() == 2)
        })
        .collect()
}

#[test]
fn a_plane_has_no_curvature() {
    let mut random = Random::new(1);
    for estimator in ESTIMATORS {
        for (columns, rows) in [(8, 8), (40, 3), (1, 1)] {
            let flat = grid(columns, rows, 1.0, 1.0, Diagonals::Alternating);
            let (_, measured) = measure(&flat, CurvatureEstimator::SignedEdge);
            assert!(measured.curvatures.iter().all(|&curvature| curvature == 0.0));
            let (turn, shift) = (random_rotation(&mut random), random.vector());
            let turned: Vec<Vec3> =
                positions(&flat).iter().map(|point| (turn * point.as_dvec3() + shift).as_vec3()).collect();
            let (_, measured) = measure_at(&turned, &flat.triangles, estimator);
            // Rounding of corners at coordinates of up to 2 tilts a triangle by that error over its height: 2 · 2 ·
            // 2^-24 · 40 on the narrowest. An angle deficit that is only rounding is the square root of a few units of
            // 2^-24.
            let height = 1.0 / f64::from(columns.max(rows) as u32);
            let tilt = 8.0 * 2.0 * ROUNDING / height;
            let bound = match estimator {
                CurvatureEstimator::SignedEdge => tilt / height * 3.0,
                CurvatureEstimator::DualAngleDeficit => (8.0 * ROUNDING).sqrt() / height * 3.0 + tilt / height * 3.0,
            };
            for &curvature in &measured.curvatures {
                assert!(f64::from(curvature.abs()) <= bound, "{estimator:?} {columns}x{rows} {curvature} {bound}");
            }
        }
    }
}

/// Signed edge curvature of a triangulation inscribed in the unit sphere, computed without normals. The dihedral angle
/// at an edge is the sum of two angles, each subtended at the sphere's center by the distance of a circumcenter from
/// the edge.
fn inscribed_edge_curvature(topology: &SurfaceTopology, positions: &[Vec3], triangle: usize) -> f64 {
    let own = exact(corners(positions, topology.triangles()[triangle]));
    let beyond = |triangle: u32, start: DVec3, end: DVec3| {
        let corners = exact(corners(positions, topology.triangles()[triangle as usize]));
        let (center, radius) = circumcircle(&corners);
        let half = 0.5 * start.distance(end);
        let in_plane = (radius * radius - half * half).sqrt();
        let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        (in_plane.atan2(center.length()), area / start.distance(end))
    };
    (0..3)
        .map(|k| {
            let edge = topology.triangle_edges()[triangle][k];
            let (start, end) = (own[k], own[(k + 1) % 3]);
            let around = topology.triangles_of_edge(EdgeId(edge));
            assert_eq!(around.len(), 2);
            let (first, second) = (beyond(around[0], start, end), beyond(around[1], start, end));
            (first.0 + second.0) / ((first.1 + second.1) / 3.0)
        })
        .fold(0.0, f64::max)
}

#[test]
fn a_sphere_has_one_over_its_radius() {
    println!("level triangles  signed edge: mean, max, rounding   dual deficit: mean, max");
    for level in 1..=6 {
        let mesh = icosphere(level, 1.0);
        let points = positions(&mesh);
        let (topology, signed) = measure(&mesh, CurvatureEstimator::SignedEdge);
        let (_, dual) = measure(&mesh, CurvatureEstimator::DualAngleDeficit);
        let edge = topology.mean_edge_length(&points);
        let count = mesh.triangles.len() as f64;
        let (mut worst_rounding, mut checked) = (0f64, 0);
        for (triangle, &curvature) in signed.curvatures.iter().enumerate() {
            let expected = inscribed_edge_curvature(&topology, &points, triangle);
            worst_rounding = worst_rounding.max((f64::from(curvature) - expected).abs());
            checked += 1;
        }
        let statistics = |values: &[f32]| {
            let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / count;
            let worst = values.iter().map(|&value| (f64::from(value) - 1.0).abs()).fold(0.0, f64::max);
            (mean, worst)
        };
        let ((mean, worst), (dual_mean, dual_worst)) = (statistics(&signed.curvatures), statistics(&dual.curvatures));
        println!("{level} {checked:>6}  {mean:.4} {worst:.4} {worst_rounding:.1e}   {dual_mean:.4} {dual_worst:.4}");
        // Corners are stored to half a unit in the last place. This tilts both normals by that error over a triangle's
        // height, and the angle between them is divided by the edge again.
        let rounding = 32.0 * ROUNDING / (edge * edge);
        assert!(worst_rounding <= rounding, "level {level}: {worst_rounding:e} {rounding:e}");
        // Both converge, up to the shape of the triangles: in a subdivided icosahedron, edge lengths differ by a factor
        // of up to 1.18 at every level, and the largest of two or three values exceeds their mean accordingly.
        assert!((0.0..=0.11).contains(&(mean - 1.0)) && worst <= 0.16, "level {level}: {mean} {worst}");
        // The deficit shrinks with the square of the edge, but the rounding of the three angles does not.
        let deficit_rounding = 16.0 * ROUNDING / (edge * edge);
        let coarse = if level == 1 { 0.05 } else { 0.02 };
        assert!((dual_mean - 1.0).abs() <= coarse, "level {level}: {dual_mean}");
        assert!(dual_worst <= 0.14 + deficit_rounding, "level {level}: {dual_worst}");
        for radius in [0.01f32, 100.0] {
            for estimator in ESTIMATORS {
                let (_, scaled) = measure(&icosphere(level.min(4), radius), estimator);
                let (_, unit) = measure(&icosphere(level.min(4), 1.0), estimator);
                for (scaled, unit) in scaled.curvatures.iter().zip(&unit.curvatures) {
                    assert!(f64::from((scaled * radius - unit).abs()) <= 16.0 * 32.0 * ROUNDING / (edge * edge));
                }
            }
        }
    }
}

/// Curvature of the dual mesh inside a tube of flat strips of width `width`, cut into right triangles of height
/// `height`. The neighbor across the upright edge is bent away by `bend`. The other two lie in the triangle's own
/// plane.
fn tube_dual_curvature(width: f64, height: f64, bend: f64) -> f64 {
    let third = width / 3.0;
    let spokes = [
        DVec3::new(third, height / 3.0, 0.0),
        DVec3::new(-third - third * bend.cos(), height / 3.0, -third * bend.sin()),
        DVec3::new(third, -2.0 * height / 3.0, 0.0),
    ];
    let (mut angles, mut area) = (0.0, 0.0);
    for k in 0..3 {
        let (u, v) = (spokes[k], spokes[(k + 1) % 3]);
        angles += u.angle_between(v);
        area += 0.5 * u.cross(v).length();
    }
    ((TAU - angles) / area).sqrt()
}

#[test]
fn a_tube_has_its_strips_bend_over_their_distance_at_every_stretch() {
    const AROUND: usize = 64;
    let width = 2.0 * (PI / AROUND as f64).sin();
    let bend = TAU / AROUND as f64;
    // Every triangle has one upright edge. Both triangles there have the height `width`, so their centroids are 2/3 of
    // it apart.
    let expected = bend / (2.0 * width / 3.0);
    assert!((expected - 1.5).abs() < 1.0e-3, "one and a half of the cylinder's curvature of 1");
    for ratio in [0.1, 0.2, 1.0, 2.0, 5.0, 10.0, 50.0] {
        let height = width * ratio;
        let rows = 6;
        let mesh = cylinder_side(1.0, (height * rows as f64) as f32, AROUND, rows);
        let (topology, signed) = measure(&mesh, CurvatureEstimator::SignedEdge);
        let shortest = height.min(width);
        // Rounding of corners at coordinates of up to `extent` tilts a triangle by that error over its height, on both
        // sides.
        let extent = 1f64.max(height * rows as f64);
        let tilt = 8.0 * ROUNDING * extent / shortest;
        for &curvature in &signed.curvatures {
            let error = (f64::from(curvature) - expected).abs();
            assert!(error <= 4.0 * tilt / shortest, "ratio {ratio}: {curvature} {expected} {:e}", tilt / shortest);
        }
        let (_, dual) = measure(&mesh, CurvatureEstimator::DualAngleDeficit);
        let closed = tube_dual_curvature(width, height, bend);
        let inner = inner(&topology);
        assert!(inner.len() > 500);
        let found: Vec<f64> = inner.iter().map(|&triangle| f64::from(dual.curvatures[triangle])).collect();
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        println!("ratio {ratio}: signed {expected:.4}, dual deficit {mean:.4}, closed form {closed:.4}");
        // The error of a deficit of this size from the rounding of three angles.
        let deficit_error = (16.0 * ROUNDING + tilt) / (width * height);
        assert!((mean - closed).abs() <= 0.02 * closed + deficit_error, "ratio {ratio}: {mean} {closed}");
        if ratio == 1.0 {
            // The mean curvature is 1/2. Right triangles add a factor of 2/√3.
            assert!((mean - 1.0 / 3f64.sqrt()).abs() < 0.01, "{mean}");
        }
        if ratio == 10.0 {
            // The reason that this estimator is not the default.
            assert!(mean < 0.07, "known to fail on stretched triangles: {mean}");
        }
        for (triangle, &curvature) in dual.curvatures.iter().enumerate() {
            if !inner.contains(&triangle) {
                assert_eq!(curvature, signed.curvatures[triangle], "without a neighbor, the edges are used");
            }
        }
    }
}

#[test]
fn a_saddle_has_no_angle_deficit_and_edges_of_both_signs() {
    for curvature in [0.5, 1.0] {
        let mesh = saddle(16, 1.0, curvature);
        let (topology, dual) = measure(&mesh, CurvatureEstimator::DualAngleDeficit);
        let (_, signed) = measure(&mesh, CurvatureEstimator::SignedEdge);
        let near: Vec<usize> = inner(&topology)
            .into_iter()
            .filter(|&triangle| {
                exact(corners(&positions(&mesh), mesh.triangles[triangle])).iter().all(|corner| corner.length() < 0.5)
            })
            .collect();
        assert!(near.len() > 50);
        for &triangle in &near {
            // The square root of the rounding of the full angle, divided by the area of the dual triangles, half a
            // cell.
            let bound = (32.0 * ROUNDING / (0.5 * 0.125 * 0.125f64)).sqrt();
            assert!(f64::from(dual.curvatures[triangle]) <= bound, "{}", dual.curvatures[triangle]);
        }
        let count = |sign: f32| near.iter().filter(|&&triangle| signed.curvatures[triangle] * sign > 0.1).count();
        assert!(count(1.0) > 10 && count(-1.0) > 10, "{} convex, {} concave", count(1.0), count(-1.0));
    }
}

#[test]
fn a_box_is_convex_by_right_angles_and_its_inside_concave() {
    for subdivisions in [1usize, 2, 5] {
        let mesh = cuboid([1.0, 2.0, 0.5], subdivisions);
        let turned_out = Mesh {
            triangles: mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
            positions: mesh.positions.clone(),
        };
        for (mesh, sign) in [(&mesh, 1.0), (&turned_out, -1.0)] {
            let (_, measured) = measure(mesh, CurvatureEstimator::SignedEdge);
            let (mut creases, mut flat) = (0, 0);
            for (triangle, dihedrals) in measured.dihedrals.iter().enumerate() {
                let mut folded = false;
                for &dihedral in dihedrals {
                    if dihedral.abs() < 1.0e-5 {
                        flat += 1;
                    } else {
                        assert!((f64::from(dihedral) - sign * FRAC_PI_2).abs() < 1.0e-5, "{dihedral}");
                        creases += 1;
                        folded = true;
                    }
                }
                if folded {
                    assert!(measured.curvatures[triangle] * sign as f32 > 0.1);
                } else {
                    assert!(measured.curvatures[triangle].abs() < 1.0e-3);
                }
            }
            // The box has twelve edges, each seen from both sides.
            assert_eq!(creases, 12 * subdivisions * 2);
            assert_eq!(creases + flat, 3 * mesh.triangles.len());
        }
    }
}

/// Two triangles of heights `first` and `second` on the edge from (0, 0, 0) to (0, 0, length), folded by `angle`
/// (positive where convex). The first faces +y.
fn hinge(length: f64, first: f64, second: f64, angle: f64) -> [DVec3; 4] {
    [
        DVec3::ZERO,
        DVec3::Z * length,
        DVec3::new(first, 0.0, 0.3 * length),
        DVec3::new(-second * angle.cos(), -second * angle.sin(), 0.8 * length),
    ]
}

const HINGE: [[u32; 3]; 2] = [[0, 1, 2], [1, 0, 3]];

#[test]
fn a_hinge_has_its_angle_over_the_distance_of_the_centroids() {
    let mut random = Random::new(2);
    let mut checked = 0;
    for degrees in (-175..=175).step_by(5) {
        for _ in 0..20 {
            let angle = f64::from(degrees).to_radians();
            let (length, first, second) = (random.range(0.2, 3.0), random.range(0.1, 3.0), random.range(0.1, 3.0));
            let scale = random.power_of_ten(-6.0, 6.0);
            let (turn, shift) = (random_rotation(&mut random), random.vector());
            let corners = hinge(length, first, second, angle).map(|point| ((turn * point + shift) * scale).as_vec3());
            let expected = angle / ((first + second) / 3.0) / scale;
            // Rounding of corners at coordinates of up to 8 tilts a triangle by that error over its height.
            let tilt = 8.0 * 8.0 * ROUNDING / first.min(second).min(length);
            let flipped = [HINGE[0], [0, 1, 3]];
            let renumbered = [[2, 0, 1], [3, 1, 0]];
            for triangles in [HINGE, flipped, renumbered] {
                let (_, measured) = measure_at(&corners, &triangles, CurvatureEstimator::SignedEdge);
                for (triangle, dihedrals) in measured.dihedrals.iter().enumerate() {
                    let own: Vec<f32> = dihedrals.iter().copied().filter(|&dihedral| dihedral != 0.0).collect();
                    assert!(own.len() <= 1, "the boundary adds no angle");
                    let found = own.first().map_or(0.0, |&dihedral| f64::from(dihedral));
                    assert!((found - angle).abs() <= tilt, "{degrees} {found} {angle}");
                    let curvature = f64::from(measured.curvatures[triangle]);
                    let tolerance = (tilt + 1.0e-5 * angle.abs()) / ((first + second) / 3.0) / scale;
                    assert!((curvature - expected).abs() <= tolerance, "{degrees} {curvature} {expected}");
                    checked += 1;
                }
            }
            // Reversing the first triangle swaps its inside and outside.
            let (_, turned) = measure_at(&corners, &[[1, 0, 2], HINGE[1]], CurvatureEstimator::SignedEdge);
            let found = f64::from(turned.dihedrals[0].iter().sum::<f32>());
            assert!((found + angle).abs() <= tilt, "{degrees} {found}");
        }
    }
    assert!(checked > 8_000);
}

#[test]
fn neither_motion_nor_scale_bends_a_surface() {
    let mut random = Random::new(3);
    for estimator in ESTIMATORS {
        for mesh in [icosphere(2, 1.0), cuboid([1.0, 0.5, 2.0], 3), saddle(8, 1.0, 0.7)] {
            let points = positions(&mesh);
            let (topology, at_rest) = measure(&mesh, estimator);
            let edge = topology.mean_edge_length(&points);
            for exponent in [-20, -3, 0, 3, 20] {
                let scale = 2f64.powi(exponent);
                let (turn, shift) = (random_rotation(&mut random), random.vector() * 4.0);
                let moved: Vec<Vec3> =
                    points.iter().map(|point| ((turn * point.as_dvec3() + shift) * scale).as_vec3()).collect();
                let (_, measured) = measure_at(&moved, &mesh.triangles, estimator);
                // Coordinates of up to 8 are rounded again. Angles change by that error over an edge (the shortest
                // height is at least a quarter of the mean edge). So does a deficit, whose square root near zero
                // changes by the root.
                let tilt = 4.0 * 8.0 * ROUNDING * 4.0 / edge;
                let tolerance = match estimator {
                    CurvatureEstimator::SignedEdge => 8.0 * tilt / edge,
                    CurvatureEstimator::DualAngleDeficit => 4.0 * tilt.sqrt() / edge,
                };
                let mut curved = 0;
                for (found, expected) in measured.curvatures.iter().zip(&at_rest.curvatures) {
                    let difference = (f64::from(*found) * scale - f64::from(*expected)).abs();
                    assert!(difference <= tolerance, "{estimator:?} 2^{exponent} {found} {expected} {tolerance:e}");
                    curved += usize::from(f64::from(expected.abs()) > 10.0 * tolerance);
                }
                assert!(curved * 4 >= measured.curvatures.len(), "{curved} of {}", measured.curvatures.len());
                for (found, expected) in measured.dihedrals.iter().zip(&at_rest.dihedrals) {
                    for k in 0..3 {
                        assert!(f64::from((found[k] - expected[k]).abs()) <= tilt);
                    }
                }
            }
        }
    }
}

#[test]
fn a_boundary_edge_bends_nothing() {
    let (_, measured) = measure_at(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]], CurvatureEstimator::DualAngleDeficit);
    assert_eq!(measured.curvatures, [0.0]);
    assert_eq!(measured.dihedrals, [[0.0; 3]]);
}

#[test]
fn at_an_edge_of_several_triangles_the_largest_fold_counts() {
    // A book of pages around the z axis, at these angles from the continuation of the first page.
    let pages = [0.4f64, -1.1, 0.7, -0.2];
    let mut corners = vec![DVec3::ZERO, DVec3::Z, DVec3::X];
    let mut triangles = vec![[0, 1, 2]];
    for (page, angle) in pages.iter().enumerate() {
        corners.push(DVec3::new(-angle.cos(), -angle.sin(), 0.5));
        let apex = 3 + page as u32;
        // The fold of the first page does not depend on the winding.
        triangles.push(if page % 2 == 0 { [1, 0, apex] } else { [0, 1, apex] });
    }
    let stored: Vec<Vec3> = corners.iter().map(|corner| corner.as_vec3()).collect();
    let (topology, measured) = measure_at(&stored, &triangles, CurvatureEstimator::DualAngleDeficit);
    assert_eq!(topology.report().non_manifold_edges, 1);
    // Pages are 1 wide, so the centroids are 2/3 apart.
    let expected = -1.1 / (2.0 / 3.0);
    assert!((f64::from(measured.dihedrals[0][0]) + 1.1).abs() < 1.0e-5, "{:?}", measured.dihedrals[0]);
    assert!((f64::from(measured.curvatures[0]) - expected).abs() < 1.0e-5, "{}", measured.curvatures[0]);
}

#[test]
fn triangles_without_area_give_finite_curvature() {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X * 0.5, Vec3::new(0.0, 0.0, 1.0)];
    for triangles in [
        vec![[0, 1, 2], [1, 0, 3]],
        vec![[0, 1, 2], [1, 0, 0]],
        vec![[0, 1, 3], [1, 0, 3]],
        vec![[0, 0, 0], [0, 1, 4], [1, 0, 2]],
        vec![[0, 1, 2], [1, 0, 4], [2, 1, 4], [0, 2, 4], [0, 1, 3]],
    ] {
        for estimator in ESTIMATORS {
            for scale in [1.0f32, 1.0e-20, 1.0e-38, 1.0e18] {
                let corners = corners.map(|corner| corner * scale);
                let (_, measured) = measure_at(&corners, &triangles, estimator);
                assert!(measured.curvatures.iter().all(|curvature| curvature.is_finite()), "{scale} {triangles:?}");
                assert!(measured.dihedrals.iter().flatten().all(|dihedral| dihedral.is_finite()));
            }
        }
    }
    let (_, measured) = measure_at(&corners, &[[0, 1, 2], [1, 0, 3]], CurvatureEstimator::SignedEdge);
    assert_eq!(measured.dihedrals[0], [0.0; 3], "a neighbor without area has no plane");
}
