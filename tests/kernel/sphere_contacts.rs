//! Sphere contacts that are tested eight pairs at a time equal those of single pairs.

use bevy_circumsphere::kernel::{
    mesh::{barycentric::barycentric_of, ids::TriangleId, topology::SurfaceTopology},
    pair::{FoundPairs, MovedSide, PairSettings, SurfaceSide},
    pose::Pose,
    simd::parallel::Sequential,
    spheres::{
        circumsphere::{Ball, OffsetSpheres, RecipeSettings, enclosing_balls},
        cone::{Cap, SafetyCones, cap_contact},
        contacts::{FoundSpheres, ball_contacts, meeting_caps, overlapping_ball_contacts},
        curvature::{CurvatureEstimator, Curvatures},
        pairs::{BallSide, CapSide},
        rows::{BallRows, CapRows},
    },
};
use circumsphere_support::scenes::crumpled_sheet;
use glam::{Affine3A, DVec3, Quat, Vec3};

use crate::{
    common::Random,
    truth::{ROUNDING, independent, positions},
};

/// Rounding of a few f64 operations on coordinates of 100, below the resolution of single precision.
const DOUBLE_ROUNDING: f64 = 1.0e-12;

const SETTINGS: PairSettings = PairSettings {
    contact_distance: 0.2,
    reported_distance: 0.4,
    range: 0.5,
    scale: 1.5,
    bulge: 0.0,
    cull: true,
    same_surface: false,
    any_left_out: false,
};

/// A surface with all data that the sphere stages need.
struct Body {
    topology: SurfaceTopology,
    positions: Vec<Vec3>,
    balls: Vec<Ball>,
    spheres: OffsetSpheres,
    cones: SafetyCones,
}

impl Body {
    fn new(positions: Vec<Vec3>, triangles: &[[u32; 3]]) -> Self {
        let topology = SurfaceTopology::new(&positions, triangles).expect("the mesh is valid");
        let mut measured = Curvatures::default();
        measured.measure(&topology, &positions, CurvatureEstimator::SignedEdge);
        let (mut spheres, mut cones) = (OffsetSpheres::default(), SafetyCones::default());
        let recipe = RecipeSettings { sphere_offset: 0.5, curvature_threshold: 2.0, refit_threshold: 0.7 };
        spheres.refit(&positions, triangles, &measured.curvatures, &measured.dihedrals, recipe, &mut cones);
        cones.widen(&measured.spreads);
        let mut balls = Vec::new();
        enclosing_balls(&positions, triangles, &mut balls);
        Self { topology, positions, balls, spheres, cones }
    }

    fn surface(&self, one_sided: bool) -> SurfaceSide<'_> {
        SurfaceSide { one_sided, ..SurfaceSide::flat(&self.topology, &self.positions) }
    }

    fn cap_side(&self, one_sided: bool) -> CapSide<'_> {
        let surface = self.surface(one_sided);
        CapSide { surface, spheres: &self.spheres, cones: &self.cones, pose: None, rows: None }
    }

    fn ball_side(&self) -> BallSide<'_> {
        BallSide { surface: self.surface(true), balls: &self.balls, pose: None, rows: None }
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize].as_dvec3())
    }
}

/// A crumpled sheet, and triangles of all sizes and shapes: without area, duplicated, tiny, and far away.
fn bodies(random: &mut Random) -> [Body; 2] {
    let sheet = crumpled_sheet(1_000, 0.0);
    let mut triangles = Vec::new();
    for index in 0..600 {
        let place = random.vector() * [1.0, 1.0, 1.0e-20, 100.0][index % 4];
        let size = [1.0, 0.1, 1.0e-25, 1.0e-3][index / 4 % 4];
        let mut corners = [0, 1, 2].map(|_| (place + random.vector() * size).as_vec3());
        match index % 11 {
            0 => corners[2] = corners[0],
            1 => corners = [corners[0]; 3],
            2 => corners[2] = corners[0].midpoint(corners[1]),
            _ => {}
        }
        triangles.extend([corners, corners]);
    }
    let (soup, list) = independent(&triangles);
    [Body::new(positions(&sheet), &sheet.triangles), Body::new(soup, &list)]
}

fn random_pairs(random: &mut Random, a: &Body, b: &Body) -> Vec<[u32; 2]> {
    let counts = [a, b].map(|body| body.topology.triangles().len());
    let mut pairs: Vec<[u32; 2]> = (0..60_001).map(|_| counts.map(|count| random.below(count) as u32)).collect();
    // The same triangle, and its twin in the same place.
    pairs.extend(
        (0..counts[1].min(counts[0]) as u32).flat_map(|triangle| [[triangle, triangle], [triangle, triangle ^ 1]]),
    );
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

fn box_gap(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let low = |corners: &[DVec3; 3]| corners[0].min(corners[1]).min(corners[2]);
    let high = |corners: &[DVec3; 3]| corners[0].max(corners[1]).max(corners[2]);
    (low(a) - high(b)).max(low(b) - high(a)).max_element().max(0.0)
}

fn gap_along(direction: DVec3, a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let along = |corners: &[DVec3; 3]| corners.map(|corner| direction.dot(corner - a[0]));
    let low = |values: [f64; 3]| values.into_iter().fold(f64::INFINITY, f64::min);
    let high = |values: [f64; 3]| values.into_iter().fold(f64::NEG_INFINITY, f64::max);
    (low(along(a)) - high(along(b))).max(low(along(b)) - high(along(a)))
}

/// The expected result of a single pair.
struct Expected {
    points: [Vec3; 2],
    normal: Vec3,
    gap: f64,
    distance: f64,
}

/// Compares the results with the expectation of each pair. Returns the number of contacts and of touching pairs.
fn assert_found(
    found: &FoundPairs,
    [a, b]: [&Body; 2],
    pairs: &[[u32; 2]],
    expected: impl Fn([u32; 2]) -> Option<Expected>,
) -> [usize; 2] {
    let (mut contacts, mut touching, mut nearest) = (found.contacts.iter(), found.touching.iter(), f64::INFINITY);
    for &[triangle_a, triangle_b] in pairs {
        let Some(expected) = expected([triangle_a, triangle_b]) else { continue };
        let distance = expected.distance * SETTINGS.scale;
        let gap = (expected.gap * SETTINGS.scale).min(distance);
        nearest = nearest.min(distance.max(0.0));
        let slack = DOUBLE_ROUNDING * (1.0 + distance.abs());
        let is_undecided = |limit: f64| (distance - limit).abs() <= slack;
        assert!(!is_undecided(SETTINGS.contact_distance) && !is_undecided(SETTINGS.reported_distance));
        if distance <= SETTINGS.contact_distance {
            let pair = touching.next().expect("the pair touches");
            assert_eq!([pair.triangle_a, pair.triangle_b], [triangle_a, triangle_b]);
            assert!((pair.distance - gap.max(0.0)).abs() <= slack, "{pair:?}: {gap}");
        }
        if distance <= SETTINGS.reported_distance {
            let contact = contacts.next().expect("the pair has a contact");
            assert_eq!([contact.triangle_a, contact.triangle_b], [triangle_a, triangle_b]);
            assert_eq!(contact.feature_numbers(), [triangle_a, triangle_b]);
            assert_eq!(contact.point_b, expected.points[1]);
            assert_eq!(contact.normal, expected.normal);
            assert!((f64::from(contact.distance) - gap).abs() <= slack + ROUNDING * gap.abs(), "{contact:?}: {gap}");
            let weights = [
                (contact.barycentric_a, barycentric_of(&a.corners(triangle_a), expected.points[0].as_dvec3())),
                (contact.barycentric_b, barycentric_of(&b.corners(triangle_b), expected.points[1].as_dvec3())),
            ];
            for (weights, expected) in weights {
                assert_eq!(weights, [expected[0] as f32, expected[1] as f32], "{contact:?}");
            }
        }
    }
    assert!(contacts.next().is_none() && touching.next().is_none(), "there are unexpected results");
    assert!((found.nearest - nearest).abs() <= DOUBLE_ROUNDING || found.nearest == nearest);
    [found.contacts.len(), found.touching.len()]
}

fn facing_caps(a: &CapSide<'_>, b: &CapSide<'_>, [triangle_a, triangle_b]: [u32; 2]) -> [Cap; 2] {
    let (cap_a, cap_b) = (a.cap(triangle_a), b.cap(triangle_b));
    [
        if a.surface.one_sided { cap_a } else { cap_a.facing(cap_b.in_plane_center()) },
        if b.surface.one_sided { cap_b } else { cap_b.facing(cap_a.in_plane_center()) },
    ]
}

#[test]
fn caps_eight_at_a_time_meet_where_one_pair_at_a_time_does() {
    let mut random = Random::new(1);
    let [sheet, soup] = bodies(&mut random);
    let (mut concentric, mut met, mut counts) = (0, 0, [0; 2]);
    for (one, other) in [(&sheet, &soup), (&soup, &sheet), (&sheet, &sheet), (&soup, &soup)] {
        let pairs = random_pairs(&mut random, one, other);
        for sides in [[true, true], [false, true], [false, false]] {
            let (a, b) = (one.cap_side(sides[0]), other.cap_side(sides[1]));
            let (mut meeting, mut found) = (Vec::new(), FoundPairs::default());
            meeting_caps(&a, &b, &pairs, &SETTINGS, &mut meeting, &mut found);
            let contact = |pair: [u32; 2]| {
                let [cap_a, cap_b] = facing_caps(&a, &b, pair);
                Some((cap_contact(&cap_a, &cap_b)?, cap_a, cap_b))
            };
            let expected: Vec<[u32; 2]> = pairs.iter().copied().filter(|&pair| contact(pair).is_some()).collect();
            assert!(meeting == expected, "{} pairs meet, {} should", meeting.len(), expected.len());
            met += meeting.len();
            concentric += pairs
                .iter()
                .filter(|&&pair| {
                    let [cap_a, cap_b] = facing_caps(&a, &b, pair);
                    cap_a.center == cap_b.center
                })
                .count();
            let found_counts = assert_found(&found, [one, other], &pairs, |pair| {
                let (contact, cap_a, cap_b) = contact(pair)?;
                let corners = [one.corners(pair[0]), other.corners(pair[1])];
                let between = cap_a.center.as_dvec3().distance(cap_b.center.as_dvec3());
                let directions = [cap_a.axis, cap_b.axis, contact.direction].map(Vec3::as_dvec3);
                let planes = directions.map(|direction| gap_along(direction, &corners[0], &corners[1]));
                let spheres = between - f64::from(cap_a.radius) - f64::from(cap_b.radius);
                let distance = planes.into_iter().fold(spheres, f64::max).max(box_gap(&corners[0], &corners[1]));
                let points = [contact.point_a, contact.point_b];
                Some(Expected { points, normal: contact.direction, gap: f64::from(contact.gap), distance })
            });
            counts = [counts[0] + found_counts[0], counts[1] + found_counts[1]];

            // Rows must give the same numbers.
            let (mut rows_a, mut rows_b) = (CapRows::default(), CapRows::default());
            a.rows(&Sequential, &mut rows_a);
            b.rows(&Sequential, &mut rows_b);
            let (mut meeting_by_rows, mut found_by_rows) = (Vec::new(), FoundPairs::default());
            let (a, b) = (CapSide { rows: Some(&rows_a), ..a }, CapSide { rows: Some(&rows_b), ..b });
            meeting_caps(&a, &b, &pairs, &SETTINGS, &mut meeting_by_rows, &mut found_by_rows);
            assert!(meeting_by_rows == meeting && found_by_rows.touching == found.touching);
            assert!(found_by_rows.contacts == found.contacts && found_by_rows.nearest == found.nearest);
        }
    }
    println!("{met} pairs of caps meet, {concentric} are concentric; contacts, touching: {counts:?}");
    assert!(met > 50_000 && concentric > 5_000 && counts[0] > counts[1] + 1_000 && counts[1] > 10_000);
}

#[test]
fn balls_eight_at_a_time_touch_where_one_pair_at_a_time_does() {
    let mut random = Random::new(2);
    let [sheet, soup] = bodies(&mut random);
    let mut counts = [0; 2];
    for (one, other) in [(&sheet, &soup), (&sheet, &sheet), (&soup, &soup)] {
        let pairs = random_pairs(&mut random, one, other);
        let (a, b) = (one.ball_side(), other.ball_side());
        let mut found = FoundPairs::default();
        ball_contacts(&a, &b, &pairs, &SETTINGS, &mut found);
        let found_counts = assert_found(&found, [one, other], &pairs, |pair| {
            let (own, other_ball) = (a.ball(pair[0]), b.ball(pair[1]));
            let between = own.center.as_dvec3() - other_ball.center.as_dvec3();
            let normal = between.normalize_or(DVec3::Y).as_vec3();
            let gap = between.length() - f64::from(own.radius) - f64::from(other_ball.radius);
            let distance = gap.max(box_gap(&one.corners(pair[0]), &other.corners(pair[1])));
            let points = [own.center - normal * own.radius, other_ball.center + normal * other_ball.radius];
            Some(Expected { points, normal: -normal, gap, distance })
        });
        counts = [counts[0] + found_counts[0], counts[1] + found_counts[1]];

        let (mut rows_a, mut rows_b) = (BallRows::default(), BallRows::default());
        a.rows(&Sequential, &mut rows_a);
        b.rows(&Sequential, &mut rows_b);
        let mut by_rows = FoundPairs::default();
        let (a, b) = (BallSide { rows: Some(&rows_a), ..a }, BallSide { rows: Some(&rows_b), ..b });
        ball_contacts(&a, &b, &pairs, &SETTINGS, &mut by_rows);
        assert!(by_rows.touching == found.touching && by_rows.contacts == found.contacts);
    }
    println!("contacts, touching: {counts:?}");
    assert!(counts[0] > counts[1] + 1_000 && counts[1] > 10_000);
}

/// A body and a pose that rotates, moves, and enlarges it.
struct Moved {
    body: Body,
    pose: Pose,
    positions: Vec<Vec3>,
}

impl Moved {
    fn new(body: Body, translation: Vec3) -> Self {
        let (scale, turn) = (Vec3::splat(1.25), Quat::from_rotation_y(0.3));
        let affine = Affine3A::from_scale_rotation_translation(scale, turn, translation);
        let pose = Pose::from_affine(&affine).expect("a similarity");
        let mut positions = Vec::new();
        pose.transform_points(&body.positions, &mut positions);
        Self { body, pose, positions }
    }

    fn surface(&self) -> SurfaceSide<'_> {
        let moved = MovedSide::new(&self.body.positions, &self.pose, &self.positions);
        SurfaceSide { positions: &self.positions, moved: Some(moved), ..self.body.surface(true) }
    }

    fn ball_side(&self) -> BallSide<'_> {
        BallSide { surface: self.surface(), pose: Some(&self.pose), ..self.body.ball_side() }
    }

    fn cap_side(&self) -> CapSide<'_> {
        CapSide { surface: self.surface(), pose: Some(&self.pose), ..self.body.cap_side(true) }
    }

    /// The mesh as it is in the world. Its balls and caps are transformed one by one.
    fn standing(&self) -> Body {
        let (balls, caps) = (self.ball_side(), self.cap_side());
        let triangles = 0..self.body.topology.triangles().len() as u32;
        let caps: Vec<Cap> = triangles.clone().map(|triangle| caps.cap(triangle)).collect();
        let (mut spheres, mut cones) = (self.body.spheres.clone(), self.body.cones.clone());
        spheres.centers = caps.iter().map(|cap| cap.center).collect();
        spheres.radii = caps.iter().map(|cap| cap.radius).collect();
        spheres.heights = caps.iter().map(|cap| cap.height).collect();
        cones.axes = caps.iter().map(|cap| cap.axis).collect();
        cones.cosines = caps.iter().map(|cap| cap.cosine).collect();
        let balls = triangles.map(|triangle| balls.ball(triangle)).collect();
        Body { topology: self.body.topology.clone(), positions: self.positions.clone(), balls, spheres, cones }
    }
}

/// Corners of a moved side are not rounded. Spheres and caps are, however they are transformed.
#[test]
fn a_moved_side_gives_the_contacts_of_the_mesh_that_stands_there() {
    let mut random = Random::new(3);
    let [[sheet, _], [other, _]] = [bodies(&mut random), bodies(&mut random)];
    let pairs = random_pairs(&mut random, &sheet, &other);
    let moved = Moved::new(other, Vec3::Y * 0.05);
    let standing = moved.standing();
    let near = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs()) <= 1.0e-3;
    let assert_same = |found: &FoundPairs, expected: &FoundPairs| {
        assert!(found.contacts.len() > 400, "{}", found.contacts.len());
        assert_eq!(found.contacts.len(), expected.contacts.len());
        for (contact, expected) in found.contacts.iter().zip(&expected.contacts) {
            assert_eq!((contact.key, contact.normal), (expected.key, expected.normal));
            // Corners of a mesh of size 2 are rounded by 1e-7. Triangles are 0.1 wide, slivers a hundredth of that.
            assert!(near(contact.barycentric_b, expected.barycentric_b), "{contact:?} {expected:?}");
        }
    };

    let (a, b) = (sheet.ball_side(), moved.ball_side());
    let mut rows = BallRows::default();
    b.rows(&Sequential, &mut rows);
    let [found, by_rows, expected] = [b, BallSide { rows: Some(&rows), ..b }, standing.ball_side()].map(|b| {
        let mut found = FoundPairs::default();
        ball_contacts(&a, &b, &pairs, &SETTINGS, &mut found);
        found
    });
    assert_same(&found, &expected);
    assert!(by_rows.contacts == found.contacts && by_rows.touching == found.touching);

    let (a, b) = (sheet.cap_side(true), moved.cap_side());
    let mut rows = CapRows::default();
    b.rows(&Sequential, &mut rows);
    let [found, by_rows, expected] = [b, CapSide { rows: Some(&rows), ..b }, standing.cap_side(true)].map(|b| {
        let (mut meeting, mut found) = (Vec::new(), FoundPairs::default());
        meeting_caps(&a, &b, &pairs, &SETTINGS, &mut meeting, &mut found);
        found
    });
    assert_same(&found, &expected);
    assert!(by_rows.contacts == found.contacts && by_rows.touching == found.touching);
}

/// The distances of balls of a moved side do not depend on how its corners are rounded, even at the limit.
#[test]
fn balls_of_a_moved_side_are_found_where_they_are_written_even_at_the_limit() {
    let mut random = Random::new(5);
    let [sheet, soup] = bodies(&mut random);
    // At this distance, single precision resolves only a ten-thousandth.
    let far = Vec3::splat(2_000.0);
    let sheet = Body::new(sheet.positions.iter().map(|&place| place + far).collect(), sheet.topology.triangles());
    let pairs = random_pairs(&mut random, &sheet, &soup);
    let moved = Moved::new(soup, far);
    let (a, b) = (sheet.ball_side(), moved.ball_side());
    // Distances between boxes of the corners, which are not rounded.
    let limits = pairs.iter().filter_map(|&[triangle_a, triangle_b]| {
        let (own, other) = (a.ball(triangle_a), b.ball(triangle_b));
        let gap = own.center.as_dvec3().distance(other.center.as_dvec3()) - f64::from(own.radius + other.radius);
        let corners = moved.body.corners(triangle_b).map(|corner| moved.pose.transform_point(corner));
        let boxes = box_gap(&sheet.corners(triangle_a), &corners);
        (boxes > gap && (1.0e-3..9.0).contains(&boxes)).then_some(boxes * SETTINGS.scale)
    });
    let limits: Vec<f64> = limits.collect();
    let mut touching = 0;
    for _ in 0..200 {
        let limit = limits[random.below(limits.len())];
        for contact_distance in [limit, limit.next_down()] {
            let settings =
                PairSettings { contact_distance, reported_distance: 1.5 * limit, range: 2.0 * limit, ..SETTINGS };
            let (mut overlapping, mut found, mut written) =
                (Vec::new(), FoundSpheres::default(), FoundPairs::default());
            overlapping_ball_contacts(&a, &b, &pairs, &settings, &mut overlapping, &mut found);
            ball_contacts(&a, &b, &overlapping, &settings, &mut written);
            assert_eq!([found.touching, found.reported], [written.touching.len(), written.contacts.len()]);
            assert_eq!(found.nearest, written.nearest);
            touching += found.touching;
        }
    }
    println!("{} limits, {touching} touch", limits.len());
    assert!(limits.len() > 1_000 && touching > 10_000);
}

/// Single precision decides most pairs. Where the limit equals the distance of a pair to the last bit, it cannot.
#[test]
fn balls_are_found_where_they_are_written_even_at_the_limit() {
    let mut random = Random::new(4);
    let [sheet, soup] = bodies(&mut random);
    let (mut touching, mut apart) = (0, 0);
    for (one, other) in [(&sheet, &soup), (&sheet, &sheet), (&soup, &soup)] {
        let same_surface = std::ptr::eq(one, other);
        let mut pairs = random_pairs(&mut random, one, other);
        // Within one surface, a pair in reverse order has the same contact.
        pairs.retain(|[first, second]| !same_surface || first < second);
        let (a, b) = (one.ball_side(), other.ball_side());
        let (mut rows_a, mut rows_b) = (BallRows::default(), BallRows::default());
        a.rows(&Sequential, &mut rows_a);
        b.rows(&Sequential, &mut rows_b);
        let (by_rows_a, by_rows_b) = (BallSide { rows: Some(&rows_a), ..a }, BallSide { rows: Some(&rows_b), ..b });
        let ball_gap = |[triangle_a, triangle_b]: [u32; 2]| {
            let (own, other_ball) = (a.ball(triangle_a), b.ball(triangle_b));
            let between = own.center.as_dvec3().distance(other_ball.center.as_dvec3());
            between - f64::from(own.radius) - f64::from(other_ball.radius)
        };
        let distance = |[triangle_a, triangle_b]: [u32; 2]| {
            ball_gap([triangle_a, triangle_b]).max(box_gap(&one.corners(triangle_a), &other.corners(triangle_b)))
                * SETTINGS.scale
        };
        let distances = pairs.iter().map(|&pair| distance(pair));
        let limits: Vec<f64> = distances.filter(|distance| (1.0e-3..1.0).contains(distance)).collect();
        for _ in 0..20 {
            let limit = limits[random.below(limits.len())];
            for contact_distance in [limit, limit.next_down()] {
                let (reported_distance, range) = (1.5 * limit, 2.0 * limit);
                let settings = PairSettings { contact_distance, reported_distance, range, same_surface, ..SETTINGS };
                let (mut kept, mut written) = (Vec::new(), FoundPairs::default());
                overlapping_ball_contacts(&a, &b, &pairs, &settings, &mut kept, &mut FoundSpheres::default());
                let is_neighbor = |[first, second]: [u32; 2]| {
                    same_surface && one.topology.share_vertex(TriangleId(first), TriangleId(second))
                };
                for &pair in pairs.iter().filter(|&&pair| !is_neighbor(pair)) {
                    let gap = ball_gap(pair) * SETTINGS.scale;
                    // Rounding of coordinates of 100 in f32.
                    let is_certain = (gap - range).abs() > 1.0e-4;
                    assert!(!is_certain || kept.contains(&pair) == (gap < range), "{pair:?}: {gap} of {range}");
                }
                ball_contacts(&a, &b, &kept, &settings, &mut written);
                for [a, b] in [[&a, &b], [&by_rows_a, &by_rows_b]] {
                    let (mut overlapping, mut found) = (Vec::new(), FoundSpheres::default());
                    overlapping_ball_contacts(a, b, &pairs, &settings, &mut overlapping, &mut found);
                    assert!(overlapping == kept);
                    assert_eq!([found.touching, found.reported], [written.touching.len(), written.contacts.len()]);
                    assert_eq!(found.nearest, written.nearest);
                    let mut contacts = written.contacts.iter();
                    for found in found.contacts(&overlapping) {
                        let contact = contacts.next().expect("the contact exists");
                        assert_eq!((found.triangle_a, found.triangle_b), contact.triangles());
                        let slack = 16.0 * f32::EPSILON * (1.0 + contact.distance.abs());
                        assert!((found.distance - contact.distance).abs() <= slack, "{found:?}: {contact:?}");
                    }
                    touching += found.touching;
                    apart += found.distances.iter().filter(|distance| distance.is_infinite()).count();
                }
            }
        }
    }
    println!("{touching} touch, {apart} overlapping ones have no contact");
    assert!(touching > 100_000 && apart > 100_000);
}
