//! Osculating spheres: the method `Circumsphere` on smooth surfaces.

use bevy_app::{App, Update};
use bevy_circumsphere::{Circumspheres, ContactStore, TriangleCurvature, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::icosphere;
use circumsphere_truth::{BodyShape, SmoothBody};
use glam::{DMat3, DVec3, Quat, Vec3};

use crate::bodies::{BodyMesh, mesh_of};

type Mesh = (Vec<Vec3>, Vec<[u32; 3]>);

fn ball(level: u32, radius: f32) -> Mesh {
    let mesh = icosphere(level, radius);
    (mesh.positions.into_iter().map(Vec3::from_array).collect(), mesh.triangles)
}

fn inside_out((positions, triangles): Mesh) -> Mesh {
    (positions, triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect())
}

fn app() -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    app
}

fn spawn(app: &mut App, (positions, triangles): &Mesh, pose: Transform, sides: Sidedness, thickness: f32) -> Entity {
    let surface = DeformableSurface::from_mesh(positions, triangles).expect("a mesh");
    let thickness = SurfaceThickness::World(thickness);
    let shape = (SurfaceShape::Smooth, ContactMethod::Circumsphere);
    app.world_mut().spawn((surface, pose, sides, thickness, shape)).id()
}

/// The least distance, and whether its normal points along `direction`.
fn least(app: &App) -> (f32, Vec3) {
    let store = app.world().resource::<ContactStore>();
    let of_pairs = store.pairs().iter().flat_map(|pair| pair.contacts.iter().map(move |contact| (pair, contact)));
    let least = of_pairs.min_by(|(_, one), (_, other)| one.distance.total_cmp(&other.distance));
    least.map_or((f32::INFINITY, Vec3::ZERO), |(pair, least)| {
        (least.distance, pair.frame_pose.transform_direction(least.normal.as_dvec3()).as_vec3())
    })
}

#[test]
fn spheres_of_a_ball_are_the_ball() {
    for (mesh, sign) in [(ball(2, 2.0), 1.0), (inside_out(ball(2, 2.0)), -1.0)] {
        let mut app = app();
        let entity = spawn(&mut app, &mesh, Transform::default(), Sidedness::OneSided, 0.1);
        spawn(&mut app, &ball(2, 2.0), Transform::from_xyz(4.05, 0.0, 0.0), Sidedness::Auto, 0.1);
        app.update();
        let spheres = app.world().get::<Circumspheres>(entity).expect("the surface has spheres");
        let curvatures = app.world().get::<TriangleCurvature>(entity).expect("the surface has curvatures");
        for triangle in 0..mesh.1.len() {
            let (center, radius) = (spheres.centers[triangle], spheres.radii[triangle]);
            assert!(center.length() < 1.0e-4 && (radius - 2.0).abs() < 1.0e-4, "{center} {radius}");
            let curvature = curvatures.curvatures[triangle];
            assert!((curvature - sign * 0.5).abs() < 1.0e-5, "{curvature}");
        }
    }
}

#[test]
fn distances_of_balls_are_exact() {
    for (scale, gap) in [(1.0, 0.02), (1.0, 0.2), (1.0, -0.05), (1.0e-2, 0.03), (30.0, 0.01)] {
        let mut app = app();
        for seed in 0..12_u16 {
            let turn = Quat::from_rotation_x(f32::from(seed)) * Quat::from_rotation_y(2.3 * f32::from(seed));
            let direction = turn * Vec3::X;
            let poses = [
                Transform::from_scale(Vec3::splat(scale)),
                Transform::from_translation(direction * (1.5 + gap) * scale)
                    .with_rotation(turn.inverse())
                    .with_scale(Vec3::splat(scale)),
            ];
            let entities = [(ball(2, 1.0), poses[0]), (ball(1, 0.5), poses[1])]
                .map(|(mesh, pose)| spawn(&mut app, &mesh, pose, Sidedness::Auto, 0.15 * scale));
            app.update();
            let (distance, normal) = least(&app);
            let error = (distance / scale - gap).abs();
            assert!(error < 4.0e-6, "{scale} {gap} {seed}: off by {error}");
            assert!(normal.dot(direction) > 1.0 - 1.0e-5, "{scale} {gap} {seed}: {normal} {direction}");
            for entity in entities {
                app.world_mut().despawn(entity);
            }
        }
    }
}

/// A ball in a bowl touches it where it is closest, not where the line of centers leaves the bowl on the other side.
#[test]
fn a_ball_in_a_bowl_is_as_far_from_it_as_from_the_sphere() {
    for offset in [0.2, 0.45] {
        let mut app = app();
        spawn(&mut app, &inside_out(ball(3, 1.0)), Transform::default(), Sidedness::OneSided, 0.1);
        spawn(&mut app, &ball(2, 0.5), Transform::from_xyz(0.6 * offset, 0.8 * offset, 0.0), Sidedness::Auto, 0.1);
        app.update();
        let (distance, normal) = least(&app);
        if offset > 0.3 {
            assert!((distance - (0.5 - offset)).abs() < 1.0e-5, "{distance}");
            assert!(normal.dot(Vec3::new(-0.6, -0.8, 0.0)) > 0.999, "{normal}");
        } else {
            assert!(distance.is_infinite(), "{distance}");
        }
    }
}

/// Seen from either side, a sheet is the same surface.
#[test]
fn a_sheet_is_curved_the_same_from_both_sides() {
    let (positions, triangles) = ball(3, 1.0);
    let is_upper = |corners: &[u32; 3]| corners.iter().all(|&vertex| positions[vertex as usize].y > 0.3);
    let cap: Vec<[u32; 3]> = triangles.iter().filter(|corners| is_upper(corners)).copied().collect();
    for (height, expected, up) in [(1.33, 0.03, 1.0), (0.67, 0.03, -1.0)] {
        let mut app = app();
        spawn(&mut app, &(positions.clone(), cap.clone()), Transform::default(), Sidedness::TwoSided, 0.05);
        let turned = Transform::from_xyz(0.0, height, 0.0).with_rotation(Quat::from_rotation_z(0.7));
        spawn(&mut app, &ball(2, 0.3), turned, Sidedness::Auto, 0.05);
        app.update();
        let (distance, normal) = least(&app);
        assert!((distance - expected).abs() < 1.0e-4, "{height}: {distance}");
        assert!(normal.y * up > 0.999, "{height}: {normal}");
    }
}

/// Bodies whose faces, edges, and rims meet in all ways: no body passes unseen.
#[test]
fn no_pair_of_bodies_is_missed() {
    let shapes = [
        BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5)),
        BodyShape::Torus(0.8, 0.3),
        BodyShape::Capsule(0.3, 0.6),
        BodyShape::Ball(0.6),
    ];
    let mut worst = 0.0_f64;
    for seed in 0..60_u8 {
        let number = f64::from(seed);
        let pair = [shapes[usize::from(seed) % 4], shapes[usize::from(seed) / 4 % 4]];
        let rotation = |seed: f64| DMat3::from_rotation_x(1.9 * seed) * DMat3::from_rotation_y(0.8 * seed);
        let direction = rotation(number + 0.4) * DVec3::X;
        let body = |side: usize, far: f64| SmoothBody {
            shape: pair[side],
            rotation: rotation(number * 1.7 + side as f64),
            center: direction * if side == 0 { 0.0 } else { far },
        };
        let starts: Vec<DVec3> = {
            let first = body(0, 0.0);
            mesh_of(pair[0], 3).positions.iter().map(|p| first.rotation * DVec3::from(p.map(f64::from))).collect()
        };
        let mut far = 3.0;
        for _ in 0..12 {
            far += 0.02 - body(0, far).distance(&body(1, far), &starts).distance;
        }
        let mut app = app();
        for side in 0..2 {
            let mesh = mesh_of(pair[side], 1);
            let positions = BodyMesh::new(body(side, far), &mesh).positions;
            spawn(&mut app, &(positions, mesh.triangles), Transform::default(), Sidedness::Auto, 0.05);
        }
        app.update();
        let (distance, _) = least(&app);
        assert!(distance.is_finite(), "{pair:?} {seed}");
        worst = worst.max((f64::from(distance) - 0.02).abs());
    }
    println!("largest error {worst}");
    assert!(worst < 0.05, "{worst}");
}
