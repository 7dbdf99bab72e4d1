//! Garments that may pass through themselves and each other.

use drapery_core::effects::{self_collision, self_repulsion};

use super::{Facts, Finding};

/// Points from which on a garment can fold: ten by ten.
const CAN_FOLD: usize = 100;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.has_decided_on(self_collision::SPEC.name) {
        return Vec::new();
    }
    let folds: Vec<&str> = match facts.scene.garments.as_slice() {
        [one] if one.point_count() < CAN_FOLD => return Vec::new(),
        garments => garments.iter().map(|garment| garment.name.as_str()).collect(),
    };
    let names: Vec<String> = folds.iter().map(|name| format!("\"{name}\"")).collect();
    let message = match names.as_slice() {
        [_] => "it can fold, and nothing keeps it from passing through itself",
        _ => "nothing keeps them from passing through themselves and each other",
    };
    let object = if names.len() == 1 { "garment" } else { "garments" };
    let line = match facts.request(self_repulsion::SPEC.name) {
        Some(_) => "[self_collision]",
        None => "[self_repulsion] and [self_collision]",
    };
    vec![Finding {
        object: format!("{object} {}", names.join(", ")),
        message: message.to_owned(),
        line: line.to_owned(),
    }]
}
