//! The cloth after a line of a time step as HDF5 (`docs/reference/dump.md`).

use std::path::Path;

use drapery_core::observe::Observation;
use hdf5::H5Type;
use hdf5::types::VarLenUnicode;

use crate::atomic_file::{put, unfinished};
use crate::cache::APPLICATION;
use crate::error::IoError;
use crate::formats::hdf5::reserved;
use crate::hdf5_file;

/// The names that the files of a shot repeat.
#[derive(Debug, Clone)]
pub struct Names {
    /// Name of the shot.
    pub shot: String,
    /// Names of its garments, in their order.
    pub garments: Vec<String>,
}

/// Writes an observation beside its path and renames it into place.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, names: &Names, observation: &Observation) -> Result<(), IoError> {
    let part = unfinished(path);
    let refused = |e: hdf5::Error| IoError::writing(path, hdf5_file::refused(e));
    lay_out(&part, names, observation).map_err(refused)?;
    put(&part, path)
}

fn lay_out(path: &Path, names: &Names, observation: &Observation) -> hdf5::Result<()> {
    // Times of change are left out so that equal states give equal bytes.
    let file = hdf5::File::with_options()
        .with_fapl(|access| access.libver_v110())
        .with_fcpl(|create| create.obj_track_times(false))
        .create(path)?;
    let Observation { line, frame, step, time, dt, garments } = observation;
    for (name, text) in [("application", APPLICATION), ("shot", &names.shot), ("line", line)] {
        attribute(&file, name, &unicode(text)?)?;
    }
    attribute(&file, "frame", frame)?;
    attribute(&file, "step", step)?;
    attribute(&file, "time", time)?;
    attribute(&file, "dt", dt)?;
    for (name, quantities) in names.garments.iter().zip(garments) {
        let group = file.create_group_builder().obj_track_times(false).create(name.as_str())?;
        for (quantity, values) in quantities {
            let rows: Vec<[f64; 3]> = values.iter().map(|value| (*value).into()).collect();
            let dataset = reserved::<f64>(&group, quantity, &[rows.len(), 3])?;
            dataset.write_raw(rows.as_flattened())?;
            let unit = if quantity.starts_with('x') { "m" } else { "m/s" };
            dataset.new_attr::<VarLenUnicode>().create("unit")?.write_scalar(&unicode(unit)?)?;
        }
    }
    file.close()
}

fn attribute<T: H5Type>(group: &hdf5::Group, name: &str, value: &T) -> hdf5::Result<()> {
    group.new_attr::<T>().create(name)?.write_scalar(value)
}

fn unicode(text: &str) -> hdf5::Result<VarLenUnicode> {
    text.replace('\0', " ").parse().map_err(|e| hdf5::Error::from(format!("{e}")))
}
