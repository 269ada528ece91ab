//! Properties that hold for any mesh, motion and size: the whole plugin and the kernel on what the strategies of
//! `circumsphere_support` make up.
//!
//! A default run tries the same cases everywhere, in some half a minute. `PROPTEST_CASES=2000 cargo test --release --test
//! properties` tries that many others for each property. A failing case is shrunk, printed, and kept in
//! `tests/proptest-regressions/`, which is tried first from then on: commit what was a real bug.

mod agreement;
mod harness;
mod invariance;
mod poses;
mod spheres;
mod topology;
mod warmth;
