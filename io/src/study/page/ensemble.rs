//! What can be compared where trajectories cannot: how the cloth is, over copies and over time.

use crate::page::table::{self, Cell, number, words};
use crate::page::text;
use crate::study::analysis::Analysis;
use crate::study::fit::mean_and_deviation;
use crate::study::record::{Figures, Role, Sample, Study};
use crate::study::table::is_reference;

/// Something that the cloth is: its name, its value, how it is written.
type Quantity = (&'static str, fn(&Figures) -> f64, fn(f64) -> String);

/// Everything that is compared.
const QUANTITIES: [Quantity; 9] = [
    ("drape area", |f| f.drape_area, square),
    ("height of the centre", |f| f.centre[1], metres),
    ("kinetic energy", |f| f.kinetic_energy, joules),
    ("potential energy", |f| f.potential_energy, joules),
    ("folds over 30°", |f| f.folds[0], metres),
    ("folds over 60°", |f| f.folds[1], metres),
    ("folds over 90°", |f| f.folds[2], metres),
    ("contact area", |f| f.contact_area[0] + f.contact_area[1], square),
    ("largest strain", |f| f.strain[0], percent),
];

fn square(value: f64) -> String {
    format!("{value:.3} m²")
}

fn metres(value: f64) -> String {
    format!("{value:.3} m")
}

fn joules(value: f64) -> String {
    text::scaled(value, "J")
}

fn percent(value: f64) -> String {
    format!("{:.2} %", 100.0 * value)
}

/// Differences of means that nobody sees, by the mean.
const SAME: f64 = 1e-3;

/// Mean of a quantity over the last compared frames of a run.
fn mean_of(sample: &Sample, from: usize, value: fn(&Figures) -> f64) -> Option<f64> {
    let figures = sample.figures.get(from..).filter(|figures| !figures.is_empty())?;
    Some(figures.iter().map(value).sum::<f64>() / figures.len() as f64)
}

/// The table of all settings against the spread of copies; from the horizon on, or over the second half where there is none.
pub(super) fn section(study: &Study, analysis: &Analysis<'_>) -> String {
    let frames = study.compared.len();
    let from = if analysis.has_horizon { analysis.predictable } else { frames / 2 };
    let is_of_base = |sample: &&Sample| sample.role == Role::Base && sample.repeat == 0 && sample.is_whole();
    let copies: Vec<&Sample> = study.samples.iter().filter(is_of_base).collect();
    if copies.len() < 2 || from >= frames {
        return String::new();
    }
    let spread = |value: fn(&Figures) -> f64| {
        let values: Vec<f64> = copies.iter().filter_map(|copy| mean_of(copy, from, value)).collect();
        let (mean, deviation) = mean_and_deviation(&values);
        (mean, deviation.unwrap_or(0.0), values.len() as f64)
    };
    let mut heads = vec![words("setting")];
    heads.extend(QUANTITIES.iter().map(|(name, ..)| number(*name)));
    let of_copies = |(_, value, write): &Quantity| {
        let (mean, deviation, count) = spread(*value);
        number(format!("{} ± {}", write(mean), write(2.0 * deviation / count.sqrt())))
    };
    let mut lines = vec![vec![words(format!("{} copies, mean ± 2 SE", copies.len()))]];
    lines[0].extend(QUANTITIES.iter().map(of_copies));
    for row in analysis.rows.iter().filter(|row| row.sample.role != Role::Base) {
        let of_row = |(_, value, write): &Quantity| -> Cell {
            let (mean, deviation, _) = spread(*value);
            let Some(found) = mean_of(row.sample, from, *value) else { return number("-") };
            let is_within = (found - mean).abs() <= (2.0 * deviation).max(SAME * mean.abs());
            match (is_within, mean == 0.0) {
                (true, _) => number("="),
                (false, true) => (format!("<b>{}</b>", write(found)), true),
                (false, false) => {
                    let change = 100.0 * (found - mean) / mean.abs();
                    (format!("{} <b>{change:+.1} %</b>", write(found)), true)
                }
            }
        };
        let label = &row.sample.setting.label;
        let mut cells = vec![words(if is_reference(row) { format!("{label} (reference)") } else { label.clone() })];
        cells.extend(QUANTITIES.iter().map(of_row));
        lines.push(cells);
    }
    let first = study.compared.get(from).copied().unwrap_or_default();
    let last = study.compared.last().copied().unwrap_or_default();
    let beyond = if analysis.has_horizon { "beyond the horizon" } else { "the second half: there is no horizon" };
    let note = format!(
        "<p>Means over frames {first} to {last} ({beyond}). = is within a thousandth or two standard deviations of the \
         shifted copies, which cannot be told from them; elsewhere the difference from their mean is given.</p>"
    );
    table::section("How the cloth is, where trajectories cannot be compared", &note, &heads, &lines)
}
