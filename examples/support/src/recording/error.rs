//! All errors of recordings, each with the file and the place.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a recording could not be read or written.
///
/// Frames, vertices, triangles, and faces are counted from 0. A face is a polygon of the file before it is split into
/// triangles. Lines are counted from 1.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The list of files is empty.
    #[error("no file is given: name one .bin recording or the PLY or OBJ files of its frames")]
    NoFiles,
    /// The file is missing, or the system does not allow it to be read.
    #[error("{}: cannot be read: {source}", file.display())]
    Read {
        /// The file in question.
        file: PathBuf,
        /// The error from the system.
        source: io::Error,
    },
    /// The file cannot be created or written.
    #[error("{}: cannot be written: {source}", file.display())]
    Write {
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
    /// The file has no bytes.
    #[error("{}: is empty", file.display())]
    Empty {
        /// The file in question.
        file: PathBuf,
    },
    /// A `.bin` file does not begin with the expected magic.
    #[error(
        "{}: begins with {found:#010x} instead of {expected:#010x}, the magic of such a recording: it is of another kind \
         or damaged", file.display()
    )]
    WrongMagic {
        /// The file in question.
        file: PathBuf,
        /// The first four bytes, little-endian.
        found: u32,
        /// The magic of the expected format.
        expected: u32,
    },
    /// A `.bin` file is shorter than its header says, or shorter than a header.
    #[error("{}: is truncated: {found} bytes where the header needs {expected}", file.display())]
    Truncated {
        /// The file in question.
        file: PathBuf,
        /// Bytes that the header implies; the length of a header if even that is incomplete.
        expected: u128,
        /// Bytes in the file.
        found: u64,
    },
    /// The file continues after the last element that its header announces.
    #[error("{}: has {found} bytes where its header accounts for {expected}", file.display())]
    TrailingBytes {
        /// The file in question.
        file: PathBuf,
        /// Bytes that the header implies.
        expected: u128,
        /// Bytes in the file.
        found: u64,
    },
    /// A PLY header announces more elements than a file of this size can hold.
    #[error(
        "{}: the header announces {count} elements `{element}`, which {bytes} bytes cannot hold", file.display()
    )]
    TooManyElements {
        /// The file in question.
        file: PathBuf,
        /// Name of the element.
        element: String,
        /// The number that the header announces.
        count: u64,
        /// Bytes after the header.
        bytes: u64,
    },
    /// A PLY file ends before everything that its header announces.
    #[error("{}: ends early: {detail}", file.display())]
    EndsEarly {
        /// The file in question.
        file: PathBuf,
        /// Where it ends.
        detail: String,
    },
    /// A PLY or OBJ file does not follow its format.
    #[error("{}: is not valid {format}: {detail}", file.display())]
    Malformed {
        /// The file in question.
        file: PathBuf,
        /// `PLY` or `OBJ`.
        format: &'static str,
        /// What is wrong, with the line if it is known.
        detail: String,
    },
    /// A PLY file lacks the element `vertex` or `face`.
    #[error("{}: has no element `{element}`", file.display())]
    MissingElement {
        /// The file in question.
        file: PathBuf,
        /// The required element.
        element: &'static str,
    },
    /// A PLY element lacks a property, or has it with an unsuitable type.
    #[error("{}: the element `{element}` has no {property}", file.display())]
    MissingProperty {
        /// The file in question.
        file: PathBuf,
        /// The element.
        element: &'static str,
        /// The required property, with its type.
        property: &'static str,
    },
    /// The recording has no frame.
    #[error("{}: has no frames", file.display())]
    NoFrames {
        /// The file in question.
        file: PathBuf,
    },
    /// The mesh has no vertices or no faces.
    #[error("{}: has no triangles ({vertices} vertices, {faces} faces)", file.display())]
    NoTriangles {
        /// The file in question.
        file: PathBuf,
        /// Number of vertices.
        vertices: u64,
        /// Number of faces.
        faces: u64,
    },
    /// A face has fewer than three corners.
    #[error("{}: face {face} has {corners} corners and needs at least 3", file.display())]
    TooFewCorners {
        /// The file in question.
        file: PathBuf,
        /// The face in question.
        face: usize,
        /// Number of its corners.
        corners: usize,
    },
    /// A face has a vertex index that does not exist.
    #[error("{}: face {face} names vertex {index}, but there are {vertices} vertices", file.display())]
    IndexOutOfRange {
        /// The file in question.
        file: PathBuf,
        /// The face in question.
        face: usize,
        /// The index as in the file (OBJ counts from 1, and from the end if negative).
        index: i64,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is NaN, infinite, or too large for `f32`. (An ASCII PLY file cannot represent the first two. There
    /// the words are [`RecordingError::Malformed`].)
    #[error("{}: frame {frame} vertex {vertex} has a coordinate that is not finite", file.display())]
    NotFinite {
        /// The file in question.
        file: PathBuf,
        /// The frame in question.
        frame: usize,
        /// The vertex in question.
        vertex: usize,
    },
    /// A number in a file of queries has an invalid value.
    #[error("{}: the value at byte {byte} is {found}, but must be {expected}", file.display())]
    UnknownValue {
        /// The file in question.
        file: PathBuf,
        /// Place of the value's first byte, counted from 0.
        byte: usize,
        /// The value.
        found: u32,
        /// The valid values.
        expected: &'static str,
    },
    /// A coordinate of a query is NaN or infinite.
    #[error("{}: query {query} has a coordinate that is not finite, at byte {byte}", file.display())]
    QueryNotFinite {
        /// The file in question.
        file: PathBuf,
        /// The query in question.
        query: usize,
        /// Place of the coordinate's first byte, counted from 0.
        byte: usize,
    },
    /// A frame has more or fewer vertices than the first frame.
    #[error(
        "{}: frame {frame} has {found} vertices where the first frame ({}) has {expected}",
        file.display(), first.display()
    )]
    VertexCountDiffers {
        /// The file in question.
        file: PathBuf,
        /// The frame in question.
        frame: usize,
        /// Number of its vertices.
        found: usize,
        /// Number of vertices of the first frame.
        expected: usize,
        /// The file of the first frame.
        first: PathBuf,
    },
    /// The triangles of a frame differ from those of the first frame.
    #[error(
        "{}: frame {frame} differs from the first frame ({}) from triangle {triangle} on",
        file.display(), first.display()
    )]
    TrianglesDiffer {
        /// The file in question.
        file: PathBuf,
        /// The frame in question.
        frame: usize,
        /// The first triangle that differs.
        triangle: usize,
        /// The file of the first frame.
        first: PathBuf,
    },
    /// More than one `.bin` recording is given.
    #[error("{}: is one of {count} .bin recordings, but only one can be read at a time", file.display())]
    SeveralRecordings {
        /// The first of them.
        file: PathBuf,
        /// Number of recordings given.
        count: usize,
    },
    /// A `.bin` recording is given together with PLY or OBJ files.
    #[error("{}: is a .bin recording and cannot be a frame beside other files", file.display())]
    MixedFormats {
        /// The first `.bin` recording.
        file: PathBuf,
    },
    /// A recording to be written has more vertices, triangles, or frames than the format can count.
    #[error("{}: {count} {what} do not fit a .bin recording, which counts up to 4294967295", file.display())]
    TooLarge {
        /// The file in question.
        file: PathBuf,
        /// `vertices`, `triangles`, or `frames`.
        what: &'static str,
        /// The number of them.
        count: usize,
    },
}

impl RecordingError {
    pub(super) fn read(file: &Path, source: io::Error) -> Self {
        Self::Read { file: file.to_path_buf(), source }
    }

    pub(super) fn malformed(file: &Path, format: &'static str, detail: String) -> Self {
        Self::Malformed { file: file.to_path_buf(), format, detail }
    }
}
