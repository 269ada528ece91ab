//! Volume constraint of a closed body.

use glam::DVec3;

use crate::response::particles::Particles;

/// Volume enclosed by triangles whose vertices start at index `first`. Positive if the triangles are wound
/// counter-clockwise as seen from outside.
#[must_use]
pub fn enclosed_volume(positions: &[DVec3], first: usize, triangles: &[[u32; 3]]) -> f64 {
    let origin = triangles.first().map_or(DVec3::ZERO, |triangle| positions[first + triangle[0] as usize]);
    let corner = |vertex: u32| positions[first + vertex as usize] - origin;
    let six_times: f64 = triangles.iter().map(|&[a, b, c]| corner(a).dot(corner(b).cross(corner(c)))).sum();
    six_times / 6.0
}

/// Moves all particles of a closed body toward a volume. `compliance` is scaled to the substep (`α / h²`), `multiplier`
/// is the Lagrange multiplier accumulated in it, and `gradients` is scratch memory.
pub fn solve_volume(
    particles: &mut Particles,
    (first, count): (usize, usize),
    triangles: &[[u32; 3]],
    volume: f64,
    compliance: f64,
    multiplier: &mut f64,
    gradients: &mut Vec<DVec3>,
) {
    gradients.clear();
    gradients.resize(count, DVec3::ZERO);
    let origin = particles.position[first];
    let mut six_times = 0.0;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| particles.position[first + vertex as usize] - origin);
        let opposite = [b.cross(c), c.cross(a), a.cross(b)];
        six_times += a.dot(opposite[0]);
        for (&vertex, gradient) in triangle.iter().zip(opposite) {
            gradients[vertex as usize] += gradient / 6.0;
        }
    }
    let weights = &particles.inverse_mass[first..first + count];
    let weight: f64 = weights.iter().zip(gradients.iter()).map(|(w, gradient)| w * gradient.length_squared()).sum();
    if weight + compliance <= f64::MIN_POSITIVE {
        return;
    }
    let change = (volume - six_times / 6.0 - compliance * *multiplier) / (weight + compliance);
    *multiplier += change;
    for (particle, gradient) in gradients.iter().enumerate() {
        let weight = particles.inverse_mass[first + particle];
        particles.position[first + particle] += *gradient * (weight * change);
    }
}
