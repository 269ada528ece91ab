//! The internal constraints of a body: XPBD constraints, each on a few particles or, for the volume, on all of them.
//!
//! For a constraint `C` with compliance `α` in a substep `h`, `Δλ = (−C − α̃ λ) / (Σ w |∇C|² + α̃)` with `α̃ = α / h²`,
//! and every particle moves by `w ∇C Δλ` (Macklin, Müller and Chentanez 2016, "XPBD"). The functions are pure over
//! particles. The solver calls them in one fixed order.

mod bend;
mod stretch;
mod volume;

pub use bend::Hinge;
pub use stretch::Spring;
pub use volume::{enclosed_volume, solve_volume};

#[cfg(test)]
mod tests;
