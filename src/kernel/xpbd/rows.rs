//! The state of particles in a tick, one row of four numbers each.
//!
//! Rows are in the order in which threads work on them, with gaps: threads that write to one line of the cache slow each
//! other down, even if they write different rows.

mod lanes;

use std::iter::zip;

use arrayvec::ArrayVec;
use glam::{DVec3, Vec3, Vec4};

pub(super) use self::lanes::{
    Gathered, NOBODY, Places, Row, Rows, SharedRows, gather, scatter, scatter_free, set_lane,
};
use super::slabs::{MOST_SLABS, Slabs};
use crate::kernel::simd::{
    lanes::VectorRows,
    parallel::{Team, share},
};

/// Stands for rows that are left out in an order of particles.
const GAP: u32 = u32::MAX;

/// The rows in two lines of the cache: processors load neighboring lines in pairs.
const LINES: u32 = 128 / size_of::<Row>() as u32;

/// Rows between two gaps in a slab. Parts that are smaller are hardly worked on by different threads.
const LEAST_APART: usize = 64;

/// Where particles begin a tick: their positions, and their rows.
#[derive(Clone, Copy, Debug)]
pub struct Starts<'a> {
    positions: &'a [DVec3],
    rows: &'a [u32],
    ends: &'a [usize],
}

impl<'a> Starts<'a> {
    /// The number of particles.
    pub(super) const fn len(&self) -> usize {
        self.rows.len()
    }

    /// The end of the rows of each slab.
    pub(super) const fn ends(&self) -> &'a [usize] {
        self.ends
    }

    pub(super) fn row(&self, particle: usize) -> u32 {
        self.rows[particle]
    }

    pub(super) fn position(&self, particle: usize) -> DVec3 {
        self.positions[particle]
    }

    /// The vector from one particle to another.
    pub(super) fn offset(&self, from: usize, to: usize) -> DVec3 {
        self.positions[to] - self.positions[from]
    }
}

/// Puts a constraint into a lane: the rows of its particles, and where those after the first start, relative to it.
pub(super) fn place_in_lane<const N: usize, const M: usize>(
    lane: usize,
    (corners, offsets): (&mut [Places; N], &mut [VectorRows; M]),
    particles: [usize; N],
    start: Starts<'_>,
) {
    for (places, particle) in zip(corners, particles) {
        places[lane] = start.row(particle);
    }
    for (offset, &particle) in zip(offsets, &particles[1..]) {
        set_lane(offset, lane, start.offset(particles[0], particle));
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
    /// The row of each particle. Those that were arranged come first.
    pub(super) rows: Vec<u32>,
    arranged: usize,
    /// The number of rows that were arranged, with gaps.
    end: usize,
    /// The end of the rows of each slab. The last has those that were not arranged, too.
    ends: ArrayVec<usize, MOST_SLABS>,
    /// For each slab, its particles in order, and [`GAP`]s. Only used while rows are arranged.
    order: [Vec<u32>; MOST_SLABS],
}

/// The rows of a slab.
struct SlabRows<'a> {
    displacement: &'a mut [Row],
    previous: &'a mut [Row],
    velocity: &'a mut [Row],
}

/// The tables while constraints move particles, on any number of threads.
#[derive(Clone, Copy)]
pub struct MovingRows<'a> {
    pub(super) displacement: SharedRows<'a>,
    pub(super) previous: &'a [Row],
    pub(super) velocity: SharedRows<'a>,
    rows: &'a [u32],
    ends: &'a [usize],
}

impl<'a> MovingRows<'a> {
    /// The particles, which begin the tick at `positions`.
    pub fn starts(self, positions: &'a [DVec3]) -> Starts<'a> {
        let Self { rows, ends, .. } = self;
        Starts { positions, rows, ends }
    }

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

impl SlabRows<'_> {
    /// Applies gravity, whose change of velocity is `fall`, and moves particles for a substep.
    fn predict(&mut self, step: f32, fall: Vec3) {
        let fall = Vec4::from((fall, 0.0));
        let step = Vec4::new(step, step, step, 0.0);
        for ((now, before), velocity) in zip(zip(&mut *self.displacement, &mut *self.previous), &mut *self.velocity) {
            *before = *now;
            let mut speed = Vec4::from(velocity.0);
            if speed.w > 0.0 {
                speed += fall;
                *velocity = Row(speed.to_array());
            }
            *now = Row((Vec4::from(now.0) + speed * step).to_array());
        }
    }

    fn update_velocities(&mut self, step: f32) {
        for ((now, before), velocity) in zip(zip(&*self.displacement, &*self.previous), &mut *self.velocity) {
            let [x, y, z, _] = ((Vec4::from(now.0) - Vec4::from(before.0)) / step).to_array();
            *velocity = Row([x, y, z, now.0[3]]);
        }
    }
}

impl ParticleRows {
    /// For constraints.
    pub fn moving(&mut self) -> MovingRows<'_> {
        let Self { displacement, previous, velocity, rows, ends, .. } = self;
        let [displacement, velocity] = [displacement, velocity].map(|table| SharedRows::new(table));
        MovingRows { displacement, previous, velocity, rows, ends }
    }

    /// The particles, which begin the tick at `positions`.
    #[must_use]
    pub fn starts<'a>(&'a self, positions: &'a [DVec3]) -> Starts<'a> {
        Starts { positions, rows: &self.rows, ends: &self.ends }
    }

    /// The rows of a slab, for each of them. The last has those of all others.
    fn slabs(&mut self) -> ArrayVec<SlabRows<'_>, MOST_SLABS> {
        let Self { displacement, previous, velocity, ends, .. } = self;
        let (mut displacement, mut previous, mut velocity) =
            (&mut displacement[..], &mut previous[..], &mut velocity[..]);
        let mut first = 0;
        let slabs = ends.iter().map(|&end| {
            let size = end - first;
            first = end;
            SlabRows {
                displacement: displacement.split_off_mut(..size).unwrap_or_default(),
                previous: previous.split_off_mut(..size).unwrap_or_default(),
                velocity: velocity.split_off_mut(..size).unwrap_or_default(),
            }
        });
        slabs.collect()
    }

    /// Orders the rows of `count` particles for a tick, by slabs, and in a slab by parts, which are worked on by a thread
    /// each. Rows stay in this order until they are arranged again.
    pub fn arrange<Part: Iterator<Item = u32>>(
        &mut self,
        slabs: &Slabs,
        count: usize,
        parts: impl Iterator<Item = Part>,
    ) {
        let Self { rows, arranged, end, ends, order, .. } = self;
        rows.clear();
        rows.resize(count, NOBODY);
        order.iter_mut().for_each(Vec::clear);
        let mut gaps = [0; MOST_SLABS];
        for part in parts {
            for (list, gap) in zip(&mut *order, &mut gaps) {
                if list.len() - *gap >= LEAST_APART {
                    list.push(GAP);
                    *gap = list.len();
                }
            }
            part.for_each(|particle| order[slabs.of(particle)].push(particle));
        }
        let mut next = NOBODY + 1;
        ends.clear();
        for list in &order[..slabs.count()] {
            for &particle in list {
                if particle == GAP {
                    next += LINES;
                } else {
                    rows[particle as usize] = next;
                    next += 1;
                }
            }
            next += LINES;
            ends.push(next as usize);
        }
        for row in rows.iter_mut().filter(|row| **row == NOBODY) {
            *row = next;
            next += 1;
        }
        ends.pop();
        ends.push(next as usize);
        (*arranged, *end) = (count, next as usize);
    }

    /// Begins a tick.
    pub fn begin(&mut self, mut particles: impl Iterator<Item = Placed>) {
        let Self { displacement, previous, velocity, driven, rows, arranged, end, .. } = self;
        rows.truncate(*arranged);
        for table in [displacement, previous, velocity] {
            table.clear();
            table.resize((*end).max(1), Row::default());
        }
        driven.clear();
        for particle in 0..self.rows.len() {
            let Some(placed) = particles.next() else { return };
            self.put(self.rows[particle], placed, 0.0);
        }
        self.extend(particles, 0.0);
    }

    /// The number of particles.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows.len()
    }

    /// Adds particles when `share` of the tick has passed. Free ones have not moved yet.
    pub fn extend(&mut self, particles: impl Iterator<Item = Placed>, share: f32) {
        for placed in particles {
            let row = self.displacement.len() as u32;
            self.rows.push(row);
            for table in [&mut self.displacement, &mut self.previous, &mut self.velocity] {
                table.push(Row::default());
            }
            self.put(row, placed, share);
        }
        self.ends.pop();
        self.ends.push(self.displacement.len());
    }

    /// Sets the row of a particle when `share` of the tick has passed.
    fn put(&mut self, row: u32, Placed { way, velocity: speed, inverse_mass }: Placed, share: f32) {
        let Self { displacement, previous, velocity, driven, .. } = self;
        let inverse_mass = inverse_mass as f32;
        let is_free = inverse_mass > 0.0;
        let way = if is_free { Vec3::ZERO } else { way.as_vec3() };
        if way != Vec3::ZERO {
            driven.push((row, way));
        }
        let speed = if is_free { speed.as_vec3() } else { Vec3::ZERO };
        let Vec3 { x, y, z } = way * share;
        let (now, row) = (Row([x, y, z, inverse_mass]), row as usize);
        (displacement[row], previous[row]) = (now, now);
        velocity[row] = Row([speed.x, speed.y, speed.z, inverse_mass]);
    }

    /// Keeps a share of the velocities of some consecutive particles.
    pub fn slow_down(&mut self, first: usize, count: usize, kept: f32) {
        for &row in &self.rows[first..first + count] {
            let row = &mut self.velocity[row as usize];
            row.set(row.vector() * kept);
        }
    }

    /// Applies forces to some particles over `step` seconds.
    pub fn apply_forces(&mut self, forces: &[(u32, Vec3)], step: f32) {
        for &(particle, force) in forces {
            let row = &mut self.velocity[self.rows[particle as usize] as usize];
            row.set(row.vector() + force * (row.0[3] * step));
        }
    }

    /// Begins a substep of `step` seconds: applies gravity and moves every particle to its unconstrained position.
    /// At its end a share of the tick has `passed`, and kinematic particles are at as much of their way.
    pub fn predict(&mut self, team: &dyn Team, step: f32, gravity: Vec3, passed: f32) {
        share(team, &mut self.slabs(), |slab| slab.predict(step, gravity * step));
        let Self { displacement, previous, velocity, driven, .. } = self;
        for &(row, way) in &*driven {
            let row = row as usize;
            let now = way * passed;
            velocity[row].set((now - previous[row].vector()) / step);
            displacement[row].set(now);
        }
    }

    /// Ends a substep: derives velocities from the change of positions.
    pub fn update_velocities(&mut self, team: &dyn Team, step: f32) {
        share(team, &mut self.slabs(), |slab| slab.update_velocities(step));
    }

    /// Displacement of a particle since the beginning of the tick, and its velocity.
    #[must_use]
    pub fn state(&self, particle: usize) -> [DVec3; 2] {
        let row = self.rows[particle] as usize;
        [&self.displacement, &self.velocity].map(|table| table[row].vector().as_dvec3())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::simd::parallel::Sequential;

    /// 1,200 particles in two slabs, in parts that cross them, and one in none.
    #[test]
    fn what_different_threads_write_is_in_different_lines_and_particles_are_found_wherever_they_are() {
        let at = |particle: u32| DVec3::X * f64::from(particle * 7 % 60) * 30.0;
        let positions: Vec<DVec3> = (0..1200).map(|particle| at(particle % 60) + f64::from(particle) * 1e-3).collect();
        let mut slabs = Slabs::default();
        slabs.split(&positions);
        assert_eq!(slabs.count(), 2);
        let part_of = |particle: u32| particle / 500;
        let left_out = 77;
        let parts = (0..3).map(|part| (0..1200).filter(move |&own| own != left_out && part_of(own) == part));
        let mut rows = ParticleRows::default();
        rows.arrange(&slabs, positions.len(), parts);
        let placed =
            |particle: usize| Placed { way: DVec3::ZERO, velocity: DVec3::Y * particle as f64, inverse_mass: 1.0 };
        for _ in 0..2 {
            rows.begin((0..1205).map(placed));
            assert_eq!(rows.count(), 1205, "five were appended");
            rows.predict(&Sequential, 0.5, Vec3::X, 1.0);
            rows.update_velocities(&Sequential, 0.5);
            for particle in 0..1205 {
                let [moved, velocity] = rows.state(particle);
                let expected = DVec3::new(0.5, particle as f64, 0.0);
                assert_eq!([moved, velocity], [expected * 0.5, expected], "{particle}");
            }
        }
        let starts = rows.starts(&positions);
        let key = |particle: u32| (slabs.of(particle), part_of(particle));
        let mut seen = std::collections::BTreeSet::new();
        for particle in 0..1200 {
            let row = starts.row(particle as usize);
            assert!(row != NOBODY && seen.insert(row), "{particle} has no row of its own");
            let is_in_slab = |slab: usize| slab == 0 || row as usize >= starts.ends()[slab - 1];
            assert!(
                particle == left_out || is_in_slab(key(particle).0) && (row as usize) < starts.ends()[key(particle).0]
            );
        }
        let mut order: Vec<u32> = (0..1200).filter(|&particle| particle != left_out).collect();
        order.sort_by_key(|&particle| starts.row(particle as usize));
        let mut borders = 0;
        for pair in order.windows(2) {
            let [before, after] = [pair[0], pair[1]].map(|particle| starts.row(particle as usize));
            let is_border = key(pair[0]) != key(pair[1]);
            assert_eq!(after - before, if is_border { LINES + 1 } else { 1 }, "{pair:?}");
            borders += usize::from(is_border);
        }
        assert_eq!(borders, 5);
        // Small parts are not apart.
        rows.arrange(&slabs, positions.len(), (0..1200).map(|particle| [particle].into_iter()));
        let ends = rows.starts(&positions).ends();
        assert!(ends[1] - 1200 < 25 * LINES as usize, "{ends:?}");
    }
}
