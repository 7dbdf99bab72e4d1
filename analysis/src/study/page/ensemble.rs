//! Quantities that can be compared where trajectories cannot: properties of the cloth, over copies and over time.

use crate::page::table::{self, Cell, number, words};
use crate::page::text::{self, escape};
use crate::study::analysis::Analysis;
use crate::study::fit::mean_and_deviation;
use crate::study::record::{Figures, Role, Sample, Study};
use crate::study::table::is_reference;

/// Something that the cloth is: its name and unit, its value in that unit, and decimals.
type Quantity = (&'static str, fn(&Figures) -> f64, usize);

/// Everything that is compared.
const QUANTITIES: [Quantity; 9] = [
    ("drape area, m²", |f| f.drape_area, 3),
    ("height of the centre, m", |f| f.centre[1], 4),
    ("kinetic energy, mJ", |f| f.kinetic_energy * 1e3, 2),
    ("potential energy, J", |f| f.potential_energy, 4),
    ("folds over 30°, m", |f| f.folds[0], 2),
    ("folds over 60°, m", |f| f.folds[1], 2),
    ("folds over 90°, m", |f| f.folds[2], 2),
    ("contact area, m²", |f| f.contact_area[0] + f.contact_area[1], 3),
    ("largest strain, %", |f| f.strain[0] * 100.0, 2),
];

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
    // What the cloth never has, such as sharp folds in flat cloth, is no column.
    let is_there = |(_, value, _): &&Quantity| study.samples.iter().any(|s| s.figures.iter().any(|f| value(f) != 0.0));
    let quantities: Vec<&Quantity> = QUANTITIES.iter().filter(is_there).collect();
    let mut heads = vec![words("setting")];
    heads.extend(quantities.iter().map(|(name, ..)| number(*name)));
    let of_copies = |(_, value, decimals): &&Quantity| {
        let (mean, deviation, count) = spread(*value);
        let error = 2.0 * deviation / count.sqrt();
        let error = if error < SAME * mean.abs() { "< 0.1 %".to_owned() } else { format!("{error:.decimals$}") };
        number(format!("{mean:.decimals$} ± {error}"))
    };
    let mut lines = vec![vec![words(format!("as the scene: {} copies, mean ± 2 SE", copies.len()))]];
    lines[0].extend(quantities.iter().map(of_copies));
    let mut alike: Vec<&str> = Vec::new();
    for row in analysis.rows.iter().filter(|row| row.sample.role != Role::Base && !is_reference(row)) {
        let mut differs = false;
        let mut of_row = |(_, value, decimals): &&Quantity| -> Cell {
            let (mean, deviation, _) = spread(*value);
            let Some(found) = mean_of(row.sample, from, *value) else { return number("-") };
            if (found - mean).abs() <= (2.0 * deviation).max(SAME * mean.abs()) {
                return number("=");
            }
            differs = true;
            if mean == 0.0 {
                return (format!("<b>{found:.decimals$}</b>"), true);
            }
            let change = 100.0 * (found - mean) / mean.abs();
            (format!("{found:.decimals$} <b>{change:+.1} %</b>"), true)
        };
        let cells: Vec<Cell> = quantities.iter().map(&mut of_row).collect();
        let label = &row.sample.setting.label;
        if differs {
            lines.push([vec![words(label)], cells].concat());
        } else {
            alike.push(label);
        }
    }
    let first = study.compared.get(from).copied().unwrap_or_default();
    let last = study.compared.last().copied().unwrap_or_default();
    let over = text::frames(first, last);
    let beyond = if analysis.has_horizon { "beyond the horizon" } else { "the second half: there is no horizon" };
    let same = match alike.is_empty() {
        true => String::new(),
        false => format!(" Settings without a difference in any column: {}.", escape(&alike.join("; "))),
    };
    let note = format!(
        "<p>Means over {over} ({beyond}). The sign = marks values within a thousandth or two standard deviations of the \
         shifted copies, so indistinguishable from theirs; others have their difference from the mean of the copies.{same}</p>"
    );
    table::section("Statistics of the cloth, independent of single folds", &note, &heads, &lines)
}
