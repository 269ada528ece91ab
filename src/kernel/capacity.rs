//! Capacity policy for reused lists: keep enough that a steady tick allocates nothing, and no more than a new list
//! would get.
//!
//! Call these functions where a list is cleared or has just been filled. They keep no history: the last length predicts
//! the next one.

/// A list keeps capacity for at most this many times its length. Growth doubles the capacity, so a new list may have as
/// much.
const MOST_ROOM: usize = 2;

/// Capacity for this many more items is always kept: short lists vary most.
const LEAST_ROOM: usize = 8;

/// Shrinks a list whose capacity exceeds what `needed` items may take.
pub(crate) fn trim<T>(list: &mut Vec<T>, needed: usize) {
    if list.capacity() > MOST_ROOM * needed + LEAST_ROOM {
        list.shrink_to(needed);
    }
}

/// Clears a list, and keeps capacity for about its previous length.
pub(crate) fn clear<T>(list: &mut Vec<T>) {
    let held = list.len();
    list.clear();
    trim(list, held);
}
