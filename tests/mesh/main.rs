//! Surfaces from mesh assets in headless worlds: what they are made of, where they are, and what is written back.
//!
//! `cargo test --features mesh --test mesh`

mod deformed;
mod driven;
mod garments;
mod hierarchy;
mod joints;
mod layouts;
mod life_cycle;
mod normals;
mod world;
mod written;
