//! Contacts of a triangle with a cylinder or a cone, rounded or not.
//!
//! The signed distance of a convex solid is convex. Along an edge, its minimum is where its slope changes sign. Over the
//! inside of a face, it is at the point of the solid that extends farthest toward the face's plane. Where the solid is flat
//! along an edge or a face, both ends of the flat stretch and several points of a rim are reported, so that bodies can rest
//! on it.

use glam::DVec3;

use super::{
    SUPPORT_SLACK, ShapeProximity,
    frustum::{Foot, Frustum, Part, Support},
};
use crate::kernel::mesh::{
    barycentric::{corner_weights, edge_weights},
    feature::Feature,
    smooth_normal::NormalCone,
};

/// A feature number is the number of a part, plus this times the index of a place on it that an edge or a face may
/// touch.
const PARTS: u32 = 8;
/// All feature numbers are below this.
pub(super) const FRUSTUM_FEATURES: u32 = 64;
/// The whole solid, for a face that cuts through it.
const THROUGH: u32 = 5;
/// Place indices of the ends of a stretch along which an edge lies flat.
const FIRST_END: u32 = 1;
const SECOND_END: u32 = 2;
/// Place indices of further rim points that are reported for a face come after this.
const RIM_PLACES: u32 = 2;

/// A position along an edge, 0 to 1, this close to an end is at the end.
const AT_END: f64 = 1.0e-9;
/// How closely a place between 0 and 1 is searched for.
const RESOLUTION: f64 = 6.0e-14;
/// Bisection steps that shrink an interval of length 1 to that.
const HALVINGS: usize = 44;
/// An edge lies flat if its slope stays within [`SUPPORT_SLACK`] for longer than this share of the solid's size. On the
/// round mantle it does so by itself for half that length.
const FLAT_STRETCH: f64 = 4.0 * SUPPORT_SLACK;
/// A minimum this close to the end of a flat stretch, relative to its length, is that end.
const SAME_PLACE: f64 = 0.05;
/// A contact of an edge counts if the face beside it falls toward the solid by no more than this sine. Otherwise the
/// face touches farther in.
const FACING: f64 = 0.1;
/// If the normal at an edge inside the solid leans along the edge by more than this cosine, moving along it would not
/// separate them.
const LEANING: f64 = 0.3;
/// The way out for a face counts up to this many times that for its edges and corners inside. If the face lies flat on
/// a part, the two are equal except for rounding.
const SHORTER_WAY: f64 = 1.01;
/// Distinguishes the two ends of an edge, in whichever order its triangle names them. Not along an axis or a diagonal,
/// where the result would change with every rounding.
const OBLIQUE: DVec3 = DVec3::new(0.8137, 0.1291, 0.5667);
/// Cosine and sine of π/16.
const STEP: [f64; 2] = [0.980_785_280_403_230_4, 0.195_090_322_016_128_27];
const STEPS: usize = 32;

impl Frustum {
    /// The mantle has the curvature of its radius, a rim that of the border.
    pub(super) fn normal_cone(&self, number: u32, outward: DVec3) -> NormalCone {
        let curvature = if number == Part::Mantle.number() {
            (self.bottom_radius() + self.border()).recip()
        } else if Part::is_number_smooth(number) {
            0.0
        } else {
            self.border().recip()
        };
        NormalCone::single(outward, curvature)
    }

    pub(super) fn examine(&self, triangle: &[DVec3; 3], range: f64, found: &mut Vec<ShapeProximity>) {
        let reach = self.half_extents() + range;
        let low = triangle[0].min(triangle[1]).min(triangle[2]);
        let high = triangle[0].max(triangle[1]).max(triangle[2]);
        if low.cmpgt(reach).any() || high.cmplt(-reach).any() {
            return;
        }
        let before = found.len();
        let feet = triangle.map(|corner| self.foot(corner));
        for vertex in 0..3 {
            examine_vertex(triangle, vertex, &feet[vertex], range, found);
        }
        for edge in 0..3 {
            self.examine_edge(triangle, edge, &feet, range, found);
        }
        let deepest = found[before..].iter().map(|proximity| proximity.distance).fold(0.0, f64::min);
        self.examine_face(triangle, deepest, range, found);
    }

    fn examine_edge(
        &self,
        triangle: &[DVec3; 3],
        edge: usize,
        feet: &[Foot; 3],
        range: f64,
        found: &mut Vec<ShapeProximity>,
    ) {
        let next = (edge + 1) % 3;
        let start = triangle[edge];
        let way = triangle[next] - start;
        let length = way.length();
        // The distance changes by no more than the length traveled.
        if length == 0.0 || 0.5 * (feet[edge].distance + feet[next].distance - length) > range {
            return;
        }
        let slope_at = |along: f64| self.foot(start + way * along).normal.dot(way);
        let ends = [feet[edge].normal.dot(way), feet[next].normal.dot(way)];
        // A convex function is above its tangents.
        let meeting = (ends[1] + feet[edge].distance - feet[next].distance) / (ends[1] - ends[0]);
        if ends[0] < 0.0 && ends[1] > 0.0 && feet[edge].distance + ends[0] * meeting > range {
            return;
        }
        let reaches = |slope: f64| {
            if ends[0] >= slope {
                [0.0; 2]
            } else if ends[1] < slope {
                [1.0; 2]
            } else {
                bracket(|along| slope_at(along) - slope, ends.map(|end| end - slope))
            }
        };
        let lowest = reaches(0.0);
        let interior = |along: f64| along > AT_END && along < 1.0 - AT_END;
        let least = self.foot(start + way * lowest[1]).distance;
        if least > range {
            return;
        }
        let slack = SUPPORT_SLACK * length;
        let (first, last) = (reaches(-slack)[1], reaches(slack)[0]);
        let add = |along: [f64; 2], place: u32, found: &mut Vec<ShapeProximity>, part: Option<Part>| {
            if interior(along[1]) {
                found.extend(self.edge_contact(triangle, edge, feet, along, (part, place), range));
            }
        };
        let stretch = last - first;
        if stretch * length <= FLAT_STRETCH * (self.size() + least.max(0.0)) {
            add(lowest, 0, found, None);
            return;
        }
        let near = |end: f64| (lowest[1] - end).abs() <= SAME_PLACE * stretch && interior(end);
        let (at_first, at_last) = (near(first), near(last));
        let part = Some(self.foot(start + way * (0.5 * (first + last))).part);
        let places = if way.dot(OBLIQUE) < 0.0 { [SECOND_END, FIRST_END] } else { [FIRST_END, SECOND_END] };
        add(if at_first { lowest } else { [first; 2] }, places[0], found, part);
        add(if at_last { lowest } else { [last; 2] }, places[1], found, part);
        let distance_at = |along: f64| self.foot(start + way * along).distance;
        if !at_first && !at_last && least < distance_at(first).min(distance_at(last)) {
            add(lowest, 0, found, None);
        }
    }

    /// `along` contains two places close to each other, one on each side of the contact. Without `part`, the contact
    /// is named after its own part.
    fn edge_contact(
        &self,
        triangle: &[DVec3; 3],
        edge: usize,
        feet: &[Foot; 3],
        along: [f64; 2],
        (part, place): (Option<Part>, u32),
        range: f64,
    ) -> Option<ShapeProximity> {
        let next = (edge + 1) % 3;
        let (start, way) = (triangle[edge], triangle[next] - triangle[edge]);
        let lean = |foot: &Foot| foot.normal.dot(way).abs();
        let sides = along.map(|along| (along, self.foot(start + way * along)));
        // Inside, where two parts are equally close, prefers the part beside the edge.
        let (along, foot) = if lean(&sides[0].1) < lean(&sides[1].1) { sides[0] } else { sides[1] };
        if foot.distance > range {
            return None;
        }
        let inward = triangle[(edge + 2) % 3] - start;
        let inward = inward - way * (inward.dot(way) / way.length_squared());
        if foot.distance > 0.0 && foot.normal.dot(inward) < -FACING * inward.length() {
            return None;
        }
        let number = part.unwrap_or(foot.part).number() + PARTS * place;
        let pierces = feet[edge].distance > 0.0 && feet[next].distance > 0.0 && foot.distance < 0.0;
        if pierces
            && lean(&foot) > LEANING * way.length()
            && let Some((along, out)) = self.way_out_of_edge(start, way, foot.part)
        {
            let weights = edge_weights(edge, along);
            return Some(contact(Feature::Edge(edge as u8), weights, start + way * along, &out, number));
        }
        Some(contact(Feature::Edge(edge as u8), edge_weights(edge, along), start + way * along, &foot, number))
    }

    /// The shortest translation perpendicular to an edge that moves its whole line out of the solid, and the place on
    /// the edge that touches then. `None` if that is beyond the ends.
    fn way_out_of_edge(&self, start: DVec3, way: DVec3, part: Part) -> Option<(f64, Foot)> {
        let axis = way.try_normalize()?;
        let first = axis.any_orthonormal_vector();
        let second = axis.cross(first);
        let depth = |direction: DVec3| direction.dot(self.support(direction).point - start);
        let mut turn = [1.0, 0.0];
        let mut directions = [DVec3::ZERO; STEPS];
        for direction in &mut directions {
            *direction = first * turn[0] + second * turn[1];
            turn = [turn[0] * STEP[0] - turn[1] * STEP[1], turn[0] * STEP[1] + turn[1] * STEP[0]];
        }
        let best = (0..STEPS).min_by(|&one, &other| depth(directions[one]).total_cmp(&depth(directions[other])))?;
        // The derivative of the depth as the direction turns: the sideways position of the support point.
        let aside = |direction: DVec3| {
            let to_support = self.support(direction).point - start;
            (to_support.dot(axis.cross(direction)), to_support)
        };
        let (mut low, mut high) = (directions[(best + STEPS - 1) % STEPS], directions[(best + 1) % STEPS]);
        for _ in 0..HALVINGS {
            let middle = (low + high).try_normalize()?;
            if aside(middle).0 < 0.0 { low = middle } else { high = middle }
        }
        let direction = (low + high).try_normalize()?;
        let ((before, to_low), (after, to_high)) = (aside(low), aside(high));
        // Either end of a flat part may be the farthest. What lies between them over the edge is on the part as well.
        let share = if after > before { (-before / (after - before)).clamp(0.0, 1.0) } else { 0.0 };
        let to_support = to_low.lerp(to_high, share);
        let along = to_support.dot(way) / way.length_squared();
        let is_within = along > AT_END && along < 1.0 - AT_END;
        is_within.then(|| (along, Foot { distance: -direction.dot(to_support), normal: direction, part }))
    }

    /// `deepest` is how far the triangle's boundary extends into the solid, at most 0.
    fn examine_face(&self, triangle: &[DVec3; 3], deepest: f64, range: f64, found: &mut Vec<ShapeProximity>) {
        let edges = [0, 1, 2].map(|k| triangle[(k + 1) % 3] - triangle[k]);
        let Some(upward) = edges[0].cross(-edges[2]).try_normalize() else { return };
        let origin = triangle[0];
        let lengths = edges.map(DVec3::length_squared);
        let longest = (0..3).max_by(|&one, &other| lengths[one].total_cmp(&lengths[other])).unwrap_or_default();
        let weights = |point: DVec3| {
            let areas = [0, 1, 2].map(|k| upward.dot(edges[k].cross(point - triangle[k])));
            let sum = areas[0] + areas[1] + areas[2];
            if !areas.iter().all(|area| *area > 0.0) {
                return None;
            }
            // For a sliver, areas say little about where along it the point is. The longest edge does.
            let (start, end, apex) = (longest, (longest + 1) % 3, (longest + 2) % 3);
            let share = areas[longest] / sum;
            let aside = (triangle[apex] - triangle[start]) * share;
            let along = (point - triangle[start] - aside).dot(edges[longest]) / lengths[longest];
            let along = along.clamp(0.0, 1.0 - share);
            let mut weights = [0.0; 3];
            (weights[start], weights[end], weights[apex]) = (1.0 - share - along, along, share);
            Some(weights)
        };
        let sides = [upward, -upward].map(|direction| {
            let support = self.support(direction);
            (direction, support, direction.dot(origin - support.point))
        });
        let [above, below] = &sides;
        // The side on which less of the solid is beyond the plane.
        let &(direction, support, gap) = if above.2 >= below.2 { above } else { below };
        if gap > range {
            return;
        }
        if gap < 0.0 {
            let inside = deepest < 0.0;
            // The way out for the whole face is longer than that for its edges and corners inside.
            if inside && gap < deepest * SHORTER_WAY {
                return;
            }
            let share = above.2 / (above.2 + below.2);
            let between = above.1.point.lerp(below.1.point, share);
            let middle = weights(between);
            if !inside && middle.is_none() {
                return;
            }
            if !inside && weights(support.point).is_none() {
                found.extend(middle.map(|weights| self.out_of_middle(weights, between, &sides)));
            }
        }
        self.rest_on_face(direction, support, gap, range, weights, found);
    }

    fn rest_on_face(
        &self,
        direction: DVec3,
        support: Support,
        gap: f64,
        range: f64,
        weights: impl Fn(DVec3) -> Option<[f64; 3]>,
        found: &mut Vec<ShapeProximity>,
    ) {
        let mut add = |point: DVec3, gap: f64, number: u32| {
            if let Some(weights) = weights(point) {
                found.push(ShapeProximity {
                    feature: Feature::Face,
                    shape_feature: number,
                    crossing: false,
                    barycentric: weights,
                    shape_point: point,
                    normal: direction,
                    distance: gap,
                });
            }
        };
        add(support.point, gap, support.part.number());
        for (core, part, place) in self.rim_points(direction) {
            let point = core + direction * self.border();
            let lower = direction.dot(support.point - point);
            let is_support = place == 0 && part == support.part;
            if is_support || lower > SUPPORT_SLACK * self.size() || gap + lower > range {
                continue;
            }
            let place = if place == 0 { 0 } else { RIM_PLACES + place };
            add(point, gap + lower, part.number() + PARTS * place);
        }
    }

    /// For a face that cuts through the solid with nothing of its boundary inside, and that does not cover the place
    /// where the solid ends: straight out from the middle of the cut, to the nearer side.
    fn out_of_middle(&self, weights: [f64; 3], middle: DVec3, sides: &[(DVec3, Support, f64); 2]) -> ShapeProximity {
        let out = |&(direction, _, gap): &(DVec3, Support, f64)| {
            let farthest = -gap;
            let distance_at = |along: f64| self.foot(middle + direction * (farthest * along)).distance;
            let [inside, _] = bracket(distance_at, [0.0, 1.0].map(distance_at));
            (direction, farthest * inside)
        };
        let (above, below) = (out(&sides[0]), out(&sides[1]));
        let (direction, depth) = if above.1 <= below.1 { above } else { below };
        ShapeProximity {
            feature: Feature::Face,
            shape_feature: THROUGH,
            crossing: false,
            barycentric: weights,
            shape_point: middle + direction * depth,
            normal: direction,
            distance: -depth,
        }
    }
}

fn examine_vertex(triangle: &[DVec3; 3], vertex: usize, foot: &Foot, range: f64, found: &mut Vec<ShapeProximity>) {
    if foot.distance > range {
        return;
    }
    let position = triangle[vertex];
    let rises = |to: usize| {
        let edge = triangle[to % 3] - position;
        foot.normal.dot(edge) >= -SUPPORT_SLACK * edge.length()
    };
    // A corner of the triangle and a rim are in contact only if these two points are the closest ones.
    if foot.distance <= 0.0 || foot.part.is_smooth() || rises(vertex + 1) && rises(vertex + 2) {
        found.push(contact(Feature::Vertex(vertex as u8), corner_weights(vertex), position, foot, foot.part.number()));
    }
}

/// Two places from 0 to 1, within [`RESOLUTION`] of each other, between which a function that does not decrease stops being
/// below zero. Its values at 0, below zero, and at 1, not below zero, are given.
///
/// Interpolates where that converges faster than bisection, and takes hardly more steps where it does not (I. Oliveira
/// and R. Takahashi 2020, "An enhancement of the bisection method average performance preserving minmax optimality").
fn bracket(function: impl Fn(f64) -> f64, [mut below, mut above]: [f64; 2]) -> [f64; 2] {
    let (mut before, mut past) = (0.0, 1.0);
    // Twice the width that bisection would have reached by now.
    let mut width = 2.0;
    // Bisection, and one more step.
    for _ in 0..=HALVINGS {
        let middle = 0.5 * (before + past);
        let straight = ((before * above - past * below) / (above - below)).clamp(before, past);
        let to_middle = middle - straight;
        // A little toward the middle and past the root, so that both sides come closer.
        let shift = (0.2 * (past - before).powi(2)).max(0.5 * RESOLUTION);
        let place = if to_middle.abs() > shift { straight + shift.copysign(to_middle) } else { middle };
        let room = 0.5 * (width - (past - before));
        let place = if (place - middle).abs() <= room { place } else { middle - room.copysign(to_middle) };
        let value = function(place);
        if value < 0.0 {
            (before, below) = (place, value);
        } else {
            (past, above) = (place, value);
        }
        if past - before <= RESOLUTION {
            break;
        }
        width *= 0.5;
    }
    [before, past]
}

fn contact(feature: Feature, weights: [f64; 3], point: DVec3, foot: &Foot, number: u32) -> ShapeProximity {
    ShapeProximity {
        feature,
        shape_feature: number,
        crossing: false,
        barycentric: weights,
        shape_point: point - foot.normal * foot.distance,
        normal: foot.normal,
        distance: foot.distance,
    }
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;

    use super::*;

    #[test]
    fn a_change_of_sign_is_found_in_few_steps_where_the_function_is_smooth_and_in_no_more_than_by_halves() {
        type Function = fn(f64, f64) -> f64;
        let functions: [(Function, usize); 5] = [
            (|along, root| along - root, 12),
            (|along, root| (along - root) / (1.0 + (along - root).powi(2)).sqrt(), 12),
            (|along, root| (along - root) + 0.5 * (along.powi(3) - root.powi(3)), 12),
            // As where an edge passes a rim, and beside a cap on which it lies flat.
            (|along, root| if along < root { -1.0 } else { 1.0e-3 }, HALVINGS + 1),
            (|along, root| if along < root { -1.0e-9 } else { (along - root).sqrt() }, HALVINGS + 1),
        ];
        for (function, most) in functions {
            for root in [1.0e-12, 1.0e-3, 0.31, 0.5, 0.8, 1.0 - 1.0e-9] {
                let steps = Cell::new(0);
                let counted = |along: f64| {
                    steps.set(steps.get() + 1);
                    function(along, root)
                };
                let [before, past] = bracket(counted, [function(0.0, root), function(1.0, root)]);
                assert!(before < past && past - before <= RESOLUTION, "{root}: {before} to {past}");
                assert!(function(before, root) < 0.0 && function(past, root) >= 0.0, "{root}: {before} to {past}");
                assert!(steps.get() <= most, "{root}: {}", steps.get());
            }
        }
    }
}
