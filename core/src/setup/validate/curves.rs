//! Checks of numbers that change over time.

use crate::effects;
use crate::error::Problem;
use crate::scene::number_curves::{ChangingNumbers, NumberCurve, NumberPlace};
use crate::scene::{
    BodyDescription, ContactRule, ElasticDescription, GarmentDescription, PinDescription, SceneDescription,
    SeamDescription,
};
use crate::settings::{Field, SettingValue};

/// Paths, keys and values of the curves of a scene.
pub(crate) fn check_curves(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for (path, curve) in &description.curves {
        if let Err((what, advice)) = check_curve(description, path, curve) {
            problems.push(Problem::scene(format!("curve of {path}"), what, advice));
        }
    }
    for garment in &description.garments {
        for (of, curve) in &garment.map_curves {
            if let Err((what, advice)) = check_keys(curve.iter().map(|(frame, _)| *frame)) {
                let place = format!("garment \"{}\", map of {of} over time", garment.name);
                problems.push(Problem::scene(place, what, advice));
            }
        }
    }
}

fn check_curve(description: &SceneDescription, path: &str, curve: &NumberCurve) -> Result<(), (String, String)> {
    check_keys(curve.iter().map(|(frame, _)| *frame))?;
    for (frame, value) in curve {
        check_number(description, path, value)
            .map_err(|(what, advice)| (format!("at frame {frame}: {what}"), advice.to_owned()))?;
    }
    Ok(())
}

/// Frames that are no numbers or do not increase.
fn check_keys(frames: impl Iterator<Item = f64>) -> Result<(), (String, String)> {
    let advice = || "write [[frame, value], …] with frames that increase".to_owned();
    let mut before = None;
    for frame in frames {
        if !frame.is_finite() {
            return Err((format!("{frame} is no frame"), advice()));
        }
        if let Some(before) = before.filter(|before| *before >= frame) {
            return Err((format!("frame {frame} comes after frame {before}"), advice()));
        }
        before = Some(frame);
    }
    before.map(drop).ok_or_else(|| ("it has no keys".into(), advice()))
}

/// Checks a value of the number at a path.
///
/// # Errors
/// The scene has no such number, or the value does not fit it; with what to do.
pub(crate) fn check_number(
    description: &SceneDescription,
    path: &str,
    value: &SettingValue,
) -> Result<(), (String, &'static str)> {
    let Some(field) = number_field(description, path) else {
        let advice = "name a number of an effect, a garment, a pin, a body, a seam or a contact";
        return Err((format!("the scene has no number `{path}`"), advice));
    };
    let checked = match value {
        SettingValue::Number(_) | SettingValue::Vector(_) => field.check(value).map(drop),
        _ => Err(field.expected()),
    };
    checked.map_err(|what| (what, "give a value that fits it, in the SI unit"))
}

/// The row of the number at a path.
fn number_field(description: &SceneDescription, path: &str) -> Option<&'static Field> {
    match &description.number_place(path)? {
        NumberPlace::Effect(effect, key) => {
            let spec = effects::find(&description.effects[*effect].effect)?;
            spec.fields.iter().find(|field| field.name == key)
        }
        NumberPlace::Garment(_, key) => changing::<GarmentDescription>(key),
        NumberPlace::Pin(_, key) => changing::<PinDescription>(key),
        NumberPlace::Elastic(_, key) => changing::<ElasticDescription>(key),
        NumberPlace::Body(_, key) => changing::<BodyDescription>(key),
        NumberPlace::Seam(_, key) => changing::<SeamDescription>(key),
        NumberPlace::Contact(_, key) => changing::<ContactRule>(key),
    }
}

/// The row of a number that may change over time.
fn changing<T: ChangingNumbers>(key: &str) -> Option<&'static Field> {
    T::FIELDS.iter().find(|field| field.name == key && T::CHANGING.contains(&key))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::geometry::shapes::Shape;
    use crate::mesh::PolygonMesh;
    use crate::scene::{BodyShape, EffectRequest, GarmentDescription, RigidMotion};

    #[test]
    fn curves_of_nothing_out_of_order_or_out_of_range_are_named() {
        let mut description = SceneDescription::new("curves");
        let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
        description.garments.push(GarmentDescription::new("a.b", mesh, 0.2));
        let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
        description.bodies.push(BodyDescription::new("hero", ball, RigidMotion::at(Vec3::zeros())));
        description.effects.push(EffectRequest::of_scene("gravity"));
        description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 100.0));
        let number = SettingValue::Number;
        let fall = SettingValue::Vector([0.0, -9.81, 0.0]);
        for (path, curve, expected) in [
            ("gravity.acceleration", vec![(0.0, fall.clone()), (5.0, SettingValue::Vector([0.0; 3]))], None),
            ("garment.a.b.stretch.stiffness", vec![(1.0, number(10.0)), (3.0, number(20.0))], None),
            ("body.hero.friction", vec![(1.0, number(0.0))], None),
            ("body.hero.frictoin", vec![(1.0, number(0.0))], Some("has no number `body.hero.frictoin`")),
            ("garment.c.stretch.stiffness", vec![(1.0, number(10.0))], Some("has no number")),
            ("contact.0.friction", vec![(1.0, number(10.0))], Some("has no number")),
            (
                "garment.a.b.stretch.stiffness",
                vec![(3.0, number(1.0)), (3.0, number(2.0))],
                Some("frame 3 comes after frame 3"),
            ),
            ("garment.a.b.stretch.stiffness", vec![(f64::NAN, number(1.0))], Some("NaN is no frame")),
            ("garment.a.b.stretch.stiffness", vec![(3.0, number(f64::NAN))], Some("at frame 3")),
            ("garment.a.b.stretch.stiffness", vec![(3.0, number(-1.0))], Some("at frame 3")),
            ("gravity.acceleration", vec![(0.0, number(1.0))], Some("three numbers")),
            ("body.hero.friction", vec![(0.0, fall)], Some("a number")),
            ("gravity.acceleration", Vec::new(), Some("it has no keys")),
        ] {
            description.curves = [(path.to_owned(), curve)].into();
            let mut problems = Vec::new();
            check_curves(&description, &mut problems);
            let found = problems.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
            match expected {
                Some(expected) => assert!(found.contains(expected) && found.contains(path), "{path}: {found}"),
                None => assert!(found.is_empty(), "{path}: {found}"),
            }
        }
    }
}
