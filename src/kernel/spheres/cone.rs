//! Safety cones: the directions from which a sphere's cap is the real surface.
//!
//! Two offset spheres touch as surfaces only if the line between their centers leaves both through their caps. Reads
//! the spheres of `circumsphere`, and the cone stage keeps the pairs that pass. The test alone misses contacts, so only
//! the `Circumsphere` method rejects pairs by it. The signed gap is the source paper's, in terms of plane heights.

use core::f32::consts::PI;

use fearless_simd::{f32x8, prelude::*};
use glam::Vec3;

use super::circumsphere::{OffsetSpheres, length};
use crate::kernel::simd::{
    lanes::{WIDTH, load_first, sine_cosine, store_first},
    parallel::{LEAST_SHARE, PART, Parallel, Sequential},
};

/// Slack of the cone comparison, as a cosine. A direction that the crease clamp puts exactly on the cone's boundary
/// passes despite rounding.
pub(in crate::kernel) const BOUNDARY_SLACK: f32 = 1.0e-4;

/// How far a cone is widened beyond its triangle's spread, in radians (15°). Over the recordings and the generated
/// scenes this finds the most pairs at the same precision.
const EXTRA_WIDENING: f32 = 0.261_799_4;

/// The cones of a surface's triangles, as a structure of arrays.
#[derive(Clone, Debug, Default)]
pub struct SafetyCones {
    /// Unit normals of the triangles. For a triangle without area, its last normal, or zero.
    pub axes: Vec<Vec3>,
    /// Cosines of the half-angles, or [`EVERYWHERE`](Self::EVERYWHERE) if a triangle has no area.
    pub cosines: Vec<f32>,
}

impl SafetyCones {
    /// The cosine of a cone that contains every direction.
    pub const EVERYWHERE: f32 = -1.0;

    pub(in crate::kernel) fn resize(&mut self, count: usize) {
        self.axes.resize(count, Vec3::ZERO);
        self.cosines.resize(count, Self::EVERYWHERE);
    }
}

impl SafetyCones {
    /// Widens every cone by its triangle's `spread` (see [`Curvatures::spreads`](super::curvature::Curvatures)), and by
    /// 15° more. Between the cones of two neighbors there are directions from which their common edge is met and that
    /// are in neither cone.
    pub fn widen(&mut self, spreads: &[f32]) {
        self.widen_on(&Sequential, spreads);
    }

    /// Like [`widen`](Self::widen), in tasks that `parallel` may distribute.
    pub fn widen_on(&mut self, parallel: &impl Parallel, spreads: &[f32]) {
        let count = self.cosines.len() / LEAST_SHARE;
        parallel.run_tasks(self.cosines.chunks_mut(PART).zip(spreads.chunks(PART)), count, |(cosines, spreads)| {
            dispatch!(simd => widen(simd, cosines, spreads));
        });
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn widen<S: Simd>(simd: S, cosines: &mut [f32], spreads: &[f32]) {
    let one = f32x8::splat(simd, 1.0);
    for (cosines, spreads) in cosines.chunks_mut(WIDTH).zip(spreads.chunks(WIDTH)) {
        let count = cosines.len().min(spreads.len());
        let (cosine, spread) = (load_first(simd, &cosines[..count]), load_first(simd, &spreads[..count]));
        let added = spread + EXTRA_WIDENING;
        let (sine_added, cosine_added) = sine_cosine(added);
        let sine = (one - cosine * cosine).max(0.0).sqrt();
        // Half-angles are at least 0, so their sum passes π where its sine becomes negative.
        let past_half_circle = (sine * cosine_added + cosine * sine_added).simd_lt(0.0);
        let everything = added.simd_ge(PI) | past_half_circle;
        let widened = cosine * cosine_added - sine * sine_added;
        let widened = everything.select(f32x8::splat(simd, SafetyCones::EVERYWHERE), widened);
        store_first(widened, &mut cosines[..count]);
    }
}

/// One triangle's sphere and cone, as the pair test needs them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cap {
    /// Center of the offset sphere.
    pub center: Vec3,
    /// Radius of the offset sphere.
    pub radius: f32,
    /// Height of the triangle's plane above the center.
    pub height: f32,
    /// Unit normal of the triangle.
    pub axis: Vec3,
    /// Cosine of the cone's half-angle.
    pub cosine: f32,
}

impl Cap {
    /// The cap of one triangle.
    #[inline]
    #[must_use]
    pub fn of(spheres: &OffsetSpheres, cones: &SafetyCones, triangle: usize) -> Self {
        Self {
            center: spheres.centers[triangle],
            radius: spheres.radii[triangle],
            height: spheres.heights[triangle],
            axis: cones.axes[triangle],
            cosine: cones.cosines[triangle],
        }
    }

    /// The point of the triangle's plane above the sphere's center.
    #[must_use]
    pub fn in_plane_center(&self) -> Vec3 {
        self.center + self.axis * self.height
    }

    /// The cap on the side of the triangle where `point` is: this one, or its mirror image in the triangle's plane. A
    /// sheet has a surface on both sides.
    #[must_use]
    pub fn facing(&self, point: Vec3) -> Self {
        let in_plane = self.in_plane_center();
        if (point - in_plane).dot(self.axis) >= 0.0 {
            *self
        } else {
            Self { center: in_plane + self.axis * self.height, axis: -self.axis, ..*self }
        }
    }
}

/// Where the line between two caps' centers crosses their triangles' planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapContact {
    /// The crossing with the first triangle's plane.
    pub point_a: Vec3,
    /// The crossing with the second triangle's plane.
    pub point_b: Vec3,
    /// Unit direction from the first center to the second.
    pub direction: Vec3,
    /// Distance from `point_a` to `point_b` along `direction`. Negative if the planes have passed each other.
    pub gap: f32,
}

/// Whether two spheres come within `reach` (0 or more) of each other.
#[must_use]
pub fn spheres_overlap(center_a: Vec3, radius_a: f32, center_b: Vec3, radius_b: f32, reach: f32) -> bool {
    let sum = radius_a + radius_b + reach;
    center_a.distance_squared(center_b) <= sum * sum
}

/// The cone test: the contact of two caps along the line between their centers, or `None` if that line leaves a sphere
/// outside its cone. Concentric caps have no such line. They are in contact along the first one's normal, or against
/// the second one's if the first has no area.
#[must_use]
pub fn cap_contact(a: &Cap, b: &Cap) -> Option<CapContact> {
    let between = b.center - a.center;
    let length = length(between);
    if length <= f32::EPSILON * (a.radius + b.radius) {
        let (point_a, point_b) = (a.in_plane_center(), b.in_plane_center());
        let direction = [a.axis, -b.axis].into_iter().find(|&axis| axis != Vec3::ZERO).unwrap_or(Vec3::Y);
        return Some(CapContact { point_a, point_b, direction, gap: (point_b - point_a).dot(direction) });
    }
    let direction = if between.is_finite() {
        between / length
    } else {
        // Farther apart than the largest f32.
        (b.center.as_dvec3() - a.center.as_dvec3()).try_normalize()?.as_vec3()
    };
    let (toward_b, toward_a) = (direction.dot(a.axis), -direction.dot(b.axis));
    if toward_b < a.cosine - BOUNDARY_SLACK || toward_a < b.cosine - BOUNDARY_SLACK {
        return None;
    }
    // A direction that passed meets the plane within the sphere. The limit keeps the slack from extending beyond it.
    let to_plane = |cap: &Cap, toward: f32| {
        if cap.height > 0.0 { (cap.height / toward.max(f32::MIN_POSITIVE)).min(cap.radius) } else { 0.0 }
    };
    let (from_a, from_b) = (to_plane(a, toward_b), to_plane(b, toward_a));
    Some(CapContact {
        point_a: a.center + direction * from_a,
        point_b: b.center - direction * from_b,
        direction,
        gap: length - from_a - from_b,
    })
}
