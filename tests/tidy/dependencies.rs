//! What each crate may depend on. A new dependency is a decision: it needs a page in `docs/dev/decisions/` and a word here.

use crate::tree::{report, root};

/// Folder of a crate, its dependencies, and what only its tests and benches use.
const ALLOWED: [(&str, &[&str], &[&str]); 14] = [
    ("core", &["bytemuck", "nalgebra", "rayon", "robust", "thiserror"], &[]),
    ("core/mpi", &["drapery-core", "mpi", "thiserror"], &["drapery-tests", "rayon"]),
    ("io/alembic", &["thiserror"], &["serde_json", "tempfile"]),
    ("io/usd", &["thiserror", "openusd"], &["serde_json", "tempfile"]),
    (
        "io",
        &[
            "drapery-core",
            "drapery-alembic",
            "drapery-usd",
            "nalgebra",
            "thiserror",
            "serde",
            "serde_json",
            "toml",
            "serde_path_to_error",
            "schemars",
            "globset",
            "hdf5",
            "sha2",
            "rustix",
        ],
        &["tempfile"],
    ),
    (
        "shot",
        &[
            "drapery-core",
            "drapery-alembic",
            "drapery-io",
            "thiserror",
            "serde",
            "serde_json",
            "toml",
            "sha2",
            "rustix",
        ],
        &["tempfile"],
    ),
    (
        "analysis",
        &[
            "drapery-core",
            "drapery-alembic",
            "drapery-io",
            "drapery-shot",
            "nalgebra",
            "thiserror",
            "serde",
            "serde_json",
            "toml",
            "sha2",
            "png",
        ],
        &["tempfile"],
    ),
    (
        "cli",
        &[
            "drapery-core",
            "drapery-io",
            "drapery-shot",
            "drapery-analysis",
            "drapery-mpi",
            "drapery-selftest",
            "clap",
            "miette",
            "thiserror",
            "tracing",
            "tracing-subscriber",
            "indicatif",
            "serde_json",
            "rayon",
            "signal-hook",
        ],
        &["clap_complete", "clap_mangen", "tempfile"],
    ),
    (
        "sample_assets",
        &["drapery-core", "drapery-alembic", "nalgebra", "clap", "thiserror", "rayon"],
        &["serde_json", "tempfile"],
    ),
    (
        "cli/selftest",
        &["drapery-core", "drapery-alembic", "drapery-io", "drapery-shot", "nalgebra", "serde_json", "tempfile"],
        &[],
    ),
    (
        "plugins/capi",
        &["drapery-core", "drapery-io", "drapery-shot", "bytemuck", "rayon"],
        // Of a licence that asks for changed files back (MPL 2.0): it makes the header, and is linked to nothing that is given away.
        &["cbindgen", "tempfile"],
    ),
    (
        "plugins/python",
        &[
            "drapery",
            "drapery-core",
            "drapery-io",
            "drapery-shot",
            "drapery-analysis",
            "bytemuck",
            "rayon",
            "serde_json",
            "toml",
            "numpy",
            "pyo3",
        ],
        &[],
    ),
    (
        "tests",
        &[
            "drapery-core",
            "drapery-io",
            "drapery-shot",
            "drapery-analysis",
            "drapery-alembic",
            "drapery-assets",
            "drapery-selftest",
            "nalgebra",
            "proptest",
            "rayon",
            "serde_json",
            "tempfile",
        ],
        &[],
    ),
    (
        "tests/fuzz",
        &["drapery-alembic", "drapery-core", "drapery-io", "drapery-shot", "drapery-analysis", "hdf5", "sha2"],
        &[],
    ),
];

/// Names under the tables `[dependencies]` and `[dev-dependencies]` of a manifest.
fn dependencies(manifest: &str, table: &str) -> Vec<String> {
    let mut inside = false;
    let mut names = Vec::new();
    for line in manifest.lines() {
        let line = line.trim();
        if line.starts_with('[') {
            inside = line == format!("[{table}]");
        } else if inside && !line.is_empty() && !line.starts_with('#') {
            let name = line.split(['.', '=', ' ']).next().unwrap_or_default();
            names.push(name.to_owned());
        }
    }
    names
}

#[test]
fn every_crate_depends_only_on_what_it_may() {
    let mut complaints = Vec::new();
    for (folder, allowed, in_tests) in ALLOWED {
        let path = root().join(folder).join("Cargo.toml");
        let manifest = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{folder}/Cargo.toml: {e}"));
        for (table, may) in [("dependencies", allowed), ("dev-dependencies", in_tests), ("build-dependencies", &[])] {
            let extra = dependencies(&manifest, table).into_iter().filter(|name| !may.contains(&name.as_str()));
            complaints.extend(extra.map(|name| format!("{folder}/Cargo.toml: [{table}] {name}")));
        }
    }
    report(&complaints);
}

#[test]
fn every_member_of_the_workspace_has_its_list() {
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).expect("the workspace has a manifest");
    let members = manifest.lines().find(|line| line.starts_with("members")).expect("it lists its members");
    let named: Vec<&str> = members.split('"').skip(1).step_by(2).collect();
    let mut listed: Vec<&str> = ALLOWED.iter().map(|(folder, ..)| *folder).collect();
    listed.sort_unstable_by_key(|folder| named.iter().position(|name| name == folder));
    assert_eq!(named, listed);
}

#[test]
fn dependencies_are_read_from_a_manifest() {
    let manifest =
        "[package]\nname = \"x\"\n[dependencies]\na.workspace = true\nb = \"1\"\n# c\n[dev-dependencies]\nd = \"1\"\n";
    assert_eq!(dependencies(manifest, "dependencies"), ["a", "b"]);
    assert_eq!(dependencies(manifest, "dev-dependencies"), ["d"]);
}
