//! Runs kernel tasks in an unexpected order.

use bevy_circumsphere::kernel::simd::parallel::Parallel;

/// Runs tasks from the last to the first. Results must not depend on the order.
pub struct LastFirst;

impl Parallel for LastFirst {
    fn run_tasks<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        let mut tasks: Vec<P> = tasks.collect();
        while let Some(task) = tasks.pop() {
            work(task);
        }
    }
}
