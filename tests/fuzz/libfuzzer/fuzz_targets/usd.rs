//! `drapery_fuzz::targets::usd`, fed by libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| drapery_fuzz::targets::usd::run(data));
