//! Locates and runs the programs of the examples for tests.

use std::{
    fs,
    path::PathBuf,
    process::{Command, Output},
};

use tempfile::TempDir;

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

/// What the program of an example does with arguments.
///
/// # Panics
///
/// As for [`example_program`].
pub fn run(name: &str, arguments: &[&str]) -> Output {
    Command::new(example_program(name)).args(arguments).output().expect("the program starts")
}

/// What a program prints that must succeed.
///
/// # Panics
///
/// If it does not.
pub fn succeed(name: &str, arguments: &[&str]) -> String {
    let output = run(name, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("the table is text")
}

/// Runs a program that must exit with code 2 and a message that contains all of `parts`.
///
/// # Panics
///
/// If it does not.
pub fn refuse(name: &str, arguments: &[&str], parts: &[&str]) {
    let output = run(name, arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert!(!message.contains("panicked"), "{arguments:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{arguments:?} does not name {part:?}: {message}");
    }
}

/// A temporary folder for the files of a test, which is removed when it is dropped.
pub struct Folder(TempDir);

impl Folder {
    /// Creates an empty folder.
    ///
    /// # Panics
    ///
    /// If the system has no room for it.
    #[expect(clippy::new_without_default, reason = "makes a folder on the disk")]
    #[must_use]
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder can be made"))
    }

    /// The path of a file in the folder, as an argument for a program.
    #[must_use]
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    /// Writes a file and returns its path.
    ///
    /// # Panics
    ///
    /// If it cannot be written.
    pub fn with(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        fs::write(self.0.path().join(name), bytes).expect("a temporary file can be written");
        self.path(name)
    }
}
