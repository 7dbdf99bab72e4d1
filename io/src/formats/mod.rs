//! The file formats: which are read and which are written.

pub mod alembic;
mod continuing;
pub mod hdf5;
mod obj;
mod point_cache;
#[cfg(feature = "usd")]
mod usd;

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use globset::{GlobBuilder, GlobMatcher};

use crate::cache::{CacheFrame, CacheMark, CachePlan, CacheWriter};
use crate::cache_frames::CacheFrames;
use crate::error::IoError;
use crate::file_summary::FileSummary;
use crate::input_file;
use crate::mesh_data::MeshReader;
use crate::units::{Units, UpAxis};

/// Frame rates that differ by less than this share are one.
const SAME_RATE: f64 = 1e-5;

/// Opens a mesh, or the objects of it whose path fits the pattern.
pub type OpenMesh = fn(&Path, Option<&str>) -> Result<Box<dyn MeshReader>, IoError>;

/// Creates a cache.
pub type CreateCache = fn(&Path, &CachePlan<'_>) -> Result<Box<dyn CacheWriter>, IoError>;

/// Opens a cache to go on after its mark: what is behind the mark is cut off. The final file has the bytes of one that
/// was written without a break.
///
/// A cache that is missing, damaged or was made with another plan is an error that says what to do, and stays as it is.
/// Only the last frame may be another than planned before, as long as it is not before a frame that the file holds.
pub type ResumeCache = fn(&Path, &CachePlan<'_>, &CacheMark) -> Result<Box<dyn CacheWriter>, IoError>;

/// Finds out whether a cache can go on after its mark, and changes nothing: what it refuses, [`ResumeCache`] refuses too.
pub type CheckCache = fn(&Path, &CachePlan<'_>, &CacheMark) -> Result<(), IoError>;

/// Opens a cache to be read back.
pub type OpenCache = fn(&Path, Opening) -> Result<CacheFrames, IoError>;

/// Choices in opening a cache, for formats that offer them; none by default.
#[derive(Debug, Clone, Copy, Default)]
pub struct Opening {
    /// Offset of the tables of an earlier commit in the file [bytes].
    pub root: Option<u64>,
    /// Frames a second, for samples that have times.
    pub rate: Option<f64>,
}

/// Samples of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSamples {
    /// Axis that points up, where the file says it.
    pub up: Option<UpAxis>,
    /// Frames per second that the file states.
    pub stated_rate: Option<f64>,
    /// Times [s], ascending, and the numbers of the value there; one sample for what never changes.
    pub values: Vec<(f64, Vec<f64>)>,
}

/// Reads a channel: a property of an object that holds numbers, by the path of the object and the name of the property.
pub type ReadChannel = fn(&Path, &str, &str) -> Result<ChannelSamples, IoError>;

/// Files of an extension, in words.
fn with_extension(extension: &str) -> String {
    if extension.is_empty() { "files without an extension".to_owned() } else { format!(".{extension} files") }
}

/// Looks into a file.
pub type Summarise = fn(&Path) -> Result<FileSummary, IoError>;

/// The caches of a shot in one format.
#[derive(Debug)]
pub struct ShotFiles<'a> {
    /// Name of the shot.
    pub name: &'a str,
    /// Units and up axis of the caches.
    pub units: Units,
    /// Frames per second.
    pub fps: f64,
    /// First and last frame that are complete in all of them.
    pub frames: [i64; 2],
    /// Their caches.
    pub caches: Vec<ShotCache<'a>>,
}

/// A cache of a shot.
#[derive(Debug)]
pub struct ShotCache<'a> {
    /// Name of the garment or render mesh.
    pub name: &'a str,
    /// Name of the file, in the same folder.
    pub file: String,
    /// Whether it is to be seen where a render mesh and the garment that it follows are there.
    pub part: Part,
}

/// Role of a cache where a garment is rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The garment itself.
    Alone,
    /// The garment, in the place of which a render mesh is rendered.
    Followed,
    /// The render mesh of a garment.
    RenderMesh,
}

/// One file that ties the caches of a shot together.
pub struct ShotFormat {
    /// Its extension, behind the name of the shot.
    pub extension: &'static str,
    /// Writes it, or replaces it as a whole.
    pub write: fn(&Path, &ShotFiles<'_>) -> Result<(), IoError>,
}

/// One file that stands for itself and holds several meshes with all their frames, written when these are all there.
pub struct SingleFormat {
    /// Begins one in memory.
    pub create: for<'a> fn(SinglePlan<'a>) -> Box<dyn SingleWriter + 'a>,
    /// The most bytes of positions, velocities and normals that it takes.
    pub most_bytes: u64,
}

/// Content of such a file, known before its first sample.
pub struct SinglePlan<'a> {
    /// The file, for messages.
    pub path: &'a Path,
    /// First and last frame.
    pub frames: [i64; 2],
    /// The meshes; one at least.
    pub caches: Vec<CachePlan<'a>>,
    /// The shot, if the meshes are those of its caches.
    pub shot: Option<&'a ShotFiles<'a>>,
}

/// Such a file being put together.
pub trait SingleWriter {
    /// Adds a sample of a mesh: one mesh after the other, each with all its samples in the order of their times.
    ///
    /// # Errors
    /// The mesh cannot be read, or has a name that the format refuses.
    fn write(&mut self, mesh: usize, frame: &CacheFrame<'_>) -> Result<(), IoError>;

    /// Writes everything.
    ///
    /// # Errors
    /// The disk refuses.
    fn finish(&mut self, file: &mut File) -> Result<(), IoError>;
}

/// A file format. Those that are given but a name, a line and a summary are neither read nor written.
pub struct Format {
    /// File name extension, which is also its word in the scene file.
    pub extension: &'static str,
    /// One line about it.
    pub summary: &'static str,
    /// Whether Blender, Houdini, Maya or other applications load caches in it.
    pub opens_in_applications: bool,
    /// Whether its caches hold whole frames alone, and no samples between them.
    pub whole_frames: bool,
    /// Whether its caches hold points and nothing else, counted from the origin of the world.
    pub holds_points_alone: bool,
    /// Whether it has a place for materials that meshes are bound to, for their purpose, and for whether both sides are rendered.
    pub binds_materials: bool,
    /// Whether a file may be made of others, wherever these lie.
    pub refers_to_others: bool,
    /// Opens meshes, if they are read from it.
    pub open: Option<OpenMesh>,
    /// Reads a channel, if it has such.
    pub channel: Option<ReadChannel>,
    /// Creates a cache, if they are written to it.
    pub create: Option<CreateCache>,
    /// Continues a cache, if they are written to it.
    pub resume: Option<ResumeCache>,
    /// Tells whether a cache can be continued, if they are written to it.
    pub check: Option<CheckCache>,
    /// Opens a cache to be read back, if that is done.
    pub read_back: Option<OpenCache>,
    /// Tells what a file of it holds.
    pub summary_of: Summarise,
    /// The folder beside a cache that holds a part of it, if there is one.
    pub folder_of: Option<fn(&Path) -> PathBuf>,
    /// The file over all caches of a shot, if there is one.
    pub shot: Option<ShotFormat>,
    /// Writes several meshes with all their frames as one file, if that is done.
    pub single: Option<SingleFormat>,
    /// Whether a panic on this thread becomes an error of a file in it, if one ever does.
    pub answers_panics: Option<fn() -> bool>,
}

impl Format {
    const fn new(extension: &'static str, summary: &'static str, summary_of: Summarise) -> Self {
        Self {
            extension,
            summary,
            opens_in_applications: true,
            whole_frames: false,
            holds_points_alone: false,
            binds_materials: false,
            refers_to_others: false,
            open: None,
            channel: None,
            create: None,
            resume: None,
            check: None,
            read_back: None,
            summary_of,
            folder_of: None,
            shot: None,
            single: None,
            answers_panics: None,
        }
    }
}

/// All formats: a room each, with reader, writer, what reads caches back, and summary.
pub static FORMATS: &[Format] = &[
    alembic::FORMAT,
    obj::FORMAT,
    hdf5::FORMAT,
    #[cfg(feature = "usd")]
    usd::USD,
    #[cfg(feature = "usd")]
    usd::USDA,
    #[cfg(feature = "usd")]
    usd::USDC,
    #[cfg(feature = "usd")]
    usd::USDZ,
    point_cache::PC2,
    point_cache::MDD,
];

/// The format with this extension or word.
pub fn by_extension(extension: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.extension.eq_ignore_ascii_case(extension))
}

/// The format of a file, by its extension.
pub fn of_file(path: &Path) -> Option<&'static Format> {
    by_extension(&path.extension()?.to_string_lossy())
}

/// Whether a cache of this name holds whole frames alone.
pub fn holds_whole_frames(cache: &Path) -> bool {
    of_file(cache).is_some_and(|format| format.whole_frames)
}

/// The folder that holds a part of a cache, if its format has one.
pub fn folder_of(cache: &Path) -> Option<PathBuf> {
    of_file(cache)?.folder_of.map(|folder_of| folder_of(cache))
}

/// Removes a folder with all that is in it, if it exists; of a link, the link.
///
/// # Errors
/// The disk refuses.
pub fn remove_folder(path: &Path) -> Result<(), IoError> {
    let removed = match fs::symlink_metadata(path) {
        Ok(about) if about.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) => Err(e),
    };
    match removed {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(IoError::creating(path, e)),
        _ => Ok(()),
    }
}

/// Opens a mesh by the extension of its file.
///
/// # Errors
/// The format is not read here, or its reader fails.
pub fn open_mesh(path: &Path, pattern: Option<&str>) -> Result<Box<dyn MeshReader>, IoError> {
    if let Some(open) = of_file(path).and_then(|format| format.open) {
        return open(path, pattern);
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    Err(IoError::Format {
        path: path.to_owned(),
        what: format!("meshes cannot be read from {}", with_extension(&extension)),
        advice: match extension.to_lowercase().starts_with("usd") {
            // Only a build without USD comes here with it.
            true => "this program was built without USD: use a build with USD (`make build`), or export an .abc".into(),
            false => format!("export it as one of {}", endings(|format| format.open.is_some())),
        },
    })
}

impl CacheFrames {
    /// Opens a cache of any format that is read back, or any stage of USD.
    ///
    /// # Errors
    /// The file is missing, damaged, of another format, or holds no mesh.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        Self::open_as(path, Opening::default())
    }

    /// Opens a cache; of an Alembic file the commit whose tables stand at `root`, if that is given.
    ///
    /// # Errors
    /// As [`CacheFrames::open`].
    pub fn open_at(path: &Path, root: Option<u64>) -> Result<Self, IoError> {
        Self::open_as(path, Opening { root, rate: None })
    }

    /// Opens a cache whose samples have times, those of an Alembic file, and which does not state the rate of its frames.
    ///
    /// # Errors
    /// Errors of [`CacheFrames::open`]; the file states another rate.
    pub fn open_at_rate(path: &Path, frames_per_second: f64) -> Result<Self, IoError> {
        let opened = Self::open_as(path, Opening { root: None, rate: Some(frames_per_second) })?;
        let is_other = |stated: &f64| (stated - frames_per_second).abs() > SAME_RATE * frames_per_second;
        let Some(stated) = opened.stated_fps.filter(is_other) else { return Ok(opened) };
        let what = format!("the frames of this file are at {stated} fps, not at {frames_per_second}");
        let advice = "leave the rate out (`--fps`, `fps=`): another one would change the time of every frame";
        Err(IoError::data(path, "frame rate", what, advice))
    }

    fn open_as(path: &Path, opening: Opening) -> Result<Self, IoError> {
        input_file::open(path)?;
        if let Some(open) = of_file(path).and_then(|format| format.read_back) {
            return open(path, opening);
        }
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        Err(IoError::Format {
            path: path.to_owned(),
            what: format!("{} are not caches", with_extension(&extension)),
            advice: format!("give a file that ends in {}", endings(|format| format.read_back.is_some())),
        })
    }
}

/// Whether a panic on this thread becomes an error of a file, of which somebody tells the user.
pub fn answers_panics() -> bool {
    FORMATS.iter().filter_map(|format| format.answers_panics).any(|answers| answers())
}

/// Matcher of the objects whose path fits a pattern.
fn fitting(path: &Path, pattern: &str) -> Result<GlobMatcher, IoError> {
    let fits = GlobBuilder::new(pattern).literal_separator(false).build().map_err(|error| {
        IoError::data(path, format!("path = \"{pattern}\""), error.to_string(), "write it like /hero/geo/*")
    })?;
    Ok(fits.compile_matcher())
}

/// Extensions of some formats.
pub(crate) fn endings(which: fn(&Format) -> bool) -> String {
    let all: Vec<String> = FORMATS.iter().filter(|f| which(f)).map(|f| format!(".{}", f.extension)).collect();
    all.join(", ")
}

/// Looks into a file.
///
/// # Errors
/// The file is missing, damaged, or of a format that is not read here.
pub fn inspect(path: &Path) -> Result<FileSummary, IoError> {
    input_file::open(path)?;
    if let Some(format) = of_file(path) {
        return (format.summary_of)(path);
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    Err(IoError::Format {
        path: path.to_owned(),
        what: format!("{} cannot be inspected", with_extension(&extension)),
        advice: format!("give a file that ends in {}", endings(|_| true)),
    })
}
