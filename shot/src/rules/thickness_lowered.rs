//! Thickness that short edges lower.

use drapery_core::effects::self_repulsion;
use drapery_core::simulation::{LoweredThickness, Simulation};

use super::Finding;

/// The setting that says how much short edges lower.
const CLAMP: &str = "thickness_clamp";

/// One vertex in so many may be concerned before it is said: every mesh has a few short edges.
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
    let message = format!(
        "{}: their edges are short; longer edges or a larger `{CLAMP}` keep more, and a smaller thickness is kept \
         everywhere",
        found.kept()
    );
    // Rounded down, so that what is written holds.
    let of_rule = if found.by_rule_with.is_some() { " in its [[contact]]" } else { "" };
    let line = format!("thickness = \"{} mm\"{of_rule}", (found.least * 1e6).floor() / 1e3);
    Finding { object: format!("garment \"{}\"", found.garment), message, line }
}
