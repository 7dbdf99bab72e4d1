//! Would other applications load these caches, and does cloth pass through cloth? The rules of the hand-off, checked on
//! every frame of Alembic files and USD stages, ours or foreign: finite positions, constant topology, uniform times, velocities per
//! second that agree with the motion, true bounds; and no crossing, of a mesh with itself or with another.

mod applications;
mod attributes;
mod crossings;
mod recorded;
mod stage;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use drapery_alembic::{Archive, PolyMesh, Samples, SamplingKind, TopologyVariance};
use drapery_core::Vec3;
use drapery_io::cache_frames::CacheFrames;
use drapery_io::error::IoError;
use drapery_io::formats;
use drapery_io::input_file;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::manifest::{Manifest, ManifestBody, ManifestGarment};

pub use recorded::recorded;

/// Stored velocities over the motion seen between frames; outside of it the unit is wrong (per frame, say).
const VELOCITY_RATIO: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// Bounds are compared relative to the size of the mesh; positions are f32.
const BOUNDS_TOLERANCE: f64 = 1e-5;

/// Findings in a cache.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Verification {
    /// Facts that are good to know.
    pub facts: Vec<String>,
    /// Properties with which some application may have trouble.
    pub warnings: Vec<String>,
    /// Rules that are broken; at most one message a rule and object.
    pub failures: Vec<String>,
}

/// An opened file.
#[derive(Default)]
struct Cache {
    /// Start of its messages; empty when there is one file only.
    prefix: String,
    meshes: Vec<PolyMesh>,
    /// A stage of USD, which holds no archive's meshes.
    stage: Option<CacheFrames>,
    fps: Option<f64>,
    /// The file's name.
    file: String,
    /// Garments of the run in whose folder the file lies, if it lies in one.
    run: Option<Rc<RunGarments>>,
}

/// Garments of a run, as its manifest has them.
#[derive(Debug, PartialEq)]
struct RunGarments {
    garments: Vec<ManifestGarment>,
    bodies: Vec<ManifestBody>,
    ignored: Vec<[String; 2]>,
}

impl RunGarments {
    /// The objects of the run in a folder, if it holds one with bodies or with garments that ignore each other.
    fn read(folder: &Path) -> Option<Self> {
        let Manifest { garments, bodies, ignored, .. } = RunFolder::read(folder).ok()?.manifest;
        (!ignored.is_empty() || !bodies.is_empty()).then_some(Self { garments, bodies, ignored })
    }

    /// Whether two garments or parts pass through each other.
    fn ignore_each_other(&self, a: &str, b: &str) -> bool {
        self.ignored.iter().any(|[one, other]| (one == a && other == b) || (one == b && other == a))
    }
}

impl Cache {
    /// The run that wrote a mesh with this path, and its garment there.
    fn garment_of(&self, path: &str) -> Option<(&RunGarments, &ManifestGarment)> {
        let run = self.run.as_deref()?;
        let holds = |garment: &&ManifestGarment| garment.files.contains(&self.file);
        let is_named = |garment: &&ManifestGarment| {
            path.ends_with(&garment.object_path) || path.split('/').any(|name| name == garment.name)
        };
        // A file of one garment, or one over all of them.
        let found = run.garments.iter().find(holds).or_else(|| run.garments.iter().find(is_named))?;
        Some((run, found))
    }

    /// Whether a run wrote it of a body.
    fn is_of_body(&self) -> bool {
        self.run.as_deref().is_some_and(|run| run.bodies.iter().any(|body| body.files.contains(&self.file)))
    }

    fn name_of(&self, mesh: &PolyMesh) -> String {
        format!("{}{}", self.prefix, mesh.object().path())
    }
}

/// Checks every frame of caches that belong together, such as all garments of a shot, and counts where they cross the
/// mesh in the file `body`, if one is given, in the caches' unit.
///
/// # Errors
/// A file is missing or cannot be read as a whole. A damaged sample of a cache is a failure, not an error.
pub fn verify(paths: &[&Path], body: Option<&Path>) -> Result<Verification, IoError> {
    let mut found = Verification::default();
    let mut caches = Vec::new();
    let mut runs: BTreeMap<PathBuf, Option<Rc<RunGarments>>> = BTreeMap::new();
    for path in paths {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let run = runs.entry(folder.to_owned()).or_insert_with(|| RunGarments::read(folder).map(Rc::new));
        let cache = verify_file(path, prefix_of(path, paths), &mut found)?;
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        caches.push(Cache { run: run.clone(), file, ..cache });
    }
    let body = body.map(|path| formats::open_mesh(path, None)).transpose()?;
    crossings::check(&caches, body.as_deref(), &mut found)?;
    Ok(found)
}

/// Returns the prefix that tells a file from the others in a message: nothing, its name, or its whole path.
fn prefix_of(path: &Path, all: &[&Path]) -> String {
    match all.iter().filter(|other| other.file_name() == path.file_name()).count() {
        _ if all.len() == 1 => String::new(),
        1 => format!("{}: ", path.file_name().unwrap_or_default().display()),
        _ => format!("{}: ", path.display()),
    }
}

/// Opens a file and checks the rules that concern it alone.
fn verify_file(path: &Path, prefix: String, found: &mut Verification) -> Result<Cache, IoError> {
    input_file::open(path)?;
    if path.extension().is_some_and(|extension| extension.to_string_lossy().to_lowercase().starts_with("usd")) {
        return stage::verify_file(path, prefix, found);
    }
    let archive = Archive::open(path)?;
    let meshes = PolyMesh::all(&archive)?;
    if meshes.is_empty() {
        found.failures.push(format!("{prefix}the file contains no mesh"));
    }
    if archive.bounds()?.is_none_or(|samples| samples.is_empty()) {
        found.warnings.push(format!("{prefix}the archive stores no bounds of all its objects (.childBnds)"));
    }
    let fps = archive.frames_per_second_hint();
    if fps.is_none() {
        found.warnings.push(format!("{prefix}the archive states no frame rate; set it in the application"));
    }
    let cache = Cache { meshes, fps, prefix, ..Cache::default() };
    found.facts.extend(applications::of_archive(&archive, &cache.meshes, &cache.prefix));
    for mesh in &cache.meshes {
        verify_mesh(mesh, &cache.name_of(mesh), fps, found);
    }
    Ok(cache)
}

fn verify_mesh(mesh: &PolyMesh, path: &str, fps: Option<f64>, found: &mut Verification) {
    let mut check = MeshCheck { mesh, path, found, motion: Motion::default() };
    if mesh.sample_count() == 0 {
        return check.fail("it has no samples");
    }
    check.times(fps);
    check.topology();
    check.samples();
    check.velocities();
    check.attributes();
}

/// The checks of one mesh.
struct MeshCheck<'a> {
    mesh: &'a PolyMesh,
    path: &'a str,
    found: &'a mut Verification,
    motion: Motion,
}

/// Sums over all vertices and frames: stored velocity against the motion between the frames around.
#[derive(Default)]
struct Motion {
    stored_by_seen: f64,
    seen_by_seen: f64,
    compared: usize,
}

impl MeshCheck<'_> {
    fn fail(&mut self, what: impl std::fmt::Display) {
        self.found.failures.push(format!("{}: {what}", self.path));
    }

    fn warn(&mut self, what: impl std::fmt::Display) {
        self.found.warnings.push(format!("{}: {what}", self.path));
    }

    fn times(&mut self, fps: Option<f64>) {
        let (mesh, count) = (self.mesh, self.mesh.sample_count());
        let (first, last) = (mesh.time(0), mesh.time(count - 1));
        let frame = |time: f64| fps.map_or(String::new(), |fps| format!(" = frame {:.3}", time * fps));
        let range = format!("{first:.6} s{} to {last:.6} s{}", frame(first), frame(last));
        self.found.facts.push(format!("{}: {count} samples, {range}", self.path));
        match mesh.time_sampling().kind() {
            SamplingKind::Acyclic if count > 1 => {
                self.fail("samples are not evenly spaced in time; write one sample a frame");
            }
            SamplingKind::Cyclic => self.warn("several samples a frame; some applications use the first only"),
            _ => {}
        }
        if count > 2 && first == 0.0 && mesh.time(1) > 2.0 * (mesh.time(2) - mesh.time(1)) {
            self.fail("a lone sample at time 0 comes before the shot; importers fill the gap with frames");
        }
    }

    fn topology(&mut self) {
        if self.mesh.topology_variance() == TopologyVariance::Heterogeneous {
            self.fail("the topology changes between samples; caches need the same points and faces in every frame");
        }
        match self.mesh.faces(0) {
            Err(error) => self.fail(error),
            Ok(faces) if faces.face_counts.is_empty() => self.fail("it has no faces"),
            Ok(faces) => {
                let large = faces.face_counts.iter().filter(|&&count| count > 4).count();
                if large > 0 {
                    self.warn(format_args!("{large} faces have more than 4 corners, which some game engines refuse"));
                }
                if faces.face_counts.iter().any(|&count| count < 3) {
                    self.fail("some faces have fewer than 3 corners");
                }
                self.uvs(faces.face_indices.len());
            }
        }
    }

    fn uvs(&mut self, corners: usize) {
        let Some(uv) = self.mesh.uv() else { return };
        match uv.expanded::<f32, 2>(0) {
            Err(error) => self.fail(error),
            Ok(values) if uv.scope() == drapery_alembic::Scope::FaceVarying && values.len() != corners => {
                self.fail(format_args!("{} UVs for {corners} face corners", values.len()));
            }
            Ok(_) => {}
        }
    }

    /// Positions and bounds of every sample, and the sums for the velocities.
    fn samples(&mut self) {
        let (mesh, count) = (self.mesh, self.mesh.sample_count());
        let mut recent: Vec<Vec<[f32; 3]>> = Vec::new();
        let (mut bad_bounds, mut without_bounds) = (false, false);
        for sample in 0..count {
            let positions = match mesh.positions(sample) {
                Ok(positions) => positions,
                Err(error) => return self.fail(error),
            };
            if let Some(vertex) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
                return self
                    .fail(format_args!("sample {sample}, vertex {vertex}: the position is not a finite number"));
            }
            if recent.last().is_some_and(|before| before.len() != positions.len()) {
                return self.fail(format_args!("sample {sample}: the number of points changes to {}", positions.len()));
            }
            if positions.is_empty() {
                return self.fail(format_args!("sample {sample} has no points"));
            }
            match mesh.bounds(sample) {
                Err(error) => return self.fail(error),
                Ok(None) => without_bounds = true,
                Ok(Some(bounds)) if !bad_bounds && !fits(&bounds, &positions) => {
                    bad_bounds = true;
                    self.fail(format_args!("sample {sample}: the stored bounds do not match the points"));
                }
                Ok(Some(_)) => {}
            }
            recent.push(positions);
            if let [before, _, after] = recent.as_slice() {
                self.motion.add(mesh, sample - 1, before, after);
                recent.remove(0);
            }
        }
        if without_bounds {
            self.fail("bounds (.selfBnds) are missing");
        }
    }

    fn velocities(&mut self) {
        let mesh = self.mesh;
        let stored = mesh.geom().samples(".velocities").filter(|samples| !samples.is_empty());
        let Some(stored) = stored.map(Samples::len) else {
            if mesh.topology_variance() != TopologyVariance::Constant {
                self.warn("no velocities: motion blur can only come from neighbouring samples");
            }
            return;
        };
        if stored != mesh.sample_count() {
            self.fail(format_args!("velocities in {stored} samples, positions in {}", mesh.sample_count()));
        }
        for sample in 0..mesh.sample_count() {
            match mesh.velocities(sample) {
                Ok(Some(values)) if values.iter().flatten().all(|x| x.is_finite()) => {}
                Ok(Some(_)) => return self.fail(format_args!("sample {sample}: a velocity is not a finite number")),
                Ok(None) => {
                    let what = "the number of velocities differs from the number of points";
                    return self.fail(format_args!("sample {sample}: {what}"));
                }
                Err(error) => return self.fail(error),
            }
        }
        self.motion.judge(self.path, self.found);
    }
}

impl Motion {
    /// Says what the velocities of a mesh are to its motion.
    fn judge(&self, path: &str, found: &mut Verification) {
        if self.compared == 0 || self.seen_by_seen == 0.0 {
            return;
        }
        let ratio = self.stored_by_seen / self.seen_by_seen;
        found.facts.push(format!("{path}: velocities are {ratio:.3} times the motion between frames"));
        if !VELOCITY_RATIO.contains(&ratio) {
            let what = format!("velocities are {ratio:.4} times the motion; they have to be per second, in file units");
            found.failures.push(format!("{path}: {what}"));
        }
    }

    /// Adds sample `index`, whose neighbours are given. A sample without fitting velocities is reported elsewhere.
    fn add(&mut self, mesh: &PolyMesh, index: usize, before: &[[f32; 3]], after: &[[f32; 3]]) {
        let span = mesh.time(index + 1) - mesh.time(index - 1);
        let Ok(Some(velocities)) = mesh.velocities(index) else { return };
        self.compare(&velocities, [before, after], span);
    }

    /// Adds velocities and the positions before and after them, which lie so far apart in time [s].
    fn compare(&mut self, velocities: &[[f32; 3]], [before, after]: [&[[f32; 3]]; 2], span: f64) {
        for ((v, p), q) in velocities.iter().zip(before).zip(after) {
            let vector = |x: &[f32; 3]| Vec3::from(x.map(f64::from));
            let seen = (vector(q) - vector(p)) / span;
            self.stored_by_seen += vector(v).dot(&seen);
            self.seen_by_seen += seen.norm_squared();
        }
        self.compared += 1;
    }
}

fn fits(bounds: &[f64; 6], positions: &[[f32; 3]]) -> bool {
    let size = bounds.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    (0..3).all(|axis| {
        let coordinates = || positions.iter().map(|p| f64::from(p[axis]));
        let low = coordinates().fold(f64::INFINITY, f64::min);
        let high = coordinates().fold(f64::NEG_INFINITY, f64::max);
        let near = |a: f64, b: f64| (a - b).abs() <= BOUNDS_TOLERANCE * size;
        near(bounds[axis], low) && near(bounds[axis + 3], high)
    })
}
