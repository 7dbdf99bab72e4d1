//! `drapery_fuzz::targets::run_folder`, fed by libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| drapery_fuzz::targets::run_folder::run(data));
