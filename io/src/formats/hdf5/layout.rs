//! The datasets and attributes of an HDF5 cache: made for a plan, and compared with one.

use std::path::Path;

use drapery_core::mesh::MeshStream;
use hdf5::plist::dataset_create::{AllocTime, FillTime};
use hdf5::types::VarLenUnicode;
use hdf5::{Dataset, H5Type};

use super::datasets::{ORIGIN, dataset, origin, place_of};
use super::{NORMAL_INDICES, fixed_digest};
use crate::attributes::{CONTACT, REST, STRAIN, THICKNESS};
use crate::cache::{APPLICATION, CachePlan};
use crate::garment_mesh::triangles_to_store;
use crate::hdf5_file;
use crate::mesh_data::MeshData;

/// Version of the layout, stored as the attribute `format_version`.
const FORMAT_VERSION: i64 = 1;

/// The same where positions are counted from an origin: who does not know of that shows them in the wrong place.
const VERSION_WITH_ORIGIN: i64 = 2;

/// Attribute that names the writing program: another version of it may continue a cache.
const APPLICATION_ATTRIBUTE: &str = "application";

/// Offsets of the datasets that grow [bytes].
#[derive(Debug, Clone, Copy)]
pub(super) struct Offsets {
    pub(super) positions: u64,
    pub(super) velocities: Option<u64>,
    pub(super) normals: Option<u64>,
    /// Number of normals of a frame.
    pub(super) normal_count: usize,
    pub(super) strain: Option<u64>,
    pub(super) contact: Option<u64>,
    pub(super) crossings: Option<u64>,
    pub(super) committed: u64,
}

/// Room in a stored file.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) offsets: Offsets,
    pub(super) frames: usize,
}

/// A dataset that is written when the file is made.
struct Fixed<'a> {
    name: &'static str,
    shape: Vec<usize>,
    values: Values<'a>,
}

enum Values<'a> {
    F32(&'a [f32]),
    F64(Vec<f64>),
    /// Stored as signed numbers: checked meshes have fewer than 2³¹ corners.
    U32(&'a [u32]),
    I64(Vec<i64>),
}

/// Creates the file, fills in what does not change, and closes it. `data` is the mesh of the plan.
pub(super) fn create_file(path: &Path, plan: &CachePlan<'_>, data: &MeshData) -> hdf5::Result<Offsets> {
    let file = hdf5_file::create(path, 0)?;
    for (name, text) in texts(plan) {
        file.new_attr::<VarLenUnicode>().create(name)?.write_scalar(&unicode(&text)?)?;
    }
    for (name, value) in numbers(plan) {
        file.new_attr::<f64>().create(name)?.write_scalar(&value)?;
    }
    for (name, value) in integers(plan) {
        file.new_attr::<i64>().create(name)?.write_scalar(&value)?;
    }
    if let Some(origin) = plan.file_origin() {
        file.new_attr::<f64>().shape([origin.len()]).create(ORIGIN)?.write_raw(&origin)?;
    }
    for fixed in fixed_datasets(plan, data, &triangles_to_store(data)) {
        match fixed.values {
            Values::F32(values) => fixed.create(&file, values)?,
            Values::F64(ref values) => fixed.create(&file, values)?,
            Values::U32(values) => fixed.create(&file, &as_i32(values))?,
            Values::I64(ref values) => fixed.create(&file, values)?,
        }
    }
    fixed_digest::write(&file)?;
    let (frames, points) = (plan.frame_count(), plan.mesh.point_count());
    let committed = growing::<u8>(&file, "committed", &[frames])?;
    let crossings = plan.crossings.then(|| growing::<u32>(&file, "crossings", &[frames])).transpose()?;
    let velocities = plan.velocities.then(|| growing::<f32>(&file, "velocities", &[frames, points, 3])).transpose()?;
    let normal_count = normal_count(plan, data);
    let normals = plan.normals.then(|| growing::<f32>(&file, "normals", &[frames, normal_count, 3])).transpose()?;
    let numbers = |name, is_there: bool| is_there.then(|| growing::<f32>(&file, name, &[frames, points])).transpose();
    let strain = numbers(STRAIN, plan.attributes.strain)?;
    let contact = numbers(CONTACT, plan.attributes.contact)?;
    let positions = growing::<f32>(&file, "positions", &[frames, points, 3])?;
    // What goes wrong while a file is dropped is not heard of.
    file.flush()?;
    file.close()?;
    Ok(Offsets { positions, velocities, normals, normal_count, strain, contact, crossings, committed })
}

/// The layout of a stored file that was made with this plan, or with this plan and another last frame.
///
/// # Errors
/// Fault of the file: it cannot be read, or was made with another plan.
pub(super) fn read_layout(path: &Path, plan: &CachePlan<'_>, data: &MeshData) -> Result<Layout, String> {
    compared(path, plan, data).map_err(|source| format!("the file is damaged: {source}"))?
}

/// The outer error is the library's, the inner one says what differs from the plan.
fn compared(path: &Path, plan: &CachePlan<'_>, data: &MeshData) -> hdf5::Result<Result<Layout, String>> {
    let file = hdf5_file::open(path)?;
    let (_, [frames]) = dataset::<1>(&file, "frame_numbers")?;
    // Each frame has at least its mark.
    if frames == 0 || frames as u64 > file.size() {
        return Ok(Err(format!("it has {frames} frames")));
    }
    let stored = CachePlan { last_frame: plan.first_frame.saturating_add(frames as i64 - 1), ..plan.clone() };
    if let Some(name) = differing_attribute(&file, &stored)? {
        return Ok(Err(format!("the cache was started with different settings: `{name}` differs")));
    }
    if file.link_exists("uv_values") && data.uvs.is_none() {
        return Ok(Err("the cache was started with different settings: it has UVs".into()));
    }
    let ours = [
        (REST, plan.attributes.rest.is_some()),
        (THICKNESS, plan.attributes.thickness.is_some()),
        (NORMAL_INDICES, plan.normals && data.split_normals.is_some()),
    ];
    if let Some((name, _)) = ours.iter().find(|(name, is_there)| !is_there && file.link_exists(name)) {
        return Ok(Err(format!("the cache was started with different settings: it has `{name}`")));
    }
    for fixed in fixed_datasets(&stored, data, &triangles_to_store(data)) {
        if !fixed.is_in(&file)? {
            return Ok(Err(format!("the cache was started with different settings: `{}` differs", fixed.name)));
        }
    }
    let (points, normal_count) = (plan.mesh.point_count(), normal_count(plan, data));
    let places = [
        place::<f32>(&file, "positions", &[frames, points, 3])?,
        place::<f32>(&file, "velocities", &[frames, points, 3])?,
        place::<f32>(&file, "normals", &[frames, normal_count, 3])?,
        place::<f32>(&file, STRAIN, &[frames, points])?,
        place::<f32>(&file, CONTACT, &[frames, points])?,
        place::<u32>(&file, "crossings", &[frames])?,
        place::<u8>(&file, "committed", &[frames])?,
    ];
    match places {
        [Some(positions), velocities, normals, strain, contact, crossings, Some(committed)]
            if [velocities, normals, strain, contact, crossings].map(|offset| offset.is_some())
                == [plan.velocities, plan.normals, plan.attributes.strain, plan.attributes.contact, plan.crossings] =>
        {
            let offsets =
                Offsets { positions, velocities, normals, normal_count, strain, contact, crossings, committed };
            Ok(Ok(Layout { offsets, frames }))
        }
        _ => Ok(Err("the cache was started with different settings: its datasets differ".into())),
    }
}

/// Number of normals of a frame: of the points, or those that hard edges split.
fn normal_count(plan: &CachePlan<'_>, data: &MeshData) -> usize {
    data.split_normals.as_ref().map_or(plan.mesh.point_count(), |split| split.count)
}

/// Offset of a dataset of this type and shape, if the file has it.
fn place<T: H5Type>(file: &hdf5::File, name: &str, shape: &[usize]) -> hdf5::Result<Option<u64>> {
    if !file.link_exists(name) {
        return Ok(None);
    }
    let dataset = file.dataset(name)?;
    if dataset.shape() != shape || !dataset.dtype()?.is::<T>() {
        return Ok(None);
    }
    place_of(&dataset, file.size())
}

/// The first attribute that is not as this plan makes it.
fn differing_attribute(file: &hdf5::File, plan: &CachePlan<'_>) -> hdf5::Result<Option<&'static str>> {
    if origin(file)? != plan.file_origin() {
        return Ok(Some(ORIGIN));
    }
    for (name, text) in texts(plan).into_iter().filter(|(name, _)| *name != APPLICATION_ATTRIBUTE) {
        if file.attr(name)?.read_scalar::<VarLenUnicode>()? != unicode(&text)? {
            return Ok(Some(name));
        }
    }
    for (name, value) in numbers(plan) {
        if file.attr(name)?.read_scalar::<f64>()? != value {
            return Ok(Some(name));
        }
    }
    for (name, value) in integers(plan) {
        if file.attr(name)?.read_scalar::<i64>()? != value {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

fn texts(plan: &CachePlan<'_>) -> [(&'static str, String); 6] {
    [
        (APPLICATION_ATTRIBUTE, APPLICATION.to_owned()),
        ("garment", plan.garment.to_owned()),
        ("object_path", plan.object_path()),
        ("length_unit", plan.units.length.word().to_owned()),
        ("up_axis", format!("{:?}", plan.units.up)),
        ("winding", "counter-clockwise".to_owned()),
    ]
}

fn unicode(text: &str) -> hdf5::Result<VarLenUnicode> {
    text.replace('\0', " ").parse().map_err(|e| hdf5::Error::from(format!("{e}")))
}

fn numbers(plan: &CachePlan<'_>) -> [(&'static str, f64); 2] {
    [("fps", plan.timeline.fps()), ("metres_per_unit", plan.units.length.metres())]
}

fn integers(plan: &CachePlan<'_>) -> [(&'static str, i64); 3] {
    [
        ("format_version", if plan.file_origin().is_some() { VERSION_WITH_ORIGIN } else { FORMAT_VERSION }),
        ("fps_numerator", i64::from(plan.timeline.fps_numerator)),
        ("fps_denominator", i64::from(plan.timeline.fps_denominator)),
    ]
}

fn fixed_datasets<'a>(plan: &'a CachePlan<'_>, data: &'a MeshData, cut: &'a Option<Vec<[u32; 3]>>) -> Vec<Fixed<'a>> {
    let numbers: Vec<i64> = (plan.first_frame..=plan.last_frame).collect();
    let times: Vec<f64> = numbers.iter().map(|&frame| plan.timeline.file_time(frame)).collect();
    let (mesh, frames) = (&data.mesh, numbers.len());
    let triangles = cut.as_ref().map_or(mesh.face_indices.as_slice(), |triangles| triangles.as_flattened());
    let fixed = |name, shape: &[usize], values| Fixed { name, shape: shape.to_vec(), values };
    let integers = |name, values: &'a [u32]| fixed(name, &[values.len()], Values::U32(values));
    let mut all = vec![
        fixed("times", &[frames], Values::F64(times)),
        fixed("frame_numbers", &[frames], Values::I64(numbers)),
        integers("face_counts", &mesh.face_counts),
        integers("face_indices", &mesh.face_indices),
        fixed("triangles", &[triangles.len() / 3, 3], Values::U32(triangles)),
    ];
    if let Some(uvs) = &data.uvs {
        all.push(fixed("uv_values", &[uvs.values.len(), 2], Values::F32(uvs.values.as_flattened())));
        all.push(integers("uv_indices", &uvs.indices));
    }
    if let Some(split) = data.split_normals.as_ref().filter(|_| plan.normals) {
        all.push(integers(NORMAL_INDICES, &split.indices));
    }
    if let Some(rest) = &plan.attributes.rest {
        all.push(fixed(REST, &[rest.len(), 3], Values::F32(rest.as_flattened())));
    }
    if let Some(thickness) = &plan.attributes.thickness {
        all.push(fixed(THICKNESS, &[thickness.len()], Values::F32(thickness)));
    }
    all
}

fn as_i32(values: &[u32]) -> Vec<i32> {
    values.iter().map(|&v| v as i32).collect()
}

impl Fixed<'_> {
    fn create<T: H5Type>(&self, file: &hdf5::File, values: &[T]) -> hdf5::Result<()> {
        let dataset = file.new_dataset::<T>().obj_track_times(false).shape(self.shape.clone()).create(self.name)?;
        dataset.write_raw(values)
    }

    /// Whether the file has this dataset with these values.
    fn is_in(&self, file: &hdf5::File) -> hdf5::Result<bool> {
        if !file.link_exists(self.name) {
            return Ok(false);
        }
        let dataset = file.dataset(self.name)?;
        if dataset.shape() != self.shape {
            return Ok(false);
        }
        // By their bits: an input may have coordinates that are no numbers, which are handed through.
        match &self.values {
            Values::F32(values) => {
                Ok(dataset.read_raw::<f32>()?.into_iter().map(f32::to_bits).eq(values.iter().map(|v| v.to_bits())))
            }
            Values::F64(values) => {
                Ok(dataset.read_raw::<f64>()?.into_iter().map(f64::to_bits).eq(values.iter().map(|v| v.to_bits())))
            }
            Values::U32(values) => Ok(dataset.read_raw::<i32>()?.into_iter().eq(values.iter().map(|&v| v as i32))),
            Values::I64(values) => Ok(dataset.read_raw::<i64>()? == *values),
        }
    }
}

/// Offset of a new dataset whose space is reserved in the file.
fn growing<T: H5Type>(file: &hdf5::File, name: &str, shape: &[usize]) -> hdf5::Result<u64> {
    reserved::<T>(file, name, shape)?
        .offset()
        .ok_or_else(|| hdf5::Error::from(format!("dataset {name} has no fixed place in the file")))
}

/// A new dataset whose space is reserved in the file but not written; what nobody writes reads as zeros.
pub(crate) fn reserved<T: H5Type>(group: &hdf5::Group, name: &str, shape: &[usize]) -> hdf5::Result<Dataset> {
    group
        .new_dataset::<T>()
        .no_chunk()
        .alloc_time(Some(AllocTime::Early))
        .fill_time(FillTime::Never)
        .obj_track_times(false)
        .shape(shape.to_vec())
        .create(name)
}
