//! Bending constraint: the dihedral angle of two triangles at their common edge.
//!
//! Its value is `2 sin(θ/2)` of the dihedral angle θ, minus the value at rest. That equals the angle while it is small,
//! and has no jump where a hinge is folded flat. Gradients of the angle: Bridson, Marino and Fedkiw 2003, "Simulation
//! of Clothing with Folds and Wrinkles".

use glam::DVec3;

use crate::response::particles::Particles;

/// A triangle counts as degenerate if twice its area is below this share of the square of its longest edge.
const LEAST_AREA: f64 = 1.0e-9;

/// Largest displacement of a corner per solve, as a share of the triangle's height.
const FARTHEST: f64 = 0.2;

/// Underrelaxation: one solve removes this share of the error at zero compliance. Hinges around a vertex pull at the
/// same corners, and together would overshoot.
const RELAXATION: f64 = 0.5;

/// An inner edge, the two corners opposite it, and the bend at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Indices within the body: the ends of the edge, the third corner of the triangle wound along the edge, and the
    /// third corner of the triangle wound against it.
    pub corners: [u32; 4],
    /// `2 sin(θ/2)` at rest, from −2 to 2. θ is 0 if flat, and positive if the two triangles fall away from their
    /// normals.
    pub bend: f64,
}

struct Bend {
    value: f64,
    /// The smaller of the two triangles' heights over the edge.
    height: f64,
    gradients: [DVec3; 4],
}

/// Evaluates a hinge at four points. `None` if a triangle is degenerate.
fn bend(points: &[DVec3; 4]) -> Option<Bend> {
    let [start, end, left, right] = *points;
    let edge = end - start;
    let [left_start, left_end, right_start, right_end] = [left - start, left - end, right - start, right - end];
    let (normal_left, normal_right) = (edge.cross(left_start), right_start.cross(edge));
    let (area_left, area_right) = (normal_left.length_squared(), normal_right.length_squared());
    let length_squared = edge.length_squared();
    let sides = [left_start, left_end, right_start, right_end];
    let longest = sides.iter().map(|side| side.length_squared()).fold(length_squared, f64::max);
    let least = (LEAST_AREA * longest).powi(2);
    if length_squared == 0.0 || area_left <= least || area_right <= least {
        return None;
    }
    let length = length_squared.sqrt();
    let per_length = length.recip();
    let scale = (area_left * area_right).sqrt().recip();
    let cosine = (normal_left.dot(normal_right) * scale).clamp(-1.0, 1.0);
    let sine = normal_left.cross(normal_right).dot(edge) * (scale * per_length);
    // Half angles without inverse functions. Each branch uses the form that does not cancel.
    let (half_sine, half_cosine) = if cosine > 0.0 {
        let half_cosine = (0.5 * (1.0 + cosine)).sqrt();
        (0.5 * sine / half_cosine, half_cosine)
    } else {
        let half_sine = (0.5 * (1.0 - cosine)).sqrt();
        (half_sine.copysign(sine), 0.5 * sine.abs() / half_sine)
    };
    let (lift_left, lift_right) = (normal_left / area_left, normal_right / area_right);
    let along = |side: DVec3| side.dot(edge) * (per_length * half_cosine);
    let across = -length * half_cosine;
    let gradients = [
        lift_left * -along(left_end) - lift_right * along(right_end),
        lift_left * along(left_start) + lift_right * along(right_start),
        lift_left * across,
        lift_right * across,
    ];
    let height = area_left.min(area_right).sqrt() * per_length;
    Some(Bend { value: 2.0 * half_sine, height, gradients })
}

impl Hinge {
    /// The bend at four points; 0 if a triangle is degenerate.
    #[must_use]
    pub fn bend_at(points: &[DVec3; 4]) -> f64 {
        bend(points).map_or(0.0, |bend| bend.value)
    }

    /// Moves the four corners toward the bend at rest. `first` is the body's first particle, `compliance` is scaled to
    /// the substep (`α / h²`), and `multiplier` is the Lagrange multiplier accumulated in the substep.
    #[inline]
    pub fn solve(&self, particles: &mut Particles, first: usize, compliance: f64, multiplier: &mut f64) {
        let places = self.corners.map(|corner| first + corner as usize);
        let Some(bend) = bend(&places.map(|place| particles.position[place])) else { return };
        let weights = places.map(|place| particles.inverse_mass[place]);
        let squares = bend.gradients.map(DVec3::length_squared);
        let weight: f64 = (0..4).map(|corner| weights[corner] * squares[corner]).sum();
        if weight + compliance <= f64::MIN_POSITIVE {
            return;
        }
        let change = (self.bend - bend.value - compliance * *multiplier) / (weight / RELAXATION + compliance);
        // The gradients are only valid while no corner moves by more than a fraction of the height over the edge.
        let farthest = (0..4).map(|corner| squares[corner] * weights[corner].powi(2)).fold(0.0, f64::max).sqrt();
        let change = if farthest * change.abs() > FARTHEST * bend.height {
            (FARTHEST * bend.height / farthest).copysign(change)
        } else {
            change
        };
        *multiplier += change;
        for corner in 0..4 {
            particles.position[places[corner]] += bend.gradients[corner] * (weights[corner] * change);
        }
    }
}

#[cfg(test)]
pub(super) fn value_and_gradients(points: &[DVec3; 4]) -> Option<(f64, [DVec3; 4])> {
    bend(points).map(|bend| (bend.value, bend.gradients))
}
