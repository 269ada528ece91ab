//! Surfaces with their own poses, up to a million sizes away from the origin: the same pairs as the reference, which
//! composes the poses in f64.

use crate::strategies::{Turn, far_offset, offset, turn, two_meshes};
use bevy_transform::components::Transform;
use glam::{DAffine3, DVec3, Vec3};
use proptest::prelude::*;

use crate::{
    agreement::edges,
    harness::{BAND, Body, Count, Judge, Setup, SmallWorld, between, for_all, mean_edge, truth_between, wide},
};

fn transform(turn: Turn, translation: Vec3, scale: f32, mirrored: bool) -> Transform {
    let axis = Vec3::from_array(turn.axis).as_dvec3().normalize();
    let rotation = glam::DQuat::from_axis_angle(axis, f64::from(turn.angle)).as_quat();
    let sign = if mirrored { -1.0 } else { 1.0 };
    Transform { translation, rotation, scale: Vec3::new(sign * scale, scale, scale) }
}

/// The stored transform, taken as exact.
fn affine(transform: &Transform) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(
        transform.scale.as_dvec3(),
        transform.rotation.as_dquat().normalize(),
        transform.translation.as_dvec3(),
    )
}

fn largest(points: impl IntoIterator<Item = DVec3>) -> f64 {
    points.into_iter().map(|point| point.abs().max_element()).fold(0.0, f64::max)
}

#[test]
fn surfaces_in_any_pose_touch_as_the_reference_says() {
    let (crossing, apart, far) = (Count::default(), Count::default(), Count::default());
    let scale = || prop_oneof![Just(1.0f32), 0.2f32..5.0];
    let own = || (turn(), offset(0.3), scale(), any::<bool>());
    let case = (two_meshes(), own(), own(), far_offset(), edges());
    for_all(file!(), 600, case, |(meshes, first, second, far_offset, edges)| {
        let place = |(turn, offset, scale, mirrored): (Turn, [f32; 3], f32, bool)| {
            transform(turn, Vec3::from_array(far_offset) + Vec3::from_array(offset), scale, mirrored)
        };
        let transforms = [place(first), place(second)];
        let scales = transforms.map(|transform| f64::from(transform.scale.y));
        let distance = (edges * mean_edge(&meshes[0]) * scales[0]) as f32;
        let bodies: Vec<Body> = meshes
            .iter()
            .zip(transforms)
            .map(|(mesh, transform)| Body { transform, self_collision: false, ..Body::new(mesh) })
            .collect();
        let affines = transforms.map(|transform| affine(&transform));
        let world = [0, 1].map(|side| -> Vec<DVec3> {
            wide(&bodies[side].positions).into_iter().map(|point| affines[side].transform_point3(point)).collect()
        });
        // Vertices are rounded once, in the frame of one of the two surfaces.
        let rounding = [0, 1].map(|side| {
            let to_frame = affines[side].inverse();
            let coordinate = largest(world.iter().flatten().map(|&point| to_frame.transform_point3(point)));
            4.0 * f64::from(f32::EPSILON) * coordinate * scales[side]
        });
        let distance_f64 = f64::from(distance);
        let band = (BAND * distance_f64).max(rounding[0].max(rounding[1]));
        let triangles = [&meshes[0].triangles[..], &meshes[1].triangles[..]];
        let truth = truth_between((&world[0], triangles[0]), (&world[1], triangles[1]), distance_f64 + 2.0 * band);
        crossing.add(truth.iter().filter(|pair| pair.distance == 0.0).count());
        apart.add(truth.iter().filter(|pair| pair.distance > band && pair.distance < distance_f64 - band).count());
        far.add(usize::from(largest(world[0].iter().copied()) > 1.0e4 && !truth.is_empty()));
        let corners = [(&world[0][..], triangles[0]), (&world[1][..], triangles[1])];
        let judge = Judge { corners, distance: distance_f64, band };
        for setup in Setup::exact() {
            let found = SmallWorld::new(&bodies, distance, setup).tick();
            judge.assert_right(&format!("{setup:?}"), between(&found, [0, 1]), &truth);
        }
    });
    crossing.assert_at_least(3_000, "crossing pairs");
    apart.assert_at_least(10_000, "pairs that are apart");
    far.assert_at_least(10, "scenes more than 10,000 away from the origin");
}
