//! Every crate begins with an example, and where no doc test can run it, says what does.

use std::path::Path;

use crate::tree::{report, root};

/// Crates that are linked by another language, each with the test that replaces doc tests, as its page names it.
const NOT_IN_RUST: [(&str, &str); 2] =
    [("plugins/capi", "tests/c_programs.rs"), ("plugins/python", "plugins/python/tests/test_analysis.py")];

/// Folders of the crates of the workspace.
fn members() -> Vec<String> {
    let text = std::fs::read_to_string(root().join("Cargo.toml")).expect("the workspace has a manifest");
    let list = text.split("\nmembers = [").nth(1).and_then(|rest| rest.split(']').next()).expect("a list of members");
    list.split(',').map(|member| member.trim().trim_matches('"').to_owned()).collect()
}

/// The comment that a crate begins with.
fn opening(folder: &Path) -> String {
    let library = ["src/lib.rs", "lib.rs"].map(|name| folder.join(name)).into_iter().find(|path| path.is_file());
    let text = std::fs::read_to_string(library.expect("every crate is a library")).expect("it can be read");
    text.lines().take_while(|line| line.starts_with("//!")).collect::<Vec<_>>().join("\n")
}

#[test]
fn every_crate_begins_with_an_example_that_a_test_runs() {
    let mut complaints = Vec::new();
    for member in members() {
        let text = opening(&root().join(&member));
        match NOT_IN_RUST.iter().find(|(name, _)| *name == member) {
            None if !text.lines().any(|line| line == "//! ```") => {
                complaints.push(format!("{member}: its documentation begins without an example that is run"));
            }
            Some((_, test)) if !text.contains("//! ```") || !text.contains(test) => {
                complaints
                    .push(format!("{member}: its documentation lacks an example, or the test that runs it ({test})"));
            }
            _ => {}
        }
    }
    report(&complaints);
}
