//! The exact stage over a list of candidate pairs: a screen of eight side by side, exact distance, contacts.
//!
//! Reads candidate triangle pairs and positions in one common frame, writes touching pairs and contacts, both in the order of
//! the candidates. Of a feature pair that several pairs of triangles have the first contact stays, when contacts are stored.
//! Mostly only that one is written: that of the first triangles around both features, which the topology knows alone, because
//! every pair that has both touches too. Where only the closest features are wanted, every pair reports its own.

use arrayvec::ArrayVec;
use glam::{DVec3, Vec3};

use self::{
    contacts::{contact, numbers},
    reports::{Reported, reported_cases, reports},
};
use super::{
    contact::{CompactContact, TouchingPair},
    corner_rows::CornerRow,
    exact::{
        Cases, FeatureBatches, FeatureTask, LeftOver, PairProximity, PairScreen, Proximity, ScreenLimits, ScreenedPair,
        examine_boundaries, examine_pair, examine_screened,
        rigid_shape::{ShapeGeometry, ShapeProximity},
        rounded_down,
        triangle_pair::TIE,
    },
    pair::{FoundPairs, PairSettings, RowPair, SurfaceSide, without_neighbors},
    pose::Pose,
    prefetch::{ask_ahead, ask_for_room},
    topology::SurfaceTopology,
};

mod contacts;
pub(super) mod reports;

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
    let mut batches = FeatureBatches::new([a, b], settings);
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
        ask_for_room(&mut found.contacts);
        ask_for_room(&mut found.touching);
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
            // Where points coincide a surface with an inside has a way out of its own.
            if is_doubtful || has_inside && cases.may_cross() {
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
                if pair.touches() {
                    add_boundaries(&rows, &pair, settings, &mut proximity, &mut found.contacts);
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
    found.finish_contacts(first_contact);
}

/// Adds what is on the boundaries of both triangles of a pair without any distance, each for itself.
fn add_boundaries(
    rows: &RowPair<'_>,
    pair: &ScreenedPair,
    settings: &PairSettings,
    proximity: &mut PairProximity,
    contacts: &mut Vec<CompactContact>,
) {
    let [a, b] = rows.sides;
    let corners = [rows.corners(0), rows.corners(1)];
    proximity.proximities.clear();
    examine_boundaries(pair, &corners, settings.range / settings.scale, &mut proximity.proximities);
    for features in &proximity.proximities {
        if features.distance * settings.scale <= settings.reported_distance {
            let numbers = [rows.number(0, features.features.a), rows.number(1, features.features.b)];
            contacts.push(contact(a, b, settings, rows.triangles, numbers, true, &corners, features));
        }
    }
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
    found.finish_contacts(first_contact);
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
    found.finish_contacts(first_contact);
}
