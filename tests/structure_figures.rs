//! Figures of the structure of a checkout: files and lines of each room of the solver, imports between rooms, circles, and how
//! often effects are named outside their own room.
//!
//! ```text
//! make structure                     this checkout
//! make structure CHECKOUT=../other   another one
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use drapery_tests::source_text::without_tests;
use drapery_tests::structure::{Module, Modules};

/// The room of a module: its first name, or two of them where the room is divided.
fn room(module: &Module) -> String {
    let depth = if module.first().is_some_and(|first| first == "contact") { 2 } else { 1 };
    module[..depth.min(module.len())].join("::")
}

/// Rust files below a folder.
fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// How often a file names an effect as a text.
fn named(path: &Path, effects: &BTreeSet<String>) -> usize {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let code: String = without_tests(&text).lines().filter(|l| !l.trim_start().starts_with("//")).collect();
    code.split('"').skip(1).step_by(2).filter(|text| effects.contains(*text)).count()
}

fn main() {
    let root = std::env::args().nth(1).map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join(".."), PathBuf::from);
    let core = root.join("core/src");
    let modules = Modules::read(&core);
    let mut rooms: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    for module in modules.names() {
        let (files, lines) = rooms.entry(room(module)).or_default();
        *files += 1;
        *lines += modules.own_lines(module);
    }
    let mut between: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (module, targets) in modules.imports() {
        let others = targets.iter().map(room).filter(|to| *to != room(&module));
        between.entry(room(&module)).or_default().extend(others);
    }
    println!("{:<28} {:>5} {:>6}  imports", "room of the solver", "files", "lines");
    for (room, (files, lines)) in &rooms {
        let imports: Vec<&str> = between[room].iter().map(String::as_str).collect();
        println!("{room:<28} {files:>5} {lines:>6}  {}", imports.join(" "));
    }
    println!("rooms: {}, imports between them: {}", rooms.len(), between.values().map(BTreeSet::len).sum::<usize>());
    let circles = modules.circles(|module| {
        let file = module.iter().fold(core.clone(), |path, name| path.join(name)).join("mod.rs");
        file.is_file() || module.len() == 1
    });
    println!("circles: {}", circles.len());
    for circle in &circles {
        println!("    {}", circle.iter().map(|module| module.join("::")).collect::<Vec<_>>().join(", "));
    }
    let own = |module: &&Module| module.len() == 2 && module[0] == "effects";
    let listed: BTreeSet<String> = drapery_core::effects::LISTED.iter().map(|(name, _)| (*name).to_owned()).collect();
    let effects =
        modules.names().filter(own).map(|module| module[1].clone()).filter(|name| listed.contains(name)).collect();
    let mut files = Vec::new();
    ["core/src", "io/src", "shot/src", "analysis/src", "cli/src"]
        .iter()
        .for_each(|folder| rust_files(&root.join(folder), &mut files));
    let outside = files.iter().filter(|path| {
        let name = path.strip_prefix(core.join("effects")).ok().and_then(|path| path.iter().next());
        let stem = name.map(|name| name.to_string_lossy().trim_end_matches(".rs").to_owned());
        !stem.is_some_and(|stem| listed.contains(&stem)) && !path.ends_with("tests.rs")
    });
    let counts: Vec<usize> = outside.map(|path| named(path, &effects)).filter(|count| *count > 0).collect();
    println!("effects named outside their own room: {} times in {} files", counts.iter().sum::<usize>(), counts.len());
}
