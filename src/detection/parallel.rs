//! Distributes lists over Bevy's compute task pool, or over a team of its threads. Results are in the order of the list,
//! for any number of threads.

use std::{
    ops::Range,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use bevy_tasks::ComputeTaskPool;

use crate::kernel::{
    bvh::near_pairs::BoundedPairs,
    pair::FoundPairs,
    simd::parallel::{Parallel, hand_out},
    spheres::contacts::FoundSpheres,
};

/// Pairs per task: enough work to outweigh the overhead, and few enough to balance the load.
pub(super) const CHUNK: usize = 4096;

/// The number of threads that may work, including the calling one: `wanted`, or all that the pool has if that is 0.
fn available_threads(wanted: usize) -> usize {
    match (wanted, ComputeTaskPool::try_get()) {
        (1, _) | (_, None) => 1,
        (0, Some(pool)) => pool.thread_num() + 1,
        (wanted, Some(pool)) => wanted.min(pool.thread_num() + 1),
    }
}

/// The threads among which kernel functions may distribute their tasks. 0 means all threads of the pool.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Threads(pub(crate) usize);

impl Threads {
    /// The largest number of threads, including the calling one.
    pub(super) fn most(self) -> usize {
        available_threads(self.0)
    }

    /// Whether this many tasks occupy only one thread.
    pub(super) fn are_one(self, tasks: usize) -> bool {
        self.most().min(tasks) <= 1
    }
}

impl Parallel for Threads {
    fn threads(&self) -> usize {
        self.most()
    }

    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, count: usize, work: impl Fn(P) + Sync) {
        run_tasks(tasks, count, self.0, work);
    }
}

/// The results of a stage, part by part.
pub(super) trait Results: Default + Send + 'static {
    /// Clears the results and keeps their memory.
    fn clear(&mut self);
}

impl<T: Send + 'static> Results for Vec<T> {
    fn clear(&mut self) {
        self.clear();
    }
}

impl Results for BoundedPairs {
    fn clear(&mut self) {
        self.clear();
    }
}

impl Results for FoundPairs {
    fn clear(&mut self) {
        self.clear();
    }
}

impl<T: Send + 'static> Results for (Vec<T>, FoundSpheres) {
    fn clear(&mut self) {
        self.0.clear();
        self.1.clear();
    }
}

/// Calls `work` on consecutive parts of `0..count`, each `chunk` long, with results to append to, and joins them in
/// order. With one thread or one part, hands out no tasks and allocates nothing. Otherwise each part writes to a
/// `spare` buffer, which is joined as soon as its turn comes, while it is still in the CPU cache.
pub(super) fn append_parts<T: Results>(
    count: usize,
    chunk: usize,
    parallel: &impl Parallel,
    spare: &Buffers<T>,
    results: &mut T,
    work: impl Fn(Range<usize>, &mut T) + Sync,
    mut join: impl FnMut(&mut T, &mut T) + Send,
) {
    let part_count = count.div_ceil(chunk);
    let range = |part: usize| part * chunk..((part + 1) * chunk).min(count);
    if parallel.threads().min(part_count) <= 1 {
        return (0..part_count).for_each(|part| work(range(part), results));
    }
    let waiting: Mutex<Vec<(usize, T)>> = Mutex::default();
    let take_waiting = |part: usize| {
        let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let place = waiting.iter().position(|(other, _)| *other == part)?;
        Some(waiting.swap_remove(place).1)
    };
    let mut joined = 0;
    let join_waiting = move || {
        while let Some(mut found) = take_waiting(joined) {
            join(results, &mut found);
            spare.give(found);
            joined += 1;
        }
    };
    let join_waiting = Mutex::new(join_waiting);
    parallel.run_tasks(0..part_count, part_count, |part| {
        let mut found = spare.take();
        found.clear();
        work(range(part), &mut found);
        waiting.lock().unwrap_or_else(PoisonError::into_inner).push((part, found));
        // No thread waits for the one that is joining. What that one misses is joined after a later part, or at the end.
        if let Ok(mut join_waiting) = join_waiting.try_lock() {
            join_waiting();
        }
    });
    join_waiting.into_inner().unwrap_or_else(PoisonError::into_inner)();
}

/// Like [`append_parts`], for consecutive chunks of `pairs`.
pub(super) fn append_chunks<T: Results>(
    pairs: &[[u32; 2]],
    threads: usize,
    spare: &Buffers<T>,
    results: &mut T,
    work: impl Fn(&[[u32; 2]], &mut T) + Sync,
    join: impl FnMut(&mut T, &mut T) + Send,
) {
    let work = |range: Range<usize>, found: &mut T| work(&pairs[range], found);
    append_parts(pairs.len(), CHUNK, &Threads(threads), spare, results, work, join);
}

/// Like [`append_parts`], for lists. Returns the sum of the return values of `work`.
pub(super) fn append_ranges<T: Send + 'static>(
    count: usize,
    chunk: usize,
    parallel: &impl Parallel,
    spare: &Buffers<Vec<T>>,
    results: &mut Vec<T>,
    work: impl Fn(Range<usize>, &mut Vec<T>) -> usize + Sync,
) -> usize {
    let sum = AtomicUsize::new(0);
    let work = |range: Range<usize>, found: &mut Vec<T>| {
        sum.fetch_add(work(range, found), Ordering::Relaxed);
    };
    append_parts(count, chunk, parallel, spare, results, work, Vec::append);
    sum.into_inner()
}

/// Calls `work` on consecutive chunks of `items`, each with the index of its first item and with the results of the
/// same items to write. The chunks are the same for any number of threads.
pub(super) fn fill_chunks<T: Sync, R: Send>(
    items: &[T],
    results: &mut [R],
    chunk: usize,
    threads: usize,
    work: impl Fn(usize, &[T], &mut [R]) + Sync,
) {
    let chunks = items.chunks(chunk).zip(results.chunks_mut(chunk)).enumerate();
    let count = items.len().div_ceil(chunk);
    run_tasks(chunks, count, threads, |(number, (items, results))| work(number * chunk, items, results));
}

/// Passes each of about `count` tasks to a free thread. With one thread or one task, does not use the pool and
/// allocates nothing.
fn run_tasks<P: Send>(tasks: impl Iterator<Item = P> + Send, count: usize, threads: usize, work: impl Fn(P) + Sync) {
    let threads = available_threads(threads).min(count);
    if threads <= 1 {
        return tasks.for_each(work);
    }
    hand_out(tasks, work, |take_tasks| on_threads(threads, take_tasks));
}

/// Calls `work` once on each of this many threads. Not generic: a task of the pool is much code, a fifth of this library
/// if there is one for each closure.
fn on_threads(threads: usize, work: &(dyn Fn() + Sync)) {
    ComputeTaskPool::get().scope(|scope| {
        for _ in 0..threads {
            scope.spawn(async { work() });
        }
    });
}

/// Calls `work` with every item and the number of threads that it may use: `threads`, or one. Items that weigh less
/// than two chunks are distributed among the threads as a whole. The others follow one by one, each on all threads.
/// Results must not depend on that. Does not use the pool if there is little to distribute.
pub(super) fn for_each_weighed<T: Send>(
    items: &mut [T],
    threads: usize,
    chunk: usize,
    weight: impl Fn(usize, &T) -> usize + Sync,
    work: impl Fn(usize, &mut T, usize) + Sync,
) {
    if available_threads(threads) <= 1 {
        return items.iter_mut().enumerate().for_each(|(place, item)| work(place, item, 1));
    }
    let is_light = |place: usize, item: &T| weight(place, item) < 2 * chunk;
    let weights = items.iter().enumerate().map(|(place, item)| (is_light(place, item), weight(place, item)));
    let to_share: usize = weights.filter(|(is_light, _)| *is_light).map(|(_, weight)| weight).sum();
    let light = items.iter_mut().enumerate().filter(|(place, item)| is_light(*place, item));
    run_tasks(light, to_share / chunk, threads, |(place, item)| work(place, item, 1));
    for (place, item) in items.iter_mut().enumerate().filter(|(place, item)| !is_light(*place, item)) {
        work(place, item, threads);
    }
}

/// Buffers that are kept from tick to tick, one for each thread that works at the same time.
pub(super) struct Buffers<T>(Mutex<Vec<T>>);

impl<T> Default for Buffers<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Default> Buffers<T> {
    /// Calls `work` with a buffer that no other thread uses at the same time.
    pub(super) fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let mut buffer = self.take();
        let result = work(&mut buffer);
        self.give(buffer);
        result
    }

    /// Frees all buffers, when there is nothing to do.
    pub(super) fn clear(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Vec::new();
    }

    fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn give(&self, buffer: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }
}
