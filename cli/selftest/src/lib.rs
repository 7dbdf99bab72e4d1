//! What a build of Drapery has to withstand: the hard cases H1 to H52, each with what must happen and a number that
//! decides. `drapery selftest --hard` and the project's tests run the same entries.
//!
//! A case is a function that makes its scene or its files, runs them on a [`bench::Bench`] and returns
//! [`case::Figure`]s. The bench looks after what holds for every case: finite numbers, no panic, the same bits on any
//! number of ranks and threads, no crossing where there was none at the start, and every degradation counted.

pub mod bench;
pub mod case;
mod cases;
pub mod combine;
pub mod drape;
pub mod files;
pub mod report;
pub mod scenes;
pub mod suite;
pub mod tier;

pub use cases::CATALOGUE;
