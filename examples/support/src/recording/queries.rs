//! Recorded queries of continuous collision detection with known answers, little-endian.
//!
//! A `.ccdq.bin` file has the positions of every query. A `.vf.gt.bin` or `.ee.gt.bin` file has vertex indices into a
//! separate recording. Both begin with four `u32` (magic, kind, count, 0). Then follow the records, and one byte per
//! record that is 1 if the two features collide during the step.

use std::path::Path;

use super::{
    RecordingError,
    binary::{HEADER_BYTES, check_size, header_words, read_sized},
};

/// First four bytes of a `.ccdq.bin` file, read as a little-endian `u32`.
pub const MAGIC_QUERIES: u32 = 0x5144_4343;

/// First four bytes of a `.gt.bin` file, read as a little-endian `u32`.
pub const MAGIC_TRUTH: u32 = 0x5447_4343;

/// Bytes of the positions of one query: eight points of three `f64`.
const QUERY_BYTES: usize = 8 * 3 * size_of::<f64>();
/// Bytes of the indices of one answer: four `u32`.
const INDICES_BYTES: usize = 4 * size_of::<u32>();

/// The kind of features in a file of queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum QueryKind {
    /// A vertex and a face. The four points are the vertex, then the corners of the face.
    VertexFace,
    /// Two edges. The four points are the ends of the first edge, then those of the second.
    EdgeEdge,
}

/// Two features that move in straight lines over one step, and whether they collide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CcdQuery {
    /// The four points at the beginning of the step, in the order of [`QueryKind`].
    pub start: [[f64; 3]; 4],
    /// The four points at the end of the step.
    pub end: [[f64; 3]; 4],
    /// The exact answer: whether the features have a point in common at some time of the step, including its ends.
    pub collides: bool,
}

/// A `.ccdq.bin` file. Its coordinates are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct CcdQueries {
    /// The kind of features of all queries.
    pub kind: QueryKind,
    /// The queries, in the order of the file.
    pub queries: Vec<CcdQuery>,
}

/// Two features of a recording, and whether they collide between its frames 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImpactAnswer {
    /// Indices of the four points, in the order of [`QueryKind`].
    pub vertices: [u32; 4],
    /// The exact answer for motion in straight lines from frame 0 to frame 1.
    pub collides: bool,
}

/// A `.gt.bin` file: feature pairs that must be found. They are not all pairs that collide.
///
/// The indices refer to a recording in another file, so they may be out of its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedImpacts {
    /// The kind of features of all answers.
    pub kind: QueryKind,
    /// The answers, in the order of the file.
    pub answers: Vec<ImpactAnswer>,
}

impl CcdQueries {
    /// Reads one `.ccdq.bin` file from bytes.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not a valid file of that format, see [`RecordingError`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, RecordingError> {
        let header = Header::read::<QUERY_BYTES>(bytes, MAGIC_QUERIES, bytes.len() as u64, name)?;
        let (records, answers) = header.records::<QUERY_BYTES>(bytes);
        let mut queries = Vec::with_capacity(records.len());
        for (query, (record, place)) in records.iter().zip(answers).enumerate() {
            let (numbers, _) = record.as_chunks::<{ size_of::<f64>() }>();
            let number = |k: usize| f64::from_le_bytes(numbers[k]);
            if let Some(broken) = (0..numbers.len()).find(|&k| !number(k).is_finite()) {
                return Err(RecordingError::QueryNotFinite {
                    file: name.to_path_buf(),
                    query,
                    byte: HEADER_BYTES + query * QUERY_BYTES + broken * size_of::<f64>(),
                });
            }
            let points = |first: usize| {
                std::array::from_fn(|point| std::array::from_fn(|axis| number(3 * (first + point) + axis)))
            };
            queries.push(CcdQuery { start: points(0), end: points(4), collides: collides(bytes, place, name)? });
        }
        Ok(Self { kind: header.kind, queries })
    }
}

impl RecordedImpacts {
    /// Reads one `.gt.bin` file from bytes.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// If the bytes are not a valid file of that format, see [`RecordingError`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, RecordingError> {
        let header = Header::read::<INDICES_BYTES>(bytes, MAGIC_TRUTH, bytes.len() as u64, name)?;
        let (records, answers) = header.records::<INDICES_BYTES>(bytes);
        let mut truth = Vec::with_capacity(records.len());
        for (record, place) in records.iter().zip(answers) {
            let (indices, _) = record.as_chunks::<{ size_of::<u32>() }>();
            let vertices = std::array::from_fn(|point| u32::from_le_bytes(indices[point]));
            truth.push(ImpactAnswer { vertices, collides: collides(bytes, place, name)? });
        }
        Ok(Self { kind: header.kind, answers: truth })
    }
}

/// Reads one `.ccdq.bin` file.
///
/// # Errors
///
/// If the file cannot be read or is malformed, see [`RecordingError`].
pub fn read_ccd_queries(path: &Path) -> Result<CcdQueries, RecordingError> {
    let check = |start: &[u8], size| Header::read::<QUERY_BYTES>(start, MAGIC_QUERIES, size, path).map(drop);
    CcdQueries::from_bytes(&read_sized(path, check)?, path)
}

/// Reads one `.gt.bin` file.
///
/// # Errors
///
/// If the file cannot be read or is malformed, see [`RecordingError`].
pub fn read_recorded_impacts(path: &Path) -> Result<RecordedImpacts, RecordingError> {
    let check = |start: &[u8], size| Header::read::<INDICES_BYTES>(start, MAGIC_TRUTH, size, path).map(drop);
    RecordedImpacts::from_bytes(&read_sized(path, check)?, path)
}

/// The header of either kind of file.
struct Header {
    kind: QueryKind,
    count: u32,
}

impl Header {
    /// Reads the header at the start of `bytes`, which may contain no more than the header.
    ///
    /// `file_bytes` is the size of the whole file. It must be exactly the size of the header, plus `count` records of
    /// `RECORD` bytes with one byte each for the answer.
    fn read<const RECORD: usize>(
        bytes: &[u8],
        magic: u32,
        file_bytes: u64,
        name: &Path,
    ) -> Result<Self, RecordingError> {
        let [kind, count, rest] = header_words(bytes, magic, file_bytes, name)?;
        let unknown =
            |byte, found, expected| RecordingError::UnknownValue { file: name.to_path_buf(), byte, found, expected };
        let kind = match kind {
            0 => QueryKind::VertexFace,
            1 => QueryKind::EdgeEdge,
            found => return Err(unknown(4, found, "0 (vertex–face) or 1 (edge–edge)")),
        };
        if rest != 0 {
            return Err(unknown(12, rest, "0"));
        }
        check_size(file_bytes, HEADER_BYTES as u128 + u128::from(count) * (RECORD as u128 + 1), name)?;
        Ok(Self { kind, count })
    }

    /// The records in the bytes of a whole file, and the places of their answers.
    fn records<'bytes, const RECORD: usize>(
        &self,
        bytes: &'bytes [u8],
    ) -> (&'bytes [[u8; RECORD]], std::ops::Range<usize>) {
        // The size matches the count, so the count describes memory that is already allocated.
        let end = HEADER_BYTES + self.count as usize * RECORD;
        (bytes[HEADER_BYTES..end].as_chunks::<RECORD>().0, end..bytes.len())
    }
}

/// The answer at `place`.
fn collides(bytes: &[u8], place: usize, name: &Path) -> Result<bool, RecordingError> {
    match bytes[place] {
        0 => Ok(false),
        1 => Ok(true),
        found => Err(RecordingError::UnknownValue {
            file: name.to_path_buf(),
            byte: place,
            found: found.into(),
            expected: "0 (apart) or 1 (collides)",
        }),
    }
}
