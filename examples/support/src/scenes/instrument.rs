//! A rigid instrument that presses into the [`organ`](super::organ), slides over its back and lifts.
//!
//! Its tip follows the organ's surface at rest, so that the depth of the pressing is what it says wherever the organ is
//! held in place.

use super::bodies::{organ_normal, organ_point};
use super::points::{advance, ease, rotation_from_y, subtract, unit};
use super::{Mesh, capsule};

/// The radius of the instrument in metres.
pub const INSTRUMENT_RADIUS: f32 = 0.01;

/// Half the length of the instrument's axis, between the middles of its caps, in metres.
pub const INSTRUMENT_HALF_LENGTH: f32 = 0.06;

/// How deep the instrument is pressed into the organ at rest, in metres.
pub const INSTRUMENT_DEPTH: f64 = 0.004;

/// How far above the organ the instrument starts and ends, in metres.
pub const INSTRUMENT_CLEARANCE: f64 = 0.05;

/// When the instrument has its full depth and begins to slide, in seconds.
pub const INSTRUMENT_SLIDE_START: f64 = 1.0;

/// When the instrument has stopped sliding and begins to lift, in seconds.
pub const INSTRUMENT_SLIDE_END: f64 = INSTRUMENT_SLIDE_START + 2.0 * RAMP + STEADY;

/// When the instrument has come to rest above the organ, in seconds.
pub const INSTRUMENT_END: f64 = INSTRUMENT_SLIDE_END + 1.0;

/// How long the sliding takes to start and to stop, in seconds.
const RAMP: f64 = 0.25;

/// How long the sliding is steady, in seconds.
const STEADY: f64 = 1.8;

/// How fast the sine of the direction to the tip grows while it slides, in 1/s: about 5 cm/s on the organ.
const RATE: f64 = 0.5;

/// The point, in metres, through which the axis always goes, as an instrument goes through the wall of the abdomen.
const PIVOT: [f64; 3] = [0.0, 0.4, 0.06];

/// The instrument at rest: a closed capsule along the y axis, its middle at the origin, its tip downwards.
pub fn instrument() -> Mesh {
    capsule(INSTRUMENT_RADIUS, INSTRUMENT_HALF_LENGTH, 12, 26, 3)
}

/// Where [`instrument`] is `time` seconds after the start: its translation in metres and its rotation, a unit quaternion
/// in the order x, y, z, w.
///
/// In the first second it comes down from [`INSTRUMENT_CLEARANCE`] above the organ to [`INSTRUMENT_DEPTH`] inside; from
/// [`INSTRUMENT_SLIDE_START`] to [`INSTRUMENT_SLIDE_END`] it slides towards +x at that depth, at 4 to 6 cm/s once it has
/// started; then it lifts for a second and stays. Before 0 it is at its start. Its velocity is continuous.
pub fn instrument_pose(time: f64) -> ([f32; 3], [f32; 4]) {
    let pressed = ease(0.0, INSTRUMENT_SLIDE_START, time) - ease(INSTRUMENT_SLIDE_END, INSTRUMENT_END, time);
    let height = INSTRUMENT_CLEARANCE - (INSTRUMENT_CLEARANCE + INSTRUMENT_DEPTH) * pressed;
    let sine = RATE * (slid(time) - 0.5 * (STEADY + RAMP));
    let direction = [sine, (1.0 - sine * sine).sqrt(), 0.0];
    let tip = advance(organ_point(direction), f64::from(INSTRUMENT_RADIUS) + height, organ_normal(direction));
    let axis = unit(subtract(PIVOT, tip));
    let middle = advance(tip, f64::from(INSTRUMENT_HALF_LENGTH), axis);
    (middle.map(|coordinate| coordinate as f32), rotation_from_y(axis).map(|part| part as f32))
}

/// For how many seconds of full speed the instrument has been sliding.
fn slid(time: f64) -> f64 {
    // The integral of a speed that grows as 3s² − 2s³ over a ramp and is 1 from then on.
    let since = |start: f64| {
        let share = ((time - start) / RAMP).clamp(0.0, 1.0);
        RAMP * share * share * share * (1.0 - 0.5 * share) + (time - start - RAMP).max(0.0)
    };
    since(INSTRUMENT_SLIDE_START) - since(INSTRUMENT_SLIDE_END - RAMP)
}
