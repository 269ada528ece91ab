//! Queries of surfaces and shapes, against brute force in f64 and against parry.

mod casts;
mod closest;
mod cost;
mod life;
mod overlaps;
mod peers;
mod rays;
mod solids;
mod truth;
mod world;
