//! Generated scenes: every exact method and broad phase against the reference, and contacts against their pairs.

use std::collections::{HashMap, HashSet};

use bevy_circumsphere::{
    geometry::{Feature, FeatureKind, TouchingPair},
    prelude::*,
};
use circumsphere_support::scenes::{
    Diagonals, Mesh, cloth_fall, cuboid, duplicate_vertices, grid, icosphere, merge, ragged_slivers, saddle,
    sheet_stack, torus, triangle_soup, twisted_rod,
};
use circumsphere_truth::{closest_features, exact_weld, mean_edge_length};
use glam::{DVec3, Vec3};

use crate::detect::{BroadPhase, Detector, assert_agrees, crossings_without_near_features, truth};

struct Scene {
    name: &'static str,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

fn scene(name: &'static str, mesh: &Mesh) -> Scene {
    Scene {
        name,
        positions: mesh.positions.iter().copied().map(Vec3::from_array).collect(),
        triangles: mesh.triangles.clone(),
    }
}

fn scenes() -> Vec<Scene> {
    let fall = cloth_fall();
    let last = Mesh { positions: fall.frames[100].clone(), triangles: fall.triangles };
    let crossing_spheres = merge(&[icosphere(3, 1.0), icosphere(3, 1.0).translate([0.7, 0.3, 0.1])]);
    let sizes = merge(&[icosphere(2, 1000.0), icosphere(2, 1.0).translate([1000.5, 0.0, 0.0])]);
    let far = merge(&[torus(1.0, 0.4, 24, 12), torus(1.0, 0.4, 24, 12).translate([1.1, 0.1, 0.0])])
        .translate([1.0e4, -1.0e4, 1.0e4]);
    let sheets = merge(&[
        grid(12, 12, 2.0, 2.0, Diagonals::Alternating),
        grid(9, 11, 2.0, 2.0, Diagonals::Uniform).translate([0.03, 0.015, 0.01]),
    ]);
    let tiny = merge(&[icosphere(2, 1.0e-6), icosphere(2, 1.0e-6).translate([1.4e-6, 2.0e-7, 0.0])]);
    let huge = merge(&[icosphere(2, 1.0e6), icosphere(2, 1.0e6).translate([1.4e6, 2.0e5, 0.0])]);
    let boxes = merge(&[cuboid([1.0, 1.0, 1.0], 4), cuboid([0.5, 0.5, 0.5], 3).translate([1.4, 0.2, 0.1])]);
    vec![
        scene("cloth fall", &last),
        scene("crossing spheres", &crossing_spheres),
        scene("crossing spheres, unindexed", &duplicate_vertices(&crossing_spheres)),
        scene("sizes 1000:1", &sizes),
        scene("far from the origin", &far),
        scene("close sheets", &sheets),
        scene("stacked sheets", &sheet_stack(10, 0.02, 10)),
        scene(
            "coinciding sheets",
            &merge(&[grid(8, 8, 1.0, 1.0, Diagonals::Uniform), grid(7, 9, 1.0, 1.0, Diagonals::Uniform)]),
        ),
        scene("millionths", &tiny),
        scene("millions", &huge),
        scene("soup", &triangle_soup(300, 7)),
        scene("slivers", &ragged_slivers(3)),
        scene("twisted rod", &twisted_rod(4.0, 0.2, 60, 3, 20.0)),
        scene("saddle through boxes", &merge(&[boxes, saddle(14, 1.5, 0.8)])),
    ]
}

/// The longest edge of any triangle, to which errors of separations are relative.
fn size(scene: &Scene) -> f64 {
    let corner = |vertex: u32| scene.positions[vertex as usize].as_dvec3();
    scene
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| {
            [corner(a).distance(corner(b)), corner(b).distance(corner(c)), corner(c).distance(corner(a))]
        })
        .fold(0.0, f64::max)
}

fn mean_edge(scene: &Scene) -> f64 {
    let positions: Vec<DVec3> = scene.positions.iter().map(|position| position.as_dvec3()).collect();
    mean_edge_length(&positions, &scene.triangles, &exact_weld(&positions))
}

#[test]
fn exact_methods_find_the_pairs_of_the_reference_on_generated_scenes() {
    let (mut compared, mut hidden_crossings, mut crossings, mut apart) = (0, 0, 0, 0);
    for scene in scenes() {
        for edges in [0.02, 0.1, 0.5] {
            let distance = edges * mean_edge(&scene);
            let truth = truth(&scene.positions, &scene.positions, &scene.triangles, distance);
            hidden_crossings += crossings_without_near_features(&scene.positions, &scene.triangles, &truth, distance);
            crossings += truth.iter().filter(|pair| pair.distance == 0.0).count();
            apart += truth.iter().filter(|pair| pair.distance > 0.0).count();
            let mut sets: Vec<Vec<TouchingPair>> = Vec::new();
            for method in [ContactMethod::Exact, ContactMethod::Polygon] {
                for broad_phase in BroadPhase::ALL {
                    let what = format!("{} at {edges} edges, {method:?}, {broad_phase:?}", scene.name);
                    let mut detector = Detector::new(&scene.positions, &scene.triangles, method, broad_phase, distance);
                    let (found, _) = detector.detect(&scene.positions);
                    compared += assert_agrees(&what, &found, &truth, distance, size(&scene)).matched;
                    sets.push(found);
                }
            }
            let mut closest =
                Detector::new(&scene.positions, &scene.triangles, ContactMethod::Closest, BroadPhase::Tree, distance);
            let what = format!("{} at {edges} edges", scene.name);
            let (found, _) = closest.detect(&scene.positions);
            compared += assert_agrees(&what, &found, &truth, distance, size(&scene)).matched;
            assert!(
                sets.windows(2).all(|sets| sets[0] == sets[1]),
                "{}: the methods differ among themselves",
                scene.name
            );
        }
    }
    // There must have been something to compare.
    assert!(compared > 100_000, "only {compared} pairs were compared");
    assert!(crossings > 1000 && apart > 1000, "{crossings} crossing and {apart} separate pairs");
    assert!(hidden_crossings > 50, "only {hidden_crossings} crossings had no near feature");
}

#[test]
fn every_touching_pair_has_its_closest_contact_and_every_contact_a_touching_pair() {
    let (mut contacts_seen, mut pairs_seen) = (0, 0);
    let methods = [ContactMethod::Closest, ContactMethod::Exact];
    for (scene, method) in scenes().iter().flat_map(|scene| methods.map(|method| (scene, method))) {
        let distance = 0.1 * mean_edge(scene);
        let mut detector = Detector::new(&scene.positions, &scene.triangles, method, BroadPhase::Tree, distance);
        let (touching, contacts) = detector.detect(&scene.positions);
        let tolerance = 1.0e-5 * distance.max(size(scene));
        let corner =
            |triangle: u32, k: usize| scene.positions[scene.triangles[triangle as usize][k] as usize].as_dvec3();
        let point = |triangle: u32, weights: [f32; 2]| {
            let [u, v] = weights.map(f64::from);
            corner(triangle, 0) * u + corner(triangle, 1) * v + corner(triangle, 2) * (1.0 - u - v)
        };
        let pairs: HashSet<[u32; 2]> = touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
        let mut keys = HashSet::new();
        // Contacts by the two points they join, on a grid as coarse as the tolerance of their barycentric weights.
        let mut distances: HashMap<[u32; 2], Vec<f64>> = HashMap::new();
        for contact in &contacts {
            let name = scene.name;
            assert!(keys.insert(contact.key), "{name}: {:?} is listed twice", contact.key);
            assert!(
                pairs.contains(&[contact.triangle_a, contact.triangle_b]),
                "{name}: {contact:?} does not belong to a touching pair"
            );
            let (point_a, point_b) =
                (point(contact.triangle_a, contact.barycentric_a), point(contact.triangle_b, contact.barycentric_b));
            let gap = point_a.distance(point_b);
            let stored = f64::from(contact.distance);
            assert!(stored >= 0.0 && stored <= distance * (1.0 + 1.0e-6), "{name}: {contact:?}");
            assert!((gap - stored).abs() <= tolerance, "{name}: {contact:?} joins points {gap} apart");
            assert!((contact.normal.length() - 1.0).abs() < 1.0e-5, "{name}: {contact:?}");
            if contact.features.kind() != FeatureKind::EdgeFace && stored > 100.0 * tolerance {
                let direction = (point_b - point_a).normalize();
                assert!(direction.dot(contact.normal.as_dvec3()) > 0.999, "{name}: {contact:?} against {direction}");
            }
            // A feature belongs to every triangle around it, so any of those pairs may have reported it.
            for &first in &around(scene, contact.triangle_a) {
                for &second in &around(scene, contact.triangle_b) {
                    distances.entry([first.min(second), first.max(second)]).or_default().push(stored);
                }
            }
        }
        for pair in &touching {
            let corners = |triangle: u32| [0, 1, 2].map(|k| corner(triangle, k));
            let closest = closest_features(&corners(pair.triangle_a), &corners(pair.triangle_b));
            let reported = distances.get(&[pair.triangle_a, pair.triangle_b]);
            assert!(
                reported.is_some_and(|all| all.iter().any(|stored| (stored - closest.distance).abs() <= tolerance)),
                "{}: no contact has the distance {} of {pair:?}",
                scene.name,
                closest.distance
            );
        }
        contacts_seen += contacts.len();
        pairs_seen += touching.len();
    }
    assert!(contacts_seen > 5000 && pairs_seen > 5000, "{contacts_seen} contacts, {pairs_seen} pairs");
}

/// The triangle and those that share a vertex with it.
fn around(scene: &Scene, triangle: u32) -> Vec<u32> {
    let positions: Vec<Vec3> =
        scene.triangles[triangle as usize].iter().map(|&vertex| scene.positions[vertex as usize]).collect();
    (0..scene.triangles.len() as u32)
        .filter(|&other| {
            scene.triangles[other as usize].iter().any(|&vertex| positions.contains(&scene.positions[vertex as usize]))
        })
        .collect()
}

#[test]
fn every_vertex_of_aligned_sheets_has_its_contact() {
    let sheet = grid(4, 4, 1.0, 1.0, Diagonals::Uniform);
    let scene = scene("aligned sheets", &merge(&[sheet.clone(), sheet.translate([0.0, 0.01, 0.0])]));
    let mut detector = Detector::new(&scene.positions, &scene.triangles, ContactMethod::Exact, BroadPhase::Tree, 0.02);
    let (_, contacts) = detector.detect(&scene.positions);
    let vertices: HashSet<[u32; 2]> = contacts
        .iter()
        .filter_map(|contact| match (contact.features.a, contact.features.b) {
            (Feature::Vertex(own), Feature::Vertex(other)) => {
                let vertex = |triangle: u32, corner: u8| scene.triangles[triangle as usize][corner as usize];
                Some([vertex(contact.triangle_a, own), vertex(contact.triangle_b, other)])
            }
            _ => None,
        })
        .collect();
    let expected: HashSet<[u32; 2]> = (0..25).map(|vertex| [vertex, vertex + 25]).collect();
    assert_eq!(vertices, expected);
}
