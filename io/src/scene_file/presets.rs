//! Values that presets put into a scene before its own defaults: the solver's quality, and materials.

use std::borrow::Cow;
use std::path::PathBuf;

use drapery_core::scene::{Integrator, SolverPreset, names};
use drapery_core::settings::SettingValue;

use crate::materials::{self, Material, MaterialEffect, MaterialSetting, TakesPart};
use crate::shot_description::Fabric;

use super::deserialize::suggestion;
use super::diagnostics::SceneFileError;
use super::file_names;
use super::material_files;
use super::pair_friction;
use super::tree::{Node, Origin, Place, Sources, Table, Value};

/// Fills in what the presets and the materials in `folders` say, wherever the scene does not say it itself. Returns the
/// material of each garment, and the material files that were read, each once.
///
/// # Errors
/// A material that does not exist, or a file of one that cannot be used.
pub(super) fn fill(
    root: &mut Node,
    sources: &mut Sources,
    folders: &[PathBuf],
) -> Result<(Vec<Option<Fabric>>, Vec<PathBuf>), SceneFileError> {
    fill_solver(root);
    fill_integrator(root);
    let (used, files) = fill_materials(root, sources, folders)?;
    pair_friction::fill(root, &used);
    fill_bodies(root, &used);
    let fabric = |material: &Material| {
        let Material { name, friction, strain_limit, .. } = material;
        Fabric { name: name.to_string(), friction: *friction, strain_limit: *strain_limit }
    };
    Ok((used.iter().map(|material| material.as_deref().map(fabric)).collect(), files))
}

fn fill_solver(root: &mut Node) {
    let Some(node) = root.as_table_mut().and_then(|t| t.get_mut("solver")) else {
        return;
    };
    let place = node.place.clone();
    let Some(table) = node.as_table_mut() else {
        return;
    };
    let Some(name) = table.get("preset").and_then(Node::as_text).map(str::to_owned) else {
        return;
    };
    // An unknown preset is reported when the table is read.
    let Some(preset) = SolverPreset::find(&name) else {
        return;
    };
    let origin = Origin::Preset(name);
    let written = table.get("integrator").and_then(Node::as_text).and_then(Integrator::find);
    let integrator = written.unwrap_or(preset.integrator);
    let is_unused = |key: &str| integrator.unused_keys().any(|unused| unused.key == key);
    for (key, value) in preset.written().into_iter().filter(|(key, _)| !is_unused(key)) {
        table.fill(&key, as_written(value), &place, origin.clone());
    }
}

/// Leaves the integrator to the solver where a garment has a material and nothing else says it.
fn fill_integrator(root: &mut Node) {
    let place = root.place.clone();
    let Some(table) = root.as_table_mut() else { return };
    let Some(Node { value: Value::Array(garments), .. }) = table.get("garment") else { return };
    let material = |garment: &Node| garment.as_table()?.get("material")?.as_text().map(str::to_owned);
    let Some(material) = garments.iter().find_map(material) else { return };
    table.fill("solver", Value::Table(Table::default()), &place, Origin::Default);
    let Some(Node { value: Value::Table(solver), place, .. }) = table.get_mut("solver") else { return };
    let auto = Value::Text(Integrator::Auto.word().to_owned());
    solver.fill("integrator", auto, place, Origin::Material(material));
}

/// A value of a preset as a scene would write it.
fn as_written(value: SettingValue) -> Value {
    match value {
        SettingValue::Number(number) if number.fract() == 0.0 => Value::Integer(number as i64),
        SettingValue::Number(number) => Value::Float(number),
        SettingValue::Text(text) => Value::Text(text),
        other => unreachable!("presets hold numbers and words, not {other:?}"),
    }
}

/// The material of each garment, if it names one, and the files that they were read from.
type Used = (Vec<Option<Cow<'static, Material>>>, Vec<PathBuf>);

/// Fills the garments and returns the materials they use.
fn fill_materials(root: &mut Node, sources: &mut Sources, folders: &[PathBuf]) -> Result<Used, SceneFileError> {
    let (mut used, mut files) = (Vec::new(), Vec::new());
    let integrator = root.as_table().and_then(|t| t.get("solver")?.as_table()?.get("integrator")?.as_text());
    let may_be_long = |integrator: Integrator| integrator == Integrator::Auto || integrator.spec().is_implicit;
    let long_steps = integrator.and_then(Integrator::find).is_some_and(may_be_long);
    let Some(Node { value: Value::Array(garments), .. }) = root.as_table_mut().and_then(|t| t.get_mut("garment"))
    else {
        return Ok((used, files));
    };
    for garment in garments {
        used.push(fill_from_material(garment, sources, (folders, long_steps), &mut files)?);
    }
    Ok((used, files))
}

/// Fills a garment from its material, looked for in these folders, for long steps or short ones, and returns that; adds the file that it was read from.
fn fill_from_material(
    garment: &mut Node,
    sources: &mut Sources,
    (folders, long_steps): (&[PathBuf], bool),
    files: &mut Vec<PathBuf>,
) -> Result<Option<Cow<'static, Material>>, SceneFileError> {
    let place = garment.place.clone();
    let Some(table) = garment.as_table_mut() else { return Ok(None) };
    let Some(Node { value: Value::Text(name), place: name_place, .. }) = table.get("material") else {
        return Ok(None);
    };
    let material = match (materials::find(name), material_files::find(name, folders)) {
        (Some(preset), _) => Cow::Borrowed(preset),
        (None, Some(file)) => {
            let material = material_files::read(&file, sources, Some(name_place))?;
            if !files.contains(&file) {
                files.push(file);
            }
            // The scene with its values written out has to run where the file is not found.
            table.0.retain(|entry| entry.key != "material");
            Cow::Owned(material)
        }
        (None, None) => return Err(unknown_material(name, name_place, sources, folders)),
    };
    fill_garment(table, &material, long_steps, &place);
    Ok(Some(material))
}

fn unknown_material(name: &str, place: &Place, sources: &Sources, folders: &[PathBuf]) -> SceneFileError {
    let in_files = material_files::names(folders);
    let presets = materials::PRESETS.iter().map(|material| material.name.as_ref());
    let names: Vec<&str> = presets.chain(in_files.iter().map(String::as_str)).collect();
    sources.error(place, format!("there is no material `{name}`"), Some(suggestion(name, &names)))
}

fn fill_garment(table: &mut Table, material: &Material, long_steps: bool, place: &Place) {
    let origin = Origin::Material(material.name.to_string());
    if table.get("total_mass").is_none() {
        table.fill("density", Value::Float(material.density), place, origin.clone());
    }
    table.fill("thickness", Value::Float(material.thickness), place, origin);
    let has = |table: &Table, effect: &str| table.get(effect).is_some();
    for MaterialEffect { effect, takes_part, settings } in &materials::EFFECTS {
        let settings = settings.iter().filter(|setting| long_steps || !setting.in_long_steps);
        let takes_part = match takes_part {
            TakesPart::IfAskedFor => has(table, effect),
            TakesPart::Unless(other) => !has(table, other),
        };
        if takes_part {
            fill_effect(table, effect, settings, material, place);
        }
    }
}

/// Fills in settings of an effect of a garment, and asks for the effect.
fn fill_effect<'a>(
    garment: &mut Table,
    effect: &str,
    settings: impl Iterator<Item = &'a MaterialSetting>,
    material: &Material,
    place: &Place,
) {
    let origin = Origin::Material(material.name.to_string());
    garment.fill(effect, Value::Table(Table::default()), place, origin.clone());
    let Some(table) = garment.get_mut(effect).and_then(Node::as_table_mut) else {
        return;
    };
    for MaterialSetting { key, unless, in_long_steps, value } in settings {
        let is_asked_for = !in_long_steps || table.get("extension").is_some();
        let counts = is_asked_for && unless.iter().all(|other| table.get(other).is_none());
        if let Some(value) = value(material).filter(|_| counts) {
            table.fill(key, Value::Float(value), place, origin.clone());
        }
    }
}

/// Friction and thickness of bodies that do not say them: the largest of the materials that touch them.
fn fill_bodies(root: &mut Node, used: &[Option<Cow<'static, Material>>]) {
    let Some(Node { value: Value::Array(bodies), .. }) = root.as_table_mut().and_then(|t| t.get_mut("body")) else {
        return;
    };
    let largest = |of: fn(&Material) -> f64| used.iter().flatten().max_by(|a, b| of(a).total_cmp(&of(b)));
    for body in bodies {
        let place = body.place.clone();
        let Some(table) = body.as_table_mut() else { continue };
        if let Some(material) = largest(|m| m.friction) {
            let origin = Origin::Material(material.name.to_string());
            table.fill("friction", Value::Float(material.friction), &place, origin);
        }
        if let Some(material) = largest(|m| m.thickness) {
            let origin = Origin::Material(material.name.to_string());
            table.fill("thickness", Value::Float(material.thickness), &place, origin);
        }
    }
}

/// Name of the shot where it is left out: that of the file.
pub(super) fn fill_shot_name(root: &mut Node, file_stem: &str) {
    if let Some(shot) = root.as_table_mut().and_then(|t| t.get_mut("shot")) {
        let place = shot.place.clone();
        if let Some(table) = shot.as_table_mut() {
            // A file may have a name that no folder should have.
            let is_usable = file_names::usable_for_folder(file_stem).is_ok();
            let name = if is_usable { file_stem.to_owned() } else { names::usable(file_stem) };
            table.fill("name", Value::Text(name), &place, Origin::Default);
        }
    }
}
