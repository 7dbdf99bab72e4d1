//! The integrators: a row for each with everything that other rooms ask of it. Its listing is in `crate::step`.

use crate::settings::choice;

choice! {
    /// Time integration: the treatment of elastic forces in the two solves of a step. See `docs/theory/step.md` and `docs/theory/tr_bdf2.md`.
    ///
    /// ```
    /// use drapery_core::Integrator;
    /// assert_eq!(Integrator::find("tr_bdf2"), Some(Integrator::TrBdf2));
    /// assert!(Integrator::TrBdf2.spec().is_implicit && !Integrator::SemiImplicit.spec().is_implicit);
    /// ```
    pub enum Integrator {
        // `docs/theory/step.md`.
        /// The paper's step: explicit, with implicit damping. Of second order; elastic forces limit the time step.
        SemiImplicit = "semi_implicit",
        // `docs/theory/tr_bdf2.md`.
        /// Long steps: all that resists motion is implicit, so that stiffness does not limit the time step. Of second order,
        /// and stiff motion dies out.
        TrBdf2 = "tr_bdf2",
        // `docs/theory/tr_bdf2.md#when-long-steps-pay`.
        /// The one of these that is expected to take less time, from the sizes and the stiffness of the scene. The other one is tried for a
        /// frame now and then, and stays where it is faster.
        Auto = "auto",
    }
}

/// Lines of a step in which self-repulsion acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RepulsionPlace {
    /// Impulses in B.2 and B.8, as in the paper.
    Impulses,
    /// Forces in the solves of B.1 and B.5.
    Solves,
}

/// Properties of an integrator that other rooms read.
#[derive(Debug, Clone, Copy)]
pub struct IntegratorSpec {
    /// True if elastic forces are part of the solves: their stiffness does not limit the time step, fabrics may follow a tensile
    /// curve, and the length of a step comes from `steps_per_frame`.
    pub is_implicit: bool,
    /// Lines in which self-repulsion acts.
    pub repulsion: RepulsionPlace,
    /// True if the solves drag vertices along that are pinched by surfaces which have passed through one another; else B.4 does.
    pub pinched_in_solves: bool,
    /// True if a step predicts with the acceleration of the last one, which checkpoints keep.
    pub keeps_acceleration: bool,
    /// Largest relative change of an edge's length in one step where the scene says none: short steps are shortened for stability,
    /// long ones for motion that they could not follow.
    pub strain_per_step: f64,
    /// Sweeps over edges with a limit on strain in a step, over those that the scene allows: in a frame, about as many with all integrators.
    pub strain_limit_sweep_factor: usize,
    /// Added to [`crate::SOLVER_VERSION`] in scenes with this integrator; raised where a change leaves the results of all others
    /// alone.
    pub version: u32,
    /// Keys of `[solver]` that have no effect with it.
    pub unused: &'static [UnusedKey],
}

/// A key of `[solver]` that has no effect with an integrator.
#[derive(Debug, Clone, Copy)]
pub struct UnusedKey {
    /// The key.
    pub key: &'static str,
    /// The reason.
    pub because: &'static str,
    /// The line of a scene to write instead.
    pub instead: &'static str,
}

/// Rows, in the order of [`Integrator::ALL`].
static SPECS: [IntegratorSpec; Integrator::ALL.len()] = [
    IntegratorSpec {
        is_implicit: false,
        repulsion: RepulsionPlace::Impulses,
        pinched_in_solves: false,
        keeps_acceleration: false,
        strain_per_step: 0.1,
        strain_limit_sweep_factor: 1,
        version: 0,
        unused: &[UnusedKey {
            key: "steps_per_frame",
            because: "it sets the steps of `tr_bdf2` only",
            instead: "cfl = 2 for shorter steps, or integrator = \"tr_bdf2\"",
        }],
    },
    IntegratorSpec {
        is_implicit: true,
        repulsion: RepulsionPlace::Solves,
        pinched_in_solves: true,
        keeps_acceleration: true,
        strain_per_step: 0.5,
        strain_limit_sweep_factor: 16,
        version: 14,
        unused: &[UnusedKey {
            key: "cfl",
            because: "it limits the steps for explicit forces, and long steps have none",
            instead: "steps_per_frame = 16 for shorter steps, or integrator = \"semi_implicit\"",
        }],
    },
];

impl Integrator {
    /// All that a simulation can have, in the order of their words.
    pub const ALL: [Self; 2] = [Self::SemiImplicit, Self::TrBdf2];

    /// The row of this integrator; of short steps for [`Integrator::Auto`], which a simulation replaces by its choice.
    pub fn spec(self) -> &'static IntegratorSpec {
        match self {
            Self::SemiImplicit | Self::Auto => &SPECS[0],
            Self::TrBdf2 => &SPECS[1],
        }
    }

    /// Keys of `[solver]` that have no effect with it. [`Integrator::Auto`] takes an integrator that reads them.
    pub fn unused_keys(self) -> impl Iterator<Item = &'static UnusedKey> {
        let unused = if self == Self::Auto { &[] } else { self.spec().unused };
        unused.iter()
    }

    /// The integrator of a word.
    pub fn find(word: &str) -> Option<Self> {
        [Self::SemiImplicit, Self::TrBdf2, Self::Auto].into_iter().find(|integrator| integrator.word() == word)
    }

    /// Its word in a scene.
    pub const fn word(self) -> &'static str {
        Self::WORDS[self as usize].name
    }
}
