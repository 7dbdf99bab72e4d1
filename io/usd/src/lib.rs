//! USD: what Drapery writes and reads of it, with the crate `openusd` behind it.
//!
//! Nothing of `openusd` shows in what this crate offers: its interface is young and changes with every release
//! (`docs/decisions/0018-usd.md`).

mod interpolation;

pub mod cache;
pub mod read;
pub mod write;

pub use interpolation::Interpolation;
