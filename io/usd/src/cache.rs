//! Caches as [`crate::write`] lays them out, read back frame by frame.
//!
//! Layers are read one at a time and nothing is composed: values come as they are stored, and only one clip is in memory. A
//! cache that is being written may be read; its layer names complete frames only. Other stages are read by [`crate::read`].

use std::collections::HashMap;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use openusd::ar::{AssetBuffer, SharedBuffer};
use openusd::sdf::{self, AbstractData, Value};
use openusd::{usda, usdc};

use crate::read::promises;
use crate::write::{CacheLayer, NORMAL_INDICES, primvar_of};

/// Largest layer of text that is taken for one of ours [bytes]: far more than a million frames need.
const LARGEST_LAYER: u64 = 1 << 30;

/// Why a cache, or a frame of it, could not be read.
#[derive(Debug, thiserror::Error)]
pub enum CacheError {
    /// A file of the cache cannot be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// A file of the cache is not what it was.
    #[error("{}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Description of the fault.
        what: String,
    },
    /// A stage that another program made.
    #[error("{}: not a Drapery cache: {what}", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
        /// Feature of a cache that is missing.
        what: &'static str,
    },
}

/// A cache.
#[derive(Debug)]
pub struct Cache {
    path: PathBuf,
    folder: PathBuf,
    mesh: sdf::Path,
    /// Provenance that the layer states: how it was made.
    pub properties: Vec<(String, String)>,
    /// Length of one unit [m].
    pub metres_per_unit: f64,
    /// Whether Z is up.
    pub z_up: bool,
    /// Frames a second.
    pub fps: f64,
    /// Complete frames, ascending.
    pub frames: Vec<i64>,
    /// Time codes of the samples between frames, ascending.
    pub between: Vec<f64>,
    /// Clips of the frames, then of the samples between them.
    clips: Vec<PathBuf>,
    /// Everything that does not move.
    pub still: Still,
}

/// Data that do not move.
#[derive(Debug, Default)]
pub struct Still {
    /// Origin that positions are counted from.
    pub origin: [f64; 3],
    /// Number of corners of each face.
    pub face_counts: Vec<u32>,
    /// Point of each corner, counter-clockwise.
    pub face_indices: Vec<u32>,
    /// The triangles that were simulated, if they are not just the faces.
    pub triangles: Option<Vec<[i32; 3]>>,
    /// Number of the normal of each corner, where hard edges split them.
    pub normal_indices: Option<Vec<u32>>,
    /// Words for the attributes at the points that are this program's.
    pub attributes: Option<String>,
    /// Primvars of vectors at the points that do not move.
    pub vectors: HashMap<String, Vec<[f32; 3]>>,
    /// Primvars of numbers at the points that do not move.
    pub numbers: HashMap<String, Vec<f32>>,
}

/// A frame.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct Frame {
    /// Positions, counted from the origin of the cache.
    pub points: Vec<[f32; 3]>,
    /// Velocities per second.
    pub velocities: Option<Vec<[f32; 3]>>,
    /// Normals at the points, or at the corners where hard edges split them.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Smallest and largest coordinates, as they are stored.
    pub extent: Vec<[f32; 3]>,
    /// Crossings of the shot.
    pub crossings: Option<u32>,
    /// Numbers at the points, by their names.
    pub numbers: HashMap<String, Vec<f32>>,
}

impl Cache {
    /// Opens the layer of a garment's cache, and what of it does not move.
    ///
    /// # Errors
    /// It is missing, damaged, or the layer of another program.
    pub fn open(path: &Path) -> Result<Self, CacheError> {
        let layer = read_text_layer(path)?;
        let not_ours = |what| CacheError::NotOurs { path: path.to_owned(), what };
        let root = sdf::Path::abs_root();
        let field =
            |at: &sdf::Path, name: &str| layer.try_field(at, name).ok().flatten().map(|value| value.into_owned());
        let ours = match field(&root, "customLayerData") {
            Some(Value::Dictionary(mut custom)) => custom.remove("drapery"),
            _ => None,
        };
        let Some(Value::Dictionary(ours)) = ours else {
            return Err(not_ours("its customLayerData has no entry `drapery`"));
        };
        let topology = match field(&root, "subLayers") {
            Some(Value::StringVec(layers)) => layers.into_iter().next(),
            Some(Value::AssetPathVec(layers)) => layers.into_iter().next().map(|asset| asset.authored_path),
            _ => None,
        };
        let topology = topology.ok_or_else(|| not_ours("it has no topology"))?;
        let base = path.parent().unwrap_or(Path::new("."));
        let folder = base.join(&topology).parent().unwrap_or(base).to_owned();
        let Some(Value::Token(prim)) = field(&root, "defaultPrim") else {
            return Err(not_ours("it has no defaultPrim"));
        };
        let clips = sdf::Path::new(&format!("/{prim}")).ok().and_then(|prim| match field(&prim, "clips") {
            Some(Value::Dictionary(mut sets)) => sets.remove("default"),
            _ => None,
        });
        let Some(Value::Dictionary(clips)) = clips else { return Err(not_ours("it has no clips")) };
        let Samples { frames, between, clips } = samples_of(path, base, &clips)?;
        let (mesh, still) = read_topology(&base.join(&topology))?;
        let number = |name: &str, otherwise: f64| match field(&root, name) {
            Some(Value::Double(number)) => number,
            _ => otherwise,
        };
        let mut properties: Vec<(String, String)> = ours
            .into_iter()
            .filter_map(|(name, value)| if let Value::String(text) = value { Some((name, text)) } else { None })
            .collect();
        properties.sort();
        Ok(Self {
            path: path.to_owned(),
            folder,
            mesh,
            properties,
            metres_per_unit: number("metersPerUnit", 0.01),
            z_up: matches!(field(&root, "upAxis"), Some(Value::Token(up)) if up == "Z"),
            fps: number("timeCodesPerSecond", 24.0),
            frames,
            between,
            clips,
            still,
        })
    }

    /// Path of the mesh.
    pub fn mesh_path(&self) -> &str {
        self.mesh.as_str()
    }

    /// The layer.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The bytes of what does not move, and the name of its folder, which is the start of their digest.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn topology(&self) -> Result<(Vec<u8>, String), CacheError> {
        let path = self.folder.join(CacheLayer::TOPOLOGY);
        let bytes = fs::read(&path).map_err(|source| CacheError::Io { path, source })?;
        Ok((bytes, self.folder.file_name().unwrap_or_default().to_string_lossy().into_owned()))
    }

    /// Reads a frame by its place in [`Cache::frames`], or, behind the last of these, a sample by its place in [`Cache::between`].
    ///
    /// # Errors
    /// Its clip is missing or damaged.
    pub fn frame(&self, index: usize) -> Result<Frame, CacheError> {
        let path = &self.clips[index];
        let damaged = |what: String| CacheError::Damaged { path: path.clone(), what };
        let layer = read_binary_layer(path)?;
        let time = match index.checked_sub(self.frames.len()) {
            None => self.frames[index] as f64,
            Some(index) => self.between[index],
        };
        let sample = |name: &str| -> Result<Option<Value>, CacheError> {
            let attribute = self.mesh.append_property(name).map_err(|e| damaged(e.to_string()))?;
            match layer.try_field(&attribute, "timeSamples").map_err(|e| damaged(with_sources(&e)))? {
                None => Ok(None),
                Some(samples) => match samples.into_owned() {
                    Value::TimeSamples(mut samples) if samples.len() == 1 && samples[0].0 == time => {
                        Ok(samples.pop().map(|(_, value)| value))
                    }
                    _ => Err(damaged(format!("{name} has no sample at frame {time}, or has others"))),
                },
            }
        };
        let vectors = |name: &str| -> Result<Option<Vec<[f32; 3]>>, CacheError> {
            match sample(name)? {
                None => Ok(None),
                Some(Value::Vec3fVec(all)) => Ok(Some(all.into_iter().map(<[f32; 3]>::from).collect())),
                Some(_) => Err(damaged(format!("{name} are not vectors"))),
            }
        };
        let points = vectors("points")?.ok_or_else(|| damaged("it holds no points".to_owned()))?;
        let velocities = vectors("velocities")?;
        if velocities.as_ref().is_some_and(|all| all.len() != points.len()) {
            return Err(damaged("the number of velocities differs from the number of points".to_owned()));
        }
        let normals = vectors("normals")?;
        let (places, what) = match &self.still.normal_indices {
            Some(corners) => (corners.len(), "face corners"),
            None => (points.len(), "points"),
        };
        if normals.as_ref().is_some_and(|all| all.len() != places) {
            return Err(damaged(format!("the number of normals differs from the number of {what}")));
        }
        let crossings = match sample("drapery:crossings")? {
            Some(Value::Uint(count)) => Some(count),
            _ => None,
        };
        let mut numbers = HashMap::new();
        for word in self.still.attributes.iter().flat_map(|words| words.split(' ')) {
            if let Some(Value::FloatVec(all)) = sample(&primvar_of(word))? {
                if all.len() != points.len() {
                    return Err(damaged(format!("{word} has {} values for {} points", all.len(), points.len())));
                }
                numbers.insert(word.to_owned(), all);
            }
        }
        Ok(Frame { points, velocities, normals, extent: vectors("extent")?.unwrap_or_default(), crossings, numbers })
    }
}

/// Samples that a cache has.
struct Samples {
    frames: Vec<i64>,
    between: Vec<f64>,
    clips: Vec<PathBuf>,
}

/// Frames, samples between them and the clips of all, from the description of the clips.
fn samples_of(path: &Path, base: &Path, clips: &HashMap<String, Value>) -> Result<Samples, CacheError> {
    let damaged = |what: &str| CacheError::Damaged { path: path.to_owned(), what: what.to_owned() };
    let Some(Value::AssetPathVec(assets)) = clips.get("assetPaths") else {
        return Err(damaged("its clips have no assetPaths"));
    };
    let Some(Value::Vec2dVec(active)) = clips.get("active") else { return Err(damaged("its clips have no times")) };
    let in_order = active.iter().enumerate().all(|(index, time)| time.x.is_finite() && time.y == index as f64)
        && active.windows(2).all(|pair| pair[0].x < pair[1].x);
    let samples = active.iter().zip(assets).map(|(time, asset)| (time.x, base.join(&asset.authored_path)));
    let (whole, others): (Vec<_>, Vec<_>) = samples.partition(|(time, _)| time.fract() == 0.0);
    let (frames, mut clips): (Vec<i64>, Vec<PathBuf>) =
        whole.into_iter().map(|(time, clip)| (time as i64, clip)).unzip();
    let (between, clips_between): (Vec<f64>, Vec<PathBuf>) = others.into_iter().unzip();
    clips.extend(clips_between);
    if frames.is_empty() || active.len() != assets.len() || !in_order {
        return Err(damaged("its clips and their times do not match"));
    }
    Ok(Samples { frames, between, clips })
}

/// Reads the data that do not move, and the path of the mesh.
fn read_topology(path: &Path) -> Result<(sdf::Path, Still), CacheError> {
    let damaged = |what: String| CacheError::Damaged { path: path.to_owned(), what };
    let layer = read_binary_layer(path)?;
    let paths = layer.spec_paths();
    let kind = |prim: &sdf::Path| match layer.try_field(prim, "typeName") {
        Ok(Some(value)) => match value.into_owned() {
            Value::Token(kind) => kind.to_string(),
            _ => String::new(),
        },
        _ => String::new(),
    };
    let mesh = paths.iter().find(|path| path.is_prim_path() && kind(path) == "Mesh").cloned();
    let mesh = mesh.ok_or_else(|| damaged("it contains no mesh".to_owned()))?;
    let default = |prim: &sdf::Path, name: &str| -> Result<Option<Value>, CacheError> {
        let attribute = prim.append_property(name).map_err(|e| damaged(e.to_string()))?;
        let value = layer.try_field(&attribute, "default").map_err(|e| damaged(with_sources(&e)))?;
        Ok(value.map(|value| value.into_owned()))
    };
    let whole = |name: &str| -> Result<Vec<u32>, CacheError> {
        let numbers = match default(&mesh, name)? {
            Some(Value::IntVec(numbers)) => numbers,
            _ => return Err(damaged(format!("it has no {name}"))),
        };
        numbers
            .into_iter()
            .map(|number| u32::try_from(number).map_err(|_| damaged(format!("{name} holds {number}"))))
            .collect()
    };
    let (face_counts, face_indices) = (whole("faceVertexCounts")?, whole("faceVertexIndices")?);
    if face_counts.iter().map(|count| u64::from(*count)).sum::<u64>() != face_indices.len() as u64 {
        return Err(damaged("its faceVertexCounts and faceVertexIndices do not match".to_owned()));
    }
    let normal_indices = default(&mesh, NORMAL_INDICES.0)?.map(|_| whole(NORMAL_INDICES.0)).transpose()?;
    let mut still = Still { face_counts, face_indices, normal_indices, ..Still::default() };
    for prim in mesh.ancestors_below_root() {
        if let Some(Value::Vec3d(by)) = default(&prim, "xformOp:translate")? {
            let by = <[f64; 3]>::from(by);
            still.origin = std::array::from_fn(|axis| still.origin[axis] + by[axis]);
        }
    }
    if let Some(Value::Vec3iVec(triangles)) = default(&mesh, "drapery:triangles")? {
        still.triangles = Some(triangles.into_iter().map(Into::into).collect());
    }
    if let Some(Value::String(words)) = default(&mesh, "drapery:attributes")? {
        for word in words.split(' ') {
            match default(&mesh, &primvar_of(word))? {
                Some(Value::Vec3fVec(all)) => {
                    still.vectors.insert(word.to_owned(), all.into_iter().map(<[f32; 3]>::from).collect());
                }
                Some(Value::FloatVec(all)) => drop(still.numbers.insert(word.to_owned(), all)),
                _ => {}
            }
        }
        still.attributes = Some(words);
    }
    Ok((mesh, still))
}

fn read_text_layer(path: &Path) -> Result<sdf::Data, CacheError> {
    let failed = |source| CacheError::Io { path: path.to_owned(), source };
    let not_ours = |what| CacheError::NotOurs { path: path.to_owned(), what };
    if fs::metadata(path).map_err(failed)?.len() > LARGEST_LAYER {
        return Err(not_ours("it is too large for one"));
    }
    let mut start = Vec::new();
    fs::File::open(path).map_err(failed)?.take(5).read_to_end(&mut start).map_err(failed)?;
    if start != *b"#usda" {
        return Err(not_ours("not a text layer"));
    }
    let text = String::from_utf8(fs::read(path).map_err(failed)?).map_err(|_| not_ours("not text"))?;
    let damaged = |what: String| CacheError::Damaged { path: path.to_owned(), what };
    if let Some(what) = promises::problem(&SharedBuffer::new(text.clone().into_bytes())) {
        return Err(damaged(what));
    }
    usda::parse(&text).map_err(|e| damaged(with_sources(&e)))
}

fn read_binary_layer(path: &Path) -> Result<usdc::CrateData, CacheError> {
    let failed = |source| CacheError::Io { path: path.to_owned(), source };
    // Before it is opened: to open a pipe waits for a writer, and a device may have no end.
    if !fs::metadata(path).map_err(failed)?.is_file() {
        return Err(CacheError::Damaged { path: path.to_owned(), what: "not a file".to_owned() });
    }
    let bytes = fs::read(path).map_err(failed)?;
    let damaged = |what: String| CacheError::Damaged { path: path.to_owned(), what };
    let shared = SharedBuffer::new(bytes);
    if let Some(what) = promises::problem(&shared) {
        return Err(damaged(what));
    }
    usdc::CrateData::open(AssetBuffer::Shared(shared), true).map_err(|e| damaged(with_sources(&e)))
}

/// An error with all that it comes from.
fn with_sources(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text = format!("{text}: {error}");
        source = error.source();
    }
    text
}
