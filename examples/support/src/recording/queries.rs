//! Recorded questions of continuous collision detection with known answers, little-endian.
//!
//! A `.ccdq.bin` file carries the positions of every query, a `.vf.gt.bin` or `.ee.gt.bin` file names vertices of a
//! recording beside it. Both begin with four `u32` (magic, kind, count, 0); the records follow, then one byte per
//! record that is 1 where the two features collide during the step.

use std::path::Path;

use super::{
    RecordingError,
    binary::{HEADER_BYTES, read_sized},
};

/// First four bytes of a `.ccdq.bin` file, read as a little-endian `u32`.
pub const MAGIC_QUERIES: u32 = 0x5144_4343;

/// First four bytes of a `.gt.bin` file, read as a little-endian `u32`.
pub const MAGIC_TRUTH: u32 = 0x5447_4343;

/// Bytes of the positions of one query: eight points of three `f64`.
const QUERY_BYTES: usize = 8 * 3 * size_of::<f64>();
/// Bytes of the indices of one answer: four `u32`.
const INDICES_BYTES: usize = 4 * size_of::<u32>();

/// Which features a file of queries is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum QueryKind {
    /// A vertex and a face: the four points are the vertex, then the face's corners.
    VertexFace,
    /// Two edges: the four points are the ends of the first edge, then those of the second.
    EdgeEdge,
}

/// Two features that move in straight lines over one step, and whether they meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CcdQuery {
    /// The four points when the step begins, in the order of [`QueryKind`].
    pub start: [[f64; 3]; 4],
    /// The same points when it ends.
    pub end: [[f64; 3]; 4],
    /// The exact answer: whether the features have a point in common at some time of the step, its ends included.
    pub collides: bool,
}

/// A `.ccdq.bin` file. Its coordinates are finite.
#[derive(Clone, Debug, PartialEq)]
pub struct CcdQueries {
    /// Which features all of them are about.
    pub kind: QueryKind,
    /// The queries in the order of the file.
    pub queries: Vec<CcdQuery>,
}

/// Two features of a recording, and whether they meet between its frames 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImpactAnswer {
    /// Indices of the four points, in the order of [`QueryKind`].
    pub vertices: [u32; 4],
    /// The exact answer for motion in straight lines from frame 0 to frame 1.
    pub collides: bool,
}

/// A `.gt.bin` file: feature pairs that have to be found, not all that collide.
///
/// The recording the indices refer to is another file, so they may be out of its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedImpacts {
    /// Which features all of them are about.
    pub kind: QueryKind,
    /// The answers in the order of the file.
    pub answers: Vec<ImpactAnswer>,
}

impl CcdQueries {
    /// Reads the bytes of one `.ccdq.bin` file.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// Every way in which the bytes are not such a file, see [`RecordingError`].
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
    /// Reads the bytes of one `.gt.bin` file.
    ///
    /// `name` stands for the file in error messages and need not exist.
    ///
    /// # Errors
    ///
    /// Every way in which the bytes are not such a file, see [`RecordingError`].
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
/// A file that cannot be read or is malformed, see [`RecordingError`].
pub fn read_ccd_queries(path: &Path) -> Result<CcdQueries, RecordingError> {
    let check = |start: &[u8], size| Header::read::<QUERY_BYTES>(start, MAGIC_QUERIES, size, path).map(drop);
    CcdQueries::from_bytes(&read_sized(path, check)?, path)
}

/// Reads one `.gt.bin` file.
///
/// # Errors
///
/// A file that cannot be read or is malformed, see [`RecordingError`].
pub fn read_recorded_impacts(path: &Path) -> Result<RecordedImpacts, RecordingError> {
    let check = |start: &[u8], size| Header::read::<INDICES_BYTES>(start, MAGIC_TRUTH, size, path).map(drop);
    RecordedImpacts::from_bytes(&read_sized(path, check)?, path)
}

/// What the header of either kind of file says.
struct Header {
    kind: QueryKind,
    count: u32,
}

impl Header {
    /// Reads the header at the start of `bytes`, which may hold no more than that.
    ///
    /// `file_bytes` is the size of the whole file and has to be exactly what the count of records of `RECORD` bytes,
    /// each with a byte for its answer, asks for.
    fn read<const RECORD: usize>(
        bytes: &[u8],
        magic: u32,
        file_bytes: u64,
        name: &Path,
    ) -> Result<Self, RecordingError> {
        let file = || name.to_path_buf();
        if bytes.is_empty() {
            return Err(RecordingError::Empty { file: file() });
        }
        let truncated = |expected: u128| RecordingError::Truncated { file: file(), expected, found: file_bytes };
        let (words, _) = bytes.as_chunks::<4>();
        let mut words = words.iter().map(|word| u32::from_le_bytes(*word));
        let mut next = || words.next().ok_or(truncated(HEADER_BYTES as u128));
        let found = next()?;
        if found != magic {
            return Err(RecordingError::WrongMagic { file: file(), found, expected: magic });
        }
        let unknown = |byte, found, expected| RecordingError::UnknownValue { file: file(), byte, found, expected };
        let kind = match next()? {
            0 => QueryKind::VertexFace,
            1 => QueryKind::EdgeEdge,
            found => return Err(unknown(4, found, "0 (vertex–face) or 1 (edge–edge)")),
        };
        let count = next()?;
        match next()? {
            0 => {}
            found => return Err(unknown(12, found, "0")),
        }
        let expected = HEADER_BYTES as u128 + u128::from(count) * (RECORD as u128 + 1);
        if u128::from(file_bytes) < expected {
            return Err(truncated(expected));
        }
        if u128::from(file_bytes) > expected {
            return Err(RecordingError::TrailingBytes { file: file(), expected, found: file_bytes });
        }
        Ok(Self { kind, count })
    }

    /// The records, and the places of their answers, in the bytes of a whole file.
    fn records<'bytes, const RECORD: usize>(
        &self,
        bytes: &'bytes [u8],
    ) -> (&'bytes [[u8; RECORD]], std::ops::Range<usize>) {
        // The size agrees with the count, so the count describes memory that is already here.
        let end = HEADER_BYTES + self.count as usize * RECORD;
        (bytes[HEADER_BYTES..end].as_chunks::<RECORD>().0, end..bytes.len())
    }
}

/// The answer that stands at `place`.
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
