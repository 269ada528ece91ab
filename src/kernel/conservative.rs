//! Conservative distances of triangle pairs in single precision, eight at a time.
//!
//! The connection of the closest features, as f32 finds it, is tried as a separating direction, as in the last cull before
//! the exact test: so a pair within range is never lost. The same proof in f64 tells whether features that look closest
//! are. Read by `refine`, for the `Closest` method.

use glam::{DVec3, Vec3};

use super::{
    exact::{
        FeatureCase, Proximity,
        cull::{gap_along, proves_apart},
        examine_case,
    },
    lanes::{Connection, Lanes, PairLanes, WIDTH},
};

/// A distance counts as proven by a direction whose gap is short of it by no more than this share of the pair's extent:
/// what f64 leaves of it where the two are not much closer to each other than that.
const PROVEN: f64 = 1.0e-12;

/// Nor by more than this share of the distance, a hundredth of the band in which either answer about a contact distance is
/// right: of pairs very much larger than that the other bound says nothing.
const PROVEN_SHARE: f64 = 1.0e-6;

/// A pair that the connection of its closest features does not part by more than the range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearPair {
    /// Triangle of the first and of the second side.
    pub triangles: [u32; 2],
    /// Which features look closest; of triangles that cross, which vertex and face or which two edges.
    pub closest: FeatureCase,
}

impl NearPair {
    /// The closest features in double precision; `corners` are those of the two triangles. `None` where their own
    /// direction does not hold the triangles apart by their distance: where the triangles cross, or other features are
    /// closer than single precision saw.
    #[must_use]
    pub fn closest_features(&self, corners: [&[DVec3; 3]; 2]) -> Option<Proximity> {
        let proximity = examine_case(corners[0], corners[1], self.closest)?;
        let from_origin = |corner: &DVec3| (*corner - corners[0][0]).abs().max_element();
        let extent = corners[0].iter().chain(corners[1]).map(from_origin).fold(0.0, f64::max);
        let gap = gap_along(proximity.separation / proximity.distance, corners[0], corners[1]);
        let short = (PROVEN * extent).min(PROVEN_SHARE * proximity.distance);
        (gap > 0.0 && proximity.distance - gap <= short).then_some(proximity)
    }
}

/// Appends the pairs that the connection of their closest features does not prove farther apart than `range` (in the unit
/// of the positions, 0 or more): all within range, and hardly any beyond. `positions` and `triangles` are those of the first
/// and the second surface.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
pub fn near_pairs(
    positions: [&[Vec3]; 2],
    triangles: [&[[u32; 3]]; 2],
    pairs: &[[u32; 2]],
    range: f32,
    near: &mut Vec<NearPair>,
) {
    let mut lanes = PairLanes::EMPTY;
    for pairs in pairs.chunks(WIDTH) {
        lanes.gather(positions, triangles, pairs);
        let closest = Connection::closest::<true>(&lanes.a, &lanes.b);
        keep(pairs, &lanes.excess_along(closest.direction, Lanes::splat(range)), &closest.case, near);
    }
}

/// Kept apart for the same reason as the gathering: numbers that are stored side by side are computed side by side.
#[inline(never)]
fn keep(pairs: &[[u32; 2]], excess: &Lanes, cases: &Lanes, near: &mut Vec<NearPair>) {
    let closest = |lane: usize| FeatureCase(cases.0[lane].to_bits() as u8);
    let kept = pairs.iter().enumerate().filter(|&(lane, _)| !proves_apart(excess.0[lane]));
    near.extend(kept.map(|(lane, &triangles)| NearPair { triangles, closest: closest(lane) }));
}
