//! Tetrahedral meshes: generated bodies, and files of Gmsh (`.msh`) and TetGen (`.node` with `.ele`).
//!
//! Gmsh files are ASCII, version 4.1 or 2. Every file is treated as untrusted: nothing is reserved for elements that a
//! header merely announces, and every error is a [`TetrahedralMeshError`] that names the file and the line.
//!
//! These are custom readers. Of the crates, `mshio` 0.4 reads version 4.1 only, its errors print bytes instead of a line,
//! and it depends on nom 5 and num 0.3, which have long had successors. For files of TetGen there is none: `tetgen` and
//! `tritet` are generators.

mod bodies;
mod error;
mod lines;
mod motion;
mod msh;
mod tetgen;

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

pub use bodies::{HALF_WIDTH_OF_PIT, WALLS_OF_PIT, tetrahedral_ball, tetrahedral_box, tetrahedral_pile};
pub use error::TetrahedralMeshError;
pub use motion::CurlingBar;

/// A tetrahedral mesh as a file describes it.
///
/// The readers of this module guarantee at least one tetrahedron, finite positions, and no index out of range.
/// Tetrahedra may be degenerate and wound in any way, and vertices may be unused.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetrahedralMesh {
    /// All vertices in the order of the file, in its unit.
    pub positions: Vec<[f32; 3]>,
    /// Four vertex indices per tetrahedron, in the order of the file. Elements of other kinds are left out.
    pub tetrahedra: Vec<[u32; 4]>,
}

impl TetrahedralMesh {
    /// The number of tetrahedra that are inverted or flat at other positions.
    ///
    /// # Panics
    ///
    /// If there are fewer positions than vertices.
    #[must_use]
    pub fn inverted(&self, positions: &[[f32; 3]]) -> usize {
        let volume = |corners: &[u32; 4], positions: &[[f32; 3]]| {
            let [o, a, b, c] = corners.map(|corner| positions[corner as usize].map(f64::from));
            let [a, b, c] = [a, b, c].map(|end| [end[0] - o[0], end[1] - o[1], end[2] - o[2]]);
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        let is_upright = |corners: &&[u32; 4]| volume(corners, &self.positions) * volume(corners, positions) > 0.0;
        self.tetrahedra.len() - self.tetrahedra.iter().filter(is_upright).count()
    }

    /// Reads a Gmsh file in memory.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not such a mesh, see [`TetrahedralMeshError`].
    pub fn from_msh_bytes(bytes: &[u8], name: &Path) -> Result<Self, TetrahedralMeshError> {
        msh::decode(bytes, name)
    }

    /// Reads the two files of TetGen in memory.
    ///
    /// The names stand for the files in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not such a mesh, see [`TetrahedralMeshError`].
    pub fn from_tetgen_bytes(node: (&[u8], &Path), ele: (&[u8], &Path)) -> Result<Self, TetrahedralMeshError> {
        tetgen::decode(node, ele)
    }
}

/// Reads a tetrahedral mesh: a TetGen mesh if the extension is `node` or `ele`, and else a Gmsh file.
///
/// The other file of a TetGen mesh is found beside the given one by its extension.
///
/// # Errors
///
/// If a file cannot be read or is malformed, see [`TetrahedralMeshError`].
pub fn read_tetrahedral_mesh(path: &Path) -> Result<TetrahedralMesh, TetrahedralMeshError> {
    let has_extension =
        |wanted: &str| path.extension().and_then(OsStr::to_str).is_some_and(|found| found.eq_ignore_ascii_case(wanted));
    if has_extension("node") {
        return read_tetgen(path, &path.with_extension("ele"));
    }
    if has_extension("ele") {
        return read_tetgen(&path.with_extension("node"), path);
    }
    TetrahedralMesh::from_msh_bytes(&read(path)?, path)
}

fn read_tetgen(node: &Path, ele: &Path) -> Result<TetrahedralMesh, TetrahedralMeshError> {
    TetrahedralMesh::from_tetgen_bytes((&read(node)?, node), (&read(ele)?, ele))
}

/// Reads a regular file. Folders and devices are refused, because reading a device may never end.
fn read(path: &Path) -> Result<Vec<u8>, TetrahedralMeshError> {
    let file = || PathBuf::from(path);
    // Checked before opening, because opening a named pipe would wait for a writer.
    let metadata = fs::metadata(path).map_err(|source| TetrahedralMeshError::Read { file: file(), source })?;
    if !metadata.is_file() {
        return Err(TetrahedralMeshError::NotAFile { file: file() });
    }
    fs::read(path).map_err(|source| TetrahedralMeshError::Read { file: file(), source })
}
