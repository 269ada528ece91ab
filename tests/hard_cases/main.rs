//! The hard cases of the design, each with every method and broad phase, against the f64 reference.

mod adjacency;
mod alignment;
mod degenerate;
mod harness;
mod life;
mod million;
mod penetration;
mod scale;
mod time;
