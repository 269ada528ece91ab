//! Closest points of the two features of a contact, and the direction that separates them, given the side on which they
//! were.

use glam::DVec3;

use crate::kernel::mesh::{
    barycentric::barycentric_of,
    feature::Feature,
    side::{closest_feature, face_normal},
};

/// Features closer than this share of their size have no direction of their own.
const TOGETHER: f64 = 1.0e-9;

/// Edges count as parallel if the sine of the angle between them is smaller.
const PARALLEL_SINE: f64 = 1.0e-6;

/// The closest points of two features.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Signed weights of the four points: they sum to 1 for the first feature and to −1 for the second.
    pub weights: [f64; 4],
    /// Unit vector along which the first feature moves away from the second, or back to its own side.
    pub normal: DVec3,
}

/// A vertex (the first point) and a face. `before` is the direction from the face to the vertex at the last evaluation.
/// A vertex that projects into the interior of the face from the other side has passed through it.
#[must_use]
pub fn vertex_face(points: &[DVec3; 4], before: DVec3) -> Meeting {
    let [vertex, face @ ..] = *points;
    let (feature, nearest) = closest_feature(&face, vertex);
    let [a, b, c] = match feature {
        Feature::Vertex(corner) => std::array::from_fn(|k| if k == corner as usize { 1.0 } else { 0.0 }),
        Feature::Edge(edge) => {
            let edge = edge as usize;
            let (from, to) = (face[edge], face[(edge + 1) % 3]);
            let along = ((nearest - from).dot(to - from) / from.distance_squared(to)).clamp(0.0, 1.0);
            let mut weights = [0.0; 3];
            weights[edge] = 1.0 - along;
            weights[(edge + 1) % 3] = along;
            weights
        }
        Feature::Face => barycentric_of(&face, nearest),
    };
    let weights = [1.0, -a, -b, -c];
    let between = vertex - nearest;
    let size = face[0].distance(face[1]).max(face[0].distance(face[2]));
    if feature == Feature::Face {
        let normal = face_normal(&face);
        let normal = if normal.dot(before) < 0.0 { -normal } else { normal };
        return Meeting { weights, normal };
    }
    directed(weights, between, size, before, false)
}

/// Two edges of two points each. `before` is the direction from the second to the first at the last evaluation. Edges
/// whose closest points lie strictly between their ends, with the direction reversed, have passed each other.
#[must_use]
pub fn edge_edge(points: &[DVec3; 4], before: DVec3) -> Meeting {
    let [a0, a1, b0, b1] = *points;
    let (u, v, r) = (a1 - a0, b1 - b0, a0 - b0);
    let (uu, uv, vv) = (u.length_squared(), u.dot(v), v.length_squared());
    let (ur, vr) = (u.dot(r), v.dot(r));
    let determinant = uu * vv - uv * uv;
    let parallel = determinant <= PARALLEL_SINE * PARALLEL_SINE * uu * vv;
    let clamped = |numerator: f64, denominator: f64| {
        if denominator > 0.0 { (numerator / denominator).clamp(0.0, 1.0) } else { 0.0 }
    };
    let mut along_a = if parallel { 0.5 } else { clamped(uv * vr - vv * ur, determinant) };
    let along_b = clamped(uv * along_a + vr, vv);
    along_a = clamped(uv * along_b - ur, uu);
    let weights = [1.0 - along_a, along_a, along_b - 1.0, -along_b];
    let between = (a0 + u * along_a) - (b0 + v * along_b);
    let is_inside = |along: f64| along > 0.0 && along < 1.0;
    let size = uu.max(vv).sqrt();
    directed(weights, between, size, before, !parallel && is_inside(along_a) && is_inside(along_b))
}

/// `between` points from the second closest point to the first.
fn directed(weights: [f64; 4], between: DVec3, size: f64, before: DVec3, can_pass: bool) -> Meeting {
    let distance = between.length();
    if distance <= TOGETHER * size {
        return Meeting { weights, normal: before };
    }
    let normal = between / distance;
    if can_pass && normal.dot(before) < 0.0 {
        return Meeting { weights, normal: -normal };
    }
    Meeting { weights, normal }
}
