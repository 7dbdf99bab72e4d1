//! Settings of effects: each effect declares its [`Field`]s; what a scene wrote is checked against them once.
//!
//! A value may be written as a bare number in the field's SI unit, or as text with a unit (`"2 mm"`). A unit of another
//! dimension is refused.

use std::collections::BTreeMap;

/// A value as written in a scene.
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

/// Physical dimension of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// A pure number.
    None,
    /// Length, SI unit m.
    Length,
    /// Force, SI unit N.
    Force,
    /// Force per length, SI unit N/m.
    Stiffness,
    /// Acceleration, SI unit m/s².
    Acceleration,
    /// Speed, SI unit m/s.
    Speed,
    /// Areal density, SI unit kg/m².
    ArealDensity,
    /// Time, SI unit s.
    Time,
    /// Rate, SI unit 1/s.
    Rate,
    /// Density of a fluid, SI unit kg/m³.
    Density,
    /// Force per area and speed, SI unit N s/m³.
    Drag,
    /// Force per area, SI unit Pa.
    Pressure,
    /// Bending rigidity: moment per width and curvature, SI unit N·m.
    BendingRigidity,
    /// Angle, SI unit rad.
    Angle,
}

impl Dimension {
    /// Units that may be written, each with the factor to SI; the SI unit comes first.
    pub fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::None => &[("", 1.0), ("%", 0.01)],
            Self::Length => &[("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("in", 0.0254)],
            Self::Force => &[("N", 1.0), ("mN", 1e-3), ("gf", 9.80665e-3)],
            Self::Stiffness => &[("N/m", 1.0), ("mN/m", 1e-3), ("N/cm", 100.0), ("N/mm", 1000.0)],
            Self::Acceleration => &[("m/s²", 1.0), ("m/s^2", 1.0), ("m/s2", 1.0), ("cm/s²", 1e-2), ("cm/s^2", 1e-2)],
            Self::Speed => &[("m/s", 1.0), ("cm/s", 1e-2), ("mm/s", 1e-3)],
            Self::ArealDensity => {
                &[("kg/m²", 1.0), ("kg/m^2", 1.0), ("kg/m2", 1.0), ("g/m²", 1e-3), ("g/m^2", 1e-3), ("gsm", 1e-3)]
            }
            Self::Time => &[("s", 1.0), ("ms", 1e-3)],
            Self::Rate => &[("1/s", 1.0)],
            Self::Density => &[("kg/m³", 1.0), ("kg/m^3", 1.0), ("kg/m3", 1.0)],
            Self::Drag => &[("N s/m³", 1.0), ("N s/m^3", 1.0), ("N s/m3", 1.0)],
            Self::Pressure => &[("Pa", 1.0), ("hPa", 100.0), ("kPa", 1000.0), ("mbar", 100.0)],
            // Kawabata's instrument gives gf·cm²/cm.
            Self::BendingRigidity => &[
                ("N·m", 1.0),
                ("N m", 1.0),
                ("Nm", 1.0),
                ("mN·m", 1e-3),
                ("µN·m", 1e-6),
                ("uNm", 1e-6),
                ("gf·cm²/cm", 9.80665e-5),
            ],
            Self::Angle => &[("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)],
        }
    }

    /// The SI unit as text; empty for pure numbers.
    pub fn si_unit(self) -> &'static str {
        self.units()[0].0
    }

    /// Reads `"2 mm"` as 0.002; `Err` says what was expected.
    ///
    /// # Errors
    /// The text is not a number followed by a unit of this dimension.
    pub fn parse(self, text: &str) -> Result<f64, String> {
        let text = text.trim();
        let split = text
            .char_indices()
            .find(|(i, c)| !(c.is_ascii_digit() || "+-._".contains(*c) || is_exponent(text, *i)))
            .map_or(text.len(), |(i, _)| i);
        let (number, unit) = (text[..split].trim(), text[split..].trim());
        let expected = || {
            let units: Vec<_> = self.units().iter().map(|u| u.0).filter(|u| !u.is_empty()).collect();
            if units.is_empty() {
                "a number".to_owned()
            } else {
                format!("a number with one of the units {}", units.join(", "))
            }
        };
        let value: f64 = number.parse().map_err(|_| format!("`{text}` is not a number; expected {}", expected()))?;
        if unit.is_empty() {
            return Ok(value);
        }
        let factor = self.units().iter().find(|(name, _)| *name == unit).map(|(_, factor)| *factor);
        factor.map(|f| value * f).ok_or_else(|| format!("unit `{unit}` does not fit here; expected {}", expected()))
    }
}

/// Whether the character at `i` is the `e` of an exponent (`1e-3`), not the start of a unit.
fn is_exponent(text: &str, i: usize) -> bool {
    let rest = &text[i..];
    let follows = rest.strip_prefix(['e', 'E']).and_then(|r| r.strip_prefix(['+', '-']).or(Some(r)));
    i > 0 && follows.is_some_and(|r| r.starts_with(|c: char| c.is_ascii_digit()))
}

/// Default of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Default {
    /// The scene has to say it.
    Required,
    /// This number, in the SI unit.
    Number(f64),
    /// These three numbers, in the SI unit.
    Vector([f64; 3]),
    /// Yes or no.
    Flag(bool),
    /// Nothing, unless the scene says it: the effect works without.
    Absent,
    /// No keys, unless the scene says them.
    Keys,
    /// No file, unless the scene names one.
    File,
}

/// One setting of an effect.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// Key in the scene file.
    pub name: &'static str,
    /// Physical dimension.
    pub dimension: Dimension,
    /// Value when the scene says nothing.
    pub default: Default,
    /// Smallest and largest number allowed, in the SI unit.
    pub range: (f64, f64),
    /// One line for the reference page: what it does, which values are usual.
    pub help: &'static str,
}

/// Where a setting's value came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Written in the scene (or in a preset that the scene names).
    Scene,
    /// Default of the effect.
    Default,
}

/// Checked settings of one effect, in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    values: BTreeMap<&'static str, (SettingValue, Origin)>,
}

impl Settings {
    /// Checks what was written against the fields.
    ///
    /// # Errors
    /// One message per unknown key, missing value, wrong unit or value out of range.
    pub fn check(fields: &[Field], written: &BTreeMap<String, SettingValue>) -> Result<Self, Vec<String>> {
        let mut problems: Vec<String> = written
            .keys()
            .filter(|key| !fields.iter().any(|f| f.name == key.as_str()))
            .map(|key| unknown_key(key, fields))
            .collect();
        let mut values = BTreeMap::new();
        for field in fields {
            match resolve(field, written.get(field.name)) {
                Ok(Some(value)) => drop(values.insert(field.name, value)),
                Ok(None) => {}
                Err(problem) => problems.push(problem),
            }
        }
        if problems.is_empty() { Ok(Self { values }) } else { Err(problems) }
    }

    /// A number that is required or has a default, in the SI unit.
    pub fn number(&self, name: &str) -> f64 {
        self.optional(name).unwrap_or_else(|| panic!("field `{name}` is declared with a number by its effect"))
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
            _ => panic!("field `{name}` is declared with a vector by its effect"),
        }
    }

    /// Yes or no.
    pub fn flag(&self, name: &str) -> bool {
        match self.values.get(name) {
            Some((SettingValue::Flag(value), _)) => *value,
            _ => panic!("field `{name}` is declared with a flag by its effect"),
        }
    }

    /// Keys by time; empty if there are none.
    pub fn keys(&self, name: &str) -> &[(f64, [f64; 3])] {
        match self.values.get(name) {
            Some((SettingValue::Keys(keys), _)) => keys,
            _ => &[],
        }
    }

    /// A name of a file that may be absent.
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

/// The value of one field, or what is wrong with it.
fn resolve(field: &Field, written: Option<&SettingValue>) -> Result<Option<(SettingValue, Origin)>, String> {
    let Some(written) = written else {
        return match field.default {
            Default::Required => Err(format!("`{}` is missing: {}", field.name, field.help)),
            Default::Number(value) => Ok(Some((SettingValue::Number(value), Origin::Default))),
            Default::Vector(value) => Ok(Some((SettingValue::Vector(value), Origin::Default))),
            Default::Flag(value) => Ok(Some((SettingValue::Flag(value), Origin::Default))),
            Default::Absent | Default::Keys | Default::File => Ok(None),
        };
    };
    if let Default::Flag(_) = field.default {
        return match written {
            SettingValue::Flag(value) => Ok(Some((SettingValue::Flag(*value), Origin::Scene))),
            _ => Err(format!("`{}` takes true or false: {}", field.name, field.help)),
        };
    }
    match (field.default, written) {
        (Default::Keys, SettingValue::Keys(keys)) => {
            check_keys(field, keys)?;
            return Ok(Some((written.clone(), Origin::Scene)));
        }
        (Default::File, SettingValue::Text(_)) => return Ok(Some((written.clone(), Origin::Scene))),
        (Default::Keys, _) => return Err(format!("`{}` takes [[seconds, [x, y, z]], …]: {}", field.name, field.help)),
        (Default::File, _) => return Err(format!("`{}` takes the name of a file: {}", field.name, field.help)),
        _ => {}
    }
    let is_vector = matches!(field.default, Default::Vector(_));
    let value = match (written, is_vector) {
        (SettingValue::Vector(value), true) => {
            value.iter().try_for_each(|v| in_range(field, *v))?;
            SettingValue::Vector(*value)
        }
        (SettingValue::Number(value), false) => {
            in_range(field, *value)?;
            SettingValue::Number(*value)
        }
        (SettingValue::Text(text), false) => {
            let value = field.dimension.parse(text).map_err(|e| format!("`{}`: {e}", field.name))?;
            in_range(field, value)?;
            SettingValue::Number(value)
        }
        (_, true) => return Err(format!("`{}` takes three numbers, for example [0, -9.81, 0]", field.name)),
        (_, false) => return Err(format!("`{}` takes one number", field.name)),
    };
    Ok(Some((value, Origin::Scene)))
}

fn check_keys(field: &Field, keys: &[(f64, [f64; 3])]) -> Result<(), String> {
    keys.iter().flat_map(|(_, value)| value).try_for_each(|value| in_range(field, *value))?;
    let ascending = keys.windows(2).all(|w| w[0].0 < w[1].0) && keys.iter().all(|(time, _)| time.is_finite());
    if ascending && !keys.is_empty() { Ok(()) } else { Err(format!("the times of `{}` have to ascend", field.name)) }
}

fn in_range(field: &Field, value: f64) -> Result<(), String> {
    let (low, high) = field.range;
    if value >= low && value <= high {
        return Ok(());
    }
    let unit = field.dimension.si_unit();
    Err(format!("`{}` = {value} {unit} is outside {low} to {high} {unit}: {}", field.name, field.help))
}

fn unknown_key(key: &str, fields: &[Field]) -> String {
    let names: Vec<_> = fields.iter().map(|f| f.name).collect();
    match nearest(key, names.iter().copied()) {
        Some(best) => format!("`{key}` is not a setting here; did you mean `{best}`?"),
        None => format!("`{key}` is not a setting here; there are {}", names.join(", ")),
    }
}

/// The candidate closest to `word` by edit distance, if one is close enough to be a slip of the hand.
pub fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .map(|candidate| (edit_distance(word, candidate), candidate))
        .filter(|(distance, candidate)| *distance <= 1 + candidate.len().max(word.len()) / 3)
        .min()
        .map(|(_, candidate)| candidate)
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

    #[test]
    fn units_are_converted_to_si_and_wrong_ones_refused() {
        assert_eq!(Dimension::Length.parse("2 mm"), Ok(0.002));
        assert_eq!(Dimension::Length.parse("1e-3m"), Ok(0.001));
        assert_eq!(Dimension::ArealDensity.parse("150 g/m²"), Ok(0.15));
        assert!(Dimension::Length.parse("2 N").unwrap_err().contains("mm"));
        assert!(Dimension::Length.parse("wide").is_err());
    }

    #[test]
    fn a_misspelt_key_names_the_nearest_word() {
        let fields = [Field {
            name: "stiffness",
            dimension: Dimension::Stiffness,
            default: Default::Number(1.0),
            range: (0.0, 2.0),
            help: "",
        }];
        let written = BTreeMap::from([("stifness".to_owned(), SettingValue::Number(1.0))]);
        assert!(Settings::check(&fields, &written).unwrap_err()[0].contains("did you mean `stiffness`"));
        let written = BTreeMap::from([("stiffness".to_owned(), SettingValue::Number(3.0))]);
        assert!(Settings::check(&fields, &written).unwrap_err()[0].contains("outside"));
    }
}
