//! The masses of vertices against integrals over the tetrahedra.

use bevy_circumsphere::response::XpbdMaterial;
use circumsphere_support::tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box};
use glam::{DMat3, DVec3, Vec3};

use crate::{files::bodies, world::World};

fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// The tensor of inertia, from the second moments.
fn inertia(second: DMat3) -> DMat3 {
    let trace = second.x_axis.x + second.y_axis.y + second.z_axis.z;
    DMat3::from_diagonal(DVec3::splat(trace)) - second
}

/// Mass, center, and inertia around it.
struct Properties {
    mass: f64,
    center: DVec3,
    inertia: DMat3,
}

impl Properties {
    fn of_points(points: &[DVec3], masses: &[f64]) -> Self {
        let mass: f64 = masses.iter().sum();
        let center = points.iter().zip(masses).map(|(&at, &mass)| at * mass).sum::<DVec3>() / mass;
        let second = points
            .iter()
            .zip(masses)
            .fold(DMat3::ZERO, |sum, (&at, &mass)| sum + outer(at - center, at - center) * mass);
        Self { mass, center, inertia: inertia(second) }
    }

    /// Of a tetrahedron of volume `V` with corners `p`, `∫ x xᵀ = V/20 (Σ p pᵀ + Σp Σpᵀ)`.
    fn of_tetrahedra(points: &[DVec3], tetrahedra: &[[u32; 4]], density: f64) -> Self {
        let volumes: Vec<f64> = tetrahedra.iter().map(|corners| volume(points, *corners)).collect();
        let whole: f64 = volumes.iter().sum();
        let corners_of = |corners: &[u32; 4]| corners.map(|corner| points[corner as usize]);
        let sums = tetrahedra.iter().map(|corners| corners_of(corners).iter().sum::<DVec3>());
        let center = sums.zip(&volumes).map(|(sum, volume)| sum * *volume / 4.0).sum::<DVec3>() / whole;
        let second = tetrahedra.iter().zip(&volumes).fold(DMat3::ZERO, |all, (corners, volume)| {
            let corners = corners_of(corners).map(|corner| corner - center);
            let sum: DVec3 = corners.iter().sum();
            corners.iter().fold(all + outer(sum, sum) * (volume / 20.0), |all, &corner| {
                all + outer(corner, corner) * (volume / 20.0)
            })
        });
        Self { mass: density * whole, center, inertia: inertia(second) * density }
    }

    /// The least and the greatest moment of inertia relative to another one's, around many axes.
    fn relative_to(&self, other: &Self) -> [f64; 2] {
        let axes = (-4..=4).flat_map(|x| (-4..=4).flat_map(move |y| (0..=4).map(move |z| [x, y, z])));
        let axes = axes.map(|axis| DVec3::from_array(axis.map(f64::from))).filter(|axis| *axis != DVec3::ZERO);
        let ratios = axes.map(|axis| axis.dot(self.inertia * axis) / axis.dot(other.inertia * axis));
        ratios.fold([f64::INFINITY, 0.0], |[least, most], ratio| [least.min(ratio), most.max(ratio)])
    }
}

fn volume(points: &[DVec3], corners: [u32; 4]) -> f64 {
    let [origin, a, b, c] = corners.map(|corner| points[corner as usize]);
    ((a - origin).dot((b - origin).cross(c - origin)) / 6.0).abs()
}

#[test]
fn evened_masses_keep_the_mass_nearly_the_center_and_roughly_the_inertia() {
    let mut all: Vec<(&str, TetrahedralMesh)> = vec![
        ("ball", tetrahedral_ball(6, 0.12)),
        ("box", tetrahedral_box([7, 5, 5], [0.14, 0.1, 0.1])),
        ("bar", tetrahedral_box([20, 2, 2], [1.0, 0.1, 0.1])),
    ];
    all.extend(bodies());
    for (name, mesh) in all {
        let mut world = World::new();
        let solid = world.add(&mesh, XpbdMaterial::SOLID, ());
        let points: Vec<DVec3> = mesh.positions.iter().map(|at| Vec3::from_array(*at).as_dvec3()).collect();
        let density = f64::from(XpbdMaterial::SOLID.density);
        let mut quarters = vec![0.0; points.len()];
        for corners in &mesh.tetrahedra {
            let quarter = density * volume(&points, *corners) / 4.0;
            for &corner in corners {
                quarters[corner as usize] += quarter;
            }
        }
        let inverse_masses = &world.body(&solid).inverse_masses;
        let masses: Vec<f64> = inverse_masses.iter().map(|inverse| f64::from(*inverse).recip()).collect();
        let exact = Properties::of_tetrahedra(&points, &mesh.tetrahedra, density);
        let plain = Properties::of_points(&points, &quarters);
        let evened = Properties::of_points(&points, &masses);
        let size = points.iter().map(|at| at.distance(exact.center)).fold(0.0, f64::max);
        let off = evened.center.distance(exact.center) / size;
        let [to_exact, to_plain] = [evened.relative_to(&exact), evened.relative_to(&plain)];
        println!(
            "{name}: the center is off by {:.3} % of the radius, moments of inertia are {:.3} to {:.3} of the exact ones, \
             {:.3} to {:.3} of those of quarters",
            100.0 * off,
            to_exact[0],
            to_exact[1],
            to_plain[0],
            to_plain[1]
        );
        // Inverse masses are f32.
        assert!((evened.mass / exact.mass - 1.0).abs() < 1.0e-6, "{name}: {} {}", evened.mass, exact.mass);
        assert!(plain.center.distance(exact.center) < 1.0e-9 * size, "a quarter each keeps the center");
        // As documented: each of the few passes moves mass by an edge at most.
        assert!(off < 0.02, "{name}: {off}");
        assert!(to_plain[0] > 0.9 && to_plain[1] < 1.4, "{name}: {to_plain:?}");
    }
}
