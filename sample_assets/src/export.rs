//! Writes the sample assets: Alembic for body and garments, OBJ and pins for garments.

use std::path::{Path, PathBuf};

use drapery_alembic::{
    AlembicError, ArchiveOptions, ArchiveWriter, Durability, Indexed, Matrix, PolyMeshSample, PolyMeshWriter, Scope,
    TimeSampling, Topology, XformWriter, write_face_set,
};

use crate::coat::{coat, coat_render};
use crate::garments::{Garment, Skirt, skirt, trousers, tshirt};
use crate::mannequin::Mannequin;
use crate::motion::Root;
use crate::obj::obj_text;
use crate::pins::{pin_ring, pins_json};
use crate::sdf::Vec3;
use crate::skeleton::Bone;
use crate::surface_mesh::SurfaceMesh;

/// Bounds of the resolution: below, hands and feet vanish between the points; above, the body has 160,000 points.
pub const RESOLUTIONS: std::ops::RangeInclusive<f64> = 0.5..=4.0;
/// Most frames in one shot.
pub const MOST_FRAMES: u32 = 20_000;

/// Edge length of the garments at resolution 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fineness {
    /// About 20 mm.
    Light,
    /// About 9 mm.
    Full,
}

impl Fineness {
    /// Target edge length \[m\] at resolution 1.
    pub fn edge(self) -> f64 {
        match self {
            Fineness::Light => 0.020,
            Fineness::Full => 0.009,
        }
    }
}

/// Parameters of the assets to make.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Points per length relative to the default, within [`RESOLUTIONS`].
    pub resolution: f64,
    /// Each seed dances a little differently; body and garments stay.
    pub seed: u64,
    /// First and last frame; the rest pose is at the first.
    pub frames: [u32; 2],
    /// Frames per second.
    pub frames_per_second: f64,
    /// Edge length of the garments.
    pub garments: Fineness,
}

impl Default for Order {
    fn default() -> Self {
        Order { resolution: 1.0, seed: 0, frames: [1001, 1097], frames_per_second: 24.0, garments: Fineness::Light }
    }
}

/// Why the assets could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The resolution would give no usable body.
    #[error("resolution {0} is outside {min} to {max}; use 1 for about 10,000 body points",
        min = RESOLUTIONS.start(), max = RESOLUTIONS.end())]
    Resolution(f64),
    /// The frame range is empty or too long.
    #[error("frames {first}-{last} are not a range of 1 to {MOST_FRAMES} frames; write for example 1001-1097")]
    Frames {
        /// First frame asked for.
        first: u32,
        /// Last frame asked for.
        last: u32,
    },
    /// The frame rate is not a positive number.
    #[error("{0} frames per second is not a positive rate; write for example 24")]
    FrameRate(f64),
    /// A file could not be written.
    #[error("{path}: cannot write: {source}; check the folder and the space left on the disk", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Error reported by the system.
        source: std::io::Error,
    },
    /// An Alembic file could not be written.
    #[error(transparent)]
    Alembic(#[from] AlembicError),
}

/// One file written, and what is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// The file.
    pub path: PathBuf,
    /// Its content in a few words.
    pub content: String,
}

/// Everything of a dressed mannequin before it is written.
#[derive(Debug, Clone)]
pub struct Wardrobe {
    /// The body and its motion.
    pub mannequin: Mannequin,
    /// Skirt, T-shirt (worn over the skirt) and trousers (worn instead of the skirt).
    pub garments: Vec<Garment>,
}

impl Wardrobe {
    /// Makes body, motion and garments.
    ///
    /// # Errors
    /// The first member of the order that is out of range.
    pub fn make(order: &Order) -> Result<Wardrobe, ExportError> {
        let [first, last] = order.frames;
        if !RESOLUTIONS.contains(&order.resolution) {
            return Err(ExportError::Resolution(order.resolution));
        }
        if last < first || last - first >= MOST_FRAMES {
            return Err(ExportError::Frames { first, last });
        }
        if !(order.frames_per_second.is_finite() && order.frames_per_second > 0.0) {
            return Err(ExportError::FrameRate(order.frames_per_second));
        }
        let duration = f64::from(last - first) / order.frames_per_second;
        let mannequin = Mannequin::new(order.resolution, duration, order.seed);
        let edge = order.garments.edge() / order.resolution;
        let shape = Skirt::over(&mannequin.limbs);
        let garments =
            vec![skirt(&shape, edge), tshirt(&mannequin.limbs, &shape, edge), trousers(&mannequin.limbs, edge)];
        Ok(Wardrobe { mannequin, garments })
    }
}

/// A folder that files are written into; each gets its name once it is complete.
struct Folder<'a> {
    path: &'a Path,
    written: Vec<Written>,
}

impl<'a> Folder<'a> {
    /// The folder, which is created.
    fn create(path: &'a Path) -> Result<Self, ExportError> {
        std::fs::create_dir_all(path).map_err(|source| ExportError::File { path: path.to_owned(), source })?;
        Ok(Self { path, written: Vec::new() })
    }

    /// Adds a file.
    fn add(
        &mut self,
        name: String,
        content: String,
        write: &dyn Fn(&Path) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let path = self.path.join(&name);
        let partial = self.path.join(name + ".partial");
        write(&partial)?;
        std::fs::rename(&partial, &path).map_err(|source| ExportError::File { path: path.clone(), source })?;
        self.written.push(Written { path, content });
        Ok(())
    }
}

/// Writes the coat into `folder`, which is created: `coat.abc`, the cloth that is simulated, and `coat_render.abc`, what is rendered
/// in its place. A file gets its name once it is complete.
///
/// # Errors
/// The first file that cannot be written.
pub fn write_coat(folder: &Path) -> Result<Vec<Written>, ExportError> {
    let mut files = Folder::create(folder)?;
    for garment in [coat(), coat_render()] {
        let write = |path: &Path| write_garment(&garment, &Order::default(), path);
        files.add(format!("{}.abc", garment.name), mesh_summary(&garment.mesh), &write)?;
    }
    Ok(files.written)
}

/// Makes the assets and writes them into `folder`, which is created: `body.abc`, and for each garment `.abc`, `.obj`
/// and, if it has a waist ring, `_pins.json`. The same order gives the same bytes. A file gets its name once it is
/// complete.
///
/// # Errors
/// An order out of range, or the first file that cannot be written.
pub fn write_mannequin(order: &Order, folder: &Path) -> Result<Vec<Written>, ExportError> {
    let Wardrobe { mannequin, garments } = Wardrobe::make(order)?;
    let mut files = Folder::create(folder)?;
    let [first, last] = order.frames;
    let content = format!("{}, frames {first}-{last}", mesh_summary(&mannequin.rest));
    files.add("body.abc".into(), content, &|path| write_body(&mannequin, order, path))?;
    for garment in &garments {
        let name = garment.name;
        files.add(format!("{name}.abc"), mesh_summary(&garment.mesh), &|path| write_garment(garment, order, path))?;
        files.add(format!("{name}.obj"), "the same".into(), &|path| write_text(path, &obj_text(garment)))?;
        if !garment.waist_ring.is_empty() {
            let pins = pin_ring(&garment.mesh, &garment.waist_ring, &mannequin.rest);
            let content = format!("{} pins of the waist ring", pins.len());
            files.add(format!("{name}_pins.json"), content, &|path| write_text(path, &pins_json(name, &pins)))?;
        }
    }
    Ok(files.written)
}

fn mesh_summary(mesh: &SurfaceMesh) -> String {
    let edge = 1000.0 * mesh.mean_edge();
    format!("{} points, {} faces, mean edge {edge:.1} mm", mesh.points.len(), mesh.faces.len())
}

fn write_text(path: &Path, text: &str) -> Result<(), ExportError> {
    std::fs::write(path, text).map_err(|source| ExportError::File { path: path.to_owned(), source })
}

fn archive_options(order: &Order, description: &str) -> ArchiveOptions {
    ArchiveOptions {
        application: concat!("drapery-assets ", env!("CARGO_PKG_VERSION")).into(),
        description: description.into(),
        frames_per_second: Some(order.frames_per_second),
        ..ArchiveOptions::default()
    }
}

/// Corners of a face in Alembic's order, clockwise seen from outside. The first corner stays the first, and with it the
/// diagonal at which a quad is split.
pub fn clockwise(corners: &[usize]) -> impl Iterator<Item = usize> + '_ {
    corners[..1].iter().chain(corners[1..].iter().rev()).copied()
}

fn counts_and_indices(faces: &[Vec<usize>]) -> (Vec<i32>, Vec<i32>) {
    let counts = faces.iter().map(|face| face.len() as i32).collect();
    let indices = faces.iter().flat_map(|face| clockwise(face).map(|v| v as i32)).collect();
    (counts, indices)
}

fn single(points: &[Vec3]) -> Vec<[f32; 3]> {
    points.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect()
}

/// `/mannequin` (walks and turns) / `body` (pelvis height) / `bodyShape` (points relative to the pelvis).
fn write_body(mannequin: &Mannequin, order: &Order, path: &Path) -> Result<(), ExportError> {
    let [first, last] = order.frames;
    let mut archive = ArchiveWriter::create(path, &archive_options(order, "mannequin, metres, y up"))?;
    let sampling = archive.add_time_sampling(TimeSampling::frames(f64::from(first), order.frames_per_second)?)?;
    let root_object = archive.root();
    let walker = XformWriter::declare(&mut archive, root_object, "mannequin", sampling)?;
    let pelvis = XformWriter::declare(&mut archive, walker.object(), "body", sampling)?;
    let mut mesh = PolyMeshWriter::declare(&mut archive, pelvis.object(), "bodyShape", sampling)?;
    let (face_counts, face_indices) = counts_and_indices(&mannequin.rest.faces);
    let topology = Topology { face_counts: &face_counts, face_indices: &face_indices };
    let joint = Bone::Pelvis.rest_joint();
    for frame in first..=last {
        let (points, root) = mannequin.points_in_root(f64::from(frame - first) / order.frames_per_second);
        walker.write(&mut archive, &walk_matrix(&root))?;
        pelvis.write(&mut archive, &translation(&(joint + Vec3::y() * root.rise)))?;
        let local: Vec<Vec3> = points.iter().map(|p| p - joint).collect();
        let topology = (frame == first).then_some(topology);
        mesh.write(&mut archive, &PolyMeshSample { topology, ..PolyMeshSample::of(&single(&local)) })?;
    }
    archive.finish(Durability::Synced)?;
    Ok(())
}

/// Matrix for row vectors: turn about the vertical, then the place on the floor.
fn walk_matrix(root: &Root) -> Matrix {
    let (sine, cosine) = root.heading.sin_cos();
    let mut matrix = translation(&Vec3::new(root.over_floor[0], 0.0, root.over_floor[1]));
    (matrix[0], matrix[2]) = (cosine, -sine);
    (matrix[8], matrix[10]) = (sine, cosine);
    matrix
}

fn translation(by: &Vec3) -> Matrix {
    [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., by.x, by.y, by.z, 1.]
}

fn write_garment(garment: &Garment, order: &Order, path: &Path) -> Result<(), ExportError> {
    let mut archive = ArchiveWriter::create(path, &archive_options(order, "garment at rest, metres, y up"))?;
    let root_object = archive.root();
    let xform = XformWriter::still(&mut archive, root_object, garment.name, None)?;
    let shape = format!("{}Shape", garment.name);
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), &shape, 0)?;
    let (face_counts, face_indices) = counts_and_indices(&garment.mesh.faces);
    let uvs: Vec<[f32; 2]> = garment.uvs.iter().map(|uv| uv.map(|value| value as f32)).collect();
    let uv_indices: Vec<u32> =
        garment.uv_corners.iter().flat_map(|corners| clockwise(corners).map(|uv| uv as u32)).collect();
    let positions = single(&garment.mesh.points);
    let sample = PolyMeshSample {
        topology: Some(Topology { face_counts: &face_counts, face_indices: &face_indices }),
        uv: Some(Indexed { values: &uvs, indices: Some(&uv_indices), scope: Scope::FaceVarying, source_name: None }),
        ..PolyMeshSample::of(&positions)
    };
    mesh.write(&mut archive, &sample)?;
    for (name, faces) in &garment.face_sets {
        let faces: Vec<i32> = faces.iter().map(|&face| face as i32).collect();
        write_face_set(&mut archive, mesh.object(), name, &faces, true)?;
    }
    archive.finish(Durability::Synced)?;
    Ok(())
}
