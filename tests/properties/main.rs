//! Properties that hold for any mesh, motion and size: the whole plugin and the kernel on what the strategies of
//! `strategies` make up.
//!
//! A default run tries the same cases everywhere, in some half a minute. `PROPTEST_CASES=2560 cargo test --test
//! properties` tries ten times as many others. A failing case is shrunk, printed, and kept in
//! `tests/proptest-regressions/`, which is tried first from then on: commit what was a real bug.

mod agreement;
mod harness;
mod invariance;
mod poses;
mod spheres;
mod strategies;
mod topology;
mod warmth;
