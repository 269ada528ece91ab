//! Which meshes are fit for smooth surfaces.

use bevy_circumsphere::{
    geometry::SurfaceTopology,
    kernel::mesh::{
        curved_edges::{CurvedEdges, MOST_UNEVEN},
        smooth_normal::CreaseAngle,
    },
};
use circumsphere_support::scenes::cad_box;
use circumsphere_truth::{BodyShape, SmoothBody};
use glam::{DMat3, DVec3, Vec3};

use crate::bodies::{BodyMesh, CREASE, mesh_of};

struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// How badly a mesh fits, and the mean distance of its patches from a body over that of its triangles.
fn measured(topology: &SurfaceTopology, positions: &[Vec3], distance: impl Fn(DVec3) -> f64) -> (f32, f64) {
    let mut edges = CurvedEdges::default();
    edges.update(topology, positions, CreaseAngle::new(CREASE));
    let (mut flat, mut smooth) = (0.0, 0.0);
    for (corners, sides) in topology.triangles().iter().zip(topology.triangle_edges()) {
        let corners = corners.map(|vertex| positions[vertex as usize]);
        let offsets = sides.map(|edge| edges.offsets()[edge as usize]);
        let area = f64::from((corners[1] - corners[0]).cross(corners[2] - corners[0]).length());
        for weights in [[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0], [1.0, 1.0, 0.0]] {
            let sum: f32 = weights.iter().sum();
            let [a, b, c] = weights.map(|weight| weight / sum);
            let point: Vec3 = corners[0] * a + corners[1] * b + corners[2] * c;
            let bent = point + offsets[0] * (a * b) + offsets[1] * (b * c) + offsets[2] * (c * a);
            flat += area * distance(point.as_dvec3()).abs();
            smooth += area * distance(bent.as_dvec3()).abs();
        }
    }
    (edges.unevenness(topology, positions), smooth / flat)
}

/// Vertices on a body, and moved off it by up to a share of the mean edge.
fn noisy(shape: BodyShape, level: u32, noise: f64) -> (f32, f64) {
    let body = SmoothBody { shape, rotation: DMat3::IDENTITY, center: DVec3::ZERO };
    let mut mesh = BodyMesh::new(body, &mesh_of(shape, level));
    let edge = mesh.edge();
    let mut random = Noise(7);
    for position in &mut mesh.positions {
        let normal = body.foot(position.as_dvec3()).normal;
        *position += (normal * (random.next() * noise * edge)).as_vec3();
    }
    measured(&mesh.topology, &mesh.positions, |point| body.foot(point).distance)
}

/// A box of half size 1 with rounded edges, as CAD programs mesh it.
fn rounded_box(radius: f64, strips: usize) -> (f32, f64) {
    let core_of = |point: DVec3| point.clamp(DVec3::splat(radius - 1.0), DVec3::splat(1.0 - radius));
    let distance = move |point: DVec3| {
        let inner = core_of(point);
        if inner == point { point.abs().max_element() - 1.0 } else { (point - inner).length() - radius }
    };
    let mesh = cad_box(radius, strips);
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("a rounded box is a mesh");
    measured(&topology, &positions, distance)
}

#[test]
fn vertices_off_the_body_never_make_smooth_much_worse() {
    let shapes = [
        BodyShape::Ball(1.0),
        BodyShape::Ellipsoid(DVec3::new(1.2, 0.5, 0.4)),
        BodyShape::Torus(0.8, 0.3),
        BodyShape::Capsule(0.3, 0.6),
    ];
    let mut worse = 0;
    for shape in shapes {
        for level in 0..=4 {
            let mut before = 0.0;
            for noise in [0.0, 0.01, 0.02, 0.05, 0.1, 0.2] {
                let (unevenness, ratio) = noisy(shape, level, noise);
                println!("{shape:?} level {level} noise {noise}: unevenness {unevenness:.3}, error {ratio:.3} of flat");
                assert!(unevenness >= before, "more noise is more uneven");
                before = unevenness;
                // Below the threshold, smooth is better than flat, or as good.
                assert!(ratio < 1.2 && (unevenness > MOST_UNEVEN || ratio < 1.02), "{unevenness} {ratio}");
                worse += usize::from(ratio > 1.0);
            }
        }
    }
    assert!(worse > 10, "the comparison covers meshes that are not fit");
}

#[test]
fn large_faces_with_narrow_rounded_edges_do_not_fit() {
    for radius in [0.02, 0.05, 0.1, 0.3, 0.6] {
        for strips in [1, 2, 3, 6] {
            let (unevenness, ratio) = rounded_box(radius, strips);
            println!("radius {radius}, {strips} strips: unevenness {unevenness:.3}, error {ratio:.3} of flat");
            // At a radius of 0.6 the box is nearly a ball. Its flat faces bulge, but less than they would be noticed.
            assert!(unevenness > MOST_UNEVEN || radius > 0.5, "{radius} {strips}: {unevenness} {ratio}");
        }
    }
}
