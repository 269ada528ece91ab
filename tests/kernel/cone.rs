//! The cone test: pairs that the sphere stages find, and the geometry of a contact of two caps.

use std::f64::consts::{FRAC_PI_2, TAU};

use bevy_circumsphere::kernel::{
    contact::CompactContact,
    mesh::{
        bounds::{pairs_between_brute_force, triangle_bounds},
        topology::SurfaceTopology,
    },
    pair::{FoundPairs, MovedSide, PairSettings, SurfaceSide},
    pose::Pose,
    spheres::{
        circumsphere::{OffsetSpheres, RecipeSettings, enclosing_balls},
        cone::{Cap, SafetyCones, cap_contact, spheres_overlap},
        contacts::{FoundSpheres, meeting_caps, overlapping_ball_contacts},
        curvature::{CurvatureEstimator, Curvatures},
        pairs::{BallSide, CapSide, overlapping_caps},
    },
};
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid, icosphere};
use circumsphere_truth::triangle_distance;
use glam::{Affine3A, DQuat, DVec3, Vec3};

use crate::{
    common::Random,
    truth::{ROUNDING, positions, random_rotation},
};

const REACH: f32 = 0.05;

fn side<'a>(topology: &'a SurfaceTopology, positions: &'a [Vec3]) -> SurfaceSide<'a> {
    SurfaceSide { one_sided: true, ..SurfaceSide::flat(topology, positions) }
}

fn settings(reach: f32, same_surface: bool) -> PairSettings {
    let reach = f64::from(reach);
    PairSettings {
        contact_distance: reach,
        reported_distance: reach,
        range: reach,
        scale: 1.0,
        bulge: 0.0,
        cull: true,
        same_surface,
        any_left_out: false,
    }
}

/// A surface with its spheres and cones, in its own frame.
struct Body {
    topology: SurfaceTopology,
    positions: Vec<Vec3>,
    spheres: OffsetSpheres,
    cones: SafetyCones,
}

impl Body {
    /// `crease_clamp`: whether the spheres know the dihedral angles. Curvature is omitted on purpose, because it would
    /// lower the spheres near creases by itself.
    fn new(mesh: &Mesh, positions: Vec<Vec3>, crease_clamp: bool, phi: f32) -> Self {
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("the mesh is valid");
        let mut measured = Curvatures::default();
        measured.measure(&topology, &positions, CurvatureEstimator::SignedEdge);
        let count = mesh.triangles.len();
        let dihedrals = if crease_clamp { measured.dihedrals } else { vec![[0.0; 3]; count] };
        let settings = RecipeSettings { sphere_offset: phi, curvature_threshold: 1.0, refit_threshold: 0.5 };
        let (mut spheres, mut cones) = (OffsetSpheres::default(), SafetyCones::default());
        spheres.refit(&positions, &mesh.triangles, &vec![0.0; count], &dihedrals, settings, &mut cones);
        Self { topology, positions, spheres, cones }
    }

    fn side(&self) -> CapSide<'_> {
        CapSide {
            surface: side(&self.topology, &self.positions),
            spheres: &self.spheres,
            cones: &self.cones,
            pose: None,
            rows: None,
        }
    }
}

fn meeting(a: &Body, b: &Body) -> (Vec<[u32; 2]>, Vec<[u32; 2]>, FoundPairs) {
    let (mut boxes_a, mut boxes_b) = (Vec::new(), Vec::new());
    triangle_bounds(&a.positions, a.topology.triangles(), 0.5 * REACH, &mut boxes_a);
    triangle_bounds(&b.positions, b.topology.triangles(), 0.5 * REACH, &mut boxes_b);
    let (mut candidates, mut overlapping, mut meeting) = (Vec::new(), Vec::new(), Vec::new());
    pairs_between_brute_force(&boxes_a, &boxes_b, &mut candidates);
    overlapping_caps(&a.side(), &b.side(), &candidates, &settings(REACH, false), &mut overlapping);
    let mut found = FoundPairs::default();
    meeting_caps(&a.side(), &b.side(), &overlapping, &settings(REACH, false), &mut meeting, &mut found);
    (candidates, meeting, found)
}

/// A box rotated by `turn`, somewhere over the sheet, whose lowest point is half the reach above the plane.
fn box_over_plane(mesh: &Mesh, turn: DQuat, random: &mut Random) -> Vec<Vec3> {
    let turned: Vec<DVec3> = positions(mesh).iter().map(|point| turn * point.as_dvec3()).collect();
    let lowest = turned.iter().map(|point| point.y).fold(f64::INFINITY, f64::min);
    let shift = DVec3::new(random.range(-0.5, 0.5), 0.5 * f64::from(REACH) - lowest, random.range(-0.5, 0.5));
    turned.iter().map(|&point| (point + shift).as_vec3()).collect()
}

/// How many orientations are found with and without the crease clamp.
fn found_over_plane(turns: &[DQuat], subdivisions: usize, phi: f32, random: &mut Random) -> [usize; 2] {
    let mesh = cuboid([0.5; 3], subdivisions);
    let sheet = grid(20, 20, 4.0, 4.0, Diagonals::Alternating);
    // A flat sheet has no creases to clamp at.
    let plane = Body::new(&sheet, positions(&sheet), true, phi);
    let mut found = [0; 2];
    for &turn in turns {
        let placed = box_over_plane(&mesh, turn, random);
        for (clamp, found) in [true, false].into_iter().zip(&mut found) {
            let body = Body::new(&mesh, placed.clone(), clamp, phi);
            let (candidates, pairs, contacts) = meeting(&body, &plane);
            assert!(!candidates.is_empty(), "something is in reach");
            let is_finite = |contact: &CompactContact| contact.distance.is_finite() && contact.normal.is_finite();
            assert!(contacts.contacts.iter().all(is_finite));
            *found += usize::from(!pairs.is_empty());
        }
    }
    found
}

/// The guarantee of the clamp and its limit: it closes the gap between the *directions* of neighboring cones, but
/// neighboring lines start from different centers. With spheres no deeper than the triangles' radii (`sphere_offset` up
/// to 1), nothing is missed. With narrow cones (5) a few are missed; without the clamp most would be.
fn assert_found_thanks_to_the_clamp(name: &str, turns: &[DQuat], random: &mut Random) {
    for subdivisions in [1, 4] {
        for phi in [0.5, 1.0, 5.0] {
            let [with, without] = found_over_plane(turns, subdivisions, phi, random);
            let count = turns.len();
            println!(
                "{name}, {subdivisions} cells a side, phi {phi}: {with} of {count} found, {without} without the clamp"
            );
            if phi <= 1.0 {
                assert_eq!(with, count);
            } else {
                assert!(with * 100 >= count * 80, "{with} of {count}");
                assert!(without * 100 <= count * 60, "the clamp has to matter: {without} of {count}");
            }
        }
    }
}

#[test]
fn a_box_on_its_edge_is_found_thanks_to_the_crease_clamp() {
    let mut random = Random::new(1);
    let turns: Vec<DQuat> = (0..300)
        .map(|_| {
            // One edge down, leaning towards one of its faces, in any direction over the sheet.
            let lean = DQuat::from_rotation_x(random.range(0.05, FRAC_PI_2 - 0.05));
            DQuat::from_rotation_y(random.range(0.0, TAU)) * lean
        })
        .collect();
    assert_found_thanks_to_the_clamp("box on its edge", &turns, &mut random);
}

#[test]
fn a_box_on_its_corner_is_found_thanks_to_the_crease_clamp() {
    let mut random = Random::new(2);
    let mut turns = Vec::new();
    while turns.len() < 300 {
        let turn = random_rotation(&mut random);
        // Every axis leans, so that a single corner is lowest.
        if [DVec3::X, DVec3::Y, DVec3::Z].iter().all(|&axis| (turn * axis).y.abs() > 0.1) {
            turns.push(turn);
        }
    }
    assert_found_thanks_to_the_clamp("box on its corner", &turns, &mut random);
}

fn random_cap(random: &mut Random) -> Cap {
    let radius = random.power_of_ten(-2.0, 1.0);
    let height = if random.below(4) == 0 { 0.0 } else { radius * random.unit() };
    Cap {
        center: random.vector().as_vec3(),
        radius: radius as f32,
        height: height as f32,
        axis: random.direction().as_vec3(),
        cosine: (height / radius) as f32,
    }
}

/// Where the ray from a cap's center along `direction` meets the plane of its triangle, in f64.
fn to_plane(cap: &Cap, direction: DVec3) -> f64 {
    let axis = cap.axis.as_dvec3();
    let on_plane = cap.center.as_dvec3() + axis * f64::from(cap.height);
    axis.dot(on_plane - cap.center.as_dvec3()) / axis.dot(direction)
}

#[test]
fn the_gap_of_two_caps_lies_between_their_planes_along_the_line_of_centers() {
    let mut random = Random::new(3);
    let (mut accepted, mut refused, mut parted, mut passed) = (0, 0, 0, 0);
    for _ in 0..400_000 {
        let (a, b) = (random_cap(&mut random), random_cap(&mut random));
        let between = b.center.as_dvec3() - a.center.as_dvec3();
        let direction = between.normalize();
        let (toward_b, toward_a) = (direction.dot(a.axis.as_dvec3()), -direction.dot(b.axis.as_dvec3()));
        // Positive inside both cones.
        let inside = (toward_b - f64::from(a.cosine)).min(toward_a - f64::from(b.cosine));
        let Some(contact) = cap_contact(&a, &b) else {
            assert!(inside < 0.0, "a line inside both cones was refused");
            refused += 1;
            continue;
        };
        // The comparison has a slack of 1e-4.
        assert!(inside > -1.1e-4, "{inside}");
        accepted += 1;
        if inside < 1.0e-4 {
            continue;
        }
        // f32 rounding of points at 1 and radii up to 10, divided by the cosine towards the plane. A plane at height 0
        // is met at the center itself.
        let tolerance = |cap: &Cap, toward: f64| {
            8.0 * ROUNDING * (1.0 + between.length() + f64::from(cap.height) / toward.powi(2) / between.length())
        };
        let from_a = if a.height > 0.0 { to_plane(&a, direction) } else { 0.0 };
        let from_b = if b.height > 0.0 { to_plane(&b, -direction) } else { 0.0 };
        let (expected_a, expected_b) =
            (a.center.as_dvec3() + direction * from_a, b.center.as_dvec3() - direction * from_b);
        let (error_a, error_b) =
            (tolerance(&a, toward_b) + 4.0 * ROUNDING * from_a, tolerance(&b, toward_a) + 4.0 * ROUNDING * from_b);
        let (allowed_a, allowed_b) = (
            error_a + from_a * 8.0 * ROUNDING / between.length(),
            error_b + from_b * 8.0 * ROUNDING / between.length(),
        );
        assert!(contact.point_a.as_dvec3().distance(expected_a) <= allowed_a, "{a:?} {b:?} {contact:?} {expected_a}");
        assert!(contact.point_b.as_dvec3().distance(expected_b) <= allowed_b, "{a:?} {b:?} {contact:?} {expected_b}");
        assert!(contact.direction.as_dvec3().distance(direction) <= 8.0 * ROUNDING / between.length().min(1.0));
        let gap = between.length() - from_a - from_b;
        assert!((f64::from(contact.gap) - gap).abs() <= allowed_a + allowed_b, "{a:?} {b:?} {contact:?} {gap}");
        if gap > 0.0 {
            parted += 1;
        } else {
            passed += 1;
        }
    }
    println!("{accepted} pairs of caps accepted, {refused} refused; planes apart {parted}, passed {passed}");
    assert!(accepted > 10_000 && refused > 100_000 && parted > 1_000 && passed > 1_000);
}

#[test]
fn the_contact_of_two_caps_is_the_same_from_either_side() {
    let mut random = Random::new(4);
    let mut accepted = 0;
    for _ in 0..200_000 {
        let (a, b) = (random_cap(&mut random), random_cap(&mut random));
        let (found, turned) = (cap_contact(&a, &b), cap_contact(&b, &a));
        assert_eq!(found.is_some(), turned.is_some());
        if let (Some(found), Some(turned)) = (found, turned) {
            // Negation is exact. Only the order of the two subtractions differs.
            assert_eq!(found.point_a, turned.point_b);
            assert_eq!(found.point_b, turned.point_a);
            assert_eq!(found.direction, -turned.direction);
            let size = a.radius + b.radius + a.center.distance(b.center);
            assert!(f64::from((found.gap - turned.gap).abs()) <= 4.0 * ROUNDING * f64::from(size));
            accepted += 1;
        }
    }
    assert!(accepted > 5_000);
}

#[test]
fn concentric_spheres_are_in_contact_along_the_first_normal() {
    let mut random = Random::new(5);
    for _ in 0..1_000 {
        let (a, mut b) = (random_cap(&mut random), random_cap(&mut random));
        b.center = a.center;
        for scale in [1.0f32, 1.0e-30, 1.0e-44, 1.0e18] {
            let scaled = |cap: Cap| Cap {
                center: cap.center * scale,
                radius: cap.radius * scale,
                height: cap.height * scale,
                ..cap
            };
            let contact = cap_contact(&scaled(a), &scaled(b)).expect("they overlap");
            assert_eq!(contact.direction, a.axis);
            assert!(contact.gap.is_finite() && contact.point_a.is_finite() && contact.point_b.is_finite());
        }
        // Separated by one unit in the last place of f32, in any direction.
        let axis = random.below(3);
        b.center[axis] = b.center[axis].next_up();
        if let Some(contact) = cap_contact(&a, &b) {
            assert!(contact.gap.is_finite() && contact.direction.is_finite());
            assert!((contact.direction.length() - 1.0).abs() < 1.0e-5);
        }
    }
    let point = Cap { center: Vec3::X, radius: 0.0, height: 0.0, axis: Vec3::ZERO, cosine: SafetyCones::EVERYWHERE };
    let contact = cap_contact(&point, &point).expect("two points in one place");
    assert!(contact.gap == 0.0 && contact.point_a == Vec3::X);
    // A point has no normal. The contact uses the normal of the other cap, or any direction.
    assert_eq!(contact.direction.length(), 1.0);
    let cap = Cap { center: Vec3::X, ..random_cap(&mut random) };
    assert_eq!(cap_contact(&point, &cap).expect("they are in one place").direction, -cap.axis);
    assert_eq!(cap_contact(&cap, &point).expect("they are in one place").direction, cap.axis);
}

#[test]
fn caps_of_any_size_meet_alike() {
    let mut random = Random::new(9);
    let (mut met, mut apart) = (0, 0);
    for _ in 0..2_000 {
        let (a, b) = (random_cap(&mut random), random_cap(&mut random));
        let contact = cap_contact(&a, &b);
        // Scaling by powers of two is exact, but squares of these lengths overflow or underflow in f32.
        for exponent in [-100, 100] {
            let scale = 2.0_f32.powi(exponent);
            let scaled = |cap: &Cap| Cap {
                center: cap.center * scale,
                radius: cap.radius * scale,
                height: cap.height * scale,
                ..*cap
            };
            let found = cap_contact(&scaled(&a), &scaled(&b));
            // Rounding of lengths is far smaller than the distance of these directions from a boundary.
            let (Some(found), Some(expected)) = (found, contact) else {
                assert!(found.is_none() == contact.is_none());
                apart += 1;
                continue;
            };
            assert!(found.direction.distance(expected.direction) < 1.0e-6);
            assert!((found.gap / scale - expected.gap).abs() < 1.0e-5, "{found:?}, {expected:?}");
            met += 1;
        }
    }
    assert!(met > 200 && apart > 200, "{met} met, {apart} did not");
}

#[test]
fn caps_farther_apart_than_the_largest_f32_meet_along_a_direction() {
    let cap = |y: f32| Cap { center: Vec3::Y * y, radius: 1.0, height: 0.0, axis: Vec3::ZERO, cosine: 0.0 };
    let contact = cap_contact(&cap(2.409_109_7e38), &cap(-1.9e38)).expect("neither has a side");
    assert_eq!(contact.direction, -Vec3::Y);
    assert!(contact.point_a.is_finite() && contact.point_b.is_finite() && contact.gap > 3.0e38);
}

#[test]
fn a_triangle_without_area_meets_from_everywhere() {
    let mut random = Random::new(6);
    let mut met = 0;
    for _ in 0..2_000 {
        let segment = Cap {
            center: random.vector().as_vec3(),
            radius: 0.5,
            height: 0.0,
            axis: Vec3::ZERO,
            cosine: SafetyCones::EVERYWHERE,
        };
        let other = random_cap(&mut random);
        let toward = (segment.center - other.center).normalize().dot(other.axis);
        let contact = cap_contact(&segment, &other);
        if toward > other.cosine + 1.0e-3 {
            assert!(contact.is_some());
            met += 1;
        }
        assert!(contact.is_none_or(|contact| contact.gap.is_finite()));
    }
    assert!(met > 200);
}

#[test]
fn overlap_is_decided_by_the_sum_of_the_radii_and_the_reach() {
    let mut random = Random::new(7);
    let (mut yes, mut no) = (0, 0);
    for _ in 0..50_000 {
        let (a, b) = (random_cap(&mut random), random_cap(&mut random));
        let reach = random.power_of_ten(-3.0, 0.0) as f32;
        let distance = a.center.as_dvec3().distance(b.center.as_dvec3());
        let sum = f64::from(a.radius) + f64::from(b.radius) + f64::from(reach);
        let found = spheres_overlap(a.center, a.radius, b.center, b.radius, reach);
        if (distance - sum).abs() > 16.0 * ROUNDING * (distance + sum) {
            assert_eq!(found, distance <= sum);
            if found {
                yes += 1;
            } else {
                no += 1;
            }
        }
    }
    assert!(yes > 5_000 && no > 5_000);
}

/// The candidates whose enclosing balls are within range.
fn overlapping_balls(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_ball_contacts(a, b, candidates, settings, overlapping, &mut FoundSpheres::default());
}

/// Enclosing balls contain their triangles, so the coarse stage loses no pair within reach, moved or not.
#[test]
fn overlapping_balls_lose_no_pair_within_reach() {
    let mut random = Random::new(8);
    let mesh = icosphere(2, 1.0);
    let rest = positions(&mesh);
    let topology = SurfaceTopology::new(&rest, &mesh.triangles).expect("valid");
    let mut balls = Vec::new();
    enclosing_balls(&rest, &mesh.triangles, &mut balls);
    let all: Vec<[u32; 2]> = (0..320u32).flat_map(|first| (0..320u32).map(move |second| [first, second])).collect();
    let (mut within, mut kept) = (0, 0);
    for _ in 0..4 {
        let turn = random_rotation(&mut random).as_quat();
        let shift = (random.direction() * 1.85).as_vec3();
        let affine = Affine3A::from_scale_rotation_translation(Vec3::splat(0.9), turn, shift);
        let pose = Pose::from_affine(&affine).expect("similarity");
        let mut moved = Vec::new();
        pose.transform_points(&rest, &mut moved);
        let own = BallSide { surface: side(&topology, &rest), balls: &balls, pose: None, rows: None };
        let brought = MovedSide::new(&rest, &pose, &moved);
        let surface = SurfaceSide { moved: Some(brought), ..side(&topology, &moved) };
        let other = BallSide { surface, balls: &balls, pose: Some(&pose), rows: None };
        let mut overlapping = Vec::new();
        overlapping_balls(&own, &other, &all, &settings(REACH, false), &mut overlapping);
        kept += overlapping.len();
        for pair in &all {
            let corners = |points: &[Vec3], triangle: u32| {
                mesh.triangles[triangle as usize].map(|vertex| points[vertex as usize].as_dvec3())
            };
            if rest[mesh.triangles[pair[0] as usize][0] as usize]
                .distance(moved[mesh.triangles[pair[1] as usize][0] as usize])
                > 1.5
            {
                continue;
            }
            let distance = triangle_distance(&corners(&rest, pair[0]), &corners(&moved, pair[1]));
            if distance <= f64::from(REACH) {
                within += 1;
                assert!(overlapping.binary_search(pair).is_ok(), "{pair:?}");
            }
        }
    }
    println!("{within} pairs within reach, {kept} of {} overlapping", 4 * all.len());
    assert!(within > 20 && kept < all.len());
}

/// Spheres are stored in their own frame. Transformed by a pose, they are those of the moved mesh.
#[test]
fn a_moved_cap_is_the_cap_of_the_moved_mesh() {
    let mut random = Random::new(9);
    let mesh = icosphere(2, 1.0);
    let body = Body::new(&mesh, positions(&mesh), true, 1.0);
    for scale in [1.0f32, 2.5, 0.125] {
        let affine = Affine3A::from_scale_rotation_translation(
            Vec3::splat(scale),
            random_rotation(&mut random).as_quat(),
            random.vector().as_vec3(),
        );
        let pose = Pose::from_affine(&affine).expect("similarity");
        let mut moved = Vec::new();
        pose.transform_points(&body.positions, &mut moved);
        let moved = Body::new(&mesh, moved, true, 1.0);
        let brought = CapSide { surface: side(&body.topology, &moved.positions), pose: Some(&pose), ..body.side() };
        for triangle in 0..mesh.triangles.len() as u32 {
            let (found, expected) = (brought.cap(triangle), moved.side().cap(triangle));
            // Rounding of corners at 3 tilts triangles of height 0.2.
            let tolerance = 1.0e-5 * scale.max(1.0);
            assert!(found.center.distance(expected.center) <= tolerance, "{found:?} {expected:?}");
            assert!((found.radius - expected.radius).abs() <= tolerance);
            assert!((found.height - expected.height).abs() <= tolerance);
            assert!(found.axis.distance(expected.axis) <= 1.0e-4);
            assert!((found.cosine - expected.cosine).abs() <= 1.0e-4);
        }
    }
}
