//! Cloth that is pulled to more than twice its length: what no fabric bears, and what pinches it there.

use super::{Simulation, StrainRecord};
use crate::mesh::TriangleMesh;
use crate::tolerances::OVERSTRETCHED;

/// Count of edges that are longer than cloth can be at the end of a frame.
const COUNT: &str = "edges_overstretched";

/// Cloth at a frame that is longer than cloth can be.
#[derive(Debug, Clone, PartialEq)]
pub struct Overstretched {
    /// The most stretched edge.
    pub most: StrainRecord,
    /// Edges that are more than twice as long as at rest.
    pub edges: u64,
    /// Vertices that bodies pinched in the last step, and have been let go.
    pub pinched: u64,
    /// Names of the bodies that cross themselves at the frame.
    pub bodies: Vec<String>,
}

impl Simulation {
    /// Names and counts the cloth that is longer than cloth can be; `most` is its most stretched edge. All ranks call it together.
    pub(super) fn overstretched(&mut self, most: Option<&StrainRecord>) -> Option<Overstretched> {
        let most = most.filter(|most| most.strain > OVERSTRETCHED)?.clone();
        let (scene, x) = (&self.scene, &self.cloth.state.x);
        let parts = scene.parts();
        let of_garment = |(garment, mesh): (usize, &TriangleMesh)| {
            let first = parts.garment(garment).start;
            let is_over = |edge: &&crate::mesh::Edge| {
                let [a, b] = edge.vertices.map(|v| first + v as usize);
                // Each edge counts at the rank that owns its first vertex.
                let counts = parts.own().contains(&a.min(b));
                counts && (x[b] - x[a]).norm() > (1.0 + OVERSTRETCHED) * mesh.rest_length(**edge)
            };
            mesh.edges().iter().filter(is_over).count() as u64
        };
        let here = scene.meshes().iter().enumerate().map(of_garment).sum();
        let pinched = self.contacts.bodies.as_ref().map_or(0, |collision| collision.pinched());
        let [edges, pinched] = self.ranks().sum_of([here, pinched]);
        let crossings = self.prescribed.bodies.self_crossings().zip(&scene.description().bodies);
        let bodies = crossings.filter(|(crossings, _)| *crossings > 0).map(|(_, body)| body.name.clone()).collect();
        self.metrics.count(COUNT, here);
        Some(Overstretched { most, edges, pinched, bodies })
    }
}
