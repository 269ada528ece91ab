//! Points in the cells of a uniform grid, stored by a hash of the cell (Teschner et al. 2003).

use glam::DVec3;

/// Slots of the table per point.
const SLOTS_OF_A_POINT: usize = 2;

type Cell = [i32; 3];

/// Points by the cells of a grid. Every point is in one cell.
#[derive(Clone, Debug, Default)]
pub(super) struct HashedCells {
    /// Side of a cell.
    size: f64,
    /// Where the points of each slot begin, and after the last slot, where they end.
    starts: Vec<u32>,
    /// The points, slot by slot, each with its cell.
    points: Vec<(Cell, u32)>,
}

impl HashedCells {
    /// Stores points in cells of side `size`, which is positive.
    pub(super) fn fill(&mut self, points: impl Iterator<Item = DVec3> + Clone, size: f64) {
        self.size = size;
        let count = points.clone().count();
        let slots = SLOTS_OF_A_POINT * count + 1;
        self.starts.clear();
        self.starts.resize(slots + 1, 0);
        for point in points.clone() {
            self.starts[slot(cell(point, size), slots)] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.points.clear();
        self.points.resize(count, ([0; 3], 0));
        for (place, point) in points.enumerate() {
            let cell = cell(point, size);
            let start = &mut self.starts[slot(cell, slots)];
            *start -= 1;
            self.points[*start as usize] = (cell, place as u32);
        }
    }

    /// Calls `visit` with the index of every point in the cells that a box overlaps, once, in any order.
    pub(super) fn visit(&self, min: DVec3, max: DVec3, mut visit: impl FnMut(u32)) {
        let (low, high) = (cell(min, self.size), cell(max, self.size));
        let sides = [0, 1, 2].map(|axis: usize| f64::from(high[axis]) - f64::from(low[axis]) + 1.0);
        // A box that is large among small cells must not take longer than a pass over all points.
        if sides[0] * sides[1] * sides[2] >= self.points.len() as f64 {
            for &(cell, point) in &self.points {
                if (0..3).all(|axis| (low[axis]..=high[axis]).contains(&cell[axis])) {
                    visit(point);
                }
            }
            return;
        }
        let slots = self.starts.len() - 1;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let slot = slot([x, y, z], slots);
                    let range = self.starts[slot] as usize..self.starts[slot + 1] as usize;
                    for &(cell, point) in &self.points[range] {
                        if cell == [x, y, z] {
                            visit(point);
                        }
                    }
                }
            }
        }
    }
}

/// The cell of a point. Far cells saturate, which keeps their order.
fn cell(point: DVec3, size: f64) -> Cell {
    (point / size).floor().to_array().map(|coordinate| coordinate as i32)
}

fn slot([i, j, k]: Cell, slots: usize) -> usize {
    let [i, j, k] = [i, j, k].map(i32::cast_unsigned);
    let hash = i.wrapping_mul(73_856_093) ^ j.wrapping_mul(19_349_663) ^ k.wrapping_mul(83_492_791);
    (hash % slots as u32) as usize
}
