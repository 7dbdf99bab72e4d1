//! Fuzz targets for every reader, and what they share: a bound on memory, files in a folder that each input finds empty, bytes
//! taken apart. `libfuzzer/` feeds them; `tests/corpus.rs` replays the inputs under `corpus/` in every test run. docs/dev/fuzzing.md.
//!
//! ```
//! // Bytes that are no mesh: an error of the reader, and no panic.
//! let (_, read) = drapery_fuzz::targets::TARGETS.iter().find(|(name, _)| *name == "obj").expect("a target");
//! read(b"v 0 0 nothing\nf 1 2 3\n");
//! ```

pub mod edits;
pub mod layout;
pub mod memory;
pub mod scratch;
pub mod targets;
