//! Numbers that change over time: `[[frame, value], …]` in the place of a number of an effect, a body or a contact.
//!
//! All that follows sees the value of the first key. Curves stand beside the tree, and in `resolved.toml` in their places.

use std::path::Path as FilePath;

use drapery_core::scene::number_curves::NumberCurve;
use drapery_core::settings::{Default, Field, SettingValue};

use super::channels::{self, Channel, ChannelFile};
use super::deserialize::dotted;
use super::diagnostics::SceneFileError;
use super::effects;
use super::fields::{self, TABLES};
use super::frame_rate;
use super::raw::Quantity;
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
    /// The file of a channel, which holds the keys.
    pub(super) file: Option<ChannelFile>,
}

impl Curve {
    /// The name that messages give it.
    pub(super) fn object(&self) -> String {
        format!("curve of {}", self.number)
    }
}

/// A map of a garment that changes over time.
#[derive(Debug, Clone)]
pub(super) struct MapKeys {
    /// Path of the map in the tree.
    pub(super) path: Path,
    /// The keys, as they are written.
    node: Node,
    /// Frames, and the names of maps.
    pub(super) keys: Vec<(f64, String)>,
}

/// Takes the maps that change over time out of the tree and leaves the name of their first keys.
///
/// # Errors
/// The first key that is none.
pub(super) fn take_maps(root: &mut Node, sources: &Sources) -> Result<Vec<MapKeys>, SceneFileError> {
    let mut curves = Vec::new();
    for path in fields::found(root, &["garment", fields::EACH, "maps"]) {
        let names = path.find(root).as_table().into_iter().flat_map(|table| &table.0).map(|entry| entry.key.clone());
        for name in names.collect::<Vec<_>>() {
            let path = path.clone().key(&name);
            let Some(node) = path.find_mut(root).filter(|node| matches!(node.value, Value::Array(_))) else { continue };
            let written = node.clone();
            let form = format!("{name} = [[frame, \"NAME\"], …], with frames that increase");
            let mut keys: Vec<(f64, String)> = Vec::new();
            for (frame, value) in frames(&name, &form, &written, sources)? {
                let Value::Text(map) = &value.value else {
                    let what = format!("the map of `{name}` at frame {frame} has to be a name or a file, as text");
                    return Err(sources.error(&value.place, what, Some(format!("write {form}"))));
                };
                keys.push((frame, map.clone()));
            }
            if let Some((_, first)) = keys.first() {
                node.value = Value::Text(first.clone());
            }
            curves.push(MapKeys { path, node: written, keys });
        }
    }
    Ok(curves)
}

/// Takes the curves out of the tree and leaves the value of their first keys.
///
/// # Errors
/// The first key that is none, and the first value that does not fit its number.
pub(super) fn take(root: &mut Node, sources: &Sources, folder: &FilePath) -> Result<Vec<Curve>, SceneFileError> {
    let of_effects = effects::tables(root).into_iter().map(|(spec, path)| (spec.fields.iter().collect(), path));
    let of_rows = TABLES.iter().flat_map(|rows| {
        fields::found(root, rows.path).into_iter().map(|path| (rows.changing().collect::<Vec<&Field>>(), path))
    });
    let tables: Vec<(Vec<&'static Field>, Path)> = of_effects.chain(of_rows).collect();
    let mut curves = Vec::new();
    for (fields, path) in tables {
        for field in fields {
            let path = path.clone().key(field.name);
            let fps = frames_per_second(root);
            let Some(node) = path.find_mut(root).filter(|node| is_curve(field, node)) else { continue };
            let written = node.clone();
            let (keys, first, file) = if channels::is_channel(&written) {
                let (keys, first, file) = of_channel(field, &written, sources, (folder, fps))?;
                (keys, first, Some(file))
            } else {
                let (keys, first) = keys(field, &written, sources)?;
                (keys, first, None)
            };
            node.value = first;
            let number = number(root, &path);
            curves.push(Curve { path, node: written, number, keys, file });
        }
    }
    Ok(curves)
}

/// Puts the curves back in their places.
pub(super) fn put_back(mut root: Node, curves: &[Curve], maps: &[MapKeys]) -> Node {
    let of_maps = maps.iter().map(|MapKeys { path, node, .. }| (path, node));
    for (path, node) in curves.iter().map(|Curve { path, node, .. }| (path, node)).chain(of_maps) {
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

/// Whether a list stands where a number, or a list of three, is expected: of lists, or of another length.
fn is_curve(field: &Field, node: &Node) -> bool {
    let is_list = |node: &Node| matches!(node.value, Value::Array(_));
    let is_vector = |items: &[Node]| !field.default.is_number() && items.len() == 3 && !items.iter().any(is_list);
    let is_curve = matches!(&node.value, Value::Array(items) if !is_vector(items));
    may_change(field) && (is_curve || channels::is_channel(node))
}

/// Frames per second of the shot; what is wrong with them is reported elsewhere.
fn frames_per_second(root: &Node) -> f64 {
    let fps = Path::default().key("shot").key("fps");
    let fps = match &fps.find(root).value {
        Value::Integer(fps) => Quantity::Number(*fps as f64),
        Value::Float(fps) => Quantity::Number(*fps),
        Value::Text(fps) => Quantity::Text(fps.clone()),
        _ => Quantity::Number(24.0),
    };
    frame_rate::frame_rate(&fps).map_or(24.0, |(numerator, denominator)| f64::from(numerator) / f64::from(denominator))
}

/// Keys of a channel, the value of the first, and the file.
fn of_channel(
    field: &Field,
    node: &Node,
    sources: &Sources,
    around: (&FilePath, f64),
) -> Result<(NumberCurve, Value, ChannelFile), SceneFileError> {
    let Channel { file, keys } = channels::read(node, sources, around)?;
    let wrong = |what: String| {
        let help = format!("correct it in {}, or name another channel or `scale`", file.path.display());
        sources.error(&node.place, what, Some(help))
    };
    let mut checked = NumberCurve::new();
    for (frame, value) in keys {
        if checked.last().is_some_and(|(before, _)| *before >= frame) {
            return Err(wrong(format!("the samples of the channel do not increase at frame {frame}")));
        }
        let value = field.check(&value).map_err(|what| wrong(format!("at frame {frame} of the channel: {what}")))?;
        checked.push((frame, value));
    }
    let first = match checked.first() {
        Some((_, SettingValue::Number(number))) => Value::Float(*number),
        Some((_, SettingValue::Vector(vector))) => {
            let of = |number: &f64| Node { value: Value::Float(*number), ..node.clone() };
            Value::Array(vector.iter().map(of).collect())
        }
        _ => return Err(wrong("the channel has no samples".to_owned())),
    };
    Ok((checked, first, file))
}

/// Keys of a curve, and the value of the first.
fn keys(field: &Field, node: &Node, sources: &Sources) -> Result<(NumberCurve, Value), SceneFileError> {
    let form = format!("{} = [[frame, value], …], with frames that increase", field.name);
    let Value::Array(_) = &node.value else {
        return Err(sources.error(&node.place, field.expected(), Some(format!("write {form}"))));
    };
    let mut keys: NumberCurve = Vec::new();
    let mut first = None;
    for (frame, value) in frames(field.name, &form, node, sources)? {
        let checked =
            fields::setting(&value.value).ok_or_else(|| field.expected()).and_then(|value| field.check(&value));
        let wrong =
            |what| sources.error(&value.place, format!("at frame {frame}: {what}"), Some(key_form(field, frame)));
        keys.push((frame, checked.map_err(wrong)?));
        first.get_or_insert_with(|| value.value.clone());
    }
    // There is a key.
    Ok((keys, first.unwrap_or_else(|| node.value.clone())))
}

/// Shows how a key at a frame is written.
fn key_form(field: &Field, frame: f64) -> String {
    match (field.default.is_number(), field.dimension.si_unit()) {
        (false, _) => format!("write the key as [{frame}, [x, y, z]]"),
        (true, "") => format!("write the key as [{frame}, NUMBER]"),
        (true, unit) => format!("write the key as [{frame}, NUMBER], in {unit}, or as [{frame}, \"NUMBER UNIT\"]"),
    }
}

/// Frames and values of the keys of a curve with this name; `form` shows how one is written.
fn frames<'a>(
    name: &str,
    form: &str,
    node: &'a Node,
    sources: &Sources,
) -> Result<Vec<(f64, &'a Node)>, SceneFileError> {
    let wrong = |node: &Node, what: String| sources.error(&node.place, what, Some(format!("write {form}")));
    let Value::Array(items) = &node.value else { return Ok(Vec::new()) };
    let mut keys: Vec<(f64, &Node)> = Vec::new();
    for item in items {
        let pair = match &item.value {
            Value::Array(pair) => pair.as_slice(),
            _ => &[],
        };
        let [frame, value] = pair else {
            return Err(wrong(item, format!("a key of `{name}` has to be [frame, value]")));
        };
        let frame = match frame.value {
            Value::Integer(frame) => frame as f64,
            Value::Float(frame) if frame.is_finite() => frame,
            _ => return Err(wrong(frame, format!("the frame of a key of `{name}` has to be a number"))),
        };
        if let Some((before, _)) = keys.last().filter(|(before, _)| *before >= frame) {
            return Err(wrong(item, format!("frames of `{name}` have to increase: {frame} comes after {before}")));
        }
        keys.push((frame, value));
    }
    if keys.is_empty() {
        return Err(wrong(node, format!("the curve of `{name}` has no keys")));
    }
    Ok(keys)
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
            (plain.0, "friction = [[12, nan]]", plain.2, "write the key as [12, NUMBER]"),
            (plain.0, "friction = [[12]]", plain.2, "has to be [frame, value]"),
            (plain.0, "friction = [12, 0.5, 15, 0.2]", plain.2, "friction = [[frame, value], …]"),
            ("acceleration = [12, 0, -9, 0]", plain.1, plain.2, "acceleration = [[frame, value], …]"),
            (plain.0, "friction = []", plain.2, "the curve of `friction` has no keys"),
            (
                plain.0,
                "friction = [[1, 0.5], [10, 0.2]]",
                plain.2,
                "ends at frame 10, before the first frame that is simulated, 11",
            ),
            (plain.0, plain.1, "stiffness = [[12, \"3 kg\"]]", "at frame 12"),
            (plain.0, plain.1, "stiffness = [[12, \"3 kg\"]]", "write the key as [12, NUMBER], in N/m"),
            (plain.0, plain.1, "stiffness = [[12, -3]]", "at frame 12: `stiffness` = -3 N/m"),
            ("acceleration = [[12, 3]]", plain.1, plain.2, "at frame 12: `acceleration` has to be three numbers"),
        ] {
            let text = resolved(&scene(gravity, body, stretch)).expect_err(expected);
            assert!(text.contains(expected), "{expected}: {text}");
        }
    }
}
