//! Materials that meshes and face sets are bound to, and the words that USD has for them.

/// The relationship of a binding.
pub(crate) const BINDING: &str = "material:binding";

/// Field that says whether a binding wins over the bindings below it, and the word with which it does.
pub(crate) const STRENGTH: &str = "bindMaterialAs";
pub(crate) const STRONGER: &str = "strongerThanDescendants";

/// Type of materials.
pub(crate) const MATERIAL: &str = "Material";

/// Attribute of a material that stands for another one: the path of the other material.
pub(crate) const SOURCE_PATH: &str = "drapery:sourcePath";

/// A material that a mesh or a face set is bound to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BoundMaterial {
    /// Its path.
    pub path: String,
    /// Path of the other material in the file that the mesh is from, where this one only stands for another one.
    pub source: Option<String>,
    /// Whether it wins over what is bound further down.
    pub is_stronger: bool,
}
