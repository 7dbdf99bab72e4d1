//! Materials in files, one a file: `NAME.toml` in a folder that is searched.
//!
//! ```toml
//! summary = "velvet for curtains"
//! density = "420 g/m²"
//! thickness = "1.2 mm"
//! stretch_stiffness = "300 N/m"
//! bending_rigidity = "40 µN·m"
//! damping_ratio = 2.0
//! friction = 0.45
//! provenance = "measured on three swatches"
//! # What may be left out: for membrane elements, and for the strain limit.
//! warp = "350 N/m"              # stretch_stiffness
//! weft = "250 N/m"              # stretch_stiffness
//! shear = "60 N/m"              # that of a sheet alike in all directions with a Poisson's ratio of 0.25
//! strain_limit = "8 %"          # 10 %
//! # The curve of force by strain in long steps: what it carries at the largest strain. Left out, it does not stiffen.
//! load = "490 N/m"              # none
//! linearity = 0.65              # 0.6
//! ```

use std::borrow::Cow;
use std::path::{Path as FilePath, PathBuf};

use drapery_core::settings::Dimension;
use serde::Deserialize;

use crate::error::IoError;
use crate::materials::Material;

use super::deserialize;
use super::diagnostics::SceneFileError;
use super::raw::Quantity;
use super::tree::{self, Node, Origin, Path, Place, Sources};

/// Ending of material files.
const ENDING: &str = "toml";

/// Poisson's ratio of cloth whose shear stiffness is not said, and its largest strain.
const POISSON: f64 = 0.25;
const STRAIN_LIMIT: f64 = 0.1;

/// Linearity of a curve of which only the load is said.
const LINEARITY: f64 = 0.6;

/// A material file as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialFile {
    /// Short description.
    #[serde(default)]
    summary: String,
    density: Quantity,
    thickness: Quantity,
    stretch_stiffness: Quantity,
    bending_rigidity: Quantity,
    damping_ratio: Quantity,
    friction: Quantity,
    warp: Option<Quantity>,
    weft: Option<Quantity>,
    shear: Option<Quantity>,
    strain_limit: Option<Quantity>,
    load: Option<Quantity>,
    linearity: Option<Quantity>,
    /// Source of the numbers.
    #[serde(default)]
    provenance: String,
}

/// All material files in folders, each folder in the order of the names. Folders that do not exist hold none.
///
/// # Errors
/// A folder cannot be read.
pub fn material_files(folders: &[PathBuf]) -> Result<Vec<PathBuf>, IoError> {
    let mut found = Vec::new();
    for folder in folders {
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => continue,
            Err(error) => return Err(IoError::reading(folder, error)),
        };
        let mut paths = Vec::new();
        for entry in entries {
            let path = entry.map_err(|error| IoError::reading(folder, error))?.path();
            if path.extension().is_some_and(|ending| ending == ENDING) && path.is_file() {
                paths.push(path);
            }
        }
        paths.sort();
        found.extend(paths);
    }
    Ok(found)
}

/// Reads a material file; the material is named like the file.
///
/// # Errors
/// The file cannot be read, or something in it is missing, misspelt or out of range; the first such place.
pub fn read_material(path: &FilePath) -> Result<Material, SceneFileError> {
    read(path, &mut Sources::new("", ""), None)
}

/// The file of a material: the first in the folders. Only plain names are looked for.
pub(super) fn find(name: &str, folders: &[PathBuf]) -> Option<PathBuf> {
    if name.is_empty() || name.contains(['/', '\\']) {
        return None;
    }
    let paths: Vec<PathBuf> = folders.iter().map(|folder| folder.join(format!("{name}.{ENDING}"))).collect();
    let file = paths.iter().find(|path| path.is_file());
    // What is there and no file is named when it is read.
    file.or_else(|| paths.iter().find(|path| path.symlink_metadata().is_ok())).cloned()
}

/// Names of the materials in folders, for messages: a folder that cannot be read has none.
pub(super) fn names(folders: &[PathBuf]) -> Vec<String> {
    material_files(folders).unwrap_or_default().iter().map(|path| name_of(path)).collect()
}

fn name_of(path: &FilePath) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Reads a material file as one more source; `asked_at` is where a scene names it.
pub(super) fn read(
    path: &FilePath,
    sources: &mut Sources,
    asked_at: Option<&Place>,
) -> Result<Material, SceneFileError> {
    let text = super::read_text(path, asked_at.map(|place| sources.location(place)))?;
    let source = sources.add(path.to_string_lossy().into_owned(), &text);
    let root = tree::parse(sources, source, &Origin::Scene)?;
    let file: MaterialFile = deserialize::read(&root, sources, |_| Vec::new())?;
    let number = |key: &str, quantity: &Quantity, dimension: Dimension, zero: bool| {
        let value = quantity.si(dimension).map_err(|text| error(&root, sources, key, text))?;
        let is_right = value.is_finite() && if zero { value >= 0.0 } else { value > 0.0 };
        let wanted = if zero { "zero or more" } else { "a number above zero" };
        is_right.then_some(value).ok_or_else(|| {
            let text = format!("{value} {} is out of range; expected {wanted}", dimension.si_unit());
            error(&root, sources, key, text.replace("  ", " "))
        })
    };
    let or = |key: &str, quantity: &Option<Quantity>, dimension: Dimension, otherwise: f64| match quantity {
        Some(quantity) => number(key, quantity, dimension, false),
        None => Ok(otherwise),
    };
    let stretch = number("stretch_stiffness", &file.stretch_stiffness, Dimension::Stiffness, false)?;
    let membrane = [
        or("warp", &file.warp, Dimension::Stiffness, stretch)?,
        or("weft", &file.weft, Dimension::Stiffness, stretch)?,
        or("shear", &file.shear, Dimension::Stiffness, stretch / (2.0 * (1.0 + POISSON)))?,
    ];
    Ok(Material {
        name: Cow::Owned(name_of(path)),
        density: number("density", &file.density, Dimension::ArealDensity, false)?,
        thickness: number("thickness", &file.thickness, Dimension::Length, false)?,
        stretch_stiffness: stretch,
        membrane,
        bending_rigidity: number("bending_rigidity", &file.bending_rigidity, Dimension::BendingRigidity, false)?,
        strain_limit: or("strain_limit", &file.strain_limit, Dimension::None, STRAIN_LIMIT)?,
        load: file.load.as_ref().map(|load| number("load", load, Dimension::Stiffness, false)).transpose()?,
        linearity: or("linearity", &file.linearity, Dimension::None, LINEARITY)?,
        damping_ratio: number("damping_ratio", &file.damping_ratio, Dimension::None, true)?,
        friction: number("friction", &file.friction, Dimension::None, true)?,
        summary: Cow::Owned(file.summary),
        provenance: Cow::Owned(file.provenance),
    })
}

fn error(root: &Node, sources: &Sources, key: &str, text: String) -> SceneFileError {
    sources.error(&Path::default().key(key).place(root), format!("`{key}`: {text}"), None)
}

#[cfg(test)]
mod tests {
    use super::super::{SearchPaths, load_with};
    use super::*;
    use crate::shot_description::ShotDescription;

    const VELVET: &str = "density = \"420 g/m²\"\nthickness = \"1.2 mm\"\nstretch_stiffness = \"300 N/m\"\n\
                          bending_rigidity = \"0.04 mN·m\"\ndamping_ratio = 2\nfriction = 0.45\n";

    const SCENE: &str = "drapery = 1\n[shot]\nframes = \"1-2\"\n[gravity]\n[[body]]\nname = \"ball\"\n\
                         shape = { sphere = { radius = 0.2 } }\n[[garment]]\nname = \"curtain\"\n\
                         panel = { resolution = 4 }\nmaterial = \"velvet\"\n";

    /// A scene and a folder of materials beside it.
    fn folder(scene: &str, materials: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a temporary folder");
        std::fs::write(folder.path().join("scene.toml"), scene).expect("it can be written to");
        std::fs::create_dir(folder.path().join("cloth")).expect("it can be written to");
        for (name, text) in materials {
            std::fs::write(folder.path().join("cloth").join(name), text).expect("it can be written to");
        }
        folder
    }

    fn resolve(folder: &tempfile::TempDir, materials: &[&str]) -> Result<ShotDescription, SceneFileError> {
        let materials = materials.iter().map(|name| folder.path().join(name)).collect();
        let search = SearchPaths { materials, ..SearchPaths::default() };
        let scene = load_with(&folder.path().join("scene.toml"), &[], &search)?;
        scene.resolve().map_err(|mut errors| errors.remove(0))
    }

    #[test]
    fn a_material_file_fills_what_a_preset_fills_and_is_an_input() {
        let folder = folder(SCENE, &[("velvet.toml", VELVET)]);
        let shot = resolve(&folder, &["nowhere", "cloth"]).unwrap_or_else(|error| panic!("{error}"));
        for line in
            ["density = 0.42 ", "thickness = 0.0012 ", "stiffness = 300.0 ", "stiffness = 4e-5 ", "friction = 0.45 "]
        {
            let found = shot.resolved.lines().find(|text| text.starts_with(line));
            assert!(found.is_some_and(|text| text.ends_with("# material velvet")), "{line}\n{}", shot.resolved);
        }
        assert!(shot.input_files.contains(&folder.path().join("cloth/velvet.toml")));
        // What was resolved runs where the material is not found.
        std::fs::write(folder.path().join("scene.toml"), &shot.resolved).expect("it can be written to");
        let again = resolve(&folder, &[]).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(format!("{:?}", again.scene.garments), format!("{:?}", shot.scene.garments));
        assert_eq!(format!("{:?}", again.scene.bodies), format!("{:?}", shot.scene.bodies));
    }

    #[test]
    fn a_material_completes_the_curve_of_a_garment_where_its_own_stiffness_counts() {
        let stiffening = format!("{VELVET}load = \"490 N/m\"\n");
        let brought = |material: &str, more: &str| {
            let folder =
                folder(&format!("{SCENE}{more}[solver]\nintegrator = \"tr_bdf2\"\n"), &[("velvet.toml", material)]);
            let shot = resolve(&folder, &["cloth"]).unwrap_or_else(|error| panic!("{error}"));
            let has = |start: &str| shot.resolved.lines().any(|line| line.starts_with(start));
            ["load = 490.0 ", "linearity = 0.6 "].map(has)
        };
        assert_eq!(brought(&stiffening, "[garment.stretch]\nextension = 0.08\n"), [true; 2]);
        assert_eq!(brought(&stiffening, "[garment.membrane]\nextension = 0.08\n"), [true; 2]);
        assert_eq!(brought(&stiffening, ""), [false; 2]);
        assert_eq!(brought(VELVET, "[garment.stretch]\nextension = 0.08\n"), [false; 2]);
        assert_eq!(brought(&stiffening, "[garment.stretch]\nextension = 0.08\nstiffness = 200\n"), [false; 2]);
    }

    #[test]
    fn presets_go_first_and_an_unknown_name_is_compared_with_files_too() {
        let scene = SCENE.replace("velvet", "paper");
        let shot = resolve(&folder(&scene, &[("paper.toml", VELVET)]), &["cloth"]).unwrap_or_else(|e| panic!("{e}"));
        assert!(shot.resolved.contains("density = 0.1 "), "{}", shot.resolved);
        let folder = folder(&SCENE.replace("velvet", "velvte"), &[("velvet.toml", VELVET)]);
        let error = resolve(&folder, &["cloth"]).expect_err("a misspelt name").to_string();
        assert!(error.contains("no material `velvte`") && error.contains("did you mean `velvet`?"), "{error}");
    }

    #[test]
    fn a_material_file_that_cannot_be_used_is_an_error_at_its_own_line() {
        for (from, to, words) in [
            ("density", "densty", "velvet.toml:1:1: unknown key `densty`"),
            ("density", "densty", "did you mean `density`?"),
            ("friction = 0.45\n", "", "`friction` is missing"),
            ("1.2 mm", "-1.2 mm", "velvet.toml:2:13: `thickness`: -0.0012 m is out of range"),
            ("300 N/m", "300 N", "velvet.toml:3:21: "),
            ("friction = ", "shear = \"-174 N/m\"\nfriction = ", "`shear`: -174 N/m is out of range"),
        ] {
            let folder = folder(SCENE, &[("velvet.toml", &VELVET.replace(from, to))]);
            let error = resolve(&folder, &["cloth"]).expect_err(to).to_string();
            assert!(error.contains(words), "`{words}` in\n{error}");
        }
    }

    #[test]
    fn material_files_are_listed_by_folder_and_name() {
        let folder = folder(SCENE, &[("velvet.toml", VELVET), ("felt.toml", VELVET), ("notes.txt", "")]);
        let folders = [folder.path().join("nowhere"), folder.path().join("cloth")];
        let files = material_files(&folders).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(files, [folders[1].join("felt.toml"), folders[1].join("velvet.toml")]);
        assert_eq!(read_material(&files[0]).unwrap_or_else(|error| panic!("{error}")).name, "felt");
    }
}
