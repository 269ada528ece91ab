//! Up to eight candidate pairs that were screened side by side: what of them needs no look at a pair alone.

#![expect(clippy::inline_always, reason = "parts of one loop, which are to be compiled as one")]

use std::hint::select_unpredictable;

use fearless_simd::{f64x8, mask64x8, prelude::*, u64x8};

use super::{
    Choice, add_examined, add_pair,
    contacts::contact,
    reports::{Reported, add_others},
};
use crate::kernel::{
    contact::{CompactContact, TouchingPair},
    exact::{
        CaseLanes, Cases, FeatureSet, PairProximity, PairScreen, Proximity, Reports, Screened, examine_boundaries,
        examine_screened, triangle_pair::TIE,
    },
    mesh::{corner_rows::CornerRow, feature::FeaturePair},
    pair::{FoundPairs, PairSettings, RowPair, SurfaceSide},
    simd::lanes::{SetLanes, WIDTH},
};

/// What a block of pairs reports.
pub(super) struct BlockReports<'a> {
    /// Of the pairs that are near.
    pub(super) reports: Reports<'a>,
    /// What else of each pair is reported if it is there, and what of that other pairs may report, too.
    chosen: [[u64; WIDTH]; 2],
    /// Pairs to be examined alone: those of which there is no telling whether they cross, and where points coincide a surface
    /// with an inside has a way out of its own.
    pub(super) examined: u32,
    /// Pairs of which boundaries meet without any distance, and thereby without a direction.
    pub(super) meeting: u32,
}

impl BlockReports<'_> {
    /// What a pair reports if it is there.
    pub(super) fn of(&self, place: usize) -> Reported {
        let [cases, shared] = [self.chosen[0][place], self.chosen[1][place]].map(Cases::from_bits);
        Reported { cases, shared }
    }
}

/// Up to eight candidate pairs.
pub(super) struct Block<'a> {
    pub(super) sides: [&'a SurfaceSide<'a>; 2],
    pub(super) settings: &'a PairSettings,
    pub(super) pairs: &'a [[u32; 2]],
    /// The rows of either triangle; of fewer pairs than eight the last one fills up.
    pub(super) rows: [[&'a CornerRow; WIDTH]; 2],
    pub(super) screen: &'a PairScreen,
    pub(super) screened: Screened,
}

impl<'a> Block<'a> {
    #[inline(always)]
    fn pair(&self, place: usize) -> RowPair<'a> {
        let rows = [self.rows[0][place], self.rows[1][place]];
        RowPair { sides: self.sides, triangles: self.pairs[place], rows }
    }

    /// Pairs that share a vertex, of a surface with itself: neighbors, which are no pairs.
    #[inline(always)]
    pub(super) fn neighbors(&self) -> u32 {
        if !self.settings.same_surface {
            return 0;
        }
        let meeting = if self.sides[0].topology.is_welded() { u32::MAX } else { self.screened.meeting };
        let neighbors = SetLanes(self.screened.possible & meeting).filter(|&place| self.pair(place).are_neighbors());
        neighbors.fold(0, |bits, place| bits | 1 << place)
    }

    /// What pairs of which it is `asked` report, the `near` ones without a look at them alone, of which some are to be looked
    /// at alone nevertheless.
    #[inline(always)]
    pub(super) fn reports<S: Simd>(&self, simd: S, asked: u32, near: u32, choice: &impl Choice) -> BlockReports<'a> {
        let none = u64x8::splat(simd, 0);
        let (mut cases, mut closest, mut boundary) = ([0; WIDTH], [0; WIDTH], [0; WIDTH]);
        let (mut nothing, mut meets) = ([0.0; WIDTH], 0);
        for place in 0..WIDTH {
            let pair = self.screen.pair(place);
            (cases[place], closest[place]) = (pair.cases.bits(), pair.closest.bits());
            boundary[place] = self.screen.boundary_cases(place).bits();
            nothing[place] = pair.nothing();
            meets |= u32::from(pair.touches()) << place;
        }
        let is = |bits: u32| mask64x8::from_bitmask(simd, u64::from(bits));
        let cases = is(asked & self.screened.with_cases).select(u64x8::from_slice(simd, &cases), none);
        let closest = CaseLanes(u64x8::from_slice(simd, &closest));
        let reported = choice.of_lanes(simd, self, CaseLanes(cases), closest);
        let mut chosen = [[0; WIDTH]; 2];
        reported.cases.0.store_slice(&mut chosen[0]);
        reported.shared.0.store_slice(&mut chosen[1]);
        for place in SetLanes(reported.others.to_bitmask() as u32) {
            let mut more =
                Reported { cases: Cases::from_bits(chosen[0][place]), shared: Cases::from_bits(chosen[1][place]) };
            add_others(&self.pair(place), self.settings.same_surface, self.screen.pair(place).cases, &mut more);
            (chosen[0][place], chosen[1][place]) = (more.cases.bits(), more.shared.bits());
        }

        let [counting, shared] = [u64x8::from_slice(simd, &chosen[0]), u64x8::from_slice(simd, &chosen[1])];
        let distances = f64x8::from_slice(simd, self.screen.distances());
        let is_reported = distances.simd_le(self.settings.reported_distance);
        // Of those on boundaries some are farther than the nearest, by as much as makes no difference.
        let certain = (distances * (1.0 + TIE)).simd_le(self.settings.reported_distance);
        let on_boundary = is(near & self.screened.on_boundary) & is_reported;
        let boundary = (on_boundary & is(!meets)).select(u64x8::from_slice(simd, &boundary), none);
        let counting = CaseLanes(is(near).select(cases & counting, none));
        let sets = FeatureSet::in_lanes(counting, boundary);
        let all = u64x8::splat(simd, (1 << 27) - 1);
        let mut reports = Reports {
            rows: self.rows,
            sets: [0; WIDTH],
            shared: [0; WIDTH],
            with_any: (!sets.simd_eq(none)).to_bitmask() as u32,
            certain: certain.to_bitmask() as u32,
            nothing,
        };
        sets.store_slice(&mut reports.sets);
        FeatureSet::in_lanes(CaseLanes(shared), all).store_slice(&mut reports.shared);
        let has_inside = self.sides[0].one_sided || self.sides[1].one_sided;
        let crossing = if has_inside { counting.may_cross().to_bitmask() as u32 } else { 0 };
        BlockReports {
            reports,
            chosen,
            examined: asked & !near | crossing,
            meeting: on_boundary.to_bitmask() as u32 & meets,
        }
    }

    /// Adds pairs that are near by their distances.
    #[inline(always)]
    pub(super) fn add_pairs(&self, near: u32, found: &mut FoundPairs) {
        let touching = near & self.screened.touching;
        let distances = self.screen.distances();
        let before = found.touching.len();
        found.touching.resize(before + WIDTH, TouchingPair { triangle_a: 0, triangle_b: 0, distance: 0.0 });
        let room = &mut found.touching[before..];
        let mut count = 0;
        for (place, &[triangle_a, triangle_b]) in self.pairs.iter().enumerate() {
            // Those that do not touch are written over.
            room[count] = TouchingPair { triangle_a, triangle_b, distance: distances[place % WIDTH] };
            count += (touching >> place & 1) as usize;
        }
        found.touching.truncate(before + count);
        let mut nearest = [f64::INFINITY; WIDTH];
        for (place, nearest) in nearest.iter_mut().enumerate() {
            *nearest = select_unpredictable(near >> place & 1 != 0, distances[place], f64::INFINITY);
        }
        let [first, second, third, fourth] = [0, 1, 2, 3].map(|place| least(nearest[place], nearest[place + 4]));
        found.nearest = least(found.nearest, least(least(first, second), least(third, fourth)));
    }

    /// Adds one pair that is near by its distance.
    #[inline(always)]
    pub(super) fn add_pair(&self, place: usize, found: &mut FoundPairs) {
        add_pair(self.pairs[place], self.screen.distances()[place], self.settings, found);
    }

    /// Adds what is on the boundaries of both triangles of a pair without any distance, each for itself.
    pub(super) fn add_boundaries(
        &self,
        place: usize,
        proximity: &mut PairProximity,
        contacts: &mut Vec<CompactContact>,
    ) {
        let ([a, b], settings, rows) = (self.sides, self.settings, self.pair(place));
        let corners = [rows.corners(0), rows.corners(1)];
        proximity.proximities.clear();
        let range = settings.range / settings.scale;
        examine_boundaries(&self.screen.pair(place), &corners, range, &mut proximity.proximities);
        for features in &proximity.proximities {
            if features.distance * settings.scale <= settings.reported_distance {
                let numbers = rows.numbers(features.features);
                contacts.push(contact(a, b, settings, rows.triangles, numbers, true, &corners, features));
            }
        }
    }

    /// Tests a pair by itself and adds what it amounts to. Returns a lower bound of its distance where it is not within range
    /// after all, and such are wanted.
    pub(super) fn add_examined(
        &self,
        place: usize,
        wanted: Reported,
        choice: &impl Choice,
        proximity: &mut PairProximity,
        found: &mut FoundPairs,
    ) -> Option<f64> {
        let (rows, pair) = (self.pair(place), self.screen.pair(place));
        let corners = [rows.corners(0), rows.corners(1)];
        let range = self.settings.range / self.settings.scale;
        examine_screened(&pair, &corners, range, wanted.cases, proximity);
        let reported = |features: &Proximity| {
            choice.makes_contact(proximity, features).then(|| wanted.is_shared(features.features))
        };
        let [a, b] = self.sides;
        let number = |features: FeaturePair| rows.numbers(features);
        add_examined(a, b, self.settings, rows.triangles, &corners, proximity, reported, number, found);
        (found.wants_lower_bounds && proximity.distance > range).then(|| proximity.distance - pair.nothing())
    }
}

/// The less of two numbers.
#[inline(always)]
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}
