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
        (1e6 * material.thickness).round() / 1e3,
        (1e7 * material.bending_rigidity).round() / 10.0,
        material.damping_ratio,
        material.friction
    ));
    say::line(format_args!(
        "  stretch {} N/m (warp {warp}, weft {weft}, shear {shear} N/m), largest strain {} %",
        material.stretch_stiffness,
        (1e3 * material.strain_limit).round() / 10.0
    ));
    plot_curve(material);
    if !material.provenance.is_empty() {
        say::line(format_args!("  {}", material.provenance));
    }
    say::line(format_args!("  from: {place}"));
}

/// Shares of the largest strain at which the curve is printed, and the length of the bar at the largest strain.
const SHARES: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];
const BAR: f64 = 40.0;

/// The curve of force by strain as bars, on which cloth that does not stiffen ends at the small line.
fn plot_curve(material: &Material) {
    let (Ok(Some(curve)), Some(load)) = (material.curve(), material.load) else { return };
    say::line(format_args!(
        "  force by strain in long steps (integrator = \"tr_bdf2\"), linearity {}; | is cloth that does not stiffen",
        material.linearity
    ));
    for strain in SHARES.map(|share| share * material.strain_limit) {
        let linear = material.stretch_stiffness * strain;
        let force = linear * curve.factor(strain);
        let [end, line] = [force, linear].map(|force| (BAR * force / load).round() as usize);
        let bar: String = (0..=end.max(line))
            .map(|at| {
                if at == line {
                    '|'
                } else if at < end {
                    '#'
                } else {
                    ' '
                }
            })
            .collect();
        say::line(format_args!("  {:>6.2} % {force:>7.1} N/m  {}", 100.0 * strain, bar.trim_end()));
    }
}
