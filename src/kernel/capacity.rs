//! How much room lists keep for later: enough that a steady tick allocates nothing, and no more than a new list would take.
//!
//! Called where a list is emptied or has just been filled. There is no memory of earlier lengths: what a list held last tells
//! what it will hold next.

/// A list keeps room for this many times what it holds: it grows by doubling, so a new one may have as much.
const MOST_ROOM: usize = 2;

/// Room for so many items is always kept: short lists vary most.
const LEAST_ROOM: usize = 8;

/// Gives back the room of a list beyond what `needed` items may take.
pub(crate) fn trim<T>(list: &mut Vec<T>, needed: usize) {
    if list.capacity() > MOST_ROOM * needed + LEAST_ROOM {
        list.shrink_to(needed);
    }
}

/// Empties a list, and keeps room for about what it held.
pub(crate) fn clear<T>(list: &mut Vec<T>) {
    let held = list.len();
    list.clear();
    trim(list, held);
}
