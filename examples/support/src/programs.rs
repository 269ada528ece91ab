//! Where a test finds the examples' programs.

use std::path::PathBuf;

/// The program of an example of the package under test. It lies beside the folder of the tests' own programs;
/// building all tests builds it.
///
/// # Panics
///
/// Panics if it has not been built, or if the caller is no test.
pub fn example_program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().expect("a test knows where it is");
    let profile = tests.ancestors().nth(2).expect("tests lie two folders below their profile");
    let program = profile.join("examples").join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(program.exists(), "{} is missing: build it with `cargo build --example {name}`", program.display());
    program
}
