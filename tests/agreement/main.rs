//! The whole pipeline against the f64 reference: the same touching pairs with every exact method and broad phase.

mod detect;
mod recordings;
mod scenes;
