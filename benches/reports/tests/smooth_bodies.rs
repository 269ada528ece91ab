//! Runs the program `smooth_bodies` as a user would: its output must be complete and obey what is known of smooth
//! surfaces, and bad input must be refused.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use circumsphere_reports::bounded::{Bound, Bounded, at_error};
use circumsphere_support::programs::example_program;
use serde_json::Value;

const PLOTS: [&str; 5] = ["error_vs_time", "bodies", "deforming", "cloth", "rolling"];
const SCENES: [&str; 7] = ["balls", "ellipsoids", "tori", "capsules", "ball_ellipsoid", "pulse", "cloth"];

fn smooth_bodies(arguments: &[&str]) -> Output {
    Command::new(example_program("smooth_bodies")).args(arguments).output().expect("the program starts")
}

fn succeed(arguments: &[&str]) {
    let output = smooth_bodies(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// The program must exit with code 2 and print a message that contains all of `parts`.
fn refuse(arguments: &[&str], parts: &[&str]) {
    let output = smooth_bodies(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?} does not name {part:?}: {message}");
    }
}

fn json(folder: &Path) -> Value {
    let text = fs::read_to_string(folder.join("report.json")).expect("the figures were written");
    serde_json::from_str(&text).expect("they are JSON")
}

/// A figure of the row of a list whose fields have the given values.
fn figure(study: &Value, list: &str, fields: &[(&str, Value)], name: &str) -> f64 {
    let rows = study[list].as_array().expect("it is a list");
    let row = rows.iter().find(|row| fields.iter().all(|(field, value)| row[*field] == *value));
    let row = row.unwrap_or_else(|| panic!("{list} has no row with {fields:?}"));
    row[name].as_f64().unwrap_or_else(|| panic!("{name} is {}", row[name]))
}

/// Smooth over flat.
fn ratio(study: &Value, scene: &str, level: u32, name: &str) -> f64 {
    let of = |shape: &str| {
        let fields = [("scene", scene.into()), ("level", level.into()), ("shape", shape.into())];
        figure(study, "cells", &fields, name)
    };
    of("Smooth") / of("Flat")
}

/// Takes the times out of a study, so that two can be compared.
fn without_times(mut value: Value) -> Value {
    match &mut value {
        Value::Object(fields) => {
            fields.retain(|name, _| !name.contains("time") && name != "machine" && name != "seconds");
            fields.values_mut().for_each(|field| *field = without_times(field.take()));
        }
        Value::Array(items) => items.iter_mut().for_each(|item| *item = without_times(item.take())),
        _ => {}
    }
    value
}

#[test]
fn a_quick_report_is_whole_and_smooth_surfaces_are_nearer_to_the_bodies() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let out = folder.path().join("deeper/first");
    succeed(&["--quick", "--out", &out.display().to_string()]);

    let report = fs::read_to_string(out.join("report.md")).expect("the report was written");
    assert!(report.contains("cargo run --release --example smooth_bodies -- --quick"));
    assert!(!report.contains(&folder.path().display().to_string()), "the report must not contain local paths");
    assert!(!report.contains("NaN") && !report.contains("inf"), "a figure is not a number");
    for plot in PLOTS {
        assert!(report.contains(&format!("({plot}.png)")) && report.contains(&format!("({plot}.svg)")), "{plot}");
        for ending in ["png", "svg"] {
            let path = out.join(format!("{plot}.{ending}"));
            assert!(path.metadata().is_ok_and(|data| data.len() > 5_000), "{} is nearly empty", path.display());
        }
    }

    let study = json(&out);
    for scene in SCENES {
        for shape in ["Flat", "Smooth"] {
            for level in 0..3 {
                let fields = [("scene", scene.into()), ("level", level.into()), ("shape", shape.into())];
                let figure = |name| figure(&study, "cells", &fields, name);
                assert!(figure("time_ms") > 0.0 && figure("error_mean") > 0.0, "{fields:?}");
                assert_eq!(figure("lost_poses"), 0.0, "{fields:?}");
                let expected = 80.0 * f64::from(4_u32.pow(level));
                assert!((0.75..1.25).contains(&(figure("triangles") / expected)), "{fields:?}");
            }
        }
        // The middle resolution of a quick run. The errors of smooth surfaces fall with the fourth power of the edge,
        // those of flat ones with the square.
        assert!(ratio(&study, scene, 1, "error_mean") < 0.5, "{scene}");
        assert!(ratio(&study, scene, 2, "error_mean") < 0.25, "{scene}");
        // The search for a flat surface's error has found a curve that falls.
        let flat = |level: u32| {
            let fields = [("scene", scene.into()), ("level", level.into()), ("shape", "Flat".into())];
            figure(&study, "cells", &fields, "error_mean")
        };
        assert!(flat(0) > 2.0 * flat(1) && flat(1) > 2.0 * flat(2), "{scene}");
    }
    assert!(ratio(&study, "balls", 1, "error_mean") < 0.2);
    for ground in ["ball", "ellipsoid", "torus"] {
        let ripple = |shape: &str| {
            let fields = [("ground", ground.into()), ("shape", shape.into())];
            figure(&study, "rolling", &fields, "ripple")
        };
        assert!(ripple("Smooth") < 0.5 * ripple("Flat"), "{ground}");
    }
}

#[test]
fn errors_are_the_same_twice_and_do_not_depend_on_the_exact_method() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let run = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let common = ["--quick", "--scenes", "balls,cloth", "--poses", "3"];
        let text = out.display().to_string();
        succeed(&[&common, more, &["--out", &text]].concat());
        json(&out)
    };
    let (first, second) = (run("first", &[]), run("second", &[]));
    assert_eq!(without_times(first["cells"].clone()), without_times(second["cells"].clone()));
    assert_eq!(without_times(first["rolling"].clone()), without_times(second["rolling"].clone()));
    let both = run("both", &["--methods", "exact,closest"]);
    for name in ["error_mean", "normal_mean_degrees"] {
        let [exact, closest] = ["Exact", "Closest"].map(|method| {
            let fields = [("scene", "balls".into()), ("shape", "Flat".into()), ("method", method.into())];
            figure(&both, "cells", &fields, name)
        });
        // Flat closest features are unique in random poses, and single precision resolves them to about 1e-6.
        assert!((exact - closest).abs() <= 1.0e-4 * exact, "{name}: {exact} and {closest}");
    }
}

#[test]
fn bad_input_is_refused_with_its_name_and_the_problem() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(path("file"), "a file").expect("a file can be written");
    refuse(&["--scenes", "balls,cubes", "--out", &path("out")], &["cubes", "balls"]);
    refuse(&["--poses", "0", "--out", &path("out")], &["--poses"]);
    refuse(&["--methods", "nearest", "--out", &path("out")], &["nearest", "exact"]);
    refuse(&["--quick", "--out", &path("file/below")], &["below"]);
    assert!(!folder.path().join("out").exists(), "a refused run must write nothing");
}

#[test]
fn between_two_points_a_power_law_is_followed_exactly() {
    // error = 1 / value
    let curve = [(1.0e-1, 10.0), (1.0e-2, 100.0), (1.0e-3, 1_000.0)];
    let found = at_error(&curve, 5.0e-3, 1.0e-9).expect("there is a curve");
    // Two logarithms and a power, each accurate to a few 1e-16.
    assert!(found.bound == Bound::Exactly && (found.value / 200.0 - 1.0).abs() < 1.0e-12, "{found:?}");
    let with = |value, bound| Some(Bounded { value, bound });
    assert_eq!(at_error(&curve, 1.0e-4, 1.0e-9), with(1_000.0, Bound::MoreThan));
    assert_eq!(at_error(&curve, 0.5, 1.0e-9), with(10.0, Bound::LessThan));
    assert_eq!(at_error(&curve, 1.0e-4, 1.0e-3), with(1_000.0, Bound::Exactly));
    assert_eq!(at_error(&[], 0.5, 1.0e-9), None);
}

#[test]
fn a_ratio_of_bounds_is_a_bound_or_unknown() {
    let with = |value, bound| Bounded { value, bound };
    let more = with(8.0, Bound::MoreThan);
    assert_eq!(more.over(with(2.0, Bound::Exactly)), Some(with(4.0, Bound::MoreThan)));
    assert_eq!(more.over(with(2.0, Bound::LessThan)), Some(with(4.0, Bound::MoreThan)));
    assert_eq!(more.over(with(2.0, Bound::MoreThan)), None);
    assert_eq!(with(8.0, Bound::Exactly).over(with(2.0, Bound::MoreThan)), Some(with(4.0, Bound::LessThan)));
    let mean = Bounded::geometric_mean(&[more, with(2.0, Bound::Exactly)]).expect("both are bounds from below");
    assert!(mean.bound == Bound::MoreThan && (mean.value - 4.0).abs() < 1.0e-12, "{mean:?}");
    assert_eq!(Bounded::geometric_mean(&[more, with(2.0, Bound::LessThan)]), None);
    assert_eq!(Bounded::geometric_mean(&[]), None);
}
