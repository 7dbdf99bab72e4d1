//! Amount of testing asked of the hard cases.

/// Amount of testing asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Tier {
    /// Up to 2000 triangles a case, all of them in minutes.
    Quick,
    /// Larger and longer, and combinations of cases.
    Full,
    /// The longest, for a weekend.
    Soak,
}
