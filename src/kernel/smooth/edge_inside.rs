//! Where an edge of one patch is closest to the inside of another, near two given points of them.
//!
//! Newton steps for the squared distance over three parameters: along the edge, and two of the other patch. Where the
//! patches nearly touch, directions that change nothing are damped.

use glam::{DMat3, DVec3};

use super::patch::Patch;

const STEPS: usize = 4;

/// Added to the diagonal, relative to it.
const DAMPING: f64 = 1.0e-3;

/// Moves points to where edge `edge` of the first patch and the inside of the second are closest. Edge `k` joins corners
/// `k` and `k + 1`. `None` if that is beyond an end of the edge, or a border of the second patch.
pub(super) fn closest_edge_inside(
    [outer, inner]: [&Patch; 2],
    edge: usize,
    [at_edge, inside]: [[f64; 3]; 2],
) -> Option<[[f64; 3]; 2]> {
    let (from, to) = (edge % 3, (edge + 1) % 3);
    let chord = outer.corners[to] - outer.corners[from];
    let offset = outer.offsets[from];
    let on_edge = |along: f64| {
        let mut weights = [0.0; 3];
        (weights[from], weights[to]) = (1.0 - along, along);
        weights
    };
    let both = at_edge[from] + at_edge[to];
    let mut along = if both > 0.0 { at_edge[to] / both } else { 0.5 };
    let [_, mut second, mut third] = inside;
    for _ in 0..STEPS {
        let local = inner.local(&[1.0 - second - third, second, third]);
        let between = local.point - outer.point(&on_edge(along));
        let [u, v] = local.tangents;
        let [uu, uv, vv] = local.seconds.map(|bend| between.dot(bend));
        let tangent = -(chord + offset * (1.0 - 2.0 * along));
        let bend = between.dot(offset * 2.0);
        let (tt, tu, tv) = (tangent.length_squared() + bend, tangent.dot(u), tangent.dot(v));
        let (xx, xy, yy) = (u.length_squared() + uu, u.dot(v) + uv, v.length_squared() + vv);
        let matrix = DMat3::from_cols(
            DVec3::new(tt * (1.0 + DAMPING), tu, tv),
            DVec3::new(tu, xx * (1.0 + DAMPING), xy),
            DVec3::new(tv, xy, yy * (1.0 + DAMPING)),
        );
        let slope = DVec3::new(tangent.dot(between), u.dot(between), v.dot(between));
        let step = matrix.inverse() * slope;
        if !step.is_finite() || step.abs().max_element() > 1.0 {
            return None;
        }
        along -= step.x;
        second -= step.y;
        third -= step.z;
    }
    let inside = [1.0 - second - third, second, third];
    let is_there = (0.0..=1.0).contains(&along) && inside.iter().all(|weight| *weight >= 0.0);
    is_there.then(|| [on_edge(along), inside])
}
