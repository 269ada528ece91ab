//! The instrument on the organ.

use circumsphere_support::scenes::{
    INSTRUMENT_CLEARANCE, INSTRUMENT_DEPTH, INSTRUMENT_END, INSTRUMENT_HALF_LENGTH, INSTRUMENT_RADIUS,
    INSTRUMENT_SLIDE_END, INSTRUMENT_SLIDE_START, instrument, instrument_pose, organ,
};

use super::geometry::{
    Point, advance, assert_closed, cross, length, point, point_segment, segment_mesh, subtract, winding,
};

/// Transforms a point of the instrument at rest by its pose.
fn posed(time: f64, at: Point) -> Point {
    let (translation, rotation) = instrument_pose(time);
    let [x, y, z, w] = rotation.map(f64::from);
    let axis = [x, y, z];
    let turned = cross(axis, advance(cross(axis, at), w, at));
    advance(advance(at, 2.0, turned), 1.0, point(translation))
}

/// The axis of the instrument. Its lower end is the center of the tip.
fn axis(time: f64) -> [Point; 2] {
    let half = f64::from(INSTRUMENT_HALF_LENGTH);
    [posed(time, [0.0, -half, 0.0]), posed(time, [0.0, half, 0.0])]
}

#[test]
fn instrument_is_the_capsule_of_its_constants() {
    let mesh = instrument();
    assert_closed(&mesh, "instrument");
    let half = f64::from(INSTRUMENT_HALF_LENGTH);
    for &position in &mesh.positions {
        let distance = point_segment(point(position), [[0.0, -half, 0.0], [0.0, half, 0.0]]);
        assert!((distance - f64::from(INSTRUMENT_RADIUS)).abs() < 1e-7);
    }
}

/// The flat triangles of a 5 mm mesh are up to 0.1 mm below the surface that the instrument follows.
#[test]
fn instrument_comes_down_presses_slides_and_lifts() {
    const SAGITTA: f64 = 2e-4;
    let organ = organ(4);
    let gap = |time: f64| {
        let axis = axis(time);
        assert!(winding(&organ, axis[0]).abs() < 1e-6, "the center of the tip is inside the organ at {time} s");
        segment_mesh(axis, &organ) - f64::from(INSTRUMENT_RADIUS)
    };
    for time in [-1.0, 0.0, INSTRUMENT_END, INSTRUMENT_END + 1.0] {
        assert!((gap(time) - INSTRUMENT_CLEARANCE).abs() < SAGITTA, "{} at {time} s", gap(time));
    }
    for step in 0..=46 {
        let time = INSTRUMENT_SLIDE_START + (INSTRUMENT_SLIDE_END - INSTRUMENT_SLIDE_START) * f64::from(step) / 46.0;
        assert!((gap(time) + INSTRUMENT_DEPTH).abs() < SAGITTA, "{} at {time} s", gap(time));
    }
    for (start, end) in [(0.0, INSTRUMENT_SLIDE_START), (INSTRUMENT_END, INSTRUMENT_SLIDE_END)] {
        let gaps: Vec<f64> = (0..=10).map(|step| gap(start + (end - start) * f64::from(step) / 10.0)).collect();
        assert!(gaps.is_sorted_by(|a, b| a > b), "{gaps:?}");
    }
}

#[test]
fn instrument_slides_for_two_seconds_at_five_centimetres_a_second() {
    let tip = |time: f64| axis(time)[0];
    let speed = |time: f64| length(subtract(tip(time + 1e-3), tip(time - 1e-3))) / 2e-3;
    let steady = [INSTRUMENT_SLIDE_START + 0.25, INSTRUMENT_SLIDE_END - 0.25];
    for step in 0..=90 {
        let time = steady[0] + (steady[1] - steady[0]) * f64::from(step) / 90.0;
        assert!((0.04..0.06).contains(&speed(time)), "{} m/s at {time} s", speed(time));
    }
    let seconds = INSTRUMENT_SLIDE_END - INSTRUMENT_SLIDE_START;
    assert!((1.9..2.5).contains(&seconds), "{seconds}");
    let way = subtract(tip(INSTRUMENT_SLIDE_END), tip(INSTRUMENT_SLIDE_START));
    assert!(way[0] > 0.08 && way[2].abs() < 0.02, "{way:?}");
}

/// The downward motion is a polynomial of degree 5: at most 1.875 times its mean speed, and 5.78 times its mean
/// acceleration.
#[test]
fn instrument_moves_without_a_jump_of_place_or_speed() {
    const TICK: f64 = 1e-3;
    // Coordinates of up to 0.25 m are rounded by 1.5e-8 m, and a pose adds up a few of them.
    const NOISE: f64 = 1e-7;
    let way = INSTRUMENT_CLEARANCE + INSTRUMENT_DEPTH;
    for end in 0..2 {
        let ticks = (INSTRUMENT_END / TICK) as i32 + 200;
        let places: Vec<Point> = (-200..ticks).map(|tick| axis(f64::from(tick) * TICK)[end]).collect();
        for around in places.windows(3) {
            let [before, after] = [subtract(around[1], around[0]), subtract(around[2], around[1])];
            assert!(length(before) < 1.2 * 1.875 * way * TICK + NOISE, "{before:?} in a tick");
            assert!(length(subtract(after, before)) < 1.2 * 5.78 * way * TICK * TICK + 4.0 * NOISE);
        }
    }
    for tick in -10..60 {
        let rotation = instrument_pose(0.1 * f64::from(tick)).1.map(f64::from);
        let norm = rotation.iter().map(|part| part * part).sum::<f64>();
        assert!((norm - 1.0).abs() < 1e-6 && rotation[3] > 0.9, "{rotation:?}");
    }
}
