//! The structure of the source tree: the modules of a crate, what they import of each other, and which import each other in a
//! circle. A *room* is a folder or file at the top of a crate, or at the top of a room that is itself divided.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::source_text::code_only;

/// The path of a module below its crate; empty for the crate itself.
pub type Module = Vec<String>;

/// A crate's modules without those of tests, and what each imports.
pub struct Modules {
    /// Code of each, without comments, texts and tests.
    code: BTreeMap<Module, String>,
}

impl Modules {
    /// The modules under the `src` of a crate.
    pub fn read(src: &Path) -> Self {
        let mut code = BTreeMap::new();
        collect(src, &mut Vec::new(), &mut code);
        Self { code }
    }

    /// Lines of code of one module's own file.
    pub fn own_lines(&self, module: &Module) -> usize {
        self.code[module].lines().filter(|line| !line.trim().is_empty()).count()
    }

    /// All modules.
    pub fn names(&self) -> impl Iterator<Item = &Module> {
        self.code.keys()
    }

    /// What each module imports of others of the crate, by `use` or by a path in its code.
    pub fn imports(&self) -> BTreeMap<Module, BTreeSet<Module>> {
        let of_module = |(module, code): (&Module, &String)| {
            let paths = paths(code).into_iter().filter_map(|path| self.target(module, &path));
            (module.clone(), paths.filter(|target| target != module && !target.is_empty()).collect())
        };
        self.code.iter().map(of_module).collect()
    }

    /// Modules that import each other in a circle, each circle once. A module and those inside it count as one, unless it is one
    /// of the `rooms`, which only hold others.
    pub fn circles(&self, is_room: impl Fn(&Module) -> bool) -> Vec<BTreeSet<Module>> {
        let unit = |module: &Module| {
            let outer = (1..module.len()).map(|n| &module[..n]).find(|outer| !is_room(&outer.to_vec()));
            outer.map_or_else(|| module.clone(), <[String]>::to_vec)
        };
        let mut graph: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, targets) in self.imports() {
            let from = unit(&module);
            let targets = targets.iter().map(unit).filter(|to| *to != from);
            graph.entry(from.clone()).or_default().extend(targets);
        }
        let reached: BTreeMap<&Module, BTreeSet<&Module>> =
            graph.keys().map(|from| (from, reach(&graph, from))).collect();
        let circle = |from: &&Module| -> BTreeSet<Module> {
            let back = |to: &&&Module| reached.get(**to).is_some_and(|reached| reached.contains(*from));
            reached[*from].iter().filter(back).map(|to| (*to).clone()).collect()
        };
        let circles: BTreeSet<BTreeSet<Module>> = graph.keys().collect::<Vec<_>>().iter().map(circle).collect();
        circles.into_iter().filter(|circle| circle.len() > 1).collect()
    }

    /// The module that a path written in `module` leads to; `None` if it leads out of the crate.
    fn target(&self, module: &Module, path: &[String]) -> Option<Module> {
        let mut base = module.clone();
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" => (base, rest) = (Vec::new(), &rest[1..]),
            "self" => rest = &rest[1..],
            "super" => {}
            _ => return None,
        }
        while rest.first().is_some_and(|segment| segment == "super") {
            base.pop()?;
            rest = &rest[1..];
        }
        base.extend(rest.iter().cloned());
        (0..=base.len()).rev().map(|n| base[..n].to_vec()).find(|module| self.code.contains_key(module))
    }
}

/// What can be reached from a module.
fn reach<'a>(graph: &'a BTreeMap<Module, BTreeSet<Module>>, from: &'a Module) -> BTreeSet<&'a Module> {
    let (mut found, mut next) = (BTreeSet::new(), vec![from]);
    while let Some(module) = next.pop() {
        next.extend(graph.get(module).into_iter().flatten().filter(|to| found.insert(*to)));
    }
    found
}

/// Reads the files of a folder and of those below it.
fn collect(folder: &Path, module: &mut Module, code: &mut BTreeMap<Module, String>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries.flatten() {
        let path = entry.path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if ["tests", "testing"].contains(&name.as_str()) {
            continue;
        }
        if path.is_dir() {
            module.push(name);
            collect(&path, module, code);
            module.pop();
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            let mut own = module.clone();
            if !["mod", "lib", "main"].contains(&name.as_str()) {
                own.push(name);
            }
            code.insert(own, without_test_modules(&code_only(&text)));
        }
    }
}

/// The code without modules that exist in tests alone.
fn without_test_modules(code: &str) -> String {
    let (mut out, mut inside, mut test) = (String::new(), false, false);
    for line in code.lines() {
        inside |= test && line.contains("mod ") && line.ends_with('{');
        if !inside {
            out.push_str(line);
            out.push('\n');
        }
        inside &= line != "}";
        test = line == "#[cfg(test)]";
    }
    out
}

/// All paths in code that begin with `crate`, `super` or `self`, those of a `use` with braces each by itself.
fn paths(code: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for head in ["crate", "super", "self"] {
        for (at, _) in code.match_indices(&format!("{head}::")) {
            let before = code[..at].chars().next_back();
            if before.is_some_and(|c| c.is_alphanumeric() || "_:$".contains(c)) {
                continue;
            }
            let line = code[..at].rfind('\n').map_or(0, |n| n + 1);
            let is_use = code[line..at].trim_end().ends_with("use");
            let tree = if is_use { code[at..].split(';').next().unwrap_or_default() } else { plain(&code[at..]) };
            expand(tree, &mut found);
        }
    }
    found
}

/// The path at the start of code.
fn plain(code: &str) -> &str {
    let end = code.find(|c: char| !(c.is_alphanumeric() || "_:".contains(c))).unwrap_or(code.len());
    code[..end].trim_end_matches(':')
}

/// The paths of a tree of a `use`.
fn expand(tree: &str, found: &mut Vec<Vec<String>>) {
    let segments = |path: &str| -> Vec<String> {
        let path = path.split(" as ").next().unwrap_or_default();
        path.split("::").map(|s| s.trim().to_owned()).filter(|s| !s.is_empty()).collect()
    };
    let Some(open) = tree.find('{') else { return found.push(segments(tree)) };
    let inner = &tree[open + 1..tree.rfind('}').unwrap_or(tree.len())];
    let (mut depth, mut start) = (0_usize, 0);
    let mut ends: Vec<usize> = Vec::new();
    for (i, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => ends.push(i),
            _ => {}
        }
    }
    ends.push(inner.len());
    for end in ends {
        let branch = inner[start..end].trim();
        start = (end + 1).min(inner.len());
        if !branch.is_empty() {
            expand(&format!("{}{}", tree[..open].trim(), if branch == "self" { "" } else { branch }), found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn module(path: &str) -> Module {
        path.split("::").filter(|s| !s.is_empty()).map(str::to_owned).collect()
    }

    fn modules(files: &[(&str, &str)]) -> Modules {
        Modules {
            code: files.iter().map(|(path, code)| (module(path), without_test_modules(&code_only(code)))).collect(),
        }
    }

    #[test]
    fn imports_are_found_in_trees_in_code_and_relative_to_a_module_but_not_in_tests() {
        let all = modules(&[
            ("", "pub mod a;"),
            ("a", "use crate::{b::{self, X}, c::Y as Z};\nfn f() { super::d::g(); } // crate::e::h()\n"),
            ("b", "pub(crate) fn x() {}\n#[cfg(test)]\nmod tests {\n    use crate::e::h;\n}\n"),
            ("c", "use self::inner::W;"),
            ("c::inner", "use super::Y;"),
            ("d", ""),
            ("e", "impl $crate::b::X {}"),
        ]);
        let imports = all.imports();
        let of = |path: &str| imports[&module(path)].iter().map(|m| m.join("::")).collect::<Vec<_>>().join(" ");
        assert_eq!(["a", "b", "c", "c::inner", "d", "e"].map(of), ["b c d", "", "c::inner", "c", "", ""]);
        assert_eq!(all.own_lines(&module("a")), 2);
    }

    #[test]
    fn circles_are_found_once_and_a_module_with_its_inner_ones_is_none() {
        let all = modules(&[
            ("a", "use crate::room::b::B;"),
            ("room", "mod b;"),
            ("room::b", "use crate::c::C;\nuse self::inner::I;"),
            ("room::b::inner", "use super::B;"),
            ("c", "use crate::a::A;"),
            ("d", "use crate::a::A;"),
        ]);
        let circles = all.circles(|m| *m == module("room"));
        assert_eq!(circles, [["a", "c", "room::b"].map(module).into_iter().collect::<BTreeSet<_>>()]);
    }
}
