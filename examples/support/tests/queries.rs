//! Tests the readers of recorded queries with files written byte by byte, and with every kind of invalid file.

mod bytes;

use std::fs;
use std::path::Path;

use circumsphere_support::recording::{
    CcdQueries, CcdQuery, FOLDER_VARIABLE, ImpactAnswer, MAGIC_QUERIES, MAGIC_TRUTH, QueryKind, RecordedImpacts,
    RecordingError, read_ccd_queries, read_recorded_impacts, recordings_folder,
};
use proptest::prelude::*;

use bytes::mutated;

fn words(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Two queries whose coordinates count up from 0. The second one collides.
fn queries_file() -> Vec<u8> {
    let mut bytes = words(&[MAGIC_QUERIES, 1, 2, 0]);
    for coordinate in 0..48 {
        bytes.extend(f64::from(coordinate).to_le_bytes());
    }
    bytes.extend([0, 1]);
    bytes
}

/// Three answers. In the second one the features do not collide.
fn truth_file() -> Vec<u8> {
    let mut bytes = words(&[MAGIC_TRUTH, 0, 3, 0]);
    bytes.extend(words(&[7, 0, 1, 2, 8, 3, 4, 5, u32::MAX, 6, 7, 8]));
    bytes.extend([1, 0, 1]);
    bytes
}

fn queries(bytes: &[u8]) -> Result<CcdQueries, RecordingError> {
    CcdQueries::from_bytes(bytes, Path::new("some.ccdq.bin"))
}

fn truth(bytes: &[u8]) -> Result<RecordedImpacts, RecordingError> {
    RecordedImpacts::from_bytes(bytes, Path::new("some.vf.gt.bin"))
}

/// The two errors for a change that is made to either file.
fn refusals(change: impl Fn(&mut Vec<u8>)) -> [RecordingError; 2] {
    let (mut first, mut second) = (queries_file(), truth_file());
    change(&mut first);
    change(&mut second);
    let errors = [queries(&first).unwrap_err(), truth(&second).unwrap_err()];
    for (error, name) in errors.iter().zip(["some.ccdq.bin", "some.vf.gt.bin"]) {
        assert!(error.to_string().contains(name), "{error}");
    }
    errors
}

#[test]
fn queries_are_read_as_written() {
    let points = |first: u32| {
        std::array::from_fn(|point| std::array::from_fn(|axis| f64::from(first + 3 * point as u32 + axis as u32)))
    };
    let found = queries(&queries_file()).unwrap();
    assert_eq!(found.kind, QueryKind::EdgeEdge);
    assert_eq!(
        found.queries,
        [
            CcdQuery { start: points(0), end: points(12), collides: false },
            CcdQuery { start: points(24), end: points(36), collides: true },
        ]
    );
}

#[test]
fn answers_are_read_as_written() {
    let found = truth(&truth_file()).unwrap();
    assert_eq!(found.kind, QueryKind::VertexFace);
    assert_eq!(
        found.answers,
        [
            ImpactAnswer { vertices: [7, 0, 1, 2], collides: true },
            ImpactAnswer { vertices: [8, 3, 4, 5], collides: false },
            ImpactAnswer { vertices: [u32::MAX, 6, 7, 8], collides: true },
        ]
    );
}

#[test]
fn files_without_records_are_read() {
    assert!(queries(&words(&[MAGIC_QUERIES, 0, 0, 0])).unwrap().queries.is_empty());
    assert!(truth(&words(&[MAGIC_TRUTH, 1, 0, 0])).unwrap().answers.is_empty());
}

#[test]
fn every_truncation_is_refused() {
    let (whole_queries, whole_truth) = (queries_file(), truth_file());
    for length in 1..whole_queries.len() {
        assert!(matches!(queries(&whole_queries[..length]), Err(RecordingError::Truncated { .. })), "{length}");
    }
    for length in 1..whole_truth.len() {
        assert!(matches!(truth(&whole_truth[..length]), Err(RecordingError::Truncated { .. })), "{length}");
    }
    for error in refusals(Vec::clear) {
        assert!(matches!(error, RecordingError::Empty { .. }), "{error:?}");
    }
}

#[test]
fn bytes_after_the_last_answer_are_refused() {
    for error in refusals(|bytes| bytes.push(1)) {
        assert!(matches!(error, RecordingError::TrailingBytes { .. }), "{error:?}");
    }
}

#[test]
fn the_other_files_magic_is_refused() {
    assert!(matches!(queries(&truth_file()), Err(RecordingError::WrongMagic { .. })));
    assert!(matches!(truth(&queries_file()), Err(RecordingError::WrongMagic { .. })));
}

#[test]
fn counts_that_lie_are_refused_at_once() {
    for count in [4, 0x8000_0000, u32::MAX] {
        for error in refusals(|bytes| bytes[8..12].copy_from_slice(&words(&[count]))) {
            assert!(matches!(error, RecordingError::Truncated { .. }), "{error:?}");
        }
    }
}

#[test]
fn values_without_meaning_are_refused_with_their_place() {
    for (place, value) in [(4, 2_u32), (4, u32::MAX), (12, 1)] {
        for error in refusals(|bytes| bytes[place..place + 4].copy_from_slice(&value.to_le_bytes())) {
            assert!(
                matches!(error, RecordingError::UnknownValue { byte, found, .. } if byte == place && found == value),
                "{error:?}"
            );
            assert!(error.to_string().contains(&format!("byte {place}")), "{error}");
        }
    }
    for error in refusals(|bytes| *bytes.last_mut().unwrap() = 2) {
        assert!(matches!(error, RecordingError::UnknownValue { found: 2, .. }), "{error:?}");
    }
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut bytes = queries_file();
        // Coordinate y of the third point at the end of query 1.
        let place = 16 + 8 * (24 + 12 + 6 + 1);
        bytes[place..place + 8].copy_from_slice(&value.to_le_bytes());
        let error = queries(&bytes).unwrap_err();
        assert!(matches!(error, RecordingError::QueryNotFinite { query: 1, byte, .. } if byte == place), "{error:?}");
        assert!(error.to_string().contains("some.ccdq.bin: query 1"), "{error}");
    }
}

#[test]
fn files_are_read_from_disk_and_refused_by_their_header() {
    let folder = fresh_folder();
    let place = folder.join("lying.ccdq.bin");
    fs::write(&place, queries_file()).unwrap();
    assert_eq!(read_ccd_queries(&place).unwrap(), queries(&queries_file()).unwrap());
    let mut lying = queries_file();
    lying[8..12].copy_from_slice(&words(&[u32::MAX]));
    fs::write(&place, lying).unwrap();
    assert!(matches!(read_ccd_queries(&place), Err(RecordingError::Truncated { .. })));
    fs::write(&place, truth_file()).unwrap();
    assert!(matches!(read_ccd_queries(&place), Err(RecordingError::WrongMagic { .. })));
    assert_eq!(read_recorded_impacts(&place).unwrap(), truth(&truth_file()).unwrap());
    assert!(matches!(read_recorded_impacts(&folder), Err(RecordingError::NotAFile { .. })));
    fs::remove_dir_all(&folder).unwrap();
    assert!(matches!(read_recorded_impacts(&place), Err(RecordingError::Read { .. })));
}

fn fresh_folder() -> std::path::PathBuf {
    let path = std::env::temp_dir().join(format!("circumsphere_queries_{}", std::process::id()));
    fs::create_dir_all(&path).unwrap();
    path
}

#[test]
fn recorded_queries_are_read() {
    let Some(folder) = recordings_folder() else {
        assert!(std::env::var_os(FOLDER_VARIABLE).is_none_or(|value| value.is_empty()));
        return;
    };
    let (mut asked, mut answered) = (0, 0);
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name.ends_with(".ccdq.bin") {
            asked += read_ccd_queries(&path).unwrap().queries.len();
        } else if name.ends_with(".gt.bin") {
            let truth = read_recorded_impacts(&path).unwrap();
            assert_eq!(truth.kind == QueryKind::EdgeEdge, name.ends_with(".ee.gt.bin"), "{name}");
            answered += truth.answers.len();
        }
    }
    assert!(asked > 0 && answered > 0, "the folder has no queries");
}

/// The result of a reader is an error, or has exactly as many records as fit into the bytes, all of them finite.
fn assert_sound(bytes: &[u8]) {
    if let Ok(found) = queries(bytes) {
        assert_eq!(bytes.len(), 16 + 193 * found.queries.len());
        for query in &found.queries {
            assert!(query.start.iter().chain(&query.end).flatten().all(|coordinate| coordinate.is_finite()));
        }
    }
    if let Ok(found) = truth(bytes) {
        assert_eq!(bytes.len(), 16 + 17 * found.answers.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(512) })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        assert_sound(&bytes);
        for magic in [MAGIC_QUERIES, MAGIC_TRUTH] {
            for count in [1, u32::MAX] {
                assert_sound(&[words(&[magic, 0, count, 0]), bytes.clone()].concat());
            }
        }
    }

    #[test]
    fn mutated_queries_never_panic(bytes in mutated(queries_file())) {
        assert_sound(&bytes);
    }

    #[test]
    fn mutated_answers_never_panic(bytes in mutated(truth_file())) {
        assert_sound(&bytes);
    }
}
