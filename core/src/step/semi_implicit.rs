//! The lines of the paper's step that are its own: explicit elastic forces, with two implicit solves for damping
//! (`docs/theory/step.md`).

use super::solve_arrays::SolveArrays;
use super::{Cloth, Dynamics, Line, Prescribed, Step, StepSettings};
use crate::Vec3;
use crate::clock::Watch;
use crate::contact::bodies::collision::BodyCollision;
use crate::effects::force::ForceContext;
use crate::parallel::parts::Parts;
use crate::solve::implicit_velocity::VelocityProblem;
use crate::volumes::Volumes;
use crate::wind_grid::WindGrid;

/// Common arguments of both solves of a step.
#[derive(Clone, Copy)]
struct Solves<'a> {
    parts: &'a Parts,
    masses: &'a [f64],
    settings: StepSettings<'a>,
    /// Start of the step [s].
    time: f64,
}

/// When and where forces are evaluated in a solve, and what they see there.
struct Evaluation<'a> {
    /// Fraction of the step.
    fraction: f64,
    /// Positions and velocities of the local vertices [m], [m/s].
    x: &'a [Vec3],
    v: &'a [Vec3],
    effective_masses: Option<&'a [f64]>,
    prescribed: &'a Prescribed,
    volumes: &'a Volumes,
    wind: &'a WindGrid,
    contacts: Option<&'a BodyCollision>,
}

impl<'a> Solves<'a> {
    fn at<'b>(&self, at: Evaluation<'b>) -> VelocityProblem<'b>
    where
        'a: 'b,
    {
        let Evaluation { fraction, x, v, effective_masses, prescribed, volumes, wind, contacts } = at;
        let StepSettings { dt, stop, held, .. } = self.settings;
        let time = prescribed.bodies.time_of_motion(self.time + fraction * dt);
        VelocityProblem {
            parts: self.parts,
            masses: self.masses,
            effective_masses,
            context: ForceContext { time, targets: &prescribed.targets, v, wind, volumes },
            pins: prescribed.pins.as_ref(),
            contacts,
            half_step: 0.5 * dt,
            x,
            fraction,
            stop,
            held: held.unwrap_or_default(),
        }
    }
}

impl<'a> Step<'a> {
    /// The step as in the paper: a line, and what it does.
    pub(crate) const LISTING: [Line<'a>; 11] = [
        ("B.1", Self::half_velocity),
        ("B.2", Self::repel_half_velocity),
        ("B.2", Self::limit_half_strain),
        ("B.3", Self::positions),
        ("B.4", Self::collide_with_bodies),
        ("B.5", Self::middle_velocity),
        ("B.6", Self::extrapolate),
        ("B.7", Self::rub_on_bodies),
        ("B.8", Self::repel_final_velocity),
        ("B.8", Self::limit_final_strain),
        ("end", Self::end),
    ];

    fn solves(&self) -> Solves<'a> {
        Solves { parts: self.parts, masses: self.masses, settings: self.settings, time: self.cloth.state.time }
    }

    /// B.1: v½ from x and v.
    fn half_velocity(&mut self) {
        let solves = self.solves();
        let Self { parts, cloth, dynamics, prescribed, metrics, report, .. } = self;
        let (state, (arrays, v_half, ..)) = (&cloth.state, cloth.scratch.of_solves());
        let SolveArrays { explicit, effective_masses, cg, .. } = arrays;
        let Dynamics { forces, volumes, wind, .. } = &mut **dynamics;
        metrics.stage("B.1 velocity", |m| {
            volumes.update(parts, &state.x);
            let (x, v) = (&state.x[..], &state.v[..]);
            effective_masses.set(parts, forces, solves.masses, 0.5 * solves.settings.dt);
            let effective_masses = effective_masses.get();
            let at = Evaluation { fraction: 0.0, x, v, effective_masses, prescribed, volumes, wind, contacts: None };
            let problem = solves.at(at);
            let outcome = problem.solve(forces, cg, &state.v, explicit, v_half);
            report.add(outcome, "B.1", (parts, m), || cg.unsolved(parts, solves.settings.stop));
        });
    }

    /// B.5: v½ from v* and the forces at the middle.
    fn middle_velocity(&mut self) {
        let solves = self.solves();
        let Self { parts, cloth, dynamics, prescribed, contacts, metrics, report, .. } = self;
        let (state, (arrays, v_half, v_star, x_new)) = (&mut cloth.state, cloth.scratch.of_solves());
        let Dynamics { forces, volumes, wind, .. } = &mut **dynamics;
        metrics.stage("B.5 velocity", |m| {
            arrays.set_middle(&state.x, x_new);
            volumes.update(parts, &arrays.x_middle);
            arrays.predict_velocity(parts, v_half, v_star, &state.v);
            let SolveArrays { x_middle, explicit, effective_masses, v_seen, cg } = arrays;
            let v_start: &[Vec3] = if v_star.is_empty() { &state.v } else { v_star };
            let (contacts, x) = (contacts.bodies.as_ref(), &x_middle[..]);
            let effective_masses = effective_masses.get();
            let at = Evaluation { fraction: 0.5, x, v: v_seen, effective_masses, prescribed, volumes, wind, contacts };
            let problem = solves.at(at);
            let outcome = problem.solve(forces, cg, v_start, explicit, v_half);
            report.add(outcome, "B.5", (parts, m), || cg.unsolved(parts, solves.settings.stop));
            if let Some(contacts) = contacts {
                // v is not needed any more: B.6 goes on from v*.
                problem.undo_projection(contacts, forces, explicit, v_half, &mut state.v);
                std::mem::swap(&mut state.v, v_half);
            }
        });
    }

    /// B.6: v' from v½ and v*; the state is at its end.
    fn extrapolate(&mut self) {
        let Cloth { state, scratch } = &mut *self.cloth;
        let watch = Watch::start();
        scratch.extrapolate(&mut state.v);
        std::mem::swap(&mut state.x, &mut scratch.x_new);
        // One call of the stage that B.5 has begun.
        self.metrics.add_time("B.5 velocity".into(), watch.seconds(), 0);
    }
}
