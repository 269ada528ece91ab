//! A rigid instrument that presses into the [`organ`](super::organ), slides over its back, and lifts.
//!
//! Its tip follows the rest surface of the organ, so that the pressing depth is exact wherever the organ is held in
//! place.

use super::bodies::{organ_normal, organ_point};
use super::points::{advance, ease, rotation_from_y, subtract, unit};
use super::{Mesh, capsule};

/// Radius of the instrument, in meters.
pub const INSTRUMENT_RADIUS: f32 = 0.01;

/// Half the length of the instrument's axis between the centers of its caps, in meters.
pub const INSTRUMENT_HALF_LENGTH: f32 = 0.06;

/// Depth of the tip below the rest surface of the organ, in meters.
pub const INSTRUMENT_DEPTH: f64 = 0.004;

/// Distance of the instrument above the organ at the start and at the end, in meters.
pub const INSTRUMENT_CLEARANCE: f64 = 0.05;

/// Time at which the instrument has reached its full depth and begins to slide, in seconds.
pub const INSTRUMENT_SLIDE_START: f64 = 1.0;

/// Time at which the instrument has stopped sliding and begins to lift, in seconds.
pub const INSTRUMENT_SLIDE_END: f64 = INSTRUMENT_SLIDE_START + 2.0 * RAMP + STEADY;

/// Time at which the instrument has come to rest above the organ, in seconds.
pub const INSTRUMENT_END: f64 = INSTRUMENT_SLIDE_END + 1.0;

/// Time for the sliding to start and to stop, in seconds.
const RAMP: f64 = 0.25;

/// Duration of the steady sliding, in seconds.
const STEADY: f64 = 1.8;

/// Rate of the sine of the direction to the tip while it slides, in 1/s. On the organ it is about 5 cm/s.
const RATE: f64 = 0.5;

/// The point, in meters, through which the axis always passes, as an instrument passes through the abdominal wall.
const PIVOT: [f64; 3] = [0.0, 0.4, 0.06];

/// The instrument at rest: a closed capsule along the y axis, centered at the origin, with its tip downwards.
pub fn instrument() -> Mesh {
    capsule(INSTRUMENT_RADIUS, INSTRUMENT_HALF_LENGTH, 12, 26, 3)
}

/// Pose of [`instrument`] `time` seconds after the start: its translation in meters, and its rotation as a unit
/// quaternion in the order x, y, z, w.
///
/// In the first second it comes down from [`INSTRUMENT_CLEARANCE`] above the organ to [`INSTRUMENT_DEPTH`] inside. From
/// [`INSTRUMENT_SLIDE_START`] to [`INSTRUMENT_SLIDE_END`] it slides towards +x at that depth, at 4 to 6 cm/s after the
/// ramp. Then it lifts for a second and stays. Before 0 s it is at its start. Its velocity is continuous.
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

/// Sliding time, in seconds at full speed.
fn slid(time: f64) -> f64 {
    // Integral of a speed that grows as 3s² − 2s³ over a ramp and is 1 afterwards.
    let since = |start: f64| {
        let share = ((time - start) / RAMP).clamp(0.0, 1.0);
        RAMP * share * share * share * (1.0 - 0.5 * share) + (time - start - RAMP).max(0.0)
    };
    since(INSTRUMENT_SLIDE_START) - since(INSTRUMENT_SLIDE_END - RAMP)
}
