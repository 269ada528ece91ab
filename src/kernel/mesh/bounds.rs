//! Axis-aligned boxes of triangles at their current positions.
//!
//! Every box is grown by half the distance at which a pair matters, so that two triangles within that distance have
//! overlapping boxes. The boxes follow the triangles, never the offset spheres. Feeds the broad phase.

use glam::{Mat3A, Vec3, Vec3A};

use crate::kernel::{
    pose::Pose,
    simd::parallel::{Parallel, Sequential},
};

/// Boxes are also grown by this share of their largest coordinate, two units in the last place, so that f32 rounding of
/// their planes never loses a pair.
pub(in crate::kernel) const ROUNDING_GROWTH: f32 = 2.0 * f32::EPSILON;

/// Tasks have at least `LEAST_PART` triangles, whose boxes take as long as waking another thread. There are at most
/// `MOST_PARTS` tasks.
const LEAST_PART: usize = 65_536;
const MOST_PARTS: usize = 64;

/// An axis-aligned box. Empty if a minimum exceeds its maximum.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Aabb {
    /// Smallest coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Default for Aabb {
    /// The empty box.
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Aabb {
    /// The empty box: overlaps nothing, and is the neutral element of [`union`](Self::union).
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box around the points.
    #[must_use]
    pub fn from_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points
            .into_iter()
            .fold(Self::EMPTY, |bounds, point| Self { min: bounds.min.min(point), max: bounds.max.max(point) })
    }

    /// The smallest box around both boxes.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether the closed boxes share a point.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// The box with every side moved outward by `distance`, and by an allowance for rounding.
    #[must_use]
    pub fn grown(&self, distance: f32) -> Self {
        let (min, max) = grown(self.min.into(), self.max.into(), distance);
        Self { min: min.into(), max: max.into() }
    }

    /// What the box sweeps that begins or ends farther on by anything in `way`: the box in a frame that moves by as much
    /// relative to the one in which it was computed. Then grown by `distance`, with an allowance for rounding.
    #[inline]
    pub(in crate::kernel) fn moved_along(&self, way: &Self, distance: f32) -> Self {
        let (min, max) = (Vec3A::from(self.min), Vec3A::from(self.max));
        if min.cmpgt(max).any() {
            return Self::EMPTY;
        }
        let (min, max) = (min + Vec3A::from(way.min), max + Vec3A::from(way.max));
        // More than the rounding of a sum.
        let rounding = |sum: Vec3A| sum.abs() * f32::EPSILON;
        let (min, max) = grown(min - rounding(min), max + rounding(max), distance);
        Self { min: min.into(), max: max.into() }
    }

    /// Sum of the products of two side lengths: half the surface area.
    #[must_use]
    pub fn half_area(&self) -> f32 {
        let size = (self.max - self.min).max(Vec3::ZERO);
        size.x * size.y + size.y * size.z + size.z * size.x
    }
}

/// Writes the box of every triangle, grown by `growth`, into `bounds`, and returns the box around all of them. A box
/// with NaN is written, overlaps nothing, and is left out of the box around all.
pub fn triangle_bounds(positions: &[Vec3], triangles: &[[u32; 3]], growth: f32, bounds: &mut Vec<Aabb>) -> Aabb {
    triangle_bounds_on(&Sequential, positions, triangles, growth, bounds)
}

/// Like [`triangle_bounds`], in tasks that `parallel` may distribute.
pub fn triangle_bounds_on(
    parallel: &impl Parallel,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    growth: f32,
    bounds: &mut Vec<Aabb>,
) -> Aabb {
    bounds_on(parallel, positions, triangles, |_| growth, bounds)
}

/// Like [`triangle_bounds_on`], with a growth for each triangle.
pub(super) fn bounds_on(
    parallel: &impl Parallel,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    growth: impl Fn(usize) -> f32 + Sync,
    bounds: &mut Vec<Aabb>,
) -> Aabb {
    bounds.resize(triangles.len(), Aabb::EMPTY);
    let part = triangles.len().div_ceil(MOST_PARTS).max(LEAST_PART);
    let mut wholes = [(Vec3A::INFINITY, Vec3A::NEG_INFINITY); MOST_PARTS];
    let parts = triangles.chunks(part).zip(bounds.chunks_mut(part)).zip(&mut wholes).enumerate();
    parallel.run_tasks(parts, triangles.len() / LEAST_PART, |(number, ((triangles, bounds), (low, high)))| {
        for (triangle, (corners, bounds)) in (number * part..).zip(triangles.iter().zip(bounds)) {
            let [a, b, c] = corners.map(|vertex| Vec3A::from(positions[vertex as usize]));
            let (min, max) = grown(a.min(b).min(c), a.max(b).max(c), growth(triangle));
            *bounds = Aabb { min: min.into(), max: max.into() };
            if min.cmple(max).all() {
                (*low, *high) = (low.min(min), high.max(max));
            }
        }
    });
    wholes.iter().fold(Aabb::EMPTY, |all, &(low, high)| all.union(&Aabb { min: low.into(), max: high.into() }))
}

/// The box of the points, grown by `growth`. Contains the boxes of all triangles between the points, grown by the same.
#[must_use]
pub fn point_bounds(points: &[Vec3], growth: f32) -> Aabb {
    if points.is_empty() {
        return Aabb::EMPTY;
    }
    let (low, high) = points.iter().fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), &point| {
        let point = Vec3A::from(point);
        (low.min(point), high.max(point))
    });
    Aabb { min: low.into(), max: high.into() }.grown(growth)
}

/// Moves the sides of a box outward by `distance`, and by an allowance for rounding.
#[inline]
fn grown(min: Vec3A, max: Vec3A, distance: f32) -> (Vec3A, Vec3A) {
    let largest = min.abs().max(max.abs()).max_element();
    let growth = Vec3A::splat(distance + ROUNDING_GROWTH * (largest + distance));
    (min - growth, max + growth)
}

/// The rounding error of a transformed point, relative to the terms of its coordinates. Each coefficient, three
/// products, and three sums round by half a unit in the last place. The rest is reserve.
const MOVED_ROUNDING: f32 = 8.0 * f32::EPSILON;

/// A box around points that `pose` transforms, enlarged by the rounding error. Infinite if f32 overflows.
#[must_use]
pub fn bounds_of_moved(pose: &Pose, points: &[Vec3]) -> Aabb {
    let affine = pose.to_affine();
    let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
    let linear = Mat3A::from_cols(x.as_vec3a(), y.as_vec3a(), z.as_vec3a());
    let translation = affine.translation.as_vec3a();
    let (mut low, mut high, mut largest) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY, Vec3A::ZERO);
    for &point in points {
        let point = Vec3A::from(point);
        let moved = linear * point + translation;
        (low, high, largest) = (low.min(moved), high.max(moved), largest.max(point.abs()));
    }
    let reach = linear.abs() * largest + translation.abs();
    if !reach.is_finite() {
        // Terms of a sum that overflow may result in NaN.
        return Aabb { min: Vec3::NEG_INFINITY, max: Vec3::INFINITY };
    }
    let rounding = reach * MOVED_ROUNDING;
    Aabb { min: (low - rounding).into(), max: (high + rounding).into() }
}

/// Appends every pair of overlapping boxes of one list, lower index first, sorted. Compares all boxes with all others.
pub fn self_pairs_brute_force(bounds: &[Aabb], pairs: &mut Vec<[u32; 2]>) {
    for (first, own) in bounds.iter().enumerate() {
        for (second, other) in bounds.iter().enumerate().skip(first + 1) {
            if own.overlaps(other) {
                pairs.push([first as u32, second as u32]);
            }
        }
    }
}

/// Appends every pair of overlapping boxes of two lists, sorted. Compares all boxes with all others.
pub fn pairs_between_brute_force(bounds_a: &[Aabb], bounds_b: &[Aabb], pairs: &mut Vec<[u32; 2]>) {
    for (first, own) in bounds_a.iter().enumerate() {
        for (second, other) in bounds_b.iter().enumerate() {
            if own.overlaps(other) {
                pairs.push([first as u32, second as u32]);
            }
        }
    }
}
