//! Analysis of results: the cost of accuracy ([`study`]), the course of a run ([`report`]), whether two results are
//! the same ([`diff`]), whether ranks and threads come to the same bits ([`bits`]), whether caches are sound
//! ([`verify`]), and the cloth of a run to look at ([`view`]). Nothing here is needed to simulate a shot, and nothing that simulates or writes knows of it. The
//! library never prints.
//!
//! ```
//! // What `drapery study --vary cfl=4,2,1` takes.
//! let (name, values) = drapery_analysis::study::vary::parse_vary("cfl=4,2,1").expect("a name and values");
//! assert_eq!((name.as_str(), values.len()), ("cfl", 3));
//! ```

pub mod bits;
pub mod comparison;
mod contact_sheet;
pub mod diff;
pub(crate) mod drawn;
mod local_run;
pub(crate) mod page;
pub mod report;
pub mod study;
pub mod verify;
pub mod view;
pub mod wedge;
