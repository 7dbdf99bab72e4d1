//! Nothing pulls the cloth down.

use drapery_core::effects::gravity;

use super::{Facts, Finding};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.has_decided_on(gravity::SPEC.name) {
        return Vec::new();
    }
    let message = "the scene has no gravity: cloth floats, and nothing drapes".to_owned();
    vec![Finding { object: String::new(), message, line: "[gravity]".to_owned() }]
}
