//! Prims that inherit from each other in a circle, found before `openusd` composes them.
//!
//! To compose a prim, the library goes from its `inherits` and `specializes` to those of their targets, and goes on for ever
//! where it comes back: its stack overflows, and the process with it. USD knows no such stage, so nothing that is right is refused.

use std::collections::{BTreeMap, BTreeSet};

use openusd::ar::{AssetBuffer, SharedBuffer};
use openusd::sdf::{Layer, Path, Value};

/// Fields of a prim that lead to other prims of the stage.
pub(super) const ARCS: [&str; 2] = ["inheritPaths", "specializes"];

/// Longest way from prim to prim; no stage that people work with comes near.
const DEEPEST: usize = 256;

/// Prims that prims inherit from and specialize, in all layers that were opened: paths by path.
///
/// Layers that are referred to may have other places in the stage. Where two use the same paths, their circles are found too.
#[derive(Debug, Default)]
pub(crate) struct Classes(BTreeMap<String, BTreeSet<String>>);

impl Classes {
    /// Takes what a layer says, and returns what is wrong with all of it, if anything is.
    pub(super) fn take(&mut self, layer: &SharedBuffer) -> Option<String> {
        // What cannot be read says so itself, and better.
        let layer = Layer::from_bytes("classes", AssetBuffer::Shared(layer.clone())).ok()?;
        let data = layer.data();
        for path in data.spec_paths() {
            for field in ARCS {
                let Ok(Some(value)) = data.try_field(&path, field) else { continue };
                let Value::PathListOp(targets) = value.into_owned() else { continue };
                let targets =
                    targets.flatten().iter().map(|target| plain(&path.make_absolute(target))).collect::<Vec<_>>();
                self.0.entry(plain(&path)).or_default().extend(targets);
            }
        }
        self.circle()
    }

    /// The first circle, or the first way that is too long, in words.
    fn circle(&self) -> Option<String> {
        let mut heights = BTreeMap::new();
        self.0.keys().find_map(|path| self.height(path.clone(), &mut Vec::new(), &mut heights).err())
    }

    /// Length of the longest way on from a prim; what is wrong with it, if anything is.
    fn height(
        &self,
        path: String,
        way: &mut Vec<String>,
        heights: &mut BTreeMap<String, usize>,
    ) -> Result<usize, String> {
        if let Some(start) = way.iter().position(|earlier| *earlier == path) {
            let circle = [&way[start..], &[path]].concat().join(" → ");
            return Err(format!("its prims inherit from each other in a circle, {circle}"));
        }
        let known = heights.get(&path).copied();
        if way.len() + known.unwrap_or(0) >= DEEPEST {
            return Err(format!("its prims inherit from each other more than {DEEPEST} deep, at {path}"));
        }
        if let Some(height) = known {
            return Ok(height);
        }
        way.push(path.clone());
        let mut height = 0;
        for next in self.next(&path) {
            height = height.max(1 + self.height(next, way, heights)?);
        }
        way.pop();
        heights.insert(path, height);
        Ok(height)
    }

    /// Finds the paths to which the library goes from a prim: to its targets, and with the prims above it to their
    /// targets.
    fn next(&self, path: &str) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        let mut above = path;
        while !above.is_empty() {
            for target in self.0.get(above).into_iter().flatten() {
                found.insert(target.clone());
                found.insert(format!("{target}{}", &path[above.len()..]));
            }
            above = &above[..above.rfind('/').unwrap_or(0)];
        }
        found
    }
}

/// A path without the variants that are chosen on its way: a prim in a variant stands where it stands without one.
fn plain(path: &Path) -> String {
    path.strip_all_variant_selections().as_str().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem_in(layers: &[&str]) -> Option<String> {
        let mut classes = Classes::default();
        let takes = |layer: &&str| classes.take(&SharedBuffer::new(format!("#usda 1.0\n{layer}").into_bytes()));
        layers.iter().filter_map(takes).last()
    }

    #[test]
    fn circles_are_found_through_layers_variants_and_prims_above_and_nothing_else_is() {
        for right in [
            "class \"c\" (inherits = </b>) {}\nclass \"b\" {}\ndef \"m\" (inherits = </c>) {}",
            "class \"c\" { def \"x\" {} }\ndef \"m\" (inherits = </c>) { over \"x\" { def \"y\" (inherits = </c>) {} } }",
            "def \"a\" { class \"c\" {} def \"b\" (inherits = [</a/c>, <../c>]) {} }",
            "def \"a\" (specializes = </b>) { def \"x\" (inherits = </b/x>) {} }\nclass \"b\" { def \"x\" {} }",
        ] {
            assert_eq!(problem_in(&[right]), None, "{right}");
        }
        for (wrong, way) in [
            ("class \"c\" (inherits = </c>) {}", "/c → /c"),
            ("class \"c\" (inherits = </d>) {}\nclass \"d\" (specializes = </c>) {}", "/c → /d → /c"),
            (
                "def \"a\" (variants = {string v = \"x\"} prepend variantSets = \"v\") \
                 { variantSet \"v\" = { \"x\" (inherits = </a>) {} } }",
                "/a → /a",
            ),
            ("def \"a\" (inherits = </k>) {}\nclass \"k\" { def \"x\" (inherits = </a/x>) {} }", "/k/x → /a/x → /k/x"),
        ] {
            let said = problem_in(&[wrong]).unwrap_or_default();
            assert!(said.contains("in a circle") && said.contains(way), "{wrong}: {said}");
        }
        let halves = ["class \"c\" (inherits = </d>) {}", "over \"d\" (inherits = </c>) {}"];
        assert!(problem_in(&halves).unwrap_or_default().contains("/c → /d → /c"));
        let chain: String = (0..300).map(|i| format!("class \"c{i}\" (inherits = </c{}>) {{}}\n", i + 1)).collect();
        assert!(problem_in(&[&chain]).unwrap_or_default().contains("more than 256 deep"));
    }
}
