//! The exact stage over a list of candidate pairs: a screen of eight side by side, exact distance, contacts.
//!
//! Reads candidate triangle pairs and positions in one common frame, writes touching pairs and contacts. Of a feature pair
//! that several pairs of triangles have the contact of the lowest stays, when contacts are brought into their order. Mostly
//! only that one is written: the pair of the first triangles around both features, which the topology knows alone, because
//! every pair that has both touches too. Where only the closest features are wanted, every pair reports its own.

use arrayvec::ArrayVec;
use glam::{DVec3, Vec3};

use super::{
    contact::{CompactContact, TouchingPair, feature_number},
    corner_rows::CornerRow,
    exact::{
        Cases, Feature, FeatureBatches, FeaturePair, FeatureTask, LeftOver, PairProximity, PairScreen, Proximity, ScreenLimits, ScreenedPair,
        barycentric::point_at,
        examine_boundaries, examine_pair, examine_screened,
        rigid_shape::{ShapeGeometry, ShapeProximity},
        rounded_down,
        side::face_normal,
        triangle_pair::TIE,
    },
    ids::{EdgeId, TriangleId, VertexId},
    pair::{FoundPairs, PairSettings, RowPair, SurfaceSide, without_neighbors},
    pose::Pose,
    prefetch::ask_ahead,
    topology::SurfaceTopology,
};

/// Tests candidate pairs of two surfaces exactly and appends what it finds.
pub fn refine_pairs(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    if settings.cull {
        let wanted = |rows: &RowPair<'_>, pair: &ScreenedPair| reported_cases(rows, settings.same_surface, pair.cases);
        examine_pairs(a, b, candidates, settings, found, wanted, |_, _| true);
    } else {
        examine_pairs_alone(a, b, &without_neighbors(a, candidates, settings), settings, found);
    }
}

/// Tests candidate pairs of two surfaces exactly, like [`refine_pairs`], and appends what it finds: the same pairs, but of
/// a pair that is apart only the closest features make a contact, of several that are equally close one. Each pair
/// reports its own closest features, whatever others contain them: to those they need not be the closest.
pub fn refine_closest(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    let wanted = |_: &RowPair<'_>, pair: &ScreenedPair| {
        let cases = if pair.cases.may_cross() { pair.cases } else { pair.closest };
        Reported { cases, shared: Cases::ALL }
    };
    examine_pairs(a, b, candidates, settings, found, wanted, |pair, features| {
        pair.distance == 0.0 || features.distance <= pair.distance * (1.0 + TIE)
    });
}

/// Which features of a pair it reports.
struct Reported {
    cases: Cases,
    /// Those of them that other pairs may report, too, and maybe others.
    shared: Cases,
}

impl Reported {
    /// Adds a case if it is reported, and whether it is shared.
    fn add(&mut self, case: Cases, is_shared: Option<bool>) {
        if let Some(is_shared) = is_shared {
            self.cases = self.cases.or(case);
            self.shared = if is_shared { self.shared.or(case) } else { self.shared };
        }
    }

    /// Whether other pairs may report these features, too.
    fn is_shared(&self, features: FeaturePair) -> bool {
        let case = Cases::of(features);
        case.without_boundary().are_none() || self.shared.contain(case)
    }
}

/// Tests pairs exactly, eight side by side first. Of each only those features are looked at that are `wanted` or on the
/// boundaries of both; which of them make a contact is up to `makes_contact`.
fn examine_pairs(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
    wanted: impl Fn(&RowPair<'_>, &ScreenedPair) -> Reported,
    makes_contact: impl Fn(&PairProximity, &Proximity) -> bool,
) {
    found.examined += candidates.len();
    let range = settings.range / settings.scale;
    let limits =
        ScreenLimits { scale: settings.scale, range: settings.range, contact_distance: settings.contact_distance };
    let mut proximity = PairProximity::default();
    let mut screen = PairScreen::new();
    let mut batches = FeatureBatches::new(settings);
    let first_contact = found.contacts.len();
    // Pairs that the screen was in doubt about.
    let mut apart: ArrayVec<(usize, f64), { PairScreen::WIDTH }> = ArrayVec::new();
    let has_inside = a.one_sided || b.one_sided;
    let mut made = [[CornerRow::EMPTY; PairScreen::WIDTH]; 2];
    let [made_a, made_b] = &mut made;
    let poses = [a, b].map(|side| side.moved.map(|moved| moved.pose));
    for (block, pairs) in candidates.chunks(PairScreen::WIDTH).enumerate() {
        if let (Some(rows_a), Some(rows_b)) = (a.rows, b.rows) {
            ask_ahead(rows_a, rows_b, candidates, block);
        }
        let sides = [rows_of::<0>(a, pairs, made_a), rows_of::<1>(b, pairs, made_b)];
        let screened = screen.screen([&sides[0], &sides[1]], poses, pairs.len(), &limits);
        let rows_of_pair =
            |place: usize| RowPair { sides: [a, b], triangles: pairs[place], rows: [sides[0][place], sides[1][place]] };
        let mut left = screened.possible;
        if settings.same_surface {
            let suspects = if a.topology.is_welded() { left } else { left & screened.meeting };
            let neighbors = places(suspects).filter(|&place| rows_of_pair(place).are_neighbors());
            let neighbors = neighbors.fold(0, |bits, place| bits | 1 << place);
            left &= !neighbors;
            found.examined -= neighbors.count_ones() as usize;
        }
        for place in places(left & (screened.near | screened.doubtful)) {
            let rows = rows_of_pair(place);
            let is_doubtful = screened.doubtful >> place & 1 != 0;
            let on_boundary = screened.on_boundary >> place & 1 != 0;
            let has_cases = screened.with_cases >> place & 1 != 0;
            if !(has_cases || on_boundary) {
                add_pair(rows.triangles, screen.distances()[place], settings, found);
                continue;
            }
            let pair = screen.pair(place);
            let wanted = wanted(&rows, &pair);
            let cases = pair.cases.and(wanted.cases).without_boundary();
            if is_doubtful || has_inside && !cases.are_none() {
                let corners = [rows.corners(0), rows.corners(1)];
                examine_screened(&pair, &corners, range, wanted.cases, &mut proximity);
                if found.wants_lower_bounds && proximity.distance > range {
                    apart.push((place, proximity.distance - pair.nothing()));
                }
                let reported = |features: &Proximity| {
                    makes_contact(&proximity, features).then(|| wanted.is_shared(features.features))
                };
                add_examined(a, b, settings, rows.triangles, &corners, &proximity, reported, found);
                continue;
            }
            add_pair(rows.triangles, screen.distances()[place], settings, found);
            if !cases.are_none() {
                batches.add(&rows, [cases, wanted.shared], pair.nothing(), &mut found.contacts);
            }
            if on_boundary && screen.distances()[place] <= settings.reported_distance {
                if pair.touches() || has_inside {
                    let corners = [rows.corners(0), rows.corners(1)];
                    proximity.proximities.clear();
                    examine_boundaries(&pair, &corners, range, &mut proximity.proximities);
                    for features in &proximity.proximities {
                        if features.distance * settings.scale <= settings.reported_distance {
                            let numbers = [rows.number(0, features.features.a), rows.number(1, features.features.b)];
                            let contact = contact(a, b, settings, rows.triangles, numbers, true, &corners, features);
                            found.contacts.push(contact);
                        }
                    }
                } else {
                    batches.add_boundary(&rows, screen.boundary_cases(place), pair.nothing(), &mut found.contacts);
                }
            }
        }
        if found.wants_lower_bounds {
            let first = found.lower_bounds.len();
            found.lower_bounds.extend_from_slice(&screen.lower_bounds()[..pairs.len()]);
            for (place, distance) in apart.drain(..) {
                found.lower_bounds[first + place] = rounded_down(distance);
            }
        }
    }
    let LeftOver { doubtful, mut has_gaps } = batches.finish(&mut found.contacts);
    for task in doubtful {
        match contact_alone(a, b, settings, &task) {
            Some(contact) => found.contacts[task.place as usize] = contact,
            None => has_gaps = true,
        }
    }
    if has_gaps {
        close_gaps(&mut found.contacts, first_contact);
    }
    found.list_shared(first_contact);
}

/// The places of bits that are set, ascending.
#[inline]
fn places(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (place < PairScreen::WIDTH).then_some(place)
    })
}

/// Drops places without a contact from the first of some on.
fn close_gaps(contacts: &mut Vec<CompactContact>, first: usize) {
    let mut kept = first;
    for place in first..contacts.len() {
        if !contacts[place].is_none() {
            contacts[kept] = contacts[place];
            kept += 1;
        }
    }
    contacts.truncate(kept);
}

/// The rows of one side's triangles of up to eight pairs, of fewer the last one fills up. Where nobody has made them, they
/// are `made`.
#[inline(always)]
#[expect(clippy::inline_always, reason = "so that it is compiled for each side")]
fn rows_of<'a, const SIDE: usize>(
    side: &SurfaceSide<'a>,
    pairs: &[[u32; 2]],
    made: &'a mut [CornerRow; PairScreen::WIDTH],
) -> [&'a CornerRow; PairScreen::WIDTH] {
    let triangle = |lane: usize| pairs[lane.min(pairs.len() - 1)][SIDE];
    if let Some(rows) = side.rows {
        return std::array::from_fn(|lane| rows.of(triangle(lane)));
    }
    for (row, pair) in made.iter_mut().zip(pairs) {
        *row = side.row(pair[SIDE]);
    }
    std::array::from_fn(|lane| &made[lane.min(pairs.len() - 1)])
}

/// The contact of a feature pair by the test of its triangles alone, where it is close enough to be reported.
fn contact_alone(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    task: &FeatureTask,
) -> Option<CompactContact> {
    let FeatureTask { triangles, features, numbers, is_shared, .. } = *task;
    let corners = [a.corners(triangles[0]), b.corners(triangles[1])];
    let mut proximity = PairProximity::default();
    examine_pair(&corners[0], &corners[1], settings.range / settings.scale, &mut proximity);
    let found = proximity.proximities.iter().find(|found| found.features == features)?;
    let is_reported = found.distance * settings.scale <= settings.reported_distance;
    is_reported.then(|| contact(a, b, settings, triangles, numbers, is_shared, &corners, found))
}

/// Tests pairs exactly, each for itself and whole: what the other ways are measured by.
fn examine_pairs_alone(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    pairs: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    let mut proximity = PairProximity::default();
    found.examined += pairs.len();
    let first_contact = found.contacts.len();
    for &triangles in pairs {
        let corners = [a.corners(triangles[0]), b.corners(triangles[1])];
        examine_pair(&corners[0], &corners[1], settings.range / settings.scale, &mut proximity);
        let reported = |features: &Proximity| reports(a, b, settings.same_surface, triangles, features.features);
        add_examined(a, b, settings, triangles, &corners, &proximity, reported, found);
    }
    found.list_shared(first_contact);
}

/// Adds what a pair amounts to that was looked at alone: nothing where it is beyond the range. Of features that make a
/// contact, `reported` says whether other pairs may report them, too.
#[expect(clippy::too_many_arguments, reason = "a pair, what is known of it, and where it goes")]
fn add_examined(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    triangles: [u32; 2],
    corners: &[[DVec3; 3]; 2],
    pair: &PairProximity,
    reported: impl Fn(&Proximity) -> Option<bool>,
    found: &mut FoundPairs,
) {
    let distance = pair.distance * settings.scale;
    if distance > settings.range {
        return;
    }
    add_pair(triangles, distance, settings, found);
    for features in &pair.proximities {
        if features.distance * settings.scale <= settings.reported_distance
            && let Some(is_shared) = reported(features)
        {
            let numbers = numbers(a, b, triangles, features.features);
            found.contacts.push(contact(a, b, settings, triangles, numbers, is_shared, corners, features));
        }
    }
}

fn add_pair([triangle_a, triangle_b]: [u32; 2], distance: f64, settings: &PairSettings, found: &mut FoundPairs) {
    found.nearest = found.nearest.min(distance);
    if distance <= settings.contact_distance {
        found.touching.push(TouchingPair { triangle_a, triangle_b, distance });
    }
}

/// Tests candidate triangles of a surface exactly against a rigid shape and appends what it finds. `pose` brings the
/// surface into the shape's frame, which is the frame of the pair.
pub fn refine_shape(
    topology: &SurfaceTopology,
    positions: &[Vec3],
    pose: &Pose,
    shape: &ShapeGeometry,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    let mut scratch = PairProximity::default();
    let mut proximities: Vec<ShapeProximity> = Vec::new();
    let first_contact = found.contacts.len();
    for &[triangle, _] in candidates {
        let corners = topology.triangles()[triangle as usize]
            .map(|vertex| pose.transform_point(positions[vertex as usize].as_dvec3()));
        proximities.clear();
        found.examined += 1;
        let distance =
            shape.examine(&corners, settings.range / settings.scale, &mut scratch, &mut proximities) * settings.scale;
        if distance > settings.range {
            continue;
        }
        found.nearest = found.nearest.min(distance.max(0.0));
        if distance <= settings.contact_distance {
            found.touching.push(TouchingPair { triangle_a: triangle, triangle_b: 0, distance: distance.max(0.0) });
        }
        found.contacts.extend(
            proximities
                .iter()
                .filter(|proximity| proximity.distance * settings.scale <= settings.reported_distance)
                .map(|proximity| CompactContact::with_shape(topology, positions, triangle, proximity, settings.scale)),
        );
    }
    found.list_shared(first_contact);
}

/// Those of a pair's cases that it reports, see [`reports`].
#[inline]
fn reported_cases(pair: &RowPair<'_>, same_surface: bool, cases: Cases) -> Reported {
    let [a, b] = pair.sides;
    let [around_a, around_b] = pair.rows.map(|row| row.surroundings);
    let mut reported = Reported { cases: Cases::between(around_a.first_of, around_b.first_of), shared: Cases::NONE };
    if a.topology.is_welded() || b.topology.is_welded() {
        for case in cases.without(reported.cases).without_boundary().each() {
            reported.add(case, reports(a, b, same_surface, pair.triangles, case.features()));
        }
    } else if same_surface && around_a.firsts_may_meet(around_b) {
        for case in cases.without(reported.cases).without_boundary().each() {
            let [part_a, part_b] = case.parts();
            let [first_a, first_b] =
                [(0, part_a), (1, part_b)].map(|(side, part)| pair.rows[side].first_around(a.topology, part));
            let [x, y, z] = first_b;
            // Without short circuits: nine comparisons cost less than one branch that is hard to predict.
            let meet = |vertex: u32| (vertex == x) | (vertex == y) | (vertex == z);
            reported.add(case, (meet(first_a[0]) | meet(first_a[1]) | meet(first_a[2])).then_some(true));
        }
    }
    reported
}

/// Whether this pair of triangles reports a feature pair, and if so whether others may, too. The pair of the first triangles
/// around both features does alone, unless those are neighbors, which are no pair: then every pair does that has both features,
/// and only the first of them stays later, as of pairs that are closest on a boundary.
fn reports(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    same_surface: bool,
    triangles: [u32; 2],
    features: FeaturePair,
) -> Option<bool> {
    if matches!(
        (features.a, features.b),
        (Feature::Vertex(_), Feature::Vertex(_) | Feature::Edge(_)) | (Feature::Edge(_), Feature::Vertex(_))
    ) {
        return Some(true);
    }
    let first_around = |side: &SurfaceSide<'_>, triangle: u32, feature: Feature| {
        let around = triangles_around(side, triangle, feature).unwrap_or_default();
        around.iter().copied().find(|&candidate| shares_feature(side, triangle, feature, candidate)).unwrap_or(triangle)
    };
    let firsts = [first_around(a, triangles[0], features.a), first_around(b, triangles[1], features.b)];
    let is_shared = || same_surface && a.topology.share_vertex(TriangleId(firsts[0]), TriangleId(firsts[1]));
    if firsts == triangles { Some(false) } else { is_shared().then_some(true) }
}

pub(super) fn triangles_around<'a>(side: &SurfaceSide<'a>, triangle: u32, feature: Feature) -> Option<&'a [u32]> {
    match feature {
        Feature::Vertex(corner) => {
            let vertex = side.topology.welded_triangles()[triangle as usize][corner as usize];
            Some(side.topology.triangles_of_vertex(VertexId(vertex)))
        }
        Feature::Edge(edge) => Some(
            side.topology.triangles_of_edge(EdgeId(side.topology.triangle_edges()[triangle as usize][edge as usize])),
        ),
        Feature::Face => None,
    }
}

/// Whether `candidate` still has the feature of `triangle` at the same place: vertices that were welded because they
/// coincided once may have moved apart since.
fn shares_feature(side: &SurfaceSide<'_>, triangle: u32, feature: Feature, candidate: u32) -> bool {
    if candidate == triangle || !side.topology.is_welded() {
        return true;
    }
    let same_corner = |corner: usize| {
        let vertex = side.topology.triangles()[triangle as usize][corner];
        let welded = side.topology.weld()[vertex as usize];
        let own = side.positions[vertex as usize];
        side.topology.triangles()[candidate as usize].iter().any(|&other| {
            other == vertex || side.topology.weld()[other as usize] == welded && side.positions[other as usize] == own
        })
    };
    match feature {
        Feature::Vertex(corner) => same_corner(corner as usize),
        Feature::Edge(edge) => same_corner(edge as usize) && same_corner((edge as usize + 1) % 3),
        Feature::Face => true,
    }
}

/// The [numbers](feature_number) of features.
fn numbers(a: &SurfaceSide<'_>, b: &SurfaceSide<'_>, triangles: [u32; 2], features: FeaturePair) -> [u32; 2] {
    [
        feature_number(a.topology, a.positions, triangles[0], features.a),
        feature_number(b.topology, b.positions, triangles[1], features.b),
    ]
}

/// A contact between features of these `numbers`.
#[expect(clippy::too_many_arguments, reason = "a pair, what is known of it, and what of it meets")]
fn contact(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    triangles: [u32; 2],
    numbers: [u32; 2],
    is_shared: bool,
    corners: &[[DVec3; 3]; 2],
    proximity: &Proximity,
) -> CompactContact {
    let mut normal = direction_of(proximity.separation).unwrap_or_else(|| way_out(a, b, triangles, corners, proximity));
    let mut distance = proximity.distance * settings.scale;
    if !settings.same_surface && is_inside(a, b, triangles, proximity) {
        normal = -normal;
        distance = -distance;
    }
    let weights = proximity.barycentric_b;
    let point_b = point_at(&corners[1], &weights);
    CompactContact::between_features(
        triangles,
        settings.same_surface,
        proximity.features,
        numbers,
        is_shared,
        [proximity.barycentric_a, weights].map(|[first, second, _]| [first as f32, second as f32]),
        point_b.as_vec3(),
        normal.as_vec3(),
        distance as f32,
    )
}

/// Unit vector along a separation; `None` where there is none.
fn direction_of(separation: DVec3) -> Option<DVec3> {
    // 2^512: squares of what is shorter than its inverse have lost precision to the end of f64, or all of it.
    const LARGE: f64 = f64::from_bits((1023 + 512) << 52);
    let separation = if separation.length_squared() * LARGE < 1.0 { separation * LARGE } else { separation };
    separation.try_normalize()
}

/// Whether the sides have passed each other, as far as a one-sided surface tells. A face tells best, of two edges the
/// second side's. A vertex or an edge that is close to another triangle's boundary may be closer still to a neighbor of
/// it, and then its direction misleads: where both sides have an inside, both have to agree.
fn is_inside(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    [triangle_a, triangle_b]: [u32; 2],
    proximity: &Proximity,
) -> bool {
    let (features, separation) = (proximity.features, proximity.separation);
    let behind_b = || b.outward(triangle_b, features.b).dot(separation) < 0.0;
    let behind_a = || a.outward(triangle_a, features.a).dot(separation) > 0.0;
    match (a.one_sided, b.one_sided) {
        (true, true) => match (features.a, features.b) {
            (Feature::Face, _) => behind_a(),
            (_, Feature::Face) | (Feature::Edge(_), Feature::Edge(_)) => behind_b(),
            _ => behind_a() && behind_b(),
        },
        (false, true) => behind_b(),
        (true, false) => behind_a(),
        (false, false) => false,
    }
}

/// A direction where the points coincide: the normal of the face that is met or pierced, else that of two edges. Out
/// of a one-sided surface; of a two-sided one towards the side where more of the first side lies.
fn way_out(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    triangles: [u32; 2],
    corners: &[[DVec3; 3]; 2],
    proximity: &Proximity,
) -> DVec3 {
    let from_b_to_a = (corners[0].iter().sum::<DVec3>() - corners[1].iter().sum::<DVec3>()) / 3.0;
    let towards_a = |direction: DVec3| if direction.dot(from_b_to_a) < 0.0 { -direction } else { direction };
    let features = proximity.features;
    let direction = match (features.a, features.b) {
        (Feature::Face, _) if a.one_sided => -a.outward(triangles[0], Feature::Face),
        (_, Feature::Face) if b.one_sided => b.outward(triangles[1], Feature::Face),
        (Feature::Face, _) => towards_a(face_normal(&corners[0])),
        (Feature::Edge(edge_a), Feature::Edge(edge_b)) => {
            let along = |side: usize, edge: u8| corners[side][(edge as usize + 1) % 3] - corners[side][edge as usize];
            towards_a(along(0, edge_a).cross(along(1, edge_b)))
        }
        _ => towards_a(face_normal(&corners[1])),
    };
    direction.try_normalize().or_else(|| from_b_to_a.try_normalize()).unwrap_or(DVec3::Y)
}
