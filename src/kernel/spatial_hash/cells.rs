//! The cells of grids: their sizes, their coordinates, and their hash.

use glam::Vec3;

use crate::kernel::mesh::bounds::Aabb;

/// The most grids of a hierarchy.
pub(super) const MOST_LEVELS: u8 = 16;

/// From grid to grid the size of cells doubles this many times. With 1, boxes visit more levels, which takes 1.2 times as
/// long on scanned and crumpled meshes.
const DOUBLINGS: i32 = 2;

/// A box in more cells of a uniform grid than this is not written into them. It is compared with all boxes by a sweep.
const MOST_CELLS: f64 = 64.0;

/// Side of a cell of the uniform grid, in mean box sizes. With 1, more entries are written, and with 3, more boxes are
/// compared.
const SIZES_OF_A_CELL: f64 = 2.0;

/// The finest cells of a hierarchy, in powers of two below the mean size. Smaller boxes share them.
const DOUBLINGS_BELOW_MEAN: i32 = 12;

/// Exponents of two whose powers and their reciprocals are normal numbers.
const EXPONENTS: [i32; 2] = [-126, 126];

/// The coordinates of a cell.
pub(super) type Cell = [i32; 3];

/// Where a box goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) enum Place {
    /// Nowhere: it is empty or has NaN, or it is beyond the reach of the other surface.
    #[default]
    LeftOut,
    /// Into the cells of the grid of this number.
    Level(u8),
    /// Onto the list of large boxes.
    Large,
}

/// The grids of a hash: one, or one for every second power of two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grids {
    /// The finest level's exponent of two. `None` for a uniform grid.
    finest: Option<i32>,
    /// The reciprocals of cell sizes.
    densities: [f32; MOST_LEVELS as usize],
}

impl Default for Grids {
    fn default() -> Self {
        Self { finest: None, densities: [1.0; MOST_LEVELS as usize] }
    }
}

impl Grids {
    /// A single grid with this cell size, or with one that fits boxes of this mean size.
    pub(super) fn uniform(cell_size: Option<f32>, mean_size: f64) -> Self {
        let automatic = (SIZES_OF_A_CELL * mean_size) as f32;
        let size = cell_size.unwrap_or(automatic).clamp(power_of_two(EXPONENTS[0]), power_of_two(EXPONENTS[1]));
        Self { finest: None, densities: [1.0 / size; MOST_LEVELS as usize] }
    }

    /// A hierarchy whose finest cells have at least this size, or fit boxes of this mean exponent of two.
    pub(super) fn hierarchical(cell_size: Option<f32>, mean_exponent: i32) -> Self {
        let finest = cell_size.map_or(mean_exponent - DOUBLINGS_BELOW_MEAN, exponent);
        let finest = finest.clamp(EXPONENTS[0], EXPONENTS[1] - DOUBLINGS * i32::from(MOST_LEVELS));
        let mut exponent = finest;
        let densities = [(); MOST_LEVELS as usize].map(|()| {
            let density = power_of_two(-exponent);
            exponent += DOUBLINGS;
            density
        });
        Self { finest: Some(finest), densities }
    }

    /// The lowest and the highest cell that a box reaches.
    pub(super) fn cells(&self, level: u8, bounds: &Aabb) -> [Cell; 2] {
        let density = self.densities[usize::from(level)];
        [bounds.min, bounds.max].map(|corner| corner.to_array().map(|coordinate| floor(coordinate * density)))
    }

    /// Where a cell is.
    pub(super) fn bounds(&self, level: u8, cell: Cell) -> Aabb {
        let side = 1.0 / f64::from(self.densities[usize::from(level)]);
        let corner = |beyond: f64| Vec3::from_array(cell.map(|place| ((f64::from(place) + beyond) * side) as f32));
        Aabb { min: corner(0.0), max: corner(1.0) }
    }

    /// Where a box that is not empty goes.
    pub(super) fn place(&self, bounds: &Aabb) -> Place {
        let size = size(bounds);
        if !size.is_finite() {
            return Place::Large;
        }
        let Some(finest) = self.finest else {
            let [low, high] = self.cells(0, bounds);
            let sides = [0, 1, 2].map(|axis| f64::from(high[axis]) - f64::from(low[axis]) + 1.0);
            return if sides[0] * sides[1] * sides[2] > MOST_CELLS { Place::Large } else { Place::Level(0) };
        };
        let level = (exponent(size) - finest + DOUBLINGS - 1).max(0) / DOUBLINGS;
        u8::try_from(level).ok().filter(|level| *level < MOST_LEVELS).map_or(Place::Large, Place::Level)
    }
}

/// The largest side of a box.
pub(super) fn size(bounds: &Aabb) -> f32 {
    (bounds.max - bounds.min).max_element()
}

/// The exponent of the smallest power of two that is not less than a size.
pub(super) fn exponent(size: f32) -> i32 {
    let bits = size.to_bits();
    let whole = (bits >> 23 & 0xff).cast_signed() - 127;
    whole.max(EXPONENTS[0]) + i32::from(bits & 0x7f_ffff != 0)
}

fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits((exponent + 127).cast_unsigned() << 23)
}

/// The floor, saturated. It never decreases when the coordinate increases, so a point in two boxes is in a cell of both.
fn floor(coordinate: f32) -> i32 {
    // `f32::floor` is a function call on machines without SSE4.1.
    let truncated = coordinate as i32;
    truncated.saturating_sub(i32::from(truncated as f32 > coordinate))
}

/// The hash of a cell (Teschner et al. 2003). Levels of a hierarchy are a fourth coordinate.
pub(super) fn hash([i, j, k]: Cell, level: u8) -> u32 {
    let [i, j, k] = [i, j, k].map(i32::cast_unsigned);
    i.wrapping_mul(73_856_093)
        ^ j.wrapping_mul(19_349_663)
        ^ k.wrapping_mul(83_492_791)
        ^ u32::from(level).wrapping_mul(0x9e37_79b1)
}

/// The cells from the lowest to the highest, each with a bit for each axis on which it is the lowest.
#[inline]
pub(super) fn cells_between([low, high]: [Cell; 2]) -> impl Iterator<Item = (Cell, u8)> {
    let columns = (low[0]..=high[0]).flat_map(move |i| (low[1]..=high[1]).map(move |j| (i, j)));
    columns.flat_map(move |(i, j)| {
        (low[2]..=high[2]).map(move |k| {
            let lowest = u8::from(i == low[0]) | u8::from(j == low[1]) << 1 | u8::from(k == low[2]) << 2;
            ([i, j, k], lowest)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_floor_is_that_of_the_standard_library_and_saturates() {
        for value in [0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 1e-40, -1e-40, 8_388_607.5, -8_388_607.5, 2e9, -2e9] {
            assert_eq!(floor(value), f32::floor(value) as i32, "{value}");
        }
        assert_eq!([3e9, f32::INFINITY].map(floor), [i32::MAX; 2]);
        assert_eq!([-3e9, f32::NEG_INFINITY].map(floor), [i32::MIN; 2]);
    }

    #[test]
    fn exponents_round_up() {
        for (size, expected) in [(1.0, 0), (1.5, 1), (2.0, 1), (2.1, 2), (0.5, -1), (0.3, -1), (0.0, -126)] {
            assert_eq!(exponent(size), expected, "{size}");
            assert!(power_of_two(exponent(size)) >= size);
        }
    }

    #[test]
    fn a_hierarchy_puts_boxes_into_few_cells_of_their_size() {
        let grids = Grids::hierarchical(None, 0);
        for size in [1e-3, 0.3, 1.0, 1.1, 900.0] {
            let bounds = Aabb { min: Vec3::splat(-0.1), max: Vec3::splat(size - 0.1) };
            let Place::Level(level) = grids.place(&bounds) else { panic!("{size} is not large") };
            let [low, high] = grids.cells(level, &bounds);
            assert!((0..3).all(|axis| high[axis] - low[axis] <= 1), "{size}");
        }
        let huge = Aabb { min: Vec3::splat(-1e9), max: Vec3::splat(1e9) };
        assert_eq!(grids.place(&huge), Place::Large);
    }
}
