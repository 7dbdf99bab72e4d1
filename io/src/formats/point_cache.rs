//! Point caches for tools that read nothing else: PC2 and MDD. Both hold the points of one mesh at whole frames and nothing more:
//! no faces, units, velocities or attributes; the mesh that they move is loaded from elsewhere. `drapery convert` writes them.
//!
//! | | PC2 | MDD |
//! |---|---|---|
//! | numbers | little-endian | big-endian |
//! | header | `POINTCACHE2\0`, version 1 (i32), points (i32), first frame, frames a sample (f32), samples (i32) | samples, points (i32) |
//! | times | follow from the header | of every sample in seconds (f32) |
//! | points | x, y, z (f32), sample after sample | the same |

use std::fs::{self, File};
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use drapery_core::mesh::MeshStream;

use super::Format;
use crate::atomic_file::unfinished;
use crate::cache::{CacheFrame, CacheMark, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::file_summary::{FileSummary, MeshSummary};
use crate::input_file;

/// PC2.
pub(super) const PC2: Format = Format {
    create: Some(|path, plan| Ok(Box::new(PointCacheWriter::create(path, plan, Kind::Pc2)?))),
    ..points_alone("pc2", "PC2 point cache: points out, for other tools", |path| summary(path, Kind::Pc2))
};

/// MDD.
pub(super) const MDD: Format = Format {
    create: Some(|path, plan| Ok(Box::new(PointCacheWriter::create(path, plan, Kind::Mdd)?))),
    ..points_alone("mdd", "MDD point cache: points out, for other tools", |path| summary(path, Kind::Mdd))
};

const fn points_alone(extension: &'static str, about: &'static str, summary_of: super::Summarise) -> Format {
    Format { whole_frames: true, holds_points_alone: true, ..Format::new(extension, about, summary_of) }
}

/// First bytes of a PC2 file.
const SIGNATURE: &[u8; 12] = b"POINTCACHE2\0";

/// Bytes of a point.
const POINT: usize = size_of::<[f32; 3]>();

/// One of the two formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Pc2,
    Mdd,
}

impl Kind {
    /// A number as the format stores it.
    fn bytes(self, little: [u8; 4]) -> [u8; 4] {
        match self {
            Self::Pc2 => little,
            Self::Mdd => [little[3], little[2], little[1], little[0]],
        }
    }

    fn integer(self, number: i32) -> [u8; 4] {
        self.bytes(number.to_le_bytes())
    }

    fn float(self, number: f32) -> [u8; 4] {
        self.bytes(number.to_le_bytes())
    }

    /// Everything before the points.
    fn header(self, plan: &CachePlan<'_>, [points, frames]: [i32; 2]) -> Vec<u8> {
        let mut header = Vec::new();
        match self {
            Self::Pc2 => {
                header.extend(SIGNATURE);
                header.extend(self.integer(1));
                header.extend(self.integer(points));
                header.extend(self.float(plan.first_frame as f32));
                header.extend(self.float(1.0));
                header.extend(self.integer(frames));
            }
            Self::Mdd => {
                header.extend(self.integer(frames));
                header.extend(self.integer(points));
                let times = (plan.first_frame..=plan.last_frame).map(|frame| plan.timeline.file_time(frame) as f32);
                times.for_each(|time| header.extend(self.float(time)));
            }
        }
        header
    }
}

/// A point cache being written. It gets its name when all frames are there: its header says how many they are.
#[derive(Debug)]
struct PointCacheWriter {
    path: PathBuf,
    kind: Kind,
    file: BufWriter<File>,
    points: usize,
    frames: [i64; 2],
    mark: CacheMark,
}

impl PointCacheWriter {
    fn create(path: &Path, plan: &CachePlan<'_>, kind: Kind) -> Result<Self, IoError> {
        let (points, frames) = (plan.mesh.point_count(), plan.frame_count());
        let fits = |number: usize| i32::try_from(number).ok();
        let Some(counts) = fits(points).zip(fits(frames)) else {
            let what = format!("{frames} frames of {points} points are more than the format can count");
            return Err(IoError::data(path, "size", what, "choose fewer frames with --frames A-B"));
        };
        let part = unfinished(path);
        let failed = |e| IoError::creating(&part, e);
        let mut file = BufWriter::new(File::create(&part).map_err(failed)?);
        file.write_all(&kind.header(plan, counts.into())).map_err(failed)?;
        let frames = [plan.first_frame, plan.last_frame];
        Ok(Self { path: path.to_owned(), kind, file, points, frames, mark: CacheMark::none(path) })
    }
}

impl CacheWriter for PointCacheWriter {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        if frame.sub_frame > 0 {
            return Ok(());
        }
        let expected = self.mark.last_frame.map_or(self.frames[0], |last| last + 1);
        assert_eq!(frame.frame, expected, "frames come in order");
        assert_eq!(frame.positions.len(), self.points, "a garment keeps its number of points");
        let numbers = frame.positions.as_flattened().iter();
        let bytes: Vec<u8> = numbers.flat_map(|number| self.kind.float(*number)).collect();
        self.file.write_all(&bytes).map_err(|e| IoError::writing(&self.path, e))?;
        self.mark.last_frame = Some(frame.frame);
        Ok(())
    }

    fn mark(&self) -> CacheMark {
        self.mark.clone()
    }

    fn sync(&mut self) -> Result<(), IoError> {
        let synced = self.file.flush().and_then(|()| self.file.get_ref().sync_all());
        synced.map_err(|e| IoError::writing(&self.path, e))
    }

    fn finish(&mut self) -> Result<(), IoError> {
        assert_eq!(self.mark.last_frame, Some(self.frames[1]), "all frames are there");
        self.sync()?;
        fs::rename(unfinished(&self.path), &self.path).map_err(|e| IoError::writing(&self.path, e))
    }
}

impl Drop for PointCacheWriter {
    fn drop(&mut self) {
        // What is not whole says of itself that it is; nothing is there after the end.
        let _ = fs::remove_file(unfinished(&self.path));
    }
}

/// Looks into a point cache.
fn summary(path: &Path, kind: Kind) -> Result<FileSummary, IoError> {
    let name = if kind == Kind::Pc2 { "PC2" } else { "MDD" };
    let failed = |source| IoError::Read { path: path.to_owned(), source };
    let wrong = |what: &str| IoError::data(path, "header", what, format!("it is damaged, or not a {name} file"));
    let mut file = input_file::open(path)?;
    let length = file.metadata().map_err(failed)?.len();
    let mut header = [0; 32];
    let size = if kind == Kind::Pc2 { 32 } else { 8 };
    file.read_exact(&mut header[..size]).map_err(|_| wrong("the file is too short for one"))?;
    let word = |at: usize| kind.bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let count = |at: usize| u64::try_from(i32::from_le_bytes(word(at))).map_err(|_| wrong("it has a negative number"));
    let mut properties = Vec::new();
    let (points, samples, before) = match kind {
        Kind::Pc2 if header[..12] != *SIGNATURE => return Err(wrong("it does not begin with POINTCACHE2")),
        Kind::Pc2 => {
            let [first, step] = [20, 24].map(|at| f32::from_le_bytes(word(at)));
            let (points, samples) = (count(16)?, count(28)?);
            let last = first + step * samples.saturating_sub(1) as f32;
            for (name, value) in [("first frame", first), ("last frame", last), ("frames a sample", step)] {
                properties.push((name.to_owned(), value.to_string()));
            }
            (points, samples, 32)
        }
        Kind::Mdd => (count(4)?, count(0)?, 8 + 4 * count(0)?),
    };
    if before + points * samples * POINT as u64 != length {
        return Err(wrong(&format!("{samples} samples of {points} points do not fit its {length} bytes")));
    }
    let mut times = None;
    if kind == Kind::Mdd && samples > 0 {
        let mut stored = vec![0; 4 * samples as usize];
        file.read_exact(&mut stored).map_err(failed)?;
        let all = stored.as_chunks::<4>().0;
        times = Some([all[0], all[all.len() - 1]].map(|bytes| f64::from(f32::from_be_bytes(bytes))));
    }
    let mesh = MeshSummary {
        path: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        points: points as usize,
        topology: "points alone",
        samples: samples as usize,
        times,
        ..MeshSummary::default()
    };
    let format = if kind == Kind::Pc2 { "PC2 point cache" } else { "MDD point cache" };
    Ok(FileSummary { format, properties, meshes: vec![mesh], ..FileSummary::default() })
}

#[cfg(test)]
mod tests {
    use drapery_core::Vec3;
    use drapery_core::mesh::PolygonMesh;
    use drapery_core::scene::Timeline;

    use super::*;
    use crate::attributes::{PointAttributes, PointValues};
    use crate::garment_mesh::GarmentMesh;
    use crate::mesh_data::MeshData;
    use crate::units::Units;

    fn written(folder: &Path, kind: Kind, frames: i64) -> Result<Vec<u8>, IoError> {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let mesh = GarmentMesh::kept(MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]])));
        let plan = CachePlan {
            garment: "sheet",
            mesh: &mesh,
            units: Units::SI,
            origin: Vec3::zeros(),
            timeline: Timeline::default(),
            first_frame: 1001,
            last_frame: 1002,
            velocities: false,
            normals: false,
            crossings: false,
            attributes: PointAttributes::default(),
            sub_frames: &[],
        };
        let path = folder.join("sheet.cache");
        let mut writer = PointCacheWriter::create(&path, &plan, kind)?;
        for frame in 1001..1001 + frames {
            let positions = [[0.0, 1.0, 2.0], [frame as f32, 0.0, 0.0], [0.5; 3]];
            let (crossings, values) = (None, PointValues::default());
            let (velocities, normals): (&[[f32; 3]], &[[f32; 3]]) = (&[], &[]);
            writer.write(&CacheFrame {
                frame,
                sub_frame: 0,
                positions: &positions,
                velocities,
                normals,
                crossings,
                values,
            })?;
        }
        if frames == 2 {
            writer.finish()?;
        }
        drop(writer);
        assert!(!unfinished(&path).exists());
        fs::read(&path).map_err(|e| IoError::writing(&path, e))
    }

    #[test]
    fn headers_and_byte_orders_are_those_of_the_formats() {
        let folder = tempfile::tempdir().unwrap();
        let pc2 = written(folder.path(), Kind::Pc2, 2).unwrap();
        assert_eq!((&pc2[..12], pc2.len()), (&b"POINTCACHE2\0"[..], 32 + 2 * 3 * 12));
        let integer = |at: usize| i32::from_le_bytes(pc2[at..at + 4].try_into().unwrap());
        let float = |at: usize| f32::from_le_bytes(pc2[at..at + 4].try_into().unwrap());
        assert_eq!((integer(12), integer(16), float(20), float(24), integer(28)), (1, 3, 1001.0, 1.0, 2));
        assert_eq!((float(32 + 4), float(32 + 12), float(32 + 36 + 12)), (1.0, 1001.0, 1002.0));
        let seen = summary(&folder.path().join("sheet.cache"), Kind::Pc2).unwrap();
        assert_eq!((seen.meshes[0].points, seen.meshes[0].samples), (3, 2));

        let mdd = written(folder.path(), Kind::Mdd, 2).unwrap();
        let integer = |at: usize| i32::from_be_bytes(mdd[at..at + 4].try_into().unwrap());
        let float = |at: usize| f32::from_be_bytes(mdd[at..at + 4].try_into().unwrap());
        assert_eq!((integer(0), integer(4), mdd.len()), (2, 3, 8 + 2 * 4 + 2 * 3 * 12));
        assert_eq!((float(8), float(12)), ((1001.0 / 24.0) as f32, (1002.0 / 24.0) as f32));
        assert_eq!((float(16 + 4), float(16 + 36 + 12)), (1.0, 1002.0));
        let seen = summary(&folder.path().join("sheet.cache"), Kind::Mdd).unwrap();
        assert_eq!((seen.meshes[0].points, seen.meshes[0].samples), (3, 2));
    }

    #[test]
    fn a_cache_that_is_not_whole_leaves_no_file_and_a_damaged_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        assert!(written(folder.path(), Kind::Pc2, 1).is_err());
        let path = folder.path().join("cut.pc2");
        let mut bytes = written(folder.path(), Kind::Pc2, 2).unwrap();
        bytes.pop();
        fs::write(&path, &bytes).unwrap();
        let said = summary(&path, Kind::Pc2).unwrap_err().to_string();
        assert!(said.contains("cut.pc2") && said.contains("2 samples of 3 points do not fit"), "{said}");
        fs::write(&path, b"\xff\xff\xff\xff\0\0\0\x01").unwrap();
        assert!(summary(&path, Kind::Mdd).unwrap_err().to_string().contains("negative"));
    }
}
