//! First times of impact of features and triangles with linearly moving corners, bounded by certificates in f64.
//!
//! *Apart:* a direction that turns linearly over a span of time separates all pairs of corners throughout. The gaps
//! along it are polynomials of degree 2, bounded by their Bernstein coefficients.
//!
//! *Met*, for a minimum separation above 0: the distance at one time.
//!
//! *Met* at 0: the volume of the features changes sign over a span in which, seen along a fixed direction, the vertex
//! stays inside the face or the edges keep crossing. When all four corners are coplanar during that span, the features
//! have a point in common.
//!
//! Spans are bisected, earlier half first, until one of these decides. Every comparison allows for the rounding of its
//! operands, so whatever rounding could change stays undecided. Exact signs decide what touches at the ends of the
//! motion.

use glam::DVec3;

use self::shape::{CORNERS, Closest, Corners, Shape};
use super::{triangle_crossing::side_of_plane, triangle_pair::power_of_two_within};

mod shape;

/// When two moving features or triangles first come within a distance of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImpactTruth {
    /// Never during the motion. This is certified.
    Never,
    /// For the first time, between `earliest` and `latest`. Both are certified. Both are 0 if the sides are within the
    /// distance at the start.
    First {
        /// A fraction of the motion, 0…1. At all earlier times, the distance is larger than the minimum separation.
        earliest: f64,
        /// A fraction of the motion, 0…1. At this time or earlier, the distance is at most the minimum separation.
        latest: f64,
    },
    /// Not before `earliest`, if at all. f64 cannot decide whether the closest approach is near enough.
    Undecided {
        /// The first time that is not certified to be apart.
        earliest: f64,
        /// The last time that is not certified to be apart.
        latest: f64,
        /// The least distance found, in the unit of the positions.
        closest: f64,
    },
}

/// Half a unit in the last place of numbers from 1 to 2: the relative error of one rounding.
const ROUNDING: f64 = f64::EPSILON * 0.5;

/// Error of a coordinate at one time, relative to the largest coordinate: one rounding for each of the two interpolated
/// local coordinates, the two weights, the two products, and their sum.
const POSITION_ERROR: f64 = 8.0 * ROUNDING;

/// Error of the gap between two corners along a direction, relative to the largest coordinate: the errors of both
/// corners (√3 times that of a coordinate), of their difference, and of a scalar product of three terms, for a unit
/// vector that may be 3 roundings too long and vectors of at most 2√3.
const GAP_ERROR: f64 = 2.0 * 1.74 * POSITION_ERROR + 2.0 * 1.74 * 8.0 * ROUNDING;

/// Error of a distance at one time, relative to the largest coordinate: the errors of both corners, and of the static
/// distance of the rounded corners (a dozen roundings of the pair's extent, which is at most twice the largest
/// coordinate).
const DISTANCE_ERROR: f64 = 2.0 * 1.74 * POSITION_ERROR + 2.0 * 16.0 * ROUNDING;

/// Error of the vector between two corners at one time, relative to the largest coordinate: √3 times the errors of two
/// coordinates and the rounding of a difference up to twice as large.
const DIFFERENCE_ERROR: f64 = 1.74 * (2.0 * POSITION_ERROR + 2.0 * ROUNDING);

/// Error of a product of three vectors, relative to the product of their lengths: 2√3 roundings for the cross product
/// and 3 for the scalar product of three terms.
const TRIPLE_PRODUCT_ERROR: f64 = 8.0 * ROUNDING;

/// Spans of this length are not bisected. It is well below the 1e-9 that times of impact usually need.
const SHORTEST_SPAN: f64 = 1.0 / (1u64 << 36) as f64;

/// Spans of this length are not bisected if rounding hides whether the distance midway exceeds the minimum separation.
/// A grazing approach stays within rounding for about 1e-7 of the motion.
const SHORT_SPAN: f64 = 1.0 / (1u64 << 24) as f64;

/// Number of undecided spans after which the rest of the motion counts as undecided, too. It stops the search where
/// sides slide along each other.
const MOST_UNDECIDED: usize = 512;

/// Number of spans tested before the rest of the motion counts as undecided, too. Sides that turn along each other
/// barely farther apart than rounding would need millions.
const MOST_SPANS: usize = 1 << 15;

/// First impact of a vertex (the first of the four points) and a face (the other three).
///
/// `start` holds the positions at time 0 and `end` those at time 1. They move linearly in between. An impact is a
/// distance of at most `minimum_separation` (0 or more, in the unit of the positions) between the vertex and the closed
/// triangle. Coordinates must be finite and in the range of
/// [`triangles_cross`](super::triangle_crossing::triangles_cross).
#[must_use]
pub fn vertex_face_impact(start: &[DVec3; 4], end: &[DVec3; 4], minimum_separation: f64) -> ImpactTruth {
    first_impact(Shape::VertexFace, &start[..1], &start[1..], &end[..1], &end[1..], minimum_separation)
}

/// First impact of two edges, from the first to the second point and from the third to the fourth. See
/// [`vertex_face_impact`].
#[must_use]
pub fn edge_edge_impact(start: &[DVec3; 4], end: &[DVec3; 4], minimum_separation: f64) -> ImpactTruth {
    first_impact(Shape::EdgeEdge, &start[..2], &start[2..], &end[..2], &end[2..], minimum_separation)
}

/// First impact of two closed triangles. See [`vertex_face_impact`]. Triangles that cross have distance 0.
#[must_use]
pub fn triangle_impact(
    start_a: &[DVec3; 3],
    end_a: &[DVec3; 3],
    start_b: &[DVec3; 3],
    end_b: &[DVec3; 3],
    minimum_separation: f64,
) -> ImpactTruth {
    first_impact(Shape::Triangles, start_a, start_b, end_a, end_b, minimum_separation)
}

/// A pair at one time.
#[derive(Clone)]
struct Moment {
    time: f64,
    corners: Corners,
    closest: Closest,
}

/// A pair in motion, relative to its first corner and scaled to coordinates of at most 2.
struct Motion {
    shape: Shape,
    /// The original corners at times 0 and 1.
    given: [Corners; 2],
    start: Corners,
    end: Corners,
    /// The minimum separation.
    reach: f64,
    /// The largest coordinate at either end, and so at any time.
    size: f64,
    /// An upper bound of the speed at which two points of different sides approach each other.
    speed: f64,
    /// The length of one local unit, in the caller's unit.
    unit: f64,
}

fn first_impact(
    shape: Shape,
    start_a: &[DVec3],
    start_b: &[DVec3],
    end_a: &[DVec3],
    end_b: &[DVec3],
    minimum_separation: f64,
) -> ImpactTruth {
    let gathered = |a: &[DVec3], b: &[DVec3]| {
        let mut corners = [DVec3::ZERO; CORNERS];
        corners[..a.len()].copy_from_slice(a);
        corners[a.len()..a.len() + b.len()].copy_from_slice(b);
        corners
    };
    let (start, end) = (gathered(start_a, start_b), gathered(end_a, end_b));
    if shape.touches(&start) {
        return ImpactTruth::First { earliest: 0.0, latest: 0.0 };
    }
    let motion = Motion::new(shape, &start, &end, minimum_separation);
    motion.search(shape.touches(&end))
}

impl Motion {
    fn new(shape: Shape, start: &Corners, end: &Corners, minimum_separation: f64) -> Self {
        let count = shape.corners();
        // Motion common to all corners does not change their relative positions. Differences of exact coordinates have
        // a small relative rounding.
        let (mut local_start, mut local_end) = (*start, *end);
        for corner in 0..count {
            local_start[corner] -= start[0];
            local_end[corner] -= end[0];
        }
        let largest =
            |corners: &Corners| corners[..count].iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
        let unit = power_of_two_within(largest(&local_start).max(largest(&local_end)));
        let given = [*start, *end];
        let (start, end) = (local_start.map(|corner| corner / unit), local_end.map(|corner| corner / unit));
        let mut speed = 0f64;
        for first in 0..shape.first_side() {
            for second in shape.first_side()..count {
                let relative = (end[second] - start[second]) - (end[first] - start[first]);
                speed = speed.max(relative.length());
            }
        }
        Self {
            shape,
            given,
            start,
            end,
            reach: minimum_separation / unit,
            size: largest(&start).max(largest(&end)),
            speed,
            unit,
        }
    }

    fn at(&self, time: f64) -> Moment {
        let mut corners = [DVec3::ZERO; CORNERS];
        for corner in 0..self.shape.corners() {
            corners[corner] = self.start[corner] * (1.0 - time) + self.end[corner] * time;
        }
        Moment { time, corners, closest: self.shape.closest(&corners) }
    }

    fn search(&self, touches_at_end: bool) -> ImpactTruth {
        let (start, end) = (self.at(0.0), self.at(1.0));
        if self.is_within(&start) {
            return ImpactTruth::First { earliest: 0.0, latest: 0.0 };
        }
        let mut latest = (touches_at_end || self.is_within(&end)).then_some(1.0);
        let mut closest = start.closest.distance.min(end.closest.distance);
        let mut undecided: Vec<[f64; 2]> = Vec::new();
        let (mut looked_at, mut left_undecided) = (0, 0);
        // Later spans are below earlier ones.
        let mut spans = vec![(start, end)];
        while let Some((early, late)) = spans.pop() {
            let (from, to) = (early.time, late.time);
            if latest.is_some_and(|latest| from >= latest) {
                break;
            }
            looked_at += 1;
            if looked_at > MOST_SPANS || left_undecided >= MOST_UNDECIDED {
                join(&mut undecided, [from, 1.0]);
                break;
            }
            if self.is_apart_throughout(&early, &late) {
                continue;
            }
            let middle = self.at(0.5 * (from + to));
            closest = closest.min(middle.closest.distance);
            if self.is_apart_midway(&early, &middle, &late) {
                continue;
            }
            if self.meets_between(&early, &late) {
                latest = Some(latest.map_or(to, |latest: f64| latest.min(to)));
            }
            // Once something is within reach, later spans do not matter.
            let within = self.is_within(&middle) || self.crosses_surely(&middle);
            if within {
                latest = Some(latest.map_or(middle.time, |latest: f64| latest.min(middle.time)));
            }
            let (span, rounding) = (to - from, GAP_ERROR * self.size);
            let may_be_grazing =
                !within && span <= SHORT_SPAN && (middle.closest.distance - self.reach).abs() <= rounding;
            if span <= SHORTEST_SPAN || may_be_grazing || self.speed * span <= rounding {
                left_undecided += 1;
                join(&mut undecided, [from, to]);
                continue;
            }
            if !within {
                spans.push((middle.clone(), late));
            }
            spans.push((early, middle));
        }
        let Some(&[earliest, _]) = undecided.first() else {
            return ImpactTruth::Never;
        };
        for &span in &undecided {
            if latest.is_none_or(|latest| span[1] < latest)
                && let Some(met) = self.meets_around(span)
            {
                latest = Some(latest.map_or(met, |latest| latest.min(met)));
                break;
            }
        }
        match latest {
            Some(latest) => ImpactTruth::First { earliest, latest },
            None => ImpactTruth::Undecided {
                earliest,
                latest: undecided.last().map_or(earliest, |span| span[1]),
                closest: closest * self.unit,
            },
        }
    }

    /// Whether the distance at a time is certainly at most the minimum separation.
    fn is_within(&self, moment: &Moment) -> bool {
        moment.closest.distance + DISTANCE_ERROR * self.size <= self.reach
    }

    /// Whether the sides certainly stay farther apart than the minimum separation between two times, using the best
    /// separating directions at both. These follow sides that turn.
    fn is_apart_throughout(&self, early: &Moment, late: &Moment) -> bool {
        let ([between, normal], [late_between, late_normal]) = (early.closest.directions(), late.closest.directions());
        self.is_apart(early, late, between, late_between) || self.is_apart(early, late, normal, late_normal)
    }

    /// The same with the best separating direction midway, for sides that pass close to each other.
    fn is_apart_midway(&self, early: &Moment, middle: &Moment, late: &Moment) -> bool {
        middle.closest.directions().into_iter().any(|direction| self.is_apart(early, late, direction, direction))
    }

    /// Whether a direction that turns from `first` to `last` separates the sides by more than the minimum separation at
    /// all times between two moments.
    ///
    /// Both are unit vectors, so their mean weighted by time is no longer than 1. Along it, the gap between two corners
    /// is a polynomial of degree 2, which is at least its least Bernstein coefficient.
    fn is_apart(&self, early: &Moment, late: &Moment, first: DVec3, last: DVec3) -> bool {
        let needed = self.reach * (1.0 + 8.0 * ROUNDING) + GAP_ERROR * self.size;
        let (first_side, count) = (self.shape.first_side(), self.shape.corners());
        (0..first_side).all(|one| {
            (first_side..count).all(|other| {
                let between = |moment: &Moment| moment.corners[other] - moment.corners[one];
                let (early, late) = (between(early), between(late));
                early.dot(first) > needed
                    && late.dot(last) > needed
                    && 0.5 * (early.dot(last) + late.dot(first)) > needed
            })
        })
    }

    /// Whether the sides certainly have a point in common at some time between two moments.
    fn meets_between(&self, early: &Moment, late: &Moment) -> bool {
        let passes = |corners: &[usize; 4]| {
            let (before, after) = (self.volume(early, *corners), self.volume(late, *corners));
            before != 0.0 && after == -before
        };
        let middle = |corner: usize| early.corners[corner] + late.corners[corner];
        let side = |view: DVec3, corners: [usize; 3]| self.side_throughout(early, late, view, corners);
        self.shape.vertex_faces().iter().any(|corners| {
            let [vertex, first, second, third] = *corners;
            let view = (middle(second) - middle(first)).cross(middle(third) - middle(first));
            let inside = |from: usize, to: usize| side(view, [from, to, vertex]);
            passes(corners) && inside(first, second) * inside(second, third) > 0.0 && {
                inside(first, second) * inside(third, first) > 0.0
            }
        }) || self.shape.edge_edges().iter().any(|corners| {
            let [from_a, to_a, from_b, to_b] = *corners;
            let view = (middle(to_a) - middle(from_a)).cross(middle(to_b) - middle(from_b));
            let splits = |from: usize, to: usize, one: usize, other: usize| {
                side(view, [from, to, one]) * side(view, [from, to, other]) < 0.0
            };
            passes(corners) && splits(from_a, to_a, from_b, to_b) && splits(from_b, to_b, from_a, to_a)
        })
    }

    /// A time by which the sides certainly meet, found by widening a span in which they may meet. `None` if they do
    /// not.
    fn meets_around(&self, [from, to]: [f64; 2]) -> Option<f64> {
        let mut more = to - from;
        while more < 1.0 {
            let late = self.at((to + more).min(1.0));
            if self.meets_between(&self.at((from - more).max(0.0)), &late) {
                return Some(late.time);
            }
            more *= 2.0;
        }
        None
    }

    /// The sign of the volume of the tetrahedron of four corners, or 0 if rounding may have decided it. Exact at the
    /// ends of the motion.
    fn volume(&self, moment: &Moment, [base, first, second, third]: [usize; 4]) -> f64 {
        if moment.time == 0.0 || moment.time == 1.0 {
            let given = &self.given[usize::from(moment.time == 1.0)];
            return f64::from(side_of_plane(&[given[base], given[second], given[first]], given[third]) as i8);
        }
        let edges = [first, second, third].map(|corner| moment.corners[corner] - moment.corners[base]);
        let error = DIFFERENCE_ERROR * self.size;
        certain_sign(triple_product(edges, [error; 3]))
    }

    /// The side on which the third corner passes the line from the first to the second, seen along `view`: the sign of
    /// a turn that is certain at all times from `early` to `late`, or 0.
    ///
    /// The turn is a polynomial of degree 2 in time, between its least and its largest Bernstein coefficient.
    fn side_throughout(&self, early: &Moment, late: &Moment, view: DVec3, [from, to, third]: [usize; 3]) -> f64 {
        let error = DIFFERENCE_ERROR * self.size;
        let along = |moment: &Moment| moment.corners[to] - moment.corners[from];
        let across = |moment: &Moment| moment.corners[third] - moment.corners[from];
        let turn =
            |one: &Moment, other: &Moment| triple_product([view, along(one), across(other)], [0.0, error, error]);
        let (first, last) = (certain_sign(turn(early, early)), certain_sign(turn(late, late)));
        let ((value, value_error), (other, other_error)) = (turn(early, late), turn(late, early));
        let sum = certain_sign((value + other, value_error + other_error + ROUNDING * (value + other).abs()));
        if first == last && first == sum { first } else { 0.0 }
    }

    /// Whether an edge of one triangle certainly passes through the inside of the other at a time.
    fn crosses_surely(&self, moment: &Moment) -> bool {
        self.shape.edge_faces().iter().any(|&([from, to], [first, second, third])| {
            let volume = |corners: [usize; 4]| self.volume(moment, corners);
            let passes = volume([from, first, second, third]) * volume([to, first, second, third]) < 0.0;
            let turns = [(first, second), (second, third), (third, first)]
                .map(|(one, other)| if passes { volume([from, to, one, other]) } else { 0.0 });
            turns[0] * turns[1] > 0.0 && turns[0] * turns[2] > 0.0
        })
    }
}

/// Appends a span. It is merged with the last one if it starts where that one ends.
fn join(spans: &mut Vec<[f64; 2]>, [from, to]: [f64; 2]) {
    match spans.last_mut() {
        Some(last) if last[1] >= from => last[1] = to,
        _ => spans.push([from, to]),
    }
}

/// The determinant of three vectors, and the bound of its error for given errors of the vectors.
fn triple_product([u, v, w]: [DVec3; 3], [error_u, error_v, error_w]: [f64; 3]) -> (f64, f64) {
    let (length_u, length_v, length_w) = (u.length() + error_u, v.length() + error_v, w.length() + error_w);
    let of_vectors = error_u * length_v * length_w + error_v * length_u * length_w + error_w * length_u * length_v;
    (u.dot(v.cross(w)), of_vectors * (1.0 + 16.0 * ROUNDING) + TRIPLE_PRODUCT_ERROR * length_u * length_v * length_w)
}

/// The sign, 1 or -1, or 0 if the value does not exceed its error.
fn certain_sign((value, error): (f64, f64)) -> f64 {
    if value.abs() > error { value.signum() } else { 0.0 }
}
