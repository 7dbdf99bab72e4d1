//! States of the cloth at the compared frames, on the disk while a study may go on: the mesh, then positions and velocities
//! as doubles, frame after frame.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_io::error::IoError;
use drapery_io::input_file;

use crate::study::cloth::{Cloth, FrameState};

/// Fault of a file that cannot be understood.
const DAMAGED: &str = "it is damaged";

/// States being written. The file has its name only once it is whole.
#[derive(Debug)]
pub(super) struct StatesWriter {
    path: PathBuf,
    partial: PathBuf,
    file: BufWriter<File>,
}

impl StatesWriter {
    /// Begins a file about this cloth.
    ///
    /// # Errors
    /// It cannot be created.
    pub(super) fn create(path: &Path, cloth: &Cloth) -> Result<Self, IoError> {
        let partial = path.with_extension("partial");
        let file = File::create(&partial).map_err(|error| IoError::creating(&partial, error))?;
        let mut writer = Self { path: path.to_owned(), partial, file: BufWriter::new(file) };
        let counts = [cloth.rest.len(), cloth.triangles.len(), cloth.garments.len()];
        let counts = counts.into_iter().chain(cloth.garments.iter().flatten().copied()).map(|count| count as u64);
        let mut bytes: Vec<u8> = counts.flat_map(u64::to_le_bytes).collect();
        bytes.extend(cloth.triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
        let numbers = cloth.rest.iter().flat_map(|v| [v.x, v.y, v.z]).chain(cloth.areas.iter().copied());
        bytes.extend(numbers.flat_map(f64::to_le_bytes));
        writer.put(&bytes)?;
        Ok(writer)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), IoError> {
        self.file.write_all(bytes).map_err(|error| IoError::writing(&self.partial, error))
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// The disk refuses.
    pub(super) fn frame(&mut self, state: &FrameState) -> Result<(), IoError> {
        let numbers = state.positions.iter().chain(&state.velocities).flat_map(|v| [v.x, v.y, v.z]);
        let bytes: Vec<u8> = numbers.flat_map(f64::to_le_bytes).collect();
        self.put(&bytes)
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// The disk refuses.
    pub(super) fn finish(self) -> Result<(), IoError> {
        let Self { path, partial, file } = self;
        let written = file.into_inner().map_err(std::io::IntoInnerError::into_error).map(drop);
        written.and_then(|()| std::fs::rename(&partial, &path)).map_err(|error| IoError::writing(&path, error))
    }
}

/// Reads the mesh, and the states frame after frame.
#[derive(Debug)]
pub(super) struct StatesReader {
    path: PathBuf,
    file: BufReader<File>,
    cloth: Cloth,
}

impl StatesReader {
    /// Opens a file and reads the mesh.
    ///
    /// # Errors
    /// It cannot be read, or is no such file.
    pub(super) fn open(path: &Path) -> Result<Self, IoError> {
        let file = input_file::open(path)?;
        let length = file.metadata().map_err(|error| IoError::reading(path, error))?.len();
        let cloth = Cloth::default();
        let mut reader = Self { path: path.to_owned(), file: BufReader::new(file), cloth };
        let counts = reader.counts(3)?;
        // Before room is made for them: a damaged file may claim anything.
        if counts.iter().any(|count| *count as u64 > length) {
            let advice = "delete it; the study then repeats that run";
            return Err(IoError::data(path, "states of a study", DAMAGED, advice));
        }
        let (vertices, triangles) = (counts[0], counts[1]);
        let garments = reader.counts(2 * counts[2])?.chunks_exact(2).map(|ends| [ends[0], ends[1]]).collect();
        let corners = reader.take(triangles * 3 * size_of::<u32>())?;
        let corners: Vec<u32> = corners.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect();
        let (rest, areas) = (reader.vectors(vertices)?, reader.numbers(vertices)?);
        let triangles = corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
        reader.cloth = Cloth::with(rest, triangles, garments, areas);
        Ok(reader)
    }

    /// The mesh: rest shape, triangles, garments and areas.
    pub(super) fn into_cloth(self) -> Cloth {
        self.cloth
    }

    /// The state of the next frame.
    ///
    /// # Errors
    /// There is none, or the disk refuses.
    pub(super) fn frame(&mut self) -> Result<FrameState, IoError> {
        let vertices = self.cloth.rest.len();
        Ok(FrameState { positions: self.vectors(vertices)?, velocities: self.vectors(vertices)? })
    }

    fn take(&mut self, count: usize) -> Result<Vec<u8>, IoError> {
        let mut bytes = vec![0; count];
        self.file.read_exact(&mut bytes).map_err(|error| IoError::reading(&self.path, error))?;
        Ok(bytes)
    }

    fn counts(&mut self, count: usize) -> Result<Vec<usize>, IoError> {
        let bytes = self.take(count * size_of::<u64>())?;
        // Chunks of eight bytes fit the array.
        let number = |chunk: &[u8]| u64::from_le_bytes(chunk.try_into().unwrap_or_default()) as usize;
        Ok(bytes.chunks_exact(size_of::<u64>()).map(number).collect())
    }

    fn numbers(&mut self, count: usize) -> Result<Vec<f64>, IoError> {
        let bytes = self.take(count * size_of::<f64>())?;
        let number = |chunk: &[u8]| f64::from_le_bytes(chunk.try_into().unwrap_or_default());
        Ok(bytes.chunks_exact(size_of::<f64>()).map(number).collect())
    }

    fn vectors(&mut self, count: usize) -> Result<Vec<Vec3>, IoError> {
        let numbers = self.numbers(3 * count)?;
        Ok(numbers.chunks_exact(3).map(|v| Vec3::new(v[0], v[1], v[2])).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_come_back_bit_by_bit_and_have_their_name_only_when_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.states");
        let state = |shift: f64| FrameState {
            positions: vec![Vec3::new(0.1 + shift, 2.0, -0.0), Vec3::new(1e-300, 4.0, 5.0)],
            velocities: vec![Vec3::new(1.0 / 3.0, 0.0, 0.0), Vec3::new(7.0, 8.0, 9.0)],
        };
        let cloth = Cloth::with(vec![Vec3::x(), Vec3::y()], vec![[0, 1, 0]], vec![[0, 0], [1, 2]], vec![0.25, 0.5]);
        let mut writer = StatesWriter::create(&path, &cloth).unwrap();
        writer.frame(&state(0.0)).unwrap();
        writer.frame(&state(1.0)).unwrap();
        assert!(!path.exists());
        writer.finish().unwrap();
        let mut reader = StatesReader::open(&path).unwrap();
        assert_eq!([reader.frame().unwrap(), reader.frame().unwrap()], [state(0.0), state(1.0)]);
        assert!(reader.frame().is_err());
        assert_eq!(reader.into_cloth(), cloth);
    }
}
