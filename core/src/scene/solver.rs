//! Settings of the time integration.

use crate::scene::described::described;
use crate::settings::choice;

/// Settings of the time integration (`docs/theory/step.md`): the table `[solver]`, whose rows are below.
#[derive(Debug, Clone, PartialEq)]
pub struct SolverSettings {
    /// CFL number of the elastic step limit; 4 is the authors' value for cloth, below 2.83 is provably stable.
    pub cfl: f64,
    /// Largest time step [s]; `None` leaves the choice to the CFL number and the strain rate.
    pub max_dt: Option<f64>,
    /// A step that would have to be shorter than this ends the run with an error [s].
    pub min_dt: f64,
    /// Largest relative change of an edge's length in one step; `None` leaves it to the integrator
    /// ([`SolverSettings::strain_per_step`]).
    pub strain_per_step: Option<f64>,
    /// Largest nodal residual at which the damping solve stops [m/s]; `None` takes the smaller of 1e-2 m/s and a tenth
    /// of what gravity adds in one step, so that accuracy does not fade as steps get shorter
    /// (`docs/theory/step.md#the-damping-solve`).
    pub cg_tolerance: Option<f64>,
    /// Largest number of conjugate gradient iterations of one solve; a solve that reaches it is counted, not fatal.
    pub cg_max_iterations: usize,
    /// How elastic forces enter both solves.
    pub integrator: Integrator,
    /// Time steps of a frame where the integrator is [`Integrator::TrBdf2`], before anything asks for shorter ones.
    pub steps_per_frame: usize,
    /// Where in a step friction with bodies acts.
    pub body_friction: BodyFriction,
}

described! { all of SolverSettings {
    cfl => None, default Number(4.0), range (1e-6, 1e6),
        "CFL number of the elastic step limit; 4 is usual for cloth, below 2.83 is provably stable";
    max_dt => Time, default Auto, range (1e-9, 1e3),
        "largest time step; \"auto\" leaves it to cfl and strain_per_step";
    min_dt => Time, default Number(1e-9), range (1e-15, 1.0),
        "a step that would have to be shorter ends the run";
    strain_per_step => None, default Auto, range (1e-7, 1e9),
        "largest relative change of an edge's length in one step; \"auto\" is 0.1, and 0.5 with `tr_bdf2`";
    cg_tolerance => Speed, default Auto, range (1e-18, 1e6),
        "residual at which the damping solve stops; \"auto\" takes the smaller of 1 cm/s and a tenth of what gravity adds in one step";
    cg_max_iterations => None, default Count(200), range (1.0, 1e6),
        "largest number of iterations of one damping solve";
    integrator => None, default Choice("semi_implicit", Integrator::WORDS), range (0.0, 0.0),
        "how elastic forces enter a time step; only to compare";
    steps_per_frame => None, default Count(8), range (1.0, 1e4),
        "time steps of a frame with `tr_bdf2`; contact and fast strain may shorten them";
    body_friction => None, default Choice("whole_step", BodyFriction::WORDS), range (0.0, 0.0),
        "where in a time step friction with bodies acts; only to compare";
} }

impl SolverSettings {
    /// Largest relative change of an edge's length in one step. Explicit springs ask for 0.1 (R. Bridson, R. Fedkiw, J. Anderson,
    /// "Robust treatment of collisions, contact and friction for cloth animation", SIGGRAPH 2002); where they are implicit a step
    /// is shortened for motion that it could not follow, not for its stability.
    pub fn strain_per_step(&self) -> f64 {
        let automatic = if self.integrator == Integrator::TrBdf2 { 0.5 } else { 0.1 };
        self.strain_per_step.unwrap_or(automatic)
    }
}

choice! {
    /// How elastic forces enter the two solves of a step; see `docs/theory/variants.md`.
    pub enum Integrator {
        /// The paper's step: explicit, with implicit damping. Of second order; elastic forces limit the time step.
        SemiImplicit = "semi_implicit",
        // `docs/theory/variants.md#fully-implicit`: springs are linearised over the step; it loses energy like backward Euler.
        /// Springs are implicit like damping, so that they do not limit the time step; other forces stay explicit. Of first
        /// order only.
        Implicit = "implicit",
        // `docs/theory/tr_bdf2.md`.
        /// Long steps: all that resists motion is implicit, so that stiffness does not limit the time step. Of second order,
        /// and stiff motion dies out.
        TrBdf2 = "tr_bdf2",
    }
}

choice! {
    /// Where in a time step friction between cloth and bodies acts; see `docs/theory/variants.md`.
    pub enum BodyFriction {
        // `docs/theory/friction.md#why-it-is-accurate`: in B.4, and in B.7 on the final velocities with the load of the whole step.
        /// In the position half and on the velocities of the end: the paper's, which is exact.
        WholeStep = "whole_step",
        /// In the position half alone: it loses the friction of resting contact.
        PositionHalf = "position_half",
    }
}
