//! `drapery materials`: presets and material files, and where their numbers come from.

use std::borrow::Cow;

use drapery_core::settings::nearest;
use drapery_io::materials::{self, Material, PRESETS};
use drapery_io::scene_file::{material_files, read_material};
use serde_json::{Value, json};

use crate::args::ListArgs;
use crate::config::Environment;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Lists all materials that a scene would find, or one of them. Files that cannot be read are an error after the list of the others.
pub(crate) fn materials(args: &ListArgs, around: &Environment) -> Result<ExitCode, Failure> {
    let mut all: Vec<(Cow<'_, Material>, String)> =
        PRESETS.iter().map(|material| (Cow::Borrowed(material), "preset".to_owned())).collect();
    let mut broken = Vec::new();
    for file in material_files(&around.search(&args.materials).value.materials)? {
        let material = match read_material(&file) {
            Ok(material) => material,
            Err(error) => {
                broken.push(error);
                continue;
            }
        };
        let place = file.display();
        let place = match materials::find(&material.name) {
            Some(_) => format!("{place}; not used: a preset of this name takes precedence"),
            None if all.iter().any(|(known, _)| known.name == material.name) => {
                format!("{place}; not used: an earlier folder has a material of this name")
            }
            None => place.to_string(),
        };
        all.push((Cow::Owned(material), place));
    }
    if let Some(name) = &args.name {
        let names: Vec<String> = all.iter().map(|(material, _)| material.name.to_string()).collect();
        all.retain(|(material, _)| material.name == name.as_str());
        if all.is_empty() && broken.is_empty() {
            let help = match nearest(name, names.iter().map(String::as_str)) {
                Some(best) => format!("did you mean `{best}`?"),
                None => format!("use one of {}", names.join(", ")),
            };
            return Err(Failure::new(ExitCode::Usage, format!("there is no material `{name}`\n  help: {help}")));
        }
    }
    if args.json {
        let list: Vec<Value> = all.iter().map(|(material, place)| as_json(material, place)).collect();
        // Texts and numbers always have a JSON form.
        say::line(serde_json::to_string_pretty(&list).unwrap_or_default());
    } else {
        all.iter().for_each(|(material, place)| list(material, place));
    }
    // The one that was asked for is there.
    let is_found = args.name.is_some() && !all.is_empty();
    if broken.is_empty() || is_found { Ok(ExitCode::Done) } else { Err(broken.into()) }
}

/// A material for programs, in SI units.
fn as_json(material: &Material, place: &str) -> Value {
    json!({
        "name": material.name,
        "summary": material.summary,
        "density": material.density,
        "thickness": material.thickness,
        "bending_rigidity": material.bending_rigidity,
        "damping_ratio": material.damping_ratio,
        "friction": material.friction,
        "stretch_stiffness": material.stretch_stiffness,
        "membrane": material.membrane,
        "strain_limit": material.strain_limit,
        "linearity": material.linearity,
        "provenance": material.provenance,
        "from": place,
    })
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
        "  force by strain in long steps (integrator = \"tr_bdf2\"), linearity {}; | marks cloth that does not stiffen",
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
