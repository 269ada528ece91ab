//! A block of the table: consecutive slots with their entries, and the pairs in their cells.

use glam::Vec3A;

use super::{
    boxes::Boxes,
    cells::Cell,
    crowd::{Crowd, Group},
    entries::{ALL_AXES, Entry, Part, Slots},
};
use crate::kernel::mesh::bounds::Aabb;

/// Cells with more entries than this compare eight boxes at a time.
const FEW: usize = 8;

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
    /// Cells with more than a few boxes that are not finished, in the order of the entries.
    pub(super) crowds: Vec<Crowd>,
    pub(super) groups: Vec<Group>,
    near: Vec<Near>,
    /// Pairs of boxes of one level in cells that are not crowded.
    pub(super) pairs: Vec<[u32; 2]>,
    pub(super) occupied_cells: usize,
}

impl Block {
    /// Collects the block's entries from all parts, in slots.
    pub(super) fn fill(&mut self, number: usize, parts: &[Part], slots: Slots) {
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

    /// Finds the pairs in each cell that is not crowded, and sorts those that are. `is_visited`: whether boxes of other
    /// levels follow.
    pub(super) fn pair_cells(&mut self, boxes: &Boxes<'_>, is_visited: bool) {
        self.pairs.clear();
        self.crowds.clear();
        self.groups.clear();
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
                if cell.len() <= FEW {
                    pair_cell(cell, boxes, &mut self.near, &mut self.pairs);
                } else {
                    let groups = self.groups.len();
                    let crowd = Crowd::new(cell, start, boxes, &mut self.groups);
                    if !crowd.is_sorted() {
                        crowd.sweep(0..crowd.group_count(), &self.groups, boxes, &mut self.pairs);
                    }
                    if crowd.is_sorted() || is_visited {
                        self.crowds.push(crowd);
                    } else {
                        self.groups.truncate(groups);
                    }
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
        if entries.len() > FEW {
            let from = entries.partition_point(|entry| entry.key() < (level, cell));
            let to = entries.partition_point(|entry| entry.key() <= (level, cell));
            if to - from > FEW {
                let place = self.crowds.partition_point(|crowd| crowd.entries < start + from);
                return self.crowds[place].visit(visitor, &self.groups, boxes, pairs);
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

/// Appends the pairs that count in a cell, whose entries are in the order of the boxes.
fn pair_cell(cell: &[Entry], boxes: &Boxes<'_>, near: &mut Vec<Near>, pairs: &mut Vec<[u32; 2]>) {
    let first = cell.partition_point(|entry| boxes.side(entry.item) == 0);
    if cell.len() < 2 || !boxes.is_own() && (first == 0 || first == cell.len()) {
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
            if overlap.all() && (one.lowest | other.lowest) == ALL_AXES {
                pairs.push(boxes.pair(one.item, other.item));
            }
        }
    }
}
