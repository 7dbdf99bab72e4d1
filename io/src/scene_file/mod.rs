//! The scene file: TOML with units, parameters and presets, resolved to what the solver simulates.
//!
//! ```toml
//! drapery = 1
//! [parameters]
//! resolution = 40
//! [shot]
//! frames = "1001-1100"
//! [gravity]
//! [[garment]]
//! name = "sheet"
//! panel = { resolution = "$resolution" }
//! material = "cotton_shirting"
//! [[garment.pin]]
//! corners = ["i0j0", "i0jn"]
//! ```
//!
//! [`load`] reads a file, replaces parameters and applies `--set`; [`SceneFile::resolve`] opens the meshes that it
//! names. What is not understood is an error that shows the line: a misspelt key must not cost a night of simulation.
//! Positions, velocities and times in the scene file are SI with Y up; `[units]` are those of the mesh files.

mod bodies;
mod channels;
mod check;
mod contacts;
mod curves;
mod defaults;
mod deserialize;
mod diagnostics;
mod effects;
mod fields;
mod file_names;
mod frame_rate;
mod garment_parts;
mod garments;
mod maps;
mod material_files;
mod memory;
mod mesh_files;
mod pair_friction;
mod parameters;
mod pins;
mod presets;
mod random;
mod ranges;
mod raw;
mod render_mesh;
mod resolve;
mod resolved;
mod schema;
mod seams;
mod search;
mod shape;
mod shapes;
mod start;
mod thickness;
mod tree;

use std::path::{Path as FilePath, PathBuf};

use serde::de::DeserializeOwned;

use crate::input_file;
use crate::memory_mesh::MemoryMeshes;
use crate::shot_description::{Fabric, ShotDescription};

pub use defaults::Defaults;
pub use diagnostics::{Location, SceneErrorKind, SceneFileError};
pub use material_files::{material_files, read_material};
pub use raw::UNSAID;
pub use resolved::names_file;
pub use schema::schema;
pub use search::{PathMaps, SearchPaths};

use curves::{Curve, MapKeys};
use tree::{Node, Origin, Path, Sources, Table};

/// Version of the format that this program reads.
const VERSION: u32 = 1;

/// A scene file that was read, with parameters, overrides, presets and defaults in place.
#[derive(Debug, Clone)]
pub struct SceneFile {
    document: raw::Document,
    root: Node,
    sources: Sources,
    parameters: Table,
    /// For each garment its material, if it has one.
    fabrics: Vec<Option<Fabric>>,
    material_files: Vec<PathBuf>,
    folder: PathBuf,
    path: PathBuf,
    /// Meshes that it may name beside files.
    meshes: MemoryMeshes,
    /// Numbers that change over time.
    curves: Vec<Curve>,
    /// Maps that change over time.
    map_curves: Vec<MapKeys>,
}

/// Reads a scene file. `overrides` are the `--set` arguments: the name of a parameter or a dotted key, and its value.
///
/// # Errors
/// The file cannot be read, is not TOML, or says something that is not understood; the first such place.
pub fn load(path: &FilePath, overrides: &[(String, String)]) -> Result<SceneFile, SceneFileError> {
    load_with(path, overrides, &SearchPaths::default())
}

/// As [`load`], with files found where `search` says.
///
/// # Errors
/// As [`load`]; a material file that cannot be used.
pub fn load_with(
    path: &FilePath,
    overrides: &[(String, String)],
    search: &SearchPaths,
) -> Result<SceneFile, SceneFileError> {
    let text = read_text(path, None)?;
    let folder = path.parent().unwrap_or(FilePath::new(""));
    let scene = parse_with(&text, &path.to_string_lossy(), folder, overrides, search)?;
    Ok(SceneFile { path: path.to_owned(), ..scene })
}

/// Reads a scene from text. `name` is used in messages and, without its folder and ending, as the name of a shot that
/// has none; files in the scene are relative to `folder`.
///
/// # Errors
/// As [`load`].
pub fn parse(
    text: &str,
    name: &str,
    folder: &FilePath,
    overrides: &[(String, String)],
) -> Result<SceneFile, SceneFileError> {
    parse_with(text, name, folder, overrides, &SearchPaths::default())
}

/// As [`parse`], with files found where `search` says.
///
/// # Errors
/// As [`load_with`].
pub fn parse_with(
    text: &str,
    name: &str,
    folder: &FilePath,
    overrides: &[(String, String)],
    search: &SearchPaths,
) -> Result<SceneFile, SceneFileError> {
    let mut sources = Sources::new(name, text);
    let mut root = tree::parse(&sources, 0, &Origin::Scene)?;
    parameters::override_values(&mut root, &mut sources, overrides)?;
    let parameters = parameters::take(&mut root, &sources)?;
    parameters::substitute(&mut root, &parameters, &sources)?;
    let stem = FilePath::new(name).file_stem().map_or_else(|| "scene".to_owned(), |s| s.to_string_lossy().into_owned());
    presets::fill_shot_name(&mut root, &stem);
    let (fabrics, material_files) = presets::fill(&mut root, &mut sources, &search.materials)?;
    search.maps.apply_to_files(&mut root);
    let curves = curves::take(&mut root, &sources, folder)?;
    let map_curves = curves::take_maps(&mut root, &sources)?;
    let here = effects::take_lacking(&mut root, &sources);
    let checked = effects::check_and_fill(&mut root, &sources);
    let refused = [here, checked].into_iter().filter_map(Result::err).reduce(SceneFileError::and);
    let of_effects = effects::tables(&root).into_iter().map(|(_, path)| path);
    let own = fields::without(root.clone(), of_effects);
    let document: raw::Document = match (refused, deserialize::read(&own, &sources, names_at)) {
        (None, read) => read?,
        (Some(first), Err(other)) => return Err(first.and(other)),
        (Some(error), Ok(_)) => return Err(error),
    };
    if document.drapery != VERSION {
        let place = Path::default().key("drapery").place(&root);
        let text = format!("this scene has version {}; this program reads version {VERSION}", document.drapery);
        return Err(sources.error(&place, text, Some("a newer Drapery may read it".to_owned())));
    }
    // After all keys are known: a key that is missing may be a misspelt one.
    fields::check(&root, &sources)?;
    shape::check(&root, &sources)?;
    ranges::check(&own, &sources)?;
    let mut defaults = toml::Value::try_from(&document)
        .map_err(|error| sources.error(&root.place, format!("this scene cannot be written back: {error}"), None))?;
    fields::add_defaults(&mut defaults);
    root.fill_from(&defaults);
    let (folder, path) = (folder.to_owned(), PathBuf::new());
    let meshes = MemoryMeshes::default();
    Ok(SceneFile {
        document,
        root,
        sources,
        parameters,
        fabrics,
        material_files,
        folder,
        path,
        meshes,
        curves,
        map_curves,
    })
}

/// Keys that may stand at a path beside those that serde knows.
fn names_at(path: &Path) -> Vec<&'static str> {
    [effects::names_at(path), fields::names_at(path)].concat()
}

/// The text of a scene, or of another file in TOML; `asked_at` is where a scene names it.
fn read_text(path: &FilePath, asked_at: Option<Location>) -> Result<String, SceneFileError> {
    input_file::text(path).map_err(|error| SceneFileError::of_file(asked_at, &error))
}

/// Reads a file in TOML that is no scene, with the same messages.
///
/// # Errors
/// The file cannot be read, is not TOML, or does not fit the type; the first such place.
pub fn read_table<T: DeserializeOwned>(path: &FilePath) -> Result<T, SceneFileError> {
    let sources = Sources::new(&path.to_string_lossy(), &read_text(path, None)?);
    deserialize::read(&tree::parse(&sources, 0, &Origin::Scene)?, &sources, |_| Vec::new())
}

impl SceneFile {
    /// The scene with meshes in memory, which it names `memory:NAME` in the place of files.
    #[must_use]
    pub fn with_meshes(self, meshes: MemoryMeshes) -> Self {
        Self { meshes, ..self }
    }

    /// Opens the files that the scene names, generates the other meshes, and turns everything into SI units.
    ///
    /// # Errors
    /// Every problem found: of the scene file with its place, and of the files it names.
    pub fn resolve(&self) -> Result<ShotDescription, Vec<SceneFileError>> {
        self.resolve_on(1)
    }

    /// The same for `ranks` ranks, of which each has to have room for its share of the garments.
    ///
    /// # Errors
    /// As [`SceneFile::resolve`].
    pub fn resolve_on(&self, ranks: usize) -> Result<ShotDescription, Vec<SceneFileError>> {
        resolve::resolve(self, ranks)
    }

    /// Value of a parameter that is a number.
    pub fn number(&self, parameter: &str) -> Option<f64> {
        match self.parameters.get(parameter)?.value {
            tree::Value::Integer(number) => Some(number as f64),
            tree::Value::Float(number) => Some(number),
            _ => None,
        }
    }

    /// Name of the shot.
    pub fn name(&self) -> &str {
        &self.document.shot.name
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod effects_tests;
