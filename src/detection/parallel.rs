//! Spreads a list of pairs over Bevy's compute task pool, with results in the order of the list.

use std::sync::atomic::{AtomicUsize, Ordering};

use bevy_tasks::ComputeTaskPool;

/// Pairs handed out at a time: enough work to outweigh the handing out, few enough to balance.
const CHUNK: usize = 4096;

/// How many threads may work, the calling one included: `wanted`, or where that is 0 all that the pool has.
fn available_threads(wanted: usize) -> usize {
    match (wanted, ComputeTaskPool::try_get()) {
        (1, _) | (_, None) => 1,
        (0, Some(pool)) => pool.thread_num() + 1,
        (wanted, Some(pool)) => wanted.min(pool.thread_num() + 1),
    }
}

/// Calls `work` on consecutive chunks of `pairs` and returns the results in order. The chunks are the same for any
/// number of threads. One thread, or a short list, never touches the pool.
pub(super) fn map_chunks<T: Send + 'static>(
    pairs: &[[u32; 2]],
    threads: usize,
    work: impl Fn(&[[u32; 2]]) -> T + Sync,
) -> Vec<T> {
    let chunk_count = pairs.len().div_ceil(CHUNK);
    let threads = available_threads(threads).min(chunk_count);
    if threads <= 1 {
        return pairs.chunks(CHUNK).map(work).collect();
    }
    let next = AtomicUsize::new(0);
    let take_chunks = || {
        let mut done = Vec::new();
        loop {
            let chunk = next.fetch_add(1, Ordering::Relaxed);
            let Some(pairs) = pairs.chunks(CHUNK).nth(chunk) else { return done };
            done.push((chunk, work(pairs)));
        }
    };
    let mut results: Vec<(usize, T)> = ComputeTaskPool::get()
        .scope(|scope| {
            for _ in 0..threads {
                scope.spawn(async { take_chunks() });
            }
        })
        .into_iter()
        .flatten()
        .collect();
    results.sort_unstable_by_key(|&(chunk, _)| chunk);
    results.into_iter().map(|(_, result)| result).collect()
}
