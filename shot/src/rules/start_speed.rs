//! Garments that start faster than cloth flies.

use drapery_core::Vec3;
use drapery_core::scene::GarmentDescription;

use super::{Facts, Finding};
use crate::check::JUMP;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    facts.scene.garments.iter().filter_map(of_garment).collect()
}

fn of_garment(garment: &GarmentDescription) -> Option<Finding> {
    let speeds = garment.start_velocities.iter().flatten().map(Vec3::norm).enumerate();
    let fastest = speeds.max_by(|a, b| a.1.total_cmp(&b.1));
    let (whose, speed) = match fastest {
        Some((vertex, speed)) => (format!("vertex {vertex} starts"), speed),
        None => ("it starts".to_owned(), garment.velocity.norm()),
    };
    (speed > JUMP).then(|| Finding {
        object: format!("garment \"{}\"", garment.name),
        message: format!(
            "{whose} at {speed:.0} m/s; cloth that meets something at more than {JUMP} m/s is overstretched or folded \
             at once; numbers of a scene are in metres per second, `[units]` applies to files only"
        ),
        line: "`velocity` and `random_velocity` in m/s: a hundredth of these numbers, if meant in cm/s".to_owned(),
    })
}
