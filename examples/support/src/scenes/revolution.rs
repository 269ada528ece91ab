//! Surfaces of revolution made of circles with different numbers of vertices, so that triangles are of similar size.
//!
//! Capsules, needles, and skirts are such surfaces. Between two adjacent circles with different numbers of vertices,
//! the band is filled by walking along both at once, always taking the step with the shorter edge across.

use std::f64::consts::TAU;

use super::{Mesh, index};

/// A circle around the y axis, or a single point on the axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circle {
    /// Its height y, in meters.
    pub height: f64,
    /// Its radius, in meters.
    pub radius: f64,
    /// Its number of vertices: at least 3, or 1 for a point on the axis.
    pub segments: usize,
}

impl Circle {
    /// The point on the axis at `height`.
    pub const fn point(height: f64) -> Self {
        Self { height, radius: 0.0, segments: 1 }
    }
}

/// The surface through `circles`, which run from top to bottom, facing away from the axis.
///
/// Vertices are ordered by circle, and in each from x towards z. Every second circle is rotated by half a step, which
/// allows equilateral triangles. The surface is closed if the first and the last circle are points.
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
        // A point takes no steps.
        let steps = |circle: usize| if segments(circle) == 1 { 0 } else { segments(circle) };
        let vertex = |circle: usize, step: usize| index(first[circle] + step % segments(circle));
        let (mut above, mut below) = (0, 0);
        while above < steps(upper) || below < steps(lower) {
            let corners = [vertex(lower, below), vertex(upper, above)];
            // Angles in a unit that is an integer on both circles.
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

/// The angle of a vertex on a circle, in halves of the circle's step.
const fn half_steps(vertex: usize, circle: usize) -> usize {
    2 * vertex + circle % 2
}
