//! Runs the program `experiments` as a user would: its output must be complete, and bad input must be refused.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use circumsphere_reports::finding::{Finding, Outcome, figure, geometric_mean, happens_less, optional, percent, table};
use circumsphere_support::programs::example_program;

/// The experiments, and the columns of their tables that hold text.
const EXPERIMENTS: [(&str, &[&str]); 5] = [
    ("delta", &["kind", "scene"]),
    ("iterations", &["kind", "scene", "method"]),
    ("tunnelling", &["target", "method", "continuous"]),
    ("caps", &[]),
    ("sizes", &["method"]),
];

/// Columns that are empty if a scene flew apart or was not played.
const MAY_BE_EMPTY: [&str; 12] = [
    "trembling",
    "trembling_spread",
    "jitter",
    "churn",
    "residual_mean",
    "residual_deepest",
    "residual_crossings",
    "residual_inside",
    "contacts",
    "time_detection_ms",
    "time_response_ms",
    "frame_share_with_response",
];

fn experiments(arguments: &[&str]) -> Output {
    Command::new(example_program("experiments")).args(arguments).output().expect("the program starts")
}

type Problems = Vec<String>;

/// Problems in the output of one experiment. Empty if the output is complete.
fn problems(folder: &Path, report: &str, name: &str, words: &[&str]) -> Problems {
    let mut problems = Problems::new();
    for ending in ["png", "svg", "csv"] {
        let path = folder.join(format!("{name}.{ending}"));
        if !path.metadata().is_ok_and(|data| data.len() > 300) {
            problems.push(format!("{name}.{ending} is missing or nearly empty"));
        }
        if !report.contains(&format!("({name}.{ending})")) {
            problems.push(format!("the report does not show {name}.{ending}"));
        }
    }
    problems.extend(bad_png(&folder.join(format!("{name}.png"))).map(|problem| format!("{name}.png: {problem}")));
    let Ok(mut reader) = csv::Reader::from_path(folder.join(format!("{name}.csv"))) else { return problems };
    let columns: Vec<String> = reader.headers().map(|row| row.iter().map(str::to_owned).collect()).unwrap_or_default();
    let mut count = 0;
    for row in reader.records() {
        let Ok(row) = row else {
            problems.push(format!("{name}.csv has a broken row"));
            continue;
        };
        count += 1;
        for (column, cell) in columns.iter().zip(&row) {
            let is_number = cell.parse::<f64>().is_ok_and(f64::is_finite);
            let may_be_empty = cell.is_empty() && MAY_BE_EMPTY.contains(&column.as_str());
            if !words.contains(&column.as_str()) && !is_number && !may_be_empty {
                problems.push(format!("{name}.csv: {column} holds {cell:?}"));
            }
        }
    }
    if count < 2 {
        problems.push(format!("{name}.csv has {count} rows"));
    }
    let sections: Vec<&str> =
        report.split("\n## ").filter(|section| section.contains(&format!("({name}.csv)"))).collect();
    let [section] = sections[..] else {
        problems.push(format!("{name} has {} sections", sections.len()));
        return problems;
    };
    let last = section.trim_end().lines().last().unwrap_or_default();
    let parts = ["**Claim:** ", "; **found:** ", "; **"];
    if !(last.starts_with(parts[0]) && parts.iter().all(|part| last.contains(part)) && last.ends_with("**.")) {
        problems.push(format!("{name} does not end with its finding, but with {last:?}"));
    }
    if section.contains("NaN") || section.contains("inf ") {
        problems.push(format!("{name} contains a value that is not a number"));
    }
    problems
}

/// The problem of a plot, if there is one.
fn bad_png(path: &Path) -> Option<String> {
    let file = fs::File::open(path).ok()?;
    let decode = || -> Result<(u32, u32, usize), png::DecodingError> {
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info()?;
        let mut bytes = vec![0; reader.output_buffer_size().unwrap_or_default()];
        let frame = reader.next_frame(&mut bytes)?;
        let pixels = bytes[..frame.buffer_size()].chunks(frame.color_type.samples());
        let colors: std::collections::HashSet<&[u8]> = pixels.collect();
        Ok((frame.width, frame.height, colors.len()))
    };
    match decode() {
        Ok((width, height, colors)) if width >= 1000 && height >= 800 && colors > 20 => None,
        Ok(shape) => Some(format!("width, height and colors are {shape:?}")),
        Err(error) => Some(error.to_string()),
    }
}

#[test]
fn a_quick_run_is_whole_and_a_torn_one_is_found_out() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let out = folder.path().join("deeper/experiments");
    let output = experiments(&["--quick", "--out", &out.display().to_string()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = fs::read_to_string(out.join("report.md")).expect("the report was written");
    assert!(report.contains("cargo run --release --example experiments -- --quick"));
    assert!(!report.contains(&folder.path().display().to_string()), "the report must not contain local paths");
    for (name, words) in EXPERIMENTS {
        assert_eq!(problems(&out, &report, name, words), Problems::new());
    }

    // The check detects missing files, values that are not numbers, and missing findings.
    let torn = report.replace("**Claim:**", "Claim:");
    for (name, words) in EXPERIMENTS {
        assert_eq!(problems(&out, &torn, name, words).len(), 1, "{name}");
    }
    let path = out.join("caps.csv");
    let table = fs::read_to_string(&path).expect("the table was written");
    let (header, rows) = table.split_once('\n').expect("there is a header");
    let spoiled = rows.replacen(rows.split(',').next().expect("there is a cell"), "NaN", 1);
    fs::write(&path, format!("{header}\n{spoiled}")).expect("a file can be written");
    assert_eq!(problems(&out, &report, "caps", &[]), ["caps.csv: phi holds \"NaN\""]);
    fs::remove_file(out.join("sizes.png")).expect("the plot was there");
    assert_eq!(problems(&out, &report, "sizes", &["method"]), ["sizes.png is missing or nearly empty"]);
}

#[test]
fn bad_input_is_refused_with_its_name_and_the_problem() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let file = folder.path().join("file");
    fs::write(&file, "a file").expect("a file can be written");
    let below = file.join("below").display().to_string();
    for (arguments, part) in
        [(["--quick", "--out", &below], "below"), (["--quick", "--only", "everything"], "everything")]
    {
        let output = experiments(&arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(part) && !message.contains("panicked"), "{message}");
    }
}

/// The committed report is the complete output of a full run.
#[test]
fn the_committed_report_is_whole() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/experiments");
    let report = fs::read_to_string(folder.join("report.md")).expect("the report is committed");
    assert!(!report.contains("--quick") && !report.contains("--only"), "it must come from a full run");
    for (name, words) in EXPERIMENTS {
        assert_eq!(problems(&folder, &report, name, words), Problems::new());
    }
}

#[test]
fn figures_have_three_digits() {
    let expected = [(0.0, "0"), (1234.5, "1234"), (99.96, "100"), (1.0, "1"), (0.012_345, "0.0123"), (-2.5, "-2.5")];
    for (value, text) in expected {
        assert_eq!(figure(value), text);
    }
    assert_eq!([figure(1.0e-7), figure(1.234e9)], ["1.0e-7", "1.2e9"]);
    assert_eq!([optional(Some(0.5)), optional(None), percent(0.123_45)], ["0.5", "–", "12.3 %"]);
    let cells = |cells: [&str; 2]| cells.map(str::to_owned);
    assert_eq!(table(&cells(["a", "b"]), [cells(["1", "2"]).to_vec()]), "| a | b |\n| --- | ---: |\n| 1 | 2 |\n");
}

#[test]
fn a_claim_in_parts_holds_if_all_of_them_do() {
    use Outcome::{Fails, Holds, HoldsInPart, Undecided};
    let expected = [
        ([Holds, Holds], Holds),
        ([Holds, Fails], HoldsInPart),
        ([Undecided, Holds], HoldsInPart),
        ([Fails, Undecided], Fails),
        ([Undecided, Undecided], Undecided),
    ];
    for (parts, outcome) in expected {
        assert_eq!(Outcome::all(&parts), outcome, "{parts:?}");
    }
    let finding = Finding { claim: "so it is".to_owned(), found: "it is not".to_owned(), outcome: Fails };
    assert_eq!(finding.to_string(), "**Claim:** so it is; **found:** it is not; **does not hold**.");
}

#[test]
fn what_chance_may_have_done_decides_nothing() {
    let alternating: Vec<bool> = (0..40).map(|number| number % 2 == 0).collect();
    let inverted: Vec<bool> = alternating.iter().map(|one| !one).collect();
    assert_eq!(happens_less(&alternating, &inverted), Outcome::Undecided);
    assert_eq!(happens_less(&alternating, &alternating), Outcome::Undecided);
    // Four of four trials are within twice the square root of four. Five of five are not.
    for (count, outcome, reverse) in [(4, Outcome::Undecided, Outcome::Undecided), (5, Outcome::Holds, Outcome::Fails)]
    {
        let (never, always) = (vec![false; count], vec![true; count]);
        assert_eq!([happens_less(&never, &always), happens_less(&always, &never)], [outcome, reverse]);
    }
}

#[test]
fn the_geometric_mean_is_the_root_of_the_product() {
    // The tolerance covers two roundings of logarithms and one of their exponential.
    let mean = geometric_mean([2.0, 8.0, 4.0], 0.0).expect("there are numbers");
    assert!((mean - 4.0).abs() < 1.0e-14, "{mean}");
    let lifted = geometric_mean([0.0, 4.0], 1.0).expect("there are numbers");
    assert!((lifted - 2.0).abs() < 1.0e-14, "values below the minimum count as the minimum: {lifted}");
    assert_eq!(geometric_mean([], 1.0), None);
}
