//! The normals of faces, and their weights at corners.

use fearless_simd::{f32x8, prelude::*};
use glam::{DVec3, Vec3, Vec3A, Vec4};

use super::selection::{Part, Selection};
use crate::kernel::simd::{
    lanes::{SetLanes, TriangleLanes, WIDTH, ZERO_AREA, first_lanes, transposed},
    parallel::Parallel,
};

/// Lengths whose squares are reliable in f32.
const RELIABLE: [f32; 2] = [1.0e-15, 1.0e15];

/// What is known about one triangle, as one row: the unit normal, or zero if it has no area, the weights of the normal
/// at the three corners, and the least height.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub(super) struct Face([f32; 8]);

impl Face {
    #[inline]
    pub(super) fn normal(&self) -> Vec3A {
        Vec3A::from_vec4(Vec4::from_slice(&self.0))
    }

    /// The weight of the normal at a corner.
    #[inline]
    pub(super) fn weight(&self, corner: usize) -> f32 {
        self.0[3 + corner % 3]
    }

    /// The least height. 0 if it has no area.
    pub(super) fn height(&self) -> f32 {
        self.0[6]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn row(&self) -> &[f32; 8] {
        &self.0
    }

    /// In f64, for triangles that f32 is not enough for.
    #[cold]
    fn new([a, b, c]: [DVec3; 3]) -> Self {
        let sides = [b - a, c - b, a - c];
        let squares = sides.map(DVec3::length_squared);
        let cross = sides[0].cross(sides[1]);
        let doubled_area = cross.length();
        let longest = squares[0].max(squares[1]).max(squares[2]);
        let normal = cross / doubled_area;
        if !normal.is_finite() || longest <= 0.0 {
            return Self::default();
        }
        // The sine of the angle over the lengths of its two sides.
        let weight = |before: usize, after: usize| (doubled_area / (squares[before] * squares[after])) as f32;
        let weights = [weight(2, 0), weight(0, 1), weight(1, 2)];
        if !weights.iter().all(|weight| weight.is_finite()) {
            return Self::default();
        }
        let height = (doubled_area / longest.sqrt()) as f32;
        let (normal, [a, b, c]) = (normal.as_vec3(), weights);
        Self([normal.x, normal.y, normal.z, a, b, c, height, 0.0])
    }
}

/// Computes the selected faces.
pub(super) fn compute_faces(
    parallel: &impl Parallel,
    selection: &Selection,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    faces: &mut Vec<Face>,
) {
    faces.resize(triangles.len(), Face::default());
    parallel.run_tasks(selection.parts(faces), selection.share(), |faces| {
        dispatch!(simd => write_faces(simd, positions, triangles, faces));
    });
}

#[cfg_attr(not(unoptimized), inline(always))]
fn write_faces<S: Simd>(simd: S, positions: &[Vec3], triangles: &[[u32; 3]], mut faces: Part<'_, Face>) {
    let zero = f32x8::splat(simd, 0.0);
    for items in faces.items.chunks(WIDTH) {
        let mut own = [[0; 3]; WIDTH];
        for (own, &item) in own.iter_mut().zip(items) {
            *own = triangles[item as usize];
        }
        let lanes = TriangleLanes::gather(simd, positions, &own);
        let (lengths, _) = lanes.edge_lengths();
        let longest = lengths[0].max(lengths[1]).max(lengths[2]);
        let reliable = longest.simd_gt(RELIABLE[0]) & longest.simd_lt(RELIABLE[1]);
        let scale = f32x8::splat(simd, 1.0) / longest;
        let [first, second, third] =
            [lanes.edge(0).scaled(scale), lanes.edge(1).scaled(scale), lanes.edge(2).scaled(scale)];
        let cross = first.cross(second);
        let doubled_area = cross.dot(cross).sqrt();
        let exact = reliable & doubled_area.simd_gt(ZERO_AREA);
        let normal = cross.scaled(f32x8::splat(simd, 1.0) / doubled_area);
        let inverse = doubled_area * (scale * scale);
        let squares = [first.dot(first), second.dot(second), third.dot(third)];
        let weights = [
            inverse / (squares[2] * squares[0]),
            inverse / (squares[0] * squares[1]),
            inverse / (squares[1] * squares[2]),
        ];
        let rows = transposed([
            normal.x,
            normal.y,
            normal.z,
            weights[0],
            weights[1],
            weights[2],
            doubled_area * longest,
            zero,
        ]);
        for (&item, row) in items.iter().zip(rows) {
            row.store_slice(&mut faces.of(item).0);
        }
        let inexact = !(exact.to_bitmask() as u32) & first_lanes(items.len()) as u32;
        for lane in SetLanes(inexact) {
            *faces.of(items[lane]) = Face::new(own[lane].map(|vertex| positions[vertex as usize].as_dvec3()));
        }
    }
}
