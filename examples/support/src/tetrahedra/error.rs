//! All errors of tetrahedral meshes, each with the file and the place.

use std::{
    io,
    path::{Path, PathBuf},
};

use thiserror::Error;

/// Why a tetrahedral mesh could not be read. Lines are counted from 1.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TetrahedralMeshError {
    /// The file is missing, or the system does not allow it to be read.
    #[error("{}: cannot be read: {source}", file.display())]
    Read {
        /// The file in question.
        file: PathBuf,
        /// The error from the system.
        source: io::Error,
    },
    /// The path names a folder, a pipe, or a device.
    #[error("{}: is not a regular file", file.display())]
    NotAFile {
        /// The path in question.
        file: PathBuf,
    },
    /// A line does not follow the format.
    #[error("{}: line {line}: {detail}", file.display())]
    Line {
        /// The file in question.
        file: PathBuf,
        /// The line in question.
        line: usize,
        /// What is wrong there.
        detail: String,
    },
    /// The file ends before everything that it announces.
    #[error("{}: ends early, at line {line}: {wanted} was expected", file.display())]
    EndsEarly {
        /// The file in question.
        file: PathBuf,
        /// The last line.
        line: usize,
        /// What is missing.
        wanted: String,
    },
    /// The format is not one of those that are read.
    #[error("{}: {detail}", file.display())]
    Unsupported {
        /// The file in question.
        file: PathBuf,
        /// What is not supported, and what to do.
        detail: String,
    },
    /// The file has no tetrahedron.
    #[error("{}: has no tetrahedra ({vertices} vertices, {elements} elements)", file.display())]
    NoTetrahedra {
        /// The file in question.
        file: PathBuf,
        /// Number of vertices.
        vertices: usize,
        /// Number of elements of all kinds.
        elements: usize,
    },
}

impl TetrahedralMeshError {
    pub(super) fn line(file: &Path, line: usize, detail: impl Into<String>) -> Self {
        Self::Line { file: file.to_path_buf(), line, detail: detail.into() }
    }

    pub(super) fn unsupported(file: &Path, detail: impl Into<String>) -> Self {
        Self::Unsupported { file: file.to_path_buf(), detail: detail.into() }
    }
}
