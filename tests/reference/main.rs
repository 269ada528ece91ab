//! The reference against parry in f64, exact integers, closed forms and published counts.

mod common;
mod mesh_pairs;
mod recordings;
mod triangle_pairs;
