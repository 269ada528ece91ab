//! What the examples share: a headless app and its command-line options, and the physics scenes.

#![expect(missing_docs, clippy::missing_errors_doc, clippy::missing_panics_doc, reason = "not published")]

pub mod headless;
pub mod scenes;
