//! Everything that the sphere stages read of a triangle, as one row of contiguous memory.
//!
//! A triangle is in about a dozen pairs. Each pair needs its corners and its sphere, whose numbers lie in as many
//! places. Rows are assembled once per tick, or once for a surface at rest, and transposed into lanes eight pairs at a
//! time. Written by the overlap stage; read by it, by the cone stage, and by the writers of contacts, possibly ticks
//! later.

use fearless_simd::{f32x8, prelude::*};
use glam::{DVec3, Vec3};

use super::{cap_lanes::CapLanes, circumsphere::Ball, cone::Cap};
use crate::kernel::{
    pair::SurfaceSide,
    pose::Pose,
    simd::{
        lanes::{DoubleVectorLanes, VectorLanes, WIDTH, columns_from, rounded, widened},
        parallel::{LEAST_SHARE, PART, Parallel},
        prefetch::prefetch,
    },
};

/// How many rows ahead of the written one to prefetch.
const ROWS_AHEAD: usize = 16;

/// Numbers per cache line.
const NUMBERS: usize = 2 * WIDTH;

/// The numbers of one triangle.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct TriangleRow([f32; NUMBERS]);

impl TriangleRow {
    pub(in crate::kernel) const EMPTY: Self = Self([0.0; NUMBERS]);
}

/// Rows with the corners of each triangle and its enclosing ball.
#[derive(Clone, Debug, Default)]
pub struct BallRows {
    rows: Vec<TriangleRow>,
}

/// Rows with the corners of each triangle, its offset sphere, and its cone. A row is one cache line. The two numbers
/// that do not fit are stored together elsewhere.
#[derive(Clone, Debug, Default)]
pub struct CapRows {
    rows: Vec<TriangleRow>,
    rest: Vec<[f32; 2]>,
}

impl BallRows {
    /// Prefetches a row.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn prefetch(&self, triangle: u32) {
        prefetch(&self.rows, triangle);
    }

    /// Writes `count` rows, which `row` makes.
    pub(in crate::kernel) fn fill(
        &mut self,
        parallel: &impl Parallel,
        count: usize,
        row: impl Fn(u32) -> TriangleRow + Sync,
    ) {
        self.rows.resize(count, TriangleRow::EMPTY);
        parallel.run_tasks(self.rows.chunks_mut(PART).enumerate(), count / LEAST_SHARE, |(part, rows)| {
            for place in 0..rows.len() {
                prefetch(rows, (place + ROWS_AHEAD) as u32);
                rows[place] = row((part * PART + place) as u32);
            }
        });
    }
}

impl CapRows {
    /// Prefetches a row.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn prefetch(&self, triangle: u32) {
        prefetch(&self.rows, triangle);
        prefetch(&self.rest, triangle);
    }

    /// Writes `count` rows, which `row` makes.
    pub(in crate::kernel) fn fill(
        &mut self,
        parallel: &impl Parallel,
        count: usize,
        row: impl Fn(u32) -> (TriangleRow, [f32; 2]) + Sync,
    ) {
        self.rows.resize(count, TriangleRow::EMPTY);
        self.rest.resize(count, [0.0; 2]);
        let parts = self.rows.chunks_mut(PART).zip(self.rest.chunks_mut(PART)).enumerate();
        parallel.run_tasks(parts, count / LEAST_SHARE, |(part, (rows, rest))| {
            for (place, rest) in rest.iter_mut().enumerate().take(rows.len()) {
                prefetch(rows, (place + ROWS_AHEAD) as u32);
                (rows[place], *rest) = row((part * PART + place) as u32);
            }
        });
    }
}

impl TriangleRow {
    /// `corners` and `cap` must be in the same frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of_cap(corners: [Vec3; 3], cap: &Cap) -> (Self, [f32; 2]) {
        let [a, b, c] = corners;
        let Cap { center, radius, height, axis, cosine } = *cap;
        let Vec3 { x, y, z } = center;
        let row = [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z, x, y, z, radius, height, axis.x, axis.y];
        (Self(row), [axis.z, cosine])
    }

    /// `corners` and `ball` must be in the same frame.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn of_ball(corners: [Vec3; 3], ball: &Ball) -> Self {
        let ([a, b, c], Ball { center: Vec3 { x, y, z }, radius }) = (corners, *ball);
        Self([a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z, x, y, z, radius, 0.0, 0.0, 0.0])
    }
}

/// The rows of one side of eight pairs, transposed into lanes, in the pairs' frame.
pub(in crate::kernel) struct RowLanes<S: Simd> {
    row: [f32x8<S>; NUMBERS],
    rest: [f32x8<S>; 2],
    /// The corners before rounding, if they have been transformed.
    moved_corners: Option<[DoubleVectorLanes<S>; 3]>,
}

impl<S: Simd> RowLanes<S> {
    /// Gathers the rows of the triangles on one side of the pairs.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gather_balls<const SIDE: usize>(simd: S, rows: &BallRows, pairs: &[[u32; 2]]) -> Self {
        let places = places::<SIDE>(pairs);
        Self::new(simd, |lane| &rows.rows[places[lane] as usize], &[[0.0; WIDTH]; 2])
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn gather_caps<const SIDE: usize>(simd: S, rows: &CapRows, pairs: &[[u32; 2]]) -> Self {
        let places = places::<SIDE>(pairs);
        let mut rest = [[0.0; WIDTH]; 2];
        for (lane, &place) in places.iter().enumerate() {
            [rest[0][lane], rest[1][lane]] = rows.rest[place as usize];
        }
        Self::new(simd, |lane| &rows.rows[places[lane] as usize], &rest)
    }

    /// Takes rows that were made pair by pair.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn new<'a>(
        simd: S,
        row: impl Fn(usize) -> &'a TriangleRow,
        rest: &[[f32; WIDTH]; 2],
    ) -> Self {
        let [a, b, c, d, e, f, g, h] = [row(0), row(1), row(2), row(3), row(4), row(5), row(6), row(7)];
        let rows: [&[f32]; WIDTH] = [&a.0, &b.0, &c.0, &d.0, &e.0, &f.0, &g.0, &h.0];
        let [ax, ay, az, bx] = columns_from::<0, S>(simd, rows);
        let [by, bz, cx, cy] = columns_from::<4, S>(simd, rows);
        let [cz, x, y, z] = columns_from::<8, S>(simd, rows);
        let [radius, height, axis_x, axis_y] = columns_from::<12, S>(simd, rows);
        Self {
            row: [ax, ay, az, bx, by, bz, cx, cy, cz, x, y, z, radius, height, axis_x, axis_y],
            rest: [f32x8::from_slice(simd, &rest[0]), f32x8::from_slice(simd, &rest[1])],
            moved_corners: None,
        }
    }

    /// Transforms triangles and balls to another frame, if there is a pose.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn with_balls_moved(mut self, simd: S, pose: Option<&Pose>) -> Self {
        let Some(to_frame) = pose else { return self };
        let [a, b, c] = self.corners();
        let corners = [a.widened().moved(simd, pose), b.widened().moved(simd, pose), c.widened().moved(simd, pose)];
        for corner in 0..3 {
            self.set_vector(3 * corner, corners[corner].rounded());
        }
        self.moved_corners = Some(corners);
        self.set_vector(9, self.center().moved(simd, pose));
        self.row[12] = scaled(self.radius(), to_frame);
        self
    }

    /// Transforms triangles and caps to another frame, if there is a pose.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn with_caps_moved(self, simd: S, pose: Option<&Pose>) -> Self {
        let mut moved = self.with_balls_moved(simd, pose);
        if let Some(pose) = pose {
            let CapLanes { height, axis, .. } = moved.cap();
            let axis = axis.widened().moved_direction(simd, pose).normalized_or(DVec3::ZERO).rounded();
            moved.row[13] = scaled(height, pose);
            ([moved.row[14], moved.row[15]], moved.rest[0]) = ([axis.x, axis.y], axis.z);
        }
        moved
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn set_vector(&mut self, place: usize, vector: VectorLanes<S>) {
        (self.row[place], self.row[place + 1], self.row[place + 2]) = (vector.x, vector.y, vector.z);
    }

    /// The corners, not rounded even if they have been transformed.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn exact_corners(&self) -> [DoubleVectorLanes<S>; 3] {
        if let Some(corners) = self.moved_corners {
            return corners;
        }
        let [a, b, c] = self.corners();
        [a.widened(), b.widened(), c.widened()]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn vector(&self, place: usize) -> VectorLanes<S> {
        VectorLanes { x: self.row[place], y: self.row[place + 1], z: self.row[place + 2] }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn corners(&self) -> [VectorLanes<S>; 3] {
        [self.vector(0), self.vector(3), self.vector(6)]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn center(&self) -> VectorLanes<S> {
        self.vector(9)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn radius(&self) -> f32x8<S> {
        self.row[12]
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn cap(&self) -> CapLanes<S> {
        CapLanes {
            center: self.center(),
            radius: self.radius(),
            height: self.row[13],
            axis: VectorLanes { x: self.row[14], y: self.row[15], z: self.rest[0] },
            cosine: self.rest[1],
        }
    }
}

/// Converts lengths to another frame.
#[cfg_attr(not(unoptimized), inline(always))]
fn scaled<S: Simd>(lengths: f32x8<S>, pose: &Pose) -> f32x8<S> {
    rounded(widened(lengths) * pose.scale())
}

/// The triangles on one side of eight pairs. The last pair fills unused lanes.
#[cfg_attr(not(unoptimized), inline(always))]
fn places<const SIDE: usize>(pairs: &[[u32; 2]]) -> [u32; WIDTH] {
    let mut places = [0; WIDTH];
    if let Some(pairs) = pairs.first_chunk::<WIDTH>() {
        for lane in 0..WIDTH {
            places[lane] = pairs[lane][SIDE];
        }
        return places;
    }
    for (lane, place) in places.iter_mut().enumerate() {
        *place = pairs.get(lane).or(pairs.last()).map_or(0, |pair| pair[SIDE]);
    }
    places
}

/// The corners of a triangle in its surface's own frame.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel) fn own_corners(side: &SurfaceSide<'_>, triangle: u32) -> [Vec3; 3] {
    let (positions, [a, b, c]) = (side.own_positions(), side.topology.triangles()[triangle as usize]);
    [positions[a as usize], positions[b as usize], positions[c as usize]]
}
