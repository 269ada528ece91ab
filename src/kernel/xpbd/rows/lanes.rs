//! Rows of four numbers each, and how eight of them get into lanes and back.

use std::cell::Cell;

use fearless_simd::{f32x4, f32x8, prelude::*};
use glam::{DVec3, Vec3};

use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH, columns, rows, stored};

/// A vector of a particle, followed by one over its mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub(in crate::kernel::xpbd) struct Row(pub(in crate::kernel::xpbd) [f32; 4]);

impl Row {
    pub(in crate::kernel::xpbd) fn vector(self) -> Vec3 {
        let Self([x, y, z, _]) = self;
        Vec3::new(x, y, z)
    }

    pub(in crate::kernel::xpbd) fn set(&mut self, vector: Vec3) {
        let Self([x, y, z, _]) = self;
        (*x, *y, *z) = (vector.x, vector.y, vector.z);
    }
}

/// Eight particles, or fewer: the first row belongs to no particle, and stands in for those that are missing.
pub(in crate::kernel::xpbd) type Places = [u32; WIDTH];

/// The row of no particle. Its inverse mass is 0.
pub(in crate::kernel::xpbd) const NOBODY: u32 = 0;

/// Vectors of eight particles, and the inverse masses.
#[derive(Clone, Copy)]
pub(in crate::kernel::xpbd) struct Gathered<S: Simd> {
    pub(in crate::kernel::xpbd) vector: VectorLanes<S>,
    pub(in crate::kernel::xpbd) inverse_mass: f32x8<S>,
}

/// A table of rows.
pub(in crate::kernel::xpbd) trait Rows {
    fn row(&self, place: u32) -> Row;
}

impl Rows for [Row] {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn row(&self, place: u32) -> Row {
        self[place as usize]
    }
}

/// Rows that several threads may move.
#[derive(Clone, Copy)]
pub(in crate::kernel::xpbd) struct SharedRows<'a>(&'a [Cell<Row>]);

#[expect(unsafe_code, reason = "an atomic row costs more than its arithmetic")]
// SAFETY: while several threads have the rows, those of kinematic particles are only read: `scatter_free` leaves them
// out, and nothing else writes. Each thread solves constraints in other slabs, which have no free particle in common, so
// a row of one is read and written by one thread only. So do threads that solve what is across slabs and the next ones,
// for slabs that are not neighbors. What reaches farther is solved by a thread alone.
unsafe impl Sync for SharedRows<'_> {}

impl<'a> SharedRows<'a> {
    pub(in crate::kernel::xpbd) fn new(rows: &'a mut [Row]) -> Self {
        Self(Cell::from_mut(rows).as_slice_of_cells())
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn set<S: Simd>(self, place: u32, vector: f32x4<S>) {
        let mut row = Row::default();
        vector.store_slice(&mut row.0);
        self.0[place as usize].set(row);
    }

    pub(in crate::kernel::xpbd) fn replace(self, place: u32, vector: Vec3) {
        let mut row = self.row(place);
        row.set(vector);
        self.0[place as usize].set(row);
    }
}

impl Rows for SharedRows<'_> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn row(&self, place: u32) -> Row {
        self.0[place as usize].get()
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel::xpbd) fn gather<S: Simd>(simd: S, table: &(impl Rows + ?Sized), places: &Places) -> Gathered<S> {
    let mut part = [f32x4::splat(simd, 0.0); WIDTH];
    for lane in 0..WIDTH {
        part[lane] = f32x4::from_slice(simd, &table.row(places[lane]).0);
    }
    let [x, y, z, inverse_mass] = columns(part);
    Gathered { vector: VectorLanes { x, y, z }, inverse_mass }
}

/// Writes those particles that are free.
#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel::xpbd) fn scatter_free<S: Simd>(gathered: Gathered<S>, table: SharedRows<'_>, places: &Places) {
    let VectorLanes { x, y, z } = gathered.vector;
    let part = rows([x, y, z, gathered.inverse_mass]);
    if gathered.inverse_mass.simd_gt(0.0).all_true() {
        for lane in 0..WIDTH {
            table.set(places[lane], part[lane]);
        }
        return;
    }
    let inverse_mass = stored(gathered.inverse_mass);
    for lane in 0..WIDTH {
        if inverse_mass[lane] > 0.0 {
            table.set(places[lane], part[lane]);
        }
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
pub(in crate::kernel::xpbd) fn scatter<S: Simd>(gathered: Gathered<S>, table: &mut [Row], places: &Places) {
    let VectorLanes { x, y, z } = gathered.vector;
    let part = rows([x, y, z, gathered.inverse_mass]);
    for lane in 0..WIDTH {
        part[lane].store_slice(&mut table[places[lane] as usize].0);
    }
}

impl<S: Simd> Gathered<S> {
    /// Moves the particles by a vector times their inverse masses.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel::xpbd) fn pushed(self, by: VectorLanes<S>) -> Self {
        Self { vector: self.vector.plus(by.scaled(self.inverse_mass)), ..self }
    }
}

/// Writes a vector, rounded to f32, into a lane.
pub(in crate::kernel::xpbd) fn set_lane(rows: &mut VectorRows, lane: usize, vector: DVec3) {
    rows.set(lane, vector.as_vec3());
}
