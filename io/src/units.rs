//! Units and axes of files. Everything inside Drapery is in metres with Y up; conversion happens where a file is read
//! or written, and nowhere else.

use std::fmt;

use drapery_core::Vec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Unit of length of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum LengthUnit {
    /// Metres.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Centimetres (the default of Maya and of many rigs).
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
    /// Inches.
    #[serde(rename = "in")]
    Inch,
    /// Feet.
    #[serde(rename = "ft")]
    Foot,
}

impl LengthUnit {
    /// All units, from the shortest to the longest.
    pub const ALL: [Self; 5] = [Self::Millimetre, Self::Centimetre, Self::Inch, Self::Foot, Self::Metre];

    /// Length of one unit [m].
    pub const fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
            Self::Inch => 0.0254,
            Self::Foot => 0.3048,
        }
    }

    /// Its word in the scene file.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Inch => "in",
            Self::Foot => "ft",
        }
    }

    /// Its name in a sentence.
    pub const fn plural(self) -> &'static str {
        match self {
            Self::Metre => "metres",
            Self::Centimetre => "centimetres",
            Self::Millimetre => "millimetres",
            Self::Inch => "inches",
            Self::Foot => "feet",
        }
    }
}

/// Axis of a file that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum UpAxis {
    /// Y is up (Maya, Houdini, most caches).
    #[default]
    Y,
    /// Z is up (Blender, 3ds Max).
    Z,
}

/// Unit of length and up axis of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Units {
    /// Unit of length.
    pub length: LengthUnit,
    /// Axis that points up.
    pub up: UpAxis,
}

impl Units {
    /// Metres, Y up: what is used inside.
    pub const SI: Self = Self { length: LengthUnit::Metre, up: UpAxis::Y };

    /// A position or a displacement of the file as one in metres, Y up. Also turns a velocity per second.
    pub fn to_si(self, vector: Vec3) -> Vec3 {
        turned_up(vector, self.up) * self.length.metres()
    }

    /// A position, displacement or velocity in metres, Y up, as one of the file: the inverse of [`Units::to_si`].
    pub fn from_si(self, vector: Vec3) -> Vec3 {
        InputUnits::from(self).from_si(vector)
    }

    /// The numbers that a cache stores for a position or velocity in metres, Y up.
    pub fn stored(self, vector: Vec3) -> [f32; 3] {
        let v = self.from_si(vector);
        [v.x as f32, v.y as f32, v.z as f32]
    }

    /// The numbers that a cache stores for a position in metres, Y up, which counts positions from `origin`.
    pub fn stored_from(self, origin: Vec3, position: Vec3) -> [f32; 3] {
        self.stored(position - origin)
    }

    /// [`Units::stored`] for many.
    pub fn stored_all(self, vectors: &[Vec3]) -> Vec<[f32; 3]> {
        vectors.iter().map(|v| self.stored(*v)).collect()
    }
}

drapery_core::codec! { enum LengthUnit { 0 => Metre, 1 => Centimetre, 2 => Millimetre, 3 => Inch, 4 => Foot } }
drapery_core::codec! { enum UpAxis { 0 => Y, 1 => Z } }
drapery_core::codec! { struct Units { length, up } }

/// Unit of length and up axis of an input file, whose unit may be any length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputUnits {
    /// Length of one unit [m].
    pub metres: f64,
    /// Axis that points up.
    pub up: UpAxis,
}

impl From<Units> for InputUnits {
    fn from(units: Units) -> Self {
        Self { metres: units.length.metres(), up: units.up }
    }
}

impl InputUnits {
    /// A position or a displacement of the file as one in metres, Y up.
    pub fn to_si(self, vector: Vec3) -> Vec3 {
        turned_up(vector, self.up) * self.metres
    }

    /// A position, displacement or velocity in metres, Y up, as one of the file: the inverse of [`InputUnits::to_si`].
    pub fn from_si(self, vector: Vec3) -> Vec3 {
        // Dividing, not multiplying by the rounded inverse: 0.12 m has to come back as 12 cm.
        let scaled = vector / self.metres;
        match self.up {
            UpAxis::Y => scaled,
            UpAxis::Z => Vec3::new(scaled.x, -scaled.z, scaled.y),
        }
    }

    /// Its unit of length, if it is one that scenes know.
    pub fn named(self) -> Option<LengthUnit> {
        LengthUnit::ALL.into_iter().find(|unit| same_length(unit.metres(), self.metres))
    }

    /// Its unit of length in a sentence.
    fn plural(self) -> String {
        self.named().map_or_else(|| format!("units of {} m", self.metres), |unit| unit.plural().to_owned())
    }
}

impl fmt::Display for InputUnits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {:?} up", self.plural(), self.up)
    }
}

/// Units that a file states for itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StatedUnits {
    /// Length of one unit [m], if it says so.
    pub metres: Option<f64>,
    /// Axis that points up, if it says so.
    pub up: Option<UpAxis>,
}

/// Whether two lengths are one, up to the rounding of programs that count in single precision.
fn same_length(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * b
}

/// Units of a file of a format that states them, [`UNSTATED`] where it does not, and a warning if somebody else has said otherwise.
///
/// `own` is what the scene says about this very file: it knows better than the file. `general` is what it says about all files:
/// a file that speaks for itself knows better.
pub fn decide(stated: StatedUnits, own: Option<Units>, general: Option<Units>) -> (InputUnits, Option<String>) {
    let of_file = |rest: InputUnits| {
        let metres = stated.metres.unwrap_or(rest.metres);
        // 0.01 in single precision is meant as 0.01.
        let metres =
            LengthUnit::ALL.into_iter().map(LengthUnit::metres).find(|m| same_length(*m, metres)).unwrap_or(metres);
        InputUnits { metres, up: stated.up.unwrap_or(rest.up) }
    };
    let differs = |said: Units| {
        let said = InputUnits::from(said);
        of_file(said) != said
    };
    match (own, general) {
        (Some(own), _) if differs(own) => {
            let file = of_file(own.into());
            (
                own.into(),
                Some(format!("the file states {file}, but is read in {own}, which its `units` in the scene set")),
            )
        }
        (Some(own), _) => (own.into(), None),
        (None, Some(general)) => {
            let file = of_file(general.into());
            let warning = differs(general).then(|| {
                format!(
                    "the file states {file}, which overrides [units] ({general}); if the file is wrong, set its `units`"
                )
            });
            (file, warning)
        }
        (None, None) => {
            let file = of_file(UNSTATED);
            let missing = match (stated.metres, stated.up) {
                (None, None) => "neither its unit of length nor its up axis",
                (None, Some(_)) => "no unit of length",
                (Some(_), None) => "no up axis",
                (Some(_), Some(_)) => return (file, None),
            };
            (
                file,
                Some(format!(
                    "the file states {missing}; it is read in {file}, USD's default; set `units` if that is wrong"
                )),
            )
        }
    }
}

/// Why a body is meant in the unit of length of `[units]`, in the place of the one that its file states and it was read in; `None` if
/// nothing contradicts the file.
///
/// Programs state metres for scenes that are modelled in centimetres: Blender does, whatever the unit scale of the scene is. A body
/// that would stand taller than a house in the unit of its file, and no taller than one in that of the scene, is meant in the latter.
/// `height` is that in the file's unit [m].
pub fn why_meant_in(general: Units, height: f64, read_in: InputUnits) -> Option<String> {
    let meant = height / read_in.metres * general.length.metres();
    let is_giant = height.is_finite() && height > *PLAUSIBLE_BODY.end();
    (is_giant && PLAUSIBLE_BODY.contains(&meant)).then(|| {
        format!(
            "the file states {}, which makes it {height:.3} m high; it is read in {}, the unit of [units]. If it \
             really has that size, set its `units`",
            read_in.plural(),
            general.length.plural()
        )
    })
}

/// Units where a file of a format that states units does not state them: USD's default.
pub const UNSTATED: InputUnits = InputUnits { metres: 0.01, up: UpAxis::Y };

/// A vector of a file with Y up.
pub(crate) fn turned_up(vector: Vec3, up: UpAxis) -> Vec3 {
    match up {
        UpAxis::Y => vector,
        UpAxis::Z => Vec3::new(vector.x, vector.z, -vector.y),
    }
}

impl fmt::Display for Units {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {:?} up", self.length.plural(), self.up)
    }
}

/// Largest factor between the sizes of two meshes that belong together, before one looks as if it were in another
/// unit.
const OTHER_UNIT: f64 = 5.0;

/// Largest distance from a unit of the factor between two sizes, as a factor.
const NEAR_UNIT: f64 = 1.5;

/// Smallest factor by which two units that are taken for each other differ: metres and centimetres do by 100, of
/// millimetres and centimetres a doll tells as little as of feet and centimetres.
const MISTAKEN: f64 = 50.0;

/// Whether two sizes with this factor between them are about the same.
fn is_about(factor: f64) -> bool {
    (1.0 / OTHER_UNIT..=OTHER_UNIT).contains(&factor)
}

/// The unit in which a mesh that is `size` metres across, read in `units`, has about the size of `other`; `None` where it has that in
/// its own unit, or in none that scenes know.
pub fn likely_unit(size: f64, units: InputUnits, other: f64) -> Option<LengthUnit> {
    let factor = size / other;
    if !factor.is_finite() || is_about(factor) {
        return None;
    }
    let miss = |unit: &LengthUnit| libm::log(factor * unit.metres() / units.metres).abs();
    let likely = LengthUnit::ALL.into_iter().min_by(|a, b| miss(a).total_cmp(&miss(b)))?;
    (miss(&likely) < libm::log(NEAR_UNIT)).then_some(likely)
}

/// Heights that a body from a file may have without anyone asking [m]: from a doll to a four-storey creature.
const PLAUSIBLE_BODY: std::ops::RangeInclusive<f64> = 0.2..=20.0;

/// Height of a person [m], to which a wrong unit is compared.
const PERSON: f64 = 1.7;

/// A size that no character has.
#[derive(Debug, Clone, PartialEq)]
pub struct UnlikelySize {
    /// The size in words.
    pub what: String,
    /// The unit that it looks like: the one that brings it nearest to a person's height. `None` if it is the one that it was read
    /// in, or none helps.
    pub likely: Option<LengthUnit>,
    /// Largest extent [m].
    pub extent: f64,
}

impl UnlikelySize {
    /// The unit that the mesh, read in `units`, must be meant in: with it a character, or a mesh about as large as one of `other`
    /// metres that belongs to it, has the right size, and it is far from the one that it was read in. `None` if the size may be meant.
    pub fn mistaken_for(&self, units: InputUnits, other: f64) -> Option<LengthUnit> {
        let is_far = |unit: &LengthUnit| {
            let factor = unit.metres() / units.metres;
            factor.max(1.0 / factor) >= MISTAKEN
        };
        self.likely.into_iter().chain(likely_unit(self.extent, units, other)).find(is_far)
    }

    /// The size in words, with a unit that it looks like.
    pub fn looks_like(&self, unit: Option<LengthUnit>) -> String {
        unit.map_or_else(|| self.what.clone(), |unit| format!("{}: looks like {}", self.what, unit.plural()))
    }

    /// Whether the mesh is small and about as large as one of `other` metres that belongs to it: a doll and its dress.
    pub fn fits(&self, other: f64) -> bool {
        self.extent < *PLAUSIBLE_BODY.start() && is_about(self.extent / other)
    }
}

/// Says what is suspicious about the size of a mesh that was read from a file.
///
/// `bounds` are the smallest and largest coordinates in metres after conversion from `units`. `None` when the largest
/// extent is between 0.2 m and 20 m.
pub fn unlikely_size(bounds: [Vec3; 2], units: InputUnits) -> Option<UnlikelySize> {
    let extent = (bounds[1] - bounds[0]).max();
    if PLAUSIBLE_BODY.contains(&extent) || !extent.is_finite() || extent <= 0.0 {
        return None;
    }
    let height = bounds[1].y - bounds[0].y;
    let stored = extent / units.metres;
    let miss = |unit: &LengthUnit| libm::log(stored * unit.metres() / PERSON).abs();
    let likely = LengthUnit::ALL.into_iter().min_by(|a, b| miss(a).total_cmp(&miss(b))).unwrap_or_default();
    let size = if height > 0.0 && (height - extent).abs() < 1e-9 * extent { "high" } else { "across" };
    let read_as = units.plural();
    let likely = Some(likely)
        .filter(|likely| PLAUSIBLE_BODY.contains(&(stored * likely.metres())) && Some(*likely) != units.named());
    let extent_in_words = if (1e-3..1e6).contains(&extent) { format!("{extent:.3}") } else { format!("{extent:.3e}") };
    let what = format!("it is {extent_in_words} m {size} when read as {read_as}");
    Some(UnlikelySize { what, likely, extent })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(height: f64) -> [Vec3; 2] {
        [Vec3::zeros(), Vec3::new(0.3 * height, height, 0.2 * height)]
    }

    #[test]
    fn z_up_centimetres_turn_into_metres_and_back_exactly() {
        let units = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };
        assert_eq!(units.to_si(Vec3::new(100.0, 200.0, 300.0)), Vec3::new(1.0, 3.0, -2.0));
        assert_eq!(units.from_si(Vec3::new(0.12, 0.955, 0.03)), Vec3::new(12.0, -3.0, 95.5));
        // A right-handed frame stays right-handed.
        let [x, y, z] = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| units.to_si(axis).normalize());
        assert!((x.cross(&y) - z).norm() < 1e-15);
    }

    #[test]
    fn a_body_of_172_units_is_recognised_as_centimetres() {
        let giant = unlikely_size(body(172.0), Units::SI.into()).expect("172 m is not a person");
        let words = "it is 172.000 m high when read as metres: looks like centimetres";
        assert_eq!((giant.looks_like(giant.likely).as_str(), giant.likely), (words, Some(LengthUnit::Centimetre)));
        let centimetres = Units { length: LengthUnit::Centimetre, up: UpAxis::Y };
        let small = unlikely_size(body(0.0172), centimetres.into()).expect("17 mm is not a person");
        assert_eq!(small.likely, Some(LengthUnit::Metre), "{}", small.what);
        assert_eq!(unlikely_size(body(1.72), Units::SI.into()), None);
        assert_eq!(unlikely_size(body(19.0), Units::SI.into()), None);
        assert!(unlikely_size(body(1.0e7), Units::SI.into()).is_some_and(|size| size.likely.is_none()));
    }

    #[test]
    fn a_small_body_that_fits_its_garments_is_meant_and_one_that_is_a_hundred_times_off_is_not() {
        let centimetres = InputUnits { metres: 0.01, up: UpAxis::Y };
        let millimetres = InputUnits { metres: 0.001, up: UpAxis::Y };
        let judged = |height: f64, units, other: f64| {
            let size = unlikely_size(body(height), units).expect("no character has this size");
            (size.mistaken_for(units, other), size.fits(other))
        };
        // A doll of 14 cm and its dress, whatever its file counts in.
        for units in [InputUnits::from(Units::SI), centimetres, millimetres] {
            assert_eq!(judged(0.14, units, 0.1), (None, true), "{units}");
        }
        // A hand under a table cloth.
        assert_eq!(judged(0.14, Units::SI.into(), 2.0), (None, false));
        // A person in metres that is read in centimetres, alone or with the garments.
        assert_eq!(judged(0.0172, centimetres, 1.2).0, Some(LengthUnit::Metre));
        assert_eq!(judged(0.0172, centimetres, 0.012).0, Some(LengthUnit::Metre));
        // The other mistake, and a giant, which is no doll.
        assert_eq!(judged(172.0, Units::SI.into(), 150.0), (Some(LengthUnit::Centimetre), false));
        assert_eq!(judged(25.0, Units::SI.into(), 30.0), (None, false));
        // Nothing that looks like a person, but like the garments: a tower in metres that is read in centimetres, and its flag.
        assert_eq!(judged(0.19, centimetres, 18.0).0, Some(LengthUnit::Metre));
    }

    #[test]
    fn a_mesh_that_is_a_hundred_times_as_large_as_another_is_in_centimetres() {
        let metres = InputUnits::from(Units::SI);
        assert_eq!(likely_unit(149.0, metres, 1.6), Some(LengthUnit::Centimetre));
        let centimetres = Units { length: LengthUnit::Centimetre, up: UpAxis::Y };
        assert_eq!(likely_unit(0.016, centimetres.into(), 1.5), Some(LengthUnit::Metre));
        assert_eq!(likely_unit(1.9, metres, 1.6), None);
        // Ten times as large is no unit's fault.
        assert_eq!(likely_unit(16.0, metres, 1.6), None);
        assert_eq!(likely_unit(1.0, metres, 0.0), None);
    }

    #[test]
    fn a_giant_by_the_unit_of_its_file_is_meant_in_that_of_the_scene_and_nothing_else_is() {
        let metres = InputUnits { metres: 1.0, up: UpAxis::Z };
        let general = |length| Units { length, up: UpAxis::Y };
        assert_eq!(
            why_meant_in(general(LengthUnit::Centimetre), 172.0, metres).as_deref(),
            Some(
                "the file states metres, which makes it 172.000 m high; it is read in centimetres, the unit of \
                 [units]. If it really has that size, set its `units`"
            )
        );
        // A dwarf in millimetres, a person, a floor.
        assert_eq!(why_meant_in(general(LengthUnit::Millimetre), 172.0, metres), None);
        assert_eq!(why_meant_in(general(LengthUnit::Centimetre), 1.72, metres), None);
        assert_eq!(why_meant_in(general(LengthUnit::Centimetre), 0.0, metres), None);
        // A button is small in any unit, and may be.
        let centimetres = InputUnits { metres: 0.01, up: UpAxis::Y };
        assert_eq!(why_meant_in(general(LengthUnit::Metre), 0.017, centimetres), None);
    }

    #[test]
    fn a_file_that_states_its_units_is_believed_unless_the_scene_speaks_of_that_very_file() {
        let centimetres = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };
        let stated = StatedUnits { metres: Some(0.009_999_999_776), up: Some(UpAxis::Z) };
        assert_eq!(decide(stated, None, None), (centimetres.into(), None));
        assert_eq!(decide(stated, None, Some(centimetres)), (centimetres.into(), None));
        let (units, warning) = decide(stated, None, Some(Units::SI));
        assert_eq!(units, centimetres.into());
        assert!(warning.unwrap().contains("the file states centimetres, Z up, which overrides [units]"));
        let (units, warning) = decide(stated, Some(Units::SI), Some(centimetres));
        assert_eq!(units, Units::SI.into());
        assert!(warning.unwrap().contains("but is read in metres, Y up"));
        // What it leaves open is said by the scene, or else by USD.
        let half = StatedUnits { metres: Some(10.0), up: None };
        assert_eq!(decide(half, None, Some(centimetres)).0, InputUnits { metres: 10.0, up: UpAxis::Z });
        let (units, warning) = decide(StatedUnits::default(), None, None);
        assert_eq!(units, UNSTATED);
        assert!(warning.unwrap().contains("neither"));
    }
}
