//! Content of a mesh or cache file, for `drapery info`; the table of formats says how it is found out.

use drapery_core::Vec3;
use serde::Serialize;

/// Content of a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FileSummary {
    /// Its format.
    pub format: &'static str,
    /// Its writer, its way to count frames, and the like: name and value.
    pub properties: Vec<(String, String)>,
    /// Its meshes.
    pub meshes: Vec<MeshSummary>,
    /// Objects that are no meshes: path and kind.
    pub others: Vec<(String, String)>,
    /// Numbers that a scene can follow.
    pub channels: Vec<ChannelSummary>,
}

/// A property of an object, of one number or of three, that changes over time or was added by an artist.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ChannelSummary {
    /// Path of the object and name of the property, as a scene writes them: `/control.slip`.
    pub channel: String,
    /// Numbers of a sample.
    pub numbers: usize,
    /// Number of samples: 1 if it never changes.
    pub samples: usize,
}

impl ChannelSummary {
    /// The channel, if a scene can follow as many numbers: one or three.
    pub(crate) fn of(object: &str, property: &str, numbers: usize, samples: usize) -> Option<Self> {
        matches!(numbers, 1 | 3).then(|| Self { channel: format!("{object}.{property}"), numbers, samples })
    }
}

/// Normals of a mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Normals {
    /// None are stored.
    #[default]
    No,
    /// The same for all faces at a point.
    Smooth,
    /// Several at the points of hard edges.
    Split,
}

impl Normals {
    /// Normals that are stored, or not, and whether hard edges split them.
    pub(crate) fn of(are_stored: bool, are_split: bool) -> Self {
        match (are_stored, are_split) {
            (false, _) => Self::No,
            (true, false) => Self::Smooth,
            (true, true) => Self::Split,
        }
    }
}

/// A mesh of a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MeshSummary {
    /// Full path of the object.
    pub path: String,
    /// Number of points of the first sample.
    pub points: usize,
    /// Faces with three, four, and more corners.
    pub faces: [usize; 3],
    /// Whether points and faces change.
    pub topology: &'static str,
    /// Number of times at which its points, or a parent that moves it, are stored.
    pub samples: usize,
    /// Times of the first and the last sample [s]; `None` where the file has frames without a rate, or the mesh does not move.
    pub times: Option<[f64; 2]>,
    /// Smallest and largest coordinates of the first sample, in world space and the file's unit.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Name of the UV set and number of its values.
    pub uvs: Option<(String, usize)>,
    /// Face sets and their number of faces.
    pub face_sets: Vec<(String, usize)>,
    /// Normals of the first sample.
    pub normals: Normals,
    /// Names of other attributes.
    pub attributes: Vec<String>,
    /// Whether velocities are stored.
    pub velocities: bool,
    /// Why it cannot be read, if so; the rest is then empty.
    pub problem: Option<String>,
}

/// Faces with three, four, and more corners.
pub(crate) fn face_kinds(counts: &[u32]) -> [usize; 3] {
    let number = |test: fn(u32) -> bool| counts.iter().filter(|&&count| test(count)).count();
    [number(|c| c <= 3), number(|c| c == 4), number(|c| c > 4)]
}

/// Smallest and largest coordinates of points.
pub(crate) fn bounds(points: &[Vec3]) -> Option<[[f64; 3]; 2]> {
    let first = *points.first()?;
    let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    Some([low.into(), high.into()])
}
