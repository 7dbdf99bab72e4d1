//! Names of a scene that become names of files.

use std::collections::BTreeMap;
use std::path::PathBuf;

use drapery_core::scene::names;

use super::raw::Garment;

/// Longest name of a file or folder [bytes].
const LONGEST_FILE_NAME: usize = 255;

/// Whether a name can be that of one folder, inside another; blanks may stand in it, as in names of scene files.
pub(super) fn usable_for_folder(name: &str) -> Result<(), String> {
    match name {
        "" => Err("it is empty".to_owned()),
        "." | ".." => Err("it leads to another folder".to_owned()),
        _ if name.contains(['/', '\\']) => Err("it leads to another folder".to_owned()),
        _ if name.contains(char::is_control) => Err("it contains a control character".to_owned()),
        _ if name.len() > LONGEST_FILE_NAME => {
            Err(format!("it has {} bytes, and file systems allow {LONGEST_FILE_NAME}", name.len()))
        }
        _ if name.trim() != name => Err("it begins or ends with a space".to_owned()),
        _ => names::why_unusable(&name.replace(' ', "_")).map_or(Ok(()), Err),
    }
}

/// Warnings of files that `resolved.toml`, which is UTF-8, cannot name.
pub(super) fn not_utf8(files: &[PathBuf]) -> Vec<String> {
    let whole = |file: &PathBuf| std::path::absolute(file).unwrap_or_else(|_| file.clone());
    let unnamed = files.iter().map(whole).filter(|file| file.to_str().is_none());
    let warning = |file: PathBuf| {
        format!(
            "{file:?}: this path is not UTF-8, so resolved.toml cannot name the file and cannot be run again: rename \
             it or its folder"
        )
    };
    unnamed.map(warning).collect()
}

/// Warnings of garments whose caches would be one file where names that differ in capital letters alone are the same.
pub(super) fn one_on_some_disks(garments: &[Garment]) -> Vec<String> {
    let mut by_name: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    garments.iter().for_each(|garment| by_name.entry(folded(&garment.name)).or_default().push(&garment.name));
    let warning = |names: &Vec<&str>| {
        let quoted: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
        format!(
            "garments {}: their names differ only in upper and lower case, so on disks of Windows and macOS their \
             caches would overwrite each other: rename one of them",
            quoted.join(" and ")
        )
    };
    by_name.values().filter(|names| names.iter().any(|name| *name != names[0])).map(warning).collect()
}

/// A name without the difference of capital and small letters, as Unicode folds them: by way of the small letters, so that İ and ẞ
/// are those of their like, then of the capitals, so that letters with two small forms (ς, σ) or with capitals of two letters (ß)
/// count as one.
fn folded(name: &str) -> String {
    name.to_lowercase().to_uppercase().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_differ_in_case_alone_are_one_in_every_script() {
        for names in [
            ["sheet", "Sheet"],
            ["STRASSE", "straße"],
            ["STRAẞE", "strasse"],
            ["ΟΔΟΣ", "οδος"],
            ["σας", "ΣΑΣ"],
            ["ﬁn", "FIN"],
        ] {
            let [a, b] = names.map(folded);
            assert_eq!(a, b, "{names:?}");
        }
        for names in [["sheet", "sheets"], ["ä", "a"], ["o", "ö"]] {
            let [a, b] = names.map(folded);
            assert_ne!(a, b, "{names:?}");
        }
    }

    #[test]
    fn a_folder_has_a_name_that_every_system_can_have() {
        for name in ["shot", "my shot", "010_020.v3"] {
            assert_eq!(usable_for_folder(name), Ok(()), "{name}");
        }
        for name in ["CON", "a:b", " ", "\u{202e}", "nul.old", "a ", " a", "a.", ".hidden"] {
            assert!(usable_for_folder(name).is_err(), "{name:?}");
        }
    }
}
