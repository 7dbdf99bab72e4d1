//! Printing that never fails: when nobody reads any more, the work goes on.

use std::fmt::Display;
use std::io::Write;

/// A line on standard output.
pub(crate) fn line(text: impl Display) {
    // A closed pipe (`drapery run … | head`) is no reason to lose a simulation.
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// A line on standard error.
pub(crate) fn complaint(text: impl Display) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}
