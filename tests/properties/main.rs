//! Properties that hold for any mesh, motion, and size: the whole plugin and the kernel on the generated cases of
//! `strategies`.
//!
//! By default, the same cases run everywhere, in about half a minute. `PROPTEST_CASES=2560 cargo test --test
//! properties` runs ten times as many different cases. A failing case is shrunk, printed, and stored in
//! `tests/proptest-regressions/`, whose cases always run first. Commit it if it was a real bug.

mod agreement;
mod harness;
mod invariance;
mod poses;
mod spheres;
mod strategies;
mod topology;
mod warmth;
