//! Exact touching: where the points of a contact coincide, its normal is still a unit vector.

use bevy_app::prelude::*;
use bevy_circumsphere::{geometry::FeatureKind, prelude::*};
use bevy_transform::components::Transform;
use circumsphere_support::random::Random;
use glam::{Quat, Vec3};

use crate::{
    shape_kinds::shapes,
    world::{EXACT_METHODS, Seen, all, app},
};

/// Far more than the rounding error of a unit vector that a pose has rotated in f32.
const UNIT: f32 = 1.0e-5;

/// Coordinates that lie exactly on shapes and inside them.
const PLACES: [f32; 7] = [0.0, 0.25, -0.25, 0.5, -0.5, 1.0, -1.0];

fn below(random: &mut Random, count: usize) -> usize {
    random.below(count as u64) as usize
}

fn place(random: &mut Random) -> Vec3 {
    Vec3::from_array([0, 1, 2].map(|_| PLACES[below(random, PLACES.len())]))
}

/// A triangle with or without area.
fn triangle(random: &mut Random) -> [Vec3; 3] {
    let [a, b, c] = [place(random), place(random), place(random)];
    match below(random, 6) {
        0 => [a; 3],
        1 => [a, b, b],
        2 => [a, b, 0.5 * (a + b)],
        _ => [a, b, c],
    }
}

/// A pose of any kind. Bodies with the same pose touch exactly, because their relative pose is the identity.
fn pose(random: &mut Random) -> Transform {
    let mut number = |from: f64, to: f64| (from + (to - from) * random.unit()) as f32;
    let axis = Vec3::new(number(-1.0, 1.0), number(-1.0, 1.0), number(-1.0, 1.0)).normalize_or(Vec3::X);
    let turned = Transform::from_rotation(Quat::from_axis_angle(axis, number(0.0, 6.0)))
        .with_translation(Vec3::new(number(-9.0, 9.0), number(-9.0, 9.0), number(-9.0, 9.0)))
        .with_scale(Vec3::splat(number(0.1, 4.0)));
    // Mirrored, with a nearly uniform scale, or neither.
    match below(random, 4) {
        0 => turned.with_scale(turned.scale * Vec3::new(-1.0, 1.0, 1.0)),
        1 => turned.with_scale(turned.scale * Vec3::new(1.0, 1.000_8, 0.999_9)),
        2 => Transform::IDENTITY,
        _ => turned,
    }
}

fn soup(triangles: &[[Vec3; 3]]) -> (DeformableSurface, SurfacePositions) {
    let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    DeformableSurface::from_mesh(triangles.as_flattened(), &numbers).expect("the mesh is valid")
}

fn any<T: Clone>(random: &mut Random, of: &[T]) -> T {
    of[below(random, of.len())].clone()
}

/// The number of contacts, and the number at distance 0.
#[derive(Debug, Default)]
struct Tally {
    seen: usize,
    exact: usize,
}

impl Tally {
    fn count(&mut self, app: &mut App, what: &str) {
        for contact in all(app) {
            let length = contact.normal.length();
            assert!((length - 1.0).abs() < UNIT, "{what}: a normal of length {length}: {contact:?}");
            let (a, b) = contact.points;
            assert!(a.is_finite() && b.is_finite() && contact.distance.is_finite(), "{what}: {contact:?}");
            self.seen += 1;
            self.exact += usize::from(contact.distance == 0.0);
        }
    }
}

#[test]
fn normals_of_what_touches_a_rigid_shape_exactly_are_unit_vectors() {
    let mut random = Random::new(24);
    for (name, shape) in shapes(1.0) {
        let mut app = app();
        let shape = app.world_mut().spawn(RigidShape(shape)).id();
        let mut tally = Tally::default();
        for round in 0..900 {
            let count = [1, 2, 30][round % 3];
            let triangles: Vec<[Vec3; 3]> = (0..count).map(|_| triangle(&mut random)).collect();
            let pose = pose(&mut random);
            let thickness = SurfaceThickness::World(any(&mut random, &[0.0, 0.1]));
            let sidedness = any(&mut random, &[Sidedness::Auto, Sidedness::OneSided, Sidedness::TwoSided]);
            let method = any(&mut random, &ContactMethod::ALL);
            let body = app.world_mut().spawn((soup(&triangles), thickness, sidedness, method, pose)).id();
            app.world_mut().entity_mut(shape).insert((pose, sidedness));
            for _ in 0..2 {
                app.update();
                tally.count(&mut app, name);
            }
            app.world_mut().despawn(body);
        }
        println!("{name}: {tally:?}");
        // Few points of round shapes are exact in f32.
        assert!(tally.exact > 50, "{name}: {tally:?}");
    }
}

#[derive(Clone, Copy, Debug)]
enum Touch {
    VertexOnFace,
    EdgeOnEdge,
    ParallelEdges,
    VertexOnEdge,
    VertexOnVertex,
    Coplanar,
    Piercing,
    Degenerate,
}

const TOUCHES: [Touch; 8] = [
    Touch::VertexOnFace,
    Touch::EdgeOnEdge,
    Touch::ParallelEdges,
    Touch::VertexOnEdge,
    Touch::VertexOnVertex,
    Touch::Coplanar,
    Touch::Piercing,
    Touch::Degenerate,
];

/// Two triangles whose corners have whole coordinates, so that their common points are exact.
fn touching(random: &mut Random, touch: Touch) -> [[Vec3; 3]; 2] {
    let point = |random: &mut Random| Vec3::from_array([0, 1, 2].map(|_| below(random, 17) as f32 - 8.0));
    let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|_| point(random));
    let other = [a, b, c];
    let (on_edge, on_face) = (0.5 * (a + b), 0.5 * a + 0.25 * (b + c));
    match touch {
        Touch::VertexOnFace => [[on_face, d, e], other],
        Touch::EdgeOnEdge => [[on_edge - d, on_edge + d, e], other],
        Touch::ParallelEdges => [[0.75 * a + 0.25 * b, 0.25 * a + 0.75 * b, e], other],
        Touch::VertexOnEdge => [[on_edge, d, e], other],
        Touch::VertexOnVertex => [[a, d, e], other],
        Touch::Coplanar => [[on_face, on_face + (b - a), on_face + (c - a)], other],
        Touch::Piercing => [[on_face - d, on_face + d, e], other],
        Touch::Degenerate => {
            let flat = [[on_face; 3], [on_face, d, d], [on_edge, 0.5 * (on_edge + d), d], [a, b, b], [a; 3]];
            let other = any(random, &[other, [a, b, b], [a; 3], [a, b, on_edge]]);
            [any(random, &flat), other]
        }
    }
}

/// Asserts that the normal has the direction that the features determine, if they do.
fn assert_square(contact: &Seen, triangles: &[[Vec3; 3]; 2], told: &dyn std::fmt::Debug) {
    let [first, second] = [&contact.feature_vertices.0, &contact.feature_vertices.1];
    let corner = |side: usize, vertex: VertexId| triangles[side][vertex.index()];
    let face = |side: usize| {
        let [a, b, c] = triangles[side].map(Vec3::as_dvec3);
        (b - a).cross(c - a).normalize_or_zero()
    };
    let along = |side: usize, edge: &[VertexId]| {
        (corner(side, edge[1]).as_dvec3() - corner(side, edge[0]).as_dvec3()).normalize_or_zero()
    };
    let normal = contact.normal.as_dvec3();
    match contact.kind {
        FeatureKind::EdgeEdge => {
            let leans = along(0, first).dot(normal).abs().max(along(1, second).dot(normal).abs());
            assert!(leans < 1.0e-5, "{told:?}: {contact:?}");
        }
        FeatureKind::VertexFace | FeatureKind::EdgeFace => {
            let side = usize::from(second.len() == 3);
            assert!(face(side).dot(normal).abs() > 1.0 - 1.0e-5, "{told:?}: {contact:?}");
        }
        _ => {}
    }
}

#[test]
fn normals_of_surfaces_that_touch_exactly_are_unit_vectors() {
    let mut random = Random::new(25);
    let mut app = app();
    for touch in TOUCHES {
        let mut tally = Tally::default();
        for round in 0..600 {
            let triangles = touching(&mut random, touch);
            let pose = pose(&mut random);
            let method = any(&mut random, &ContactMethod::ALL);
            let sided = [Sidedness::Auto, Sidedness::OneSided, Sidedness::TwoSided];
            let bodies = triangles.map(|triangle| {
                let thickness = SurfaceThickness::World(any(&mut random, &[0.0, 0.1]));
                let extra = (thickness, any(&mut random, &sided), method, pose);
                app.world_mut().spawn((soup(&[triangle]), extra)).id()
            });
            for _ in 0..2 {
                app.update();
                tally.count(&mut app, &format!("{touch:?} {method:?} {triangles:?}"));
            }
            if EXACT_METHODS.contains(&method) && pose == Transform::IDENTITY {
                let found = all(&mut app);
                for contact in found.iter().filter(|contact| contact.distance == 0.0) {
                    assert_square(contact, &triangles, &(touch, round, triangles));
                }
            }
            for body in bodies {
                app.world_mut().despawn(body);
            }
        }
        println!("{touch:?}: {tally:?}");
        assert!(tally.exact > 500, "{touch:?}: {tally:?}");
    }
}

#[test]
fn normals_within_a_surface_that_touches_itself_exactly_are_unit_vectors() {
    let mut random = Random::new(26);
    let mut app = app();
    let mut tally = Tally::default();
    for _ in 0..300 {
        let triangles: Vec<[Vec3; 3]> = (0..12).map(|_| triangle(&mut random)).collect();
        let method = any(&mut random, &ContactMethod::ALL);
        let extra = (SurfaceThickness::World(any(&mut random, &[0.0, 0.1])), SelfCollision, method, pose(&mut random));
        let body = app.world_mut().spawn((soup(&triangles), extra)).id();
        app.update();
        tally.count(&mut app, "self");
        app.world_mut().despawn(body);
    }
    println!("{tally:?}");
    assert!(tally.exact > 1_000, "{tally:?}");
}
