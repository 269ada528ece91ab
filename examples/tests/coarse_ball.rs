//! What the example tells its readers: a smooth coarse ball is closer to the ball than a flat one.

use std::process::Command;

use circumsphere_support::programs::example_program;

#[test]
fn the_smooth_ball_is_several_times_closer_to_the_ball() {
    let output = Command::new(example_program("coarse_ball")).output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let table = String::from_utf8(output.stdout).expect("the table is text");
    let last = table.lines().last().expect("the table has rows");
    let numbers: Vec<f64> =
        last.split_whitespace().skip(1).map(|cell| cell.trim_end_matches('°').parse().expect("a number")).collect();
    let [distance, angle, smooth_distance, smooth_angle] = numbers[..] else { panic!("{last}") };
    assert!(last.starts_with("mean") && distance > 0.03 && angle > 3.0, "{last}");
    assert!(smooth_distance < 0.2 * distance && smooth_angle < 0.3 * angle, "{last}");
    assert_eq!(table.lines().filter(|line| line.contains('°')).count(), 61, "60 ticks and their mean");
}

#[test]
fn a_box_with_narrow_rounded_edges_is_said_not_to_fit() {
    let output = Command::new(example_program("coarse_ball")).arg("--unfit").output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let told = String::from_utf8(output.stdout).expect("it is text");
    assert_eq!(told.lines().filter(|line| line.contains("unevenness 0.97")).count(), 2, "{told}");
}
