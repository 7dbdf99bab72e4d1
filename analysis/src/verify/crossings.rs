//! Does cloth pass through cloth? Exactly, on the stored positions, in every frame.
//!
//! Each mesh against itself, and against every other of all files given. What render meshes cross is reported and not judged:
//! they are no cloth, but follow it. Positions are taken as they are stored, so nothing is rounded; only meshes under different
//! transforms have to be brought together in the world, where their points are rounded as `f64`. Faces are cut into the triangles
//! that were simulated where the file tells them, and otherwise by the solver's rule at the first sample.

use std::collections::BTreeMap;

use drapery_alembic::{IDENTITY, Matrix, PolyMesh, TopologyVariance, transform_point};
use drapery_core::Vec3;
use drapery_core::geometry::crossings::{Crossing, CrossingSearch, find, find_between};
use drapery_io::cache_frames::{CacheFrames, triangles_of};
use drapery_io::error::IoError;
use drapery_io::formats::alembic::{render_mesh_of, sample_times};
use drapery_io::mesh_data::MeshReader;

use super::{Cache, Verification};

/// Sample times closer than this are one time [s]: programs round frame / fps differently.
const SAME_TIME: f64 = 1e-5;

/// Checks all meshes of all files against themselves and one another, and counts where they cross a body.
pub(super) fn check(caches: &[Cache], body: Option<&dyn MeshReader>, found: &mut Verification) -> Result<(), IoError> {
    let mut sheets = Vec::new();
    for cache in caches {
        sheets.extend(cache.meshes.iter().filter_map(|mesh| Sheet::open(cache, mesh)));
        if let Some(stage) = &cache.stage {
            sheets.extend((0..stage.meshes().len()).filter_map(|mesh| Sheet::of_stage(cache, stage, mesh)));
        }
    }
    let mut body = body.map(Body::open).transpose()?;
    let fps = caches.iter().find_map(|cache| cache.fps);
    let mut tallies = Tallies::default();
    for time in all_times(&sheets) {
        let frame = match fps {
            Some(fps) => format!("frame {}", (time * fps * 1e3).round() / 1e3),
            None => format!("{time:.6} s"),
        };
        check_moment(&mut sheets, body.as_mut(), (time, &frame), &mut tallies)?;
    }
    report(&sheets, &tallies, found);
    Ok(())
}

/// A mesh whose samples are looked at.
struct Sheet<'a> {
    name: String,
    mesh: Mesh<'a>,
    search: CrossingSearch,
    /// Times at which it or a parent is stored [s]; empty when nothing moves.
    times: Vec<f64>,
    /// The garment that it follows to be rendered in its place: it is no cloth, and may go through itself.
    render_mesh_of: Option<String>,
    /// What it is for, if not for everything.
    purpose: Option<String>,
}

/// Where samples come from.
#[derive(Clone, Copy)]
enum Mesh<'a> {
    Archive(&'a PolyMesh),
    /// A mesh of a stage, by its place.
    Stage(StageMesh<'a>),
}

/// A mesh of a stage.
#[derive(Clone, Copy)]
struct StageMesh<'a> {
    stage: &'a CacheFrames,
    mesh: usize,
    /// Time of a frame [s].
    duration: f64,
    /// What its stored points are counted from, where that never changes; points in the world are looked at otherwise.
    origin: Option<[f64; 3]>,
}

impl StageMesh<'_> {
    fn points(&self, sample: usize) -> Option<Vec<Vec3>> {
        if self.origin.is_none() {
            return self.stage.world_positions(self.mesh, sample).ok();
        }
        let stored = self.stage.stored_positions(self.mesh, sample).ok()??;
        Some(stored.points.into_iter().map(|p| Vec3::from(p.map(f64::from))).collect())
    }
}

impl Mesh<'_> {
    /// Stored positions, none if they cannot be read or are not numbers.
    fn stored(self, sample: usize) -> Option<Vec<Vec3>> {
        let points = match self {
            Self::Archive(mesh) => {
                mesh.positions(sample).ok()?.into_iter().map(|p| Vec3::from(p.map(f64::from))).collect()
            }
            Self::Stage(mesh) => mesh.points(sample)?,
        };
        points.iter().flatten().all(|x| x.is_finite()).then_some(points)
    }

    /// The sample at a time [s], if there is one.
    fn sample_at(self, time: f64) -> Option<usize> {
        match self {
            Self::Archive(mesh) => {
                // What does not move is there at any time.
                let is_still = mesh.topology_variance() == TopologyVariance::Constant;
                let sample = mesh.time_sampling().near_index(time, mesh.sample_count());
                (is_still || (mesh.time(sample) - time).abs() < SAME_TIME).then_some(sample)
            }
            Self::Stage(StageMesh { stage, mesh, .. }) if !stage.moves(mesh) => Some(0),
            Self::Stage(StageMesh { stage, mesh, duration, .. }) => {
                let frames = &stage.meshes()[mesh].frames;
                frames.iter().position(|frame| (*frame as f64 * duration - time).abs() < SAME_TIME)
            }
        }
    }

    /// From what is stored to the world.
    fn world_matrix_at(self, time: f64) -> Result<Matrix, IoError> {
        match self {
            Self::Archive(mesh) => Ok(mesh.world_matrix_at(time)?),
            Self::Stage(StageMesh { origin, .. }) => {
                let mut matrix = IDENTITY;
                matrix[12..15].copy_from_slice(&origin.unwrap_or_default());
                Ok(matrix)
            }
        }
    }

    /// Time of the first sample [s].
    fn start(self) -> f64 {
        match self {
            Self::Archive(mesh) => mesh.time(0),
            Self::Stage(StageMesh { stage, mesh, duration, .. }) => stage.meshes()[mesh].frames[0] as f64 * duration,
        }
    }
}

impl<'a> Sheet<'a> {
    /// `None` for a mesh without a first sample or with changing topology, which break other rules.
    fn open(cache: &Cache, mesh: &'a PolyMesh) -> Option<Self> {
        if mesh.topology_variance() == TopologyVariance::Heterogeneous {
            return None;
        }
        let points = Mesh::Archive(mesh).stored(0)?;
        let triangles = triangles_of(mesh, &points)?;
        let times = sample_times(std::slice::from_ref(mesh)).ok()?;
        let search = CrossingSearch::new(triangles, points);
        let render_mesh_of = render_mesh_of(mesh);
        Some(Self {
            name: cache.name_of(mesh),
            mesh: Mesh::Archive(mesh),
            search,
            times,
            render_mesh_of,
            purpose: None,
        })
    }

    /// A mesh of a stage; `None` if its first frame cannot be read, which breaks other rules.
    fn of_stage(cache: &Cache, stage: &'a CacheFrames, mesh: usize) -> Option<Self> {
        let described = &stage.meshes()[mesh];
        // Guides are no surfaces that anybody sees.
        if stage.purpose(mesh) == Some("guide") {
            return None;
        }
        let duration = 1.0 / cache.fps?;
        let origin = stage.stored_positions(mesh, 0).ok()?.map(|stored| stored.origin);
        let points = Mesh::Stage(StageMesh { stage, mesh, duration, origin });
        let search = CrossingSearch::new(described.triangles.clone(), points.stored(0)?);
        let shown = if stage.moves(mesh) { described.frames.as_slice() } else { &[] };
        let times = shown.iter().map(|frame| *frame as f64 * duration).collect();
        let name = format!("{}{}", cache.prefix, described.name);
        let render_mesh_of = stage.attributes(mesh).ok()?.render_mesh_of;
        let purpose = stage.purpose(mesh).map(str::to_owned);
        Some(Self { name, mesh: points, search, times, render_mesh_of, purpose })
    }

    /// Takes the positions stored at a time; whether there are any.
    fn place(&mut self, time: f64) -> bool {
        let count = self.search.surface().positions.len();
        let stored = self.mesh.sample_at(time).and_then(|sample| self.mesh.stored(sample));
        match stored.filter(|points| points.len() == count) {
            Some(points) => {
                self.search.place(points);
                true
            }
            None => false,
        }
    }

    /// Takes its positions into the world.
    fn transform(&mut self, matrix: &Matrix) {
        let local = self.search.surface().positions.to_vec();
        self.search.place(local.into_iter().map(|p| Vec3::from(transform_point(p.into(), matrix))));
    }
}

/// A body, in the world and at any time.
struct Body<'a> {
    reader: &'a dyn MeshReader,
    search: CrossingSearch,
    points: Vec<Vec3>,
}

impl<'a> Body<'a> {
    fn open(reader: &'a dyn MeshReader) -> Result<Self, IoError> {
        let first = reader.sample_times().first().copied().unwrap_or(0.0);
        let mesh = reader.mesh_at(first)?.mesh;
        Ok(Self { reader, search: CrossingSearch::new(mesh.triangulate().0, mesh.points), points: Vec::new() })
    }

    fn place(&mut self, time: f64) -> Result<(), IoError> {
        self.reader.positions_at(time, &mut self.points)?;
        self.search.place(self.points.iter().copied());
        Ok(())
    }
}

/// What is checked: a mesh with itself (`a == b`), with another, or with the body.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Subject {
    Cloth(usize, usize),
    Body(usize),
}

/// What was found about one subject in all frames.
#[derive(Default)]
struct Tally {
    looked_at: usize,
    frames: usize,
    /// Largest number of crossings in one frame, and that frame.
    worst: (usize, String),
    /// The first crossing, in words.
    first: String,
}

type Tallies = BTreeMap<Subject, Tally>;

impl Tally {
    /// Adds a frame; `words` describes a crossing by the names of the meshes of its edge and its triangle.
    fn add(&mut self, frame: &str, lists: &[(&[Crossing], [&str; 2])]) {
        self.looked_at += 1;
        let count = lists.iter().map(|(list, _)| list.len()).sum();
        let first = lists.iter().find_map(|(list, names)| Some((list.first()?, names)));
        let Some((Crossing { edge: [p, q], triangle: [a, b, c] }, names)) = first else { return };
        self.frames += 1;
        if self.first.is_empty() {
            let [edge_of, triangle_of] = names;
            self.first = format!("{frame}, edge {p}-{q}{edge_of} through triangle {a}-{b}-{c}{triangle_of}");
        }
        if count > self.worst.0 {
            self.worst = (count, frame.to_owned());
        }
    }
}

/// All checks at one time, whose name is given with it.
fn check_moment(
    sheets: &mut [Sheet<'_>],
    body: Option<&mut Body<'_>>,
    (time, frame): (f64, &str),
    tallies: &mut Tallies,
) -> Result<(), IoError> {
    let mut present = Vec::new();
    for (i, sheet) in sheets.iter_mut().enumerate() {
        if sheet.place(time) {
            let list = find(&sheet.search.surface());
            tallies.entry(Subject::Cloth(i, i)).or_default().add(frame, &[(&list, ["", ""])]);
            present.push((i, sheet.mesh.world_matrix_at(time)?));
        }
    }
    let is_one_space =
        present.iter().all(|(_, matrix)| *matrix == present[0].1 && (body.is_none() || *matrix == IDENTITY));
    if !is_one_space {
        present.iter().for_each(|(i, matrix)| sheets[*i].transform(matrix));
    }
    let between = |a: &CrossingSearch, b: &CrossingSearch| find_between(&a.surface(), &b.surface());
    for (k, &(i, _)) in present.iter().enumerate() {
        for &(j, _) in &present[k + 1..] {
            let (a, b) = (&sheets[i], &sheets[j]);
            if never_together(a, b) {
                continue;
            }
            let lists = [between(&a.search, &b.search), between(&b.search, &a.search)];
            let names = [format!(" of {}", a.name), format!(" of {}", b.name)];
            let lists: [(&[Crossing], _); 2] =
                [(&lists[0], [names[0].as_str(), &names[1]]), (&lists[1], [names[1].as_str(), &names[0]])];
            tallies.entry(Subject::Cloth(i, j)).or_default().add(frame, &lists);
        }
    }
    let Some(body) = body else { return Ok(()) };
    body.place(time)?;
    for &(i, _) in &present {
        let lists = [between(&sheets[i].search, &body.search), between(&body.search, &sheets[i].search)];
        let lists: [(&[Crossing], _); 2] = [(&lists[0], ["", " of the body"]), (&lists[1], [" of the body", ""])];
        tallies.entry(Subject::Body(i)).or_default().add(frame, &lists);
    }
    Ok(())
}

/// Whether two meshes are seen one in the place of the other.
fn never_together(a: &Sheet<'_>, b: &Sheet<'_>) -> bool {
    matches!(
        (a.purpose.as_deref(), b.purpose.as_deref()),
        (Some("proxy"), Some("render")) | (Some("render"), Some("proxy"))
    )
}

/// Every time at which something is stored, ascending; the first time if nothing moves.
fn all_times(sheets: &[Sheet<'_>]) -> Vec<f64> {
    let mut times: Vec<f64> = sheets.iter().flat_map(|sheet| sheet.times.iter().copied()).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|b, a| *b - *a < SAME_TIME);
    if times.is_empty() {
        times.extend(sheets.iter().map(|sheet| sheet.mesh.start()).min_by(f64::total_cmp));
    }
    times
}

/// Puts what was found into words.
fn report(sheets: &[Sheet<'_>], tallies: &Tallies, found: &mut Verification) {
    let mut clean_pairs = 0;
    for (subject, tally) in tallies {
        let (all, frames, first) = (tally.looked_at, tally.frames, &tally.first);
        let (count, worst) = &tally.worst;
        let where_and_how =
            format!("in {frames} of {all} frames, at most {count} intersections ({worst}); first: {first}");
        let name = |i: usize| &sheets[i].name;
        match *subject {
            Subject::Cloth(i, j) if i == j && frames == 0 => {
                let triangles = sheets[i].search.surface().triangles.len();
                found.facts.push(format!("{}: {triangles} triangles, no intersections in {all} frames", name(i)));
            }
            Subject::Cloth(i, j) if i == j && sheets[i].render_mesh_of.is_some() => {
                found.facts.push(format!("{}: its layers intersect {where_and_how}", render_mesh(&sheets[i])));
            }
            Subject::Cloth(i, j) if i == j => {
                found.failures.push(format!("{}: the cloth intersects itself {where_and_how}", name(i)));
            }
            Subject::Cloth(..) if frames == 0 => clean_pairs += 1,
            // It is around its own garment, and thicker than that where it meets another.
            Subject::Cloth(i, j) if [i, j].iter().any(|k| sheets[*k].render_mesh_of.is_some()) => {
                let described = |k: usize| match sheets[k].render_mesh_of {
                    Some(_) => render_mesh(&sheets[k]),
                    None => sheets[k].name.clone(),
                };
                found.facts.push(format!("{} and {} intersect {where_and_how}", described(i), described(j)));
            }
            Subject::Cloth(i, j) => {
                found.failures.push(format!("{} and {} intersect {where_and_how}", name(i), name(j)));
            }
            Subject::Body(i) if frames == 0 => {
                found.facts.push(format!("{}: no intersections with the body in {all} frames", name(i)));
            }
            // Where a body squeezes or crosses itself, cloth has no right place: this is reported, not judged.
            Subject::Body(i) => {
                found.warnings.push(format!("{} and the body intersect {where_and_how}", name(i)));
            }
        }
    }
    if clean_pairs > 0 {
        found.facts.push(format!("no intersections between meshes, {clean_pairs} pairs of them"));
    }
    report_times(sheets, tallies, found);
}

/// A render mesh by its name, and that it is one.
fn render_mesh(sheet: &Sheet<'_>) -> String {
    let garment = sheet.render_mesh_of.as_deref().unwrap_or_default();
    format!("{} (render mesh of {garment}, not judged as cloth)", sheet.name)
}

/// Meshes can be compared only where both are stored.
fn report_times(sheets: &[Sheet<'_>], tallies: &Tallies, found: &mut Verification) {
    for (i, a) in sheets.iter().enumerate() {
        for (j, b) in sheets.iter().enumerate().skip(i + 1).filter(|(_, b)| !never_together(a, b)) {
            let common = tallies.get(&Subject::Cloth(i, j)).map_or(0, |tally| tally.looked_at);
            let expected = a.times.len().min(b.times.len());
            if common == 0 {
                let what = "have no sample at the same time, so intersections between them cannot be judged";
                found.failures.push(format!("{} and {} {what}", a.name, b.name));
            } else if common < expected {
                let what =
                    format!("share {common} times of {expected}; intersections between them were judged there only");
                found.warnings.push(format!("{} and {} {what}", a.name, b.name));
            }
        }
    }
}
