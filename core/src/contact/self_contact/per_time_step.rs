//! Repulsions in every time step: B.2 and B.8, or in the solves of a long one.

use super::SelfContact;
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::collision::BodyCollision;
use crate::contact::bodies::constraints::BodyConstraints;
use crate::contact::repulsion::ghost_constraints::send_to_ghosts;
use crate::contact::repulsion::pair_forces::{PairForce, PairStage};
use crate::contact::repulsion::{Passes, RepulsionStep};
use crate::contact::topology::nodes::ContactNodes;
use crate::metrics::Metrics;

impl SelfContact {
    /// B.2: repulsion of the velocities of the half step, over the scene's local vertices.
    pub(crate) fn half_velocity(&mut self, dt: f64, x: &[Vec3], v: &mut [Vec3], metrics: &mut Metrics) {
        self.repel(Passes::Full, dt, x, v, metrics);
    }

    /// B.8: repulsion of the final velocities, without springs. Velocities of vertices on bodies have afterwards what the
    /// bodies have to bear.
    pub(crate) fn final_velocity(
        &mut self,
        dt: f64,
        x: &[Vec3],
        v: &mut [Vec3],
        bodies: Option<&BodyCollision>,
        metrics: &mut Metrics,
    ) {
        if let Some(repulsions) = &mut self.repulsions {
            repulsions.positions_changed();
        }
        if let Some(bodies) = bodies {
            let nodes = self.surface.nodes();
            self.constraints.resize(nodes.cloth(), BodyConstraints::default());
            bodies.supports(dt, &mut self.constraints[nodes.own()]);
        }
        self.repel(Passes::WithoutSprings, dt, x, v, metrics);
    }

    /// Sets the accelerations of own vertices at the start of a long step under all forces but those of pairs [m/s²], none where a body
    /// holds one: they say how hard each pair is pressed. All ranks call it together.
    pub(crate) fn set_unrepelled(&mut self, accelerations: impl Iterator<Item = Option<Vec3>>) {
        self.unrepelled.set(self.surface.nodes(), &self.mobility, accelerations);
    }

    /// The forces of pairs in touch at a stage of a long step, cloth at `x` with `v`, both over the scene's local vertices
    /// [m], [m/s], and bodies at a fraction of the step of `dt` [s]; `before` are those of the evaluation before in this step; none
    /// if it is the first. All ranks call it together.
    pub(crate) fn pair_forces(
        &mut self,
        [x, v]: [&[Vec3]; 2],
        bodies: &Bodies,
        (fraction, dt): (f64, f64),
        before: &[PairForce],
    ) -> Vec<PairForce> {
        let Self { surface, repulsions: Some(repulsions), mobility, unrepelled, cloth, paths, displacements, .. } =
            self
        else {
            return Vec::new();
        };
        surface.gather_stage([x, v], bodies, fraction, cloth);
        let [x, v] = cloth;
        displacements.clear();
        displacements.extend(x.iter().zip(&paths.start).map(|(x, start)| x - start));
        let is_guess = fraction > 0.0;
        repulsions.pair_forces(&PairStage { surface, x, displacements, v, mobility, unrepelled, dt, is_guess }, before)
    }

    /// The numbering of the nodes of pairs.
    pub(crate) fn nodes(&self) -> &ContactNodes {
        self.surface.nodes()
    }

    /// Counts the pairs in touch of the last stage.
    pub(crate) fn count_pair_forces(&self, metrics: &mut Metrics) {
        self.repulsions.iter().for_each(|repulsions| repulsions.count(metrics));
    }

    /// Thickness that layers keep at own vertices [m]; `None` where they do not repel each other.
    pub(crate) fn layer_thickness(&self) -> Option<&[f64]> {
        self.repels().then(|| &self.surface.thickness()[self.surface.nodes().own()])
    }

    /// Whether B.8 has pressed an own vertex against a body, by its place among these.
    pub(crate) fn is_pressed(&self, vertex: usize) -> bool {
        let node = (self.surface.nodes().own().start + vertex) as u32;
        self.repulsions.as_ref().is_some_and(|repulsions| repulsions.is_pressed(node))
    }

    fn repel(&mut self, passes: Passes, dt: f64, x: &[Vec3], v: &mut [Vec3], metrics: &mut Metrics) {
        let Some(repulsions) = &mut self.repulsions else { return };
        let (nodes, place, friction) = (self.surface.nodes(), self.surface.place(), self.surface.friction());
        let bears = passes == Passes::WithoutSprings && !self.constraints.is_empty();
        if nodes.ranks().is_alone() {
            let constraints = bears.then_some(self.constraints.as_slice());
            repulsions.apply(
                passes,
                &RepulsionStep { nodes, dt, x, mobility: &self.mobility, friction, constraints },
                v,
                metrics,
            );
            return;
        }
        let [contact_x, contact_v] = &mut self.cloth;
        for (all, own) in [(&mut *contact_x, x), (&mut *contact_v, &*v)] {
            all.resize(nodes.cloth(), Vec3::zeros());
            all[nodes.own()].copy_from_slice(&own[place.clone()]);
        }
        if bears {
            send_to_ghosts(nodes, &mut self.constraints, contact_x);
        } else {
            nodes.update(contact_x);
        }
        let constraints = bears.then_some(self.constraints.as_slice());
        let at = RepulsionStep { nodes, dt, x: contact_x, mobility: &self.mobility, friction, constraints };
        repulsions.apply(passes, &at, contact_v, metrics);
        v[place].copy_from_slice(&contact_v[nodes.own()]);
    }
}
