//! HDF5 caches read back.

use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use hdf5::types::VarLenUnicode;

use super::datasets::{dataset, origin, values};
use super::{NORMAL_INDICES, fixed_digest, not_a_cache};
use crate::attributes::{CONTACT, PointAttributes, REST, STRAIN, StoredValues, THICKNESS};
use crate::cache_frames::{CacheFrames, CacheMesh, CacheSamples, Shifted, StoredFrame, placed, units};
use crate::error::IoError;
use crate::formats::Opening;
use crate::hdf5_file;
use crate::input_file;
use crate::mesh_data::{Connectivity, MeshData, Uvs};
use crate::normals::SplitNormals;

/// An opened file.
struct Samples {
    path: PathBuf,
    file: hdf5::File,
    /// Origin that its positions are counted from.
    origin: [f64; 3],
    attributes: PointAttributes,
}

/// Opens a cache.
///
/// # Errors
/// The file cannot be opened or has another layout.
pub(super) fn open(path: &Path, _: Opening) -> Result<CacheFrames, IoError> {
    input_file::check_for_hdf5(path)?;
    opened(path).map_err(|source| not_a_cache(path, &source))
}

fn opened(path: &Path) -> hdf5::Result<CacheFrames> {
    let file = hdf5_file::open(path)?;
    let text =
        |name: &str| -> hdf5::Result<String> { Ok(file.attr(name)?.read_scalar::<VarLenUnicode>()?.to_string()) };
    let committed = values::<u8>(&file, "committed")?;
    let numbers = values::<i64>(&file, "frame_numbers")?;
    let triangles = dataset::<2>(&file, "triangles")?.0.read_raw::<u32>()?;
    let (_, [_, points, _]) = dataset::<3>(&file, "positions")?;
    let attributes = attributes(&file, points)?;
    let faces =
        Connectivity { face_counts: values(&file, "face_counts")?, face_indices: values(&file, "face_indices")? };
    let mesh = CacheMesh {
        attributes: attributes.clone(),
        split_normals: split_normals(&file, &faces)?,
        name: text("object_path")?,
        points,
        faces,
        triangles: triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        // Frames are committed in ascending order, so the first mark that is missing ends the file.
        frames: numbers.iter().zip(&committed).take_while(|(_, mark)| **mark == 1).map(|(n, _)| *n).collect(),
        ..CacheMesh::default()
    };
    let units = units(&text("length_unit")?, &text("up_axis")?);
    let fps = file.attr("fps").and_then(|fps| fps.read_scalar()).ok();
    let samples = Samples { path: path.to_owned(), origin: origin(&file)?.unwrap_or_default(), attributes, file };
    Ok(CacheFrames::new(path, (units.into(), fps), vec![mesh], samples))
}

/// Attributes at the points, beside normals.
fn attributes(file: &hdf5::File, points: usize) -> hdf5::Result<PointAttributes> {
    let wrong = |name: &str, held: usize| format!("dataset {name} has {held} values for {points} points").into();
    let rest = || -> hdf5::Result<Vec<[f32; 3]>> {
        let all = dataset::<2>(file, REST)?.0.read_raw::<f32>()?;
        if all.len() == 3 * points { Ok(all.as_chunks().0.to_vec()) } else { Err(wrong(REST, all.len() / 3)) }
    };
    let thickness = || {
        let all = values::<f32>(file, THICKNESS)?;
        if all.len() == points { Ok(all) } else { Err(wrong(THICKNESS, all.len())) }
    };
    let held: Vec<&str> =
        [REST, THICKNESS, STRAIN, CONTACT].into_iter().filter(|name| file.link_exists(name)).collect();
    PointAttributes::of_listed(&held.join(" "), rest, thickness)
}

/// Normals that hard edges split, if there are any.
fn split_normals(file: &hdf5::File, faces: &Connectivity) -> hdf5::Result<Option<SplitNormals>> {
    if !file.link_exists(NORMAL_INDICES) {
        return Ok(None);
    }
    let (indices, (_, [_, count, _])) = (values::<u32>(file, NORMAL_INDICES)?, dataset::<3>(file, "normals")?);
    let split = SplitNormals::numbered(indices, count, &faces.face_indices);
    split.map(Some).ok_or_else(|| format!("dataset {NORMAL_INDICES} does not fit the faces and normals").into())
}

impl Samples {
    /// The numbers of a sample as they are stored, one for each point.
    fn numbers(&self, name: &str, sample: usize) -> Result<Vec<f32>, IoError> {
        let read = || match dataset::<2>(&self.file, name)? {
            (dataset, [samples, _]) if sample < samples => dataset.read_slice_1d::<f32, _>((sample, ..)),
            (_, extents) => Err(format!("dataset {name} has the extents {extents:?}").into()),
        };
        Ok(read().map_err(|source| not_a_cache(&self.path, &source))?.to_vec())
    }

    /// The vectors of a sample as they are stored.
    fn rows(&self, name: &str, sample: usize) -> Result<Vec<[f32; 3]>, IoError> {
        let read = || match dataset::<3>(&self.file, name)? {
            (dataset, [samples, _, 3]) if sample < samples => dataset.read_slice_2d::<f32, _>((sample, .., ..)),
            (_, extents) => Err(format!("dataset {name} has the extents {extents:?}").into()),
        };
        let values = read().map_err(|source| not_a_cache(&self.path, &source))?;
        Ok((0..values.shape()[0]).map(|row| [0, 1, 2].map(|axis| values[[row, axis]])).collect())
    }

    /// The same, if the file has them.
    fn rows_if_any(&self, name: &str, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        self.file.link_exists(name).then(|| self.rows(name, sample)).transpose()
    }

    /// The number of a sample as it is stored, if the file has it.
    fn number_if_any(&self, name: &str, sample: usize) -> Result<Option<u32>, IoError> {
        let read = || match dataset::<1>(&self.file, name)? {
            (dataset, [samples]) if sample < samples => Ok(dataset.read_slice_1d::<u32, _>(sample..=sample)?[0]),
            (_, extents) => Err(format!("dataset {name} has the extents {extents:?}").into()),
        };
        self.file.link_exists(name).then(read).transpose().map_err(|source| not_a_cache(&self.path, &source))
    }

    fn uvs(&self) -> hdf5::Result<Uvs> {
        let values_of = dataset::<2>(&self.file, "uv_values")?.0.read_raw::<f32>()?;
        let indices = values(&self.file, "uv_indices")?;
        Ok(Uvs { name: String::new(), values: values_of.as_chunks().0.to_vec(), indices })
    }
}

impl CacheSamples for Samples {
    fn world(&self, _: usize, sample: usize) -> Result<Vec<Vec3>, IoError> {
        Ok(placed((self.origin, self.rows("positions", sample)?)))
    }

    fn shifted(&self, _: usize, sample: usize) -> Result<Option<Shifted>, IoError> {
        Ok(Some((self.origin, self.rows("positions", sample)?)))
    }

    fn velocities(&self, _: usize, sample: usize) -> Result<Option<Vec<[f32; 3]>>, IoError> {
        self.rows_if_any("velocities", sample)
    }

    fn frame(&self, _: usize, sample: usize) -> Result<StoredFrame, IoError> {
        Ok(StoredFrame {
            velocities: self.rows_if_any("velocities", sample)?,
            normals: self.rows_if_any("normals", sample)?,
            crossings: self.number_if_any("crossings", sample)?,
            values: StoredValues::read(&self.attributes, |name| self.numbers(name, sample))?,
            positions: self.rows("positions", sample)?,
            has_bounds_of_points: true,
        })
    }

    fn check_constants(&self) -> Result<(), IoError> {
        match fixed_digest::is_as_made(&self.file).map_err(|source| not_a_cache(&self.path, &source))? {
            true => Ok(()),
            false => {
                let what = "faces, texture coordinates or attributes that do not move are not what was written";
                Err(IoError::data(&self.path, "HDF5", what, "copy it again, or run the shot again"))
            }
        }
    }

    fn attributes(&self, _: usize, about: &CacheMesh) -> Result<MeshData, IoError> {
        let Connectivity { face_counts, face_indices } = about.faces.clone();
        let polygons = PolygonMesh { points: Vec::new(), face_counts, face_indices };
        let (object_path, split_normals) = (about.name.clone(), about.split_normals.clone());
        let plain = MeshData { object_path, split_normals, ..MeshData::new(polygons) };
        if !self.file.link_exists("uv_values") {
            return Ok(plain);
        }
        let uvs = self.uvs().map_err(|source| not_a_cache(&self.path, &source))?;
        let fits = uvs.indices.len() == plain.mesh.face_indices.len()
            && uvs.indices.iter().all(|index| (*index as usize) < uvs.values.len());
        if !fits {
            let what = "the texture coordinates do not fit the faces";
            return Err(IoError::data(&self.path, "uv_indices", what, "it is damaged; copy it again"));
        }
        Ok(MeshData { uvs: Some(uvs), ..plain })
    }
}
