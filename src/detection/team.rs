//! A team of threads for many jobs, one after the other. Most of them take microseconds.
//!
//! A task of Bevy's pool costs as much as such a job. So the threads are taken from the pool once, wait actively for one
//! job after the other, and are given back at the end: until then, the pool is without them. The caller never waits for a
//! thread that has not begun: if the pool is busy, it does all of the work itself.

#![expect(unsafe_code, reason = "a job is borrowed for shorter than its threads live")]

use std::{
    cell::UnsafeCell,
    hint,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering},
    thread,
};

use bevy_tasks::ComputeTaskPool;

use super::parallel::Threads;
use crate::kernel::simd::parallel::{MOST_IN_TEAM, Sequential, Team};

/// Looks for the next job before other threads get the processor.
const PATIENCE: u32 = 2_000;

/// Bit of the parts that are left which says that there will be none.
const OVER: u32 = 1 << 31;

type Work<'a> = dyn Fn(usize) + Sync + 'a;

struct SpinningTeam {
    size: usize,
    /// The parts of the job that are left to begin, one bit each.
    left: AtomicU32,
    /// The number of parts that others than the leader have finished.
    finished: AtomicUsize,
    /// Whether one of them has panicked.
    is_broken: AtomicBool,
    /// The job. Written by the leader while no part of a job is left.
    work: UnsafeCell<Option<*const Work<'static>>>,
}

// SAFETY: `work` is written by the leader only, while no part is left or unfinished, and read by those only who have
// begun a part, which the leader waits for before it writes again. The job may be called from any thread.
unsafe impl Sync for SpinningTeam {}

/// Counts a part as finished, even if it panics. Otherwise the leader would wait forever.
struct Part<'a>(&'a SpinningTeam);

impl Drop for Part<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.is_broken.store(true, Ordering::Relaxed);
        }
        self.0.finished.fetch_add(1, Ordering::Release);
    }
}

/// Waits until others have finished their parts of a job.
struct Wait<'a> {
    team: &'a SpinningTeam,
    /// How many those are.
    parts: usize,
}

impl Drop for Wait<'_> {
    fn drop(&mut self) {
        // Parts are only left if the leader has panicked.
        self.parts -= (1..self.team.size).filter(|&part| self.team.begin(part)).count();
        let mut waited = 0;
        while self.team.finished.load(Ordering::Acquire) < self.parts {
            rest(&mut waited);
        }
    }
}

fn rest(waited: &mut u32) {
    *waited += 1;
    if *waited < PATIENCE {
        hint::spin_loop();
    } else {
        thread::yield_now();
    }
}

impl SpinningTeam {
    const fn new(size: usize) -> Self {
        Self {
            size,
            left: AtomicU32::new(0),
            finished: AtomicUsize::new(0),
            is_broken: AtomicBool::new(false),
            work: UnsafeCell::new(None),
        }
    }

    /// Begins a part of the job. Returns `false` if it is not left.
    fn begin(&self, part: usize) -> bool {
        let bit = 1 << part;
        self.left.load(Ordering::Acquire) & bit != 0 && self.left.fetch_and(!bit, Ordering::AcqRel) & bit != 0
    }

    /// Does one part of all jobs until the team is dismissed.
    fn help(&self, part: usize) {
        let mut waited = 0;
        while self.left.load(Ordering::Acquire) & OVER == 0 {
            if !self.begin(part) {
                rest(&mut waited);
                continue;
            }
            waited = 0;
            let _finished = Part(self);
            // SAFETY: this part is not finished, so the leader waits, and the job is not changed and still borrowed.
            if let Some(work) = unsafe { (*self.work.get()).map(|work| &*work) } {
                work(part);
            }
        }
    }
}

impl Team for SpinningTeam {
    fn size(&self) -> usize {
        self.size
    }

    fn run(&self, work: &Work<'_>) {
        #[expect(clippy::transmute_ptr_to_ptr, reason = "a cast cannot change the lifetime of a trait object")]
        // SAFETY: only the lifetime changes. All parts are finished before this call returns or unwinds, and the job is
        // read only to do a part of it.
        let shared = unsafe { std::mem::transmute::<*const Work<'_>, *const Work<'static>>(work) };
        // SAFETY: all parts of the last job are finished, so no other thread reads this.
        unsafe { *self.work.get() = Some(shared) };
        self.finished.store(0, Ordering::Relaxed);
        self.left.store((1 << self.size) - 2, Ordering::Release);
        let mut wait = Wait { team: self, parts: self.size - 1 };
        work(0);
        for part in 1..self.size {
            if self.begin(part) {
                wait.parts -= 1;
                work(part);
            }
        }
        drop(wait);
        // What is missing in the results must not be used.
        assert!(!self.is_broken.load(Ordering::Relaxed), "another thread of the team has panicked");
    }
}

impl Threads {
    /// Calls `work` with as many threads as are allowed and pay off for jobs of microseconds. Nothing in it may wait for
    /// tasks of the pool: the calling thread could take up a part of this team meanwhile, which ends only with the team.
    pub(crate) fn with_team(self, work: &mut dyn FnMut(&dyn Team)) {
        let size = self.most().min(MOST_IN_TEAM);
        if size <= 1 {
            return work(&Sequential);
        }
        let team = SpinningTeam::new(size);
        let mut result = Ok(());
        ComputeTaskPool::get().scope(|scope| {
            for part in 1..size {
                let team = &team;
                scope.spawn(async move { team.help(part) });
            }
            result = catch_unwind(AssertUnwindSafe(|| work(&team)));
            team.left.store(OVER, Ordering::Release);
        });
        if let Err(panic) = result {
            resume_unwind(panic);
        }
    }
}

#[cfg(all(test, feature = "parallel"))]
mod tests {
    use std::sync::{Mutex, atomic::AtomicU64};

    use bevy_tasks::TaskPoolBuilder;

    use super::*;
    use crate::kernel::simd::parallel::share;

    fn pool() {
        ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(3).build());
    }

    #[test]
    fn every_item_of_every_job_is_worked_on_once_before_the_next_job_begins() {
        pool();
        for threads in [1, 2, 4] {
            let mut items = vec![0_u64; 10];
            let seen = Mutex::new(Vec::new());
            Threads(threads).with_team(&mut |team| {
                assert_eq!(team.size(), threads);
                for job in 0..20_000 {
                    share(team, &mut items, |item| {
                        assert_eq!(*item, job);
                        *item += 1;
                    });
                }
                team.run(&|part| seen.lock().expect("no call panics").push(part));
            });
            assert_eq!(items, [20_000; 10]);
            let mut seen = seen.into_inner().expect("no call panics");
            seen.sort_unstable();
            assert_eq!(seen, (0..threads).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_caller_does_what_nobody_helps_with() {
        let team = SpinningTeam::new(4);
        let done = AtomicU64::new(0);
        for _ in 0..100 {
            team.run(&|part| {
                done.fetch_add(1 << (8 * part), Ordering::Relaxed);
            });
        }
        assert_eq!(done.into_inner(), 0x6464_6464);
    }

    #[test]
    fn a_panic_in_any_part_reaches_the_caller_and_ends_the_team() {
        pool();
        for bad in 0..4 {
            let caught = catch_unwind(|| {
                Threads(4).with_team(&mut |team| {
                    for job in 0..100 {
                        team.run(&|part| assert!(job < 50 || part != bad, "part {bad}"));
                    }
                });
            });
            assert!(caught.is_err(), "{bad}");
        }
    }
}
