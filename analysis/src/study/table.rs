//! The table that a study prints.

use std::fmt::Write;

use crate::page::text::{self, millimetres};
use crate::study::allowed;
use crate::study::analysis::{Analysis, Error, Row, Validity, degradations};
use crate::study::checks::checks;
use crate::study::record::{Omission, Role, Study};
use crate::study::schedule::NO_TIME;
use crate::study::verdict::Verdict;

/// The whole text: a head, a line for every setting, what was found, what to take. `budget` is in seconds a frame.
pub fn table(study: &Study, analysis: &Analysis<'_>, budget: Option<f64>) -> String {
    let mut out = head(study, analysis);
    let width = analysis.rows.iter().map(|row| row.sample.setting.label.chars().count()).max().unwrap_or(0).max(12);
    let _ = writeln!(
        out,
        " {:<width$}  {:>9} {:>6}  {:>14} {:>10} {:>6} {:>9} {:>6} {:>6}  front",
        "setting", "time/f", "x", "error rms", "p99", "order", "maxstrain", "isect", "zones"
    );
    for row in analysis.rows.iter().filter(|row| !is_reference(row)) {
        let _ = writeln!(out, " {}", line(row, width));
    }
    out += &below(study, analysis);
    let _ = writeln!(out, " {}", recommendation(study, analysis, budget));
    out
}

/// Whether a row is of the reference or its check: what others are measured against.
pub(crate) fn is_reference(row: &Row<'_>) -> bool {
    matches!(row.sample.role, Role::Reference | Role::ReferenceCheck | Role::ReferenceCoarse)
}

fn head(study: &Study, analysis: &Analysis<'_>) -> String {
    let frames = study.base().map_or(0, |base| base.cost.frames);
    let scene = &study.scene;
    let mut out = format!(
        "study {}   {frames} f, {} triangles, {} threads, reference {}\n",
        scene.shot,
        text::count(scene.triangles),
        study.machine.threads,
        reference_words(study, analysis)
    );
    let _ = writeln!(out, " {}", window_words(study, analysis));
    out
}

/// Settings of the reference and its own error.
pub(crate) fn reference_words(study: &Study, analysis: &Analysis<'_>) -> String {
    let Some(reference) = study.reference() else { return "missing (see below)".to_owned() };
    let own = match analysis.own {
        Some(own) => format!("self-error {}", millimetres(own)),
        None => "self-error not measured".to_owned(),
    };
    let extrapolated = study.extrapolated.iter().filter(|order| **order > 0).count();
    let how = match extrapolated {
        0 => String::new(),
        some if some == study.compared.len() => ", extrapolated to dt 0".to_owned(),
        some => format!(", extrapolated to dt 0 at {some} of {} frames", study.compared.len()),
    };
    format!("{}{how} ({own})", reference.setting.label)
}

/// Up to when errors are given, and why not longer.
pub(crate) fn window_words(study: &Study, analysis: &Analysis<'_>) -> String {
    let Some(&last) = study.compared.last() else { return "no frames were compared".to_owned() };
    let seconds = |frame: i64| format!("{} s", text::digits(study.time(frame)));
    let horizon = match (analysis.has_horizon, analysis.floor.is_empty()) {
        (true, _) => {
            let at = study.compared.get(analysis.predictable).copied().unwrap_or(last);
            format!("T_p = {}", seconds(at))
        }
        (false, true) => "T_p not measured: no shifted copy was run".to_owned(),
        (false, false) => format!("T_p > {}", seconds(last)),
    };
    let Some(end) = analysis.window_end(study) else {
        return format!("{horizon}; the horizon lies before the first compared frame: errors cannot be measured");
    };
    let why = match (analysis.window < analysis.predictable, analysis.has_horizon) {
        (true, _) => "; beyond, the reference is not converged",
        (false, true) => "; beyond, trajectories cannot be predicted",
        (false, false) => "",
    };
    let over = text::frames(study.scene.start + 1, end);
    format!("{horizon}; errors over {over} (until {}{why})", seconds(end))
}

fn line(row: &Row<'_>, width: usize) -> String {
    let counted = |name: &str| row.sample.counts.get(name).map_or("-".to_owned(), |count| count.to_string());
    let strain = row.sample.figures.iter().map(|figures| figures.strain[0]).fold(0.0, f64::max);
    format!(
        "{:<width$}  {:>9} {:>6}  {:>14} {:>10} {:>6} {:>9} {:>6} {:>6}  {}",
        row.sample.setting.label,
        text::seconds(row.seconds),
        times_words(row.times_base),
        error_words(row.error.as_ref()),
        row.error
            .as_ref()
            .filter(|error| error.validity == Validity::Yes)
            .map_or("-".to_owned(), |e| millimetres(e.p99)),
        row.order.map_or("-".to_owned(), |order| format!("{order:.2}")),
        format!("{} %", text::digits(100.0 * strain)),
        counted("crossings"),
        counted("zones"),
        if row.on_front { "*" } else { "" }
    )
    .trim_end()
    .to_owned()
}

/// A ratio of times.
pub(crate) fn times_words(times: f64) -> String {
    if times < 9.95 { format!("{times:.2}") } else { format!("{times:.1}") }
}

/// An error, or why it cannot be told.
pub(crate) fn error_words(error: Option<&Error>) -> String {
    match error {
        None => "-".to_owned(),
        Some(error) => match error.validity {
            Validity::Yes => millimetres(error.rms),
            Validity::BelowFloor => "<= floor".to_owned(),
            Validity::NotConverged => "ref. not conv.".to_owned(),
            Validity::Unchecked => format!("~ {}", millimetres(error.rms)),
        },
    }
}

/// The error of a recommended setting, in words.
fn recommended_error(error: Option<&Error>, own: Option<f64>) -> String {
    match error.map(|error| (error.validity, error.rms + own.unwrap_or(0.0))) {
        Some((Validity::Yes | Validity::Unchecked, _)) => format!("error {} rms", error_words(error)),
        Some((Validity::BelowFloor, _)) => "error within the noise floor".to_owned(),
        Some((Validity::NotConverged, most)) => {
            format!("error at most {} rms (below what the reference resolves)", millimetres(most))
        }
        None => "error unknown".to_owned(),
    }
}

/// Writes the lines below the settings: orders, effects, failures, and omitted runs.
fn below(study: &Study, analysis: &Analysis<'_>) -> String {
    let mut out = String::new();
    for ladder in &analysis.ladders {
        let interval = ladder.fit.uncertainty.map_or(String::new(), |half| format!(" ± {half:.2}"));
        let of = if ladder.common.is_empty() { String::new() } else { format!(" with {}", ladder.common) };
        let _ = writeln!(
            out,
            " order of convergence{of}: {:.2}{interval} over {} steps, R² {:.3}",
            ladder.fit.order,
            ladder.points.len(),
            ladder.fit.r_squared
        );
    }
    for change in changes(study, analysis) {
        let _ = writeln!(out, " {change}");
    }
    if let Some(base) = study.base() {
        for form in &study.closed_forms {
            let Some([exact, found]) = form.compare(study, base) else { continue };
            let off = millimetres((found - exact).abs());
            let _ = writeln!(
                out,
                " {}: {}, closed form {}, deviation {off}",
                form.name,
                millimetres(found),
                millimetres(exact)
            );
        }
    }
    for row in &analysis.rows {
        let found = degradations(row.sample);
        if !found.is_empty() {
            let words: Vec<String> = found.iter().map(|(name, count)| format!("{name} {count}")).collect();
            let _ = writeln!(out, " degraded: {}: {}", row.sample.setting.label, words.join(", "));
        }
    }
    for sample in study.samples.iter().filter(|sample| !sample.is_whole()) {
        if let Some(failure) = &sample.failure {
            let at = failure.frame.map_or("at the start".to_owned(), |frame| format!("on the way to frame {frame}"));
            let _ = writeln!(out, " failed: {} {at}: {}", sample.setting.label, first_line(&failure.what));
        }
    }
    for check in checks(study, analysis).iter().filter(|check| check.verdict == Verdict::Fails) {
        let _ = writeln!(out, " check failed: {}: {}", check.name, check.why);
    }
    let (late, other): (Vec<&Omission>, Vec<&Omission>) =
        study.omitted.iter().partition(|o| o.why.starts_with(NO_TIME));
    for omission in other {
        let _ = writeln!(out, " missing: {}: {}", omission.label, omission.why);
    }
    if !late.is_empty() {
        let labels: Vec<&str> = late.iter().map(|omission| omission.label.as_str()).collect();
        let _ = writeln!(out, " skipped because of the time limit: {}", labels.join("; "));
    }
    for sentence in allowed::words(study) {
        let _ = writeln!(out, " {sentence}");
    }
    out
}

/// Other models and left-out effects: what they take and what they change in the picture.
fn changes(study: &Study, analysis: &Analysis<'_>) -> Vec<String> {
    let base = analysis.rows.first().map_or(0.0, |row| row.seconds);
    let own = study.samples.iter().filter(|sample| sample.is_own() && sample.is_whole());
    own.filter(|sample| matches!(sample.role, Role::Without | Role::Model | Role::Threads))
        .map(|sample| {
            let change = crate::study::analysis::error_over(&sample.from_base, analysis.predictable);
            let change = change.map_or("an unknown distance".to_owned(), |change| millimetres(change.rms) + " rms");
            let times = sample.seconds_a_frame() / base.max(f64::MIN_POSITIVE);
            let picture = match (sample.role, sample.from_base.iter().all(|distance| distance.max == 0.0)) {
                (Role::Threads, true) => "the same bits".to_owned(),
                (_, true) if !sample.from_base.is_empty() => "no difference in these frames".to_owned(),
                _ => format!("positions differ by {change}"),
            };
            format!("{}: time x {}, {picture}", sample.setting.label, times_words(times))
        })
        .collect()
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// Advice where the front alone leads to no recommendation.
const BUDGET: &str = "set --budget, for example --budget 10s/frame";

/// Returns the recommended setting with the time of the whole shot, or the reason for having none.
pub fn recommendation(study: &Study, analysis: &Analysis<'_>, budget: Option<f64>) -> String {
    let within =
        budget.map_or("at the knee of the front".to_owned(), |b| format!("within {} per frame", text::seconds(b)));
    let Some(row) = analysis.recommended(budget).map(|index| &analysis.rows[index]) else {
        return match budget {
            _ if study.reference().is_none() => "no recommendation: there is no reference run".to_owned(),
            Some(_) => format!(
                "no recommendation: no measured setting {within} is free of intersections and unconverged solves"
            ),
            None if analysis.knee.is_some() => format!(
                "no recommendation: the setting at the knee of the front has intersections or unconverged solves; {BUDGET}"
            ),
            None => format!("no recommendation: the front has no knee; {BUDGET}"),
        };
    };
    let [first, last] = study.scene.frames;
    let frames = (last - study.scene.start).max(0) as f64;
    format!(
        "recommended {within}: \"{}\", {}, frames {first}-{last} in about {} on {} threads{}",
        row.sample.setting.label,
        recommended_error(row.error.as_ref(), analysis.own),
        text::seconds(frames * row.seconds),
        study.machine.threads,
        if study.compared.last().is_some_and(|studied| *studied < last) {
            " if later frames cost the same"
        } else {
            ""
        }
    )
}
