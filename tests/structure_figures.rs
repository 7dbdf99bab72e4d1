//! Figures of the structure of a checkout: files and lines of each room of the solver, imports between rooms, circles, and how
//! often effects are named outside their own room, integrators anywhere, and features of crates in code.
//!
//! ```text
//! make structure                     this checkout
//! make structure CHECKOUT=../other   another one
//! ```

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use drapery_tests::effect_names::named_outside_their_rooms;
use drapery_tests::structure::{Module, Modules, members};

/// The room of a module: its first name, or two of them where the room is divided.
fn room(module: &Module) -> String {
    let depth = if module.first().is_some_and(|first| first == "contact") { 2 } else { 1 };
    module[..depth.min(module.len())].join("::")
}

/// Says which files of a crate import each other in a circle; its modules.
fn circles(folder: &str, source: &Path) -> Modules {
    let modules = Modules::read(source);
    let circles = modules.circles();
    println!("circles in {folder}: {}", circles.len());
    for circle in &circles {
        println!("    {}", circle.iter().map(|module| module.join("::")).collect::<Vec<_>>().join(", "));
    }
    modules
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
    let (mut questions, mut features) = (0, 0);
    for folder in members(&root) {
        let source = root.join(&folder).join("src");
        if source.is_dir() {
            let modules = circles(&folder, &source);
            questions += modules.count("Integrator::SemiImplicit") + modules.count("Integrator::TrBdf2");
            features += modules.count("cfg(feature") + modules.count("cfg(not(feature");
        }
    }
    println!("integrators named: {questions} times, their rows among them; cfg of features: {features}");
    let named = named_outside_their_rooms(&root);
    let times = named.iter().map(|(_, times)| times).sum::<usize>();
    println!("effects named outside their own room: {times} times in {} files", named.len());
}
