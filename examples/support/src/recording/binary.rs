//! `.bin` recordings: header, triangles, and frames, all little-endian, in `f32` or `f64`.

use std::cmp::Ordering;
use std::io::Read;
use std::path::Path;

use super::{MAGIC, MAGIC_F64, RecordingError, check_positions, open};

/// Bytes of the header: magic, vertices, faces, frames. The headers of `queries` have the same length.
pub(super) const HEADER_BYTES: usize = 16;
/// Bytes of one face: three `u32`.
const FACE_BYTES: usize = 12;

/// A number type in which recordings store coordinates.
pub(super) trait Coordinate: Copy {
    /// The magic of this type.
    const MAGIC: u32;
    /// Bytes of one coordinate.
    const BYTES: usize;

    fn is_finite(self) -> bool;

    /// Reads one coordinate from exactly [`Coordinate::BYTES`] bytes.
    fn from_slice(bytes: &[u8]) -> Self;
}

impl Coordinate for f32 {
    const MAGIC: u32 = MAGIC;
    const BYTES: usize = size_of::<f32>();

    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }

    fn from_slice(bytes: &[u8]) -> Self {
        let mut array = [0; Self::BYTES];
        array.copy_from_slice(bytes);
        Self::from_le_bytes(array)
    }
}

impl Coordinate for f64 {
    const MAGIC: u32 = MAGIC_F64;
    const BYTES: usize = size_of::<f64>();

    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }

    fn from_slice(bytes: &[u8]) -> Self {
        let mut array = [0; Self::BYTES];
        array.copy_from_slice(bytes);
        Self::from_le_bytes(array)
    }
}

/// The counts in the header of a recording.
struct Header {
    vertices: u32,
    faces: u32,
    frames: u32,
}

impl Header {
    /// Reads the header at the start of `bytes`, which may contain no more than the header.
    ///
    /// `file_bytes` is the size of the whole file. It must be exactly the size that the counts imply.
    fn read<C: Coordinate>(bytes: &[u8], file_bytes: u64, name: &Path) -> Result<Self, RecordingError> {
        let file = || name.to_path_buf();
        let [vertices, faces, frames] = header_words(bytes, C::MAGIC, file_bytes, name)?;
        let header = Self { vertices, faces, frames };
        if header.frames == 0 {
            return Err(RecordingError::NoFrames { file: file() });
        }
        if header.vertices == 0 || header.faces == 0 {
            return Err(RecordingError::NoTriangles {
                file: file(),
                vertices: u64::from(header.vertices),
                faces: u64::from(header.faces),
            });
        }
        let expected = header.file_bytes::<C>();
        check_size(file_bytes, expected, name)?;
        Ok(header)
    }

    /// Size of the file that the counts describe. Three counts of 32 bits can exceed 64 bits, but never 128.
    fn file_bytes<C: Coordinate>(&self) -> u128 {
        let positions = u128::from(self.vertices) * u128::from(self.frames);
        HEADER_BYTES as u128 + u128::from(self.faces) * FACE_BYTES as u128 + positions * (3 * C::BYTES) as u128
    }
}

/// The three words after `magic` in the header at the start of `bytes`, which may contain no more than the header. The
/// whole file has `file_bytes` bytes.
pub(super) fn header_words(bytes: &[u8], magic: u32, file_bytes: u64, name: &Path) -> Result<[u32; 3], RecordingError> {
    let file = || name.to_path_buf();
    if bytes.is_empty() {
        return Err(RecordingError::Empty { file: file() });
    }
    let (words, _) = bytes.as_chunks::<4>();
    let mut words = words.iter().map(|word| u32::from_le_bytes(*word));
    let mut next = || {
        let expected = HEADER_BYTES as u128;
        words.next().ok_or_else(|| RecordingError::Truncated { file: file(), expected, found: file_bytes })
    };
    let found = next()?;
    if found != magic {
        return Err(RecordingError::WrongMagic { file: file(), found, expected: magic });
    }
    Ok([next()?, next()?, next()?])
}

/// Compares the size of a file with the size that its header implies.
pub(super) fn check_size(file_bytes: u64, expected: u128, name: &Path) -> Result<(), RecordingError> {
    let (file, found) = (|| name.to_path_buf(), file_bytes);
    match u128::from(file_bytes).cmp(&expected) {
        Ordering::Less => Err(RecordingError::Truncated { file: file(), expected, found }),
        Ordering::Equal => Ok(()),
        Ordering::Greater => Err(RecordingError::TrailingBytes { file: file(), expected, found }),
    }
}

/// Reads a file whose header matches its size. `check` gets the header, or less if the file is shorter, and the size of
/// the file. Nothing after the header is read before `check` succeeds.
pub(super) fn read_sized(
    path: &Path,
    check: impl FnOnce(&[u8], u64) -> Result<(), RecordingError>,
) -> Result<Vec<u8>, RecordingError> {
    let (mut file, size) = open(path)?;
    let failed = |source| RecordingError::read(path, source);
    let mut bytes = Vec::with_capacity(HEADER_BYTES);
    (&mut file).take(HEADER_BYTES as u64).read_to_end(&mut bytes).map_err(failed)?;
    check(&bytes, size)?;
    // One byte more than the size, so that decoding notices if the file has grown in the meantime.
    file.take(size.saturating_sub(bytes.len() as u64) + 1).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Reads the bytes of one recording with coordinates of type `C`.
pub(super) fn read_recording<C: Coordinate>(path: &Path) -> Result<Vec<u8>, RecordingError> {
    read_sized(path, |start, size| Header::read::<C>(start, size, path).map(drop))
}

/// The triangles and frames of a recording.
type Decoded<C> = (Vec<[u32; 3]>, Vec<Vec<[C; 3]>>);

/// Decodes the bytes of a recording into triangles and frames.
pub(super) fn decode<C: Coordinate>(bytes: &[u8], name: &Path) -> Result<Decoded<C>, RecordingError> {
    let header = Header::read::<C>(bytes, bytes.len() as u64, name)?;
    // The size matches the counts, so the counts describe memory that is already allocated.
    let vertices = header.vertices as usize;
    let faces = header.faces as usize;
    let (faces, positions) = bytes[HEADER_BYTES..].split_at(faces * FACE_BYTES);
    let (faces, _) = faces.as_chunks::<FACE_BYTES>();
    let triangles: Vec<[u32; 3]> = faces
        .iter()
        .map(|face| {
            let (corners, _) = face.as_chunks::<4>();
            std::array::from_fn(|corner| u32::from_le_bytes(corners[corner]))
        })
        .collect();
    check_indices(&triangles, vertices, name)?;

    let mut frames = Vec::with_capacity(header.frames as usize);
    for (frame, bytes) in positions.chunks_exact(vertices * 3 * C::BYTES).enumerate() {
        let positions: Vec<[C; 3]> = bytes
            .chunks_exact(3 * C::BYTES)
            .map(|position| {
                std::array::from_fn(|axis| C::from_slice(&position[axis * C::BYTES..(axis + 1) * C::BYTES]))
            })
            .collect();
        check_positions(&positions, triangles.len(), name, frame)?;
        frames.push(positions);
    }
    Ok((triangles, frames))
}

/// Encodes triangles and frames as the bytes of a recording.
pub(super) fn encode(triangles: &[[u32; 3]], frames: &[Vec<[f32; 3]>], name: &Path) -> Result<Vec<u8>, RecordingError> {
    let Some(first) = frames.first() else {
        return Err(RecordingError::NoFrames { file: name.to_path_buf() });
    };
    check_indices(triangles, first.len(), name)?;
    for (frame, positions) in frames.iter().enumerate() {
        check_positions(positions, triangles.len(), name, frame)?;
        if positions.len() != first.len() {
            return Err(RecordingError::VertexCountDiffers {
                file: name.to_path_buf(),
                frame,
                found: positions.len(),
                expected: first.len(),
                first: name.to_path_buf(),
            });
        }
    }
    let fit = |what, count: usize| {
        u32::try_from(count).map_err(|_| RecordingError::TooLarge { file: name.to_path_buf(), what, count })
    };
    let mut bytes = Vec::new();
    for word in [MAGIC, fit("vertices", first.len())?, fit("triangles", triangles.len())?, fit("frames", frames.len())?]
    {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    for corner in triangles.iter().flatten() {
        bytes.extend_from_slice(&corner.to_le_bytes());
    }
    for coordinate in frames.iter().flatten().flatten() {
        bytes.extend_from_slice(&coordinate.to_le_bytes());
    }
    Ok(bytes)
}

fn check_indices(triangles: &[[u32; 3]], vertices: usize, name: &Path) -> Result<(), RecordingError> {
    for (face, corners) in triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&corner| corner as usize >= vertices) {
            return Err(RecordingError::IndexOutOfRange {
                file: name.to_path_buf(),
                face,
                index: i64::from(index),
                vertices,
            });
        }
    }
    Ok(())
}
