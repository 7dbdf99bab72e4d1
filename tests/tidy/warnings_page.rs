//! `docs/reference/warnings.md`, from the table of rules.

use std::fmt::Write;

use drapery_io::rules::RULES;

/// For developers, and for nobody who reads the page.
const NOTE: &str = "
<!-- Written by a test from the table of rules (`io/src/rules.rs`); change it there. -->
";

const HEAD: &str = "# Warnings before a run

`drapery check`, `plan` and `run` look at a scene by these rules before anything is simulated. A warning begins with the name of its
rule, says what it found in which object, and shows the line to write:

```text
WARN frame_rate: body \"hero\": hero.abc: the file states 24 frames per second, but the shot has 25: their frames do not line up
  help: write fps = \"24\" in [shot]
```

A scene that means it so silences the rule; an unknown name is an error, with a suggestion. What is silenced changes
no result, and a run starts all the same:

```toml
[check]
silence = [\"frame_rate\"]
```

`check --json` and `plan --json` list them under `warnings`: `rule`, `object`, `message`, `line`; `rule` is null for warnings that no
rule has, such as broken meshes and jumps of bodies. In the last line of a run they count as warnings; `--strict` does not stop
for them.
";

/// The page.
pub(crate) fn page() -> String {
    let mut page = String::from(HEAD);
    for rule in RULES {
        let (finds, exactly, line) = (capital(rule.finds), rule.exactly, rule.line);
        // Writing to a String cannot fail.
        let _ = write!(page, "\n## `{}`\n\n{finds}. {exactly}\n\nFor example: `{line}`\n", rule.name);
    }
    page + NOTE
}

/// A text that begins with a capital letter, unless it begins with code.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect()
}
