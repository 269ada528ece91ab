//! Spreads a list of pairs over Bevy's compute task pool, with results in the order of the list.

use std::{
    ops::Range,
    sync::atomic::{AtomicUsize, Ordering},
};

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

/// Calls `work` on consecutive chunks of `pairs`, each with results of its own, and has them appended to `results` in
/// order. One thread, or a short list, writes all at once and straight into `results`.
pub(super) fn collect_chunks<T: Default + Send + 'static>(
    pairs: &[[u32; 2]],
    threads: usize,
    results: &mut T,
    work: impl Fn(&[[u32; 2]], &mut T) + Sync,
    append: impl Fn(&mut T, T),
) {
    if available_threads(threads).min(pairs.len().div_ceil(CHUNK)) <= 1 {
        return work(pairs, results);
    }
    let chunks = map_chunks(pairs, threads, |chunk| {
        let mut found = T::default();
        work(chunk, &mut found);
        found
    });
    for chunk in chunks {
        append(results, chunk);
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

/// Calls `work` on consecutive parts of `0..count`, `chunk` long, each with a list to append to, and appends the lists to
/// `results` in order. Returns the sum of what `work` returns. One thread, or a single part, never touches the pool.
pub(super) fn append_ranges<T: Send + 'static>(
    count: usize,
    chunk: usize,
    threads: usize,
    results: &mut Vec<T>,
    work: impl Fn(Range<usize>, &mut Vec<T>) -> usize + Sync,
) -> usize {
    let part_count = count.div_ceil(chunk);
    let threads = available_threads(threads).min(part_count);
    if threads <= 1 {
        return work(0..count, results);
    }
    let next = AtomicUsize::new(0);
    let take_parts = || {
        let mut done = Vec::new();
        loop {
            let part = next.fetch_add(1, Ordering::Relaxed);
            if part >= part_count {
                return done;
            }
            let mut found = Vec::new();
            let sum = work(part * chunk..((part + 1) * chunk).min(count), &mut found);
            done.push((part, found, sum));
        }
    };
    let mut parts: Vec<(usize, Vec<T>, usize)> = ComputeTaskPool::get()
        .scope(|scope| {
            for _ in 0..threads {
                scope.spawn(async { take_parts() });
            }
        })
        .into_iter()
        .flatten()
        .collect();
    parts.sort_unstable_by_key(|&(part, ..)| part);
    parts.iter_mut().for_each(|(_, found, _)| results.append(found));
    parts.iter().map(|&(.., sum)| sum).sum()
}
