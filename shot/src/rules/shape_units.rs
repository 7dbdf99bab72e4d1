//! Numbers of shapes and pins that look as if they were in the units of the files.

use drapery_core::Vec3;
use drapery_core::effects::gravity;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyDescription, BodyShape, PinTarget, RigidMotion};
use drapery_core::settings::SettingValue;
use drapery_io::units::{LengthUnit, Units, UpAxis};

use super::{Facts, Finding, bounds};

/// Height of a person [m]: the size of a scene without files.
const PERSON: f64 = 1.7;

/// Least ratio of a length to the size of the contents of the files for the length to look wrong.
const LARGE: f64 = 5.0;

/// Gravity of the earth [m/s²], and how far from it a number in another unit may be, as a share.
const EARTH: f64 = 9.81;
const NEAR: f64 = 0.05;

/// The cosine below which ground stands upright: 60 degrees.
const UPRIGHT: f64 = 0.5;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let units = facts.output.units;
    let mut findings: Vec<Finding> = of_gravity(facts).into_iter().collect();
    if units == Units::SI {
        return findings;
    }
    let suspect = Suspect { unit: units.length, limit: LARGE * size_of_files(facts) };
    for body in &facts.scene.bodies {
        if let BodyShape::Rigid(shape) = &body.shape {
            findings.extend(suspect.shape(body, shape));
            findings.extend(suspect.place(body));
            findings.extend(upright(body, shape).filter(|_| units.up == UpAxis::Z));
        }
    }
    for (garment, mesh) in facts.scene.garments.iter().zip(facts.garments).filter(|(_, mesh)| !mesh.is_from_file()) {
        let extent = mesh.positions().ok().and_then(|all| bounds(&all)).map_or(0.0, |[low, high]| (high - low).max());
        let object = format!("garment \"{}\"", garment.name);
        findings
            .extend(suspect.length(&object, "it is", extent, |length| format!("its sizes in metres, {length} across")));
    }
    for (number, pin) in facts.scene.pins.iter().enumerate() {
        if let (PinTarget::Path { offsets, .. }, Some(garment)) = (&pin.target, facts.scene.garments.get(pin.garment)) {
            let farthest = offsets.iter().map(|(_, offset)| offset.amax()).fold(0.0, f64::max);
            let object = format!("garment \"{}\", pin {number}", garment.name);
            findings.extend(
                suspect.length(&object, "its path reaches", farthest, |length| {
                    format!("its path in metres, up to {length}")
                }),
            );
        }
    }
    findings
}

/// Measure that a length is compared with.
struct Suspect {
    /// The unit of the files.
    unit: LengthUnit,
    /// The length from which on one looks wrong [m].
    limit: f64,
}

impl Suspect {
    /// A length [m] that is too large, but would not be in the unit of the files; `line` says what to write for it in metres.
    fn length(&self, object: &str, what: &str, length: f64, line: impl Fn(f64) -> String) -> Option<Finding> {
        let meant = length * self.unit.metres();
        if length <= self.limit || meant > self.limit {
            return None;
        }
        let unit = self.unit.word();
        let message = format!(
            "{what} {} m: numbers of a scene are in metres; [units] length = \"{unit}\" applies to files only",
            rounded(length)
        );
        Some(Finding { object: object.to_owned(), message, line: line(rounded(meant)) })
    }

    fn shape(&self, body: &BodyDescription, shape: &Shape) -> Option<Finding> {
        let (key, size) = match *shape {
            Shape::HalfSpace => return None,
            Shape::Sphere { radius } => ("radius", radius),
            Shape::Capsule { radius, half_length } | Shape::Cylinder { radius, half_length } => {
                if radius < half_length { ("radius", radius) } else { ("half_length", half_length) }
            }
            // Ground is wide and not thick.
            Shape::Box { half_extents } => ("half_extents", half_extents.into_iter().fold(f64::INFINITY, f64::min)),
        };
        let unit = self.unit.word();
        self.length(&format!("body \"{}\"", body.name), &format!("its {key} is"), size, |metres| match *shape {
            Shape::Box { half_extents } => {
                format!("half_extents = {}", shown(Vec3::from(half_extents) * self.unit.metres()))
            }
            _ => format!("{key} = \"{size} {unit}\", which is {metres} m"),
        })
    }

    fn place(&self, body: &BodyDescription) -> Option<Finding> {
        let RigidMotion { path, .. } = &body.motion;
        let (_, farthest) = path.iter().max_by(|a, b| a.1.amax().total_cmp(&b.1.amax()))?;
        let key = if path.len() > 1 { "path" } else { "position" };
        let metres = *farthest * self.unit.metres();
        let line = |_| match key {
            "path" => format!("its path in metres, {} there", shown(metres)),
            _ => format!("position = {}", shown(metres)),
        };
        self.length(&format!("body \"{}\"", body.name), &format!("its {key} reaches"), farthest.amax(), line)
    }
}

/// Ground that stands upright.
fn upright(body: &BodyDescription, shape: &Shape) -> Option<Finding> {
    let normal = body.motion.rotation * Vec3::y();
    let stands = *shape == Shape::HalfSpace && normal.y.abs() < UPRIGHT;
    stands.then(|| Finding {
        object: format!("body \"{}\"", body.name),
        message: "it is a wall: shapes have Y up; [units] up = \"Z\" applies to files only".to_owned(),
        line: "shape = { half_space = {} } without a rotation for level ground".to_owned(),
    })
}

/// Gravity that is the earth's in another unit of length than metres.
fn of_gravity(facts: &Facts<'_>) -> Option<Finding> {
    let Some(SettingValue::Vector(pull)) = facts.request(gravity::SPEC.name)?.settings.get("acceleration") else {
        return None;
    };
    let size = Vec3::from(*pull).norm();
    let is_earth = |unit: &LengthUnit| (size * unit.metres() / EARTH - 1.0).abs() < NEAR;
    let unit = LengthUnit::ALL.into_iter().filter(|unit| *unit != LengthUnit::Metre).find(is_earth)?;
    let message = format!(
        "{size} m/s² looks like {}/s²: numbers of a scene are in metres; [units] applies to files only",
        unit.word()
    );
    let line = format!("acceleration = {}", shown(Vec3::from(*pull) * unit.metres()));
    Some(Finding { object: "gravity".to_owned(), message, line })
}

/// Largest extent of what the files hold [m]; that of a person without files.
fn size_of_files(facts: &Facts<'_>) -> f64 {
    let bodies = facts.first_poses().map(|(_, bounds)| bounds);
    let from_files = facts.garments.iter().filter(|mesh| mesh.is_from_file());
    let garments = from_files.filter_map(|mesh| bounds(&mesh.positions().ok()?));
    let extent = |[low, high]: [Vec3; 2]| (high - low).max();
    bodies.chain(garments).map(extent).max_by(f64::total_cmp).unwrap_or(PERSON)
}

fn rounded(number: f64) -> f64 {
    (number * 1e6).round() / 1e6
}

fn shown(vector: Vec3) -> String {
    let [x, y, z] = <[f64; 3]>::from(vector).map(rounded);
    format!("[{x}, {y}, {z}]")
}
