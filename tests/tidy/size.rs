//! Lengths of files; those of functions are lints of clippy (`clippy.toml`).

use crate::tree::{report, rust_files};

const FILE_LINES: usize = 600;

#[test]
fn no_file_is_longer_than_600_lines() {
    let long = rust_files().into_iter().map(|file| (file.text.lines().count(), file.name));
    let long = long.filter(|(lines, _)| *lines > FILE_LINES);
    report(&long.map(|(lines, name)| format!("{name}: {lines} lines")).collect::<Vec<_>>());
}
