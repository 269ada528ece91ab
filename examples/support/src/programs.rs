//! Locates the programs of the examples for tests.

use std::path::PathBuf;

/// The program of an example of the package under test. It is next to the folder of the test programs, and building all
/// tests builds it.
///
/// # Panics
///
/// If it has not been built, or if the caller is not a test.
pub fn example_program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().expect("a test knows its own path");
    let profile = tests.ancestors().nth(2).expect("test programs are two folders below their profile");
    let program = profile.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(program.exists(), "{} is missing: build it with `cargo build --example {name}`", program.display());
    program
}
