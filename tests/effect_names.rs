//! Where code names an effect as a text although it is not that effect's own: what is known of an effect ought to stand in its
//! room.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use drapery_core::effects::LISTED;

use crate::source_text::{code_only, without_tests};

/// Folders of the code that a shot runs through.
const FOLDERS: [&str; 5] = ["core/src", "io/src", "shot/src", "analysis/src", "cli/src"];

/// The rooms of effects.
const ROOMS: &str = "core/src/effects";

/// The files of a checkout that name effects outside the effects' own rooms, below its root, each with how often.
pub fn named_outside_their_rooms(root: &Path) -> Vec<(PathBuf, usize)> {
    let is_listed = |stem: &str| LISTED.contains(&stem);
    let files = FOLDERS.iter().flat_map(|folder| rust_files(&root.join(folder)));
    let below = |path: PathBuf| path.strip_prefix(root).map(Path::to_owned).ok();
    let outside = files.filter_map(below).filter(|path| {
        let first = path.strip_prefix(ROOMS).ok().and_then(|path| path.iter().next());
        !first.is_some_and(|name| is_listed(name.to_string_lossy().trim_end_matches(".rs")))
    });
    // An effect of this program alone: an older checkout may not have it.
    let effects: BTreeSet<&str> = LISTED.iter().copied().filter(|name| has_room(root, name)).collect();
    let count = |path: PathBuf| {
        let text = std::fs::read_to_string(root.join(&path)).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let names = names(&text, &effects);
        (path, names)
    };
    outside.map(count).filter(|(_, names)| *names > 0).collect()
}

fn has_room(root: &Path, effect: &str) -> bool {
    let room = root.join(ROOMS).join(effect);
    room.is_dir() || room.with_extension("rs").is_file()
}

/// Number of texts in code, without that of tests, which are the name of an effect.
fn names(text: &str, effects: &BTreeSet<&str>) -> usize {
    let text = without_tests(text);
    let code = code_only(text);
    let blanked: Vec<bool> = code.chars().map(|c| c == ' ').collect();
    let chars: Vec<char> = text.chars().collect();
    let is_text = |effect: &str, at: usize| {
        let quoted: Vec<char> = format!("\"{effect}\"").chars().collect();
        // A comment is blanked with the blanks before it; a text begins right behind code.
        chars[at..].starts_with(&quoted) && blanked[at] && !is_in_comment(&chars, at)
    };
    (0..chars.len()).filter(|at| chars[*at] == '"' && effects.iter().any(|effect| is_text(effect, *at))).count()
}

/// Whether the line has a comment before a place.
fn is_in_comment(chars: &[char], at: usize) -> bool {
    let start = chars[..at].iter().rposition(|c| *c == '\n').map_or(0, |n| n + 1);
    chars[start..at].windows(2).any(|pair| pair == ['/', '/'])
}

/// Rust files below a folder, without those that exist in tests alone.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut tests) = (Vec::new(), BTreeSet::new());
    let entries: Vec<PathBuf> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    for path in &entries {
        if path.is_dir() {
            found.extend(rust_files(path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(path).unwrap_or_default();
            tests.extend(test_modules(&text).map(|name| folder.join(name).with_extension("rs")));
            found.push(path.clone());
        }
    }
    found.retain(|path| !tests.contains(path) && !path.ends_with("tests.rs"));
    found.sort();
    found
}

/// Names of the modules in files of their own that a file declares for tests.
fn test_modules(text: &str) -> impl Iterator<Item = &str> {
    text.split("#[cfg(test)]\n").skip(1).filter_map(|rest| {
        let line = rest.lines().next()?.trim_start().trim_start_matches("pub(crate) ");
        line.strip_prefix("mod ")?.strip_suffix(';')
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_counted_in_code_but_not_in_comments_texts_and_tests() {
        let effects = BTreeSet::from(["wind", "pins"]);
        let count = |text: &str| names(text, &effects);
        assert_eq!(count("let a = (\"wind\", \"pins\", \"winds\");\nf(x == \"pins\");"), 3);
        assert_eq!(count("// \"wind\"\n/// see \"pins\"\nlet a = 1; // \"wind\""), 0);
        assert_eq!(count("let a = \"the wind\";\n#[cfg(test)]\nmod tests {\n    let b = \"wind\";\n}\n"), 0);
        assert_eq!(
            test_modules("#[cfg(test)]\nmod a;\n#[cfg(test)]\nuse b;\n#[cfg(test)]\npub(crate) mod c;").count(),
            2
        );
    }
}
