//! Choice of the integrator in scenes that leave it to the solver (`docs/theory/tr_bdf2.md#when-long-steps-pay`).

use std::sync::Arc;

use super::estimate::{CostModel, FrameEstimate};
use crate::effects::registry::{PlannedEffect, build_all};
use crate::effects::spec::Effect;
use crate::error::{Problem, Problems};
use crate::scene::{Integrator, Scene};
use crate::setup::validate::unused::check_unused;
use crate::solve::implicit_velocity::by_part;
use crate::state::State;

/// Version of the choice and of the [change](super::integrator_change) between frames: raised whenever a shot that leaves the integrator to
/// the solver takes another one in some frame.
pub(crate) const CHOICE_VERSION: u32 = 2;

/// Gives a scene the integrator that is expected to take less time, among those that read everything the scene says. Sizes and stiffness
/// decide, never the clock. It may [change](super::integrator_change) between frames. A scene that names its integrator keeps it. All ranks
/// call it together, and choose the same.
///
/// # Errors
/// No integrator can have this scene: the problems with the one that has fewer.
pub(super) fn choose_integrator(scene: &mut Arc<Scene>) -> Result<(), Problems> {
    if scene.description().solver.integrator != Integrator::Auto {
        return Ok(());
    }
    let scene = Arc::make_mut(scene);
    let [short, long] = Integrator::ALL.map(|integrator| {
        scene.description.solver.integrator = integrator;
        expected(scene)
    });
    let takes_long = match (short, long) {
        (Ok(short), Ok(long)) => {
            let costs = [short.total(), long.total()];
            scene.integrator_costs = Some(costs);
            costs[0] >= costs[1]
        }
        (Err(_), Ok(_)) => true,
        (Ok(_), Err(_)) => false,
        (Err(short), Err(long)) => return Err(Problems(if long.len() < short.len() { long } else { short })),
    };
    scene.description.solver.integrator = Integrator::ALL[usize::from(takes_long)];
    Ok(())
}

/// Returns the expected cost of a frame with the integrator of the scene.
///
/// # Errors
/// The scene cannot have this integrator, or has other problems.
fn expected(scene: &Scene) -> Result<FrameEstimate, Vec<Problem>> {
    let mut problems = Vec::new();
    check_unused(scene.description(), &mut problems);
    match build_all(scene) {
        Ok(effects) if problems.is_empty() => Ok(estimate(scene, effects)),
        Ok(_) => Err(problems),
        Err(Problems(found)) => Err([problems, found].concat()),
    }
}

fn estimate(scene: &Scene, effects: Vec<(PlannedEffect, Effect)>) -> FrameEstimate {
    let parts = scene.parts();
    let (mut plan, of_effects): (Vec<PlannedEffect>, Vec<Effect>) = effects.into_iter().unzip();
    for effect in &mut plan {
        let [elements] = parts.ranks().sum_of([effect.elements as u64]);
        effect.elements = elements as usize;
    }
    let forces = by_part(parts, of_effects.into_iter().flat_map(|effect| effect.forces));
    let State { v: velocities, .. } = State::at_start(scene);
    let model = CostModel { scene, plan: &plan, forces: &forces, velocities: &velocities };
    model.estimate(scene.description().solver.integrator)
}
