//! `drapery_fuzz::targets::obj`, fed by libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| drapery_fuzz::targets::obj::run(data));
