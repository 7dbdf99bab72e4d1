//! What a study varies: named changes of a scene, alone or in all combinations.

use crate::study::record::{Asked, Role, Setting};

/// Word for a setting without any change.
pub const AS_IS: &str = "as the scene";

/// Name under which effects are left out.
const WITHOUT: &str = "without";

/// Name under which deforming bodies are shown more seldom.
const BODY_FRAMES: &str = "body_frames";

/// Short names of keys of the scene.
const SHORT: [(&str, &str); 8] = [
    ("cfl", "solver.cfl"),
    ("max_dt", "solver.max_dt"),
    ("cg_tolerance", "solver.cg_tolerance"),
    ("strain_per_step", "solver.strain_per_step"),
    ("max_steps", "self_collision.max_steps"),
    ("integrator", "solver.integrator"),
    ("body_friction", "solver.body_friction"),
    ("per_collision_step", "self_repulsion.per_collision_step"),
];

/// Keys of `[solver]` that are another method, not another accuracy.
const METHODS: [&str; 2] = ["solver.integrator", "solver.body_friction"];

/// Name of the thickness of all garments.
const THICKNESS: &str = "thickness";

/// Parameter that is taken for the fineness of the mesh.
pub const RESOLUTION: &str = "resolution";

/// How much finer in time than the scene the reference is, the finest that there is time for.
pub const FINENESS: [u32; 3] = [16, 8, 4];

/// Time of a reference and its checks by that of the scene as it is, for each time that it is finer.
pub const REFERENCE_TIMES: f64 = 1.5 * (1.0 + 0.5 + 0.25);

/// Tolerance of the velocity solves of the reference [m/s].
const REFERENCE_TOLERANCE: &str = "1e-9";

/// Iterations that the velocity solves of the reference may take.
const REFERENCE_ITERATIONS: &str = "5000";

/// Tighter tolerance of the velocity solves that is tried [m/s].
const TIGHT: &str = "1e-5";

/// What of the scene the choice of variations depends on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Ground {
    /// CFL number.
    pub cfl: f64,
    /// Longest step that the scene allows [s], where it says so.
    pub max_dt: Option<f64>,
    /// Names of the garments.
    pub garments: Vec<String>,
    /// Thickness of each [m].
    pub thicknesses: Vec<f64>,
    /// Names of the effects, each once.
    pub effects: Vec<String>,
    /// Whether a body deforms.
    pub has_surfaces: bool,
    /// Value of the parameter `resolution`, if the scene has one that is a number.
    pub resolution: Option<f64>,
}

/// A run that is wanted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Wish {
    /// What for.
    pub role: Role,
    /// What it changes.
    pub setting: Setting,
    /// Number of the copy with shifted positions; 0 for none.
    pub copy: u32,
    /// Number of the repeat; 0 for the first run.
    pub repeat: u32,
    /// Its time by that of the base, as far as one can say before trying.
    pub times: f64,
}

impl Wish {
    fn new(role: Role, setting: Setting, times: f64) -> Self {
        Self { role, setting, copy: 0, repeat: 0, times }
    }

    /// As it is called in messages.
    pub fn label(&self) -> String {
        let mut label = match self.role {
            Role::Reference => format!("reference ({})", self.setting.label),
            Role::ReferenceCheck | Role::ReferenceCoarse => format!("check of the reference ({})", self.setting.label),
            _ => self.setting.label.clone(),
        };
        if self.copy > 0 {
            label += &format!(", shifted copy {}", self.copy);
        }
        if self.repeat > 0 {
            label += &format!(", repeat {}", self.repeat);
        }
        label
    }
}

/// Reads `name=a,b,c`.
///
/// # Errors
/// It is something else, or a value that the name does not take.
pub fn parse_vary(text: &str) -> Result<(String, Vec<String>), String> {
    let wrong = || format!("`{text}`: write a name and its values, for example cfl=4,2,1");
    let (name, values) = text.split_once('=').ok_or_else(wrong)?;
    let values: Vec<String> = values.split(',').map(|value| value.trim().to_owned()).collect();
    let name = name.trim();
    if name.is_empty() || values.iter().any(String::is_empty) {
        return Err(wrong());
    }
    if name == BODY_FRAMES && values.iter().any(|value| !value.parse::<u32>().is_ok_and(|every| every > 0)) {
        return Err(format!("`{text}`: bodies are shown at every so many frames, for example {BODY_FRAMES}=1,2"));
    }
    Ok((name.to_owned(), values))
}

/// The setting with one more change.
fn changed(setting: &Setting, name: &str, value: &str, ground: &Ground) -> Setting {
    let mut setting = setting.clone();
    setting.changes.push((name.to_owned(), value.to_owned()));
    match name {
        WITHOUT => setting.without.push(value.to_owned()),
        // Values were checked when they were read.
        BODY_FRAMES => setting.body_frames = value.parse().unwrap_or(1),
        THICKNESS => {
            for (garment, thickness) in ground.garments.iter().zip(&ground.thicknesses) {
                let value = match value.strip_prefix('x').and_then(|factor| factor.parse::<f64>().ok()) {
                    Some(factor) => (thickness * factor).to_string(),
                    None => value.to_owned(),
                };
                setting.settings.push((format!("garment.{garment}.thickness"), value));
            }
        }
        _ => {
            let key = SHORT.iter().find(|(short, _)| *short == name).map_or(name, |(_, key)| key);
            setting.settings.push((key.to_owned(), value.to_owned()));
        }
    }
    let words: Vec<String> = setting.changes.iter().map(|(name, value)| format!("{name} {value}")).collect();
    setting.label = words.join(", ");
    setting
}

/// The scene as it is.
fn as_is() -> Setting {
    Setting { label: AS_IS.to_owned(), ..Setting::default() }
}

/// What a change of this name is compared with.
fn role_of(name: &str) -> Role {
    let key = SHORT.iter().find(|(short, _)| *short == name).map_or(name, |(_, key)| key);
    match name {
        WITHOUT => Role::Without,
        BODY_FRAMES => Role::Accuracy,
        _ if METHODS.contains(&key) => Role::Model,
        _ if key.starts_with("solver.") || key == "self_collision.max_steps" => Role::Accuracy,
        _ => Role::Model,
    }
}

/// Time of a change by that of the base, before anything is measured.
fn rough_times(name: &str, value: &str, ground: &Ground) -> f64 {
    let number = value.parse::<f64>().ok().filter(|number| *number > 0.0);
    match (name, number) {
        ("cfl", Some(cfl)) => ground.cfl / cfl,
        // A panel of n cells has n² vertices and takes n times as many steps.
        (RESOLUTION, Some(cells)) => ground.resolution.map_or(1.0, |base| (cells / base).powi(3)),
        ("max_dt", Some(dt)) => ground.max_dt.map_or(4.0, |base| (base / dt).max(1.0)),
        ("cg_tolerance", _) => 1.3,
        ("max_steps", _) => 1.5,
        _ => 1.0,
    }
}

/// All runs of a study, the most useful first: when time runs out, the last are missing. The reference is at least `fineness`
/// times as fine as the scene.
pub fn wishes(asked: &Asked, ground: &Ground, fineness: u32) -> Vec<Wish> {
    let mut all = vec![Wish::new(Role::Base, as_is(), 1.0)];
    let copy = |number: u32| Wish { copy: number, ..all[0].clone() };
    let copies: Vec<Wish> = (1..=asked.copies).map(copy).collect();
    let repeats = |of: &Wish| -> Vec<Wish> { (1..asked.repeats).map(|repeat| Wish { repeat, ..of.clone() }).collect() };
    let base_repeats = repeats(&all[0]);
    let varied = if asked.vary.is_empty() { default_space(ground) } else { asked_space(asked, ground) };
    let (accuracy, other): (Vec<Wish>, Vec<Wish>) = varied.into_iter().partition(|wish| wish.role == Role::Accuracy);
    let repeated: Vec<Wish> = accuracy.iter().flat_map(&repeats).collect();
    let mut copies = copies.into_iter();
    all.extend(copies.next());
    let mut accuracy = accuracy.into_iter();
    // One finer setting, then what it is to be compared with; the rest of the front after it.
    all.extend(accuracy.next());
    all.extend(references(asked, ground, fineness));
    all.extend(accuracy);
    all.extend(copies.next());
    all.extend(other);
    all.extend(copies);
    all.extend(base_repeats);
    all.extend(repeated);
    all
}

/// The reference and the runs that tell how far it has converged, the coarsest first.
fn references(asked: &Asked, ground: &Ground, fineness: u32) -> Vec<Wish> {
    let fineness = f64::from(fineness);
    let finest = |name: &str, from: f64| {
        let values = asked.vary.iter().filter(|(varied, _)| varied == name).flat_map(|(_, values)| values);
        values.filter_map(|value| value.parse::<f64>().ok()).filter(|v| *v > 0.0).fold(from, f64::min)
    };
    // At least twice as fine as anything that is compared with it.
    let cfl = (ground.cfl / fineness).min(finest("cfl", ground.cfl) / 2.0);
    let longest = ground.max_dt.or_else(|| {
        let asked = finest("max_dt", f64::INFINITY);
        asked.is_finite().then_some(asked * fineness / 2.0)
    });
    let finer = |coarser: f64| {
        let mut setting = changed(&as_is(), "cfl", &(cfl * coarser).to_string(), ground);
        if let Some(dt) = longest {
            let dt = (dt / fineness).min(finest("max_dt", f64::INFINITY) / 2.0) * coarser;
            setting = changed(&setting, "max_dt", &dt.to_string(), ground);
        }
        setting = changed(&setting, "cg_tolerance", REFERENCE_TOLERANCE, ground);
        setting.settings.push(("solver.cg_max_iterations".to_owned(), REFERENCE_ITERATIONS.to_owned()));
        setting
    };
    let times = 1.5 * ground.cfl / cfl;
    vec![
        Wish::new(Role::ReferenceCoarse, finer(4.0), times / 4.0),
        Wish::new(Role::ReferenceCheck, finer(2.0), times / 2.0),
        Wish::new(Role::Reference, finer(1.0), times),
    ]
}

/// What is varied when nobody says: steps and solves, then one at a time what else costs time or changes the picture.
fn default_space(ground: &Ground) -> Vec<Wish> {
    let mut space = Vec::new();
    let cfl = |divisor: f64| (ground.cfl / divisor).to_string();
    let one = |name: &str, value: &str| {
        let times = rough_times(name, value, ground);
        Wish::new(role_of(name), changed(&as_is(), name, value, ground), times)
    };
    space.push(one("cfl", &cfl(2.0)));
    space.push(one("cg_tolerance", TIGHT));
    space.push(one("cfl", &cfl(4.0)));
    for divisor in [2.0, 4.0] {
        let setting = changed(&changed(&as_is(), "cfl", &cfl(divisor), ground), "cg_tolerance", TIGHT, ground);
        space.push(Wish::new(Role::Accuracy, setting, 1.3 * divisor));
    }
    let has = |effect: &str| ground.effects.iter().any(|name| name == effect);
    if has("self_collision") {
        space.push(one("max_steps", "1"));
    }
    space.extend(ground.effects.iter().filter(|name| can_go(name)).map(|name| one(WITHOUT, name)));
    if has("self_repulsion") {
        space.push(one(THICKNESS, "x0.5"));
    }
    if let Some(cells) = ground.resolution.filter(|cells| *cells >= 8.0) {
        space.push(one(RESOLUTION, &(cells / 2.0).round().to_string()));
    }
    if ground.has_surfaces {
        space.push(one(BODY_FRAMES, "2"));
    }
    // What the method's own choices bring.
    space.push(one("integrator", "implicit"));
    if has("self_repulsion") {
        space.push(one("per_collision_step", "true"));
    }
    if has("body_collision") {
        space.push(one("body_friction", "position_half"));
    }
    space
}

/// Whether a shot without this effect still is one to look at: cloth without weight, without springs along its edges,
/// without what holds it or what it lies on is not.
fn can_go(effect: &str) -> bool {
    !["gravity", "stretch", "membrane", "pins", "attachments", "seams", "body_collision"].contains(&effect)
}

/// What was asked for: all combinations, or one change at a time.
fn asked_space(asked: &Asked, ground: &Ground) -> Vec<Wish> {
    let none = Wish::new(Role::Accuracy, as_is(), 1.0);
    let with = |wish: &Wish, name: &str, value: &str| {
        let role = match (wish.role, role_of(name)) {
            (Role::Accuracy, role) | (role, Role::Accuracy) => role,
            _ => Role::Model,
        };
        let times = wish.times * rough_times(name, value, ground);
        Wish::new(role, changed(&wish.setting, name, value, ground), times)
    };
    if !asked.grid {
        let one = |(name, values): &(String, Vec<String>)| {
            values.iter().map(|value| with(&none, name, value)).collect::<Vec<_>>()
        };
        return asked.vary.iter().flat_map(one).collect();
    }
    let mut all = vec![none];
    for (name, values) in &asked.vary {
        all = all.iter().flat_map(|wish| values.iter().map(|value| with(wish, name, value))).collect();
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ground() -> Ground {
        Ground {
            cfl: 4.0,
            garments: vec!["shirt".into(), "skirt".into()],
            thicknesses: vec![0.002, 0.001],
            effects: ["gravity", "stretch", "bending", "self_repulsion", "self_collision"].map(str::to_owned).into(),
            resolution: Some(40.0),
            ..Ground::default()
        }
    }

    fn asked(vary: &[&str], grid: bool) -> Asked {
        let vary = vary.iter().map(|text| parse_vary(text).unwrap()).collect();
        Asked { vary, grid, copies: 4, repeats: 3, ..Asked::default() }
    }

    #[test]
    fn one_at_a_time_and_grid_hold_what_they_say() {
        let labels = |asked: &Asked| -> Vec<String> {
            asked_space(asked, &ground()).iter().map(|wish| wish.setting.label.clone()).collect()
        };
        let vary = ["cfl=4,2", "cg_tolerance=1e-2,1e-4"];
        assert_eq!(labels(&asked(&vary, false)), ["cfl 4", "cfl 2", "cg_tolerance 1e-2", "cg_tolerance 1e-4"]);
        assert_eq!(labels(&asked(&vary, true)).len(), 4);
        assert_eq!(labels(&asked(&vary, true))[1], "cfl 4, cg_tolerance 1e-4");
        assert!(parse_vary("cfl").is_err() && parse_vary("cfl=").is_err() && parse_vary("body_frames=0").is_err());
    }

    #[test]
    fn a_factor_of_thickness_reaches_every_garment() {
        let setting = changed(&as_is(), "thickness", "x0.5", &ground());
        let expected = [("garment.shirt.thickness", "0.001"), ("garment.skirt.thickness", "0.0005")];
        assert_eq!(setting.settings, expected.map(|(key, value)| (key.to_owned(), value.to_owned())));
    }

    #[test]
    fn the_reference_is_finer_than_all_that_is_compared_with_it() {
        let cfl = |asked: &Asked| {
            let wish = references(asked, &ground(), FINENESS[0]).pop().unwrap();
            wish.setting.settings[0].1.parse::<f64>().unwrap()
        };
        assert_eq!(cfl(&asked(&[], false)), 0.25);
        assert_eq!(cfl(&asked(&["cfl=4,0.25"], false)), 0.125);
    }

    #[test]
    fn base_copy_and_references_come_before_what_only_measures_time_again() {
        let all = wishes(&asked(&[], false), &ground(), FINENESS[0]);
        let at = |found: &dyn Fn(&Wish) -> bool| all.iter().position(found).unwrap();
        assert_eq!(at(&|wish| wish.role == Role::Base), 0);
        assert_eq!(at(&|wish| wish.copy == 1), 1);
        assert!(at(&|wish| wish.role == Role::Reference) < at(&|wish| wish.role == Role::Without));
        assert!(at(&|wish| wish.role == Role::Without) < at(&|wish| wish.repeat > 0));
    }
}
