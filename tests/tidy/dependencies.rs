//! Dependencies: each is named once, in the manifest of the workspace, where a new one is seen; the solver has six. A new one is a
//! decision, with a page in `docs/dev/decisions/`. Licences are judged by `packaging/licences.toml`.

use drapery_tests::structure::members;

use crate::tree::{report, root};

/// Dependencies of the solver.
const OF_THE_SOLVER: [&str; 6] = ["bytemuck", "libm", "nalgebra", "rayon", "robust", "thiserror"];

/// The manifest of a crate.
pub(crate) fn manifest(folder: &str) -> String {
    let path = root().join(folder).join("Cargo.toml");
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Lines of a manifest in tables whose names end like `table`, without comments.
fn lines<'a>(manifest: &'a str, table: &'a str) -> impl Iterator<Item = &'a str> {
    let tables =
        manifest.split("\n[").filter(move |text| text.lines().next().is_some_and(|head| head.ends_with(table)));
    tables.flat_map(|text| text.lines().skip(1).filter(|line| !line.is_empty() && !line.starts_with('#')))
}

/// The name at the start of a line of a table.
fn name(line: &str) -> &str {
    line.split(['.', '=', ' ']).next().unwrap_or_default()
}

#[test]
fn every_dependency_is_one_of_the_workspace_and_the_solver_has_six() {
    let mut complaints = Vec::new();
    for folder in members(&root()) {
        let manifest = manifest(&folder);
        let elsewhere = lines(&manifest, "dependencies]").filter(|line| !line.contains("workspace = true"));
        complaints.extend(elsewhere.map(|line| format!("{folder}/Cargo.toml: {line}: not that of the workspace")));
    }
    report(&complaints);
    let manifest = manifest("core");
    assert_eq!(lines(&manifest, "dependencies]").map(name).collect::<Vec<_>>(), OF_THE_SOLVER);
}

#[test]
fn dependencies_are_read_from_a_manifest() {
    let manifest = "[package]\nname = \"x\"\n\n[dependencies]\na.workspace = true\nb = \"1\"\n# c\n[dev-dependencies]\nd = \"1\"\n";
    assert_eq!(lines(manifest, "dependencies]").map(name).collect::<Vec<_>>(), ["a", "b", "d"]);
}
