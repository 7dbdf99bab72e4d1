//! What a run leaves beside its caches: `manifest.json` (what is there, replaced as a whole after every frame) and
//! `run.jsonl` (one line a frame with everything that was measured).

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};

use drapery_core::metrics::Metrics;
use drapery_core::simulation::{BrokenAttachment, FrameSummary, StrainRecord};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::atomic_file;
use crate::error::IoError;
use crate::farm::process::resident_bytes;
use crate::formats;
use crate::frame_digest::FrameDigests;
use crate::input_file;
use crate::shot::bundle::recovery_value;

/// Stage of a frame that holds all stages of the solver.
pub const SIMULATE: &str = "simulate";

/// File name of the manifest; a folder that has one holds a run.
pub const MANIFEST: &str = "manifest.json";

/// File name of the record.
pub const RECORD: &str = "run.jsonl";

/// File name of the scene with every default written out.
pub const RESOLVED: &str = "resolved.toml";

/// File name of what the run depends on, by which a changed scene or input is noticed.
pub const FINGERPRINT: &str = "fingerprint.json";

/// Frame numbers that there can be: far more than any shot has, and far from where sums of them would overflow.
pub(crate) const FRAMES: std::ops::RangeInclusive<i64> = -1_000_000_000..=1_000_000_000;

/// What a folder of output holds, for programs that pick it up.
///
/// What a folder of an older program does not say is empty.
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
    /// What the positions in the caches are counted from [m], Y up.
    pub origin: [f64; 3],
    /// Caches.
    pub garments: Vec<ManifestGarment>,
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
    /// How it ended: `done`, `failed`, or why it stopped; nothing while it runs, or when it was killed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end: Option<String>,
    /// What had changed, when it was told to go on all the same.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub changes: Vec<String>,
}

/// The caches of one garment.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ManifestGarment {
    /// Name of the garment.
    pub name: String,
    /// Full path of the object in the archive.
    pub object_path: String,
    /// Number of points.
    pub points: usize,
    /// File names, relative to the folder.
    pub files: Vec<String>,
}

impl Manifest {
    /// Writes it into `folder`.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&self, folder: &Path) -> Result<(), IoError> {
        // A struct of texts and numbers always has a JSON form.
        let text = serde_json::to_string_pretty(self).unwrap_or_default() + "\n";
        atomic_file::replace(&folder.join(MANIFEST), text.as_bytes())
    }
}

/// Caches that the manifest of a folder lists, and nothing else that it may name; none when there is no manifest that can be read.
pub fn listed_files(folder: &Path) -> Vec<PathBuf> {
    let text = input_file::bytes(&folder.join(MANIFEST)).unwrap_or_default();
    let manifest: Value = serde_json::from_slice(&text).unwrap_or_default();
    let garments = manifest["garments"].as_array().into_iter().flatten();
    let names =
        garments.flat_map(|garment| garment["files"].as_array().into_iter().flatten()).filter_map(Value::as_str);
    let is_cache = |path: &PathBuf| {
        let format = path.extension().and_then(|extension| formats::by_extension(extension.to_str()?));
        format.is_some_and(|format| format.create.is_some())
    };
    names.filter_map(|name| named_in(folder, name)).filter(is_cache).collect()
}

/// The file of this name in a folder; `None` for what leads out of it: a manifest that was tampered with must not reach files
/// elsewhere.
pub(crate) fn named_in(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut parts = Path::new(name).components();
    let is_name = matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None));
    is_name.then(|| folder.join(name))
}

/// The record being written.
#[derive(Debug)]
pub struct RunRecord {
    path: PathBuf,
    file: File,
}

impl RunRecord {
    /// Creates the record in `folder`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(folder: &Path) -> Result<Self, IoError> {
        let path = folder.join(RECORD);
        let file = File::create(&path).map_err(|e| IoError::creating(&path, e))?;
        Ok(Self { path, file })
    }

    /// Goes on with the record in `folder` after `frame`. If its length then is known [bytes], what comes after that is cut
    /// off, but for what had happened up to that frame: checkpoints, stops, errors.
    ///
    /// # Errors
    /// The file cannot be read, opened or cut.
    pub fn resume(folder: &Path, frame: i64, length: Option<u64>) -> Result<Self, IoError> {
        let path = folder.join(RECORD);
        let options = &mut OpenOptions::new();
        let file = options.read(true).append(true).create(true).open(&path).map_err(|e| IoError::creating(&path, e))?;
        let mut record = Self { path, file };
        let present = record.length()?;
        let cut = length.filter(|length| *length < present);
        // A record that somebody has changed has another length there: it stays, and `resume` voids what comes after.
        if let Some(length) = cut.filter(|length| record.ends_line(*length)) {
            let events = record.events_after(length, frame)?;
            record.file.set_len(length).map_err(|e| IoError::writing(&record.path, e))?;
            events.iter().try_for_each(|event| record.line(event))?;
        }
        record.end_half_line()?;
        Ok(record)
    }

    /// Whether a line ends at `length` bytes.
    fn ends_line(&mut self, length: u64) -> bool {
        let mut last = [0];
        let at = length.checked_sub(1).map(SeekFrom::Start);
        at.is_none_or(|at| self.file.seek(at).and_then(|_| self.file.read_exact(&mut last)).is_ok() && last == *b"\n")
    }

    /// Gives a line its end that a process which was killed left without, so that the next one is not lost with it.
    fn end_half_line(&mut self) -> Result<(), IoError> {
        match self.length().map(|length| self.ends_line(length))? {
            true => Ok(()),
            false => self.file.write_all(b"\n").map_err(|e| IoError::writing(&self.path, e)),
        }
    }

    /// Lines behind `length` bytes that are not about a frame and not about what came after `frame`.
    fn events_after(&mut self, length: u64, frame: i64) -> Result<Vec<Value>, IoError> {
        let mut tail = Vec::new();
        let read = self.file.seek(SeekFrom::Start(length)).and_then(|_| self.file.read_to_end(&mut tail));
        read.map_err(|e| IoError::reading(&self.path, e))?;
        let lines = tail.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice::<Value>(line).ok());
        let is_event = |line: &Value| {
            let of_frame = matches!(line["record"].as_str(), Some("frame" | "start") | None);
            !of_frame && line["frame"].as_i64().is_none_or(|at| at <= frame)
        };
        Ok(lines.filter(is_event).collect())
    }

    /// Its length [bytes].
    ///
    /// # Errors
    /// The system does not say.
    pub fn length(&self) -> Result<u64, IoError> {
        Ok(self.file.metadata().map_err(|e| IoError::reading(&self.path, e))?.len())
    }

    /// Appends a line.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn line(&mut self, value: &Value) -> Result<(), IoError> {
        let line = format!("{value}\n");
        self.file.write_all(line.as_bytes()).map_err(|e| IoError::writing(&self.path, e))
    }
}

/// The frame at which the simulation starts: nothing is simulated, `counts` holds what its writing counted.
pub fn start_record(frame: i64, spent: &Metrics, seconds: f64) -> Value {
    json!({"record": "start", "frame": frame, "seconds": seconds, "counts": counts(spent)})
}

/// Everything that was measured in one frame; `spent` is what reading and writing took and counted.
pub fn frame_record(summary: &FrameSummary, spent: &Metrics, seconds: f64) -> Value {
    let strain = |strain: &StrainRecord| json!({"garment": strain.garment, "vertices": strain.vertices, "strain": strain.strain});
    let mut all = summary.metrics.clone();
    spent.counts().iter().for_each(|(name, amount)| all.add_count(name.clone(), *amount));
    // What the solver took is told by its own stages.
    let around = spent.stages().iter().filter(|stage| stage.name != SIMULATE);
    around.for_each(|stage| all.add_time(stage.name.clone(), stage.seconds, stage.calls));
    let mut record = json!({
        "record": "frame",
        "frame": summary.frame,
        "seconds": seconds,
        "steps": summary.steps,
        "dt_min": summary.dt_min,
        "dt_max": summary.dt_max,
        "cg_iterations": summary.cg_iterations,
        "max_strain": summary.max_strain.as_ref().map(strain),
        "kinetic_energy": summary.kinetic_energy,
        "potential_energy": summary.potential_energy,
        "body_self_crossings": summary.body_self_crossings,
        "resident_bytes": resident_bytes(),
        "stages": stages(&all),
        "counts": counts(&all),
    });
    if let Some(between_pins) = &summary.between_pins {
        record["strain_between_pins"] = strain(between_pins);
    }
    if !summary.recoveries.is_empty() {
        record["recoveries"] = summary.recoveries.iter().map(recovery_value).collect();
    }
    if !summary.broken.is_empty() {
        let broken = |b: &BrokenAttachment| json!({"garment": b.garment, "vertex": b.vertex, "pin": b.pin});
        record["broken_attachments"] = summary.broken.iter().map(broken).collect();
    }
    record
}

/// Digests of what the caches hold of a frame, where they are not those that its own line has: caches that were written anew.
pub fn digests_record(frame: i64, digests: &FrameDigests) -> Value {
    json!({"record": "digests", "frame": frame, "digests": digests})
}

/// What is said of a frame in which steps went wrong, from the `recoveries` of its line; nothing where there are none.
pub fn recovery_line(recoveries: &[Value]) -> Option<String> {
    let first = recoveries.first()?;
    let word = |key: &str| first[key].as_str().unwrap_or_default();
    let vertices: Vec<u64> = first["vertices"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    let place = match word("garment") {
        "" => String::new(),
        garment => format!(", garment \"{garment}\", vertices {vertices:?}"),
    };
    let more = match recoveries.len() - 1 {
        0 => String::new(),
        also => format!(", and {also} more in this frame"),
    };
    let (frame, time) = (first["frame"].as_i64().unwrap_or_default(), first["time"].as_f64().unwrap_or_default());
    Some(format!("frame {frame}, time {time:.6} s{place}: {}; {}{more}", word("trouble"), word("rung")))
}

/// Stages with seconds and calls, in the order of their first call; over ranks the seconds are their mean, with the least and
/// the most of a rank beside it.
pub fn stages(metrics: &Metrics) -> Vec<Value> {
    let stage = |s: &drapery_core::metrics::Stage| {
        let mut stage = json!({"stage": s.name, "seconds": s.seconds, "calls": s.calls});
        if let Some([min, max]) = s.spread {
            stage["over_ranks"] = json!({"min": min, "mean": s.seconds, "max": max});
        }
        stage
    };
    metrics.stages().iter().map(stage).collect()
}

/// Counts by name.
pub fn counts(metrics: &Metrics) -> Value {
    metrics.counts().iter().map(|(name, amount)| (name.to_string(), Value::from(*amount))).collect()
}

/// A count of every frame in a record; frames that a resumed run came to again count the last time.
pub fn frame_counts(record: &Path, name: &str) -> BTreeMap<i64, u64> {
    let text = input_file::bytes(record).unwrap_or_default();
    let lines = text.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice::<Value>(line).ok());
    lines.filter_map(|line| Some((line["frame"].as_i64()?, line["counts"][name].as_u64()?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let manifest = json!({"garments": [{"files": names}]});
        std::fs::write(folder.path().join(MANIFEST), manifest.to_string()).unwrap();
        assert_eq!(listed_files(folder.path()), ["sheet.abc", "sheet.h5"].map(|name| folder.path().join(name)));
    }
}
