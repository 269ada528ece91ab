//! The exact stage over a list of candidate pairs: a screen of eight at a time, exact distances, and contacts.
//!
//! Reads candidate triangle pairs and positions in one common frame, and writes touching pairs and contacts, both in
//! the order of the candidates. If several pairs of triangles have the same feature pair, the first contact that is
//! stored is kept. Usually only that one is written, by the pair of the first triangles around both features. The
//! topology alone determines these, because every pair with both features touches too. If only the closest features are
//! requested, every pair reports its own. Boundary features are not reported again if another pair has just reported
//! them.

use arrayvec::ArrayVec;
use fearless_simd::prelude::*;
use glam::DVec3;

use self::{
    block::Block,
    contacts::{contact, numbers},
    reports::{ReportedLanes, reported_as_first, reports},
};
use super::{
    CaseLanes, FeatureBatches, LeftOver, PairProximity, PairScreen, Proximity, ScreenLimits, examine_pair,
    rounded_down, tolerances::TIE,
};
use crate::kernel::{
    contact::{CompactContact, TouchingPair},
    mesh::{corner_rows::CornerRow, feature::FeaturePair},
    pair::{FoundPairs, PairSettings, SurfaceSide},
    simd::{
        lanes::SetLanes,
        prefetch::{ask_ahead, ask_for_room},
    },
};

mod block;
mod contacts;
pub(in crate::kernel) mod reports;
mod varying;

/// Tests candidate pairs of two surfaces exactly, and appends the results. Neighbors, which share a vertex in a
/// self-collision, must not be among the candidates: the broad phase leaves them out.
pub fn exact_pairs(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    if !(a.is_evenly_thick() && b.is_evenly_thick()) {
        varying::examine_pairs(a, b, candidates, settings, found, false);
    } else if settings.cull {
        examine_pairs(a, b, candidates, settings, found, &EachOnce);
    } else {
        examine_pairs_alone(a, b, candidates, settings, found);
    }
}

/// Like [`exact_pairs`], with the same touching pairs, but a pair that does not cross makes a contact of its closest
/// features only, of one of them if several are equally close. Each pair reports its own closest features, whatever
/// other pairs contain them, because for those they need not be the closest. Boundary features may be left to a pair
/// that has just reported the same ones. If a side has an inside, this only applies outside of it.
pub fn closest_pairs(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    if a.is_evenly_thick() && b.is_evenly_thick() {
        examine_pairs(a, b, candidates, settings, found, &Closest);
    } else {
        varying::examine_pairs(a, b, candidates, settings, found, true);
    }
}

/// What pairs report.
trait Choice {
    /// The cases that eight pairs report, given all their cases and the closest one.
    fn of_lanes<S: Simd>(
        &self,
        simd: S,
        block: &Block<'_>,
        cases: CaseLanes<S>,
        closest: CaseLanes<S>,
    ) -> ReportedLanes<S>;

    /// Whether features of a pair make a contact.
    fn makes_contact(&self, pair: &PairProximity, features: &Proximity) -> bool;
}

/// Everything that no other pair reports.
struct EachOnce;

impl Choice for EachOnce {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn of_lanes<S: Simd>(&self, simd: S, block: &Block<'_>, cases: CaseLanes<S>, _: CaseLanes<S>) -> ReportedLanes<S> {
        if block.settings.any_left_out {
            return ReportedLanes::all(simd, cases);
        }
        let is_welded = block.sides[0].topology.is_welded() || block.sides[1].topology.is_welded();
        reported_as_first(simd, &block.rows, block.settings.same_surface, is_welded, cases)
    }

    fn makes_contact(&self, _: &PairProximity, _: &Proximity) -> bool {
        true
    }
}

/// The closest features, or all features of a pair that crosses.
struct Closest;

impl Choice for Closest {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn of_lanes<S: Simd>(
        &self,
        simd: S,
        _: &Block<'_>,
        cases: CaseLanes<S>,
        closest: CaseLanes<S>,
    ) -> ReportedLanes<S> {
        ReportedLanes::all(simd, CaseLanes(cases.may_cross().select(cases.0, closest.0)))
    }

    fn makes_contact(&self, pair: &PairProximity, features: &Proximity) -> bool {
        pair.distance == 0.0 || features.distance <= pair.distance * (1.0 + TIE)
    }
}

/// Tests pairs exactly, eight at a time first. Only chosen features and boundary features are examined.
fn examine_pairs(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
    choice: &impl Choice,
) {
    // Bits are counted and shifted all the time, for which early processors have no instructions.
    dispatch!(simd => examine_blocks(simd, a, b, candidates, settings, found, choice));
}

#[cfg_attr(not(unoptimized), inline(always))]
fn examine_blocks<S: Simd>(
    simd: S,
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
    choice: &impl Choice,
) {
    found.examined += candidates.len();
    let ranges = [settings.range; PairScreen::WIDTH];
    let mut limits = ScreenLimits { scale: settings.scale, ranges, contact_distance: settings.contact_distance };
    let (is_smooth, of_flat) = (settings.bulge > 0.0, settings.range - settings.bulge);
    let mut proximity = PairProximity::default();
    let mut screen = PairScreen::new();
    let mut batches = FeatureBatches::new([a, b], settings);
    let first_contact = found.contacts.len();
    // Pairs that the screen was in doubt about and that are beyond the range, with lower bounds of their distances.
    let mut apart: ArrayVec<(usize, f64), { PairScreen::WIDTH }> = ArrayVec::new();
    let mut made = [[CornerRow::EMPTY; PairScreen::WIDTH]; 2];
    let [made_a, made_b] = &mut made;
    let poses = [a, b].map(|side| side.moved.map(|moved| moved.pose));
    for (number, pairs) in candidates.chunks(PairScreen::WIDTH).enumerate() {
        if let (Some(rows_a), Some(rows_b)) = (a.rows, b.rows) {
            ask_ahead(rows_a, rows_b, candidates, number);
        }
        ask_for_room(&mut found.contacts);
        ask_for_room(&mut found.touching);
        let rows = [rows_of::<0>(a, pairs, made_a), rows_of::<1>(b, pairs, made_b)];
        if is_smooth {
            // The range was widened for the highest patches. Most are closer to their triangles.
            for (range, &[triangle_a, triangle_b]) in limits.ranges.iter_mut().zip(pairs) {
                *range = of_flat + (a.patch_height(triangle_a) + b.patch_height(triangle_b)) * settings.scale;
            }
        }
        let screened = screen.screen([&rows[0], &rows[1]], poses, pairs.len(), &limits);
        let block = Block { sides: [a, b], settings, pairs, rows, screen: &screen, screened };
        let [near, doubtful] = [screened.near, screened.doubtful];
        let mut of_block = block.reports(simd, near | doubtful, near, choice);
        let mut stops = of_block.examined | of_block.meeting;
        let is_plain = stops == 0;
        if is_plain {
            block.add_pairs(near, found);
        }
        // In the order of the candidates, up to each pair that must be examined by itself.
        let mut left = near & !of_block.examined;
        loop {
            let next = stops.trailing_zeros().min(u32::BITS - 1);
            let part = left & (u32::MAX >> (u32::BITS - 1 - next));
            left &= !part;
            if !is_plain {
                for place in SetLanes(part) {
                    block.add_pair(place, found);
                }
            }
            batches.add(pairs, &mut of_block.reports, part, &mut found.contacts);
            if stops == 0 {
                break;
            }
            stops &= stops - 1;
            let place = next as usize;
            if of_block.examined >> place & 1 != 0 {
                let wanted = of_block.of(place);
                let distance = block.add_examined(place, wanted, choice, &mut proximity, found);
                apart.extend(distance.map(|distance| (place, distance)));
            } else {
                block.add_boundaries(place, &mut proximity, &mut found.contacts);
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
    for place in doubtful {
        let contact = &mut found.contacts[place as usize];
        if let Some(known) = contact_alone(a, b, settings, contact) {
            *contact = known;
        } else {
            contact.drop_name();
            has_gaps = true;
        }
    }
    if has_gaps {
        close_gaps(&mut found.contacts, first_contact);
    }
    found.finish_contacts(first_contact);
}

/// Removes empty entries from index `first` on.
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

/// The rows of one side's triangles for up to eight pairs. The last row fills unused lanes. If rows have not been made,
/// they are written to `made`.
#[cfg_attr(not(unoptimized), inline(always))]
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

/// The contact of a feature pair by the test of its triangles alone, if it is close enough to be reported.
fn contact_alone(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    named: &CompactContact,
) -> Option<CompactContact> {
    let CompactContact { triangle_a, triangle_b, features, is_shared, .. } = *named;
    let triangles = [triangle_a, triangle_b];
    let corners = [a.corners(triangles[0]), b.corners(triangles[1])];
    let mut proximity = PairProximity::default();
    examine_pair(&corners[0], &corners[1], settings.range / settings.scale, &mut proximity);
    let found = proximity.proximities.iter().find(|found| found.features == features)?;
    let is_reported = found.distance * settings.scale <= settings.reported_distance;
    let numbers = numbers(a, b, triangles, features);
    is_reported.then(|| contact(a, b, settings, triangles, numbers, is_shared, &corners, found))
}

/// Tests each pair exactly by itself and completely. The other ways are compared with this.
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
        let reported = |features: &Proximity| reports(a, b, settings, triangles, features.features);
        let number = |features: FeaturePair| numbers(a, b, triangles, features);
        add_examined(a, b, settings, triangles, &corners, &proximity, reported, number, found);
    }
    found.finish_contacts(first_contact);
}

/// Adds the result of a pair that was examined by itself, or nothing if it is beyond the range. `reported` returns
/// `None` for features that make no contact, and otherwise whether other pairs may report them too. `number` returns
/// the numbers of features.
#[expect(clippy::too_many_arguments, reason = "a pair, what is known about it, and where the result goes")]
fn add_examined(
    a: &SurfaceSide<'_>,
    b: &SurfaceSide<'_>,
    settings: &PairSettings,
    triangles: [u32; 2],
    corners: &[[DVec3; 3]; 2],
    pair: &PairProximity,
    reported: impl Fn(&Proximity) -> Option<bool>,
    number: impl Fn(FeaturePair) -> [u32; 2],
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
            let numbers = number(features.features);
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
