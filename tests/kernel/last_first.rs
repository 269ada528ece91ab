//! Tasks of the kernel in the order that nobody expects.

use bevy_circumsphere::kernel::simd::share::Share;

/// Hands out tasks from the last to the first: nothing may depend on which is done when.
pub struct LastFirst;

impl Share for LastFirst {
    fn hand_out<P: Send>(&self, tasks: impl Iterator<Item = P> + Send, _: usize, work: impl Fn(P) + Sync) {
        let mut tasks: Vec<P> = tasks.collect();
        while let Some(task) = tasks.pop() {
            work(task);
        }
    }
}
