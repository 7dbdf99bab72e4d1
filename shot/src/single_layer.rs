//! The shot as one file that stands for itself (`output.usd_single`), written when a run is done.

use std::path::{Path, PathBuf};

use drapery_core::error::Problem;
use drapery_core::mesh::MeshStream;
use drapery_io::attributes::Attribute;
use drapery_io::convert::bytes_of;
use drapery_io::formats::{FORMATS, Format, SingleFormat};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::shot_description::{OutputDescription, RenderMeshDescription};

/// The file of the shot of this name, if the scene asks for it.
pub(crate) fn path(output: &OutputDescription, name: &str, folder: &Path) -> Option<PathBuf> {
    let (format, _) = format(output)?;
    Some(folder.join(format!("{name}.{}", format.extension)))
}

/// The format of the file, if the scene asks for it.
fn format(output: &OutputDescription) -> Option<(&'static Format, &'static SingleFormat)> {
    let mut formats = FORMATS.iter().filter_map(|format| Some((format, format.single.as_ref()?)));
    formats.next().filter(|_| output.usd_single)
}

/// Says before anything runs that there is too much for one layer.
pub(crate) fn problem(
    output: &OutputDescription,
    [first, last]: [i64; 2],
    (garments, render_meshes): (&[GarmentMesh], &[RenderMeshDescription]),
) -> Option<Problem> {
    let (_, single) = format(output)?;
    let samples = last.abs_diff(first).saturating_mul(output.sub_frames.len() as u64 + 1) + 1;
    let points = |all: u64, mesh: &GarmentMesh| all.saturating_add(mesh.point_count() as u64);
    let of_garments = garments.iter().fold(0, points);
    let of_render_meshes = render_meshes.iter().map(|mesh| &mesh.mesh).fold(0, points);
    // Positions, and velocities where they are stored; of render meshes normals too.
    let (each, normals) = (1 + u64::from(output.velocities), u64::from(output.has(Attribute::Normals)));
    let of_render_meshes_alone = of_render_meshes.saturating_mul(each + 1);
    let vectors = of_garments.saturating_mul(each + normals).saturating_add(of_render_meshes_alone);
    let each = u64::from(output.has(Attribute::Strain)) + u64::from(output.has(Attribute::Contact));
    let numbers = of_garments.saturating_add(of_render_meshes).saturating_mul(each);
    let bytes = bytes_of(vectors.saturating_mul(samples), numbers.saturating_mul(samples));
    (bytes > single.most_bytes).then(|| {
        let (megabytes, most) = (bytes / 1_000_000, single.most_bytes / 1_000_000);
        Problem::scene(
            "[output] usd_single",
            format!("{samples} samples of the shot take {megabytes} MB, and one layer holds at most {most} MB"),
            "leave usd_single out, or ask for fewer frames: the layer over value clips has no such limit",
        )
    })
}
