//! Places on this machine of the files that a scene names: path maps, and folders of materials.

use std::path::{Path as FilePath, PathBuf};

use super::raw::FILE;
use super::resolved::{MAP, MAPS, names_file};
use super::tree::{Node, Origin, Value};

/// Places where files are found; the default finds them where the scene says.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SearchPaths {
    /// Maps of paths that begin elsewhere on this machine.
    pub maps: PathMaps,
    /// Folders of material files, searched in this order.
    pub materials: Vec<PathBuf>,
}

/// Starts of paths, and what stands in their place on this machine: `X:/` is found at `/mnt/x/`.
///
/// A start fits whole folders only; of several that fit, the longest is taken. Backslashes count as slashes. Relative
/// paths are never mapped: they belong to the scene file's own folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PathMaps(Vec<(String, String)>);

impl PathMaps {
    /// Maps from pairs of a start and its replacement.
    ///
    /// # Errors
    /// A start is not one of absolute paths, or a replacement is relative; the text says which.
    pub fn new(pairs: impl IntoIterator<Item = (String, String)>) -> Result<Self, String> {
        let mut maps = Vec::new();
        for (from, to) in pairs {
            let start = slashes(&from);
            if !start.starts_with('/') && !start.contains(':') {
                return Err(format!("`{from}` is not the start of an absolute path, such as \"X:/\" or \"/mnt/x/\""));
            }
            if !FilePath::new(&to).is_absolute() {
                return Err(format!("`{to}` has to be an absolute path, such as \"/mnt/x/\""));
            }
            maps.push((start.trim_end_matches('/').to_owned(), to.trim_end_matches('/').to_owned()));
        }
        // The longest start first; equally long ones that fit the same path are equal.
        maps.sort_by_key(|(from, _)| std::cmp::Reverse(from.len()));
        Ok(Self(maps))
    }

    /// Starts and replacements, the longest start first, without slashes at their ends.
    pub fn pairs(&self) -> &[(String, String)] {
        &self.0
    }

    /// The path on this machine, if a map fits.
    fn apply(&self, path: &str) -> Option<String> {
        let path = slashes(path);
        self.0.iter().find_map(|(from, to)| {
            let rest = path.strip_prefix(from.as_str())?;
            (rest.is_empty() || rest.starts_with('/')).then(|| format!("{to}{rest}"))
        })
    }

    /// Replaces the paths of all input files in the tables of a scene.
    pub(super) fn apply_to_files(&self, node: &mut Node) {
        if !self.0.is_empty() {
            self.apply_in("", node);
        }
    }

    /// Replaces the path of a painted map, or of each one over time, that is a file.
    fn apply_to_map(&self, node: &mut Node) {
        match &mut node.value {
            Value::Array(items) => items.iter_mut().for_each(|item| self.apply_to_map(item)),
            Value::Text(text) => {
                if let Some(mapped) = text.strip_prefix(FILE).and_then(|file| self.apply(file)) {
                    *text = format!("{FILE}{mapped}");
                    node.origin = Origin::PathMap(Box::new(node.origin.clone()));
                }
            }
            _ => {}
        }
    }

    /// The same in the table `name`, or in those of a list of tables.
    fn apply_in(&self, name: &str, node: &mut Node) {
        match &mut node.value {
            Value::Array(items) => items.iter_mut().for_each(|item| self.apply_in(name, item)),
            Value::Table(table) => {
                for entry in &mut table.0 {
                    match &mut entry.node.value {
                        Value::Text(text) if names_file(name, &entry.key) => {
                            if let Some(mapped) = self.apply(text) {
                                *text = mapped;
                                entry.node.origin = Origin::PathMap(Box::new(entry.node.origin.clone()));
                            }
                        }
                        _ if names_map(name, &entry.key) => self.apply_to_map(&mut entry.node),
                        _ => self.apply_in(&entry.key, &mut entry.node),
                    }
                }
            }
            _ => {}
        }
    }
}

/// Whether a value under this key is a painted map, which may be a file.
fn names_map(table: &str, key: &str) -> bool {
    key == MAP || MAPS.strip_prefix('.') == Some(table)
}

fn slashes(path: &str) -> String {
    path.replace('\\', "/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maps(pairs: &[(&str, &str)]) -> Result<PathMaps, String> {
        PathMaps::new(pairs.iter().map(|(from, to)| ((*from).to_owned(), (*to).to_owned())))
    }

    #[test]
    fn a_map_replaces_whole_folders_at_the_start_and_the_longest_that_fits_is_taken() {
        let maps = maps(&[("X:/", "/mnt/x/"), ("X:/show/", "/fast/show"), ("/a", "/b/")]).expect("they are maps");
        for (path, expected) in [
            ("X:/lib/hero.abc@101", Some("/mnt/x/lib/hero.abc@101")),
            ("X:\\lib\\hero.abc", Some("/mnt/x/lib/hero.abc")),
            ("X:/show/hero.abc", Some("/fast/show/hero.abc")),
            ("X:/shows/hero.abc", Some("/mnt/x/shows/hero.abc")),
            ("/a/hero.abc", Some("/b/hero.abc")),
            ("/ab/hero.abc", None),
            ("Y:/hero.abc", None),
            ("a/hero.abc", None),
            ("../X:/hero.abc", None),
        ] {
            assert_eq!(maps.apply(path).as_deref(), expected, "{path}");
        }
    }

    #[test]
    fn maps_of_relative_paths_are_refused() {
        assert!(maps(&[("assets/", "/mnt/assets/")]).expect_err("a relative start").contains("`assets/`"));
        assert!(maps(&[("X:/", "mnt/x/")]).expect_err("a relative replacement").contains("`mnt/x/`"));
    }
}
