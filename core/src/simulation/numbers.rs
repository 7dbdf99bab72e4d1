//! Numbers of the scene that change between frames: effects, bodies and contact are built anew with them, around the same state.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::checkpoint::Room;
use super::rebuild_error::RebuildError;
use super::{FrameInput, Simulation};
use crate::contact::bodies::Samples;
use crate::effects::registry::{build_each, build_one};
use crate::error::{ChangeError, Problem, Problems, StepError};
use crate::scene::Scene;
use crate::scene::number_curves::NumberCurve;
use crate::settings::SettingValue;
use crate::setup::validate::check_number;
use crate::snapshot::SnapshotError;
use crate::snapshot::saved_section::SavedSection;
use crate::solve::implicit_velocity::PartForces;
use crate::state::State;
use crate::step::{Contacts, Scratch};
use crate::volumes::Volumes;

/// Most keys of a curve at which its effect is built before the start: of more, those of the least and the largest values.
const KEYS_BUILT: usize = 8;

/// Builds each effect of which a number changes with the values of its keys: what it refuses is named before the start, not in the shot.
///
/// # Errors
/// Problems of the effects, each with its frame.
pub(super) fn check_curves_of_effects(scene: &Scene) -> Result<(), Problems> {
    let description = scene.description();
    let mut by_frame: BTreeMap<i64, BTreeSet<usize>> = BTreeMap::new();
    for (path, curve) in &description.curves {
        let Some(request) = description.effect_of_number(path) else { continue };
        for frame in telling_frames(curve) {
            by_frame.entry(frame).or_default().insert(request);
        }
    }
    let (mut problems, mut refused) = (Vec::new(), BTreeSet::new());
    for (frame, requests) in by_frame {
        let changed = Scene { description: description.clone().with_numbers_at(frame), ..scene.clone() }.derive();
        for request in requests {
            let built = build_one(&changed, &changed.description().effects[request], true);
            if let Some(found) = built.err().filter(|_| refused.insert(request)) {
                let at = |problem: Problem| Problem { what: format!("at frame {frame}: {}", problem.what), ..problem };
                problems.extend(found.into_iter().map(at));
            }
        }
    }
    if problems.is_empty() { Ok(()) } else { Err(Problems(problems)) }
}

/// Frames of the keys of a curve, or of its least and largest values.
fn telling_frames(curve: &NumberCurve) -> Vec<i64> {
    let whole = |frame: f64| frame.round() as i64;
    if curve.len() <= KEYS_BUILT {
        return curve.iter().map(|(frame, _)| whole(*frame)).collect();
    }
    let components = |value: &SettingValue| match value {
        SettingValue::Vector(vector) => vector.to_vec(),
        SettingValue::Number(number) => vec![*number],
        _ => Vec::new(),
    };
    let count = curve.first().map_or(0, |(_, value)| components(value).len());
    let extremes = (0..count).flat_map(|component| {
        let by_value = |a: &&(f64, SettingValue), b: &&(f64, SettingValue)| {
            components(&a.1)[component].total_cmp(&components(&b.1)[component])
        };
        [curve.iter().min_by(by_value), curve.iter().max_by(by_value)]
    });
    let mut frames: Vec<i64> = extremes.flatten().map(|(frame, _)| whole(*frame)).collect();
    frames.sort_unstable();
    frames.dedup();
    frames
}

/// Error of the scene in the words of a snapshot.
fn of_scene(what: String) -> SnapshotError {
    SnapshotError { section: "scene".into(), what }
}

impl Simulation {
    /// Gives numbers of the scene other values from the next step on, by their paths (`garment.skirt.stretch.stiffness`,
    /// `body.hero.friction`), in SI units. Between frames; all ranks call it together with the same numbers. A snapshot does not
    /// hold them.
    ///
    /// # Errors
    /// The scene has no such number, the value does not fit it, or a curve of the scene changes it; nothing has changed then. After
    /// [`ChangeError::Broken`] the simulation may not be used any more.
    pub fn set(&mut self, numbers: &[(String, SettingValue)]) -> Result<(), ChangeError> {
        let description = self.scene.description();
        for (path, value) in numbers {
            let problem = |what: String, advice: &str| ChangeError::Refused(Problem::scene(path.clone(), what, advice));
            check_number(description, path, value).map_err(|(what, advice)| problem(what, advice))?;
            if description.curves.contains_key(path) {
                return Err(problem("a curve of the scene changes this number".into(), "remove the curve"));
            }
        }
        self.change_numbers(numbers, None).map_err(|error| match error {
            RebuildError::Refused(error) => {
                ChangeError::Refused(Problem::scene("numbers", error.what, "set other values"))
            }
            RebuildError::Broken(error) => ChangeError::Broken(Problem::scene(
                "numbers",
                error.what,
                "restore a state, or prepare the scene again",
            )),
        })
    }

    /// Gives the numbers that have curves their values at the frame of `input`. All ranks call it together.
    pub(super) fn follow_curves(&mut self, input: &FrameInput) -> Result<(), StepError> {
        let description = self.scene.description();
        if description.curves.is_empty() && description.garments.iter().all(|garment| garment.map_curves.is_empty()) {
            return Ok(());
        }
        let numbers = self.scene.description().numbers_at(input.frame);
        self.change_numbers(&numbers, Some(input.frame)).map_err(|error| match error {
            RebuildError::Refused(SnapshotError { what, .. }) => StepError::Input { frame: input.frame, what },
            RebuildError::Broken(SnapshotError { what, .. }) => StepError::Broken { frame: input.frame, what },
        })
    }

    /// Builds everything anew if these numbers, or the maps of a frame, differ from the present ones.
    fn change_numbers(&mut self, numbers: &[(String, SettingValue)], frame: Option<i64>) -> Result<(), RebuildError> {
        let mut description = self.scene.description().clone();
        let mut changes = false;
        for (path, value) in numbers {
            changes |= description.set_number(path, value).map_err(|what| RebuildError::Refused(of_scene(what)))?;
        }
        let has_maps = description.garments.iter().any(|garment| !garment.map_curves.is_empty());
        if !(changes || has_maps) {
            return Ok(());
        }
        let mut scene = Scene { description, ..(*self.scene).clone() };
        changes |= frame.is_some_and(|frame| scene.set_maps_at(frame as f64));
        if !changes {
            return Ok(());
        }
        let scene = Arc::new(scene.derive());
        let memory = self.saved_sections();
        self.rebuild(scene, None, &memory)
    }

    /// Builds effects, bodies and contact of another form of the scene around the state in `memory`, with `tracks` where they change.
    /// The parts to be replaced are dropped first: the old and the new ones together would be the memory peak of the run.
    ///
    /// # Errors
    /// [`RebuildError::Refused`] if the effects cannot be built; the simulation is then built as it was. [`RebuildError::Broken`] if
    /// that fails too, or `memory` does not fit.
    pub(super) fn rebuild(
        &mut self,
        scene: Arc<Scene>,
        tracks: Option<Vec<Samples>>,
        memory: &[(&'static Room, SavedSection)],
    ) -> Result<(), RebuildError> {
        let broken = |problems: Problems| RebuildError::Broken(of_scene(problems.to_string()));
        self.drop_what_is_built();
        let (scene, effects, refused) = match build_each(&scene, true) {
            Ok(effects) => (scene, effects, Ok(())),
            Err(problems) => {
                let present = Arc::clone(&self.scene);
                let effects = build_each(&present, true).map_err(broken)?;
                (present, effects, Err(RebuildError::Refused(of_scene(problems.to_string()))))
            }
        };
        let tracks = tracks.filter(|_| refused.is_ok()).unwrap_or_else(|| std::mem::take(&mut self.prescribed.tracks));
        let mut bodies = std::mem::take(&mut self.prescribed.bodies);
        bodies.take_properties(&scene);
        let wind = std::mem::take(&mut self.dynamics.wind);
        let mut built =
            Self::with(Arc::clone(&scene), effects, State::at_start(&scene), (bodies, tracks, wind)).map_err(broken)?;
        built.restore_sections(self.frame, memory).map_err(RebuildError::Broken)?;
        (built.sent, built.balance) = (self.sent, self.balance.clone());
        std::mem::swap(&mut built.metrics, &mut self.metrics);
        built.observer = self.observer.take();
        std::mem::swap(&mut built.crossings, &mut self.crossings);
        std::mem::swap(&mut built.warnings, &mut self.warnings);
        std::mem::swap(&mut built.start_crossings, &mut self.start_crossings);
        std::mem::swap(&mut built.start_inside, &mut self.start_inside);
        std::mem::swap(&mut built.start_layers, &mut self.start_layers);
        std::mem::swap(&mut built.start_lengths, &mut self.start_lengths);
        *self = built;
        refused
    }

    /// Drops what follows from the scene and from the sections of a snapshot, and takes much memory.
    fn drop_what_is_built(&mut self) {
        self.contacts = Contacts::default();
        self.cloth.scratch = Scratch::default();
        self.dynamics.forces = PartForces::default();
        self.dynamics.filters.clear();
        self.dynamics.volumes = Volumes::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::mesh::PolygonMesh;
    use crate::scene::{EffectRequest, GarmentDescription, SceneDescription};

    #[test]
    fn a_refused_change_leaves_the_simulation_whole_and_one_whose_memory_does_not_fit_breaks_it() {
        let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
        let mut description = SceneDescription::new("fall");
        description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
        description.effects.push(EffectRequest::of_scene("gravity"));
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let mut simulation =
            Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|problems| panic!("{problems}"));
        let present = Arc::clone(&simulation.scene);
        let mut wrong = (*present).clone();
        wrong.description.effects.push(EffectRequest::of_scene("gravity").with("acceleration", 1.0));
        let memory = simulation.saved_sections();
        let refused = simulation.rebuild(Arc::new(wrong), None, &memory);
        assert!(matches!(refused, Err(RebuildError::Refused(_))), "{refused:?}");
        simulation.advance(&FrameInput::to_frame(1)).expect("it is whole");
        assert!(simulation.cloth.state.x.iter().all(|x| x.y < 0.0), "its forces act");
        // The state of another frame.
        let broken = simulation.rebuild(present, None, &memory);
        assert!(matches!(broken, Err(RebuildError::Broken(_))), "{broken:?}");
    }
}
