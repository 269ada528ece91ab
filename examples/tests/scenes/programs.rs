//! The programs as users call them: one process per number of threads.

use circumsphere_support::programs;

use crate::scenes::SCENES;

/// The value in a row of the table.
fn row<'a>(table: &'a str, name: &str) -> &'a str {
    let line = table.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{name} is not in {table}"));
    line[name.len()..].trim()
}

#[test]
fn programs_print_a_table_with_the_same_end_for_one_thread_and_two() {
    for name in SCENES {
        let table = |threads: &str| {
            let output = programs::run(name, &["--small", "--ticks", "20", "--threads", threads]);
            assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
            String::from_utf8(output.stdout).expect("the table is text")
        };
        let (one, two) = (table("1"), table("2"));
        assert_eq!(row(&one, "hash of the end"), row(&two, "hash of the end"), "{name}");
        assert_eq!(row(&one, "hash of the end").len(), 16);
        assert!(row(&one, "time of a tick").contains("detection"), "{one}");
        assert!(one.starts_with(&format!("{name}: ")) && one.contains("20 ticks"), "{one}");
    }
}

#[test]
fn programs_refuse_what_they_cannot_play() {
    let wrong: [(&str, &[&str]); 7] = [
        ("cloth_drop", &["--ticks", "0"]),
        ("pile", &["--substeps", "0"]),
        ("skirt", &["--method", "guess"]),
        ("bullet_cloth", &["--speed", "-1"]),
        ("bullet_cloth", &["--speed", "nan"]),
        ("walking_skirt", &["--speed", "11"]),
        ("level", &["--speed", "-1"]),
    ];
    for (name, arguments) in wrong {
        let output = programs::run(name, arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{name} {arguments:?}: {message}");
        assert!(message.contains(arguments[0]) && !message.contains("panicked"), "{name} {arguments:?}: {message}");
    }
}
