//! Outcome of a check of a study.

/// Whether something holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It holds.
    Holds,
    /// It does not, and readers of the figures have to know.
    Fails,
    /// There is nothing to tell it from.
    Unknown,
    /// It need not hold of this scene.
    NotApplicable,
}

/// Something that should hold of a study.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Check {
    /// Property that should hold.
    pub name: &'static str,
    /// Whether.
    pub verdict: Verdict,
    /// Figures on which the verdict rests.
    pub why: String,
}

impl Check {
    pub(super) fn new(name: &'static str, verdict: Option<bool>, why: String) -> Self {
        let verdict = verdict.map_or(Verdict::Unknown, |holds| if holds { Verdict::Holds } else { Verdict::Fails });
        Self { name, verdict, why }
    }
}
