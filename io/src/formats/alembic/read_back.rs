//! Meshes of Alembic files as caches: their frames, and what is stored of one.

use std::path::{Path, PathBuf};

use drapery_alembic::{
    Archive, Bounds, DataType, GeomParam, IDENTITY, Matrix, PodType, PolyMesh, Samples, Scope, TopologyVariance,
    transform_point,
};
use drapery_core::Vec3;
use globset::escape;

use super::read::{
    AlembicMesh, INVISIBLE, SAME_TIME, Winding, blend, changed, is_ours, merge_times, split_normals, take_hidden,
    transform_times,
};
use super::write::{CROSSINGS, TRIANGLES, bounds_of, shifted};
use crate::attributes::{LISTED, PREF, PointAttributes, StoredValues, THICKNESS};
use crate::cache_frames::rates::film_rate;
use crate::cache_frames::transforms::in_world;
use crate::cache_frames::{
    Between, CacheFrames, CacheMesh, CacheSamples, Shifted, StoredFrame, cut, listed_triangles, units,
};
use crate::error::IoError;
use crate::formats::Opening;
use crate::mesh_data::{Connectivity, MeshData, MeshReader};
use crate::normals::SplitNormals;
use crate::units::LengthUnit;

/// A frame number that lies this close to a whole number is that number: programs round frame / fps differently.
const WHOLE_FRAME: f64 = 1e-3;

/// Times of samples between frames are given in this many parts of a frame: what is finer is rounding of seconds.
const PARTS_OF_FRAME: f64 = 1e9;

/// An archive whose meshes are read sample by sample.
struct ArchiveSamples {
    path: PathBuf,
    archive: Archive,
    meshes: Vec<ArchiveMesh>,
    /// Bounds of everything.
    bounds: Option<Samples>,
    /// Frames a second, if the file tells or somebody says.
    fps: Option<f64>,
}

/// A mesh and its samples: those of its frames, then those between them.
#[derive(Debug)]
struct ArchiveMesh {
    mesh: PolyMesh,
    samples: Vec<Sample>,
    attributes: PointAttributes,
}

/// A time at which points, or a transform above them, are stored.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    /// When [s].
    time: f64,
    /// The stored points around it, and the share of the second.
    around: (usize, usize, f64),
}

/// Opens all meshes of an archive that are to be seen, in the order of their paths; frames are at the rate that is said, or else at the one that the
/// file tells.
///
/// # Errors
/// The archive is damaged, or nothing is to be seen of it.
pub(super) fn open(path: &Path, Opening { root, rate }: Opening) -> Result<CacheFrames, IoError> {
    let archive = root.map_or_else(|| Archive::open(path), |root| Archive::open_at(path, root))?;
    let word = |key: &str| archive.metadata().get(key).unwrap_or_default();
    let units = units(word("lengthUnit"), word("upAxis"));
    let states_length = LengthUnit::ALL.iter().any(|unit| unit.word() == word("lengthUnit"));
    let mut stored = PolyMesh::all(&archive)?;
    stored.sort_by(|a, b| a.object().path().cmp(b.object().path()));
    if stored.is_empty() {
        return Err(IoError::data(path, "objects", "it contains no mesh", "give a cache of a garment"));
    }
    let hidden = take_hidden(path, &mut stored, "show it before the export")?;
    let hidden = hidden.iter().map(|path| format!("{path} is left out: {INVISIBLE}")).collect();
    let stated_fps = archive.frames_per_second_hint();
    let fps = rate.or(stated_fps);
    let described = stored.into_iter().map(|mesh| ArchiveMesh::of(mesh, (&archive, fps)));
    let (meshes, described) = described.collect::<Result<Vec<_>, IoError>>()?.into_iter().unzip();
    let samples = ArchiveSamples { path: path.to_owned(), meshes, bounds: archive.bounds()?, archive, fps };
    let cache = CacheFrames::new(path, (units.into(), fps), described, samples);
    Ok(CacheFrames { states_length, hidden, stated_fps, ..cache })
}

impl CacheSamples for ArchiveSamples {
    fn world(&self, mesh: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        self.meshes[mesh].world(&self.archive, sample)
    }

    fn shifted(&self, mesh: usize, sample: usize) -> Result<Option<Shifted>, IoError> {
        let mesh = &self.meshes[mesh];
        let mut matrix = mesh.to_world(sample)?;
        let origin = [matrix[12], matrix[13], matrix[14]];
        matrix[12..15].fill(0.0);
        Ok(if matrix == IDENTITY { Some((origin, mesh.points(&self.archive, sample)?)) } else { None })
    }

    fn velocities(&self, mesh: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        let found = &self.meshes[mesh];
        let Some(rates) = found.velocities(sample)? else { return Ok(None) };
        let (time, frame) = (found.samples[sample].time, 1.0 / self.fps.unwrap_or(24.0));
        let at = |time| found.mesh.world_matrix_at(time);
        let around = ([at(time - frame / 2.0)?, at(time + frame / 2.0)?], frame);
        Ok(Some(in_world(rates, &found.points(&self.archive, sample)?, &at(time)?, Some(around))))
    }

    fn frame(&self, mesh: usize, sample: usize) -> Result<StoredFrame, IoError> {
        let mesh = &self.meshes[mesh];
        let (number, _, share) = mesh.samples[sample].around;
        if share > 0.0 {
            let (positions, velocities) = (mesh.points(&self.archive, sample)?, mesh.velocities(sample)?);
            let (normals, crossings, values) = (None, None, StoredValues::default());
            return Ok(StoredFrame { positions, velocities, normals, crossings, values, has_bounds_of_points: true });
        }
        let bounds = self.bounds.as_ref().filter(|bounds| number < bounds.len());
        let of_file = bounds.map(|bounds| bounds.elements::<f64, 6>(number)).transpose()?;
        stored((&self.path, &mesh.mesh), number, &mesh.attributes, of_file.and_then(|all| all.first().copied()))
    }

    fn attributes(&self, mesh: usize, about: &CacheMesh) -> Result<MeshData, IoError> {
        let start = self.meshes[mesh].samples.first().map_or(0.0, |sample| sample.time);
        AlembicMesh::open(&self.path, Some(&escape(&about.name)))?.mesh_at(start)
    }

    fn faces(&self, mesh: usize, sample: usize) -> Result<Option<Connectivity>, IoError> {
        let ArchiveMesh { mesh, samples, .. } = &self.meshes[mesh];
        let Sample { time, around } = samples[sample];
        if mesh.topology_variance() != TopologyVariance::Heterogeneous {
            return Ok(None);
        }
        Ok(Some(counter_clockwise(mesh, around.0, time)?))
    }

    fn check_constants(&self) -> Result<(), IoError> {
        Ok(self.archive.check_constants()?)
    }
}

/// Properties of a mesh that are not handed through, a sentence each.
fn left_out(mesh: &PolyMesh, ours: &PointAttributes) -> Vec<String> {
    let name = mesh.object().path();
    let mut sentences = Vec::new();
    if let Some(normals) = mesh.normals().filter(|normals| normals.scope() != Scope::Vertex && !is_ours(mesh)) {
        let of = match normals.scope() {
            Scope::FaceVarying => "of face corners",
            Scope::Uniform => "of faces",
            _ => "of another kind",
        };
        sentences.push(format!("{name}: normals {of} are left out: those of one frame say nothing of the others"));
    }
    let moving = |param: &GeomParam| param.sample_count() > 1 && !param.is_constant();
    let others = mesh.attributes().into_iter().filter(|param| !ours.has(param.name(), PREF));
    let moving = others.chain(mesh.uv()).filter(moving);
    sentences.extend(
        moving.map(|param| format!("{name}: {} is animated; its first value is used in all frames", param.name())),
    );
    let creases = [".creaseIndices", ".creaseSharpnesses", ".cornerIndices", ".holes"];
    let is_there = |crease: &&&str| mesh.geom().samples(crease).is_some_and(|samples| !samples.is_empty());
    let creases = creases.iter().filter(is_there);
    sentences.extend(creases.map(|crease| format!("{name}: {crease} is not copied to the cache")));
    sentences
}

/// Faces of a sample as the rest of the program has them, as the mesh is in the world at a time [s].
fn counter_clockwise(mesh: &PolyMesh, sample: usize, time: f64) -> Result<Connectivity, IoError> {
    let mut faces = mesh.faces(sample)?;
    Winding::of(mesh, time)?.turn(&faces.face_counts, &mut faces.face_indices);
    Ok(Connectivity { face_counts: faces.face_counts, face_indices: faces.face_indices })
}

impl ArchiveMesh {
    /// A mesh of an archive, whose frames are at `fps` if that is known, and what a cache says of it.
    fn of(mesh: PolyMesh, (archive, fps): (&Archive, Option<f64>)) -> Result<(Self, CacheMesh), IoError> {
        let times = times_of(&mesh)?;
        let Sorted { frames, between, samples } = sorted(&times, fps);
        let sample = |number: usize| Sample { time: times[number], around: around(&mesh, times[number]) };
        let samples = samples.into_iter().map(sample).collect();
        let attributes = attributes_of(archive.path(), &mesh)?;
        let found = Self { mesh, samples, attributes };
        let mut described = CacheMesh {
            name: found.mesh.object().path().to_owned(),
            frames,
            between,
            is_still: found.samples.len() <= 1,
            left_out: left_out(&found.mesh, &found.attributes),
            attributes: found.attributes.clone(),
            ..CacheMesh::default()
        };
        if let Some(first) = found.samples.first() {
            let faces = counter_clockwise(&found.mesh, first.around.0, first.time)?;
            let points = found.world(archive, 0)?;
            described.points = points.len();
            described.split_normals = found.split_normals(first, points.len())?;
            described.triangles = triangles_of(&found.mesh, &points).unwrap_or_default();
            described.faces = faces;
        }
        Ok((found, described))
    }

    /// Normals of this program that hard edges split, corners as the rest of the program has them.
    fn split_normals(&self, sample: &Sample, points: usize) -> Result<Option<SplitNormals>, IoError> {
        if !is_ours(&self.mesh) {
            return Ok(None);
        }
        let (number, winding) = (sample.around.0, Winding::of(&self.mesh, sample.time)?);
        let faces = self.mesh.faces(number)?;
        let mut split = split_normals(&self.mesh, number, &faces, points)?;
        split.iter_mut().for_each(|split| winding.turn(&faces.face_counts, &mut split.indices));
        Ok(split)
    }

    /// From its own space to the world.
    fn to_world(&self, sample: usize) -> Result<Matrix, IoError> {
        Ok(self.mesh.world_matrix_at(self.samples[sample].time)?)
    }

    /// Its points as stored; linear between two of them.
    fn points(&self, archive: &Archive, sample: usize) -> Result<Vec<[f32; 3]>, IoError> {
        let Sample { time, around: (below, above, share) } = self.samples[sample];
        let mut points = self.mesh.positions(below)?;
        if share > 0.0 {
            let next = self.mesh.positions(above)?;
            if next.len() != points.len() {
                return Err(changed(archive.path(), &self.mesh, (time, points.len(), next.len())));
            }
            blend(&mut points, &next, share);
        }
        Ok(points)
    }

    fn world(&self, archive: &Archive, sample: usize) -> Result<Vec<Vec3>, IoError> {
        let matrix = self.to_world(sample)?;
        let points = self.points(archive, sample)?;
        Ok(points.into_iter().map(|p| Vec3::from(transform_point(p.map(f64::from), &matrix))).collect())
    }

    /// Velocities as stored; linear between two of them.
    fn velocities(&self, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        let (below, above, share) = self.samples[sample].around;
        let Some(mut rates) = self.mesh.velocities(below)? else { return Ok(None) };
        if share > 0.0 {
            let next = self.mesh.velocities(above)?.filter(|next| next.len() == rates.len());
            let Some(next) = next else { return Ok(None) };
            blend(&mut rates, &next, share);
        }
        Ok(Some(rates))
    }
}

/// Times at which a mesh is stored, or a transform above it that moves, ascending.
pub(super) fn times_of(mesh: &PolyMesh) -> Result<Vec<f64>, IoError> {
    let mut times = transform_times(mesh)?;
    if times.is_empty() {
        return Ok(mesh.times());
    }
    // The time of a mesh that has but one sample says nothing.
    if mesh.sample_count() > 1 {
        times.extend(mesh.times());
    }
    merge_times(&mut times);
    Ok(times)
}

/// The stored points around a time [s], and the share of the second.
fn around(mesh: &PolyMesh, time: f64) -> (usize, usize, f64) {
    let (sampling, count) = (mesh.time_sampling(), mesh.sample_count());
    let near = sampling.near_index(time, count);
    if (sampling.time(near) - time).abs() < SAME_TIME { (near, near, 0.0) } else { sampling.bracket(time, count) }
}

/// The triangles that were simulated, if the file tells them, or the faces cut by the solver's rule.
pub fn triangles_of(mesh: &PolyMesh, points: &[Vec3]) -> Option<Vec<[u32; 3]>> {
    let stored =
        mesh.user_properties().and_then(|properties| properties.samples(TRIANGLES)?.elements::<i32, 3>(0).ok());
    let stored = stored.and_then(|stored| listed_triangles(&stored, points.len()));
    let Some(mut triangles) = stored else {
        let faces = faces_of(mesh)?;
        return Some(cut(&faces.face_counts, &faces.face_indices, points));
    };
    // They are counter-clockwise in the space of the mesh.
    if Winding::of(mesh, mesh.time(0)).ok()?.is_mirrored() {
        triangles.iter_mut().for_each(|triangle| triangle.reverse());
    }
    Some(triangles)
}

/// The faces of the first sample, counter-clockwise, if they can be read.
pub fn faces_of(mesh: &PolyMesh) -> Option<Connectivity> {
    counter_clockwise(mesh, 0, mesh.time(0)).ok()
}

/// Attributes at the points of a mesh that this program wrote, beside normals.
fn attributes_of(path: &Path, mesh: &PolyMesh) -> Result<PointAttributes, IoError> {
    let listed = mesh.user_properties().and_then(|properties| properties.samples(LISTED)?.strings(0).ok()?.pop());
    let Some(listed) = listed else { return Ok(PointAttributes::default()) };
    let points = mesh.positions(0)?.len();
    let rest = || numbers_at_points::<3>((path, mesh), PREF, 0, points);
    let thickness = || Ok(numbers_at_points::<1>((path, mesh), THICKNESS, 0, points)?.into_iter().flatten().collect());
    PointAttributes::of_listed(&listed, rest, thickness)
}

/// The values of an attribute that the mesh lists, `N` numbers of single precision for each point.
fn numbers_at_points<const N: usize>(
    (path, mesh): (&Path, &PolyMesh),
    name: &str,
    sample: usize,
    points: usize,
) -> Result<Vec<[f32; N]>, IoError> {
    let damaged = |what: String| {
        let place = format!("{}, attribute {name}", mesh.object().path());
        IoError::data(path, place, what, "it is damaged: copy it again, or run the shot again")
    };
    let is_it = |param: &GeomParam| {
        param.name() == name
            && param.scope() == Scope::Vertex
            && param.data_type() == DataType::new(PodType::F32, N as u8)
    };
    let found = mesh.attributes().into_iter().find(is_it);
    let found = found.ok_or_else(|| damaged("the cache lists it but does not hold it at its points".to_owned()))?;
    let held = found.samples();
    if sample >= held.len() {
        return Err(damaged(format!("it has {} samples, and sample {sample} is missing", held.len())));
    }
    let values = held.elements::<f32, N>(sample)?;
    if values.len() != points {
        return Err(damaged(format!("it has {} values for {points} points", values.len())));
    }
    Ok(values)
}

/// All that is stored of a sample; `of_file` are the bounds of everything in it.
fn stored(
    (path, mesh): (&Path, &PolyMesh),
    sample: usize,
    attributes: &PointAttributes,
    of_file: Option<Bounds>,
) -> Result<StoredFrame, IoError> {
    let positions = mesh.positions(sample)?;
    let bounds = bounds_of(&positions);
    let matrix = mesh.world_matrix_at(mesh.time(sample))?;
    let in_world = shifted(bounds, [matrix[12], matrix[13], matrix[14]]);
    let same = |stored: Option<Bounds>, bounds: Bounds| stored.is_none_or(|stored| stored == bounds);
    let counts = mesh.user_properties().and_then(|properties| properties.samples(CROSSINGS));
    let counts = counts.filter(|counts| sample < counts.len());
    let crossings = counts.map(|counts| counts.values::<u32>(sample)).transpose()?;
    Ok(StoredFrame {
        has_bounds_of_points: same(mesh.bounds(sample)?, bounds) && same(of_file, in_world),
        velocities: mesh.velocities(sample)?,
        normals: normals_of(mesh, sample, positions.len())?,
        crossings: crossings.and_then(|values| values.first().copied()),
        values: StoredValues::read(attributes, |name| {
            Ok::<_, IoError>(
                numbers_at_points::<1>((path, mesh), name, sample, positions.len())?.into_iter().flatten().collect(),
            )
        })?,
        positions,
    })
}

/// Normals, where the archive has them of single precision as the caches of this program do: one for each point, or each of those
/// that hard edges split.
fn normals_of(mesh: &PolyMesh, sample: usize, points: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
    let kind = DataType::new(PodType::F32, 3);
    let is_split = |normals: &GeomParam| normals.scope() == Scope::FaceVarying && normals.is_indexed() && is_ours(mesh);
    let at_points = |normals: &GeomParam| normals.scope() == Scope::Vertex && !normals.is_indexed();
    let fits = |normals: &GeomParam| normals.data_type() == kind && sample < normals.sample_count();
    let Some(normals) = mesh.normals().filter(|found| fits(found) && (at_points(found) || is_split(found))) else {
        return Ok(None);
    };
    let all = normals.samples().elements::<f32, 3>(sample)?;
    Ok(Some(all).filter(|all| is_split(&normals) || all.len() == points))
}

/// Samples by their frames.
#[derive(Debug, PartialEq)]
struct Sorted {
    frames: Vec<i64>,
    between: Vec<Between>,
    /// The numbers of the samples in the file: of the frames, then of those between.
    samples: Vec<usize>,
}

/// Whole frames and the samples between them; all samples by their numbers where nobody says the frame rate. What stands still is in
/// the frame that is nearest.
fn sorted(times: &[f64], fps: Option<f64>) -> Sorted {
    let fps = fps.map(film_rate);
    if let (&[time], Some(fps)) = (times, fps) {
        let frames = vec![(time * fps).round() as i64];
        return Sorted { frames, between: Vec::new(), samples: vec![0] };
    }
    let Some(fps) = fps else {
        let frames = (0..times.len() as i64).collect();
        return Sorted { frames, between: Vec::new(), samples: (0..times.len()).collect() };
    };
    let is_whole = |sample: &usize| whole_frame(times[*sample], fps).is_some();
    let (whole, others): (Vec<usize>, Vec<usize>) = (0..times.len()).partition(is_whole);
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
    fn frames_are_whole_numbers_and_samples_are_counted_where_nobody_says_the_rate() {
        let numbers = |times: &[f64], fps| sorted(times, fps).frames;
        let times = [1001.0 / 24.0, 1002.0 / 24.0];
        assert_eq!(numbers(&times, Some(24.0)), [1001, 1002]);
        assert_eq!(numbers(&times, None), [0, 1]);
        let shutter = [1010.0, 1010.25, 1010.75, 1011.0, 1011.25].map(|frame: f64| frame / 24.0);
        let between = [(1010, 0.25), (1010, 0.75), (1011, 0.25)].map(|(frame, behind)| Between { frame, behind });
        let expected = Sorted { frames: vec![1010, 1011], between: between.into(), samples: vec![0, 3, 1, 2, 4] };
        assert_eq!(sorted(&shutter, Some(24.0)), expected);
        let none = Sorted { frames: Vec::new(), between: between[..2].into(), samples: vec![0, 1] };
        assert_eq!(sorted(&shutter[1..3], Some(24.0)), none);
        // What stands still is in the nearest frame, and a rate in few digits is the one that is meant.
        assert_eq!(numbers(&[1.0 / 24.0], Some(25.0)), [1]);
        let television = [1001.0, 1002.0].map(|frame| frame * 1001.0 / 24_000.0);
        assert_eq!(numbers(&television, Some(23.976)), [1001, 1002]);
    }
}
