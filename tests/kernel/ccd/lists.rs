//! Which impacts a sweep lists: every pair of features once, or what comes first at a convex solid. Against every pair of
//! features tested alone.

use std::collections::BTreeMap;

use bevy_circumsphere::kernel::{
    ccd::{
        CommonVertices, ImpactCause, ImpactList, PairImpact, SWEEP_PART, Sweep, SweepLeaves, SweepTree, SweptMesh,
        edge_edge_impact, sort_impacts, triangle_pair_impact, vertex_face_impact,
    },
    mesh::{
        feature::Feature,
        ids::{EdgeId, VertexId},
        topology::SurfaceTopology,
    },
    simd::parallel::Sequential,
};
use glam::{DQuat, DVec3};

use super::sweep::{Body, half_distances, pair, sheet, tree_of};
use crate::common::Random;

/// A feature of a mesh: a vertex, an edge, or a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Vertex(u32),
    Edge(u32),
    Face(u32),
}

impl Part {
    fn of(topology: &SurfaceTopology, triangle: u32, feature: Feature) -> Self {
        match feature {
            Feature::Vertex(corner) => Self::Vertex(topology.welded_triangles()[triangle as usize][corner as usize]),
            Feature::Edge(edge) => Self::Edge(topology.triangle_edges()[triangle as usize][edge as usize]),
            Feature::Face => Self::Face(triangle),
        }
    }

    fn all(topology: &SurfaceTopology) -> Vec<Self> {
        let vertices = (0..topology.vertex_count() as u32).map(Self::Vertex);
        let edges = (0..topology.edges().len() as u32).map(Self::Edge);
        vertices.chain(edges).chain((0..topology.triangles().len() as u32).map(Self::Face)).collect()
    }

    fn vertices(self, topology: &SurfaceTopology) -> Vec<u32> {
        match self {
            Self::Vertex(vertex) => vec![vertex],
            Self::Edge(edge) => topology.edges()[edge as usize].to_vec(),
            Self::Face(triangle) => topology.welded_triangles()[triangle as usize].to_vec(),
        }
    }

    fn triangles(self, topology: &SurfaceTopology) -> Vec<u32> {
        match self {
            Self::Vertex(vertex) => topology.triangles_of_vertex(VertexId(vertex)).to_vec(),
            Self::Edge(edge) => topology.triangles_of_edge(EdgeId(edge)).to_vec(),
            Self::Face(triangle) => vec![triangle],
        }
    }
}

/// When two features meet.
#[derive(Clone, Copy, Debug)]
struct Meeting {
    time: f64,
    cause: ImpactCause,
    /// Whether all triangles around one of them cross all those around the other at the start.
    is_hidden: bool,
}

/// Tests every pair of features alone.
fn meetings(a: &SweptMesh<'_>, b: &SweptMesh<'_>, same: bool, separation: f64) -> BTreeMap<[Part; 2], Meeting> {
    let mut found = BTreeMap::new();
    let parts_b = Part::all(b.topology);
    for one in Part::all(a.topology) {
        for &other in &parts_b {
            let (ends_a, ends_b) = (one.vertices(a.topology), other.vertices(b.topology));
            let points = |of_a: &[DVec3], of_b: &[DVec3]| -> Vec<DVec3> {
                let points_a = ends_a.iter().map(|&vertex| of_a[vertex as usize]);
                points_a.chain(ends_b.iter().map(|&vertex| of_b[vertex as usize])).collect()
            };
            let (start, end) = (points(a.start, b.start), points(a.end, b.end));
            if start.len() != 4 || same && ends_a.iter().any(|vertex| ends_b.contains(vertex)) {
                continue;
            }
            let four = |points: &[DVec3]| -> [DVec3; 4] { points.try_into().expect("there are four") };
            let turned = |points: &[DVec3]| [points[3], points[0], points[1], points[2]];
            let impact = match (one, other) {
                (Part::Vertex(_), _) => vertex_face_impact(&four(&start), &four(&end), separation),
                (Part::Face(_), _) if same => None,
                (Part::Face(_), _) => vertex_face_impact(&turned(&start), &turned(&end), separation),
                (Part::Edge(_), _) if same && other <= one => None,
                (Part::Edge(_), _) => edge_edge_impact(&four(&start), &four(&end), separation),
            };
            let Some(impact) = impact else { continue };
            let crosses = |triangle_a: u32, triangle_b: u32| {
                let welded = |mesh: &SweptMesh<'_>, triangle: u32| mesh.topology.welded_triangles()[triangle as usize];
                let common = if same {
                    CommonVertices::of(welded(a, triangle_a), welded(b, triangle_b))
                } else {
                    CommonVertices::NONE
                };
                let impact =
                    triangle_pair_impact(&a.triangle(triangle_a), &b.triangle(triangle_b), &common, separation);
                impact.is_some_and(|impact| impact.cause == ImpactCause::Crossing)
            };
            let around_b = other.triangles(b.topology);
            let is_hidden =
                one.triangles(a.topology).iter().all(|&one| around_b.iter().all(|&other| crosses(one, other)));
            found.insert([one, other], Meeting { time: impact.time, cause: impact.cause, is_hidden });
        }
    }
    found
}

fn listed(a: &SweptMesh<'_>, b: &SweptMesh<'_>, same: bool, list: ImpactList, separation: f64) -> Vec<PairImpact> {
    listed_by((a, &tree_of(a, true)), (b, &tree_of(b, true)), same, list, separation)
}

fn listed_by(
    (a, tree_a): (&SweptMesh<'_>, &SweepTree),
    (b, tree_b): (&SweptMesh<'_>, &SweepTree),
    same: bool,
    list: ImpactList,
    separation: f64,
) -> Vec<PairImpact> {
    let b = if same { (*a, tree_a) } else { (*b, tree_b) };
    let sweep = Sweep { a: (*a, tree_a), b, same_surface: same, list, separation };
    let (mut leaves, mut impacts) = (SweepLeaves::default(), Vec::new());
    sweep.collect(&Sequential, &mut leaves);
    for leaf in (0..leaves.len()).step_by(SWEEP_PART) {
        let part = leaf..(leaf + SWEEP_PART).min(leaves.len());
        sweep.append_part(&leaves, part, &mut Vec::new(), &mut impacts);
    }
    sort_impacts(&mut impacts);
    impacts
}

/// The features of an impact: of one mesh with itself, a vertex before a face, and the lower edge first.
fn parts_of(a: &SweptMesh<'_>, b: &SweptMesh<'_>, same: bool, found: &PairImpact) -> [Part; 2] {
    let one = Part::of(a.topology, found.triangle_a, found.impact.features.a);
    let other = Part::of(b.topology, found.triangle_b, found.impact.features.b);
    if same && other < one { [other, one] } else { [one, other] }
}

/// The same mesh with its triangles in a random order.
fn shuffled(random: &mut Random, body: Body) -> Body {
    let mut triangles = body.topology.triangles().to_vec();
    for place in (1..triangles.len()).rev() {
        triangles.swap(place, random.below(place + 1));
    }
    Body { end: body.end, ..Body::new(body.start, &triangles) }
}

#[test]
fn every_pair_of_features_that_meets_is_listed_once() {
    let mut random = Random::new(85);
    let (mut count, mut hidden, mut crossing, mut known) = (0, 0, 0, 0);
    for round in 0..48 {
        let (same, is_soup) = (round % 4 == 3, round % 4 == 0);
        let speed = [0.1, 0.4, 1.0][round % 3];
        let bodies = pair(&mut random, speed, [true, true], is_soup);
        // In a random order, some triangles are the first around none of their edges and vertices.
        let [a, b] = bodies.map(|body| if round % 2 == 1 { shuffled(&mut random, body) } else { body });
        let separation = if round % 3 == 0 { 0.02 } else { 0.0 };
        let [a, b] = [&a, &b].map(|body| SweptMesh { reach: 0.0, ..body.mesh() });
        let b = if same { a } else { b };
        let mut expected = meetings(&a, &b, same, separation);
        hidden += expected.values().filter(|meeting| meeting.is_hidden).count();
        expected.retain(|_, meeting| !meeting.is_hidden);
        count += expected.len();
        let list = listed(&a, &b, same, ImpactList::Features, separation);
        // Pairs that begin apart may be left out if their features are tested in others, and are the only ones.
        let trees = [(&a, half_distances(&a, &b, same)), (&b, half_distances(&b, &a, same))].map(|(mesh, reaches)| {
            let mut tree = SweepTree::default();
            tree.update_with_reaches(mesh, &reaches);
            tree.update_tree();
            tree
        });
        let by_reach = listed_by((&a, &trees[0]), (&b, &trees[1]), same, ImpactList::Features, separation);
        assert!(by_reach == list, "round {round}, with known distances");
        known += list.iter().filter(|found| found.impact.cause == ImpactCause::Reached).count();
        for found in list {
            if found.impact.cause == ImpactCause::Crossing {
                crossing += 1;
                continue;
            }
            let parts = parts_of(&a, &b, same, &found);
            let meeting = expected.remove(&parts);
            let meeting = meeting.unwrap_or_else(|| panic!("round {round}: {parts:?} do not meet, or twice"));
            assert_eq!(meeting.cause, found.impact.cause, "round {round}: {parts:?}");
            assert!((meeting.time - found.impact.time).abs() < 1.0e-9, "round {round}: {parts:?}");
        }
        assert!(expected.is_empty(), "round {round}: {expected:?}");
    }
    assert!(count > 1_000 && hidden > 50 && crossing > 50, "{count}, {hidden} hidden, {crossing} crossing");
    assert!(known > 500, "{known} impacts of what begins apart");
}

#[test]
fn what_is_torn_or_has_no_box_is_listed_by_triangles() {
    let [whole, target] = [sheet(5, 1.0), sheet(7, -1.0)];
    // Each triangle has its own vertices, in the same places.
    let corners = whole.topology.triangles().as_flattened();
    let apart = corners.iter().map(|&vertex| whole.start[vertex as usize]).collect::<Vec<_>>();
    let count = corners.len() as u32 / 3;
    let mut torn = Body::new(apart, &(0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect::<Vec<_>>());
    torn.translate(DVec3::Z * 0.3);
    let list = |mesh: &SweptMesh<'_>, list| listed(mesh, &target.mesh(), false, list, 0.0);
    let both = |mesh: &SweptMesh<'_>| [ImpactList::Triangles, ImpactList::Features].map(|by| list(mesh, by));
    torn.move_each(|_| DVec3::Z * -0.6);
    let [by_triangles, by_features] = both(&torn.mesh());
    assert!(by_triangles != by_features && !by_triangles.is_empty());
    let mut random = Random::new(86);
    torn.move_each(|_| DVec3::Z * -0.6 + random.vector() * 0.01);
    let [by_triangles, by_features] = both(&torn.mesh());
    assert!(by_triangles == by_features && !by_triangles.is_empty());
    // The first triangle around a vertex has no box.
    let mut spoiled = sheet(5, 1.0);
    spoiled.translate(DVec3::Z * 0.3);
    spoiled.move_each(|_| DVec3::Z * -0.6);
    spoiled.end[6] = DVec3::NAN;
    let [by_triangles, by_features] = both(&spoiled.mesh());
    assert!(by_triangles == by_features && !by_triangles.is_empty());
}

/// A prism about the x axis with so many sides, of radius 0.2.
fn prism(sides: u32) -> Body {
    let rim = |x: f64| {
        (0..sides).map(move |side| {
            let (sine, cosine) = (std::f64::consts::TAU * f64::from(side) / f64::from(sides)).sin_cos();
            DVec3::new(x, 0.2 * cosine, 0.2 * sine)
        })
    };
    let positions = [DVec3::NEG_X, DVec3::X].into_iter().chain(rim(-1.0)).chain(rim(1.0)).collect();
    let triangles = (0..sides).flat_map(|side| {
        let (here, next) = (2 + side, 2 + (side + 1) % sides);
        let (across, across_next) = (here + sides, next + sides);
        [[0, next, here], [1, across, across_next], [here, next, across], [next, across_next, across]]
    });
    Body::new(positions, &triangles.collect::<Vec<_>>())
}

#[test]
fn of_the_impacts_with_a_convex_solid_the_first_are_listed() {
    let mut random = Random::new(79);
    for sides in [4, 12, 50] {
        let (mut all, mut later, mut within, mut across) = (0, 0, 0, 0);
        for round in 0..6 {
            let (mut sheet, mut solid) = (sheet(10, 1.0), prism(sides));
            let turn = DQuat::from_axis_angle(random.direction(), random.range(0.0, 6.0));
            // In some rounds some of the sheet begins in the solid.
            sheet.translate(DVec3::Z * if round % 2 == 0 { 0.4 } else { 0.15 });
            sheet.start.iter_mut().for_each(|position| *position = turn * *position);
            sheet.move_each(|_| turn * DVec3::NEG_Z * 0.8 + random.vector() * 0.1);
            if round % 3 == 0 {
                solid.move_each(|_| DVec3::new(0.05, -0.1, 0.1));
            }
            let (a, b) = (sheet.mesh(), solid.mesh());
            let separation = 0.02;
            let expected = meetings(&a, &b, false, separation);
            let found = listed(&a, &b, false, ImpactList::Solid, separation);
            let is_across = |triangle: u32| {
                let crosses = |found: &&PairImpact| found.impact.cause == ImpactCause::Crossing;
                found.iter().filter(crosses).any(|found| found.triangle_a == triangle)
            };
            let named: BTreeMap<[Part; 2], (u32, f64)> = found
                .iter()
                .map(|found| (parts_of(&a, &b, false, found), (found.triangle_a, found.impact.time)))
                .collect();
            for (&[one, other], meeting) in &expected {
                let owner = one.triangles(a.topology)[0];
                // Whatever is not listed comes after something that is, of the same triangle.
                let is_after =
                    found.iter().any(|found| found.triangle_a == owner && found.impact.time <= meeting.time + 1.0e-9);
                match named.get(&[one, other]) {
                    Some((_, time)) => assert!((time - meeting.time).abs() < 1.0e-9, "{sides}: {one:?}, {other:?}"),
                    None if is_across(owner) => assert!(meeting.is_hidden, "{sides}: {one:?}, {other:?}"),
                    None => {
                        let begins = meeting.cause == ImpactCause::Within;
                        assert!(is_after && !begins, "{sides}: {one:?}, {other:?}, {meeting:?}, {is_after}");
                    }
                }
                all += usize::from(!is_across(owner));
                within += usize::from(meeting.cause == ImpactCause::Within);
                across += usize::from(is_across(owner));
            }
            later += named.values().filter(|(triangle, _)| !is_across(*triangle)).count();
        }
        assert!(within > 20 && across > 100 && later > 100, "{sides}: {within} within, {across} across, {later}");
        assert!(later <= all && (sides < 50 || 3 * later < all), "{sides}: {later} of {all}");
    }
}
