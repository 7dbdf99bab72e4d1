//! Values that may be written in more than one way.

use std::fmt;

use drapery_core::settings::Dimension;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use super::place_schemas::{path, place};

/// A number in the SI unit, or text with a unit such as "2 mm".
#[derive(Debug, Clone, PartialEq)]
pub(in crate::scene_file) enum Quantity {
    Number(f64),
    Text(String),
}

impl Quantity {
    /// The value in the SI unit.
    pub(in crate::scene_file) fn si(&self, dimension: Dimension) -> Result<f64, String> {
        match self {
            Self::Number(number) => Ok(*number),
            Self::Text(text) => dimension.parse(text),
        }
    }
}

impl Serialize for Quantity {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Number(number) => serializer.serialize_f64(*number),
            Self::Text(text) => serializer.serialize_str(text),
        }
    }
}

impl<'de> Deserialize<'de> for Quantity {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl de::Visitor<'_> for Visitor {
            type Value = Quantity;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, or text with a unit such as \"2 mm\"")
            }

            fn visit_f64<E: de::Error>(self, number: f64) -> Result<Quantity, E> {
                Ok(Quantity::Number(number))
            }

            fn visit_i64<E: de::Error>(self, number: i64) -> Result<Quantity, E> {
                Ok(Quantity::Number(number as f64))
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Quantity, E> {
                Ok(Quantity::Text(text.to_owned()))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl JsonSchema for Quantity {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Quantity".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": ["number", "string"] })
    }
}

/// A path of objects in a file, or a path in space.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::scene_file) enum BodyPath {
    Objects(String),
    Motion(Vec<(f64, [f64; 3])>),
}

impl Serialize for BodyPath {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Objects(pattern) => serializer.serialize_str(pattern),
            Self::Motion(points) => points.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for BodyPath {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = BodyPath;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a pattern of object paths such as \"/hero/*\", or points [[seconds, [x, y, z]], …]")
            }

            fn visit_str<E: de::Error>(self, pattern: &str) -> Result<BodyPath, E> {
                Ok(BodyPath::Objects(pattern.to_owned()))
            }

            fn visit_seq<A: de::SeqAccess<'de>>(self, points: A) -> Result<BodyPath, A::Error> {
                Vec::deserialize(de::value::SeqAccessDeserializer::new(points)).map(BodyPath::Motion)
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl JsonSchema for BodyPath {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "BodyPath".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": ["string", "array"], "items": path() })
    }
}

/// A place, or the one that is found by where the garments start.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::scene_file) enum Origin {
    Auto,
    At([f64; 3]),
}

impl Serialize for Origin {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str("auto"),
            Self::At(place) => place.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Origin {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = Origin;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"auto\", or a place [x, y, z] in metres")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Origin, E> {
                match text {
                    "auto" => Ok(Origin::Auto),
                    _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
                }
            }

            fn visit_seq<A: de::SeqAccess<'de>>(self, place: A) -> Result<Origin, A::Error> {
                <[f64; 3]>::deserialize(de::value::SeqAccessDeserializer::new(place)).map(Origin::At)
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl JsonSchema for Origin {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Origin".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": ["string", "array"], "items": place() })
    }
}

/// A rotation about an axis through the shape's own origin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::scene_file) struct Rotation {
    /// Axis; its length does not matter.
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub(in crate::scene_file) axis: [f64; 3],
    /// Angle in degrees, counter-clockwise seen from the tip of the axis.
    #[schemars(range(min = -1e6, max = 1e6))]
    pub(in crate::scene_file) degrees: f64,
}
