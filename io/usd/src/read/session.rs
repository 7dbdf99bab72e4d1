//! A stage on its thread: opened, walked through once, and asked for the meshes that were chosen.

use std::cell::RefCell;
use std::path::Path;

use openusd::sdf::Value;
use openusd::usd::{Prim, PrimPredicate, Stage, TimeCode};

use super::error::UsdError;
use super::guard::{Guard, seen};
use super::instancer::Prototype;
use super::left_out;
use super::mesh::Mesh;
use super::reading::{Reading, flaws, usd_error};
use super::values::{all_integers, number, numbers as list, vector, word};
use super::worker::Panicked;
use super::{About, Channel, Chosen, Entry};

/// Most prims of a stage: references that double at every level reach any number from a few lines, and the library takes about
/// 4 kB and 30 µs for each.
const MOST_PRIMS: usize = if cfg!(fuzzing) { 2_000 } else { 100_000 };

/// Prims of which `info` tells the type.
const MOST_OTHERS: usize = 1000;

/// Namespace of the attributes that Blender and Houdini make of custom properties.
const USER: &str = "userProperties:";

/// State that is queried on the thread of a stage.
pub(crate) struct Session {
    pub(crate) reading: Reading,
    pub(crate) meshes: RefCell<Vec<Mesh>>,
}

/// State that a prim hands down to its children.
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
    /// Purpose of the instancer.
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

    /// Samples of an attribute of a prim that holds numbers.
    pub(crate) fn numbers(&self, path: &str, name: &str) -> Result<Vec<(f64, Vec<f64>)>, UsdError> {
        let Self { reading, .. } = self;
        let bad = |what: String, advice: &str| reading.bad(format!("{path}.{name}"), what, advice);
        let prim = reading.stage.prim(path);
        let prim = prim.map_err(|error| bad(format!("{path} is no prim: {error}"), "write /PRIM.ATTRIBUTE"))?;
        let attribute = prim.attribute(name);
        let codes = reading.ok(attribute.time_sample_times(), &prim)?;
        if let Some(code) = codes.iter().find(|code| !code.is_finite()) {
            return Err(bad(format!("a sample has the time code {code}"), "export it again"));
        }
        let still = reading.value(&attribute)?.filter(|_| codes.len() < 2).map(|value| (0.0, value));
        let mut samples: Vec<(f64, Value)> = still.into_iter().collect();
        if codes.len() > 1 {
            for code in codes {
                samples.extend(reading.ok(attribute.get_at(TimeCode::new(code)), &prim)?.map(|value| (code, value)));
            }
        }
        if samples.is_empty() {
            let what = "there is no such attribute, or it has no value".to_owned();
            let mut names = Vec::new();
            for attribute in reading.ok(prim.authored_attributes(), &prim)? {
                let is_number = reading.value(&attribute)?.as_ref().and_then(plain).is_some();
                names.extend(is_number.then(|| attribute.name().to_owned()));
            }
            let advice = match names.is_empty() {
                true => "the stage has no such prim, or none of its attributes holds numbers; `drapery info` lists those that a scene can follow".to_owned(),
                false => format!("its attributes of numbers are {}", names.join(", ")),
            };
            return Err(bad(what, &advice));
        }
        let plain = |(code, value): (f64, Value)| match plain(&value) {
            Some(numbers) => Ok((code, numbers)),
            None => Err(bad("it does not hold numbers".to_owned(), "name an attribute of one number, or of three")),
        };
        samples.into_iter().map(plain).collect()
    }

    /// Attributes of these prims that hold numbers and either change over time or are custom, without primvars.
    pub(crate) fn channels(&self, prims: &[String]) -> Result<Vec<Channel>, UsdError> {
        let Self { reading, .. } = self;
        let mut channels = Vec::new();
        for path in prims {
            let prim = reading.stage.prim(path.as_str());
            let prim = prim.map_err(|error| reading.bad(path, error.to_string(), "export the file again"))?;
            for attribute in reading.ok(prim.authored_attributes(), &prim)? {
                let name = attribute.name().to_owned();
                if name.starts_with("primvars:") {
                    continue;
                }
                let samples = reading.ok(attribute.time_sample_times(), &prim)?.len();
                if samples < 2 && !name.starts_with(USER) && !reading.ok(attribute.is_custom(), &prim)? {
                    continue;
                }
                let samples = samples.max(1);
                if let Some(numbers) = reading.value(&attribute)?.as_ref().and_then(plain) {
                    channels.push(Channel { prim: path.clone(), attribute: name, numbers: numbers.len(), samples });
                }
            }
        }
        Ok(channels)
    }

    /// Makes the chosen meshes ready.
    pub(crate) fn choose(&self, entries: &[Entry]) -> Result<Chosen, UsdError> {
        let mut chosen = Chosen::default();
        let mut meshes = Vec::new();
        for entry in entries {
            let mesh = Mesh::open(&self.reading, entry, &mut chosen.notes)?;
            chosen.moving_primvars_of_each.push(left_out::moving_primvars(&self.reading, mesh.prim())?);
            let mut codes = mesh.times(&self.reading)?;
            codes.sort_by(f64::total_cmp);
            codes.dedup();
            let mut left_out = left_out::of(&self.reading, mesh.prim())?;
            left_out.extend(mesh.unfitting_primvars(&self.reading, codes.first().copied().unwrap_or(0.0))?);
            chosen.left_out_of_each.push(left_out);
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

/// Numbers of a value: one, three, or those of a list.
fn plain(value: &Value) -> Option<Vec<f64>> {
    let integers = || Some(all_integers(value)?.into_iter().map(|number| number as f64).collect());
    number(value)
        .map(|number| vec![number])
        .or_else(|| vector(value).map(Vec::from))
        .or_else(|| list(value))
        .or_else(integers)
}

/// Returns the description that a stage gives of itself.
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
                let within = || "it is inside another PointInstancer, which is not read".to_owned();
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
        let what = "it is below a PointInstancer, but not one of its prototypes";
        mesh.entry.hidden.get_or_insert_with(|| what.to_owned());
    }
    found.append(&mut placed);
}

/// Failure inside the library, and the file in which it occurred.
#[derive(Debug)]
pub(crate) struct Failure(pub(crate) UsdError);

impl From<Panicked> for Failure {
    fn from(panicked: Panicked) -> Self {
        let what = format!("the library that reads USD gave up: {}", panicked.0);
        let advice = "the file is damaged, or holds what the library does not know; export it again";
        Self(UsdError::bad(Path::new(""), "stage", what, advice))
    }
}
