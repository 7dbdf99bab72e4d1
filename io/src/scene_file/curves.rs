//! Numbers that change over time: `[[frame, value], …]` in the place of a number of an effect, a body or a contact.
//!
//! All that follows sees the value of the first key. Curves stand beside the tree, and in `resolved.toml` in their places.

use drapery_core::scene::number_curves::NumberCurve;
use drapery_core::settings::{Default, Field};

use super::deserialize::dotted;
use super::diagnostics::SceneFileError;
use super::effects;
use super::fields::{self, CURVED};
use super::tree::{Node, Path, Segment, Sources, Value};

/// A curve of the scene file.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    /// Path of the number in the tree.
    pub(super) path: Path,
    /// The keys, as they are written.
    node: Node,
    /// Path of the number in the solver's description.
    pub(super) number: String,
    /// Frames and values, in the SI unit.
    pub(super) keys: NumberCurve,
}

/// Takes the curves out of the tree and leaves the value of their first keys.
///
/// # Errors
/// The first key that is none, and the first value that does not fit its number.
pub(super) fn take(root: &mut Node, sources: &Sources) -> Result<Vec<Curve>, SceneFileError> {
    let of_effects = effects::tables(root).into_iter().map(|(spec, path)| (spec.fields.iter().collect(), path));
    let of_rows = CURVED.iter().flat_map(|rows| {
        fields::found(root, rows.path).into_iter().map(|path| (rows.fields().collect::<Vec<&Field>>(), path))
    });
    let tables: Vec<(Vec<&'static Field>, Path)> = of_effects.chain(of_rows).collect();
    let mut curves = Vec::new();
    for (fields, path) in tables {
        for field in fields {
            let path = path.clone().key(field.name);
            let Some(node) = path.find_mut(root).filter(|node| is_curve(field, node)) else { continue };
            let written = node.clone();
            let (keys, first) = keys(field, &written, sources)?;
            node.value = first;
            let number = number(root, &path);
            curves.push(Curve { path, node: written, number, keys });
        }
    }
    Ok(curves)
}

/// Puts the curves back in their places.
pub(super) fn put_back(mut root: Node, curves: &[Curve]) -> Node {
    for Curve { path, node, .. } in curves {
        if let Some(place) = path.find_mut(&mut root) {
            *place = node.clone();
        }
    }
    root
}

/// Whether a number, or a list of three, may change over time.
pub(super) fn may_change(field: &Field) -> bool {
    let is_number = field.default.is_number() && !matches!(field.default, Default::Auto | Default::Count(_));
    is_number || matches!(field.default, Default::Vector(_) | Default::RequiredVector)
}

/// Whether a list of lists stands where a number, or a list of three, is expected.
fn is_curve(field: &Field, node: &Node) -> bool {
    let is_list = |node: &Node| matches!(node.value, Value::Array(_));
    may_change(field) && matches!(&node.value, Value::Array(items) if items.iter().any(is_list) || items.is_empty())
}

/// Keys of a curve, and the value of the first.
fn keys(field: &Field, node: &Node, sources: &Sources) -> Result<(NumberCurve, Value), SceneFileError> {
    let help = || Some(format!("write {} = [[frame, value], …], with frames that increase", field.name));
    let wrong = |node: &Node, what: String| sources.error(&node.place, what, help());
    let Value::Array(items) = &node.value else { return Err(wrong(node, field.expected())) };
    let mut keys: NumberCurve = Vec::new();
    let mut first = None;
    for item in items {
        let Value::Array(pair) = &item.value else {
            return Err(wrong(item, format!("a key of `{}` has to be [frame, value]", field.name)));
        };
        let [frame, value] = pair.as_slice() else {
            return Err(wrong(item, format!("a key of `{}` has to be [frame, value]", field.name)));
        };
        let frame = match frame.value {
            Value::Integer(frame) => frame as f64,
            Value::Float(frame) if frame.is_finite() => frame,
            _ => return Err(wrong(frame, format!("the frame of a key of `{}` has to be a number", field.name))),
        };
        if keys.last().is_some_and(|(before, _)| *before >= frame) {
            let before = keys.last().map_or(frame, |(before, _)| *before);
            return Err(wrong(
                item,
                format!("frames of `{}` have to increase: {frame} comes after {before}", field.name),
            ));
        }
        let checked =
            fields::setting(&value.value).ok_or_else(|| field.expected()).and_then(|value| field.check(&value));
        keys.push((frame, checked.map_err(|what| wrong(value, format!("at frame {frame}: {what}")))?));
        first.get_or_insert_with(|| value.value.clone());
    }
    let first = first.ok_or_else(|| wrong(node, format!("the curve of `{}` has no keys", field.name)))?;
    Ok((keys, first))
}

/// Path of a number in the solver's description: objects by their names.
fn number(root: &Node, path: &Path) -> String {
    let named = match path.0.as_slice() {
        [Segment::Key(kind), Segment::Index(_), rest @ ..] if kind == "garment" || kind == "body" => {
            let object = Path(path.0[..2].to_vec()).key("name");
            let name = object.find(root).as_text().unwrap_or_default();
            Some(format!("{kind}.{name}.{}", dotted(&Path(rest.to_vec()))))
        }
        _ => None,
    };
    named.unwrap_or_else(|| dotted(path))
}

#[cfg(test)]
mod tests {
    use std::path::Path as FilePath;

    use drapery_core::settings::SettingValue;

    use crate::scene_file::parse;
    use crate::shot_description::ShotDescription;

    /// A scene with these lines of gravity, of the body and of the garment's stretch.
    fn scene(gravity: &str, body: &str, stretch: &str) -> String {
        format!(
            "drapery = 1\nshot.frames = \"11-20\"\n[gravity]\n{gravity}\n[self_repulsion]\n\
             [[body]]\nname = \"ball\"\nshape.sphere.radius = 0.1\n{body}\n\
             [[garment]]\nname = \"g\"\ndensity = 0.2\n[garment.panel]\nresolution = 3\n[garment.stretch]\n{stretch}\n\
             [[contact]]\nbetween = [\"g\", \"ball\"]\nthickness = [[11, \"2 mm\"], [15.5, 0.004]]\n"
        )
    }

    fn resolved(text: &str) -> Result<ShotDescription, String> {
        let scene = parse(text, "s.toml", FilePath::new(""), &[]).map_err(|error| error.to_string())?;
        scene.resolve().map_err(|errors| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
    }

    #[test]
    fn curves_are_read_in_units_and_written_back() {
        let text = scene(
            "acceleration = [[11, [0, -9, 0]], [14, [0, 1, 0]]]",
            "friction = [[12, 0.5], [13, 0]]",
            "stiffness = [[11, \"4 N/cm\"], [20, 100]]",
        );
        let shot = resolved(&text).unwrap_or_else(|text| panic!("{text}"));
        let number = SettingValue::Number;
        let expected = [
            ("body.ball.friction", vec![(12.0, number(0.5)), (13.0, number(0.0))]),
            ("contact.0.thickness", vec![(11.0, number(0.002)), (15.5, number(0.004))]),
            ("garment.g.stretch.stiffness", vec![(11.0, number(400.0)), (20.0, number(100.0))]),
            (
                "gravity.acceleration",
                vec![(11.0, SettingValue::Vector([0.0, -9.0, 0.0])), (14.0, SettingValue::Vector([0.0, 1.0, 0.0]))],
            ),
        ];
        assert_eq!(shot.scene.curves, expected.map(|(path, curve)| (path.to_owned(), curve)).into());
        assert_eq!(shot.scene.bodies[0].friction, 0.5, "the value of the first key");
        let again = resolved(&shot.resolved).unwrap_or_else(|text| panic!("{text}\n{}", shot.resolved));
        assert_eq!(again.scene.curves, shot.scene.curves);
    }

    #[test]
    fn curves_that_cannot_be_are_named_with_their_line() {
        let plain = ("acceleration = [0, -9, 0]", "friction = 0.3", "stiffness = 300");
        for (gravity, body, stretch, expected) in [
            (
                plain.0,
                "friction = [[12, 0.5], [12, 0]]",
                plain.2,
                "frames of `friction` have to increase: 12 comes after 12",
            ),
            (plain.0, "friction = [[nan, 0.5]]", plain.2, "the frame of a key of `friction` has to be a number"),
            (plain.0, "friction = [[12, nan]]", plain.2, "at frame 12: `friction`"),
            (plain.0, "friction = [[12]]", plain.2, "has to be [frame, value]"),
            (plain.0, "friction = []", plain.2, "the curve of `friction` has no keys"),
            (
                plain.0,
                "friction = [[1, 0.5], [10, 0.2]]",
                plain.2,
                "ends at frame 10, before the first frame that is simulated, 11",
            ),
            (plain.0, plain.1, "stiffness = [[12, \"3 kg\"]]", "at frame 12"),
            (plain.0, plain.1, "stiffness = [[12, -3]]", "at frame 12: `stiffness` = -3 N/m"),
            ("acceleration = [[12, 3]]", plain.1, plain.2, "at frame 12: `acceleration` has to be three numbers"),
        ] {
            let text = resolved(&scene(gravity, body, stretch)).expect_err(expected);
            assert!(text.contains(expected), "{expected}: {text}");
        }
    }
}
