//! Writing `run.jsonl`: one line a frame with everything that was measured, and the events between frames.

use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use drapery_core::metrics::Metrics;
use drapery_core::simulation::{BrokenHold, FrameSummary, GarmentStrains, HoldOwner, Recovery, StrainRecord};
use drapery_io::error::IoError;
use drapery_io::memory::resident_bytes;
use drapery_io::written_file;
use serde_json::{Value, json};

use super::RECORD;
use crate::frame_digest::FrameDigests;

/// Stage of a frame that holds all stages of the solver.
pub(crate) const SIMULATE: &str = "simulate";

/// The word of a line about a sample between frames.
const SAMPLE: &str = "sample";

/// The record being written.
#[derive(Debug)]
pub(crate) struct RunRecord {
    path: PathBuf,
    file: File,
    /// Length that was written or found [bytes].
    written: u64,
}

impl RunRecord {
    /// Creates the record in `folder`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub(crate) fn create(folder: &Path) -> Result<Self, IoError> {
        let path = folder.join(RECORD);
        let file = File::create(&path).map_err(|e| IoError::creating(&path, e))?;
        Ok(Self { path, file, written: 0 })
    }

    /// Goes on with the record in `folder` after `frame`. If its length then is known [bytes], what comes after that is cut
    /// off, but for what had happened up to that frame: checkpoints, stops, errors.
    ///
    /// # Errors
    /// The file cannot be read, opened or cut.
    pub(crate) fn resume(folder: &Path, frame: i64, length: Option<u64>) -> Result<Self, IoError> {
        let path = folder.join(RECORD);
        let options = &mut OpenOptions::new();
        let file = options.read(true).append(true).create(true).open(&path).map_err(|e| IoError::creating(&path, e))?;
        let mut record = Self { path, file, written: 0 };
        let present = record.length()?;
        let cut = length.filter(|length| *length < present);
        // A record that somebody has changed has another length there: it stays, and `resume` voids what comes after.
        if let Some(length) = cut.filter(|length| record.ends_line(*length)) {
            let events = record.events_after(length, frame)?;
            record.file.set_len(length).map_err(|e| IoError::writing(&record.path, e))?;
            events.iter().try_for_each(|event| record.line(event))?;
        }
        record.end_half_line()?;
        record.written = record.length()?;
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
            let of_frame = matches!(line["record"].as_str(), Some("frame" | "start" | SAMPLE) | None);
            !of_frame && line["frame"].as_i64().is_none_or(|at| at <= frame)
        };
        Ok(lines.filter(is_event).collect())
    }

    /// Its length [bytes].
    ///
    /// # Errors
    /// The system does not say.
    pub(crate) fn length(&self) -> Result<u64, IoError> {
        Ok(self.file.metadata().map_err(|e| IoError::reading(&self.path, e))?.len())
    }

    /// Appends a line.
    ///
    /// # Errors
    /// The disk refuses; what it has taken of the line is cut off, if that can be done.
    pub(crate) fn line(&mut self, value: &Value) -> Result<(), IoError> {
        let line = format!("{value}\n");
        if let Err(error) = self.file.write_all(line.as_bytes()) {
            let _ = self.file.set_len(self.written).and_then(|()| self.file.seek(SeekFrom::Start(self.written)));
            return Err(IoError::writing(&self.path, error));
        }
        self.written += line.len() as u64;
        Ok(())
    }

    /// Makes sure that the file is still there with all that was written.
    ///
    /// # Errors
    /// Another program has removed, replaced or cut it.
    pub(crate) fn check(&self) -> Result<(), IoError> {
        written_file::check(&self.path, &self.file, self.written)
    }
}

/// Returns the end record of a run that fails.
pub(crate) fn failure_record(error: &str) -> Value {
    json!({"record": "end", "state": "failed", "error": error})
}

/// Appends to the record in `folder` that the run failed, while another thread may have it open and will write no more.
///
/// # Errors
/// The record is not there, or the disk refuses.
pub(crate) fn record_failure(folder: &Path, error: &str) -> Result<(), IoError> {
    let path = folder.join(RECORD);
    let file = OpenOptions::new().read(true).append(true).open(&path).map_err(|e| IoError::creating(&path, e))?;
    let mut record = RunRecord { path, file, written: 0 };
    record.end_half_line()?;
    record.written = record.length()?;
    record.line(&failure_record(error))
}

/// The frame at which the simulation starts: nothing is simulated, `counts` holds what its writing counted.
pub(crate) fn start_record(frame: i64, spent: &Metrics, seconds: f64) -> Value {
    json!({"record": "start", "frame": frame, "seconds": seconds, "counts": counts(spent)})
}

/// Everything that was measured in one frame; `spent` is what reading and writing took and counted.
pub(crate) fn frame_record(summary: &FrameSummary, spent: &Metrics, seconds: f64) -> Value {
    let strain = |strain: &StrainRecord| json!({"garment": strain.garment, "vertices": strain.vertices, "strain": strain.strain});
    let strains = |of: &GarmentStrains| json!({"garment": of.garment, "largest": of.largest, "p99_9": of.p99_9});
    let mut all = summary.metrics.clone();
    spent.counts().iter().for_each(|(name, amount)| all.add_count(name.clone(), *amount));
    // What the solver took is in its own stages.
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
        "strains": summary.strains.iter().map(strains).collect::<Vec<_>>(),
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
    if let Some(over) = &summary.overstretched {
        record["overstretched"] = strain(&over.most);
        record["overstretched"]["edges"] = over.edges.into();
        record["overstretched"]["pinched"] = over.pinched.into();
        record["overstretched"]["bodies"] = json!(over.bodies);
    }
    if let Some(next) = summary.next_integrator {
        record["next_integrator"] = next.word().into();
    }
    if !summary.recoveries.is_empty() {
        record["recoveries"] = summary.recoveries.iter().map(recovery_value).collect();
    }
    let of_pin = |broken: &BrokenHold| match broken.of {
        HoldOwner::Pin(pin) => Some(json!({"garment": broken.garment, "vertex": broken.vertex, "pin": pin})),
        HoldOwner::Seam(_) => None,
    };
    let of_seam = |broken: &BrokenHold| match broken.of {
        HoldOwner::Seam(seam) => Some(json!({"garment": broken.garment, "vertex": broken.vertex, "seam": seam})),
        HoldOwner::Pin(_) => None,
    };
    for (key, broken) in [
        ("broken_attachments", summary.broken.iter().filter_map(of_pin).collect::<Vec<_>>()),
        ("broken_stitches", summary.broken.iter().filter_map(of_seam).collect()),
    ] {
        if !broken.is_empty() {
            record[key] = broken.into();
        }
    }
    record
}

/// Digests of what the caches hold of a frame, where they are not those that its own line has: caches that were written anew.
pub(crate) fn digests_record(frame: i64, digests: &FrameDigests) -> Value {
    json!({"record": "digests", "frame": frame, "digests": digests})
}

/// Digests of what the caches hold of a sample behind a frame, counted from 1.
pub(crate) fn sample_record((frame, sub_frame): (i64, usize), digests: &FrameDigests) -> Value {
    json!({"record": SAMPLE, "frame": frame, "sub_frame": sub_frame, "digests": digests})
}

/// A rung of the ladder as JSON.
pub(crate) fn recovery_value(recovery: &Recovery) -> Value {
    let Recovery { frame, time, failure, level, garment, vertices } = recovery;
    json!({
        "frame": frame, "time": time, "trouble": failure, "rung": level, "garment": garment, "vertices": vertices,
    })
}

/// Stages with seconds and calls, in the order of their first call; over ranks the seconds are their mean, with the least and
/// the most of a rank beside it.
pub(crate) fn stages(metrics: &Metrics) -> Vec<Value> {
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
pub(crate) fn counts(metrics: &Metrics) -> Value {
    metrics.counts().iter().map(|(name, amount)| (name.to_string(), Value::from(*amount))).collect()
}
