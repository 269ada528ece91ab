//! The reference against parry in f64, exact integers, closed forms, and published counts.

mod common;
mod exact_impact;
mod impact;
mod mesh_pairs;
mod recordings;
mod triangle_pairs;
