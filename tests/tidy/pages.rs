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
fn the_page_of_the_scene_file_is_fresh() {
    check("docs/reference/scene.md", &crate::scene_page::page());
}
