//! Places where code names an effect as a text outside the effect's own room. Knowledge of an effect belongs in its room.

use std::path::{Path, PathBuf};

use drapery_core::effects::LISTED;

use crate::source_text::without_tests;

/// Folders of the code that a shot runs through.
const FOLDERS: [&str; 5] = ["core/src", "io/src", "shot/src", "analysis/src", "cli/src"];

/// The rooms of effects.
const ROOMS: &str = "core/src/effects";

/// Files that exist in tests alone.
const OF_TESTS: [&str; 4] = ["tests", "testing", "effects_tests", "planted_errors"];

/// The files of a checkout that name effects outside the effects' own rooms, below its root, each with how often.
pub fn named_outside_their_rooms(root: &Path) -> Vec<(PathBuf, usize)> {
    let mut found = Vec::new();
    FOLDERS.iter().for_each(|folder| collect(root, Path::new(folder), &mut found));
    found.sort();
    found
}

fn collect(root: &Path, folder: &Path, found: &mut Vec<(PathBuf, usize)>) {
    for entry in std::fs::read_dir(root.join(folder)).into_iter().flatten().flatten() {
        let path = folder.join(entry.file_name());
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let is_own = folder == Path::new(ROOMS) && LISTED.iter().any(|name| *name == stem);
        if is_own || OF_TESTS.contains(&&*stem) {
            continue;
        }
        if entry.path().is_dir() {
            collect(root, &path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(entry.path()).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            found.extend(Some(names(&text)).filter(|times| *times > 0).map(|times| (path, times)));
        }
    }
}

/// Number of texts in code, without comments and tests, which are the name of an effect.
fn names(text: &str) -> usize {
    let code = without_tests(text).lines().filter_map(|line| line.split("//").next());
    let texts = code.flat_map(|line| line.split('"').skip(1).step_by(2));
    texts.filter(|text| LISTED.iter().any(|name| name == text)).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_counted_in_code_but_not_in_comments_texts_and_tests() {
        assert_eq!(names("let a = (\"wind\", \"pressure\", \"winds\");\nf(x == \"pressure\");"), 3);
        assert_eq!(names("// \"wind\"\n/// see \"pressure\"\nlet a = 1; // \"wind\""), 0);
        assert_eq!(names("let a = \"the wind\";\n#[cfg(test)]\nmod tests {\n    let b = \"wind\";\n}\n"), 0);
    }
}
