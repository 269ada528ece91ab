//! Recorded meshes: one list of triangles, and a list of vertex positions per frame.
//!
//! A recording is either one `.bin` file or a list of PLY and OBJ files, one per frame of the same mesh. Every file is
//! treated as untrusted: its header is compared with the size of the file before memory is reserved for it, and every
//! error is returned as a [`RecordingError`] that names the file and the place.
//!
//! The `.bin` layout is little-endian: four `u32` (magic, vertices, faces, frames), three `u32` per face, then three
//! coordinates per vertex for every frame. Coordinates are `f32` under [`MAGIC`] and `f64` under [`MAGIC_F64`]. This
//! module also reads files of queries for continuous collision detection, see [`CcdQueries`] and [`RecordedImpacts`].

mod binary;
mod error;
mod obj;
mod ply;
mod queries;

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

pub use error::RecordingError;
pub use queries::{
    CcdQueries, CcdQuery, ImpactAnswer, MAGIC_QUERIES, MAGIC_TRUTH, QueryKind, RecordedImpacts, read_ccd_queries,
    read_recorded_impacts,
};

/// First four bytes of a `.bin` recording with `f32` coordinates, read as a little-endian `u32`.
pub const MAGIC: u32 = 0x4D53_4851;

/// First four bytes of a `.f64.bin` recording with `f64` coordinates, read as a little-endian `u32`.
pub const MAGIC_F64: u32 = 0x4D53_4844;

/// The environment variable with the folder of recordings, see [`recordings_folder`].
pub const FOLDER_VARIABLE: &str = "CIRCUMSPHERE_DATA";

/// A mesh of constant topology with the vertex positions of one or more frames.
///
/// The readers of this module guarantee at least one frame and one triangle, the same number of finite positions in
/// every frame, and no index out of range. Triangles may still be degenerate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Three vertex indices per triangle, in the order of the file.
    pub triangles: Vec<[u32; 3]>,
    /// `frames[frame][vertex]`, in the units of the file.
    pub frames: Vec<Vec<[f32; 3]>>,
}

/// A [`Recording`] in the double precision of its source, with the same guarantees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecordingF64 {
    /// Three vertex indices per triangle, in the order of the file.
    pub triangles: Vec<[u32; 3]>,
    /// `frames[frame][vertex]`, in the units of the file.
    pub frames: Vec<Vec<[f64; 3]>>,
}

impl Recording {
    /// Reads one `.bin` recording from bytes, for example an embedded one.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not a valid recording, see [`RecordingError`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, RecordingError> {
        let (triangles, frames) = binary::decode::<f32>(bytes, name)?;
        Ok(Self { triangles, frames })
    }

    /// Writes the `.bin` recording that [`Recording::from_bytes`] reads, as bytes.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the recording violates the guarantees of its type (no frame, no triangle, frames of different lengths, an
    /// index out of range, a coordinate that is not finite), or if a count does not fit into a `u32`.
    pub fn to_bytes(&self, name: &Path) -> Result<Vec<u8>, RecordingError> {
        binary::encode(&self.triangles, &self.frames, name)
    }

    /// Reads one PLY file in memory as a recording of one frame.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not a valid PLY mesh, see [`RecordingError`].
    pub fn from_ply_bytes(bytes: &[u8], name: &Path) -> Result<Self, RecordingError> {
        Self::from_polygons(ply::decode(bytes, name, 0)?)
    }

    /// Reads one OBJ file in memory as a recording of one frame.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not a valid OBJ mesh, see [`RecordingError`].
    pub fn from_obj_bytes(bytes: &[u8], name: &Path) -> Result<Self, RecordingError> {
        Self::from_polygons(obj::decode(bytes, name, 0)?)
    }

    fn from_polygons(mesh: PolygonMesh) -> Result<Self, RecordingError> {
        Ok(Self { triangles: mesh.triangles, frames: vec![mesh.positions] })
    }
}

impl RecordingF64 {
    /// Reads one `.f64.bin` recording from bytes.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not a valid recording, see [`RecordingError`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, RecordingError> {
        let (triangles, frames) = binary::decode::<f64>(bytes, name)?;
        Ok(Self { triangles, frames })
    }
}

/// Reads one `.bin` recording, or PLY and OBJ files that are the frames of one mesh in the given order.
///
/// The content determines the format: a first line `ply`, or the magic of a recording. If it does not, the extension
/// decides, and everything else is read as OBJ. Polygons become triangle fans around their first corner. Vertices keep
/// the order and the numbers of the file, including those that no face uses.
///
/// # Errors
///
/// If there is no file, if a file cannot be read or is malformed, if a `.bin` recording is given with other files, or
/// if the vertex count or the triangles of a frame differ from those of the first. See [`RecordingError`].
pub fn read_recording(paths: &[PathBuf]) -> Result<Recording, RecordingError> {
    let formats = paths.iter().map(|path| sniff(path)).collect::<Result<Vec<_>, _>>()?;
    if let ([path], [Format::Binary]) = (paths, formats.as_slice()) {
        let bytes = binary::read_recording::<f32>(path)?;
        return Recording::from_bytes(&bytes, path);
    }
    if let Some(position) = formats.iter().position(|format| *format == Format::Binary) {
        let file = paths[position].clone();
        return Err(if formats.iter().all(|format| *format == Format::Binary) {
            RecordingError::SeveralRecordings { file, count: paths.len() }
        } else {
            RecordingError::MixedFormats { file }
        });
    }

    let mut recording = Recording::default();
    let mut first_file = None;
    for (frame, (path, format)) in paths.iter().zip(formats).enumerate() {
        let bytes = fs::read(path).map_err(|source| RecordingError::read(path, source))?;
        let mesh = match format {
            Format::Ply => ply::decode(&bytes, path, frame)?,
            Format::Obj | Format::Binary => obj::decode(&bytes, path, frame)?,
        };
        match first_file {
            None => {
                first_file = Some(path);
                recording.triangles = mesh.triangles;
            }
            Some(first) => matches_first(&recording, first, &mesh, path, frame)?,
        }
        recording.frames.push(mesh.positions);
    }
    if recording.frames.is_empty() {
        return Err(RecordingError::NoFiles);
    }
    Ok(recording)
}

/// Reads one `.f64.bin` recording.
///
/// # Errors
///
/// If the file cannot be read or is malformed, see [`RecordingError`].
pub fn read_f64_recording(path: &Path) -> Result<RecordingF64, RecordingError> {
    RecordingF64::from_bytes(&binary::read_recording::<f64>(path)?, path)
}

/// Writes `recording` as one `.bin` file. An existing file is replaced.
///
/// # Errors
///
/// If [`Recording::to_bytes`] fails, in which case the file is not touched, or if the file cannot be written.
pub fn write_recording(path: &Path, recording: &Recording) -> Result<(), RecordingError> {
    let bytes = recording.to_bytes(path)?;
    fs::write(path, bytes).map_err(|source| RecordingError::Write { file: path.to_path_buf(), source })
}

/// The folder of recordings that the environment names, for tests that can run without it.
///
/// If the variable [`FOLDER_VARIABLE`] is not set, this returns `None` and prints to standard error that recordings are
/// skipped, so that a run without recordings cannot be mistaken for one with them.
pub fn recordings_folder() -> Option<PathBuf> {
    let folder = std::env::var_os(FOLDER_VARIABLE).filter(|value| !value.is_empty());
    if folder.is_none() {
        eprintln!("recordings are skipped because {FOLDER_VARIABLE} is not set");
    }
    folder.map(PathBuf::from)
}

/// One frame of a PLY or OBJ file, with its polygons split into triangles.
struct PolygonMesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// Appends the triangle fan around the first of at least three `corners`.
fn push_fan(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    for edge in corners.windows(2).skip(1) {
        triangles.push([corners[0], edge[0], edge[1]]);
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Binary,
    Ply,
    Obj,
}

/// Detects the format of a file from its first four bytes, then from its extension.
fn sniff(path: &Path) -> Result<Format, RecordingError> {
    let (file, _) = open(path)?;
    let mut start = Vec::with_capacity(4);
    file.take(4).read_to_end(&mut start).map_err(|source| RecordingError::read(path, source))?;
    let is_binary = start
        .first_chunk()
        .map(|magic| u32::from_le_bytes(*magic))
        .is_some_and(|magic| magic == MAGIC || magic == MAGIC_F64);
    let is_ply = matches!(start.as_slice(), [b'p', b'l', b'y', b'\n' | b'\r']);
    let has_extension = |extension: &str| {
        path.extension().and_then(OsStr::to_str).is_some_and(|found| found.eq_ignore_ascii_case(extension))
    };
    Ok(if is_binary {
        Format::Binary
    } else if is_ply {
        Format::Ply
    } else if has_extension("bin") {
        Format::Binary
    } else if has_extension("ply") {
        Format::Ply
    } else {
        Format::Obj
    })
}

/// Opens a regular, non-empty file. The second value is its size in bytes.
///
/// Folders and devices are refused, because reading a device may never end.
fn open(path: &Path) -> Result<(File, u64), RecordingError> {
    let failed = |source: io::Error| RecordingError::read(path, source);
    // Checked before opening, because opening a named pipe would wait for a writer.
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        return Err(RecordingError::NotAFile { file: path.to_path_buf() });
    }
    if metadata.len() == 0 {
        return Err(RecordingError::Empty { file: path.to_path_buf() });
    }
    Ok((File::open(path).map_err(failed)?, metadata.len()))
}

/// Checks that a later frame is the same mesh as the first one.
fn matches_first(
    first: &Recording,
    first_file: &Path,
    mesh: &PolygonMesh,
    file: &Path,
    frame: usize,
) -> Result<(), RecordingError> {
    let expected = first.frames[0].len();
    if mesh.positions.len() != expected {
        return Err(RecordingError::VertexCountDiffers {
            file: file.to_path_buf(),
            frame,
            found: mesh.positions.len(),
            expected,
            first: first_file.to_path_buf(),
        });
    }
    if mesh.triangles == first.triangles {
        return Ok(());
    }
    let common = first.triangles.iter().zip(&mesh.triangles).take_while(|(left, right)| left == right).count();
    Err(RecordingError::TrianglesDiffer {
        file: file.to_path_buf(),
        frame,
        triangle: common,
        first: first_file.to_path_buf(),
    })
}

/// Checks that a mesh has triangles and vertices, and that every coordinate is finite.
fn check_positions<C: binary::Coordinate>(
    positions: &[[C; 3]],
    triangles: usize,
    file: &Path,
    frame: usize,
) -> Result<(), RecordingError> {
    if positions.is_empty() || triangles == 0 {
        return Err(RecordingError::NoTriangles {
            file: file.to_path_buf(),
            vertices: positions.len() as u64,
            faces: triangles as u64,
        });
    }
    let broken = |position: &[C; 3]| !position.iter().all(|coordinate| coordinate.is_finite());
    match positions.iter().position(broken) {
        None => Ok(()),
        Some(vertex) => Err(RecordingError::NotFinite { file: file.to_path_buf(), frame, vertex }),
    }
}
