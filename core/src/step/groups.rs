//! Data of a time step, in groups: the cloth, the forces and filters that act on it, prescribed motion, and contacts.

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::bodies::active_set::ActiveSet;
use crate::contact::bodies::collision::BodyCollision;
use crate::contact::bodies::{Bodies, Samples};
use crate::contact::self_contact::{EndOptions, Ending, SelfContact};
use crate::effects::force::VelocityFilter;
use crate::metrics::Metrics;
use crate::observe::Quantity;
use crate::parallel::CHUNK;
use crate::parallel::for_each_part::PerVertex;
use crate::parallel::parts::Parts;
use crate::pins::{HardPins, Mobility, PinTargets};
use crate::scene::Scene;
use crate::solve::implicit_velocity::PartForces;
use crate::state::State;
use crate::step::implicit::StageArrays;
use crate::step::solve_arrays::SolveArrays;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// The cloth of a rank.
pub(crate) struct Cloth {
    /// Positions and velocities of the local vertices; ghosts are those of their owners before and after a step.
    pub state: State,
    /// Arrays that a step writes and the next one overwrites.
    pub scratch: Scratch,
}

impl Cloth {
    /// Returns the paper's quantities that exist after a line of a step.
    pub(super) fn quantities(&self, line: &str) -> Vec<Quantity<'_>> {
        let Self { state: State { x, v, .. }, scratch: Scratch { v_half, v_star, x_new, .. } } = self;
        let of = |name, values| Quantity { name, values };
        let [x, v, v_half, x_new] = [of("x", x), of("v", v), of("v_half", v_half), of("x_new", x_new)];
        let v_star = of("v_star", if v_star.is_empty() { v.values } else { v_star });
        match line {
            "B.1" | "B.2" => vec![x, v, v_half],
            "B.3" | "B.4" | "C" => vec![x, v, v_half, x_new, v_star],
            // v made room for what undoing the projection needs.
            "B.5" => vec![x, v_half, x_new, v_star],
            _ => vec![x, v],
        }
    }
}

/// Forces and velocity filters that act on the cloth.
pub(crate) struct Dynamics {
    /// Forces of every part.
    pub forces: PartForces,
    /// Filters that change velocities between the solves.
    pub filters: Vec<Box<dyn VelocityFilter>>,
    /// Volumes that forces look at.
    pub volumes: Volumes,
    /// The wind of a file.
    pub wind: WindGrid,
}

/// Whose motion is given.
pub(crate) struct Prescribed {
    /// The bodies.
    pub bodies: Bodies,
    /// Animated positions that pins follow.
    pub tracks: Vec<Samples>,
    /// Hard pins, if the scene has any.
    pub pins: Option<HardPins>,
    /// Required positions of pinned vertices.
    pub targets: PinTargets,
    /// Inverse masses as hard pins leave them in the present step.
    pub mobility: Mobility,
}

impl Prescribed {
    /// Gives pinned components their prescribed velocity.
    pub(super) fn apply_prescribed(&self, parts: &Parts, v: &mut [Vec3]) {
        if let Some(pins) = &self.pins {
            parts.for_each(PerVertex(&mut v[parts.own()]), &|part, v| {
                pins.set_velocities(part, parts.ranges()[part].start, &self.targets, v.0);
            });
        }
    }
}

/// Contacts of the cloth.
#[derive(Default)]
pub(crate) struct Contacts {
    /// Bodies, if the scene has any.
    pub bodies: Option<BodyCollision>,
    /// Cloth, if the scene asks for it.
    pub cloth: Option<SelfContact>,
}

/// The end of a collision step, from which C goes back to its start or on.
pub(crate) struct CollisionEnd<'a> {
    /// Positions of the local vertices [m].
    pub x: &'a mut [Vec3],
    /// Velocities of the local vertices [m/s].
    pub v: &'a mut [Vec3],
    /// From the collision-free state to here [s].
    pub duration: f64,
    /// Whether C may give the state back, which leaves a hard case to a shorter collision step.
    pub may_rewind: bool,
    /// Whether the exact check looks at all cloth afterwards, not at what C has moved alone.
    pub checks_all: bool,
}

impl Contacts {
    /// C; ghosts are those of their owners afterwards.
    pub(crate) fn resolve_collisions(
        &mut self,
        end: CollisionEnd,
        prescribed: &Bodies,
        parts: &Parts,
        metrics: &mut Metrics,
    ) -> Ending {
        let Self { bodies, cloth: Some(contact) } = self else { return Ending::Resolved };
        let CollisionEnd { x, v, duration, may_rewind, checks_all } = end;
        let options = EndOptions { may_rewind, checks_all };
        let ending = contact.end_collision_step((x, v), prescribed, duration, options, metrics, bodies.as_mut());
        let (mut x, mut v) = (x, v);
        parts.halo().update_all(parts.ranks(), &mut [&mut x, &mut v]);
        ending
    }
}

/// Velocities besides v and v½ that the solves of a scene need.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VelocityNeeds {
    /// v*, because contact changes velocities between B.3 and B.5.
    pub v_star: bool,
    /// Velocities that forces look at.
    pub seen: bool,
}

/// Arrays that a step writes and the next one overwrites; never saved.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// v½ [m/s].
    pub(super) v_half: Vec<Vec3>,
    /// v* [m/s]; empty where nothing between B.3 and B.5 changes velocities, so that it is v.
    pub(super) v_star: Vec<Vec3>,
    /// x' [m].
    pub(super) x_new: Vec<Vec3>,
    /// Arrays of the two solves of a semi-implicit step, where the integrator is that.
    pub(super) solves: Option<Box<SolveArrays>>,
    /// Arrays of the stages of implicit steps, where the integrator is such.
    pub(super) stages: Option<Box<StageArrays>>,
    /// Vertices that rest on bodies in these stages.
    pub(super) active: ActiveSet,
}

impl Scratch {
    /// Arrays for the local vertices; `stages` where the integrator is implicit.
    pub(crate) fn new(scene: &Scene, forces: &PartForces, needs: VelocityNeeds, stages: Option<StageArrays>) -> Self {
        let vertices = vec![Vec3::zeros(); scene.parts().local_count()];
        let solves = stages.is_none().then(|| Box::new(SolveArrays::new(scene, forces, needs.seen)));
        Self {
            v_half: vertices.clone(),
            v_star: if needs.v_star { vertices.clone() } else { Vec::new() },
            x_new: vertices,
            solves,
            stages: stages.map(Box::new),
            active: ActiveSet::default(),
        }
    }

    /// Own vertices at which a step that has gone wrong left numbers that are not finite, ascending: those that forces or the
    /// state itself spoil, or, if there are none, those that the solve has spread it to.
    pub(crate) fn not_finite(&self, own: std::ops::Range<usize>, state: &State) -> Vec<usize> {
        let is_finite = |v: &Vec3| v.iter().all(|c| c.is_finite());
        let explicit = self.solves.as_ref().map(|solves| &solves.explicit);
        let at = |i: usize| explicit.map(|explicit| &explicit[i]).into_iter().chain([&state.x[i], &state.v[i]]);
        let spoilt = |i: &usize| !at(*i).all(is_finite);
        let found: Vec<usize> = own.clone().filter(spoilt).collect();
        if found.is_empty() { own.filter(|i| !is_finite(&self.v_half[*i])).collect() } else { found }
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        (2 * self.x_new.len() + self.v_star.len()) * size_of::<Vec3>()
            + self.solves.as_ref().map_or(0, |solves| solves.bytes())
            + self.stages.as_ref().map_or(0, |stages| stages.bytes())
            + self.active.bytes()
    }

    /// The arrays of the solves, v½, v* and x'.
    pub(super) fn of_solves(&mut self) -> (&mut SolveArrays, &mut Vec<Vec3>, &[Vec3], &[Vec3]) {
        let Self { solves: Some(arrays), v_half, v_star, x_new, .. } = self else {
            unreachable!("a scene with the semi-implicit integrator has its arrays")
        };
        (arrays, v_half, v_star, x_new)
    }

    /// B.3: x' = x + dt · v½, and v* = v.
    pub(super) fn set_positions(&mut self, state: &State, dt: f64) {
        if !self.v_star.is_empty() {
            copy(&mut self.v_star, &state.v);
        }
        let chunks = self.x_new.par_chunks_mut(CHUNK).zip(state.x.par_chunks(CHUNK));
        chunks.zip(self.v_half.par_chunks(CHUNK)).for_each(|((x_new, x), v)| {
            for ((x_new, x), v) in x_new.iter_mut().zip(x).zip(v) {
                *x_new = x + v * dt;
            }
        });
    }

    /// B.6: v' = 2 v½ − v*; `v` is v before and v' after.
    pub(super) fn extrapolate(&self, v: &mut [Vec3]) {
        let halves = v.par_chunks_mut(CHUNK).zip(self.v_half.par_chunks(CHUNK));
        if self.v_star.is_empty() {
            halves.for_each(|(v, half)| v.iter_mut().zip(half).for_each(|(v, half)| *v = half * 2.0 - *v));
        } else {
            halves.zip(self.v_star.par_chunks(CHUNK)).for_each(|((v, half), v_star)| {
                for ((v, half), v_star) in v.iter_mut().zip(half).zip(v_star) {
                    *v = half * 2.0 - v_star;
                }
            });
        }
    }
}

fn copy(to: &mut [Vec3], from: &[Vec3]) {
    to.par_chunks_mut(CHUNK).zip(from.par_chunks(CHUNK)).for_each(|(to, from)| to.copy_from_slice(from));
}
