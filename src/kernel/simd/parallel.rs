//! How kernel functions hand out tasks that do not depend on each other.
//!
//! The kernel knows nothing about threads: the caller decides where tasks run. The result is the same anywhere.

use std::sync::{Mutex, PoisonError};

use arrayvec::ArrayVec;

/// Triangles per task, where triangles are processed independently of each other.
pub(in crate::kernel) const PART: usize = 2048;

/// With fewer triangles than this another thread does not pay off.
pub(in crate::kernel) const LEAST_SHARE: usize = 8192;

/// Runs tasks in any order on any thread. All of them finish before the call returns.
pub trait Parallel {
    /// The largest number of threads that may work at the same time, the calling one included. By default, any number.
    fn threads(&self) -> usize {
        usize::MAX
    }

    /// Calls `work` with every task. More than `count` threads do not pay off if they have to be woken for it.
    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, count: usize, work: impl Fn(P) + Sync);
}

/// The most threads in a [`Team`]. Jobs of microseconds do not gain from more, and others need threads, too.
pub const MOST_IN_TEAM: usize = 8;

/// Threads that do many short jobs together, one after the other.
pub trait Team: Sync {
    /// The number of threads, from 1 to [`MOST_IN_TEAM`], the calling one included.
    fn size(&self) -> usize;

    /// Calls `work` once with every number below [`size`](Self::size), each on a thread of its own if one is free. A
    /// thread has the same number in every job, so what it works on stays in its cache. All calls return before this one
    /// does.
    fn run(&self, work: &(dyn Fn(usize) + Sync));
}

impl Team for Sequential {
    fn size(&self) -> usize {
        1
    }

    fn run(&self, work: &(dyn Fn(usize) + Sync)) {
        work(0);
    }
}

/// Calls `work` with every item.
pub fn share<T: Send>(team: &dyn Team, items: &mut [T], work: impl Fn(&mut T) + Sync) {
    share_all(team, [items], work);
}

/// Calls `work` with every item of several lists. Each thread has its share of each of them.
pub fn share_all<T: Send, const N: usize>(team: &dyn Team, lists: [&mut [T]; N], work: impl Fn(&mut T) + Sync) {
    let size = lists.iter().map(|items| items.len()).fold(0, usize::max).min(team.size());
    if size <= 1 {
        return lists.into_iter().flatten().for_each(work);
    }
    let counts = lists.each_ref().map(|items| items.len());
    let mut rest = lists;
    let parts: ArrayVec<Mutex<[&mut [T]; N]>, MOST_IN_TEAM> = (0..size)
        .map(|part| {
            let mut list = 0;
            Mutex::new(rest.each_mut().map(|items| {
                let length = (part + 1) * counts[list] / size - part * counts[list] / size;
                list += 1;
                items.split_off_mut(..length).unwrap_or_default()
            }))
        })
        .collect();
    team.run(&|part| {
        if let Some(own) = parts.get(part) {
            let mut own = own.lock().unwrap_or_else(PoisonError::into_inner);
            own.iter_mut().flat_map(|items| items.iter_mut()).for_each(&work);
        }
    });
}

/// Hands out tasks one after the other. `run` calls the closure that it gets on each thread; each call takes tasks until
/// none is left.
pub(crate) fn hand_out<P: Send>(
    tasks: impl Iterator<Item = P> + Send,
    work: impl Fn(P) + Sync,
    run: impl FnOnce(&(dyn Fn() + Sync)),
) {
    let tasks = Mutex::new(tasks);
    let next = || tasks.lock().unwrap_or_else(PoisonError::into_inner).next();
    run(&|| {
        while let Some(task) = next() {
            work(task);
        }
    });
}

/// The threads of a team take one task after the other. They need not be woken, so all of them pay off.
impl Parallel for &(dyn Team + '_) {
    fn threads(&self) -> usize {
        self.size()
    }

    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        if self.size() <= 1 || tasks.size_hint().1.is_some_and(|most| most <= 1) {
            return tasks.for_each(work);
        }
        hand_out(tasks, work, |take_tasks| self.run(&|_| take_tasks()));
    }
}

/// Runs one task after the other on the calling thread.
#[derive(Clone, Copy, Debug)]
pub struct Sequential;

impl Parallel for Sequential {
    fn threads(&self) -> usize {
        1
    }

    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        tasks.for_each(work);
    }
}

/// For tests of thread independence. Runs every second task on another thread, and each thread starts with its last
/// task.
#[cfg(test)]
pub(crate) struct OnTwoThreads;

#[cfg(test)]
impl Parallel for OnTwoThreads {
    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        let (even, odd): (Vec<_>, Vec<_>) = tasks.enumerate().partition(|(number, _)| number % 2 == 0);
        std::thread::scope(|scope| {
            scope.spawn(|| even.into_iter().rev().for_each(|(_, task)| work(task)));
            odd.into_iter().rev().for_each(|(_, task)| work(task));
        });
    }
}
