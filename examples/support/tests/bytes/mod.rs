//! Corrupted files, for the tests of every reader.

use proptest::prelude::*;

/// The bytes of a valid file with a few changes, sometimes truncated.
pub fn mutated(valid: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let length = valid.len();
    let changes = prop::collection::vec((0..length, any::<u8>()), 0..6);
    (changes, prop::option::of(0..length)).prop_map(move |(changes, end)| {
        let mut bytes = valid.clone();
        for (place, value) in changes {
            bytes[place] = value;
        }
        bytes.truncate(end.unwrap_or(length));
        bytes
    })
}
