//! The exact stage over whole surfaces: signs, keys, and independence from the order of triangles.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use bevy_circumsphere::kernel::{
    contact::{CompactContact, ContactKey},
    exact::{
        PairProximity, examine_pair,
        penetration::{Finding, PenetrationTest},
        stage::{closest_pairs, exact_pairs},
        unique::UniqueFeatures,
    },
    mesh::{
        feature::{Feature, FeatureKind, FeaturePair},
        ids::TriangleId,
        topology::SurfaceTopology,
    },
    pair::{FoundPairs, MovedSide, PairSettings, SurfaceSide},
    pose::Pose,
};
use circumsphere_support::scenes::{Mesh, duplicate_vertices, icosphere, merge, triangle_soup};
use circumsphere_truth::{
    exact_weld, point_triangle, touching_pairs_between_brute_force, touching_pairs_brute_force, triangle_distance,
};
use glam::{DAffine3, DQuat, DVec3, Vec3};

use crate::{
    common::Random,
    truth::{corners, exact, positions},
};

const REACH: f64 = 0.08;

/// [`exact_pairs`] or [`closest_pairs`].
type Test = fn(&SurfaceSide<'_>, &SurfaceSide<'_>, &[[u32; 2]], &PairSettings, &mut FoundPairs);

fn settings(same_surface: bool, cull: bool) -> PairSettings {
    PairSettings {
        contact_distance: REACH,
        reported_distance: REACH,
        range: REACH,
        scale: 1.0,
        bulge: 0.0,
        cull,
        same_surface,
        any_left_out: false,
    }
}

fn side<'a>(topology: &'a SurfaceTopology, positions: &'a [Vec3], one_sided: bool) -> SurfaceSide<'a> {
    SurfaceSide { one_sided, ..SurfaceSide::flat(topology, positions) }
}

fn all_between(a: usize, b: usize) -> Vec<[u32; 2]> {
    (0..a as u32).flat_map(|first| (0..b as u32).map(move |second| [first, second])).collect()
}

fn all_within(count: usize) -> Vec<[u32; 2]> {
    (0..count as u32).flat_map(|first| (first + 1..count as u32).map(move |second| [first, second])).collect()
}

fn weights([first, second]: [f32; 2]) -> [f64; 3] {
    [f64::from(first), f64::from(second), 1.0 - f64::from(first) - f64::from(second)]
}

fn at(triangle: &[DVec3; 3], weights: [f64; 3]) -> DVec3 {
    triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2]
}

/// How far outside a convex closed mesh a point is: its largest distance above the plane of any face. Negative inside.
fn outside_of_convex(point: DVec3, positions: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
    triangles
        .iter()
        .map(|&triangle| {
            let [a, b, c] = exact(corners(positions, triangle));
            (b - a).cross(c - a).normalize().dot(point - a)
        })
        .fold(f64::NEG_INFINITY, f64::max)
}

fn is_on_a_boundary(contact: &CompactContact) -> bool {
    matches!(contact.features.kind(), FeatureKind::VertexVertex | FeatureKind::VertexEdge)
}

/// One contact per key, that of the lowest triangles. Closest contacts on a boundary may be reported by several
/// triangles. In a self-collision, so may contacts whose features have neighbors as their lowest triangles.
fn by_key(contacts: &[CompactContact], same_surface: bool) -> BTreeMap<ContactKey, CompactContact> {
    let mut kept: BTreeMap<ContactKey, CompactContact> = BTreeMap::new();
    for contact in contacts {
        let lowest = kept.entry(contact.key).or_insert(*contact);
        let [triangles, lowest_triangles] = [contact, &*lowest].map(|contact| (contact.triangle_a, contact.triangle_b));
        if triangles != lowest_triangles {
            assert!(same_surface || is_on_a_boundary(contact), "{contact:?} {lowest:?}");
            assert!((contact.distance - lowest.distance).abs() <= 1.0e-6, "{contact:?} {lowest:?}");
        }
        if triangles < lowest_triangles {
            *lowest = *contact;
        }
    }
    kept
}

fn overlapping_spheres(depth: f32) -> [(Mesh, Vec<Vec3>); 2] {
    // Rotated and moved so that nothing is aligned.
    let a = icosphere(2, 1.0).rotate([0.3, 1.0, 0.2], 0.7);
    let b = icosphere(2, 0.8).rotate([1.0, 0.1, -0.4], 1.9).translate([1.8 - depth, 0.013, 0.021]);
    [a, b].map(|mesh| {
        let positions = positions(&mesh);
        (mesh, positions)
    })
}

#[test]
fn distances_are_negative_exactly_for_vertices_inside_the_other_sphere() {
    let (mut inside_contacts, mut outside_contacts, mut crossings) = (0, 0, 0);
    let mut boundary_contacts = [0; 2];
    for depth in [0.0, 0.05, 0.07, 0.1, 0.12, 0.14] {
        let [(mesh_a, points_a), (mesh_b, points_b)] = overlapping_spheres(depth);
        let topologies = [(&mesh_a, &points_a), (&mesh_b, &points_b)]
            .map(|(mesh, points)| SurfaceTopology::new(points, &mesh.triangles).expect("valid"));
        let candidates = all_between(mesh_a.triangles.len(), mesh_b.triangles.len());
        let mut found = FoundPairs::default();
        exact_pairs(
            &side(&topologies[0], &points_a, true),
            &side(&topologies[1], &points_b, true),
            &candidates,
            &settings(false, true),
            &mut found,
        );
        let contacts = by_key(&found.contacts, false);
        let mut reported_vertices = [BTreeSet::new(), BTreeSet::new()];
        for contact in contacts.values() {
            let triangle_a = exact(corners(&points_a, mesh_a.triangles[contact.triangle_a as usize]));
            let triangle_b = exact(corners(&points_b, mesh_b.triangles[contact.triangle_b as usize]));
            let point_a = at(&triangle_a, weights(contact.barycentric_a));
            let point_b = at(&triangle_b, weights(contact.barycentric_b));
            // Rounding of weights stored in f32, at coordinates of up to 2.
            let tolerance = 1.0e-6;
            assert!(point_b.distance(contact.point_b.as_dvec3()) <= tolerance);
            assert!((contact.normal.length() - 1.0).abs() <= 1.0e-6);
            assert!((point_a.distance(point_b) - f64::from(contact.distance.abs())).abs() <= tolerance, "{contact:?}");
            let normal = contact.normal.as_dvec3();
            assert!((point_b - point_a).distance(normal * f64::from(contact.distance)) <= tolerance, "{contact:?}");
            if contact.features.kind() == FeatureKind::VertexFace {
                assert!(normal.x > 0.0, "the normal points out of the first sphere whatever the sign: {contact:?}");
            }
            if is_on_a_boundary(contact) {
                // Near the curve where the spheres cross, one point may be inside and the other outside, and no sign is
                // right. Elsewhere one is.
                let outside_b = outside_of_convex(point_a, &points_b, &mesh_b.triangles);
                let outside_a = outside_of_convex(point_b, &points_a, &mesh_a.triangles);
                if outside_a.min(outside_b) > tolerance || outside_a.max(outside_b) < -tolerance {
                    assert_eq!(contact.distance < 0.0, outside_a < 0.0, "{contact:?} {outside_a} {outside_b}");
                    boundary_contacts[usize::from(outside_a < 0.0)] += 1;
                }
            }
            if contact.features.kind() == FeatureKind::EdgeFace {
                crossings += 1;
                assert_eq!(contact.distance, 0.0);
            }
            for (own, other_points, other_mesh, vertex_point, feature, other_feature) in [
                (0, &points_b, &mesh_b, point_a, contact.features.a, contact.features.b),
                (1, &points_a, &mesh_a, point_b, contact.features.b, contact.features.a),
            ] {
                let Feature::Vertex(corner) = feature else { continue };
                if other_feature != Feature::Face {
                    continue;
                }
                let (mesh, triangle) =
                    if own == 0 { (&mesh_a, contact.triangle_a) } else { (&mesh_b, contact.triangle_b) };
                reported_vertices[own].insert(mesh.triangles[triangle as usize][corner as usize]);
                let outside = outside_of_convex(vertex_point, other_points, &other_mesh.triangles);
                if outside.abs() > tolerance {
                    assert_eq!(contact.distance < 0.0, outside < 0.0, "{contact:?} {outside}");
                    if outside < 0.0 {
                        inside_contacts += 1;
                    } else {
                        outside_contacts += 1;
                    }
                }
            }
        }
        // Every vertex inside the other sphere has a face above it within reach, so none may be missing.
        for (own, points, other_points, other_mesh) in
            [(0, &points_a, &points_b, &mesh_b), (1, &points_b, &points_a, &mesh_a)]
        {
            for (vertex, point) in points.iter().enumerate() {
                let outside = outside_of_convex(point.as_dvec3(), other_points, &other_mesh.triangles);
                if outside < 0.0 && outside > -0.99 * REACH {
                    assert!(reported_vertices[own].contains(&(vertex as u32)), "{vertex} {outside}");
                }
            }
        }
        let expected = touching_pairs_between_brute_force(
            &points_a.iter().map(|point| point.as_dvec3()).collect::<Vec<_>>(),
            &mesh_a.triangles,
            &points_b.iter().map(|point| point.as_dvec3()).collect::<Vec<_>>(),
            &mesh_b.triangles,
            REACH,
        );
        let touching: Vec<[u32; 2]> = found.touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
        let expected_pairs: Vec<[u32; 2]> = expected.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
        assert_eq!(touching, expected_pairs);
        assert!(found.touching.len() > 10);
        for (pair, expected) in found.touching.iter().zip(&expected) {
            assert!((pair.distance - expected.distance).abs() <= 1.0e-12);
        }
        let nearest = expected.iter().map(|pair| pair.distance).fold(f64::INFINITY, f64::min);
        assert!((found.nearest - nearest).abs() <= 1.0e-12);
        assert_eq!(found.examined, candidates.len());
    }
    println!(
        "{inside_contacts} contacts of vertices inside, {outside_contacts} outside, {crossings} crossings, on \
         boundaries {boundary_contacts:?}"
    );
    assert!(boundary_contacts.iter().all(|&count| count > 10));
    assert!(inside_contacts > 10 && outside_contacts > 10 && crossings > 10);
}

/// Processes contacts between surfaces as detection does: settles penetrations, and keeps the first contact of each key
/// that several pairs of triangles may report. Contacts of one pair of triangles, which come in any order, are sorted
/// by key.
fn settled(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &FoundPairs,
) -> Vec<CompactContact> {
    let mut contacts = found.contacts.clone();
    let mut settling = PenetrationTest::default();
    settling.prepare(a, b, candidates, settings, &contacts);
    let mut findings = vec![Finding::Alone; settling.questions().len()];
    settling.look(a, b, &contacts, settling.questions(), &mut findings);
    settling.apply(&findings, settings, &mut contacts);
    contacts.sort_by_key(|contact| (contact.triangles(), contact.key));
    let mut known = HashSet::new();
    contacts.retain(|contact| !contact.is_shared || known.insert(contact.key));
    contacts
}

#[test]
fn screening_changes_nothing_and_neither_does_a_cut_through_the_candidates() {
    let [(mesh_a, points_a), (mesh_b, points_b)] = overlapping_spheres(0.1);
    let a = SurfaceTopology::new(&points_a, &mesh_a.triangles).expect("valid");
    let b = SurfaceTopology::new(&points_b, &mesh_b.triangles).expect("valid");
    let candidates = all_between(mesh_a.triangles.len(), mesh_b.triangles.len());
    let (mut screened, mut every) = (FoundPairs::default(), FoundPairs::default());
    let (side_a, side_b) = (side(&a, &points_a, true), side(&b, &points_b, true));
    exact_pairs(&side_a, &side_b, &candidates, &settings(false, true), &mut screened);
    exact_pairs(&side_a, &side_b, &candidates, &settings(false, false), &mut every);
    assert_eq!(screened.touching, every.touching);
    let settled = |found: &FoundPairs| {
        assert!(found.contacts.is_sorted_by_key(CompactContact::triangles));
        settled(&side_a, &side_b, &candidates, &settings(false, true), found)
    };
    assert_eq!(settled(&screened), settled(&every));
    assert!(screened.contacts.len() < every.contacts.len(), "shared features were computed once per pair");
    assert_eq!(screened.nearest, every.nearest);
    assert_eq!([screened.examined, every.examined], [candidates.len(); 2]);
    assert!(screened.touching.len() > 100 && screened.contacts.len() > 100);
    // Appended in parts, the result is the same.
    let (first, second) = candidates.split_at(candidates.len() / 3);
    let (mut head, mut tail) = (FoundPairs::default(), FoundPairs::default());
    exact_pairs(&side_a, &side_b, first, &settings(false, true), &mut head);
    exact_pairs(&side_a, &side_b, second, &settings(false, true), &mut tail);
    head.append(&mut tail);
    assert_eq!(settled(&head), settled(&screened));
    assert_eq!(head.touching, screened.touching);
    assert_eq!(head.nearest, screened.nearest);
    head.clear();
    assert!(head.contacts.is_empty() && head.touching.is_empty() && head.nearest == f64::INFINITY);
}

#[test]
fn what_was_reported_lately_need_not_be_told_again() {
    // One sphere inside the other: most triangles are closest to each other on their boundaries.
    let meshes = [icosphere(2, 1.0), icosphere(2, 0.95).rotate([1.0, 0.1, -0.4], 1.9)];
    let [(mesh_a, points_a), (mesh_b, points_b)] = meshes.map(|mesh| (mesh.clone(), positions(&mesh)));
    let a = SurfaceTopology::new(&points_a, &mesh_a.triangles).expect("valid");
    let b = SurfaceTopology::new(&points_b, &mesh_b.triangles).expect("valid");
    let candidates = all_between(mesh_a.triangles.len(), mesh_b.triangles.len());
    // Closest features inside faces and edges are reported by every pair.
    for (test, times) in [(exact_pairs as Test, 4), (closest_pairs as Test, 1)] {
        let find = |candidates: &[[u32; 2]]| {
            let mut found = FoundPairs::default();
            test(
                &side(&a, &points_a, false),
                &side(&b, &points_b, false),
                candidates,
                &settings(false, true),
                &mut found,
            );
            found
        };
        // Tested alone, a pair of triangles cannot know what others reported.
        let mut alone = FoundPairs::default();
        for candidate in &candidates {
            alone.append(&mut find(&[*candidate]));
        }
        let mut together = find(&candidates);
        let told = [alone.contacts.len(), together.contacts.len()];
        for found in [&mut alone, &mut together] {
            UniqueFeatures::default().drop_repeats(found, 0);
        }
        assert_eq!(together.contacts, alone.contacts);
        assert_eq!(together.touching, alone.touching);
        let repeats = told.map(|count| count - together.contacts.len());
        assert!(repeats[0] > 100 && repeats[1] * times < repeats[0], "repeats: {repeats:?}");
    }
}

#[test]
fn lengths_are_world_lengths_whatever_the_scale_of_the_frame() {
    let [(mesh_a, points_a), (mesh_b, points_b)] = overlapping_spheres(0.05);
    let a = SurfaceTopology::new(&points_a, &mesh_a.triangles).expect("valid");
    let b = SurfaceTopology::new(&points_b, &mesh_b.triangles).expect("valid");
    let candidates = all_between(mesh_a.triangles.len(), mesh_b.triangles.len());
    let mut unit = FoundPairs::default();
    exact_pairs(&side(&a, &points_a, true), &side(&b, &points_b, true), &candidates, &settings(false, true), &mut unit);
    // In a frame with units a quarter as long, every length is four times as large. A power of two does not round.
    let fine = |points: &[Vec3]| points.iter().map(|point| *point * 4.0).collect::<Vec<_>>();
    let (fine_a, fine_b) = (fine(&points_a), fine(&points_b));
    let mut scaled = FoundPairs::default();
    let settings = PairSettings { scale: 0.25, ..settings(false, true) };
    exact_pairs(&side(&a, &fine_a, true), &side(&b, &fine_b, true), &candidates, &settings, &mut scaled);
    assert_eq!(scaled.touching, unit.touching);
    assert_eq!(scaled.contacts.len(), unit.contacts.len());
    for (scaled, unit) in scaled.contacts.iter().zip(&unit.contacts) {
        assert_eq!((scaled.key, scaled.distance, scaled.normal), (unit.key, unit.distance, unit.normal));
        assert_eq!(scaled.point_b, unit.point_b * 4.0);
    }
    assert!(unit.contacts.len() > 20);
}

#[test]
fn a_mirrored_side_keeps_its_inside() {
    let [(mesh_a, points_a), (mesh_b, points_b)] = overlapping_spheres(0.1);
    let a = SurfaceTopology::new(&points_a, &mesh_a.triangles).expect("valid");
    let candidates = all_between(mesh_a.triangles.len(), mesh_b.triangles.len());
    let b = SurfaceTopology::new(&points_b, &mesh_b.triangles).expect("valid");
    let mut plain = FoundPairs::default();
    exact_pairs(
        &side(&a, &points_a, true),
        &side(&b, &points_b, true),
        &candidates,
        &settings(false, true),
        &mut plain,
    );
    // The same surface, stored inside out and transformed by a mirroring pose.
    let inverted: Vec<[u32; 3]> = mesh_b.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    let inverted = SurfaceTopology::new(&points_b, &inverted).expect("valid");
    let mirrored = SurfaceSide { mirrored: true, ..side(&inverted, &points_b, true) };
    let mut turned = FoundPairs::default();
    exact_pairs(&side(&a, &points_a, true), &mirrored, &candidates, &settings(false, true), &mut turned);
    let (plain, turned) = (by_key(&plain.contacts, false), by_key(&turned.contacts, false));
    assert_eq!(plain.len(), turned.len());
    let mut inside = 0;
    for (key, contact) in &plain {
        let other = turned[key];
        assert!((contact.distance - other.distance).abs() <= 1.0e-6);
        assert!(contact.normal.distance(other.normal) <= 1.0e-4 || contact.distance.abs() < 1.0e-4);
        inside += usize::from(contact.distance < 0.0);
    }
    assert!(inside > 3);
}

#[test]
fn of_two_sheets_no_distance_is_negative() {
    let [(mesh_a, points_a), (mesh_b, points_b)] = overlapping_spheres(0.1);
    let a = SurfaceTopology::new(&points_a, &mesh_a.triangles).expect("valid");
    let b = SurfaceTopology::new(&points_b, &mesh_b.triangles).expect("valid");
    let candidates = all_between(mesh_a.triangles.len(), mesh_b.triangles.len());
    let mut found = FoundPairs::default();
    exact_pairs(
        &side(&a, &points_a, false),
        &side(&b, &points_b, false),
        &candidates,
        &settings(false, true),
        &mut found,
    );
    assert!(found.contacts.len() > 20);
    assert!(found.contacts.iter().all(|contact| contact.distance >= 0.0));
}

/// Names a contact's two features by the caller's vertices, independently of the order of triangles.
fn features_by_vertices(contact: &CompactContact, triangles: &[[u32; 3]]) -> [Vec<u32>; 2] {
    let name = |triangle: u32, feature: Feature| {
        let corners = triangles[triangle as usize];
        let mut vertices = match feature {
            Feature::Vertex(corner) => vec![corners[corner as usize]],
            Feature::Edge(edge) => vec![corners[edge as usize], corners[(edge as usize + 1) % 3]],
            Feature::Face => corners.to_vec(),
        };
        vertices.sort_unstable();
        vertices
    };
    let mut names = [name(contact.triangle_a, contact.features.a), name(contact.triangle_b, contact.features.b)];
    names.sort();
    names
}

/// The corners of a triangle that belong to a feature. Some are repeated.
fn corners_of(feature: Feature) -> [usize; 3] {
    match feature {
        Feature::Vertex(corner) => [corner.into(); 3],
        Feature::Edge(edge) => [edge.into(), edge.into(), (usize::from(edge) + 1) % 3],
        Feature::Face => [0, 1, 2],
    }
}

/// A surface that folds back onto itself at random: a crumpled ball with a soup through it.
fn crumpled(seed: u64) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut random = Random::new(seed);
    let mesh = merge(&[
        icosphere(2, 1.0),
        icosphere(1, 0.9).rotate([1.0, 2.0, 3.0], 0.5).translate([0.31, 0.17, -0.12]),
        triangle_soup(60, seed),
    ]);
    let points = positions(&mesh).iter().map(|&point| point + (random.vector() * 0.15).as_vec3()).collect();
    (points, mesh.triangles)
}

fn self_contacts(points: &[Vec3], triangles: &[[u32; 3]]) -> FoundPairs {
    let topology = SurfaceTopology::new(points, triangles).expect("valid");
    let own = side(&topology, points, false);
    let mut found = FoundPairs::default();
    let mut candidates = all_within(triangles.len());
    // The broad phase leaves these out.
    candidates.retain(|&[a, b]| !topology.share_vertex(TriangleId(a), TriangleId(b)));
    exact_pairs(&own, &own, &candidates, &settings(true, true), &mut found);
    found
}

#[test]
fn the_contacts_of_a_surface_with_itself_do_not_depend_on_the_order_of_its_triangles() {
    let mut compared = 0;
    for seed in 1..=4 {
        let mut random = Random::new(seed);
        let (points, triangles) = crumpled(seed);
        let named = |triangles: &[[u32; 3]]| {
            let found = self_contacts(&points, triangles);
            let mut touching: Vec<[Vec<u32>; 2]> = found
                .touching
                .iter()
                .map(|pair| {
                    let mut names = [pair.triangle_a, pair.triangle_b].map(|triangle| {
                        let mut corners = triangles[triangle as usize].to_vec();
                        corners.sort_unstable();
                        corners
                    });
                    names.sort();
                    names
                })
                .collect();
            touching.sort();
            let mut contacts: Vec<([Vec<u32>; 2], f32)> = by_key(&found.contacts, true)
                .values()
                .map(|contact| (features_by_vertices(contact, triangles), contact.distance))
                .collect();
            contacts.sort_by(|a, b| a.0.cmp(&b.0));
            (touching, contacts)
        };
        let (touching, contacts) = named(&triangles);
        assert!(contacts.windows(2).all(|pair| pair[0].0 != pair[1].0), "each feature pair once");
        for _ in 0..3 {
            let mut shuffled = triangles.clone();
            for last in (1..shuffled.len()).rev() {
                let other = random.below(last + 1);
                shuffled.swap(last, other);
            }
            for corners in &mut shuffled {
                let turn = random.below(3);
                corners.rotate_left(turn);
            }
            let (other_touching, other_contacts) = named(&shuffled);
            assert_eq!(other_touching, touching);
            assert_eq!(other_contacts.len(), contacts.len());
            for (found, expected) in other_contacts.iter().zip(&contacts) {
                assert_eq!(found.0, expected.0);
                // Differences are taken from another corner: f64 rounding, stored as f32.
                assert!((found.1 - expected.1).abs() <= 1.0e-6, "{found:?} {expected:?}");
                compared += 1;
            }
        }
    }
    println!("{compared} contacts compared");
    assert!(compared > 10_000);
}

#[test]
fn the_touching_pairs_of_a_surface_with_itself_are_those_of_the_reference() {
    for seed in 1..=3 {
        let (points, triangles) = crumpled(seed);
        let found = self_contacts(&points, &triangles);
        let exact: Vec<DVec3> = points.iter().map(|point| point.as_dvec3()).collect();
        let expected = touching_pairs_brute_force(&exact, &triangles, &exact_weld(&exact), REACH);
        let pairs: Vec<[u32; 2]> = found.touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
        assert_eq!(pairs, expected.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect::<Vec<_>>());
        assert!(pairs.len() > 500, "{}", pairs.len());
        // The contacts contain the closest features of every touching pair, and every contact belongs to a touching
        // pair.
        let distances: BTreeMap<[u32; 2], f64> =
            found.touching.iter().map(|pair| ([pair.triangle_a, pair.triangle_b], pair.distance)).collect();
        for contact in &found.contacts {
            let pair = [contact.triangle_a, contact.triangle_b];
            assert!(distances[&pair] <= f64::from(contact.distance.abs()) + 1.0e-7);
        }
    }
}

/// A vertex over the two faces at an inner edge, or an edge over another, is one contact instead of one per triangle.
#[test]
fn a_vertex_over_a_sheet_is_one_contact() {
    let points = [
        Vec3::new(-1.0, 0.0, -1.0),
        Vec3::new(1.0, 0.0, -1.0),
        Vec3::new(1.0, 0.0, 1.0),
        Vec3::new(-1.0, 0.0, 1.0),
        // A fan of four triangles around one vertex above the first face.
        Vec3::new(0.3, 0.05, -0.4),
        Vec3::new(0.3, 1.0, -0.1),
        Vec3::new(0.6, 1.0, -0.4),
        Vec3::new(0.3, 1.0, -0.7),
        Vec3::new(0.0, 1.0, -0.4),
    ];
    let triangles = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [4, 7, 8], [4, 8, 5]];
    let found = self_contacts(&points, &triangles);
    assert_eq!(found.touching.len(), 4, "each triangle of the fan");
    assert_eq!(found.contacts.len(), 1);
    let contact = found.contacts[0];
    assert_eq!(contact.features.kind(), FeatureKind::VertexFace);
    assert!((contact.distance - 0.05).abs() < 1.0e-7);
    let (vertex, face) = if contact.features.b == Feature::Face { (2, 0) } else { (0, 2) };
    assert_eq!(contact.triangle_a.min(contact.triangle_b), face.min(vertex));
    // The reference agrees for each triangle.
    let exact_corners = |triangle: usize| exact(corners(&points, triangles[triangle]));
    for triangle in 2..6 {
        assert!((triangle_distance(&exact_corners(0), &exact_corners(triangle)) - 0.05).abs() < 1.0e-7);
    }
    assert!((point_triangle(points[4].as_dvec3(), &exact_corners(0)).distance - 0.05).abs() < 1.0e-7);
    assert_eq!(Pose::IDENTITY.scale(), 1.0);
}

/// Positions are rounded when they are moved to the frame of the pair, which does not change the features. Almost no
/// pair that is apart needs the exact test because of it.
#[test]
fn the_closest_features_of_a_moved_surface_are_told_as_often_as_those_of_one_in_place() {
    let own = icosphere(3, 1.0).rotate([0.3, 1.0, 0.2], 0.7);
    let other = icosphere(3, 0.8).rotate([1.0, 0.1, -0.4], 1.9);
    let (own_points, other_points) = (positions(&own), positions(&other));
    let a = SurfaceTopology::new(&own_points, &own.triangles).expect("valid");
    let b = SurfaceTopology::new(&other_points, &other.triangles).expect("valid");
    let turn = DQuat::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 0.3);
    let pose = DAffine3::from_rotation_translation(turn, DVec3::new(1.83, 0.013, 0.021));
    let pose = Pose::from_double_affine(&pose).expect("a rigid motion");
    let mut moved_points = Vec::new();
    pose.transform_points(&other_points, &mut moved_points);
    let settings = settings(false, true);
    let candidates = all_between(own.triangles.len(), other.triangles.len());

    let own_side = side(&a, &own_points, true);
    let in_place = side(&b, &moved_points, true);
    let moved = SurfaceSide { moved: Some(MovedSide::new(&other_points, &pose, &moved_points)), ..in_place };
    let examined = [in_place, moved].map(|other_side| {
        let mut found = FoundPairs::default();
        closest_pairs(&own_side, &other_side, &candidates, &settings, &mut found);
        let mut every = FoundPairs::default();
        exact_pairs(&own_side, &other_side, &candidates, &settings, &mut every);
        // The same pairs, with distances that agree as far as single precision distinguishes the features.
        let pairs = |found: &FoundPairs| -> Vec<[u32; 2]> {
            found.touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect()
        };
        assert_eq!(pairs(&found), pairs(&every));
        assert!(found.touching.len() > 100, "{} pairs touch", found.touching.len());
        for (pair, exact) in found.touching.iter().zip(&every.touching) {
            assert!((pair.distance - exact.distance).abs() <= 1.0e-5 * 0.15, "{pair:?} {exact:?}");
        }
        found.examined
    });
    println!("{examined:?} pairs examined");
    assert!(examined[1] * 10 <= examined[0] * 11, "{examined:?} in place and moved");
}

/// A large triangle, which single precision can hardly tell from one that crosses, next to a small one, which it can.
#[test]
fn every_touching_pair_has_its_closest_features_among_those_of_the_closest_alone() {
    let (vertex, lowest) = (Vec3::new(0.2, 1.0e-4, 0.1), Vec3::new(0.25, 5.0e-5, 0.15));
    let own =
        [vertex, lowest, Vec3::new(0.1, 0.3, 0.2), Vec3::new(1000.0, 500.0, 0.0), Vec3::new(1000.0, 500.0, 300.0)];
    let floor = [Vec3::new(-1.0, 0.0, -1.0), Vec3::new(0.0, 0.0, 2.0), Vec3::new(2.0, 0.0, -1.0)];
    let a = SurfaceTopology::new(&own, &[[0, 1, 2], [0, 3, 4]]).expect("valid");
    let b = SurfaceTopology::new(&floor, &[[0, 1, 2]]).expect("valid");
    let mut found = FoundPairs::default();
    let sides = [side(&a, &own, false), side(&b, &floor, false)];
    closest_pairs(&sides[0], &sides[1], &all_between(2, 1), &settings(false, true), &mut found);
    assert_eq!(found.touching.len(), 2, "{found:?}");
    for touching in &found.touching {
        let corner = if touching.triangle_a == 0 { lowest } else { vertex };
        assert_eq!(touching.distance as f32, corner.y);
        let is_it = |contact: &&CompactContact| contact.distance == corner.y;
        assert_eq!(found.contacts.iter().filter(is_it).count(), 1, "{touching:?} {:?}", found.contacts);
    }
}

/// The mesh with its vertices on a grid, if `step` is not 0. There, triangles share points, are coplanar, have parallel
/// edges, or have no area.
fn on_grid(mut mesh: Mesh, step: f32) -> Mesh {
    for coordinate in mesh.positions.iter_mut().flatten().filter(|_| step > 0.0) {
        *coordinate = (*coordinate / step).round() * step;
    }
    mesh
}

/// The screen handles the features of eight pairs at a time before any pair is examined. Its result must be
/// bit-identical to the test of single pairs: exactly the pairs that the test does not find are screened out.
#[test]
fn screened_pairs_are_those_that_examining_each_pair_finds() {
    let (mut within, mut crossing, mut beyond, mut features) = (0, 0, 0, 0);
    for (seed, grid) in [(1, 0.0), (2, 0.25), (3, 0.5), (4, 1.0)] {
        let mesh = on_grid(triangle_soup(90, seed), grid);
        let positions = positions(&mesh);
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("the mesh is valid");
        let surface = side(&topology, &positions, false);
        for range in [0.0, 0.01, REACH, 10.0] {
            let settings =
                PairSettings { contact_distance: range, reported_distance: range, range, ..settings(false, true) };
            let pairs = all_between(mesh.triangles.len(), mesh.triangles.len());
            let mut found = FoundPairs::default();
            exact_pairs(&surface, &surface, &pairs, &settings, &mut found);
            let mut proximity = PairProximity::default();
            let expected = pairs.iter().filter_map(|&[a, b]| {
                let [a, b] = [a, b].map(|triangle| exact(corners(&positions, mesh.triangles[triangle as usize])));
                examine_pair(&a, &b, range, &mut proximity);
                (proximity.distance <= range).then_some(proximity.distance)
            });
            let expected: Vec<f64> = expected.collect();
            let distances: Vec<f64> = found.touching.iter().map(|pair| pair.distance).collect();
            assert_eq!(distances, expected, "seed {seed}, range {range}");
            // If each surface has a single triangle, no other pair can report a feature.
            for &[a, b] in pairs.iter().step_by(13) {
                let alone = [a, b].map(|triangle| corners(&positions, mesh.triangles[triangle as usize]));
                let topologies =
                    alone.map(|corners| SurfaceTopology::new(&corners, &[[0, 1, 2]]).expect("it is valid"));
                let [a, b] = [0, 1].map(|number: usize| side(&topologies[number], &alone[number], false));
                let mut found = FoundPairs::default();
                exact_pairs(&a, &b, &[[0, 0]], &settings, &mut found);
                examine_pair(&exact(alone[0]), &exact(alone[1]), range, &mut proximity);
                let near = proximity.proximities.iter().filter(|_| proximity.distance <= range);
                let near: Vec<_> = near.filter(|near| near.distance <= range).collect();
                // Coincident corners are one vertex and are not reported twice.
                let places = |features: &FeaturePair| {
                    [(0, features.a), (1, features.b)].map(|(side, feature)| {
                        let place =
                            |corner: usize| alone[side][corner].to_array().map(|number| (number + 0.0).to_bits());
                        let places: BTreeSet<_> = corners_of(feature).map(place).into();
                        (feature == Feature::Face, places)
                    })
                };
                let expected: BTreeSet<_> = near.iter().map(|near| places(&near.features)).collect();
                let reported: BTreeSet<_> = found.contacts.iter().map(|contact| places(&contact.features)).collect();
                assert_eq!(reported, expected, "seed {seed}, range {range}");
                features += near.len();
            }
            within += expected.len();
            crossing += expected.iter().filter(|&&distance| distance == 0.0).count();
            beyond += pairs.len() - expected.len();
        }
    }
    assert!(crossing > 1000 && within > crossing + 1000 && beyond > 1000, "{crossing} of {within}, {beyond} beyond");
    assert!(features > 10_000, "{features} features");
}

/// A pair touches within exactly its own distance, and not within a distance one bit shorter, whichever test is used.
/// The squares that first sort features are rounded differently. Every touching pair has a contact: each surface is one
/// triangle, so no other pair can report it.
#[test]
fn pairs_touch_within_exactly_their_own_distance() {
    let ways: [(Test, bool); 3] = [(exact_pairs, false), (exact_pairs, true), (closest_pairs, true)];
    let mut squares_disagree = 0;
    for (seed, grid) in [(1, 0.0), (2, 0.125), (3, 0.25), (4, 0.5)] {
        let mesh = on_grid(triangle_soup(120, seed), grid);
        let positions = positions(&mesh);
        let mut proximity = PairProximity::default();
        for (number, [first, second]) in all_within(mesh.triangles.len()).into_iter().enumerate() {
            let alone = [first, second].map(|triangle| corners(&positions, mesh.triangles[triangle as usize]));
            let topologies = alone.map(|corners| SurfaceTopology::new(&corners, &[[0, 1, 2]]).expect("it is valid"));
            let [a, b] = [0, 1].map(|number: usize| side(&topologies[number], &alone[number], false));
            let scale = [1.0, 1.0, 3.0, 0.7, 1.0e-3][number % 5];
            // Distances are exact up to the range of the search.
            examine_pair(&exact(alone[0]), &exact(alone[1]), 1.0e9, &mut proximity);
            let distance = proximity.distance * scale;
            if distance == 0.0 {
                continue;
            }
            squares_disagree +=
                usize::from((distance / scale) * (distance / scale) < proximity.distance * proximity.distance);
            for (test, cull) in ways {
                for (limit, touches) in [(distance, true), (distance.next_down(), false)] {
                    let settings = PairSettings {
                        contact_distance: limit,
                        reported_distance: limit,
                        range: limit,
                        scale,
                        ..settings(false, cull)
                    };
                    let mut found = FoundPairs::default();
                    test(&a, &b, &[[0, 0]], &settings, &mut found);
                    let distances: Vec<f64> = found.touching.iter().map(|pair| pair.distance).collect();
                    let expected = if touches { vec![distance] } else { vec![] };
                    assert_eq!(distances, expected, "within {limit} by {scale}, screened: {cull}: {alone:?}");
                    assert_eq!(
                        found.contacts.is_empty(),
                        !touches,
                        "within {limit} by {scale}, screened: {cull}: {alone:?}"
                    );
                }
            }
        }
    }
    assert!(squares_disagree > 100, "{squares_disagree} squares disagree with distances");
}

/// A surface whose vertices may have moved after they were welded.
struct Moved {
    topology: SurfaceTopology,
    positions: Vec<Vec3>,
}

impl Moved {
    /// `step` is the size of the grid that positions lie on, or 0. If `apart` is not 0, every `apart`th vertex is moved
    /// away from those it was welded to.
    fn new(mesh: Mesh, step: f32, apart: usize, random: &mut Random) -> Self {
        let mesh = on_grid(mesh, step);
        let mut positions = positions(&mesh);
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("the mesh is valid");
        for position in positions.iter_mut().step_by(apart.max(1)).filter(|_| apart > 0) {
            *position += (random.vector() * 0.1).as_vec3();
        }
        Self { topology, positions }
    }

    fn side(&self, one_sided: bool) -> SurfaceSide<'_> {
        side(&self.topology, &self.positions, one_sided)
    }

    fn count(&self) -> usize {
        self.topology.triangles().len()
    }
}

/// Pages on one edge, with some triangles without area.
fn book(pages: u8, random: &mut Random) -> Mesh {
    let mut mesh = Mesh { positions: vec![[0.0; 3], [0.0, 0.0, 1.0]], triangles: Vec::new() };
    for page in 0..u32::from(pages) {
        let tip = random.vector().as_vec3() * 0.8;
        mesh.positions.push(tip.to_array());
        mesh.triangles.push(if page % 2 == 0 { [0, 1, 2 + page] } else { [1, 0, 2 + page] });
        mesh.triangles.push([1, 2 + page, if page % 3 == 0 { 2 + page } else { 1 + page }]);
    }
    mesh
}

/// `Exact` screens eight pairs at a time, then examines only features that this pair reports according to tables of the
/// topology. `Polygon` examines each pair alone, and checks all triangles around each feature.
#[test]
fn refined_and_polygon_find_the_same_bit_by_bit_on_meshes_of_every_kind() {
    let mut random = Random::new(20_261_120);
    let mut kinds: BTreeMap<(bool, FeatureKind), usize> = BTreeMap::new();
    let (mut touching, mut non_manifold, mut welded, mut collapsed) = (0, 0, 0, 0);
    for round in 0..160 {
        let mut mesh = |round: usize| {
            let seed = random.bits();
            let turned = icosphere(1, 0.6).rotate([0.3, 1.0, 0.2], round as f32);
            let mesh = match round % 5 {
                0 => triangle_soup(60, seed),
                1 => merge(&[book(9, &mut random), book(12, &mut random).translate([0.1, 0.02, 0.3])]),
                2 => merge(&[turned.clone(), turned.clone().translate([0.25, 0.0, 0.0])]),
                3 => duplicate_vertices(&turned),
                _ => {
                    let (points, triangles) = crumpled(seed);
                    Mesh { positions: points.iter().map(Vec3::to_array).collect(), triangles }
                }
            };
            let step = [0.0, 0.25, 0.125][random.below(3)];
            let apart = [0, 0, 3][random.below(3)];
            Moved::new(mesh, step, apart, &mut random)
        };
        let (first, second) = (mesh(round), mesh(round / 5));
        for topology in [&first.topology, &second.topology] {
            let report = topology.report();
            non_manifold += report.non_manifold_edges;
            welded += report.welded_vertices;
            collapsed += report.collapsed_triangles;
        }
        let reach = [0.0, 0.02, REACH, 0.4][round % 4];
        for same_surface in [true, false] {
            let one_sided = !same_surface && round % 3 == 0;
            let (a, b) = (first.side(one_sided), if same_surface { &first } else { &second });
            let candidates =
                if same_surface { all_within(first.count()) } else { all_between(first.count(), second.count()) };
            let find = |cull: bool| {
                let distances =
                    PairSettings { contact_distance: reach, range: 1.5 * reach, ..settings(same_surface, cull) };
                let distances = PairSettings { reported_distance: 1.2 * reach, ..distances };
                let mut found = [FoundPairs::default(), FoundPairs::default()];
                exact_pairs(&a, &b.side(one_sided), &candidates, &distances, &mut found[0]);
                closest_pairs(&a, &b.side(one_sided), &candidates, &distances, &mut found[1]);
                found
            };
            let ([mut refined, closest], [mut polygon, _]) = (find(true), find(false));
            // Repeated contacts are dropped. The screen may already have skipped them.
            for found in [&mut refined, &mut polygon] {
                if one_sided {
                    let side_b = b.side(one_sided);
                    found.contacts = settled(&a, &side_b, &candidates, &settings(same_surface, true), found);
                } else {
                    UniqueFeatures::default().drop_repeats(found, 0);
                }
            }
            assert_eq!(refined.touching, polygon.touching, "round {round}, {same_surface}");
            assert_eq!(refined.nearest.to_bits(), polygon.nearest.to_bits(), "round {round}, {same_surface}");
            // Among contacts with the same key, the one of the lowest triangles counts, and the first if there are
            // several, whatever comes between them.
            let [by_refined, by_polygon] = [&refined, &polygon].map(|found| {
                let mut contacts = found.contacts.clone();
                contacts.sort_by_key(|contact| (contact.key, contact.triangle_a, contact.triangle_b));
                contacts
            });
            for (refined, polygon) in by_refined.iter().zip(&by_polygon) {
                assert_eq!(refined, polygon, "round {round}, {same_surface}");
            }
            assert_eq!(by_refined.len(), by_polygon.len(), "round {round}, {same_surface}");
            assert_eq!(closest.touching, polygon.touching, "round {round}, {same_surface}");
            touching += polygon.touching.len();
            for contact in &polygon.contacts {
                *kinds.entry((same_surface, contact.features.kind())).or_default() += 1;
            }
        }
    }
    println!("{touching} pairs, {non_manifold} edges of many, {welded} welded, {collapsed} collapsed: {kinds:?}");
    assert!(touching > 20_000 && non_manifold > 500 && welded > 500 && collapsed > 100);
    assert!(kinds.len() == 10 && kinds.values().all(|&count| count > 200), "{kinds:?}");
}
