//! Tasks of the kernel in the order that nobody expects.

use bevy_circumsphere::kernel::simd::parallel::Parallel;

/// Hands out tasks from the last to the first: nothing may depend on which is done when.
pub struct LastFirst;

impl Parallel for LastFirst {
    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        let mut tasks: Vec<P> = tasks.collect();
        while let Some(task) = tasks.pop() {
            work(task);
        }
    }
}
