//! The choice of the time step (method 1.12 and 2.7).
//!
//! Elastic limit: per vertex `ω² = Σ 4 k / (m cfl²)` over its springs, dt = min 1/ω. It depends on masses and rest lengths
//! alone and is computed once. Damping is implicit and sets no limit. Strain rate: no edge changes its length by more than a
//! given fraction in a step.

use crate::Vec3;
use crate::effects::Force;
use crate::parallel::parts::Parts;
use crate::parallel::split::PerPart;
use crate::parallel::sum::largest;
use crate::scene::SolverSettings;
use crate::tolerances::LAST_TWO_STEPS;

/// Limits that do not change during a run.
#[derive(Debug, Clone, PartialEq)]
pub struct StepLimit {
    /// Largest stable step of the explicit elastic forces [s].
    pub elastic: f64,
    strain_rates: Vec<f64>,
}

/// A chosen step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Length [s].
    pub dt: f64,
    /// Whether it ends the interval.
    pub ends_interval: bool,
    /// What the cloth alone allows [s].
    pub limit: f64,
    /// Whether the strain rate set that limit rather than the elastic forces.
    pub by_strain: bool,
}

impl StepLimit {
    /// The limits for these forces and masses [kg].
    pub fn new(parts: &Parts, masses: &[f64], forces: &[Vec<Box<dyn Force>>], cfl: f64) -> Self {
        let mut elastic = f64::INFINITY;
        let mut sums = Vec::new();
        for (range, forces) in parts.ranges().iter().zip(forces) {
            sums.clear();
            sums.resize(range.len(), 0.0);
            forces.iter().for_each(|f| f.add_stiffness(&mut sums));
            let squared = sums.iter().zip(&masses[range.clone()]).map(|(k, m)| 4.0 * k / (m * cfl * cfl));
            elastic = squared.fold(elastic, |dt: f64, s| if s > 0.0 { dt.min(1.0 / s.sqrt()) } else { dt });
        }
        Self { elastic, strain_rates: vec![0.0; parts.count()] }
    }

    /// The step from `time` towards `end` [s].
    pub fn choose(
        &mut self,
        settings: &SolverSettings,
        parts: &Parts,
        forces: &[Vec<Box<dyn Force>>],
        (x, v): (&[Vec3], &[Vec3]),
        (time, end): (f64, f64),
    ) -> Choice {
        parts.for_each(PerPart(&mut self.strain_rates), &|part, rate| {
            rate.0[0] = forces[part].iter().map(|f| f.strain_rate(x, v)).fold(0.0, f64::max);
        });
        let strain = settings.strain_per_step / largest(&self.strain_rates);
        let limit = self.elastic.min(strain).min(settings.max_dt.unwrap_or(f64::INFINITY));
        let left = end - time;
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
