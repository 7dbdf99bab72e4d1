//! JSON schemas of places, paths and fractions, with the ranges of their numbers.

use schemars::Schema;
use serde_json::{Value as Json, json};

/// Farthest place and longest time that a scene may name [m, s]: that of the solver, so that it can refuse what comes near it.
const FARTHEST: f64 = drapery_core::scene::FARTHEST;

/// The ranges of a place in space.
pub(super) fn place() -> Json {
    json!({ "type": "number", "minimum": -FARTHEST, "maximum": FARTHEST })
}

/// The form of points of a path, [[seconds, [x, y, z]], …].
pub(super) fn path() -> Json {
    let point = json!({ "type": "array", "items": place(), "minItems": 3, "maxItems": 3 });
    json!({ "type": "array", "prefixItems": [place(), point], "minItems": 2, "maxItems": 2 })
}

/// Gives the points of a path their ranges.
pub(super) fn points_in_space(schema: &mut Schema) {
    schema.insert("items".to_owned(), path());
}

/// Gives fractions along the sides of a panel their ranges.
pub(super) fn fractions(schema: &mut Schema) {
    let fraction = json!({ "type": "number", "minimum": 0.0, "maximum": 1.0 });
    schema.insert("items".to_owned(), json!({ "type": "array", "items": fraction, "minItems": 2, "maxItems": 2 }));
}
