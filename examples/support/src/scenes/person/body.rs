//! The limbs of the person: their shape, what moves them, and their colors.

use super::{
    super::points::{Point, advance, between, dot, subtract},
    ARMS, HEAD, HIPS, LEGS, SPINE,
};

/// Distance within which limbs melt into each other, in meters.
const MELT: f64 = 0.035;

/// The same within the trunk.
const TRUNK_MELT: f64 = 0.06;

/// Distance over which the influence of a limb on the vertices of another falls off, in meters.
const FALLOFF: f64 = 0.022;

/// What a limb is clothed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cloth {
    Bare,
    Head,
    Tunic,
    Trousers,
    Boot,
}

/// A capsule whose radius changes along its axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limb {
    joint: usize,
    ends: [Point; 2],
    radii: [f64; 2],
    cloth: Cloth,
}

/// All limbs of the standing person.
pub(super) fn limbs() -> Vec<Limb> {
    let limb = |joint, from, to, radii, cloth| Limb { joint, ends: [from, to], radii, cloth };
    let across = |joint, half: f64, height, depth, radius, cloth| {
        limb(joint, [-half, height, depth], [half, height, depth], [radius; 2], cloth)
    };
    let mut limbs = vec![
        across(HIPS, 0.075, 0.94, 0.0, 0.1, Cloth::Trousers),
        across(HIPS, 0.06, 1.05, 0.0, 0.088, Cloth::Tunic),
        across(SPINE, 0.065, 1.15, 0.0, 0.09, Cloth::Tunic),
        across(SPINE, 0.08, 1.25, 0.0, 0.1, Cloth::Tunic),
        across(SPINE, 0.1, 1.34, -0.005, 0.095, Cloth::Tunic),
        across(SPINE, 0.1, 1.4, -0.012, 0.06, Cloth::Tunic),
        limb(SPINE, [0.0, 1.42, -0.015], [0.0, 1.5, -0.005], [0.055, 0.048], Cloth::Bare),
        limb(HEAD, [0.0, 1.5, -0.005], [0.0, 1.55, 0.005], [0.048, 0.05], Cloth::Bare),
        limb(HEAD, [0.0, 1.585, 0.025], [0.0, 1.665, -0.005], [0.068, 0.1], Cloth::Head),
        limb(HEAD, [0.0, 1.645, 0.092], [0.0, 1.61, 0.108], [0.008, 0.014], Cloth::Head),
    ];
    for (side, sign) in [1.0, -1.0].into_iter().enumerate() {
        let at = |x: f64, y, z| [sign * x, y, z];
        let [arm, leg] = [ARMS[side], LEGS[side]];
        limbs.extend([
            limb(arm, at(0.17, 1.385, -0.01), at(0.26, 1.125, -0.01), [0.058, 0.043], Cloth::Tunic),
            limb(arm + 1, at(0.26, 1.125, -0.01), at(0.325, 0.9, 0.02), [0.043, 0.032], Cloth::Tunic),
            limb(arm + 1, at(0.33, 0.875, 0.024), at(0.345, 0.81, 0.036), [0.036, 0.03], Cloth::Bare),
            limb(leg, at(0.09, 0.91, 0.0), at(0.1, 0.5, 0.01), [0.094, 0.058], Cloth::Trousers),
            limb(leg + 1, at(0.1, 0.5, 0.01), at(0.102, 0.34, -0.004), [0.058, 0.06], Cloth::Trousers),
            limb(leg + 1, at(0.102, 0.34, -0.004), at(0.105, 0.1, -0.012), [0.062, 0.046], Cloth::Boot),
            limb(leg + 2, at(0.105, 0.05, -0.03), at(0.118, 0.042, 0.13), [0.05, 0.042], Cloth::Boot),
        ]);
    }
    limbs
}

impl Limb {
    /// The distance from the surface of the limb, negative inside.
    fn distance(&self, at: Point) -> f64 {
        let [from, to] = self.ends;
        let axis = subtract(to, from);
        let share = (dot(subtract(at, from), axis) / dot(axis, axis)).clamp(0.0, 1.0);
        let off = subtract(at, between(from, to, share));
        dot(off, off).sqrt() - (self.radii[0] + share * (self.radii[1] - self.radii[0]))
    }
}

/// The distance from the smooth union of the limbs, negative inside. Near the surface only.
pub(super) fn distance(limbs: &[Limb], at: Point) -> f64 {
    // Arms and legs melt into the trunk, not into each other.
    let parts = [ARMS[0], ARMS[1], LEGS[0], LEGS[1], usize::MAX].map(|part| {
        let own = limbs.iter().filter(|limb| part_of(limb.joint) == part);
        own.fold(f64::INFINITY, |so_far, limb| {
            let is_trunk = part == usize::MAX && matches!(limb.cloth, Cloth::Tunic | Cloth::Trousers);
            smooth_least(so_far, limb.distance(at), if is_trunk { TRUNK_MELT } else { MELT })
        })
    });
    let limbs = parts[..4].iter().copied().fold(f64::INFINITY, f64::min);
    smooth_least(limbs, parts[4], MELT)
}

/// The first joint of the arm or leg that a joint is in, or `usize::MAX`.
fn part_of(joint: usize) -> usize {
    match joint {
        3 | 4 => ARMS[0],
        5 | 6 => ARMS[1],
        7..=9 => LEGS[0],
        10..=12 => LEGS[1],
        _ => usize::MAX,
    }
}

/// The lesser of two, rounded where they differ by less than `melt`.
fn smooth_least(a: f64, b: f64, melt: f64) -> f64 {
    // Of infinities, the difference is not a number, and `max` returns 0.
    let overlap = (melt - (a - b).abs()).max(0.0) / melt;
    a.min(b) - 0.25 * melt * overlap * overlap
}

/// The unit direction away from the surface.
pub(super) fn outward(distance: impl Fn(Point) -> f64, at: Point) -> Point {
    const STEP: f64 = 1.0e-4;
    let slope: Point = std::array::from_fn(|axis| {
        let mut step = [0.0; 3];
        step[axis] = STEP;
        distance(advance(at, 1.0, step)) - distance(advance(at, -1.0, step))
    });
    let length = dot(slope, slope).sqrt().max(f64::MIN_POSITIVE);
    slope.map(|coordinate| coordinate / length)
}

/// The joints that move a place of the skin most, with weights that sum to 1.
pub(super) fn influences(limbs: &[Limb], at: Point) -> ([u8; 4], [f32; 4]) {
    let distances: Vec<f64> = limbs.iter().map(|limb| limb.distance(at)).collect();
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let mut shares = [(0.0, 0); 13];
    for (number, share) in shares.iter_mut().enumerate() {
        share.1 = number as u8;
    }
    for (limb, distance) in limbs.iter().zip(&distances) {
        let share = &mut shares[limb.joint].0;
        *share = f64::max(*share, libm::exp((least - distance) / FALLOFF));
    }
    shares.sort_by(|a, b| b.0.total_cmp(&a.0));
    let kept = [0, 1, 2, 3].map(|place| shares[place]);
    // What has hardly a share has none.
    let kept = kept.map(|(share, joint)| ((share - 0.02_f64).max(0.0), joint));
    let sum: f64 = kept.iter().map(|(share, _)| share).sum();
    (kept.map(|(share, joint)| if share > 0.0 { joint } else { 0 }), kept.map(|(share, _)| (share / sum) as f32))
}

/// The color of a place of the skin, in linear red, green, blue, and opacity.
pub(super) fn color(limbs: &[Limb], at: Point) -> [f32; 4] {
    let nearest = limbs.iter().min_by(|a, b| a.distance(at).total_cmp(&b.distance(at)));
    let cloth = nearest.map_or(Cloth::Bare, |limb| limb.cloth);
    let [_, height, depth] = at;
    let is_hair = height > 1.685 - 0.9 * (depth - 0.05).min(0.0).abs() && !(depth > 0.05 && height < 1.69);
    let [red, green, blue] = match cloth {
        Cloth::Head if is_hair => [0.045, 0.022, 0.012],
        Cloth::Bare | Cloth::Head => [0.62, 0.36, 0.24],
        Cloth::Tunic if at[0].abs() < 0.2 && (0.985..1.035).contains(&height) => [0.05, 0.025, 0.012],
        Cloth::Tunic => [0.09, 0.2, 0.24],
        Cloth::Trousers => [0.11, 0.085, 0.06],
        Cloth::Boot => [0.06, 0.03, 0.016],
    };
    [red, green, blue, 1.0]
}
