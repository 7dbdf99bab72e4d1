//! Meshes of Alembic files as caches: their frames, and what is stored of one.

use drapery_alembic::{Bounds, DataType, GeomParam, PodType, PolyMesh, SamplingKind, Scope};
use drapery_core::Vec3;

use super::{Between, CacheMesh, StoredFrame, cut};
use crate::error::IoError;
use crate::formats::alembic_writer::{CROSSINGS, TRIANGLES, bounds_of, reverse, shifted};
use crate::mesh_data::Connectivity;

/// A frame number that lies this close to a whole number is that number: programs round frame / fps differently.
const WHOLE_FRAME: f64 = 1e-3;

/// Times of samples between frames are given in this many parts of a frame: what is finer is rounding of seconds.
const PARTS_OF_FRAME: f64 = 1e9;

/// A mesh, and which sample belongs to each of its frames, and to those between them.
pub(super) fn described(mesh: &PolyMesh, fps: Option<f64>) -> Result<(CacheMesh, Vec<usize>), IoError> {
    let times = mesh.times();
    let Sorted { frames, between, samples } = match (mesh.time_sampling().kind(), fps) {
        (SamplingKind::Cyclic, Some(fps)) => sorted(&times, fps),
        _ => Sorted { frames: frame_numbers(&times, fps), between: Vec::new(), samples: (0..times.len()).collect() },
    };
    let mut described = CacheMesh {
        name: mesh.object().path().to_owned(),
        points: 0,
        faces: Connectivity::default(),
        triangles: Vec::new(),
        frames,
        between,
    };
    if !times.is_empty() {
        let mut faces = mesh.faces(0)?;
        reverse(&faces.face_counts, &mut faces.face_indices);
        let first: Vec<Vec3> = mesh.world_positions(0)?.into_iter().map(Vec3::from).collect();
        described.points = first.len();
        described.triangles = triangles_of(mesh, &first).unwrap_or_default();
        described.faces = Connectivity { face_counts: faces.face_counts, face_indices: faces.face_indices };
    }
    Ok((described, samples))
}

/// The triangles that were simulated, if the file tells them, or the faces cut by the solver's rule.
pub fn triangles_of(mesh: &PolyMesh, points: &[Vec3]) -> Option<Vec<[u32; 3]>> {
    let stored =
        mesh.user_properties().and_then(|properties| properties.samples(TRIANGLES)?.elements::<i32, 3>(0).ok());
    let in_range = |corner: i32| u32::try_from(corner).ok().filter(|&v| (v as usize) < points.len());
    let triangle = |[a, b, c]: [i32; 3]| Some([in_range(a)?, in_range(b)?, in_range(c)?]);
    let stored = stored.and_then(|stored| stored.into_iter().map(triangle).collect::<Option<Vec<_>>>());
    if stored.is_some() {
        return stored;
    }
    let faces = mesh.faces(0).ok()?;
    let mut corners = faces.face_indices;
    reverse(&faces.face_counts, &mut corners);
    Some(cut(&faces.face_counts, &corners, points))
}

/// All that is stored of a sample; `of_file` are the bounds of everything in it.
pub(super) fn stored(mesh: &PolyMesh, sample: usize, of_file: Option<Bounds>) -> Result<StoredFrame, IoError> {
    let positions = mesh.positions(sample)?;
    let bounds = bounds_of(&positions);
    let matrix = mesh.world_matrix_at(mesh.time(sample))?;
    let in_world = shifted(bounds, [matrix[12], matrix[13], matrix[14]]);
    let same = |stored: Option<Bounds>, bounds: Bounds| stored.is_none_or(|stored| stored == bounds);
    let counts = mesh.user_properties().and_then(|properties| properties.samples(CROSSINGS));
    let crossings = counts.map(|counts| counts.values::<u32>(sample)).transpose()?;
    Ok(StoredFrame {
        has_bounds_of_points: same(mesh.bounds(sample)?, bounds) && same(of_file, in_world),
        velocities: mesh.velocities(sample)?,
        normals: normals_at_points(mesh, sample, positions.len())?,
        crossings: crossings.and_then(|values| values.first().copied()),
        positions,
    })
}

/// Normals, where the archive has one of single precision for each point as the caches of this program do.
fn normals_at_points(mesh: &PolyMesh, sample: usize, points: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
    let kind = DataType::new(PodType::F32, 3);
    let is_ours =
        |normals: &GeomParam| normals.scope() == Scope::Vertex && !normals.is_indexed() && normals.data_type() == kind;
    let Some(normals) = mesh.normals().filter(is_ours).filter(|normals| sample < normals.sample_count()) else {
        return Ok(None);
    };
    Ok(Some(normals.samples().elements::<f32, 3>(sample)?).filter(|all| all.len() == points))
}

/// Frame numbers of samples, or sample numbers where times are not those of whole frames.
fn frame_numbers(times: &[f64], fps: Option<f64>) -> Vec<i64> {
    let numbers: Option<Vec<i64>> = times.iter().map(|time| whole_frame(*time, fps?)).collect();
    numbers.unwrap_or_else(|| (0..times.len() as i64).collect())
}

/// Samples of a file that has several a frame.
#[derive(Debug, PartialEq)]
struct Sorted {
    frames: Vec<i64>,
    between: Vec<Between>,
    /// The numbers of the samples in the file: of the frames, then of those between.
    samples: Vec<usize>,
}

/// Whole frames and the samples between them; all samples by their numbers where none is a whole frame.
fn sorted(times: &[f64], fps: f64) -> Sorted {
    let (whole, others): (Vec<usize>, Vec<usize>) =
        (0..times.len()).partition(|sample| whole_frame(times[*sample], fps).is_some());
    if whole.is_empty() {
        let frames = (0..times.len() as i64).collect();
        return Sorted { frames, between: Vec::new(), samples: (0..times.len()).collect() };
    }
    let between =
        others.iter().map(|sample| Between::at((times[*sample] * fps * PARTS_OF_FRAME).round() / PARTS_OF_FRAME));
    Sorted {
        frames: whole.iter().filter_map(|sample| whole_frame(times[*sample], fps)).collect(),
        between: between.collect(),
        samples: whole.iter().chain(&others).copied().collect(),
    }
}

/// The frame that a time [s] is, if it is one.
fn whole_frame(time: f64, fps: f64) -> Option<i64> {
    let frame = time * fps;
    ((frame - frame.round()).abs() < WHOLE_FRAME).then_some(frame.round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_whole_numbers_or_else_samples_are_counted() {
        let times = [1001.0 / 24.0, 1002.0 / 24.0];
        assert_eq!(frame_numbers(&times, Some(24.0)), [1001, 1002]);
        assert_eq!(frame_numbers(&times, None), [0, 1]);
        assert_eq!(frame_numbers(&[0.0, 0.25 / 24.0], Some(24.0)), [0, 1]);
        let shutter = [1010.0, 1010.25, 1010.75, 1011.0, 1011.25].map(|frame: f64| frame / 24.0);
        let between = [(1010, 0.25), (1010, 0.75), (1011, 0.25)].map(|(frame, behind)| Between { frame, behind });
        let expected = Sorted { frames: vec![1010, 1011], between: between.into(), samples: vec![0, 3, 1, 2, 4] };
        assert_eq!(sorted(&shutter, 24.0), expected);
        let none = Sorted { frames: vec![0, 1], between: Vec::new(), samples: vec![0, 1] };
        assert_eq!(sorted(&shutter[1..3], 24.0), none);
    }
}
