//! How far two bodies are apart, by their meshes.

use bevy_circumsphere::kernel::smooth::slide::{Domain, Spot, closest_on_patches};
use circumsphere_truth::{BodyDistance, BodyShape, SmoothBody, closest_features};
use glam::DVec3;

use crate::bodies::{BodyMesh, mesh_of, rotation, smooth};

/// Errors of distances in edges, and of normals in degrees.
#[derive(Clone, Copy, Debug, Default)]
struct Errors {
    distance: f64,
    normal: f64,
}

impl Errors {
    fn add(&mut self, truth: &BodyDistance, distance: f64, normal: DVec3, edge: f64) {
        self.distance += (distance - truth.distance).abs() / edge;
        self.normal += normal.dot(truth.normal).clamp(-1.0, 1.0).acos().to_degrees();
    }
}

/// The errors of the least distance of pairs of bodies: flat and smooth.
fn errors(shapes: [BodyShape; 2], level: u32, gap: f64) -> [Errors; 2] {
    const PAIRS: usize = 24;
    let mut sums = [Errors::default(); 2];
    for pair in 0..PAIRS {
        let seed = pair as f64 + 0.5;
        let direction = rotation(seed * 0.37) * DVec3::X;
        let place = |center| {
            [0, 1].map(|side| SmoothBody {
                shape: shapes[side],
                rotation: rotation(seed + side as f64),
                center: if side == 0 { DVec3::ZERO } else { center },
            })
        };
        let meshes = shapes.map(|shape| mesh_of(shape, level));
        // Move the second body until the gap is right.
        let starts: Vec<DVec3> = {
            let first = place(DVec3::ZERO)[0];
            let fine = mesh_of(shapes[0], 3);
            fine.positions.iter().map(|p| first.rotation * DVec3::from(p.map(f64::from))).collect()
        };
        let edge = BodyMesh::new(place(DVec3::ZERO)[0], &meshes[0]).edge();
        let mut far = 3.0;
        for _ in 0..12 {
            let [first, second] = place(direction * far);
            far += gap * edge - first.distance(&second, &starts).distance;
        }
        let [first, second] = place(direction * far);
        let truth = first.distance(&second, &starts);
        let a = BodyMesh::new(first, &meshes[0]);
        let b = BodyMesh::new(second, &meshes[1]);
        let (side_a, side_b) = (a.side(), b.side());
        let mut flat = (f64::INFINITY, DVec3::ZERO);
        let mut caps = (f64::INFINITY, DVec3::ZERO);
        for own in 0..a.topology.triangles().len() {
            for other in 0..b.topology.triangles().len() {
                let (p, q) = (a.corners(own), b.corners(other));
                let apart = ((p[0] + p[1] + p[2]) / 3.0).distance((q[0] + q[1] + q[2]) / 3.0);
                if apart > (gap + 3.5) * edge {
                    continue;
                }
                let found = closest_features(&p, &q);
                let between = found.point_b - found.point_a;
                if found.distance < flat.0 {
                    flat = (found.distance, between.normalize());
                }
                let spots = [
                    Spot { triangle: own as u32, weights: found.barycentric_a },
                    Spot { triangle: other as u32, weights: found.barycentric_b },
                ];
                let sides = [smooth(&side_a, Some(&a.edges)), smooth(&side_b, Some(&b.edges))];
                if found.distance < (gap + 0.5) * edge {
                    let meeting = closest_on_patches(sides, spots, between.normalize(), Domain::Surfaces);
                    if meeting.distance < caps.0 {
                        caps = (meeting.distance, meeting.normal);
                    }
                }
            }
        }
        sums[0].add(&truth, flat.0, flat.1, edge);
        sums[1].add(&truth, caps.0, caps.1, edge);
    }
    sums.map(|sum| Errors { distance: sum.distance / PAIRS as f64, normal: sum.normal / PAIRS as f64 })
}

#[test]
fn smooth_surfaces_are_as_far_apart_as_the_bodies() {
    let ellipsoid = BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5));
    let long = BodyShape::Ellipsoid(DVec3::new(1.2, 0.5, 0.4));
    let torus = BodyShape::Torus(0.8, 0.3);
    let capsule = BodyShape::Capsule(0.3, 0.6);
    let ball = BodyShape::Ball(0.6);
    for shapes in [[ellipsoid, ellipsoid], [ellipsoid, long], [torus, ellipsoid], [torus, torus], [capsule, ball], [capsule, torus]] {
        for level in [1, 2] {
            for gap in [0.02, 0.3] {
                let [flat, smooth] = errors(shapes, level, gap);
                println!(
                    "{shapes:?} level {level} gap {gap}: flat {:.5} {:.2}°, smooth {:.5} {:.2}°, ratios {:.3} {:.3}",
                    flat.distance, flat.normal, smooth.distance, smooth.normal,
                    smooth.distance / flat.distance, smooth.normal / flat.normal
                );
            }
        }
    }
}
