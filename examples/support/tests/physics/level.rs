//! The ground of the level and the objects that move on it.

use circumsphere_support::scenes::{
    LEVEL_CELLS, LEVEL_HALF_WIDTH, level_ball, level_ferry, level_ground, level_height, level_heights, level_lift,
};

use super::geometry::{corners, cross, length, point, subtract};

#[test]
fn both_halves_of_the_ground_have_one_height_at_their_border() {
    let ground = level_ground();
    let [columns, rows] = LEVEL_CELLS;
    let heights = level_heights();
    assert_eq!((heights.len(), heights[0].len()), (rows + 1, columns + 1));
    for (row, heights) in heights.iter().enumerate() {
        let [x, y, z] = ground.positions[row * (columns + 1) + columns];
        assert!(x.abs() < 1e-6 && (y - heights[0]).abs() < 1e-6, "{x} {y} {z} beside {}", heights[0]);
        assert_eq!(y, level_height(x, z));
    }
    let reach = ground.positions.iter().map(|at| at[0].abs().max(at[2].abs())).fold(0.0, f32::max);
    assert!((reach - LEVEL_HALF_WIDTH).abs() < 1e-6);
    // The ground faces up, and is nowhere steeper than 0.15 · (1.7 + 1.3).
    for [a, b, c] in corners(&ground) {
        let normal = cross(subtract(b, a), subtract(c, a));
        assert!(normal[1] / length(normal) > 0.9);
    }
}

#[test]
fn what_moves_on_the_level_moves_at_its_speed_and_above_the_ground() {
    const TICK: f64 = 1e-3;
    for tick in 0..4000 {
        let time = f64::from(tick) * TICK;
        let speed = |at: fn(f64) -> [f32; 3]| length(subtract(point(at(time + TICK)), point(at(time)))) / TICK;
        assert!(speed(level_lift) < 1.3 && speed(|time| level_ferry(time).0) < 1.6, "{time} s");
        assert!(speed(|time| level_ball(time, 30.0)) < 30.1);
        for at in [level_lift(time), level_ferry(time).0] {
            assert!(at[1] > 0.4);
        }
    }
    assert_eq!(level_ball(0.5, 30.0), [0.0, 1.3, -2.5]);
    assert_eq!(level_ball(2.0, 30.0), [0.0, 1.3, 2.5]);
}
