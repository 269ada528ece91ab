//! All that the sphere stages ask of a triangle, one row a triangle: what is side by side in memory is read at once.
//!
//! A triangle is in a dozen pairs, and each pair needs its corners and its sphere, which lie in as many places as they have
//! numbers. Rows are copied together once a tick, and turned into lanes eight pairs at a time. Written by the overlap stage,
//! read by it and by the cone stage.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f32x8, prelude::*};
use glam::Vec3;

use super::{
    circumsphere::Ball,
    cone::Cap,
    lanes::{CapLanes, Lanes, PairLanes, VectorLanes, WIDTH},
    pair::SurfaceSide,
};

/// The numbers of one triangle, in blocks of as many as there are lanes.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct TriangleRow([[f32; WIDTH]; 2]);

/// Rows with the corners of each triangle and its enclosing ball.
#[derive(Clone, Debug, Default)]
pub struct BallRows {
    rows: Vec<TriangleRow>,
}

/// Rows with the corners of each triangle, its offset sphere and its cone. A row is a line of the cache: the two numbers
/// that it has no room for are together elsewhere.
#[derive(Clone, Debug, Default)]
pub struct CapRows {
    rows: Vec<TriangleRow>,
    rest: Vec<[f32; 2]>,
}

impl BallRows {
    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Empties the list and keeps its memory.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    pub(super) fn fill(&mut self, rows: impl Iterator<Item = TriangleRow>) {
        self.rows.clear();
        self.rows.extend(rows);
    }
}

impl CapRows {
    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Empties the lists and keeps their memory.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.rest.clear();
    }

    pub(super) fn fill(&mut self, rows: impl Iterator<Item = (TriangleRow, [f32; 2])>) {
        self.clear();
        self.rows.reserve(rows.size_hint().0);
        self.rest.reserve(rows.size_hint().0);
        for (row, rest) in rows {
            self.rows.push(row);
            self.rest.push(rest);
        }
    }
}

impl TriangleRow {
    /// `corners` and `cap` in the same frame.
    #[inline(always)]
    pub(super) fn of_cap(corners: [Vec3; 3], cap: &Cap) -> (Self, [f32; 2]) {
        let [a, b, c] = corners;
        let Cap { center, radius, height, axis, cosine } = *cap;
        let row = Self([
            [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y],
            [c.z, center.x, center.y, center.z, radius, height, axis.x, axis.y],
        ]);
        (row, [axis.z, cosine])
    }

    /// `corners` and `ball` in the same frame.
    #[inline(always)]
    pub(super) fn of_ball(corners: [Vec3; 3], ball: &Ball) -> Self {
        let ([a, b, c], Ball { center, radius }) = (corners, *ball);
        Self([[a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y], [c.z, center.x, center.y, center.z, radius, 0.0, 0.0, 0.0]])
    }
}

/// The rows of one side of eight pairs, one number to the lanes.
#[derive(Clone, Copy)]
pub(super) struct RowLanes {
    row: [[Lanes; WIDTH]; 2],
    rest: [Lanes; 2],
}

impl RowLanes {
    pub(super) const EMPTY: Self = Self { row: [[Lanes::ZERO; WIDTH]; 2], rest: [Lanes::ZERO; 2] };

    /// The rows of the pairs' triangles on one side.
    #[inline(never)]
    pub(super) fn gather_balls<const SIDE: usize>(&mut self, rows: &BallRows, pairs: &[[u32; 2]]) {
        dispatch!(Level::new(), simd => self.transpose(simd, &rows.rows, &places::<SIDE>(pairs)));
    }

    #[inline(never)]
    pub(super) fn gather_caps<const SIDE: usize>(&mut self, rows: &CapRows, pairs: &[[u32; 2]]) {
        let places = places::<SIDE>(pairs);
        dispatch!(Level::new(), simd => self.transpose(simd, &rows.rows, &places));
        for (lane, place) in places.into_iter().enumerate() {
            let [axis_z, cosine] = rows.rest[place as usize];
            self.rest[0].0[lane] = axis_z;
            self.rest[1].0[lane] = cosine;
        }
    }

    #[inline(always)]
    fn transpose<S: Simd>(&mut self, simd: S, rows: &[TriangleRow], places: &[u32; WIDTH]) {
        for (block, lanes) in self.row.iter_mut().enumerate() {
            let mut square = [f32x8::splat(simd, 0.0); WIDTH];
            for lane in 0..WIDTH {
                square[lane] = f32x8::from_slice(simd, &rows[places[lane] as usize].0[block]);
            }
            // Each round turns the places' six binary digits by one: after three, rows are columns.
            for _ in 0..3 {
                let before = square;
                for pair in 0..WIDTH / 2 {
                    let (even, odd) = before[pair].interleave(before[pair + WIDTH / 2]);
                    square[2 * pair] = even;
                    square[2 * pair + 1] = odd;
                }
            }
            for (lanes, column) in lanes.iter_mut().zip(square) {
                column.store_slice(&mut lanes.0);
            }
        }
    }

    /// Rows that are made pair by pair.
    #[inline(always)]
    pub(super) fn set(&mut self, lane: usize, row: &TriangleRow, rest: [f32; 2]) {
        for (lanes, numbers) in self.row.iter_mut().zip(&row.0) {
            for (lanes, &number) in lanes.iter_mut().zip(numbers) {
                lanes.0[lane] = number;
            }
        }
        self.rest[0].0[lane] = rest[0];
        self.rest[1].0[lane] = rest[1];
    }

    #[inline(always)]
    fn number(&self, place: usize) -> Lanes {
        self.row[place / WIDTH][place % WIDTH]
    }

    #[inline(always)]
    fn vector(&self, place: usize) -> VectorLanes {
        VectorLanes { x: self.number(place), y: self.number(place + 1), z: self.number(place + 2) }
    }

    #[inline(always)]
    pub(super) fn corners(&self) -> [VectorLanes; 3] {
        [self.vector(0), self.vector(3), self.vector(6)]
    }

    #[inline(always)]
    pub(super) fn center(&self) -> VectorLanes {
        self.vector(9)
    }

    #[inline(always)]
    pub(super) fn radius(&self) -> Lanes {
        self.number(12)
    }

    #[inline(always)]
    pub(super) fn cap(&self) -> CapLanes {
        CapLanes {
            center: self.center(),
            radius: self.radius(),
            height: self.number(13),
            axis: VectorLanes { x: self.number(14), y: self.number(15), z: self.rest[0] },
            cosine: self.rest[1],
        }
    }
}

/// The triangles on one side of eight pairs; of fewer the last one fills up.
#[inline(always)]
fn places<const SIDE: usize>(pairs: &[[u32; 2]]) -> [u32; WIDTH] {
    let mut places = [pairs.last().map_or(0, |last| last[SIDE]); WIDTH];
    for (place, pair) in places.iter_mut().zip(pairs) {
        *place = pair[SIDE];
    }
    places
}

/// The corners of a triangle in the frame of the pair, rounded.
#[inline(always)]
pub(super) fn rounded_corners(side: &SurfaceSide<'_>, triangle: u32) -> [Vec3; 3] {
    let [a, b, c] = side.topology.triangles()[triangle as usize];
    [side.positions[a as usize], side.positions[b as usize], side.positions[c as usize]]
}

impl PairLanes {
    /// Like [`gather`](Self::gather), of corners that are in lanes already.
    #[inline(always)]
    pub(super) fn of_corners(a: &[VectorLanes; 3], b: &[VectorLanes; 3]) -> Self {
        let origin = a[0];
        let (a, b) = ([a[0] - origin, a[1] - origin, a[2] - origin], [b[0] - origin, b[1] - origin, b[2] - origin]);
        let mut largest = VectorLanes::ZERO;
        for corner in [a[0], a[1], a[2], b[0], b[1], b[2]] {
            largest.x = largest.x.max(corner.x.abs());
            largest.y = largest.y.max(corner.y.abs());
            largest.z = largest.z.max(corner.z.abs());
        }
        let extent = largest.x + largest.y + largest.z;
        let is_known = Lanes::splat(Self::LARGEST_EXTENT).at_least(extent);
        Self { a, b, extent: Lanes::select(is_known, extent, Lanes::splat(f32::INFINITY)) }
    }
}
