//! A hard case and what it found.

use crate::bench::Bench;
pub use crate::tier::Tier;

/// Function that makes scenes or files, runs them and measures; an error is a text that describes the failure.
pub type Judge = fn(&mut Bench<'_>) -> Result<Vec<Figure>, String>;

/// An entry of the catalogue.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// Its number in the catalogue, as in `H23`.
    pub id: &'static str,
    /// Difficulty of the case.
    pub title: &'static str,
    /// Required outcome.
    pub must: &'static str,
    /// Finds out.
    pub judge: Judge,
}

/// Requirement on the value of a figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bound {
    /// No more than this.
    AtMost(f64),
    /// No less than this.
    AtLeast(f64),
    /// This, to the last bit.
    Exactly(f64),
}

/// A number that decides.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Name of the quantity, with its unit.
    pub what: String,
    /// Value found.
    pub value: f64,
    /// Requirement on the value.
    pub bound: Bound,
}

impl Figure {
    /// A figure that may be this large.
    pub fn at_most(what: impl Into<String>, value: f64, bound: f64) -> Self {
        Self { what: what.into(), value, bound: Bound::AtMost(bound) }
    }

    /// A figure that has to be this large.
    pub fn at_least(what: impl Into<String>, value: f64, bound: f64) -> Self {
        Self { what: what.into(), value, bound: Bound::AtLeast(bound) }
    }

    /// A figure that can only be this.
    pub fn exactly(what: impl Into<String>, value: f64, bound: f64) -> Self {
        Self { what: what.into(), value, bound: Bound::Exactly(bound) }
    }

    /// Whether it is within its bound; what is not a number is not.
    pub fn holds(&self) -> bool {
        match self.bound {
            Bound::AtMost(bound) => self.value <= bound,
            Bound::AtLeast(bound) => self.value >= bound,
            Bound::Exactly(bound) => self.value == bound,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_within_no_bound() {
        for figure in [
            Figure::at_most("", f64::NAN, 1.0),
            Figure::at_least("", f64::NAN, 1.0),
            Figure::exactly("", f64::NAN, 1.0),
        ] {
            assert!(!figure.holds());
        }
        assert!(Figure::at_most("", 1.0, 1.0).holds() && Figure::at_least("", 1.0, 1.0).holds());
        assert!(!Figure::at_most("", 1.1, 1.0).holds() && !Figure::at_least("", 0.9, 1.0).holds());
    }
}
