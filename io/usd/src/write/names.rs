//! Names: what of a scene's or another format's names USD accepts.

use std::collections::BTreeSet;

/// A name as an identifier of USD: ASCII letters, digits and `_`, no digit first; any other character becomes `_`.
///
/// USD allows letters of other alphabets since 2024; programs with an older library refuse the whole layer for one.
pub fn identifier(name: &str) -> String {
    let mut valid: String = name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if valid.chars().next().is_none_or(|c| c.is_ascii_digit()) {
        valid.insert(0, '_');
    }
    valid
}

/// Identifiers that differ from each other: the second of a kind gets a number.
#[derive(Debug, Default)]
pub struct Distinct {
    taken: BTreeSet<String>,
}

impl Distinct {
    /// The identifier of a name.
    pub fn identifier(&mut self, name: &str) -> String {
        let plain = identifier(name);
        let mut unique = plain.clone();
        let mut number = 1;
        while !self.taken.insert(unique.clone()) {
            number += 1;
            unique = format!("{plain}_{number}");
        }
        unique
    }
}

/// Location of a mesh in its layer: the prims from the root down to it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshPath {
    /// Identifiers, the mesh last; one at least.
    prims: Vec<String>,
    /// Number of them that stand for the root of the file that the mesh is from, and the name of that root.
    root: (usize, String),
}

impl MeshPath {
    /// The path of an object of another format, `/hero/geo/skirtShape`, with every name made an identifier; `/mesh` where
    /// there is no name.
    pub fn of(object_path: &str) -> Self {
        let mut prims: Vec<String> = object_path.split('/').filter(|name| !name.is_empty()).map(identifier).collect();
        if prims.is_empty() {
            prims.push("mesh".to_owned());
        }
        let root = (1, prims[0].clone());
        Self { prims, root }
    }

    /// The same mesh below the prims of a shot and of a part of it, which takes the place of the root.
    pub fn in_shot(&self, shot: &str, part: &str) -> Self {
        let above = [shot, part].map(str::to_owned).into_iter();
        let prims = above.chain(self.prims[1..].iter().cloned()).collect();
        Self { prims, root: (2, self.root.1.clone()) }
    }

    /// Returns the place of a material of this path: below the prims that stand for the root of the mesh, so that
    /// both stay together wherever the layer is referenced.
    pub(super) fn material(&self, path: &str) -> Vec<String> {
        let mut names: Vec<String> = path.split('/').filter(|name| !name.is_empty()).map(identifier).collect();
        let (levels, root) = &self.root;
        if names.len() > 1 && names[0] == *root {
            names.remove(0);
        }
        if names.is_empty() {
            names.push("material".to_owned());
        }
        self.prims[..*levels].iter().cloned().chain(names).collect()
    }

    /// Whether these prims are the mesh or stand above it.
    pub(super) fn goes_through(&self, names: &[String]) -> bool {
        self.prims.starts_with(names)
    }

    /// The prims from the root down to the mesh.
    pub(super) fn prims(&self) -> &[String] {
        &self.prims
    }

    /// Name of the root prim.
    pub fn root(&self) -> &str {
        &self.prims[0]
    }

    /// Path of a prim: the first `levels` names.
    pub(super) fn upto(&self, levels: usize) -> String {
        format!("/{}", self.prims[..levels].join("/"))
    }

    /// Path of the mesh.
    pub fn mesh(&self) -> String {
        self.upto(self.prims.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_identifiers() {
        let cases = [
            ("skirt", "skirt"),
            ("hero:skirt-2", "hero_skirt_2"),
            ("2nd", "_2nd"),
            ("Röckchen", "R_ckchen"),
            ("", "_"),
            ("a b", "a_b"),
        ];
        for (name, expected) in cases {
            assert_eq!(identifier(name), expected, "{name}");
        }
    }

    #[test]
    fn names_that_become_the_same_stay_different() {
        let mut distinct = Distinct::default();
        assert_eq!(["a b", "a_b", "a-b"].map(|name| distinct.identifier(name)), ["a_b", "a_b_2", "a_b_3"]);
    }

    #[test]
    fn object_paths_keep_their_levels() {
        let path = MeshPath::of("/hero/geo/skirt:Shape");
        assert_eq!(
            (path.root(), path.mesh().as_str(), path.upto(2).as_str()),
            ("hero", "/hero/geo/skirt_Shape", "/hero/geo")
        );
        assert_eq!(MeshPath::of("").mesh(), "/mesh");
    }

    #[test]
    fn materials_are_below_what_stands_for_the_root_of_the_mesh() {
        let mesh = MeshPath::of("/char/geo/cape");
        let there = |path: &str| {
            [mesh.material(path), mesh.in_shot("shot", "cape").material(path)].map(|names| names.join("/"))
        };
        assert_eq!(there("/char/mtl/red"), ["char/mtl/red", "shot/cape/mtl/red"]);
        assert_eq!(there("/looks/red:1"), ["char/looks/red_1", "shot/cape/looks/red_1"]);
        assert_eq!(there("/char"), ["char/char", "shot/cape/char"]);
        assert_eq!(there("/"), ["char/material", "shot/cape/material"]);
        assert!(mesh.goes_through(&mesh.material("/char/geo")) && !mesh.goes_through(&mesh.material("/geo/red")));
    }
}
