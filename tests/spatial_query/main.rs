//! Queries of surfaces and shapes, against brute force in f64 and against parry.

mod rays;
mod truth;
mod world;
