//! The replay program as users call it: its output, and the errors it reports.
//!
//! Each call is a separate process, so that every number of threads has its own task pool.

use circumsphere_support::{
    programs::{self, Folder},
    recording::{Recording, write_recording},
    scenes::{BALL_TRIANGLES, CLOTH_TRIANGLES, FRAMES, Mesh, TORUS_TRIANGLES, cuboid, icosphere, merge},
};
use circumsphere_truth::{compare, exact_weld, mean_edge_length, touching_pairs_tree};
use glam::{DVec3, Vec3};
use std::{fmt::Write, fs, path::Path};

fn succeed(arguments: &[&str]) -> String {
    programs::succeed("replay", arguments)
}

/// The program must exit with code 2 and a message that contains all of `parts`.
fn refuse(arguments: &[&str], parts: &[&str]) {
    programs::refuse("replay", arguments, parts);
}

/// Three moving bodies: two spheres that push into each other, and a box nearby.
fn recording() -> Recording {
    let frame = |push: f32| {
        merge(&[
            icosphere(3, 1.0),
            icosphere(2, 0.7).translate([1.9 - push, 0.1, 0.0]),
            cuboid([0.4, 0.4, 0.4], 4).translate([0.0, 1.43, 0.05]),
        ])
    };
    let meshes: Vec<Mesh> = [0.1, 0.25, 0.4, 0.6].map(frame).into();
    Recording {
        triangles: meshes[0].triangles.clone(),
        frames: meshes.into_iter().map(|mesh| mesh.positions).collect(),
    }
}

/// Writes the scene into a folder and returns its path.
fn written(folder: &Folder) -> String {
    let path = folder.path("scene.bin");
    write_recording(Path::new(&path), &recording()).expect("the scene can be written");
    path
}

/// Announces eight billion elements in a few bytes.
const LYING_PLY: &str = "ply
format binary_little_endian 1.0
element vertex 4000000000
property float x
property float y
property float z
element face 4000000000
property list uchar int vertex_indices
end_header
abc";

type Row = (usize, u32, u32, f64);

fn read_pairs(path: &str) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(path).expect("the pairs were written");
    assert_eq!(reader.headers().expect("there is a header"), vec!["frame", "triangle_a", "triangle_b", "distance"]);
    reader.deserialize().map(|row| row.expect("every row has four numbers")).collect()
}

fn wide(frame: &[[f32; 3]]) -> Vec<DVec3> {
    frame.iter().map(|&position| Vec3::from_array(position).as_dvec3()).collect()
}

#[test]
fn the_embedded_scene_runs_without_arguments_and_touches() {
    let table = succeed(&[]);
    for part in ["the embedded scene", "broad phase", "exact", "total", "contacts:"] {
        assert!(table.contains(part), "{part} is missing:\n{table}");
    }
    let folder = Folder::new();
    let pairs = folder.path("pairs.csv");
    succeed(&["--pairs", &pairs]);

    // Anyone who runs the program for the first time should see contacts of every kind, in nearly every frame.
    let part = |triangle: u32| {
        let parts = [CLOTH_TRIANGLES, BALL_TRIANGLES, TORUS_TRIANGLES];
        parts.into_iter().position(|part| part.contains(&(triangle as usize))).expect("every triangle has a part")
    };
    let mut counts = vec![[0; 3]; FRAMES];
    for (frame, a, b, _) in read_pairs(&pairs) {
        // The ball and the ring do not touch each other or themselves.
        assert!(part(a).min(part(b)) == 0, "frame {frame}: {a} and {b}");
        counts[frame][part(a).max(part(b))] += 1;
    }
    for (kind, (name, least)) in [("cloth", 60), ("ball", 60), ("ring", 80)].into_iter().enumerate() {
        let frames = counts.iter().filter(|counts| counts[kind] > 0).count();
        assert!(frames > least, "the cloth touches the {name} in {frames} frames only");
    }
    let mut pairs: Vec<i32> = counts.iter().map(|counts| counts.iter().sum()).collect();
    pairs.sort_unstable();
    assert!(pairs[FRAMES - 100] > 0 && pairs[FRAMES / 2] > 100, "{pairs:?}");
}

#[test]
fn pairs_are_those_of_the_reference_for_every_way_to_find_them() {
    let (folder, recording) = (Folder::new(), recording());
    let (input, pairs) = (written(&folder), folder.path("pairs.csv"));
    let rest = wide(&recording.frames[0]);
    let weld = exact_weld(&rest);
    let distance = 0.3 * mean_edge_length(&rest, &recording.triangles, &weld);
    let mut matched = 0;
    let ways: [&[&str]; 9] = [
        &["--contact-distance-edges", "0.3"],
        &["--contact-distance-edges", "0.3", "--surfaces", "components"],
        &["--contact-distance-edges", "0.3", "--broad-phase", "brute-force"],
        &["--contact-distance-edges", "0.3", "--broad-phase", "spatial-hash", "--surfaces", "components"],
        &["--contact-distance-edges", "0.3", "--broad-phase", "hierarchical-hash", "--threads", "2"],
        &["--contact-distance-edges", "0.3", "--method", "polygon", "--surfaces", "components"],
        &["--contact-distance-edges", "0.3", "--threads", "3", "--repeat", "2"],
        &["--contact-distance-edges", "0.3", "--warm", "--repeat", "3"],
        &["--contact-distance", &distance.to_string()],
    ];
    let mut first: Option<Vec<Row>> = None;
    for way in ways {
        succeed(&[&[input.as_str(), "--pairs", &pairs], way].concat());
        let rows = read_pairs(&pairs);
        assert!(rows.is_sorted_by(|a, b| (a.0, a.1, a.2) < (b.0, b.1, b.2)), "{way:?}: rows are sorted and unique");
        assert!(rows.iter().all(|row| row.1 < row.2), "{way:?}: the lower triangle comes first");
        for (frame, positions) in recording.frames.iter().enumerate() {
            let truth = touching_pairs_tree(&wide(positions), &recording.triangles, &weld, distance * 1.0002);
            let found: Vec<(u32, u32, f64)> =
                rows.iter().filter(|row| row.0 == frame).map(|&(_, a, b, distance)| (a, b, distance)).collect();
            let comparison = compare(&found, &truth, distance, 1.0e-4);
            assert!(comparison.missed.is_empty() && comparison.false_pairs.is_empty(), "{way:?} frame {frame}");
            assert!(comparison.worst_distance_error <= 1.0e-5 * distance, "{way:?} frame {frame}");
            matched += comparison.matched;
        }
        let first = first.get_or_insert_with(|| rows.clone());
        let same = first.len() == rows.len()
            && first.iter().zip(&rows).all(|(a, b)| (a.0, a.1, a.2) == (b.0, b.1, b.2) && (a.3 - b.3).abs() <= 1.0e-12);
        assert!(same, "{way:?} finds different pairs than {:?}", ways[0]);
    }
    assert!(matched > 1000, "only {matched} pairs were compared");
}

#[test]
fn files_of_single_frames_equal_one_recording() {
    let (folder, recording) = (Folder::new(), recording());
    let input = written(&folder);
    let expected = folder.path("expected.csv");
    succeed(&[&input, "--pairs", &expected]);
    let frames = recording.frames.iter().enumerate();
    let ply: Vec<String> = frames
        .clone()
        .map(|(frame, positions)| {
            let mut text = format!(
                "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
                 element face {}\nproperty list uchar int vertex_indices\nend_header\n",
                positions.len(),
                recording.triangles.len()
            );
            for [x, y, z] in positions {
                writeln!(text, "{x:?} {y:?} {z:?}").expect("a string takes anything");
            }
            for [a, b, c] in &recording.triangles {
                writeln!(text, "3 {a} {b} {c}").expect("a string takes anything");
            }
            folder.with(&format!("frame{frame}.ply"), text)
        })
        .collect();
    let obj: Vec<String> = frames
        .map(|(frame, positions)| {
            let mut text = String::new();
            for [x, y, z] in positions {
                writeln!(text, "v {x:?} {y:?} {z:?}").expect("a string takes anything");
            }
            for [a, b, c] in &recording.triangles {
                writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).expect("a string takes anything");
            }
            folder.with(&format!("frame{frame}.obj"), text)
        })
        .collect();
    let expected = fs::read(expected).expect("the pairs were written");
    assert!(expected.len() > 1000);
    for files in [ply, obj] {
        let pairs = folder.path("pairs.csv");
        let arguments: Vec<&str> = files.iter().map(String::as_str).chain(["--pairs", &pairs]).collect();
        succeed(&arguments);
        assert!(fs::read(&pairs).expect("the pairs were written") == expected, "{files:?} give different pairs");
    }
}

#[test]
fn contacts_lie_on_their_pairs_and_join_the_points_they_state() {
    let (folder, recording) = (Folder::new(), recording());
    let input = written(&folder);
    for surfaces in ["whole", "components"] {
        let (pairs, contacts) = (folder.path("pairs.csv"), folder.path("contacts.csv"));
        succeed(&[&input, "--surfaces", surfaces, "--pairs", &pairs, "--contacts", &contacts]);
        let touching: std::collections::HashSet<(usize, u32, u32)> =
            read_pairs(&pairs).iter().map(|row| (row.0, row.1, row.2)).collect();
        let mut reader = csv::Reader::from_path(&contacts).expect("the contacts were written");
        let columns = reader.headers().expect("there is a header").clone();
        let mut count = 0;
        for row in reader.records() {
            let row = row.expect("every row is complete");
            let text = |name: &str| &row[columns.iter().position(|column| column == name).expect("the column exists")];
            let number = |name: &str| text(name).parse::<f64>().expect("a number");
            let whole = |name: &str| text(name).parse::<u32>().expect("a whole number");
            let vector = |name: &str| DVec3::from_array(["x", "y", "z"].map(|axis| number(&format!("{name}_{axis}"))));
            let weights = |name: &str| [0, 1, 2].map(|k| number(&format!("{name}_{k}")));
            let (frame, a, b) = (whole("frame") as usize, whole("triangle_a"), whole("triangle_b"));
            assert!(touching.contains(&(frame, a, b)), "{row:?} does not belong to a touching pair");
            let point = |triangle: u32, weights: [f64; 3]| {
                recording.triangles[triangle as usize]
                    .iter()
                    .zip(weights)
                    .map(|(&vertex, weight)| {
                        Vec3::from_array(recording.frames[frame][vertex as usize]).as_dvec3() * weight
                    })
                    .sum::<DVec3>()
            };
            // Points and barycentric weights are stored in f32, at coordinates of about 2.
            let tolerance = 1.0e-6;
            assert!(point(a, weights("barycentric_a")).distance(vector("point_a")) < tolerance, "{row:?}");
            assert!(point(b, weights("barycentric_b")).distance(vector("point_b")) < tolerance, "{row:?}");
            let along = (vector("point_b") - vector("point_a")).dot(vector("normal"));
            assert!((along - number("distance")).abs() < tolerance, "{row:?}");
            assert!(number("separation") <= tolerance, "{row:?}");
            let names = [text("feature_a"), text("feature_b")];
            assert!(names.iter().all(|name| name.starts_with(['v', 'e', 'f'])), "{row:?}");
            count += 1;
        }
        assert!(count > 200, "only {count} contacts");
    }
}

#[test]
fn smooth_contacts_are_other_contacts_and_balls_refuse_them() {
    let folder = Folder::new();
    let (input, json) = (written(&folder), folder.path("report.json"));
    let [flat, smooth] = [&[][..], &["--smooth"][..]].map(|option| {
        let contacts = folder.path("contacts.csv");
        let mut arguments = vec![input.as_str(), "--json", &json, "--contacts", &contacts];
        arguments.extend(option);
        succeed(&arguments);
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(&json).expect("the report was written")).expect("it is JSON");
        assert_eq!(report["settings"]["smooth"], !option.is_empty());
        fs::read_to_string(&contacts).expect("the contacts were written")
    });
    assert!(smooth.lines().count() > 100);
    assert_ne!(flat, smooth);
}

#[test]
fn json_holds_what_was_asked_and_measured() {
    let folder = Folder::new();
    let (input, json) = (written(&folder), folder.path("report.json"));
    for method in ["bounding-sphere", "circumsphere", "exact", "polygon"] {
        let arguments =
            [&input, "--json", &json, "--method", method, "--frames", "1..3", "--repeat", "3", "--threads", "2"];
        succeed(&arguments);
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(&json).expect("the report was written")).expect("it is JSON");
        assert_eq!(report["input"], input.as_str());
        assert_eq!(report["settings"]["method"], method);
        assert_eq!(report["triangles"], recording().triangles.len());
        assert_eq!(report["vertices"], recording().frames[0].len());
        assert_eq!(report["threads"], 2);
        assert!(report["build_ms"].as_f64().expect("a time") > 0.0);
        assert!(!cfg!(target_os = "linux") || report["peak_bytes"].as_u64().expect("a size") > 1_000_000);
        let frames = report["frames"].as_array().expect("a list");
        assert_eq!(frames.iter().map(|frame| frame["frame"].as_u64().expect("a number")).collect::<Vec<_>>(), [1, 2]);
        for frame in frames {
            let stages = frame["stages"].as_array().expect("a list");
            let sum: f64 = stages.iter().map(|stage| stage["ms"].as_f64().expect("a time")).sum();
            let total = frame["detect_ms"].as_f64().expect("a time");
            // The stages' share has no lower bound: on a busy machine, the scheduler may take any share of such a short
            // time.
            assert!(sum > 0.0 && total > 0.0, "{method}: the stages take {sum} of {total} ms");
            assert!(
                stages.iter().all(|stage| stage["in"].is_u64() && stage["out"].is_u64() && stage["name"].is_string())
            );
            assert!(frame["pairs"].as_u64().expect("a number") > 0, "{method} finds nothing");
            assert!(frame["contacts"].as_u64().expect("a number") > 0, "{method} finds nothing");
            let refreshed = frame["recipes_refreshed"].as_u64().expect("a number");
            assert_eq!(
                refreshed > 0,
                method == "circumsphere" && frame["frame"] == 1,
                "{method}: {refreshed} refreshed"
            );
        }
    }
}

#[test]
fn contacts_are_the_same_for_any_number_of_threads() {
    let folder = Folder::new();
    let input = written(&folder);
    for method in ["circumsphere", "exact"] {
        let outputs: Vec<Vec<u8>> = ["1", "2", "5"]
            .iter()
            .map(|threads| {
                let contacts = folder.path("contacts.csv");
                // Half an edge gives lists long enough for several chunks.
                let arguments = [
                    input.as_str(),
                    "--threads",
                    threads,
                    "--method",
                    method,
                    "--contacts",
                    &contacts,
                    "--contact-distance-edges",
                    "1.5",
                ];
                succeed(&arguments);
                fs::read(contacts).expect("the contacts were written")
            })
            .collect();
        assert!(outputs[0].len() > 100_000, "{method}: too few contacts to need several chunks");
        assert!(
            outputs.iter().all(|output| *output == outputs[0]),
            "{method}: the contacts differ between thread counts"
        );
    }
}

#[test]
fn bad_files_are_refused_with_their_name_and_the_problem() {
    let folder = Folder::new();
    let good = fs::read(written(&folder)).expect("the scene was written");
    let header = |words: [u32; 4]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let magic = 0x4D53_4851;
    let mut wrong_index = good.clone();
    wrong_index[16..20].copy_from_slice(&u32::MAX.to_le_bytes());
    let mut not_a_number = good.clone();
    let last = not_a_number.len() - 4;
    not_a_number[last..].copy_from_slice(&f32::NAN.to_le_bytes());

    let cases = [
        folder.with("truncated.bin", &good[..good.len() - 7]),
        folder.with("longer.bin", [&good[..], &[0; 5]].concat()),
        folder.with("lying.bin", header([magic, u32::MAX, u32::MAX, u32::MAX])),
        folder.with("short.bin", &good[..9]),
        folder.with("no_frames.bin", header([magic, 3, 0, 0])),
        folder.with("magic.bin", header([7, 1, 1, 1])),
        folder.with("index.bin", wrong_index),
        folder.with("nan.bin", not_a_number),
        folder.with("empty.bin", []),
        folder.with("empty.ply", []),
        folder.with("text.obj", "this is no mesh\n"),
        folder.with("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        folder.with("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        folder.with("lying.ply", LYING_PLY),
        folder.path("missing.bin"),
        folder.path(""),
    ];
    for path in &cases {
        let name = Path::new(path).file_name().expect("every case has a name").to_string_lossy();
        refuse(&[path], &[&name]);
    }

    let triangle = folder.with("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let more_vertices = folder.with("b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n");
    let other_face = folder.with("c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 3 2\n");
    refuse(&[&triangle, &more_vertices], &["b.obj"]);
    refuse(&[&triangle, &other_face], &["c.obj"]);
    let recording = written(&folder);
    refuse(&[&recording, &triangle], &["bin"]);
    refuse(&[&recording, &recording], &["bin"]);
}

#[test]
fn bad_options_are_refused() {
    let folder = Folder::new();
    let input = written(&folder);
    refuse(&[&input, "--frames", "2..9"], &["2..9", "0..4"]);
    refuse(&[&input, "--frames", "3..3"], &["3..3"]);
    refuse(&[&input, "--frames", "a..b"], &["a"]);
    refuse(&[&input, "--contact-distance", "nan"], &["--contact-distance"]);
    refuse(&[&input, "--contact-distance=-1"], &["--contact-distance"]);
    refuse(&[&input, "--contact-distance", "1", "--contact-distance-edges", "1"], &["--contact-distance"]);
    refuse(&[&input, "--threads", "0"], &["--threads"]);
    refuse(&[&input, "--repeat", "0"], &["--repeat"]);
    refuse(&[&input, "--method", "guess"], &["guess", "exact"]);
    refuse(&[&input, "--curvature-threshold", "0"], &["--curvature-threshold"]);
    refuse(&[&input, "--pairs", &folder.path("no/such/folder/pairs.csv")], &["pairs.csv"]);
}
