//! Caches in USD, as this program writes them: what every application needs of a stage over value clips.

use std::path::Path;

use drapery_io::cache_frames::{CacheFrames, CacheMesh, StoredFrame};
use drapery_io::error::IoError;

use super::{Cache, Motion, Verification};

/// Opens a cache and checks the rules that concern it alone.
pub(super) fn verify_file(path: &Path, prefix: String, found: &mut Verification) -> Result<Cache, IoError> {
    let stage = CacheFrames::open(path)?;
    let name = format!("{prefix}{}", stage.meshes()[0].name);
    let fps = stage.fps();
    times(&stage.meshes()[0], fps, &name, found);
    faces(&stage.meshes()[0], &name, found);
    if let Err(error) = stage.check_constants() {
        found.failures.push(format!("{name}: {error}"));
    }
    frames(&stage, fps, &name, found);
    Ok(Cache { prefix, meshes: Vec::new(), stage: Some(stage), fps })
}

/// What time is what: an application goes by time codes, and takes the rate from the stage.
fn times(mesh: &CacheMesh, fps: Option<f64>, name: &str, found: &mut Verification) {
    let (first, last) = (mesh.frames[0], mesh.frames[mesh.frames.len() - 1]);
    let seconds = |frame: i64| fps.map_or(String::new(), |fps| format!(", {:.6} s", frame as f64 / fps));
    let told = |frame: i64| format!("frame {frame} is time code {frame}{}", seconds(frame));
    found.facts.push(format!("{name}: {} samples; {}; {}", mesh.frames.len(), told(first), told(last)));
    if first == last {
        found.warnings.push(format!("{name}: a single time code; some renderers give no motion blur for one"));
    }
    if mesh.frames.windows(2).any(|pair| pair[1] != pair[0] + 1) {
        found.failures.push(format!("{name}: frames are missing between {first} and {last}"));
    }
}

fn faces(mesh: &CacheMesh, name: &str, found: &mut Verification) {
    let counts = &mesh.faces.face_counts;
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

/// Positions, velocities and extents of every frame; ends at the first that is wrong.
fn frames(stage: &CacheFrames, fps: Option<f64>, name: &str, found: &mut Verification) {
    let mesh = &stage.meshes()[0];
    let mut motion = Motion::default();
    let mut recent: Vec<StoredFrame> = Vec::new();
    let mut without_velocities = false;
    for (sample, frame) in mesh.frames.iter().enumerate() {
        let stored = match stage.stored_frame(0, sample) {
            Ok(stored) => stored,
            Err(error) => return found.failures.push(format!("{name}: frame {frame}: {error}")),
        };
        if let Some(what) = wrong_with(&stored, mesh.points) {
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
    if without_velocities {
        found.warnings.push(format!("{name}: no velocities: motion blur has to come from neighbouring samples"));
    }
    motion.judge(name, found);
}

/// What is wrong with a frame of a mesh with so many points.
fn wrong_with(frame: &StoredFrame, points: usize) -> Option<String> {
    let first_bad = |vectors: &[[f32; 3]]| vectors.iter().position(|v| v.iter().any(|x| !x.is_finite()));
    if frame.positions.len() != points {
        return Some(format!("the number of points changes from {points} to {}", frame.positions.len()));
    }
    if let Some(vertex) = first_bad(&frame.positions) {
        return Some(format!("vertex {vertex}: the position is not a finite number"));
    }
    if let Some(vertex) = frame.velocities.as_deref().and_then(first_bad) {
        return Some(format!("vertex {vertex}: the velocity is not a finite number"));
    }
    (!frame.has_bounds_of_points).then(|| "the extent is not that of the points".to_owned())
}
