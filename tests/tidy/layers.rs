//! The direction of imports: from crate to crate, and inside a crate from room to room. What is used stands before what uses it.

use std::collections::BTreeSet;
use std::path::PathBuf;

use drapery_tests::effect_names::named_outside_their_rooms;
use drapery_tests::structure::{Module, Modules, members};

use crate::dependencies::manifest;
use crate::tree::{SourceFile, report, root, rust_files};

/// The rooms of the solver, lowest first: each may import those before it alone. Read upwards, this is how the solver is built
/// (`docs/dev/architecture.md`).
const ROOMS: [&str; 34] = [
    "tolerances",
    "long_steps",
    "clock",
    "error",
    "settings",
    "mesh",
    "geometry",
    "parallel",
    "block_matrix",
    "metrics",
    "scene",
    "observe",
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

/// The rooms of files: reading and writing.
const IO_ROOMS: [&str; 32] = [
    "platform",
    "error",
    "input_file",
    "hdf5_file",
    "atomic_file",
    "written_file",
    "units",
    "memory",
    "duration",
    "sha256",
    "normals",
    "mesh_data",
    "memory_mesh",
    "mesh_cut",
    "garment_mesh",
    "attributes",
    "cache",
    "cache_frames",
    "file_summary",
    "formats",
    "dump_file",
    "mesh_source",
    "belt",
    "convert",
    "checkpoint",
    "materials",
    "wind_file",
    "input_motion",
    "rules",
    "shot_description",
    "scene_file",
    "site_file",
];

/// The rooms of running a shot.
const SHOT_ROOMS: [&str; 26] = [
    "quality",
    "frame_digest",
    "run_record",
    "recorded_frames",
    "checkpoints",
    "farm",
    "error",
    "fault",
    "remote_simulation",
    "render_mesh",
    "point_attributes",
    "single_layer",
    "check",
    "loose_points",
    "inputs",
    "written_faces",
    "rules",
    "long_frames",
    "towards_frame",
    "shot",
    "scene_source",
    "pinned",
    "overstretched",
    "run",
    "steps",
    "session",
];

/// The rooms of what is said of results.
const ANALYSIS_ROOMS: [&str; 12] = [
    "page",
    "drawn",
    "local_run",
    "bits",
    "verify",
    "diff",
    "contact_sheet",
    "report",
    "view",
    "study",
    "wedge",
    "comparison",
];

/// A crate whose rooms are held.
struct Held {
    folder: &'static str,
    /// Its rooms, lowest first.
    rooms: &'static [&'static str],
    /// Modules that only list rooms.
    lists: &'static [&'static str],
}

const HELD: [Held; 4] = [
    Held { folder: "core", rooms: &ROOMS, lists: &["contact"] },
    Held { folder: "io", rooms: &IO_ROOMS, lists: &[] },
    Held { folder: "shot", rooms: &SHOT_ROOMS, lists: &[] },
    Held { folder: "analysis", rooms: &ANALYSIS_ROOMS, lists: &[] },
];

/// Crates, each with those of the project that it may import; what is not listed may import none.
const CRATES: [(&str, &[&str]); 14] = [
    ("core", &[]),
    ("core/mpi", &["drapery_core"]),
    ("io/alembic", &[]),
    ("io/usd", &[]),
    ("io", &["drapery_core", "drapery_alembic", "drapery_usd"]),
    ("shot", &["drapery_core", "drapery_alembic", "drapery_io"]),
    ("analysis", &["drapery_core", "drapery_alembic", "drapery_io", "drapery_shot"]),
    ("cli", &["drapery_core", "drapery_io", "drapery_shot", "drapery_analysis", "drapery_mpi", "drapery_selftest"]),
    ("cli/selftest", &["drapery_core", "drapery_alembic", "drapery_io", "drapery_shot"]),
    ("plugins/capi", &["drapery_core", "drapery_io", "drapery_shot"]),
    // And the command itself, which its module starts.
    ("plugins/python", &["drapery_core", "drapery_io", "drapery_shot", "drapery_analysis"]),
    ("sample_assets", &["drapery_core", "drapery_alembic"]),
    (
        "tests",
        &[
            "drapery_core",
            "drapery_alembic",
            "drapery_io",
            "drapery_shot",
            "drapery_analysis",
            "drapery_assets",
            "drapery_selftest",
        ],
    ),
    ("tests/fuzz", &["drapery_core", "drapery_alembic", "drapery_io", "drapery_shot", "drapery_analysis"]),
];

impl Held {
    fn source(&self) -> PathBuf {
        root().join(self.folder).join("src")
    }

    /// Place of a module's room among the rooms.
    fn place(&self, module: &Module) -> Option<usize> {
        let name = module.join("::");
        self.rooms.iter().position(|room| name == *room || name.starts_with(&format!("{room}::")))
    }
}

#[test]
fn every_module_imports_only_what_is_below_it() {
    let mut complaints = Vec::new();
    for held in &HELD {
        for (module, targets) in Modules::read(&held.source()).imports() {
            let name = format!("{}: {}", held.folder, module.join("::"));
            // The crate and the rooms of rooms only list what is in them.
            if module.is_empty() || held.lists.contains(&module.join("::").as_str()) {
                continue;
            }
            let Some(from) = held.place(&module) else {
                complaints.push(format!("{name}: this room is not among the rooms"));
                continue;
            };
            for target in targets.iter().filter(|target| held.place(target).is_none_or(|to| to > from)) {
                complaints.push(format!("{name} imports {}, which is above it", target.join("::")));
            }
        }
    }
    report(&complaints);
}

#[test]
fn no_modules_import_each_other_in_a_circle() {
    let mut complaints = Vec::new();
    for (folder, _) in CRATES {
        let source = root().join(folder).join("src");
        // The crate of tests has none.
        if !source.is_dir() {
            continue;
        }
        for circle in Modules::read(&source).circles() {
            let names: Vec<String> = circle.iter().map(|module| module.join("::")).collect();
            complaints.push(format!("{folder}: a circle: {}", names.join(", ")));
        }
    }
    report(&complaints);
}

#[test]
fn every_crate_imports_only_those_below_it() {
    let mut complaints = Vec::new();
    assert_eq!(BTreeSet::from(CRATES.map(|(folder, _)| folder.to_owned())), BTreeSet::from_iter(members(&root())));
    for (folder, allowed) in CRATES {
        let manifest = manifest(folder);
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

/// Most words of the map before its table of invariants. Words and not lines, which made paragraphs of tables.
const MAP_WORDS: usize = 1750;

#[test]
fn the_map_is_short_and_names_every_room_in_their_order() {
    let page = std::fs::read_to_string(root().join("docs/dev/architecture.md")).expect("the map");
    let map = page.split("\n## Invariants").next().unwrap_or_default();
    let words = map.split_whitespace().filter(|word| word.contains(char::is_alphanumeric)).count();
    assert!(words <= MAP_WORDS, "{words} words before the invariants");
    for held in &HELD {
        let heading = format!("## The rooms of {}\n", held.folder);
        let table = map.split(&heading).nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap_or_default();
        let cells = table.lines().filter(|line| line.starts_with("| `")).filter_map(|line| line.split('|').nth(1));
        let named: Vec<&str> = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
        assert_eq!(named, held.rooms, "{heading}");
    }
}

/// Cap on the number of times that code names an effect as a text outside the effect's own room.
const NAMES_OF_EFFECTS: usize = 30;

#[test]
fn what_is_known_of_an_effect_stands_in_its_room() {
    let named = named_outside_their_rooms(&root());
    let times: usize = named.iter().map(|(_, times)| times).sum();
    let files: Vec<String> = named.iter().map(|(file, times)| format!("{}: {times}", file.display())).collect();
    assert!(times <= NAMES_OF_EFFECTS, "effects are named {times} times outside their rooms:\n{}", files.join("\n"));
}

#[test]
fn what_a_build_without_usd_lacks_is_a_folder_of_the_formats_and_its_rows() {
    let asks = |file: &SourceFile| file.name.starts_with("io/src/") && file.text.contains("feature = \"usd\"");
    let asking: Vec<String> = rust_files().into_iter().filter(asks).map(|file| file.name).collect();
    assert_eq!(asking, ["io/src/formats/mod.rs"]);
}
