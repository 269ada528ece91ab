//! Osculating spheres: through the vertices of a triangle, and as curved as the body that a smooth mesh stands for.
//!
//! A sphere is stored as its signed curvature `κ`, greater than 0 where the surface is convex, and 0 where it is flat,
//! because centers and radii are infinite there. With the in-plane center `x` of the triangle, the distance `ρ` of its
//! corners from there, its unit normal `n`, and `c = √(1 − κ²ρ²)`:
//!
//! - The signed distance of a point at `y` from `x` is `(κ(y² − ρ²) + 2 c y·n) / (|κy + cn| + 1)`, with the gradient
//!   `(κy + cn) / |κy + cn|`.
//! - The sphere stands over a point of the plane at a squared distance `r²` from `x` by
//!   `κ(ρ² − r²) / (√(1 − κ²r²) + c)`. Its *cap* is what lines from its center through the triangle meet.
//! - The line between the centers of two spheres has the direction `e = κ_b c_a n_a − κ_a c_b n_b + κ_a κ_b (x_b − x_a)`
//!   from the first surface to the second. It meets the first sphere over `x_a + (κ_b (x_b − x_a) − c_b n_b) / |e|`,
//!   projected into the plane of the triangle, and the second over `x_b − (κ_a (x_b − x_a) + c_a n_a) / |e|`.

use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::Vec3;

use super::{
    circumsphere::{OBTUSE_REACH, OffsetSpheres},
    cone::SafetyCones,
    curvature::Curvatures,
};
use crate::kernel::{
    mesh::curved_edges::CurvedEdges,
    simd::{
        lanes::{EdgeChoice, FrameLanes, TriangleLanes, VectorLanes, WIDTH, load_first, store_first},
        parallel::{LEAST_SHARE, PART, Parallel},
    },
};

/// The largest sine of the angle at which a sphere meets the plane of its triangle.
const LARGEST_SINE: f32 = 0.7;

/// Spheres larger than this many radii of their triangle are stored with that size, because centers must be finite.
const LARGEST_RADIUS: f32 = 1.0e4;

/// The osculating spheres of eight triangles.
#[derive(Clone, Copy)]
pub(super) struct OsculatingLanes<S: Simd> {
    /// The in-plane center, relative to an origin.
    pub(super) center: VectorLanes<S>,
    pub(super) normal: VectorLanes<S>,
    pub(super) curvature: f32x8<S>,
    /// `ρ²`
    pub(super) squared_radius: f32x8<S>,
    /// `c`
    pub(super) cosine: f32x8<S>,
}

impl<S: Simd> OsculatingLanes<S> {
    /// Spheres with given curvatures. Triangles without area are flat, with a normal of zero.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn new(simd: S, corners: &TriangleLanes<S>, curvature: f32x8<S>) -> Self {
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let (lengths, exact) = corners.edge_lengths();
        let origin = VectorLanes::splat(simd, Vec3::ZERO);
        let frame = FrameLanes::new(corners, origin, EdgeChoice::longest(&lengths), &lengths);
        let has_area = exact & frame.exact;
        let across = has_area.select(frame.cotangent.max(-OBTUSE_REACH), zero);
        let center = VectorLanes::select(has_area, frame.point_across(across), frame.midpoint);
        let (radius, _) = corners.farthest_corner(center);
        let limit = f32x8::splat(simd, LARGEST_SINE) / radius;
        let curvature = has_area.select(curvature.max(-limit).min(limit), zero);
        let sine = curvature * radius;
        let normal = VectorLanes::select(has_area, frame.normal, origin);
        let cosine = (one - sine * sine).sqrt();
        Self { center, normal, curvature, squared_radius: radius * radius, cosine }
    }

    /// The same spheres, seen from the other side where a mask is set.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn turned(self, mask: mask32x8<S>) -> Self {
        Self {
            normal: VectorLanes::select(mask, self.normal.negated(), self.normal),
            curvature: mask.select(-self.curvature, self.curvature),
            ..self
        }
    }

    /// How far the caps stand over points of the planes at these squared distances from the centers.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn height(&self, squared: f32x8<S>) -> f32x8<S> {
        let simd = squared.simd;
        let own = (f32x8::splat(simd, 1.0) - self.curvature * self.curvature * squared).max(0.0).sqrt();
        self.curvature * (self.squared_radius - squared) / (own + self.cosine)
    }

    /// Where lines from the centers of the spheres to their points pass the planes. Neighbors on one sphere meet there,
    /// and the inverse is the [foot](Self::foot) of a point of the plane.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn below(&self, point: VectorLanes<S>) -> VectorLanes<S> {
        let from_center = point - self.center;
        let height = from_center.dot(self.normal);
        let across = from_center - self.normal.scaled(height);
        self.center.plus(across.scaled(self.cosine / (self.cosine + self.curvature * height).max(f32::MIN_POSITIVE)))
    }

    /// The points of the spheres straight over points of the planes.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn over(&self, point: VectorLanes<S>) -> VectorLanes<S> {
        let from_center = point - self.center;
        point.plus(self.normal.scaled(self.height(from_center.dot(from_center))))
    }

    /// The closest points of the spheres to other points.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn foot(&self, point: VectorLanes<S>) -> VectorLanes<S> {
        let from_center = point - self.center;
        let gradient = from_center.scaled(self.curvature).plus(self.normal.scaled(self.cosine));
        let length = gradient.dot(gradient).sqrt().max(f32::MIN_POSITIVE);
        let value = self.curvature * (from_center.dot(from_center) - self.squared_radius)
            + self.cosine * from_center.dot(self.normal) * 2.0;
        point - gradient.scaled(value / ((length + 1.0) * length))
    }
}

/// Signed curvatures of the osculating spheres, from the curved edges.
///
/// An edge of length `l` that bends by `c` has the curvature `2 c·n / l²` over a sphere, times the cosine of the angle
/// at which the sphere meets the plane. The mean over the edges is weighted by `l⁴`.
#[cfg_attr(not(unoptimized), inline(always))]
fn curvatures<S: Simd>(
    simd: S,
    corners: &TriangleLanes<S>,
    offsets: &[VectorLanes<S>; 3],
    flat: &OsculatingLanes<S>,
) -> f32x8<S> {
    let one = f32x8::splat(simd, 1.0);
    let (mut rise, mut weight) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, f32::MIN_POSITIVE));
    for edge in 0..3 {
        let along = corners.edge(edge);
        let squared = along.dot(along);
        rise += offsets[edge].dot(flat.normal) * squared;
        weight += squared * squared;
    }
    let radius = flat.squared_radius.sqrt().max(f32::MIN_POSITIVE);
    // The sine times the cosine of that angle.
    let product = (rise * 2.0 / weight * radius).max(-0.5).min(0.5);
    let doubled = (one - product * product * 4.0).max(0.0).sqrt();
    product / (((one + doubled) * 0.5).sqrt() * radius)
}

impl Curvatures {
    /// Measures the signed curvatures of the osculating spheres of a smooth surface. Dihedral angles and spreads are not
    /// measured.
    pub fn osculate_on(
        &mut self,
        parallel: &impl Parallel,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        curved: &CurvedEdges,
    ) {
        self.dihedrals.clear();
        self.spreads.clear();
        self.curvatures.resize(triangles.len(), 0.0);
        let parts = triangles.chunks(PART).zip(self.curvatures.chunks_mut(PART)).enumerate();
        parallel.run_tasks(parts, triangles.len() / LEAST_SHARE, |(part, (triangles, measured))| {
            dispatch!(simd => {
                for (block, (triangles, measured)) in
                    triangles.chunks(WIDTH).zip(measured.chunks_mut(WIDTH)).enumerate()
                {
                    let first = (part * PART + block * WIDTH) as u32;
                    store_first(measure_eight(simd, positions, triangles, curved, first), measured);
                }
            });
        });
    }
}

/// The curvatures of up to eight consecutive triangles.
#[cfg_attr(not(unoptimized), inline(always))]
fn measure_eight<S: Simd>(
    simd: S,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    curved: &CurvedEdges,
    first: u32,
) -> f32x8<S> {
    let mut offsets = [[Vec3::ZERO; WIDTH]; 3];
    for lane in 0..triangles.len() {
        let own = curved.of_triangle(first + lane as u32);
        for edge in 0..3 {
            offsets[edge][lane] = own[edge];
        }
    }
    let [a, b, c] = offsets;
    let offsets = [VectorLanes::of(simd, a), VectorLanes::of(simd, b), VectorLanes::of(simd, c)];
    let corners = TriangleLanes::gather(simd, positions, triangles);
    let corners = corners.relative_to(corners.0[0]);
    let flat = OsculatingLanes::new(simd, &corners, f32x8::splat(simd, 0.0));
    let curvature = curvatures(simd, &corners, &offsets, &flat);
    OsculatingLanes::new(simd, &corners, curvature).curvature
}

impl OffsetSpheres {
    /// Writes the osculating sphere of every triangle, given its signed curvature, with its cone: the directions of its
    /// cap's normals. Heights are negative where a sphere lies above its triangle, and nearly flat spheres are stored
    /// with 10,000 radii of their triangle.
    pub fn osculate_on(
        &mut self,
        parallel: &impl Parallel,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        curvatures: &[f32],
        cones: &mut SafetyCones,
    ) {
        self.forget();
        let count = triangles.len();
        cones.resize(count);
        let Self { centers, radii, heights, .. } = self;
        centers.resize(count, Vec3::ZERO);
        radii.resize(count, 0.0);
        heights.resize(count, 0.0);
        let spheres = centers.chunks_mut(PART).zip(radii.chunks_mut(PART)).zip(heights.chunks_mut(PART));
        let cones = cones.axes.chunks_mut(PART).zip(cones.cosines.chunks_mut(PART));
        let parts = triangles.chunks(PART).zip(curvatures.chunks(PART)).zip(spheres).zip(cones);
        parallel.run_tasks(parts, count / LEAST_SHARE, |(((triangles, curvatures), spheres), cones)| {
            let ((centers, radii), heights) = spheres;
            let mut out = Osculated { centers, radii, heights, axes: cones.0, cosines: cones.1 };
            dispatch!(simd => out.write(simd, positions, triangles, curvatures));
        });
    }
}

/// Where the spheres of consecutive triangles go.
struct Osculated<'a> {
    centers: &'a mut [Vec3],
    radii: &'a mut [f32],
    heights: &'a mut [f32],
    axes: &'a mut [Vec3],
    cosines: &'a mut [f32],
}

impl Osculated<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn write<S: Simd>(&mut self, simd: S, positions: &[Vec3], triangles: &[[u32; 3]], curvatures: &[f32]) {
        let one = f32x8::splat(simd, 1.0);
        for (block, (triangles, curvatures)) in triangles.chunks(WIDTH).zip(curvatures.chunks(WIDTH)).enumerate() {
            let own = block * WIDTH..block * WIDTH + triangles.len();
            let corners = TriangleLanes::gather(simd, positions, triangles);
            let origin = corners.0[0];
            let sphere = OsculatingLanes::new(simd, &corners.relative_to(origin), load_first(simd, curvatures));
            let least = one / (sphere.squared_radius.sqrt() * LARGEST_RADIUS).max(f32::MIN_POSITIVE);
            let bent = sphere.curvature.abs().max(least);
            let height = sphere.cosine / bent;
            let height = sphere.curvature.simd_lt(0.0).select(-height, height);
            origin.plus(sphere.center - sphere.normal.scaled(height)).write(&mut self.centers[own.clone()]);
            store_first(one / bent, &mut self.radii[own.clone()]);
            store_first(height, &mut self.heights[own.clone()]);
            sphere.normal.write(&mut self.axes[own.clone()]);
            store_first(sphere.cosine, &mut self.cosines[own]);
        }
    }
}
