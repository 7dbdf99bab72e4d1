//! The files of the project: everything below its root except what builds, tools and demos leave behind.

use std::path::{Path, PathBuf};

/// Folders that `.gitignore` names, and git's own.
const SKIPPED: [&str; 7] = [".git", "target", "out", "demo", ".venv", "__pycache__", ".pytest_cache"];

/// Endings of files that hold text written by people.
const TEXT: [&str; 12] = ["rs", "toml", "md", "py", "txt", "ini", "json", "csv", "yml", "sh", "sbatch", "alf"];

/// A file of the project.
pub(crate) struct SourceFile {
    /// Path from the root, with `/` between folders.
    pub(crate) name: String,
    /// Its text.
    pub(crate) text: String,
}

/// Root of the project.
pub(crate) fn root() -> PathBuf {
    // The manifest's folder has a parent: it is a member of the workspace.
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests live in a folder of the project").to_owned()
}

/// All text files, in the order of their names.
pub(crate) fn text_files() -> Vec<SourceFile> {
    let root = root();
    let mut paths = Vec::new();
    collect(&root, &mut paths);
    paths.sort();
    let read = |path: PathBuf| {
        let name = path.strip_prefix(&root).expect("it was found below the root").to_string_lossy().replace('\\', "/");
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
        SourceFile { name, text }
    };
    paths.into_iter().map(read).collect()
}

/// All Rust files.
pub(crate) fn rust_files() -> Vec<SourceFile> {
    text_files().into_iter().filter(|file| file.name.ends_with(".rs")).collect()
}

fn collect(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries.flatten() {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if path.is_dir() {
            if !SKIPPED.contains(&name.as_str()) {
                collect(&path, found);
            }
        } else if is_text(&path, &name) {
            found.push(path);
        }
    }
}

fn is_text(path: &Path, name: &str) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().into_owned());
    ["Makefile", ".gitignore", "run"].contains(&name) || ending.is_some_and(|e| TEXT.contains(&e.as_str()))
}

/// Fails with all complaints at once.
pub(crate) fn report(complaints: &[String]) {
    assert!(complaints.is_empty(), "{} complaints\n{}", complaints.len(), complaints.join("\n"));
}

#[test]
fn the_tree_is_found() {
    let names: Vec<String> = text_files().into_iter().map(|file| file.name).collect();
    for expected in ["Cargo.toml", "core/src/step/mod.rs", "README.md", ".ci/run", "tests/tidy/tree.rs"] {
        assert!(names.iter().any(|name| name == expected), "{expected} is not among the files");
    }
    assert!(!names.iter().any(|name| name.starts_with("target/")));
}
