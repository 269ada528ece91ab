//! Surfaces of revolution out of circles with different numbers of vertices, so that triangles stay alike in size.
//!
//! Capsules, needles and skirts are such surfaces. Where two neighbouring circles differ in number, the band between them
//! is filled by walking along both at once and always taking the step that leaves the shorter edge across.

use std::f64::consts::TAU;

use super::{Mesh, index};

/// A circle around the y axis, or a single point on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    /// Its height y, in metres.
    pub height: f64,
    /// Its radius in metres.
    pub radius: f64,
    /// Its number of vertices: at least 3, or 1 for a point, which then lies on the axis.
    pub segments: usize,
}

impl Circle {
    /// The point on the axis at `height`.
    pub const fn point(height: f64) -> Self {
        Self { height, radius: 0.0, segments: 1 }
    }
}

/// The surface through `circles`, which run from the top down, facing away from the axis.
///
/// Vertices follow circle by circle, in each from x towards z; every second circle is turned by half a step, which makes
/// equilateral triangles possible. The surface is closed if the first and the last circle are points.
pub(super) fn revolve(circles: &[Circle]) -> Mesh {
    let mut mesh = Mesh::default();
    let mut first = Vec::new();
    for (number, circle) in circles.iter().enumerate() {
        first.push(mesh.positions.len());
        for vertex in 0..circle.segments {
            let angle = TAU * half_steps(vertex, number) as f64 / (2 * circle.segments) as f64;
            let position = [circle.radius * libm::cos(angle), circle.height, circle.radius * libm::sin(angle)];
            mesh.positions.push(position.map(|coordinate| coordinate as f32));
        }
    }
    for upper in 0..circles.len().saturating_sub(1) {
        let lower = upper + 1;
        let segments = |circle: usize| circles[circle].segments;
        // Going once around a point means not to leave it.
        let steps = |circle: usize| if segments(circle) == 1 { 0 } else { segments(circle) };
        let vertex = |circle: usize, step: usize| index(first[circle] + step % segments(circle));
        let (mut above, mut below) = (0, 0);
        while above < steps(upper) || below < steps(lower) {
            let corners = [vertex(lower, below), vertex(upper, above)];
            // Angles in a measure that is whole on both circles.
            let angle_above = |step: usize| half_steps(step, upper) * segments(lower);
            let angle_below = |step: usize| half_steps(step, lower) * segments(upper);
            let across_if_above = angle_above(above + 1).abs_diff(angle_below(below));
            let across_if_below = angle_below(below + 1).abs_diff(angle_above(above));
            let is_shorter = across_if_above < across_if_below;
            let is_above = below == steps(lower) || (above < steps(upper) && is_shorter);
            let next = if is_above {
                above += 1;
                vertex(upper, above)
            } else {
                below += 1;
                vertex(lower, below)
            };
            mesh.triangles.push([corners[0], corners[1], next]);
        }
    }
    mesh
}

/// Where a vertex lies on the circle of that number, in halves of the circle's step.
const fn half_steps(vertex: usize, circle: usize) -> usize {
    2 * vertex + circle % 2
}
