//! Caches as arrays: read, and written frame by frame.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};

use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_io::attributes::{PointAttributes, PointValues};
use drapery_io::cache::{self, CacheFrame, CachePlan};
use drapery_io::cache_frames::{Between, CacheFrames, CacheMesh};
use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::{MeshData, Uvs};
use drapery_io::units::{LengthUnit, Units, UpAxis};
use drapery_shot::fault::{Fault, FaultKind};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, Faces};
use crate::errors::{in_use, raised, usage};

/// A cache, opened to be read.
#[pyclass(module = "drapery._native", frozen)]
pub(crate) struct Cache {
    frames: Mutex<CacheFrames>,
    path: PathBuf,
}

/// Values of texture coordinates, and the value of each corner.
type UvArrays<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<u32>>);

impl Cache {
    fn opened(&self) -> PyResult<MutexGuard<'_, CacheFrames>> {
        self.frames.try_lock().map_err(|error| in_use("cache", &error))
    }
}

/// A unit of length by its word; `name` is the argument that it is.
pub(crate) fn length_of(name: &str, word: &str) -> PyResult<LengthUnit> {
    LengthUnit::ALL.into_iter().find(|unit| unit.word() == word).ok_or_else(|| {
        let known = LengthUnit::ALL.map(LengthUnit::word).join(", ");
        usage(format!("`{name}` is {word:?}\n  help: give one of {known}"))
    })
}

/// An up axis by its letter; `name` is the argument that it is.
pub(crate) fn axis_of(name: &str, letter: &str) -> PyResult<UpAxis> {
    match letter {
        "Y" => Ok(UpAxis::Y),
        "Z" => Ok(UpAxis::Z),
        other => Err(usage(format!("`{name}` is {other:?}\n  help: give Y or Z"))),
    }
}

/// The letter of an up axis.
pub(crate) fn axis(up: UpAxis) -> &'static str {
    match up {
        UpAxis::Y => "Y",
        UpAxis::Z => "Z",
    }
}

/// Distance of two samples that are one [frames].
const SAME_SAMPLE: f64 = 1e-6;

/// The sample of a frame, or of a time between frames.
fn sample_of(path: &Path, mesh: &CacheMesh, frame: f64) -> PyResult<usize> {
    let whole = (frame.fract() == 0.0).then_some(frame as i64);
    let is_it = |at: &Between| (time_of(at) - frame).abs() < SAME_SAMPLE;
    let found = match whole {
        Some(whole) => mesh.frames.binary_search(&whole).ok(),
        None => mesh.between.iter().position(is_it).map(|place| mesh.frames.len() + place),
    };
    found.ok_or_else(|| {
        let advice = match frames_of(mesh).as_slice() {
            [] => "it holds no frame yet".to_owned(),
            [first, .., last] => format!("it holds frames {first} to {last}"),
            [only] => format!("it holds frame {only} alone"),
        };
        let what = format!("{}: there is no such frame of {}", path.display(), mesh.name);
        let mut fault = Fault::new(FaultKind::Usage, format!("frame {frame}: {what}\n  help: {advice}"));
        (fault.object, fault.frame) = (Some(mesh.name.clone()), whole);
        raised(fault)
    })
}

/// Time of a sample between frames, in frames.
fn time_of(at: &Between) -> f64 {
    at.frame as f64 + at.behind
}

/// Frames of a mesh: the whole ones, or where no sample is one, those that there are.
fn frames_of(mesh: &CacheMesh) -> Vec<f64> {
    match mesh.frames.is_empty() {
        true => mesh.between.iter().map(time_of).collect(),
        false => mesh.frames.iter().map(|frame| *frame as f64).collect(),
    }
}

#[pymethods]
impl Cache {
    #[new]
    fn new(py: Python<'_>, path: PathBuf, fps: Option<f64>) -> PyResult<Self> {
        let open = || match fps {
            Some(fps) => CacheFrames::open_at_rate(&path, fps),
            None => CacheFrames::open(&path),
        };
        Ok(Self { frames: py.detach(open).map_err(raised)?.into(), path })
    }

    /// Paths of the objects.
    #[getter]
    fn objects(&self) -> PyResult<Vec<String>> {
        Ok(self.opened()?.meshes.iter().map(|mesh| mesh.name.clone()).collect())
    }

    /// Frames of a mesh, and whether they are whole.
    fn frames(&self, mesh: usize) -> PyResult<(Vec<f64>, bool)> {
        let cache = self.opened()?;
        let mesh = &cache.meshes[mesh];
        Ok((frames_of(mesh), !mesh.frames.is_empty()))
    }

    fn point_count(&self, mesh: usize) -> PyResult<usize> {
        Ok(self.opened()?.meshes[mesh].points)
    }

    #[getter]
    fn fps(&self) -> PyResult<Option<f64>> {
        Ok(self.opened()?.fps)
    }

    /// Unit of the file, if it is one that has a word, and its axis.
    #[getter]
    fn units(&self) -> PyResult<(Option<&'static str>, &'static str)> {
        let units = self.opened()?.input_units;
        Ok((units.named().map(LengthUnit::word), axis(units.up)))
    }

    fn positions<'py>(&self, py: Python<'py>, mesh: usize, frame: f64) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let cache = self.opened()?;
        let sample = sample_of(&self.path, &cache.meshes[mesh], frame)?;
        arrays::vectors(py, cache.positions(mesh, sample).map_err(raised)?)
    }

    fn velocities<'py>(&self, py: Python<'py>, mesh: usize, frame: f64) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let cache = self.opened()?;
        let sample = sample_of(&self.path, &cache.meshes[mesh], frame)?;
        cache.velocities(mesh, sample).map_err(raised)?.map(|values| arrays::vectors(py, values)).transpose()
    }

    /// Attributes at a frame by their names, in metres with Y up.
    fn attributes<'py>(&self, py: Python<'py>, mesh: usize, frame: f64) -> PyResult<Bound<'py, PyDict>> {
        let cache = self.opened()?;
        let sample = sample_of(&self.path, &cache.meshes[mesh], frame)?;
        let (held, units) = (&cache.meshes[mesh], cache.input_units);
        let stored = cache.samples.frame(mesh, sample).map_err(raised)?;
        let all = PyDict::new(py);
        // Where parents turn a mesh of another program, its normals are not those of the world.
        let shifted = cache.samples.shifted(mesh, sample).map_err(raised)?;
        if let (Some(normals), Some(_)) = (stored.normals, &shifted) {
            let normals = match &held.split_normals {
                Some(split) => split.at_corners(&normals),
                None => normals,
            };
            let turned = |v: [f32; 3]| units.to_si(Vec3::from(v.map(f64::from))) / units.metres;
            all.set_item("normals", arrays::vectors(py, normals.into_iter().map(turned).collect())?)?;
        }
        if let (Some(rest), Some((origin, _))) = (&held.attributes.rest, &shifted) {
            let placed = |v: &[f32; 3]| units.to_si(Vec3::from(v.map(f64::from)) + Vec3::from(*origin));
            all.set_item("rest", arrays::vectors(py, rest.iter().map(placed).collect())?)?;
        }
        if let Some(thickness) = &held.attributes.thickness {
            let metres = thickness.iter().map(|h| f64::from(*h) * units.metres).collect();
            all.set_item("thickness", PyArray1::<f64>::from_vec(py, metres))?;
        }
        for (name, numbers) in stored.values.named() {
            all.set_item(name, PyArray1::<f64>::from_iter(py, numbers.iter().copied().map(f64::from)))?;
        }
        Ok(all)
    }

    fn faces<'py>(&self, py: Python<'py>, mesh: usize) -> PyResult<Faces<'py>> {
        Ok(arrays::faces(py, self.opened()?.meshes[mesh].faces.clone()))
    }

    fn triangles<'py>(&self, py: Python<'py>, mesh: usize) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let triangles = self.opened()?.meshes[mesh].triangles.clone();
        arrays::rows(py, triangles.into_flattened(), 3)
    }

    fn uvs<'py>(&self, py: Python<'py>, mesh: usize) -> PyResult<Option<UvArrays<'py>>> {
        let Some(Uvs { values, indices, .. }) = self.opened()?.attributes(mesh).map_err(raised)?.uvs else {
            return Ok(None);
        };
        Ok(Some((arrays::rows(py, values.into_flattened(), 2)?, PyArray1::from_vec(py, indices))))
    }
}

/// A cache that is being written.
#[pyclass(module = "drapery._native", frozen)]
pub(crate) struct CacheWriter {
    /// `None` once it is closed.
    file: Mutex<Option<Box<dyn cache::CacheWriter>>>,
    path: PathBuf,
    points: usize,
    next: Mutex<i64>,
    frames: (i64, i64),
    units: Units,
    velocities: bool,
}

/// Parameters of a writer, as Python hands them over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Plan<'py> {
    name: String,
    positions: PyReadonlyArray2<'py, f64>,
    face_counts: PyReadonlyArray1<'py, u32>,
    corners: PyReadonlyArray1<'py, u32>,
    uvs: Option<(PyReadonlyArray2<'py, f32>, PyReadonlyArray1<'py, u32>)>,
    frames: (i64, i64),
    fps: (u32, u32),
    length: String,
    up: String,
    velocities: bool,
    overwrite: bool,
}

impl Plan<'_> {
    fn units(&self) -> PyResult<Units> {
        Ok(Units { length: length_of("length", &self.length)?, up: axis_of("up", &self.up)? })
    }

    /// The mesh, whose faces and points fit each other.
    fn mesh(&self) -> PyResult<MeshData> {
        let mesh = arrays::mesh(&self.positions, &self.face_counts, &self.corners)?;
        let mut checked = drapery_io::memory_mesh::MemoryMeshes::default();
        checked.insert(&self.name, mesh.clone()).map_err(raised)?;
        let uvs = self.uvs.as_ref().map(|(values, indices)| {
            let values = values.as_array().rows().into_iter().map(|row| [row[0], row[1]]).collect::<Vec<_>>();
            Uvs { name: String::new(), values, indices: indices.as_array().to_vec() }
        });
        if let Some(uvs) = &uvs {
            let fits = uvs.indices.len() == mesh.face_indices.len();
            if !fits || uvs.indices.iter().any(|index| *index as usize >= uvs.values.len()) {
                let corners = mesh.face_indices.len();
                let what = format!("{} values for {} corners", uvs.indices.len(), corners);
                return Err(usage(format!("`uvs`: {what}\n  help: give each corner the number of a value")));
            }
        }
        Ok(MeshData { uvs, ..MeshData::new(mesh) })
    }
}

#[pymethods]
impl CacheWriter {
    #[new]
    fn new(path: PathBuf, plan: Plan<'_>) -> PyResult<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        // Others are valid only when all frames are there.
        let grows = |format: &&formats::Format| format.resume.is_some();
        let Some(create) = formats::by_extension(&extension).filter(grows).and_then(|format| format.create) else {
            let written = formats::FORMATS.iter().filter(grows);
            let known: Vec<String> = written.map(|format| format!(".{}", format.extension)).collect();
            return Err(raised(IoError::Format {
                path,
                what: format!("caches cannot be written as .{extension} files"),
                advice: format!("give a file that ends with {}", known.join(", ")),
            }));
        };
        let (first, last) = plan.frames;
        if last < first {
            return Err(usage(format!("`frames` are {first} to {last}\n  help: give the first and the last frame")));
        }
        if plan.fps.0 == 0 || plan.fps.1 == 0 {
            return Err(usage("`fps` is no rate\n  help: give frames per second, as in 24 or (24000, 1001)"));
        }
        let (units, data) = (plan.units()?, plan.mesh()?);
        let points = data.mesh.points.len();
        let (beside, mesh) = (formats::folder_of(&path), GarmentMesh::kept(data));
        let taken = [Some(&path), beside.as_ref()].into_iter().flatten().find(|path| path.symlink_metadata().is_ok());
        if let Some(taken) = taken {
            if !plan.overwrite {
                return Err(raised(IoError::FileExists { path: taken.clone() }));
            }
            let clear =
                formats::remove_folder(&path).and_then(|()| beside.as_deref().map_or(Ok(()), formats::remove_folder));
            clear.map_err(raised)?;
        }
        let (fps_numerator, fps_denominator) = plan.fps;
        let file = create(
            &path,
            &CachePlan {
                garment: &plan.name,
                mesh: &mesh,
                units,
                origin: Vec3::zeros(),
                timeline: Timeline { fps_numerator, fps_denominator, origin: first, start: first },
                first_frame: first,
                last_frame: last,
                velocities: plan.velocities,
                normals: false,
                crossings: false,
                sub_frames: &[],
                attributes: PointAttributes::default(),
            },
        );
        let file = Mutex::new(Some(file.map_err(raised)?));
        let (frames, velocities) = (plan.frames, plan.velocities);
        Ok(Self { file, path, points, next: Mutex::new(first), frames, units, velocities })
    }

    /// Appends a frame: positions [m] and velocities [m/s], Y up.
    fn write(
        &self,
        py: Python<'_>,
        positions: PyReadonlyArray2<'_, f64>,
        velocities: Option<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<i64> {
        let mut file = self.file.try_lock().map_err(|error| in_use("cache", &error))?;
        let mut next = self.next.try_lock().map_err(|error| in_use("cache", &error))?;
        let (frame, path) = (*next, self.path.display());
        let Some(writer) = file.as_mut() else { return Err(usage(format!("{path}: this cache is closed"))) };
        if frame > self.frames.1 {
            let advice = "name a later last frame when the cache is begun";
            return Err(usage(format!("{path}: all frames up to {} are written\n  help: {advice}", self.frames.1)));
        }
        if velocities.is_some() != self.velocities {
            let what = if self.velocities { "needs velocities" } else { "was started without velocities" };
            return Err(usage(format!("{path}: this cache {what}\n  help: give them with every frame, or never")));
        }
        let positions = self.stored(&positions, "positions", frame)?;
        let velocities = velocities.map(|values| self.stored(&values, "velocities", frame)).transpose()?;
        let sample = CacheFrame {
            frame,
            sub_frame: 0,
            positions: &positions,
            velocities: velocities.as_deref().unwrap_or_default(),
            normals: &[],
            crossings: None,
            values: PointValues::default(),
        };
        py.detach(|| writer.write(&sample)).map_err(raised)?;
        *next += 1;
        Ok(frame)
    }

    /// Brings everything to the disk; nothing is written after that.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let taken = self.file.try_lock().map_err(|error| in_use("cache", &error))?.take();
        taken.map_or(Ok(()), |mut file| py.detach(|| file.finish()).map_err(raised))
    }
}

impl CacheWriter {
    /// Vectors as the file stores them.
    fn stored(&self, array: &PyReadonlyArray2<'_, f64>, name: &str, frame: i64) -> PyResult<Vec<[f32; 3]>> {
        let vectors = arrays::points(array, name)?;
        let place = |vertex: String| format!("frame {frame}{vertex}");
        if vectors.len() != self.points {
            let what = format!("{} {name} for {} points", vectors.len(), self.points);
            let advice = "give one for each point of the mesh, in its order";
            return Err(raised(IoError::data(&self.path, place(String::new()), what, advice)));
        }
        let stored = self.units.stored_all(&vectors);
        if let Some(vertex) = stored.iter().position(|vector| !vector.iter().all(|x| x.is_finite())) {
            let what =
                format!("{:?} among the {name} is no number that the file can hold", <[f64; 3]>::from(vectors[vertex]));
            let advice = "give finite numbers, in metres and seconds; no frame was written";
            return Err(raised(IoError::data(&self.path, place(format!(", vertex {vertex}")), what, advice)));
        }
        Ok(stored)
    }
}
