//! How functions of the kernel hand out tasks that do not depend on each other.
//!
//! The kernel knows of no threads: whoever calls it says where its tasks run. What comes of them is the same anywhere.

/// Triangles of one task, where what is made of each is independent of the others.
pub(in crate::kernel) const PART: usize = 2048;

/// Fewer triangles than these are not worth another thread.
pub(in crate::kernel) const LEAST_SHARE: usize = 8192;

/// Runs tasks, all of them before it returns, in any order and on any thread.
pub trait Share {
    /// Calls `work` with each of some tasks, about `count`.
    fn hand_out<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, count: usize, work: impl Fn(P) + Sync);
}

/// One task after the other, on the thread of the caller.
#[derive(Clone, Copy, Debug)]
pub struct OneByOne;

impl Share for OneByOne {
    fn hand_out<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        tasks.for_each(work);
    }
}

/// For tests of what threads share: every second task is done by a thread of its own, and either thread begins with its last.
#[cfg(test)]
pub(crate) struct OnTwoThreads;

#[cfg(test)]
impl Share for OnTwoThreads {
    fn hand_out<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        let (even, odd): (Vec<_>, Vec<_>) = tasks.enumerate().partition(|(number, _)| number % 2 == 0);
        std::thread::scope(|scope| {
            scope.spawn(|| even.into_iter().rev().for_each(|(_, task)| work(task)));
            odd.into_iter().rev().for_each(|(_, task)| work(task));
        });
    }
}
