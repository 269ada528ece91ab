//! First contact of two moving balls: a lower bound of the first impact of what they contain.
//!
//! For who has balls about what moves, as those of triangles. A ball whose center and radius run in straight lines from
//! those at the start of a step to those at its end contains, at every time between, what moves in straight lines and lies
//! in the ball at both ends: a distance from a center that moves in a straight line is a convex function of time.

use crate::kernel::circumsphere::Ball;

/// Lengths are taken longer by this share of the largest length involved. What the formulas below round is below 1e-14
/// of it.
const ROUNDING_SLACK: f64 = 1.0e-12;

/// A ball whose center and radius run in straight lines from the start of a step to its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingBall {
    /// When the step begins.
    pub start: Ball,
    /// When it ends.
    pub end: Ball,
}

/// A time in 0 to 1 before which two moving balls stay farther than `separation` apart; `None` if they do so throughout.
///
/// With the difference `x + t v` of the centers and the sum `r + t g` of the radii (the separation included) the time
/// is the first root of `(|v|² − g²) t² + 2 (x·v − r g) t + |x|² − r²`. The discriminant is evaluated as
/// `|r v − g x|² − |x × v|²`, to which it is equal, because differences of squares lose the digits that matter for
/// balls that are small compared with their way.
#[must_use]
pub fn first_impact_of_balls(a: &MovingBall, b: &MovingBall, separation: f64) -> Option<f64> {
    let center = |ball: &Ball| ball.center.as_dvec3();
    let radius = |a: &Ball, b: &Ball| f64::from(a.radius) + f64::from(b.radius) + separation;
    let offset = center(&b.start) - center(&a.start);
    let velocity = (center(&b.end) - center(&a.end)) - offset;
    let (first, last) = (radius(&a.start, &b.start), radius(&a.end, &b.end));
    let slack = ROUNDING_SLACK * (offset.length() + velocity.length() + first + last);
    let (reach, growth) = (first + slack, last - first);

    let constant = offset.length_squared() - reach * reach;
    if constant <= 0.0 {
        return Some(0.0);
    }
    let half_linear = offset.dot(velocity) - reach * growth;
    let discriminant = (velocity * reach - offset * growth).length_squared() - offset.cross(velocity).length_squared();
    if discriminant < 0.0 {
        return None;
    }
    let denominator = discriminant.sqrt() - half_linear;
    if denominator <= 0.0 {
        return None;
    }
    let time = constant / denominator * (1.0 - ROUNDING_SLACK);
    (time <= 1.0).then_some(time)
}

/// Appends those of `pairs` whose balls may come within `separation` of each other during the step, each with the time
/// before which they surely do not.
pub fn swept_ball_pairs(
    a: [&[Ball]; 2],
    b: [&[Ball]; 2],
    pairs: &[[u32; 2]],
    separation: f64,
    found: &mut Vec<([u32; 2], f64)>,
) {
    let moving =
        |balls: [&[Ball]; 2], ball: u32| MovingBall { start: balls[0][ball as usize], end: balls[1][ball as usize] };
    found.extend(pairs.iter().filter_map(|&[first, second]| {
        let time = first_impact_of_balls(&moving(a, first), &moving(b, second), separation)?;
        Some(([first, second], time))
    }));
}
