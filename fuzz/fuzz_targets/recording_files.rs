#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| circumsphere_fuzz::run("recording_files", bytes));
