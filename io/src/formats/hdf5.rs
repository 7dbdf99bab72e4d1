//! HDF5 caches: one file a garment, whole and readable from the moment it is created.
//!
//! The file is created with room for every planned frame and closed at once; frames are then written with plain
//! positioned writes into the places of the datasets, each followed by its mark in `committed`. So nobody holds the
//! file open through the HDF5 library: readers meet no lock, and a killed run leaves a file that opens like any other
//! (`docs/decisions/0002-hdf5-preallocated.md`). A frame whose mark is 0 reads as zeros.
//!
//! | dataset | shape | type | content |
//! |---|---|---|---|
//! | `positions` | (frames, points, 3) | f32 | in the file's unit and up axis |
//! | `velocities` | (frames, points, 3) | f32 | per second, only if asked for |
//! | `times` | (frames) | f64 | frame / fps [s] |
//! | `frame_numbers` | (frames) | i64 | |
//! | `committed` | (frames) | u8 | 1 when the frame is complete |
//! | `crossings` | (frames) | u32 | edges of cloth through cloth, all garments; only if the shot counts them |
//! | `face_counts`, `face_indices` | (faces), (corners) | i32 | counter-clockwise |
//! | `triangles` | (triangles, 3) | i32 | what is simulated: how faces with more corners are cut |
//! | `uv_values`, `uv_indices` | (values, 2), (corners) | f32, i32 | only if the garment has them |

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use hdf5::plist::dataset_create::{AllocTime, FillTime};
use hdf5::types::VarLenUnicode;
use hdf5::{Dataset, H5Type};

use crate::cache::{APPLICATION, CacheFrame, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::inspect::{FileSummary, MeshSummary, face_kinds};
use crate::units::Units;

/// Version of the layout above, stored as the attribute `format_version`.
const FORMAT_VERSION: i64 = 1;

/// An HDF5 cache being written.
#[derive(Debug)]
pub struct Hdf5Writer {
    path: PathBuf,
    file: File,
    units: Units,
    first_frame: i64,
    frame_count: usize,
    point_count: usize,
    offsets: Offsets,
    bytes: Vec<u8>,
}

/// Where the datasets that grow lie in the file [bytes].
#[derive(Debug, Clone, Copy)]
struct Offsets {
    positions: u64,
    velocities: Option<u64>,
    crossings: Option<u64>,
    committed: u64,
}

impl Hdf5Writer {
    /// Creates the file with room for all frames of the plan; an existing file is replaced.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path, plan: &CachePlan<'_>) -> Result<Self, IoError> {
        let offsets = create_file(path, plan).map_err(|source| IoError::Hdf5 { path: path.to_owned(), source })?;
        let file = OpenOptions::new().write(true).open(path).map_err(|e| IoError::creating(path, e))?;
        Ok(Self {
            path: path.to_owned(),
            file,
            units: plan.units,
            first_frame: plan.first_frame,
            frame_count: plan.frame_count(),
            point_count: plan.mesh.mesh.points.len(),
            offsets,
            bytes: Vec::new(),
        })
    }

    fn write_vectors(&mut self, offset: u64, index: usize, vectors: &[Vec3]) -> std::io::Result<()> {
        assert_eq!(vectors.len(), self.point_count, "a garment keeps its number of points");
        self.bytes.clear();
        for v in vectors {
            for x in self.units.stored(*v) {
                self.bytes.extend_from_slice(&x.to_ne_bytes());
            }
        }
        self.file.seek(SeekFrom::Start(offset + (index * self.bytes.len()) as u64))?;
        self.file.write_all(&self.bytes)
    }

    fn write_frame(&mut self, frame: &CacheFrame<'_>, index: usize) -> std::io::Result<()> {
        self.write_vectors(self.offsets.positions, index, frame.positions)?;
        if let Some(offset) = self.offsets.velocities {
            self.write_vectors(offset, index, frame.velocities)?;
        }
        if let (Some(offset), Some(count)) = (self.offsets.crossings, frame.crossings) {
            self.file.seek(SeekFrom::Start(offset + (index * size_of::<u32>()) as u64))?;
            self.file.write_all(&count.to_ne_bytes())?;
        }
        self.file.seek(SeekFrom::Start(self.offsets.committed + index as u64))?;
        self.file.write_all(&[1])
    }
}

impl CacheWriter for Hdf5Writer {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        let index = usize::try_from(frame.frame - self.first_frame).unwrap_or(usize::MAX);
        assert!(index < self.frame_count, "frames come from the planned range");
        self.write_frame(frame, index).map_err(|e| IoError::writing(&self.path, e))
    }

    fn finish(&mut self) -> Result<(), IoError> {
        self.file.sync_all().map_err(|e| IoError::writing(&self.path, e))
    }
}

/// What a cache of this layout holds.
///
/// # Errors
/// The file cannot be opened or has another layout.
pub fn inspect(path: &Path) -> Result<FileSummary, IoError> {
    read_summary(path).map_err(|source| {
        IoError::data(path, "HDF5", source.to_string(), "it is damaged, or not a cache of this program")
    })
}

fn read_summary(path: &Path) -> hdf5::Result<FileSummary> {
    let file = hdf5::File::open(path)?;
    let text = |name: &str| Ok::<_, hdf5::Error>(file.attr(name)?.read_scalar::<VarLenUnicode>()?.to_string());
    let committed = file.dataset("committed")?.read_raw::<u8>()?;
    let frames = file.dataset("frame_numbers")?.read_raw::<i64>()?;
    let times = file.dataset("times")?.read_raw::<f64>()?;
    let counts = file.dataset("face_counts")?.read_raw::<u32>()?;
    let mut properties = Vec::new();
    for name in ["application", "garment", "length_unit", "up_axis"] {
        properties.push((name.to_owned(), text(name)?));
    }
    properties.push(("fps".into(), file.attr("fps")?.read_scalar::<f64>()?.to_string()));
    if let Some((first, last)) = frames.first().zip(frames.last()) {
        properties.push(("planned frames".into(), format!("{first}-{last}")));
    }
    let done = committed.iter().filter(|mark| **mark == 1).count();
    properties.push(("committed frames".into(), done.to_string()));
    let mesh = MeshSummary {
        path: text("object_path")?,
        points: file.dataset("positions")?.shape().get(1).copied().unwrap_or(0),
        faces: face_kinds(&counts),
        topology: "constant faces, moving points",
        samples: done,
        times: [times.first().copied().unwrap_or(0.0), times.get(done.max(1) - 1).copied().unwrap_or(0.0)],
        uvs: file.dataset("uv_values").ok().map(|uvs| ("uv".to_owned(), uvs.shape()[0])),
        velocities: file.link_exists("velocities"),
        ..MeshSummary::default()
    };
    Ok(FileSummary { format: "HDF5 (Drapery)", properties, meshes: vec![mesh], others: Vec::new() })
}

/// Creates the file, fills in what does not change, and closes it.
fn create_file(path: &Path, plan: &CachePlan<'_>) -> hdf5::Result<Offsets> {
    // Times of change are left out so that equal runs give equal bytes.
    let file = hdf5::File::with_options()
        .with_fapl(|access| access.libver_v110())
        .with_fcpl(|create| create.obj_track_times(false))
        .create(path)?;
    write_attributes(&file, plan)?;
    let (frames, points) = (plan.frame_count(), plan.mesh.mesh.points.len());
    let numbers: Vec<i64> = (plan.first_frame..=plan.last_frame).collect();
    let times: Vec<f64> = numbers.iter().map(|&frame| plan.file_time(frame)).collect();
    fixed(&file, "times", &times, &[frames])?;
    fixed(&file, "frame_numbers", &numbers, &[frames])?;
    let mesh = &plan.mesh.mesh;
    fixed(&file, "face_counts", &as_i32(&mesh.face_counts), &[mesh.face_counts.len()])?;
    fixed(&file, "face_indices", &as_i32(&mesh.face_indices), &[mesh.face_indices.len()])?;
    fixed(&file, "triangles", &as_i32(plan.triangles.as_flattened()), &[plan.triangles.len(), 3])?;
    if let Some(uvs) = &plan.mesh.uvs {
        let flat: Vec<f32> = uvs.values.iter().flatten().copied().collect();
        fixed(&file, "uv_values", &flat, &[uvs.values.len(), 2])?;
        fixed(&file, "uv_indices", &as_i32(&uvs.indices), &[uvs.indices.len()])?;
    }
    let committed = growing::<u8>(&file, "committed", &[frames])?;
    let crossings = plan.crossings.then(|| growing::<u32>(&file, "crossings", &[frames])).transpose()?;
    let velocities = plan.velocities.then(|| growing::<f32>(&file, "velocities", &[frames, points, 3])).transpose()?;
    let positions = growing::<f32>(&file, "positions", &[frames, points, 3])?;
    Ok(Offsets { positions, velocities, crossings, committed })
}

fn as_i32(values: &[u32]) -> Vec<i32> {
    // Checked meshes have fewer than 2³¹ corners.
    values.iter().map(|&v| v as i32).collect()
}

fn fixed<T: H5Type>(file: &hdf5::File, name: &str, values: &[T], shape: &[usize]) -> hdf5::Result<()> {
    let dataset = file.new_dataset::<T>().obj_track_times(false).shape(shape.to_vec()).create(name)?;
    dataset.write_raw(values)
}

/// A dataset whose space is reserved in the file but not written, and where it lies. What nobody wrote reads as zeros.
fn growing<T: H5Type>(file: &hdf5::File, name: &str, shape: &[usize]) -> hdf5::Result<u64> {
    let dataset: Dataset = file
        .new_dataset::<T>()
        .no_chunk()
        .alloc_time(Some(AllocTime::Early))
        .fill_time(FillTime::Never)
        .obj_track_times(false)
        .shape(shape.to_vec())
        .create(name)?;
    dataset.offset().ok_or_else(|| hdf5::Error::from(format!("dataset {name} has no fixed place in the file")))
}

fn write_attributes(file: &hdf5::File, plan: &CachePlan<'_>) -> hdf5::Result<()> {
    let texts = [
        ("application", APPLICATION.to_owned()),
        ("garment", plan.garment.to_owned()),
        ("object_path", plan.object_path()),
        ("length_unit", plan.units.length.word().to_owned()),
        ("up_axis", format!("{:?}", plan.units.up)),
        ("winding", "counter-clockwise".to_owned()),
    ];
    for (name, text) in texts {
        let value: VarLenUnicode = text.replace('\0', " ").parse().map_err(|e| hdf5::Error::from(format!("{e}")))?;
        file.new_attr::<VarLenUnicode>().create(name)?.write_scalar(&value)?;
    }
    let numbers = [("fps", plan.fps()), ("metres_per_unit", plan.units.length.metres())];
    for (name, value) in numbers {
        file.new_attr::<f64>().create(name)?.write_scalar(&value)?;
    }
    let (numerator, denominator) = (plan.timeline.fps_numerator, plan.timeline.fps_denominator);
    let integers = [
        ("format_version", FORMAT_VERSION),
        ("fps_numerator", i64::from(numerator)),
        ("fps_denominator", i64::from(denominator)),
    ];
    for (name, value) in integers {
        file.new_attr::<i64>().create(name)?.write_scalar(&value)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::{MeshData, Uvs};
    use crate::units::{LengthUnit, UpAxis};
    use drapery_core::mesh::PolygonMesh;
    use drapery_core::scene::Timeline;

    fn triangle() -> MeshData {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let mut data = MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]]));
        data.uvs = Some(Uvs { name: "map".into(), values: vec![[0.0, 0.5]], indices: vec![0, 0, 0] });
        data
    }

    fn plan(mesh: &MeshData) -> CachePlan<'_> {
        CachePlan {
            garment: "flag",
            mesh,
            triangles: &[[0, 1, 2]],
            units: Units { length: LengthUnit::Centimetre, up: UpAxis::Z },
            timeline: Timeline::default(),
            first_frame: 1001,
            last_frame: 1004,
            velocities: true,
            crossings: true,
        }
    }

    fn written(folder: &Path, name: &str, frames: i64) -> PathBuf {
        let mesh = triangle();
        let path = folder.join(name);
        let mut writer = Hdf5Writer::create(&path, &plan(&mesh)).unwrap();
        for frame in 1001..1001 + frames {
            let positions = [Vec3::new(0.01, 0.02, 0.03), Vec3::x(), Vec3::new(0.0, frame as f64, 0.0)];
            let velocities = [Vec3::zeros(), Vec3::zeros(), Vec3::new(0.0, 24.0, 0.0)];
            let crossings = Some((frame - 1000) as u32);
            writer.write(&CacheFrame { frame, positions: &positions, velocities: &velocities, crossings }).unwrap();
        }
        // Dropped without `finish`, as a killed process would leave it.
        path
    }

    #[test]
    fn a_file_that_was_never_finished_holds_every_committed_frame() {
        let folder = tempfile::tempdir().unwrap();
        let file = hdf5::File::open(written(folder.path(), "flag.h5", 2)).unwrap();
        assert_eq!(file.dataset("committed").unwrap().read_raw::<u8>().unwrap(), [1, 1, 0, 0]);
        let positions = file.dataset("positions").unwrap();
        assert_eq!(positions.shape(), [4, 3, 3]);
        let values = positions.read_raw::<f32>().unwrap();
        // Centimetres with Z up: (x, y, z) m is (x, -z, y) · 100.
        assert_eq!(&values[..3], [1.0, -3.0, 2.0]);
        assert_eq!(values[9 + 8], 100_200.0);
        assert!(values[18..].iter().all(|v| *v == 0.0));
        assert_eq!(file.dataset("velocities").unwrap().read_raw::<f32>().unwrap()[8], 2400.0);
        assert_eq!(file.dataset("triangles").unwrap().read_raw::<i32>().unwrap(), [0, 1, 2]);
        assert_eq!(file.dataset("crossings").unwrap().read_raw::<u32>().unwrap()[..2], [1, 2]);
        assert_eq!(file.dataset("times").unwrap().read_raw::<f64>().unwrap()[1], 1002.0 / 24.0);
        drop(file);
        let summary = inspect(&folder.path().join("flag.h5")).unwrap();
        assert_eq!((summary.meshes[0].samples, summary.meshes[0].points), (2, 3));
    }

    #[test]
    fn equal_runs_give_equal_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let first = std::fs::read(written(folder.path(), "a.h5", 3)).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(1100)); // HDF5 counts times of change in seconds
        let second = std::fs::read(written(folder.path(), "b.h5", 3)).unwrap();
        assert!(first == second);
    }
}
