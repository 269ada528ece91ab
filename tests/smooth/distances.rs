//! How far two bodies are apart, by their meshes.

use bevy_app::{App, Update};
use bevy_circumsphere::{ContactStore, prelude::*};
use circumsphere_truth::{BodyDistance, BodyShape, SmoothBody};
use glam::DVec3;

use crate::bodies::{BodyMesh, mesh_of, rotation};

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

/// Two bodies that touch within a distance, after one tick.
fn app_of(bodies: &[BodyMesh; 2], shape: SurfaceShape, method: ContactMethod, distance: f64) -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    for body in bodies {
        let surface = DeformableSurface::from_mesh(&body.positions, body.topology.triangles()).expect("a mesh");
        let thickness = SurfaceThickness::World((distance / 2.0) as f32);
        app.world_mut().spawn((surface, thickness, method, shape));
    }
    app.update();
    app
}

/// The least distance and its normal.
fn least(app: &App) -> (f64, DVec3) {
    let contacts = app.world().resource::<ContactStore>().contacts();
    let least = contacts.min_by(|one, other| one.distance.total_cmp(&other.distance)).expect("the bodies are near");
    // The larger body, in whose frame the pair is tested, is not moved.
    (f64::from(least.distance), least.normal.as_dvec3())
}

/// What is compared: flat triangles, patches, and osculating spheres.
const TESTED: [(SurfaceShape, ContactMethod); 3] = [
    (SurfaceShape::Flat, ContactMethod::Exact),
    (SurfaceShape::Smooth, ContactMethod::Exact),
    (SurfaceShape::Smooth, ContactMethod::Circumsphere),
];

/// The errors of the least distance of pairs of bodies.
fn errors(shapes: [BodyShape; 2], level: u32, gap: f64) -> [Errors; 3] {
    const PAIRS: usize = 24;
    let mut sums = [Errors::default(); 3];
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
        let bodies = [BodyMesh::new(first, &meshes[0]), BodyMesh::new(second, &meshes[1])];
        for ((shape, method), sum) in TESTED.into_iter().zip(&mut sums) {
            let (distance, normal) = least(&app_of(&bodies, shape, method, (gap + 0.5) * edge));
            sum.add(&truth, distance, normal, edge);
        }
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
    let pairs = [
        [ellipsoid, ellipsoid],
        [ellipsoid, long],
        [torus, ellipsoid],
        [torus, torus],
        [capsule, ball],
        [capsule, torus],
    ];
    // About 320 and 1280 triangles. Errors relative to those of flat triangles: of the distance and the normal, by
    // patches and by spheres.
    for (level, most) in [(1, [[0.2, 0.5], [0.3, 1.0]]), (2, [[0.06, 0.2], [0.3, 1.0]])] {
        let mut sums = [Errors::default(); 3];
        for shapes in pairs {
            for gap in [0.02, 0.3] {
                let own = errors(shapes, level, gap);
                println!("{shapes:?} level {level} gap {gap}");
                for ((sum, own), (shape, method)) in sums.iter_mut().zip(own).zip(TESTED) {
                    println!("    {shape:?} {method:?}: {:.5} edges {:.2}°", own.distance, own.normal);
                    sum.distance += own.distance;
                    sum.normal += own.normal;
                }
            }
        }
        let [flat, smooth @ ..] = sums;
        let ratios = smooth.map(|own| [own.distance / flat.distance, own.normal / flat.normal]);
        println!("level {level}: {ratios:?}");
        let holds = ratios.as_flattened().iter().zip(most.as_flattened()).all(|(ratio, most)| ratio < most);
        assert!(holds, "level {level}: {ratios:?}");
    }
}
