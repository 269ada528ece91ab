//! The occupied cells of a hash one by one, for those who draw them.

use super::{
    boxes::Boxes,
    entries::{Entry, Part},
    table::HashSettings,
};
use crate::kernel::mesh::bounds::Aabb;

/// A cell that has boxes.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupiedCell {
    /// Its grid, counted from the finest one.
    pub level: u8,
    /// Where it is.
    pub bounds: Aabb,
    /// The boxes in it, ascending. The numbers of a second list follow those of the first.
    pub items: Vec<u32>,
}

/// The cells that a hash with these settings fills to pair boxes with each other, or with those of a second list: level
/// by level.
#[must_use]
pub fn occupied_cells(settings: &HashSettings, first: &[Aabb], second: Option<&[Aabb]>) -> Vec<OccupiedCell> {
    let boxes = Boxes { first, second };
    let mut part = Part::default();
    part.measure(&boxes, 0..boxes.len());
    let sizes = part.sizes;
    let grids = settings.grids(&sizes);
    part.make_entries(&boxes, &sizes, &grids);
    let mut entries = part.into_entries();
    entries.sort_unstable_by_key(|entry| (entry.key(), entry.item));
    let of_cell = |entries: &[Entry]| {
        let (level, cell) = entries[0].key();
        let items = entries.iter().map(|entry| entry.item).collect();
        OccupiedCell { level, bounds: grids.bounds(level, cell), items }
    };
    entries.chunk_by(|a, b| a.key() == b.key()).map(of_cell).collect()
}
