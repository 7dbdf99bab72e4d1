//! Cost of a frame by its counts: what the clock would say of it on the machine of the expected costs, with the same bits on all.
//!
//! ```text
//! seconds = Σ count × size × nanoseconds of one
//! ```
//!
//! Nanoseconds are a least-squares fit to the frames of 18 shots with both integrators: samples, dressed characters, layers, wrung cloth;
//! AMD EPYC, one thread.

use crate::effects::spec::NANOSECONDS;
use crate::metrics::Metrics;
use crate::parallel::ranks::Ranks;
use crate::scene::{BodyShape, Integrator, Scene};

/// Cost of a triangle of a moving surface over the cost of one of cloth, where neighbours are looked for.
const SURFACE_TRIANGLE: f64 = 0.3;

/// Size that a count is multiplied by.
#[derive(Debug, Clone, Copy)]
enum Factor {
    One,
    Vertices,
    Triangles,
}

/// Counts that time follows from, alike on any number of ranks and after a resume.
pub(super) const COUNTS: [&str; 7] = [
    "cg_solves",
    "cg_iterations",
    "collision_steps",
    "collision_attempts",
    "pairs_near",
    "collision_hits",
    "body_queries",
];

/// Values of [`COUNTS`].
pub(super) type Counts = [u64; COUNTS.len()];

/// Nanoseconds of one of a count with each of [`Integrator::ALL`].
struct CountCost {
    factor: Factor,
    nanoseconds: [f64; 2],
}

/// Costs of [`COUNTS`].
static COSTS: [CountCost; COUNTS.len()] = [
    CountCost { factor: Factor::Vertices, nanoseconds: [48.0, 330.0] },
    CountCost { factor: Factor::Vertices, nanoseconds: [34.0, 24.0] },
    CountCost { factor: Factor::Triangles, nanoseconds: [400.0, 370.0] },
    CountCost { factor: Factor::Triangles, nanoseconds: [170.0, 340.0] },
    CountCost { factor: Factor::One, nanoseconds: [930.0, 1280.0] },
    CountCost { factor: Factor::One, nanoseconds: [21e3, 28e3] },
    CountCost { factor: Factor::One, nanoseconds: [1060.0, 1560.0] },
];

/// Sizes of a scene that the cost of its frames follows from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SceneSizes {
    /// Vertices of all garments.
    pub(super) vertices: f64,
    /// Triangles of all garments.
    pub(super) triangles: f64,
    /// Triangles of bodies that are meshes.
    pub(super) surface_triangles: f64,
    /// Number of analytic bodies.
    pub(super) shapes: f64,
    /// Number of bodies that are meshes.
    pub(super) surfaces: f64,
}

impl SceneSizes {
    /// Returns the sizes of a scene. All ranks call it together.
    pub(super) fn of(scene: &Scene) -> Self {
        let of_surface = |shape: &BodyShape| match shape {
            BodyShape::Surface { triangles, .. } => Some(triangles.len() as f64),
            BodyShape::Rigid(_) => None,
        };
        let bodies = &scene.description().bodies;
        let surfaces: Vec<f64> = bodies.iter().filter_map(|body| of_surface(&body.shape)).collect();
        Self {
            vertices: scene.parts().partition().vertex_count() as f64,
            triangles: triangle_count(scene),
            surface_triangles: surfaces.iter().sum(),
            shapes: (bodies.len() - surfaces.len()) as f64,
            surfaces: surfaces.len() as f64,
        }
    }

    /// Returns the CPU seconds of these counts with an integrator.
    pub(super) fn cost(&self, integrator: Integrator, counts: &Counts) -> f64 {
        let nanoseconds = COSTS.iter().zip(counts).map(|(cost, count)| {
            let size = match cost.factor {
                Factor::One => 1.0,
                Factor::Vertices => self.vertices,
                Factor::Triangles => self.triangles + SURFACE_TRIANGLE * self.surface_triangles,
            };
            *count as f64 * size * cost.nanoseconds[integrator as usize]
        });
        nanoseconds.sum::<f64>() / NANOSECONDS
    }
}

/// Returns what `metrics` of all ranks have counted. All ranks call it together, and find the same.
pub(super) fn counts_of(metrics: &Metrics, ranks: &Ranks) -> Counts {
    ranks.sum_of(COUNTS.map(|count| metrics.counted(count)))
}

/// Triangles of all garments, on all ranks.
fn triangle_count(scene: &Scene) -> f64 {
    let parts = scene.parts();
    // A rank has the triangles around its own vertices, so that each corner is counted by one rank.
    let corners = scene.meshes().iter().enumerate().flat_map(|(garment, mesh)| {
        let first = parts.garment(garment).start;
        mesh.triangles().iter().flatten().map(move |corner| first + *corner as usize)
    });
    let own = corners.filter(|vertex| parts.own().contains(vertex)).count() as u64;
    let [all] = parts.ranks().sum_of([own]);
    (all / 3) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_count_costs_its_nanoseconds_by_the_size_that_it_goes_with() {
        let sizes = SceneSizes { vertices: 10.0, triangles: 7.0, surface_triangles: 10.0, shapes: 1.0, surfaces: 1.0 };
        let cost = |count: &'static str, integrator: Integrator| {
            let mut metrics = Metrics::default();
            metrics.count(count, 3);
            sizes.cost(integrator, &counts_of(&metrics, &Ranks::default())) * NANOSECONDS
        };
        for (count, [short, long]) in [
            ("cg_solves", [3.0 * 10.0 * 48.0, 3.0 * 10.0 * 330.0]),
            ("collision_steps", [3.0 * 10.0 * 400.0, 3.0 * 10.0 * 370.0]),
            ("pairs_near", [3.0 * 930.0, 3.0 * 1280.0]),
            ("steps", [0.0, 0.0]),
        ] {
            let found = Integrator::ALL.map(|integrator| cost(count, integrator));
            assert!((found[0] - short).abs() + (found[1] - long).abs() < 1e-6, "{count}: {found:?}");
        }
    }
}
