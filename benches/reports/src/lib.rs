//! Code that all reports share: a description of the machine, statistics, tables, figures,
//! findings, and curves that are compared.

#![expect(missing_docs, clippy::missing_errors_doc, reason = "not published")]

use std::path::PathBuf;

pub mod bounded;
pub mod cloth_scenes;
pub mod cloth_truth;
pub mod drawing;
pub mod finding;
pub mod machine;
pub mod statistics;
pub mod tables;

pub use circumsphere_examples::headless::BAD_INPUT;

/// A report file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    #[error("cannot write {}: {source}", .path.display())]
    File { path: PathBuf, source: std::io::Error },
    #[error("cannot write {}: {source}", .path.display())]
    Csv { path: PathBuf, source: csv::Error },
    #[error("cannot draw {}: {reason}", .path.display())]
    Figure { path: PathBuf, reason: String },
}
