//! Triangles and boxes transformed into another frame, against f64 and against single transforms.

use bevy_circumsphere::kernel::{
    bvh::{
        moved_triangles::{MovingMesh, Reach},
        tree::BoxTree,
    },
    mesh::bounds::{Aabb, bounds_of_moved, triangle_bounds},
    pose::Pose,
};
use circumsphere_support::scenes::triangle_soup;
use glam::{Affine3A, DVec3, Quat, Vec3};

use crate::common::Random;

/// Similarities of all sizes, near the origin and far from it, some mirrored.
fn random_pose(random: &mut Random) -> Pose {
    let turn = Quat::from_axis_angle((random.vector() + DVec3::Z * 2.0).normalize().as_vec3(), random.below(7) as f32);
    let scale = random.power_of_ten(-2.0, 2.0) as f32;
    let mirror = if random.below(3) == 0 { -1.0 } else { 1.0 };
    let translation = (random.vector() * random.power_of_ten(-1.0, 4.0)).as_vec3();
    let affine = Affine3A::from_scale_rotation_translation(Vec3::splat(mirror * scale), turn, translation);
    Pose::from_affine(&affine).expect("it is a similarity")
}

fn moved(pose: &Pose, point: Vec3) -> DVec3 {
    pose.transform_point(point.as_dvec3())
}

#[test]
fn a_box_around_moved_points_holds_them_all_and_hardly_more() {
    let mut random = Random::new(1);
    for round in 0..2_000 {
        let pose = random_pose(&mut random);
        let points: Vec<Vec3> = (0..=round % 40).map(|_| (random.vector() * 3.0).as_vec3()).collect();
        let bounds = bounds_of_moved(&pose, &points);
        let (low, high) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let exact: Vec<DVec3> = points.iter().map(|&point| moved(&pose, point)).collect();
        let (least, most) = exact
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(least, most), &point| (least.min(point), most.max(point)));
        assert!(low.cmple(least).all() && most.cmple(high).all(), "{bounds:?} of {least} to {most}");
        // Each coordinate is the sum of three products and a translation. The slack is twice the rounding on either
        // side.
        let size = 9.0 * pose.scale() + pose.to_affine().translation.abs().max_element();
        let slack = 2.0 * 10.0 * f64::from(f32::EPSILON) * size;
        assert!((least - low).max(high - most).max_element() <= slack, "{bounds:?} of {least} to {most}");
    }
    assert_eq!(bounds_of_moved(&random_pose(&mut random), &[]).min, Vec3::INFINITY);
    // The rotation cancels the translation, but overflows on the way.
    let far = Affine3A::from_scale_rotation_translation(Vec3::splat(1.0e30), Quat::IDENTITY, Vec3::NEG_X * 3.0e38);
    let pose = Pose::from_affine(&far).expect("it is a similarity");
    let bounds = bounds_of_moved(&pose, &[Vec3::ZERO, Vec3::X * 6.0e8, Vec3::X * 3.0e8]);
    assert_eq!([bounds.min, bounds.max], [Vec3::NEG_INFINITY, Vec3::INFINITY]);
}

fn bits(vector: Vec3) -> [u32; 3] {
    vector.to_array().map(f32::to_bits)
}

#[test]
fn moved_triangles_are_those_that_are_moved_one_by_one() {
    let mut random = Random::new(2);
    for round in 0..400 {
        let mesh = triangle_soup(60, round);
        let own: Vec<Vec3> = mesh.positions.iter().map(|&position| position.into()).collect();
        let (pose, growth) = (random_pose(&mut random), random.power_of_ten(-4.0, 0.0) as f32);
        let named: Vec<u32> = (0..round as u32 % 30).map(|_| random.below(60) as u32).collect();
        let (mut places, mut bounds) = (vec![Vec3::NAN; own.len()], vec![(7, Aabb::EMPTY)]);
        let moving = MovingMesh { pose: &pose, positions: &own, triangles: &mesh.triangles, growth };
        let largest = moving.move_triangles(&named, &mut places, &mut bounds);
        assert_eq!(bounds.len(), 1 + named.len(), "existing boxes stay");
        let (mut expected_largest, mut touched) = (0.0_f32, vec![false; own.len()]);
        for (&triangle, (name, found)) in named.iter().zip(&bounds[1..]) {
            let vertices = mesh.triangles[triangle as usize];
            let corners = vertices.map(|vertex| moved(&pose, own[vertex as usize]).as_vec3());
            let expected = Aabb::from_points(corners).grown(growth);
            assert_eq!((*name, bits(found.min), bits(found.max)), (triangle, bits(expected.min), bits(expected.max)));
            for (vertex, corner) in vertices.into_iter().zip(corners) {
                touched[vertex as usize] = true;
                assert_eq!(bits(places[vertex as usize]), bits(corner));
                expected_largest = expected_largest.max(corner.abs().max_element());
            }
        }
        assert_eq!(largest, expected_largest);
        assert!(places.iter().zip(&touched).all(|(place, touched)| *touched != place.is_nan()), "others stay");
    }
}

/// Points of a transformed box, on a grid.
fn points_of(pose: &Pose, bounds: &Aabb) -> impl Iterator<Item = DVec3> {
    let (low, size) = (bounds.min.as_dvec3(), (bounds.max - bounds.min).as_dvec3());
    let share = |number: usize| number as f64 / 4.0;
    (0..125).map(move |number| {
        pose.transform_point(low + size * DVec3::new(share(number % 5), share(number / 5 % 5), share(number / 25)))
    })
}

#[test]
fn leaves_that_reach_a_box_are_visited_and_most_others_are_not() {
    let mut random = Random::new(3);
    let (mut visited, mut met, mut all) = (0, 0, 0);
    for round in 0..200 {
        let mesh = triangle_soup(2_000, round);
        let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| position.into()).collect();
        let mut boxes = Vec::new();
        triangle_bounds(&positions, &mesh.triangles, 0.01, &mut boxes);
        let mut tree = BoxTree::default();
        tree.rebuild(&boxes);
        let pose = random_pose(&mut random);
        // Near one of the boxes.
        let middle = moved(&pose, positions[random.below(positions.len())]);
        let half = DVec3::splat(0.2 * pose.scale()) * (random.vector().abs() + 0.1);
        let target = Aabb { min: (middle - half).as_vec3(), max: (middle + half).as_vec3() };
        let mut found = vec![false; boxes.len()];
        tree.visit_reaching(&Reach::new(&pose, &target), |items| {
            for &item in items {
                found[item as usize] = true;
            }
        });
        for (bounds, found) in boxes.iter().zip(&found) {
            let (low, high) = (target.min.as_dvec3(), target.max.as_dvec3());
            let meets = points_of(&pose, bounds).any(|point| low.cmple(point).all() && point.cmple(high).all());
            assert!(!meets || *found, "{bounds:?} meets {target:?}");
            met += usize::from(meets);
        }
        visited += found.iter().filter(|found| **found).count();
        all += boxes.len();
    }
    println!("{met} of {all} boxes meet for certain, {visited} were in leaves that may");
    assert!(met > 1_000 && visited > met && 3 * visited < all);
}
