//! The scene file as it is written, but for values that have rows ([`super::fields`]): what serde reads, what the JSON schema
//! describes, and its defaults.
//!
//! The doc comments here and in its parts are shown by editors that use the schema, so they speak to the artist.
//! Positions, velocities and times are in metres, metres per second and seconds with Y up, whatever the units of the
//! input files.

mod contact;
mod garment;
mod place_schemas;
mod seam;
mod values;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::attributes::Attribute;
use crate::units::{LengthUnit, UpAxis};

pub(in crate::scene_file) use contact::Contact;
pub(in crate::scene_file) use garment::{
    Axis, BIND, Ball, Bind, Corner, Disc, Elastic, Folds, Garment, Jitter, LARGEST_LEAF, Leaves, MAX_RESOLUTION, Panel,
    PanelShape, Part, Pin, Region, RenderMesh, Tube,
};
pub(in crate::scene_file) use seam::{PAIRING, Pairing, Seam, SeamSide};
pub(in crate::scene_file) use values::{BodyPath, Origin, Quantity, Rotation};

/// Prefix of the name of a painted map that is a file.
pub(in crate::scene_file) const FILE: &str = "file:";

/// A scene for Drapery.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Document {
    /// Version of the scene file format; 1.
    pub(in crate::scene_file) drapery: u32,
    /// Name, frame rate and frames.
    pub(in crate::scene_file) shot: Shot,
    /// Units of the input files, and of the output. Required with files that do not state them; USD files need none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) units: Option<FileUnits>,
    /// Time integration. Leave it out unless a shot needs it.
    #[serde(default)]
    pub(in crate::scene_file) solver: Solver,
    /// Bodies (colliders) that the garments collide with; the first has priority where bodies intersect.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) body: Vec<Body>,
    /// Garments, in the order of the output.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) garment: Vec<Garment>,
    /// Vertices that seams draw together.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) seam: Vec<Seam>,
    /// Contact by pair: which garments and bodies ignore each other, and friction and thickness between two of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) contact: Vec<Contact>,
    /// Choice among the effects that the scene asks for. Leave it out to run them all.
    #[serde(default, skip_serializing_if = "EffectChoice::is_everything")]
    pub(in crate::scene_file) effects: EffectChoice,
    /// Caches that are written.
    #[serde(default)]
    pub(in crate::scene_file) output: Output,
    /// Warnings before a run.
    #[serde(default, skip_serializing_if = "Check::says_nothing")]
    pub(in crate::scene_file) check: Check,
}

/// Warnings before a run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::scene_file) struct Check {
    /// Rules (docs/reference/warnings.md) that this scene breaks on purpose, as in ["no_gravity"]: they give no warnings.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) silence: Vec<String>,
}

impl Check {
    fn says_nothing(&self) -> bool {
        *self == Self::default()
    }
}

/// Choice among the effects that the scene asks for; one of the two lists at most.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::scene_file) struct EffectChoice {
    /// All but these, as in ["self_collision"]; `--without` replaces this list.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) without: Vec<String>,
    /// These and no others; `--only` replaces this list.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) only: Vec<String>,
}

impl EffectChoice {
    fn is_everything(&self) -> bool {
        *self == Self::default()
    }
}

/// Name, frame rate and frames.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Shot {
    /// Name of the shot, and of the folder of its run: letters, digits, "_", "-", "." and blanks; the name of the scene file if
    /// left out.
    pub(in crate::scene_file) name: String,
    /// Frames per second: "24", "24000/1001", "23.976" (which means 24000/1001), or a number.
    #[serde(default = "default_fps")]
    #[schemars(range(min = 0.1, max = 1e6))]
    pub(in crate::scene_file) fps: Quantity,
    /// First and last frame, as in "1001-1100".
    pub(in crate::scene_file) frames: String,
    /// Frames simulated before the first one.
    #[serde(default)]
    pub(in crate::scene_file) preroll: Preroll,
    /// Origin of the shot, [x, y, z]: caches count positions from there and hold it as a transform. "auto" is the middle of the
    /// garments at their start, in whole metres, if it is farther than 1 km along an axis. Otherwise it is the origin.
    #[serde(default = "automatic_origin")]
    pub(in crate::scene_file) origin: Origin,
}

fn automatic_origin() -> Origin {
    Origin::Auto
}

fn default_fps() -> Quantity {
    Quantity::Text("24".to_owned())
}

/// Frames simulated before the first one.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::scene_file) struct Preroll {
    /// Frames in which the cloth settles while bodies hold their rest pose (or their first pose, if they have none).
    #[schemars(range(min = 0, max = 100_000))]
    pub(in crate::scene_file) settle: u32,
    /// Frames in which bodies then blend from the rest pose to their first pose.
    #[schemars(range(min = 0, max = 100_000))]
    pub(in crate::scene_file) blend: u32,
}

/// Unit of length and up axis of a file.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct FileUnits {
    /// Unit of length.
    pub(in crate::scene_file) length: LengthUnit,
    /// Axis that points up.
    #[serde(default)]
    pub(in crate::scene_file) up: UpAxis,
}

// Every key of it has a row (`super::fields`).
/// Time integration.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Solver {}

// An ideal shape is read by `super::shape`.
/// A body that garments collide with: a shape, or a mesh from a file.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Body {
    /// Name, unique among the bodies.
    pub(in crate::scene_file) name: String,
    /// An Alembic, USD or OBJ file, relative to the scene file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) file: Option<String>,
    /// With `file`: a text, the one pattern of the paths of its meshes, as in "/hero/geo/*"; several meshes are merged into one body.
    /// With `shape`: a list, the points of its motion, [[seconds since the first frame, [x, y, z]], …], joined by straight lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) path: Option<BodyPath>,
    /// With `file`: the pose in which the cloth settles, as "file.abc@frame"; needed to blend in the pre-roll.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) rest: Option<String>,
    /// With `file`: units of this file, if they differ from `[units]`, or if the file states wrong ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) units: Option<FileUnits>,
    /// A belt around another body, which it follows, in the place of `file` and `shape` (docs/howto/belt.md).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) belt: Option<Belt>,
    /// With `shape`: its position.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) position: Option<[f64; 3]>,
    /// With `shape`: its rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) rotation: Option<Rotation>,
    /// With `shape`: its steady rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(in crate::scene_file) spin: Option<Spin>,
}

/// A belt around another body: a closed band around what a plane cuts out of it in the first frame of the shot, which then follows
/// its surface.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Belt {
    /// Name of the body, which has to be from a file.
    pub(in crate::scene_file) around: String,
    /// A point inside of the part that it runs around, as the middle of the waist, in the first frame.
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) at: [f64; 3],
    /// Axis that it runs around.
    #[serde(default = "upwards")]
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) axis: [f64; 3],
    /// Width along the axis, in metres or as "4 cm".
    #[serde(default = "default_belt_width")]
    #[schemars(range(min = 1e-6, max = 1e3))]
    pub(in crate::scene_file) width: Quantity,
    /// Thickness of the strap, in metres or as "4 mm".
    #[serde(default = "default_belt_depth")]
    #[schemars(range(min = 1e-6, max = 1e3))]
    pub(in crate::scene_file) depth: Quantity,
    /// Room for cloth between the belt and the body, in metres or as "6 mm".
    #[serde(default = "default_belt_gap")]
    #[schemars(range(min = 0.0, max = 1e3))]
    pub(in crate::scene_file) gap: Quantity,
    /// Points along its length.
    #[serde(default = "default_belt_resolution")]
    #[schemars(range(min = 8, max = MAX_RESOLUTION))]
    pub(in crate::scene_file) resolution: u32,
}

fn upwards() -> [f64; 3] {
    [0.0, 1.0, 0.0]
}

fn default_belt_width() -> Quantity {
    Quantity::Text("4 cm".to_owned())
}

fn default_belt_depth() -> Quantity {
    Quantity::Text("4 mm".to_owned())
}

fn default_belt_gap() -> Quantity {
    Quantity::Text("6 mm".to_owned())
}

fn default_belt_resolution() -> u32 {
    96
}

/// A steady rotation.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Spin {
    /// Angular velocity about world axes in rad/s.
    #[schemars(inner(range(min = -1e5, max = 1e5)))]
    pub(in crate::scene_file) angular_velocity: [f64; 3],
    /// Start of the rotation, in seconds since the first frame.
    #[serde(default)]
    #[schemars(range(min = -1e9, max = 1e9))]
    pub(in crate::scene_file) from: f64,
}

/// Caches that are written.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::scene_file) struct Output {
    /// Formats: "abc" (Alembic), "h5" (HDF5), "usd" (USD).
    pub(in crate::scene_file) format: Vec<Format>,
    /// Stores velocities, for motion blur.
    pub(in crate::scene_file) velocities: bool,
    /// Samples of a frame in Alembic and USD, at equal distances over the shutter; 1 by default, the frame alone. A step of the
    /// solver ends at each of them. Frames are always among the samples, also outside the shutter. There are none before the first
    /// frame and after the last.
    #[schemars(range(min = 1, max = 33))]
    #[serde(skip_serializing_if = "is_one")]
    pub(in crate::scene_file) samples: u32,
    /// Opening and closing of the shutter, in frames from the frame; at most one frame apart. By default [-0.25, 0.25].
    #[schemars(inner(range(min = -1, max = 1)))]
    #[serde(skip_serializing_if = "is_usual_shutter")]
    pub(in crate::scene_file) shutter: [f64; 2],
    /// Writes the frames of the pre-roll, too; not by default.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(in crate::scene_file) preroll: bool,
    /// Writes the whole shot as one binary USD file at the end of a run, SHOT.usdc beside SHOT.usda; not by default.
    /// For small shots: all of it is in memory until it is written, and more than 2 GB are refused.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(in crate::scene_file) usd_single: bool,
    /// Attributes at the points, for shading and checks: "normals" (smooth but for hard edges), "rest" (positions at rest:
    /// `Pref` in Alembic, `primvars:rest` in USD), "strain" (greatest strain of the edges at a point: length over rest length,
    /// less one), "contact" (1 where a point is as close to a body or other cloth as contact keeps it, 0 at twice that distance),
    /// "thickness" (of the fabric, in the unit of the caches). None by default; render meshes always have normals.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::scene_file) attributes: Vec<PointAttribute>,
    /// Faces that garments are written with; render meshes keep theirs. "original" by default.
    #[serde(skip_serializing_if = "is_original")]
    pub(in crate::scene_file) faces: Faces,
}

/// An attribute at the points of caches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum PointAttribute {
    /// Normals of length one, smooth but for hard edges.
    Normals,
    /// Positions at rest.
    Rest,
    /// Greatest strain of the edges at a point.
    Strain,
    /// Contact with bodies and other cloth, from 0 to 1.
    Contact,
    /// Thickness of the fabric.
    Thickness,
}

impl From<PointAttribute> for Attribute {
    fn from(written: PointAttribute) -> Self {
        match written {
            PointAttribute::Normals => Self::Normals,
            PointAttribute::Rest => Self::Rest,
            PointAttribute::Strain => Self::Strain,
            PointAttribute::Contact => Self::Contact,
            PointAttribute::Thickness => Self::Thickness,
        }
    }
}

/// Faces that garments are written with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum Faces {
    /// Faces of their files, which renderers cut into triangles themselves, along either diagonal.
    #[default]
    Original,
    /// The triangles that are simulated, so that what is rendered is what collided.
    Triangles,
}

/// Keys of `[output]` that a scene with all defaults does not say, with the values that mean the same.
pub const UNSAID: [(&str, &str); 6] = [
    ("output.samples", "1"),
    ("output.shutter", "[-0.25, 0.25]"),
    ("output.preroll", "false"),
    ("output.usd_single", "false"),
    ("output.attributes", "[]"),
    ("output.faces", "\"original\""),
];

/// Half a frame around the frame.
const SHUTTER: [f64; 2] = [-0.25, 0.25];

fn is_one(samples: &u32) -> bool {
    *samples == 1
}

fn is_original(faces: &Faces) -> bool {
    *faces == Faces::Original
}

fn is_usual_shutter(shutter: &[f64; 2]) -> bool {
    *shutter == SHUTTER
}

impl Default for Output {
    fn default() -> Self {
        let format = vec![Format::Abc, Format::H5];
        Self {
            format,
            velocities: true,
            samples: 1,
            shutter: SHUTTER,
            preroll: false,
            usd_single: false,
            attributes: Vec::new(),
            faces: Faces::Original,
        }
    }
}

impl Output {
    /// Returns the times of the samples between a frame and the next, as fractions of a frame, ascending.
    pub(in crate::scene_file) fn sub_frames(&self) -> Vec<f64> {
        let [open, close] = self.shutter;
        let intervals = self.samples.saturating_sub(1);
        let at = |sample: u32| open + (close - open) * f64::from(sample) / f64::from(intervals.max(1));
        let behind = |time: f64| time - time.floor();
        let mut fractions: Vec<f64> = match intervals {
            0 => Vec::new(),
            _ => (0..=intervals).map(|sample| behind(at(sample))).collect(),
        };
        fractions.retain(|fraction| (SAME_TIME..=1.0 - SAME_TIME).contains(fraction));
        fractions.sort_by(f64::total_cmp);
        fractions.dedup_by(|later, earlier| *later - *earlier < SAME_TIME);
        fractions
    }
}

/// Samples that lie closer are one [frames].
const SAME_TIME: f64 = 1e-6;

/// A format of caches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene_file) enum Format {
    /// Alembic.
    Abc,
    /// HDF5.
    H5,
    /// USD.
    Usd,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_unsaid_is_the_default() {
        let usual = toml::to_string(&Output::default()).unwrap();
        for (key, value) in UNSAID {
            let name = key.strip_prefix("output.").unwrap();
            assert!(!usual.contains(name), "{usual}");
            let said: Output = toml::from_str(&format!("{name} = {value}")).unwrap();
            assert_eq!(toml::to_string(&said).unwrap(), usual);
        }
    }

    #[test]
    fn samples_between_frames_are_those_of_the_shutter_without_the_frames_themselves() {
        let behind = |samples, shutter| Output { samples, shutter, ..Output::default() }.sub_frames();
        assert_eq!(behind(1, SHUTTER), [] as [f64; 0]);
        assert_eq!(behind(2, SHUTTER), [0.25, 0.75]);
        assert_eq!(behind(3, SHUTTER), [0.25, 0.75]);
        assert_eq!(behind(5, [-0.5, 0.5]), [0.25, 0.5, 0.75]);
        assert_eq!(behind(3, [0.0, 1.0]), [0.5]);
        assert_eq!(behind(2, [0.0, 0.5]), [0.5]);
    }
}
