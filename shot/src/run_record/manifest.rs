//! `manifest.json`: what a folder of output holds.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use drapery_io::atomic_file;
use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::input_file;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::MANIFEST;

/// Contents of a folder of output, for programs that pick it up.
///
/// Fields that a folder of an older program does not state are empty.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Manifest {
    /// Program and version.
    pub application: String,
    /// Name of the shot.
    pub shot: String,
    /// Scene file.
    pub scene: String,
    /// `running`, `stopped`, `done` or `failed`.
    pub state: Cow<'static, str>,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// First frame that is delivered.
    pub first_frame: i64,
    /// Last frame that is delivered.
    pub last_frame: i64,
    /// Last frame that is complete in every cache; `None` before the first.
    pub last_complete_frame: Option<i64>,
    /// Frames per second as a fraction.
    pub fps: String,
    /// Unit of length of the caches.
    pub length_unit: String,
    /// Up axis of the caches.
    pub up_axis: String,
    /// Origin of the positions in the caches [m], Y up.
    pub origin: [f64; 3],
    /// Caches of garments.
    pub garments: Vec<ManifestGarment>,
    /// Caches of bodies that the program makes: belts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<ManifestBody>,
    /// Garments, and parts of them as `GARMENT.PART`, that pass through each other by a rule of the scene; one twice for its own layers.
    /// A garment with `parts` stands for the rest of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ignored: Vec<[String; 2]>,
    /// Files over all caches of a format, relative to the folder.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub layers: Vec<String>,
    /// Caches of earlier attempts that this one no longer writes, relative to the folder. They end where it began.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub former: Vec<String>,
    /// Number of threads of each rank.
    pub threads: usize,
    /// The command line that continues the run.
    pub command: Option<String>,
    /// The last good checkpoint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checkpoint: Option<ManifestCheckpoint>,
    /// Every start of the run in this folder.
    pub attempts: Vec<AttemptRecord>,
}

/// The last good checkpoint.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ManifestCheckpoint {
    /// The file, relative to the folder.
    pub file: String,
    /// Last frame that it holds.
    pub frame: i64,
    /// States free of collisions since that frame.
    pub sub_step: u64,
}

/// One start of the run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AttemptRecord {
    /// Its number, that of its logs.
    pub attempt: u32,
    /// Machine.
    pub host: String,
    /// Process.
    pub pid: u32,
    /// When it began, as in `2026-05-04 09:30:00 UTC`; empty in the records of older programs.
    pub began: String,
    /// Number of threads of each rank.
    pub threads: usize,
    /// Number of ranks; 0 in the records of older programs, which had one.
    pub ranks: usize,
    /// First frame that it simulated, or would have.
    pub first_frame: i64,
    /// Last frame that it finished.
    pub last_frame: Option<i64>,
    /// Seconds that its frames took.
    pub seconds: f64,
    /// End of the attempt: `done`, `failed`, or the reason why it stopped; nothing while it runs, or when it was
    /// killed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<String>,
    /// Changes in spite of which it was told to go on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
}

/// The caches of one garment, or of its render mesh.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ManifestGarment {
    /// Its name.
    pub name: String,
    /// Full path of the object in the archive.
    pub object_path: String,
    /// Number of points.
    pub points: usize,
    /// Its material, if the scene names one; of a render mesh none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<String>,
    /// Largest strain that its material takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strain_limit: Option<f64>,
    /// The garment that it is the render mesh of, if it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub render_mesh_of: Option<String>,
    /// Parts that rules of contact name where something passes through something: ranges of points, each with its last one.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub parts: BTreeMap<String, Vec<[u32; 2]>>,
    /// File names, relative to the folder.
    pub files: Vec<String>,
}

/// The caches of a body.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ManifestBody {
    /// Its name.
    pub name: String,
    /// File names, relative to the folder.
    pub files: Vec<String>,
}

impl ManifestGarment {
    /// The name in `ignored` of the garment or the part that all these points belong to: the garment where they belong to several.
    pub fn object_of(&self, points: &[u32]) -> String {
        let holds = |ranges: &[[u32; 2]], point: u32| {
            let next = ranges.partition_point(|[first, _]| *first <= point);
            next.checked_sub(1).is_some_and(|place| point <= ranges[place][1])
        };
        // Of parts that overlap the last one has the point, as in the solver.
        let part = |point: u32| self.parts.iter().rfind(|(_, ranges)| holds(ranges, point)).map(|(name, _)| name);
        let first = points.first().and_then(|point| part(*point));
        match first.filter(|first| points.iter().all(|point| part(*point) == Some(*first))) {
            Some(part) => part_name(&self.name, part),
            None => self.name.clone(),
        }
    }
}

/// A part of a garment by its name, as in `coat.pocket`.
pub fn part_name(garment: &str, part: &str) -> String {
    format!("{garment}.{part}")
}

impl Manifest {
    /// Writes it into `folder`.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&self, folder: &Path) -> Result<(), IoError> {
        ManifestLock::take().write(self, folder)
    }
}

/// The right to write manifests: of the threads of a process, the one that has it.
#[derive(Debug)]
pub struct ManifestLock(#[expect(dead_code, reason = "held, not looked at")] MutexGuard<'static, ()>);

impl ManifestLock {
    /// Waits until no other thread has it.
    pub(crate) fn take() -> Self {
        static ONLY: Mutex<()> = Mutex::new(());
        Self(ONLY.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn write(&self, manifest: &Manifest, folder: &Path) -> Result<(), IoError> {
        // A struct of texts and numbers always has a JSON form.
        let text = serde_json::to_string_pretty(manifest).unwrap_or_default() + "\n";
        atomic_file::replace(&folder.join(MANIFEST), text.as_bytes())
    }
}

/// Caches that the manifest of a folder lists, and nothing else that it may name; none when there is no manifest that can be read.
pub fn listed_files(folder: &Path) -> Vec<PathBuf> {
    let text = input_file::bytes(&folder.join(MANIFEST)).unwrap_or_default();
    let manifest: Value = serde_json::from_slice(&text).unwrap_or_default();
    let objects = ["garments", "bodies"].into_iter().flat_map(|kind| manifest[kind].as_array().into_iter().flatten());
    caches_in(folder, objects.flat_map(|object| object["files"].as_array().into_iter().flatten()))
}

/// Caches that the manifest of a folder lists as those of earlier attempts, and nothing else that it may name.
pub(crate) fn former_files(folder: &Path) -> Vec<PathBuf> {
    let text = input_file::bytes(&folder.join(MANIFEST)).unwrap_or_default();
    let manifest: Value = serde_json::from_slice(&text).unwrap_or_default();
    caches_in(folder, manifest["former"].as_array().into_iter().flatten())
}

fn caches_in<'a>(folder: &Path, names: impl Iterator<Item = &'a Value>) -> Vec<PathBuf> {
    let is_cache = |path: &PathBuf| formats::of_file(path).is_some_and(|format| format.create.is_some());
    names.filter_map(|name| named_in(folder, name.as_str()?)).filter(is_cache).collect()
}

/// Files over all caches that the manifest of a folder lists, and nothing else that it may name.
pub(crate) fn listed_layers(folder: &Path) -> Vec<PathBuf> {
    let text = input_file::bytes(&folder.join(MANIFEST)).unwrap_or_default();
    let manifest: Value = serde_json::from_slice(&text).unwrap_or_default();
    let names = manifest["layers"].as_array().into_iter().flatten().filter_map(Value::as_str);
    let is_layer = |path: &PathBuf| {
        let mut over = formats::FORMATS.iter().filter_map(|format| format.shot.as_ref());
        let is_single = formats::of_file(path).is_some_and(|format| format.single.is_some());
        is_single || over.any(|over| path.extension().is_some_and(|of_path| of_path == over.extension))
    };
    names.filter_map(|name| named_in(folder, name)).filter(is_layer).collect()
}

/// The file of this name in a folder; `None` for what leads out of it: a manifest that was tampered with must not reach files
/// elsewhere.
pub(super) fn named_in(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut parts = Path::new(name).components();
    let is_name = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
    is_name.then(|| folder.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_manifest_that_was_tampered_with_names_no_files_but_caches_in_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let names = [
            "sheet.abc",
            "sheet.h5",
            "../a.abc",
            "/a.abc",
            "b/a.abc",
            "..",
            ".",
            "/",
            "",
            "scene.toml",
            "body.obj",
            "logs",
        ];
        let manifest = json!({"garments": [{"files": names}], "former": names});
        std::fs::write(folder.path().join(MANIFEST), manifest.to_string()).unwrap();
        let caches = ["sheet.abc", "sheet.h5"].map(|name| folder.path().join(name));
        assert_eq!([listed_files(folder.path()), former_files(folder.path())], [&caches[..], &caches[..]]);
    }
}
