//! What the Rerun debug layer records, read back from the chunks and compared value by value with the recorded world.
//!
//! `cargo test --features rerun --test rerun`

mod budget;
mod cells;
mod contacts;
mod layout;
mod meshes;
mod neutrality;
mod pairs;
mod patches;
mod recording;
mod repeats;
mod series;
mod settings;
mod sinks;
mod tetrahedra;
mod text_log;
mod timelines;
mod triangles;
mod world;
