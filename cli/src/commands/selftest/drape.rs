//! `drapery selftest --drape`: how the preset materials drape.

use drapery_io::materials::PRESETS;
use drapery_selftest::drape::{HEAD, Verdict, judge};

use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Drapes these materials, or all, and prints a row for each as soon as it hangs.
pub(crate) fn run(names: &[String], json: bool) -> Result<ExitCode, Failure> {
    let all: Vec<String> = PRESETS.iter().map(|material| material.name.to_string()).collect();
    let mut verdicts: Vec<Verdict> = Vec::new();
    if !json {
        say::line(HEAD);
    }
    for name in if names.is_empty() { &all } else { names } {
        let unknown = || {
            let text = format!("there is no preset {name}\n  help: use one of {}", all.join(", "));
            Failure::new(ExitCode::Usage, text)
        };
        let verdict = judge(name).ok_or_else(unknown)?.map_err(|text| Failure::new(ExitCode::SolverGaveUp, text))?;
        if !json {
            say::line(verdict.row());
        }
        verdicts.push(verdict);
    }
    if json {
        let values: Vec<_> = verdicts.iter().map(Verdict::value).collect();
        // Texts and numbers always have a JSON form.
        say::line(serde_json::to_string_pretty(&values).unwrap_or_default());
    }
    Ok(if verdicts.iter().all(Verdict::passed) { ExitCode::Done } else { ExitCode::Differences })
}
