//! Hard cases that a build of Drapery has to withstand, H1 to H52, each with its required outcome and a number that
//! decides. `drapery selftest --hard` and the project's tests run the same entries.
//!
//! A case is a function that makes its scene or its files, runs them on a [`bench::Bench`] and returns
//! [`case::Figure`]s. The bench looks after what holds for every case: finite numbers, no panic, the same bits on any
//! number of ranks and threads, no crossing where there was none at the start, and every degradation counted.
//!
//! ```
//! use drapery_core::scene::Integrator;
//! use drapery_selftest::CATALOGUE;
//! use drapery_selftest::bench::{Bench, Conditions};
//! use drapery_selftest::case::{Figure, Tier};
//!
//! // A limit on strain; this case does not start the command.
//! let case = CATALOGUE.iter().find(|case| case.id == "H6").expect("a hard case");
//! let drapery = "drapery".as_ref();
//! let conditions = Conditions { tier: Tier::Quick, integrator: Integrator::SemiImplicit, drapery };
//! let figures = (case.judge)(&mut Bench::new(conditions)?)?;
//! assert!(figures.iter().all(Figure::holds));
//! # Ok::<(), String>(())
//! ```

pub mod bench;
pub mod case;
mod cases;
pub mod combine;
pub mod drape;
pub mod files;
pub mod report;
pub mod scenes;
pub mod suite;
pub mod tangles;
pub mod tier;

pub use cases::CATALOGUE;
