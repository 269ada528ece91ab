//! Triangles against cylinders, cones, and rounded shapes, compared with brute force over the triangle, closed forms,
//! and parry in f64.

use bevy_circumsphere::kernel::{
    exact::rigid_shape::{ShapeGeometry, ShapeProximity},
    mesh::feature::Feature,
};
use circumsphere_truth::{point_segment, triangle_distance};
use glam::{DVec3, Vec3};
use parry3d::shape::SharedShape;
use parry3d_f64::{math::Pose as ParryPose, query, shape::Triangle};

use crate::{
    common::Random,
    shapes::{assert_well_formed, at, examine, hull_facets, random_triangle},
    truth::{exact, random_rotation},
};

/// Rounding between two f64 computations of the same distance, for shapes about 1 long.
const TOLERANCE: f64 = 1.0e-9;
/// parry's f64 search on curved shapes stops earlier.
const PARRY_TOLERANCE: f64 = 1.0e-4;

/// The parts of a shape that the reference needs.
#[derive(Clone, Copy, Debug)]
enum Solid {
    /// Half height, radii at the bottom and the top, border.
    Round(f64, f64, f64, f64),
    /// Half extents, border.
    Box(DVec3, f64),
}

impl Solid {
    fn random(random: &mut Random, kind: usize) -> (Self, SharedShape) {
        let [a, b, c] = [0, 1, 2].map(|_| random.power_of_ten(-1.0, 0.2) as f32);
        let border = random.power_of_ten(-2.0, -0.3) as f32;
        let [x, y, z, r] = [a, b, c, border].map(f64::from);
        match kind % 5 {
            0 => (Self::Round(x, y, y, 0.0), SharedShape::cylinder(a, b)),
            1 => (Self::Round(x, y, 0.0, 0.0), SharedShape::cone(a, b)),
            2 => (Self::Round(x, y, y, r), SharedShape::round_cylinder(a, b, border)),
            3 => (Self::Round(x, y, 0.0, r), SharedShape::round_cone(a, b, border)),
            _ => (Self::Box(DVec3::new(x, y, z), r), SharedShape::round_cuboid(a, b, c, border)),
        }
    }

    /// Signed distance to the profile as a polygon, side by side. Inside, the depth is that of the nearest side.
    fn signed(&self, point: DVec3) -> f64 {
        match *self {
            Self::Round(h, bottom, top, border) => {
                let at = DVec3::new(point.x.hypot(point.z), point.y, 0.0);
                let corners = [
                    DVec3::new(-bottom, -h, 0.0),
                    DVec3::new(bottom, -h, 0.0),
                    DVec3::new(top, h, 0.0),
                    DVec3::new(-top, h, 0.0),
                ];
                let sides = (0..4).map(|k| (corners[k], corners[(k + 1) % 4]));
                let nearest =
                    sides.clone().map(|(a, b)| point_segment(at, a, b).distance).fold(f64::INFINITY, f64::min);
                let inside = sides.clone().all(|(a, b)| (b - a).cross(at - a).z >= 0.0);
                (if inside { -nearest } else { nearest }) - border
            }
            Self::Box(half, border) => {
                let beyond = point.abs() - half;
                beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0) - border
            }
        }
    }

    /// Unit normal out of the solid by finite differences, where the solid is smooth.
    fn gradient(&self, point: DVec3) -> DVec3 {
        const STEP: f64 = 1.0e-6;
        let slope = |axis: DVec3| (self.signed(point + axis * STEP) - self.signed(point - axis * STEP)) / (2.0 * STEP);
        DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z))
    }
}

/// The minimum of a convex function on [0, 1].
fn least_on_line(value: &impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..70 {
        let (one, other) = (low + (high - low) / 2.2, high - (high - low) / 2.2);
        if value(one) <= value(other) { high = other } else { low = one }
    }
    value(low).min(value(high)).min(value(0.0)).min(value(1.0))
}

/// The least signed distance of a triangle's points. It is a convex function, searched line by line.
fn least_signed(triangle: &[DVec3; 3], signed: impl Fn(DVec3) -> f64) -> f64 {
    let across = |u: f64| {
        let (from, to) = (triangle[0].lerp(triangle[1], u), triangle[0].lerp(triangle[2], u));
        least_on_line(&|v| signed(from.lerp(to, v)))
    };
    least_on_line(&across)
}

#[derive(Default, Debug)]
struct Tally {
    near: usize,
    beyond: usize,
    inside: usize,
    vertices_inside: usize,
    pierced: usize,
    by_feature: [usize; 3],
}

fn check(solid: &Solid, shape: &ShapeGeometry, triangle: &[DVec3; 3], range: f64, tally: &mut Tally) {
    let (least, found) = examine(shape, triangle, range);
    let signed = |point: DVec3| solid.signed(point);
    let expected = least_signed(triangle, signed);
    let size = triangle.iter().map(|corner| corner.length()).fold(1.0, f64::max);
    let tolerance = TOLERANCE * size;
    let told = || format!("{solid:?} {triangle:?}\nleast {least} expected {expected} range {range}\n{found:#?}");
    for proximity in &found {
        assert_well_formed(triangle, proximity);
        let on_surface = signed(proximity.shape_point).abs();
        // Polytopes treat edges as parallel up to a slope of 1e-3 of their size.
        let tolerance = if matches!(solid, Solid::Box(..)) { 1.0e-5 * size } else { tolerance };
        assert!(
            on_surface <= if is_rest(proximity) { 3.0e-3 * size } else { tolerance },
            "{proximity:?} {on_surface} {}",
            told()
        );
        let own = signed(at(triangle, proximity.barycentric));
        if proximity.distance > 0.0 && !is_rest(proximity) {
            assert!((own - proximity.distance).abs() <= tolerance, "{proximity:?} {own} {}", told());
        }
        tally.by_feature[match proximity.feature {
            Feature::Vertex(_) => 0,
            Feature::Edge(_) => 1,
            Feature::Face => 2,
        }] += 1;
        let twins = found
            .iter()
            .filter(|other| (other.feature, other.shape_feature) == (proximity.feature, proximity.shape_feature));
        assert!(matches!(solid, Solid::Box(..)) || twins.count() == 1, "{proximity:?} {}", told());
    }
    for (vertex, &corner) in triangle.iter().enumerate() {
        let depth = signed(corner);
        if depth < -tolerance {
            let own: Vec<_> = found.iter().filter(|p| p.feature == Feature::Vertex(vertex as u8)).collect();
            let deepest = own.iter().map(|p| p.distance).fold(f64::INFINITY, f64::min);
            assert!((deepest - depth).abs() <= tolerance, "{depth} {}", told());
            tally.vertices_inside += 1;
        }
    }
    if expected > range + tolerance {
        assert!(least >= range - tolerance, "{}", told());
        tally.beyond += 1;
    } else if expected > range - tolerance {
    } else if expected > tolerance {
        assert!((least - expected).abs() <= tolerance, "{}", told());
        tally.near += 1;
    } else if expected > -tolerance {
        assert!(least <= 2.0 * tolerance, "{}", told());
    } else {
        assert!(least < 0.0, "{}", told());
        // Depth depends on the feature: vertices have their distance from the surface, edges and faces their way out.
        tally.pierced += usize::from(triangle.iter().all(|corner| signed(*corner) > 0.0));
        tally.inside += 1;
    }
}

/// A contact of a face beside its deepest point. Its distance from the plane is right, but it is not the closest point
/// to its foot.
fn is_rest(proximity: &ShapeProximity) -> bool {
    proximity.feature == Feature::Face && proximity.shape_feature >= 3
}

#[test]
fn random_triangles_have_the_distance_that_brute_force_finds() {
    let mut random = Random::new(51);
    let mut tally = Tally::default();
    for index in 0..6_000 {
        let (solid, shared) = Solid::random(&mut random, index);
        let shape = ShapeGeometry::new(&shared).expect("a convex shape");
        let triangle = random_triangle(&mut random, 1.0);
        check(&solid, &shape, &triangle, random.power_of_ten(-2.0, 0.0), &mut tally);
    }
    println!("{tally:?}");
    assert!(tally.near > 500 && tally.beyond > 300 && tally.inside > 1_000 && tally.vertices_inside > 500);
    assert!(tally.pierced > 200 && tally.by_feature.iter().all(|count| *count > 300));
}

#[test]
fn triangles_in_a_tangent_plane_touch_at_every_height() {
    let mut random = Random::new(52);
    let mut tally = Tally::default();
    for index in 0..3_000 {
        let (solid, shared) = Solid::random(&mut random, index);
        let shape = ShapeGeometry::new(&shared).expect("a convex shape");
        // Project onto the surface from outside.
        let mut point = random.direction() * 4.0;
        for _ in 0..3 {
            point -= solid.gradient(point).normalize() * solid.signed(point);
        }
        let normal = solid.gradient(point + random.direction() * 0.0 + (point * 0.01)).normalize();
        let height = [0.0, 1.0e-12, 1.0e-6, 0.01, -1.0e-6, -0.01][random.below(6)];
        let (u, v) = normal.any_orthonormal_pair();
        let center = point + normal * height;
        let size = random.power_of_ten(-2.0, 1.0);
        let corners = [u, v * 0.9 - u * 0.6, -v - u * 0.4].map(|corner| center + corner * size);
        check(&solid, &shape, &corners, 0.1, &mut tally);
    }
    println!("{tally:?}");
    assert!(tally.near > 300 && tally.inside > 300 && tally.by_feature[2] > 300);
}

#[test]
fn triangles_along_axes_caps_and_mantles_are_exact() {
    let mut random = Random::new(53);
    let mut tally = Tally::default();
    for index in 0..3_000 {
        let (solid, shared) = Solid::random(&mut random, index % 4);
        let shape = ShapeGeometry::new(&shared).expect("a convex shape");
        let Solid::Round(h, bottom, top, border) = solid else { unreachable!("round ones only") };
        let gap = [0.0, 1.0e-3, 0.05, -1.0e-3, -0.05][random.below(5)];
        let size = random.power_of_ten(-1.0, 1.0);
        let flat = |random: &mut Random| DVec3::new(random.range(-1.0, 1.0), 0.0, random.range(-1.0, 1.0)) * size;
        let triangle = match index / 4 % 4 {
            // Above a cap.
            0 => [flat(&mut random), flat(&mut random), flat(&mut random)]
                .map(|corner| corner + DVec3::Y * (h + border + gap)),
            1 => [flat(&mut random), flat(&mut random), flat(&mut random)]
                .map(|corner| corner - DVec3::Y * (h + border + gap)),
            // An edge along the mantle. The rest of the triangle points away.
            2 => {
                let slope = DVec3::new(top - bottom, 2.0 * h, 0.0).normalize();
                let out = DVec3::new(slope.y, -slope.x, 0.0);
                let start = DVec3::new(bottom, -h, 0.0) + out * (border + gap);
                let along = slope * 2.0 * h;
                let ends = [start - along * random.unit(), start + along * random.range(0.1, 2.0)];
                [ends[0], ends[1], ends[0].lerp(ends[1], random.unit()) + out + DVec3::Z * random.range(-1.0, 1.0)]
            }
            // Along the axis.
            _ => [DVec3::Y * -random.unit(), DVec3::Y * random.unit(), flat(&mut random)],
        };
        check(&solid, &shape, &triangle, 0.1, &mut tally);
    }
    println!("{tally:?}");
    assert!(tally.near > 300 && tally.inside > 300 && tally.vertices_inside > 100);
}

#[test]
fn an_apex_through_a_face_is_as_deep_as_it_reaches() {
    let mut random = Random::new(54);
    for _ in 0..500 {
        let (half, radius) = (random.range(0.2, 1.0) as f32, random.range(0.1, 1.0) as f32);
        let shape = ShapeGeometry::new(&SharedShape::cone(half, radius)).expect("a cone");
        let depth = random.range(0.01, 0.1);
        let apex = DVec3::Y * f64::from(half);
        let turn = random.range(0.0, 6.0);
        let corner = |k: f64| {
            let angle = turn + k * 2.1;
            DVec3::new(angle.cos() * 3.0, f64::from(half) - depth, angle.sin() * 3.0)
        };
        let (least, found) = examine(&shape, &[corner(0.0), corner(1.0), corner(2.0)], 0.05);
        assert!((least + depth).abs() <= 1.0e-12, "{least} {depth}");
        let face = found.iter().find(|p| p.feature == Feature::Face).expect("the apex is past the face");
        assert!(face.normal.distance(DVec3::Y) <= 1.0e-12 && face.shape_point.distance(apex) <= 1.0e-12);
    }
}

#[test]
fn an_edge_through_a_cylinder_leaves_square_to_itself() {
    let mut random = Random::new(55);
    let shape = ShapeGeometry::new(&SharedShape::cylinder(2.0, 0.5)).expect("a cylinder");
    for _ in 0..500 {
        // Perpendicular to the axis and past it by `aside`, so the shortest way out is towards that side.
        let (aside, height, angle) = (random.range(0.05, 0.45), random.range(-1.0, 1.0), random.range(0.0, 6.0));
        let along = DVec3::new(angle.cos(), 0.0, angle.sin());
        let out = DVec3::new(-angle.sin(), 0.0, angle.cos());
        let middle = out * aside + DVec3::Y * height;
        let triangle = [middle - along * 2.0, middle + along * 3.0, middle + out * 9.0];
        let (_, found) = examine(&shape, &triangle, 0.0);
        let edge = found.iter().find(|p| p.feature == Feature::Edge(0)).expect("it pierces");
        assert!((edge.distance + 0.5 - aside).abs() <= TOLERANCE, "{edge:?} {aside}");
        assert!(edge.normal.distance(out) <= 1.0e-6, "{edge:?} {out}");
    }
}

#[test]
fn a_face_on_a_cap_has_contacts_around_its_rest() {
    let shape = ShapeGeometry::new(&SharedShape::cylinder(0.5, 0.4)).expect("a cylinder");
    let mut random = Random::new(56);
    for index in 0..2_000 {
        let gap = random.range(-0.01, 0.02);
        let tilt = DVec3::new(random.range(-1.0, 1.0), 0.0, random.range(-1.0, 1.0)) * 3.0e-4;
        let size = [0.3, 0.5, 1.0, 30.0][index % 4];
        let turn = random.range(0.0, 6.0);
        let triangle = [0.0, 2.1, 4.2].map(|angle: f64| {
            let flat = DVec3::new((turn + angle).cos(), 0.0, (turn + angle).sin()) * size;
            flat + DVec3::Y * (0.5 + gap + flat.clamp_length_max(1.0).dot(tilt))
        });
        let (_, found) = examine(&shape, &triangle, 0.05);
        let upright: Vec<_> = found.iter().filter(|proximity| proximity.normal.y > 0.99).collect();
        // The contacts surround the middle: there is one in every direction.
        for step in 0..8 {
            let angle = f64::from(step) * 0.785;
            let toward = DVec3::new(angle.cos(), 0.0, angle.sin());
            let reach = upright.iter().map(|p| p.shape_point.dot(toward)).fold(f64::NEG_INFINITY, f64::max);
            assert!(reach > 0.08, "{index} {size} {reach} {found:#?}");
        }
    }
}

#[test]
fn parry_agrees_about_cylinders_and_cones_that_are_apart() {
    let mut random = Random::new(57);
    let (mut compared, mut largest) = (0, 0.0f64);
    for index in 0..4_000 {
        let (half, radius) = (random.range(0.2, 1.0) as f32, random.range(0.2, 1.0) as f32);
        let (h, r) = (f64::from(half), f64::from(radius));
        let (shape, peer): (_, Box<dyn parry3d_f64::shape::Shape>) = if index % 2 == 0 {
            (SharedShape::cylinder(half, radius), Box::new(parry3d_f64::shape::Cylinder::new(h, r)))
        } else {
            (SharedShape::cone(half, radius), Box::new(parry3d_f64::shape::Cone::new(h, r)))
        };
        let shape = ShapeGeometry::new(&shape).expect("a convex shape");
        let rotation = random_rotation(&mut random);
        let center = random.direction() * random.range(0.5, 2.5);
        let triangle = exact([0, 1, 2].map(|_| (rotation * random.vector() * 0.5 + center).as_vec3()));
        let parry_triangle = Triangle::new(triangle[0], triangle[1], triangle[2]);
        let pose = ParryPose::identity();
        let distance = query::distance(&pose, &parry_triangle, &pose, peer.as_ref()).expect("supported").distance;
        let (least, _) = examine(&shape, &triangle, 1.0);
        if distance > 0.01 && distance < 0.99 {
            largest = largest.max((least - distance).abs());
            assert!((least - distance).abs() <= PARRY_TOLERANCE, "{least} {distance}");
            compared += 1;
        }
    }
    println!("{compared} agree, largest error {largest}");
    assert!(compared > 500);
}

#[test]
fn sweep_meshes_are_closed_and_lie_on_the_shape() {
    let mut random = Random::new(58);
    for index in 0..200 {
        let (solid, shared) = Solid::random(&mut random, index);
        let shape = ShapeGeometry::new(&shared).expect("a convex shape");
        let parts = shape.sweep_parts();
        assert_eq!(parts.len(), 1);
        let topology =
            bevy_circumsphere::kernel::mesh::topology::SurfaceTopology::new(&parts[0].points, &parts[0].triangles)
                .expect("a sweep part is a surface");
        assert!(topology.is_closed(), "{:?}", topology.report());
        for point in &parts[0].points {
            let height = solid.signed(point.as_dvec3()) + f64::from(parts[0].radius);
            // The centers of the caps must lie on the shape as well.
            assert!(height.abs() <= 1.0e-6, "{height} {point}");
        }
        // The sagitta of a chord across one of 256 segments of a circle: r (1 - cos(pi / 256)).
        let (sagitta, is_round) = match solid {
            Solid::Round(_, bottom, top, _) => (7.54e-5 * bottom.max(top), true),
            Solid::Box(..) => (0.0, false),
        };
        let mut deepest: f64 = 0.0;
        let corner = |number: u32| parts[0].points[number as usize].as_dvec3();
        for triangle in &parts[0].triangles {
            let [a, b, c] = triangle.map(corner);
            assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "outward");
            for place in [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0, (a + b + c) / 3.0] {
                let depth = -solid.signed(place) - f64::from(parts[0].radius);
                assert!(depth.abs() <= sagitta + 1.0e-6, "{depth} {place} {solid:?}");
                deepest = deepest.max(depth);
            }
        }
        assert!(!is_round || deepest > 0.1 * sagitta, "{deepest} {solid:?}");
    }
    for shape in [SharedShape::ball(0.5), SharedShape::capsule(Vec3::X, Vec3::Y, 0.5)] {
        let parts = ShapeGeometry::new(&shape).expect("rounded").sweep_parts();
        let topology =
            bevy_circumsphere::kernel::mesh::topology::SurfaceTopology::new(&parts[0].points, &parts[0].triangles);
        assert!(topology.is_ok() && parts[0].radius == 0.5 && parts[0].points.len() == 3);
    }
    let half_space = ShapeGeometry::new(&SharedShape::halfspace(Vec3::Y)).expect("a half-space");
    assert!(half_space.sweep_parts().is_empty());
}

#[test]
fn a_rounded_hull_is_its_core_less_the_border() {
    let mut random = Random::new(59);
    let mut compared = 0;
    for _ in 0..60 {
        let points: Vec<Vec3> = (0..8).map(|_| (random.direction() * random.range(0.5, 1.0)).as_vec3()).collect();
        let border = random.range(0.01, 0.3) as f32;
        let Some(shared) = SharedShape::round_convex_hull(&points, border) else { continue };
        let shape = ShapeGeometry::new(&shared).expect("rounded");
        let facets = hull_facets(&points.iter().map(|point| point.as_dvec3()).collect::<Vec<_>>());
        for _ in 0..50 {
            let triangle = random_triangle(&mut random, 1.0);
            let nearest = facets.iter().map(|facet| triangle_distance(&triangle, facet)).fold(f64::INFINITY, f64::min);
            let inside = triangle.iter().any(|corner| {
                let height = |face: &[DVec3; 3]| (face[1] - face[0]).cross(face[2] - face[0]).dot(*corner - face[0]);
                facets.iter().all(|facet| height(facet) < 0.0)
            });
            let (least, _) = examine(&shape, &triangle, 0.5);
            let expected = nearest - f64::from(border);
            if nearest > 1.0e-3 && expected < 0.49 && !inside {
                // parry finds the facets in f32.
                assert!((least - expected).abs() <= 1.0e-5, "{least} {expected}");
                compared += 1;
            }
        }
    }
    println!("{compared} compared");
    assert!(compared > 500);
}
