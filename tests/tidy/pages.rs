//! Reference pages that are written by a program. `DRAPERY_BLESS=1 cargo test -p drapery-tests --test tidy` rewrites them.

use crate::tree::root;

/// Compares a page with what it has to be, or rewrites it.
fn check(name: &str, fresh: &str) {
    let path = root().join(name);
    if std::env::var_os("DRAPERY_BLESS").is_some() {
        std::fs::write(&path, fresh).unwrap_or_else(|e| panic!("{name}: {e}"));
        return;
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    let line = there.lines().zip(fresh.lines()).position(|(a, b)| a != b);
    let line = line.unwrap_or(there.lines().count().min(fresh.lines().count())) + 1;
    assert!(
        there == fresh,
        "{name}, line {line}: it is out of date\n  help: DRAPERY_BLESS=1 cargo test -p drapery-tests --test tidy"
    );
}

#[test]
fn the_page_of_effects_is_fresh() {
    check("docs/reference/effects.md", &crate::effects_page::page());
}

#[test]
fn the_page_of_warnings_is_fresh_and_explains_every_rule() {
    let page = crate::warnings_page::page();
    for rule in drapery_io::rules::RULES {
        assert!(page.contains(&format!("\n## `{}`\n", rule.name)), "{} is not explained", rule.name);
        let says = |text: &str| text.trim_end_matches('.').len() > 10;
        assert!(says(rule.finds) && says(rule.exactly) && !rule.line.is_empty(), "{}", rule.name);
    }
    check("docs/reference/warnings.md", &page);
}

#[test]
fn the_picture_of_materials_is_fresh() {
    check("docs/pictures/materials.svg", &crate::curves_picture::picture());
}

#[test]
fn the_page_of_the_scene_file_is_fresh() {
    check("docs/reference/scene.md", &crate::scene_page::page());
}

#[test]
fn the_index_of_decisions_is_fresh() {
    let folder = root().join("docs/dev/decisions");
    let index = folder.join("README.md");
    let head = std::fs::read_to_string(&index).unwrap_or_default();
    let head = head.split("\n* [").next().unwrap_or_default().trim_end();
    let entries = std::fs::read_dir(&folder).expect("there are decisions").flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.retain(|name| name.starts_with(|c: char| c.is_ascii_digit()));
    names.sort();
    let mut page = format!("{head}\n\n");
    for name in names {
        let text = std::fs::read_to_string(folder.join(&name)).expect("a decision");
        let title = text.lines().next().unwrap_or_default().trim_start_matches('#').trim();
        page += &format!("* [{title}]({name})\n");
    }
    check("docs/dev/decisions/README.md", &page);
}

#[test]
fn every_page_is_in_the_book() {
    let book = std::fs::read_to_string(root().join("mkdocs.yml")).expect("the order of the book");
    let pages = crate::tree::text_files().into_iter().filter_map(|file| {
        let page = file.name.strip_prefix("docs/")?;
        page.ends_with(".md").then(|| page.to_owned())
    });
    let lost = pages.filter(|page| !book.contains(&format!(": {page}\n")));
    crate::tree::report(&lost.map(|page| format!("docs/{page} is not in mkdocs.yml")).collect::<Vec<_>>());
}
