//! Fuzz targets for every reader, and what they share: a bound on memory, files in a folder that each input finds empty, bytes
//! taken apart. `libfuzzer/` feeds them; `tests/corpus.rs` replays the inputs under `corpus/` in every test run. docs/dev/fuzzing.md.

pub mod edits;
pub mod layout;
pub mod memory;
pub mod scratch;
pub mod targets;
