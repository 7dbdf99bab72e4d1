//! Alembic meshes: polygon meshes and subdivision surfaces, with the transforms of all parents applied at the time
//! asked for. Where the normals of face corners or faces differ at a point, edges are hard. Objects are chosen by a pattern over
//! their full paths; several are merged in the order of their paths.
//!
//! Alembic faces are clockwise seen from outside, so they are reversed on reading; under a mirrored parent they already
//! are counter-clockwise in the world. Shears and scales need no care: points go through the full matrix.

use std::ops::Range;
use std::path::{Path, PathBuf};

use drapery_alembic::{
    Archive, DataType, Faces, GeomParam, Matrix, PodType, PolyMesh, Schema, Scope, TopologyVariance, Xform,
    transform_point,
};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;

use super::write::RENDER_MESH_OF;
use crate::error::IoError;
use crate::formats::fitting;
use crate::input_file;
use crate::mesh_data::{Connectivity, FaceSet, MeshData, MeshParam, MeshReader, Uvs, merge, reverse};
use crate::normals::SplitNormals;

/// Points or faces that are read at a time.
const PIECE: usize = 8192;

/// Times closer than this are one sample [s]: archives round frame / fps differently for points and transforms.
pub(super) const SAME_TIME: f64 = 1e-6;

/// A time this close to a stored one, in sample steps, is that sample and not a blend of two.
const SAME_SAMPLE: f64 = 1e-3;

/// Why a mesh is not rendered.
pub(super) const INVISIBLE: &str = "it is invisible";

/// Meshes of an archive, read as one.
#[derive(Debug)]
pub struct AlembicMesh {
    path: PathBuf,
    meshes: Vec<PolyMesh>,
    times: Vec<f64>,
    frame_rate: Option<f64>,
}

impl AlembicMesh {
    /// Opens the meshes whose path fits `pattern` (`*` stands for any letters, also over several levels); all that are rendered
    /// without a pattern.
    ///
    /// # Errors
    /// The file is missing or damaged, the pattern is malformed, or fits no mesh that is rendered.
    pub fn open(path: &Path, pattern: Option<&str>) -> Result<Self, IoError> {
        // The system's own words for a missing file are the same everywhere; ours carry advice.
        input_file::open(path)?;
        let archive = Archive::open(path)?;
        let mut meshes = PolyMesh::all(&archive)?;
        meshes.sort_by(|a, b| a.object().path().cmp(b.object().path()));
        if let Some(pattern) = pattern {
            let fits = fitting(path, pattern)?;
            let paths: Vec<String> = meshes.iter().map(|mesh| mesh.object().path().to_owned()).collect();
            meshes.retain(|mesh| fits.is_match(mesh.object().path()));
            if meshes.is_empty() && !paths.is_empty() {
                let what = format!("no mesh path matches {pattern}");
                return Err(IoError::data(path, "objects", what, format!("its meshes are {}", paths.join(", "))));
            }
        }
        if meshes.is_empty() {
            return Err(IoError::data(path, "objects", without_meshes(&archive), "export the meshes themselves"));
        }
        take_hidden(path, &mut meshes, "show it before the export, or choose another mesh")?;
        let times = sample_times(&meshes)?;
        Ok(Self { path: path.to_owned(), meshes, times, frame_rate: archive.frames_per_second_hint() })
    }

    /// World positions of some points of one mesh at a time at which something is stored.
    fn world_positions(&self, mesh: &PolyMesh, time: f64, range: Range<usize>) -> Result<Vec<Vec3>, IoError> {
        let matrix = mesh.world_matrix_at(time)?;
        let (below, above, share) = mesh.time_sampling().bracket(time, mesh.sample_count());
        let mut local = mesh.positions_in(below, range.clone())?;
        if above != below && share > 0.0 && mesh.topology_variance() != TopologyVariance::Constant {
            let [before, after] = [mesh.vertex_count(below)?, mesh.vertex_count(above)?];
            if before != after {
                return Err(changed(&self.path, mesh, (time, before, after)));
            }
            blend(&mut local, &mesh.positions_in(above, range)?, share);
        }
        Ok(local.iter().map(|p| Vec3::from(transform_point(p.map(f64::from), &matrix))).collect())
    }

    /// Number of points of one mesh at a time.
    fn point_count(mesh: &PolyMesh, time: f64) -> Result<usize, IoError> {
        let (below, _, _) = mesh.time_sampling().bracket(time, mesh.sample_count());
        Ok(mesh.vertex_count(below)?)
    }

    /// The stored times around `time` and the share of the second; equal on a sample and outside.
    fn bracket(&self, time: f64) -> (f64, f64, f64) {
        let Some((&first, &last)) = self.times.first().zip(self.times.last()) else {
            return (0.0, 0.0, 0.0);
        };
        let step = (last - first) / (self.times.len() - 1).max(1) as f64;
        let near = |t: f64| (t - time).abs() <= SAME_SAMPLE * step;
        let after = self.times.partition_point(|&t| t < time);
        let below = self.times[after.max(1) - 1];
        let above = self.times[after.min(self.times.len() - 1)];
        if near(above) || time <= first {
            (above, above, 0.0)
        } else if near(below) || time >= last {
            (below, below, 0.0)
        } else {
            (below, above, (time - below) / (above - below))
        }
    }
}

impl MeshReader for AlembicMesh {
    fn objects(&self) -> Vec<String> {
        self.meshes.iter().map(|mesh| mesh.object().path().to_owned()).collect()
    }

    fn sample_times(&self) -> &[f64] {
        &self.times
    }

    fn frame_rate(&self) -> Option<f64> {
        self.frame_rate
    }

    fn mesh_at(&self, time: f64) -> Result<MeshData, IoError> {
        let mut merged: Option<MeshData> = None;
        for mesh in &self.meshes {
            let data = read_mesh(mesh, time)?;
            merged = Some(match merged {
                None => data,
                Some(so_far) => merge(so_far, data),
            });
        }
        let mut merged = merged.unwrap_or_default(); // never without meshes
        self.positions_at(time, &mut merged.mesh.points)?;
        Ok(merged)
    }

    fn positions_at(&self, time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError> {
        positions.clear();
        self.points_at(time, &mut |points| positions.extend_from_slice(points))
    }

    fn points_at(&self, time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        let (below, above, share) = self.bracket(time);
        for mesh in &self.meshes {
            let count = Self::point_count(mesh, below)?;
            let after = if share > 0.0 { Self::point_count(mesh, above)? } else { count };
            if after != count {
                return Err(changed(&self.path, mesh, (above, count, after)));
            }
            for start in (0..count).step_by(PIECE) {
                let range = start..(start + PIECE).min(count);
                let mut points = self.world_positions(mesh, below, range.clone())?;
                if share > 0.0 {
                    let next = self.world_positions(mesh, above, range)?;
                    points.iter_mut().zip(&next).for_each(|(p, q)| *p += (q - *p) * share);
                }
                take(&points);
            }
        }
        Ok(())
    }

    fn faces_at(&self, time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        let mut first = 0;
        for mesh in &self.meshes {
            let sample = mesh.time_sampling().floor_index(time, mesh.sample_count());
            let winding = Winding::of(mesh, time)?;
            mesh.faces_in_pieces(sample, PIECE, &mut |Faces { face_counts, face_indices }| {
                winding.turn(face_counts, face_indices);
                face_indices.iter_mut().for_each(|corner| *corner += first);
                take(face_counts, face_indices);
            })?;
            first += mesh.vertex_count(sample)? as u32;
        }
        Ok(())
    }

    fn check_attributes_at(&self, time: f64) -> Result<(), IoError> {
        for mesh in &self.meshes {
            let sample = mesh.time_sampling().floor_index(time, mesh.sample_count());
            for attribute in mesh.uv().into_iter().chain(mesh.attributes()) {
                attribute.values(sample)?;
                attribute.indices(sample)?;
            }
            mesh.face_sets()?;
        }
        Ok(())
    }

    fn connectivity_at(&self, time: f64) -> Result<Option<Connectivity>, IoError> {
        if self.meshes.iter().all(|mesh| mesh.topology_variance() != TopologyVariance::Heterogeneous) {
            return Ok(None);
        }
        let mut all = Connectivity::default();
        for mesh in &self.meshes {
            let faces = mesh.faces(mesh.time_sampling().floor_index(time, mesh.sample_count()))?;
            all.face_counts.extend(faces.face_counts);
            all.face_indices.extend(faces.face_indices);
        }
        Ok(Some(all))
    }
}

/// The error of a mesh whose number of points changes before a time [s].
pub(super) fn changed(path: &Path, mesh: &PolyMesh, (time, before, after): (f64, usize, usize)) -> IoError {
    IoError::data(
        path,
        format!("object {}, time {time:.6} s", mesh.object().path()),
        format!("the number of points changes from {before} to {after}"),
        "export it with constant topology (no modifiers that change it)",
    )
}

/// Goes a share of the way to other vectors.
pub(super) fn blend(vectors: &mut [[f32; 3]], others: &[[f32; 3]], share: f64) {
    for (v, other) in vectors.iter_mut().zip(others) {
        let between = |a: f32, b: f32| (f64::from(a) + (f64::from(b) - f64::from(a)) * share) as f32;
        *v = std::array::from_fn(|axis| between(v[axis], other[axis]));
    }
}

/// Takes away the meshes that are hidden at all times; returns their paths. Meshes that all are hidden are an error with this advice.
pub(super) fn take_hidden(path: &Path, meshes: &mut Vec<PolyMesh>, advice: &str) -> Result<Vec<String>, IoError> {
    let mut hidden = Vec::new();
    for mesh in std::mem::take(meshes) {
        match mesh.object().is_hidden()? {
            true => hidden.push(mesh.object().path().to_owned()),
            false => meshes.push(mesh),
        }
    }
    if let (Some(hidden), true) = (hidden.first(), meshes.is_empty()) {
        let what = format!("the mesh {hidden} is not rendered: {INVISIBLE}");
        return Err(IoError::data(path, "objects", what, advice));
    }
    Ok(hidden)
}

/// Says what an archive holds instead of meshes.
fn without_meshes(archive: &Archive) -> String {
    let others: Vec<String> = archive
        .objects()
        .filter(|object| !matches!(object.schema(), Schema::Xform | Schema::Group))
        .take(5)
        .map(|object| format!("{} ({:?})", object.path(), object.schema()))
        .collect();
    if others.is_empty() {
        "it contains no mesh".into()
    } else {
        format!("it contains no mesh, only {}", others.join(", "))
    }
}

/// Times at which points or transforms change, ascending.
pub fn sample_times(meshes: &[PolyMesh]) -> Result<Vec<f64>, IoError> {
    let mut times = Vec::new();
    for mesh in meshes {
        if mesh.topology_variance() != TopologyVariance::Constant {
            times.extend(mesh.times());
        }
        times.extend(transform_times(mesh)?);
    }
    merge_times(&mut times);
    Ok(times)
}

/// Times at which transforms above a mesh are stored, of those that change.
pub(super) fn transform_times(mesh: &PolyMesh) -> Result<Vec<f64>, IoError> {
    let mut times = Vec::new();
    let mut parent = mesh.object().parent();
    while let Some(object) = parent {
        if object.schema() == Schema::Xform {
            let xform = Xform::of(&object)?;
            if !xform.is_constant() {
                times.extend((0..xform.sample_count()).map(|index| xform.time(index)));
            }
        }
        parent = object.parent();
    }
    Ok(times)
}

/// Puts times in order, each once.
pub(super) fn merge_times(times: &mut Vec<f64>) {
    times.sort_by(f64::total_cmp);
    times.dedup_by(|b, a| *b - *a < SAME_TIME);
}

/// One mesh without its points, faces turned counter-clockwise in the world.
fn read_mesh(mesh: &PolyMesh, time: f64) -> Result<MeshData, IoError> {
    let sample = mesh.time_sampling().floor_index(time, mesh.sample_count());
    let faces = mesh.faces(sample)?;
    let point_count = mesh.vertex_count(sample)?;
    let winding = Winding::of(mesh, time)?;
    let turn = |mut corners: Vec<u32>| {
        winding.turn(&faces.face_counts, &mut corners);
        corners
    };
    let uvs = mesh.uv().map(|uv| read_uvs(&uv, sample, &faces.face_indices)).transpose()?.flatten();
    let uvs = uvs.map(|uvs| Uvs { indices: turn(uvs.indices), ..uvs });
    let split = split_normals(mesh, sample, &faces, point_count)?;
    let split_normals = split.map(|split| SplitNormals { indices: turn(split.indices), ..split });
    let mut params = Vec::new();
    for attribute in mesh.attributes() {
        let corners = winding.is_mirrored().then_some(faces.face_counts.as_slice());
        params.extend(read_param(&attribute, sample, corners)?);
    }
    let face_set = |set: drapery_alembic::FaceSet| FaceSet {
        name: set.name,
        faces: set.faces.into_iter().filter_map(|face| u32::try_from(face).ok()).collect(),
        material: None,
    };
    Ok(MeshData {
        render_mesh_of: render_mesh_of(mesh),
        object_path: mesh.object().path().to_owned(),
        mesh: PolygonMesh {
            points: vec![Vec3::zeros(); point_count],
            face_indices: turn(faces.face_indices.clone()),
            face_counts: faces.face_counts,
        },
        uvs,
        split_normals,
        face_sets: mesh.face_sets()?.into_iter().map(face_set).collect(),
        params,
        subdivision: (mesh.object().schema() == Schema::SubD).then(|| "catmullClark".to_owned()),
        ..MeshData::default()
    })
}

/// The garment that a mesh follows to be rendered in its place, if the archive says so.
pub fn render_mesh_of(mesh: &PolyMesh) -> Option<String> {
    let names = mesh.user_properties()?.samples(RENDER_MESH_OF)?;
    names.strings(0).ok()?.into_iter().next()
}

/// Whether this program wrote a mesh.
pub(super) fn is_ours(mesh: &PolyMesh) -> bool {
    let written_by =
        mesh.user_properties().and_then(|properties| properties.samples("application")?.strings(0).ok()?.pop());
    written_by.is_some_and(|application| application.starts_with("Drapery "))
}

/// Normals that hard edges split, the corners in the file's order; none where the normals do not fit the mesh.
///
/// Normals of this program follow the frames, and those of a hard edge that is flat in a frame are equal: which are two says their
/// numbering.
pub(super) fn split_normals(
    mesh: &PolyMesh,
    sample: usize,
    faces: &Faces,
    points: usize,
) -> Result<Option<SplitNormals>, IoError> {
    let is_vector = |normals: &GeomParam| normals.data_type() == DataType::new(PodType::F32, 3);
    let of_faces = |normals: &GeomParam| matches!(normals.scope(), Scope::FaceVarying | Scope::Uniform);
    let Some(normals) = mesh.normals().filter(is_vector).filter(of_faces) else { return Ok(None) };
    if let Some(indices) = normals.indices(sample)?.filter(|_| is_ours(mesh)) {
        let count = normals.elements::<f32, 3>(sample)?.len();
        return Ok(SplitNormals::numbered(indices, count, &faces.face_indices));
    }
    let stored = normals.expanded::<f32, 3>(sample)?;
    let directions: Vec<[f32; 3]> = match normals.scope() {
        Scope::Uniform => {
            let each = faces.face_counts.iter().zip(&stored);
            each.flat_map(|(count, normal)| std::iter::repeat_n(*normal, *count as usize)).collect()
        }
        _ => stored,
    };
    let fits = directions.len() == faces.face_indices.len();
    Ok(SplitNormals::of_directions(&faces.face_indices, points, &directions).filter(|_| fits))
}

/// UVs as one index a face corner, in the file's order of corners; none when they do not fit the mesh.
fn read_uvs(uv: &GeomParam, sample: usize, face_indices: &[u32]) -> Result<Option<Uvs>, IoError> {
    if uv.data_type().pod != PodType::F32 || uv.data_type().extent != 2 {
        return Ok(None);
    }
    let stored = uv.values(sample)?;
    let values: Vec<[f32; 2]> = stored
        .chunks_exact(8)
        .map(|v| [[v[0], v[1], v[2], v[3]], [v[4], v[5], v[6], v[7]]].map(f32::from_le_bytes))
        .collect();
    let indices = uv.indices(sample)?.unwrap_or_else(|| (0..values.len() as u32).collect());
    let corners: Option<Vec<u32>> = match uv.scope() {
        Scope::FaceVarying => Some(indices),
        Scope::Vertex | Scope::Varying => face_indices.iter().map(|&p| indices.get(p as usize).copied()).collect(),
        Scope::Constant | Scope::Uniform => None,
    };
    let fits = |c: &Vec<u32>| c.len() == face_indices.len() && c.iter().all(|&i| (i as usize) < values.len());
    let name = uv.source_name().unwrap_or_default().to_owned();
    Ok(corners.filter(fits).map(|indices| Uvs { name, values, indices }))
}

/// An attribute to hand through. `mirrored` holds the face counts when the corners of the output run the other way.
fn read_param(param: &GeomParam, sample: usize, mirrored: Option<&[u32]>) -> Result<Option<MeshParam>, IoError> {
    let mut values = param.values(sample)?;
    let mut indices = param.indices(sample)?;
    if let (Some(face_counts), Scope::FaceVarying) = (mirrored, param.scope()) {
        let size = param.data_type().element_size();
        let corner_count = face_counts.iter().map(|&n| n as usize).sum::<usize>();
        let mut order: Vec<u32> = (0..corner_count as u32).collect();
        reverse(face_counts, &mut order);
        match &mut indices {
            Some(indices) if indices.len() == corner_count => {
                *indices = order.iter().map(|&corner| indices[corner as usize]).collect();
            }
            None if size > 0 && values.len() == size * corner_count => {
                values = order.iter().flat_map(|&c| &values[c as usize * size..][..size]).copied().collect();
            }
            // Texts without indices, or a count that does not fit: better left out than on the wrong corners.
            _ => return Ok(None),
        }
    }
    Ok(Some(MeshParam {
        name: param.name().to_owned(),
        scope: param.scope(),
        data_type: param.data_type(),
        interpretation: param.interpretation().to_owned(),
        source_name: param.source_name().map(str::to_owned),
        values,
        indices,
    }))
}

/// Order of the corners of stored faces, seen from outside in the world: clockwise, or the other way where parents mirror the mesh.
#[derive(Clone, Copy)]
pub(super) struct Winding {
    is_mirrored: bool,
}

impl Winding {
    /// The order in a mesh at a time [s].
    pub(super) fn of(mesh: &PolyMesh, time: f64) -> Result<Self, IoError> {
        Ok(Self { is_mirrored: determinant(&mesh.world_matrix_at(time)?) < 0.0 })
    }

    /// Whether faces are counter-clockwise as they are stored.
    pub(super) fn is_mirrored(self) -> bool {
        self.is_mirrored
    }

    /// Puts what is stored for the corners of faces in the counter-clockwise order.
    pub(super) fn turn<T>(self, face_counts: &[u32], corners: &mut [T]) {
        if !self.is_mirrored {
            reverse(face_counts, corners);
        }
    }
}

/// Volume of the unit cube under the linear part; negative for a mirror.
fn determinant(m: &Matrix) -> f64 {
    let row = |i: usize| Vec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
    row(0).dot(&row(1).cross(&row(2)))
}
