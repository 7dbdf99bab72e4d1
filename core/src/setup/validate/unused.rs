//! Settings that have no effect with the integrator of a scene.

use crate::effects;
use crate::error::Problem;
use crate::scene::{Described, SceneDescription, SolverSettings};
use crate::settings::{Field, Written};

/// Refuses values that differ from their defaults and that the integrator does not read, each by name.
pub(super) fn check_unused(description: &SceneDescription, problems: &mut Vec<Problem>) {
    let integrator = description.solver.integrator;
    for row in integrator.spec().unused {
        let mut check = |place: String, fields, written: &Written| {
            for key in row.keys.iter().filter(|key| differs(fields, written, key)) {
                let what = format!("`{key}` has no effect with `{}`: {}", integrator.word(), row.because);
                problems.push(Problem::scene(&place, what, format!("leave it out, or write {}", row.instead)));
            }
        };
        if row.table == SOLVER {
            check(SOLVER.to_owned(), SolverSettings::FIELDS, &description.solver.written());
        }
        for request in description.effects.iter().filter(|request| request.effect == row.table) {
            let fields = effects::find(row.table).map_or(&[][..], |spec| spec.fields);
            check(row.table.to_owned(), fields, &request.settings);
        }
    }
}

/// Name of the table of [`SolverSettings`].
const SOLVER: &str = "solver";

/// True if a key has a value other than its default. Values that cannot be read are reported elsewhere.
fn differs(fields: &[Field], written: &Written, key: &str) -> bool {
    let Some(field) = fields.iter().find(|field| field.name == key) else { return false };
    let Some(value) = written.get(key).and_then(|value| field.check(value).ok()) else { return false };
    field.default.value().and_then(|value| field.check(&value).ok()) != Some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{EffectRequest, Integrator};
    use crate::settings::{SettingValue, Settings};

    #[test]
    fn every_unused_key_is_refused_by_name_with_its_integrator_and_its_default_is_not() {
        for integrator in Integrator::ALL {
            for row in integrator.spec().unused {
                for key in row.keys {
                    let fields = effects::find(row.table).map_or(SolverSettings::FIELDS, |spec| spec.fields);
                    let field = fields.iter().find(|field| field.name == *key).expect("the table has the key");
                    let Some(SettingValue::Number(usual)) = field.default.value() else {
                        panic!("`{key}` is a number")
                    };
                    let problems = |value: f64, integrator: Integrator| {
                        let mut description = SceneDescription::new("scene");
                        let written = Written::from([((*key).to_owned(), SettingValue::Number(value))]);
                        if row.table == SOLVER {
                            let checked = Settings::check(fields, &written).expect("a number in range");
                            description.solver = SolverSettings::of(&checked);
                        } else {
                            let request = EffectRequest { settings: written, ..EffectRequest::of_scene(row.table) };
                            description.effects.push(request);
                        }
                        description.solver.integrator = integrator;
                        let mut problems = Vec::new();
                        check_unused(&description, &mut problems);
                        problems.iter().map(|problem| problem.what.clone()).collect::<Vec<_>>()
                    };
                    let [found] = &problems(0.5 * usual, integrator)[..] else { panic!("`{key}` is refused once") };
                    assert!(
                        found.starts_with(&format!("`{key}` has no effect with `{}`", integrator.word())),
                        "{found}"
                    );
                    assert!(problems(usual, integrator).is_empty());
                    let others = Integrator::ALL.into_iter().filter(|other| *other != integrator);
                    others.for_each(|other| assert!(problems(0.5 * usual, other).is_empty(), "`{key}`"));
                }
            }
        }
    }
}
