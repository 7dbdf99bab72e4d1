//! Bounds of a time step that prove pairs too far apart to push each other, from how far their nodes stray from the motion that they have
//! at its start. A stage is evaluated ten times and more in a step, and nine in ten of its pairs never touch.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::repulsion::CHUNK;
use crate::contact::repulsion::active_pair::{OrientedPair, PairsOfKind};
use crate::contact::repulsion::pair_forces::PairStage;
use crate::contact::tolerances::DISTANCE_ROUNDING;
use crate::contact::topology::pair::PairKind;
use crate::long_steps::LOOK_AHEAD;

/// Bounds of all pairs in a step.
#[derive(Debug, Default)]
pub(super) struct StepBounds {
    /// Time at which they were made, since the start of the step [s].
    time: f64,
    /// Displacements of all nodes at that time, since the collision-free state [m].
    displacements: Vec<Vec3>,
    /// Their velocities then [m/s].
    velocities: Vec<Vec3>,
    /// Upper bounds of the distance [m] and the difference of velocity [m/s] between each node and the motion that it has at the start.
    strays: Vec<[f32; 2]>,
    /// Bounds of the pairs of each kind, in their order.
    of_pairs: [Vec<PairBound>; 2],
}

/// Lower bounds of a pair's distance beyond that at which it may push, while its nodes go on as at the start of the step. Rounded to single
/// precision, away from proofs.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairBound {
    nodes: [u32; 4],
    /// Room beyond the distance at which pairs are looked for [m].
    to_look_ahead: f32,
    /// Room beyond the distance at which the pair's damper acts [m].
    to_push: f32,
    /// Distance at which the damper acts, over the velocity of approach [s].
    damping_time: f32,
}

impl StepBounds {
    /// Forgets all pairs.
    pub(super) fn clear(&mut self) {
        self.of_pairs.iter_mut().for_each(Vec::clear);
    }

    /// Memory held [bytes].
    pub(super) fn bytes(&self) -> usize {
        let of_nodes = self.displacements.capacity() * (2 * size_of::<Vec3>() + size_of::<[f32; 2]>());
        of_nodes + self.of_pairs.iter().map(|pairs| pairs.capacity() * size_of::<PairBound>()).sum::<usize>()
    }

    /// Bounds the motion of the nodes at a stage, from the first one of the step on.
    pub(super) fn follow(&mut self, kinds: &[PairsOfKind; 2], at: &PairStage<'_>) {
        let is_begun = |(bounds, of_kind): (&Vec<PairBound>, &PairsOfKind)| bounds.len() == of_kind.oriented.len();
        if at.time == 0.0 || !self.of_pairs.iter().zip(kinds).all(is_begun) {
            self.begin(kinds, at);
        }
        let up = |value: f64| (value as f32).next_up();
        let since = at.time - self.time;
        let Self { displacements, velocities, strays, .. } = self;
        let start = displacements.iter().zip(&*velocities);
        strays.clear();
        strays.extend(at.displacements.iter().zip(at.v).zip(start).map(|((d, v), (d_start, v_start))| {
            [up((d - d_start - v_start * since).norm()), up((v - v_start).norm())]
        }));
    }

    fn begin(&mut self, kinds: &[PairsOfKind; 2], at: &PairStage<'_>) {
        self.time = at.time;
        self.displacements.clear();
        self.displacements.extend_from_slice(at.displacements);
        self.velocities.clear();
        self.velocities.extend_from_slice(at.v);
        for (bounds, of_kind) in self.of_pairs.iter_mut().zip(kinds) {
            let pairs = of_kind.oriented.par_iter().with_min_len(CHUNK);
            pairs.map(|pair| PairBound::new(pair, at)).collect_into_vec(bounds);
        }
    }

    /// Bounds of the pairs of a kind, one for each.
    pub(super) fn of_kind(&self, kind: PairKind) -> &[PairBound] {
        &self.of_pairs[kind as usize]
    }

    /// Whether a pair of this kind is proved too far apart to push.
    #[inline]
    pub(super) fn prove_far(&self, kind: PairKind, bound: &PairBound) -> bool {
        let [a, b, c, d] = bound.nodes.map(|node| self.strays[node as usize]);
        let larger = |one: [f32; 2], other: [f32; 2]| [one[0].max(other[0]), one[1].max(other[1])];
        let (one, other) = match kind {
            PairKind::PointTriangle => (a, larger(larger(b, c), d)),
            PairKind::EdgeEdge => (larger(a, b), larger(c, d)),
        };
        let [distance, speed] = [one[0] + other[0], one[1] + other[1]];
        // Not so where a room is no number, as between nodes that are held.
        bound.to_look_ahead > distance || bound.to_push > distance + bound.damping_time * speed
    }
}

impl PairBound {
    fn new(pair: &OrientedPair, at: &PairStage<'_>) -> Self {
        let speed = pair.largest_difference_squared(at.v).sqrt();
        // Twice the rounding that `OrientedPair::is_beyond` allows for: what is proved here is so there. Largest differences grow by
        // no more than the motion of nodes.
        let approach = pair.largest_difference_squared(at.displacements).sqrt() + speed * at.dt;
        let room = (1.0 - 2.0 * DISTANCE_ROUNDING) * pair.start_distance - approach;
        let damping_time = pair.longest_damping_time(at, pair.linear_stiffness(at));
        // Sums of strays have relative errors of 1e-7.
        let down = |room: f64| ((1.0 - 1e-6) * room) as f32;
        Self {
            nodes: pair.pair.nodes,
            to_look_ahead: down(room - LOOK_AHEAD * pair.thickness).next_down(),
            to_push: down(room - pair.thickness - damping_time * speed).next_down(),
            damping_time: (damping_time as f32).next_up(),
        }
    }
}
