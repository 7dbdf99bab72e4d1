//! State that changes with time: positions and velocities of the local vertices.

use crate::Vec3;
use crate::scene::Scene;

/// Positions [m] and velocities [m/s] of a rank's vertices and its ghosts.
///
/// One array of 3-vectors each: springs gather whole vertices, so three arrays would touch three cache lines where one
/// does (`docs/dev/decisions/0001-state-layout.md`).
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Positions [m].
    pub x: Vec<Vec3>,
    /// Velocities [m/s].
    pub v: Vec<Vec3>,
    /// Accelerations of the last step [m/s²], from which the implicit step predicts; empty in the others.
    pub a: Vec<Vec3>,
    /// Solver time [s].
    pub time: f64,
}

impl State {
    /// The state at the start of a scene.
    pub fn at_start(scene: &Scene) -> Self {
        let timeline = scene.description().timeline;
        let [x, v] = scene.start_state();
        let keeps_acceleration = scene.description().solver.integrator.spec().keeps_acceleration;
        let a = if keeps_acceleration { vec![Vec3::zeros(); x.len()] } else { Vec::new() };
        Self { x, v, a, time: timeline.time(timeline.start) }
    }
}
