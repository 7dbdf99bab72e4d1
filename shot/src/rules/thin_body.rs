//! Bodies through which coarse cloth shows.

use drapery_core::effects::body_collision;

use super::{Facts, Finding};

/// A body that has so much of what is needed is thick enough: that is an estimate.
const ENOUGH: f64 = 0.9;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    if facts.request(body_collision::SPEC.name).is_none() {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (body, thickness) in facts.scene.bodies.iter().zip(facts.body_thickness) {
        if let Some(thickness) = thickness.filter(|found| found.is_written && body.thickness < ENOUGH * found.needed) {
            let needed = thickness.needed * 1e3;
            found.push(Finding {
                object: format!("body \"{}\"", body.name),
                message: format!(
                    "its thickness is {:.2} mm, but faces of cloth and body as coarse as these need {needed:.2} mm \
                     over its curvature: the body may show through between vertices; finer garments need less. Garments that are \
                     modelled closer to the body than that are pushed out at the start (rule `start_close`)",
                    body.thickness * 1e3
                ),
                line: format!(
                    "thickness = \"{needed:.2} mm\", or leave it out; or keep it with silence = [\"thin_body\"] in [check]"
                ),
            });
        }
    }
    found
}
