//! The program `queries` as users call it: its output, and the errors it reports.

use circumsphere_support::{
    programs::{self, Folder},
    random::Random,
    recording::{Recording, write_recording},
    scenes::{icosphere, torus},
};
use glam::{DVec3, Vec3};
use std::{fmt::Write, fs, path::Path};

fn succeed(arguments: &[&str]) -> String {
    programs::succeed("queries", arguments)
}

/// The program must exit with code 2 and a message that contains all of `parts`.
fn refuse(arguments: &[&str], parts: &[&str]) {
    programs::refuse("queries", arguments, parts);
}

/// Writes a recording into a folder and returns its path.
fn written(folder: &Folder, recording: &Recording) -> String {
    let path = folder.path("scene.bin");
    write_recording(Path::new(&path), recording).expect("the scene can be written");
    path
}

/// A ring that turns into another one, vertex by vertex.
fn recording() -> Recording {
    let (first, last) = (torus(0.8, 0.3, 24, 12), torus(1.1, 0.4, 24, 12));
    let frame = |share: f32| {
        let between =
            |(from, to): (&[f32; 3], &[f32; 3])| Vec3::from_array(*from).lerp(Vec3::from_array(*to), share).to_array();
        first.positions.iter().zip(&last.positions).map(between).collect()
    };
    Recording { triangles: first.triangles.clone(), frames: [0.0, 0.3, 0.7, 1.0].map(frame).to_vec() }
}

const RAY_HEADER: &str = "frame,origin_x,origin_y,origin_z,direction_x,direction_y,direction_z,max_distance";
const HIT_HEADER: &str = "ray,triangle,distance,barycentric_0,barycentric_1,barycentric_2,normal_x,normal_y,normal_z";
const CLOSEST_HEADER: &str = "point,triangle,distance,barycentric_0,barycentric_1,barycentric_2,x,y,z";

fn rows(path: &str, header: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).expect("the file was written");
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some(header));
    lines.map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn numbers(row: &[String]) -> Vec<f64> {
    row.iter().map(|text| text.parse().expect("a number")).collect()
}

/// The corners of a triangle of a frame.
fn corners(recording: &Recording, frame: usize, triangle: usize) -> [DVec3; 3] {
    recording.triangles[triangle].map(|vertex| Vec3::from_array(recording.frames[frame][vertex as usize]).as_dvec3())
}

/// The distance of the nearest triangle along a ray, by Cramer's rule.
fn nearest(recording: &Recording, frame: usize, origin: DVec3, direction: DVec3) -> f64 {
    (0..recording.triangles.len())
        .filter_map(|triangle| {
            let [a, b, c] = corners(recording, frame, triangle);
            let (first, second, from) = (b - a, c - a, origin - a);
            let volume = first.dot(direction.cross(second));
            let (v, w) = (from.dot(direction.cross(second)) / volume, direction.dot(from.cross(first)) / volume);
            let distance = second.dot(from.cross(first)) / volume;
            (v >= 0.0 && w >= 0.0 && v + w <= 1.0 && distance >= 0.0).then_some(distance)
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn hits_are_those_of_brute_force_in_the_order_of_the_rays() {
    let (folder, recording) = (Folder::new(), recording());
    let mut random = Random::new(1);
    let mut text = format!("{RAY_HEADER}\n");
    let mut asked = Vec::new();
    for _ in 0..600 {
        // In no order of frames.
        let frame = random.below(4) as usize;
        let mut vector = |size: f32| Vec3::from_array([0; 3].map(|_| random.signed_unit())) * size;
        let (origin, target) = (vector(3.0), vector(1.0));
        let (direction, range) = (target - origin, if asked.len() % 3 == 0 { 0.9 } else { f32::INFINITY });
        let [a, b, c] = origin.to_array();
        let [x, y, z] = direction.to_array();
        writeln!(text, "{frame},{a},{b},{c},{x},{y},{z},{range}").expect("a string takes anything");
        asked.push((frame, origin.as_dvec3(), direction.as_dvec3(), f64::from(range)));
    }
    let (rays, hits) = (folder.with("rays.csv", &text), folder.path("hits.csv"));
    let table = succeed(&[&written(&folder, &recording), "--rays", &rays, "--hits", &hits]);
    assert!(table.contains("4 ticks") && table.contains("600"), "{table}");
    let rows = rows(&hits, HIT_HEADER);
    assert_eq!(rows.len(), asked.len());
    let mut counts = [0; 2];
    for (number, (row, (frame, origin, direction, range))) in rows.iter().zip(asked).enumerate() {
        assert_eq!((row.len(), &row[0]), (9, &number.to_string()));
        let expected = nearest(&recording, frame, origin, direction);
        if row[1].is_empty() {
            assert!(row[1..].iter().all(String::is_empty), "{row:?}");
            assert!(expected.is_infinite() || expected > range, "ray {number} hits at {expected}");
            counts[0] += 1;
            continue;
        }
        let values = numbers(row);
        assert!((values[2] - expected).abs() < 1.0e-6, "ray {number}: {row:?}, not {expected}");
        let [a, b, c] = corners(&recording, frame, row[1].parse().expect("a number of a triangle"));
        let point = a * values[3] + b * values[4] + c * values[5];
        assert!(point.distance(origin + direction * values[2]) < 1.0e-5, "ray {number}: {row:?}");
        let normal = (b - a).cross(c - a).normalize();
        assert!(normal.distance(DVec3::new(values[6], values[7], values[8])) < 1.0e-6, "ray {number}: {row:?}");
        counts[1] += 1;
    }
    assert!(counts[0] > 100 && counts[1] > 100, "{counts:?}");
}

#[test]
fn closest_points_lie_on_their_triangles_at_their_distance() {
    let (folder, recording) = (Folder::new(), recording());
    let mut random = Random::new(2);
    let mut text = "frame,x,y,z,max_distance\n".to_owned();
    let mut asked = Vec::new();
    for _ in 0..300 {
        let frame = random.below(4) as usize;
        let [x, y, z] = [0; 3].map(|_| 2.0 * random.signed_unit());
        let range = if asked.len() % 2 == 0 { "0.5" } else { "inf" };
        writeln!(text, "{frame},{x},{y},{z},{range}").expect("a string takes anything");
        asked.push((frame, Vec3::new(x, y, z).as_dvec3(), range == "inf"));
    }
    let (points, closest) = (folder.with("points.csv", &text), folder.path("closest.csv"));
    succeed(&[&written(&folder, &recording), "--points", &points, "--closest", &closest]);
    let rows = rows(&closest, CLOSEST_HEADER);
    assert_eq!(rows.len(), asked.len());
    let mut empty = 0;
    for (number, (row, (frame, point, always))) in rows.iter().zip(asked).enumerate() {
        assert_eq!((row.len(), &row[0]), (9, &number.to_string()));
        let least_to_vertex = recording.frames[frame]
            .iter()
            .map(|vertex| Vec3::from_array(*vertex).as_dvec3().distance(point))
            .fold(f64::INFINITY, f64::min);
        if row[1].is_empty() {
            assert!(!always && least_to_vertex > 0.5, "point {number}");
            empty += 1;
            continue;
        }
        let values = numbers(row);
        let [a, b, c] = corners(&recording, frame, row[1].parse().expect("a number of a triangle"));
        let on_triangle = a * values[3] + b * values[4] + c * values[5];
        let found = DVec3::new(values[6], values[7], values[8]);
        assert!(on_triangle.distance(found) < 1.0e-6, "point {number}: {row:?}");
        assert!((found.distance(point) - values[2].abs()).abs() < 1.0e-6, "point {number}: {row:?}");
        assert!(values[2].abs() <= least_to_vertex + 1.0e-6, "point {number}: {row:?}");
    }
    assert!(empty > 20 && empty < 140, "{empty}");
}

#[test]
fn the_embedded_scene_runs_without_arguments_and_is_hit() {
    let table = succeed(&[]);
    for part in ["the embedded scene", "ray", "closest point", "µs each"] {
        assert!(table.contains(part), "{part} is missing:\n{table}");
    }
    let counts: Vec<usize> = table
        .lines()
        .find(|line| line.starts_with("ray "))
        .expect("there is a row of rays")
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .collect();
    assert!(counts[0] == 1000 && counts[2] > counts[1] / 5 && counts[2] < counts[1], "{table}");
}

#[test]
fn bad_input_is_refused_with_its_file_row_and_column() {
    let (folder, recording) = (Folder::new(), recording());
    let input = written(&folder, &recording);
    let hits = folder.path("hits.csv");
    let rays = |text: &str, parts: &[&str]| {
        let rays = folder.with("rays.csv", text);
        refuse(&[&input, "--rays", &rays, "--hits", &hits], &[&["rays.csv"], parts].concat());
    };
    let row = |row: &str| format!("{RAY_HEADER}\n0,0,0,0,0,0,1,inf\n{row}\n");
    rays(&row("4,0,0,0,0,0,1,inf"), &["row 1", "line 3", "frame", "'4'", "0 to 3"]);
    rays(&row("-1,0,0,0,0,0,1,inf"), &["row 1", "frame", "'-1'"]);
    rays(&row("0,0,zero,0,0,0,1,inf"), &["row 1", "origin_y", "'zero'"]);
    rays(&row("0,0,0,0,nan,0,1,inf"), &["row 1", "direction_x", "'nan'"]);
    rays(&row("0,0,0,0,0,0,1e39,inf"), &["row 1", "direction_z", "'1e39'"]);
    rays(&row("0,0,0,0,0,0,1,-2"), &["row 1", "max_distance", "'-2'", "0 or more"]);
    rays(&row("0,0,0,0,0,0,1,nan"), &["row 1", "max_distance", "'nan'"]);
    rays(&row("0,0,0,0,0,0,1"), &["line"]);
    rays(&format!("{}\n", RAY_HEADER.replace("origin_z", "origin_w")), &["origin_z", "missing"]);
    rays(&format!("{}\n", RAY_HEADER.replace("origin_z", "origin_y")), &["origin_y", "twice"]);
    rays("", &["frame", "missing"]);
    let points = folder.with("points.csv", "frame,x,y,z,max_distance\n0,0,0,inf,1\n");
    refuse(&[&input, "--points", &points, "--closest", &hits], &["points.csv", "row 0", "column z", "'inf'"]);
    refuse(&[&input, "--rays", &folder.path("missing.csv"), "--hits", &hits], &["missing.csv"]);
    let good = folder.with("good.csv", row("0,0,0,0,0,0,1,inf"));
    refuse(&[&input, "--rays", &good, "--hits", &folder.path("no/such/folder/hits.csv")], &["hits.csv"]);
    refuse(&[&input, "--rays", &good], &["--hits"]);
    refuse(&[&input, "--hits", &hits], &["--rays"]);
    refuse(&[&folder.path("missing.bin")], &["missing.bin"]);
}

#[test]
fn rays_that_are_no_rays_hit_nothing_and_files_without_rows_give_none() {
    let folder = Folder::new();
    let ball = icosphere(2, 1.0);
    let input = written(&folder, &Recording { triangles: ball.triangles, frames: vec![ball.positions] });
    let hits = folder.path("hits.csv");
    let text = format!("{RAY_HEADER}\n0,0,0,0,0,0,0,inf\n0,0,0,3,0,0,-2,inf\n0,0,0,3,0,0,-2,0.5\n");
    succeed(&[&input, "--rays", &folder.with("rays.csv", &text), "--hits", &hits]);
    let found = rows(&hits, HIT_HEADER);
    assert_eq!(found[0].join(","), "0,,,,,,,,");
    assert_eq!(found[2].join(","), "2,,,,,,,,");
    assert!((numbers(&found[1])[2] - 1.0).abs() < 1.0e-6, "{:?}", found[1]);
    succeed(&[&input, "--rays", &folder.with("none.csv", RAY_HEADER), "--hits", &hits]);
    assert_eq!(rows(&hits, HIT_HEADER), Vec::<Vec<String>>::new());
}
