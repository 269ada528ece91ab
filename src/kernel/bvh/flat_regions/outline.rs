//! A contour as seen along an axis.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec2Swizzles, Vec3};

use super::contour::Contour;

/// Buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct Outline {
    points: Vec<DVec2>,
    sides: Vec<Side>,
}

/// A side of a polygon.
#[derive(Clone, Copy, Debug)]
struct Side {
    min: DVec2,
    max: DVec2,
    ends: [u32; 2],
}

impl Outline {
    /// Whether a contour, seen against `axis`, a unit vector, winds at most once around every point, and each of its
    /// vertices is farther than `range` from all sides that do not end there.
    pub(super) fn is_clear(&mut self, contour: &Contour, positions: &[Vec3], axis: DVec3, range: f64) -> bool {
        let Some(&first) = contour.vertices.first() else { return false };
        let origin = positions[first as usize].as_dvec3();
        let across = axis.any_orthonormal_vector();
        let up = axis.cross(across);
        let Self { points, sides } = self;
        points.clear();
        points.extend(contour.vertices.iter().map(|&vertex| {
            let place = positions[vertex as usize].as_dvec3() - origin;
            DVec2::new(place.dot(across), place.dot(up))
        }));
        sides.clear();
        for polygon in polygons(contour) {
            for place in polygon.clone() {
                let next = if place + 1 == polygon.end { polygon.start } else { place + 1 };
                let (a, b) = (points[place], points[next]);
                sides.push(Side { min: a.min(b), max: a.max(b), ends: [place, next].map(|place| place as u32) });
            }
        }
        self.winds_once(contour) && self.sides_are_apart(range)
    }

    /// Whether polygons that do not cross or touch wind at most once around every point, and never clockwise.
    fn winds_once(&self, contour: &Contour) -> bool {
        polygons(contour).all(|polygon| {
            let ends = |side: &Side| side.ends.map(|place| self.points[place as usize]);
            let twice_area: f64 = self.sides[polygon.clone()].iter().map(ends).map(|[a, b]| a.perp_dot(b)).sum();
            let [a, b] = ends(&self.sides[polygon.start]);
            let middle = (a + b) * 0.5;
            let others = self.sides[..polygon.start].iter().chain(&self.sides[polygon.end..]);
            let winding: i32 = others
                .map(|side| {
                    let [a, b] = ends(side).map(|end| end - middle);
                    match [a.y > 0.0, b.y > 0.0] {
                        [false, true] if a.perp_dot(b) > 0.0 => 1,
                        [true, false] if a.perp_dot(b) < 0.0 => -1,
                        _ => 0,
                    }
                })
                .sum();
            // A clockwise polygon is a hole in what winds around it.
            winding == i32::from(twice_area < 0.0)
        })
    }

    /// Whether no two sides cross, and no end of one is within `range` of the other, unless they share it.
    fn sides_are_apart(&mut self, range: f64) -> bool {
        let Self { points, sides } = self;
        let around = |(min, max): (DVec2, DVec2), side: &Side| (min.min(side.min), max.max(side.max));
        let (min, max) = sides.iter().fold((DVec2::INFINITY, DVec2::NEG_INFINITY), around);
        let size = max - min;
        if size.y > size.x {
            for Side { min, max, .. } in &mut *sides {
                (*min, *max) = (min.yx(), max.yx());
            }
        }
        sides.sort_unstable_by(|a, b| a.min.x.total_cmp(&b.min.x));
        sides.iter().enumerate().all(|(place, side)| {
            let reaching = sides[place + 1..].iter().take_while(|later| later.min.x <= side.max.x + range);
            reaching.into_iter().all(|other| {
                other.min.y > side.max.y + range
                    || side.min.y > other.max.y + range
                    || are_apart(points, [side.ends, other.ends], range)
            })
        })
    }
}

/// The vertices of each polygon, and its sides.
fn polygons(contour: &Contour) -> impl Iterator<Item = Range<usize>> {
    contour.ends.iter().scan(0, |start, &end| Some(std::mem::replace(start, end as usize)..end as usize))
}

/// Whether two sides do not cross, and no end of one is within `range` of the other, unless they share it.
fn are_apart(points: &[DVec2], [first, second]: [[u32; 2]; 2], range: f64) -> bool {
    let segment = |side: [u32; 2]| side.map(|place| points[place as usize]);
    let is_far = |end: u32, side: [u32; 2]| {
        let ([from, to], point) = (segment(side), points[end as usize]);
        let share = ((point - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
        point.distance_squared(from.lerp(to, share)) > range * range
    };
    let is_end_far = |end: u32, side: [u32; 2]| side.contains(&end) || is_far(end, side);
    if !first.iter().all(|&end| is_end_far(end, second)) || !second.iter().all(|&end| is_end_far(end, first)) {
        return false;
    }
    let is_left = |[from, to]: [DVec2; 2], point: DVec2| (to - from).perp_dot(point - from) > 0.0;
    let parts = |side: [u32; 2], other: [u32; 2]| {
        let ([a, b], line) = (segment(other), segment(side));
        is_left(line, a) != is_left(line, b)
    };
    first.iter().any(|end| second.contains(end)) || !(parts(first, second) && parts(second, first))
}
