//! The state of particles, one row of four numbers each, and how eight of them get into lanes and back.

use std::{cell::Cell, iter::zip};

use fearless_simd::{f32x4, f32x8, prelude::*};
use glam::{DVec3, Vec3, Vec4};

use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH, columns, rows, stored};

/// A vector of a particle, followed by one over its mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))]
pub(super) struct Row(pub(super) [f32; 4]);

impl Row {
    pub(super) fn vector(self) -> Vec3 {
        let Self([x, y, z, _]) = self;
        Vec3::new(x, y, z)
    }

    pub(super) fn set(&mut self, vector: Vec3) {
        let Self([x, y, z, _]) = self;
        (*x, *y, *z) = (vector.x, vector.y, vector.z);
    }
}

/// Eight particles, or fewer: the first row belongs to no particle, and stands in for those that are missing.
pub(super) type Places = [u32; WIDTH];

/// The row of no particle. Its inverse mass is 0.
pub(super) const NOBODY: u32 = 0;

/// The row of a particle.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) const fn row_of(particle: usize) -> u32 {
    particle as u32 + 1
}

/// Puts a constraint into a lane: the rows of its particles, and where those after the first start, relative to it.
pub(super) fn place_in_lane<const N: usize, const M: usize>(
    lane: usize,
    (corners, offsets): (&mut [Places; N], &mut [VectorRows; M]),
    particles: [usize; N],
    start: &[DVec3],
) {
    for (places, particle) in zip(corners, particles) {
        places[lane] = row_of(particle);
    }
    for (offset, &particle) in zip(offsets, &particles[1..]) {
        set_lane(offset, lane, start[particle] - start[particles[0]]);
    }
}

/// Vectors of eight particles, and the inverse masses.
#[derive(Clone, Copy)]
pub(super) struct Gathered<S: Simd> {
    pub(super) vector: VectorLanes<S>,
    pub(super) inverse_mass: f32x8<S>,
}

/// A table of rows.
pub(super) trait Rows {
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
pub(super) struct SharedRows<'a>(&'a [Cell<Row>]);

#[expect(unsafe_code, reason = "an atomic row costs more than its arithmetic")]
// SAFETY: while several threads have the rows, those of kinematic particles are only read: `scatter_free` leaves them
// out, and nothing else writes. Each thread solves constraints in other slabs, which have no free particle in common, so
// a row of one is read and written by one thread only. So do threads that solve what is across slabs and the next ones,
// for slabs that are not neighbors. What reaches farther is solved by a thread alone.
unsafe impl Sync for SharedRows<'_> {}

impl<'a> SharedRows<'a> {
    pub(super) fn new(rows: &'a mut [Row]) -> Self {
        Self(Cell::from_mut(rows).as_slice_of_cells())
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn set<S: Simd>(self, place: u32, vector: f32x4<S>) {
        let mut row = Row::default();
        vector.store_slice(&mut row.0);
        self.0[place as usize].set(row);
    }

    fn replace(self, place: u32, vector: Vec3) {
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
pub(super) fn gather<S: Simd>(simd: S, table: &(impl Rows + ?Sized), places: &Places) -> Gathered<S> {
    let mut part = [f32x4::splat(simd, 0.0); WIDTH];
    for lane in 0..WIDTH {
        part[lane] = f32x4::from_slice(simd, &table.row(places[lane]).0);
    }
    let [x, y, z, inverse_mass] = columns(part);
    Gathered { vector: VectorLanes { x, y, z }, inverse_mass }
}

/// Writes those particles that are free.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn scatter_free<S: Simd>(gathered: Gathered<S>, table: SharedRows<'_>, places: &Places) {
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
pub(super) fn scatter<S: Simd>(gathered: Gathered<S>, table: &mut [Row], places: &Places) {
    let VectorLanes { x, y, z } = gathered.vector;
    let part = rows([x, y, z, gathered.inverse_mass]);
    for lane in 0..WIDTH {
        part[lane].store_slice(&mut table[places[lane] as usize].0);
    }
}

impl<S: Simd> Gathered<S> {
    /// Moves the particles by a vector times their inverse masses.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn pushed(self, by: VectorLanes<S>) -> Self {
        Self { vector: self.vector.plus(by.scaled(self.inverse_mass)), ..self }
    }
}

/// A particle at the beginning of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// How far a kinematic particle moves in the tick. Unused otherwise.
    pub way: DVec3,
    /// In world units per second. Unused if kinematic.
    pub velocity: DVec3,
    /// One over the mass; 0 if kinematic.
    pub inverse_mass: f64,
}

/// Particles in the substeps of a tick.
///
/// A kinematic particle, with an inverse mass of 0, moves in a straight line, whatever pushes it.
#[derive(Debug, Default)]
pub struct ParticleRows {
    /// Displacement since the beginning of the tick.
    pub(super) displacement: Vec<Row>,
    /// Displacement at the beginning of the substep.
    pub(super) previous: Vec<Row>,
    /// In world units per second.
    pub(super) velocity: Vec<Row>,
    /// The rows of kinematic particles that move, with how far in the tick.
    driven: Vec<(u32, Vec3)>,
}

/// The tables while constraints move particles, on any number of threads.
#[derive(Clone, Copy)]
pub struct MovingRows<'a> {
    pub(super) displacement: SharedRows<'a>,
    pub(super) previous: &'a [Row],
    pub(super) velocity: SharedRows<'a>,
}

impl MovingRows<'_> {
    /// Moves a kinematic particle.
    pub(super) fn place(self, row: u32, displacement: Vec3) {
        self.displacement.replace(row, displacement);
    }

    /// Sets the velocity of a kinematic particle from how far it has moved in a substep of `step` seconds.
    pub(super) fn set_speed(self, row: u32, step: f32) {
        let moved = self.displacement.row(row).vector() - self.previous.row(row).vector();
        self.velocity.replace(row, moved / step);
    }
}

impl ParticleRows {
    /// For constraints.
    pub fn moving(&mut self) -> MovingRows<'_> {
        let Self { displacement, previous, velocity, .. } = self;
        MovingRows { displacement: SharedRows::new(displacement), previous, velocity: SharedRows::new(velocity) }
    }

    /// Begins a tick.
    pub fn begin(&mut self, particles: impl Iterator<Item = Placed>) {
        let Self { displacement, previous, velocity, driven } = self;
        for table in [displacement, previous, velocity] {
            table.clear();
            table.push(Row::default());
        }
        driven.clear();
        self.extend(particles, 0.0);
    }

    /// The number of particles.
    #[must_use]
    pub fn count(&self) -> usize {
        self.displacement.len().saturating_sub(1)
    }

    /// Adds particles when `share` of the tick has passed. Free ones have not moved yet.
    pub fn extend(&mut self, particles: impl Iterator<Item = Placed>, share: f32) {
        let Self { displacement, previous, velocity, driven } = self;
        for Placed { way, velocity: speed, inverse_mass } in particles {
            let inverse_mass = inverse_mass as f32;
            let is_free = inverse_mass > 0.0;
            let way = if is_free { Vec3::ZERO } else { way.as_vec3() };
            if way != Vec3::ZERO {
                driven.push((displacement.len() as u32, way));
            }
            let speed = if is_free { speed.as_vec3() } else { Vec3::ZERO };
            let Vec3 { x, y, z } = way * share;
            let now = Row([x, y, z, inverse_mass]);
            displacement.push(now);
            previous.push(now);
            velocity.push(Row([speed.x, speed.y, speed.z, inverse_mass]));
        }
    }

    /// Keeps a share of the velocities of some consecutive particles.
    pub fn slow_down(&mut self, first: usize, count: usize, kept: f32) {
        let first = row_of(first) as usize;
        for row in &mut self.velocity[first..first + count] {
            row.set(row.vector() * kept);
        }
    }

    /// Applies forces to some particles over `step` seconds.
    pub fn apply_forces(&mut self, forces: &[(u32, Vec3)], step: f32) {
        for &(particle, force) in forces {
            let row = &mut self.velocity[row_of(particle as usize) as usize];
            row.set(row.vector() + force * (row.0[3] * step));
        }
    }

    /// Begins a substep of `step` seconds: applies gravity and moves every particle to its unconstrained position.
    /// Kinematic particles are at `share` of their way at the end of the substep.
    pub fn predict(&mut self, step: f32, gravity: Vec3, share: f32) {
        let Self { displacement, previous, velocity, driven } = self;
        let fall = Vec4::from((gravity * step, 0.0));
        let step_of_vector = Vec4::new(step, step, step, 0.0);
        for ((now, before), velocity) in displacement.iter_mut().zip(previous.iter_mut()).zip(velocity.iter_mut()) {
            *before = *now;
            let mut speed = Vec4::from(velocity.0);
            if speed.w > 0.0 {
                speed += fall;
                *velocity = Row(speed.to_array());
            }
            *now = Row((Vec4::from(now.0) + speed * step_of_vector).to_array());
        }
        for &(row, way) in &*driven {
            let row = row as usize;
            let now = way * share;
            velocity[row].set((now - previous[row].vector()) / step);
            displacement[row].set(now);
        }
    }

    /// Ends a substep: derives velocities from the change of positions.
    pub fn update_velocities(&mut self, step: f32) {
        let Self { displacement, previous, velocity, .. } = self;
        for ((now, before), velocity) in displacement.iter().zip(&*previous).zip(velocity) {
            let [x, y, z, _] = ((Vec4::from(now.0) - Vec4::from(before.0)) / step).to_array();
            *velocity = Row([x, y, z, now.0[3]]);
        }
    }

    /// Displacement of a particle since the beginning of the tick, and its velocity.
    #[must_use]
    pub fn state(&self, particle: usize) -> [DVec3; 2] {
        let row = row_of(particle) as usize;
        [&self.displacement, &self.velocity].map(|table| table[row].vector().as_dvec3())
    }
}

/// Writes a vector, rounded to f32, into a lane.
pub(super) fn set_lane(rows: &mut VectorRows, lane: usize, vector: DVec3) {
    rows.set(lane, vector.as_vec3());
}
