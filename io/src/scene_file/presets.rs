//! What presets put into a scene before its own defaults: the solver's quality, and materials.

use crate::materials::{self, Material};

use super::deserialize::suggestion;
use super::diagnostics::SceneFileError;
use super::raw;
use super::tree::{Node, Origin, Place, Sources, Table, Value};

/// Fills in what the presets say, wherever the scene does not say it itself.
///
/// # Errors
/// A material that does not exist.
pub(super) fn fill(root: &mut Node, sources: &Sources) -> Result<(), SceneFileError> {
    fill_solver(root);
    let used = fill_materials(root, sources)?;
    fill_bodies(root, &used);
    Ok(())
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
    let values: Vec<(&str, Value)> = match name.as_str() {
        // Strain and tolerance trade accuracy for time; the step stays where cloth at cfl 4 is known to behave.
        "preview" => vec![
            ("strain_per_step", Value::Float(0.2)),
            ("cg_tolerance", Value::Float(2e-2)),
            ("cg_max_iterations", Value::Integer(100)),
        ],
        // 2.8 is below 2.83, under which the elastic part is proven stable (method 1.12).
        "hero" => vec![
            ("cfl", Value::Float(2.8)),
            ("strain_per_step", Value::Float(0.05)),
            ("cg_tolerance", Value::Float(1e-4)),
            ("cg_max_iterations", Value::Integer(500)),
        ],
        "production" => Vec::new(),
        _ => return,
    };
    let origin = Origin::Preset(name);
    for (key, value) in values {
        table.fill(key, value, &place, origin.clone());
    }
    if let Ok(defaults) = toml::Table::try_from(raw::Solver::default()) {
        let mut rest = Node { value: Value::Table(Table::default()), place: place.clone(), origin: origin.clone() };
        rest.fill_from(&toml::Value::Table(defaults));
        if let Value::Table(rest) = rest.value {
            rest.0.into_iter().for_each(|e| table.fill(&e.key, e.node.value, &place, origin.clone()));
        }
    }
}

/// Fills the garments and returns the materials they use.
fn fill_materials(root: &mut Node, sources: &Sources) -> Result<Vec<&'static Material>, SceneFileError> {
    let mut used = Vec::new();
    let Some(Node { value: Value::Array(garments), .. }) = root.as_table_mut().and_then(|t| t.get_mut("garment"))
    else {
        return Ok(used);
    };
    for garment in garments {
        let place = garment.place.clone();
        let Some(table) = garment.as_table_mut() else { continue };
        let Some(Node { value: Value::Text(name), place: name_place, .. }) = table.get("material") else { continue };
        let Some(material) = materials::find(name) else {
            let names: Vec<&str> = materials::PRESETS.iter().map(|m| m.name).collect();
            let text = format!("there is no material `{name}`");
            return Err(sources.error(name_place, text, Some(suggestion(name, &names))));
        };
        used.push(material);
        let origin = Origin::Material(material.name.to_owned());
        if table.get("total_mass").is_none() {
            table.fill("density", Value::Float(material.density), &place, origin.clone());
        }
        table.fill("thickness", Value::Float(material.thickness), &place, origin.clone());
        fill_springs(table, "stretch", material.stretch_stiffness, material, &place);
        fill_springs(table, "bending", material.bending_stiffness, material, &place);
    }
    Ok(used)
}

fn fill_springs(garment: &mut Table, effect: &str, stiffness: f64, material: &Material, place: &Place) {
    let origin = Origin::Material(material.name.to_owned());
    garment.fill(effect, Value::Table(Table::default()), place, origin.clone());
    let Some(table) = garment.get_mut(effect).and_then(Node::as_table_mut) else {
        return;
    };
    if table.get("spring_stiffness").is_none() {
        table.fill("stiffness", Value::Float(stiffness), place, origin.clone());
    }
    table.fill("damping_ratio", Value::Float(material.damping_ratio), place, origin);
}

/// Friction and thickness of bodies that do not say them: the largest of the materials that touch them.
fn fill_bodies(root: &mut Node, used: &[&Material]) {
    let Some(Node { value: Value::Array(bodies), .. }) = root.as_table_mut().and_then(|t| t.get_mut("body")) else {
        return;
    };
    let largest = |of: fn(&Material) -> f64| used.iter().copied().max_by(|a, b| of(a).total_cmp(&of(b)));
    for body in bodies {
        let place = body.place.clone();
        let Some(table) = body.as_table_mut() else { continue };
        if let Some(material) = largest(|m| m.friction) {
            let origin = Origin::Material(material.name.to_owned());
            table.fill("friction", Value::Float(material.friction), &place, origin);
        }
        if let Some(material) = largest(|m| m.thickness) {
            let origin = Origin::Material(material.name.to_owned());
            table.fill("thickness", Value::Float(material.thickness), &place, origin);
        }
    }
}

/// Name of the shot where it is left out: that of the file.
pub(super) fn fill_shot_name(root: &mut Node, file_stem: &str) {
    if let Some(shot) = root.as_table_mut().and_then(|t| t.get_mut("shot")) {
        let place = shot.place.clone();
        if let Some(table) = shot.as_table_mut() {
            table.fill("name", Value::Text(file_stem.to_owned()), &place, Origin::Default);
        }
    }
}
