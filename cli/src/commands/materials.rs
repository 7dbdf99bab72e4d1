//! `drapery materials`: presets and material files, and where their numbers come from.

use drapery_io::materials::{self, Material, PRESETS};
use drapery_io::scene_file::{material_files, read_material};

use crate::args::MaterialsArgs;
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Lists all materials that a scene would find.
pub(crate) fn materials(args: &MaterialsArgs, around: &Environment) -> Result<ExitCode, Failure> {
    for material in PRESETS {
        list(material, "preset");
    }
    let mut found = Vec::new();
    for file in material_files(&around.search(args).value.materials)? {
        let material = read_material(&file)?;
        let place = file.display();
        match materials::find(&material.name) {
            Some(_) => list(&material, &format!("{place}; not used, the preset of this name goes first")),
            None if found.contains(&material.name) => {
                list(&material, &format!("{place}; not used, a folder named before has one of this name"));
            }
            None => list(&material, &place.to_string()),
        }
        found.push(material.name);
    }
    Ok(ExitCode::Done)
}

fn list(material: &Material, place: &str) {
    say::line(format_args!("{}: {}", material.name, material.summary).to_string().trim_end_matches(": "));
    let [warp, weft, shear] = material.membrane;
    say::line(format_args!(
        "  density {} kg/m², thickness {} mm, bending {} µN·m, damping {}, friction {}",
        material.density,
        1e3 * material.thickness,
        (1e7 * material.bending_rigidity).round() / 10.0,
        material.damping_ratio,
        material.friction
    ));
    say::line(format_args!(
        "  stretch {} N/m (warp {warp}, weft {weft}, shear {shear} N/m), largest strain {} %",
        material.stretch_stiffness,
        (1e3 * material.strain_limit).round() / 10.0
    ));
    if !material.provenance.is_empty() {
        say::line(format_args!("  {}", material.provenance));
    }
    say::line(format_args!("  from: {place}"));
}
