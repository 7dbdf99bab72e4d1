//! Repulsions that act once per collision step instead of in every time step: a variant of the method, to compare.

use super::SelfContact;
use crate::Vec3;
use crate::contact::repulsion::{Passes, RepulsionStep};
use crate::metrics::Metrics;

impl SelfContact {
    /// Before C, where repulsions act once per collision step: on the average velocities of the collision step, which took
    /// `duration` [s], with the geometry of its start (`docs/theory/variants.md#repulsion-once-per-collision-step`).
    /// `x` and `v` are those at its end; the vertices that were moved go to `moved`, each with how far [m].
    pub fn repel_once(
        &mut self,
        (x, v): (&mut [Vec3], &mut [Vec3]),
        duration: f64,
        metrics: &mut Metrics,
        mut moved: impl FnMut(usize, f64),
    ) {
        let Self { surface, repulsions, paths, mobility, cloth, .. } = self;
        let Some(repulsions) = repulsions else { return };
        let (nodes, place) = (surface.nodes(), surface.place());
        let [ends, average] = cloth;
        ends.resize(nodes.cloth(), Vec3::zeros());
        ends[nodes.own()].copy_from_slice(&x[place.clone()]);
        nodes.update(ends);
        let start = &paths.start[..nodes.cloth()];
        let mean = |(end, start): (&Vec3, &Vec3)| (end - start) / duration;
        average.clear();
        average.extend(ends.iter().zip(start).map(mean));
        let at =
            RepulsionStep { nodes, dt: duration, x: start, mobility, friction: surface.friction(), supports: None };
        repulsions.apply(Passes::Full, &at, average, metrics);
        for (node, vertex) in nodes.own().zip(place) {
            let change = (average[node] - mean((&ends[node], &start[node]))).component_mul(&surface.free_axes(node));
            if change != Vec3::zeros() {
                x[vertex] += change * duration;
                v[vertex] += change;
                moved(vertex, change.norm() * duration);
            }
        }
    }
}
