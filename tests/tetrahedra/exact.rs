//! Whether a tetrahedron contains a point, in integers. Coordinates are whole multiples of a power of two, so nothing is
//! rounded.

use circumsphere_support::random::Random;
use glam::{DVec3, Vec3};

/// A point in units of [`Grid::unit`].
pub type Whole = [i64; 3];

/// Points with whole coordinates below `reach` in magnitude.
#[derive(Clone, Copy)]
pub struct Grid {
    pub reach: i64,
    /// A power of two.
    pub unit: f32,
}

impl Grid {
    /// So few points that many of them lie in the planes of others.
    pub const COARSE: Self = Self { reach: 4, unit: 0.25 };
    /// Fills the fraction of an f32. Determinants of differences stay below 2^80.
    pub const FINE: Self = Self { reach: 1 << 23, unit: 1.0 / (1 << 20) as f32 };

    pub fn random(self, random: &mut Random) -> Whole {
        [(); 3].map(|()| below(random, 2 * self.reach) - self.reach)
    }

    pub fn point(self, whole: Whole) -> Vec3 {
        Vec3::from_array(whole.map(|coordinate| coordinate as f32)) * self.unit
    }

    pub fn exact_point(self, whole: Whole) -> DVec3 {
        self.point(whole).as_dvec3()
    }
}

/// A random whole number below `end`.
pub fn below(random: &mut Random, end: i64) -> i64 {
    random.below(end.cast_unsigned()).cast_signed()
}

/// Six times the signed volume.
pub fn volume([a, b, c, d]: [Whole; 4]) -> i128 {
    let minus_a = |p: Whole| [0, 1, 2].map(|axis: usize| i128::from(p[axis] - a[axis]));
    let (u, v, w) = (minus_a(b), minus_a(c), minus_a(d));
    u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0]) + u[2] * (v[0] * w[1] - v[1] * w[0])
}

/// Six times the signed volumes between a point and the faces opposite the corners, if the tetrahedron contains the
/// point.
pub fn parts_inside(corners: [Whole; 4], point: Whole) -> Option<[i128; 4]> {
    let whole = volume(corners);
    let parts = [0, 1, 2, 3].map(|corner: usize| {
        let mut part = corners;
        part[corner] = point;
        volume(part) * whole.signum()
    });
    (whole != 0 && parts.iter().all(|&part| part >= 0)).then_some(parts)
}
