//! Garments that are far too small or too large for the bodies, and would fit in another unit.

use std::ops::RangeInclusive;

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyDescription, BodyShape};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::units::LengthUnit;

use super::{Facts, Finding, bounds};

/// Sizes of a garment, by a body's, that are plausible as they are: from a handkerchief to a bridal train.
const PLAUSIBLE: RangeInclusive<f64> = 0.05..=20.0;

/// Sizes of a garment, by a body's, that it has to have in the other unit.
const FITTING: RangeInclusive<f64> = 0.2..=5.0;

/// Smallest and largest coordinates.
type Bounds = [Vec3; 2];

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let from_files = facts.first_poses().map(|(motion, bounds)| (motion.label.clone(), bounds));
    let bodies: Vec<(String, Bounds)> = from_files.chain(facts.scene.bodies.iter().filter_map(of_shape)).collect();
    if bodies.is_empty() {
        return Vec::new();
    }
    let garments = facts.scene.garments.iter().zip(facts.garments);
    garments.filter_map(|(garment, mesh)| of_garment(&garment.name, mesh, &bodies)).collect()
}

fn of_garment(name: &str, mesh: &GarmentMesh, bodies: &[(String, Bounds)]) -> Option<Finding> {
    let units = mesh.units()?;
    let garment = bounds(&mesh.positions().ok()?)?;
    let size = diagonal(garment);
    let by_body = |body: Bounds| size / diagonal(body);
    if bodies.iter().any(|(_, body)| PLAUSIBLE.contains(&by_body(*body))) {
        return None;
    }
    let candidates = bodies.iter().flat_map(|body| LengthUnit::ALL.map(|unit| (body, unit)));
    let fitting = candidates.filter_map(|((label, body), unit)| {
        let factor = unit.metres() / units.metres;
        let ratio = by_body(*body) * factor;
        let fits = FITTING.contains(&ratio) && overlap(garment.map(|corner| corner * factor), *body);
        fits.then(|| (ratio.ln().abs(), label, diagonal(*body), unit))
    });
    let (_, label, of_body, unit) = fitting.min_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Finding {
        object: format!("garment \"{name}\""),
        message: format!(
            "its bounding box has a diagonal of {} m when read in {units}, but the box of {label} one of {} m. In {} the garment \
             would have the size of the body and lie on it: its unit is probably wrong",
            shown(size),
            shown(of_body),
            unit.plural()
        ),
        line: format!(
            "length = \"{}\" in [units], or units = {{ length = \"{}\", up = \"{:?}\" }} at this garment alone",
            unit.word(),
            unit.word(),
            units.up
        ),
    })
}

/// A ball, a capsule or a cylinder, with its box where its path begins, turned in any way. Other shapes may be ground, of any size.
fn of_shape(body: &BodyDescription) -> Option<(String, Bounds)> {
    let BodyShape::Rigid(shape) = &body.shape else { return None };
    // Half the extents of the box around a turned box.
    let turned = |x: f64, y: f64, z: f64| {
        let axes = [Vec3::x() * x, Vec3::y() * y, Vec3::z() * z].map(|axis| (body.motion.rotation * axis).abs());
        axes.iter().sum::<Vec3>()
    };
    let reach = match *shape {
        Shape::Sphere { radius } => Vec3::repeat(radius),
        Shape::Capsule { radius, half_length } => turned(radius, radius + half_length, radius),
        Shape::Cylinder { radius, half_length } => turned(radius, half_length, radius),
        Shape::Box { .. } | Shape::HalfSpace => return None,
    };
    let (_, center) = body.motion.path.first()?;
    Some((format!("body \"{}\"", body.name), [center - reach, center + reach]))
}

fn diagonal([low, high]: Bounds) -> f64 {
    (high - low).norm()
}

/// Whether two boxes have a point in common.
fn overlap(a: Bounds, b: Bounds) -> bool {
    (0..3).all(|axis| a[0][axis] <= b[1][axis] && b[0][axis] <= a[1][axis])
}

/// Three digits, also of a size in thousandths.
fn shown(size: f64) -> String {
    if (0.1..1e4).contains(&size) { format!("{size:.3}") } else { format!("{size:.2e}") }
}
