//! A body's friction in the place of what the garments' materials have.

use drapery_core::effects::body_collision;
use drapery_core::scene::BodyDescription;
use drapery_io::shot_description::Fabric;

use super::{Facts, Finding};

/// Numbers that differ by less are one.
const SAME: f64 = 1e-9;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.request(body_collision::SPEC.name).is_none() {
        return Vec::new();
    }
    let own = facts.scene.bodies.iter().zip(&facts.check.has_own_friction).filter(|(_, own)| **own);
    own.filter_map(|(body, _)| of_body(body, &facts.check.fabrics)).collect()
}

fn of_body(body: &BodyDescription, fabrics: &[Option<Fabric>]) -> Option<Finding> {
    let mut others: Vec<&Fabric> = Vec::new();
    for fabric in fabrics.iter().flatten().filter(|fabric| (fabric.friction - body.friction).abs() > SAME) {
        if !others.contains(&fabric) {
            others.push(fabric);
        }
    }
    let largest = fabrics.iter().flatten().map(|fabric| fabric.friction).max_by(f64::total_cmp)?;
    let list: Vec<String> = others.iter().map(|fabric| format!("{} of {}", fabric.friction, fabric.name)).collect();
    (!list.is_empty()).then(|| Finding {
        object: format!("body \"{}\"", body.name),
        message: format!(
            "its friction {} overrides the friction of the fabrics, {}; changing the fabric has no effect here. \
             Without the key, the largest of them is used",
            body.friction,
            list.join(" and ")
        ),
        line: format!("friction = {largest}, or leave it out"),
    })
}
