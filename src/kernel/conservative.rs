//! Conservative distances of triangle pairs in single precision, eight at a time.
//!
//! The connection of the closest features, as f32 finds it, and the normals are tried as separating directions: the gap
//! along any direction bounds the distance from below, whatever rounding did to the direction. So a pair within range is
//! never lost. The same proof in f64 tells whether features that look closest are. Read by `refine`, for the `Closest`
//! method.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use glam::{DVec3, Vec3};

use super::{
    exact::{
        FeatureCase, Proximity,
        cull::{LEAST_SQUARED, RANGE_SLACK, ROUNDING, gap_along},
        examine_case,
    },
    lanes::{Connection, Lanes, PairLanes, VectorLanes, WIDTH, normal, project},
};

/// A distance counts as proven by a direction whose gap is short of it by no more than this share of the pair's extent:
/// what f64 leaves of it where the two are not much closer to each other than that.
const PROVEN: f64 = 1.0e-12;

/// Nor by more than this share of the distance, a hundredth of the band in which either answer about a contact distance is
/// right: of pairs very much larger than that the other bound says nothing.
const PROVEN_SHARE: f64 = 1.0e-6;

/// The largest gap found, and what looks closest.
struct Apart {
    /// Negative where every direction finds the projections overlapping.
    gap: Lanes,
    closest: Connection,
}

impl Apart {
    const NOTHING: Self = Self { gap: Lanes([f32::NEG_INFINITY; WIDTH]), closest: Connection::NONE };

    #[inline(always)]
    fn offer(&mut self, pairs: &PairLanes, direction: VectorLanes) {
        let (low_a, high_a) = project(&pairs.a, direction);
        let (low_b, high_b) = project(&pairs.b, direction);
        let squared = direction.dot(direction);
        let gap = (low_a - high_b).max(low_b - high_a) * squared.sqrt().recip();
        let better = gap.greater_than(self.gap).and(squared.greater_than(Lanes::splat(LEAST_SQUARED)));
        self.gap = Lanes::select(better, gap, self.gap);
    }

    #[inline(always)]
    fn find(&mut self, pairs: &PairLanes) {
        *self = Self::NOTHING;
        self.offer(pairs, normal(&pairs.a));
        self.offer(pairs, normal(&pairs.b));
        self.closest = Connection::closest::<true>(&pairs.a, &pairs.b);
        self.offer(pairs, self.closest.direction);
    }
}

/// A pair that no direction has parted by more than the range.
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

/// Appends the pairs that are not proven farther apart than `range` (in the unit of the positions, 0 or more): all
/// within range, and hardly any beyond. `positions` and `triangles` are those of the first and the second surface;
/// `rounding` is how far positions may be from where they are meant to be, both sides together.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
pub fn near_pairs(
    positions: [&[Vec3]; 2],
    triangles: [&[[u32; 3]]; 2],
    pairs: &[[u32; 2]],
    range: f32,
    rounding: f32,
    near: &mut Vec<NearPair>,
) {
    let mut lanes = PairLanes::EMPTY;
    let mut apart = Apart::NOTHING;
    for pairs in pairs.chunks(WIDTH) {
        lanes.gather(positions, triangles, pairs);
        apart.find(&lanes);
        keep(pairs, &lanes, &apart, range, rounding, near);
    }
}

/// Kept apart for the same reason as the gathering: numbers that are stored side by side are computed side by side.
#[inline(never)]
fn keep(pairs: &[[u32; 2]], lanes: &PairLanes, apart: &Apart, range: f32, rounding: f32, near: &mut Vec<NearPair>) {
    for (lane, &triangles) in pairs.iter().enumerate() {
        let (gap, rounding) = (apart.gap.0[lane], ROUNDING * lanes.extent.0[lane] + rounding);
        // What is not a number proves nothing.
        if gap > range * RANGE_SLACK + rounding {
            continue;
        }
        near.push(NearPair { triangles, closest: FeatureCase(apart.closest.case.0[lane].to_bits() as u8) });
    }
}
