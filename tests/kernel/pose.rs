//! Similarity transforms against plain f64 arithmetic.

use crate::{common::Random, truth::random_rotation};
use bevy_circumsphere::kernel::pose::{Pose, PoseError};
use glam::{Affine3A, DMat3, DVec3, Mat3A, Quat, Vec3, Vec3A};

fn affine(random: &mut Random, scale: f32, mirrored: bool, reach: f64) -> Affine3A {
    let turn = random_rotation(random).as_quat();
    let mirror = if mirrored { -1.0 } else { 1.0 };
    Affine3A::from_scale_rotation_translation(
        Vec3::new(scale * mirror, scale, scale),
        turn,
        (random.vector() * reach).as_vec3(),
    )
}

#[test]
fn anything_but_a_similarity_is_refused() {
    let from = |x: [f32; 3], y: [f32; 3], z: [f32; 3]| {
        Pose::from_affine(&Affine3A::from_mat3_translation(
            glam::Mat3::from_cols(Vec3::from(x), Vec3::from(y), Vec3::from(z)),
            Vec3::ZERO,
        ))
    };
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    assert!(from(x, y, z).is_ok());
    for uneven in [1.01f32, 0.99, 2.0, 1.0e-3, 0.0, 1.0e20] {
        assert_eq!(from([uneven, 0.0, 0.0], y, z), Err(PoseError::NonUniformScale), "{uneven}");
        assert_eq!(from(x, [0.0, uneven, 0.0], z), Err(PoseError::NonUniformScale));
        assert_eq!(from(x, y, [0.0, 0.0, uneven]), Err(PoseError::NonUniformScale));
    }
    // A shear by 1/100 that preserves the lengths of the axes, and one that collapses them into a plane.
    for angle in [0.01f64, 0.5, 1.0] {
        let leaning = [angle.sin() as f32, angle.cos() as f32, 0.0];
        assert_eq!(from(x, leaning, z), Err(PoseError::NonUniformScale));
        assert_eq!(from(leaning, y, z), Err(PoseError::NonUniformScale));
    }
    assert_eq!(from(x, x, x), Err(PoseError::NonUniformScale));
    assert_eq!(from([0.0; 3], [0.0; 3], [0.0; 3]), Err(PoseError::ZeroScale));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(from([bad, 0.0, 0.0], y, z), Err(PoseError::NonFinite));
        let moved = Affine3A { matrix3: Mat3A::IDENTITY, translation: Vec3A::new(0.0, bad, 0.0) };
        assert_eq!(Pose::from_affine(&moved), Err(PoseError::NonFinite));
    }
}

#[test]
fn every_similarity_is_taken_with_its_scale_and_its_mirroring() {
    let mut random = Random::new(1);
    let mut checked = 0;
    for exponent in -20..=20 {
        for mirrored in [false, true] {
            for _ in 0..20 {
                let scale = 2f32.powi(exponent) * random.range(1.0, 2.0) as f32;
                let affine = affine(&mut random, scale, mirrored, 1.0e6);
                let pose = Pose::from_affine(&affine).expect("it is a similarity");
                assert_eq!(pose.is_mirrored(), mirrored);
                // A rotation stored in f32 scales by up to a few units in the last place.
                assert!((pose.scale() / f64::from(scale) - 1.0).abs() < 1.0e-6);
                let inverse = pose.inverse();
                assert_eq!(inverse.is_mirrored(), mirrored);
                assert!((inverse.scale() * pose.scale() - 1.0).abs() < 1.0e-12);
                checked += 1;
            }
        }
    }
    assert!(checked > 1_600);
    // A flip of three axes is a mirroring, a flip of two is a rotation.
    let turned = |x: f32, y: f32, z: f32| {
        Pose::from_affine(&Affine3A::from_scale(Vec3::new(x, y, z))).expect("it is a similarity").is_mirrored()
    };
    assert!(turned(-1.0, -1.0, -1.0) && turned(1.0, -1.0, 1.0) && !turned(-1.0, 1.0, -1.0));
}

/// Applies a stored affine in f64. Its coefficients are exact.
fn apply(affine: &Affine3A, point: DVec3) -> DVec3 {
    let columns =
        [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis].map(|c| Vec3::from(c).as_dvec3());
    columns[0] * point.x + columns[1] * point.y + columns[2] * point.z + Vec3::from(affine.translation).as_dvec3()
}

/// Solves for the point that an affine without its translation maps to `image`, by Cramer's rule.
fn solve(affine: &Affine3A, image: DVec3) -> DVec3 {
    let [x, y, z] =
        [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis].map(|c| Vec3::from(c).as_dvec3());
    let volume = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c));
    let whole = volume(x, y, z);
    DVec3::new(volume(image, y, z), volume(x, image, z), volume(x, y, image)) / whole
}

#[test]
fn points_and_directions_move_as_the_stored_transform_says() {
    let mut random = Random::new(2);
    for _ in 0..2_000 {
        let (scale, mirrored) = (random.power_of_ten(-3.0, 3.0) as f32, random.below(2) == 0);
        let affine = affine(&mut random, scale, mirrored, 1.0e6);
        let pose = Pose::from_affine(&affine).expect("it is a similarity");
        let point = random.vector() * random.power_of_ten(-3.0, 3.0);
        let (found, expected) = (pose.transform_point(point), apply(&affine, point));
        // Rounding of half a dozen f64 operations.
        let size = 1.0e6 + f64::from(scale) * 1.0e3;
        assert!(found.distance(expected) <= 1.0e-15 * size, "{found} {expected}");
        let direction = random.direction();
        let moved = apply(&affine, direction) - apply(&affine, DVec3::ZERO);
        // The rotation is only as orthogonal as its f32 values. The translation cancels to 1e-10.
        assert!(pose.transform_direction(direction).distance(moved.normalize()) <= 1.0e-6 + 1.0e-9 / f64::from(scale));
        let other = random.direction();
        let turned = pose.transform_direction(direction).dot(other);
        assert!((turned - direction.dot(pose.inverse_transform_direction(other))).abs() <= 1.0e-14);
        let stored = point.as_vec3();
        let mut moved = Vec::new();
        pose.transform_points(&[stored], &mut moved);
        let expected = apply(&affine, stored.as_dvec3());
        let tolerance = expected.abs() * 6.1e-8 + DVec3::splat(1.0e-9);
        assert!((moved[0].as_dvec3() - expected).abs().cmple(tolerance).all(), "rounded once: {moved:?} {expected}");
    }
}

#[test]
fn relative_poses_far_from_the_origin_keep_their_precision() {
    let mut random = Random::new(3);
    let (mut worst, mut checked) = (0f64, 0);
    for _ in 0..5_000 {
        let (scale_a, scale_b) = (random.range(0.5, 2.0) as f32, random.range(0.5, 2.0) as f32);
        let (mirror_a, mirror_b) = (random.below(2) == 0, random.below(2) == 0);
        let mut a = affine(&mut random, scale_a, mirror_a, 1.0);
        let mut b = affine(&mut random, scale_b, mirror_b, 1.0);
        // Two neighbors at a distance of a million from the origin. f32 is coarse there (1/16), but stored values are
        // exact.
        let far = (random.direction() * 1.0e6).as_vec3();
        a.translation += Vec3A::from(far);
        b.translation += Vec3A::from(far);
        let (pose_a, pose_b) = (Pose::from_affine(&a).expect("similarity"), Pose::from_affine(&b).expect("similarity"));
        let relative = pose_a.relative_to(&pose_b);
        assert_eq!(relative.is_mirrored(), mirror_a != mirror_b);
        assert!((relative.scale() / (f64::from(scale_a) / f64::from(scale_b)) - 1.0).abs() < 1.0e-6);
        let point = random.vector() * 2.0;
        // The difference of the stored translations is exact, so no large numbers are added.
        let between = Vec3::from(a.translation).as_dvec3() - Vec3::from(b.translation).as_dvec3();
        let linear = Affine3A { translation: Vec3A::ZERO, ..a };
        let expected = solve(&b, apply(&linear, point) + between);
        let error = relative.transform_point(point).distance(expected);
        worst = worst.max(error);
        checked += 1;
    }
    println!("{checked} relative poses at 1e6, worst error {worst:.1e}");
    // f64 resolves 1e-10 at a million, and there are a few operations.
    assert!(worst <= 2.0e-9 && checked == 5_000, "{worst:e}");
}

#[test]
fn a_pose_and_its_inverse_cancel_and_equal_poses_are_relative_by_nothing() {
    let mut random = Random::new(4);
    for _ in 0..2_000 {
        let (scale, mirrored) = (random.power_of_ten(-3.0, 3.0) as f32, random.below(2) == 0);
        let pose = Pose::from_affine(&affine(&mut random, scale, mirrored, 100.0)).expect("similarity");
        assert_eq!(pose.relative_to(&pose), Pose::IDENTITY);
        let point = random.vector();
        for cancelled in [pose.inverse().after(&pose), pose.after(&pose.inverse())] {
            // Translations of 100 over scales of 1e-3 cancel down to f64 rounding.
            assert!(cancelled.transform_point(point).distance(point) <= 1.0e-9);
            assert!((cancelled.scale() - 1.0).abs() <= 1.0e-12);
            assert!(!cancelled.is_mirrored());
        }
        let other = Pose::from_affine(&affine(&mut random, 1.5, false, 100.0)).expect("similarity");
        let (inner_first, by_hand) = (pose.after(&other).transform_point(point), {
            let inner = other.transform_point(point);
            pose.transform_point(inner)
        });
        assert!(inner_first.distance(by_hand) <= 1.0e-12 * (1.0 + f64::from(scale) * 200.0 + 100.0));
    }
    assert_eq!(Pose::default(), Pose::IDENTITY);
    assert_eq!(Pose::IDENTITY.inverse().transform_point(DVec3::ONE), DVec3::ONE);
    assert!(DMat3::IDENTITY.determinant() > 0.0 && !Pose::IDENTITY.is_mirrored());
    assert_eq!(Pose::from_affine(&Affine3A::from_quat(Quat::IDENTITY)), Ok(Pose::IDENTITY));
}
