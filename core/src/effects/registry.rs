//! Queries on all effects, and on the effects that a scene asks for.

use std::collections::BTreeMap;

use crate::effects::force::PartForce;
use crate::effects::spec::{BuildContext, Effect, EffectSpec, MapSpec, Need};
use crate::effects::stability::longest_stable_step;
use crate::effects::{LISTED, REGISTRY};
use crate::error::{Problem, Problems};
use crate::scene::{EffectRequest, Scene};
use crate::settings::Settings;

/// Lists all effects, each by its module, an optional one with the feature of the build that brings it.
macro_rules! effects {
    ($($module:ident $(if $feature:literal)?,)*) => {
        /// Table of all effects of this build, in the order of execution.
        ///
        /// ```
        /// use drapery_core::REGISTRY;
        /// let names: Vec<&str> = REGISTRY.iter().map(|spec| spec.name).collect();
        /// assert!(["gravity", "stretch", "pins", "self_collision"].iter().all(|name| names.contains(name)));
        /// ```
        pub static REGISTRY: &[&EffectSpec] = &[$($(#[cfg(feature = $feature)])? &$module::SPEC),*];

        /// Names of all effects of the program, in the order of execution.
        pub static LISTED: &[&str] = &[$(stringify!($module)),*];
    };
}

pub(crate) use effects;

/// An effect that runs, for `drapery plan`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedEffect {
    /// Name in the registry.
    pub name: &'static str,
    /// Garment it acts on; `None` for the whole scene.
    pub garment: Option<String>,
    /// Why it is there.
    pub because: String,
    /// Checked settings.
    pub settings: Settings,
    /// Source of settings in words, where the scene knows more than that it says them.
    pub sources: BTreeMap<String, String>,
    /// Structures that it needs.
    pub needs: &'static [Need],
    /// Kind of element it works on, as in "springs".
    pub kind: &'static str,
    /// Number of elements of that kind.
    pub elements: usize,
    /// Memory held [bytes].
    pub bytes: usize,
    /// Changes that the effect had to make to run well.
    pub notes: Vec<String>,
    /// Longest time step that its forces allow by themselves [s]; infinite if they set no limit.
    pub longest_step: f64,
}

/// The map of what every garment has.
static DENSITY: MapSpec = MapSpec::of("density", &[]);

/// Returns the maps that can be painted in this build, each with the effect that looks at it; `None` for the map that
/// every garment has.
pub fn maps() -> impl Iterator<Item = (&'static MapSpec, Option<&'static EffectSpec>)> {
    let of_effects = REGISTRY.iter().flat_map(|spec| spec.maps.iter().map(|map| (map, Some(*spec))));
    std::iter::once((&DENSITY, None)).chain(of_effects)
}

/// The effect of this name.
pub fn find(name: &str) -> Option<&'static EffectSpec> {
    REGISTRY.iter().copied().find(|spec| spec.name == name)
}

/// Returns the problem and the remedy for an effect that this build lacks. `None` if it is here, or if there is no
/// such effect.
pub fn lacking(name: &str) -> Option<(String, String)> {
    let name = LISTED.iter().find(|listed| **listed == name && find(listed).is_none())?;
    let what = format!("this program was built without the effect `{name}`");
    Some((what, "build it with `--features effects`, or leave the effect out".to_owned()))
}

/// Builds what the scene asks for, in the order of the registry, then in that of the garments.
///
/// # Errors
/// All problems of all effects: unknown names, settings out of range, contradictions.
pub fn build_all(scene: &Scene) -> Result<Vec<(PlannedEffect, Effect)>, Problems> {
    build_each(scene, false)
}

/// The same; `is_running` where numbers of a simulation change, which may leave an effect without work.
pub(crate) fn build_each(scene: &Scene, is_running: bool) -> Result<Vec<(PlannedEffect, Effect)>, Problems> {
    let mut requests: Vec<_> = scene.description().effects.iter().collect();
    let rank = |name: &str| REGISTRY.iter().position(|spec| spec.name == name);
    requests.sort_by_key(|r| (rank(&r.effect), r.garment));
    let mut built = Vec::new();
    let mut problems = Vec::new();
    for request in requests {
        match build_one(scene, request, is_running) {
            Ok(effect) => built.extend(effect),
            Err(found) => problems.extend(found),
        }
    }
    if problems.is_empty() { Ok(built) } else { Err(Problems(problems)) }
}

/// Builds one effect; none of a name that this build lacks.
pub(crate) fn build_one(
    scene: &Scene,
    request: &EffectRequest,
    is_running: bool,
) -> Result<Option<(PlannedEffect, Effect)>, Vec<Problem>> {
    let garment = request.garment.map(|g| scene.description().garments[g].name.clone());
    let place = garment.as_ref().map_or(request.effect.clone(), |g| format!("garment \"{g}\", {}", request.effect));
    // Scene::validate has refused unknown names.
    let Some(spec) = find(&request.effect) else { return Ok(None) };
    let wrong = |text: String| Problem::scene(&place, text, "correct it in the scene file");
    let settings = Settings::check(spec.fields, &request.settings)
        .map_err(|texts| texts.into_iter().map(wrong).collect::<Vec<_>>())?;
    let context = BuildContext { scene, garment: request.garment, is_running };
    let effect = (spec.build)(&settings, &context).map_err(|problem| vec![problem])?;
    let (because, bytes, notes) = (request.because.clone(), effect.bytes, effect.notes.clone());
    let (needs, kind, elements) = (spec.needs, spec.elements, effect.elements);
    let (name, longest_step) = (spec.name, longest_step(scene, &effect.forces));
    let sources = request.sources.clone();
    let planned =
        PlannedEffect { name, garment, because, settings, sources, needs, kind, elements, bytes, notes, longest_step };
    Ok(Some((planned, effect)))
}

/// Longest step that these forces allow by themselves on this rank [s].
fn longest_step(scene: &Scene, forces: &[PartForce]) -> f64 {
    let (ranges, solver) = (scene.parts().ranges(), &scene.description().solver);
    let mut sums = Vec::new();
    forces.iter().fold(f64::INFINITY, |longest, (part, force)| {
        let range = ranges[*part].clone();
        sums.clear();
        sums.resize(range.len(), 0.0);
        longest_stable_step(std::slice::from_ref(force), solver, &scene.masses()[range], &mut sums).min(longest)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_is_listed_under_its_name() {
        let here: Vec<&str> = LISTED.iter().copied().filter(|name| find(name).is_some()).collect();
        assert_eq!(here, REGISTRY.iter().map(|spec| spec.name).collect::<Vec<_>>());
        for name in ["gravity", "stretch", "pins", "body_collision", "self_repulsion", "self_collision"] {
            assert!(find(name).is_some(), "{name} is in every build");
        }
        assert_eq!(here.len() == LISTED.len(), cfg!(feature = "effects"), "the others are in builds with the feature");
    }

    #[test]
    fn of_an_effect_that_the_build_lacks_the_feature_is_named() {
        for name in LISTED {
            match lacking(name) {
                Some((what, advice)) => {
                    assert!(what.contains(name) && advice.contains("`--features effects`"), "{what}: {advice}");
                }
                None => assert!(find(name).is_some(), "{name}"),
            }
        }
        assert_eq!(lacking("no such effect"), None);
    }
}
