//! Which items of a list are computed.

use crate::kernel::simd::parallel::{LEAST_SHARE, PART};

/// Which items of a list are known, and which are to be computed next.
#[derive(Clone, Debug, Default)]
pub(super) struct Selection {
    /// For each item, whether it has been selected.
    selected: Vec<bool>,
    /// The items to compute next, ascending once they are [settled](Self::settle).
    next: Vec<u32>,
    is_settled: bool,
}

/// Items that are computed together, and the part of the list that they are in.
pub(super) struct Part<'a, T> {
    /// The items, ascending.
    pub(super) items: &'a [u32],
    first: usize,
    list: &'a mut [T],
}

impl<T> Part<'_, T> {
    /// An item, to be written.
    #[inline]
    pub(super) fn of(&mut self, item: u32) -> &mut T {
        &mut self.list[item as usize - self.first]
    }

    /// Consecutive items, to be written.
    #[inline]
    pub(super) fn range(&mut self, range: std::ops::Range<usize>) -> &mut [T] {
        &mut self.list[range.start - self.first..range.end - self.first]
    }
}

impl Selection {
    /// Begins anew, with a list of unknown items.
    pub(super) fn forget(&mut self, items: usize) {
        self.selected.clear();
        self.selected.resize(items, false);
        self.next.clear();
        self.is_settled = false;
    }

    /// Selects an item.
    #[inline]
    pub(super) fn want(&mut self, item: u32) {
        if std::mem::take(&mut self.is_settled) {
            self.next.clear();
        }
        let selected = &mut self.selected[item as usize];
        if !*selected {
            *selected = true;
            self.next.push(item);
        }
    }

    pub(super) fn want_all(&mut self) {
        for item in 0..self.selected.len() as u32 {
            self.want(item);
        }
    }

    /// Whether an item has been selected.
    #[inline]
    pub(super) fn knows(&self, item: u32) -> bool {
        self.selected[item as usize]
    }

    /// Ends the selection of the items to compute next. Returns whether there are any.
    pub(super) fn settle(&mut self) -> bool {
        if std::mem::replace(&mut self.is_settled, true) {
            self.next.clear();
        }
        if !self.next.is_sorted() {
            self.next.sort_unstable();
        }
        !self.next.is_empty()
    }

    /// Whether all items are to be computed next.
    pub(super) fn are_all(&self) -> bool {
        self.next.len() == self.selected.len()
    }

    /// The items to compute next, ascending.
    pub(super) fn next(&self) -> &[u32] {
        &self.next
    }

    /// The number of threads that pay off for the items to compute.
    pub(super) fn share(&self) -> usize {
        self.next.len() / LEAST_SHARE
    }

    /// The items to compute, in parts of the list that they are in.
    pub(super) fn parts<'a, T: Send>(&'a self, list: &'a mut [T]) -> impl Iterator<Item = Part<'a, T>> + Send {
        self.parts_of(list, |item| item as usize..item as usize + 1)
    }

    /// Like [`parts`](Self::parts), where each item has a range of the list. The ranges ascend like the items.
    pub(super) fn parts_of<'a, T: Send>(
        &'a self,
        list: &'a mut [T],
        range: impl Fn(u32) -> std::ops::Range<usize> + Send + 'a,
    ) -> impl Iterator<Item = Part<'a, T>> + Send {
        let (mut rest, mut passed) = (list, 0);
        self.next.chunks(PART).map(move |items| {
            let (first, end) = (range(items[0]).start, range(items[items.len() - 1]).end);
            let (_, later) = std::mem::take(&mut rest).split_at_mut(first - passed);
            let (list, later) = later.split_at_mut(end - first);
            (rest, passed) = (later, end);
            Part { items, first, list }
        })
    }
}
