//! Morphs and skins vertices as Bevy's vertex shader does: morph first, then skin, no normalization of weights.
//!
//! Before everything else in the flow: rest positions come in, the positions of this tick go out.

use bevy_math::Affine3A;
use glam::{Vec3, Vec3A};

/// The joints that move a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Influences {
    /// Indices of joints. Any index where the weight is 0.
    pub joints: [u16; 4],
    /// The weights of these joints. They usually sum to 1.
    pub weights: [f32; 4],
}

impl Influences {
    /// The joints with a weight other than 0, and these weights.
    pub fn acting(&self) -> impl Iterator<Item = (u16, f32)> {
        self.joints.into_iter().zip(self.weights).filter(|&(_, weight)| weight != 0.0)
    }
}

/// Moves vertices by morph targets. `displacements` holds one displacement per vertex for each target in turn, and
/// `weights` one weight per target. Targets without a weight, and weights without a target, are ignored.
pub fn morph(positions: &[Vec3], displacements: &[Vec3], weights: &[f32], morphed: &mut Vec<Vec3>) {
    morphed.clear();
    morphed.extend_from_slice(positions);
    let targets = displacements.chunks_exact(positions.len().max(1));
    for (target, &weight) in targets.zip(weights).filter(|&(_, &weight)| weight != 0.0) {
        for (position, &displacement) in morphed.iter_mut().zip(target) {
            *position += weight * displacement;
        }
    }
}

/// Moves vertices with their joints: each by the weighted sum of its joints' matrices. `joints` are the matrices from
/// the mesh to the world.
///
/// # Panics
/// If a weight other than 0 names a joint that does not exist.
pub fn skin(positions: &[Vec3], influences: &[Influences], joints: &[Affine3A], skinned: &mut Vec<Vec3>) {
    skinned.clear();
    skinned.extend(positions.iter().zip(influences).map(|(position, influences)| {
        let [mut x, mut y, mut z, mut translation] = [Vec3A::ZERO; 4];
        for (joint, weight) in influences.acting() {
            let joint = &joints[joint as usize];
            x += weight * joint.matrix3.x_axis;
            y += weight * joint.matrix3.y_axis;
            z += weight * joint.matrix3.z_axis;
            translation += weight * joint.translation;
        }
        Vec3::from(x * position.x + y * position.y + z * position.z + translation)
    }));
}

/// The joint with the largest weight at a point of a triangle: the weights of its corners' `influences`, interpolated by
/// the barycentric weights of the point. Of several, the lowest. `None` if no joint has a positive weight there.
#[must_use]
pub fn dominant_joint(influences: [&Influences; 3], barycentric: [f32; 3]) -> Option<u16> {
    let at_point = |joint: u16| -> f64 {
        let at_corner = |influences: &Influences| -> f64 {
            influences.acting().filter(|&(other, _)| other == joint).map(|(_, weight)| f64::from(weight)).sum()
        };
        influences.iter().zip(barycentric).map(|(corner, share)| f64::from(share) * at_corner(corner)).sum()
    };
    let joints = influences.iter().flat_map(|corner| corner.acting()).map(|(joint, _)| (at_point(joint), joint));
    let (_, joint) = joints
        .filter(|&(weight, _)| weight > 0.0)
        .max_by(|(weight, joint), (other_weight, other)| weight.total_cmp(other_weight).then(other.cmp(joint)))?;
    Some(joint)
}
