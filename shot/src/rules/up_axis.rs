//! An up axis that the pose of a body contradicts, and gravity that does not pull along it.

use drapery_core::Vec3;
use drapery_core::effects::gravity;
use drapery_core::settings::SettingValue;
use drapery_io::input_motion::InputMotion;
use drapery_io::units::UpAxis;

use super::{Facts, Finding};

/// Least ratio of the height of a body along the other axis to its extent along `up`.
const HIGHER: f64 = 2.0;

/// Largest distance of the feet from zero, as a share of that height.
const FEET: f64 = 0.1;

/// Least reach of a body below zero and above along `up`, as a share of its extent there: a body that lies on the
/// ground does not reach that far.
const STRADDLES: f64 = 0.2;

/// Largest width of a body that can be a figure, arms outstretched, as a share of its height; ground is as wide as long.
const WIDER: f64 = 1.2;

/// Least extent of a figure along `up`, as a share of its height: ground is flatter.
const FLATTER: f64 = 0.06;

/// Least share of gravity that has to pull downwards: half of it is 60 degrees.
const DOWNWARDS: f64 = 0.5;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let bodies = facts.first_poses().filter_map(|(motion, bounds)| of_body(motion, bounds));
    bodies.chain(of_gravity(facts)).collect()
}

fn of_body(motion: &InputMotion, [low, high]: [Vec3; 2]) -> Option<Finding> {
    let units = motion.source.units();
    // The axis of the file that is not up, whichever way it was turned.
    let (other, [bottom, top]) = match units.up {
        UpAxis::Y => (UpAxis::Z, [low.z, high.z]),
        UpAxis::Z => (UpAxis::Y, [-high.z, -low.z]),
    };
    let (height, depth) = (top - bottom, high.y - low.y);
    let is_ground = depth < FLATTER * height || high.x - low.x > WIDER * height;
    let stands = height >= HIGHER * depth && bottom.abs() <= FEET * height && !is_ground;
    if !stands || low.y > -STRADDLES * depth || high.y < STRADDLES * depth {
        return None;
    }
    let up = units.up;
    let message = format!(
        "{}: with {up:?} up it lies on its back: it is {height:.2} m high along {other:?}, where its feet are on the ground, and \
         {depth:.2} m along {up:?}",
        motion.source.path().display()
    );
    let up = format!("up = \"{other:?}\"");
    let line = match (motion.own_units, motion.source.states_up_axis(), units.named()) {
        (true, ..) => format!("{up} in `units` of this body"),
        (false, false, _) => format!("{up} in [units]"),
        // Over what a file says of itself goes only what is said of that very file.
        (false, true, Some(length)) => format!("units = {{ length = \"{}\", {up} }} at this body", length.word()),
        (false, true, None) => format!("upAxis = \"{other:?}\" in the file, which states otherwise"),
    };
    Some(Finding { object: motion.label.clone(), message, line })
}

fn of_gravity(facts: &Facts<'_>) -> Option<Finding> {
    let Some(SettingValue::Vector(pull)) = facts.request(gravity::SPEC.name)?.settings.get("acceleration") else {
        return None;
    };
    let pull = Vec3::from(*pull);
    if pull == Vec3::zeros() || -pull.y >= DOWNWARDS * pull.norm() {
        return None;
    }
    let [x, y, z] = <[f64; 3]>::from(pull);
    let message = format!(
        "acceleration [{x}, {y}, {z}] does not pull down: numbers of a scene have Y up; `up` applies to files only"
    );
    let line = format!("acceleration = [0, -{}, 0]", (pull.norm() * 1e3).round() / 1e3);
    Some(Finding { object: "gravity".to_owned(), message, line })
}
