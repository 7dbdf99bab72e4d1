//! Channels: numbers over time that a file holds, in the place of keys.
//!
//! ```toml
//! friction = { file = "props.abc", channel = "/control.friction" }
//! ```

use std::path::{Path as FilePath, PathBuf};

use drapery_core::Vec3;
use drapery_core::settings::SettingValue;

use crate::error::IoError;
use crate::formats;
use crate::input_file;
use crate::mesh_source::FrameRate;
use crate::units::{UpAxis, turned_up};

use super::deserialize::suggestion;
use super::diagnostics::SceneFileError;
use super::tree::{Node, Sources, Table, Value};

/// The file of a channel.
#[derive(Debug, Clone)]
pub(super) struct ChannelFile {
    /// The file.
    pub(super) path: PathBuf,
    /// Its frame rate; `None` for a channel that never changes.
    pub(super) rate: Option<FrameRate>,
}

/// A channel that was read. Its vectors have Y up.
pub(super) struct Channel {
    /// The file.
    pub(super) file: ChannelFile,
    /// Frames and values.
    pub(super) keys: Vec<(f64, SettingValue)>,
}

/// Keys of the table.
const FILE: &str = "file";
const CHANNEL: &str = "channel";
const SCALE: &str = "scale";
const UP: &str = "up";

/// Whether a table names a channel.
pub(super) fn is_channel(node: &Node) -> bool {
    node.as_table().is_some_and(|table| [FILE, CHANNEL].iter().any(|key| table.get(key).is_some()))
}

/// Reads the channel that a table names, in a scene of this frame rate whose files are relative to `folder`.
///
/// # Errors
/// An unknown key; the file, the object or the property is not there; a value is no number.
pub(super) fn read(node: &Node, sources: &Sources, (folder, fps): (&FilePath, f64)) -> Result<Channel, SceneFileError> {
    let table = node.as_table().cloned().unwrap_or_default();
    let form = || Some("write { file = \"props.abc\", channel = \"/object.property\" }".to_owned());
    let known = [FILE, CHANNEL, SCALE, UP];
    if let Some(entry) = table.0.iter().find(|entry| !known.contains(&entry.key.as_str())) {
        let what = format!("unknown key `{}` in a channel; it has `file`, `channel`, `scale` and `up`", entry.key);
        return Err(sources.error(&entry.key_place, what, Some(suggestion(&entry.key, &known))));
    }
    let scale = match table.get(SCALE).map(|node| &node.value) {
        None => 1.0,
        Some(Value::Integer(scale)) => *scale as f64,
        Some(Value::Float(scale)) if scale.is_finite() => *scale,
        Some(_) => return Err(sources.error(&node.place, "the `scale` of a channel has to be a number", form())),
    };
    let up = match table.get(UP).map(Node::as_text) {
        None => None,
        Some(Some("Y")) => Some(UpAxis::Y),
        Some(Some("Z")) => Some(UpAxis::Z),
        Some(_) => return Err(sources.error(&node.place, "the `up` of a channel has to be \"Y\" or \"Z\"", form())),
    };
    let text = |key: &str| {
        text(&table, key).ok_or_else(|| sources.error(&node.place, format!("a channel needs `{key}` as text"), form()))
    };
    let (file, channel) = (folder.join(text(FILE)?), text(CHANNEL)?);
    let Some((object, property)) = channel.rsplit_once('.').filter(|(object, _)| object.starts_with('/')) else {
        let what = format!("\"{channel}\" is not the path of an object and the name of its property");
        return Err(sources.error(&node.place, what, form()));
    };
    let of_file = |error: IoError| SceneFileError::of_file(Some(sources.location(&node.place)), &error);
    let reads = formats::of_file(&file).and_then(|format| format.channel);
    let Some(reads) = reads else {
        let what = format!("channels are not read from {}", file.display());
        return Err(sources.error(&node.place, what, Some("name an Alembic or USD file".to_owned())));
    };
    // The system's own words for a missing file are the same everywhere; ours carry advice.
    let samples = input_file::open(&file).and_then(|_| reads(&file, object, property)).map_err(of_file)?;
    let times: Vec<f64> = samples.values.iter().map(|(time, _)| *time).collect();
    let rate = FrameRate::of(samples.stated_rate, &times);
    let mut keys = Vec::new();
    let up = up.or(samples.up).unwrap_or_default();
    for (time, numbers) in samples.values {
        let value = match numbers.iter().map(|number| scale * number).collect::<Vec<_>>()[..] {
            [number] => SettingValue::Number(number),
            [x, y, z] => SettingValue::Vector(turned_up(Vec3::new(x, y, z), up).into()),
            _ => {
                let what = format!("a sample has {} numbers", numbers.len());
                let advice = "name a property of one number, or of three";
                return Err(of_file(IoError::data(&file, channel.to_owned(), what, advice)));
            }
        };
        // Programs round frame / fps differently.
        let frame = time * fps;
        let whole = frame.round();
        keys.push((if (frame - whole).abs() < 1e-6 * whole.abs().max(1.0) { whole } else { frame }, value));
    }
    Ok(Channel { file: ChannelFile { path: file, rate }, keys })
}

fn text<'a>(table: &'a Table, key: &str) -> Option<&'a str> {
    table.get(key)?.as_text()
}
