//! Runs the program `compare` as a user would. On a small mesh, contestants that count the same thing must agree, with
//! each other and with the f64 reference.
//!
//! Embree is the only peer program in these tests, and only if it is installed. The others take minutes to build.
//! `compare` itself checks all counts that should agree, whichever peers run.

use circumsphere_support::{
    programs::example_program,
    recording::{Recording, write_recording},
    scenes::crumpled_sheet,
};
use circumsphere_truth::{box_pairs, exact_weld, mean_edge_length, touching_pairs_tree};
use glam::DVec3;
use serde_json::Value;
use std::{collections::BTreeMap, fs, process::Command};

const TRIANGLES: usize = 1_000;
const DISTANCE_EDGES: f64 = 0.1;

/// Relative tolerance for the growth of boxes, which is computed in f32. Coordinates are below 32 and the distance is
/// above 0.1, so half a unit in the last place of either side is below 2e-5 of the distance.
const BOX_BAND: f64 = 1.0e-4;

/// Our boxes are larger by a thousandth of the contact distance, plus rounding.
const OWN_BOX_BAND: f64 = 1.2e-3;

/// Relative band around the contact distance in which either answer is right: f32 coordinates are exact, but distances
/// are rounded.
const BAND: f64 = 1.0e-4;

/// The counts of one kind on one thread, by contestant (`who`) and row (`what`).
fn counts<'a>(rows: &'a [Value], kind: &str) -> BTreeMap<(&'a str, &'a str), u64> {
    rows.iter()
        .filter(|row| row["threads"] == 1)
        .filter_map(|row| {
            let name = (row["who"].as_str()?, row["what"].as_str()?);
            Some((name, row["counts"][kind].as_u64()?))
        })
        .collect()
}

/// The table that the program prints, and its measurements.
fn compare(arguments: &[&str]) -> (String, Value) {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let json = folder.path().join("comparison.json");
    let output = Command::new(example_program("compare"))
        .args(arguments)
        .arg("--json")
        .arg(&json)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = fs::read_to_string(&json).expect("the program has written its measurements");
    let comparison = serde_json::from_str(&text).expect("the measurements are JSON");
    (String::from_utf8_lossy(&output.stdout).into_owned(), comparison)
}

#[test]
fn everyone_counts_what_the_reference_counts() {
    let states = [0.0, 0.05].map(|phase| crumpled_sheet(TRIANGLES, phase));
    let triangles = states[0].triangles.clone();
    let positions: Vec<DVec3> =
        states[0].positions.iter().map(|&position| DVec3::from_array(position.map(f64::from))).collect();
    let weld = exact_weld(&positions);
    let distance = DISTANCE_EDGES * mean_edge_length(&positions, &triangles, &weld);

    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let file = folder.path().join("sheet.bin");
    let recording = Recording { triangles: triangles.clone(), frames: states.map(|state| state.positions).into() };
    write_recording(&file, &recording).expect("the sheet can be written");
    let file = file.display().to_string();
    let (table, comparison) = compare(&[
        &file,
        "--repeat",
        "2",
        "--peers",
        "embree",
        "--no-headline",
        "--no-steps",
        "--no-solids",
        "--no-scale",
    ]);
    let input = &comparison["inputs"][0];
    let rows = input["rows"].as_array().expect("there are rows");
    let has_embree = rows.iter().any(|row| row["who"] == "Embree");
    let faults = input["faults"].as_array().expect("a list");
    if has_embree {
        assert!(faults.is_empty(), "{table}");
    } else {
        // Exactly one fault for each number of threads.
        assert!(
            faults.len() == 2 && faults.iter().all(|fault| fault.to_string().contains("Embree is missing")),
            "{table}"
        );
        eprintln!("Embree's counts were not compared: {}", faults[0]);
    }
    assert!(rows.iter().all(|row| row["is_unsteady"] == false), "{table}");
    assert!((input["contact_distance"].as_f64().expect("a number") / distance - 1.0).abs() < 1.0e-12);

    // parry reports all pairs of overlapping boxes, including neighbors.
    let boxes = |distance: f64| box_pairs(&positions, &triangles, distance).len() as u64;
    let [fewest, most] = [1.0 - BOX_BAND, 1.0 + BOX_BAND].map(|factor| boxes(factor * distance));
    let box_counts = counts(rows, "box_pairs");
    let expected = if has_embree { 6 + 2 } else { 6 };
    assert_eq!(box_counts.len(), expected, "three rows of pairs for each of parry's strategies: {table}");
    assert!(box_counts.values().all(|&count| (fewest..=most).contains(&count)), "{fewest}..={most}: {table}");
    // Without the growth of the boxes, there would be fewer pairs.
    assert!(boxes(0.0) < fewest, "{table}");

    // Our methods report the box pairs that share no vertex.
    let share_vertex = |a: u32, b: u32| {
        let [a, b] = [a, b].map(|triangle| triangles[triangle as usize].map(|vertex| weld[vertex as usize]));
        a.iter().any(|vertex| b.contains(vertex))
    };
    let apart = |distance: f64| {
        box_pairs(&positions, &triangles, distance).into_iter().filter(|&(a, b)| !share_vertex(a, b)).count() as u64
    };
    let [fewest, most] = [1.0 - BOX_BAND, 1.0 + OWN_BOX_BAND].map(|factor| apart(factor * distance));
    let cold = |method: &str| format!("ours, {method}");
    let apart_counts = counts(rows, "apart");
    for method in ["BoundingSphere", "Circumsphere", "Closest", "Exact", "Polygon"] {
        let count = apart_counts[&(cold(method).as_str(), "cold tick")];
        assert!((fewest..=most).contains(&count), "{method}: {count}, expected {fewest}..={most}\n{table}");
    }

    // The exact methods find the touching pairs, and agree with each other.
    let touching = touching_pairs_tree(&positions, &triangles, &weld, distance * (1.0 + BAND));
    let surely = touching.iter().filter(|pair| pair.distance <= distance * (1.0 - BAND)).count() as u64;
    assert!(surely > 500, "the sheet has too few self-contacts: {surely}");
    let touching_counts = counts(rows, "touching");
    for method in ["Closest", "Exact", "Polygon"] {
        let count = touching_counts[&(cold(method).as_str(), "cold tick")];
        assert!(
            (surely..=touching.len() as u64).contains(&count),
            "{method}: {count}, expected about {surely}\n{table}"
        );
    }
    assert!(
        touching_counts[&("ours, BoundingSphere", "cold tick")] > surely,
        "balls contain their triangles, so they touch more often: {table}"
    );

    // parry's f32 distances come close. Its tolerances are absolute, so the comparison is coarse.
    let parry = touching_counts[&("parry", "query::distance of every pair")] as f64;
    assert!((parry / surely as f64 - 1.0).abs() < 0.05, "parry: {parry}, the reference: {surely}\n{table}");

    // A tick after a small motion finds the same as a cold tick at the end of that motion. So does an unchanged tick.
    for method in ["BoundingSphere", "Circumsphere", "Closest", "Exact"] {
        let method = cold(method);
        let there = touching_counts[&(method.as_str(), "cold tick, where the motion ends")];
        for what in ["tick, moved by 0.09 contact distances", "tick, unchanged"] {
            let count = touching_counts[&(method.as_str(), what)];
            // Spheres are refreshed lazily, so after a small motion they differ from those of a cold tick.
            if method != cold("Circumsphere") {
                assert_eq!(count, there, "{method}, {what}: {table}");
            }
        }
    }
    assert_eq!(input["reference"].as_str().map(|name| name.starts_with("parry Bvh")), Some(true), "{table}");
    assert!(table.contains(input["reference"].as_str().expect("a name")), "{table}");
}

#[test]
fn whole_steps_of_our_cloths_cross_nothing() {
    let (table, comparison) =
        compare(&["--sheet", "8", "--repeat", "1", "--no-peers", "--no-headline", "--small-steps", "--no-scale"]);
    let steps = &comparison["steps"];
    let scenes = steps["scenes"].as_array().expect("there are scenes");
    assert_eq!(scenes.len(), 3, "{table}");
    for scene in scenes {
        let vertices = scene["vertices"].as_f64().expect("a number");
        let rows = scene["rows"].as_array().expect("there are rows");
        let threads: Vec<&Value> = rows.iter().map(|row| &row["threads"]).collect();
        assert_eq!(threads, [1, 2], "{table}");
        for row in rows {
            let number = |name: &str| row[name].as_f64().expect("a number");
            assert!(
                row["crossings"].as_object().is_some_and(|counts| counts.values().all(|count| count == 0)),
                "{table}"
            );
            // Every tick has as many substeps, so the median tick has the median share.
            let share = 1.0e3 * number("median_ms") / (vertices * number("substeps"));
            assert!((number("per_vertex_and_substep_us") / share - 1.0).abs() < 1.0e-9, "{row}");
        }
        assert!(table.contains(scene["scene"].as_str().expect("a name")), "{table}");
    }
    // Without rapier, nothing is to compare with.
    let bars = steps["bars"].as_array().expect("there are bars");
    assert!(bars.len() == 6 && bars.iter().all(|bar| bar["holds"].is_null()), "{table}");
    assert_eq!(steps["faults"].as_array().map(Vec::len), Some(0), "{table}");
}

#[test]
fn what_it_cannot_read_is_refused_by_name() {
    for (arguments, named) in [
        (vec!["no/such/file.bin"], "no/such/file.bin"),
        (vec!["--frames", "7..9", "--sheet", "8", "--no-peers"], "--frames 7..9"),
        (vec!["--contact-distance-edges=-1"], "--contact-distance-edges"),
    ] {
        let output = Command::new(example_program("compare")).args(&arguments).output().expect("the program starts");
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(named) && !message.contains("panicked"), "{arguments:?}: {message}");
    }
}
