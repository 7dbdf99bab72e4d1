//! Lengths of files, functions and lines.

use crate::tree::{report, rust_files};
use drapery_tests::source_text::{code_only, functions};

const FILE_LINES: usize = 600;
const FUNCTION_LINES: usize = 80;

#[test]
fn no_file_is_longer_than_600_lines_and_no_function_longer_than_80() {
    let mut complaints = Vec::new();
    for file in rust_files() {
        let lines = file.text.lines().count();
        if lines > FILE_LINES {
            complaints.push(format!("{}: {lines} lines", file.name));
        }
        let long = functions(&code_only(&file.text)).into_iter().filter(|f| f.lines > FUNCTION_LINES);
        complaints.extend(long.map(|f| format!("{}:{}: fn {} has {} lines", file.name, f.line, f.name, f.lines)));
    }
    report(&complaints);
}
