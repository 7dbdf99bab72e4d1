//! Summary of an HDF5 cache.

use std::path::Path;

use hdf5::types::VarLenUnicode;

use super::{NORMAL_INDICES, datasets, not_a_cache};
use crate::attributes::{CONTACT, REST, STRAIN, THICKNESS};
use crate::error::IoError;
use crate::file_summary::{FileSummary, MeshSummary, Normals, face_kinds};
use crate::hdf5_file;
use crate::input_file;

/// Looks into a cache of this layout.
///
/// # Errors
/// The file cannot be opened or has another layout.
pub(super) fn summary(path: &Path) -> Result<FileSummary, IoError> {
    input_file::check_for_hdf5(path)?;
    read_summary(path).map_err(|source| not_a_cache(path, &source))
}

fn read_summary(path: &Path) -> hdf5::Result<FileSummary> {
    let file = hdf5_file::open(path)?;
    let text = |name: &str| Ok::<_, hdf5::Error>(file.attr(name)?.read_scalar::<VarLenUnicode>()?.to_string());
    let committed = datasets::values::<u8>(&file, "committed")?;
    let frames = datasets::values::<i64>(&file, "frame_numbers")?;
    let times = datasets::values::<f64>(&file, "times")?;
    let counts = datasets::values::<u32>(&file, "face_counts")?;
    let mut properties = Vec::new();
    for name in ["application", "garment", "length_unit", "up_axis"] {
        properties.push((name.to_owned(), text(name)?));
    }
    properties.push(("fps".into(), file.attr("fps")?.read_scalar::<f64>()?.to_string()));
    if let Some([x, y, z]) = datasets::origin(&file)? {
        properties.push((datasets::ORIGIN.to_owned(), format!("[{x}, {y}, {z}]")));
    }
    if let Some((first, last)) = frames.first().zip(frames.last()) {
        properties.push(("planned frames".into(), format!("{first}-{last}")));
    }
    let done = committed.iter().filter(|mark| **mark == 1).count();
    properties.push(("committed frames".into(), done.to_string()));
    let mesh = MeshSummary {
        path: text("object_path")?,
        points: datasets::dataset::<3>(&file, "positions")?.1[1],
        faces: face_kinds(&counts),
        topology: "constant faces, moving points",
        samples: done,
        times: times.first().copied().zip(times.get(done.max(1) - 1).copied()).map(<[f64; 2]>::from),
        uvs: datasets::dataset::<2>(&file, "uv_values").ok().map(|(_, [count, _])| ("uv".to_owned(), count)),
        attributes: [REST, STRAIN, CONTACT, THICKNESS]
            .into_iter()
            .filter(|name| file.link_exists(name))
            .map(str::to_owned)
            .collect(),
        normals: Normals::of(file.link_exists("normals"), file.link_exists(NORMAL_INDICES)),
        velocities: file.link_exists("velocities"),
        ..MeshSummary::default()
    };
    Ok(FileSummary { format: "HDF5 (Drapery)", properties, meshes: vec![mesh], ..FileSummary::default() })
}
