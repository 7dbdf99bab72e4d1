//! Stages of USD, caches of this program and others: what every application needs of meshes that move.

use std::path::Path;

use drapery_io::cache_frames::{CacheFrames, CacheMesh, StoredFrame};
use drapery_io::error::IoError;

use super::{Cache, Motion, Verification, applications, attributes};

/// Opens a stage and checks the rules that concern it alone.
pub(super) fn verify_file(path: &Path, prefix: String, found: &mut Verification) -> Result<Cache, IoError> {
    let stage = CacheFrames::open(path)?;
    let fps = stage.fps;
    found.facts.push(applications::of_stage(&stage, &prefix));
    found.warnings.extend(stage.notes.iter().map(|note| format!("{prefix}{note}")));
    if let Err(error) = stage.samples.check_complete(None).and_then(|()| stage.samples.check_constants()) {
        found.failures.push(format!("{prefix}{error}"));
    }
    for (mesh, described) in stage.meshes.iter().enumerate() {
        let check = MeshCheck { stage: &stage, mesh, described, name: format!("{prefix}{}", described.name) };
        check.times(found);
        check.faces(found);
        check.frames(fps, found);
    }
    Ok(Cache { prefix, stage: Some(stage), fps, ..Cache::default() })
}

/// The checks of one mesh.
struct MeshCheck<'a> {
    stage: &'a CacheFrames,
    mesh: usize,
    described: &'a CacheMesh,
    name: String,
}

impl MeshCheck<'_> {
    /// Reports the time codes of the frames: an application goes by time codes, and takes the rate from the stage.
    fn times(&self, found: &mut Verification) {
        let (name, frames) = (&self.name, &self.described.frames);
        if self.stage.meshes[self.mesh].is_still {
            return found.facts.push(format!("{name}: it does not move"));
        }
        let (first, last) = (frames[0], frames[frames.len() - 1]);
        let seconds = |frame: i64| self.stage.fps.map_or(String::new(), |fps| format!(", {:.6} s", frame as f64 / fps));
        let code = |frame: i64| frame as f64 * self.stage.codes_per_frame;
        let time_code = |frame: i64| format!("frame {frame} is time code {}{}", code(frame), seconds(frame));
        let between = match self.described.between.len() {
            0 => String::new(),
            number => format!(" and {number} between them"),
        };
        found.facts.push(format!(
            "{name}: {} samples{between}; {}; {}",
            frames.len(),
            time_code(first),
            time_code(last)
        ));
        if first == last {
            found.warnings.push(format!("{name}: a single time code; some renderers give no motion blur for one"));
        }
        if frames.windows(2).any(|pair| pair[1] != pair[0] + 1) {
            found.failures.push(format!("{name}: frames are missing between {first} and {last}"));
        }
    }

    fn faces(&self, found: &mut Verification) {
        let (name, counts) = (&self.name, &self.described.faces.face_counts);
        if counts.is_empty() {
            found.failures.push(format!("{name}: it has no faces"));
        }
        let large = counts.iter().filter(|count| **count > 4).count();
        if large > 0 {
            let what = "faces have more than 4 corners, which some game engines refuse";
            found.warnings.push(format!("{name}: {large} {what}"));
        }
        if counts.iter().any(|count| *count < 3) {
            found.failures.push(format!("{name}: some faces have fewer than 3 corners"));
        }
    }

    /// Positions, velocities and extents of every sample; ends at the first that is wrong.
    fn frames(&self, fps: Option<f64>, found: &mut Verification) {
        let name = &self.name;
        let moves = !self.stage.meshes[self.mesh].is_still;
        let mut motion = Motion::default();
        let mut recent: Vec<StoredFrame> = Vec::new();
        let mut without_velocities = false;
        // What does not move is the same in all frames.
        let shown = if moves { self.described.frames.len() } else { 1 };
        for (sample, frame) in self.described.frames.iter().enumerate().take(shown) {
            let stored = match self.stage.samples.frame(self.mesh, sample) {
                Ok(stored) => stored,
                Err(error) => return found.failures.push(format!("{name}: frame {frame}: {error}")),
            };
            if let Some(what) = self.wrong_with(sample, &stored) {
                return found.failures.push(format!("{name}: frame {frame}: {what}"));
            }
            without_velocities |= stored.velocities.is_none();
            recent.push(stored);
            if let [before, now, after] = recent.as_slice() {
                if let (Some(velocities), Some(fps)) = (&now.velocities, fps) {
                    motion.compare(velocities, [&before.positions, &after.positions], 2.0 / fps);
                }
                recent.remove(0);
            }
        }
        for (index, at) in self.described.between.iter().enumerate() {
            let sample = self.described.frames.len() + index;
            let stored = self.stage.samples.frame(self.mesh, sample).map_err(|error| error.to_string());
            let what = match stored {
                Ok(stored) => self.wrong_with(sample, &stored),
                Err(error) => Some(error),
            };
            if let Some(what) = what {
                return found.failures.push(format!("{name}: frame {}: {what}", at.frame as f64 + at.behind));
            }
        }
        if without_velocities && moves {
            found.warnings.push(format!("{name}: no velocities: motion blur can only come from neighbouring samples"));
        }
        motion.judge(name, found);
    }

    /// Returns the fault of a frame, if it has one.
    fn wrong_with(&self, sample: usize, frame: &StoredFrame) -> Option<String> {
        let first_bad = |vectors: &[[f32; 3]]| vectors.iter().position(|v| v.iter().any(|x| !x.is_finite()));
        let (points, has) = (self.described.points, frame.positions.len());
        if has != points {
            return Some(format!("the number of points changes from {points} to {has}"));
        }
        match self.stage.samples.faces(self.mesh, sample) {
            Err(error) => return Some(error.to_string()),
            Ok(Some(faces)) if faces != self.described.faces => {
                return Some("the faces change; caches need the same points and faces in every frame".to_owned());
            }
            Ok(_) => {}
        }
        if let Some(vertex) = first_bad(&frame.positions) {
            return Some(format!("vertex {vertex}: the position is not a finite number"));
        }
        if frame.velocities.as_ref().is_some_and(|velocities| velocities.len() != points) {
            return Some("the number of velocities differs from the number of points".to_owned());
        }
        if let Some(vertex) = frame.velocities.as_deref().and_then(first_bad) {
            return Some(format!("vertex {vertex}: the velocity is not a finite number"));
        }
        if let Some(what) = attributes::wrong_in(frame) {
            return Some(what);
        }
        (!frame.has_bounds_of_points).then(|| "the extent does not match the points".to_owned())
    }
}
