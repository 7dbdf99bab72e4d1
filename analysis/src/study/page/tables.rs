//! The tables of the page.

use std::collections::BTreeSet;

use drapery_shot::quality::LIMITS;

use crate::page::table::{Cell, number, section, table, words};
use crate::page::text::{self, escape, millimetres};
use crate::study::analysis::{Analysis, Error, Row, Validity, error_over};
use crate::study::checks::checks;
use crate::study::page::charts::class;
use crate::study::record::{Omission, Role, Sample, Study};
use crate::study::schedule::NO_TIME;
use crate::study::table::{error_words, is_reference, times_words};
use crate::study::verdict::{Check, Verdict};

/// All settings, what they take and how far they are off.
pub(super) fn settings(study: &Study, analysis: &Analysis<'_>) -> String {
    let recommended = analysis.recommended(study.budget);
    let line = |(index, row): (usize, &Row<'_>)| -> Vec<Cell> {
        let valid_error = valid_error(row);
        let spread = if row.times.len() > 2 { format!(" ± {}", text::seconds(row.spread)) } else { String::new() };
        let strain = row.sample.figures.iter().map(|figures| figures.strain[0]).fold(0.0, f64::max);
        let mark = format!("<span class=\"num {}\">{}</span>", class(row), index + 1);
        vec![
            (mark, false),
            (name(row, recommended == Some(index)), false),
            number(format!("{}{spread}", text::seconds(row.seconds))),
            number(times_words(row.times_base)),
            number(text::seconds(processor_seconds(row.sample))),
            number(error_words(row.error.as_ref())),
            number(row.error.map_or("-".to_owned(), |error| millimetres(error.rms + analysis.own.unwrap_or(0.0)))),
            number(valid_error.map_or("-".to_owned(), |error| millimetres(error.p99))),
            number(row.order.map_or("-".to_owned(), |order| format!("{order:.2}"))),
            number(format!("{} %", text::digits(100.0 * strain))),
            number(crossings_of(row.sample)),
            words(if row.on_front { "●" } else { "" }),
        ]
    };
    let rows = || analysis.rows.iter().enumerate().filter(|(_, row)| !is_reference(row));
    let lines: Vec<Vec<Cell>> = rows().map(line).collect();
    let heads = [
        words(""),
        words("setting"),
        number("time per frame"),
        number("×"),
        number("processor time"),
        number("error, RMS"),
        number("upper bound"),
        number("99th percentile"),
        number("order"),
        number("max strain"),
        number("intersections"),
        words("front"),
    ];
    let note = "<p>Error: distance from the reference, root mean square over the cloth and the frames. Processor time: per \
         frame, summed over threads; nearly independent of other load on the machine. Order: rate at which the error falls \
         with the time step. Intersections: edges that pass through triangles at the end of a frame. ● no other setting is \
         both faster and more accurate. <i>ref. not conv.</i>: below what the reference resolves; the next column is an \
         upper bound. <i>&lt;= floor</i>: no larger than the growth of rounding errors.</p>";
    section("Settings", note, &heads, &lines) + &more(study, analysis)
}

/// The error of a row, if it may be given.
fn valid_error(row: &Row<'_>) -> Option<Error> {
    row.error.filter(|error| matches!(error.validity, Validity::Yes | Validity::Unchecked))
}

/// A length by the diagonal of the box around the cloth.
fn share_of_size(length: f64, study: &Study) -> String {
    format!("{} %", text::digits(100.0 * length / study.scene.size.max(f64::MIN_POSITIVE)))
}

/// Name of a setting, with what it is besides.
fn name(row: &Row<'_>, is_recommended: bool) -> String {
    let label = escape(&row.sample.setting.label);
    match (row.sample.role, is_recommended) {
        (_, true) => format!("<b>{label}</b> ← recommended"),
        (Role::Reference, _) => format!("{label} <i>(reference)</i>"),
        (Role::ReferenceCheck | Role::ReferenceCoarse, _) => format!("{label} <i>(checks the reference)</i>"),
        _ => label,
    }
}

/// Processor seconds a frame: on a machine that does other things as well they tell more than the time of a single run.
fn processor_seconds(sample: &Sample) -> f64 {
    sample.cost.processor_seconds / sample.cost.frames.max(1) as f64
}

/// Returns a table of the further measurements of every setting, and of the reference.
fn more(study: &Study, analysis: &Analysis<'_>) -> String {
    let line = |row: &Row<'_>| -> Vec<Cell> {
        let (valid_error, cost) = (valid_error(row), &row.sample.cost);
        let length = |of: &dyn Fn(&Error) -> Option<f64>| {
            number(valid_error.as_ref().and_then(of).map_or("-".to_owned(), millimetres))
        };
        let frames = cost.frames.max(1);
        vec![
            (name(row, false), false),
            number(text::seconds(row.seconds)),
            number(valid_error.map_or("-".to_owned(), |error| share_of_size(error.rms, study))),
            length(&|error| Some(error.max)),
            length(&|error| error.surface),
            number(valid_error.map_or("-".to_owned(), |error| text::scaled(error.velocity_rms, "m/s"))),
            number(
                valid_error.map_or("-".to_owned(), |error| format!("{}°", text::digits(error.normal_rms.to_degrees()))),
            ),
            number(text::digits(cost.steps as f64 / frames as f64)),
            number(text::seconds(cost.dt[0])),
            number(text::digits(cost.cg_iterations as f64 / frames as f64)),
            number(cost.peak_bytes.map_or("-".to_owned(), text::bytes)),
        ]
    };
    let lines: Vec<Vec<Cell>> = analysis.rows.iter().map(line).collect();
    let heads = [
        words("setting"),
        number("time per frame"),
        number("error / size of the cloth"),
        number("largest error"),
        number("distance of surfaces"),
        number("velocity, RMS"),
        number("angle of normals, RMS"),
        number("steps per frame"),
        number("shortest step"),
        number("iterations per frame"),
        number("peak memory"),
    ];
    let table = table(&heads, &lines);
    format!(
        "<div class=\"card\"><details><summary>All figures of every setting and of the reference</summary>{table}</details></div>\n"
    )
}

/// Returns a table of the conditions that have to hold for a study whatever the scene.
pub(super) fn checked(study: &Study, analysis: &Analysis<'_>) -> String {
    let line = |check: &Check| -> Vec<Cell> {
        let answer = match check.verdict {
            Verdict::Holds => "<span class=\"none\">yes</span>",
            Verdict::Fails => "<span class=\"warn\"><b>no</b></span>",
            Verdict::Unknown => "not known",
            Verdict::NotApplicable => "not applicable",
        };
        vec![words(check.name), (answer.to_owned(), false), words(&check.why)]
    };
    let lines: Vec<Vec<Cell>> = checks(study, analysis).iter().map(line).collect();
    section("Validity checks", "", &[words("check"), words("passed"), words("")], &lines)
}

/// Returns a table of the cost of other models and left-out effects, and of the changes that they make.
pub(super) fn changes(study: &Study) -> String {
    let base = study.base().map(processor_seconds).filter(|seconds| *seconds > 0.0);
    let own = study.samples.iter().filter(|sample| sample.is_own() && sample.is_whole());
    let lines: Vec<Vec<Cell>> = own
        .filter(|sample| matches!(sample.role, Role::Without | Role::Model | Role::Threads))
        .map(|sample| {
            let seconds = sample.seconds_a_frame();
            let share = |base: f64| format!("{:+.0} %", 100.0 * (base - processor_seconds(sample)) / base);
            let share = base.map_or("-".to_owned(), share);
            let change = error_over(&sample.from_base, study.compared.len());
            let length = |of: fn(&Error) -> f64| {
                number(change.as_ref().map_or("-".to_owned(), |change| millimetres(of(change))))
            };
            let last = |of: fn(&Sample) -> f64| text::digits(of(sample));
            let area = last(|sample| sample.figures.last().map_or(0.0, |figures| figures.drape_area));
            let folds = last(|sample| sample.figures.last().map_or(0.0, |figures| figures.folds[1]));
            vec![
                words(&sample.setting.label),
                number(text::seconds(seconds)),
                number(share),
                length(|change| change.rms),
                length(|change| change.p99),
                number(format!("{area} m²")),
                number(format!("{folds} m")),
                words(crossings_of(sample)),
            ]
        })
        .collect();
    let heads = [
        words("change"),
        number("time per frame"),
        number("share of processor time"),
        number("displacement of the cloth, RMS"),
        number("99th percentile"),
        number("drape area at the end"),
        number("folds over 60° at the end"),
        words("intersections"),
    ];
    let note = "<p>Compared with the scene as it is, over all compared frames. Share: the part of the processor time per frame \
         that the change saves.</p>";
    section("Cost and impact of each effect and choice", note, &heads, &lines)
}

fn crossings_of(sample: &Sample) -> String {
    match sample.counts.get("crossings") {
        None => "not checked".to_owned(),
        Some(count) => text::count(*count),
    }
}

/// Quantities that are known without simulating.
pub(super) fn closed_forms(study: &Study, analysis: &Analysis<'_>) -> String {
    let mut lines: Vec<Vec<Cell>> = Vec::new();
    for form in &study.closed_forms {
        for row in &analysis.rows {
            let Some([exact, found]) = form.compare(study, row.sample) else { continue };
            lines.push(vec![
                words(&form.name),
                words(&row.sample.setting.label),
                number(millimetres(exact)),
                number(millimetres(found)),
                number(millimetres((found - exact).abs())),
            ]);
        }
    }
    let heads = [words("quantity"), words("setting"), number("closed form"), number("found"), number("deviation")];
    section("Comparison with closed-form solutions", "", &heads, &lines)
}

/// Counts that should stay zero and did not, with what they mean and where they occurred; and all counts.
pub(super) fn counters(analysis: &Analysis<'_>) -> String {
    let names: BTreeSet<&str> = analysis
        .rows
        .iter()
        .flat_map(|row| row.sample.counts.iter().filter(|(_, count)| **count > 0).map(|(name, _)| name.as_str()))
        .collect();
    let lost = |(name, meaning): &(&str, &str)| -> Option<Vec<Cell>> {
        let found = analysis.rows.iter().filter_map(|row| {
            let count = row.sample.counts.get(*name).filter(|count| **count > 0)?;
            Some(format!("{}: {}", row.sample.setting.label, text::count(*count)))
        });
        let found: Vec<String> = found.collect();
        let name = (format!("<code>{}</code>", escape(name)), false);
        (!found.is_empty()).then(|| vec![name, words(*meaning), words(found.join("; "))])
    };
    let lines: Vec<Vec<Cell>> = LIMITS.iter().filter_map(lost).collect();
    let mut heads = vec![words("count")];
    heads.extend(analysis.rows.iter().map(|row| number(&row.sample.setting.label)));
    let line = |name: &&str| -> Vec<Cell> {
        let cells = analysis.rows.iter().map(|row| count_of(row.sample, name));
        std::iter::once((format!("<code>{}</code>", escape(name)), false)).chain(cells).collect()
    };
    let all: Vec<Vec<Cell>> = names.iter().map(line).collect();
    if analysis.rows.is_empty() {
        return String::new();
    }
    let lost = match lines.is_empty() {
        true => "<p class=\"none\">None in any setting: every count that should stay zero is zero.</p>".to_owned(),
        false => table(&[words("count"), words("meaning"), words("total by setting")], &lines),
    };
    let all = match all.is_empty() {
        true => String::new(),
        false => format!("<details><summary>All counts, over all frames</summary>{}</details>", table(&heads, &all)),
    };
    format!("<section><h2>Degradations</h2><div class=\"card\">{lost}{all}</div></section>\n")
}

fn count_of(sample: &Sample, name: &str) -> Cell {
    match sample.counts.get(name) {
        None => number("-"),
        Some(0) => number("0"),
        Some(count) => (format!("<b>{}</b>", text::count(*count)), true),
    }
}

/// Runs that failed, and runs that are not there.
pub(super) fn left_out(study: &Study) -> String {
    let failed = study.samples.iter().filter_map(|sample| {
        let failure = sample.failure.as_ref()?;
        let at = failure.frame.map_or("at the start".to_owned(), |frame| format!("on the way to frame {frame}"));
        Some(vec![words(&sample.setting.label), words(format!("failed {at}: {}", failure.what))])
    });
    let (late, other): (Vec<&Omission>, Vec<&Omission>) =
        study.omitted.iter().partition(|o| o.why.starts_with(NO_TIME));
    let omitted = other.into_iter().map(|omission| vec![words(&omission.label), words(&omission.why)]);
    let mut lines: Vec<Vec<Cell>> = failed.chain(omitted).collect();
    if !late.is_empty() {
        let seconds: f64 = late.iter().map(|omission| omission.seconds).sum();
        let labels: Vec<&str> = late.iter().map(|omission| omission.label.as_str()).collect();
        let why = format!("time limit: about {} more needed for all of them", text::seconds(seconds));
        lines.push(vec![words(labels.join("; ")), words(why)]);
    }
    section("Runs that failed or are missing", "", &[words("run"), words("reason")], &lines)
}

/// Returns a table of the provenance of the study.
pub(super) fn provenance(study: &Study, analysis: &Analysis<'_>) -> String {
    let (scene, machine) = (&study.scene, &study.machine);
    let settings: Vec<String> = scene.settings.iter().map(|(name, value)| format!("{name}={value}")).collect();
    let digests: Vec<String> = study.digests.iter().map(|(name, digest)| format!("{name} {digest}")).collect();
    let noise = analysis.noise.map_or("not measured".to_owned(), |noise| format!("{:.1} %", 100.0 * noise));
    let runs = study.samples.len();
    let facts = [
        ("command", study.command.clone()),
        ("scene", scene.path.clone()),
        ("set", settings.join(" ")),
        ("program", study.application.clone()),
        ("effects", scene.effects.join(", ")),
        ("machine", format!("{}: {}", machine.host, machine.processor)),
        ("processors", format!("{} ({} threads used)", machine.processors, machine.threads)),
        ("CPU frequency governor", machine.governor.clone()),
        ("load before the study", text::digits(machine.load)),
        ("spread of repeated times", noise),
        ("runs", format!("{runs} in {}", text::seconds(study.seconds))),
        ("compared frames", study.compared.iter().map(i64::to_string).collect::<Vec<_>>().join(" ")),
        ("digests", digests.join("\n")),
    ];
    let lines: Vec<Vec<Cell>> = facts
        .iter()
        .filter(|(_, text)| !text.is_empty())
        .map(|(name, text)| vec![words(name), (format!("<code>{}</code>", escape(text)), false)])
        .collect();
    section("Provenance", "", &[words(""), words("")], &lines)
}
