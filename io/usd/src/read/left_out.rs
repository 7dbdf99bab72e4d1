//! Names of the data of a mesh that are not read: a program that writes the mesh anew has to report them.

use openusd::sdf::Value;
use openusd::usd::Prim;

use super::error::UsdError;
use super::primvars::{is_primvar, metadata, numbers_of};
use super::reading::Reading;
use super::values::word;
use crate::material::BINDING;

/// Attributes of meshes that are not handed through.
const ATTRIBUTES: [&str; 10] = [
    "accelerations",
    "cornerIndices",
    "cornerSharpnesses",
    "creaseIndices",
    "creaseLengths",
    "creaseSharpnesses",
    "faceVaryingLinearInterpolation",
    "holeIndices",
    "interpolateBoundary",
    "triangleSubdivisionRule",
];

/// Names of what is not read.
pub(crate) fn of(reading: &Reading, prim: &Prim) -> Result<Vec<String>, UsdError> {
    let mut names = Vec::new();
    for name in ATTRIBUTES {
        if reading.ok(prim.attribute(name).has_authored_value(), prim)? {
            names.push(name.to_owned());
        }
    }
    let normals = prim.attribute("normals");
    if reading.ok(normals.has_authored_value(), prim)? {
        let interpolation = metadata(reading, &normals, "interpolation")?.as_ref().and_then(word);
        // One for each point belongs to the frame; others belong to faces or their corners.
        if let Some(word @ ("faceVarying" | "uniform" | "constant")) = interpolation.as_deref() {
            names.push(format!("normals ({word})"));
        }
    }
    for attribute in reading.ok(prim.authored_attributes_in_namespace("primvars"), prim)? {
        let name = attribute.name().to_owned();
        if is_primvar(&name)
            && let Some(value) = reading.value(&attribute)?
            && value.array_len() != Some(0)
            && numbers_of(&value).is_none()
        {
            let kind = reading.ok(attribute.get_metadata::<Value>("typeName"), prim)?.as_ref().and_then(word);
            names.push(format!("{name} ({})", kind.unwrap_or_else(|| "of an unknown type".to_owned())));
        }
    }
    for purpose in ["preview", "full"] {
        let name = format!("{BINDING}:{purpose}");
        if !reading.targets(prim, &name)?.is_empty() {
            names.push(name);
        }
    }
    Ok(names)
}

/// Names of the primvars that move.
pub(crate) fn moving_primvars(reading: &Reading, prim: &Prim) -> Result<Vec<String>, UsdError> {
    let mut names = Vec::new();
    for attribute in reading.ok(prim.authored_attributes_in_namespace("primvars"), prim)? {
        if is_primvar(attribute.name()) && reading.ok(attribute.time_sample_times(), prim)?.len() > 1 {
            names.push(attribute.name().to_owned());
        }
    }
    Ok(names)
}
