//! Does cloth pass through cloth? Exactly, on the stored positions, in every frame.
//!
//! Each mesh against itself, and against every other of all files given. What render meshes cross is reported and not judged:
//! they are no cloth, but follow it. Positions are taken as they are stored, so nothing is rounded; only meshes under different
//! transforms have to be brought together in the world, where their points are rounded as `f64`. Faces are cut into the triangles
//! that were simulated where the file tells them, and otherwise by the solver's rule at the first sample.

use std::collections::BTreeMap;

use drapery_alembic::{IDENTITY, Matrix, PolyMesh, TopologyVariance, transform_point};
use drapery_core::Vec3;
use drapery_core::geometry::crossings::Crossing;
use drapery_core::geometry::face_cuts::{CutCrossings, FaceSearch};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::error::IoError;
use drapery_io::formats::alembic::{faces_of, render_mesh_of, sample_times, triangles_of};
use drapery_io::mesh_data::MeshReader;
use drapery_shot::run_record::manifest::ManifestGarment;

use super::{Cache, RunGarments, Verification};

/// Sample times closer than this are one time [s]: programs round frame / fps differently.
const SAME_TIME: f64 = 1e-5;

/// Checks all meshes of all files against themselves and one another, and counts where they cross a body.
pub(super) fn check(caches: &[Cache], body: Option<&dyn MeshReader>, found: &mut Verification) -> Result<(), IoError> {
    let mut sheets = Vec::new();
    for cache in caches {
        sheets.extend(cache.meshes.iter().filter_map(|mesh| Sheet::open(cache, mesh)));
        if let Some(stage) = &cache.stage {
            sheets.extend((0..stage.meshes.len()).filter_map(|mesh| Sheet::of_stage(cache, stage, mesh)));
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
    search: FaceSearch,
    /// Times at which it or a parent is stored [s]; empty when nothing moves.
    times: Vec<f64>,
    /// The garment that it follows to be rendered in its place: it is no cloth, and may go through itself.
    render_mesh_of: Option<String>,
    /// Purpose of the mesh, if it is not for everything.
    purpose: Option<String>,
    /// Whether it is a body that a run wrote, and no cloth.
    is_body: bool,
    /// The run that wrote it, and its garment there, where its folder says so.
    written_by: Option<(&'a RunGarments, &'a ManifestGarment)>,
}

/// Source of samples.
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
    /// Origin from which its stored points are counted, where it never changes; points in the world are looked at
    /// otherwise.
    origin: Option<[f64; 3]>,
}

impl StageMesh<'_> {
    fn points(&self, sample: usize) -> Option<Vec<Vec3>> {
        if self.origin.is_none() {
            return self.stage.samples.world(self.mesh, sample).ok();
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
            Self::Stage(StageMesh { stage, mesh, .. }) if stage.meshes[mesh].is_still => Some(0),
            Self::Stage(StageMesh { stage, mesh, duration, .. }) => {
                let frames = &stage.meshes[mesh].frames;
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
            Self::Stage(StageMesh { stage, mesh, duration, .. }) => stage.meshes[mesh].frames[0] as f64 * duration,
        }
    }
}

impl<'a> Sheet<'a> {
    /// `None` for a mesh without a first sample or with changing topology, which break other rules.
    fn open(cache: &'a Cache, mesh: &'a PolyMesh) -> Option<Self> {
        if mesh.topology_variance() == TopologyVariance::Heterogeneous {
            return None;
        }
        let points = Mesh::Archive(mesh).stored(0)?;
        let (triangles, faces) = (triangles_of(mesh, &points)?, faces_of(mesh)?);
        let times = sample_times(std::slice::from_ref(mesh)).ok()?;
        let search = FaceSearch::new((&faces.face_counts, &faces.face_indices), triangles, points);
        let render_mesh_of = render_mesh_of(mesh);
        Some(Self {
            name: cache.name_of(mesh),
            mesh: Mesh::Archive(mesh),
            search,
            times,
            render_mesh_of,
            purpose: None,
            is_body: cache.is_of_body(),
            written_by: cache.garment_of(mesh.object().path()),
        })
    }

    /// A mesh of a stage; `None` if its first frame cannot be read, which breaks other rules.
    fn of_stage(cache: &'a Cache, stage: &'a CacheFrames, mesh: usize) -> Option<Self> {
        let described = &stage.meshes[mesh];
        // Guides are no surfaces that anybody sees.
        if described.purpose.as_deref() == Some("guide") {
            return None;
        }
        let duration = 1.0 / cache.fps?;
        let origin = stage.stored_positions(mesh, 0).ok()?.map(|stored| stored.origin);
        let points = Mesh::Stage(StageMesh { stage, mesh, duration, origin });
        let faces = (described.faces.face_counts.as_slice(), described.faces.face_indices.as_slice());
        let search = FaceSearch::new(faces, described.triangles.clone(), points.stored(0)?);
        let shown = if described.is_still { &[] } else { described.frames.as_slice() };
        let times = shown.iter().map(|frame| *frame as f64 * duration).collect();
        let name = format!("{}{}", cache.prefix, described.name);
        let render_mesh_of = stage.attributes(mesh).ok()?.render_mesh_of;
        let purpose = described.purpose.clone();
        let (is_body, written_by) = (cache.is_of_body(), cache.garment_of(&described.name));
        Some(Self { name, mesh: points, search, times, render_mesh_of, purpose, is_body, written_by })
    }

    /// Takes the positions stored at a time; whether there are any.
    fn place(&mut self, time: f64) -> bool {
        let count = self.search.positions().len();
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
        let local = self.search.positions().to_vec();
        self.search.place(local.into_iter().map(|p| Vec3::from(transform_point(p.into(), matrix))));
    }
}

/// Takes the crossings out of a list that a rule of the run allows, edges of one mesh through triangles of another; returns those of the
/// triangles that were simulated.
fn take_ignored(list: &mut CutCrossings, edges_of: &Sheet<'_>, triangles_of: &Sheet<'_>) -> Vec<Crossing> {
    let (Some((run, one)), Some((other_run, other))) = (edges_of.written_by, triangles_of.written_by) else {
        return Vec::new();
    };
    if !std::ptr::eq(run, other_run) {
        return Vec::new();
    }
    let is_ignored = |crossing: &mut Crossing| {
        run.ignore_each_other(&one.object_of(&crossing.edge), &other.object_of(&crossing.triangle))
    };
    list.other.retain_mut(|crossing| !is_ignored(crossing));
    list.simulated.extract_if(.., is_ignored).collect()
}

/// A body, in the world and at any time.
struct Body<'a> {
    reader: &'a dyn MeshReader,
    search: FaceSearch,
    points: Vec<Vec3>,
}

impl<'a> Body<'a> {
    fn open(reader: &'a dyn MeshReader) -> Result<Self, IoError> {
        let first = reader.sample_times().first().copied().unwrap_or(0.0);
        let mesh = reader.mesh_at(first)?.mesh;
        let faces = (mesh.face_counts.as_slice(), mesh.face_indices.as_slice());
        let search = FaceSearch::new(faces, mesh.triangulate().0, mesh.points.clone());
        Ok(Self { reader, search, points: Vec::new() })
    }

    fn place(&mut self, time: f64) -> Result<(), IoError> {
        self.reader.positions_at(time, &mut self.points)?;
        self.search.place(self.points.iter().copied());
        Ok(())
    }
}

/// Subject of a check: a mesh with itself (`a == b`), with another, or with the body.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Subject {
    Cloth(usize, usize),
    Body(usize),
}

/// Findings about one subject in all frames.
#[derive(Default)]
struct Tally {
    looked_at: usize,
    /// Crossings of the triangles that were simulated.
    simulated: Found,
    /// Crossings that only another cut of a face has.
    other: Found,
    /// Crossings of the simulated triangles that a rule of the scene allows; the others are without them.
    ignored: Found,
    /// Whether any face has one.
    has_other_cuts: bool,
}

/// Crossings of all frames.
#[derive(Default)]
struct Found {
    frames: usize,
    /// Largest number of crossings in one frame, and that frame.
    worst: (usize, String),
    /// The first crossing, in words.
    first: String,
}

type Tallies = BTreeMap<Subject, Tally>;

/// A surface in a search, and what is said behind its edges and triangles.
type Side<'a> = (&'a FaceSearch, &'a str);

/// Crossings of edges of a surface with triangles of another: those to be judged, and those that a rule of the scene allows.
type Listed<'a> = (CutCrossings, Vec<Crossing>, [Side<'a>; 2]);

impl Tally {
    /// Adds a frame: what edges of the first surface do to triangles of the second.
    fn add(&mut self, frame: &str, lists: &[Listed<'_>]) {
        self.looked_at += 1;
        self.has_other_cuts |= lists.iter().flat_map(|(.., sides)| sides).any(|(search, _)| search.has_other_cuts());
        self.simulated.add(frame, lists.iter().map(|(list, _, sides)| (&list.simulated, sides)), |_, _| String::new());
        self.other.add(frame, lists.iter().map(|(list, _, sides)| (&list.other, sides)), faces_in_words);
        self.ignored.add(frame, lists.iter().map(|(_, ignored, sides)| (ignored, sides)), |_, _| String::new());
    }
}

impl Found {
    fn add<'a, 'b: 'a>(
        &mut self,
        frame: &str,
        lists: impl Iterator<Item = (&'a Vec<Crossing>, &'a [Side<'b>; 2])> + Clone,
        faces: impl Fn(&Crossing, &[Side<'_>; 2]) -> String,
    ) {
        let count = lists.clone().map(|(list, _)| list.len()).sum();
        let first = lists.into_iter().find_map(|(list, sides)| Some((list.first()?, sides)));
        let Some((crossing, sides)) = first else { return };
        self.frames += 1;
        if self.first.is_empty() {
            let Crossing { edge: [p, q], triangle: [a, b, c] } = crossing;
            let [(_, edge_of), (_, triangle_of)] = sides;
            let faces = faces(crossing, sides);
            self.first = format!("{frame}, edge {p}-{q}{edge_of} through triangle {a}-{b}-{c}{triangle_of}{faces}");
        }
        if count > self.worst.0 {
            self.worst = (count, frame.to_owned());
        }
    }

    fn in_words(&self, looked_at: usize) -> String {
        let Self { frames, worst: (count, worst), first } = self;
        format!("in {frames} of {looked_at} frames, at most {count} intersections ({worst}); first: {first}")
    }
}

/// The faces of an edge and of a triangle, where they may be cut in several ways.
fn faces_in_words(Crossing { edge, triangle }: &Crossing, [one, other]: &[Side<'_>; 2]) -> String {
    let of = |face: Option<u32>, name: &str| face.map(|face| format!("face {face}{name}"));
    let both = [of(one.0.face_of_edge(*edge), one.1), of(other.0.face_of_triangle(*triangle), other.1)];
    let both: Vec<String> = both.into_iter().flatten().collect();
    if both.is_empty() { String::new() } else { format!(" ({})", both.join(", ")) }
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
            let (side, mut found) = ((&sheet.search, ""), sheet.search.find());
            let ignored = take_ignored(&mut found, sheet, sheet);
            tallies.entry(Subject::Cloth(i, i)).or_default().add(frame, &[(found, ignored, [side, side])]);
            present.push((i, sheet.mesh.world_matrix_at(time)?));
        }
    }
    let is_one_space =
        present.iter().all(|(_, matrix)| *matrix == present[0].1 && (body.is_none() || *matrix == IDENTITY));
    if !is_one_space {
        present.iter().for_each(|(i, matrix)| sheets[*i].transform(matrix));
    }
    for (k, &(i, _)) in present.iter().enumerate() {
        for &(j, _) in &present[k + 1..] {
            let (a, b) = (&sheets[i], &sheets[j]);
            if never_together(a, b) {
                continue;
            }
            let names = [a, b].map(|sheet| format!(" of {}", sheet.name));
            let listed = |edges_of: usize, triangles_of: usize| -> Listed<'_> {
                let ([one, other], sheets) = ([edges_of, triangles_of], [a, b]);
                let mut found = sheets[one].search.find_through(&sheets[other].search);
                let ignored = take_ignored(&mut found, sheets[one], sheets[other]);
                (found, ignored, [one, other].map(|k| (&sheets[k].search, names[k].as_str())))
            };
            tallies.entry(Subject::Cloth(i, j)).or_default().add(frame, &[listed(0, 1), listed(1, 0)]);
        }
    }
    let Some(body) = body else { return Ok(()) };
    body.place(time)?;
    for &(i, _) in &present {
        let (cloth, body): (Side<'_>, Side<'_>) = ((&sheets[i].search, ""), (&body.search, " of the body"));
        let listed = [[cloth, body], [body, cloth]].map(|[a, b]| (a.0.find_through(b.0), Vec::new(), [a, b]));
        tallies.entry(Subject::Body(i)).or_default().add(frame, &listed);
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
    let (mut clean_pairs, mut clean_cuts) = (0, 0);
    for (subject, tally) in tallies {
        let (all, frames) = (tally.looked_at, tally.simulated.frames);
        if let Subject::Cloth(i, j) = *subject
            && tally.ignored.frames > 0
        {
            let with = if i == j { "itself" } else { &sheets[j].name };
            let (rule, how) = ("as the scene lets them pass through each other", tally.ignored.in_words(all));
            found.facts.push(format!("{} and {with} intersect, {rule}, {how}", sheets[i].name));
        }
        let where_and_how = tally.simulated.in_words(all);
        let name = |i: usize| &sheets[i].name;
        match *subject {
            Subject::Cloth(..) if frames == 0 && tally.ignored.frames > 0 => {}
            Subject::Cloth(i, j) if i == j && frames == 0 => {
                let triangles = sheets[i].search.triangle_count();
                found.facts.push(format!("{}: {triangles} triangles, no intersections in {all} frames", name(i)));
            }
            // As of every body: it may squeeze, and cloth then has no right place.
            Subject::Cloth(i, j) if frames > 0 && (sheets[i].is_body || sheets[j].is_body) => {
                let with = if i == j { "itself" } else { name(j) };
                found.warnings.push(format!("{} and {with} intersect {where_and_how}; one is a body", name(i)));
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
                let [a, b] = [i, j].map(|k| described(&sheets[k]));
                found.facts.push(format!("{a} and {b} intersect {where_and_how}"));
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
        clean_cuts += usize::from(tally.has_other_cuts && tally.other.frames == 0);
        report_other_cuts(sheets, (*subject, tally), found);
    }
    if clean_pairs > 0 {
        found.facts.push(format!("no intersections between meshes; pairs checked: {clean_pairs}"));
    }
    if clean_cuts > 0 {
        let all = tallies.values().filter(|tally| tally.has_other_cuts).count();
        let what = "no intersections where quads are cut along the other diagonal and larger faces into fans";
        found.facts.push(format!("{what}, in {clean_cuts} of {all} comparisons"));
    }
    report_times(sheets, tallies, found);
}

/// Puts into words what crosses only where faces are cut otherwise than they were simulated.
fn report_other_cuts(sheets: &[Sheet<'_>], (subject, tally): (Subject, &Tally), found: &mut Verification) {
    if tally.other.frames == 0 {
        return;
    }
    let where_and_how = tally.other.in_words(tally.looked_at);
    let cut = "if faces are cut along the other diagonal, as renderers may do,";
    match subject {
        Subject::Cloth(i, j) => {
            let who = match i == j {
                true => format!("{}: the cloth intersects itself", described(&sheets[i])),
                false => format!("{} and {} intersect", described(&sheets[i]), described(&sheets[j])),
            };
            if [i, j].iter().any(|k| sheets[*k].render_mesh_of.is_some()) {
                return found.facts.push(format!("{who} {cut} {where_and_how}"));
            }
            let advice =
                "write the triangles that were simulated: faces = \"triangles\" under [output], or convert --triangles";
            found.warnings.push(format!("{who} {cut} {where_and_how}; {advice}"));
        }
        Subject::Body(i) => {
            let advice = "a thicker body keeps the cloth clear of both diagonals";
            found.warnings.push(format!("{} and the body intersect {cut} {where_and_how}; {advice}", sheets[i].name));
        }
    }
}

/// A mesh by its name, and whether it is a render mesh.
fn described(sheet: &Sheet<'_>) -> String {
    if sheet.render_mesh_of.is_some() { render_mesh(sheet) } else { sheet.name.clone() }
}

/// A render mesh by its name, and that it is one.
fn render_mesh(sheet: &Sheet<'_>) -> String {
    let garment = sheet.render_mesh_of.as_deref().unwrap_or_default();
    format!("{} (render mesh of {garment}, reported only)", sheet.name)
}

/// Meshes can be compared only where both are stored.
fn report_times(sheets: &[Sheet<'_>], tallies: &Tallies, found: &mut Verification) {
    for (i, a) in sheets.iter().enumerate() {
        for (j, b) in sheets.iter().enumerate().skip(i + 1).filter(|(_, b)| !never_together(a, b)) {
            let common = tallies.get(&Subject::Cloth(i, j)).map_or(0, |tally| tally.looked_at);
            let expected = a.times.len().min(b.times.len());
            if common == 0 {
                let what = "have no sample at the same time, so intersections between them cannot be tested";
                found.failures.push(format!("{} and {} {what}", a.name, b.name));
            } else if common < expected {
                let what =
                    format!("share {common} times of {expected}; intersections between them were tested only there");
                found.warnings.push(format!("{} and {} {what}", a.name, b.name));
            }
        }
    }
}
