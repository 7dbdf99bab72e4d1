//! Thickness that short edges lower.

use drapery_core::effects::self_repulsion;
use drapery_core::simulation::{LoweredThickness, Simulation};

use super::{Finding, rounded_down};

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
    let [metres, millimetres] = [rounded_down(found.least, 6), rounded_down(found.least * 1e3, 3)];
    let line = match (found.is_painted, &found.by_rule_with) {
        (true, _) => format!("values of at most {metres} into its map of `thickness`, which is in metres"),
        (false, None) => format!("thickness = \"{millimetres} mm\""),
        (false, Some(_)) => format!("thickness = \"{millimetres} mm\" in its [[contact]]"),
    };
    Finding { object: format!("garment \"{}\"", found.garment), message, line }
}
