//! Repulsion inside the solves of long steps: pairs that are closer than their thickness push each other apart with a spring, a
//! damper and friction (`docs/theory/tr_bdf2.md#repulsion-in-the-solves`).
//!
//! Impulses after a solve move single vertices by what a step of milliseconds takes them, and stiff cloth answers in the next.
//! Here the solve itself finds the velocities at which springs of the cloth and of its pairs agree.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::repulsion::active_contact::{OrientedPair, PairsOfKind};
use crate::contact::repulsion::{CHUNK, Laws};
use crate::contact::tolerances::SLOW_SLIP;
use crate::contact::topology::surface::ContactSurface;

/// Pressure at which a pair that yields by all of its thickness would push if its spring were linear [Pa].
const PRESSURE: f64 = 1000.0;

/// How many times that it pushes in truth: the spring stiffens with the square of the overlap, so that waistbands, which press
/// with kilopascals, keep a distance too.
const STIFFENING: f64 = 4.0;

/// Area of a vertex, over the square of its mean edge, in a mesh of equilateral triangles.
const AREA: f64 = 0.866_025_403_784_438_6;

/// Where the nodes of contact are at a stage, and how fast.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairStage<'a> {
    /// The surfaces.
    pub surface: &'a ContactSurface,
    /// Positions of all nodes, ghosts and points of bodies included [m].
    pub x: &'a [Vec3],
    /// Their velocities [m/s].
    pub v: &'a [Vec3],
    /// Inverse masses of the nodes of cloth, zero where held [1/kg].
    pub mobility: &'a [f64],
    /// Length of the step [s].
    pub dt: f64,
}

/// What a pair in touch does to its nodes: node i is pushed by `weights[i]` times the force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PairForce {
    /// Nodes of contact.
    pub nodes: [u32; 4],
    /// Weights of the point on one side, and minus those of the other.
    pub weights: [f64; 4],
    /// Unit direction from the second side to the first.
    pub normal: Vec3,
    /// Signed distance [m], negative where the two have passed through each other.
    pub distance: f64,
    /// Force on the first side [N].
    pub force: Vec3,
    /// Minus its derivative by the distance along the normal [N/m].
    pub stiffness: f64,
    /// Minus those by the relative velocity, along the normal and across it [N s/m].
    pub damping: [f64; 2],
}

/// The forces of all pairs in touch, in an order that the scene fixes: by kind, and as the list of pairs has them.
pub(super) fn pair_forces(kinds: &[PairsOfKind; 2], laws: &Laws, at: &PairStage<'_>, found: &mut Vec<PairForce>) {
    found.clear();
    for of_kind in kinds {
        let chunks = of_kind.oriented.par_chunks(CHUNK);
        let pieces: Vec<Vec<PairForce>> =
            chunks.map(|pairs| pairs.iter().filter_map(|pair| pair.force(laws, at)).collect()).collect();
        pieces.into_iter().for_each(|piece| found.extend(piece));
    }
}

impl OrientedPair {
    /// What the pair does, if it is in touch and nothing pulls it.
    fn force(&self, laws: &Laws, at: &PairStage<'_>) -> Option<PairForce> {
        let (weights, normal, distance) = self.touch(laws, at.x, self.thickness)?;
        let (nodes, surface) = (self.pair.nodes, at.surface);
        let overlap = self.thickness - distance;
        let (mut response, mut velocity, mut edges, mut count) = (0.0, Vec3::zeros(), 0.0, 0.0);
        for (node, weight) in nodes.into_iter().zip(weights) {
            velocity += at.v[node as usize] * weight;
            if let Some(mobility) = at.mobility.get(node as usize) {
                response += weight * weight * mobility;
                edges += surface.edge_length()[node as usize];
                count += 1.0;
            }
        }
        if overlap <= 0.0 || response <= 0.0 {
            return None;
        }
        let edge: f64 = edges / count;
        // p = P o/H (1 + (s - 1) (o/H)²)
        let linear = PRESSURE * AREA * edge * edge / self.thickness;
        let yielded = (overlap / self.thickness).min(1.0).powi(2) * (STIFFENING - 1.0);
        let stiffness = linear * (1.0 + 3.0 * yielded);
        let spring = linear * (1.0 + yielded) * overlap;
        // Critical for the two sides alone.
        let normal_damping = 2.0 * (linear / response).sqrt();
        let approach = velocity.dot(&normal);
        let push = spring - normal_damping * approach;
        if push <= 0.0 {
            return None;
        }
        let slip = velocity - normal * approach;
        let of_cloth =
            || surface.friction().map_or(laws.friction, |painted| laws.mean_friction(painted, nodes, weights));
        let friction = surface.body_of(&nodes).map_or_else(of_cloth, |body| body.friction);
        let sliding = friction * push / slip.norm().max(SLOW_SLIP);
        let tangential_damping = sliding.min(linear * at.dt);
        let force = normal * push - slip * tangential_damping;
        Some(PairForce {
            nodes,
            weights,
            normal,
            distance,
            force,
            stiffness,
            damping: [normal_damping, tangential_damping],
        })
    }
}

#[cfg(test)]
mod tests;
