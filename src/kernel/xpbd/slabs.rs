//! Splits space into slabs, so that threads can work on what is in different slabs at the same time.

use glam::DVec3;

/// The most slabs; a power of two, as all numbers of slabs.
pub(super) const MOST_SLABS: usize = 8;

/// Points per slab. With fewer, too much lies between slabs.
const LEAST: usize = 512;

/// The resolution in which slabs share points equally.
const BINS: usize = 256;

/// Which slab every point is in. Depends on nothing but the points.
#[derive(Clone, Debug, Default)]
pub struct Slabs {
    of_points: Vec<u8>,
    count: usize,
}

impl Slabs {
    /// Splits space between these points, across the longest side of their bounds.
    pub fn split(&mut self, points: &[DVec3]) {
        let Self { of_points, count } = self;
        *count = 1 << (points.len() / LEAST).clamp(1, MOST_SLABS).ilog2();
        of_points.clear();
        of_points.resize(points.len(), 0);
        if *count == 1 {
            return;
        }
        let (low, high) = points
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)));
        let axis = (high - low).max_position();
        let per_bin = BINS as f64 / (high - low)[axis];
        #[expect(clippy::cast_sign_loss, reason = "no coordinate is below the lowest")]
        let bin_of = |point: &DVec3| ((point[axis] - low[axis]) * per_bin).min(BINS as f64 - 1.0) as usize;
        let mut sizes = [0_usize; BINS];
        for point in points {
            sizes[bin_of(point)] += 1;
        }
        let (mut before, mut slabs) = (0, [0; BINS]);
        for (slab, size) in slabs.iter_mut().zip(sizes) {
            *slab = ((before + size / 2) * *count / points.len()) as u8;
            before += size;
        }
        for (slab, point) in of_points.iter_mut().zip(points) {
            *slab = slabs[bin_of(point)];
        }
    }

    /// The number of slabs.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.count
    }

    /// The slab of a point, or the first if it was not there when space was split.
    #[must_use]
    pub fn of(&self, point: u32) -> usize {
        self.of_points.get(point as usize).map_or(0, |&slab| slab.into())
    }

    /// The points of each slab.
    #[must_use]
    pub fn parts(&self) -> Vec<Vec<u32>> {
        let mut parts = vec![Vec::new(); self.count];
        for (point, &slab) in (0..).zip(&self.of_points) {
            parts[usize::from(slab)].push(point);
        }
        parts
    }

    /// The slab that all of these points are in, or else the number of slabs. Points that were not there when space was
    /// split do not count.
    pub fn common(&self, points: impl Iterator<Item = u32>) -> usize {
        match self.place(points) {
            Place::In(slab) => slab,
            Place::Across(_) | Place::Far => self.count,
        }
    }

    /// Where these points are. Points that were not there when space was split do not count.
    pub fn place(&self, points: impl Iterator<Item = u32>) -> Place {
        let slabs = points.filter_map(|point| self.of_points.get(point as usize));
        let (first, last) = slabs.fold((u8::MAX, 0), |(first, last), &slab| (first.min(slab), last.max(slab)));
        match last.checked_sub(first) {
            Some(0) => Place::In(usize::from(first)),
            Some(1) => Place::Across(usize::from(first)),
            _ => Place::Far,
        }
    }
}

/// Where some points are among the slabs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// All in one slab.
    In(usize),
    /// In a slab and the next.
    Across(usize),
    /// In slabs that are not neighbors, or in none.
    Far,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_are_of_equal_size_and_do_not_mix() {
        // 64 by 64 points, the columns in a random order.
        let column = |place: u32| place * 37 % 64;
        let points: Vec<DVec3> = (0..4096)
            .map(|place| DVec3::new(0.01 * f64::from(column(place)), 0.0, 0.005 * f64::from(place / 64)) + 1.0e3)
            .collect();
        let mut slabs = Slabs::default();
        slabs.split(&points);
        assert_eq!(slabs.count(), 8);
        let mut sizes = [0; 8];
        for place in 0..4096 {
            let slab = slabs.common([place].into_iter());
            sizes[slab] += 1;
            assert_eq!(slab, column(place) as usize / 8, "{}", points[place as usize]);
        }
        assert_eq!(sizes, [512; 8]);
        assert_eq!(slabs.common([0, 64].into_iter()), slabs.common([0].into_iter()));
        assert_eq!(slabs.common([0, 32].into_iter()), 8);
        for [a, b] in [[0, 64], [0, 7], [9, 2], [0, 32]] {
            let slabs_of = [a, b].map(|place| column(place) as usize / 8);
            let place = match slabs_of[0].abs_diff(slabs_of[1]) {
                0 => Place::In(slabs_of[0]),
                1 => Place::Across(slabs_of[0].min(slabs_of[1])),
                _ => Place::Far,
            };
            assert_eq!(slabs.place([a, b].into_iter()), place, "{a} {b}");
        }
        assert_eq!(slabs.common([9999, 0].into_iter()), slabs.common([0].into_iter()));
        assert_eq!(slabs.common([9999].into_iter()), 8);
    }

    #[test]
    fn few_points_and_points_at_one_place_are_in_one_slab() {
        for points in [vec![DVec3::X; 3], vec![DVec3::ONE; 5000], Vec::new()] {
            let mut slabs = Slabs::default();
            slabs.split(&points);
            assert!((1..points.len() as u32).all(|point| slabs.common([0, point].into_iter()) < slabs.count()));
        }
    }
}
