//! Smooth bodies whose distance is known in closed form, or by a search that ends at the precision of f64, and how far
//! two of them are apart.

use glam::{DMat3, DVec3};

/// A smooth closed body at a pose.
#[derive(Clone, Copy, Debug)]
pub struct SmoothBody {
    /// Its shape, around the origin.
    pub shape: BodyShape,
    /// Its rotation.
    pub rotation: DMat3,
    /// Its center.
    pub center: DVec3,
}

/// A smooth closed shape around the origin.
#[derive(Clone, Copy, Debug)]
pub enum BodyShape {
    /// A ball with this radius.
    Ball(f64),
    /// An ellipsoid with these semi-axes.
    Ellipsoid(DVec3),
    /// A torus around the y axis: the radius of its circle, and that of its tube.
    Torus(f64, f64),
    /// A capsule along the y axis: its radius, and half the length of its axis.
    Capsule(f64, f64),
}

/// The closest point of a body's surface to another point.
#[derive(Clone, Copy, Debug)]
pub struct BodyFoot {
    /// The closest point.
    pub point: DVec3,
    /// The outward unit normal there.
    pub normal: DVec3,
    /// The signed distance, negative inside.
    pub distance: f64,
}

/// How far two bodies are apart.
#[derive(Clone, Copy, Debug)]
pub struct BodyDistance {
    /// The closest points of the first and the second body.
    pub points: [DVec3; 2],
    /// Unit vector from the first body to the second.
    pub normal: DVec3,
    /// The distance. Negative if one is inside the other there.
    pub distance: f64,
}

impl BodyShape {
    fn foot(&self, point: DVec3) -> BodyFoot {
        match *self {
            Self::Ball(radius) => rounded(point, DVec3::ZERO, radius),
            Self::Capsule(radius, half) => rounded(point, DVec3::Y * point.y.clamp(-half, half), radius),
            Self::Torus(major, minor) => {
                let flat = DVec3::new(point.x, 0.0, point.z).try_normalize().unwrap_or(DVec3::X);
                rounded(point, flat * major, minor)
            }
            Self::Ellipsoid(axes) => ellipsoid_foot(axes, point),
        }
    }
}

fn rounded(point: DVec3, core: DVec3, radius: f64) -> BodyFoot {
    let normal = (point - core).try_normalize().unwrap_or(DVec3::X);
    BodyFoot { point: core + normal * radius, normal, distance: point.distance(core) - radius }
}

/// The foot of a point on an ellipsoid: the root of the equation of the Lagrange multiplier `t`, with the foot at
/// `a² p / (t + a²)` for each semi-axis `a` (Eberly, "Distance from a Point to an Ellipse, an Ellipsoid, or a
/// Hyperellipsoid"). The root above `−min a²` belongs to the closest point. Found by bisection.
fn ellipsoid_foot(axes: DVec3, point: DVec3) -> BodyFoot {
    let squares = axes * axes;
    let value = |t: f64| (axes * point / (squares + DVec3::splat(t))).length_squared() - 1.0;
    let mut low = -squares.min_element() * (1.0 - 1.0e-15);
    let mut high = (axes * point).length() + squares.max_element();
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if value(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let foot = squares * point / (squares + DVec3::splat(0.5 * (low + high)));
    let normal = (foot / squares).normalize();
    let inside = (point / axes).length_squared() < 1.0;
    let distance = point.distance(foot);
    BodyFoot { point: foot, normal, distance: if inside { -distance } else { distance } }
}

impl SmoothBody {
    /// The closest point of the surface to a point. Not unique on the axis of a torus or a capsule, at the center of a
    /// ball, and for an ellipsoid on its planes of symmetry inside.
    #[must_use]
    pub fn foot(&self, point: DVec3) -> BodyFoot {
        let foot = self.shape.foot(self.rotation.transpose() * (point - self.center));
        BodyFoot {
            point: self.rotation * foot.point + self.center,
            normal: self.rotation * foot.normal,
            distance: foot.distance,
        }
    }

    /// How far another body is away, given points of this body's surface, some of them near the closest one. Searches
    /// along the surface from the best of them, with steps that shrink to the precision of f64.
    ///
    /// # Panics
    /// If there is no start.
    #[must_use]
    pub fn distance(&self, other: &Self, starts: &[DVec3]) -> BodyDistance {
        const STARTS: usize = 3;
        let mut best: Vec<(f64, DVec3)> = starts
            .iter()
            .map(|&start| {
                let start = self.foot(start).point;
                (other.foot(start).distance, start)
            })
            .collect();
        best.sort_by(|one, next| one.0.total_cmp(&next.0));
        best.truncate(STARTS);
        let found = best.into_iter().map(|(distance, start)| self.descend(other, start, distance));
        found.min_by(|one, next| one.distance.total_cmp(&next.distance)).expect("there is a start")
    }

    /// Follows the surface downward on the distance from another body.
    fn descend(&self, other: &Self, mut at: DVec3, mut distance: f64) -> BodyDistance {
        let mut step = 0.1 * self.size();
        while step > 1.0e-13 * self.size() {
            let (first, second) = self.foot(at).normal.any_orthonormal_pair();
            let tries = [first, second, -first, -second].map(|way| self.foot(at + way * step).point);
            let next = tries.into_iter().map(|point| (other.foot(point).distance, point));
            let (lowest, point) = next.min_by(|one, next| one.0.total_cmp(&next.0)).expect("there are four");
            if lowest < distance {
                (distance, at) = (lowest, point);
            } else {
                step *= 0.5;
            }
        }
        let foot = other.foot(at);
        BodyDistance { points: [at, foot.point], normal: -foot.normal, distance }
    }

    fn size(&self) -> f64 {
        match self.shape {
            BodyShape::Ball(radius) => radius,
            BodyShape::Ellipsoid(axes) => axes.max_element(),
            BodyShape::Torus(major, minor) => major + minor,
            BodyShape::Capsule(radius, half) => radius + half,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(shape: BodyShape, center: DVec3) -> SmoothBody {
        SmoothBody { shape, rotation: DMat3::from_rotation_z(0.7) * DMat3::from_rotation_y(1.1), center }
    }

    fn directions() -> impl Iterator<Item = DVec3> {
        (1..200).map(|n| {
            let n = f64::from(n);
            DVec3::new((n * 1.7).sin(), (n * 2.3).sin(), (n * 3.1).sin()).normalize()
        })
    }

    #[test]
    fn a_foot_is_on_the_body_and_the_vector_to_it_is_normal() {
        let shapes = [
            BodyShape::Ball(0.7),
            BodyShape::Ellipsoid(DVec3::new(1.0, 0.6, 0.4)),
            BodyShape::Torus(1.0, 0.3),
            BodyShape::Capsule(0.3, 0.8),
        ];
        for shape in shapes {
            let body = placed(shape, DVec3::new(0.1, -0.3, 0.2));
            for direction in directions() {
                let point = body.center + direction * 2.5;
                let foot = body.foot(point);
                assert!(body.foot(foot.point).distance.abs() < 1.0e-12, "{shape:?}");
                assert!((point - foot.point).normalize().dot(foot.normal) > 1.0 - 1.0e-12, "{shape:?}");
                assert!((foot.point + foot.normal * foot.distance).distance(point) < 1.0e-12, "{shape:?}");
                // No other point of the surface is closer.
                for other in directions() {
                    let on_surface = body.foot(foot.point + other * 0.05).point;
                    assert!(on_surface.distance(point) >= foot.distance - 1.0e-12, "{shape:?}");
                }
            }
        }
    }

    #[test]
    fn an_ellipsoid_with_equal_axes_is_a_ball() {
        let ball = placed(BodyShape::Ball(0.8), DVec3::X);
        let ellipsoid = placed(BodyShape::Ellipsoid(DVec3::splat(0.8)), DVec3::X);
        for direction in directions() {
            for length in [0.3, 0.9, 4.0] {
                let point = ball.center + direction * length;
                assert!((ball.foot(point).distance - ellipsoid.foot(point).distance).abs() < 1.0e-12);
            }
        }
    }

    #[test]
    fn two_balls_are_as_far_apart_as_their_centers_less_their_radii() {
        let first = placed(BodyShape::Ellipsoid(DVec3::splat(0.8)), DVec3::ZERO);
        for direction in directions().take(20) {
            let second = placed(BodyShape::Ball(0.5), direction * 1.4);
            let starts: Vec<DVec3> = directions().map(|start| start * 0.8).collect();
            let found = first.distance(&second, &starts);
            assert!((found.distance - 0.1).abs() < 1.0e-12);
            assert!(found.normal.distance(direction) < 1.0e-5);
        }
    }
}
