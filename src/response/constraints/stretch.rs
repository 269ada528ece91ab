//! Stretch constraint: the distance of two particles.

use glam::DVec3;

use crate::response::particles::Particles;

/// Highest rate at which an edge recovers its rest length, in rest lengths per second. A stiff edge would recover
/// within one substep, and an edge stretched to several lengths would be thrown about faster than contacts can follow.
const RECOVERY: f64 = 100.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// The particles at its ends, as indices within the body.
    pub ends: [u32; 2],
    /// Rest length in world units, 0 or more.
    pub length: f64,
}

impl Spring {
    /// Moves both ends toward the rest length. `first` is the body's first particle, `compliance` is scaled to the
    /// substep (`α / h²`), `step` is its duration in seconds, and `multiplier` is the Lagrange multiplier accumulated
    /// in it. The error that existed at the beginning of the substep is removed at [`RECOVERY`].
    #[inline]
    pub fn solve(&self, particles: &mut Particles, first: usize, compliance: f64, step: f64, multiplier: &mut f64) {
        let [a, b] = self.ends.map(|end| first + end as usize);
        let [weight_a, weight_b] = [particles.inverse_mass[a], particles.inverse_mass[b]];
        let weight = weight_a + weight_b;
        if weight == 0.0 {
            return;
        }
        let between = particles.position[a] - particles.position[b];
        let length = between.length();
        // Coincident ends have no direction to separate in. Another constraint will move them.
        if length == 0.0 {
            return;
        }
        let direction: DVec3 = between / length;
        let missing = self.length - length;
        let mut change = (missing - compliance * *multiplier) / (weight + compliance);
        let pace = RECOVERY * step * self.length;
        if missing.abs() > pace {
            let before = self.length - particles.previous[a].distance(particles.previous[b]);
            let left = if before * missing > 0.0 { (before.abs() - pace).max(0.0) } else { 0.0 };
            let most = (missing.abs() - left).max(0.0) / weight;
            change = change.clamp(-most, most);
        }
        *multiplier += change;
        particles.position[a] += direction * (change * weight_a);
        particles.position[b] -= direction * (change * weight_b);
    }

    /// Removes a share of the relative velocity along the edge. Momentum is preserved.
    #[inline]
    pub fn damp(&self, particles: &mut Particles, first: usize, share: f64) {
        let [a, b] = self.ends.map(|end| first + end as usize);
        let [weight_a, weight_b] = [particles.inverse_mass[a], particles.inverse_mass[b]];
        let weight = weight_a + weight_b;
        let between = particles.position[a] - particles.position[b];
        let squared = between.length_squared();
        if weight == 0.0 || squared == 0.0 {
            return;
        }
        let opening = between.dot(particles.velocity[a] - particles.velocity[b]);
        let change = between * (-share * opening / (squared * weight));
        particles.velocity[a] += change * weight_a;
        particles.velocity[b] -= change * weight_b;
    }
}
