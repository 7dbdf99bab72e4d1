//! What Drapery tells of results: what accuracy costs ([`study`]), how a run went ([`report`]), whether two results are the
//! same ([`diff`]), and whether caches are sound ([`verify`]). Nothing here is needed to simulate a shot, and nothing that
//! simulates or writes knows of it. The library never prints.

pub mod diff;
pub(crate) mod page;
pub mod report;
pub mod study;
pub mod verify;
