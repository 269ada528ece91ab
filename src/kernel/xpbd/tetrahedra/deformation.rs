//! How tetrahedra are deformed, and the gradients of that by their corners, eight at a time.

use fearless_simd::{f32x8, prelude::*};

use crate::kernel::simd::lanes::VectorLanes;

/// Below this sum of squares, `N` is a small strain, and `C² = |N|²/2`. The polynomial would lose it to rounding.
const SMALL_STRAIN: f32 = 1.0e-3;

/// A vector per column.
pub(super) type Columns<S> = [VectorLanes<S>; 3];

/// The deformation of eight tetrahedra.
pub(super) struct Deformation<S: Simd> {
    /// `I`, the sum of the squares of the stretches.
    pub(super) squares: f32x8<S>,
    /// `J`, the volume relative to that at rest. Negative if inverted.
    pub(super) volume: f32x8<S>,
    /// `N`.
    pub(super) strain: Columns<S>,
    /// `cof F`.
    pub(super) cofactors: Columns<S>,
}

impl<S: Simd> Deformation<S> {
    /// From the edges now, and the rows of the inverse of those at rest.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn new(edges: Columns<S>, inverse: Columns<S>) -> Self {
        let [first, second, third] = inverse;
        let x = combined(edges, [first.x, second.x, third.x]);
        let y = combined(edges, [first.y, second.y, third.y]);
        let z = combined(edges, [first.z, second.z, third.z]);
        let cofactors = [y.cross(z), z.cross(x), x.cross(y)];
        let volume = x.dot(cofactors[0]);
        let share = volume - 2.0;
        let strain = [
            x.plus(cofactors[0].scaled(share)),
            y.plus(cofactors[1].scaled(share)),
            z.plus(cofactors[2].scaled(share)),
        ];
        Self { squares: x.dot(x) + y.dot(y) + z.dot(z), volume, strain, cofactors }
    }

    /// `C`.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn shear(&self) -> f32x8<S> {
        let [x, y, z] = self.strain;
        let strain = x.dot(x) + y.dot(y) + z.dot(z);
        let polynomial = self.squares + self.volume * (self.volume - 4.0);
        let is_small = strain.simd_lt(SMALL_STRAIN);
        is_small.select(strain * 0.5, polynomial.max(strain * SMALL_STRAIN)).sqrt()
    }
}

/// The gradients of a function of `F` by the positions of the corners, given its gradient by `F`.
#[cfg_attr(not(unoptimized), inline(always))]
pub(super) fn by_corners<S: Simd>(by: Columns<S>, [first, second, third]: Columns<S>) -> [VectorLanes<S>; 4] {
    // Not `map`, which is not always inlined, and would then call a function for every sum and product.
    let a = combined(by, [first.x, first.y, first.z]);
    let b = combined(by, [second.x, second.y, second.z]);
    let c = combined(by, [third.x, third.y, third.z]);
    [a.plus(b).plus(c).negated(), a, b, c]
}

/// The sum of the columns, each times its factor.
#[cfg_attr(not(unoptimized), inline(always))]
fn combined<S: Simd>([x, y, z]: Columns<S>, [a, b, c]: [f32x8<S>; 3]) -> VectorLanes<S> {
    x.scaled(a).plus(y.scaled(b)).plus(z.scaled(c))
}

#[cfg(test)]
pub(super) mod tests {
    use circumsphere_support::random::Random;
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::kernel::simd::lanes::WIDTH;

    pub(in crate::kernel::xpbd::tetrahedra) const REST: [DVec3; 4] =
        [DVec3::new(0.1, -0.2, 0.05), DVec3::new(1.1, 0.1, 0.0), DVec3::new(0.0, 0.9, 0.2), DVec3::new(0.2, 0.1, 1.3)];

    fn edges(&[origin, a, b, c]: &[DVec3; 4]) -> DMat3 {
        DMat3::from_cols(a - origin, b - origin, c - origin)
    }

    /// `tr(FᵀF)` and `det F`, from corners in f64.
    pub(in crate::kernel::xpbd::tetrahedra) fn invariants(corners: &[DVec3; 4]) -> [f64; 2] {
        let deformation = edges(corners) * edges(&REST).inverse();
        let squares = deformation.to_cols_array().iter().map(|entry| entry * entry).sum();
        [squares, deformation.determinant()]
    }

    /// `C`, `J`, and the gradients of `C² / 2` and `J` by the corners, from lanes.
    fn in_lanes(corners: &[DVec3; 4]) -> (f64, f64, [[DVec3; 4]; 2]) {
        dispatch!(simd => {
            let inverse = edges(&REST).inverse();
            let now = edges(corners);
            let of = |vector: DVec3| VectorLanes::splat(simd, vector.as_vec3());
            let inverse = [of(inverse.row(0)), of(inverse.row(1)), of(inverse.row(2))];
            let now = Deformation::new([of(now.x_axis), of(now.y_axis), of(now.z_axis)], inverse);
            let stored = |gradients: [VectorLanes<_>; 4]| gradients.map(|vector| vector.stored().get(0).as_dvec3());
            let gradients = [stored(by_corners(now.strain, inverse)), stored(by_corners(now.cofactors, inverse))];
            let first = |lanes: f32x8<_>| f64::from(<[f32; WIDTH]>::from(lanes)[0]);
            (first(now.shear()), first(now.volume), gradients)
        })
    }

    pub(in crate::kernel::xpbd::tetrahedra) fn moved(random: &mut Random, by: f64) -> [DVec3; 4] {
        REST.map(|corner| corner + by * DVec3::from_array(std::array::from_fn(|_| f64::from(random.signed_unit()))))
    }

    #[test]
    fn the_constraints_are_the_energy_of_a_stable_neo_hookean_solid() {
        let mut random = Random::new(0x7e7a);
        let (shear, lame) = (3.0, 7.0);
        let mut inverted = 0;
        for round in 0..300 {
            let corners = moved(&mut random, [1.0, 0.1, 0.01][round % 3]);
            let [squares, volume] = invariants(&corners);
            let energy = shear / 2.0 * (squares - 3.0) - shear * (volume - 1.0)
                + f64::midpoint(lame, shear) * (volume - 1.0) * (volume - 1.0);
            let (value, found, _) = in_lanes(&corners);
            let sum = shear / 2.0 * value * value + lame / 2.0 * (found - 1.0) * (found - 1.0);
            // The small strain stands in for the polynomial within its own size.
            let error = if value < 0.03 { 0.05 } else { 1.0e-4 };
            assert!((sum - energy).abs() <= error * energy.abs() + 1.0e-6, "{corners:?}: {sum} {energy}");
            inverted += usize::from(volume < 0.0);
        }
        assert!(inverted > 10, "{inverted}");
    }

    #[test]
    fn gradients_are_those_of_the_values() {
        let mut random = Random::new(0x96ad);
        let nudge = 1.0e-6;
        for round in 0..60 {
            let corners = moved(&mut random, [1.0, 0.2][round % 2]);
            let (.., [of_shear, of_volume]) = in_lanes(&corners);
            for (corner, axis) in (0..12).map(|place| (place / 3, place % 3)) {
                let at = |by: f64| {
                    let mut corners = corners;
                    corners[corner][axis] += by;
                    let [squares, volume] = invariants(&corners);
                    [0.5 * (squares - 4.0 * volume + volume * volume), volume]
                };
                let slopes = [0, 1].map(|value| (at(nudge)[value] - at(-nudge)[value]) / (2.0 * nudge));
                let found = [of_shear[corner][axis], of_volume[corner][axis]];
                let scale = of_shear.iter().chain(&of_volume).map(|gradient| gradient.length()).fold(1.0, f64::max);
                for (slope, found) in slopes.into_iter().zip(found) {
                    assert!((slope - found).abs() < 1.0e-5 * scale, "{round}: {slopes:?} {found:?}");
                }
            }
        }
    }
}
