//! The direction of imports: from crate to crate, and inside the solver from room to room. What is used stands before what uses
//! it.

use std::path::Path;

use drapery_tests::structure::{Module, Modules};

use crate::tree::{report, root};

/// The rooms of the solver, lowest first: each may import those before it alone. Read upwards, this is how the solver is built
/// (`docs/architecture.md`).
const ROOMS: [&str; 31] = [
    "tolerances",
    "clock",
    "error",
    "settings",
    "mesh",
    "geometry",
    "parallel",
    "metrics",
    "scene",
    "snapshot",
    "state",
    "wind_grid",
    "elements",
    "volumes",
    "contact::tolerances",
    "contact::bodies",
    "contact::topology",
    "contact::ccd",
    "contact::colouring",
    "contact::broad_phase",
    "contact::repulsion",
    "contact::collisions",
    "contact::intersections",
    "contact::self_contact",
    "pins",
    "effects",
    "time_step",
    "solve",
    "setup",
    "step",
    "simulation",
];

/// Crates, each with those of the project that it may import; what is not listed may import none.
const CRATES: [(&str, &[&str]); 9] = [
    ("core", &[]),
    ("core/mpi", &["drapery_core"]),
    ("io/alembic", &[]),
    ("io", &["drapery_core", "drapery_alembic"]),
    ("analysis", &["drapery_core", "drapery_alembic", "drapery_io"]),
    ("cli", &["drapery_core", "drapery_io", "drapery_analysis", "drapery_mpi", "drapery_selftest"]),
    ("cli/selftest", &["drapery_core", "drapery_alembic", "drapery_io"]),
    ("sample_assets", &["drapery_alembic"]),
    (
        "tests",
        &["drapery_core", "drapery_alembic", "drapery_io", "drapery_analysis", "drapery_assets", "drapery_selftest"],
    ),
];

/// Place of a module's room among the rooms.
fn place(module: &Module) -> Option<usize> {
    let name = module.join("::");
    ROOMS.iter().position(|room| name == *room || name.starts_with(&format!("{room}::")))
}

fn solver() -> Modules {
    Modules::read(&root().join("core/src"))
}

#[test]
fn every_module_of_the_solver_imports_only_what_is_below_it() {
    let mut complaints = Vec::new();
    for (module, targets) in solver().imports() {
        // The crate and the room of contact only list what is in them.
        if module.is_empty() || module == ["contact"] {
            continue;
        }
        let Some(from) = place(&module) else {
            complaints.push(format!("{}: this room is not among the rooms", module.join("::")));
            continue;
        };
        for target in targets.iter().filter(|target| place(target).is_none_or(|to| to > from)) {
            complaints.push(format!("{} imports {}, which is above it", module.join("::"), target.join("::")));
        }
    }
    report(&complaints);
}

/// Whether a module only holds others: its file says what they are.
fn only_holds(folder: &Path, module: &Module) -> bool {
    let file = module.iter().fold(folder.to_owned(), |path, name| path.join(name)).join("mod.rs");
    file.is_file()
        && std::fs::read_to_string(file).is_ok_and(|text| !text.contains("\nfn ") && !text.contains("\nimpl "))
}

#[test]
fn no_modules_of_the_solver_import_each_other_in_a_circle() {
    let folder = root().join("core/src");
    let circles = solver().circles(|module| only_holds(&folder, module) || ROOMS.contains(&module.join("::").as_str()));
    let named = |circle: &std::collections::BTreeSet<Module>| {
        let names: Vec<String> = circle.iter().map(|module| module.join("::")).collect();
        format!("a circle: {}", names.join(", "))
    };
    report(&circles.iter().map(named).collect::<Vec<_>>());
}

#[test]
fn every_crate_imports_only_those_below_it() {
    let mut complaints = Vec::new();
    for (folder, allowed) in CRATES {
        let manifest = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).expect("a manifest");
        let dependencies = manifest.split("[dev-dependencies]").next().unwrap_or_default();
        for line in dependencies.lines().filter(|line| line.starts_with("drapery-")) {
            let name: String = line.chars().take_while(|c| c.is_alphanumeric() || *c == '-').collect();
            if !allowed.contains(&name.replace('-', "_").as_str()) {
                complaints.push(format!("{folder} depends on {name}, which is above it"));
            }
        }
    }
    report(&complaints);
}

#[test]
fn the_map_names_every_room_of_the_solver_in_their_order() {
    let page = std::fs::read_to_string(root().join("docs/architecture.md")).expect("the map");
    let table =
        page.split("## The rooms of the solver").nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap_or_default();
    let first_cells = table.lines().filter(|line| line.starts_with("| `")).filter_map(|line| line.split('|').nth(1));
    let named: Vec<&str> = first_cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    assert_eq!(named, ROOMS);
}
