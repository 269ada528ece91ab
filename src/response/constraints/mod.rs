//! What holds a body together: constraints of extended position-based dynamics, each on a handful of particles.
//!
//! For a constraint `C` with compliance `α` in a step `h`, `Δλ = (−C − α̃ λ) / (Σ w |∇C|² + α̃)` with `α̃ = α / h²`, and
//! every particle moves by `w ∇C Δλ` (Macklin, Müller and Chentanez 2016, "XPBD"). Pure functions over particles: they
//! are called by the solver, in one fixed order.

mod bend;
mod stretch;
mod volume;

pub use bend::Hinge;
pub use stretch::Spring;
pub use volume::{enclosed_volume, solve_volume};

#[cfg(test)]
mod tests;
