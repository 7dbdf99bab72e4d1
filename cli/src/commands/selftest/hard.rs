//! `drapery selftest --hard` and `--tangles`: cases one after the other.

use drapery_selftest::CATALOGUE;
use drapery_selftest::bench::Conditions;
use drapery_selftest::case::{Case, Tier};
use drapery_selftest::suite::{Verdict, judge, judge_combination, judge_tangle};
use drapery_selftest::{report, suite, tangles};

use crate::args::{HardTier, SelftestArgs};
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Combinations of the full and of the soak tier.
const COMBINATIONS: [u64; 2] = [200, 2000];

/// Runs cases and combinations, and prints a row for each figure as soon as it is known.
pub(crate) fn run(args: &SelftestArgs, tier: HardTier) -> Result<ExitCode, Failure> {
    let (tier, combinations) = match tier {
        HardTier::Quick => (Tier::Quick, 0),
        HardTier::Full => (Tier::Full, COMBINATIONS[0]),
        HardTier::Soak => (Tier::Soak, COMBINATIONS[1]),
    };
    let (cases, seeds) = match (&args.seeds, args.cases.is_empty()) {
        (Some(seeds), _) => (Vec::new(), seeds.first..seeds.last + 1),
        (None, false) => (chosen(&args.cases)?, 0..0),
        (None, true) => (CATALOGUE.iter().collect(), 0..combinations),
    };
    let mut table = Table::new(args, tier)?;
    cases.into_iter().for_each(|case| table.add(judge(case, table.conditions)));
    seeds.for_each(|seed| table.add(judge_combination(seed, table.conditions)));
    Ok(table.end())
}

/// Runs tangles, and prints a row for each figure as soon as it is known.
pub(crate) fn run_tangles(args: &SelftestArgs) -> Result<ExitCode, Failure> {
    let seeds = args.seeds.as_ref().map_or(0..tangles::COUNT, |seeds| seeds.first..seeds.last + 1);
    let mut table = Table::new(args, Tier::Quick)?;
    seeds.for_each(|seed| table.add(judge_tangle(seed, table.conditions)));
    Ok(table.end())
}

/// Verdicts as they come.
struct Table<'a> {
    conditions: Conditions<'a>,
    is_json: bool,
    verdicts: Vec<Verdict>,
}

impl<'a> Table<'a> {
    fn new(args: &'a SelftestArgs, tier: Tier) -> Result<Self, Failure> {
        // Cases of the command start it again.
        let drapery = args.program.as_deref().ok_or_else(|| {
            let what = "the executable of this command, which some cases start, is not found";
            Failure::new(ExitCode::Io, format!("{what}\n  help: reinstall the program"))
        })?;
        if !args.json {
            say::line(report::HEAD);
        }
        let conditions = Conditions { tier, integrator: args.integrator, drapery };
        Ok(Self { conditions, is_json: args.json, verdicts: Vec::new() })
    }

    fn add(&mut self, verdict: Verdict) {
        if !self.is_json {
            report::rows(&verdict).into_iter().for_each(say::line);
            trouble(&verdict);
        }
        self.verdicts.push(verdict);
    }

    fn end(self) -> ExitCode {
        if self.is_json {
            let all: Vec<_> = self.verdicts.iter().map(report::value).collect();
            // Texts and numbers always have a JSON form.
            say::line(serde_json::to_string_pretty(&all).unwrap_or_default());
        } else {
            say::line(suite::summary(&self.verdicts));
        }
        if self.verdicts.iter().all(Verdict::passed) { ExitCode::Done } else { ExitCode::Differences }
    }
}

/// The rest of what went wrong, where one line does not hold it.
fn trouble(verdict: &Verdict) {
    let lines = verdict.trouble.iter().flat_map(|text| text.lines().skip(1));
    lines.for_each(|line| say::complaint(format_args!("{}: {line}", verdict.id)));
}

/// The cases of these numbers; all of them if there are none.
fn chosen(ids: &[String]) -> Result<Vec<&'static Case>, Failure> {
    if ids.is_empty() {
        return Ok(CATALOGUE.iter().collect());
    }
    let find = |id: &String| {
        let known = CATALOGUE.iter().find(|case| case.id.eq_ignore_ascii_case(id));
        known.ok_or_else(|| {
            let all: Vec<_> = CATALOGUE.iter().map(|case| case.id).collect();
            Failure::new(ExitCode::Usage, format!("there is no case {id}\n  help: use one of {}", all.join(", ")))
        })
    };
    ids.iter().map(find).collect()
}
