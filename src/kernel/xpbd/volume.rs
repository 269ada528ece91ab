//! Volume constraint of a closed body.

use std::ops::Range;

use fearless_simd::{f32x8, f64x8, prelude::*};
use glam::{DVec3, Vec3};

use super::{
    coloring::{Block, Coloring, lanes_of},
    rows::{Gathered, NOBODY, ParticleRows, Places, Row, Starts, gather, scatter, set_lane},
};
use crate::kernel::{
    mesh::volume::enclosed_volume,
    simd::lanes::{VectorLanes, VectorRows, WIDTH, widened},
};

/// A closed body at rest: its triangles, colored, and its volume.
#[derive(Clone, Debug)]
pub struct VolumeRest {
    triangles: Vec<[u32; 3]>,
    blocks: Vec<Block>,
    volume: f64,
}

impl VolumeRest {
    /// The body that triangles enclose. `None` unless the volume is positive: they are wound counter-clockwise as seen
    /// from outside.
    #[must_use]
    pub fn new(points: &[DVec3], triangles: &[[u32; 3]]) -> Option<Self> {
        let volume = enclosed_volume(points, triangles);
        let has_three = |&[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
        let triangles: Vec<[u32; 3]> = triangles.iter().copied().filter(has_three).collect();
        let mut blocks = Vec::new();
        let corners = |triangle: u32| triangles[triangle as usize];
        Coloring::default().blocks(points.len(), triangles.len(), corners, &mut blocks);
        (volume > 0.0).then_some(Self { triangles, blocks, volume })
    }

    /// In the unit of the points, cubed.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.volume
    }
}

/// Eight triangles that have no particle in common.
#[derive(Debug)]
struct TriangleBlock {
    corners: [Places; 3],
    /// From the body's first particle to each corner, at the beginning of the tick.
    start: [VectorRows; 3],
}

/// A body whose volume is kept, in a tick.
#[derive(Debug)]
struct Volume {
    blocks: Range<usize>,
    /// Its first particle, and their number.
    particles: (usize, usize),
    wanted: f64,
    multiplier: f64,
}

/// The volumes of all bodies in a tick.
#[derive(Debug, Default)]
pub struct Volumes {
    bodies: Vec<Volume>,
    blocks: Vec<TriangleBlock>,
    gradients: Vec<Row>,
}

impl Volumes {
    pub fn clear(&mut self) {
        self.bodies.clear();
        self.blocks.clear();
    }

    /// Adds the volume of a body with `count` particles from `first` on, and returns its place. `scale` is the world
    /// length of a unit of the body at rest.
    pub fn add(&mut self, rest: &VolumeRest, (first, count): (usize, usize), scale: f64, start: Starts<'_>) -> usize {
        let before = self.blocks.len();
        self.blocks.extend(rest.blocks.iter().map(|numbers| {
            let mut block = TriangleBlock { corners: [[NOBODY; WIDTH]; 3], start: [VectorRows::ZERO; 3] };
            for (lane, triangle) in lanes_of(numbers) {
                for (corner, vertex) in rest.triangles[triangle].into_iter().enumerate() {
                    let particle = first + vertex as usize;
                    block.corners[corner][lane] = start.row(particle);
                    set_lane(&mut block.start[corner], lane, start.offset(first, particle));
                }
            }
            block
        }));
        let wanted = rest.volume * scale.powi(3);
        let blocks = before..self.blocks.len();
        self.bodies.push(Volume { blocks, particles: (first, count), wanted, multiplier: 0.0 });
        self.bodies.len() - 1
    }

    /// Forgets the Lagrange multipliers of the last substep.
    pub fn begin_step(&mut self) {
        self.bodies.iter_mut().for_each(|volume| volume.multiplier = 0.0);
    }

    /// Moves all particles of a closed body toward its volume. `compliance` is scaled to the substep (`α / h²`).
    pub fn solve(&mut self, place: usize, particles: &mut ParticleRows, compliance: f64) {
        let Self { bodies, blocks, gradients } = self;
        let Volume { blocks: range, particles: (first, count), wanted, multiplier } = &mut bodies[place];
        let ParticleRows { displacement, rows, .. } = particles;
        let own = &rows[*first..*first + *count];
        // All others stay 0: those of other bodies are not read, and that of no particle gets nothing.
        gradients.resize(gradients.len().max(displacement.len()), Row::default());
        for &row in own {
            gradients[row as usize] = Row::default();
        }
        let blocks = &blocks[range.clone()];
        let origin = displacement[own[0] as usize].vector();
        let six_times = dispatch!(simd => add_gradients(simd, blocks, displacement, origin, gradients));
        let squared = |row: usize| gradients[row].vector().as_dvec3().length_squared();
        let weight: f64 =
            own.iter().map(|&row| f64::from(displacement[row as usize].0[3]) * squared(row as usize)).sum();
        if weight.is_nan() || weight + compliance <= f64::MIN_POSITIVE {
            return;
        }
        let change = (*wanted - six_times / 6.0 - compliance * *multiplier) / (weight + compliance);
        *multiplier += change;
        for &row in own {
            let (row, gradient) = (&mut displacement[row as usize], gradients[row as usize]);
            row.set(row.vector() + gradient.vector() * (f64::from(row.0[3]) * change) as f32);
        }
    }
}

/// Adds the gradients of a body's volume with respect to its particles, and returns six times the volume.
#[cfg_attr(not(unoptimized), inline(always))]
fn add_gradients<S: Simd>(
    simd: S,
    blocks: &[TriangleBlock],
    displacement: &[Row],
    origin: Vec3,
    gradients: &mut [Row],
) -> f64 {
    let origin = VectorLanes::splat(simd, origin);
    let sixth = f32x8::splat(simd, 1.0 / 6.0);
    let mut six_times = f64x8::splat(simd, 0.0);
    for block in blocks {
        let mut corners = [VectorLanes::splat(simd, Vec3::ZERO); 3];
        for corner in 0..3 {
            let moved = gather(simd, displacement, &block.corners[corner]).vector - origin;
            // The corners of an unused lane are all the row of no particle: one point, which encloses nothing.
            corners[corner] = VectorLanes::load(simd, &block.start[corner]).plus(moved);
        }
        let [a, b, c] = corners;
        let opposite = [b.cross(c), c.cross(a), a.cross(b)];
        let height = a.dot(opposite[0]);
        six_times += widened(height);
        for corner in 0..3 {
            let sum: Gathered<S> = gather(simd, gradients, &block.corners[corner]);
            let vector = sum.vector.plus(opposite[corner].scaled(sixth));
            scatter(Gathered { vector, ..sum }, gradients, &block.corners[corner]);
        }
    }
    let lanes = <[f64; WIDTH]>::from(six_times);
    lanes.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::xpbd::Placed;

    #[test]
    fn a_box_encloses_the_product_of_its_sides_and_goes_back_to_it() {
        let corner = |k: usize| DVec3::new((k & 1) as f64 * 2.0, (k >> 1 & 1) as f64 * 3.0, (k >> 2) as f64 * 5.0);
        let corners: Vec<DVec3> = (0..8).map(|k| corner(k) + 7.0e6).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let rest = VolumeRest::new(&corners, &triangles).expect("it is wound outwards");
        assert!((rest.volume() - 30.0).abs() < 1e-9);
        let inside_out: Vec<[u32; 3]> = triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert!(VolumeRest::new(&corners, &inside_out).is_none());
        // Squeezed along z to four fifths, with three iterations to get back.
        let squeezed: Vec<DVec3> = corners.iter().map(|corner| *corner * DVec3::new(1.0, 1.0, 0.8)).collect();
        let mut particles = ParticleRows::default();
        let still = Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: 1.0 };
        particles.begin(corners.iter().map(|_| still));
        let mut volumes = Volumes::default();
        let place = volumes.add(&rest, (0, 8), 1.0, particles.starts(&squeezed));
        (0..3).for_each(|_| volumes.solve(place, &mut particles, 0.0));
        let after: Vec<DVec3> = (0..8).map(|k| squeezed[k] + particles.state(k)[0]).collect();
        let volume = VolumeRest::new(&after, &triangles).expect("it is wound outwards").volume();
        assert!((volume - 30.0).abs() < 1e-3, "{volume}");
    }
}
