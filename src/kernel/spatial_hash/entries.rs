//! Entries: a box in a cell. Consecutive boxes form parts, whose entries are made and sorted by blocks of the table
//! independently of each other.

use std::ops::Range;

use super::{
    boxes::{Boxes, Sizes},
    cells::{Cell, Grids, MOST_LEVELS, Place, cells_between, hash},
};

/// A box in a cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Entry {
    pub(super) cell: Cell,
    /// The hash of the cell, and then its slot.
    pub(super) slot: u32,
    /// The box.
    pub(super) item: u32,
    /// The grid of the cell.
    pub(super) level: u8,
    /// A bit for each axis on which the cell is the lowest one of the box.
    pub(super) lowest: u8,
}

/// The bits of all axes.
pub(super) const ALL_AXES: u8 = 0b111;

impl Entry {
    /// A box on the list of large boxes. Pairs on it are not found anywhere else.
    pub(super) fn large(item: u32) -> Self {
        Self { item, lowest: ALL_AXES, ..Self::default() }
    }

    /// Whether the pair of two boxes in one cell counts in this cell: that of the larger of their two minima on each
    /// axis, where one of them has its lowest cell.
    #[inline]
    pub(super) fn counts_here(&self, lowest: u8) -> bool {
        (self.lowest | lowest) == ALL_AXES
    }

    /// Sort key of the cells in a slot.
    pub(super) fn key(&self) -> (u8, Cell) {
        (self.level, self.cell)
    }
}

/// The slots of the table, in blocks of a power of two.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slots {
    count: u32,
    shift: u32,
}

/// Slots per block: at least so many that a block's entries fit into the first-level cache.
const LEAST_SHIFT: u32 = 10;

/// The most blocks.
const MOST_BLOCKS: u32 = 256;

impl Slots {
    /// A slot for each of so many entries.
    pub(super) fn for_entries(entries: usize) -> Self {
        // An odd number: with a power of two, cells whose distance is a power of two would share few slots.
        let count = (entries as u64).clamp(1, u64::from(u32::MAX >> 1)) as u32 | 1;
        let shift = count.div_ceil(MOST_BLOCKS).next_power_of_two().trailing_zeros().max(LEAST_SHIFT);
        Self { count, shift }
    }

    pub(super) fn blocks(self) -> usize {
        (self.count as usize).div_ceil(1 << self.shift)
    }

    /// The slots of a block.
    pub(super) fn of_a_block(self) -> usize {
        1 << self.shift
    }

    pub(super) fn slot(self, hash: u32) -> u32 {
        hash % self.count
    }

    /// The block of a slot, and the slot's number in it.
    pub(super) fn place(self, slot: u32) -> (usize, usize) {
        ((slot >> self.shift) as usize, slot as usize & (self.of_a_block() - 1))
    }
}

/// Consecutive boxes.
#[derive(Debug, Default)]
pub(super) struct Part {
    pub(super) sizes: Sizes,
    pub(super) items: Range<usize>,
    /// The place of each box.
    pub(super) places: Vec<Place>,
    pub(super) large: Vec<u32>,
    /// The levels that have boxes of each list, one bit each.
    pub(super) levels: [u32; 2],
    made: Vec<Entry>,
    sorted: Vec<Entry>,
    /// Where the entries of each block begin, and after the last one, where they end.
    starts: Vec<u32>,
}

const _: () = assert!((MOST_LEVELS as u32) < u32::BITS);

impl Part {
    pub(super) fn measure(&mut self, boxes: &Boxes<'_>, items: Range<usize>) {
        self.sizes = Sizes::of(boxes, items.clone());
        self.items = items;
    }

    /// Places the boxes and makes their entries.
    pub(super) fn make_entries(&mut self, boxes: &Boxes<'_>, sizes: &Sizes, grids: &Grids) {
        self.places.clear();
        self.large.clear();
        self.made.clear();
        self.levels = [0; 2];
        for item in self.items.clone() {
            let item = item as u32;
            let place = sizes.place(boxes, grids, item);
            self.places.push(place);
            match place {
                Place::LeftOut => {}
                Place::Large => self.large.push(item),
                Place::Level(level) => {
                    self.levels[boxes.side(item)] |= 1 << level;
                    let cells = cells_between(grids.cells(level, boxes.get(item)));
                    self.made.extend(cells.map(|(cell, lowest)| {
                        let slot = hash(cell, level);
                        Entry { cell, slot, item, level, lowest }
                    }));
                }
            }
        }
    }

    /// The entries, in the order of the boxes.
    pub(super) fn into_entries(self) -> Vec<Entry> {
        self.made
    }

    pub(super) fn entry_count(&self) -> usize {
        self.made.len()
    }

    /// Sorts the entries by block, and otherwise keeps their order.
    pub(super) fn sort_by_block(&mut self, slots: Slots) {
        self.starts.clear();
        self.starts.resize(slots.blocks() + 1, 0);
        for entry in &mut self.made {
            entry.slot = slots.slot(entry.slot);
            self.starts[slots.place(entry.slot).0] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.sorted.resize(self.made.len(), Entry::default());
        for entry in self.made.iter().rev() {
            let start = &mut self.starts[slots.place(entry.slot).0];
            *start -= 1;
            self.sorted[*start as usize] = *entry;
        }
    }

    pub(super) fn of_block(&self, block: usize) -> &[Entry] {
        &self.sorted[self.starts[block] as usize..self.starts[block + 1] as usize]
    }

    /// The number of items that the lists have room for.
    pub(super) fn room(&self) -> usize {
        self.made.capacity() + self.sorted.capacity()
    }
}
