//! Smooth surfaces against rigid shapes: by sampled patches, and by bodies whose distance is known.

use bevy_app::{App, Update};
use bevy_circumsphere::{ContactStore, RigidShape, prelude::*};
use bevy_transform::components::Transform;
use circumsphere_truth::{BodyShape, CurvedMesh, ReferencePatch, SmoothBody, exact_weld, point_triangle};
use glam::{DVec3, EulerRot, Quat, Vec3};
use parry3d::{
    math::Pose3,
    query::PointQuery,
    shape::{Ball, ConvexPolyhedron, HalfSpace, SharedShape},
};

use crate::bodies::{BodyMesh, CREASE, mesh_of, rotation};

/// Samples along an edge of a patch.
const SAMPLES: usize = 24;

/// How often the neighborhood of the closest sample is sampled again, each time four times finer.
const ZOOMS: usize = 6;

fn shapes() -> Vec<(&'static str, SharedShape)> {
    let corners: Vec<Vec3> = (0..12)
        .map(|k| Quat::from_euler(EulerRot::XYZ, k as f32, 1.7 * k as f32, 0.6 * k as f32) * Vec3::new(0.7, 0.0, 0.0))
        .collect();
    let at = |x, y, z| Pose3::from_translation(Vec3::new(x, y, z));
    let parts = vec![
        (at(0.0, 0.0, 0.0), SharedShape::cuboid(0.3, 0.2, 0.5)),
        (at(0.3, 0.1, 0.0), SharedShape::ball(0.4)),
        (at(-0.4, 0.0, 0.2), SharedShape::cylinder(0.3, 0.2)),
    ];
    vec![
        ("ball", SharedShape::ball(0.6)),
        ("small ball", SharedShape::ball(0.05)),
        ("capsule", SharedShape::capsule_y(0.5, 0.3)),
        ("cuboid", SharedShape::cuboid(0.5, 0.3, 0.7)),
        ("round cuboid", SharedShape::round_cuboid(0.5, 0.3, 0.4, 0.1)),
        ("hull", SharedShape::convex_hull(&corners).expect("a hull")),
        ("cylinder", SharedShape::cylinder(0.4, 0.5)),
        ("cone", SharedShape::cone(0.5, 0.4)),
        ("round cylinder", SharedShape::round_cylinder(0.4, 0.5, 0.1)),
        ("half-space", SharedShape::halfspace(Vec3::new(0.2, 1.0, -0.3).normalize())),
        ("compound", SharedShape::compound(parts)),
    ]
}

/// The patches of a mesh, by the reference.
fn patches_of(mesh: &BodyMesh) -> Vec<ReferencePatch> {
    let positions: Vec<DVec3> = mesh.positions.iter().map(|position| position.as_dvec3()).collect();
    let triangles = mesh.topology.triangles();
    let weld = exact_weld(&positions);
    let offsets = CurvedMesh::new(&positions, triangles, &weld, f64::from(CREASE)).offsets();
    let patch = |corners: &[u32; 3]| {
        let own = corners.map(|vertex| weld[vertex as usize]);
        let of_edge = |k: usize| {
            let (start, end) = (own[k], own[(k + 1) % 3]);
            offsets.get(&[start.min(end), start.max(end)]).copied().unwrap_or_default()
        };
        ReferencePatch::bent(corners.map(|vertex| positions[vertex as usize]), [of_edge(0), of_edge(1), of_edge(2)])
    };
    triangles.iter().map(patch).collect()
}

/// The least distance over a patch, sampled. Not finely if it is far more than `enough`.
fn sampled(patch: &ReferencePatch, distance: &impl Fn(DVec3) -> f64, enough: f64) -> f64 {
    let (mut center, mut reach) = ([0.5; 2], 0.5);
    let mut least = f64::INFINITY;
    for zoom in 0..=ZOOMS {
        let around = center;
        for i in 0..=SAMPLES {
            for j in 0..=SAMPLES {
                let offset = |k: usize| reach * (2.0 * k as f64 / SAMPLES as f64 - 1.0);
                let (u, v) = (f64::max(around[0] + offset(i), 0.0), f64::max(around[1] + offset(j), 0.0));
                let sum = f64::max(u + v, 1.0);
                let (u, v) = (u / sum, v / sum);
                let own = distance(patch.point([1.0 - u - v, u, v]));
                if own < least {
                    (least, center) = (own, [u, v]);
                }
            }
        }
        // The samples are far closer to each other than this.
        if least > 2.0 * enough {
            return least;
        }
        if zoom == 0 {
            reach = 4.0 / SAMPLES as f64;
        } else {
            reach /= 4.0;
        }
    }
    least
}

/// A smooth or flat body and a shape that touch within a distance, after one tick.
fn app_of(mesh: &BodyMesh, shape: SurfaceShape, solid: &SharedShape, pose: &Transform, distance: f64) -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let surface = DeformableSurface::from_mesh(&mesh.positions, mesh.topology.triangles()).expect("a mesh");
    app.world_mut().spawn((surface, SurfaceThickness::World(distance as f32), shape));
    app.world_mut().spawn((RigidShape(solid.clone()), *pose));
    app.update();
    app
}

/// Where a shape is, so that it is this far from a mesh's patches, seen from a direction.
fn placed(patches: &[ReferencePatch], solid: &SharedShape, direction: DVec3, turn: f32, gap: f64) -> Transform {
    let rotation = Quat::from_euler(EulerRot::XYZ, turn, 2.3 * turn, 0.7 * turn);
    // A half-space faces the body.
    let rotation = solid
        .as_shape::<HalfSpace>()
        .map_or(rotation, |half_space| Quat::from_rotation_arc(half_space.normal, -direction.as_vec3()));
    let pose = |far: f64| Transform::from_translation((direction * far).as_vec3()).with_rotation(rotation);
    let mut far = 3.0;
    for _ in 0..10 {
        let least = patches
            .iter()
            .flat_map(|patch| {
                let of = |point| to_shape(solid, &pose(far), point);
                [[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [1.0 / 3.0; 3]].map(|weights| of(patch.point(weights)))
            })
            .fold(f64::INFINITY, f64::min);
        far += gap - least;
    }
    pose(far)
}

/// Signed distance of a point from a convex hull, by all its faces.
fn to_hull(hull: &ConvexPolyhedron, point: DVec3) -> f64 {
    let (points, faces) = hull.to_trimesh();
    let corners = faces.iter().map(|face| face.map(|vertex| points[vertex as usize].as_dvec3()));
    let (mut outside, mut depth) = (f64::INFINITY, f64::NEG_INFINITY);
    for corners in corners {
        outside = outside.min(point_triangle(point, &corners).distance);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        depth = depth.max(normal.dot(point - corners[0]));
    }
    if depth < 0.0 { depth } else { outside }
}

fn to_shape(solid: &SharedShape, pose: &Transform, point: DVec3) -> f64 {
    if let Some(hull) = solid.as_convex_polyhedron() {
        let (rotation, translation) = (pose.rotation.as_dquat(), pose.translation.as_dvec3());
        return to_hull(hull, rotation.inverse() * (point - translation));
    }
    let pose = Pose3::from_parts(pose.translation, pose.rotation);
    let point = point.as_vec3();
    // The distance from the inner shape is exact. That from the rounded shape is found by a search.
    let bordered =
        |inner: &dyn PointQuery, border: f32| f64::from(inner.distance_to_point(&pose, point, false) - border);
    if let Some(round) = solid.as_round_cuboid() {
        return bordered(&round.inner_shape, round.border_radius);
    }
    if let Some(round) = solid.as_round_cylinder() {
        return bordered(&round.inner_shape, round.border_radius);
    }
    f64::from(solid.distance_to_point(&pose, point, false))
}

#[test]
fn patches_are_as_far_from_shapes_as_samples_of_them() {
    let (ellipsoid, torus) = (BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5)), BodyShape::Torus(0.8, 0.3));
    let (mut touching, mut worst, mut only_patches, mut inside) = (0, 0.0_f64, 0, 0);
    for (number, shape) in [ellipsoid, torus].into_iter().enumerate() {
        let body = SmoothBody { shape, rotation: rotation(0.3), center: DVec3::ZERO };
        let mesh = BodyMesh::new(body, &mesh_of(shape, 1));
        let (patches, edge) = (patches_of(&mesh), mesh.edge());
        for (name, solid) in shapes() {
            for step in 0..8 {
                let turn = 0.7 * step as f32 + 0.4 + number as f32;
                // Not inside where parry and a compound measure depths to different places.
                let gap = if step % 2 == 0 || name == "compound" { 0.15 } else { -0.05 };
                let direction = rotation(f64::from(turn)) * DVec3::X;
                let pose = placed(&patches, &solid, direction, turn, gap * edge);
                let distance = if step % 4 < 2 { 0.2 } else { 0.5 } * edge;
                let app = app_of(&mesh, SurfaceShape::Smooth, &solid, &pose, distance);
                let store = app.world().resource::<ContactStore>();
                let mut found = vec![None; patches.len()];
                for pair in store.touching() {
                    found[pair.triangle_a as usize] = Some(pair.distance);
                }
                let tolerance = 2.0e-5 * edge;
                let mut least = f64::INFINITY;
                for (triangle, patch) in patches.iter().enumerate() {
                    let of = |point| to_shape(&solid, &pose, point);
                    if of(patch.corners[0]) > distance + 2.0 * edge {
                        assert!(found[triangle].is_none());
                        continue;
                    }
                    let expected = sampled(patch, &of, distance);
                    least = least.min(expected);
                    let flat = ReferencePatch::bent(patch.corners, [DVec3::ZERO; 3]);
                    let at = format!("{name} {shape:?} turn {turn} triangle {triangle}: {expected}");
                    match found[triangle] {
                        Some(own) => {
                            touching += 1;
                            inside += usize::from(expected < 0.0);
                            only_patches += usize::from(sampled(&flat, &of, distance) > distance);
                            worst = worst.max((own - expected.max(0.0)).abs() / edge);
                            assert!((own - expected.max(0.0)).abs() < tolerance, "{at} {own}");
                        }
                        None => assert!(expected > distance - tolerance, "{at} is missed"),
                    }
                }
                // Inside, an edge of a shape may also be deep behind a patch.
                if least > 0.0 && least <= distance {
                    let all = store.contacts().map(|contact| f64::from(contact.distance));
                    let nearest = all.fold(f64::INFINITY, f64::min);
                    assert!((nearest - least).abs() < tolerance, "{name} {shape:?} {turn}: {nearest} {least}");
                }
            }
        }
    }
    println!("{touching} touching, {only_patches} of them only as patches, {inside} inside, worst {worst:.1e} edges");
    assert!(touching > 1_000 && only_patches > 30 && inside > 50);
}

#[test]
fn contacts_are_where_they_say() {
    let shape = BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5));
    let body = SmoothBody { shape, rotation: rotation(0.3), center: DVec3::ZERO };
    let mesh = BodyMesh::new(body, &mesh_of(shape, 1));
    let (patches, edge) = (patches_of(&mesh), mesh.edge());
    let mut count = 0;
    for (name, solid) in shapes() {
        let pose = placed(&patches, &solid, rotation(0.9) * DVec3::X, 1.1, 0.1 * edge);
        let mut app = app_of(&mesh, SurfaceShape::Smooth, &solid, &pose, 0.4 * edge);
        let found = app
            .world_mut()
            .run_system_cached(|contacts: SurfaceContacts| {
                contacts
                    .iter()
                    .map(|contact| (contact.points(), contact.normal(), contact.distance()))
                    .collect::<Vec<_>>()
            })
            .expect("the system runs");
        for ((on_body, on_shape), normal, distance) in found {
            count += 1;
            let expected = to_shape(&solid, &pose, on_body.as_dvec3());
            let off = [(f64::from(distance) - expected).abs(), to_shape(&solid, &pose, on_shape.as_dvec3()).abs()];
            assert!(off.iter().all(|off| *off < 1.0e-2 * edge), "{name}: {off:?} edge {edge}");
            assert!((on_shape - on_body - normal * distance).length() < 1.0e-2 * edge as f32, "{name}");
        }
    }
    assert!(count > 100, "{count}");
}

#[test]
fn a_body_is_as_far_from_a_ball_and_a_plane_as_it_is() {
    let shape = BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5));
    for (level, most) in [(1, 0.1), (2, 0.03)] {
        let mut sums = [[0.0; 2]; 2];
        for seed in 0..24 {
            let body = SmoothBody { shape, rotation: rotation(0.37 * f64::from(seed)), center: DVec3::ZERO };
            let mesh = BodyMesh::new(body, &mesh_of(shape, level));
            let patches = patches_of(&mesh);
            let direction = rotation(f64::from(seed) + 0.5) * DVec3::X;
            for solid in [SharedShape::ball(0.5), SharedShape::halfspace(Vec3::Y)] {
                let pose = placed(&patches, &solid, direction, 0.0, 0.1 * mesh.edge());
                let center = pose.translation.as_dvec3();
                let (expected, outward) = if solid.as_shape::<Ball>().is_some() {
                    let foot = body.foot(center);
                    (foot.distance - 0.5, foot.normal)
                } else {
                    // How far the ellipsoid reaches in the direction of the plane.
                    let along = direction * center.length();
                    let extent = (body.rotation.transpose() * direction * DVec3::new(1.0, 0.7, 0.5)).length();
                    (along.length() - extent, direction)
                };
                for (shape, sum) in [SurfaceShape::Flat, SurfaceShape::Smooth].into_iter().zip(&mut sums) {
                    let app = app_of(&mesh, shape, &solid, &pose, 0.8 * mesh.edge());
                    let store = app.world().resource::<ContactStore>();
                    let least = store.contacts().min_by(|one, other| one.distance.total_cmp(&other.distance));
                    let least = least.expect("it is near");
                    let normal = pose.rotation * least.normal;
                    sum[0] += (f64::from(least.distance) - expected).abs() / mesh.edge();
                    sum[1] += f64::from(normal.dot(outward.as_vec3())).clamp(-1.0, 1.0).acos().to_degrees();
                }
            }
        }
        let [flat, smooth] = sums.map(|sum| sum.map(|sum| sum / 48.0));
        println!("level {level}: distance {smooth:?} of {flat:?}");
        assert!(smooth[0] < most * flat[0], "level {level}: {smooth:?} {flat:?}");
        // The normal at a plane is always that of the plane.
        assert!(smooth[1] < 0.5 * flat[1], "level {level}: {smooth:?} {flat:?}");
    }
}

/// Two boxes side by side are one floor, however deep a smooth body is in it.
#[test]
fn a_seam_of_a_compound_has_no_contacts_of_its_own() {
    let shape = BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5));
    let half = SharedShape::cuboid(2.0, 0.5, 2.0);
    let at = |x: f32| Pose3::from_translation(Vec3::new(x, -0.5, 0.0));
    let floor = SharedShape::compound(vec![(at(-2.0), half.clone()), (at(2.0), half)]);
    let mut inside = 0;
    for turn in 0..6 {
        let body = SmoothBody { shape, rotation: rotation(0.7 * f64::from(turn)), center: DVec3::ZERO };
        let mesh = BodyMesh::new(body, &mesh_of(shape, 1));
        let lowest = patches_of(&mesh)
            .iter()
            .flat_map(|patch| [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [1.0 / 3.0; 3]].map(|weights| patch.point(weights).y))
            .fold(f64::INFINITY, f64::min);
        for depth in [-0.02, 0.01, 0.05] {
            for aside in [-0.013, 0.0, 0.004, 0.02] {
                // The floor is placed under the body.
                let pose = Transform::from_xyz(aside, (lowest + depth * mesh.edge()) as f32, 0.0);
                let app = app_of(&mesh, SurfaceShape::Smooth, &floor, &pose, 0.1 * mesh.edge());
                let store = app.world().resource::<ContactStore>();
                for contact in store.contacts() {
                    // From the body to the floor.
                    assert!(contact.normal.y < -0.99, "turn {turn} depth {depth} aside {aside}: {contact:?}");
                    inside += usize::from(contact.distance < 0.0);
                }
                assert!(store.contact_count() > 0);
            }
        }
    }
    assert!(inside > 100, "{inside}");
}
