//! Two caches, frame by frame and vertex by vertex.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use drapery_core::Vec3;
use drapery_io::cache_frames::{Between, CacheFrames, CacheMesh};
use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::mesh_data::Uvs;

use super::{FrameDistance, PartComparison, Verdict, WorstVertex};

/// Frames that are named one by one when a side lacks them.
const NAMED_FRAMES: usize = 3;

/// Samples between frames that lie closer to each other are one, as a part of a frame.
const PARTS_OF_FRAME: f64 = 1e6;

/// A frame, and how far behind it a sample is, in these parts of a frame.
type Moment = (i64, i64);

/// Two opened caches, and what was found so far.
struct Pair {
    a: CacheFrames,
    b: CacheFrames,
    notes: Vec<String>,
    frames: BTreeMap<Moment, FrameDistance>,
    /// Sum of squared distances [m²] and number of vertices of each frame.
    squares: BTreeMap<Moment, (f64, usize)>,
}

/// Two caches. Where one does not tell its frame rate, its times are taken in frames of the other.
fn opened(a: &Path, b: &Path) -> Result<(CacheFrames, CacheFrames), IoError> {
    let (a_frames, b_frames) = (CacheFrames::open(a)?, CacheFrames::open(b)?);
    Ok(match (a_frames.fps, b_frames.fps) {
        (None, Some(fps)) => (CacheFrames::open_at_rate(a, fps)?, b_frames),
        (Some(fps), None) => (a_frames, CacheFrames::open_at_rate(b, fps)?),
        _ => (a_frames, b_frames),
    })
}

/// Compares all meshes of two caches in all frames that both have, and in all samples between them.
pub(super) fn compare(a: &Path, b: &Path, tolerance: f64) -> Result<PartComparison, IoError> {
    let (a_frames, b_frames) = opened(a, b)?;
    a_frames.samples.check_complete(None)?;
    b_frames.samples.check_complete(None)?;
    let mut pair =
        Pair { a: a_frames, b: b_frames, notes: Vec::new(), frames: BTreeMap::new(), squares: BTreeMap::new() };
    for (index_a, index_b) in pair.match_meshes() {
        pair.compare_mesh(index_a, index_b)?;
    }
    for (moment, (sum, count)) in &pair.squares {
        if let Some(distance) = pair.frames.get_mut(moment) {
            distance.rms = (sum / (*count).max(1) as f64).sqrt();
        }
    }
    let mut compared = PartComparison::new(a, b, Verdict::Equal);
    compared.notes = pair.notes;
    compared.frames = pair.frames.into_values().collect();
    compared.worst = worst(&compared.frames);
    compared.verdict = verdict(&compared, tolerance);
    if let Some(largest) = compared.frames.iter().filter_map(|f| f.max_velocity).max_by(f64::total_cmp)
        && largest > 0.0
    {
        let first = compared.frames.iter().find(|f| f.max_velocity > Some(0.0)).map_or(0, |f| f.frame);
        compared.notes.push(format!("velocities differ by up to {largest:.3e} m/s, first in frame {first}"));
    }
    Ok(compared)
}

/// The worst vertex of all frames; a distance that is not a number counts as the largest.
fn worst(frames: &[FrameDistance]) -> Option<WorstVertex> {
    // Of equal distances the first frame is named: that is where to look.
    let farther = |best: Option<&'_ FrameDistance>, next: &FrameDistance| best.is_none_or(|b| next.max > b.max);
    let mut found: Option<&FrameDistance> = None;
    for frame in frames.iter().filter(|frame| frame.max > 0.0) {
        if farther(found, frame) {
            found = Some(frame);
        }
    }
    let name = |f: &FrameDistance| WorstVertex {
        mesh: f.mesh.clone(),
        vertex: f.vertex,
        frame: f.frame,
        behind: f.behind,
        distance: f.max,
    };
    found.map(name)
}

fn verdict(compared: &PartComparison, tolerance: f64) -> Verdict {
    let largest = compared.worst.as_ref().map_or(0.0, |worst| worst.distance);
    let velocities_differ = compared.frames.iter().any(|frame| frame.max_velocity > Some(0.0));
    // A tolerance is a distance, so it cannot judge velocities; without one they have to be the same.
    match () {
        () if !compared.notes.is_empty() || largest > tolerance || velocities_differ && tolerance == 0.0 => {
            Verdict::Differs
        }
        () if largest > 0.0 || velocities_differ => Verdict::WithinTolerance,
        () => Verdict::Equal,
    }
}

impl Pair {
    /// Meshes of the same path, or the only ones of both sides. Others are noted.
    fn match_meshes(&mut self) -> Vec<(usize, usize)> {
        let (a, b) = (&self.a.meshes, &self.b.meshes);
        if a.len() == 1 && b.len() == 1 {
            return vec![(0, 0)];
        }
        let place = |meshes: &[CacheMesh], name: &str| meshes.iter().position(|mesh| mesh.name == name);
        let matched = a.iter().enumerate().filter_map(|(i, mesh)| Some((i, place(b, &mesh.name)?))).collect();
        let lacking = |meshes: &[CacheMesh], others: &[CacheMesh], side: &str| -> Vec<String> {
            let missing = meshes.iter().filter(|mesh| place(others, &mesh.name).is_none());
            missing.map(|mesh| format!("mesh {} exists only in the {side} cache", mesh.name)).collect()
        };
        let notes = [lacking(a, b, "first"), lacking(b, a, "second")].concat();
        self.notes.extend(notes);
        matched
    }

    fn compare_mesh(&mut self, index_a: usize, index_b: usize) -> Result<(), IoError> {
        let (mesh_a, mesh_b) = (self.a.meshes[index_a].clone(), self.b.meshes[index_b].clone());
        let name = &mesh_a.name;
        self.notes.extend(missing_frames(name, &mesh_a.frames, &mesh_b.frames));
        // What a format cannot hold is not missing in its files.
        if ![&self.a, &self.b].iter().any(|side| formats::holds_whole_frames(&side.path)) {
            self.notes.extend(missing_between(name, &mesh_a.between, &mesh_b.between));
        }
        if mesh_a.points != mesh_b.points {
            self.notes.push(format!(
                "{name}: {} points in the first and {} in the second: not the same mesh",
                mesh_a.points, mesh_b.points
            ));
            return Ok(());
        }
        if mesh_a.faces != mesh_b.faces {
            self.notes.push(format!("{name}: the faces differ"));
        } else {
            let uvs = [self.a.attributes(index_a)?.uvs, self.b.attributes(index_b)?.uvs];
            self.notes.extend(different_uvs(name, &uvs));
        }
        for (sample_a, frame) in mesh_a.frames.iter().enumerate() {
            if let Ok(sample_b) = mesh_b.frames.binary_search(frame) {
                self.compare_frame(name, (*frame, 0.0), (index_a, sample_a), (index_b, sample_b))?;
            }
        }
        let places: BTreeMap<Moment, usize> =
            (0..).zip(&mesh_b.between).map(|(place, at)| (moment(at), place)).collect();
        for (place_a, at) in mesh_a.between.iter().enumerate() {
            if let Some(place_b) = places.get(&moment(at)) {
                let samples = (mesh_a.frames.len() + place_a, mesh_b.frames.len() + place_b);
                self.compare_frame(name, (at.frame, at.behind), (index_a, samples.0), (index_b, samples.1))?;
            }
        }
        Ok(())
    }

    fn compare_frame(
        &mut self,
        name: &str,
        (frame, behind): (i64, f64),
        (mesh_a, sample_a): (usize, usize),
        (mesh_b, sample_b): (usize, usize),
    ) -> Result<(), IoError> {
        let a = self.a.positions(mesh_a, sample_a)?;
        let b = self.b.positions(mesh_b, sample_b)?;
        if a.len() != b.len() {
            let (first, second) = (a.len(), b.len());
            let at = frame as f64 + behind;
            self.notes.push(format!("{name}, frame {at}: {first} points in the first and {second} in the second"));
            return Ok(());
        }
        let (vertex, max, sum) = farthest(&a, &b);
        let rates = self.a.velocities(mesh_a, sample_a)?.zip(self.b.velocities(mesh_b, sample_b)?);
        let max_velocity = rates.map(|(a, b)| farthest(&a, &b).1);
        let moment = moment(&Between { frame, behind });
        let squares = self.squares.entry(moment).or_default();
        *squares = (squares.0 + sum, squares.1 + a.len());
        let fresh = FrameDistance { frame, behind, max, rms: 0.0, max_velocity, vertex, mesh: name.to_owned() };
        match self.frames.get_mut(&moment) {
            None => drop(self.frames.insert(moment, fresh)),
            Some(known) => {
                let velocity = known.max_velocity.zip(max_velocity).map(|(x, y)| x.max(y)).or(max_velocity);
                if max > known.max {
                    *known = fresh;
                }
                known.max_velocity = velocity;
            }
        }
        Ok(())
    }
}

/// The pair that is farthest apart, its distance [m], and the sum of all squared distances [m²]. A distance that is not
/// a number is infinite, unless both sides hold the same bits.
fn farthest(a: &[Vec3], b: &[Vec3]) -> (usize, f64, f64) {
    let (mut vertex, mut max, mut sum) = (0, 0.0, 0.0);
    for (index, (p, q)) in a.iter().zip(b).enumerate() {
        let same_bits = p.iter().zip(q.iter()).all(|(x, y)| x.to_bits() == y.to_bits());
        let distance = if same_bits { 0.0 } else { (p - q).norm() };
        let distance = if distance.is_nan() { f64::INFINITY } else { distance };
        sum += distance * distance;
        if distance > max {
            (vertex, max) = (index, distance);
        }
    }
    (vertex, max, sum)
}

/// Says in which way the texture coordinates of the corners of the same faces differ, if they do.
fn different_uvs(name: &str, uvs: &[Option<Uvs>; 2]) -> Option<String> {
    let (a, b) = match uvs {
        [None, None] => return None,
        [Some(_), None] => return Some(format!("{name}: only the first has texture coordinates")),
        [None, Some(_)] => return Some(format!("{name}: only the second has texture coordinates")),
        [Some(a), Some(b)] => (a, b),
    };
    let of =
        |uvs: &Uvs, corner: usize| uvs.values.get(*uvs.indices.get(corner)? as usize).map(|uv| uv.map(f32::to_bits));
    let corners = a.indices.len().max(b.indices.len());
    let mut other = (0..corners).filter(|corner| of(a, *corner) != of(b, *corner)).peekable();
    let first = *other.peek()?;
    let number = other.count();
    Some(format!(
        "{name}: the texture coordinates of {number} of {corners} face corners differ, first of corner {first}"
    ))
}

/// When a sample is.
fn moment(at: &Between) -> Moment {
    (at.frame, (at.behind * PARTS_OF_FRAME).round() as i64)
}

/// Says how many samples between frames only one side has.
fn missing_between(name: &str, a: &[Between], b: &[Between]) -> Vec<String> {
    let only = |these: &[Between], others: &[Between], side: &str| {
        let others: BTreeSet<Moment> = others.iter().map(moment).collect();
        let mut lone = these.iter().filter(|at| !others.contains(&moment(at))).peekable();
        let first = lone.peek().map(|at| at.frame as f64 + (at.behind * PARTS_OF_FRAME).round() / PARTS_OF_FRAME)?;
        let number = lone.count();
        Some(format!("{name}: only the {side} has {number} samples between frames, the first at frame {first}"))
    };
    [only(a, b, "first"), only(b, a, "second")].into_iter().flatten().collect()
}

/// Says which frames only one side has.
fn missing_frames(name: &str, a: &[i64], b: &[i64]) -> Vec<String> {
    let only = |these: &[i64], others: &[i64], side: &str| {
        let lone: Vec<i64> = these.iter().copied().filter(|frame| others.binary_search(frame).is_err()).collect();
        let text = match lone.as_slice() {
            [] => return None,
            few if few.len() <= NAMED_FRAMES => few.iter().map(i64::to_string).collect::<Vec<_>>().join(", "),
            many => format!("{} to {} ({} frames)", many[0], many[many.len() - 1], many.len()),
        };
        Some(format!("{name}: only the {side} has frame {text}"))
    };
    [only(a, b, "first"), only(b, a, "second")].into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_farthest_vertex_its_distance_and_the_sum_of_squares_are_found() {
        let a = [Vec3::zeros(), Vec3::x(), Vec3::y()];
        let b = [Vec3::new(0.0, 0.0, 3.0), Vec3::new(1.0, 4.0, 0.0), Vec3::y()];
        assert_eq!(farthest(&a, &b), (1, 4.0, 25.0));
        assert_eq!(farthest(&a, &a), (0, 0.0, 0.0));
        // What is not a number differs from everything but itself.
        let nan = [Vec3::repeat(f64::NAN), Vec3::x(), Vec3::y()];
        assert_eq!(farthest(&nan, &a).1, f64::INFINITY);
        assert_eq!(farthest(&nan, &nan).1, 0.0);
    }

    #[test]
    fn texture_coordinates_are_compared_by_corner_however_their_values_are_numbered() {
        let uvs = |values: &[[f32; 2]], indices: &[u32]| {
            Some(Uvs { name: String::new(), values: values.into(), indices: indices.into() })
        };
        let a = || uvs(&[[0.0, 0.0], [1.0, 0.0]], &[0, 1, 0]);
        let same = uvs(&[[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]], &[1, 0, 2]);
        assert_eq!(different_uvs("m", &[a(), same]), None);
        let moved = uvs(&[[0.0, 0.0], [0.5, 0.0]], &[0, 1, 1]);
        let expected = "m: the texture coordinates of 2 of 3 face corners differ, first of corner 1";
        assert_eq!(different_uvs("m", &[a(), moved]).as_deref(), Some(expected));
        let expected = "m: only the first has texture coordinates";
        assert_eq!(different_uvs("m", &[a(), None]).as_deref(), Some(expected));
        assert_eq!(different_uvs("m", &[None, None]), None);
    }

    #[test]
    fn frames_of_one_side_are_named() {
        assert_eq!(missing_frames("m", &[1, 2, 3], &[1, 2, 3]), Vec::<String>::new());
        assert_eq!(missing_frames("m", &[1, 2, 3], &[1]), ["m: only the first has frame 2, 3"]);
        let between =
            |behind: &[f64]| behind.iter().map(|behind| Between { frame: 7, behind: *behind }).collect::<Vec<_>>();
        let named = missing_between("m", &between(&[0.25, 0.75]), &between(&[0.250_000_000_1]));
        assert_eq!(named, ["m: only the first has 1 samples between frames, the first at frame 7.75"]);
        let many: Vec<i64> = (1..=9).collect();
        assert_eq!(missing_frames("m", &[1], &many), ["m: only the second has frame 2 to 9 (8 frames)"]);
    }
}
