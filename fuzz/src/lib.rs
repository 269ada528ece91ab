//! What the fuzz targets of `bevy_circumsphere` do with the bytes they are given.
//!
//! Each target is a function of a slice of bytes that panics where something is wrong. The programs in
//! `fuzz_targets/` hand it what libFuzzer makes up, the test in `tests/corpus.rs` the committed corpus. README.md says
//! how to run them.

#![forbid(unsafe_code)]

mod input;
mod meshes;
mod narrow_phase;
mod readers;
mod spheres;
mod surfaces;

/// A function that is to survive any bytes.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The name of its program, and of the folder of its corpus.
    pub name: &'static str,
    /// Panics where something is wrong.
    pub run: fn(&[u8]),
}

/// Every target.
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

/// Runs one target; what its program calls.
///
/// # Panics
///
/// Where there is no target of that name, and where the target finds something wrong.
pub fn run(name: &str, bytes: &[u8]) {
    let target = TARGETS.iter().find(|target| target.name == name).expect("the program is named after a target");
    (target.run)(bytes);
}
