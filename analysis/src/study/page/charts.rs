//! The charts of the page.

use crate::page::axis::Axis;
use crate::page::plot::{Bar, Plot, Side, bars};
use crate::page::text::{self, millimetres};
use crate::page::{card, longest_stages};
use crate::study::analysis::{Analysis, Row, Validity};
use crate::study::fit::Order;
use crate::study::record::{Role, Study};
use crate::study::table::{error_words, is_reference, times_words};

/// Size of the chart over the whole page.
const WIDE: (f64, f64) = (1160.0, 380.0);

/// Size of the others.
const NARROW: (f64, f64) = (1160.0, 320.0);

/// Position of the triangle of a slope below its line, as a factor on the error of the line.
const BELOW_LINE: f64 = 0.85;

/// Distances below this are rounding and only stretch the axis [m].
const ROUNDING: f64 = 1e-12;

/// Meaning of the letters of stages.
const STAGE_NOTE: &str = "Seconds per frame of the first run of each setting. Stages are numbered as in the paper (Selle \
                          et al. 2009): the neighbour search (A), the velocity solves (B.1, B.5), self-repulsion (B.2, \
                          B.8), collision and friction with bodies (B.4, B.7), self-collision (C).";

/// A line: its class, its name, its points.
type Line = (&'static str, String, Vec<(f64, f64)>);

/// Class of a row's marks, by what it is.
pub(super) fn class(row: &Row<'_>) -> &'static str {
    match (row.sample.role, row.is_sound) {
        (_, false) => "k2",
        (Role::Mesh, _) => "k3",
        _ if row.on_front && row.error.is_some_and(|error| error.validity != Validity::NotConverged) => "k1",
        _ => "k0",
    }
}

fn millimetre_axis(values: impl Iterator<Item = f64>, height: f64) -> Axis {
    Axis::logarithmic(values, Plot::labels_in(height))
}

/// Errors over seconds a frame, with what no setting beats.
pub(super) fn error_over_seconds(study: &Study, analysis: &Analysis<'_>) -> String {
    let valid = |row: &Row<'_>| row.error.filter(|error| error.rms > 0.0 && row.seconds > 0.0);
    let rows: Vec<(usize, &Row<'_>, f64)> = analysis
        .rows
        .iter()
        .enumerate()
        .filter(|(_, row)| !is_reference(row))
        .filter_map(|(number, row)| Some((number, row, valid(row)?.rms)))
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let budget = study.budget;
    let seconds = rows.iter().map(|(_, row, _)| row.seconds).chain(budget);
    let x = Side::new(Axis::logarithmic(seconds, 10), "seconds per frame (median)", &text::seconds);
    let floor = analysis.floor.get(..analysis.window).map(|floor| floor.iter().copied().fold(0.0, f64::max));
    let errors = rows.iter().map(|(_, _, error)| *error);
    let lines = analysis.own.into_iter().filter(|own| *own > 0.0);
    let y = Side::new(
        millimetre_axis(errors.chain(lines), WIDE.1),
        "error, area-weighted RMS over the window",
        &millimetres,
    );
    let mut plot = Plot::new(WIDE, x, y);
    if let Some(own) = analysis.own.filter(|own| *own > 0.0) {
        plot.at_y("dash", own, "self-error of the reference");
    }
    if let Some(budget) = budget {
        plot.at_x("limit", budget, &format!("budget {}", text::seconds(budget)));
    }
    let mut front: Vec<(f64, f64)> =
        rows.iter().filter(|(_, row, _)| row.on_front).map(|(_, row, error)| (row.seconds, *error)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    plot.staircase("stair", &front);
    for (number, row, error) in &rows {
        let tip = format!(
            "{}\n{} per frame ({} x), error {}",
            row.sample.setting.label,
            text::seconds(row.seconds),
            times_words(row.times_base),
            error_words(row.error.as_ref())
        );
        plot.mark(class(row), (row.seconds, *error), &(number + 1).to_string(), &tip);
    }
    let noise = floor.map_or(String::new(), |floor| format!(" Noise floor inside the window: {}.", millimetres(floor)));
    let note =
        format!("Numbers refer to the table. The staircase (Pareto front) is the smallest error for each time.{noise}");
    let legend = [
        ("f1", "no other setting is both faster and more accurate"),
        ("f0", "not on the front, or below what the reference resolves"),
        ("f3", "another mesh"),
        ("f2", "intersections or unconverged solves"),
    ];
    section("Error over seconds", &card("", &note, &legend, &plot.finish("error over seconds per frame")))
}

fn section(title: &str, body: &str) -> String {
    format!("<section><h2>{title}</h2><div class=\"wide\">{body}</div></section>\n")
}

/// The point of a fitted line at a time step.
fn on_line(fit: &Order, dt: f64) -> (f64, f64) {
    (dt, fit.scale * dt.powf(fit.order))
}

/// Errors over time steps, with fitted orders.
pub(super) fn error_over_step(analysis: &Analysis<'_>) -> String {
    if analysis.ladders.is_empty() {
        return String::new();
    }
    let all: Vec<(f64, f64)> = analysis.ladders.iter().flat_map(|ladder| ladder.points.clone()).collect();
    let x = Side::new(Axis::logarithmic(all.iter().map(|point| point.0), 8), "mean time step", &text::seconds);
    let y = Side::new(
        millimetre_axis(all.iter().map(|point| point.1), NARROW.1),
        "error, area-weighted RMS over the window",
        &millimetres,
    );
    let mut plot = Plot::new(NARROW, x, y);
    let mut legend: Vec<(String, String)> = Vec::new();
    for (index, ladder) in analysis.ladders.iter().enumerate() {
        let colour = index % 5 + 1;
        let (fit, points) = (&ladder.fit, &ladder.points);
        let ends = [points.first(), points.last()].into_iter().flatten();
        let ends: Vec<(f64, f64)> = ends.map(|point| on_line(fit, point.0)).collect();
        plot.line(&format!("l{colour}"), &ends);
        for (dt, error) in points {
            let tip = format!("dt {}, error {}", text::seconds(*dt), millimetres(*error));
            plot.mark(&format!("k{colour}"), (*dt, *error), "", &tip);
        }
        let interval = fit.uncertainty.map_or(" (two points)".to_owned(), |half| format!(" ± {half:.2} (95 %)"));
        let name = if ladder.common.is_empty() { "as the scene" } else { &ladder.common };
        legend
            .push((format!("f{colour}"), format!("{name}: order {:.2}{interval}, R² {:.3}", fit.order, fit.r_squared)));
    }
    let longest = analysis.ladders.iter().max_by_key(|ladder| ladder.points.len());
    if let Some((ladder, (coarse, _), (fine, _))) =
        longest.and_then(|ladder| Some((ladder, ladder.points.first()?, ladder.points.last()?)))
    {
        // In the middle third, a little below the line.
        let span = (coarse / fine).powf(1.0 / 3.0);
        let (dt, error) = on_line(&ladder.fit, fine * span);
        plot.slope((dt, error * BELOW_LINE), span, ladder.fit.order);
    }
    let legend: Vec<(&str, &str)> = legend.iter().map(|(class, name)| (class.as_str(), name.as_str())).collect();
    let note = "Settings that differ only in their steps and have an error that the reference resolves. The paper's method is \
                of second order on smooth motion; contact and friction reduce the order towards one.";
    section("Error over time step", &card("", note, &legend, &plot.finish("error over time step")))
}

/// Draws the time of each setting by stage.
pub(super) fn stages(study: &Study, analysis: &Analysis<'_>) -> String {
    let all = study.samples.iter().filter(|sample| sample.is_own() && sample.is_whole());
    let named =
        longest_stages(all.flat_map(|sample| &sample.stages).map(|stage| (stage.stage.as_str(), stage.seconds)));
    let bar = |row: &Row<'_>| {
        let sample = row.sample;
        let frames = sample.cost.frames.max(1) as f64;
        let of = |name: &str| sample.stages.iter().filter(|s| s.stage == name).map(|s| s.seconds).sum::<f64>() / frames;
        let mut parts: Vec<(String, f64, String)> = Vec::new();
        for (index, name) in named.iter().enumerate() {
            parts.push((format!("f{}", index + 1), of(name), format!("{name}: {} per frame", text::seconds(of(name)))));
        }
        let known: f64 = parts.iter().map(|(_, seconds, _)| seconds).sum();
        let rest = (sample.seconds_a_frame() - known).max(0.0);
        parts.push(("f0".to_owned(), rest, format!("other: {} per frame", text::seconds(rest))));
        Bar { name: sample.setting.label.clone(), parts, end: text::seconds(sample.seconds_a_frame()) }
    };
    let rows: Vec<Bar> = analysis.rows.iter().filter(|row| !is_reference(row)).map(bar).collect();
    let classes: Vec<String> = (1..=named.len()).map(|index| format!("f{index}")).collect();
    let mut legend: Vec<(&str, &str)> = classes.iter().map(String::as_str).zip(named.iter().copied()).collect();
    legend.push(("f0", "other"));
    let drawing = bars(WIDE.0, "seconds per frame by stage", &rows);
    section("Where the time goes", &card("", STAGE_NOTE, &legend, &drawing))
}

/// Noise floor, error and own error of the reference over time.
pub(super) fn horizon(study: &Study, analysis: &Analysis<'_>) -> String {
    let time = |frame: usize| study.compared.get(frame).map_or(0.0, |frame| study.time(*frame));
    let series = |values: &[f64]| -> Vec<(f64, f64)> {
        values.iter().enumerate().map(|(frame, value)| (time(frame), *value)).filter(|(_, v)| *v > ROUNDING).collect()
    };
    let mut lines: Vec<Line> = Vec::new();
    if !analysis.floor.is_empty() {
        lines.push((
            "l2",
            "noise floor: shifted copies against the scene as it is".to_owned(),
            series(&analysis.floor),
        ));
    }
    if !analysis.own_error.is_empty() {
        lines.push(("l3", "self-error of the reference".to_owned(), series(&analysis.own_error)));
    }
    let mut errors = |row: Option<&Row<'_>>, class: &'static str, word: &str| {
        if let Some(row) = row.filter(|row| !row.sample.from_reference.is_empty()) {
            let values: Vec<f64> = row.sample.from_reference.iter().map(|distance| distance.rms).collect();
            lines.push((class, format!("{word}: {}", row.sample.setting.label), series(&values)));
        }
    };
    errors(analysis.rows.first(), "l1", "error");
    let accurate = analysis.rows.iter().filter(|row| row.sample.role == Role::Accuracy);
    let valid = |row: &&Row<'_>| row.error.is_some_and(|error| error.validity == Validity::Yes);
    let finest = accurate.filter(valid).min_by(|a, b| {
        let error = |row: &Row<'_>| row.error.map_or(f64::INFINITY, |error| error.rms);
        error(a).total_cmp(&error(b))
    });
    errors(finest, "l4", "smallest error that the reference resolves");
    let values = lines.iter().flat_map(|(_, _, points)| points.iter().map(|point| point.1));
    let all: Vec<f64> = values.chain([study.scene.thickness]).filter(|value| *value > 0.0).collect();
    if lines.is_empty() {
        return String::new();
    }
    let x = Side::new(
        Axis::linear(study.compared.iter().map(|frame| study.time(*frame)), 10),
        "time since the start",
        &text::seconds,
    );
    let y = Side::new(millimetre_axis(all.into_iter(), NARROW.1), "area-weighted RMS distance", &millimetres);
    let mut plot = Plot::new(NARROW, x, y);
    let end = time(analysis.window.saturating_sub(1));
    if analysis.window < study.compared.len() {
        plot.beyond(end);
        plot.at_x("dash", end, "errors are measured up to here");
    }
    if analysis.has_horizon {
        plot.at_x("limit", time(analysis.predictable), "T_p");
    }
    plot.at_y("dash", 0.25 * study.scene.thickness, "a quarter of the thickness");
    for (class, name, points) in &lines {
        plot.line(class, points);
        // A single frame makes no line.
        if let [point] = points.as_slice() {
            plot.mark(&class.replace('l', "k"), *point, "", name);
        }
    }
    let classes: Vec<String> = lines.iter().map(|(class, ..)| class.replace('l', "f")).collect();
    let names = lines.iter().map(|(_, name, _)| name.as_str());
    let legend: Vec<(&str, &str)> = classes.iter().map(String::as_str).zip(names).collect();
    let note = "Copies start with every vertex shifted by 1e-10 of the size of the cloth. Once they drift apart by more than a \
                tenth of the smallest error and more than a quarter of the thickness, the motion is no longer predictable: \
                later errors are grey and in no table.";
    section("Predictability horizon", &card("", note, &legend, &plot.finish("distances over time")))
}
