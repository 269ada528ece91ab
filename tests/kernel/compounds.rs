//! Triangles against unions of shapes, compared with brute force over the union.

use bevy_circumsphere::kernel::{
    exact::rigid_shape::{ShapeError, ShapeGeometry},
    mesh::{feature::Feature, topology::SurfaceTopology},
};
use glam::{DQuat, DVec3, Quat, Vec3};
use parry3d::{math::Pose, shape::SharedShape};

use crate::{
    common::Random,
    shapes::{assert_well_formed, examine, random_triangle},
    truth::random_rotation,
};

#[derive(Clone, Copy)]
struct Block {
    half: DVec3,
    rotation: DQuat,
    center: DVec3,
}

impl Block {
    fn signed(&self, point: DVec3) -> f64 {
        let beyond = (self.rotation.inverse() * (point - self.center)).abs() - self.half;
        beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
    }

    fn shape(&self) -> (Pose, SharedShape) {
        let half = self.half.as_vec3();
        let mut pose = Pose::from_translation(self.center.as_vec3());
        pose.rotation = self.rotation.as_quat();
        (pose, SharedShape::cuboid(half.x, half.y, half.z))
    }

    /// Points spread over the whole surface.
    fn surface(&self, steps: i32) -> impl Iterator<Item = DVec3> {
        let block = *self;
        (0..6).flat_map(move |side| {
            (0..=steps).flat_map(move |i| {
                (0..=steps).map(move |j| {
                    let [u, v] = [i, j].map(|step| 2.0 * f64::from(step) / f64::from(steps) - 1.0);
                    let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
                    let mut local = [DVec3::new(sign, u, v), DVec3::new(u, sign, v), DVec3::new(u, v, sign)][side / 2];
                    local *= block.half;
                    block.rotation * local + block.center
                })
            })
        })
    }
}

fn union(blocks: &[Block], point: DVec3) -> f64 {
    blocks.iter().map(|block| block.signed(point)).fold(f64::INFINITY, f64::min)
}

#[test]
fn vertices_in_a_union_are_led_to_the_nearest_point_outside() {
    let mut random = Random::new(61);
    let (mut inside, mut in_both, mut corners) = (0, 0, 0);
    for index in 0..60 {
        let mut block = |turned: bool| Block {
            half: [0, 1, 2].map(|_| random.range(0.2, 0.6) as f32 as f64).into(),
            rotation: if turned {
                random_rotation(&mut random).as_quat().normalize().as_dquat().normalize()
            } else {
                DQuat::IDENTITY
            },
            center: (random.vector() * 0.4).as_vec3().as_dvec3(),
        };
        let blocks = [block(index % 2 == 0), block(index % 2 == 0)];
        let shape =
            ShapeGeometry::new(&SharedShape::compound(blocks.iter().map(Block::shape).collect())).expect("two boxes");
        let boundary: Vec<DVec3> = (0..2)
            .flat_map(|own| blocks[own].surface(60).filter(move |point| blocks[1 - own].signed(*point) >= 0.0))
            .collect();
        for _ in 0..30 {
            let center = blocks[random.below(2)].center + random.vector() * 0.4;
            let triangle = [0, 1, 2].map(|_| center + random.vector() * 0.1);
            let (_, found) = examine(&shape, &triangle, 0.02);
            for (vertex, &corner) in triangle.iter().enumerate() {
                if union(&blocks, corner) > -1.0e-4 {
                    continue;
                }
                let own: Vec<_> =
                    found.iter().filter(|p| p.feature == Feature::Vertex(vertex as u8) && p.distance < 0.0).collect();
                let nearest = boundary.iter().map(|point| point.distance(corner)).fold(f64::INFINITY, f64::min);
                let depth = own.iter().map(|p| -p.distance).fold(f64::INFINITY, f64::min);
                // No sampled way out is shorter, and every reported one ends outside, so none is too short.
                let depths = blocks.map(|block| block.signed(corner));
                assert!(depth <= nearest + 1.0e-5, "{depth} {nearest} {depths:?} {own:?}");
                for proximity in own {
                    assert!(union(&blocks, proximity.shape_point) >= -1.0e-5, "{proximity:?}");
                    assert!((corner.distance(proximity.shape_point) + proximity.distance).abs() < 1.0e-6);
                }
                inside += 1;
                in_both += usize::from(blocks.iter().all(|block| block.signed(corner) < 0.0));
                corners += usize::from(blocks.iter().all(|block| block.signed(corner) < 0.0) && depth > 0.0);
            }
            for proximity in &found {
                assert_well_formed(&triangle, proximity);
                // The way out of the union may end on a plane of the other part where the two meet.
                let past = proximity.shape_point + proximity.normal * 3.0e-5;
                let led = if proximity.distance <= 0.0 { proximity.shape_point } else { past };
                assert!(union(&blocks, led) >= -1.0e-5, "leads into a part: {proximity:?}");
            }
        }
    }
    println!("{inside} inside, {in_both} of them in both");
    assert!(inside > 1_000 && in_both > 300 && corners == in_both);
}

#[test]
fn triangles_outside_a_union_are_as_far_as_its_nearest_part() {
    let mut random = Random::new(62);
    let mut compared = 0;
    for _ in 0..300 {
        let parts: Vec<(Pose, SharedShape)> = (0..3)
            .map(|kind| {
                let mut pose = Pose::from_translation(random.vector().as_vec3());
                pose.rotation = random_rotation(&mut random).as_quat();
                let shape = match kind {
                    0 => SharedShape::cylinder(0.4, 0.3),
                    1 => SharedShape::ball(0.3),
                    _ => SharedShape::cuboid(0.2, 0.3, 0.4),
                };
                (pose, shape)
            })
            .collect();
        let alone: Vec<ShapeGeometry> =
            parts.iter().map(|(_, shape)| ShapeGeometry::new(shape).expect("convex")).collect();
        let shape = ShapeGeometry::new(&SharedShape::compound(parts.clone())).expect("three parts");
        for _ in 0..20 {
            let triangle = random_triangle(&mut random, 1.0);
            let expected = parts
                .iter()
                .zip(&alone)
                .map(|((pose, _), shape)| {
                    let turn = pose.rotation.as_dquat().normalize().inverse();
                    let center = pose.translation.as_dvec3();
                    examine(shape, &triangle.map(|corner| turn * (corner - center)), 0.5).0
                })
                .fold(f64::INFINITY, f64::min);
            let (least, _) = examine(&shape, &triangle, 0.5);
            if expected > 1.0e-6 {
                assert!(least == expected || (least - expected).abs() <= 1.0e-4, "{least} {expected}");
                compared += usize::from(expected < 0.5);
            } else {
                assert!(least <= 1.0e-6, "{least} {expected}");
            }
        }
    }
    println!("{compared} compared");
    assert!(compared > 300);
}

#[test]
fn nothing_pushes_sideways_at_the_seam_of_two_boxes() {
    let mut random = Random::new(63);
    let mut seen = 0;
    for index in 0..6_000 {
        // Side by side, overlapping, or separated by the rounding of their poses.
        let overlap = [0.0, 0.1, -1.0e-7, 1.0e-7][index % 4];
        let boxes = [-1.0f32, 1.0].map(|side| {
            let pose = Pose::from_translation(Vec3::new(side * (1.0 - overlap), -0.5, 0.0));
            (pose, SharedShape::cuboid(1.0, 0.5, 1.0))
        });
        let shape = ShapeGeometry::new(&SharedShape::compound(boxes.to_vec())).expect("two boxes");
        let height = random.range(-0.1, 0.03);
        let center = DVec3::new(random.range(-0.2, 0.2), height, random.range(-0.5, 0.5));
        let triangle = [0, 1, 2].map(|_| {
            let flat = random.vector() * 0.15;
            center + DVec3::new(flat.x, flat.y * 0.05, flat.z)
        });
        let (_, found) = examine(&shape, &triangle, 0.05);
        for proximity in &found {
            assert_well_formed(&triangle, proximity);
            let lean = proximity.normal.x.hypot(proximity.normal.z);
            assert!(lean < 1.0e-2, "{overlap} {proximity:?} {triangle:?}");
            seen += 1;
        }
        assert!(!found.is_empty() || height > 0.02, "{triangle:?}");
    }
    assert!(seen > 10_000, "{seen}");
}

#[test]
fn parts_have_numbers_of_their_own_and_sweep_where_they_are() {
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let mut lying = Pose::from_translation(Vec3::X * 3.0);
    lying.rotation = quarter;
    let parts = vec![
        (Pose::from_translation(Vec3::NEG_X * 3.0), SharedShape::cuboid(0.5, 0.5, 0.5)),
        (lying, SharedShape::cylinder(1.0, 0.25)),
        (Pose::IDENTITY, SharedShape::triangle(Vec3::ZERO, Vec3::X, Vec3::Z)),
        (Pose::IDENTITY, SharedShape::segment(Vec3::Y, Vec3::Y * 2.0)),
    ];
    let shape = ShapeGeometry::new(&SharedShape::compound(parts)).expect("four parts");
    let over = |center: DVec3| [DVec3::ZERO, DVec3::X * 0.02, DVec3::Z * 0.02].map(|corner| corner + center);
    let numbers = [
        examine(&shape, &over(DVec3::new(-3.0, 0.51, 0.0)), 0.05),
        examine(&shape, &over(DVec3::new(3.0, 0.26, 0.0)), 0.05),
        examine(&shape, &over(DVec3::new(0.2, 0.01, 0.2)), 0.05),
        examine(&shape, &over(DVec3::new(0.01, 1.5, 0.0)), 0.05),
    ];
    for (one, (least, found)) in numbers.iter().enumerate() {
        assert!((least - 0.01).abs() < 1.0e-3, "{one} {least}");
        for (_, others) in &numbers[one + 1..] {
            for own in found {
                assert!(others.iter().all(|other| other.shape_feature > own.shape_feature));
            }
        }
    }
    let sweeps = shape.sweep_parts();
    assert_eq!(sweeps.len(), 4);
    for sweep in &sweeps {
        assert!(SurfaceTopology::new(&sweep.points, &sweep.triangles).is_ok());
    }
    assert!(sweeps[1].points.iter().all(|point| (point.x - 3.0).abs() < 1.001 && point.y.abs() < 0.251));
    let bounds = shape.bounds().expect("finite");
    assert!(bounds.min.x <= -3.5 && bounds.min.x > -3.51 && bounds.max.x >= 4.0 && bounds.max.x < 4.01);
    let endless = SharedShape::compound(vec![(Pose::IDENTITY, SharedShape::halfspace(Vec3::Y))]);
    assert!(matches!(ShapeGeometry::new(&endless), Err(ShapeError::Part)));
}

#[test]
fn vertices_among_many_overlapping_parts_are_led_out_of_all_of_them() {
    let mut random = Random::new(64);
    let (mut inside, mut in_solids) = (0, 0);
    for _ in 0..100 {
        let parts: Vec<(Pose, SharedShape)> = (0..6)
            .map(|kind| {
                let mut pose = Pose::from_translation((random.vector() * 0.3).as_vec3());
                pose.rotation = random_rotation(&mut random).as_quat();
                let shape = match kind {
                    0 => SharedShape::cylinder(0.4, 0.3),
                    1 => SharedShape::ball(0.3),
                    2 => SharedShape::cone(0.4, 0.4),
                    3 => SharedShape::capsule_y(0.3, 0.2),
                    4 => SharedShape::round_cuboid(0.2, 0.2, 0.2, 0.1),
                    _ => SharedShape::cuboid(0.2, 0.3, 0.4),
                };
                (pose, shape)
            })
            .collect();
        let shape = ShapeGeometry::new(&SharedShape::compound(parts.clone())).expect("six parts");
        for _ in 0..40 {
            let center = random.vector() * 0.5;
            let triangle = [0, 1, 2].map(|_| center + random.vector() * 0.1);
            let (least, found) = examine(&shape, &triangle, 0.01);
            for (vertex, &corner) in triangle.iter().enumerate() {
                if shape.signed_distance(corner) > -1.0e-3 {
                    continue;
                }
                inside += 1;
                assert!(least < 0.0, "{corner} {found:?}");
                // In a ball or a capsule, the contact is the triangle's point closest to the axis instead of each
                // vertex.
                let is_in = |(pose, shape): &(Pose, SharedShape)| {
                    let local = pose.rotation.as_dquat().normalize().inverse() * (corner - pose.translation.as_dvec3());
                    let has_corners = shape.as_ball().is_none() && shape.as_capsule().is_none();
                    has_corners && ShapeGeometry::new(shape).expect("convex").signed_distance(local) < -1.0e-3
                };
                if !parts.iter().any(is_in) {
                    continue;
                }
                in_solids += 1;
                let own = found.iter().filter(|p| p.feature == Feature::Vertex(vertex as u8) && p.distance < 0.0);
                assert!(own.clone().count() > 0, "{corner} {found:?}");
                for proximity in own {
                    assert_well_formed(&triangle, proximity);
                    assert!(shape.signed_distance(proximity.shape_point) >= -1.0e-5, "{proximity:?}");
                }
            }
        }
    }
    println!("{inside} inside, {in_solids} of them in parts with corners");
    assert!(inside > 1_000 && in_solids > 1_000);
}
