//! Result of reading a scene file: a scene with its files opened, and the output that is written of it.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use drapery_core::scene::SceneDescription;

use crate::attributes::Attribute;
use crate::garment_mesh::GarmentMesh;
use crate::input_motion::{InputMotion, Preroll};
use crate::memory_mesh::MemoryMeshes;
use crate::mesh_source::FrameRate;
use crate::units::{InputUnits, Units};
use crate::wind_file::WindFile;

/// Frame numbers that there can be: far more than any shot has, and far from where sums of them would overflow.
pub const FRAMES: RangeInclusive<i64> = -1_000_000_000..=1_000_000_000;

/// Suffix of the name of a garment's render mesh, behind the name of the garment.
pub const RENDER: &str = "_render";

/// A mesh that is rendered in the place of a garment.
#[derive(Debug)]
pub struct RenderMeshDescription {
    /// The garment that it follows.
    pub garment: usize,
    /// Its name, by which its caches are called.
    pub name: String,
    /// The file that it comes from.
    pub file: PathBuf,
    /// Unit and up axis that it is read in.
    pub units: InputUnits,
    /// The mesh at the rest shape of the garment, with everything to hand through.
    pub mesh: GarmentMesh,
    /// Distance from the cloth at rest above which points are warned of [m].
    pub max_distance: f64,
    /// Points of the parts that do not bend, part by part; no point is in two of them.
    pub rigid: Vec<Vec<u32>>,
}

/// A scene with its files opened: everything that a run needs.
#[derive(Debug)]
pub struct ShotDescription {
    /// Name of the shot.
    pub name: String,
    /// Scene file, for the record; empty when there is none.
    pub scene_path: PathBuf,
    /// All files that are read, so that none is overwritten.
    pub input_files: Vec<PathBuf>,
    /// Input files that the scene does not name: other files refer to them, from whatever folder.
    pub referred_files: Vec<PathBuf>,
    /// Meshes in memory that it may name beside files.
    pub meshes: MemoryMeshes,
    /// Scene that is simulated.
    pub scene: SceneDescription,
    /// For each body of the scene its file; `None` for analytic shapes.
    pub bodies: Vec<Option<InputMotion>>,
    /// Pin targets, in the order of the tracks.
    pub tracks: Vec<InputMotion>,
    /// The grid of the wind, if a file gives one.
    pub wind: Option<WindFile>,
    /// For each garment of the scene its mesh as it comes from its file, with everything to hand through.
    pub garments: Vec<GarmentMesh>,
    /// Meshes that are rendered in the place of garments.
    pub render_meshes: Vec<RenderMeshDescription>,
    /// First and last frame of the shot.
    pub frames: [i64; 2],
    /// Frames before the first one.
    pub preroll: Preroll,
    /// Output that is written.
    pub output: OutputDescription,
    /// The scene with every default written out.
    pub resolved: String,
    /// Warnings about suspicious things that were accepted.
    pub warnings: Vec<String>,
    /// Further data that the rules of a scene look at.
    pub check: CheckDescription,
    /// For each body what its faces and those of the cloth ask for; `None` for shapes that are not round. Shorter lists mean none.
    pub body_thickness: Vec<Option<BodyThickness>>,
}

/// The thickness of a body that is a mesh or a round shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyThickness {
    /// Thickness that keeps the coarse faces of the body and of the cloth from showing through each other [m]
    /// ([`drapery_core::geometry::coarseness`]).
    pub needed: f64,
    /// Whether the scene says the thickness itself.
    pub is_written: bool,
}

/// Data of a scene file for the rules of [`crate::rules`], which nothing else looks at.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CheckDescription {
    /// Names of rules that the scene silences.
    pub silenced: Vec<String>,
    /// For each garment its material; `None` where the scene names none. Shorter lists mean none.
    pub fabrics: Vec<Option<Fabric>>,
    /// For each body whether the scene itself says its friction. Shorter lists mean no.
    pub has_own_friction: Vec<bool>,
    /// Lines of the scene file by the objects that messages name by their number alone, such as `seam 0`: the same object behind its
    /// place in the file, as in `scene.toml:12: garment "left" and garment "right", seam 0`.
    pub lines: BTreeMap<String, String>,
    /// The channels of files that numbers follow, but for those that never change.
    pub channels: Vec<ChannelRate>,
}

/// Frame rate of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelRate {
    /// The number that follows it, as in `curve of gravity.acceleration`.
    pub object: String,
    /// The file.
    pub path: PathBuf,
    /// The rate of the file.
    pub rate: FrameRate,
}

impl CheckDescription {
    /// The object of a message, with its line in the scene file in front where the object has a number in the place of a name.
    pub fn with_line(&self, object: &str) -> String {
        let ends = object.match_indices([',', ' ']).map(|(end, _)| end).chain([object.len()]);
        // The longest name: `garment "sheet", pin 1` and not `garment "sheet"`.
        let found = ends.filter_map(|end| self.lines.get(&object[..end]).map(|line| (end, line))).next_back();
        found.map_or_else(|| object.to_owned(), |(end, line)| format!("{line}{}", &object[end..]))
    }
}

/// The material of a garment, as far as checks and reports look at it.
#[derive(Debug, Clone, PartialEq)]
pub struct Fabric {
    /// Name of the material.
    pub name: String,
    /// Its friction.
    pub friction: f64,
    /// Largest strain that it takes.
    pub strain_limit: f64,
}

/// Output of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputDescription {
    /// Words of [`crate::formats::FORMATS`].
    pub formats: Vec<String>,
    /// Units and up axis of the caches.
    pub units: Units,
    /// Whether velocities are stored.
    pub velocities: bool,
    /// Times of the samples between a frame and the next, as fractions of a frame, ascending.
    pub sub_frames: Vec<f64>,
    /// Whether the frames of the pre-roll are written too.
    pub preroll: bool,
    /// Whether a run that is done writes all its USD caches as one binary layer too.
    pub usd_single: bool,
    /// Attributes at the points that are asked for, ascending.
    pub attributes: Vec<Attribute>,
    /// Whether garments are written with the triangles that are simulated in the place of their faces.
    pub triangles: bool,
}

impl OutputDescription {
    /// Whether this attribute is asked for.
    pub fn has(&self, attribute: Attribute) -> bool {
        self.attributes.contains(&attribute)
    }
}
