//! HDF5 caches being written and continued.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use drapery_alembic::murmur3_x64_128;
use drapery_core::mesh::MeshStream;

use super::layout::{Offsets, create_file, read_layout};
use crate::atomic_file::unfinished;
use crate::cache::{CacheFrame, CacheMark, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::formats::continuing::{cannot_continue, hexadecimal, lost, marked_frames, remove, sync_name, too_short};
use crate::hdf5_file;
use crate::written_file;

/// An HDF5 cache being written.
#[derive(Debug)]
pub struct Hdf5Writer {
    path: PathBuf,
    first_frame: i64,
    stored: Stored,
    mark: CacheMark,
}

/// The file: where its frames lie, read and written without the library.
#[derive(Debug)]
struct Stored {
    file: File,
    offsets: Offsets,
    frames: usize,
    /// Length of the file [bytes].
    length: u64,
    /// Bytes of the positions or the velocities of a frame.
    vectors: usize,
}

impl Hdf5Writer {
    /// Creates the file with room for all frames of the plan; an existing file is replaced in one step.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(path: &Path, plan: &CachePlan<'_>) -> Result<Self, IoError> {
        let stored = create_beside(path, plan)?;
        fs::rename(unfinished(path), path).map_err(|e| IoError::creating(path, e))?;
        Ok(Self::new(path, plan, stored, CacheMark::none(path)))
    }

    /// Goes on with the cache at `path` after its mark. Readers find a valid file all the time; frames after the mark
    /// are no longer `committed`. Where there are such frames it goes on in a copy, because a program that has the file
    /// open may be reading them; so it does where the range is another one.
    ///
    /// # Errors
    /// The file is missing, damaged, not the one of the mark, or was made with another plan; it then stays as it is.
    pub fn resume(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<Self, IoError> {
        let kept = marked_frames(path, plan, mark)?;
        if kept == 0 {
            return Self::create(path, plan);
        }
        let failed = |e| IoError::writing(path, e);
        let (mut stored, in_place) = Self::found_sound(path, plan, (mark, kept))?;
        remove(&unfinished(path))?;
        let mut bytes = Vec::new();
        if in_place {
            stored.cut(kept, &mut bytes).map_err(failed)?;
        } else {
            let mut copy = create_beside(path, plan)?;
            let copied = copy.copy_frames(&mut stored, kept, &mut bytes).and_then(|()| copy.file.sync_all());
            copied.and_then(|()| fs::rename(unfinished(path), path)).map_err(failed)?;
            sync_name(path);
            stored = copy;
        }
        let size = stored.file.metadata().map_err(failed)?.len();
        Ok(Self::new(path, plan, stored, CacheMark { bytes: size, ..mark.clone() }))
    }

    /// Finds out whether [`Hdf5Writer::resume`] would go on; changes nothing.
    ///
    /// # Errors
    /// The errors of [`Hdf5Writer::resume`], without those of writing.
    pub fn check_resume(path: &Path, plan: &CachePlan<'_>, mark: &CacheMark) -> Result<(), IoError> {
        match marked_frames(path, plan, mark)? {
            0 => Ok(()),
            kept => Self::found_sound(path, plan, (mark, kept)).map(|_| ()),
        }
    }

    /// The file with its first frames found sound, and whether it is gone on with in place.
    fn found_sound(
        path: &Path,
        plan: &CachePlan<'_>,
        (mark, kept): (&CacheMark, usize),
    ) -> Result<(Stored, bool), IoError> {
        let failed = |e| IoError::writing(path, e);
        let frame = mark.last_frame.map_or_else(String::new, |frame| format!("frame {frame}"));
        if !path.try_exists().map_err(failed)? {
            return Err(lost(path, frame));
        }
        let data = plan.mesh.read()?;
        let layout = read_layout(path, plan, &data).map_err(|what| cannot_continue(path, frame.as_str(), what))?;
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        let mut stored = Stored::new(file, layout.offsets, layout.frames, plan).map_err(failed)?;
        let marks = stored.marks().map_err(failed)?;
        if marks.len() < kept || marks[..kept].contains(&0) {
            return Err(cannot_continue(path, frame, "not all frames up to this one are complete"));
        }
        let mut bytes = Vec::new();
        stored.read_frame(kept - 1, &mut bytes).map_err(failed)?;
        if hexadecimal(murmur3_x64_128(&bytes)) != mark.digest {
            return Err(cannot_continue(path, frame, "the frame differs from the one that was written"));
        }
        if let Some(held) = marks.iter().rposition(|mark| *mark != 0).filter(|held| *held >= plan.frame_count()) {
            return Err(too_short(path, plan, plan.first_frame + held as i64));
        }
        let looked_at = marks[kept..].iter().any(|mark| *mark != 0);
        let in_place = stored.frames == plan.frame_count() && !looked_at;
        Ok((stored, in_place))
    }

    fn new(path: &Path, plan: &CachePlan<'_>, stored: Stored, mark: CacheMark) -> Self {
        Self { path: path.to_owned(), first_frame: plan.first_frame, stored, mark }
    }

    /// The frame's bytes one dataset after another, as [`Stored::read_frame`] finds them.
    fn pack(&self, frame: &CacheFrame<'_>) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(3 * self.stored.vectors + size_of::<u32>());
        let velocities = self.stored.offsets.velocities.map(|_| frame.velocities);
        let normals = self.stored.offsets.normals.map(|_| frame.normals);
        let of_normals = self.stored.normals();
        let all =
            [(Some(frame.positions), self.stored.vectors), (velocities, self.stored.vectors), (normals, of_normals)];
        for (vectors, expected) in all.into_iter().filter_map(|(vectors, expected)| Some((vectors?, expected))) {
            let start = bytes.len();
            vectors.as_flattened().iter().for_each(|x| bytes.extend_from_slice(&x.to_ne_bytes()));
            assert_eq!(bytes.len() - start, expected, "a garment keeps its number of points");
        }
        let numbers =
            [(self.stored.offsets.strain, frame.values.strain), (self.stored.offsets.contact, frame.values.contact)];
        for (_, numbers) in numbers.into_iter().filter(|(offset, _)| offset.is_some()) {
            assert_eq!(numbers.len() * size_of::<[f32; 3]>(), self.stored.vectors, "each point has a number");
            numbers.iter().for_each(|x| bytes.extend_from_slice(&x.to_ne_bytes()));
        }
        if self.stored.offsets.crossings.is_some() {
            bytes.extend_from_slice(&frame.crossings.unwrap_or(0).to_ne_bytes());
        }
        bytes
    }
}

/// Makes the file of the plan under another name.
fn create_beside(path: &Path, plan: &CachePlan<'_>) -> Result<Stored, IoError> {
    let part = unfinished(path);
    // The library tells in words what the system refused; the usual reason is a full disk.
    let refused = |what: String| IoError::writing(&part, hdf5_file::refused(what));
    let data = plan.mesh.read()?;
    // The library does not say in a form for programs why it cannot create a file.
    File::create(&part).map_err(|e| IoError::creating(&part, e))?;
    let offsets = create_file(&part, plan, &data).map_err(|error| refused(error.to_string()))?;
    // The library passes over errors of its last writes: what it says it has written is read again.
    read_layout(&part, plan, &data).map_err(refused)?;
    let file = OpenOptions::new().read(true).write(true).open(&part).map_err(|e| IoError::creating(&part, e))?;
    Stored::new(file, offsets, plan.frame_count(), plan).map_err(|e| IoError::writing(&part, e))
}

impl Stored {
    fn new(file: File, offsets: Offsets, frames: usize, plan: &CachePlan<'_>) -> io::Result<Self> {
        let (length, vectors) = (file.metadata()?.len(), plan.mesh.point_count() * size_of::<[f32; 3]>());
        Ok(Self { file, offsets, frames, length, vectors })
    }

    /// Bytes of the normals of a frame.
    fn normals(&self) -> usize {
        self.offsets.normal_count * size_of::<[f32; 3]>()
    }

    /// Places of a frame in the file, without its mark: offset and number of bytes.
    fn places(&self, index: usize) -> impl Iterator<Item = (u64, usize)> + use<> {
        let (offsets, vectors) = (self.offsets, self.vectors);
        let place = move |(offset, size): (u64, usize)| (offset + (index * size) as u64, size);
        let all = [
            Some((offsets.positions, vectors)),
            offsets.velocities.map(|offset| (offset, vectors)),
            offsets.normals.map(|offset| (offset, self.normals())),
            offsets.strain.map(|offset| (offset, vectors / 3)),
            offsets.contact.map(|offset| (offset, vectors / 3)),
            offsets.crossings.map(|offset| (offset, size_of::<u32>())),
        ];
        all.into_iter().flatten().map(place)
    }

    fn read_at(&mut self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(offset))?;
        self.file.read_exact(bytes)
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(offset))?;
        self.file.write_all(bytes)
    }

    /// Values of `committed`.
    fn marks(&mut self) -> io::Result<Vec<u8>> {
        let mut marks = vec![0; self.frames];
        self.read_at(self.offsets.committed, &mut marks)?;
        Ok(marks)
    }

    fn read_frame(&mut self, index: usize, bytes: &mut Vec<u8>) -> io::Result<()> {
        bytes.clear();
        for (offset, size) in self.places(index) {
            let start = bytes.len();
            bytes.resize(start + size, 0);
            self.read_at(offset, &mut bytes[start..])?;
        }
        Ok(())
    }

    /// Writes a frame, then its mark.
    fn write_frame(&mut self, index: usize, bytes: &[u8]) -> io::Result<()> {
        let mut rest = bytes;
        for (offset, size) in self.places(index) {
            let (now, later) = rest.split_at(size);
            self.write_at(offset, now)?;
            rest = later;
        }
        self.write_at(self.offsets.committed + index as u64, &[1])
    }

    /// Makes the file what it was before any frame from `kept` on was written, none of which has its mark: a killed run
    /// may have left a part of one.
    fn cut(&mut self, kept: usize, bytes: &mut Vec<u8>) -> io::Result<()> {
        for index in kept..self.frames {
            self.read_frame(index, bytes)?;
            if bytes.iter().all(|byte| *byte == 0) {
                continue;
            }
            bytes.fill(0);
            for (offset, size) in self.places(index) {
                self.write_at(offset, &bytes[..size])?;
            }
        }
        Ok(())
    }

    /// Takes over the first frames of another file, which may have another range.
    fn copy_frames(&mut self, from: &mut Self, frames: usize, bytes: &mut Vec<u8>) -> io::Result<()> {
        for index in 0..frames {
            from.read_frame(index, bytes)?;
            self.write_frame(index, bytes)?;
        }
        Ok(())
    }
}

impl CacheWriter for Hdf5Writer {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        if frame.sub_frame > 0 {
            return Ok(());
        }
        let expected = self.mark.last_frame.map_or(self.first_frame, |last| last + 1);
        assert_eq!(frame.frame, expected, "frames come in order");
        let index = usize::try_from(frame.frame - self.first_frame).unwrap_or(usize::MAX);
        assert!(index < self.stored.frames, "frames come from the planned range");
        // Not kept between frames: other garments' frames will need the room.
        let bytes = self.pack(frame);
        written_file::check(&self.path, &self.stored.file, self.stored.length)?;
        let failed = |e| IoError::writing(&self.path, e);
        self.stored.write_frame(index, &bytes).map_err(failed)?;
        self.mark = CacheMark {
            last_frame: Some(frame.frame),
            bytes: self.stored.length,
            digest: hexadecimal(murmur3_x64_128(&bytes)),
            ..CacheMark::none(&self.path)
        };
        Ok(())
    }

    fn mark(&self) -> CacheMark {
        self.mark.clone()
    }

    fn sync(&mut self) -> Result<(), IoError> {
        self.stored.file.sync_all().map_err(|e| IoError::writing(&self.path, e))?;
        written_file::check(&self.path, &self.stored.file, self.stored.length)?;
        sync_name(&self.path);
        Ok(())
    }

    fn finish(&mut self) -> Result<(), IoError> {
        self.sync()?;
        // What was cut while a frame was written is long enough again, without the frames before.
        let written = self.mark.last_frame.map_or(0, |last| last.abs_diff(self.first_frame) as usize + 1);
        let marks = self.stored.marks().map_err(|e| IoError::writing(&self.path, e))?;
        if marks.iter().take_while(|mark| **mark == 1).count() < written {
            let what = "has changed this file".to_owned();
            return Err(IoError::OutputChanged { path: self.path.clone(), what });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attributes::{PointAttributes, PointValues};
    use crate::formats::hdf5::summary::summary;
    use crate::garment_mesh::GarmentMesh;
    use crate::mesh_data::{MeshData, Uvs};
    use crate::units::{LengthUnit, Units, UpAxis};
    use drapery_core::Vec3;
    use drapery_core::mesh::PolygonMesh;
    use drapery_core::scene::Timeline;

    fn triangle() -> GarmentMesh {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let mut data = MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]]));
        data.uvs = Some(Uvs { name: "map".into(), values: vec![[0.0, 0.5]], indices: vec![0, 0, 0] });
        GarmentMesh::kept(data)
    }

    fn plan(mesh: &GarmentMesh) -> CachePlan<'_> {
        CachePlan {
            sub_frames: &[],
            garment: "flag",
            mesh,
            units: Units { length: LengthUnit::Centimetre, up: UpAxis::Z },
            origin: Vec3::zeros(),
            timeline: Timeline::default(),
            first_frame: 1001,
            last_frame: 1004,
            velocities: true,
            normals: false,
            crossings: true,
            attributes: PointAttributes::default(),
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
            let [positions, velocities] = [positions, velocities].map(|vectors| plan(&mesh).units.stored_all(&vectors));
            let frame = CacheFrame {
                frame,
                sub_frame: 0,
                positions: &positions,
                velocities: &velocities,
                normals: &[],
                crossings,
                values: PointValues::default(),
            };
            writer.write(&frame).unwrap();
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
        let summary = summary(&folder.path().join("flag.h5")).unwrap();
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
