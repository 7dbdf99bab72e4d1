//! Settings in which the scenes of several runs differ.

use std::collections::{BTreeMap, BTreeSet};

use drapery_io::input_file;
use drapery_shot::run_record::RESOLVED;
use drapery_shot::run_record::folder::RunFolder;
use toml::Value;

use crate::page::table::{Cell, table as table_of, words};

/// Differences that are shown without a click.
const OPEN: usize = 16;

/// A table of the keys whose values differ: a row a key, a column a run. Empty where no scenes differ.
pub(super) fn table(runs: &[(String, RunFolder)]) -> String {
    let scenes: Vec<BTreeMap<String, String>> = runs.iter().map(|(_, run)| settings(run)).collect();
    let rows = differing(&scenes);
    if rows.is_empty() {
        return String::new();
    }
    let mut heads = vec![words("key")];
    heads.extend(runs.iter().map(|(name, _)| words(name)));
    let row = |key: &&String| -> Vec<Cell> {
        let value = |scene: &BTreeMap<String, String>| words(scene.get(*key).map_or("", String::as_str));
        [vec![words(key)], scenes.iter().map(value).collect()].concat()
    };
    let cells: Vec<Vec<Cell>> = rows.iter().map(row).collect();
    let shown = table_of(&heads, &cells);
    let body = match rows.len() {
        ..=OPEN => shown,
        count => format!("<details><summary>{count} keys</summary>{shown}</details>"),
    };
    format!("<section><h2>Differences of the scenes</h2><div class=\"card\">{body}</div></section>\n")
}

/// Keys that do not have the same value in all scenes that could be read.
fn differing(scenes: &[BTreeMap<String, String>]) -> Vec<&String> {
    let read: Vec<&BTreeMap<String, String>> = scenes.iter().filter(|scene| !scene.is_empty()).collect();
    let keys: BTreeSet<&String> = read.iter().flat_map(|scene| scene.keys()).collect();
    let differs = |key: &&String| read.iter().any(|scene| scene.get(*key) != read[0].get(*key));
    keys.into_iter().filter(differs).collect()
}

/// Every value of the resolved scene of a run by its dotted key, as `--set` has it; nothing if it cannot be read.
fn settings(run: &RunFolder) -> BTreeMap<String, String> {
    let text = input_file::text(&run.path.join(RESOLVED)).unwrap_or_default();
    let mut found = BTreeMap::new();
    if let Ok(scene) = text.parse::<toml::Table>() {
        scene.iter().for_each(|(key, value)| flatten(key, value, &mut found));
    }
    // Runs of the same `auto` may have taken different ones.
    let taken = &run.record.header.integrator;
    if let Some(written) = found.get_mut("solver.integrator").filter(|written| written != &taken && !taken.is_empty()) {
        *written = format!("{written}: {taken}");
    }
    found
}

fn flatten(key: &str, value: &Value, found: &mut BTreeMap<String, String>) {
    match value {
        Value::Table(table) => table.iter().for_each(|(name, value)| flatten(&format!("{key}.{name}"), value, found)),
        Value::Array(items) if items.iter().any(Value::is_table) => {
            for (index, item) in items.iter().enumerate() {
                let name = item.get("name").and_then(Value::as_str);
                flatten(&format!("{key}.{}", name.map_or(index.to_string(), str::to_owned)), item, found);
            }
        }
        Value::String(text) => drop(found.insert(key.to_owned(), text.clone())),
        other => drop(found.insert(key.to_owned(), other.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(folder: &std::path::Path, scene: &str) -> RunFolder {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join(RESOLVED), scene).unwrap();
        RunFolder { path: folder.to_owned(), ..RunFolder::default() }
    }

    #[test]
    fn keys_that_differ_are_named_as_set_has_them() {
        let folder = tempfile::tempdir().unwrap();
        let scene = |material: &str| {
            format!(
                "drapery = 1\n[[garment]]\nname = \"skirt\"\nmaterial = \"{material}\"\n[garment.stretch]\nstiffness = 5.0\n"
            )
        };
        let runs = vec![
            ("a".to_owned(), run(&folder.path().join("a"), &scene("silk_light"))),
            ("b".to_owned(), run(&folder.path().join("b"), &scene("wool"))),
            ("c".to_owned(), RunFolder { path: folder.path().join("c"), ..RunFolder::default() }),
        ];
        let scenes: Vec<_> = runs.iter().map(|(_, run)| settings(run)).collect();
        assert_eq!(differing(&scenes), ["garment.skirt.material"]);
        let page = table(&runs);
        assert!(page.contains("<td>silk_light</td><td>wool</td><td></td>"), "{page}");
        assert!(table(&runs[..1]).is_empty());
    }

    #[test]
    fn integrators_that_the_solver_chose_are_named_where_they_differ() {
        let folder = tempfile::tempdir().unwrap();
        let run_with = |name: &str, integrator: &str| {
            let mut run = run(&folder.path().join(name), "drapery = 1\n[solver]\nintegrator = \"auto\"\n");
            integrator.clone_into(&mut run.record.header.integrator);
            (name.to_owned(), run)
        };
        let runs = [run_with("a", "semi_implicit"), run_with("b", "tr_bdf2")];
        let page = table(&runs);
        assert!(page.contains("<td>auto: semi_implicit</td><td>auto: tr_bdf2</td>"), "{page}");
        assert!(table(&[run_with("c", "tr_bdf2"), run_with("d", "tr_bdf2")]).is_empty());
    }
}
