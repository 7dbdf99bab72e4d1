//! `drapery_fuzz::targets::usd_cache`, fed by libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| drapery_fuzz::targets::usd_cache::run(data));
