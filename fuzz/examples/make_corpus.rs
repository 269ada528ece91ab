//! Writes the seeds of the corpus: `cargo run --package circumsphere_fuzz --example make_corpus`, from any folder.
//!
//! A seed is a small valid file of its format, or the bytes of a mesh that a target reads its numbers from. Inputs
//! found by a fuzzer are stored next to them under their own names, and are not touched.

use std::{error::Error, fs, path::Path};

use circumsphere_support::{
    recording::{MAGIC_F64, MAGIC_QUERIES, MAGIC_TRUTH, Recording},
    scenes::{Diagonals, Mesh, grid, icosphere},
};

/// A list of seeds: target, name, bytes.
type Seeds = Vec<(&'static str, String, Vec<u8>)>;

fn main() -> Result<(), Box<dyn Error>> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let mut seeds = Seeds::new();
    recordings(&mut seeds)?;
    texts(&mut seeds);
    queries(&mut seeds);
    meshes(&mut seeds);
    for (target, name, bytes) in seeds {
        let folder = corpus.join(target);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(name), bytes)?;
    }
    Ok(())
}

fn recording(mesh: Mesh, frames: usize) -> Result<Vec<u8>, Box<dyn Error>> {
    let recording = Recording { triangles: mesh.triangles, frames: vec![mesh.positions; frames] };
    Ok(recording.to_bytes(Path::new("seed"))?)
}

/// `.bin` files of a triangle, a sheet, and two frames of a ball, and the same in doubles.
fn recordings(seeds: &mut Seeds) -> Result<(), Box<dyn Error>> {
    let triangle =
        Mesh { positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], triangles: vec![[0, 1, 2]] };
    let sheet = grid(2, 2, 1.0, 1.0, Diagonals::Alternating);
    for (name, mesh, frames) in [("triangle", triangle, 1), ("sheet", sheet, 1), ("ball", icosphere(0, 1.0), 2)] {
        let single = recording(mesh.clone(), frames)?;
        let mut double = single[..16 + 12 * mesh.triangles.len()].to_vec();
        double[..4].copy_from_slice(&MAGIC_F64.to_le_bytes());
        for coordinate in std::iter::repeat_n(&mesh.positions, frames).flatten().flatten() {
            double.extend_from_slice(&f64::from(*coordinate).to_le_bytes());
        }
        seeds.push(("recording_f64", name.into(), double));
        // One file by its path: the number of files, the extension, and the length in two bytes.
        let length = u16::try_from(single.len())?.to_le_bytes();
        seeds.push(("recording_files", name.into(), [&[1, 0, length[0], length[1]][..], &single].concat()));
        seeds.push(("recording_bin", name.into(), single));
    }
    Ok(())
}

const PLY: &str = "ply\nformat ascii 1.0\ncomment a sheet\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 1e-3 9\n4 0 1 2 3\n";

const OBJ: &str = "# a sheet\no sheet\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 \\\n 0\nv 0 1 1e-3\nvt 0 0\nvn 0 0 1\n\
    f 1/1/1 2/1/1 3//1\nf -4 -2 -1\n";

/// PLY in its three encodings, OBJ, and two of them as the frames of one recording.
fn texts(seeds: &mut Seeds) {
    seeds.push(("recording_ply", "ascii".into(), PLY.into()));
    for (name, encoding, is_little) in [("little", "binary_little_endian", true), ("big", "binary_big_endian", false)] {
        let mut bytes = format!(
            "ply\nformat {encoding} 1.0\nelement vertex 3\nproperty double x\nproperty float y\nproperty float z\n\
             element edge 1\nproperty list uchar short ends\nelement face 1\nproperty list uint ushort vertex_index\n\
             end_header\n"
        )
        .into_bytes();
        let mut push = |little: &[u8]| {
            if is_little {
                bytes.extend(little);
            } else {
                bytes.extend(little.iter().rev());
            }
        };
        for [x, y, z] in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]] {
            push(&f64::from(x).to_le_bytes());
            push(&y.to_le_bytes());
            push(&z.to_le_bytes());
        }
        push(&[2]);
        push(&0u16.to_le_bytes());
        push(&1u16.to_le_bytes());
        push(&3u32.to_le_bytes());
        for corner in [0u16, 1, 2] {
            push(&corner.to_le_bytes());
        }
        seeds.push(("recording_ply", name.into(), bytes));
    }
    seeds.push(("recording_obj", "sheet".into(), OBJ.into()));
    seeds.push(("recording_obj", "words".into(), b"v nan 1e400 -0\nf 1 1 1 99999999999\nf 0 1 2\n\\\n\\".to_vec()));
    let file = |extension: u8, text: &str| {
        [&[extension, text.len() as u8, (text.len() >> 8) as u8][..], text.as_bytes()].concat()
    };
    seeds.push(("recording_files", "ply_and_obj".into(), [&[2][..], &file(1, PLY), &file(2, OBJ)].concat()));
    seeds.push(("recording_files", "obj_twice".into(), [&[2][..], &file(2, OBJ), &file(5, OBJ)].concat()));
}

/// Both kinds of files for continuous collision detection.
fn queries(seeds: &mut Seeds) {
    let header = |magic: u32, kind: u32, count: u32| [magic, kind, count, 0].map(u32::to_le_bytes).concat();
    for (name, kind) in [("vertex_face", 0), ("edge_edge", 1)] {
        let points = (0..24).flat_map(|k| (f64::from(k) / 8.0).to_le_bytes());
        seeds.push((
            "ccd_queries",
            name.into(),
            header(MAGIC_QUERIES, kind, 1).into_iter().chain(points).chain([1]).collect(),
        ));
        let indices = [0u32, 1, 2, 3, 4, 5, 6, 7].map(u32::to_le_bytes).concat();
        seeds.push((
            "impact_truth",
            name.into(),
            header(MAGIC_TRUTH, kind, 2).into_iter().chain(indices).chain([0, 1]).collect(),
        ));
    }
}

/// Meshes in the encodings of the kernel's and the plugin's targets, with every kind of coordinates.
fn meshes(seeds: &mut Seeds) {
    // One byte each, multiples of an eighth. Two tetrahedra that pass through each other.
    let corners = [[0i8, 0, 0], [16, 0, 0], [0, 16, 0], [0, 0, 16], [4, 4, 4], [20, 4, 4], [4, 20, 4], [4, 4, 20]];
    let eighths: Vec<u8> = corners.iter().flatten().map(|&coordinate| coordinate as u8).collect();
    let bits: Vec<u8> =
        corners.iter().flatten().flat_map(|&coordinate| (f32::from(coordinate) / 8.0).to_le_bytes()).collect();
    let near: Vec<u8> = corners.iter().flatten().flat_map(|&coordinate| [coordinate as u8, coordinate as u8]).collect();
    // Exponents from 2^-64 to 2^63, signs, and fractions.
    let magnitudes: Vec<u8> = (0..48u8).map(|k| k.wrapping_mul(37)).collect();
    let ways = [("bits", 0u8, &bits), ("eighths", 1, &eighths), ("near", 2, &near), ("magnitudes", 3, &magnitudes)];
    // The triangles 0 2 1, 0 1 3, 1 2 3, and 0 3 2, as offsets from indices without common vertices.
    let tetrahedron = [0, 1, 3, 1, 1, 2, 3, 3, 3, 3, 1, 3u8];
    for (name, way, points) in ways {
        let half = points.len() / 2;
        let surface = |points: &[u8]| [&[3, 1, 0][..], &tetrahedron, points].concat();
        for (kind, flags) in [("between", 0b0101_0100u8), ("self", 0b0000_0001)] {
            let both = [&[flags, 16, way][..], &surface(&points[..half]), &surface(&points[half..])].concat();
            seeds.push(("narrow_phase", format!("{name}_{kind}"), both));
        }
        let spheres = [&[0, 8, 8, 4, way][..], &surface(&points[..half]), &[way], &points[half..]].concat();
        seeds.push(("spheres", name.into(), spheres));
        // Flags, the numbers of vertices and triangles, indices, coordinates, the method, then the positions of later
        // ticks.
        let indices = [0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2, 4, 5, 6, 4, 7, 5, 4, 6, 7, 5, 7, 6u8];
        for (method, flags) in [(0, 0b0001_0000), (1, 0b0011_0000), (2, 0b0111_0000), (3, 0b1001_0000u8)] {
            let world = [&[flags, 8, 8][..], &indices, &[way], points, &[method, way], points].concat();
            seeds.push(("surfaces", format!("{name}_{method}"), world));
        }
    }
}
