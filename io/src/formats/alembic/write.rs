//! Alembic caches: the garment as the artist made it, moving.
//!
//! One file a garment with one mesh at the object path of the source, under one transform a level. All of these are the
//! identity, points being in world space in the file's unit, but for the mesh's own where positions are counted from an origin
//! ([`CachePlan::origin`]): it moves them there. Uniform sampling: the first sample is the first delivered frame, at frame / fps;
//! cyclic, a cycle a frame, where there are samples between frames.
//! Faces, UVs, face sets and other attributes are written once; positions, velocities per second, normals and bounds with every
//! frame. Normals that hard edges split are indexed and of face corners (`fvr`). Among the user properties of the mesh stand how the file was made, [`TRIANGLES`] if there are larger faces,
//! and with every frame [`CROSSINGS`] if the shot counts them. The file is committed after every frame, so it is a valid
//! archive whenever a reader looks.
//!
//! A cache is continued by pointing its header to the commit of its mark and going on behind it
//! ([`ArchiveWriter::resume`]).

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use drapery_alembic::{
    AlembicError, Archive, ArchiveMark, ArchiveOptions, ArchiveWriter, Bounds, DataType, Durability, EMPTY_BOUNDS,
    GeomParamSpec, GeomParamWriter, IDENTITY, Indexed, Matrix, MetaData, PodType, PolyMesh, PolyMeshSample,
    PolyMeshWriter, PropertyId, Scope, TimeSampling, Topology, XformWriter, write_face_set,
};
use drapery_core::mesh::MeshStream;

use crate::atomic_file::unfinished;
use crate::attributes::{LISTED, PREF, PointAttributes, PointValues};
use crate::cache::{APPLICATION, CacheFrame, CacheMark, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::formats::continuing::{cannot_continue, digest_of, hexadecimal, lost, marked_frames, sync_name, too_short};
use crate::garment_mesh::{GarmentMesh, triangles_to_store};
use crate::mesh_data::{FaceSet, MeshData, MeshParam, Uvs, reverse};
use crate::normals::SplitNormals;
use crate::units::Units;
use crate::written_file;

/// User property: the triangles that were simulated, three points each, counter-clockwise. Only in meshes with other
/// faces; who cuts those along other diagonals sees another surface.
pub(super) const TRIANGLES: &str = "triangles";

/// User property: the unit of length [m].
pub(super) const METRES_PER_UNIT: &str = "metres_per_unit";

/// The garment that a render mesh follows.
pub(super) const RENDER_MESH_OF: &str = "render_mesh_of";

/// User property, one number a frame: how many edges of cloth pass through triangles of cloth in all garments of the
/// shot.
pub(super) const CROSSINGS: &str = "crossings";

/// An Alembic cache being written. The file appears with its first frame: an archive without samples would be refused
/// by the applications that load it.
#[derive(Debug)]
pub struct AlembicWriter {
    path: PathBuf,
    object_path: String,
    options: ArchiveOptions,
    properties: Vec<(&'static str, String)>,
    units: Units,
    /// Origin that positions are counted from, in the file's unit and axes, if not from the origin of the world.
    origin: Option<[f64; 3]>,
    sampling: TimeSampling,
    first_frame: i64,
    /// Number of samples between a frame and the next.
    sub_frames: usize,
    velocities: bool,
    normals: bool,
    crossings: bool,
    attributes: PointAttributes,
    /// Read with the first frame.
    mesh: GarmentMesh,
    /// Normals that hard edges split, their corners clockwise; known with the first frame.
    split_normals: Option<SplitNormals>,
    stage: Stage,
    mark: CacheMark,
}

/// Data that does not change from frame to frame, as the archive holds it: corners clockwise.
struct Still {
    face_counts: Vec<i32>,
    face_indices: Vec<i32>,
    uvs: Option<Uvs>,
    face_sets: Vec<FaceSet>,
    params: Vec<MeshParam>,
    /// The garment that it follows.
    render_mesh_of: Option<String>,
    /// None where they are just the faces.
    triangles: Option<Vec<[u32; 3]>>,
}

/// Progress of the file.
#[derive(Debug)]
enum Stage {
    /// No frame yet, so no file.
    Empty,
    /// One frame at least.
    Open(Box<Open>),
    /// Finished, or given up after an error.
    Closed,
}

/// A file that has frames.
#[derive(Debug)]
struct Open {
    archive: ArchiveWriter,
    declared: Declared,
}

/// The parts of the archive that grow with every frame.
#[derive(Debug)]
struct Declared {
    mesh: PolyMeshWriter,
    sampling: u32,
    origin: Option<[f64; 3]>,
    crossings: Option<PropertyId>,
    /// Numbers at the points, in the order of [`PointAttributes::moving`].
    values: Vec<GeomParamWriter>,
}

impl AlembicWriter {
    /// Prepares a cache at `path`; the first frame creates it and replaces what is there.
    ///
    /// # Errors
    /// The frame rate cannot be expressed.
    pub fn create(path: &Path, plan: &CachePlan<'_>) -> Result<Self, IoError> {
        let (numerator, denominator) = (plan.timeline.fps_numerator, plan.timeline.fps_denominator);
        let options = ArchiveOptions {
            application: APPLICATION.into(),
            description: format!("garment {}", plan.garment),
            // Without a date, equal runs give equal bytes.
            date: None,
            frames_per_second: Some(plan.timeline.fps()),
            extra: MetaData::new()
                .with("lengthUnit", plan.units.length.word())
                .with("metersPerUnit", &plan.units.length.metres().to_string())
                .with("upAxis", &format!("{:?}", plan.units.up)),
        };
        let properties = vec![
            ("length_unit", plan.units.length.word().to_owned()),
            ("up_axis", format!("{:?}", plan.units.up)),
            ("fps", format!("{numerator}/{denominator}")),
        ];
        Ok(Self {
            path: path.to_owned(),
            object_path: plan.object_path(),
            options,
            properties,
            units: plan.units,
            origin: plan.file_origin(),
            sampling: sampling(plan)?,
            first_frame: plan.first_frame,
            sub_frames: plan.sub_frames.len(),
            velocities: plan.velocities,
            normals: plan.normals,
            crossings: plan.crossings,
            attributes: plan.attributes.clone(),
            mesh: plan.mesh.clone(),
            split_normals: None,
            stage: Stage::Empty,
            mark: CacheMark::none(path),
        })
    }

    /// Goes on with the cache at `path` after its mark. Readers find a valid archive all the time, with the frames up
    /// to the mark; programs that opened it before go on seeing the later frames, because the cache then goes on in a
    /// copy.
    ///
    /// # Errors
    /// The file is missing, damaged, not the one of the mark, or was made with another plan; it then stays as it is.
    pub fn resume(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<Self, IoError> {
        let mut writer = Self::create(path, plan)?;
        let Some((at, still, kept)) = writer.found_sound(plan, mark)? else {
            // What a run without a break has at this point: no file before the first frame.
            ArchiveWriter::remove(path)?;
            return Ok(writer);
        };
        let resumed =
            ArchiveWriter::resume(path, &writer.options, &at, |archive| writer.declare_again(archive, &still, kept));
        let (archive, declared) = resumed.map_err(|e| not_continued(path, mark, e))?;
        sync_name(path);
        writer.stage = Stage::Open(Box::new(Open { archive, declared }));
        writer.mark = mark.clone();
        Ok(writer)
    }

    /// Finds out whether [`AlembicWriter::resume`] would go on; changes nothing.
    ///
    /// # Errors
    /// The errors of [`AlembicWriter::resume`], without those of writing.
    pub fn check_resume(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<(), IoError> {
        let mut writer = Self::create(path, plan)?;
        let Some((at, still, kept)) = writer.found_sound(plan, mark)? else { return Ok(()) };
        let checked = ArchiveWriter::check_resume(path, &writer.options, &at, |archive| {
            writer.declare_again(archive, &still, kept)
        });
        checked.map_err(|e| not_continued(path, mark, e))
    }

    /// The commit to go on after, what does not move, and the number of samples up to there; nothing where the mark is before the
    /// first frame.
    fn found_sound(
        &mut self,
        plan: &CachePlan<'_>,
        mark: &CacheMark,
    ) -> Result<Option<(ArchiveMark, Still, usize)>, IoError> {
        let path = &self.path;
        if marked_frames(path, plan, mark)? == 0 {
            return Ok(None);
        }
        if let Some(held) = self.last_frame_held().filter(|held| *held > plan.last_frame) {
            return Err(too_short(path, plan, held));
        }
        let kept = plan.samples_until(mark.last_frame.unwrap_or(plan.first_frame), mark.sub_frame);
        let at = archive_mark(mark).ok_or_else(|| cannot_continue(path, "mark", "the mark is incomplete"))?;
        Ok(Some((at, self.still()?, kept)))
    }

    /// Everything that does not move; takes note of the hard edges.
    fn still(&mut self) -> Result<Still, IoError> {
        let mut data = self.mesh.read()?;
        data.convert_params(self.units.into());
        self.attributes.add_to(&mut data, PREF);
        self.split_normals = data.split_normals.take().filter(|_| self.normals);
        if let Some(split) = &mut self.split_normals {
            reverse(&data.mesh.face_counts, &mut split.indices);
        }
        Ok(Still::of(data))
    }

    /// The last frame that readers see in the file, if they can read it.
    fn last_frame_held(&self) -> Option<i64> {
        let archive = Archive::open(&self.path).ok()?;
        let samples = PolyMesh::open(&archive, &self.object_path).ok()?.sample_count();
        Some(self.first_frame + (samples.checked_sub(1)? / (self.sub_frames + 1)) as i64)
    }

    /// Declares the objects; a new mesh has no sample yet.
    fn declare_mesh(&self, archive: &mut ArchiveWriter) -> Result<Declared, AlembicError> {
        let sampling = archive.add_time_sampling(self.sampling.clone())?;
        let mut names: Vec<&str> = self.object_path.split('/').filter(|name| !name.is_empty()).collect();
        let shape = names.pop().unwrap_or("mesh");
        let mut parent = archive.root();
        let own = names.len().saturating_sub(1);
        for (level, name) in names.into_iter().enumerate() {
            let matrix = self.origin.filter(|_| level == own).map(shift);
            parent = XformWriter::still(archive, parent, name, matrix.as_ref())?.object();
        }
        let mesh = PolyMeshWriter::declare(archive, parent, shape, sampling)?;
        Ok(Declared { mesh, sampling, origin: self.origin, crossings: None, values: Vec::new() })
    }

    /// Declares everything that a file of this plan with this number of samples has.
    fn declare_again(
        &self,
        archive: &mut ArchiveWriter,
        still: &Still,
        samples: usize,
    ) -> Result<Declared, AlembicError> {
        let mut declared = self.declare_mesh(archive)?;
        // Only what the sample has counts, not where its points are.
        let points = vec![[0.0; 3]; self.mesh.point_count()];
        let normals = vec![[0.0; 3]; self.split_normals.as_ref().map_or(points.len(), |split| split.count)];
        let frame = CacheFrame {
            frame: self.first_frame,
            sub_frame: 0,
            positions: &points,
            velocities: &points,
            normals: &normals,
            crossings: None,
            values: PointValues::default(),
        };
        declared.mesh.check_continued(archive, &still.with(self.sample(&frame)))?;
        archive.add_archive_bounds(declared.sampling)?;
        self.write_attributes(archive, &mut declared, still, None)?;
        let held = declared.mesh.sample_count(archive);
        let counted = declared.crossings.map_or(held, |property| archive.sample_count(property));
        let have_values = declared.values.iter().all(|values| values.sample_count(archive) == samples);
        if held != samples || counted != samples || !have_values {
            return Err(AlembicError::Refused {
                path: self.path.clone(),
                place: self.object_path.clone(),
                reason: format!(
                    "{held} samples are stored and {counted} counts of intersections, {samples} are expected, and as many of \
                     each attribute"
                ),
            });
        }
        Ok(declared)
    }

    /// Creates the file with its first frame and everything that does not change; it gets its name when it is valid.
    fn write_first(&mut self, frame: &CacheFrame<'_>) -> Result<Open, IoError> {
        let still = self.still()?;
        let mut archive = ArchiveWriter::create(unfinished(&self.path), &self.options)?;
        let mut declared = self.declare_mesh(&mut archive)?;
        declared.write(&mut archive, &still.with(self.sample(frame)))?;
        self.write_attributes(&mut archive, &mut declared, &still, Some(APPLICATION))?;
        declared.write_crossings(&mut archive, frame.crossings)?;
        declared.write_values(&mut archive, &self.attributes, frame.values)?;
        archive.commit(Durability::Flushed)?;
        archive.rename(&self.path)?;
        Ok(Open { archive, declared })
    }

    /// Attributes of the source, face sets, and how the file was made. Who made it is said once: another version of the
    /// program may continue it.
    fn write_attributes(
        &self,
        archive: &mut ArchiveWriter,
        declared: &mut Declared,
        still: &Still,
        application: Option<&str>,
    ) -> Result<(), AlembicError> {
        let properties = declared.mesh.user_properties(archive)?;
        match application {
            Some(application) => archive.write_static_string(properties, "application", application)?,
            None => {
                let (kind, none) = (DataType::new(PodType::String, 1), MetaData::new());
                archive.add_scalar_property(properties, "application", &none, kind, 0)?;
            }
        }
        for (name, text) in &self.properties {
            archive.write_static_string(properties, name, text)?;
        }
        archive.write_static_scalar(properties, METRES_PER_UNIT, &[self.units.length.metres()])?;
        if let Some(garment) = &still.render_mesh_of {
            archive.write_static_string(properties, RENDER_MESH_OF, garment)?;
        }
        if let Some(listed) = self.attributes.listed() {
            archive.write_static_string(properties, LISTED, &listed)?;
        }
        if let Some(triangles) = &still.triangles {
            let (kind, none) = (DataType::new(PodType::I32, 3), MetaData::new());
            let property = archive.add_array_property(properties, TRIANGLES, &none, kind, 0)?;
            let bytes: Vec<u8> = triangles.iter().flatten().flat_map(|&v| (v as i32).to_le_bytes()).collect();
            archive.write_static_raw(property, &bytes)?;
        }
        if self.crossings {
            let (kind, none) = (DataType::new(PodType::U32, 1), MetaData::new());
            let property = archive.add_scalar_property(properties, CROSSINGS, &none, kind, declared.sampling)?;
            declared.crossings = Some(property);
        }
        if !still.params.is_empty() || self.attributes.moving().next().is_some() {
            self.write_params(archive, declared, still)?;
        }
        for set in &still.face_sets {
            let faces: Vec<i32> = set.faces.iter().map(|&face| face as i32).collect();
            write_face_set(archive, declared.mesh.object(), &set.name, &faces, true)?;
        }
        Ok(())
    }

    /// Attributes at points, faces and corners: those that do not move, and the declaration of the others.
    fn write_params(
        &self,
        archive: &mut ArchiveWriter,
        declared: &mut Declared,
        still: &Still,
    ) -> Result<(), AlembicError> {
        let attributes = declared.mesh.attributes(archive)?;
        for param in &still.params {
            let spec = GeomParamSpec {
                name: &param.name,
                scope: param.scope,
                data_type: param.data_type,
                interpretation: &param.interpretation,
                source_name: param.source_name.as_deref(),
                indexed: param.indices.is_some(),
                time_sampling: 0,
            };
            let writer = GeomParamWriter::declare(archive, attributes, &spec)?;
            writer.write_static(archive, &param.values, param.indices.as_deref())?;
        }
        for name in self.attributes.moving() {
            let spec = GeomParamSpec {
                name,
                scope: Scope::Vertex,
                data_type: DataType::new(PodType::F32, 1),
                interpretation: "",
                source_name: None,
                indexed: false,
                time_sampling: declared.sampling,
            };
            declared.values.push(GeomParamWriter::declare(archive, attributes, &spec)?);
        }
        Ok(())
    }

    /// Positions, velocities, normals and bounds of a frame.
    fn sample<'a>(&'a self, frame: &CacheFrame<'a>) -> PolyMeshSample<'a> {
        let (indices, scope) = match &self.split_normals {
            Some(split) => (Some(split.indices.as_slice()), Scope::FaceVarying),
            None => (None, Scope::Vertex),
        };
        let normals = Indexed { values: frame.normals, indices, scope, source_name: None };
        PolyMeshSample {
            velocities: self.velocities.then_some(frame.velocities),
            normals: self.normals.then_some(normals),
            bounds: Some(bounds_of(frame.positions)),
            ..PolyMeshSample::of(frame.positions)
        }
    }
}

impl Declared {
    fn write(&mut self, archive: &mut ArchiveWriter, sample: &PolyMeshSample<'_>) -> Result<(), AlembicError> {
        self.mesh.write(archive, sample)?;
        let bounds = sample.bounds.unwrap_or(EMPTY_BOUNDS);
        // Those of the archive are in the world.
        let bounds = self.origin.map_or(bounds, |origin| shifted(bounds, origin));
        archive.write_archive_bounds(self.sampling, &bounds)
    }

    fn write_crossings(&self, archive: &mut ArchiveWriter, count: Option<u32>) -> Result<(), AlembicError> {
        match (self.crossings, count) {
            (Some(property), Some(count)) => archive.write_sample(property, &[count]),
            _ => Ok(()),
        }
    }

    fn write_values(
        &self,
        archive: &mut ArchiveWriter,
        attributes: &PointAttributes,
        values: PointValues<'_>,
    ) -> Result<(), AlembicError> {
        let all = self.values.iter().zip(attributes.moving_of(values));
        all.into_iter().try_for_each(|(writer, (_, numbers))| writer.write(archive, numbers, None))
    }
}

impl Open {
    /// Makes sure that the file still is under its name with all that was committed.
    fn check(&self, path: &Path) -> Result<(), IoError> {
        let committed = self.archive.mark().map_or(0, |mark| mark.end);
        written_file::check(path, self.archive.file(), committed)
    }

    /// Appends a later frame.
    fn write(
        &mut self,
        sample: &PolyMeshSample<'_>,
        (crossings, attributes, values): (Option<u32>, &PointAttributes, PointValues<'_>),
    ) -> Result<(), AlembicError> {
        self.declared.write(&mut self.archive, sample)?;
        self.declared.write_crossings(&mut self.archive, crossings)?;
        self.declared.write_values(&mut self.archive, attributes, values)?;
        self.archive.commit(Durability::Flushed)
    }
}

impl CacheWriter for AlembicWriter {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        let expected = self.mark.next(self.first_frame, self.sub_frames);
        assert_eq!((frame.frame, frame.sub_frame), expected, "frames come in order, as the samples of the archive do");
        // Closed until the frame is complete: after an error nothing may follow.
        let open = match std::mem::replace(&mut self.stage, Stage::Closed) {
            Stage::Empty => Box::new(self.write_first(frame)?),
            Stage::Open(mut open) => {
                open.check(&self.path)?;
                open.write(&self.sample(frame), (frame.crossings, &self.attributes, frame.values))?;
                open
            }
            Stage::Closed => panic!("no frame is written after an error or after the end"),
        };
        if let Some(mark) = open.archive.mark() {
            self.mark = cache_mark(&self.path, frame, &mark);
        }
        self.stage = Stage::Open(open);
        Ok(())
    }

    fn mark(&self) -> CacheMark {
        self.mark.clone()
    }

    fn sync(&mut self) -> Result<(), IoError> {
        if let Stage::Open(open) = &mut self.stage {
            open.archive.sync()?;
            open.check(&self.path)?;
            sync_name(&self.path);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), IoError> {
        if let Stage::Open(mut open) = std::mem::replace(&mut self.stage, Stage::Closed) {
            open.archive.sync()?;
            open.check(&self.path)?;
            open.archive.finish(Durability::Synced)?;
            sync_name(&self.path);
            // What was cut while a frame was written is long enough again, and no archive any more.
            if self.last_frame_held() != self.mark.last_frame {
                let what = "has changed this file".to_owned();
                return Err(IoError::OutputChanged { path: self.path.clone(), what });
            }
        }
        Ok(())
    }
}

impl Still {
    /// Takes it from a mesh; every list becomes what the archive holds in its own place.
    fn of(mut data: MeshData) -> Self {
        let triangles = triangles_to_store(&data);
        let mesh = &mut data.mesh;
        reverse(&mesh.face_counts, &mut mesh.face_indices);
        if let Some(uvs) = &mut data.uvs {
            reverse(&mesh.face_counts, &mut uvs.indices);
        }
        let signed = |list: Vec<u32>| list.into_iter().map(|number| number as i32).collect();
        let MeshData { mesh, uvs, face_sets, params, render_mesh_of, .. } = data;
        let (face_counts, face_indices) = (signed(mesh.face_counts), signed(mesh.face_indices));
        Self { face_counts, face_indices, uvs, face_sets, params, render_mesh_of, triangles }
    }

    /// A frame with everything that is written with the first one only.
    fn with<'a>(&'a self, sample: PolyMeshSample<'a>) -> PolyMeshSample<'a> {
        let uv = self.uvs.as_ref().map(|uvs| Indexed {
            values: uvs.values.as_slice(),
            indices: Some(uvs.indices.as_slice()),
            scope: Scope::FaceVarying,
            source_name: Some(uvs.name.as_str()).filter(|name| !name.is_empty()),
        });
        let topology = Some(Topology { face_counts: &self.face_counts, face_indices: &self.face_indices });
        PolyMeshSample { topology, uv, ..sample }
    }
}

/// One sample a frame, or a cycle of them.
fn sampling(plan: &CachePlan<'_>) -> Result<TimeSampling, AlembicError> {
    let (first, duration) = (plan.timeline.file_time(plan.first_frame), plan.timeline.frame_duration());
    if plan.sub_frames.is_empty() {
        return TimeSampling::uniform(first, duration);
    }
    let times = [0.0].iter().chain(plan.sub_frames).map(|fraction| first + fraction * duration);
    TimeSampling::cyclic(duration, times.collect())
}

fn cache_mark(path: &Path, frame: &CacheFrame<'_>, mark: &ArchiveMark) -> CacheMark {
    CacheMark {
        last_frame: Some(frame.frame),
        sub_frame: frame.sub_frame,
        bytes: mark.end,
        root: Some(mark.root),
        digest: hexadecimal(mark.digest),
        ..CacheMark::none(path)
    }
}

/// The place in the archive that a mark means, if it has all that belongs to one.
fn archive_mark(mark: &CacheMark) -> Option<ArchiveMark> {
    Some(ArchiveMark { root: mark.root?, end: mark.bytes, digest: digest_of(&mark.digest)? })
}

/// The archive's error with what helps when a run cannot be continued.
fn not_continued(path: &Path, mark: &CacheMark, error: AlembicError) -> IoError {
    let frame = mark.last_frame.map_or_else(String::new, |frame| format!("frame {frame}"));
    match error {
        AlembicError::Io { ref source, action: "open", .. } if source.kind() == ErrorKind::NotFound => {
            lost(path, frame)
        }
        AlembicError::Io { .. } => error.into(),
        AlembicError::Damaged { place, reason, .. } => cannot_continue(path, format!("{frame}, {place}"), reason),
        AlembicError::Refused { place, reason, .. } => {
            let what = format!("the cache was started with different settings: {reason}");
            cannot_continue(path, format!("{frame}, {place}"), what)
        }
        AlembicError::NotOgawa { reason, .. } => cannot_continue(path, frame, reason),
        _ => cannot_continue(path, frame, "the archive has changed since it was written"),
    }
}

/// The transform that moves what is counted from an origin to where it is.
fn shift(origin: [f64; 3]) -> Matrix {
    let mut matrix = IDENTITY;
    matrix[12..15].copy_from_slice(&origin);
    matrix
}

/// Bounds of what is moved by `origin`.
pub(super) fn shifted(mut bounds: Bounds, origin: [f64; 3]) -> Bounds {
    bounds.iter_mut().zip(origin.iter().cycle()).for_each(|(bound, origin)| *bound += origin);
    bounds
}

/// The smallest bounds that hold all positions.
pub(super) fn bounds_of(positions: &[[f32; 3]]) -> Bounds {
    let mut bounds = EMPTY_BOUNDS;
    for p in positions {
        for axis in 0..3 {
            bounds[axis] = bounds[axis].min(f64::from(p[axis]));
            bounds[axis + 3] = bounds[axis + 3].max(f64::from(p[axis]));
        }
    }
    bounds
}
