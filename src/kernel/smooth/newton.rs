//! Where two patches are closest inside both, near two given points of them.
//!
//! Along a direction `n`, both surfaces are heights over one plane, `h_a` below `h_b`, with slopes `g` and curvatures
//! `K` (2×2). Let `r` be the part in the plane of the vector from the first point to the second, `d` its part along
//! `n`, and `t` the displacements of both points in the plane. The points are closest if the vector between them is
//! normal to both surfaces:
//!
//! `r + t_b − t_a = −d (g_a + K_a t_a) = −d (g_b + K_b t_b)`
//!
//! which gives `[K_b (I − d K_a) − K_a] t_a = g_a − g_b + K_b (r + d g_a)`. A step solves this and begins again at the
//! new points. It holds for any sign of `d`, and has a solution where surfaces touch. A Newton step for the squared
//! distance has none there.

use glam::{DMat2, DVec2, DVec3};

use super::patch::{Local, Patch};

/// The most steps.
const STEPS: usize = 8;

/// A surface is a height over the plane if its normal is within this cosine of the direction.
const LEAST_COSINE: f64 = 0.3;

/// In directions in which surfaces part more slowly than this, times the inverse of the size, points move only as if
/// they parted that fast. So points of surfaces that fit together stay where they are.
const LEAST_PARTING: f64 = 0.1;

/// A step moves a point at most by this share of the size of its triangle.
const LONGEST_STEP: f64 = 0.5;

/// Steps shorter than this share of the size end the search.
const SHORTEST_STEP: f64 = 1.0e-9;

/// Points that are off by more than this share of the size, across the direction from one to the other, are given up.
const LARGEST_ERROR: f64 = 1.0e-2;

/// The closest points of two patches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Meeting {
    /// The weights of the corners of both triangles.
    pub(super) weights: [[f64; 3]; 2],
    /// The points.
    pub(super) points: [DVec3; 2],
    /// Unit vector from the first patch to the second.
    pub(super) normal: DVec3,
    /// The distance, negative if the patches have passed each other.
    pub(super) distance: f64,
}

/// A surface near one of its points, as a height over a plane.
struct Height {
    slope: DVec2,
    curvature: DMat2,
    /// From displacements in the plane to changes of the weights of the second and third corner.
    to_weights: DMat2,
}

/// An orthonormal basis of the plane of a direction.
fn plane_of(direction: DVec3) -> [DVec3; 2] {
    let (first, second) = direction.any_orthonormal_pair();
    [first, second]
}

impl Height {
    /// `None` if the surface is too steep.
    fn new(local: &Local, direction: DVec3, plane: &[DVec3; 2]) -> Option<Self> {
        let flat = |vector: DVec3| DVec2::new(vector.dot(plane[0]), vector.dot(plane[1]));
        let [u, v] = local.tangents;
        let normal = u.cross(v);
        if normal.dot(direction).abs() < LEAST_COSINE * normal.length() || normal == DVec3::ZERO {
            return None;
        }
        let to_weights = DMat2::from_cols(flat(u), flat(v)).inverse();
        if !to_weights.is_finite() {
            return None;
        }
        let transposed = to_weights.transpose();
        let slope = transposed * DVec2::new(u.dot(direction), v.dot(direction));
        // How each second derivative rises beyond the plane that touches the surface.
        let rise = |second: DVec3| second.dot(direction) - slope.dot(flat(second));
        let [uu, uv, vv] = local.seconds.map(rise);
        let curvature = transposed * DMat2::from_cols(DVec2::new(uu, uv), DVec2::new(uv, vv)) * to_weights;
        Some(Self { slope, curvature, to_weights })
    }

    /// The displacement to the point that is closest to a point of the other surface, given the vector to it: `r` and
    /// `d` from this surface. The sign of `d` is that of the height.
    fn foot(&self, apart: DVec2, distance: f64) -> DVec2 {
        let matrix = DMat2::IDENTITY - self.curvature * distance;
        let wanted = apart + self.slope * distance;
        // Beyond the center of curvature there is no closest point nearby.
        let determinant = matrix.determinant();
        if determinant > 0.1 && matrix.x_axis.x > 0.0 { matrix.inverse() * wanted } else { wanted }
    }
}

/// Displacements of both points, see the page.
fn displacements(a: &Height, b: &Height, apart: DVec2, distance: f64, least: f64) -> DVec2 {
    let own = DMat2::IDENTITY - a.curvature * distance;
    let matrix = b.curvature * own - a.curvature;
    let wanted = a.slope - b.slope + b.curvature * (apart + a.slope * distance);
    solve(&matrix, wanted, least)
}

/// Solves a system whose matrix is nearly symmetric, with eigenvalues of at least `least`. Negative ones lead to a
/// point where the surfaces are farthest apart: the solution leads away from it.
fn solve(matrix: &DMat2, wanted: DVec2, least: f64) -> DVec2 {
    let (xx, yy) = (matrix.x_axis.x, matrix.y_axis.y);
    let xy = 0.5 * (matrix.x_axis.y + matrix.y_axis.x);
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let radius = half.hypot(xy);
    if mean - radius >= least {
        return matrix.inverse() * wanted;
    }
    // The eigenvector of the larger eigenvalue.
    let axis = if half >= 0.0 { DVec2::new(half + radius, xy) } else { DVec2::new(xy, radius - half) };
    let axis = axis.try_normalize().unwrap_or(DVec2::X);
    let across = axis.perp();
    axis * (axis.dot(wanted) / (mean + radius).abs().max(least))
        + across * (across.dot(wanted) / (mean - radius).abs().max(least))
}

/// One patch of a search.
struct Walker<'a> {
    patch: &'a Patch,
    weights: [f64; 3],
    size: f64,
    /// Whether its last step ended at the border of the patch.
    is_held: bool,
}

impl Walker<'_> {
    /// Moves the point by a displacement in the plane, at most as far as allowed. Returns how far it moved.
    fn step(&mut self, height: &Height, step: DVec2) -> DVec2 {
        let step = step.clamp_length_max(LONGEST_STEP * self.size);
        let change = height.to_weights * step;
        let before = self.weights;
        let next = [before[0] - change.x - change.y, before[1] + change.x, before[2] + change.y];
        self.is_held = next.iter().any(|weight| *weight < 0.0);
        if !self.is_held {
            self.weights = next;
            return step;
        }
        // Back along the step to the border.
        let mut share = 1.0;
        for corner in 0..3 {
            if next[corner] < 0.0 {
                share = f64::min(share, before[corner].max(0.0) / (before[corner].max(0.0) - next[corner]));
            }
        }
        self.weights = std::array::from_fn(|corner| before[corner] + share * (next[corner] - before[corner]));
        step * share
    }
}

/// The unit normal on the side to which a direction points. `None` if the patch is too steep for it.
fn normal_towards(local: &Local, direction: DVec3) -> Option<DVec3> {
    let [u, v] = local.tangents;
    let normal = u.cross(v).normalize_or_zero();
    let along = normal.dot(direction);
    (along.abs() >= LEAST_COSINE).then(|| normal * along.signum())
}

/// The closest points of two patches near points inside them. `normal` is a unit vector from the first patch to the
/// second there. `None` if there are none inside both.
pub(super) fn closest_inside(patches: &[Patch; 2], weights: [[f64; 3]; 2], normal: DVec3) -> Option<Meeting> {
    let walker = |side: usize| Walker {
        patch: &patches[side],
        weights: weights[side],
        size: patches[side].size(),
        is_held: false,
    };
    let (mut a, mut b) = (walker(0), walker(1));
    let mut direction = normal;
    for _ in 0..STEPS {
        let locals = [a.patch.local(&a.weights), b.patch.local(&b.weights)];
        let between = locals[1].point - locals[0].point;
        let normals = [normal_towards(&locals[0], direction)?, normal_towards(&locals[1], direction)?];
        direction = (normals[0] + normals[1]).try_normalize()?;
        let plane = plane_of(direction);
        let apart = DVec2::new(between.dot(plane[0]), between.dot(plane[1]));
        let distance = between.dot(direction);
        let first = Height::new(&locals[0], direction, &plane)?;
        let second = Height::new(&locals[1], direction, &plane)?;
        let size = a.size.min(b.size);
        let moved = a.step(&first, displacements(&first, &second, apart, distance, LEAST_PARTING / size));
        let other = b.step(&second, second.foot(moved - apart, -distance));
        if moved.length().max(other.length()) <= SHORTEST_STEP * size {
            break;
        }
    }
    let points = [a.patch.point(&a.weights), b.patch.point(&b.weights)];
    let between = points[1] - points[0];
    let along = between.dot(direction);
    let error = between.reject_from_normalized(direction).length();
    let size = a.size.min(b.size);
    let is_found = !a.is_held && !b.is_held && error <= LARGEST_ERROR * size && along.abs() <= size;
    // Both are the same there, but the vector between the points has no direction where they nearly coincide.
    let normal = (between * along.signum() + direction * size).try_normalize()?;
    is_found.then_some(Meeting {
        weights: [a.weights, b.weights],
        points,
        normal,
        distance: between.length() * along.signum(),
    })
}
