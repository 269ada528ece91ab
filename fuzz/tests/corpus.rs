//! Runs every fuzz target on the committed corpus and on corrupted copies of it. Faults that libFuzzer once found stay
//! covered, with any toolchain and without a C++ compiler.

use std::{fs, path::Path};

use circumsphere_fuzz::TARGETS;
use circumsphere_support::{
    random::Random,
    recording::{CcdQueries, RecordedImpacts, Recording, RecordingF64},
};

/// Seeds are small, so that a fuzzer processes many of them and the repository stays small.
const LARGEST_SEED: u64 = 2048;
const LARGEST_CORPUS: u64 = 100 * 1024;

/// The number of corrupted copies of each seed.
const COPIES: u64 = 40;

/// The seed with a few bytes changed, removed, or inserted.
fn spoiled(seed: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..1 + random.bits() % 4 {
        let place = (random.bits() % (bytes.len() as u64 + 1)) as usize;
        match random.bits() % 5 {
            0 => bytes.truncate(place),
            1 => bytes.insert(place, random.bits() as u8),
            2 => bytes.extend_from_slice(&random.bits().to_le_bytes()),
            3 if place < bytes.len() => bytes[place] ^= 1 << (random.bits() % 8),
            _ if place < bytes.len() => bytes[place] = [0, 1, 0x7f, 0x80, 0xff][(random.bits() % 5) as usize],
            _ => {}
        }
    }
    bytes
}

#[test]
fn every_target_survives_its_corpus_and_spoiled_copies_of_it() {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let mut total = 0;
    for target in TARGETS {
        let mut seeds: Vec<_> = fs::read_dir(corpus.join(target.name))
            .unwrap_or_else(|error| panic!("the corpus of {}: {error}", target.name))
            .map(|entry| entry.expect("the corpus can be listed").path())
            .collect();
        seeds.sort();
        assert!(!seeds.is_empty(), "{} has no seed", target.name);
        for path in seeds {
            let seed = fs::read(&path).expect("a seed can be read");
            assert!(seed.len() as u64 <= LARGEST_SEED, "{} is larger than a seed should be", path.display());
            total += seed.len() as u64;
            let survives = |bytes: &[u8], what: &str| {
                let outcome = std::panic::catch_unwind(|| (target.run)(bytes));
                assert!(outcome.is_ok(), "{} does not survive {what} {}: {bytes:?}", target.name, path.display());
            };
            survives(&seed, "the seed");
            let mut random = Random::new(seed.len() as u64);
            for _ in 0..COPIES {
                survives(&spoiled(&seed, &mut random), "a corrupted copy of");
            }
        }
    }
    assert!(total <= LARGEST_CORPUS, "the corpus has {total} bytes");
}

#[test]
fn every_target_has_a_program_and_a_corpus() {
    let names = |folder: &str| {
        let mut names: Vec<String> = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder))
            .expect("it can be listed")
            .map(|entry| entry.expect("it can be listed").path())
            .map(|path| path.file_stem().expect("it has a name").to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    };
    let mut targets: Vec<&str> = TARGETS.iter().map(|target| target.name).collect();
    targets.sort_unstable();
    assert_eq!(names("fuzz_targets"), targets);
    assert_eq!(names("corpus"), targets);
}

/// Whether a reader accepts some bytes.
type Accept = fn(&[u8]) -> bool;

/// A seed that is rejected at its first byte would show a fuzzer nothing of what follows.
#[test]
fn the_seeds_of_the_readers_are_files_that_they_accept() {
    let accepts: [(&str, Accept); 6] = [
        ("recording_bin", |bytes| Recording::from_bytes(bytes, Path::new("seed")).is_ok()),
        ("recording_f64", |bytes| RecordingF64::from_bytes(bytes, Path::new("seed")).is_ok()),
        ("recording_ply", |bytes| Recording::from_ply_bytes(bytes, Path::new("seed")).is_ok()),
        ("recording_obj", |bytes| Recording::from_obj_bytes(bytes, Path::new("seed")).is_ok()),
        ("ccd_queries", |bytes| CcdQueries::from_bytes(bytes, Path::new("seed")).is_ok()),
        ("impact_truth", |bytes| RecordedImpacts::from_bytes(bytes, Path::new("seed")).is_ok()),
    ];
    for (target, accept) in accepts {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
        for entry in fs::read_dir(folder).expect("the corpus can be listed") {
            let path = entry.expect("the corpus can be listed").path();
            let is_text_of_errors = path.file_name().is_some_and(|name| name == "words");
            let seed = fs::read(&path).expect("a seed can be read");
            assert!(accept(&seed) || is_text_of_errors, "{} is rejected", path.display());
        }
    }
}
