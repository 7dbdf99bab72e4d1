//! Balances that hold whatever cloth does within itself: momentum where nothing pushes from outside, and energy, which
//! nothing within the cloth makes.
//!
//! *Momentum.* Forces between vertices come in pairs, so that P(t) = P(0) + M g t with the mass M of the cloth and gravity g.
//!
//! *Energy.* Damping, friction, plastic folds and inelastic contact only take: the sum of the energy of motion, the elastic
//! one and that of weight never grows unless something does work from outside. What damping takes is not known, so the
//! balance is an inequality.

use std::collections::BTreeSet;

use drapery_core::Vec3;
use drapery_core::effects::{find as find_effect, gravity};
use drapery_core::scene::SceneDescription;
use drapery_core::simulation::Simulation;

use crate::page::text;
use crate::study::closed_form::is_internal;
use crate::study::record::{Outside, Role, Sample, Study};
use crate::study::verdict::{Check, Verdict};

/// Largest error of momentum allowed, as a share of the largest momentum that the energy of motion can carry:
/// √(2 M K). It is a matter of rounding.
const MOMENTUM: f64 = 1e-10;

/// Energy that may appear, as a share of the largest energy of motion. Steps are of second order, and make or lose a
/// little where they follow a motion coarsely; repulsion springs give what they had stored, which is not counted.
const ENERGY: f64 = 0.01;

/// Returns the actions from outside on the cloth of a scene, of which `simulation` is the start.
pub(super) fn outside(scene: &SceneDescription, simulation: &Simulation) -> Outside {
    let plan = simulation.plan();
    let gravity = plan.iter().find(|effect| effect.name == gravity::SPEC.name);
    let gravity = gravity.map_or([0.0; 3], |effect| effect.settings.vector("acceleration"));
    let names: BTreeSet<&str> = plan.iter().map(|effect| effect.name).collect();
    let pushes: Vec<&str> = names.iter().copied().filter(|name| !is_internal(name)).collect();
    let works = |name: &&str| {
        let says = find_effect(name).and_then(|spec| spec.study.does_work);
        says.map_or_else(|| !is_internal(name), |does_work| does_work(scene))
    };
    let owned = |names: Vec<&str>| names.into_iter().map(str::to_owned).collect();
    Outside {
        mass: mass_of(simulation),
        gravity,
        pushes: owned(pushes),
        works: owned(names.iter().copied().filter(works).collect()),
    }
}

/// Mass of what moves [kg], of a simulation on one rank.
fn mass_of(simulation: &Simulation) -> f64 {
    let (scene, masses) = (simulation.scene(), simulation.scene().masses());
    let mut lives = vec![false; masses.len()];
    for (garment, mesh) in scene.meshes().iter().enumerate() {
        let first = scene.parts().garment(garment).start;
        mesh.triangles().iter().flatten().for_each(|vertex| lives[first + *vertex as usize] = true);
    }
    masses.iter().zip(lives).filter(|(_, lives)| *lives).map(|(mass, _)| mass).sum()
}

/// Runs on which the same acts as on the scene as it is.
fn runs(study: &Study) -> impl Iterator<Item = &Sample> {
    let alike = [Role::Base, Role::Accuracy, Role::Reference, Role::ReferenceCheck, Role::ReferenceCoarse];
    study.samples.iter().filter(move |sample| alike.contains(&sample.role) && sample.is_own() && sample.is_whole())
}

/// The check of a balance: of all runs the one that is farthest off, by what is allowed.
fn worst(
    name: &'static str,
    study: &Study,
    (acting, why_not): (&[String], &str),
    off: impl Fn(&Sample) -> Option<f64>,
    allowed: (f64, &str),
) -> Check {
    if study.outside.mass <= 0.0 {
        return Check::new(name, None, "external forces are not recorded".to_owned());
    }
    if !acting.is_empty() {
        let why = format!("{why_not} {}", acting.join(", "));
        return Check { name, verdict: Verdict::NotApplicable, why };
    }
    let all = runs(study).filter_map(|sample| off(sample).map(|off| (off, sample)));
    let Some((off, sample)) = all.max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return Check::new(name, None, "fewer than two frames to compare, or no motion".to_owned());
    };
    let why = format!(
        "deviates by {} of {}, in \"{}\"; {} is allowed",
        share(off),
        allowed.1,
        sample.setting.label,
        share(allowed.0)
    );
    Check::new(name, Some(off <= allowed.0), why)
}

/// A share that may be very small.
fn share(share: f64) -> String {
    if share > 0.0 && share < 1e-4 { format!("{share:.1e}") } else { format!("{} %", text::digits(100.0 * share)) }
}

/// Momentum changes by gravity alone.
pub(super) fn momentum(study: &Study) -> Check {
    let Outside { mass, gravity, pushes, .. } = &study.outside;
    let impulse = Vec3::from(*gravity) * *mass;
    let off = |sample: &Sample| {
        let largest = sample.figures.iter().map(|figures| figures.kinetic_energy).fold(0.0, f64::max);
        let times = study.compared.iter().map(|frame| study.time(*frame));
        let mut rest = times.zip(&sample.figures).map(|(t, figures)| Vec3::from(figures.momentum) - impulse * t);
        let first = rest.next()?;
        let farthest = rest.map(|now| (now - first).norm()).reduce(f64::max)?;
        (largest > 0.0).then(|| farthest / (2.0 * mass * largest).sqrt())
    };
    let allowed = (MOMENTUM, "the largest momentum");
    worst("Momentum changes by gravity alone", study, (pushes, "external forces:"), off, allowed)
}

/// Energy does not grow.
pub(super) fn energy(study: &Study) -> Check {
    let off = |sample: &Sample| {
        let largest = sample.figures.iter().map(|figures| figures.kinetic_energy).fold(0.0, f64::max);
        let mut all = sample.figures.iter().map(|figures| figures.kinetic_energy + figures.potential_energy);
        let mut least = all.next()?;
        let mut grown = None;
        for now in all {
            grown = Some(grown.unwrap_or(0.0_f64).max(now - least));
            least = least.min(now);
        }
        grown.filter(|_| largest > 0.0).map(|grown| grown / largest)
    };
    let allowed = (ENERGY, "the largest kinetic energy");
    worst("Energy does not grow", study, (&study.outside.works, "external work:"), off, allowed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::record::{Figures, SceneFacts};

    const MASS: f64 = 0.2;
    const GRAVITY: f64 = 9.81;

    /// A fall of ten frames of 0.1 s, thrown sideways; the energies of weight and of motion add up to nothing.
    fn fall() -> Study {
        let figures = |frame: i64| {
            let (time, speed) = (0.1 * frame as f64, GRAVITY * 0.1 * frame as f64);
            Figures {
                momentum: [MASS * 3.0, -MASS * speed, 0.0],
                kinetic_energy: 0.5 * MASS * (9.0 + speed * speed),
                potential_energy: -MASS * GRAVITY * 0.5 * GRAVITY * time * time,
                ..Figures::default()
            }
        };
        Study {
            scene: SceneFacts { frame_seconds: 0.1, ..SceneFacts::default() },
            outside: Outside { mass: MASS, gravity: [0.0, -GRAVITY, 0.0], ..Outside::default() },
            compared: (1..=10).collect(),
            samples: vec![Sample { figures: (1..=10).map(figures).collect(), ..Sample::default() }],
            ..Study::default()
        }
    }

    #[test]
    fn a_fall_keeps_both_balances_and_what_is_lost_or_made_breaks_them() {
        let study = fall();
        assert_eq!([momentum(&study).verdict, energy(&study).verdict], [Verdict::Holds; 2], "{}", momentum(&study).why);
        let mut lost = fall();
        // A millionth of the momentum sideways, in one frame.
        lost.samples[0].figures[6].momentum[0] *= 1.0 - 1e-6;
        assert_eq!(momentum(&lost).verdict, Verdict::Fails);
        let mut made = fall();
        let largest = made.samples[0].figures[9].kinetic_energy;
        made.samples[0].figures[9].kinetic_energy *= 1.02;
        assert_eq!(energy(&made).verdict, Verdict::Fails, "{}", energy(&made).why);
        // What is taken is taken by damping; what comes back afterwards is made.
        let mut damped = fall();
        damped.samples[0].figures[4..].iter_mut().for_each(|figures| figures.potential_energy -= 0.1 * largest);
        assert_eq!(energy(&damped).verdict, Verdict::Holds);
        damped.samples[0].figures[8].potential_energy += 0.1 * largest;
        assert_eq!(energy(&damped).verdict, Verdict::Fails);
    }

    #[test]
    fn what_acts_from_outside_is_named_and_an_old_record_says_that_it_does_not_know() {
        let mut study = fall();
        study.outside.pushes = vec!["body_collision".into(), "pins".into()];
        study.outside.works = vec!["pins".into()];
        assert_eq!(momentum(&study).why, "external forces: body_collision, pins");
        assert_eq!([momentum(&study).verdict, energy(&study).verdict], [Verdict::NotApplicable; 2]);
        study.outside = Outside::default();
        assert_eq!([momentum(&study).verdict, energy(&study).verdict], [Verdict::Unknown; 2]);
    }
}
