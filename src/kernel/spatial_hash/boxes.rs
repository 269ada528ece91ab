//! The boxes to pair, as one list, and their measured sizes.

use std::ops::Range;

use super::cells::{Grids, Place, exponent, size};
use crate::kernel::mesh::bounds::Aabb;

/// The boxes of one list, or of two lists, numbered on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Boxes<'a> {
    pub(super) first: &'a [Aabb],
    /// `None` if the boxes of the first list are paired with each other.
    pub(super) second: Option<&'a [Aabb]>,
}

impl<'a> Boxes<'a> {
    pub(super) fn len(&self) -> usize {
        self.first.len() + self.second.map_or(0, <[_]>::len)
    }

    #[inline]
    pub(super) fn get(&self, item: u32) -> &'a Aabb {
        let item = item as usize;
        match self.second {
            Some(second) if item >= self.first.len() => &second[item - self.first.len()],
            _ => &self.first[item],
        }
    }

    pub(super) fn is_own(&self) -> bool {
        self.second.is_none()
    }

    /// The list of an item: 0 or 1.
    #[inline]
    pub(super) fn side(&self, item: u32) -> usize {
        usize::from(item as usize >= self.first.len())
    }

    /// A pair by the numbers in the lists. The lower number, or that of the first list, comes first.
    #[inline]
    pub(super) fn pair(&self, one: u32, other: u32) -> [u32; 2] {
        let [low, high] = [one.min(other), one.max(other)];
        if self.is_own() { [low, high] } else { [low, high - self.first.len() as u32] }
    }
}

/// Sums over a part of the boxes. Empty ones, and those with NaN, are left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sizes {
    /// The boxes around each list.
    pub(super) wholes: [Aabb; 2],
    sum: f64,
    count: f64,
    exponents: i64,
    with_exponent: i64,
}

impl Default for Sizes {
    fn default() -> Self {
        Self { wholes: [Aabb::EMPTY; 2], sum: 0.0, count: 0.0, exponents: 0, with_exponent: 0 }
    }
}

/// Whether a box has points.
fn is_filled(bounds: &Aabb) -> bool {
    bounds.min.cmple(bounds.max).all()
}

impl Sizes {
    /// Of some of the boxes.
    pub(super) fn of(boxes: &Boxes<'_>, items: Range<usize>) -> Self {
        let mut sizes = Self::default();
        for item in items {
            let item = item as u32;
            let bounds = boxes.get(item);
            if !is_filled(bounds) {
                continue;
            }
            let whole = &mut sizes.wholes[boxes.side(item)];
            *whole = whole.union(bounds);
            let size = size(bounds);
            if size.is_finite() {
                sizes.sum += f64::from(size);
                sizes.count += 1.0;
            }
            if size.is_finite() && size > 0.0 {
                sizes.exponents += i64::from(exponent(size));
                sizes.with_exponent += 1;
            }
        }
        sizes
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (whole, other) in self.wholes.iter_mut().zip(&other.wholes) {
            *whole = whole.union(other);
        }
        self.sum += other.sum;
        self.count += other.count;
        self.exponents += other.exponents;
        self.with_exponent += other.with_exponent;
    }

    /// The arithmetic mean of the boxes' largest sides. Of points, what each would have of the space in which they are.
    pub(super) fn mean(&self) -> f64 {
        if self.sum > 0.0 {
            return self.sum / self.count;
        }
        let whole = self.wholes[0].union(&self.wholes[1]);
        let space = f64::from(size(&whole)) / self.count.cbrt();
        if space.is_finite() { space } else { 0.0 }
    }

    /// The geometric mean as an exponent of two.
    pub(super) fn mean_exponent(&self) -> i32 {
        if self.with_exponent > 0 {
            self.exponents.div_euclid(self.with_exponent) as i32
        } else {
            exponent(self.mean() as f32)
        }
    }

    /// Where a box goes: nowhere if it cannot overlap any box that it is compared with.
    pub(super) fn place(&self, boxes: &Boxes<'_>, grids: &Grids, item: u32) -> Place {
        let bounds = boxes.get(item);
        let is_reached = boxes.is_own() || self.wholes[1 - boxes.side(item)].overlaps(bounds);
        if is_filled(bounds) && is_reached { grids.place(bounds) } else { Place::LeftOut }
    }
}
