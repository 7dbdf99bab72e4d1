//! The names that a study varies, and what each of them changes in a scene.

use drapery_core::effects::find;
use drapery_core::scene::{Described, Integrator, PRESET, SolverPreset, SolverSettings};
use drapery_core::settings::{self, Field, Settings};

use crate::study::record::{Role, Setting};

/// Word for a setting without any change.
pub(crate) const AS_IS: &str = "as the scene";

/// Name under which effects are left out.
pub(super) const WITHOUT: &str = "without";

/// Name under which deforming bodies are shown more seldom.
pub(super) const BODY_FRAMES: &str = "body_frames";

/// Name of the number of threads.
pub(super) const THREADS: &str = "threads";

/// Name of the number of ranks.
pub(super) const RANKS: &str = "ranks";

/// Name of the thickness of all garments.
pub(super) const THICKNESS: &str = "thickness";

/// Name of the friction of all bodies and of cloth on cloth.
pub(super) const FRICTION: &str = "friction";

/// Parameter that is taken for the fineness of the mesh.
pub(crate) const RESOLUTION: &str = "resolution";

/// Name of the CFL number.
pub(super) const CFL: &str = "cfl";

/// Name of the longest step.
pub(super) const MAX_DT: &str = "max_dt";

/// Name of the number of long steps in a frame.
pub(super) const STEPS_PER_FRAME: &str = "steps_per_frame";

/// Name of the integrator.
pub(super) const INTEGRATOR: &str = "integrator";

/// The integrators of short and of long steps, and their words.
const SHORT: Integrator = Integrator::SemiImplicit;
const LONG: Integrator = Integrator::TrBdf2;
pub(super) const SHORT_STEPS: &str = SHORT.word();
pub(super) const LONG_STEPS: &str = LONG.word();

/// Short names of keys of the scene, beside those of `[solver]`, which are named without their table.
const SHORT_NAMES: [(&str, &str); 1] = [("max_steps", "self_collision.max_steps")];

/// Power of the number of steps that the time of a run follows, measured on the sample scenes: shorter steps need fewer
/// iterations each.
const STEPS_POWER: f64 = 0.6;

/// Time of a run with solves a hundred times as tight, measured likewise.
const TIGHTER: f64 = 1.8;

/// Time of a run with short steps by that of one with long ones, measured likewise, and the other way about: on fine cloth long
/// ones save more, on a few thousand triangles hardly anything.
const SHORT_BY_LONG: f64 = 4.0;
const LONG_BY_SHORT: f64 = 1.0;

/// Start of the keys of the time integration.
const SOLVER: &str = "solver.";

/// Start of the keys that choose effects.
const CHOICE: &str = "effects.";

/// Settings of the scene on which the choice of variations depends.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct BaseSettings {
    /// Whether it takes long steps.
    pub is_implicit: bool,
    /// Long steps in a frame, also where it does not take them.
    pub steps_per_frame: usize,
    /// CFL number.
    pub cfl: f64,
    /// Longest step that the scene allows [s], where it says so.
    pub max_dt: Option<f64>,
    /// Tolerance of the velocity solves [m/s], where the scene says so; otherwise the solver chooses at each step.
    pub cg_tolerance: Option<f64>,
    /// Names of the garments.
    pub garments: Vec<String>,
    /// Thickness of each [m].
    pub thicknesses: Vec<f64>,
    /// Names of the bodies.
    pub bodies: Vec<String>,
    /// Names of the effects, each once.
    pub effects: Vec<String>,
    /// Effects that the scene itself leaves out.
    pub left_out: Vec<String>,
    /// Whether a body deforms.
    pub has_surfaces: bool,
    /// Value of the parameter `resolution`, if the scene has one that is a number.
    pub resolution: Option<f64>,
    /// Threads of the runs.
    pub threads: usize,
}

/// A name and the value that it gets.
pub(crate) type Change<'a> = (&'a str, &'a str);

impl BaseSettings {
    /// The integrator of the scene with these changes.
    fn integrator_with(&self, changes: &[Change<'_>]) -> Integrator {
        let chosen = changes.iter().rev().find_map(|(name, value)| match *name {
            INTEGRATOR => Integrator::find(value),
            _ if *name == PRESET.name => SolverPreset::find(value).map(|preset| preset.integrator),
            _ => None,
        });
        chosen.unwrap_or(if self.is_implicit { LONG } else { SHORT })
    }

    /// Changes that are to be made together, without those that say nothing to their integrator; in a scene with short steps a
    /// number of long ones asks for them.
    pub(super) fn meant<'a>(&self, mut changes: Vec<Change<'a>>) -> Vec<Change<'a>> {
        let names = |name: &str, changes: &[Change<'_>]| changes.iter().any(|(found, _)| *found == name);
        if !self.is_implicit && names(STEPS_PER_FRAME, &changes) && !names(INTEGRATOR, &changes) {
            changes.insert(0, (INTEGRATOR, LONG_STEPS));
        }
        let integrator = self.integrator_with(&changes);
        changes.retain(|(name, _)| !integrator.unused_keys().any(|unused| unused.key == *name));
        changes
    }

    /// Settings that go with a change of the integrator: keys of the scene that it does not read, and would refuse, get their defaults.
    fn resets(&self, name: &str, value: &str) -> Vec<(String, String)> {
        // A key that has no effect in the scene itself was refused before.
        if ![INTEGRATOR, PRESET.name].contains(&name) {
            return Vec::new();
        }
        let unused = self.integrator_with(&[(name, value)]).unused_keys();
        let of_scene = |key: &str| match key {
            CFL => Some(self.cfl),
            STEPS_PER_FRAME => Some(self.steps_per_frame as f64),
            _ => None,
        };
        let usual = Settings::defaults(SolverSettings::FIELDS);
        let differs = |key: &&str| of_scene(key).is_some_and(|value| value != usual.number(key));
        let keys = unused.map(|unused| unused.key).filter(differs);
        keys.map(|key| (key_of(key), usual.number(key).to_string())).collect()
    }

    /// Whether an effect of the scene has a setting of this name.
    pub(super) fn takes(&self, setting: &str) -> bool {
        let has = |name: &String| find(name).is_some_and(|spec| spec.fields.iter().any(|field| field.name == setting));
        self.effects.iter().any(has)
    }

    /// Whether the scene has an effect.
    pub(super) fn has(&self, effect: &str) -> bool {
        self.effects.iter().any(|name| name == effect)
    }
}

/// Reads `name=a,b,c`.
///
/// # Errors
/// It is something else, or a value that the name does not take.
pub fn parse_vary(text: &str) -> Result<(String, Vec<String>), String> {
    let (name, values) = parse_values(text)?;
    let are_counts = values.iter().all(|value| value.parse::<u16>().is_ok_and(|count| count > 0));
    if name == BODY_FRAMES && !are_counts {
        return Err(format!("`{text}`: give intervals of 1 frame or more, for example {BODY_FRAMES}=1,2"));
    }
    if [THREADS, RANKS].contains(&name.as_str()) && !are_counts {
        return Err(format!("`{text}`: give whole numbers of 1 or more, for example {name}=1,2"));
    }
    Ok((name, values))
}

/// Reads `name=a,b,c`. Commas inside brackets or quotes belong to a value.
///
/// # Errors
/// It is something else.
pub fn parse_values(text: &str) -> Result<(String, Vec<String>), String> {
    let wrong = || format!("`{text}`: write a name and its values, for example cfl=4,2,1");
    let (name, rest) = text.split_once('=').ok_or_else(wrong)?;
    let (mut values, mut depth, mut quote) = (vec![String::new()], 0_i32, None);
    for c in rest.chars() {
        match (c, quote) {
            (_, Some(open)) if c == open => quote = None,
            ('"' | '\'', None) => quote = Some(c),
            ('[' | '{', None) => depth += 1,
            (']' | '}', None) => depth -= 1,
            (',', None) if depth <= 0 => {
                values.push(String::new());
                continue;
            }
            _ => {}
        }
        // There is always a last value.
        values.last_mut().into_iter().for_each(|value| value.push(c));
    }
    let values: Vec<String> = values.iter().map(|value| value.trim().to_owned()).collect();
    match name.trim() {
        "" => Err(wrong()),
        _ if values.iter().any(String::is_empty) => Err(wrong()),
        name => Ok((name.to_owned(), values)),
    }
}

/// Every combination of the values, the last name varying fastest; each has the names in their order.
pub(crate) fn combinations(vary: &[(String, Vec<String>)]) -> Vec<Vec<Change<'_>>> {
    let mut rows: Vec<Vec<Change<'_>>> = vec![Vec::new()];
    for (name, values) in vary {
        let changes = || values.iter().map(|value| (&**name, &**value));
        rows = rows.iter().flat_map(|row| changes().map(move |change| [&row[..], &[change]].concat())).collect();
    }
    rows
}

/// The scene as it is.
pub(super) fn as_is() -> Setting {
    Setting { label: AS_IS.to_owned(), ..Setting::default() }
}

/// The setting with one more change.
pub(super) fn changed(setting: &Setting, name: &str, value: &str, ground: &BaseSettings) -> Setting {
    let mut setting = setting.clone();
    setting.changes.push((name.to_owned(), value.to_owned()));
    match name {
        WITHOUT => leave_out(&mut setting, ground),
        // Values were checked when they were read.
        BODY_FRAMES => setting.body_frames = value.parse().unwrap_or(1),
        THREADS => setting.threads = value.parse().unwrap_or(0),
        RANKS => setting.ranks = value.parse().unwrap_or(1),
        THICKNESS => {
            for (garment, thickness) in ground.garments.iter().zip(&ground.thicknesses) {
                let value = match value.strip_prefix('x').and_then(|factor| factor.parse::<f64>().ok()) {
                    Some(factor) => (thickness * factor).to_string(),
                    None => value.to_owned(),
                };
                setting.settings.push((format!("garment.{garment}.thickness"), value));
            }
        }
        FRICTION => {
            let bodies = ground.bodies.iter().map(|body| format!("body.{body}.friction"));
            let cloth = ground.takes("friction").then(|| "self_repulsion.friction".to_owned());
            setting.settings.extend(bodies.chain(cloth).map(|key| (key, value.to_owned())));
        }
        _ => {
            setting.settings.extend(ground.resets(name, value));
            setting.settings.push((key_of(name), value.to_owned()));
        }
    }
    let words: Vec<String> = setting.changes.iter().map(|(name, value)| format!("{name} {value}")).collect();
    setting.label = words.join(", ");
    setting
}

/// Leaves out what the changes say besides what the scene itself leaves out, as `--without` does.
fn leave_out(setting: &mut Setting, ground: &BaseSettings) {
    let named = setting.changes.iter().filter(|(name, _)| name == WITHOUT).map(|(_, effect)| effect.clone());
    let names: Vec<String> = ground.left_out.iter().cloned().chain(named).collect();
    setting.settings.retain(|(key, _)| !key.starts_with(CHOICE));
    setting.settings.push((format!("{CHOICE}without"), format!("{names:?}")));
    setting.settings.push((format!("{CHOICE}only"), "[]".to_owned()));
}

/// The row of `[solver]` with a name, alone or behind that of the table.
fn row_of(name: &str) -> Option<&'static Field> {
    let name = name.strip_prefix(SOLVER).unwrap_or(name);
    SolverSettings::FIELDS.iter().chain([&PRESET]).find(|field| field.name == name)
}

pub(super) fn key_of(name: &str) -> String {
    match row_of(name) {
        Some(row) => format!("{SOLVER}{}", row.name),
        None => SHORT_NAMES.iter().find(|(short, _)| *short == name).map_or(name, |(_, key)| key).to_owned(),
    }
}

/// Returns the role of a change of this name, which decides its comparison.
pub(super) fn role_of(name: &str) -> Role {
    match (name, row_of(name)) {
        (WITHOUT, _) => Role::Without,
        (THREADS | RANKS, _) => Role::Threads,
        (BODY_FRAMES, _) => Role::Accuracy,
        // Both integrators converge to the same motion; other words are another method.
        (_, Some(Field { name: INTEGRATOR, .. })) => Role::Accuracy,
        (_, Some(Field { default: settings::Default::Choice(..), .. })) => Role::Model,
        (_, Some(_)) => Role::Accuracy,
        _ if name.starts_with(SOLVER) || key_of(name) == "self_collision.max_steps" => Role::Accuracy,
        _ => Role::Model,
    }
}

/// Time of a change by that of the base, before anything is measured.
pub(super) fn rough_times(name: &str, value: &str, ground: &BaseSettings) -> f64 {
    let number = value.parse::<f64>().ok().filter(|number| *number > 0.0);
    match (name, number) {
        (CFL, Some(cfl)) => (ground.cfl / cfl).powf(STEPS_POWER),
        (STEPS_PER_FRAME, Some(steps)) => (steps / ground.steps_per_frame.max(1) as f64).powf(STEPS_POWER),
        (INTEGRATOR, _) if ground.is_implicit && value == SHORT_STEPS => SHORT_BY_LONG,
        (INTEGRATOR, _) if !ground.is_implicit && value == LONG_STEPS => LONG_BY_SHORT,
        // A panel of n cells has n² vertices and takes n times as many steps.
        (RESOLUTION, Some(cells)) => ground.resolution.map_or(1.0, |base| (cells / base).powi(3)),
        (MAX_DT, Some(dt)) => ground.max_dt.map_or(4.0, |base| base / dt).max(1.0).powf(STEPS_POWER),
        ("cg_tolerance", Some(tolerance)) if ground.cg_tolerance.is_none_or(|base| tolerance < base) => TIGHTER,
        ("max_steps", _) => 1.2,
        (THREADS, Some(count)) => (ground.threads as f64 / count).max(1.0),
        _ => 1.0,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::study) fn ground() -> BaseSettings {
        BaseSettings {
            steps_per_frame: 8,
            cfl: 4.0,
            cg_tolerance: Some(1e-3),
            garments: vec!["shirt".into(), "skirt".into()],
            thicknesses: vec![0.002, 0.001],
            bodies: vec!["hero".into()],
            effects: ["gravity", "stretch", "bending", "self_repulsion", "self_collision"].map(str::to_owned).into(),
            resolution: Some(40.0),
            threads: 2,
            ..BaseSettings::default()
        }
    }

    fn pairs(expected: &[(&str, &str)]) -> Vec<(String, String)> {
        expected.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    }

    #[test]
    fn commas_in_brackets_and_quotes_belong_to_a_value() {
        let values = |text: &str| parse_values(text).map(|(_, values)| values);
        assert_eq!(values("cfl=4, 2"), Ok(vec!["4".into(), "2".into()]));
        assert_eq!(values("g=[0, -9.81, 0],[0,-1,0]"), Ok(vec!["[0, -9.81, 0]".into(), "[0,-1,0]".into()]));
        assert_eq!(values("name=\"a,b\",c"), Ok(vec!["\"a,b\"".into(), "c".into()]));
        assert!(values("cfl=4,,2").is_err() && values("=4").is_err() && values("cfl").is_err());
    }

    #[test]
    fn a_factor_of_thickness_reaches_every_garment_and_friction_everything_that_rubs() {
        let setting = changed(&as_is(), "thickness", "x0.5", &ground());
        let expected = [("garment.shirt.thickness", "0.001"), ("garment.skirt.thickness", "0.0005")];
        assert_eq!(setting.settings, pairs(&expected));
        let setting = changed(&as_is(), "friction", "0", &ground());
        assert_eq!(setting.settings, pairs(&[("body.hero.friction", "0"), ("self_repulsion.friction", "0")]));
        let bare = BaseSettings { effects: Vec::new(), ..ground() };
        assert_eq!(changed(&as_is(), "friction", "0", &bare).settings, pairs(&[("body.hero.friction", "0")]));
    }

    #[test]
    fn keys_of_the_scene_that_another_integrator_does_not_read_get_their_defaults() {
        let fine = BaseSettings { cfl: 1.0, ..ground() };
        let long = changed(&as_is(), INTEGRATOR, LONG_STEPS, &fine);
        assert_eq!(long.settings, pairs(&[("solver.cfl", "4"), ("solver.integrator", LONG_STEPS)]));
        assert_eq!(changed(&as_is(), INTEGRATOR, LONG_STEPS, &ground()).settings.len(), 1);
        let hero = BaseSettings { is_implicit: true, steps_per_frame: 16, ..ground() };
        let short = changed(&as_is(), INTEGRATOR, SHORT_STEPS, &hero);
        assert_eq!(short.settings, pairs(&[("solver.steps_per_frame", "8"), ("solver.integrator", SHORT_STEPS)]));
    }

    #[test]
    fn effects_are_left_out_besides_those_that_the_scene_leaves_out() {
        let ground = BaseSettings { left_out: vec!["wind".into()], ..ground() };
        let one = changed(&as_is(), "without", "bending", &ground);
        assert_eq!(one.settings, pairs(&[("effects.without", r#"["wind", "bending"]"#), ("effects.only", "[]")]));
        let two = changed(&one, "without", "self_repulsion", &ground);
        let expected = [("effects.without", r#"["wind", "bending", "self_repulsion"]"#), ("effects.only", "[]")];
        assert_eq!(two.settings, pairs(&expected));
    }

    #[test]
    fn every_row_of_the_solver_can_be_varied_by_its_name_alone() {
        for row in SolverSettings::FIELDS {
            let setting = changed(&as_is(), row.name, "2", &ground());
            assert_eq!(setting.settings, pairs(&[(&format!("solver.{}", row.name), "2")]));
            assert_eq!(role_of(row.name), role_of(&format!("solver.{}", row.name)));
        }
        assert_eq!((role_of("min_dt"), role_of("integrator")), (Role::Accuracy, Role::Accuracy));
        assert_eq!((role_of("preset"), role_of("body_friction")), (Role::Accuracy, Role::Model));
        assert_eq!(
            (key_of("max_steps"), key_of("resolution")),
            ("self_collision.max_steps".into(), "resolution".into())
        );
    }

    #[test]
    fn changes_are_made_only_to_an_integrator_that_reads_them_and_steps_per_frame_asks_for_it() {
        let (short, long) = (ground(), BaseSettings { is_implicit: true, ..ground() });
        let eight = (STEPS_PER_FRAME, "8");
        assert_eq!(short.meant(vec![eight]), [(INTEGRATOR, LONG_STEPS), eight]);
        assert_eq!(long.meant(vec![eight, (CFL, "2")]), [eight]);
        assert_eq!(
            long.meant(vec![(INTEGRATOR, SHORT_STEPS), eight, (CFL, "2")]),
            [(INTEGRATOR, SHORT_STEPS), (CFL, "2")]
        );
        assert_eq!(short.meant(vec![(PRESET.name, "hero"), (CFL, "2")]), [(PRESET.name, "hero")]);
    }

    #[test]
    fn values_that_a_name_does_not_take_are_refused() {
        for wrong in ["cfl", "cfl=", "body_frames=0", "threads=0", "threads=many", "ranks=0"] {
            assert!(parse_vary(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_vary("threads=1, 2").unwrap().1, ["1", "2"]);
    }
}
