//! The structure of the source tree: the modules of a crate, what they import of each other, and which import each other in a
//! circle. A *room* is a folder or file at the top of a crate, or at the top of a room that is itself divided.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::source_text::code_only;

/// The path of a module below its crate; empty for the crate itself.
pub type Module = Vec<String>;

/// Cap on the number of times that an import is handed on from a module to the one around it.
const HANDED_ON: usize = 4;

/// Folders of the crates of a workspace, below its root.
pub fn members(root: &Path) -> Vec<String> {
    let path = root.join("Cargo.toml");
    let manifest = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let members = manifest.lines().find(|line| line.starts_with("members")).unwrap_or_default();
    members.split('"').skip(1).step_by(2).map(str::to_owned).collect()
}

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

    /// Number of times that the code of all modules has a word.
    pub fn count(&self, word: &str) -> usize {
        self.code.values().map(|code| code.matches(word).count()).sum()
    }

    /// All modules.
    pub fn names(&self) -> impl Iterator<Item = &Module> {
        self.code.keys()
    }

    /// Returns the imports of each module from others of the crate, by `use` or by a path in its code: from `crate`, `super` or
    /// `self`, or from a module inside it by its name alone. An item that a module only hands on counts as imported from its own
    /// module.
    pub fn imports(&self) -> BTreeMap<Module, BTreeSet<Module>> {
        let written: BTreeMap<&Module, Vec<Vec<String>>> =
            self.code.iter().map(|(module, code)| (module, paths(code, &self.inner(module)))).collect();
        let of_module = |module: &Module| {
            let targets = written[module].iter().filter_map(|path| self.source(module, path, &written, HANDED_ON));
            (module.clone(), targets.filter(|target| target != module && !target.is_empty()).collect())
        };
        self.code.keys().map(of_module).collect()
    }

    /// Names of the modules right inside one.
    fn inner(&self, module: &Module) -> Vec<String> {
        let is_inside = |other: &&Module| other.len() == module.len() + 1 && other.starts_with(module);
        self.code.keys().filter(is_inside).filter_map(|other| other.last().cloned()).collect()
    }

    /// The module that has what a path leads to, also where others hand it on, at most `most` times.
    fn source(
        &self,
        module: &Module,
        path: &[String],
        written: &BTreeMap<&Module, Vec<Vec<String>>>,
        others: usize,
    ) -> Option<Module> {
        let (target, rest) = self.target(module, path)?;
        let Some(item) = rest.first().filter(|_| others > 0 && target != *module) else { return Some(target) };
        // By a `use` of the same name, of a module inside.
        let inner = self.inner(&target);
        let hands_on = |path: &&Vec<String>| path.last() == Some(item) && inner.contains(&path[0]) && path.len() > 1;
        match written[&target].iter().find(hands_on) {
            Some(path) => self.source(&target, path, written, others - 1),
            None => Some(target),
        }
    }

    /// Modules that import each other in a circle, each circle once. Each file counts by itself; but between the file of a module and
    /// those of modules inside it there is no circle, whatever they import of each other: to Rust they are one module, which the
    /// file lists and opens.
    pub fn circles(&self) -> Vec<BTreeSet<Module>> {
        let mut graph: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
        for (from, targets) in self.imports() {
            let is_one = |to: &Module| to.starts_with(&from) || from.starts_with(to);
            let others = targets.into_iter().filter(|to| !is_one(to)).collect();
            graph.insert(from, others);
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

    /// The module that a path written in `module` leads to, and what is left of the path there; `None` if it leads out of the crate.
    fn target(&self, module: &Module, path: &[String]) -> Option<(Module, Vec<String>)> {
        let mut base = module.clone();
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" => (base, rest) = (Vec::new(), &rest[1..]),
            "self" => rest = &rest[1..],
            "super" => {}
            name if self.inner(module).iter().any(|inner| inner == name) => {}
            _ => return None,
        }
        while rest.first().is_some_and(|segment| segment == "super") {
            base.pop()?;
            rest = &rest[1..];
        }
        base.extend(rest.iter().cloned());
        let n = (0..=base.len()).rev().find(|n| self.code.contains_key(&base[..*n]))?;
        Some((base[..n].to_vec(), base[n..].to_vec()))
    }
}

/// Returns the modules that can be reached from a module.
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

/// All paths in code that begin with `crate`, `super`, `self` or the name of one of the `inner` modules, those of a `use` with braces
/// each by itself.
fn paths(code: &str, inner: &[String]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for head in ["crate", "super", "self"].into_iter().chain(inner.iter().map(String::as_str)) {
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
            ("f", "use inner::{V, W};\nuse other::inner::U;"),
            ("f::inner", "pub struct V;"),
        ]);
        let imports = all.imports();
        let of = |path: &str| imports[&module(path)].iter().map(|m| m.join("::")).collect::<Vec<_>>().join(" ");
        assert_eq!(
            ["a", "b", "c", "c::inner", "d", "e", "f"].map(of),
            ["b c d", "", "c::inner", "c", "", "", "f::inner"]
        );
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
        let circles = all.circles();
        assert_eq!(circles, [["a", "c", "room::b"].map(module).into_iter().collect::<BTreeSet<_>>()]);
    }

    #[test]
    fn a_room_and_what_is_inside_are_one_and_those_inside_are_not_hidden_by_it() {
        let all = modules(&[
            ("room", "mod a;\nmod b;\nmod c;\npub use a::A;\nuse b::B;\nfn f() -> c::C {}"),
            ("room::a", "use super::B;"),
            ("room::b", "use super::c::C;\nuse super::f;"),
            ("room::c", "use crate::room::A;"),
        ]);
        let imports = all.imports();
        assert_eq!(imports[&module("room::c")], BTreeSet::from([module("room::a")]), "`room` only hands it on");
        let circles = all.circles();
        assert_eq!(circles, [["room::a", "room::b", "room::c"].map(module).into_iter().collect::<BTreeSet<_>>()]);
        let with_parent = modules(&[("room", "use a::A;"), ("room::a", "use super::R;")]);
        assert!(with_parent.circles().is_empty());
    }
}
