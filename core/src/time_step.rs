//! The choice of the time step (`docs/theory/step.md#the-choice-of-dt`).
//!
//! Elastic limit: per vertex `ω² = Σ 4 k / (m cfl²)` over its springs, dt = min 1/ω. It depends on masses and rest lengths
//! alone and is computed once. Damping is implicit and sets no limit. Strain rate: no edge changes its length by more than a
//! given fraction in a step.

use std::ops::Range;

use crate::Vec3;
use crate::contact::bodies::recovery_speed::RecoverySpeed;
use crate::effects::force::{Force, PartMotion};
use crate::effects::stability::longest_stable_step;
use crate::parallel::for_each_part::PerPart;
use crate::parallel::parts::Parts;
use crate::parallel::reduce::largest;
use crate::scene::SolverSettings;
use crate::state::State;
use crate::tolerances::{LAST_TWO_STEPS, STEP_OF_A_FRAME};

/// Limits that do not change during a run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StepLimit {
    /// Largest stable step of the explicit elastic forces [s].
    pub elastic: f64,
    strain_rates: Vec<f64>,
    /// Largest rate of strain of the present state [1/s], once it was looked for.
    rate: Option<f64>,
    /// Time between two frames [s].
    frame: f64,
    last: f64,
}

/// A chosen step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Choice {
    /// Length [s].
    pub dt: f64,
    /// Whether it ends the interval.
    pub ends_interval: bool,
    /// Longest step that the cloth alone allows [s].
    pub limit: f64,
    /// Whether the strain rate set that limit rather than the elastic forces.
    pub by_strain: bool,
}

/// Shares of what is allowed that a step takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StepShares {
    /// Share of the step that the elastic forces and the scene allow.
    pub of_longest: f64,
    /// Share of the step that is allowed after that and by the rate of strain.
    pub of_allowed: f64,
}

impl StepLimit {
    /// The limits for these forces and masses [kg], and frames that are so far apart [s].
    pub(crate) fn new(
        parts: &Parts,
        masses: &[f64],
        forces: &[Vec<Box<dyn Force>>],
        settings: &SolverSettings,
        frame: f64,
    ) -> Self {
        let mut elastic = if settings.integrator.spec().is_implicit {
            frame / settings.steps_per_frame as f64 * (1.0 + STEP_OF_A_FRAME)
        } else {
            f64::INFINITY
        };
        let mut sums = Vec::new();
        for (range, forces) in parts.ranges().iter().zip(forces) {
            sums.clear();
            sums.resize(range.len(), 0.0);
            elastic = elastic.min(longest_stable_step(forces, settings, &masses[range.clone()], &mut sums));
        }
        let elastic = -parts.ranks().max(-elastic);
        Self { elastic, strain_rates: vec![0.0; parts.count()], rate: None, frame, last: 0.0 }
    }

    /// Length of the step that the cloth allowed last [s]; zero before the first.
    pub(crate) fn last(&self) -> f64 {
        self.last
    }

    /// Goes on from a saved state.
    pub(crate) fn set_last(&mut self, last: f64) {
        self.last = last;
    }

    /// Positions or velocities have changed.
    pub(crate) fn forget_rate(&mut self) {
        self.rate = None;
    }

    /// Returns the longest step that the elastic forces and the scene allow [s]; `share` of it.
    pub(crate) fn longest(&self, settings: &SolverSettings, share: f64) -> f64 {
        let whole = self.elastic.min(settings.max_dt.unwrap_or(f64::INFINITY));
        // Cloth without springs allows any step; a share of it is one of a frame. A share of what is left would never end it.
        if share < 1.0 { share * whole.min(self.frame) } else { whole }
    }

    /// Returns the number of steps in a frame if every step is as long as the elastic forces and the scene allow.
    pub(crate) fn planned_steps(&self, settings: &SolverSettings) -> f64 {
        (self.frame / self.longest(settings, 1.0)).ceil().max(1.0)
    }

    /// Returns the correction, in a step of `dt` [s], of vertices that are not where they have to be: at the speed at
    /// which an edge of this length [m] changes in the longest stable step by the most that a step may change it (a
    /// part of the speed of sound in the cloth), or at which they are there in a frame, whichever is faster. Neither
    /// depends on the length of the steps.
    pub(crate) fn recovery_speed(&self, settings: &SolverSettings, edge: f64, dt: f64) -> RecoverySpeed {
        RecoverySpeed::new(dt, settings.largest_strain_per_step() * edge / self.elastic.min(self.frame), self.frame)
    }

    /// Largest rate of strain of the state [1/s], zero where it is too small to limit a step, and infinite if a velocity is
    /// not finite: the same on all ranks. Looked for once for each state.
    pub(crate) fn rate(
        &mut self,
        settings: &SolverSettings,
        parts: &Parts,
        forces: &[Vec<Box<dyn Force>>],
        State { x, v, .. }: &State,
        share: f64,
    ) -> f64 {
        if let Some(rate) = self.rate {
            return rate;
        }
        let longest = self.longest(settings, share);
        parts.for_each(PerPart(&mut self.strain_rates), &|part, rate| {
            let (range, forces) = (&parts.ranges()[part], &forces[part]);
            // A sum is finite only if all are; the velocities are on their way through the cache anyway.
            let sum: f64 = v[range.clone()].iter().map(Vec3::sum).sum();
            let strained = || forces.iter().filter_map(|force| force.strained());
            let bound = strained().map(|f| f.strain_rate_bound(range.clone(), v)).fold(0.0, f64::max);
            // Mostly the bound already says that this part sets no limit; then no spring needs to be looked at.
            rate.0[0] = if !sum.is_finite() {
                f64::INFINITY
            } else if bound * longest <= settings.largest_strain_per_step() {
                0.0
            } else {
                PartMotion::with(range.clone(), x, v, |motion| {
                    strained().map(|f| f.strain_rate(motion)).fold(0.0, f64::max)
                })
            };
        });
        *self.rate.insert(parts.ranks().max(largest(&self.strain_rates)))
    }

    /// Own parts in which the rate of strain that was found last exceeds this one [1/s].
    pub(crate) fn parts_faster_than(&self, rate: f64) -> impl Iterator<Item = usize> {
        self.strain_rates.iter().enumerate().filter(move |(_, found)| **found > rate).map(|(part, _)| part)
    }

    /// The step from the start of `interval` towards its end [s] at this rate of strain [1/s].
    pub(crate) fn choose(
        &mut self,
        settings: &SolverSettings,
        rate: f64,
        interval: Range<f64>,
        shares: StepShares,
    ) -> Choice {
        let strain = settings.largest_strain_per_step() / rate;
        let whole = self.longest(settings, shares.of_longest).min(strain);
        let limit = if shares.of_allowed < 1.0 { shares.of_allowed * whole.min(self.frame) } else { whole };
        self.last = limit;
        let left = interval.end - interval.start;
        let by_strain = strain < self.elastic;
        if left <= limit {
            Choice { dt: left, ends_interval: true, limit, by_strain }
        } else if left <= 2.0 * limit {
            Choice { dt: limit.min(LAST_TWO_STEPS * left), ends_interval: false, limit, by_strain }
        } else {
            Choice { dt: limit, ends_interval: false, limit, by_strain }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::registry::build_all;
    use crate::mesh::PolygonMesh;
    use crate::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};

    #[test]
    fn no_spring_of_a_shaken_sheet_exceeds_the_bound_on_its_rate_of_strain() {
        const N: usize = 60;
        let at = |k: usize| Vec3::new((k % N) as f64, 0.3 * ((k * 7) % 5) as f64, (k / N) as f64) * 0.01;
        let corners = (0..(N - 1) * N).filter(|k| k % N < N - 1).map(|k| k as u32);
        let triangles: Vec<_> =
            corners.flat_map(|k| [[k, k + N as u32, k + 1], [k + 1, k + N as u32, k + 1 + N as u32]]).collect();
        let mesh = PolygonMesh::from_triangles((0..N * N).map(at).collect(), &triangles);
        let mut description = SceneDescription::new("shaken");
        description.garments.push(GarmentDescription::new("sheet", mesh, 0.2));
        description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
        let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
        let x = crate::state::State::at_start(&scene).x;
        let effects = build_all(&scene).unwrap_or_else(|problems| panic!("{problems}"));
        // One vertex moves at a time, in the middle of a part and at a border alike.
        for moving in (0..x.len()).step_by(61) {
            let mut v = vec![Vec3::new(3.0, 0.0, 1.0); x.len()];
            v[moving] += Vec3::new(0.2, -0.7, 0.4);
            let mut largest_rate = 0.0_f64;
            for (part, force) in effects.iter().flat_map(|(_, effect)| &effect.forces) {
                let force = force.strained().expect("springs have lengths");
                let range = scene.parts().ranges()[*part].clone();
                let rate = PartMotion::with(range.clone(), &x, &v, |motion| force.strain_rate(motion));
                assert!(rate <= force.strain_rate_bound(range, &v), "part {part}, vertex {moving}");
                largest_rate = largest_rate.max(rate);
            }
            assert!(largest_rate > 1.0, "the springs of vertex {moving} change their lengths");
        }
    }
}
