//! All file readers. Accepted files satisfy the guarantees of their type, rejected ones give an error message of
//! bounded length.

use std::{
    fs,
    path::{Path, PathBuf},
};

use circumsphere_support::recording::{
    CcdQueries, RecordedImpacts, Recording, RecordingError, RecordingF64, read_recording,
};

use crate::input::Input;

/// The longest possible error message. The readers quote at most 300 characters of a file, and in one case name two
/// files in addition.
const LONGEST_MESSAGE: usize = 2000;

/// The most files of one recording.
const MOST_FILES: usize = 3;

fn name() -> &'static Path {
    Path::new("fuzzed")
}

/// Returns the result if a reader accepted its bytes.
fn accepted<T>(read: Result<T, RecordingError>) -> Option<T> {
    read.map_err(|error| {
        let message = error.to_string();
        assert!(message.len() <= LONGEST_MESSAGE, "a message of {} bytes", message.len());
    })
    .ok()
}

fn check_triangles(triangles: &[[u32; 3]], vertices: usize) {
    assert!(!triangles.is_empty(), "a mesh without triangles is accepted");
    assert!(
        triangles.iter().flatten().all(|&corner| (corner as usize) < vertices),
        "an index out of range is accepted"
    );
}

fn check_recording(recording: &Recording) {
    let vertices = recording.frames.first().expect("a recording has a frame").len();
    check_triangles(&recording.triangles, vertices);
    for frame in &recording.frames {
        assert_eq!(frame.len(), vertices, "frames of different lengths are accepted");
        assert!(frame.iter().flatten().all(|coordinate| coordinate.is_finite()), "a coordinate is not finite");
    }
    let bytes = recording.to_bytes(name()).expect("what was read can be written");
    assert_eq!(Recording::from_bytes(&bytes, name()).expect("what was written can be read"), *recording);
}

pub fn recording_bin(bytes: &[u8]) {
    if let Some(recording) = accepted(Recording::from_bytes(bytes, name())) {
        check_recording(&recording);
        assert_eq!(recording.to_bytes(name()).expect("what was read can be written"), bytes, "the bytes changed");
    }
}

pub fn recording_f64(bytes: &[u8]) {
    if let Some(recording) = accepted(RecordingF64::from_bytes(bytes, name())) {
        let vertices = recording.frames.first().expect("a recording has a frame").len();
        check_triangles(&recording.triangles, vertices);
        for frame in &recording.frames {
            assert_eq!(frame.len(), vertices, "frames of different lengths are accepted");
            assert!(frame.iter().flatten().all(|coordinate| coordinate.is_finite()), "a coordinate is not finite");
        }
    }
}

pub fn recording_ply(bytes: &[u8]) {
    if let Some(recording) = accepted(Recording::from_ply_bytes(bytes, name())) {
        check_recording(&recording);
    }
}

pub fn recording_obj(bytes: &[u8]) {
    if let Some(recording) = accepted(Recording::from_obj_bytes(bytes, name())) {
        check_recording(&recording);
    }
}

pub fn ccd_queries(bytes: &[u8]) {
    if let Some(queries) = accepted(CcdQueries::from_bytes(bytes, name())) {
        let coordinates = queries.queries.iter().flat_map(|query| query.start.iter().chain(&query.end)).flatten();
        assert!(coordinates.clone().all(|coordinate| coordinate.is_finite()), "a coordinate is not finite");
        // A header of 16 bytes, then 24 coordinates of 8 bytes and an answer per query.
        assert_eq!(16 + 193 * queries.queries.len(), bytes.len(), "there are unread bytes");
    }
}

pub fn impact_truth(bytes: &[u8]) {
    if let Some(truth) = accepted(RecordedImpacts::from_bytes(bytes, name())) {
        // A header of 16 bytes, then four indices and an answer each.
        assert_eq!(16 + 17 * truth.answers.len(), bytes.len(), "there are unread bytes");
    }
}

/// Up to three files with chosen extensions, read as one recording by their paths. The first byte is the number of
/// files. Each file begins with its extension and the number of bytes that it takes.
pub fn recording_files(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    let count = input.below(MOST_FILES + 1);
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let mut paths: Vec<PathBuf> = Vec::new();
    let mut contents: Vec<&[u8]> = Vec::new();
    for file in 0..count {
        let extension = ["bin", "ply", "obj", "PLY", "f64.bin", "txt"][input.below(6)];
        let length = usize::from(input.byte()) | usize::from(input.byte()) << 8;
        let rest = input.rest();
        let (content, rest) = rest.split_at(length.min(rest.len()));
        input = Input::new(rest);
        let path = folder.path().join(format!("{file}.{extension}"));
        fs::write(&path, content).expect("a file can be written to a new folder");
        paths.push(path);
        contents.push(content);
    }
    let Some(recording) = accepted(read_recording(&paths)) else { return };
    check_recording(&recording);
    if let [content] = contents[..] {
        let alone = [Recording::from_bytes, Recording::from_ply_bytes, Recording::from_obj_bytes];
        assert!(
            alone.iter().any(|from_bytes| from_bytes(content, name()).is_ok_and(|alone| alone == recording)),
            "the file and its bytes are not the same recording"
        );
    } else {
        assert_eq!(recording.frames.len(), count, "each file is a frame");
    }
}
