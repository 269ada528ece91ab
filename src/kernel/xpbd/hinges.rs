//! Bend constraint: the dihedral angle of two triangles at their common edge.
//!
//! Its value is `2 sin(θ/2)` of the dihedral angle θ, minus the value at rest. That equals the angle while it is small,
//! and has no jump where a hinge is folded flat. Gradients of the angle: Bridson, Marino and Fedkiw 2003, "Simulation
//! of Clothing with Folds and Wrinkles".

use fearless_simd::{f32x8, mask32x8, prelude::*};
use glam::DVec3;

use super::{
    coloring::{Rests, lanes_of},
    rows::{MovingRows, NOBODY, Places, Starts, gather, place_in_lane, scatter_free},
};
use crate::kernel::simd::lanes::{VectorLanes, VectorRows, WIDTH};

/// A triangle counts as degenerate if twice its area is below this share of the square of its longest edge.
const LEAST_AREA: f32 = 1.0e-5;

/// Largest displacement of a corner per solve, as a share of the triangle's height.
const FARTHEST: f32 = 0.2;

/// Underrelaxation: one solve removes this share of the error at zero compliance. Hinges around a vertex pull at the
/// same corners, and together would overshoot.
const RELAXATION: f32 = 0.5;

/// The bend at four points: the ends of the edge, the third corner of the triangle wound along the edge, and the third
/// corner of the triangle wound against it. `2 sin(θ/2)`, from −2 to 2: 0 if flat, and positive if the two triangles
/// fall away from their normals. 0 if a triangle is degenerate.
#[must_use]
pub fn bend_at(&[start, end, left, right]: &[DVec3; 4]) -> f64 {
    let edge = end - start;
    let (normal_left, normal_right) = (edge.cross(left - start), (right - start).cross(edge));
    let (Some(unit_left), Some(unit_right)) = (normal_left.try_normalize(), normal_right.try_normalize()) else {
        return 0.0;
    };
    // Twice the sine of half the angle between two unit vectors is the length of their difference.
    let side = unit_left.cross(unit_right).dot(edge);
    (unit_left - unit_right).length().copysign(side)
}

/// The hinges of a body at rest: their corners, in the order of [`bend_at`], and their bends.
pub type HingeRests = Rests<4>;

/// Eight hinges that have no particle in common.
#[derive(Debug)]
#[repr(C, align(32))]
struct HingeBlock {
    corners: [Places; 4],
    /// From the first corner to each of the others, at the beginning of the tick.
    start: [VectorRows; 3],
    bend: [f32; WIDTH],
    multiplier: [f32; WIDTH],
}

/// Hinges in a tick, of a body in one slab, or between slabs.
#[derive(Debug, Default)]
pub struct Hinges {
    blocks: Vec<HingeBlock>,
}

impl Hinges {
    pub fn clear(&mut self) {
        self.blocks.clear();
    }

    /// Adds the hinges of a slab of a body whose particles begin with `first`, or those between slabs.
    pub fn add(&mut self, (rests, slab): (&HingeRests, usize), first: usize, start: Starts<'_>) {
        self.blocks.extend(rests.part(slab).iter().map(|numbers| {
            let mut block = HingeBlock {
                corners: [[NOBODY; WIDTH]; 4],
                start: [VectorRows::ZERO; 3],
                bend: [0.0; WIDTH],
                multiplier: [0.0; WIDTH],
            };
            for (lane, hinge) in lanes_of(numbers) {
                let corners = rests.particles[hinge].map(|corner| first + corner as usize);
                place_in_lane(lane, (&mut block.corners, &mut block.start), corners, start);
                block.bend[lane] = rests.values[hinge] as f32;
            }
            block
        }));
    }

    /// Forgets the Lagrange multipliers of the last substep.
    pub fn begin_step(&mut self) {
        self.blocks.iter_mut().for_each(|block| block.multiplier = [0.0; WIDTH]);
    }

    /// Moves the corners of every hinge toward its bend at rest, color after color. `compliance` is scaled to the
    /// substep (`α / h²`).
    pub fn solve(&mut self, rows: MovingRows<'_>, compliance: f32) {
        let blocks = &mut self.blocks;
        dispatch!(simd => {
            for block in &mut *blocks {
                block.solve(simd, rows, compliance);
            }
        });
    }
}

/// The bends of eight hinges.
struct Bend<S: Simd> {
    value: f32x8<S>,
    /// The smaller of the two triangles' heights over the edge.
    height: f32x8<S>,
    gradients: [VectorLanes<S>; 4],
    /// Where neither triangle is degenerate.
    exists: mask32x8<S>,
}

/// Evaluates hinges from the vectors from the first corner to the others.
#[cfg_attr(not(unoptimized), inline(always))]
fn bend<S: Simd>(simd: S, [edge, left, right]: [VectorLanes<S>; 3]) -> Bend<S> {
    let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
    let (left_end, right_end) = (left - edge, right - edge);
    let (normal_left, normal_right) = (edge.cross(left), right.cross(edge));
    let (area_left, area_right) = (normal_left.dot(normal_left), normal_right.dot(normal_right));
    let length_squared = edge.dot(edge);
    let sides = left.dot(left).max(left_end.dot(left_end)).max(right.dot(right)).max(right_end.dot(right_end));
    let least = sides.max(length_squared) * LEAST_AREA;
    let least = least * least;
    let exists = length_squared.simd_gt(zero) & area_left.simd_gt(least) & area_right.simd_gt(least);
    let length = length_squared.sqrt();
    let per_length = one / length;
    let (root_left, root_right) = (area_left.sqrt(), area_right.sqrt());
    let scale = one / (root_left * root_right);
    let cosine = (normal_left.dot(normal_right) * scale).max(-one).min(one);
    // The cross product of the two normals is along the edge, and as long as it times this determinant.
    let sine = -(normal_left.dot(right)) * length * scale;
    // Half angles without inverse functions. Each branch uses the form that does not cancel.
    let is_open = cosine.simd_gt(zero);
    let root = ((one + cosine.abs()) * 0.5).sqrt();
    let other = sine * 0.5 / root;
    let half_sine = is_open.select(other, sine.simd_lt(zero).select(-root, root));
    let half_cosine = is_open.select(root, other.abs());
    let lift_left = normal_left.scaled(one / area_left);
    let lift_right = normal_right.scaled(one / area_right);
    let per = per_length * half_cosine;
    let across = -length * half_cosine;
    let from_start = (left_end.dot(edge) * per, right_end.dot(edge) * per);
    let from_end = (left.dot(edge) * per, right.dot(edge) * per);
    let gradients = [
        lift_left.scaled(-from_start.0) - lift_right.scaled(from_start.1),
        lift_left.scaled(from_end.0).plus(lift_right.scaled(from_end.1)),
        lift_left.scaled(across),
        lift_right.scaled(across),
    ];
    let height = root_left.min(root_right) * per_length;
    Bend { value: half_sine * 2.0, height, gradients, exists }
}

impl HingeBlock {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn solve<S: Simd>(&mut self, simd: S, rows: MovingRows<'_>, compliance: f32) {
        let zero = f32x8::splat(simd, 0.0);
        let table = rows.displacement;
        let places = &self.corners;
        let corners = [
            gather(simd, &table, &places[0]),
            gather(simd, &table, &places[1]),
            gather(simd, &table, &places[2]),
            gather(simd, &table, &places[3]),
        ];
        let [edge, left, right] = &self.start;
        let origin = corners[0].vector;
        let edge = VectorLanes::load(simd, edge).plus(corners[1].vector - origin);
        let left = VectorLanes::load(simd, left).plus(corners[2].vector - origin);
        let right = VectorLanes::load(simd, right).plus(corners[3].vector - origin);
        let bend = bend(simd, [edge, left, right]);
        let mut weight = zero;
        let mut farthest = zero;
        for corner in 0..4 {
            let squared = bend.gradients[corner].dot(bend.gradients[corner]);
            weight += squared * corners[corner].inverse_mass;
            farthest = farthest.max(squared.sqrt() * corners[corner].inverse_mass);
        }
        let multiplier = f32x8::from_slice(simd, &self.multiplier);
        let is_solved = bend.exists & weight.simd_gt(zero);
        let missing = f32x8::from_slice(simd, &self.bend) - bend.value - multiplier * compliance;
        let change = missing / (weight * (1.0 / RELAXATION) + compliance);
        // The gradients are only valid while no corner moves by more than a fraction of the height over the edge.
        let most = bend.height * FARTHEST / farthest;
        let change = is_solved.select(change.min(most).max(-most), zero);
        (multiplier + change).store_slice(&mut self.multiplier);
        for corner in 0..4 {
            let push = VectorLanes::select(
                is_solved,
                bend.gradients[corner].scaled(change),
                VectorLanes { x: zero, y: zero, z: zero },
            );
            scatter_free(corners[corner].pushed(push), table, &places[corner]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hinge folded by some angle about the z axis.
    fn folded(angle: f64) -> [DVec3; 4] {
        [
            DVec3::new(0.0, 0.0, -0.4),
            DVec3::new(0.0, 0.0, 0.7),
            DVec3::new(-0.8, 0.0, 0.1),
            DVec3::new(0.6 * angle.cos(), -0.6 * angle.sin(), 0.2),
        ]
    }

    /// The value and the gradients of a hinge in the first lane.
    fn in_lanes(points: &[DVec3; 4]) -> (f64, [DVec3; 4]) {
        dispatch!(simd => {
            let lanes = |point: DVec3| VectorLanes::splat(simd, (point - points[0]).as_vec3());
            let bend = bend(simd, [lanes(points[1]), lanes(points[2]), lanes(points[3])]);
            assert!(bend.exists.all_true());
            let value = <[f32; WIDTH]>::from(bend.value)[0];
            (f64::from(value), bend.gradients.map(|gradient| gradient.stored().get(0).as_dvec3()))
        })
    }

    #[test]
    fn a_hinge_tells_twice_the_sine_of_half_its_angle() {
        let sign = bend_at(&folded(1.0)).signum();
        for step in -31..=31 {
            let angle = f64::from(step) * 0.1;
            let expected = sign * 2.0 * (0.5 * angle).sin();
            assert!((bend_at(&folded(angle)) - expected).abs() < 1e-12, "{angle}");
            assert!((in_lanes(&folded(angle)).0 - expected).abs() < 1e-6, "{angle}: {}", in_lanes(&folded(angle)).0);
        }
    }

    #[test]
    fn gradients_of_a_hinge_are_those_of_its_value() {
        let nudge = 1e-6;
        for angle in [-2.8, -1.5, -0.3, 0.05, 0.9, 2.0, 3.0] {
            let points = folded(angle);
            let (_, gradients) = in_lanes(&points);
            for corner in 0..4 {
                for axis in 0..3 {
                    let at = |by: f64| {
                        let mut points = points;
                        points[corner][axis] += by;
                        bend_at(&points)
                    };
                    let slope = (at(nudge) - at(-nudge)) / (2.0 * nudge);
                    assert!(
                        (slope - gradients[corner][axis]).abs() < 1e-5,
                        "{angle} {corner} {axis}: {slope} {gradients:?}"
                    );
                }
            }
        }
    }
}
