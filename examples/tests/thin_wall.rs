//! The thin-wall program as users call it: its files, its table, and the errors it reports.

use std::{fs, path::Path};

use circumsphere_support::{
    programs,
    recording::{Recording, read_recording, write_recording},
    scenes::{Mesh, Panel, cuboid, panel},
};
use serde_json::Value;

fn succeed(arguments: &[&str]) -> String {
    programs::succeed("thin_wall", arguments)
}

/// The program must exit with code 2 and a message that contains all of `parts`.
fn refuse(arguments: &[&str], parts: &[&str]) {
    programs::refuse("thin_wall", arguments, parts);
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

fn write(path: &Path, mesh: &Mesh) {
    let recording = Recording { triangles: mesh.triangles.clone(), frames: vec![mesh.positions.clone()] };
    write_recording(path, &recording).expect("a temporary file can be written");
}

fn number(report: &Value, name: &str) -> f64 {
    report[name].as_f64().unwrap_or_else(|| panic!("{name} is a number: {report}"))
}

#[test]
fn a_panel_becomes_a_sheet_with_a_report() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let [mesh, out, json] = ["panel.bin", "sheet.obj", "report.json"].map(|name| folder.path().join(name));
    let before = panel(&Panel { ribs: [2, 0], ..Panel::default() });
    write(&mesh, &before);
    let table = succeed(&[&text(&mesh), "--out", &text(&out), "--json", &text(&json)]);
    for part in ["panel.bin", "now sheets", "Hausdorff", "plate", "rib"] {
        assert!(table.contains(part), "{part} is missing:\n{table}");
    }
    let report: Value = serde_json::from_slice(&fs::read(&json).expect("the report was written")).expect("JSON");
    let names: Vec<&str> = report.as_object().expect("an object").keys().map(String::as_str).collect();
    let mut expected = [
        "triangles_before",
        "triangles_after",
        "thin_area",
        "abstracted_area",
        "area_before",
        "hausdorff",
        "hausdorff_over_thickness",
        "regions",
        "left_out",
        "probes",
        "detection",
    ];
    expected.sort_unstable();
    let mut sorted = names;
    sorted.sort_unstable();
    assert_eq!(sorted, expected);
    assert_eq!(report["triangles_before"], before.triangles.len());
    assert_eq!(report["regions"][0]["kind"], "plate");
    assert_eq!(report["regions"][0]["parent"], Value::Null);
    assert_eq!(report["regions"][1]["kind"], "rib");
    assert_eq!(report["regions"][1]["parent"], 0);
    assert!(number(&report, "hausdorff_over_thickness") < 0.05);
    assert_eq!(report["probes"]["count"], 10_000);
    assert!(report["probes"]["touching"].as_u64() > Some(1000), "{report}");
    assert_eq!(report["probes"]["missed_beyond_hausdorff"], 0, "no contact is lost");
    let after = read_recording(&[out]).expect("the sheet can be read");
    assert_eq!(report["triangles_after"], after.triangles.len());
}

#[test]
fn a_solid_is_written_as_it_was() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let [mesh, out, json] = ["box.bin", "same.obj", "report.json"].map(|name| folder.path().join(name));
    let before = cuboid([1.0, 0.9, 0.8], 3);
    write(&mesh, &before);
    succeed(&[&text(&mesh), "--out", &text(&out), "--json", &text(&json)]);
    let after = read_recording(&[out]).expect("the mesh can be read");
    assert_eq!((after.triangles, &after.frames[0]), (before.triangles, &before.positions));
    let report: Value = serde_json::from_slice(&fs::read(&json).expect("the report was written")).expect("JSON");
    assert_eq!(number(&report, "thin_area"), 0.0);
    assert_eq!(report["regions"], Value::Array(Vec::new()));
    assert_eq!(report["left_out"][0]["area"], report["area_before"]);
}

#[test]
fn without_a_file_there_is_a_panel() {
    let table = succeed(&[]);
    assert!(table.contains("the embedded panel"), "{table}");
}

#[test]
fn bad_input_is_named_and_ends_with_code_2() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = |name: &str| text(&folder.path().join(name));
    refuse(&[&path("missing.ply")], &["missing.ply"]);
    fs::write(path("nan.obj"), "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n").expect("written");
    refuse(&[&path("nan.obj")], &["nan.obj"]);
    fs::write(path("index.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").expect("written");
    refuse(&[&path("index.obj")], &["index.obj", "9"]);
    fs::write(path("empty.bin"), "").expect("written");
    refuse(&[&path("empty.bin")], &["empty.bin", "empty"]);
    let mesh = cuboid([1.0; 3], 1);
    let frames = vec![mesh.positions.clone(), mesh.positions.clone()];
    write_recording(Path::new(&path("two.bin")), &Recording { triangles: mesh.triangles.clone(), frames })
        .expect("written");
    refuse(&[&path("two.bin")], &["two.bin", "2 frames"]);
    write(Path::new(&path("box.bin")), &mesh);
    let nowhere = path("no/folder/out.obj");
    refuse(&[&path("box.bin"), "--out", &nowhere], &["out.obj"]);
    refuse(&[&path("box.bin"), "--json", &nowhere], &["out.obj"]);
    refuse(&[&path("box.bin"), "--unknown"], &["--unknown"]);
    if cfg!(not(feature = "rerun")) {
        refuse(&[&path("box.bin"), "--rerun", &path("out.rrd")], &["rerun"]);
    }
}
