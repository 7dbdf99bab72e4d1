//! Face sets as subsets of the mesh.

use std::collections::BTreeSet;

use openusd::sdf::{ListOp, Value};
use openusd::tf::Token;

use super::binary::{BinaryLayer, Declared, Prim, WriteError, token};
use super::names::Distinct;

/// Family of subsets that materials are bound to: no face in two of them.
const MATERIALS: &str = "materialBind";

/// Family of other subsets.
const FACE_SETS: &str = "faceSets";

/// A named set of faces.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FaceSubset {
    /// Its name; what USD does not accept in names is replaced.
    pub name: String,
    /// Faces, ascending.
    pub faces: Vec<i32>,
    /// Path of the material that is bound to it, if one is.
    pub material: Option<String>,
}

/// Adds face sets below a mesh. Those without faces are left out: USD takes them for a mistake.
pub(super) fn add(layer: &mut BinaryLayer, mesh: &Prim, subsets: &[FaceSubset]) -> Result<(), WriteError> {
    let bound = subsets.iter().any(|subset| subset.material.is_some());
    let apart = are_apart(subsets.iter());
    let family = |subset: &FaceSubset| match subset.material {
        Some(_) => MATERIALS,
        // As other formats' face sets are used: each is what a material can be bound to.
        None if apart && !bound => MATERIALS,
        None => FACE_SETS,
    };
    for (name, is_of) in [MATERIALS, FACE_SETS].map(|name| (name, move |subset: &&FaceSubset| family(subset) == name)) {
        let of_family: Vec<&FaceSubset> = subsets.iter().filter(is_of).filter(|s| !s.faces.is_empty()).collect();
        if !of_family.is_empty() {
            let kind = if are_apart(of_family.into_iter()) { "nonOverlapping" } else { "unrestricted" };
            let attribute = format!("subsetFamily:{name}:familyType");
            let uniform = Declared { uniform: true, ..Declared::default() };
            layer.attribute(mesh, (&attribute, "token"), uniform, Some(token(kind)))?;
        }
    }
    let mut names = Distinct::default();
    for subset in subsets.iter().filter(|subset| !subset.faces.is_empty()) {
        let prim = layer.prim(mesh, &names.identifier(&subset.name), Some("GeomSubset"))?;
        let uniform = Declared { uniform: true, ..Declared::default() };
        layer.attribute(&prim, ("elementType", "token"), uniform, Some(token("face")))?;
        layer.attribute(&prim, ("familyName", "token"), uniform, Some(token(family(subset))))?;
        layer.attribute(&prim, ("indices", "int[]"), Declared::default(), Some(Value::IntVec(subset.faces.clone())))?;
        if let Some(material) = &subset.material {
            bind(layer, &prim, material)?;
        }
    }
    Ok(())
}

/// Binds a material by its path.
pub(super) fn bind(layer: &mut BinaryLayer, prim: &Prim, material: &str) -> Result<(), WriteError> {
    let schema = ListOp::prepended([Token::from("MaterialBindingAPI")]);
    layer.field(prim, "apiSchemas", Value::TokenListOp(schema));
    layer.relationship(prim, "material:binding", material)
}

/// Whether no face is in two of the sets.
fn are_apart<'a>(subsets: impl Iterator<Item = &'a FaceSubset>) -> bool {
    let mut seen = BTreeSet::new();
    subsets.flat_map(|subset| &subset.faces).all(|face| seen.insert(*face))
}
