//! A mesh from a file, still or moving, in metres with Y up: what bodies, garments and pin targets are read through.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use drapery_core::Vec3;

use crate::error::IoError;
use crate::formats;
use crate::memory_mesh::{MemoryMesh, MemoryReader};
use crate::mesh_data::{Connectivity, MeshData, MeshReader};
use crate::units::{InputUnits, StatedUnits, Units};

/// Times closer than this share of a sample step are the same: programs round frame / fps differently.
const SAME_SAMPLE: f64 = 1e-3;

/// Frames per second of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameRate {
    /// The file says so.
    Stated(f64),
    /// It says nothing, and has samples at these even steps.
    Sampled(f64),
}

impl FrameRate {
    /// The rate that a file states, otherwise the rate of its samples at these times [s], if there are three or more at even steps.
    pub(crate) fn of(stated: Option<f64>, times: &[f64]) -> Option<Self> {
        if let (Some(rate), [_, _, ..]) = (stated, times) {
            return Some(Self::Stated(rate));
        }
        let [first, _, .., last] = times else { return None };
        let step = (last - first) / (times.len() - 1) as f64;
        let is_even = times.windows(2).all(|pair| (pair[1] - pair[0] - step).abs() <= SAME_SAMPLE * step);
        is_even.then_some(Self::Sampled(1.0 / step))
    }
}

/// An opened mesh file, or the objects chosen in it, converted to metres with Y up.
pub struct MeshSource {
    path: PathBuf,
    units: InputUnits,
    reader: Box<dyn MeshReader>,
    /// The mesh, if it is no file but one in memory.
    memory: Option<Arc<MemoryMesh>>,
}

impl std::fmt::Debug for MeshSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MeshSource").field("path", &self.path).field("objects", &self.reader.objects()).finish()
    }
}

impl MeshSource {
    /// Opens `path`. `pattern` chooses objects by their full path (`/hero/geo/*`); without it all meshes are taken.
    /// Several objects are merged in the order of their paths.
    ///
    /// # Errors
    /// The file is missing, damaged or of an unknown format, or the pattern fits no mesh.
    pub fn open(path: &Path, pattern: Option<&str>, units: impl Into<InputUnits>) -> Result<Self, IoError> {
        let reader = formats::open_mesh(path, pattern)?;
        Ok(Self { path: path.to_owned(), units: units.into(), reader, memory: None })
    }

    /// A mesh in memory, to be read in these units.
    pub fn in_memory(mesh: &Arc<MemoryMesh>, units: impl Into<InputUnits>) -> Self {
        let (reader, memory) = (Box::new(MemoryReader(mesh.clone())), Some(mesh.clone()));
        Self { path: PathBuf::from(mesh.name()), units: units.into(), reader, memory }
    }

    /// Another mesh, in metres with Y up, that follows this one.
    pub(crate) fn followed_by<R: MeshReader + 'static>(
        self,
        reader: impl FnOnce(Self) -> Result<R, String>,
    ) -> Result<Self, String> {
        let path = self.path.clone();
        Ok(Self { path, units: Units::SI.into(), reader: Box::new(reader(self)?), memory: None })
    }

    /// Frames per second that the file says it was made for.
    pub(crate) fn stated_frame_rate(&self) -> Option<f64> {
        self.reader.frame_rate()
    }

    /// [`MeshSource::open`] for a file that may state its units itself; `choose` is given what it states, `None` for formats
    /// without units, and gives the units to read it in.
    ///
    /// # Errors
    /// As [`MeshSource::open`]. `None` if `choose` gives none.
    pub fn open_stating(
        path: &Path,
        pattern: Option<&str>,
        choose: impl FnOnce(Option<StatedUnits>) -> Option<InputUnits>,
    ) -> Result<Option<Self>, IoError> {
        let reader = formats::open_mesh(path, pattern)?;
        let units = choose(reader.stated_units());
        Ok(units.map(|units| Self { path: path.to_owned(), units, reader, memory: None }))
    }

    /// The mesh, if it is no file but one in memory.
    pub fn memory(&self) -> Option<&Arc<MemoryMesh>> {
        self.memory.as_ref()
    }

    /// Other files that belong to it: layers of a stage.
    pub fn other_files(&self) -> Vec<PathBuf> {
        self.reader.other_files()
    }

    /// Returns notes on it that may interest the user, object by object.
    pub fn notes(&self) -> Vec<String> {
        self.reader.notes()
    }

    /// Whether the file itself says which axis is up.
    pub fn states_up_axis(&self) -> bool {
        self.reader.stated_units().is_some_and(|stated| stated.up.is_some())
    }

    /// Whether the file itself says its unit of length.
    pub fn states_length(&self) -> bool {
        self.reader.stated_units().is_some_and(|stated| stated.metres.is_some())
    }

    /// The same mesh, read in these units.
    #[must_use]
    pub fn read_in(self, units: InputUnits) -> Self {
        Self { units, ..self }
    }

    /// Lists the data of the chosen objects that is not handed through, a sentence each.
    pub fn left_out(&self) -> Vec<String> {
        self.reader.left_out()
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Units and up axis of the file.
    pub fn units(&self) -> InputUnits {
        self.units
    }

    /// Paths of the objects that were chosen, in the order in which they are merged.
    pub fn objects(&self) -> Vec<String> {
        self.reader.objects()
    }

    /// Full path of the mesh that they are merged to, which is that of the first; empty when the format has no paths.
    pub fn object_path(&self) -> String {
        self.objects().into_iter().next().filter(|path| path.starts_with('/')).unwrap_or_default()
    }

    /// Times of the samples [s], ascending; empty when the mesh never moves.
    pub fn sample_times(&self) -> &[f64] {
        self.reader.sample_times()
    }

    /// Time of the first sample [s]; 0 when the mesh never moves.
    pub fn first_time(&self) -> f64 {
        self.sample_times().first().copied().unwrap_or(0.0)
    }

    /// Frames per second of the file; `None` when nothing tells, or the mesh never moves.
    pub fn frame_rate(&self) -> Option<FrameRate> {
        FrameRate::of(self.reader.frame_rate(), self.sample_times())
    }

    /// Times of the samples strictly between two times [s]; samples that lie on one of them are left out.
    pub fn times_between(&self, after: f64, before: f64) -> &[f64] {
        let times = self.sample_times();
        let margin = self.tolerance();
        let start = times.partition_point(|&t| t <= after + margin);
        let end = times.partition_point(|&t| t < before - margin);
        &times[start..end.max(start)]
    }

    /// Whether samples reach from one time to another [s]; a mesh that never moves covers everything.
    pub fn covers(&self, first: f64, last: f64) -> bool {
        let margin = self.tolerance();
        match self.sample_times() {
            [] => true,
            times => times[0] <= first + margin && last <= times[times.len() - 1] + margin,
        }
    }

    fn tolerance(&self) -> f64 {
        let times = self.sample_times();
        match times {
            [first, .., last] => SAME_SAMPLE * (last - first) / (times.len() - 1) as f64,
            _ => SAME_SAMPLE,
        }
    }

    /// The mesh at a time [s of the file].
    ///
    /// # Errors
    /// The file is damaged.
    pub fn mesh_at(&self, time: f64) -> Result<MeshData, IoError> {
        let mut data = self.reader.mesh_at(time)?;
        data.params_in.get_or_insert(self.units);
        self.convert(&mut data.mesh.points);
        Ok(data)
    }

    /// Positions at a time [s of the file], in metres; linear between samples, held outside their range.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn positions_at(&self, time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError> {
        self.reader.positions_at(time, positions)?;
        self.convert(positions);
        Ok(())
    }

    /// Gives the positions at a time [s of the file] piece by piece, in metres.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn points_at(&self, time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        let mut converted = Vec::new();
        self.reader.points_at(time, &mut |points| {
            converted.clear();
            converted.extend(points.iter().map(|p| self.units.to_si(*p)));
            take(&converted);
        })
    }

    /// Gives the faces at a time [s of the file] piece by piece: the number of corners of each, and the point of each corner.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn faces_at(&self, time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        self.reader.faces_at(time, take)
    }

    /// Reads what is handed through to caches, one attribute after the other, and keeps nothing.
    ///
    /// # Errors
    /// The file is damaged.
    pub(crate) fn check_attributes_at(&self, time: f64) -> Result<(), IoError> {
        self.reader.check_attributes_at(time)
    }

    /// Returns the connectivity of faces and points at a time [s of the file]; `None` when it never changes.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn connectivity_at(&self, time: f64) -> Result<Option<Connectivity>, IoError> {
        self.reader.connectivity_at(time)
    }

    fn convert(&self, positions: &mut [Vec3]) {
        for p in positions {
            *p = self.units.to_si(*p);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{LengthUnit, UpAxis};

    #[test]
    fn an_obj_in_centimetres_with_z_up_arrives_in_metres_with_y_up() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tri.obj");
        std::fs::write(&path, "v 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 2 3\n").unwrap();
        let units = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };
        let source = MeshSource::open(&path, None, units).unwrap();
        let points = source.mesh_at(0.0).unwrap().mesh.points;
        assert_eq!(points, [Vec3::x(), -Vec3::z(), Vec3::y()]);
        assert!(source.covers(-1e9, 1e9) && source.times_between(0.0, 1.0).is_empty());
    }

    #[test]
    fn a_missing_file_and_an_unknown_format_say_so() {
        let missing = MeshSource::open(Path::new("no_such.obj"), None, Units::SI).unwrap_err();
        assert!(matches!(missing, IoError::Missing { .. }));
        let unknown = MeshSource::open(Path::new("body.fbx"), None, Units::SI).unwrap_err();
        assert!(unknown.to_string().contains("body.fbx"), "{unknown}");
        assert!(unknown.to_string().contains(".abc"), "{unknown}");
    }
}
