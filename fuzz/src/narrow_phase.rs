//! The exact narrow phase on any bit patterns. Nothing panics, finite input gives finite numbers, and results agree
//! with the reference where it can judge.

use std::collections::HashSet;

use bevy_circumsphere::kernel::{
    bvh::{
        leaf_triangles::{LeafMesh, LeafTriangles, PairCull},
        tree::BoxTree,
    },
    contact::CompactContact,
    exact::{
        penetration::{Finding, PenetrationTest},
        stage::{closest_pairs, exact_pairs},
        unique::UniqueFeatures,
    },
    mesh::{bounds::triangle_bounds, ids::TriangleId},
    pair::{FoundPairs, PairSettings, SurfaceSide, can_penetrate},
};
use circumsphere_support::bars::{BAND, SEPARATION_TOLERANCE};
use circumsphere_truth::triangle_distance;
use glam::Vec3;

use crate::{input::Input, meshes::FuzzedSurface};

/// Normals are stored in f32: three components with half a unit in the last place each, plus slack.
const UNIT_TOLERANCE: f32 = 1.0e-5;

/// One or two small surfaces and a contact distance.
pub fn narrow_phase(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    let flags = input.byte();
    let flag = |bit: u8| flags & (1 << bit) != 0;
    let same_surface = flag(0);
    let contact_distance = contact_distance(&mut input, flag(1));
    let written = input.coordinates();
    let surface_a = FuzzedSurface::new(&mut input, written);
    let other = (!same_surface).then(|| FuzzedSurface::new(&mut input, written));
    let surface_b = other.as_ref().unwrap_or(&surface_a);

    let a = surface_a.side(flag(2), flag(3));
    let b = if same_surface { a } else { surface_b.side(flag(4), flag(5)) };
    let settings = PairSettings {
        contact_distance,
        reported_distance: contact_distance * if flag(6) { 2.0 } else { 1.0 },
        range: contact_distance * if flag(6) { 3.0 } else { 1.0 },
        scale: 1.0,
        bulge: 0.0,
        cull: false,
        same_surface,
        any_left_out: false,
    };
    let candidates = candidates(&surface_a, surface_b, same_surface);
    let found = detect(exact_pairs, [&a, &b], &candidates, &settings);
    let screened = detect(exact_pairs, [&a, &b], &candidates, &PairSettings { cull: true, ..settings });
    let closest = detect(closest_pairs, [&a, &b], &candidates, &settings);
    if !(surface_a.is_finite() && surface_b.is_finite() && contact_distance.is_finite()) {
        return;
    }
    check_numbers(&found, &settings);
    check_numbers(&closest, &settings);
    assert_eq!(found.touching, screened.touching, "the screen changed what touches");
    assert_eq!(by_key(&found.contacts), by_key(&screened.contacts), "the screen changed the contacts");
    assert_eq!(found.touching, closest.touching, "the closest features alone changed what touches");
    let kept = traversed(&surface_a, surface_b, &settings);
    if let Some(pair) = found.touching.iter().find(|pair| !kept.contains(&[pair.triangle_a, pair.triangle_b])) {
        let corners = [surface_a.corners(pair.triangle_a), surface_b.corners(pair.triangle_b)];
        panic!("the traversal lost {pair:?} within {contact_distance}: {corners:?}");
    }
    if surface_a.is_sane() && surface_b.is_sane() {
        for found in [&found, &closest] {
            check_against_reference(&surface_a, surface_b, &candidates, found, &settings);
        }
    }
}

/// A non-negative distance: any bit pattern without its sign, or one byte in 64ths.
fn contact_distance(input: &mut Input<'_>, any: bool) -> f64 {
    f64::from(if any { input.float().abs() } else { f32::from(input.byte()) / 64.0 })
}

/// All pairs of triangles, without the neighbors that the broad phase leaves out.
fn candidates(a: &FuzzedSurface, b: &FuzzedSurface, same_surface: bool) -> Vec<[u32; 2]> {
    let count = |surface: &FuzzedSurface| surface.topology.triangles().len() as u32;
    let are_neighbors =
        |&[first, second]: &[u32; 2]| same_surface && a.topology.share_vertex(TriangleId(first), TriangleId(second));
    (0..count(a))
        .flat_map(|first| (if same_surface { first + 1 } else { 0 }..count(b)).map(move |second| [first, second]))
        .filter(|pair| !are_neighbors(pair))
        .collect()
}

/// The pairs that remain after traversing the trees of both surfaces.
fn traversed(a: &FuzzedSurface, b: &FuzzedSurface, settings: &PairSettings) -> Vec<[u32; 2]> {
    let range = settings.range as f32;
    let [(tree, triangles), (other_tree, other_triangles)] = [a, b].map(|surface| {
        let (mut bounds, mut leaves) = (Vec::new(), LeafTriangles::default());
        triangle_bounds(&surface.positions, surface.topology.triangles(), 0.5 * range, &mut bounds);
        let tree = BoxTree::new(&bounds);
        leaves.update(&tree, &LeafMesh::flat(&surface.topology, &surface.positions));
        (tree, leaves)
    });
    let triangles = [&triangles, &other_triangles];
    let cull =
        PairCull { triangles, neighbors: settings.same_surface, slabs: range, search_from: &[], planes_only: false };
    let mut kept = Vec::new();
    if settings.same_surface {
        tree.self_pairs_of(0..tree.leaf_count(), Some(&cull), &mut kept);
    } else {
        tree.pairs_of(0..tree.leaf_count(), &other_tree, Some(&cull), &mut kept);
    }
    kept
}

/// Contacts in the order of the store. For each key, the contact of the lowest triangles counts, and among those of the
/// same triangles the first found, whatever comes between them.
fn by_key(contacts: &[CompactContact]) -> Vec<CompactContact> {
    let mut contacts = contacts.to_vec();
    contacts.sort_by_key(|contact| (contact.key, contact.triangle_a, contact.triangle_b));
    contacts
}

fn detect(
    refine: impl Fn(&SurfaceSide<'_>, &SurfaceSide<'_>, &[[u32; 2]], &PairSettings, &mut FoundPairs),
    [a, b]: [&SurfaceSide<'_>; 2],
    candidates: &[[u32; 2]],
    settings: &PairSettings,
) -> FoundPairs {
    let mut found = FoundPairs::default();
    refine(a, b, candidates, settings, &mut found);
    // As in the exact stage.
    if can_penetrate([a, b], settings) {
        let mut settling = PenetrationTest::default();
        settling.prepare(a, b, candidates, settings, &found.contacts);
        let mut findings = vec![Finding::Alone; settling.questions().len()];
        settling.look(a, b, &found.contacts, settling.questions(), &mut findings);
        settling.apply(&findings, settings, &mut found.contacts);
        // How often a shared contact was found depends on the screen.
        let mut known = HashSet::new();
        found.contacts.retain(|contact| !contact.is_shared || known.insert(contact.key));
    } else {
        UniqueFeatures::default().drop_repeats(&mut found, 0);
    }
    found
}

fn check_numbers(found: &FoundPairs, settings: &PairSettings) {
    assert!(found.nearest >= 0.0, "the nearest pair is {} away", found.nearest);
    for pair in &found.touching {
        assert!((0.0..=settings.contact_distance).contains(&pair.distance), "{pair:?}");
    }
    for contact in &found.contacts {
        check_contact(contact, settings);
    }
}

fn check_contact(contact: &CompactContact, settings: &PairSettings) {
    assert!((contact.normal.length() - 1.0).abs() <= UNIT_TOLERANCE, "not a unit normal: {contact:?}");
    // Rounded to f32, where a distance may become infinite.
    let farthest = settings.reported_distance as f32;
    assert!(contact.distance.abs() <= farthest, "farther than {farthest}: {contact:?}");
    assert!(!contact.point_b.is_nan(), "{contact:?}");
    for [first, second] in [contact.barycentric_a, contact.barycentric_b] {
        for weight in [first, second, 1.0 - first - second] {
            assert!((-1.0e-5..=1.0 + 1.0e-5).contains(&weight), "outside the triangle: {contact:?}");
        }
    }
}

fn check_against_reference(
    a: &FuzzedSurface,
    b: &FuzzedSurface,
    candidates: &[[u32; 2]],
    found: &FoundPairs,
    settings: &PairSettings,
) {
    let distance = settings.contact_distance;
    for &[first, second] in candidates {
        let corners = [a.corners(first), b.corners(second)];
        let truth = true_distance(&corners);
        let size = corners.iter().map(longest_edge).fold(0.0, f64::max);
        let tolerance = SEPARATION_TOLERANCE * distance.max(size);
        let touching = found.touching.iter().find(|pair| [pair.triangle_a, pair.triangle_b] == [first, second]);
        if let Some(pair) = touching {
            assert!(
                (pair.distance - truth).abs() <= tolerance,
                "{first} and {second} are {truth} apart, not {}: {corners:?}",
                pair.distance
            );
            assert!(
                truth <= distance * (1.0 + BAND) + rounding(&corners),
                "false: {first} and {second} are {truth} apart, which is not {distance}: {corners:?}"
            );
        } else {
            assert!(
                truth > distance * (1.0 - BAND) - rounding(&corners),
                "missed: {first} and {second} are {truth} apart, which is within {distance}: {corners:?}"
            );
        }
    }
}

/// f64 rounding of the distance of two triangles that just touch.
fn rounding(corners: &[[Vec3; 3]; 2]) -> f64 {
    let origin = corners[0][0].as_dvec3();
    let extent = corners.iter().flatten().map(|corner| (corner.as_dvec3() - origin).length()).fold(0.0, f64::max);
    1.0e-9 * extent
}

fn longest_edge(corners: &[Vec3; 3]) -> f64 {
    (0..3).map(|k| corners[k].as_dvec3().distance(corners[(k + 1) % 3].as_dvec3())).fold(0.0, f64::max)
}

/// The distance according to the reference.
fn true_distance(corners: &[[Vec3; 3]; 2]) -> f64 {
    let [a, b] = corners.map(|corners| corners.map(|corner| corner.as_dvec3()));
    triangle_distance(&a, &b)
}
