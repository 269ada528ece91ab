//! The fuzz targets of `bevy_circumsphere`.
//!
//! Each target is a function of a byte slice that panics if something is wrong. The programs in `fuzz_targets/` pass it
//! the inputs of libFuzzer, and the test in `tests/corpus.rs` passes it the committed corpus. README.md explains how to
//! run them.

#![forbid(unsafe_code)]

mod input;
mod meshes;
mod narrow_phase;
mod readers;
mod spheres;
mod surfaces;

/// A function that must survive any bytes.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The name of its program and of its corpus folder.
    pub name: &'static str,
    /// Panics if something is wrong.
    pub run: fn(&[u8]),
}

/// All targets.
pub const TARGETS: &[Target] = &[
    Target { name: "recording_bin", run: readers::recording_bin },
    Target { name: "recording_f64", run: readers::recording_f64 },
    Target { name: "recording_ply", run: readers::recording_ply },
    Target { name: "recording_obj", run: readers::recording_obj },
    Target { name: "recording_files", run: readers::recording_files },
    Target { name: "ccd_queries", run: readers::ccd_queries },
    Target { name: "impact_truth", run: readers::impact_truth },
    Target { name: "narrow_phase", run: narrow_phase::narrow_phase },
    Target { name: "spheres", run: spheres::spheres },
    Target { name: "surfaces", run: surfaces::surfaces },
];

/// Runs one target by name. The programs call it.
///
/// # Panics
///
/// If there is no target of that name, or if the target finds a fault.
pub fn run(name: &str, bytes: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name).expect("the program is named after a target");
    (target.run)(bytes);
}
