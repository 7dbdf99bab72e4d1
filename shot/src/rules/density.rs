//! Garments that weigh what no fabric weighs.

use drapery_core::scene::Mass;

use super::{Facts, Finding};

/// Mass per area of fabrics, with room on both sides [kg/m²]: silk gauze has 0.01 to 0.02, chain mail 10.
const FABRICS: std::ops::RangeInclusive<f64> = 0.005..=20.0;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let odd = facts.scene.garments.iter().filter_map(|garment| match garment.mass {
        Mass::Density(density) if !FABRICS.contains(&density) => Some((garment, density)),
        Mass::Density(_) | Mass::UniformTotal(_) => None,
    });
    odd.map(|(garment, density)| Finding {
        object: format!("garment \"{}\"", garment.name),
        message: format!(
            "its density is {density} kg/m², but fabrics have {} to {} kg/m²; a bare number is in kg/m²",
            FABRICS.start(),
            FABRICS.end()
        ),
        line: match FABRICS.contains(&(density * 1e-3)) {
            true => format!("density = \"{density} g/m²\", if that is meant"),
            false => "density = \"150 g/m²\" for a shirt".to_owned(),
        },
    })
    .collect()
}
