//! States of a session in files: checkpoints, with the places of bodies that the program has moved.

use std::fs;
use std::path::Path;

use drapery_core::Vec3;
use drapery_core::scene::BodyShape;
use drapery_core::snapshot::{SnapshotSink, SnapshotSource, ValueKind, Values};
use drapery_io::atomic_file::{check_own, put, unfinished};
use drapery_io::cache::APPLICATION;
use drapery_io::checkpoint::{CheckpointReader, CheckpointWriter, FORMAT_VERSION, Head, damaged};
use drapery_io::error::IoError;

use super::{Moved, Session};
use crate::error::ShotError;
use crate::farm::digest::{self, Fingerprint};

/// Section of bodies that the program has moved, and its version.
const SECTION: (&str, u32) = ("moved_bodies", 1);

impl Session {
    /// Writes the present state to a file, from which a session of the same shot goes on with the same bits, in any process and
    /// on any number of threads. The file appears as a whole or not at all.
    ///
    /// # Errors
    /// The file cannot be written; a folder, a pipe, a socket, a device or a file that is no checkpoint has its name; an input of the shot can no longer be read; as [`Session::shot`].
    pub fn save_file(&self, path: &Path) -> Result<(), ShotError> {
        if path.to_str().is_none() {
            return Err(IoError::OutputNotUtf8 { path: path.to_owned() }.into());
        }
        // The start of a file tells too little: files of other programs are HDF5 too.
        check_own(path, "checkpoint", |_| CheckpointReader::open(path).is_ok())?;
        let (shot, part) = (self.shot()?, unfinished(path));
        let (simulation, timeline) = (shot.simulation(), shot.timeline());
        let head = Head {
            format_version: FORMAT_VERSION,
            application: APPLICATION.to_owned(),
            shot: shot.name().to_owned(),
            frame: simulation.frame(),
            sub_step: self.sub_step,
            time: simulation.state().time,
            delivered: None,
            fps: [timeline.fps_numerator, timeline.fps_denominator],
            digests: shot.fingerprint()?.digests,
            caches: Vec::new(),
        };
        let write = |mut writer: CheckpointWriter| {
            writer.look_for_room(path);
            shot.remote_simulation.save(&mut writer);
            save_moved(&self.moved, &mut writer);
            writer.finish()
        };
        let written = CheckpointWriter::create(&part, &head).and_then(write);
        let written = written.and_then(|_| put(&part, path));
        if written.is_err() {
            // What is left of it would only confuse; if it cannot be removed either, the first error says why.
            let _ = fs::remove_file(&part);
        }
        Ok(written?)
    }

    /// Goes on from what [`Session::save_file`] or a run of the same shot has written.
    ///
    /// # Errors
    /// The file is missing, damaged or of another shot.
    pub fn restore_file(&mut self, path: &Path) -> Result<(), ShotError> {
        let mut reader = CheckpointReader::open(path)?;
        let now = self.shot()?.fingerprint()?;
        let then = Fingerprint { digests: reader.head.digests.clone(), ..Fingerprint::default() };
        let changes = digest::compare(&then, &now).forbidden;
        if !changes.is_empty() {
            let (path, changes) = (path.display(), changes.join("\n  "));
            let advice = "open the scene that it was saved of, with the same inputs";
            return Err(ShotError::Resume(format!(
                "{path}: this state belongs to a different shot\n  {changes}\n  help: {advice}"
            )));
        }
        let points = self.body_points()?;
        let moved = read_moved(&mut reader, path, &points)?;
        let (frame, sub_step) = (reader.head.frame, reader.head.sub_step);
        self.go_to((frame, moved), &mut reader, path)?;
        (self.sub_step, self.so_far, self.summary) = (sub_step, None, None);
        Ok(())
    }

    /// Number of points of each body; 0 of ideal shapes.
    fn body_points(&self) -> Result<Vec<usize>, ShotError> {
        let bodies = &self.shot()?.simulation().scene().description().bodies;
        let points =
            |shape: &BodyShape| if let BodyShape::Surface { point_count, .. } = shape { *point_count } else { 0 };
        Ok(bodies.iter().map(|body| points(&body.shape)).collect())
    }
}

/// Names of the arrays of a body.
fn names(body: usize) -> [String; 2] {
    [format!("body_{body}_here"), format!("body_{body}_next")]
}

fn save_moved(moved: &[Moved], sink: &mut dyn SnapshotSink) {
    if moved.iter().all(|moved| *moved == Moved::default()) {
        return;
    }
    sink.section(SECTION.0, SECTION.1);
    for (body, Moved { here, next }) in moved.iter().enumerate() {
        for (name, positions) in names(body).iter().zip([here, next]) {
            let Some(positions) = positions else { continue };
            sink.dataset(name, &[positions.len(), 3], ValueKind::F64);
            sink.rows(Values::F64(positions.iter().flatten().copied().collect()));
        }
    }
}

fn read_moved(reader: &mut CheckpointReader, path: &Path, points: &[usize]) -> Result<Vec<Moved>, ShotError> {
    let mut all = vec![Moved::default(); points.len()];
    let Some(section) = reader.outline().into_iter().find(|section| section.name == SECTION.0) else {
        return Ok(all);
    };
    let refuse = |what: String| ShotError::from(damaged(path, SECTION.0, what));
    if section.version != SECTION.1 {
        return Err(refuse(format!("its version {} is not known here", section.version)));
    }
    for (body, moved) in all.iter_mut().enumerate() {
        for (name, place) in names(body).iter().zip([&mut moved.here, &mut moved.next]) {
            let Some(dataset) = section.datasets.iter().find(|dataset| dataset.name == *name) else { continue };
            if dataset.shape != [points[body], 3] {
                return Err(refuse(format!("`{name}` does not fit the body")));
            }
            let values = reader.values(SECTION.0, name, 0..points[body]).map_err(|e| refuse(e.to_string()))?;
            let Values::F64(values) = values else { return Err(refuse(format!("`{name}` holds no numbers"))) };
            *place = Some(values.as_chunks().0.iter().map(|place: &[f64; 3]| Vec3::from(*place)).collect());
        }
    }
    Ok(all)
}
