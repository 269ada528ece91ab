//! Up to eight candidate pairs that were screened together: everything that needs no test of a single pair.

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
        examine_screened, tolerances::TIE,
    },
    mesh::{corner_rows::CornerRow, feature::FeaturePair},
    pair::{FoundPairs, PairSettings, RowPair, SurfaceSide},
    simd::lanes::{SetLanes, WIDTH},
};

/// What a block of pairs reports.
pub(super) struct BlockReports<'a> {
    /// The reports of the pairs that are near.
    pub(super) reports: Reports<'a>,
    /// The cases that each pair reports if they are there, and those of them that other pairs may report too.
    chosen: [[u64; WIDTH]; 2],
    /// Pairs to examine by themselves: those that may or may not cross, and those that cross where a surface has an
    /// inside, which then has its own way out.
    pub(super) examined: u32,
    /// Pairs whose boundaries meet at distance 0, and thus without a direction.
    pub(super) meeting: u32,
}

impl BlockReports<'_> {
    /// The features that a pair reports if they are there.
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
    /// The rows of both triangles. The last pair fills unused lanes.
    pub(super) rows: [[&'a CornerRow; WIDTH]; 2],
    pub(super) screen: &'a PairScreen,
    pub(super) screened: Screened,
}

impl<'a> Block<'a> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn pair(&self, place: usize) -> RowPair<'a> {
        let rows = [self.rows[0][place], self.rows[1][place]];
        RowPair { sides: self.sides, triangles: self.pairs[place], rows }
    }

    /// What the `requested` pairs report. The `near` ones need no test of a single pair, with a few exceptions.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn reports<S: Simd>(
        &self,
        simd: S,
        requested: u32,
        near: u32,
        choice: &impl Choice,
    ) -> BlockReports<'a> {
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
        let cases = is(requested & self.screened.with_cases).select(u64x8::from_slice(simd, &cases), none);
        let closest = CaseLanes(u64x8::from_slice(simd, &closest));
        let reported = choice.of_lanes(simd, self, CaseLanes(cases), closest);
        let mut chosen = [[0; WIDTH]; 2];
        reported.cases.0.store_slice(&mut chosen[0]);
        reported.shared.0.store_slice(&mut chosen[1]);
        for place in SetLanes(reported.others.to_bitmask() as u32) {
            let mut more =
                Reported { cases: Cases::from_bits(chosen[0][place]), shared: Cases::from_bits(chosen[1][place]) };
            add_others(&self.pair(place), self.settings, self.screen.pair(place).cases, &mut more);
            (chosen[0][place], chosen[1][place]) = (more.cases.bits(), more.shared.bits());
        }

        let [counting, shared] = [u64x8::from_slice(simd, &chosen[0]), u64x8::from_slice(simd, &chosen[1])];
        let distances = f64x8::from_slice(simd, self.screen.distances());
        let is_reported = distances.simd_le(self.settings.reported_distance);
        // Boundary features may be farther than the nearest one, by a share of `TIE`.
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
            examined: requested & !near | crossing,
            meeting: on_boundary.to_bitmask() as u32 & meets,
        }
    }

    /// Adds the near pairs, with the distances of the screen.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn add_pairs(&self, near: u32, found: &mut FoundPairs) {
        let touching = near & self.screened.touching;
        let distances = self.screen.distances();
        let before = found.touching.len();
        found.touching.resize(before + WIDTH, TouchingPair { triangle_a: 0, triangle_b: 0, distance: 0.0 });
        let room = &mut found.touching[before..];
        let mut count = 0;
        for (place, &[triangle_a, triangle_b]) in self.pairs.iter().enumerate() {
            // Pairs that do not touch get overwritten.
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

    /// Adds one near pair, with the distance of the screen.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn add_pair(&self, place: usize, found: &mut FoundPairs) {
        add_pair(self.pairs[place], self.screen.distances()[place], self.settings, found);
    }

    /// Adds contacts for the boundary features of a pair at distance 0, one by one.
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

    /// Tests a pair by itself and adds the result. Returns a lower bound of its distance if it is not within range
    /// after all and bounds are requested.
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

/// The smaller of two numbers.
#[cfg_attr(not(unoptimized), inline(always))]
fn least(a: f64, b: f64) -> f64 {
    if b < a { b } else { a }
}
