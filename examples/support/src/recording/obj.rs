//! OBJ files. Only the statements `v` and `f` are read.
//!
//! This is a custom parser, because a recording needs features that the OBJ crates lack: the vertex list of the file as
//! it is, faces in the order of the file, and the place of an error. `tobj` 4 numbers vertices by first use in every
//! object, omits unused ones, and its errors have no place. `obj` 0.10 keeps the list, but has had no release since
//! 2020, and loses the faces before an `o` that follows an empty `g`. `obj-rs` 0.7 panics on free-form statements, and
//! rejects vertex colors and several group names. `wavefront_obj` 11 splits the list by object, and resolves negative
//! indices incorrectly.

use std::borrow::Cow;
use std::path::Path;

use super::{PolygonMesh, RecordingError, check_positions, push_fan};

/// Longest word that an error message quotes.
const LONGEST_QUOTE: usize = 40;

/// A corner whose vertex may come later in the file, so it is checked at the end.
struct Pending {
    index: i64,
    face: usize,
}

/// Reads one OBJ mesh. `frame` is only used in messages.
///
/// Texture and normal indices, vertex weights, and vertex colors are ignored.
pub(super) fn decode(bytes: &[u8], name: &Path, frame: usize) -> Result<PolygonMesh, RecordingError> {
    if bytes.is_empty() {
        return Err(RecordingError::Empty { file: name.to_path_buf() });
    }
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut triangles = Vec::new();
    let mut corners = Vec::new();
    let mut faces = 0;
    let mut furthest = Pending { index: 0, face: 0 };
    for (line, text) in logical_lines(bytes) {
        let text = text.split(|&byte| byte == b'#').next().unwrap_or_default();
        let mut words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        match words.next() {
            Some(b"v") => {
                let mut position = [0.0; 3];
                for coordinate in &mut position {
                    let word = words.next().unwrap_or_default();
                    *coordinate = parse(word).ok_or_else(|| malformed(name, line, "a coordinate", word))?;
                }
                positions.push(position);
            }
            Some(b"f") => {
                corners.clear();
                for word in words {
                    let vertex = word.split(|&byte| byte == b'/').next().unwrap_or_default();
                    let index: i64 = parse(vertex).ok_or_else(|| malformed(name, line, "a vertex index", word))?;
                    let corner = resolve(index, positions.len()).ok_or_else(|| RecordingError::IndexOutOfRange {
                        file: name.to_path_buf(),
                        face: faces,
                        index,
                        vertices: positions.len(),
                    })?;
                    if index > furthest.index {
                        furthest = Pending { index, face: faces };
                    }
                    corners.push(corner);
                }
                if corners.len() < 3 {
                    return Err(RecordingError::TooFewCorners {
                        file: name.to_path_buf(),
                        face: faces,
                        corners: corners.len(),
                    });
                }
                push_fan(&corners, &mut triangles);
                faces += 1;
            }
            _ => {}
        }
    }
    check_positions(&positions, triangles.len(), name, frame)?;
    if furthest.index > positions.len() as i64 {
        return Err(RecordingError::IndexOutOfRange {
            file: name.to_path_buf(),
            face: furthest.face,
            index: furthest.index,
            vertices: positions.len(),
        });
    }
    Ok(PolygonMesh { positions, triangles })
}

/// The lines of the file with their line numbers. Lines that end with a backslash are joined with the next.
///
/// They are bytes rather than text, because names and comments need not be UTF-8.
fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, [u8]>)> {
    let mut lines = bytes.split(|&byte| byte == b'\n').zip(1..);
    std::iter::from_fn(move || {
        let (line, number) = lines.next()?;
        let mut text = Cow::Borrowed(line);
        while let Some(start) = text.trim_ascii_end().strip_suffix(b"\\") {
            let length = start.len();
            // Reuse the buffer. Copying it each time would take quadratic time for many short lines.
            let mut joined = text.into_owned();
            joined.truncate(length);
            joined.push(b' ');
            joined.extend_from_slice(lines.next().map_or(&[], |(line, _)| line));
            text = Cow::Owned(joined);
        }
        Some((number, text))
    })
}

fn parse<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Zero-based index of the vertex that `index` refers to: counted from 1 if positive, and from the last vertex back if
/// negative.
///
/// A vertex that comes later in the file is accepted.
fn resolve(index: i64, vertices: usize) -> Option<u32> {
    let vertex = match index {
        0 => return None,
        1.. => index - 1,
        _ => index.checked_add_unsigned(vertices as u64)?,
    };
    u32::try_from(vertex).ok()
}

fn malformed(name: &Path, line: usize, wanted: &str, word: &[u8]) -> RecordingError {
    let word = &word[..word.len().min(LONGEST_QUOTE)];
    let word = String::from_utf8_lossy(word);
    RecordingError::malformed(name, "OBJ", format!("line {line}: {wanted} was expected, but `{word}` was found"))
}
