//! Many boxes in one cell, and the list of large boxes: sorted along an axis, and swept or searched along it.

use std::ops::Range;

use super::{boxes::Boxes, entries::Entry};
use crate::kernel::mesh::bounds::Aabb;

/// Boxes in sorted order on an axis, those of the first list before those of the second.
#[derive(Clone, Debug, Default)]
pub(super) struct Crowd {
    /// Where its entries are in their list.
    pub(super) entries: Range<usize>,
    /// Where its spans are in their list.
    spans: usize,
    /// How many boxes are of the first list.
    first: usize,
    axis: usize,
}

/// A box's minimum on the axis of its crowd, and the largest maximum up to this box in its list. Both ascend.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Span {
    min: f32,
    reach: f32,
}

/// The axis on which the fewest boxes overlap: with the least sum of lengths relative to the length of the whole.
fn best_axis(entries: &[Entry], boxes: &Boxes<'_>) -> usize {
    let (mut low, mut high, mut lengths) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], [0.0; 3]);
    for entry in entries {
        let bounds = boxes.get(entry.item);
        for axis in 0..3 {
            let [min, max] = [bounds.min, bounds.max].map(|corner| f64::from(corner[axis]));
            low[axis] = low[axis].min(min);
            high[axis] = high[axis].max(max);
            lengths[axis] += max - min;
        }
    }
    let is_better =
        |axis: usize, than: usize| lengths[axis] * (high[than] - low[than]) < lengths[than] * (high[axis] - low[axis]);
    [1, 2].into_iter().fold(0, |best, axis| if is_better(axis, best) { axis } else { best })
}

impl Crowd {
    /// Sorts boxes, of which none is empty. `start` is where they are in their list.
    pub(super) fn sort(entries: &mut [Entry], start: usize, boxes: &Boxes<'_>, spans: &mut Vec<Span>) -> Self {
        let axis = best_axis(entries, boxes);
        let span = |entry: &Entry| {
            let bounds = boxes.get(entry.item);
            Span { min: bounds.min[axis], reach: bounds.max[axis] }
        };
        let side = |entry: &Entry| if boxes.is_own() { 0 } else { boxes.side(entry.item) };
        entries.sort_unstable_by(|a, b| {
            let by_minimum = || span(a).min.total_cmp(&span(b).min);
            side(a).cmp(&side(b)).then_with(by_minimum).then(a.item.cmp(&b.item))
        });
        let first = entries.partition_point(|entry| side(entry) == 0);
        let crowd = Self { entries: start..start + entries.len(), spans: spans.len(), first, axis };
        for entries in [&entries[..first], &entries[first..]] {
            let mut reach = f32::NEG_INFINITY;
            spans.extend(entries.iter().map(|entry| {
                let span = span(entry);
                reach = reach.max(span.reach);
                Span { reach, ..span }
            }));
        }
        crowd
    }

    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    fn of<'a>(&self, entries: &'a [Entry], spans: &'a [Span]) -> (&'a [Entry], &'a [Span]) {
        (&entries[self.entries.clone()], &spans[self.spans..self.spans + self.len()])
    }

    /// Appends the pairs that some boxes form with those that begin after them on the axis.
    pub(super) fn sweep(
        &self,
        range: Range<usize>,
        lists: (&[Entry], &[Span]),
        boxes: &Boxes<'_>,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let (entries, spans) = self.of(lists.0, lists.1);
        for place in range {
            let (entry, bounds) = (entries[place], boxes.get(entries[place].item));
            let min = spans[place].min;
            // Of two boxes of different lists that begin at the same coordinate, that of the first list finds the other.
            let (from, to) = if boxes.is_own() {
                (place + 1, entries.len())
            } else if place < self.first {
                (self.first + spans[self.first..].partition_point(|span| span.min < min), entries.len())
            } else {
                (spans[..self.first].partition_point(|span| span.min <= min), self.first)
            };
            for (other, span) in entries[from..to].iter().zip(&spans[from..to]) {
                if span.min > bounds.max[self.axis] {
                    break;
                }
                if entry.counts_here(other.lowest) && bounds.overlaps(boxes.get(other.item)) {
                    pairs.push(boxes.pair(entry.item, other.item));
                }
            }
        }
    }

    /// Appends the pairs that a box which is not in the crowd forms with its boxes. `lowest` is the box's, in this cell.
    pub(super) fn visit(
        &self,
        (item, bounds, lowest): (u32, &Aabb, u8),
        lists: (&[Entry], &[Span]),
        boxes: &Boxes<'_>,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let (entries, spans) = self.of(lists.0, lists.1);
        let side = match (boxes.is_own(), boxes.side(item)) {
            (true, _) => 0..entries.len(),
            (false, 0) => self.first..entries.len(),
            (false, _) => 0..self.first,
        };
        let (entries, spans) = (&entries[side.clone()], &spans[side]);
        let from = spans.partition_point(|span| span.reach < bounds.min[self.axis]);
        for (other, span) in entries.iter().zip(spans).skip(from) {
            if span.min > bounds.max[self.axis] {
                break;
            }
            if other.counts_here(lowest) && bounds.overlaps(boxes.get(other.item)) {
                pairs.push(boxes.pair(item, other.item));
            }
        }
    }
}
