//! Settings: effects, `[solver]`, bodies, pins and seams declare their values as [`Field`]s; what a scene wrote is checked against
//! them once. From a field come its check, help, JSON schema and reference page.
//!
//! A value may be written as a bare number in the field's SI unit, or as text with a unit (`"2 mm"`). A unit of another
//! dimension is refused.

mod dimension;
mod member;

use std::collections::BTreeMap;

pub use crate::choice;
pub use dimension::Dimension;
pub(crate) use member::written;
pub use member::{Member, Written};

/// A value as written in a scene.
///
/// ```
/// use drapery_core::{REGISTRY, SettingValue};
/// let stretch = REGISTRY.iter().find(|spec| spec.name == "stretch").expect("it is in every build");
/// let stiffness = stretch.fields.iter().find(|field| field.name == "stiffness").expect("a setting of stretch");
/// assert_eq!(stiffness.check(&SettingValue::Text("2 N/cm".into())), Ok(SettingValue::Number(200.0)));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub enum SettingValue {
    /// A bare number, in the field's SI unit.
    Number(f64),
    /// A word, or a number with its unit such as `"2 mm"`.
    Text(String),
    /// Three numbers, in the field's SI unit.
    Vector([f64; 3]),
    /// Yes or no.
    Flag(bool),
    /// Three numbers at each of some times [s], in the field's SI unit.
    Keys(Vec<(f64, [f64; 3])>),
}

/// Kind of value that a field takes, and its value when the scene says nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Default {
    /// A number that the scene has to say.
    Required,
    /// Three numbers that the scene has to say.
    RequiredVector,
    /// This number, in the SI unit.
    Number(f64),
    /// This number, written with its unit.
    Quantity(&'static str),
    /// This number, in the SI unit, where another key gives it a meaning; it is not written out.
    Conditional(f64),
    /// This whole number.
    Count(u32),
    /// [`AUTO`]: chosen while the scene runs, unless the scene says a number.
    Auto,
    /// These three numbers, in the SI unit.
    Vector([f64; 3]),
    /// Yes or no.
    Flag(bool),
    /// This one of some words.
    Choice(&'static str, &'static [Word]),
    /// One of some words, if the scene says one.
    Word(&'static [Word]),
    /// No number, unless the scene says it: everything works without.
    Absent,
    /// No keys, unless the scene says them.
    Keys,
    /// No file, unless the scene names one.
    File,
}

/// Words that fields took once, and what to write instead: the field, the word, the advice.
const RETIRED: [(&str, &str, &str); 1] = [(
    "integrator",
    "implicit",
    "write `tr_bdf2`, whose long steps are implicit in all forces and of second order, or a preset",
)];

/// The word in place of a number that is chosen while the scene runs.
pub const AUTO: &str = "auto";

/// A word that a field takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Word {
    /// As it is written.
    pub name: &'static str,
    /// Meaning of the word.
    pub help: &'static str,
}

impl Default {
    /// The default as it would be written; `None` where the scene has to say the value, or there is none.
    pub fn value(self) -> Option<SettingValue> {
        match self {
            Self::Number(number) | Self::Conditional(number) => Some(SettingValue::Number(number)),
            Self::Count(count) => Some(SettingValue::Number(f64::from(count))),
            Self::Quantity(text) | Self::Choice(text, _) => Some(SettingValue::Text(text.into())),
            Self::Auto => Some(SettingValue::Text(AUTO.into())),
            Self::Vector(vector) => Some(SettingValue::Vector(vector)),
            Self::Flag(flag) => Some(SettingValue::Flag(flag)),
            Self::Required | Self::RequiredVector | Self::Absent | Self::Word(_) | Self::Keys | Self::File => None,
        }
    }

    /// Whether it is one number.
    pub fn is_number(self) -> bool {
        use self::Default::{Absent, Auto, Conditional, Count, Number, Quantity, Required};
        matches!(self, Required | Absent | Auto | Number(_) | Quantity(_) | Conditional(_) | Count(_))
    }

    /// Whether the scene has to say the value.
    pub fn is_required(self) -> bool {
        matches!(self, Self::Required | Self::RequiredVector)
    }
}

/// One setting: its row in the table of an effect or of a description.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Key in the scene file.
    pub name: &'static str,
    /// Physical dimension.
    pub dimension: Dimension,
    /// Value when the scene says nothing.
    pub default: Default,
    /// Smallest and largest number allowed, in the SI unit; from [`f64::MIN_POSITIVE`] is every number above zero.
    pub range: (f64, f64),
    /// One line for the reference page: what it does, which values are usual.
    pub help: &'static str,
}

/// Origin of a setting's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Written in the scene (or in a preset that the scene names).
    Scene,
    /// Default of the field.
    Default,
}

/// Checked settings of one table, in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    values: BTreeMap<&'static str, (SettingValue, Origin)>,
}

impl Settings {
    /// Checks what was written against the fields.
    ///
    /// # Errors
    /// One message per unknown key, missing value, wrong unit or value out of range.
    pub fn check(fields: &[Field], written: &Written) -> Result<Self, Vec<String>> {
        let mut problems: Vec<String> = written
            .keys()
            .filter(|key| !fields.iter().any(|f| f.name == key.as_str()))
            .map(|key| unknown_key(key, fields))
            .collect();
        let mut values = BTreeMap::new();
        for field in fields {
            match field.resolve(written.get(field.name)) {
                Ok(Some(value)) => drop(values.insert(field.name, value)),
                Ok(None) => {}
                Err(problem) => problems.push(problem),
            }
        }
        if problems.is_empty() { Ok(Self { values }) } else { Err(problems) }
    }

    /// Returns the settings of a table when the scene says nothing.
    ///
    /// # Panics
    /// A field has to be said.
    pub fn defaults(fields: &[Field]) -> Self {
        Self::check(fields, &BTreeMap::new()).unwrap_or_else(|texts| panic!("{}", texts.join("; ")))
    }

    /// A number that is required or has a default, in the SI unit.
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name).unwrap_or_else(|| panic!("field `{name}` is declared with a number"))
    }

    /// A number that may be absent, in the SI unit.
    pub fn optional(&self, name: &str) -> Option<f64> {
        match self.values.get(name) {
            Some((SettingValue::Number(value), _)) => Some(*value),
            _ => None,
        }
    }

    /// A vector that is required or has a default, in the SI unit.
    pub fn vector(&self, name: &str) -> [f64; 3] {
        match self.values.get(name) {
            Some((SettingValue::Vector(value), _)) => *value,
            _ => panic!("field `{name}` is declared with a vector"),
        }
    }

    /// Yes or no.
    pub fn flag(&self, name: &str) -> bool {
        match self.values.get(name) {
            Some((SettingValue::Flag(value), _)) => *value,
            _ => panic!("field `{name}` is declared with a flag"),
        }
    }

    /// Keys by time; empty if there are none.
    pub fn keys(&self, name: &str) -> &[(f64, [f64; 3])] {
        match self.values.get(name) {
            Some((SettingValue::Keys(keys), _)) => keys,
            _ => &[],
        }
    }

    /// A name of a file that may be absent, or a word.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.values.get(name) {
            Some((SettingValue::Text(text), _)) => Some(text),
            _ => None,
        }
    }

    /// All values with their origin, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &SettingValue, Origin)> {
        self.values.iter().map(|(name, (value, origin))| (*name, value, *origin))
    }
}

impl Field {
    /// The value of the field, or what is wrong with it.
    fn resolve(&self, written: Option<&SettingValue>) -> Result<Option<(SettingValue, Origin)>, String> {
        let (value, origin) = match written {
            Some(value) => (value.clone(), Origin::Scene),
            None if self.default.is_required() => return Err(format!("`{}` is missing: {}", self.name, self.help)),
            None => match self.default.value() {
                Some(value) => (value, Origin::Default),
                None => return Ok(None),
            },
        };
        self.check(&value).map(|value| Some((value, origin)))
    }

    /// A value as written in the SI unit; words and names of files as they are.
    ///
    /// # Errors
    /// Description of the fault in the value: its kind, its unit, or its number, which is out of range.
    pub fn check(&self, written: &SettingValue) -> Result<SettingValue, String> {
        match (self.default, written) {
            (Default::Flag(_), SettingValue::Flag(_)) | (Default::File, SettingValue::Text(_)) => {}
            (Default::Auto, SettingValue::Text(text)) if text == AUTO => {}
            (Default::Choice(_, words) | Default::Word(words), SettingValue::Text(text)) => {
                self.check_word(words, text)?
            }
            (Default::Keys, SettingValue::Keys(keys)) => self.check_keys(keys)?,
            (Default::Vector(_) | Default::RequiredVector, SettingValue::Vector(value)) => {
                value.iter().try_for_each(|v| self.check_number(*v))?;
            }
            (kind, SettingValue::Number(value)) if kind.is_number() => self.check_number(*value)?,
            (kind, SettingValue::Text(text)) if kind.is_number() => {
                let value = self.dimension.parse(text).map_err(|e| format!("`{}`: {e}", self.name))?;
                self.check_number(value)?;
                return Ok(SettingValue::Number(value));
            }
            _ => return Err(self.expected()),
        }
        Ok(written.clone())
    }

    /// Returns the kind of value that the field takes, as a sentence.
    pub fn expected(&self) -> String {
        let form = match self.default {
            Default::Vector(_) | Default::RequiredVector => "three numbers",
            Default::Flag(_) => "true or false",
            Default::Choice(..) | Default::Word(_) => "a word",
            Default::Count(_) => "a whole number",
            Default::Keys => "[[seconds, [x, y, z]], …]",
            Default::File => "the name of a file",
            Default::Auto => "a number, text with a unit, or \"auto\"",
            _ => "a number, or text with a unit",
        };
        format!("`{}` has to be {form}: {}", self.name, self.help)
    }

    fn check_word(&self, words: &[Word], word: &str) -> Result<(), String> {
        let names = || words.iter().map(|known| known.name);
        if names().any(|name| name == word) {
            return Ok(());
        }
        let is_retired = |(field, gone, _): &&(&str, &str, &str)| *field == self.name && *gone == word;
        let advice = match (RETIRED.iter().find(is_retired), nearest(word, names())) {
            (Some((.., instead)), _) => (*instead).to_owned(),
            (None, Some(best)) => format!("did you mean `{best}`?"),
            (None, None) => format!("use one of {}", names().collect::<Vec<_>>().join(", ")),
        };
        Err(format!("`{}` cannot be `{word}`; {advice}", self.name))
    }

    fn check_keys(&self, keys: &[(f64, [f64; 3])]) -> Result<(), String> {
        keys.iter().flat_map(|(_, value)| value).try_for_each(|value| self.check_number(*value))?;
        let ascending = keys.windows(2).all(|w| w[0].0 < w[1].0) && keys.iter().all(|(time, _)| time.is_finite());
        let wrong = || format!("the times of `{}` have to increase", self.name);
        (ascending && !keys.is_empty()).then_some(()).ok_or_else(wrong)
    }

    /// The share that a number too large for the field is as a percentage, if the field takes such a share.
    fn as_share(&self, value: f64) -> Option<f64> {
        let ((low, high), share) = (self.range, value / 100.0);
        let takes_shares = self.dimension == Dimension::None && high <= MOST_SHARE;
        (takes_shares && value > high && (low..=high).contains(&share)).then_some(share)
    }

    fn check_number(&self, value: f64) -> Result<(), String> {
        let (low, high) = self.range;
        if !(value >= low && value <= high) {
            let unit = self.dimension.si_unit();
            let with_unit = |number: f64| format!("{} {unit}", short(number)).trim_end().to_owned();
            let expected = match (low, high) {
                (_, f64::INFINITY) if low == f64::MIN_POSITIVE => "has to be above 0".to_owned(),
                (f64::NEG_INFINITY, f64::INFINITY) => "has to be a number".to_owned(),
                (_, f64::INFINITY) => format!("has to be {} or more", with_unit(low)),
                _ => format!("is outside {} to {}", short(low), with_unit(high)),
            };
            let share =
                self.as_share(value).map_or(String::new(), |share| format!("; for {} % write {share}", short(value)));
            return Err(format!("`{}` = {} {expected}: {}{share}", self.name, with_unit(value), self.help));
        }
        match self.default {
            Default::Count(_) if value.fract() != 0.0 => Err(self.expected()),
            _ => Ok(()),
        }
    }
}

/// Largest top of a range of shares, as of strains and scales; ranges that reach higher are no shares.
const MOST_SHARE: f64 = 10.0;

/// A number with as few digits as it has.
pub fn short(value: f64) -> String {
    let is_long = value != 0.0 && value.is_finite() && !(1e-3..1e6).contains(&value.abs());
    if is_long { format!("{value:e}") } else { value.to_string() }
}

fn unknown_key(key: &str, fields: &[Field]) -> String {
    let names: Vec<_> = fields.iter().map(|f| f.name).collect();
    match nearest(key, names.iter().copied()) {
        Some(best) => format!("`{key}` is not a setting here; did you mean `{best}`?"),
        None => format!("`{key}` is not a setting here; use one of {}", names.join(", ")),
    }
}

/// The candidate closest to `word` by edit distance, if one is close enough to be a slip of the hand; else the only one that begins
/// with the word, or has it inside.
pub fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let candidates: Vec<&str> = candidates.collect();
    let close = candidates
        .iter()
        .map(|candidate| (edit_distance(word, candidate), *candidate))
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len().max(word.len()) / 3)
        .min();
    let only = |fits: &dyn Fn(&str) -> bool| {
        let mut fitting = candidates.iter().filter(|candidate| fits(candidate));
        fitting.next().filter(|_| fitting.next().is_none()).copied()
    };
    close.map(|(_, candidate)| candidate).or_else(|| match word.len() {
        0..3 => None,
        _ => only(&|candidate| candidate.starts_with(word)).or_else(|| only(&|candidate| candidate.contains(word))),
    })
}

/// Levenshtein distance: the smallest number of letters to insert, delete or replace.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let cost = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = cost.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    const WORDS: &[Word] = &[Word { name: "early", help: "" }, Word { name: "late", help: "" }];

    fn field(name: &'static str, default: Default, range: (f64, f64)) -> Field {
        Field { name, dimension: Dimension::Time, default, range, help: "what it does" }
    }

    fn fields() -> [Field; 5] {
        [
            field("step", Default::Auto, (1.0, 2.0)),
            field("most", Default::Count(7), (1.0, 1e6)),
            field("when", Default::Choice("late", WORDS), (0.0, 0.0)),
            field("until", Default::Number(f64::INFINITY), (f64::MIN_POSITIVE, f64::INFINITY)),
            field("pause", Default::Quantity("2 ms"), (0.0, f64::INFINITY)),
        ]
    }

    fn wrong(key: &str, value: SettingValue) -> String {
        Settings::check(&fields(), &BTreeMap::from([(key.to_owned(), value)])).unwrap_err().join("; ")
    }

    #[test]
    fn defaults_are_in_the_si_unit_and_say_that_they_are() {
        let settings = Settings::defaults(&fields());
        assert_eq!(
            (settings.optional("step"), settings.number("most"), settings.text("when")),
            (None, 7.0, Some("late"))
        );
        assert_eq!((settings.number("until"), settings.number("pause")), (f64::INFINITY, 0.002));
        assert!(settings.iter().all(|(_, _, origin)| origin == Origin::Default));
    }

    #[test]
    fn a_misspelt_key_or_word_names_the_nearest() {
        assert!(wrong("stepp", SettingValue::Number(1.0)).contains("did you mean `step`"));
        assert!(wrong("when", SettingValue::Text("lat".into())).contains("did you mean `late`"));
        assert!(wrong("when", SettingValue::Text("never".into())).contains("use one of early, late"));
    }

    #[test]
    fn a_word_that_is_cut_short_names_the_only_one_that_has_it() {
        let of = |word| nearest(word, ["preview", "production", "steps_per_frame"].into_iter());
        assert_eq!([of("prod"), of("frame"), of("pr")], [Some("production"), Some("steps_per_frame"), None]);
        assert_eq!(nearest("pre", ["preview", "preroll"].into_iter()), None, "both begin with it");
    }

    #[test]
    fn a_percentage_in_the_place_of_a_share_is_told_the_share() {
        let share = |range| Field { dimension: Dimension::None, ..field("share", Default::Number(1.0), range) };
        let refused = |field: Field, value| field.check(&SettingValue::Number(value)).unwrap_err();
        assert!(
            refused(share((0.01, 10.0)), 90.0).ends_with("is outside 0.01 to 10: what it does; for 90 % write 0.9")
        );
        assert!(refused(share((0.0, 0.99)), 5.0).ends_with("; for 5 % write 0.05"));
        for (field, value) in [
            (share((0.01, 10.0)), 5000.0),
            (share((0.01, 10.0)), -90.0),
            (share((0.0, 1e3)), 5000.0),
            (field("time", Default::Number(1.0), (0.0, 1.0)), 90.0),
        ] {
            assert!(refused(field, value).ends_with("what it does"), "{}", refused(field, value));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused_with_what_does() {
        let number = SettingValue::Number;
        for (key, value, words) in [
            ("step", number(3.0), "`step` = 3 s is outside 1 to 2 s: what it does"),
            ("step", SettingValue::Flag(true), "`step` has to be a number, text with a unit, or \"auto\""),
            ("step", SettingValue::Text("2 mm".into()), "unit `mm` does not fit here"),
            ("most", number(1.5), "`most` has to be a whole number"),
            ("most", number(f64::NAN), "is outside 1 to 1e6 s"),
            ("when", number(1.0), "`when` has to be a word"),
            ("until", number(0.0), "`until` = 0 s has to be above 0"),
            ("pause", number(-1.0), "`pause` = -1 s has to be 0 s or more"),
        ] {
            assert!(wrong(key, value.clone()).contains(words), "{}", wrong(key, value));
        }
    }
}
