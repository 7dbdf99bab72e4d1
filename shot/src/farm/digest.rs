//! Dependencies of a shot, in a form that can be kept and compared: the same shot may be continued, another may not.
//!
//! [`Fingerprint::of`] holds one digest each of the scene, of the content of every input file, and of the versions.
//! [`compare`] says in words what has changed since: changes that cannot alter a frame that is already there (the end
//! of the range, what is written, the name) are *allowed*; all others are *forbidden* unless somebody insists.
//!
//! The scene is compared value by value, as `resolved.toml` has them with all defaults, so that comments, order and
//! spelling of numbers do not matter; nor do keys at their defaults that only one of two programs knows. A value that names a
//! file stands for the content of the file: moving inputs to another folder is allowed.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf, absolute};

use drapery_io::error::IoError;
use drapery_io::input_file;
use drapery_io::memory_mesh::{MemoryMesh, MemoryMeshes};
use drapery_io::scene_file::{Defaults, UNSAID, names_file};
use drapery_io::sha256::hex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Digests by name: `scene`, `solver`, `format`, `application`, and `input:<path>` for each input file.
pub type Digests = BTreeMap<String, String>;

/// Name of the scene's digest.
const SCENE: &str = "scene";

/// Start of the names of input files' digests.
const INPUT: &str = "input:";

/// Keys of the scene that no frame which is already there depends on; a name that ends in a dot stands for a table.
const FREE_KEYS: [&str; 3] = ["shot.name", LAST_FRAME, "output."];

/// Keys among them that frames depend on all the same: at which times there are samples, at each of which a step ends, and which
/// frame is the first.
const SAMPLED: [&str; 3] = ["output.samples", "output.shutter", "output.preroll"];

/// Table of the scene that is about warnings alone: not even reported when it changes.
const WARNINGS: &str = "check.";

/// The range of the shot is compared by its ends.
const FRAMES: &str = "shot.frames";
const FIRST_FRAME: &str = "shot.first_frame";
const LAST_FRAME: &str = "shot.last_frame";

/// Keys that are younger than the first runs, without the indices of lists, with their defaults: at these the digest of a scene does
/// not hold them, so that it is that of the programs before. A new key with a default belongs here.
const YOUNGER: [(&str, &str); 4] =
    [("garment.rest_scale", "1"), ("solver.steps_per_frame", "8"), ("seam.keep_gap", "false"), ("seam.zip", "false")];

/// The preset of the solver, and its word in scenes of earlier programs that did not say one. What it stands for is written out
/// beside it, so that the word itself decides nothing.
const PRESET: (&str, &str) = ("solver.preset", "\"production\"");

/// Keys that earlier programs wrote out, with the values that stand for what this one does without them. The digest of a scene holds them,
/// so that it is the digest of these programs.
const GONE: [(&str, &str); 5] = [
    ("self_collision.after_position", "false"),
    ("self_repulsion.attraction", "true"),
    ("self_repulsion.per_collision_step", "false"),
    ("solver.body_friction", "\"whole_step\""),
    STRAIN_PER_STEP,
];
const STRAIN_PER_STEP: (&str, &str) = ("solver.strain_per_step", "0.1");

/// Key of the integrator.
const INTEGRATOR: &str = "solver.integrator";

/// Keys of the scene that say what caches hold: velocities, which faces, and attributes.
const FORM: [&str; 3] = ["output.velocities", "output.faces", "output.attributes"];

/// Longest value that is shown in full, in characters.
const SHOWN: usize = 48;

/// Bytes that are read from an input at a time.
const BLOCK: usize = 1 << 20;

/// Versions that a run depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Versions<'a> {
    /// `drapery_core::solver_version`: raised when results change.
    pub solver: u32,
    /// Word of the integrator that was taken: it stands in the place of `auto`, whose choice may differ in another program. `auto` itself
    /// where the integrator may change between frames.
    pub integrator: &'a str,
    /// Version of checkpoints.
    pub format: u32,
    /// Program and its version; another one may continue, as long as the other two are equal.
    pub application: &'a str,
}

/// Dependencies of a shot.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// For comparing, also from a checkpoint.
    pub digests: Digests,
    /// Values of the scene by their place, as in `garment[0].stretch.stiffness`: for telling which have changed.
    pub scene: BTreeMap<String, String>,
}

/// True if a scene with the table of a key does not have the key.
fn is_gone(scene: &BTreeMap<String, String>, key: &str) -> bool {
    let table = key.split_inclusive('.').next().unwrap_or(key);
    !scene.contains_key(key) && scene.keys().any(|other| other.starts_with(table))
}

/// Differences between two fingerprints, in words.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Changes {
    /// Changes with which a run goes on.
    pub allowed: Vec<String>,
    /// Changes that make it another shot.
    pub forbidden: Vec<String>,
}

impl Fingerprint {
    /// Computes the fingerprint of a scene with all defaults (`resolved`), its input files and the program. The scene
    /// file itself may be among the inputs: it is left out, because not every change of it matters.
    ///
    /// # Errors
    /// An input cannot be read.
    pub fn of(resolved: &str, scene_path: &Path, inputs: &[PathBuf], versions: Versions<'_>) -> Result<Self, IoError> {
        let table: toml::Table = toml::from_str(resolved).map_err(|error| {
            let advice = "this is a bug in Drapery; please report it with the scene";
            IoError::data(scene_path, "the scene with its defaults", error.to_string(), advice)
        })?;
        let mut scene = BTreeMap::new();
        flatten(&mut scene, "", &toml::Value::Table(table));
        split_frames(&mut scene);
        scene.retain(|key, value| !key.starts_with(WARNINGS) && !UNSAID.contains(&(key.as_str(), value.as_str())));
        // "auto" is the value of the programs before.
        scene.retain(|key, value| key != STRAIN_PER_STEP.0 || value != "\"auto\"");
        if let Some(written) = scene.get_mut(INTEGRATOR).filter(|written| *written == "\"auto\"") {
            *written = format!("\"{}\"", versions.integrator);
        }
        let missing: Vec<_> = GONE.into_iter().filter(|(key, _)| is_gone(&scene, key)).chain([PRESET]).collect();
        scene.extend(missing.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
        let mut digests = Digests::new();
        for input in inputs.iter().filter(|input| input.as_path() != scene_path) {
            digests.insert(input_name(input), content_digest(input)?);
        }
        let mut all = Sha256::new();
        for (key, value) in scene.iter().filter(|(key, value)| !is_free(key) && !is_younger_default(key, value)) {
            let (hash, rest) = by_content(&digests, key, value).unwrap_or(("", value));
            // Lengths keep one value from running into the next.
            all.update(format!("{key} {} {} {hash}{rest}\n", hash.len(), rest.len()));
        }
        digests.insert(SCENE.to_owned(), hex(&all.finalize()));
        missing.iter().for_each(|(key, _)| drop(scene.remove(*key)));
        digests.insert("solver".to_owned(), versions.solver.to_string());
        digests.insert("format".to_owned(), versions.format.to_string());
        digests.insert("application".to_owned(), versions.application.to_owned());
        Ok(Self { digests, scene })
    }

    /// With the digests of meshes in memory, which are inputs like files.
    #[must_use]
    pub fn with_meshes(mut self, meshes: &MemoryMeshes) -> Self {
        let name = |mesh: &MemoryMesh| format!("{INPUT}{}", mesh.name());
        self.digests.extend(meshes.iter().map(|mesh| (name(mesh), mesh.digest())));
        self
    }

    /// Returns the values of the scene for the contents of caches.
    pub(crate) fn form_of_caches(&self) -> [Option<&str>; 3] {
        FORM.map(|key| self.scene.get(key).map(String::as_str))
    }
}

/// Finds the changes from `old` to `new`. Digests alone are enough to see that there are some; the values of the
/// scene, where both have them, name them.
pub fn compare(old: &Fingerprint, new: &Fingerprint) -> Changes {
    let mut changes = Changes::default();
    let value =
        |side: &Fingerprint, name: &str| side.digests.get(name).cloned().unwrap_or_else(|| "unknown".to_owned());
    for (name, what) in [("solver", "version of the solver"), ("format", "version of checkpoints")] {
        let (old, new) = (value(old, name), value(new, name));
        if old != new {
            changes.forbidden.push(format!("{what} {old} -> {new}"));
        }
    }
    if value(old, "application") != value(new, "application") {
        let text = format!("program {} -> {}", value(old, "application"), value(new, "application"));
        changes.allowed.push(text);
    }
    for (name, hash) in old.digests.iter().filter_map(|(name, hash)| Some((name.strip_prefix(INPUT)?, hash))) {
        if new.digests.get(&format!("{INPUT}{name}")).is_some_and(|now| now != hash) {
            changes.forbidden.push(format!("input {name} has changed"));
        }
    }
    let has_values = !old.scene.is_empty() && !new.scene.is_empty();
    let is_explained = has_values && compare_scenes(old, new, &mut changes);
    let scene_differs = value(old, SCENE) != value(new, SCENE);
    if scene_differs && changes.forbidden.is_empty() && !is_explained {
        changes.forbidden.push("the scene has changed".to_owned());
    }
    changes
}

/// Values of the scene that differ, each in its list; a key that one of them does not have is there at its default. Returns whether
/// there is such a key, for which digests of the same scene differ.
fn compare_scenes(old: &Fingerprint, new: &Fingerprint, changes: &mut Changes) -> bool {
    let (defaults, mut has_filled) = (Defaults::default(), false);
    let keys = old.scene.keys().chain(new.scene.keys().filter(|key| !old.scene.contains_key(*key)));
    for key in keys {
        let (before, after) = (old.scene.get(key), new.scene.get(key));
        if before == after {
            continue;
        }
        if key == PRESET.0 {
            has_filled = true;
            continue;
        }
        let is_default = |side: &Fingerprint, value: &String| unsaid(&defaults, side, key).as_ref() == Some(value);
        let is_gone = |value: &String| GONE.contains(&(key.as_str(), value.as_str()));
        let fills = match (before, after) {
            (None, Some(value)) => is_default(old, value) || is_gone(value),
            (Some(value), None) => is_default(new, value) || is_gone(value),
            _ => false,
        };
        if fills {
            has_filled = true;
            continue;
        }
        let shown = |value: Option<&String>| value.map_or_else(|| "(nothing)".to_owned(), |text| shorten(text));
        let text = format!("{key} {} -> {}", shown(before), shown(after));
        let content = |side: &Fingerprint, value: Option<&String>| {
            let (hash, rest) = by_content(&side.digests, key, value?)?;
            Some((hash.to_owned(), rest.to_owned()))
        };
        let moved = content(old, before).is_some_and(|file| Some(file) == content(new, after));
        match is_free(key) || moved {
            true if moved => changes.allowed.push(format!("{text} (the same content)")),
            true => changes.allowed.push(text),
            false => changes.forbidden.push(text),
        }
    }
    has_filled
}

/// Returns the value of a key that a scene does not state: its default, where the table is there that it would stand
/// in.
fn unsaid(defaults: &Defaults, side: &Fingerprint, key: &str) -> Option<String> {
    let (table, _) = key.rsplit_once('.')?;
    has_table(defaults, &side.scene, table).then(|| defaults.of(key).map(|value| text(&value)))?
}

/// Whether a scene has a table, said or not.
fn has_table(defaults: &Defaults, scene: &BTreeMap<String, String>, table: &str) -> bool {
    let holds = |name: String| scene.range(name.clone()..).next().is_some_and(|(key, _)| key.starts_with(&name));
    let around = || table.rsplit_once('.').is_none_or(|(around, _)| has_table(defaults, scene, around));
    let is_said = scene.contains_key(table) || holds(format!("{table}.")) || holds(format!("{table}["));
    is_said || defaults.is_always_there(table) && around()
}

/// Whether a value is the default of a key that came after the first runs.
fn is_younger_default(key: &str, value: &str) -> bool {
    let is_key = |name: &str| {
        // Without the indices of lists.
        let words = key.split('.').map(|word| word.split_once('[').map_or(word, |(word, _)| word));
        words.eq(name.split('.'))
    };
    YOUNGER.iter().any(|(name, default)| value == *default && is_key(name))
}

/// Whether frames that are already there do not depend on a key.
fn is_free(key: &str) -> bool {
    !SAMPLED.contains(&key)
        && FREE_KEYS.iter().any(|free| if free.ends_with('.') { key.starts_with(free) } else { key == *free })
}

/// Content of the file that a value names, and what the value says besides (`@101`, the frame in the file).
fn by_content<'a>(digests: &'a Digests, key: &str, value: &'a str) -> Option<(&'a str, &'a str)> {
    let (table, last) = key.rsplit_once('.').unwrap_or(("", key));
    if !names_file(table, last) {
        return None;
    }
    let text = value.strip_prefix('"')?.strip_suffix('"')?;
    let path = text.rsplit_once('@').map_or(text, |(path, _)| path);
    [text, path].into_iter().find_map(|path| {
        let hash = digests.get(&input_name(Path::new(path)))?;
        Some((hash.as_str(), &text[path.len()..]))
    })
}

pub(crate) fn input_name(path: &Path) -> String {
    // A path that cannot be made absolute is empty or belongs to a folder that is gone; as it is, it still is a name.
    format!("{INPUT}{}", absolute(path).unwrap_or_else(|_| path.to_owned()).display())
}

/// Digest of all bytes of a file.
pub(crate) fn content_digest(path: &Path) -> Result<String, IoError> {
    let mut file = input_file::open(path)?;
    let (mut all, mut block) = (Sha256::new(), vec![0; BLOCK]);
    loop {
        match file.read(&mut block) {
            Ok(0) => return Ok(hex(&all.finalize())),
            Ok(count) => all.update(&block[..count]),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(IoError::reading(path, error)),
        }
    }
}

/// Writes the values of a scene under their places; lists of tables are counted through.
fn flatten(out: &mut BTreeMap<String, String>, place: &str, value: &toml::Value) {
    match value {
        toml::Value::Table(table) if !table.is_empty() => {
            for (key, inner) in table {
                let place = if place.is_empty() { key.clone() } else { format!("{place}.{key}") };
                flatten(out, &place, inner);
            }
        }
        toml::Value::Array(items) if !items.is_empty() && items.iter().all(toml::Value::is_table) => {
            for (index, inner) in items.iter().enumerate() {
                flatten(out, &format!("{place}[{index}]"), inner);
            }
        }
        _ => {
            out.insert(place.to_owned(), text(value));
        }
    }
}

/// A value as text; 2 and 2.0 are the same number.
fn text(value: &toml::Value) -> String {
    match value {
        toml::Value::Integer(number) => number.to_string(),
        // The shortest text that reads back to the same bits; whole numbers come out without a point.
        toml::Value::Float(number) => number.to_string(),
        toml::Value::Array(items) => format!("[{}]", items.iter().map(text).collect::<Vec<_>>().join(", ")),
        toml::Value::Table(table) => {
            let entries: Vec<String> = table.iter().map(|(key, value)| format!("{key} = {}", text(value))).collect();
            format!("{{{}}}", entries.join(", "))
        }
        toml::Value::String(text) => format!("{text:?}"),
        other => other.to_string(),
    }
}

/// Replaces the range of frames by its two ends: they do not mean the same.
fn split_frames(scene: &mut BTreeMap<String, String>) {
    let Some(range) = scene.get(FRAMES).and_then(|text| text.strip_prefix('"')?.strip_suffix('"')) else { return };
    // The first character may be the sign of a negative frame.
    let dash = range.char_indices().skip(1).find(|(_, c)| *c == '-').map(|(i, _)| i);
    let (first, last) = dash.map_or((range, range), |i| (&range[..i], &range[i + 1..]));
    let (first, last) = (first.trim().to_owned(), last.trim().to_owned());
    scene.remove(FRAMES);
    scene.insert(FIRST_FRAME.to_owned(), first);
    scene.insert(LAST_FRAME.to_owned(), last);
}

/// A text that fits on a line; of long ones the start.
fn shorten(text: &str) -> String {
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests;
