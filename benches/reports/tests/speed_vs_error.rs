//! Runs the program `speed_vs_error` as a user would: its output must be complete and correct, and bad input must be
//! refused.

use circumsphere_reports::statistics::{Spread, log_slope, mean, median, pareto_front};
use circumsphere_support::{
    programs::example_program,
    recording::{Recording, write_recording},
    scenes::{Fineness, MOVING_SCENES, icosphere, merge, moving_scene},
};
use circumsphere_truth::{exact_weld, mean_edge_length, touching_pairs_between_brute_force};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use std::{
    collections::BTreeSet,
    fs,
    io::BufReader,
    path::Path,
    process::{Command, Output},
};

const CLOTH_FALL: &[u8] = include_bytes!("../../../assets/cloth_fall.bin");

const TABLES: [&str; 5] = ["measures.csv", "stages.csv", "pooled.csv", "scaling.csv", "sliding.csv"];
const PLOTS: [&str; 7] = [
    "speed_vs_error",
    "speed_vs_error_by_scene",
    "error_vs_phi",
    "error_vs_curvature",
    "error_vs_delta",
    "time_vs_triangles",
    "time_by_stage",
];
/// Columns that hold text. All others hold numbers or are empty.
const WORDS: [&str; 10] = [
    "scene",
    "configuration",
    "method",
    "estimator",
    "plane_cull",
    "widen_cones",
    "stage",
    "ground",
    "body",
    "normals",
];

fn report(arguments: &[&str]) -> Output {
    Command::new(example_program("speed_vs_error")).args(arguments).output().expect("the program starts")
}

fn succeed(arguments: &[&str]) {
    let output = report(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The program must exit with code 2 and print a message that contains all of `parts`.
fn refuse(arguments: &[&str], parts: &[&str]) {
    let output = report(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(!message.contains("panicked"), "{arguments:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?} does not name {part:?}: {message}");
    }
}

/// A CSV table as text.
struct Csv {
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Csv {
    fn read(path: &Path) -> Self {
        let mut reader = csv::Reader::from_path(path).expect("the table was written");
        let columns = reader.headers().expect("there is a header").iter().map(str::to_owned).collect();
        let rows = reader.records().map(|row| row.expect("the row is whole").iter().map(str::to_owned).collect());
        Self { columns, rows: rows.collect() }
    }

    fn text<'a>(&self, row: &'a [String], column: &str) -> &'a str {
        &row[self.columns.iter().position(|name| name == column).unwrap_or_else(|| panic!("no column {column}"))]
    }

    fn number(&self, row: &[String], column: &str) -> f64 {
        let text = self.text(row, column);
        text.parse().unwrap_or_else(|_| panic!("{column} holds {text:?}"))
    }

    /// Panics at the first cell that differs between the two tables, except for times.
    fn assert_same_but_for_times(&self, other: &Self, name: &str) {
        assert_eq!((&self.columns, self.rows.len()), (&other.columns, other.rows.len()), "{name}");
        let has_time = self.columns.iter().any(|column| column.starts_with("time"));
        assert_eq!(has_time, name != "sliding.csv", "{name}");
        for (row, other) in self.rows.iter().zip(&other.rows) {
            for (column, (cell, other)) in self.columns.iter().zip(row.iter().zip(other)) {
                assert!(
                    cell == other || column.starts_with("time"),
                    "{name}: {column} is {cell} and {other} in {row:?}"
                );
            }
        }
    }
}

/// The number of different colors in a PNG, and the share of pixels that do not have the most common color.
fn colors(path: &Path) -> (usize, f64) {
    let file = fs::File::open(path).expect("the plot was written");
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().expect("it is a PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("it is no larger than memory")];
    let frame = reader.next_frame(&mut bytes).expect("it decodes");
    assert!(frame.width >= 1000 && frame.height >= 800, "{} is {} by {}", path.display(), frame.width, frame.height);
    let samples = frame.color_type.samples();
    let mut counts = std::collections::HashMap::new();
    for pixel in bytes[..frame.buffer_size()].chunks(samples) {
        *counts.entry(pixel).or_insert(0_usize) += 1;
    }
    let pixels: usize = counts.values().sum();
    let commonest = counts.values().max().expect("there are pixels");
    (counts.len(), 1.0 - *commonest as f64 / pixels as f64)
}

#[test]
fn a_report_is_whole_right_for_exact_methods_and_the_same_twice() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let (first, second) = (folder.path().join("first/deeper"), folder.path().join("second"));
    for out in [&first, &second] {
        succeed(&["--smoke", "--out", &out.display().to_string()]);
    }

    let report = fs::read_to_string(first.join("report.md")).expect("the report was written");
    assert!(report.contains("cargo run --release --example speed_vs_error -- --smoke"));
    assert!(!report.contains(&folder.path().display().to_string()), "the report must not contain local paths");
    for plot in PLOTS {
        assert!(report.contains(&format!("({plot}.png)")) && report.contains(&format!("({plot}.svg)")), "{plot}");
        let svg = fs::read_to_string(first.join(format!("{plot}.svg"))).expect("the plot was written");
        assert!(svg.trim_end().ends_with("</svg>") && svg.contains("<text"), "{plot}.svg");
        let (colors, drawn) = colors(&first.join(format!("{plot}.png")));
        assert!(colors > 20 && drawn > 0.01, "{plot}.png has {colors} colors, {drawn} of it drawn");
    }
    for table in TABLES {
        let (one, other) = (Csv::read(&first.join(table)), Csv::read(&second.join(table)));
        assert!(!one.rows.is_empty(), "{table} is empty");
        for row in &one.rows {
            for (column, cell) in one.columns.iter().zip(row) {
                let is_right = if WORDS.contains(&column.as_str()) {
                    true
                } else {
                    cell.is_empty() || cell.parse::<f64>().is_ok_and(f64::is_finite)
                };
                assert!(is_right, "{table}: {column} holds {cell:?}");
            }
        }
        one.assert_same_but_for_times(&other, table);
    }

    let measures = Csv::read(&first.join("measures.csv"));
    let scenes: BTreeSet<&str> = measures.rows.iter().map(|row| measures.text(row, "scene")).collect();
    assert_eq!(scenes, BTreeSet::from(MOVING_SCENES));
    let (mut exact, mut errors_of_spheres) = (0.0, [0.0; 2]);
    for row in &measures.rows {
        let number = |column: &str| measures.number(row, column);
        let what = (measures.text(row, "scene"), measures.text(row, "configuration"));
        let [missed, made_up] = [number("missed_pairs"), number("false_pairs")];
        let matched = number("true_pairs") - missed;
        let (found, band) = (number("found_pairs"), number("band_pairs"));
        assert!(matched + made_up <= found && found <= matched + made_up + band, "{what:?}: counts do not add up");
        if ["Closest", "Exact", "Polygon"].contains(&measures.text(row, "method")) {
            assert_eq!([missed, made_up], [0.0, 0.0], "{what:?}");
            assert!(number("separation_error_max") <= 1.0e-5, "{what:?}");
            assert!(number("true_pairs") >= 20.0, "{what:?} has too few touching pairs");
            exact += number("true_pairs");
        } else {
            errors_of_spheres[0] += missed;
            errors_of_spheres[1] += made_up;
        }
    }
    // Check that the comparison can find errors: spheres make both kinds.
    assert!(exact > 2_000.0 && errors_of_spheres.iter().all(|&count| count > 100.0), "{exact}, {errors_of_spheres:?}");
}

#[test]
fn true_pairs_are_those_of_brute_force() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let out = folder.path().display().to_string();
    succeed(&["--smoke", "--scenes", "soft_spheres", "--distances", "0.1,0.4", "--frames", "3", "--out", &out]);
    let measures = Csv::read(&folder.path().join("measures.csv"));
    let scene = moving_scene("soft_spheres", Fineness::Coarse, 3, CLOTH_FALL).expect("no file is read").expect("known");
    let wide = |body: usize, tick: usize| -> Vec<DVec3> {
        scene.bodies[body].ticks[tick].iter().map(|&position| Vec3::from_array(position).as_dvec3()).collect()
    };
    let edges = [0, 1].map(|body| {
        let rest = wide(body, 0);
        mean_edge_length(&rest, &scene.bodies[body].triangles, &exact_weld(&rest))
    });
    for edge_count in [0.1, 0.4] {
        let distance = edge_count * edges[0].min(edges[1]);
        let expected: usize = (0..3)
            .map(|tick| {
                let [a, b] = [0, 1].map(|body| (wide(body, tick), &scene.bodies[body].triangles));
                // No pair lies within the band of one part in ten thousand, so the lower and upper limits agree.
                let count = |distance| touching_pairs_between_brute_force(&a.0, a.1, &b.0, b.1, distance).len();
                assert_eq!(count(distance * (1.0 - 1.1e-4)), count(distance * (1.0 + 1.1e-4)));
                count(distance)
            })
            .sum();
        assert!(expected > 50, "too few pairs touch");
        let rows = measures.rows.iter().filter(|row| measures.number(row, "contact_distance_edges") == edge_count);
        let counts: Vec<f64> = rows.map(|row| measures.number(row, "true_pairs")).collect();
        assert!(counts.len() >= 4 && counts.iter().all(|&count| count == expected as f64), "{counts:?}, {expected}");
    }
}

#[test]
fn a_folder_of_recordings_is_measured_as_it_lies_there() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let (input, out) = (folder.path().join("input"), folder.path().join("out"));
    fs::create_dir(&input).expect("a folder can be made");
    let frame = |push: f32| merge(&[icosphere(2, 1.0), icosphere(2, 0.7).translate([1.75 - push, 0.1, 0.0])]);
    let frames = [0.1, 0.2, 0.3, 0.4].map(frame);
    let recording = Recording {
        triangles: frames[0].triangles.clone(),
        frames: frames.into_iter().map(|mesh| mesh.positions).collect(),
    };
    write_recording(&input.join("balls.bin"), &recording).expect("the recording can be written");
    fs::write(input.join("balls.f64.bin"), "answers and doubles are not recordings").expect("a file can be written");
    fs::write(input.join("README.md"), "neither is text").expect("a file can be written");
    fs::write(
        input.join("two.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0.01\nv 1 0 0.01\nv 0 1 0.01\nf 1 2 3\nf 4 5 6\n",
    )
    .expect("a file can be written");

    succeed(&["--smoke", &input.display().to_string(), "--out", &out.display().to_string()]);
    let measures = Csv::read(&out.join("measures.csv"));
    let mut of_scene = std::collections::BTreeMap::new();
    for row in measures.rows.iter().filter(|row| measures.text(row, "configuration") == "Exact") {
        let number = |column: &str| measures.number(row, column);
        assert_eq!([number("missed_pairs"), number("false_pairs")], [0.0, 0.0]);
        of_scene.insert(measures.text(row, "scene"), [number("ticks"), number("true_pairs")]);
    }
    assert_eq!(of_scene.keys().copied().collect::<Vec<_>>(), ["balls", "two"]);
    // By default, three of the four frames are measured. Two parallel triangles are one pair.
    assert!(of_scene["balls"][0] == 3.0 && of_scene["balls"][1] > 20.0, "{of_scene:?}");
    assert_eq!(of_scene["two"], [1.0, 1.0]);
    assert!(
        !out.join("scaling.csv").exists() && !out.join("sliding.csv").exists(),
        "generated meshes must not be measured"
    );
}

#[test]
fn bad_input_is_refused_with_its_name_and_the_problem() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::create_dir(path("empty")).expect("a folder can be made");
    fs::create_dir(path("broken")).expect("a folder can be made");
    fs::write(path("broken/lying.bin"), [0x51, 0x48, 0x53, 0x4D, 9, 0, 0, 0]).expect("a file can be written");
    fs::write(path("file"), "a file").expect("a file can be written");
    let out = path("out");

    refuse(&[&path("missing"), "--out", &out], &["missing"]);
    refuse(&[&path("file"), "--out", &out], &["file"]);
    refuse(&[&path("empty"), "--out", &out], &["empty", ".bin"]);
    refuse(&[&path("broken"), "--out", &out], &["lying.bin"]);
    refuse(&[&path("broken"), "--scenes", "other", "--out", &out], &["other"]);
    refuse(&["--smoke", "--out", &path("file/below")], &["below"]);
    refuse(&["--scenes", "cloth_over_bell", "--out", &out], &["cloth_over_bell", "cloth_over_ball"]);
    refuse(&["--distances", "0.1,0", "--out", &out], &["--distances", "0"]);
    refuse(&["--distances", "nan", "--out", &out], &["--distances"]);
    refuse(&["--frames", "0", "--out", &out], &["--frames"]);
    refuse(&["--sphere-offset", "1"], &["--sphere-offset"]);
    assert!(!Path::new(&out).exists(), "a refused run must write nothing");
}

#[test]
fn the_slope_of_a_power_is_its_exponent() {
    for exponent in [0.5, 1.0, 1.75] {
        let points: Vec<(f64, f64)> = [1.0e3, 3.0e3, 1.0e4, 1.0e6].map(|n: f64| (n, 0.02 * n.powf(exponent))).into();
        let slope = log_slope(&points).expect("there are points");
        // Four logarithms and their differences, each accurate to a few 1e-16.
        assert!((slope - exponent).abs() < 1.0e-12, "{slope} instead of {exponent}");
    }
    assert_eq!(log_slope(&[(10.0, 1.0)]), None);
    assert_eq!(log_slope(&[]), None);
}

#[test]
fn medians_and_percentiles_are_those_of_a_hundred_numbers() {
    let numbers: Vec<f64> = (1..=100).rev().map(f64::from).collect();
    let spread = Spread::of(numbers.clone());
    assert_eq!((spread.median, spread.p99, spread.max), (Some(50.5), Some(99.0), Some(100.0)));
    assert_eq!((median(vec![3.0, 1.0, 2.0]), mean(numbers)), (Some(2.0), Some(50.5)));
    let none = Spread::of(Vec::new());
    assert_eq!((none.median, none.p99, none.max, median(Vec::new())), (None, None, None, None));
}

proptest! {
    #[test]
    fn the_front_holds_exactly_what_nothing_dominates(places in prop::collection::vec((0_u8..12, 0_u8..12), 0..40)) {
        let points: Vec<(f64, f64)> = places.iter().map(|&(x, y)| (f64::from(x), f64::from(y))).collect();
        let dominates = |a: (u8, u8), b: (u8, u8)| a.0 <= b.0 && a.1 <= b.1 && a != b;
        let expected: BTreeSet<(u8, u8)> = places
            .iter()
            .copied()
            .filter(|&place| !places.iter().any(|&other| dominates(other, place)))
            .collect();
        let found: Vec<(u8, u8)> = pareto_front(&points).into_iter().map(|number| places[number]).collect();
        // From left to right, with each place once.
        prop_assert_eq!(found, expected.into_iter().collect::<Vec<_>>());
    }
}
