//! Materials that meshes and face sets are bound to, and the words that USD has for them.

/// The relationship of a binding.
pub(crate) const BINDING: &str = "material:binding";

/// What says whether a binding wins over those below it, and the word that it does.
pub(crate) const STRENGTH: &str = "bindMaterialAs";
pub(crate) const STRONGER: &str = "strongerThanDescendants";

/// Type of materials.
pub(crate) const MATERIAL: &str = "Material";

/// Of a material that stands for another one: the path of that.
pub(crate) const SOURCE_PATH: &str = "drapery:sourcePath";

/// A material that a mesh or a face set is bound to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BoundMaterial {
    /// Its path.
    pub path: String,
    /// Where it only stands for another one: the path of that in the file that the mesh is from.
    pub source: Option<String>,
    /// Whether it wins over what is bound further down.
    pub is_stronger: bool,
}
