//! What is inside a solid, and what has gone through a triangle, computed in f64 and independently of the library.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3, Vec3};

/// A closed mesh in the world.
pub struct Closed {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    low: DVec3,
    high: DVec3,
}

impl Closed {
    pub fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Self {
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        Self { positions, triangles, low, high }
    }

    /// Whether the mesh winds around a point, in either orientation.
    pub fn contains(&self, point: DVec3) -> bool {
        if point.cmplt(self.low).any() || point.cmpgt(self.high).any() {
            return false;
        }
        let angle = |corners: &[u32; 3]| solid_angle(corners.map(|corner| self.positions[corner as usize] - point));
        self.triangles.iter().map(angle).sum::<f64>().abs() > TAU
    }
}

/// The signed solid angle of a triangle as seen from the origin (van Oosterom and Strackee 1983).
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let [length_a, length_b, length_c] = [a.length(), b.length(), c.length()];
    let volume = a.dot(b.cross(c));
    let rest = length_a * length_b * length_c + a.dot(b) * length_c + b.dot(c) * length_a + c.dot(a) * length_b;
    2.0 * volume.atan2(rest)
}

/// The pose of something rigid.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub turn: DQuat,
    pub offset: DVec3,
}

impl Place {
    pub fn to_own(self, point: DVec3) -> DVec3 {
        self.turn.inverse() * (point - self.offset)
    }
}

/// A solid with a closed form, in its own frame.
#[derive(Clone, Copy, Debug)]
pub enum Solid {
    Ball(f64),
    /// Half extents.
    Cuboid(DVec3),
    /// Along y: half the length of the axis, and the radius.
    Capsule(f64, f64),
    /// Like a capsule, without the caps.
    Cylinder(f64, f64),
    /// Like a cylinder, pointed at the upper end.
    Cone(f64, f64),
    /// Below the plane y = 0.
    HalfSpace,
}

impl Solid {
    /// The depth of a point inside, in the solid's own frame. Outside it is negative and a lower bound.
    pub fn depth(self, point: DVec3) -> f64 {
        let around = point.x.hypot(point.z);
        match self {
            Self::Ball(radius) => radius - point.length(),
            Self::Cuboid(half) => (half - point.abs()).min_element(),
            Self::Capsule(half, radius) => radius - (point - DVec3::Y * point.y.clamp(-half, half)).length(),
            Self::Cylinder(half, radius) => (half - point.y.abs()).min(radius - around),
            Self::Cone(half, radius) => {
                let slope = (radius * (half - point.y) - 2.0 * half * around) / radius.hypot(2.0 * half);
                slope.min(half + point.y)
            }
            Self::HalfSpace => -point.y,
        }
    }
}

/// The distance of a point from a triangle.
pub fn point_triangle(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let inside = |from: DVec3, to: DVec3| normal.cross(to - from).dot(point - from) >= 0.0;
    if normal != DVec3::ZERO && inside(a, b) && inside(b, c) && inside(c, a) {
        return (point - a).dot(normal).abs() / normal.length();
    }
    let to_segment = |from: DVec3, to: DVec3| {
        let edge = to - from;
        let share = ((point - from).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (point - from - edge * share).length()
    };
    to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a))
}

/// Whether a point crosses a triangle while all four points move along straight lines. It does at a root of the volume
/// that they span, if the point is within the triangle at that time.
pub fn crosses_on_its_way(point: [DVec3; 2], corners: [[DVec3; 2]; 3]) -> bool {
    // A cubic has at most three roots. Two roots within one step are a grazing contact that this test may miss.
    const STEPS: u32 = 64;
    let at = |time: f64| -> [DVec3; 3] {
        let point = point[0].lerp(point[1], time);
        corners.map(|[from, to]| from.lerp(to, time) - point)
    };
    // Skip triangles that are far from the point all the time, in the frame of the point.
    let ends = [at(0.0), at(1.0)];
    let all = || ends.iter().flatten().copied();
    let (low, high) = (all().fold(DVec3::INFINITY, DVec3::min), all().fold(DVec3::NEG_INFINITY, DVec3::max));
    if low.cmpgt(DVec3::ZERO).any() || high.cmplt(DVec3::ZERO).any() {
        return false;
    }
    let volume = |time: f64| {
        let [a, b, c] = at(time);
        a.dot(b.cross(c))
    };
    let contains = |time: f64| {
        let [a, b, c] = at(time);
        let normal = (b - a).cross(c - a);
        [a.cross(b), b.cross(c), c.cross(a)].iter().all(|part| part.dot(normal) > 0.0)
    };
    (0..STEPS).any(|step| {
        let [mut from, mut to] = [step, step + 1].map(|step| f64::from(step) / f64::from(STEPS));
        let start = volume(from);
        if start * volume(to) > 0.0 {
            return false;
        }
        for _ in 0..60 {
            let middle = 0.5 * (from + to);
            if start * volume(middle) > 0.0 { from = middle } else { to = middle }
        }
        contains(to)
    })
}

/// Converts vertices to f64.
pub fn doubles(positions: &[Vec3]) -> Vec<DVec3> {
    positions.iter().map(|position| position.as_dvec3()).collect()
}

#[test]
fn depths_are_those_of_the_solids() {
    let half = DVec3::new(1.0, 2.0, 3.0);
    let at = DVec3::new;
    assert_eq!(Solid::Ball(1.0).depth(at(0.0, 0.6, 0.8)), 0.0);
    assert_eq!(Solid::Cuboid(half).depth(at(0.5, 1.9, 0.0)), 2.0 - 1.9);
    assert_eq!(Solid::Capsule(1.0, 0.5).depth(at(0.0, 1.25, 0.0)), 0.25);
    assert_eq!(Solid::Cylinder(1.0, 0.5).depth(at(0.25, 0.0, 0.0)), 0.25);
    // Halfway up, the cone is half as wide. Its side falls by 1 in 2.
    let depth = Solid::Cone(1.0, 1.0).depth(DVec3::ZERO);
    assert!((depth - 1.0 / 5.0_f64.sqrt()).abs() < 1e-12, "{depth}");
    assert!(Solid::Cone(1.0, 1.0).depth(at(0.6, 0.0, 0.0)) < 0.0);
    assert_eq!(Solid::HalfSpace.depth(at(3.0, -0.5, 1.0)), 0.5);
}

#[test]
fn what_goes_through_a_triangle_is_seen_and_what_passes_beside_it_is_not() {
    let still = [DVec3::ZERO, DVec3::X, DVec3::Z].map(|corner| [corner; 2]);
    let inside = DVec3::new(0.2, 1.0, 0.3);
    assert!(crosses_on_its_way([inside, inside - 2.0 * DVec3::Y], still));
    assert!(!crosses_on_its_way([inside, inside - 0.9 * DVec3::Y], still));
    let beside = DVec3::new(0.6, 1.0, 0.6);
    assert!(!crosses_on_its_way([beside, beside - 2.0 * DVec3::Y], still));
    // Both move the same way, so nothing passes.
    let moved = still.map(|[from, to]| [from, to - 3.0 * DVec3::Y]);
    assert!(!crosses_on_its_way([inside, inside - 3.0 * DVec3::Y], moved));
    assert!(crosses_on_its_way([inside, inside], still.map(|[from, to]| [from, to + 3.0 * DVec3::Y])));
}
