//! The ideal shape of a body: a word, and a table of its sizes.

use drapery_core::geometry::shapes::{Shape, ShapeSpec};
use drapery_core::settings::Default;

use super::deserialize::{dotted, suggestion};
use super::diagnostics::SceneFileError;
use super::fields;
use super::tree::{Node, Path, Sources};

/// Checks the shapes of all bodies.
///
/// # Errors
/// The first that is none.
pub(super) fn check(root: &Node, sources: &Sources) -> Result<(), SceneFileError> {
    fields::shapes(root).iter().try_for_each(|path| read(path.find(root), path, sources).map(drop))
}

/// Reads the shape at a path.
///
/// # Errors
/// It is not one word and its table.
pub(super) fn read(node: &Node, path: &Path, sources: &Sources) -> Result<Shape, SceneFileError> {
    let names: Vec<&str> = Shape::SPECS.iter().map(|spec| spec.name).collect();
    let find = |name: &str| Shape::SPECS.iter().find(|spec| spec.name == name);
    let Some(table) = node.as_table() else {
        // A ball for what is no shape at all.
        let spec = node.as_text().and_then(find).unwrap_or(&Shape::SPECS[1]);
        let text = format!("`{}` has to be a table of one shape and its sizes", dotted(path));
        return Err(sources.error(&node.place, text, Some(example(spec))));
    };
    let [entry] = table.0.as_slice() else {
        let text = format!("`{}`: expected exactly one of {}", dotted(path), names.join(", "));
        return Err(sources.error(&node.place, text, None));
    };
    let Some(spec) = find(&entry.key) else {
        let text = format!("`{}`: unknown word `{}`", dotted(path), entry.key);
        return Err(sources.error(&entry.key_place, text, Some(suggestion(&entry.key, &names))));
    };
    let sizes = fields::check_table(&entry.node, spec.fields, &path.clone().key(spec.name), sources, example(spec))?;
    Ok((spec.of)(&sizes))
}

/// Returns an example of a shape.
fn example(spec: &ShapeSpec) -> String {
    let size = |default: Default| if default.is_number() { "0.15" } else { "[0.15, 0.15, 0.15]" };
    let sizes: Vec<String> =
        spec.fields.iter().map(|field| format!("{} = {}", field.name, size(field.default))).collect();
    format!("write for example shape = {{ {} = {{ {} }} }}", spec.name, sizes.join(", "))
}
