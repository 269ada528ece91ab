//! Decides in f32 which balls are in contact, where f32 is sufficient.
//!
//! Nearly all pairs are closer than the distances that matter, or farther apart, by more than the rounding error. Those
//! take half the instructions. If one of eight pairs is in doubt, all of them are measured in f64.

use fearless_simd::{f32x8, prelude::*};

use crate::kernel::{pair::PairSettings, simd::lanes::VectorLanes, spheres::rows::RowLanes};

/// The rounding error, relative to all lengths that a distance is computed from. The vector between the centers, its
/// square, the root, the radii, and their differences each round by half a unit in the last place, 6e-8. The rest is
/// reserve.
const ROUNDING: f32 = 8.0 * 0.5 * f32::EPSILON;

/// Squares of smaller lengths lose precision.
const LEAST_LENGTH: f32 = 1.0e-18;

/// A limit in the unit of the pair's frame, rounded down and up.
#[derive(Clone, Copy)]
struct Limit {
    below: f32,
    above: f32,
}

impl Limit {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(limit: f64, scale: f64) -> Self {
        let (limit, slack) = (limit / scale, 2.0 * f64::from(f32::EPSILON));
        Self { below: (limit * (1.0 - slack)) as f32, above: (limit * (1.0 + slack)) as f32 }
    }
}

/// The distances that matter.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    contact: Limit,
    reported: Limit,
    scale: f32,
    /// How far rounding may have displaced the corners of both sides together, in the pair's frame.
    rounding: f32,
}

impl Limits {
    pub(super) fn new(settings: &PairSettings, rounding: f32) -> Self {
        let PairSettings { contact_distance, reported_distance, scale, .. } = *settings;
        Self {
            contact: Limit::new(contact_distance, scale),
            reported: Limit::new(reported_distance, scale),
            scale: scale as f32,
            rounding,
        }
    }
}

/// What is known about eight pairs.
pub(super) struct Estimate<S: Simd> {
    pub(super) touching: u32,
    pub(super) reported: u32,
    /// The gaps between the balls, in world units.
    pub(super) gaps: f32x8<S>,
    /// Whether the balls and the boxes of any pair overlap, which makes its distance 0.
    pub(super) meets: bool,
}

/// The axis-aligned boxes of eight triangles.
struct BoxLanes<S: Simd> {
    low: VectorLanes<S>,
    high: VectorLanes<S>,
}

impl<S: Simd> BoxLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new([a, b, c]: &[VectorLanes<S>; 3]) -> Self {
        let low = VectorLanes { x: a.x.min(b.x).min(c.x), y: a.y.min(b.y).min(c.y), z: a.z.min(b.z).min(c.z) };
        let high = VectorLanes { x: a.x.max(b.x).max(c.x), y: a.y.max(b.y).max(c.y), z: a.z.max(b.z).max(c.z) };
        Self { low, high }
    }

    /// The gap between the boxes along the axis that separates them most. Negative if they overlap.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn gap(&self, other: &Self) -> f32x8<S> {
        let (up, down) = (self.low - other.high, other.low - self.high);
        up.x.max(down.x).max(up.y.max(down.y)).max(up.z.max(down.z))
    }
}

/// The f32 results for the pairs whose bits are set in `within`. `None` if one of them is in doubt.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn estimate<S: Simd>(rows: &[RowLanes<S>; 2], within: u32, limits: &Limits) -> Option<Estimate<S>> {
    let [a, b] = rows;
    let between = a.center() - b.center();
    let (length, radii) = (between.dot(between).sqrt(), a.radius() + b.radius());
    let boxes_apart = BoxLanes::new(&a.corners()).gap(&BoxLanes::new(&b.corners()));
    let (gap, box_gap) = (length - radii, boxes_apart.max(0.0));
    let distance = gap.max(box_gap);
    let doubt = (length + radii + box_gap) * ROUNDING + (LEAST_LENGTH + limits.rounding);
    let (least, most) = (distance - doubt, distance + doubt);
    let [contact, reported] = [limits.contact, limits.reported].map(|limit| {
        let [is_in, is_out] = [most.simd_le(limit.below), least.simd_gt(limit.above)];
        [is_in.to_bitmask() as u32, is_out.to_bitmask() as u32]
    });
    let is_known = (contact[0] | contact[1]) & (reported[0] | reported[1]);
    if within & !is_known != 0 {
        return None;
    }
    let boxes_meet = (boxes_apart + limits.rounding).simd_le(0.0);
    let meets = ((gap + doubt).simd_le(0.0) & boxes_meet).to_bitmask() as u32 & within != 0;
    Some(Estimate { touching: contact[0] & within, reported: reported[0] & within, gaps: gap * limits.scale, meets })
}
