//! Search of a scene before it is simulated, rule by rule, and the warnings that come of it. The table of the rules
//! is [`drapery_io::rules`]; each has its file here.

mod body_friction;
mod density;
mod frame_rate;
mod garment_units;
mod idle_setting;
mod no_gravity;
mod no_self_collision;
mod other_diagonal;
mod outside_shot;
mod render_mesh;
mod seam_gap;
mod seam_lengths;
mod seam_through_body;
mod shape_units;
mod solid;
mod sparse_samples;
mod start_close;
mod start_speed;
mod start_state;
mod thickness_lowered;
mod thin_body;
mod unopened_format;
mod up_axis;
mod wind_speed;

use std::fmt;

use drapery_core::Vec3;
use drapery_core::scene::{EffectRequest, SceneDescription};
use drapery_core::simulation::Simulation;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_motion::InputMotion;
use drapery_io::rules::RULES;
use drapery_io::shot_description::{BodyThickness, CheckDescription, OutputDescription};

use crate::inputs::Inputs;
use crate::render_mesh::JudgedBinding;
use crate::written_faces::OtherCut;

/// A number rounded down to a number of decimals, or to more where two digits need them, so that the written value holds.
fn rounded_down(value: f64, decimals: usize) -> String {
    // Of a number above zero.
    let needed = (1.0 - value.log10().floor()).clamp(0.0, 15.0) as usize;
    let decimals = decimals.max(needed);
    let scale = 10_f64.powi(decimals as i32);
    let text = format!("{:.decimals$}", (value * scale).floor() / scale);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Something suspicious that was accepted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// The rule that it comes from, which a scene can silence; `None` for what no rule has.
    pub rule: Option<&'static str>,
    /// Object that it is about, as in `body "hero"`; empty where the message says it.
    pub object: String,
    /// Description of the finding.
    pub message: String,
    /// The line to write in the scene; empty where the message says what to do.
    pub line: String,
}

impl From<String> for Warning {
    fn from(message: String) -> Self {
        Self { rule: None, object: String::new(), message, line: String::new() }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rule, object, message, line } = self;
        if let Some(rule) = rule {
            write!(f, "{rule}: ")?;
        }
        if !object.is_empty() {
            write!(f, "{object}: ")?;
        }
        f.write_str(message)?;
        match line.is_empty() {
            true => Ok(()),
            false => write!(f, "\n  help: write {line}"),
        }
    }
}

/// Finding of a rule.
#[derive(Debug, PartialEq, Eq)]
struct Finding {
    object: String,
    message: String,
    line: String,
}

/// Facts about a shot that are known before its scene is handed out.
pub(crate) struct Facts<'a> {
    pub(crate) scene: &'a SceneDescription,
    pub(crate) inputs: &'a Inputs,
    pub(crate) garments: &'a [GarmentMesh],
    pub(crate) output: &'a OutputDescription,
    pub(crate) check: &'a CheckDescription,
    pub(crate) body_thickness: &'a [Option<BodyThickness>],
    /// Last frame of the scene, even if fewer are asked for.
    pub(crate) last_frame: i64,
}

/// Place at which a rule looks.
enum Look {
    /// At what is known before the scene is handed out.
    Facts(fn(&Facts<'_>) -> Vec<Finding>),
    /// At the simulation at its start.
    Simulation(fn(&Simulation) -> Vec<Finding>),
    /// At what crosses at the start along diagonals that the solver does not take.
    OtherCuts(fn(&[OtherCut]) -> Vec<Finding>),
    /// At how render meshes are bound.
    Bindings(fn(&[JudgedBinding]) -> Vec<Finding>),
}

/// Place at which each rule looks, by the name of the rule.
const LOOKS: [(&str, Look); RULES.len()] = [
    ("no_gravity", Look::Facts(no_gravity::find)),
    ("no_self_collision", Look::Facts(no_self_collision::find)),
    ("up_axis", Look::Facts(up_axis::find)),
    ("frame_rate", Look::Facts(frame_rate::find)),
    ("sparse_samples", Look::Facts(sparse_samples::find)),
    ("thickness_lowered", Look::Simulation(thickness_lowered::find)),
    ("thin_body", Look::Facts(thin_body::find)),
    ("other_diagonal", Look::OtherCuts(other_diagonal::find)),
    ("body_friction", Look::Facts(body_friction::find)),
    ("shape_units", Look::Facts(shape_units::find)),
    ("garment_units", Look::Facts(garment_units::find)),
    ("wind_speed", Look::Facts(wind_speed::find)),
    ("start_speed", Look::Facts(start_speed::find)),
    ("density", Look::Facts(density::find)),
    ("start_crossed", Look::Simulation(start_state::find_crossings)),
    ("start_inside", Look::Simulation(start_state::find_inside)),
    ("start_close", Look::Facts(start_close::find)),
    ("start_layers", Look::Simulation(start_state::find_layers)),
    ("start_lengths", Look::Simulation(start_state::find_lengths)),
    ("idle_setting", Look::Facts(idle_setting::find)),
    ("outside_shot", Look::Facts(outside_shot::find)),
    ("seam_gap", Look::Facts(seam_gap::find)),
    ("seam_lengths", Look::Facts(seam_lengths::find)),
    ("seam_through_body", Look::Facts(seam_through_body::find)),
    ("unopened_format", Look::Facts(unopened_format::find)),
    ("render_mesh_distance", Look::Bindings(render_mesh::find_distance)),
    ("render_mesh_layers", Look::Bindings(render_mesh::find_layers)),
    ("render_mesh_flipped", Look::Bindings(render_mesh::find_flipped)),
];

/// Warnings of the rules that look at the scene, but for those that it silences.
pub(crate) fn of_scene(facts: &Facts<'_>) -> Vec<Warning> {
    of(&facts.check.silenced, |look| match look {
        Look::Facts(find) => find(facts),
        _ => Vec::new(),
    })
}

/// Warnings of the rules that look at the simulation at its start, but for these.
pub(crate) fn of_simulation(simulation: &Simulation, silenced: &[String]) -> Vec<Warning> {
    of(silenced, |look| match look {
        Look::Simulation(find) => find(simulation),
        _ => Vec::new(),
    })
}

/// Warnings of the rules that look at how render meshes are bound, but for these.
pub(crate) fn of_bindings(bindings: &[JudgedBinding], silenced: &[String]) -> Vec<Warning> {
    of(silenced, |look| match look {
        Look::Bindings(find) => find(bindings),
        _ => Vec::new(),
    })
}

/// Warnings of the rules that look at what crosses at the start along other diagonals, but for these.
pub(crate) fn of_other_cuts(cuts: &[OtherCut], silenced: &[String]) -> Vec<Warning> {
    of(silenced, |look| match look {
        Look::OtherCuts(find) => find(cuts),
        _ => Vec::new(),
    })
}

fn of(silenced: &[String], find: impl Fn(&Look) -> Vec<Finding>) -> Vec<Warning> {
    let heard = LOOKS.iter().filter(|(name, _)| !silenced.iter().any(|silenced| silenced == name));
    let warnings = |(name, look): &(&'static str, Look)| -> Vec<Warning> {
        let named = |Finding { object, message, line }| Warning { rule: Some(name), object, message, line };
        find(look).into_iter().map(named).collect()
    };
    heard.flat_map(warnings).collect()
}

impl Facts<'_> {
    /// Finds the request of the scene for an effect.
    fn request(&self, effect: &str) -> Option<&EffectRequest> {
        self.scene.effects.iter().find(|request| request.effect == effect)
    }

    /// Whether the scene has an effect, or was told to do without.
    fn has_decided_on(&self, effect: &str) -> bool {
        self.request(effect).is_some() || self.scene.left_out.iter().any(|left_out| left_out == effect)
    }

    /// Positions of a garment at the start [m]; a garment that cannot be read is reported elsewhere.
    fn start_of(&self, garment: usize) -> Option<Vec<Vec3>> {
        self.scene.garments[garment].start.clone().or_else(|| self.garments[garment].positions().ok())
    }

    /// Returns the motions that come from files.
    fn motions(&self) -> impl Iterator<Item = &InputMotion> {
        self.inputs.bodies.iter().flatten().chain(&self.inputs.tracks)
    }

    /// Bodies from files, each with the bounds of its first pose [m]; without those that cannot be read, which is reported elsewhere.
    fn first_poses(&self) -> impl Iterator<Item = (&InputMotion, [Vec3; 2])> {
        let time = self.inputs.timeline.file_time(self.inputs.timeline.origin);
        self.inputs.bodies.iter().flatten().filter_map(move |motion| {
            let mut positions = Vec::new();
            motion.source.positions_at(time, &mut positions).ok()?;
            Some((motion, bounds(&positions)?))
        })
    }
}

/// Smallest and largest coordinates, if there are any and all are finite.
fn bounds(positions: &[Vec3]) -> Option<[Vec3; 2]> {
    let first = *positions.first()?;
    let bounds = positions.iter().fold([first; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    bounds.iter().flat_map(Vec3::iter).all(|c| c.is_finite()).then_some(bounds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_rule_of_the_table_looks_in_its_order() {
        let names: Vec<&str> = LOOKS.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, RULES.iter().map(|rule| rule.name).collect::<Vec<_>>());
    }
}
