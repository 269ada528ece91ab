//! Shape and volume of tetrahedra: a stable Neo-Hookean solid as two constraints.
//!
//! The energy per volume is `Ψ = μ/2 (I − 3) − μ (J − 1) + (λ + μ)/2 (J − 1)²`, with the deformation gradient `F`,
//! `I = tr(FᵀF)`, `J = det F`, and Lamé's parameters `λ` and `μ` (Smith, De Goes and Kim 2018, "Stable Neo-Hookean Flesh
//! Simulation"; as constraints, Macklin and Müller 2021, "A Constraint-based Formulation of Stable Neo-Hookean
//! Materials"). Their constraints are `√I` and `J − 1 − μ/λ`, which are not 0 at rest: two large forces cancel, and the
//! resistance to shear comes from second derivatives, which the method neglects. It then takes steps that are too long
//! where tetrahedra are stiff or small. But `Ψ = μ/2 C² + λ/2 H²` with `C = √(I − 4J + J²)` and `H = J − 1`. Both are 0 at
//! rest, and a step never overshoots by more than a spring's does. With `N = F − (2 − J) cof F`, the gradient of `C` by `F`
//! is `N / C`, and that of `H` is `cof F`.
//!
//! `I − 4J + J²` is not negative: of principal stretches with a product `J = t³ > 0`, `I ≥ 3t²`, and
//! `3t² − 4t³ + t⁶ = t² (t − 1)² (t² + 2t + 3)`. It is 0 only where nothing is deformed, and where a tetrahedron has
//! collapsed to a point.
//!
//! The energy of an inverted tetrahedron is finite, and contacts can flatten a corner of a body. So after contacts,
//! [a second pass](Tetrahedra::keep_upright) gives those that are nearly flat a share of their volume, whatever presses
//! them. It is as inelastic as contacts: the velocity that it would add is [removed](Tetrahedra::end_step). Otherwise heaps
//! would tremble forever.

mod deformation;
mod upright;

use fearless_simd::{f32x8, prelude::*};
use glam::{DMat3, DVec3};

use self::deformation::{Columns, Deformation, by_corners};
use super::{
    coloring::{Rests, in_order, lanes_of},
    rows::{Gathered, MovingRows, NOBODY, Places, Starts, gather, place_in_lane, scatter_free, set_lane},
};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH};

/// A tetrahedron counts as flat if six times its volume is below this share of the cube of its longest edge. In f32,
/// the deformation of flatter ones would be more rounding than strain.
const LEAST_VOLUME: f64 = 4.0e-3;

/// Largest displacement of a corner per solve, as a share of the size at rest. The gradients are only valid nearby.
const FARTHEST: f32 = 0.2;

/// At this `I` and below, which is a third of that at rest, the resistance of `C` fades: it would hold a tetrahedron
/// that has collapsed to a point.
const COLLAPSED: f32 = 1.0;

/// The least share of the resistance that is left then.
const LEAST_SHARE: f32 = 1.0e-6;

/// A tetrahedron that is flatter than this when a tick begins is tangled: only its elasticity can bring it back.
const TANGLED: f64 = 1.0e-3;

/// If more than one of so many are tangled, all are left to it.
const MOST_TANGLED: usize = 8;

/// How often all are visited there and back to that end, while one is flat: its neighbors press it.
const MOST_VISITS: usize = 32;

/// A tetrahedron at rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct TetrahedronRest {
    /// The inverse of the matrix of its edges from the first corner.
    inverse: DMat3,
    /// In the unit of the points, cubed.
    volume: f64,
    /// The determinant of the inverse, and the cube root of six volumes.
    density: f64,
    size: f64,
    is_flat: bool,
}

impl TetrahedronRest {
    /// With corners in any winding.
    #[must_use]
    pub fn new(&[origin, a, b, c]: &[DVec3; 4]) -> Self {
        let edges = DMat3::from_cols(a - origin, b - origin, c - origin);
        let six_times = edges.determinant().abs();
        let sides = [a - origin, b - origin, c - origin, b - a, c - b, a - c];
        let longest = sides.into_iter().map(DVec3::length).fold(0.0, f64::max);
        let is_flat = six_times.is_nan() || six_times <= LEAST_VOLUME * longest.powi(3);
        let inverse = if is_flat { DMat3::ZERO } else { edges.inverse() };
        let density = inverse.determinant();
        Self { inverse, volume: six_times / 6.0, density, size: six_times.cbrt(), is_flat }
    }

    /// Whether it is too flat to resist.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.is_flat
    }
}

/// The tetrahedra of a body at rest.
pub type TetrahedronRests = Rests<4, TetrahedronRest>;

/// How a body resists deformation.
#[derive(Clone, Copy, Debug)]
pub struct Elasticity {
    /// `μ` in pascals, times the square of the substep.
    shear: f32,
    /// `μ / λ`, from 0 if incompressible.
    ratio: f32,
}

impl Elasticity {
    /// From Young's modulus in pascals and Poisson's ratio from 0 to 0.5, for substeps of `step` seconds.
    #[must_use]
    pub fn new(young_modulus: f32, poisson_ratio: f32, step: f64) -> Self {
        let [young_modulus, poisson_ratio] = [young_modulus, poisson_ratio].map(f64::from);
        let shear = young_modulus / (2.0 * (1.0 + poisson_ratio)) * step * step;
        let ratio = (1.0 - 2.0 * poisson_ratio) / (2.0 * poisson_ratio);
        Self { shear: shear as f32, ratio: ratio.min(f64::from(f32::MAX)) as f32 }
    }
}

/// Eight tetrahedra that have no particle in common.
#[derive(Debug)]
struct TetrahedronBlock {
    corners: [Places; 4],
    /// From the first corner to each of the others, at the beginning of the tick.
    start: [VectorRows; 3],
    /// The rows of the inverse of these edges at rest.
    inverse: [VectorRows; 3],
    volume: [f32; WIDTH],
    /// The determinant of the inverse.
    density: [f32; WIDTH],
    /// The cube root of six volumes.
    size: [f32; WIDTH],
    /// Of `C` and `H`, as shares of `μ V h²`.
    multipliers: [[f32; WIDTH]; 2],
    /// 1 where the tetrahedron was kept upright in this substep, otherwise 0.
    raised: [f32; WIDTH],
}

/// Tetrahedra in a tick, of a body in one slab, or between slabs.
#[derive(Debug, Default)]
pub struct Tetrahedra {
    blocks: Vec<TetrahedronBlock>,
    /// How many there are, and how many of them are tangled.
    count: usize,
    tangled: usize,
    is_any_raised: bool,
}

impl Tetrahedra {
    pub fn clear(&mut self) {
        self.blocks.clear();
        (self.count, self.tangled) = (0, 0);
    }

    /// Adds the tetrahedra of a slab of a body whose particles begin with `first`, or those between slabs. `scale` is
    /// the world length of a unit at rest.
    pub fn add(&mut self, (rests, slab): (&TetrahedronRests, usize), first: usize, scale: f64, start: Starts<'_>) {
        let Self { blocks, count, tangled, .. } = self;
        blocks.extend(rests.part(slab).iter().map(|numbers| {
            let mut block = TetrahedronBlock {
                corners: [[NOBODY; WIDTH]; 4],
                start: [VectorRows::ZERO; 3],
                inverse: [VectorRows::ZERO; 3],
                volume: [0.0; WIDTH],
                density: [0.0; WIDTH],
                size: [0.0; WIDTH],
                multipliers: [[0.0; WIDTH]; 2],
                raised: [0.0; WIDTH],
            };
            for (lane, tetrahedron) in lanes_of(numbers) {
                let places = rests.particles[tetrahedron].map(|corner| first + corner as usize);
                let rest = &rests.values[tetrahedron];
                place_in_lane(lane, (&mut block.corners, &mut block.start), places, start);
                for edge in 0..3 {
                    set_lane(&mut block.inverse[edge], lane, rest.inverse.row(edge) / scale);
                }
                let [a, b, c] = [1, 2, 3].map(|corner| start.offset(places[0], places[corner]));
                let density = rest.density / scale.powi(3);
                *count += 1;
                *tangled += usize::from(DMat3::from_cols(a, b, c).determinant() * density <= TANGLED);
                block.volume[lane] = (rest.volume * scale.powi(3)) as f32;
                block.density[lane] = density as f32;
                block.size[lane] = (rest.size * scale) as f32;
            }
            block
        }));
    }

    /// Forgets the Lagrange multipliers of the last substep.
    pub fn begin_step(&mut self) {
        for block in &mut self.blocks {
            block.multipliers = [[0.0; WIDTH]; 2];
            block.raised = [0.0; WIDTH];
        }
        self.is_any_raised = false;
    }

    /// Moves the corners of every tetrahedron toward its shape at rest, color after color, in order or backward.
    pub fn solve(&mut self, rows: MovingRows<'_>, elasticity: Elasticity, is_backward: bool) {
        let blocks = &mut self.blocks;
        dispatch!(simd => {
            for place in in_order(blocks.len(), is_backward) {
                blocks[place].solve(simd, rows, elasticity);
            }
        });
    }

    /// Moves the corners of every tetrahedron that is inverted or nearly flat apart, to a small share of its volume,
    /// color after color, there and back. Returns whether any was. Does nothing if many were inverted when the tick
    /// began: to keep the others upright would hold them.
    pub fn keep_upright(&mut self, rows: MovingRows<'_>) -> bool {
        let Self { blocks, is_any_raised, .. } = self;
        if self.tangled * MOST_TANGLED > self.count {
            return false;
        }
        let mut is_any_now = false;
        dispatch!(simd => {
            for visit in 0..2 * MOST_VISITS {
                let mut is_any = false;
                for place in in_order(blocks.len(), visit % 2 == 1) {
                    is_any |= blocks[place].keep_upright(simd, rows);
                }
                if !is_any {
                    break;
                }
                is_any_now = true;
            }
        });
        *is_any_raised |= is_any_now;
        is_any_now
    }

    /// Whether any was moved in this substep to keep it upright.
    #[must_use]
    pub fn is_any_raised(&self) -> bool {
        self.is_any_raised
    }

    /// Removes the velocity with which tetrahedra that were kept upright in this substep unfold, after velocities have
    /// been derived: like contacts, they do not bounce.
    pub fn end_step(&self, rows: MovingRows<'_>) {
        if !self.is_any_raised {
            return;
        }
        let blocks = &self.blocks;
        dispatch!(simd => {
            for is_backward in [false, true] {
                for place in in_order(blocks.len(), is_backward) {
                    blocks[place].stop_unfolding(simd, rows);
                }
            }
        });
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }
}

impl TetrahedronBlock {
    /// The corners, and the edges from the first to the others.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn corners<S: Simd>(&self, simd: S, rows: MovingRows<'_>) -> ([Gathered<S>; 4], Columns<S>) {
        let (table, places) = (rows.displacement, &self.corners);
        let corners = [
            gather(simd, &table, &places[0]),
            gather(simd, &table, &places[1]),
            gather(simd, &table, &places[2]),
            gather(simd, &table, &places[3]),
        ];
        let origin = corners[0].vector;
        let mut edges = [origin; 3];
        for edge in 0..3 {
            edges[edge] = VectorLanes::load(simd, &self.start[edge]).plus(corners[edge + 1].vector - origin);
        }
        (corners, edges)
    }

    /// Pushes the corners, all by the same share of what would move one too far.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn push<S: Simd>(
        &self,
        simd: S,
        rows: MovingRows<'_>,
        corners: [Gathered<S>; 4],
        pushes: [VectorLanes<S>; 4],
    ) -> f32x8<S> {
        let mut farthest = f32x8::splat(simd, 0.0);
        for corner in 0..4 {
            let way = pushes[corner].scaled(corners[corner].inverse_mass);
            farthest = farthest.max(way.dot(way));
        }
        let most = f32x8::from_slice(simd, &self.size) * FARTHEST;
        let is_far = farthest.simd_gt(most * most);
        let share = is_far.select(most / farthest.sqrt(), f32x8::splat(simd, 1.0));
        for corner in 0..4 {
            let pushed = corners[corner].pushed(pushes[corner].scaled(share));
            scatter_free(pushed, rows.displacement, &self.corners[corner]);
        }
        share
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn solve<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>, elasticity: Elasticity) {
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let (corners, edges) = self.corners(simd, rows);
        let mut inverse = edges;
        for edge in 0..3 {
            inverse[edge] = VectorLanes::load(simd, &self.inverse[edge]);
        }
        let now = Deformation::new(edges, inverse);
        let shear = now.shear();
        let has_shear = shear.simd_gt(zero);
        let of_shear = by_corners(now.strain, inverse);
        let of_volume = by_corners(now.cofactors, inverse);
        let per_shear = has_shear.select(one / shear, zero);
        // In units of the stiffness `μ V h²`, one over the compliance, all sums are of moderate size.
        let stiffness = f32x8::from_slice(simd, &self.volume) * elasticity.shear;
        let (mut weight, mut both, mut other_weight) = (zero, zero, zero);
        for corner in 0..4 {
            let mass = corners[corner].inverse_mass * stiffness;
            weight += of_shear[corner].dot(of_shear[corner]) * mass;
            both += of_shear[corner].dot(of_volume[corner]) * mass;
            other_weight += of_volume[corner].dot(of_volume[corner]) * mass;
        }
        (weight, both) = (weight * (per_shear * per_shear), both * per_shear);
        let multipliers =
            [f32x8::from_slice(simd, &self.multipliers[0]), f32x8::from_slice(simd, &self.multipliers[1])];
        let compliance = one / (now.squares * (1.0 / COLLAPSED)).max(LEAST_SHARE).min(one);
        let change = -(shear + compliance * multipliers[0]) / (weight + compliance);
        // The volume is solved after the shape, without evaluating it again.
        let missing = one - now.volume - multipliers[1] * elasticity.ratio - both * change;
        let other_change = missing / (other_weight + elasticity.ratio);
        let is_solved = (weight + other_weight).simd_gt(zero);
        let [change, other_change] = [is_solved.select(change, zero), is_solved.select(other_change, zero)];
        let (by_shear, by_volume) = (change * per_shear * stiffness, other_change * stiffness);
        let mut pushes = of_shear;
        for corner in 0..4 {
            pushes[corner] = of_shear[corner].scaled(by_shear).plus(of_volume[corner].scaled(by_volume));
        }
        let share = self.push(simd, rows, corners, pushes);
        (multipliers[0] + change * share).store_slice(&mut self.multipliers[0]);
        (multipliers[1] + other_change * share).store_slice(&mut self.multipliers[1]);
    }
}

#[cfg(test)]
mod tests {
    use circumsphere_support::random::Random;

    use super::{
        deformation::tests::{REST, invariants, moved},
        *,
    };
    use crate::kernel::xpbd::{ParticleRows, Placed, Slabs};

    /// A tick that begins with one tetrahedron at these corners.
    fn tick(corners: &[DVec3; 4]) -> Tetrahedra {
        let mut slabs = Slabs::default();
        slabs.split(corners);
        let rests = TetrahedronRests::new(4, &slabs, [([0, 1, 2, 3], TetrahedronRest::new(&REST))].into_iter());
        let mut tetrahedra = Tetrahedra::default();
        let mut rows = ParticleRows::default();
        rows.begin([Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: 1.0 }; 4].into_iter());
        tetrahedra.add((&rests, 0), 0, 1.0, rows.starts(corners));
        tetrahedra
    }

    /// Solves one tetrahedron so many times in a substep, and returns its corners.
    fn solved(corners: &[DVec3; 4], masses: [f64; 4], elasticity: Elasticity, times: usize) -> [DVec3; 4] {
        let mut particles = ParticleRows::default();
        let placed = |mass: f64| Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: mass.recip() };
        particles.begin(masses.into_iter().map(placed));
        let mut tetrahedra = tick(corners);
        (0..times).for_each(|_| tetrahedra.solve(particles.moving(), elasticity, false));
        std::array::from_fn(|corner| corners[corner] + particles.state(corner)[0])
    }

    #[test]
    fn what_is_at_rest_stays_and_momenta_are_kept() {
        let mut random = Random::new(0x0040);
        let masses = [1.0, 2.0, 0.5, 3.0];
        for young_modulus in [1.0, 1.0e3, 1.0e6, 1.0e12] {
            let elasticity = Elasticity::new(young_modulus, 0.4, 1.0);
            let turn = glam::DQuat::from_rotation_y(2.0) * glam::DQuat::from_rotation_x(0.7);
            let turned = REST.map(|corner| turn * corner + 1.0e6);
            let after = solved(&turned, masses, elasticity, 10);
            assert!((0..4).all(|corner| after[corner].distance(turned[corner]) < 2.0e-5), "{turned:?} {after:?}");
            let before = moved(&mut random, 0.3);
            let after = solved(&before, masses, elasticity, 1);
            let way = |corner: usize| masses[corner] * (after[corner] - before[corner]);
            let size = (0..4).map(|corner| way(corner).length()).sum::<f64>();
            let momentum: DVec3 = (0..4).map(way).sum();
            let angular: DVec3 = (0..4).map(|corner| before[corner].cross(way(corner))).sum();
            assert!(size > 1.0e-3 && momentum.length() < 1.0e-6 * size, "{size} {momentum}");
            assert!(angular.length() < 1.0e-5 * size, "{size} {angular}");
        }
    }

    #[test]
    fn a_stiff_tetrahedron_gets_its_shape_back_even_if_inverted_or_collapsed() {
        let elasticity = Elasticity::new(1.0e9, 0.4, 1.0);
        let mirrored = REST.map(|corner| corner * DVec3::new(1.0, -1.0, 1.0));
        let collapsed = REST.map(|corner| corner * 0.01);
        let flat = REST.map(|corner| corner * DVec3::new(1.0, 1.0, 1.0e-6));
        for corners in [mirrored, collapsed, flat] {
            let after = solved(&corners, [1.0; 4], elasticity, 200);
            let [squares, volume] = invariants(&after);
            assert!((volume - 1.0).abs() < 1.0e-3 && (squares - 3.0).abs() < 1.0e-2, "{volume} {squares}");
        }
    }

    #[test]
    fn nothing_is_left_inverted_and_what_is_not_flat_is_not_touched() {
        let masses = [1.0, 2.0, 0.5, 3.0];
        let upright = |corners: &[DVec3; 4], times: usize| {
            let mut particles = ParticleRows::default();
            let placed = |mass: f64| Placed { way: DVec3::ZERO, velocity: DVec3::ZERO, inverse_mass: mass.recip() };
            particles.begin(masses.into_iter().map(placed));
            // They are pressed within the tick.
            let mut tetrahedra = Tetrahedra { tangled: 0, ..tick(corners) };
            for _ in 0..times {
                tetrahedra.keep_upright(particles.moving());
            }
            (tetrahedra.is_any_raised(), std::array::from_fn(|corner| corners[corner] + particles.state(corner)[0]))
        };
        for height in [1.0, 0.06, 0.04, 0.0, -0.3, -1.0] {
            // Pressed along z, around a corner.
            let pressed = REST.map(|corner| corner * DVec3::new(1.0, 1.0, height));
            let (acted, after) = upright(&pressed, 30);
            let [_, volume] = invariants(&after);
            if height > 0.05 {
                assert!(!acted && after == pressed, "{height}");
                continue;
            }
            // A solve is a linear step, and goes a little too far.
            assert!((0.0499..0.052).contains(&volume) && acted, "{height}: {volume} {acted}");
            let momentum: DVec3 = (0..4).map(|corner| masses[corner] * (after[corner] - pressed[corner])).sum();
            assert!(momentum.length() < 1.0e-5, "{momentum}");
        }
    }

    #[test]
    fn flat_tetrahedra_are_told_from_others() {
        let flat = |height: f64| TetrahedronRest::new(&[DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z * height]).is_flat();
        // The longest edge is √2.
        assert!(flat(0.0) && flat(1.13e-2) && !flat(1.14e-2) && !flat(-1.0));
        assert!((TetrahedronRest::new(&[DVec3::ZERO, DVec3::X, DVec3::Z, DVec3::Y]).volume - 1.0 / 6.0).abs() < 1e-15);
    }
}
