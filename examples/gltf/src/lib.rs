//! An animated character from a glTF file in a headless game: Bevy loads and animates it, its meshes are surfaces, and
//! one of them is a garment.

#![expect(clippy::missing_panics_doc, reason = "not published")]

mod app;
mod buffer;
pub mod file;
mod person;

pub use app::{Cast, Shot, character_app, load, shoot};
pub use person::person_file;
