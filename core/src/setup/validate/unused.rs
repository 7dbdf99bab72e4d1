//! Settings of the solver that have no effect with the integrator of a scene.

use crate::error::Problem;
use crate::scene::{Described, SceneDescription, SolverSettings, UnusedKey};

/// Refuses values that differ from their defaults and that nothing reads, each by name.
pub(crate) fn check_unused(description: &SceneDescription, problems: &mut Vec<Problem>) {
    let integrator = description.solver.integrator;
    let [written, defaults] = [&description.solver, &SolverSettings::default()].map(Described::written);
    for UnusedKey { key, because, instead, .. } in integrator.unused_keys() {
        if written.get(*key) != defaults.get(*key) {
            let what = format!("`{key}` has no effect with `{}`: {because}", integrator.word());
            problems.push(Problem::scene("solver", what, format!("leave it out, or write {instead}")));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Integrator;
    use crate::settings::SettingValue;

    #[test]
    fn every_unused_key_is_refused_by_name_with_its_integrator_and_its_default_is_not() {
        let problems = |solver: SolverSettings| {
            let mut description = SceneDescription::new("scene");
            description.solver = solver;
            let mut problems = Vec::new();
            check_unused(&description, &mut problems);
            problems.iter().map(|problem| problem.what.clone()).collect::<Vec<_>>()
        };
        for integrator in Integrator::ALL {
            let of = |solver: SolverSettings| problems(SolverSettings { integrator, ..solver });
            assert!(of(SolverSettings::default()).is_empty());
            assert!(!integrator.spec().unused.is_empty());
            for UnusedKey { key, .. } in integrator.spec().unused {
                let mut written = SolverSettings::default().written();
                let Some(SettingValue::Number(value)) = written.get_mut(*key) else { panic!("`{key}` is a number") };
                *value *= 2.0;
                let checked = crate::settings::Settings::check(SolverSettings::FIELDS, &written);
                let solver = SolverSettings::of(&checked.expect("twice the default is in range"));
                let [found] = &of(solver.clone())[..] else { panic!("`{key}` is refused once") };
                assert!(found.starts_with(&format!("`{key}` has no effect with `{}`", integrator.word())), "{found}");
                let others = Integrator::ALL.into_iter().filter(|other| *other != integrator);
                others.for_each(|integrator| {
                    assert!(problems(SolverSettings { integrator, ..solver.clone() }).is_empty());
                });
            }
        }
    }
}
