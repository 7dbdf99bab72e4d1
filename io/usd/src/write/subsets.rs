//! Face sets as subsets of the mesh.

use std::collections::BTreeSet;

use openusd::sdf::{ListOp, Value};
use openusd::tf::Token;

use super::binary::{BinaryLayer, Declared, Prim, WriteError, token};
use super::names::{Distinct, MeshPath};
use crate::material::{BINDING, BoundMaterial, MATERIAL, SOURCE_PATH, STRENGTH, STRONGER};

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
    /// The material that is bound to it, if one is.
    pub material: Option<BoundMaterial>,
}

/// Adds face sets below a mesh. Those without faces are left out: USD takes them for a mistake.
pub(super) fn add(
    layer: &mut BinaryLayer,
    (mesh, path): (&Prim, &MeshPath),
    subsets: &[FaceSubset],
) -> Result<(), WriteError> {
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
            bind(layer, (&prim, path), material)?;
        }
    }
    Ok(())
}

/// Binds a material, and makes sure that there is one: without a `Material` at its target a binding is an error of the stage.
pub(super) fn bind(
    layer: &mut BinaryLayer,
    (prim, path): (&Prim, &MeshPath),
    material: &BoundMaterial,
) -> Result<(), WriteError> {
    let schema = ListOp::prepended([Token::from("MaterialBindingAPI")]);
    layer.field(prim, "apiSchemas", Value::TokenListOp(schema));
    let target = place_material(layer, path, material)?;
    layer.relationship(prim, BINDING, &target)?;
    match material.is_stronger {
        true => layer.property_field(prim, BINDING, (STRENGTH, token(STRONGER))),
        false => Ok(()),
    }
}

/// Adds a material without a shader, which says what it stands for, if it is not there; returns its path.
fn place_material(layer: &mut BinaryLayer, path: &MeshPath, material: &BoundMaterial) -> Result<String, WriteError> {
    let source = material.source.as_deref().unwrap_or(&material.path);
    let names = path.material(&material.path);
    let mut number = 1;
    loop {
        let mut names = names.clone();
        if let Some(name) = names.last_mut().filter(|_| number > 1) {
            *name = format!("{name}_{number}");
        }
        let place = format!("/{}", names.join("/"));
        let is_free = !path.goes_through(&names) && layer.kind_at(&place).is_none_or(|kind| kind == MATERIAL);
        if is_free && layer.text_at(&place, SOURCE_PATH).is_none_or(|other| other == source) {
            let mut prim = layer.root();
            for (level, name) in names.iter().enumerate() {
                let kind = if level + 1 == names.len() { MATERIAL } else { "Scope" };
                prim = layer.prim(&prim, name, Some(kind))?;
            }
            if layer.text_at(&place, SOURCE_PATH).is_none() {
                let declared = Declared { custom: true, uniform: true, ..Declared::default() };
                let value = Some(Value::String(source.to_owned()));
                layer.attribute(&prim, (SOURCE_PATH, "string"), declared, value)?;
            }
            return Ok(place);
        }
        number += 1;
    }
}

/// Whether no face is in two of the sets.
fn are_apart<'a>(subsets: impl Iterator<Item = &'a FaceSubset>) -> bool {
    let mut seen = BTreeSet::new();
    subsets.flat_map(|subset| &subset.faces).all(|face| seen.insert(*face))
}
