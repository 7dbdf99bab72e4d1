//! A body's friction in the place of what the garments' materials have.

use drapery_core::effects::body_collision;
use drapery_core::scene::{BodyDescription, ContactSide};
use drapery_io::shot_description::Fabric;

use super::{Facts, Finding};

/// Numbers that differ by less are one.
const SAME: f64 = 1e-9;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.request(body_collision::SPEC.name).is_none() {
        return Vec::new();
    }
    let own = facts.scene.bodies.iter().zip(&facts.check.has_own_friction).enumerate().filter(|(_, (_, own))| **own);
    let of_body = |(number, (body, _)): (usize, (&BodyDescription, _))| {
        let has_rule = |garment: usize| {
            let rule = facts.scene.contact_rule(ContactSide::Garment(garment), ContactSide::Body(number));
            rule.is_some_and(|rule| rule.ignore || rule.friction.is_some())
        };
        let fabrics = facts.check.fabrics.iter().enumerate().filter(|(garment, _)| !has_rule(*garment));
        finding(body, &fabrics.filter_map(|(_, fabric)| fabric.as_ref()).collect::<Vec<_>>())
    };
    own.filter_map(of_body).collect()
}

/// Friction of a body that differs from these fabrics'.
fn finding(body: &BodyDescription, fabrics: &[&Fabric]) -> Option<Finding> {
    let mut others: Vec<&Fabric> = Vec::new();
    for fabric in fabrics.iter().filter(|fabric| (fabric.friction - body.friction).abs() > SAME) {
        if !others.contains(fabric) {
            others.push(fabric);
        }
    }
    let largest = fabrics.iter().map(|fabric| fabric.friction).max_by(f64::total_cmp)?;
    let list: Vec<String> = others.iter().map(|fabric| format!("{} of {}", fabric.friction, fabric.name)).collect();
    (!list.is_empty()).then(|| Finding {
        object: format!("body \"{}\"", body.name),
        message: format!(
            "its friction {} overrides the friction of the fabrics, {}; changing the fabric has no effect here. \
             Without the key, each garment has its own",
            body.friction,
            list.join(" and ")
        ),
        line: format!("friction = {largest}, or leave it out, or [[contact]] with a `friction` for a garment"),
    })
}
