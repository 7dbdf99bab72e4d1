//! Settings of the time integration.

use crate::scene::Integrator;
use crate::scene::described::described;
use crate::settings::{self, Dimension, Field, Member, Word, Written, written};
use crate::tolerances::PREVIEW_TOLERANCE;

/// Settings of the time integration (`docs/theory/step.md`): the table `[solver]`, whose rows are below.
///
/// ```
/// use drapery_core::{Integrator, SolverSettings};
/// let long = SolverSettings { integrator: Integrator::TrBdf2, steps_per_frame: 16, ..SolverSettings::default() };
/// assert!(long.largest_strain_per_step() > SolverSettings::default().largest_strain_per_step());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SolverSettings {
    /// CFL number of the elastic step limit; 4 is the authors' value for cloth, below 2.83 is provably stable.
    pub cfl: f64,
    /// Largest time step [s]; `None` leaves the choice to the CFL number and the strain rate.
    pub max_dt: Option<f64>,
    /// A step that would have to be shorter than this ends the run with an error [s].
    pub min_dt: f64,
    /// Largest relative change of an edge's length in one step; `None` takes
    /// [`IntegratorSpec::strain_per_step`](crate::scene::IntegratorSpec::strain_per_step).
    pub strain_per_step: Option<f64>,
    /// Largest nodal residual at which the damping solve stops [m/s]; `None` takes the smaller of 1e-2 m/s and a tenth
    /// of what gravity adds in one step, so that accuracy does not fade as steps get shorter
    /// (`docs/theory/step.md#the-damping-solve`).
    pub cg_tolerance: Option<f64>,
    /// Largest number of conjugate gradient iterations of one solve; a solve that reaches it is counted, not fatal.
    pub cg_max_iterations: usize,
    /// Integrator: it says how elastic forces enter both solves.
    pub integrator: Integrator,
    /// Time steps of a frame where the integrator is [`Integrator::TrBdf2`], before anything asks for shorter ones.
    pub steps_per_frame: usize,
}

described! { all of SolverSettings {
    cfl => None, default Number(4.0), range (1e-6, 1e6),
        "CFL number of the elastic step limit; 4 is usual for cloth, below 2.83 is provably stable";
    max_dt => Time, default Auto, range (1e-9, 1e3),
        "largest time step; \"auto\" leaves it to cfl and strain_per_step";
    min_dt => Time, default Number(1e-9), range (1e-15, 1.0),
        "smallest time step; a run that needs a shorter step stops with an error";
    strain_per_step => None, default Auto, range (1e-7, 1e9),
        "largest change of strain of an edge in one time step; \"auto\" takes 0.1, and 0.5 with `tr_bdf2`";
    cg_tolerance => Speed, default Auto, range (1e-18, 1e6),
        "residual at which the damping solve stops; \"auto\" takes the smaller of 1 cm/s and a tenth of what gravity adds in one step";
    cg_max_iterations => None, default Count(200), range (1.0, 1e6),
        "largest number of iterations of one damping solve";
    integrator => None, default Choice("semi_implicit", Integrator::WORDS), range (0.0, 0.0),
        "treatment of elastic forces in a time step; left out, `auto` in a scene file of which a garment has a material";
    steps_per_frame => None, default Count(8), range (1.0, 1e4),
        "time steps of a frame with `tr_bdf2`; contact and fast strain may shorten them";
} }

impl SolverSettings {
    /// Largest relative change of an edge's length in one step.
    pub fn largest_strain_per_step(&self) -> f64 {
        self.strain_per_step.unwrap_or(self.integrator.spec().strain_per_step)
    }
}

/// Preset of the solver: everything that weighs error against time in long steps, under a word of `[solver]`. Measured errors and
/// times are in `docs/dev/measurements/accuracy.md`.
///
/// ```
/// use drapery_core::{SolverPreset, SolverSettings};
/// let hero = SolverPreset::find("hero").expect("a preset of this word");
/// let SolverPreset { integrator, steps_per_frame, cg_tolerance, .. } = *hero;
/// let settings = SolverSettings { integrator, steps_per_frame, cg_tolerance, ..SolverSettings::default() };
/// assert_eq!(settings.steps_per_frame, 16);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolverPreset {
    /// The word, and what it is for.
    pub word: Word,
    /// Integrator: it says how elastic forces enter a time step.
    pub integrator: Integrator,
    /// Time steps of a frame.
    pub steps_per_frame: usize,
    /// Residual at which solves stop [m/s]; `None` as in [`SolverSettings::cg_tolerance`].
    pub cg_tolerance: Option<f64>,
}

impl SolverPreset {
    /// The keys that it sets, with their values.
    pub fn written(&self) -> Written {
        written([
            ("integrator", self.integrator.value()),
            ("steps_per_frame", self.steps_per_frame.value()),
            ("cg_tolerance", self.cg_tolerance.value()),
        ])
    }

    /// The preset of a word.
    pub fn find(word: &str) -> Option<&'static Self> {
        PRESETS.iter().find(|preset| preset.word.name == word)
    }
}

// Steps decide the error and the time. Solves stop where what they leave is
// small beside the error of the steps (`docs/dev/decisions/0031-presets.md`).
/// The presets, the fastest first.
pub const PRESETS: [SolverPreset; 3] = [
    SolverPreset {
        word: Word { name: "preview", help: "For blocking: 4 long steps per frame, with a looser tolerance." },
        integrator: Integrator::TrBdf2,
        steps_per_frame: 4,
        cg_tolerance: Some(PREVIEW_TOLERANCE),
    },
    SolverPreset {
        word: Word { name: "production", help: "For shots: 8 long steps per frame." },
        integrator: Integrator::TrBdf2,
        steps_per_frame: 8,
        cg_tolerance: None,
    },
    SolverPreset {
        word: Word { name: "hero", help: "For close-ups: 16 long steps per frame." },
        integrator: Integrator::TrBdf2,
        steps_per_frame: 16,
        cg_tolerance: None,
    },
];

/// The row of `preset` in `[solver]`: the reader of a scene puts in what it stands for, before the solver looks.
pub const PRESET: Field = Field {
    name: "preset",
    dimension: Dimension::None,
    default: settings::Default::Word(&[PRESETS[0].word, PRESETS[1].word, PRESETS[2].word]),
    range: (0.0, 0.0),
    help: "long time steps with settings that balance error and time; keys written beside it override it",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Described;
    use crate::settings::Settings;

    #[test]
    fn every_preset_is_what_the_solver_takes_and_each_is_finer_than_the_one_before() {
        let settings = PRESETS.map(|preset| {
            let checked = Settings::check(SolverSettings::FIELDS, &preset.written());
            SolverSettings::of(&checked.unwrap_or_else(|texts| panic!("{}: {texts:?}", preset.word.name)))
        });
        for (preset, found) in PRESETS.iter().zip(&settings) {
            let expected = (preset.integrator, preset.steps_per_frame, preset.cg_tolerance);
            let kept = (found.integrator, found.steps_per_frame, found.cg_tolerance);
            assert_eq!(kept, expected);
            assert_eq!(SolverPreset::find(preset.word.name), Some(preset));
            assert!(preset.word.help.contains(&preset.steps_per_frame.to_string()), "{}", preset.word.help);
        }
        assert!(settings.windows(2).all(|pair| pair[0].steps_per_frame < pair[1].steps_per_frame));
        // What the solver chooses by itself is at most 1 cm/s, and less in shorter steps; far more would be seen.
        assert!(settings[0].cg_tolerance.is_some_and(|tolerance| (1e-2..5e-2).contains(&tolerance)));
        assert!(settings[1..].iter().all(|settings| settings.cg_tolerance.is_none()));
        assert!(Settings::check(&[PRESET], &Written::new()).is_ok_and(|settings| settings.text("preset").is_none()));
    }
}
