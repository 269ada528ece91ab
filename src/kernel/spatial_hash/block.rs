//! A block of the table: consecutive slots with their entries, and the pairs in their cells.

use glam::Vec3A;

use super::{
    boxes::Boxes,
    cells::{Cell, hash},
    crowd::{Crowd, Span},
    entries::{Entry, Part, Slots},
};
use crate::kernel::mesh::bounds::Aabb;

/// A cell with more entries is swept along an axis instead of comparing all pairs.
pub(super) const CROWDED: usize = 48;

/// The box of an entry, copied next to the others of its cell.
#[derive(Clone, Copy, Debug)]
struct Near {
    min: Vec3A,
    max: Vec3A,
    item: u32,
    lowest: u8,
}

/// Consecutive slots.
#[derive(Debug, Default)]
pub(super) struct Block {
    /// Slot by slot. Within a slot by cell, and within a cell by box or in the order of its crowd.
    pub(super) entries: Vec<Entry>,
    /// Where each slot begins, and after the last one, where it ends.
    starts: Vec<u32>,
    /// Cells with many boxes, in the order of the entries.
    pub(super) crowds: Vec<Crowd>,
    pub(super) spans: Vec<Span>,
    near: Vec<Near>,
    /// Pairs of boxes of one level in cells that are not crowded.
    pub(super) pairs: Vec<[u32; 2]>,
    pub(super) occupied_cells: usize,
}

impl Block {
    /// Collects the block's entries from all parts, in slots.
    pub(super) fn fill(&mut self, number: usize, parts: &[Part], slots: &Slots) {
        self.starts.clear();
        self.starts.resize(slots.of_a_block() + 1, 0);
        for entry in parts.iter().flat_map(|part| part.of_block(number)) {
            self.starts[slots.place(entry.slot).1] += 1;
        }
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            *start = sum;
        }
        self.entries.resize(sum as usize, Entry::default());
        for entry in parts.iter().rev().flat_map(|part| part.of_block(number).iter().rev()) {
            let start = &mut self.starts[slots.place(entry.slot).1];
            *start -= 1;
            self.entries[*start as usize] = *entry;
        }
    }

    /// Finds the pairs in each cell that is not crowded, and sorts those that are.
    pub(super) fn pair_cells(&mut self, boxes: &Boxes<'_>) {
        self.pairs.clear();
        self.crowds.clear();
        self.spans.clear();
        self.occupied_cells = 0;
        for slot in 1..self.starts.len() {
            let [start, end] = [slot - 1, slot].map(|slot| self.starts[slot] as usize);
            let entries = &mut self.entries[start..end];
            if entries.len() < 2 {
                self.occupied_cells += entries.len();
                continue;
            }
            if !entries.iter().all(|entry| entry.key() == entries[0].key()) {
                entries.sort_unstable_by_key(|entry| (entry.key(), entry.item));
            }
            let mut start = start;
            for cell in entries.chunk_by_mut(|a, b| a.key() == b.key()) {
                self.occupied_cells += 1;
                if cell.len() > CROWDED {
                    self.crowds.push(Crowd::sort(cell, start, boxes, &mut self.spans));
                } else if cell.len() > 1 {
                    pair_cell(cell, boxes, &mut self.near, &mut self.pairs);
                }
                start += cell.len();
            }
        }
    }

    /// Appends the pairs that a box of a finer level forms with the boxes in a cell of this level.
    pub(super) fn visit(
        &self,
        slot: usize,
        (level, cell): (u8, Cell),
        visitor: (u32, &Aabb, u8),
        boxes: &Boxes<'_>,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let (start, end) = (self.starts[slot] as usize, self.starts[slot + 1] as usize);
        let mut entries = &self.entries[start..end];
        if entries.len() > CROWDED {
            let from = entries.partition_point(|entry| entry.key() < (level, cell));
            let to = entries.partition_point(|entry| entry.key() <= (level, cell));
            if to - from > CROWDED {
                let place = self.crowds.partition_point(|crowd| crowd.entries.start < start + from);
                return self.crowds[place].visit(visitor, (&self.entries, &self.spans), boxes, pairs);
            }
            entries = &entries[from..to];
        }
        let (item, bounds, lowest) = visitor;
        for entry in entries {
            let is_met = boxes.is_own() || boxes.side(entry.item) != boxes.side(item);
            if entry.key() == (level, cell)
                && entry.counts_here(lowest)
                && is_met
                && boxes.get(entry.item).overlaps(bounds)
            {
                pairs.push(boxes.pair(item, entry.item));
            }
        }
    }

    /// The number of items that the lists have room for.
    pub(super) fn room(&self) -> usize {
        self.entries.capacity()
    }
}

/// The block and the slot of a cell.
pub(super) fn slot_of(slots: &Slots, level: u8, cell: Cell) -> (usize, usize) {
    slots.place(slots.slot(hash(cell, level)))
}

/// Appends the pairs that count in a cell, whose entries are in the order of the boxes.
fn pair_cell(cell: &[Entry], boxes: &Boxes<'_>, near: &mut Vec<Near>, pairs: &mut Vec<[u32; 2]>) {
    let first = if boxes.is_own() { cell.len() } else { cell.partition_point(|entry| boxes.side(entry.item) == 0) };
    if !boxes.is_own() && (first == 0 || first == cell.len()) {
        return;
    }
    near.clear();
    near.extend(cell.iter().map(|&Entry { item, lowest, .. }| {
        let Aabb { min, max } = *boxes.get(item);
        Near { min: min.into(), max: max.into(), item, lowest }
    }));
    for (place, one) in near[..first].iter().enumerate() {
        let others = if boxes.is_own() { &near[place + 1..] } else { &near[first..] };
        for other in others {
            let overlap = one.min.cmple(other.max) & other.min.cmple(one.max);
            if overlap.all() && (one.lowest | other.lowest) == 0b111 {
                pairs.push(boxes.pair(one.item, other.item));
            }
        }
    }
}
