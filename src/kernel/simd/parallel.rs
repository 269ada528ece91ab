//! How kernel functions hand out tasks that do not depend on each other.
//!
//! The kernel knows nothing about threads: the caller decides where tasks run. The result is the same anywhere.

/// Triangles per task, where triangles are processed independently of each other.
pub(in crate::kernel) const PART: usize = 2048;

/// With fewer triangles than this another thread does not pay off.
pub(in crate::kernel) const LEAST_SHARE: usize = 8192;

/// Runs tasks in any order on any thread. All of them finish before the call returns.
pub trait Parallel {
    /// Calls `work` with every task. More than `count` threads do not pay off.
    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, count: usize, work: impl Fn(P) + Sync);
}

/// Runs one task after the other on the calling thread.
#[derive(Clone, Copy, Debug)]
pub struct Sequential;

impl Parallel for Sequential {
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
