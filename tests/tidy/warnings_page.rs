//! `docs/reference/warnings.md`, from the table of rules.

use std::fmt::Write;

use drapery_io::rules::RULES;

/// For developers, and for nobody who reads the page.
const NOTE: &str = "
<!-- Written by a test from the table of rules (`io/src/rules.rs`); change it there. -->
";

const HEAD: &str = "# Warnings before a run

`drapery check`, `plan` and `run` test a scene against these rules before anything is simulated. A warning begins with the name of its
rule. It names the object and the finding, and shows the line to write:

```text
WARN frame_rate: body \"hero\": hero.abc: the file states 24 frames per second, but the shot has 25: their frames do not line up
  help: write fps = \"24\" in [shot]
```

Silence a rule if the scene is meant to be so. An unknown name is an error, with a suggestion. Warnings never stop a run, and
silencing a rule changes no result:

```toml
[check]
silence = [\"frame_rate\"]
```

`check --json` and `plan --json` list warnings under `warnings`, with `rule`, `object`, `message` and `line`. `rule` is null for
warnings without a rule, such as degenerate faces and jumps of bodies. After an error they print an object with its text as `error` and
the `exit_code`. The last line of a run counts them as warnings. `--strict` does not stop for them.
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
