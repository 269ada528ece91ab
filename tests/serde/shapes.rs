//! Rigid shapes that are saved and loaded touch the same, and data that is no shape is an error.

use bevy_app::prelude::*;
use bevy_circumsphere::{ContactStore, prelude::*};
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, grid},
};
use glam::{Quat, Vec3};
use parry3d::{math::Pose, shape::HeightField, utils::Array2};
use serde_json::{Value, json};

use crate::bodies::spoil;

/// A shape of every kind, each of which reaches up to a sheet at y = 0.3.
fn shapes() -> Vec<(&'static str, SharedShape)> {
    let [a, b, c] = [Vec3::new(-0.5, 0.3, -0.5), Vec3::new(0.5, 0.31, -0.4), Vec3::new(0.0, 0.29, 0.5)];
    let corners = [a, b, c, Vec3::new(0.0, -0.5, 0.0)];
    let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let heights = Array2::new(3, 3, vec![0.3, 0.2, 0.3, 0.25, 0.3, 0.28, 0.3, 0.29, 0.3]);
    let turned = Pose::from_parts(Vec3::new(0.3, 0.0, 0.0), Quat::from_rotation_y(0.3));
    let part = |shape: SharedShape| (turned, shape);
    vec![
        ("ball", SharedShape::ball(0.3)),
        ("capsule", SharedShape::capsule(a - 0.1 * Vec3::Y, b - 0.1 * Vec3::Y, 0.1)),
        ("cuboid", SharedShape::cuboid(0.5, 0.3, 0.4)),
        ("round cuboid", SharedShape::round_cuboid(0.4, 0.2, 0.3, 0.1)),
        ("cylinder", SharedShape::cylinder(0.3, 0.4)),
        ("round cylinder", SharedShape::round_cylinder(0.2, 0.3, 0.1)),
        ("cone", SharedShape::cone(0.3, 0.4)),
        ("round cone", SharedShape::round_cone(0.2, 0.3, 0.1)),
        ("convex hull", SharedShape::convex_hull(&corners).expect("a hull")),
        ("round convex hull", SharedShape::round_convex_hull(&corners, 0.01).expect("a hull")),
        ("half-space", SharedShape::halfspace(Vec3::new(0.5, 1.0, 0.0))),
        (
            "compound",
            SharedShape::compound(vec![part(SharedShape::ball(0.3)), part(SharedShape::cuboid(0.1, 0.3, 0.1))]),
        ),
        ("triangle", SharedShape::triangle(a, b, c)),
        ("round triangle", SharedShape::round_triangle(a, b, c, 0.01)),
        ("segment", SharedShape::segment(a, b)),
        ("polyline", SharedShape::polyline(vec![a, b, c], None)),
        ("triangle mesh", SharedShape::trimesh(corners.to_vec(), triangles).expect("a mesh")),
        ("height field", SharedShape::new(HeightField::new(heights, Vec3::new(1.0, 1.0, 1.0)))),
        ("voxels", SharedShape::voxels(Vec3::splat(0.2), &[glam::IVec3::new(0, 0, 0), glam::IVec3::new(1, 1, 0)])),
    ]
}

/// The contacts of a sheet at y = 0.3 with a shape.
fn contacts(shape: RigidShape) -> (usize, String) {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let mesh = grid(8, 8, 1.5, 1.5, Diagonals::Alternating);
    let wave = |at: [f32; 3]| Vec3::from_array(at) + Vec3::Y * (0.3 + 0.02 * bevy_math::ops::sin(5.0 * at[0]));
    let points: Vec<Vec3> = mesh.positions.iter().map(|&at| wave(at)).collect();
    let sheet = DeformableSurface::from_mesh(&points, &mesh.triangles).expect("the mesh is sound");
    app.world_mut().spawn((sheet, SurfaceThickness::World(0.1)));
    let shape = app.world_mut().spawn(shape).id();
    app.update();
    let status = app.world().get::<SurfaceStatus>(shape).expect("it has one");
    let store = app.world().resource::<ContactStore>();
    (store.contact_count(), format!("{status:?} {:?}", store.contacts().collect::<Vec<_>>()))
}

#[test]
fn shapes_of_every_kind_come_back() {
    for (name, shape) in shapes() {
        let made = RigidShape(shape);
        let (count, expected) = contacts(made.clone());
        assert!(count > 0, "the sheet touches the {name}: {expected}");
        let text = ron::to_string(&made).unwrap_or_else(|error| panic!("{name}: {error}"));
        let read: RigidShape = ron::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(contacts(read).1, expected, "{name}");
        // The maps of voxels have keys that JSON cannot write.
        if name != "voxels" {
            let text = serde_json::to_string(&made).unwrap_or_else(|error| panic!("{name}: {error}"));
            let read: RigidShape = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(contacts(read).1, expected, "{name}");
        }
    }
}

#[test]
fn data_that_is_no_shape_is_an_error() {
    let written = |shape: SharedShape| serde_json::to_value(RigidShape(shape)).expect("it can be written");
    let read = |value: &Value| serde_json::from_value::<RigidShape>(value.clone());
    for (value, path, number) in [
        (written(SharedShape::ball(1.0)), "/Ball/radius", json!(-1.0)),
        (written(SharedShape::ball(1.0)), "/Ball/radius", json!(1.0e300)),
        (written(SharedShape::cuboid(1.0, 1.0, 1.0)), "/Cuboid/half_extents/1", json!(-0.5)),
        (written(SharedShape::halfspace(Vec3::Y)), "/HalfSpace/normal/1", json!(0.0)),
    ] {
        assert!(read(&value).is_ok());
        let mut value = value;
        *value.pointer_mut(path).unwrap_or_else(|| panic!("no {path}")) = number;
        assert!(read(&value).is_err(), "{value}");
    }
    let text = ron::to_string(&RigidShape(SharedShape::ball(f32::NAN))).expect("it can be written");
    assert!(ron::from_str::<RigidShape>(&text).is_err(), "{text}");
}

#[test]
fn no_change_of_a_number_in_a_shape_panics() {
    let mut random = Random::new(31);
    let [mut accepted, mut refused] = [0, 0];
    for (name, shape) in shapes().into_iter().filter(|(name, _)| *name != "voxels") {
        let written = serde_json::to_value(RigidShape(shape)).unwrap_or_else(|error| panic!("{name}: {error}"));
        for _ in 0..25 {
            let mut value = written.clone();
            spoil(&mut value, &mut random);
            match serde_json::from_value::<RigidShape>(value) {
                Ok(read) => {
                    accepted += 1;
                    contacts(read);
                }
                Err(_) => refused += 1,
            }
        }
    }
    assert!(accepted > 100 && refused > 50, "{accepted} accepted, {refused} refused");
}
