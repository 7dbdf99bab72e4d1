//! Thickness that short edges lower.

use drapery_core::effects::self_repulsion;
use drapery_core::simulation::{LoweredThickness, Simulation};

use super::Finding;

/// The setting that says how much short edges lower.
const CLAMP: &str = "thickness_clamp";

/// Number of vertices of which one may be concerned without a warning: every mesh has a few short edges.
const FEW: u64 = 100;

pub(super) fn find(simulation: &Simulation) -> Vec<Finding> {
    let requests = &simulation.scene().description().effects;
    let is_decided = requests
        .iter()
        .any(|request| request.effect == self_repulsion::SPEC.name && request.settings.contains_key(CLAMP));
    let all = simulation.lowered_thickness().iter().filter(|_| !is_decided);
    let is_much = |found: &&LoweredThickness| found.vertices[0] * FEW > found.vertices[1];
    all.filter(is_much).map(of_garment).collect()
}

fn of_garment(found: &LoweredThickness) -> Finding {
    let smaller = if found.is_painted { "smaller values in the map are" } else { "a smaller thickness is" };
    let message = format!(
        "{}: their edges are short; longer edges or a larger `{CLAMP}` keep more, and {smaller} kept everywhere",
        found.kept()
    );
    // Rounded down, so that what is written holds.
    let kept = (found.least * 1e6).floor();
    let line = match (found.is_painted, &found.by_rule_with) {
        (true, _) => format!("values of at most {} into its map of `thickness`, which is in metres", kept / 1e6),
        (false, None) => format!("thickness = \"{} mm\"", kept / 1e3),
        (false, Some(_)) => format!("thickness = \"{} mm\" in its [[contact]]", kept / 1e3),
    };
    Finding { object: format!("garment \"{}\"", found.garment), message, line }
}
