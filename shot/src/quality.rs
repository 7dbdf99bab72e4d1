//! Counts that mean a loss of quality: what `drapery run --strict` does not accept.

/// Counts that should stay zero, and what each of them means.
pub const LIMITS: &[(&str, &str)] = &[
    (
        "crossings",
        "intersections (edges through triangles) of cloth with cloth or bodies at the end of a frame, in the \
         solver's positions",
    ),
    (CROSSINGS_WRITTEN, "intersections of cloth with cloth in the positions stored in the caches"),
    (
        CROSSINGS_OTHER_DIAGONAL,
        "intersections of cloth with cloth or bodies in the caches if faces are cut along the other diagonal, as renderers may \
         cut them",
    ),
    (
        "zone_fallbacks",
        "collisions that no impact zone could resolve; the cloth there was reset to its last collision-free \
         positions",
    ),
    ("cg_short", "velocity solves that did not converge to their tolerance"),
    ("retried_held", "collision steps in which vertices were held in place, because every other retry failed"),
    ("pairs_pinched", "contacts of cloth dropped because a body or pinned vertices pinch the cloth"),
    ("pins_behind", "pinned vertices that lagged behind their targets"),
    ("pins_stretched", "edges between two pinned vertices that their pins stretch by more than 30 %"),
    ("strain_over_limit", "edges above their strain limit, because bodies or pins pull them"),
    ("edges_overstretched", "edges at the end of a frame that are more than twice as long as at rest"),
    (
        "body_pinched",
        "vertices between two surfaces of bodies that have passed through one another; they follow the surfaces \
         without contact",
    ),
];

/// Counts of what is tried, one after the other, when a step goes wrong, and in words. Those that are [`LIMITS`] too leave a mark in
/// the result; steps that the others have mended are as good as any.
pub const RETRIES: &[(&str, &str)] = &[
    ("retried_shorter", "retried with half the time step"),
    ("retried_tighter", "retried with tighter solves"),
    ("retried_more_attempts", "retried with more attempts to resolve collisions"),
    ("retried_zones", "retried with impact zones from the start"),
    ("retried_thinner", "retried without repulsion around the vertices concerned"),
    ("retried_held", "retried with the vertices concerned held in place"),
];

/// Counts of what is less exact than the method, and what each of them means. A run names them, and `--strict` accepts them: shorter
/// steps have fewer.
pub const INEXACT: &[(&str, &str)] = &[
    (
        "friction_unsettled",
        "steps in which friction on bodies is not exact; a larger solver.steps_per_frame makes the steps shorter",
    ),
    (
        "layers_unsettled",
        "steps in which the push between a few vertices of layers is not exact; a larger solver.steps_per_frame makes \
         the steps shorter",
    ),
];

/// Whether a count is one that a result answers for.
pub fn is_limit(name: &str) -> bool {
    LIMITS.iter().any(|(limit, _)| *limit == name)
}

/// Name of the count of crossings in the positions that the caches store.
pub(crate) const CROSSINGS_WRITTEN: &str = "crossings_written";

/// Name of the count of crossings in what is stored that only another cut of the faces has.
pub(crate) const CROSSINGS_OTHER_DIAGONAL: &str = "crossings_other_diagonal";

/// A count that should have stayed zero.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exceeded {
    /// Its name.
    pub name: &'static str,
    /// Meaning of the count.
    pub meaning: &'static str,
    /// Total of all frames.
    pub total: u64,
    /// First frame in which it was not zero.
    pub first_frame: i64,
}

/// Returns the message about a count that rises for the first time; the total is then the total of the frame.
pub fn first_rise(limit: &Exceeded) -> String {
    let Exceeded { name, meaning, total, first_frame } = limit;
    format!("frame {first_frame}: {name} is {total} and should stay zero: {meaning}")
}

/// Adds the counts of a frame, given by name; returns those that rise in it for the first time, in the order of [`LIMITS`].
pub fn watch(exceeded: &mut Vec<Exceeded>, frame: i64, counted: impl Fn(&str) -> u64) -> Vec<Exceeded> {
    let mut risen = Vec::new();
    for &(name, meaning) in LIMITS {
        let amount = counted(name);
        match exceeded.iter_mut().find(|known| known.name == name) {
            Some(known) => known.total = known.total.saturating_add(amount),
            None if amount > 0 => risen.push(Exceeded { name, meaning, total: amount, first_frame: frame }),
            None => {}
        }
    }
    exceeded.extend_from_slice(&risen);
    risen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_tried_against_a_failure_ends_with_what_a_result_answers_for() {
        let limits: Vec<&str> = RETRIES.iter().map(|(name, _)| *name).filter(|name| is_limit(name)).collect();
        assert_eq!(limits, ["retried_held"]);
    }

    #[test]
    fn the_first_frame_and_the_total_of_each_limit_are_kept() {
        let mut exceeded = Vec::new();
        for (frame, crossings, other) in [(1001, 0, 5), (1002, 3, 5), (1003, 0, 5), (1004, 4, 5)] {
            let counted = |name: &str| if name == "crossings" { crossings } else { other * u64::from(name == "zones") };
            let risen = watch(&mut exceeded, frame, counted);
            assert_eq!(!risen.is_empty(), frame == 1002, "what has risen is reported once");
        }
        let (name, meaning) = LIMITS[0];
        assert_eq!(exceeded, [Exceeded { name, meaning, total: 7, first_frame: 1002 }]);
    }
}
