//! Tests the readers with files written by hand, byte by byte, and with every kind of invalid file.

mod bytes;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use circumsphere_support::recording::{
    FOLDER_VARIABLE, MAGIC, MAGIC_F64, Recording, RecordingError, read_f64_recording, read_recording,
    recordings_folder, write_recording,
};
use proptest::prelude::*;

use bytes::mutated;

/// Time limit for refusing a file, whatever its header claims. Counting to four billion would take seconds.
const QUICK: Duration = Duration::from_millis(500);

/// A separate folder for one test, removed at the end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("circumsphere_support_{}_{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        fs::write(&path, bytes).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn tetrahedron() -> Recording {
    let first = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.5, 0.0], [0.0, 0.0, -2.25]];
    let second = first.iter().map(|[x, y, z]| [x + 0.1, *y, *z]).collect();
    Recording { triangles: vec![[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], frames: vec![first, second] }
}

fn words(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The tetrahedron as a `.bin` recording, written independently of the writer under test.
fn tetrahedron_bin() -> Vec<u8> {
    let recording = tetrahedron();
    let mut bytes = words(&[MAGIC, 4, 4, 2]);
    for corner in recording.triangles.iter().flatten() {
        bytes.extend(corner.to_le_bytes());
    }
    for coordinate in recording.frames.iter().flatten().flatten() {
        bytes.extend(coordinate.to_le_bytes());
    }
    bytes
}

fn obj(recording: &Recording, frame: usize) -> String {
    let mut text = String::new();
    for [x, y, z] in &recording.frames[frame] {
        text += &format!("v {x} {y} {z}\n");
    }
    for [a, b, c] in &recording.triangles {
        text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
    }
    text
}

fn ply_header(format: &str, vertices: u64, faces: u64) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment by hand\nelement vertex {vertices}\nproperty float x\n\
         property float y\nproperty float z\nelement face {faces}\nproperty list uchar int vertex_indices\n\
         end_header\n"
    )
}

fn ply_ascii(recording: &Recording, frame: usize) -> String {
    let positions = &recording.frames[frame];
    let mut text = ply_header("ascii", positions.len() as u64, recording.triangles.len() as u64);
    for [x, y, z] in positions {
        text += &format!("{x} {y} {z}\n");
    }
    for [a, b, c] in &recording.triangles {
        text += &format!("3 {a} {b} {c}\n");
    }
    text
}

fn ply_binary(recording: &Recording, frame: usize, little: bool) -> Vec<u8> {
    let (format, order): (_, fn(u32) -> [u8; 4]) =
        if little { ("binary_little_endian", u32::to_le_bytes) } else { ("binary_big_endian", u32::to_be_bytes) };
    let positions = &recording.frames[frame];
    let header = ply_header(format, positions.len() as u64, recording.triangles.len() as u64);
    let mut bytes = header.into_bytes();
    for coordinate in positions.iter().flatten() {
        bytes.extend(order(coordinate.to_bits()));
    }
    for triangle in &recording.triangles {
        bytes.push(3);
        for corner in triangle {
            bytes.extend(order(*corner));
        }
    }
    bytes
}

/// Reads one file that must be refused, quickly and with its name in the message.
fn refusal(path: &Path) -> RecordingError {
    refusal_of(&[path.to_path_buf()], path)
}

fn refusal_of(paths: &[PathBuf], culprit: &Path) -> RecordingError {
    let start = Instant::now();
    let error = read_recording(paths).expect_err("the file is invalid");
    assert!(start.elapsed() < QUICK, "took {:?}: {error}", start.elapsed());
    let name = culprit.file_name().unwrap().to_str().unwrap();
    assert!(error.to_string().contains(name), "no {name} in: {error}");
    error
}

macro_rules! assert_refused {
    ($error:expr, $pattern:pat, $($part:expr),* $(,)?) => {{
        let error = $error;
        assert!(matches!(error, $pattern), "{error:?}");
        $(assert!(error.to_string().contains($part), "no `{}` in: {error}", $part);)*
    }};
}

#[test]
fn bin_round_trip_is_exact() {
    let folder = Folder::new();
    let path = folder.0.join("tetrahedron.bin");
    write_recording(&path, &tetrahedron()).unwrap();
    assert_eq!(fs::read(&path).unwrap(), tetrahedron_bin());
    assert_eq!(read_recording(&[path]).unwrap(), tetrahedron());
    assert_eq!(Recording::from_bytes(&tetrahedron_bin(), Path::new("embedded")).unwrap(), tetrahedron());
}

#[test]
fn bin_is_known_by_its_magic_under_any_name() {
    let folder = Folder::new();
    let path = folder.file("recording.dat", tetrahedron_bin());
    assert_eq!(read_recording(&[path]).unwrap(), tetrahedron());
}

#[test]
fn f64_recording_keeps_double_precision() {
    let mut bytes = words(&[MAGIC_F64, 3, 1, 1, 0, 1, 2]);
    let positions = [[0.1_f64, 1e-300, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 1e200]];
    for coordinate in positions.iter().flatten() {
        bytes.extend(coordinate.to_le_bytes());
    }
    let folder = Folder::new();
    let path = folder.file("triangle.f64.bin", &bytes);
    let recording = read_f64_recording(&path).unwrap();
    assert_eq!(recording.triangles, [[0, 1, 2]]);
    assert_eq!(recording.frames, [positions.to_vec()]);

    assert_refused!(refusal(&path), RecordingError::WrongMagic { .. }, "of another kind");
    let path = folder.file("f32.bin", tetrahedron_bin());
    assert_refused!(read_f64_recording(&path).unwrap_err(), RecordingError::WrongMagic { .. }, "f32.bin");
    bytes.pop();
    let path = folder.file("short.f64.bin", &bytes);
    assert_refused!(
        read_f64_recording(&path).unwrap_err(),
        RecordingError::Truncated { .. },
        "short.f64.bin",
        "99",
        "100"
    );
    assert!(matches!(read_f64_recording(&folder.0), Err(RecordingError::NotAFile { .. })));
}

#[test]
fn frames_in_each_text_and_binary_format_are_one_recording() {
    let folder = Folder::new();
    let mesh = tetrahedron();
    let frames = |extension: &str, contents: [Vec<u8>; 2]| {
        let [first, second] = contents;
        [folder.file(&format!("a.{extension}"), first), folder.file(&format!("b.{extension}"), second)]
    };
    let ascii = frames("1.ply", [0, 1].map(|frame| ply_ascii(&mesh, frame).into_bytes()));
    let little = frames("2.ply", [0, 1].map(|frame| ply_binary(&mesh, frame, true)));
    let big = frames("3.ply", [0, 1].map(|frame| ply_binary(&mesh, frame, false)));
    let text = frames("obj", [0, 1].map(|frame| obj(&mesh, frame).into_bytes()));
    for paths in [&ascii, &little, &big, &text] {
        assert_eq!(read_recording(paths).unwrap(), mesh, "{paths:?}");
    }
    let mixed = [big[0].clone(), text[1].clone()];
    assert_eq!(read_recording(&mixed).unwrap(), mesh);
}

#[test]
fn ply_is_known_by_its_first_line_under_any_name() {
    let folder = Folder::new();
    let path = folder.file("frame.obj", ply_ascii(&tetrahedron(), 1));
    let recording = read_recording(&[path]).unwrap();
    assert_eq!(recording.frames, tetrahedron().frames[1..]);
}

#[test]
fn ply_with_more_than_a_mesh_needs_is_read() {
    let text = "ply\r\nformat ascii 1.0\r\nobj_info none\r\nelement camera 1\r\nproperty list uchar float view\r\n\
        element face 2\r\nproperty uchar red\r\nproperty list uint8 uint32 vertex_index\r\n\
        element vertex 5\r\nproperty double z\r\nproperty double y\r\nproperty float nx\r\nproperty double x\r\n\
        element edge 2\r\nproperty int a\r\nend_header\r\n\
        2 0.5 0.25\r\n255 5 0 1 2 3 4\r\n255 3 2 1 0\r\n\
        0 0 9 1\r\n0 0 9 2\r\n0 0 9 3\r\n1e-1 0 9 4\r\n-2.5 0 9 5\r\n7\r\n8\r\n\r\n";
    let recording = Recording::from_ply_bytes(text.as_bytes(), Path::new("extra.ply")).unwrap();
    assert_eq!(recording.triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [2, 1, 0]]);
    assert_eq!(
        recording.frames,
        [vec![[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 0.0, 0.1], [5.0, 0.0, -2.5]]]
    );
}

#[test]
fn obj_keeps_the_vertex_list_and_the_face_order_of_the_file() {
    let text = "# caf\u{e9}\nmtllib none.mtl\no first\nv 9 9 9 # unused\nv 0 0 0 1.0\nv 1 0 0 0.5 0.5 0.5\nvt 0 0\n\
        vn 0 0 1\ng some names\ng\no second\nusemtl red\ns off\nv 1 1 0\nv 0 1 0\ncurv2 1 2\n\
        f 5/1/1 4//1 3/1 2\ng left\nf -1 -2 -3\ng right\nl 1 2\np 1\nf 6 2 \\\n  3\nv 7 7 7\nv 8 8 8";
    let recording = Recording::from_obj_bytes(text.as_bytes(), Path::new("mixed.obj")).unwrap();
    assert_eq!(recording.triangles, [[4, 3, 2], [4, 2, 1], [4, 3, 2], [5, 1, 2]]);
    let first: Vec<f32> = recording.frames[0].iter().map(|position| position[0]).collect();
    assert_eq!(first, [9.0, 0.0, 1.0, 1.0, 0.0, 7.0, 8.0]);
}

#[test]
fn obj_names_need_not_be_utf8() {
    let mut bytes = b"g caf\xe9\n".to_vec();
    bytes.extend(obj(&tetrahedron(), 0).bytes());
    let recording = Recording::from_obj_bytes(&bytes, Path::new("latin.obj")).unwrap();
    assert_eq!(recording.triangles, tetrahedron().triangles);
}

#[test]
fn no_file_is_refused() {
    assert!(matches!(read_recording(&[]), Err(RecordingError::NoFiles)));
}

#[test]
fn missing_and_unreadable_paths_are_refused() {
    let folder = Folder::new();
    for name in ["missing.bin", "missing.ply", "missing.obj"] {
        assert_refused!(refusal(&folder.0.join(name)), RecordingError::Read { .. }, "cannot be read");
        let path = folder.file(&format!("empty_{name}"), b"");
        assert_refused!(refusal(&path), RecordingError::Empty { .. }, "empty");
        let path = folder.0.join(format!("folder_{name}"));
        fs::create_dir(&path).unwrap();
        assert_refused!(refusal(&path), RecordingError::NotAFile { .. }, "regular file");
    }
    let name = Path::new("nothing");
    for error in
        [Recording::from_bytes(b"", name), Recording::from_ply_bytes(b"", name), Recording::from_obj_bytes(b"", name)]
    {
        assert_refused!(error.unwrap_err(), RecordingError::Empty { .. }, "nothing");
    }
}

#[test]
fn bin_that_does_not_match_its_header_is_refused() {
    let folder = Folder::new();
    let whole = tetrahedron_bin();
    for length in [1, 3, 4, 15, 16, 17, 63, 64, whole.len() - 1] {
        let path = folder.file("short.bin", &whole[..length]);
        assert_refused!(refusal(&path), RecordingError::Truncated { .. }, "truncated", length.to_string().as_str());
    }
    let mut long = whole.clone();
    long.push(0);
    let path = folder.file("long.bin", &long);
    assert_refused!(
        refusal(&path),
        RecordingError::TrailingBytes { .. },
        long.len().to_string().as_str(),
        whole.len().to_string().as_str(),
    );
    let mut other = whole;
    other[0] ^= 1;
    let path = folder.file("other.bin", &other);
    assert_refused!(refusal(&path), RecordingError::WrongMagic { .. }, "0x4d534850", "0x4d534851");
}

#[test]
fn bin_with_a_lying_header_is_refused_at_once() {
    let folder = Folder::new();
    for counts in [
        [u32::MAX, 4, 2],
        [4, u32::MAX, 2],
        [4, 4, u32::MAX],
        [u32::MAX, u32::MAX, u32::MAX],
        [0x8000_0000, 0x8000_0000, 0x8000_0000],
    ] {
        let mut bytes = tetrahedron_bin();
        bytes[4..16].copy_from_slice(&words(&counts));
        let path = folder.file("lying.bin", &bytes);
        assert_refused!(refusal(&path), RecordingError::Truncated { .. }, "needs");
    }
}

#[test]
fn bin_without_content_is_refused() {
    let folder = Folder::new();
    let mut bytes = tetrahedron_bin();
    bytes[12..16].copy_from_slice(&words(&[0]));
    let path = folder.file("still.bin", &bytes[..64]);
    assert_refused!(refusal(&path), RecordingError::NoFrames { .. }, "no frames");
    let path = folder.file("empty.bin", words(&[MAGIC, 0, 0, 1]));
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. }, "no triangles");
    let path = folder.file("points.bin", words(&[MAGIC, 1, 0, 1, 0, 0, 0]));
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. }, "1 vertices", "0 faces");
}

#[test]
fn bin_with_bad_content_is_refused_with_the_place() {
    let folder = Folder::new();
    let mut bytes = tetrahedron_bin();
    // Corner 1 of face 2.
    bytes[16 + 2 * 12 + 4..][..4].copy_from_slice(&words(&[4]));
    let path = folder.file("index.bin", &bytes);
    assert_refused!(refusal(&path), RecordingError::IndexOutOfRange { .. }, "face 2", "vertex 4", "4 vertices");
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut bytes = tetrahedron_bin();
        // Coordinate y of vertex 3 in frame 1.
        bytes[64 + 4 * 12 + 3 * 12 + 4..][..4].copy_from_slice(&value.to_le_bytes());
        let path = folder.file("broken.bin", &bytes);
        assert_refused!(refusal(&path), RecordingError::NotFinite { .. }, "frame 1 vertex 3");
    }
}

#[test]
fn bin_is_alone_or_refused() {
    let folder = Folder::new();
    let first = folder.file("first.bin", tetrahedron_bin());
    let second = folder.file("second.bin", tetrahedron_bin());
    let frame = folder.file("frame.ply", ply_ascii(&tetrahedron(), 0));
    assert_refused!(refusal_of(&[first.clone(), second], &first), RecordingError::SeveralRecordings { .. }, "2 .bin");
    for paths in [[first.clone(), frame.clone()], [frame.clone(), first.clone()]] {
        assert_refused!(refusal_of(&paths, &first), RecordingError::MixedFormats { .. }, "beside");
    }
}

#[test]
fn frames_of_another_mesh_are_refused() {
    let folder = Folder::new();
    let mesh = tetrahedron();
    let first = folder.file("first.obj", obj(&mesh, 0));
    let more = folder.file("more.ply", {
        let mut mesh = mesh.clone();
        mesh.frames[1].push([0.0; 3]);
        ply_ascii(&mesh, 1)
    });
    let paths = [first.clone(), first.clone(), more.clone()];
    assert_refused!(
        refusal_of(&paths, &more),
        RecordingError::VertexCountDiffers { .. },
        "frame 2",
        "5 vertices",
        "has 4",
        "first.obj"
    );
    let turned = folder.file("turned.obj", {
        let mut mesh = mesh.clone();
        mesh.triangles[3].rotate_left(1);
        obj(&mesh, 1)
    });
    let fewer = folder.file("fewer.obj", {
        let mut mesh = mesh.clone();
        mesh.triangles.pop();
        obj(&mesh, 1)
    });
    for other in [turned, fewer] {
        assert_refused!(
            refusal_of(&[first.clone(), other.clone()], &other),
            RecordingError::TrianglesDiffer { .. },
            "frame 1",
            "triangle 3"
        );
    }
    let broken = folder.file("broken.obj", {
        let mut mesh = mesh;
        mesh.frames[1][2][0] = f32::NAN;
        obj(&mesh, 1)
    });
    assert_refused!(
        refusal_of(&[first, broken.clone()], &broken),
        RecordingError::NotFinite { .. },
        "frame 1 vertex 2"
    );
}

#[test]
fn ply_that_is_cut_off_or_too_long_is_refused() {
    let folder = Folder::new();
    let mesh = tetrahedron();
    for (name, whole) in [
        ("ascii.ply", ply_ascii(&mesh, 0).into_bytes()),
        ("little.ply", ply_binary(&mesh, 0, true)),
        ("big.ply", ply_binary(&mesh, 0, false)),
    ] {
        for length in 1..whole.len() - 1 {
            let path = folder.file(name, &whole[..length]);
            assert_refused!(
                refusal(&path),
                RecordingError::EndsEarly { .. }
                    | RecordingError::Malformed { .. }
                    | RecordingError::TooManyElements { .. },
            );
        }
        let mut long = whole;
        long.push(b'1');
        let path = folder.file(name, long);
        assert_refused!(refusal(&path), RecordingError::TrailingBytes { .. }, "accounts for");
    }
    let whole = ply_binary(&mesh, 0, true);
    let path = folder.file("cut.ply", &whole[..whole.len() - 30]);
    assert_refused!(refusal(&path), RecordingError::EndsEarly { .. }, "'face'");
}

#[test]
fn ply_with_a_lying_header_is_refused_at_once() {
    let folder = Folder::new();
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for count in [1000, u64::from(u32::MAX), u64::MAX] {
            for (vertices, faces) in [(count, 1), (3, count), (count, count)] {
                let mut bytes = ply_header(format, vertices, faces).into_bytes();
                bytes.extend([b'1'; 100]);
                let path = folder.file("lying.ply", bytes);
                assert_refused!(refusal(&path), RecordingError::TooManyElements { .. }, "announces");
            }
            // An element without properties has no bytes in a binary file.
            let header = format!(
                "ply\nformat {format} 1.0\nelement nothing {count}\nelement vertex 1\nproperty float x\n\
                 property float y\nproperty float z\nelement face 1\nproperty list int int vertex_indices\n\
                 end_header\n"
            );
            let path = folder.file("nothing.ply", header);
            assert_refused!(refusal(&path), RecordingError::TooManyElements { .. }, "`nothing`");
        }
    }
    // A face that claims four billion corners.
    let mut bytes = ply_header("binary_little_endian", 1, 1).replace("uchar int", "uint int").into_bytes();
    bytes.extend([0; 12]);
    bytes.extend([0xff; 4]);
    bytes.extend([0; 100]);
    let path = folder.file("corners.ply", bytes);
    assert_refused!(refusal(&path), RecordingError::EndsEarly { .. }, "face");
    let text = ply_header("ascii", 1, 1).replace("uchar int", "uint int") + "0 0 0\n18446744073709551615 1 2 3\n";
    let path = folder.file("corners_ascii.ply", text);
    assert_refused!(refusal(&path), RecordingError::Malformed { .. }, "PLY");
}

#[test]
fn ply_without_what_a_mesh_needs_is_refused() {
    let folder = Folder::new();
    let whole = ply_ascii(&tetrahedron(), 0);
    let changed = |from: &str, to: &str| {
        assert!(whole.contains(from));
        refusal(&folder.file("lacking.ply", whole.replace(from, to)))
    };
    assert_refused!(changed("element vertex", "element point"), RecordingError::MissingElement { .. }, "`vertex`");
    assert_refused!(changed("element face", "element polygon"), RecordingError::MissingElement { .. }, "`face`");
    for axis in ["x", "y", "z"] {
        for to in [String::from("property float w"), format!("property int {axis}")] {
            let error = changed(&format!("property float {axis}"), &to);
            let property = format!("`{axis}`");
            assert_refused!(error, RecordingError::MissingProperty { .. }, "`vertex`", property.as_str());
        }
    }
    for to in ["list uchar int corners", "list uchar float vertex_indices", "int vertex_indices"] {
        assert_refused!(
            changed("list uchar int vertex_indices", to),
            RecordingError::MissingProperty { .. },
            "`face`",
            "vertex_indices"
        );
    }
    assert_refused!(changed("format ascii 1.0\n", ""), RecordingError::Malformed { .. }, "format");
    assert_refused!(changed("property float y", "property real y"), RecordingError::Malformed { .. }, "Line 6");
    assert_refused!(changed("ply\n", "pla\n"), RecordingError::Malformed { .. }, "Line 1");
    let path = folder.file("faceless.ply", ply_header("ascii", 1, 0) + "0 0 0\n");
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. }, "0 faces");
    let path = folder.file("vertexless.ply", ply_header("ascii", 0, 1) + "3 0 0 0\n");
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. }, "0 vertices");
}

#[test]
fn ply_with_bad_content_is_refused_with_the_place() {
    let folder = Folder::new();
    let whole = ply_ascii(&tetrahedron(), 0);
    let changed = |from: &str, to: &str| {
        assert!(whole.contains(from));
        refusal(&folder.file("bad.ply", whole.replace(from, to)))
    };
    assert_refused!(changed("3 1 3 2", "3 1 4 2"), RecordingError::IndexOutOfRange { .. }, "face 2", "vertex 4");
    assert_refused!(changed("3 1 3 2", "3 1 -1 2"), RecordingError::IndexOutOfRange { .. }, "face 2", "vertex -1");
    assert_refused!(changed("3 1 3 2", "2 1 3"), RecordingError::TooFewCorners { .. }, "face 2", "2 corners");
    assert_refused!(changed("0 1.5 0", "0 1e99 0"), RecordingError::NotFinite { .. }, "frame 0 vertex 2");
    assert_refused!(changed("0 1.5 0", "0 nan 0"), RecordingError::Malformed { .. }, "Line 13");
    assert_refused!(changed("0 1.5 0", "0 1.5"), RecordingError::Malformed { .. }, "Line 13");
    // With one vertex too few or too many, a vertex line is read as a face line, or the reverse.
    assert_refused!(
        changed("vertex 4", "vertex 3"),
        RecordingError::Malformed { .. } | RecordingError::TooFewCorners { .. } | RecordingError::TrailingBytes { .. },
    );
    assert_refused!(
        changed("vertex 4", "vertex 5"),
        RecordingError::EndsEarly { .. } | RecordingError::TooManyElements { .. },
    );

    let mut bytes = ply_binary(&tetrahedron(), 0, true);
    let start = bytes.len() - 4 * 13 - 4;
    bytes[start..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let path = folder.file("nan.ply", bytes);
    assert_refused!(refusal(&path), RecordingError::NotFinite { .. }, "frame 0 vertex 3");
    let text = whole.replace("property float x", "property double x");
    let path = folder.file("large.ply", text.replace("1 0 0\n", "1e300 0 0\n"));
    assert_refused!(refusal(&path), RecordingError::NotFinite { .. }, "frame 0 vertex 1");
}

#[test]
fn message_about_a_long_line_is_short() {
    let text = ply_header("ascii", 1, 1) + &"x".repeat(100_000);
    let error = Recording::from_ply_bytes(text.as_bytes(), Path::new("long.ply")).unwrap_err();
    assert!(error.to_string().len() < 500, "{}", error.to_string().len());
    let text = format!("v {}", "x".repeat(100_000));
    let error = Recording::from_obj_bytes(text.as_bytes(), Path::new("long.obj")).unwrap_err();
    assert!(error.to_string().len() < 500, "{}", error.to_string().len());
}

#[test]
fn bad_obj_is_refused_with_the_place() {
    let folder = Folder::new();
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let bad = |rest: &str| refusal(&folder.file("bad.obj", format!("{vertices}{rest}")));
    assert_refused!(
        bad("f 1 2 3\nf 1 2 4\n"),
        RecordingError::IndexOutOfRange { .. },
        "face 1",
        "vertex 4",
        "3 vertices"
    );
    assert_refused!(bad("f 1 2 3\nf 1 2 0\n"), RecordingError::IndexOutOfRange { .. }, "face 1", "vertex 0");
    assert_refused!(bad("f 1 2 -4\n"), RecordingError::IndexOutOfRange { .. }, "face 0", "vertex -4");
    for index in [i64::MAX, i64::MIN, 1 << 33] {
        assert_refused!(bad(&format!("f 1 2 {index}")), RecordingError::IndexOutOfRange { .. }, "face 0");
    }
    assert_refused!(bad("f 1 2 99999999999999999999"), RecordingError::Malformed { .. }, "line 4");
    assert_refused!(bad("f 1 2 /3"), RecordingError::Malformed { .. }, "line 4", "/3");
    assert_refused!(bad("f 1 2"), RecordingError::TooFewCorners { .. }, "face 0", "2 corners");
    assert_refused!(bad("f"), RecordingError::TooFewCorners { .. }, "0 corners");
    assert_refused!(bad("v 1 2\nf 1 2 3"), RecordingError::Malformed { .. }, "line 4", "coordinate");
    assert_refused!(bad("v 1 2 \\\n x\nf 1 2 3"), RecordingError::Malformed { .. }, "line 4", "`x`");
    for value in ["nan", "inf", "-infinity", "1e99"] {
        let error = bad(&format!("v 1 {value} 1\nf 1 2 3"));
        assert_refused!(error, RecordingError::NotFinite { .. }, "frame 0 vertex 3");
    }
    assert_refused!(bad(""), RecordingError::NoTriangles { .. }, "0 faces");
    let path = folder.file("prose.txt", "Nothing of this is a mesh.\n");
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. }, "0 vertices");
    let path = folder.file("faces.obj", "f 1 2 3\n");
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. }, "0 vertices");
}

#[test]
fn long_continued_obj_line_takes_linear_time() {
    let folder = Folder::new();
    let path = folder.file("continued.obj", "\\\n".repeat(1 << 20));
    assert_refused!(refusal(&path), RecordingError::NoTriangles { .. },);
}

#[test]
fn bad_recording_is_not_written() {
    let folder = Folder::new();
    let path = folder.0.join("unwritten.bin");
    let mesh = tetrahedron();
    let refused = |change: fn(&mut Recording)| {
        let mut mesh = mesh.clone();
        change(&mut mesh);
        let error = write_recording(&path, &mesh).unwrap_err();
        assert!(!path.exists());
        assert!(error.to_string().contains("unwritten.bin"), "{error}");
        error
    };
    assert_refused!(refused(|mesh| mesh.frames.clear()), RecordingError::NoFrames { .. },);
    assert_refused!(refused(|mesh| mesh.triangles.clear()), RecordingError::NoTriangles { .. },);
    assert_refused!(refused(|mesh| mesh.triangles[1][2] = 9), RecordingError::IndexOutOfRange { .. }, "face 1");
    assert_refused!(
        refused(|mesh| mesh.frames[1][0][0] = f32::NAN),
        RecordingError::NotFinite { .. },
        "frame 1 vertex 0"
    );
    assert_refused!(refused(|mesh| mesh.frames[1].truncate(3)), RecordingError::VertexCountDiffers { .. }, "frame 1");
    let path = folder.0.join("no_such_folder").join("unwritten.bin");
    assert_refused!(write_recording(&path, &mesh).unwrap_err(), RecordingError::Write { .. }, "unwritten.bin");
}

#[test]
fn recordings_folder_is_read() {
    let Some(folder) = recordings_folder() else {
        assert!(std::env::var_os(FOLDER_VARIABLE).is_none_or(|value| value.is_empty()));
        return;
    };
    let mut single = 0;
    let mut double = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if name.ends_with(".f64.bin") {
            read_f64_recording(&path).unwrap();
            double += 1;
        } else if name.matches('.').count() == 1 && name.ends_with(".bin") {
            let recording = read_recording(std::slice::from_ref(&path)).unwrap();
            assert_eq!(fs::read(&path).unwrap(), recording.to_bytes(&path).unwrap());
            single += 1;
        }
    }
    assert!(single > 0 && double > 0, "the folder has no recordings");
}

/// The result of a reader is an error, or a recording that satisfies the guarantees of its type.
fn assert_sound(result: Result<Recording, RecordingError>) {
    let Ok(recording) = result else { return };
    assert!(!recording.triangles.is_empty());
    assert!(!recording.frames.is_empty());
    let vertices = recording.frames[0].len();
    assert!(recording.triangles.iter().flatten().all(|&corner| (corner as usize) < vertices));
    for frame in &recording.frames {
        assert_eq!(frame.len(), vertices);
        assert!(frame.iter().flatten().all(|coordinate| coordinate.is_finite()));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(512) })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let name = Path::new("random");
        assert_sound(Recording::from_bytes(&bytes, name));
        assert_sound(Recording::from_ply_bytes(&bytes, name));
        assert_sound(Recording::from_obj_bytes(&bytes, name));
    }

    #[test]
    fn random_bytes_after_a_good_start_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let name = Path::new("random");
        let after = |start: Vec<u8>| [start, bytes.clone()].concat();
        assert_sound(Recording::from_bytes(&after(words(&[MAGIC])), name));
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let header = ply_header(format, 4, 2).into_bytes();
            assert_sound(Recording::from_ply_bytes(&after(header), name));
        }
        assert_sound(Recording::from_obj_bytes(&after(b"v 0 0 0\nf 1 1 1\nf ".to_vec()), name));
    }

    #[test]
    fn random_obj_text_never_panics(text in "([vf#\\\\] ?[-0-9 /.e\\\\]{0,12}\n){0,12}") {
        assert_sound(Recording::from_obj_bytes(text.as_bytes(), Path::new("random.obj")));
    }

    #[test]
    fn mutated_bin_never_panics(bytes in mutated(tetrahedron_bin())) {
        assert_sound(Recording::from_bytes(&bytes, Path::new("mutated.bin")));
    }

    #[test]
    fn mutated_ascii_ply_never_panics(bytes in mutated(ply_ascii(&tetrahedron(), 0).into_bytes())) {
        assert_sound(Recording::from_ply_bytes(&bytes, Path::new("mutated.ply")));
    }

    #[test]
    fn mutated_little_endian_ply_never_panics(bytes in mutated(ply_binary(&tetrahedron(), 0, true))) {
        assert_sound(Recording::from_ply_bytes(&bytes, Path::new("mutated.ply")));
    }

    #[test]
    fn mutated_big_endian_ply_never_panics(bytes in mutated(ply_binary(&tetrahedron(), 0, false))) {
        assert_sound(Recording::from_ply_bytes(&bytes, Path::new("mutated.ply")));
    }

    #[test]
    fn mutated_obj_never_panics(bytes in mutated(obj(&tetrahedron(), 0).into_bytes())) {
        assert_sound(Recording::from_obj_bytes(&bytes, Path::new("mutated.obj")));
    }
}
