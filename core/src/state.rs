//! What time changes: positions and velocities of all vertices, in solver order.

use crate::Vec3;
use crate::scene::Scene;

/// Positions [m] and velocities [m/s] in solver order.
///
/// One array of 3-vectors each: springs gather whole vertices, so three arrays would touch three cache lines where one
/// does (`docs/decisions/0001-state-layout.md`).
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Positions [m].
    pub x: Vec<Vec3>,
    /// Velocities [m/s].
    pub v: Vec<Vec3>,
    /// Solver time [s].
    pub time: f64,
}

impl State {
    /// The state at the start of a scene.
    pub fn at_start(scene: &Scene) -> Self {
        let description = scene.description();
        let parts = scene.parts();
        let mut state = Self {
            x: vec![Vec3::zeros(); parts.vertex_count()],
            v: vec![Vec3::zeros(); parts.vertex_count()],
            time: description.timeline.time(description.timeline.start),
        };
        for (g, garment) in description.garments.iter().enumerate() {
            let start = garment.start.as_ref().unwrap_or(&garment.mesh.points);
            for (vertex, position) in start.iter().enumerate() {
                let solver = parts.solver_index(g, vertex as u32);
                state.x[solver] = *position;
                state.v[solver] = garment.start_velocities.as_ref().map_or(garment.velocity, |v| v[vertex]);
            }
        }
        state
    }
}
