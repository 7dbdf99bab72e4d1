//! Longest step that explicit forces allow (`docs/theory/step.md#the-choice-of-dt`).

use crate::effects::force::Force;
use crate::scene::SolverSettings;

/// Longest step that the explicit ones of these forces of a part allow together [s], with the masses of its vertices [kg].
/// `sums` are zeros, one for each vertex.
pub(crate) fn longest_stable_step(
    forces: &[Box<dyn Force>],
    settings: &SolverSettings,
    masses: &[f64],
    sums: &mut [f64],
) -> f64 {
    let cfl = settings.cfl;
    let is_implicit = settings.integrator.spec().is_implicit;
    for force in forces {
        if !(is_implicit && (force.linearised().is_some() || force.is_iterated())) {
            force.add_stiffness(sums);
        }
    }
    let squared = sums.iter().zip(masses).map(|(k, m)| 4.0 * k / (m * cfl * cfl));
    squared.fold(f64::INFINITY, |dt: f64, s| if s > 0.0 { dt.min(1.0 / s.sqrt()) } else { dt })
}
