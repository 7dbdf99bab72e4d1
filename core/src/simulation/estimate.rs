//! Expected cost of a frame before any was simulated.
//!
//! ```text
//! iterations = solves × iterations of one,   the latter by how stiff the step's system is
//! seconds    = Σ count × size × nanoseconds of one        over the stages
//! ```
//!
//! Sizes are those of the scene. Counts follow from the length of the step and from whether cloth is expected to touch
//! something; how it moves decides them too, and is not known. Short steps, and long ones that touch nothing, are as many as planned, so
//! that an estimate of them is good within a factor of two, on the machine that the nanoseconds are from. Long steps in contact are
//! made again, with more solves, where cloth is struck or pressed: what is expected of them is the least
//! ([`FrameEstimate::is_least`]). `drapery plan --measure` simulates frames instead.
//!
//! Source of all numbers here: `make measure NAME=plan`, of which docs/dev/measurements/speed.md keeps what came out; AMD EPYC, one thread.

use super::Simulation;
use super::frame_cost::SceneSizes;
use crate::Vec3;
use crate::effects::registry::{PlannedEffect, find};
use crate::effects::spec::{NANOSECONDS, Need};
use crate::scene::{Integrator, Scene, SolverSettings};
use crate::solve::implicit_velocity::PartForces;
use crate::time_step::StepLimit;
use crate::tolerances::{CG_GRAVITY_FRACTION, STANDARD_GRAVITY};

/// Stages of a step that take time, as parts of a frame: a name, and the stages of the record that belong to it.
pub const PARTS_OF_A_FRAME: [(&str, &[&str]); 4] = [
    ("solves", &["B.1 velocity", "B.5 velocity"]),
    ("pairs", &["A neighbours", "B.2 self-repulsion", "B.8 self-repulsion"]),
    ("collisions", &["C collisions"]),
    ("bodies", &["bodies and pins", "B.4 body collision", "B.7 body friction"]),
];

/// A frame as it is expected.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameEstimate {
    /// Whether cloth is expected to touch bodies, other garments or itself in most frames.
    pub in_contact: bool,
    /// Time steps.
    pub steps: f64,
    /// Systems that are solved.
    pub solves: f64,
    /// Iterations of all of them.
    pub iterations: f64,
    /// Times that A and C run.
    pub collision_steps: f64,
    /// CPU seconds of [`PARTS_OF_A_FRAME`], in this order.
    pub seconds: [f64; PARTS_OF_A_FRAME.len()],
    /// Whether all of it is the least that a frame takes while no step is made again, and contact decides how much more there is;
    /// otherwise the seconds are expected within a factor of two.
    pub is_least: bool,
}

impl FrameEstimate {
    /// CPU seconds of all parts.
    pub fn total(&self) -> f64 {
        self.seconds.iter().sum()
    }
}

/// The vectors of an iteration of the damping solve [ns by vertex].
const DAMPING_ITERATION: f64 = 6.0;
/// Cost of a damping solve besides forces and iterations [ns by vertex].
const DAMPING_SOLVE: f64 = 20.0;
/// An iteration of the preconditioned solve [ns by vertex].
const BLOCK_ITERATION: f64 = 45.0;
/// A preconditioned solve without its iterations: forces, blocks, coarse levels [ns by vertex].
const BLOCK_SOLVE: f64 = 600.0;
/// Cost that pairs with edges and faces of surfaces add to it [ns by vertex].
const SURFACE_PAIRS: f64 = 1000.0;
/// A, the pairs near a collision-free state, in a collision step [ns by triangle of cloth and of moving surfaces].
const NEIGHBOURS: f64 = 550.0;
/// C in a collision step, with the exact check of a frame [ns by such a triangle].
const COLLISIONS: f64 = 400.0;
/// B.2 and B.8 in a short step in contact [ns by triangle of cloth].
const REPULSION: f64 = 8.0;
/// Contact with a shape in a step, short or long [ns by vertex].
const SHAPE: [f64; 2] = [50.0, 70.0];
/// Contact with a surface in a step, short or long [ns by vertex].
const SURFACE: [f64; 2] = [100.0, 500.0];
/// A surface that moves, in a step [ns by its triangle].
const MOVING_SURFACE: f64 = 45.0;

/// Speed at which cloth is expected to move if it does not start faster [m/s], as if it had fallen for a tenth of a second.
const SPEED: f64 = 1.0;
/// Share of a mean edge that cloth moves in a collision step at this speed.
const SHARE_OF_EDGE: f64 = 0.14;

/// Iterations of a damping solve: by the root of the condition number, which is this at a damping ratio of 1, cfl 4 and the longest
/// step.
const DAMPING_CONDITION: f64 = 7.0;
const DAMPING_ITERATIONS: f64 = 1.6;

/// Solves of a long step: where nothing touches, and how many more rounds its stages have in contact, counted as whole ones: there are
/// 10 to 12 solves a step, of which most are for a few parts. Where the tolerance is coarse
/// against what gravity adds in a step, the later rounds have nothing left to do.
const FREE_SOLVES: f64 = 3.0;
const CONTACT_ROUNDS: f64 = 3.0;
/// Iterations of a preconditioned solve at r times the step that springs allow are a factor times r to this power. Of solves from
/// nothing to a fixed tolerance it is 0.6 ([`crate::solve::multilevel`]); later rounds have less to do.
const STIFFNESS_POWER: f64 = 0.45;
const FREE_ITERATIONS: f64 = 1.5;
const CONTACT_ITERATIONS: f64 = 4.0;

/// The parts of a simulation that the cost of its frames follows from.
pub(super) struct CostModel<'a> {
    pub scene: &'a Scene,
    pub plan: &'a [PlannedEffect],
    pub forces: &'a PartForces,
    /// Velocities of the local vertices [m/s].
    pub velocities: &'a [Vec3],
}

impl Simulation {
    /// Returns the expected cost of a frame. All ranks call it together.
    pub fn estimate(&self) -> FrameEstimate {
        self.estimate_with(self.scene.description().solver.integrator)
    }

    /// Returns the cost of a frame that is expected of the scene with another integrator. All ranks call it together.
    pub fn estimate_with(&self, integrator: Integrator) -> FrameEstimate {
        let Self { scene, plan, dynamics, cloth, .. } = self;
        CostModel { scene, plan, forces: &dynamics.forces, velocities: &cloth.state.v }.estimate(integrator)
    }
}

impl CostModel<'_> {
    /// Returns the expected cost of a frame with an integrator. All ranks call it together, and find the same.
    pub(super) fn estimate(&self, integrator: Integrator) -> FrameEstimate {
        let description = self.scene.description();
        let frame = description.timeline.frame_duration();
        let sizes = SceneSizes::of(self.scene);
        let has = |need: Need| self.plan.iter().any(|effect| effect.needs.contains(&need));
        let repels = has(Need::ClothSurface);
        // Wind folds cloth, pins alone let it hang.
        let is_blown = self.plan.iter().any(|effect| effect.name == "wind");
        let in_contact = has(Need::Bodies) || (repels && (description.garments.len() > 1 || is_blown));
        let steps = self.limit(integrator).planned_steps(&description.solver);
        let is_implicit = integrator.spec().is_implicit;
        let counts = if is_implicit { self.long_solves(steps, in_contact) } else { self.short_solves(steps) };
        let [solves, iterations] = counts;
        let largest_speed = self.velocities.iter().map(|v| v.norm()).fold(SPEED, f64::max);
        let speed = self.scene.parts().ranks().max(largest_speed);
        let moved = frame * speed / (SHARE_OF_EDGE * self.scene.mean_edge());
        let least = steps / self.most_steps_between_collisions();
        let collision_steps = if repels { moved.max(least).clamp(1.0, steps.max(1.0)) } else { 0.0 };
        let of_solves = if is_implicit {
            sizes.of_long_solves(counts, repels)
        } else {
            sizes.of_short_solves(counts, self.force_costs())
        };
        let near = (sizes.triangles + sizes.surface_triangles) * collision_steps;
        let repulsions = if in_contact && repels && !is_implicit { steps * sizes.triangles * REPULSION } else { 0.0 };
        let of_bodies = steps * sizes.of_bodies(is_implicit);
        let nanoseconds = [of_solves, near * NEIGHBOURS + repulsions, near * COLLISIONS, of_bodies];
        let seconds = nanoseconds.map(|nanoseconds| nanoseconds / NANOSECONDS);
        let is_least = is_implicit && in_contact;
        FrameEstimate { in_contact, steps, solves, iterations, collision_steps, seconds, is_least }
    }

    /// Limits of the steps that an integrator takes.
    fn limit(&self, integrator: Integrator) -> StepLimit {
        let (description, parts) = (self.scene.description(), self.scene.parts());
        let solver = SolverSettings { integrator, ..description.solver.clone() };
        StepLimit::new(parts, self.scene.masses(), self.forces, &solver, description.timeline.frame_duration())
    }

    /// Solves and iterations of a number of long steps.
    fn long_solves(&self, steps: f64, in_contact: bool) -> [f64; 2] {
        let frame = self.scene.description().timeline.frame_duration();
        let stiffness = libm::pow((frame / steps / self.spring_step()).max(1.0), STIFFNESS_POWER);
        if !in_contact {
            return [steps * FREE_SOLVES, steps * FREE_SOLVES * FREE_ITERATIONS * stiffness];
        }
        let by_gravity = CG_GRAVITY_FRACTION * STANDARD_GRAVITY * frame / steps;
        let rounds =
            CONTACT_ROUNDS * (by_gravity / self.scene.description().solver.cg_tolerance.unwrap_or(by_gravity)).min(1.0);
        let solves = steps * (FREE_SOLVES + rounds);
        [solves, solves * CONTACT_ITERATIONS * stiffness]
    }

    /// Solves and iterations of a number of short steps.
    fn short_solves(&self, steps: f64) -> [f64; 2] {
        let description = self.scene.description();
        let frame = description.timeline.frame_duration();
        let share = frame / steps / self.spring_step();
        let condition = DAMPING_CONDITION * self.damping_ratio() * description.solver.cfl / 4.0 * share;
        let solves = 2.0 * steps;
        [solves, solves * DAMPING_ITERATIONS * (1.0 + condition).sqrt()]
    }

    /// Longest step that elastic forces would allow if all of them were explicit [s], at most a frame.
    fn spring_step(&self) -> f64 {
        self.limit(Integrator::SemiImplicit).elastic.min(self.scene.description().timeline.frame_duration())
    }

    /// The largest number of time steps in a collision step.
    fn most_steps_between_collisions(&self) -> f64 {
        let of_effect = |effect: &PlannedEffect| effect.settings.optional("max_steps");
        self.plan.iter().find_map(of_effect).unwrap_or(f64::INFINITY)
    }

    /// The largest damping ratio of the forces.
    fn damping_ratio(&self) -> f64 {
        let of_effect = |effect: &PlannedEffect| effect.settings.optional("damping_ratio").unwrap_or(0.0);
        self.plan.iter().map(of_effect).fold(0.0, f64::max)
    }

    /// Nanoseconds of one update of all forces, and of one damping product.
    fn force_costs(&self) -> [f64; 2] {
        let of_effect = |effect: &PlannedEffect| {
            let elements = effect.elements as f64;
            find(effect.name).map_or([0.0; 2], |spec| [elements * spec.cost.update, elements * spec.cost.product])
        };
        self.plan.iter().map(of_effect).fold([0.0; 2], |[u, p], [update, product]| [u + update, p + product])
    }
}

impl SceneSizes {
    /// Nanoseconds of solves and iterations of the implicit step.
    fn of_long_solves(&self, [solves, iterations]: [f64; 2], repels: bool) -> f64 {
        let of_solve = BLOCK_SOLVE + if repels { self.surfaces * SURFACE_PAIRS } else { 0.0 };
        self.vertices * (solves * of_solve + iterations * BLOCK_ITERATION)
    }

    /// Nanoseconds of solves and iterations of the semi-implicit step, with forces that take these for an update and for a
    /// product.
    fn of_short_solves(&self, [solves, iterations]: [f64; 2], [update, product]: [f64; 2]) -> f64 {
        let vectors = self.vertices * (solves * DAMPING_SOLVE + iterations * DAMPING_ITERATION);
        // The first residual of a solve is a product more.
        vectors + solves * update + (iterations + solves) * product
    }

    /// Nanoseconds of bodies in a step.
    fn of_bodies(&self, is_implicit: bool) -> f64 {
        let [shape, surface] = [SHAPE, SURFACE].map(|costs| costs[usize::from(is_implicit)]);
        self.vertices * (self.shapes * shape + self.surfaces * surface) + self.surface_triangles * MOVING_SURFACE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_frame_share_no_stage() {
        let stages: Vec<&str> = PARTS_OF_A_FRAME.iter().flat_map(|(_, stages)| *stages).copied().collect();
        assert!(stages.iter().enumerate().all(|(k, stage)| !stages[..k].contains(stage)), "{stages:?}");
    }
}
