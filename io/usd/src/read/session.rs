//! A stage on its thread: opened, walked through once, and asked for the meshes that were chosen.

use std::cell::RefCell;
use std::error::Error as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use openusd::sdf::Value;
use openusd::usd::{Attribute, AttributeQuery, Prim, PrimPredicate, Stage, TimeCode};

use super::error::{UsdError, UsdErrorKind};
use super::guard::{Guard, Log, seen};
use super::instancer::Prototype;
use super::left_out;
use super::mesh::Mesh;
use super::values::{number, word};
use super::worker::Panicked;
use super::{About, Chosen, Entry};

/// Most prims of a stage: references that double at every level reach any number from a few lines, and the library takes about
/// 4 kB and 30 µs for each.
const MOST_PRIMS: usize = if cfg!(fuzzing) { 2_000 } else { 100_000 };

/// Prims of which `info` tells the type.
const MOST_OTHERS: usize = 1000;

/// A stage and what everything that is read from it needs: values, and errors that name the file.
pub(crate) struct Reading {
    path: PathBuf,
    pub(crate) stage: Stage,
    log: Arc<Mutex<Log>>,
}

impl Reading {
    /// Content that cannot be used.
    pub(crate) fn bad(&self, place: impl Into<String>, what: impl Into<String>, advice: impl Into<String>) -> UsdError {
        UsdError::bad(&self.path, place, what, advice)
    }

    /// What the library answered about a prim.
    pub(crate) fn ok<T>(&self, answer: openusd::Result<T>, prim: &Prim) -> Result<T, UsdError> {
        answer.map_err(|error| usd_error(&self.path, prim.path().as_str(), &error, &self.log))
    }

    /// A value that does not move: the default, or else the first sample.
    pub(crate) fn value(&self, attribute: &Attribute) -> Result<Option<Value>, UsdError> {
        let prim = attribute.prim();
        if let Some(value) = self.ok(attribute.get::<Value>(), &prim)? {
            return Ok(Some(value));
        }
        let first = self.ok(attribute.time_sample_times(), &prim)?.first().copied();
        first.map_or(Ok(None), |code| self.ok(attribute.get_at(TimeCode::new(code)), &prim))
    }

    /// The value at a time code.
    pub(crate) fn value_at(&self, query: &AttributeQuery, code: f64) -> Result<Option<Value>, UsdError> {
        self.ok(query.get_at(TimeCode::new(code)), &query.attribute().prim())
    }

    /// Codes of its samples; none when there is but one, as it then does not move.
    pub(crate) fn times(&self, query: &AttributeQuery) -> Result<Vec<f64>, UsdError> {
        let times = self.ok(query.time_sample_times(), &query.attribute().prim())?;
        if let Some(code) = times.iter().find(|code| !code.is_finite()) {
            let what = format!("a sample has the time code {code}");
            return Err(self.bad(query.attribute().path().as_str(), what, "export it again"));
        }
        Ok(if times.len() > 1 { times } else { Vec::new() })
    }

    /// Paths that a relationship points to.
    pub(crate) fn targets(&self, prim: &Prim, name: &str) -> Result<Vec<openusd::sdf::Path>, UsdError> {
        self.ok(prim.relationship(name).targets(), prim)
    }

    /// The type of a prim; empty when it has none.
    pub(crate) fn kind(&self, prim: &Prim) -> Result<String, UsdError> {
        Ok(self.ok(prim.type_name(), prim)?.map(|kind| kind.as_str().to_owned()).unwrap_or_default())
    }

    /// Declares attributes that value clips over a prim may hold and that no layer declares: the library looks for declared ones
    /// alone. It is done in memory, and no file changes.
    pub(crate) fn declare(&self, prim: &Prim, attributes: &[(&str, &str)]) -> Result<(), UsdError> {
        let mut above = Some(prim.clone());
        while let Some(prim) = &above
            && self.ok(prim.get_metadata::<Value>("clips"), prim)?.is_none()
        {
            above = prim.parent().filter(|prim| prim.path().as_str() != "/");
        }
        for (name, kind) in attributes.iter().filter(|_| above.is_some()) {
            let attribute = prim.attribute(*name);
            if self.ok(attribute.property_stack(), prim)?.is_empty() {
                // What cannot be declared, below an instance, is then missed by whoever needs it.
                let _ = self.stage.create_attribute(attribute.path().clone(), *kind);
            }
        }
        Ok(())
    }

    /// The word that an attribute holds.
    pub(crate) fn word(&self, prim: &Prim, name: &str) -> Result<Option<String>, UsdError> {
        Ok(self.value(&prim.attribute(name))?.as_ref().and_then(word))
    }
}

/// The library's error with all its causes; what the guard refused is the better reason.
fn usd_error(path: &Path, place: &str, error: &openusd::Error, log: &Mutex<Log>) -> UsdError {
    let log = seen(log);
    if let Some((layer, what)) = log.refused.first() {
        return refused(path, layer, what);
    }
    let mut what = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        let text = next.to_string();
        if !what.contains(&text) {
            what = format!("{what}: {text}");
        }
        cause = next.source();
    }
    let what = in_plain_words(&what);
    let advice =
        if begins_with_point(&what) { WRITE_ZERO } else { "the file is damaged, or of another kind; export it again" };
    UsdError::bad(path, place, what, advice)
}

/// What the library says where a number of a text layer begins with its point, which USD allows and it does not read.
const POINT_FIRST: &str = "got Punctuation('.')";

/// What helps then.
const WRITE_ZERO: &str = "a number that begins with its point (.3) is right in USD, and is not read here: write 0.3, or save the \
                          layer as .usdc";

/// What the library says of letters that it knows no word from.
const UNKNOWN_LETTERS: &str = "Logos error";

/// What the library says, without the names of its parts.
fn in_plain_words(what: &str) -> String {
    what.replace(UNKNOWN_LETTERS, "these letters mean nothing in USD")
}

/// Whether the library stumbled over a number that begins with its point.
fn begins_with_point(what: &str) -> bool {
    what.contains(POINT_FIRST)
}

fn refused(path: &Path, layer: &str, what: &str) -> UsdError {
    let advice = "the file is damaged, or was made to do harm; if it is neither, write its samples as value clips";
    UsdError::bad(path, format!("layer {layer}"), what, advice)
}

/// What is asked on the thread of a stage.
pub(crate) struct Session {
    pub(crate) reading: Reading,
    pub(crate) meshes: RefCell<Vec<Mesh>>,
}

/// What a prim hands down to its children.
#[derive(Clone, Default)]
struct Inherited {
    invisible: bool,
    purpose: Option<String>,
    skel_root: bool,
    instancer: bool,
}

/// A prim that is a mesh, and whether a skeleton may move it.
#[derive(Clone)]
struct Found {
    entry: Entry,
    skel_root: bool,
    in_instancer: bool,
}

/// A prim that places prototypes.
struct Instancer {
    path: String,
    /// Paths of its prototypes.
    prototypes: Vec<String>,
    /// Why nothing is to be seen of it.
    hidden: Option<String>,
    /// What it is for.
    purpose: Option<String>,
}

impl Session {
    /// Opens a stage and looks at all its prims.
    pub(crate) fn open(path: &Path) -> Result<(Self, About), UsdError> {
        let (guard, log) = Guard::new();
        let name = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let Some(name) = name.to_str() else {
            let what = format!("{path:?} is not UTF-8, and USD names its layers in UTF-8");
            return Err(UsdError::bad(path, "path", what, "rename the file or its folders"));
        };
        let opened = Stage::builder().resolver(guard).open(name);
        let stage = opened.map_err(|error| usd_error(path, "stage", &error, &log))?;
        let reading = Reading { path: path.to_owned(), stage, log };
        let mut about = about(&reading)?;
        let mut found = Vec::new();
        let mut instancers = Vec::new();
        walk(&reading, (&mut found, &mut instancers), &mut about.others)?;
        place(&mut found, &instancers);
        found.sort_by(|a, b| a.entry.path.cmp(&b.entry.path));
        about.meshes = found.into_iter().map(|found| Entry { skinnable: found.skel_root, ..found.entry }).collect();
        about.flaws = flaws(&reading);
        about.layers = seen(&reading.log).files.clone();
        Ok((Self { reading, meshes: RefCell::default() }, about))
    }

    /// Makes the chosen meshes ready.
    pub(crate) fn choose(&self, entries: &[Entry]) -> Result<Chosen, UsdError> {
        let mut chosen = Chosen::default();
        let mut meshes = Vec::new();
        for entry in entries {
            let mesh = Mesh::open(&self.reading, entry, &mut chosen.notes)?;
            chosen.left_out_of_each.push(left_out::of(&self.reading, mesh.prim())?);
            chosen.moving_primvars_of_each.push(left_out::moving_primvars(&self.reading, mesh.prim())?);
            let mut codes = mesh.times(&self.reading)?;
            codes.sort_by(f64::total_cmp);
            codes.dedup();
            chosen.codes.extend(&codes);
            chosen.codes_of_each.push(codes);
            meshes.push(mesh);
        }
        chosen.codes.sort_by(f64::total_cmp);
        chosen.codes.dedup();
        chosen.layers = seen(&self.reading.log).files.clone();
        *self.meshes.borrow_mut() = meshes;
        Ok(chosen)
    }
}

/// What a stage says about itself.
fn about(reading: &Reading) -> Result<About, UsdError> {
    let stage = &reading.stage;
    let metadata = |field: &str| stage.stage_metadata(field).ok().flatten();
    let metres_per_unit = metadata("metersPerUnit").as_ref().and_then(number);
    if let Some(metres) = metres_per_unit.filter(|metres| !(metres.is_finite() && *metres > 0.0)) {
        return Err(reading.bad("stage", format!("metersPerUnit is {metres}"), "it is the length of a unit in metres"));
    }
    Ok(About {
        metres_per_unit,
        up_axis: metadata("upAxis").as_ref().and_then(word),
        codes_per_second: stage.time_codes_per_second(),
        frames_per_second: metadata("framesPerSecond").as_ref().and_then(number),
        range: stage.has_authored_time_code_range().then(|| [stage.start_time_code(), stage.end_time_code()]),
        custom: custom(stage),
        default_prim: stage.default_prim().map(|name| name.as_str().to_owned()),
        ..About::default()
    })
}

/// Texts of the layer's own data.
fn custom(stage: &Stage) -> Vec<(String, String)> {
    let Some(Value::Dictionary(data)) = stage.custom_layer_data().ok().flatten() else { return Vec::new() };
    let mut texts: Vec<(String, String)> =
        data.iter().filter_map(|(name, value)| Some((name.clone(), word(value)?))).collect();
    texts.sort_unstable();
    texts
}

/// Looks at all prims that are active, loaded and defined, those of instances too.
fn walk(
    reading: &Reading,
    (meshes, instancers): (&mut Vec<Found>, &mut Vec<Instancer>),
    others: &mut Vec<(String, String)>,
) -> Result<(), UsdError> {
    let stage = &reading.stage;
    let root = stage.prim("/").map_err(|error| reading.bad("/", error.to_string(), "export the file again"))?;
    let mut stack = vec![(root, Inherited::default())];
    let mut count = 0;
    while let Some((prim, above)) = stack.pop() {
        let path = prim.path().as_str().to_owned();
        let mut inherited = above;
        if path != "/" {
            if !reading.ok(stage.prim_matches(prim.path(), PrimPredicate::DEFAULT_PROXIES), &prim)? {
                continue;
            }
            count += 1;
            if count > MOST_PRIMS {
                let advice = "open a smaller part of the scene, or export the body alone";
                return Err(reading.bad(path, format!("the stage has more than {MOST_PRIMS} prims"), advice));
            }
            let kind = reading.kind(&prim)?;
            let in_instancer = inherited.instancer;
            inherit(reading, &prim, &kind, &mut inherited)?;
            if kind == "PointInstancer" {
                let within = || "it is within another PointInstancer, which is not read".to_owned();
                let hidden = hidden(&inherited).or_else(|| in_instancer.then(within));
                let prototypes = reading.targets(&prim, "prototypes")?;
                let prototypes = prototypes.iter().map(|path| path.as_str().to_owned()).collect();
                let purpose = inherited.purpose.clone();
                instancers.push(Instancer { path: path.clone(), prototypes, hidden, purpose });
            }
            if kind == "Mesh" {
                let (hidden, purpose) = (hidden(&inherited), inherited.purpose.clone());
                let entry = Entry { path, hidden, purpose, prototype: None, skinnable: false };
                meshes.push(Found { entry, skel_root: inherited.skel_root, in_instancer });
            } else if others.len() < MOST_OTHERS && kind != "GeomSubset" {
                others.push((path, if kind.is_empty() { "untyped".to_owned() } else { kind }));
            }
        }
        let children = reading.ok(prim.children(), &prim)?;
        stack.extend(children.into_iter().rev().map(|child| (child, inherited.clone())));
    }
    Ok(())
}

fn inherit(reading: &Reading, prim: &Prim, kind: &str, inherited: &mut Inherited) -> Result<(), UsdError> {
    inherited.skel_root |= kind == "SkelRoot";
    inherited.instancer |= kind == "PointInstancer";
    if let Some(purpose) = reading.word(prim, "purpose")? {
        inherited.purpose = Some(purpose).filter(|purpose| purpose != "default");
    }
    let visibility = prim.attribute("visibility");
    let invisible = |value: Option<Value>| value.as_ref().and_then(word).is_some_and(|word| word == "invisible");
    let codes = reading.ok(visibility.time_sample_times(), prim)?;
    // What is seen at some time is there.
    inherited.invisible |= if codes.is_empty() {
        invisible(reading.value(&visibility)?)
    } else {
        let mut all = true;
        for code in codes {
            all &= invisible(reading.ok(visibility.get_at(TimeCode::new(code)), prim)?);
        }
        all
    };
    Ok(())
}

/// Why nothing is to be seen of a mesh.
fn hidden(inherited: &Inherited) -> Option<String> {
    inherited.invisible.then(|| "it is invisible".to_owned())
}

/// Puts the meshes of prototypes where their instancers place them.
fn place(found: &mut Vec<Found>, instancers: &[Instancer]) {
    let below =
        |path: &str, root: &str| path.strip_prefix(root).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'));
    let mut placed = Vec::new();
    for Instancer { path, prototypes, hidden, purpose } in instancers {
        let first_of =
            |number: &usize| prototypes.iter().position(|root| *root == prototypes[*number]) == Some(*number);
        for root in (0..prototypes.len()).filter(first_of).map(|number| &prototypes[number]) {
            let numbers: Vec<i64> = (0..).zip(prototypes).filter(|(_, other)| *other == root).map(|(n, _)| n).collect();
            for mesh in found.iter().filter(|mesh| below(&mesh.entry.path, root)) {
                let own = mesh.entry.path.clone();
                let character = || "a PointInstancer places characters (SkelRoot), which is not read".to_owned();
                let why = mesh.entry.hidden.clone().or_else(|| hidden.clone());
                let entry = Entry {
                    path: if below(&own, path) { own.clone() } else { format!("{path}{own}") },
                    hidden: why.or_else(|| mesh.skel_root.then(character)),
                    purpose: mesh.entry.purpose.clone().or_else(|| purpose.clone()),
                    prototype: Some(Prototype {
                        instancer: path.clone(),
                        root: root.clone(),
                        numbers: numbers.clone(),
                        mesh: own,
                    }),
                    skinnable: false,
                };
                placed.push(Found { entry, skel_root: false, in_instancer: false });
            }
        }
    }
    // What is below an instancer is seen only where that places it.
    found.retain(|mesh| !mesh.in_instancer || placed.iter().all(|other| other.entry.path != mesh.entry.path));
    for mesh in found.iter_mut().filter(|mesh| mesh.in_instancer) {
        let what = "it is below a PointInstancer, and none of its prototypes";
        mesh.entry.hidden.get_or_insert_with(|| what.to_owned());
    }
    found.append(&mut placed);
}

/// What went wrong while the stage was composed: the prim, what, and whether a file is missing.
fn flaws(reading: &Reading) -> Vec<(String, UsdError)> {
    use openusd::pcp::CompositionDiagnostic as Diagnostic;
    let path = &reading.path;
    let refusals = seen(&reading.log).refused.clone();
    let mut flaws: Vec<(String, UsdError)> =
        refusals.iter().map(|(layer, what)| (String::new(), refused(path, layer, what))).collect();
    for diagnostic in reading.stage.composition_errors() {
        let text = diagnostic.to_string();
        let (place, kind) = match &diagnostic {
            Diagnostic::ArcCycle(_) => (text.rsplit(' ').next().unwrap_or_default().to_owned(), UsdErrorKind::BadInput),
            Diagnostic::UnresolvedLayer { site_path, .. } => (site_path.as_str().to_owned(), UsdErrorKind::Missing),
            Diagnostic::MalformedLayer { site_path, .. }
            | Diagnostic::UnresolvedPrimPath { site_path, .. }
            | Diagnostic::UnresolvedDefaultPrim { site_path, .. }
            | Diagnostic::InvalidPrimPath { site_path, .. }
            | Diagnostic::InvalidVariantSelection { site_path, .. }
            | Diagnostic::InvalidExpression { site_path, .. } => {
                (site_path.as_str().to_owned(), UsdErrorKind::BadInput)
            }
            Diagnostic::UnreadableClip { prim_path, .. } => (prim_path.as_str().to_owned(), UsdErrorKind::Missing),
            // Sublayers belong to everything.
            _ if text.contains("sublayer") => {
                let missing = text.contains("unresolved");
                (String::new(), if missing { UsdErrorKind::Missing } else { UsdErrorKind::BadInput })
            }
            // Targets of materials and the like, which are no geometry.
            _ => continue,
        };
        let named = if place.is_empty() { "stage".to_owned() } else { place.clone() };
        let advice = match kind {
            _ if begins_with_point(&text) => WRITE_ZERO,
            UsdErrorKind::Missing => "put the file where the layer looks for it, or export the stage as one file",
            UsdErrorKind::BadInput => "mend what the layer refers to, or export the stage as one file",
        };
        let error = UsdError::bad(path, named, in_plain_words(&text), advice);
        flaws.push((place, UsdError { kind, ..error }));
    }
    flaws
}

/// What went wrong inside the library, and in which file.
#[derive(Debug)]
pub(crate) struct Failure(pub(crate) UsdError);

impl From<Panicked> for Failure {
    fn from(panicked: Panicked) -> Self {
        let what = format!("the library that reads USD gave up: {}", panicked.0);
        let advice = "the file is damaged, or holds what the library does not know; export it again";
        Self(UsdError::bad(Path::new(""), "stage", what, advice))
    }
}
