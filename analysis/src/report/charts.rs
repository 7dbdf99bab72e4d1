//! The charts of the page: which figures of a run are drawn, and how several frames become one column.

use drapery_shot::quality::LIMITS;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::reader::{EventKind, FrameRow};

use super::chart::{Chart, Lane};
use super::thin::{Column, columns, largest, mean, smallest};
use crate::page::axis::Axis;
use crate::page::plot::Plot;
use crate::page::text::{self, escape};
use crate::page::{card, longest_stages};

/// Size of the chart over the whole page.
const WIDE: (f64, f64) = (1160.0, 250.0);

/// Size of the others.
const NARROW: (f64, f64) = (560.0, 150.0);

/// Height of charts that share a card.
const LOW: (f64, f64) = (560.0, 92.0);

/// Columns of the wide chart at most.
const WIDE_COLUMNS: usize = 240;

/// Columns of the others at most.
const NARROW_COLUMNS: usize = 140;

/// Contacts that are drawn: count, title.
const CONTACTS: [(&str, &str); 4] = [
    ("repulsions", "repulsions (close pairs of cloth, all passes)"),
    ("collision_hits", "collisions (colliding pairs of cloth)"),
    ("zones", "impact zones"),
    ("body_contacts", "vertices in contact with bodies, summed over steps"),
];

/// All charts of a run that has simulated at least one frame.
pub(super) fn charts(folder: &RunFolder, rows: &[FrameRow]) -> String {
    let narrow = columns(rows, NARROW_COLUMNS);
    let draw = Draw { rows, columns: &narrow };
    let cards = [draw.steps(), draw.time_step(), draw.strain(), draw.energy(), draw.contacts(), draw.memory()];
    let cards: String = cards.into_iter().flatten().collect();
    format!("<div class=\"wide\">{}</div><div class=\"pairs\">{cards}</div>", time(folder, rows))
}

/// Seconds a frame by stage, with marks of what happened.
fn time(folder: &RunFolder, rows: &[FrameRow]) -> String {
    let columns = columns(rows, WIDE_COLUMNS);
    let all = rows.iter().flat_map(|row| &row.stages);
    let stages = longest_stages(all.map(|stage| (stage.stage.as_str(), stage.seconds)));
    let per_stage = |row: &FrameRow, name: &str| -> f64 {
        row.stages.iter().filter(|stage| stage.stage == name).map(|stage| stage.seconds).sum()
    };
    let over = |column: &Column, value: &dyn Fn(&FrameRow) -> f64| -> f64 {
        mean(rows[column.rows.clone()].iter().map(|row| Some(value(row)))).unwrap_or(0.0)
    };
    let totals: Vec<f64> = columns.iter().map(|column| over(column, &|row| row.seconds)).collect();
    let axis = Axis::linear(totals.iter().copied(), Plot::labels_in(WIDE.1));
    let mut chart = Chart::new(WIDE, &columns, axis, text::seconds);
    let mut below = vec![0.0; columns.len()];
    let mut legend: Vec<(String, &str)> = Vec::new();
    for (index, name) in stages.iter().enumerate() {
        let parts = columns.iter().map(|column| over(column, &|row| per_stage(row, name)));
        let above: Vec<f64> = below.iter().zip(parts).map(|(below, part)| below + part).collect();
        chart.steps(&format!("f{}", index + 1), &below, &above);
        legend.push((format!("f{}", index + 1), name));
        below = above;
    }
    let rest: Vec<f64> = below.iter().zip(&totals).map(|(below, total)| total.max(*below)).collect();
    chart.steps("f0", &below, &rest);
    chart.tips(|column| {
        let mut tip = text::frames(column.first, column.last);
        let mean_of = if column.rows.len() > 1 { " per frame" } else { "" };
        tip += &format!(": {}{mean_of}", text::seconds(over(column, &|row| row.seconds)));
        for name in &stages {
            tip += &format!("\n{name}: {}", text::seconds(over(column, &|row| per_stage(row, name))));
        }
        tip
    });
    legend.push(("f0".to_owned(), "other stages, reading, writing"));
    let drawing = chart.finish("seconds per frame by stage", &lanes(folder, rows, &columns));
    let legend: Vec<(&str, &str)> = legend.iter().map(|(class, name)| (class.as_str(), *name)).collect();
    card("Seconds per frame, by stage", &bucketed(&columns, "mean"), &legend, &drawing)
}

/// Says how many frames share a column.
fn bucketed(columns: &[Column], how: &str) -> String {
    match columns.iter().map(|column| column.rows.len()).max() {
        None | Some(0 | 1) => String::new(),
        Some(most) => format!("Each column shows the {how} of up to {most} frames."),
    }
}

/// Rows of marks: degradations, checkpoints, and where the run stopped and went on.
fn lanes(folder: &RunFolder, rows: &[FrameRow], columns: &[Column]) -> Vec<Lane> {
    let at = |frame: i64| columns.partition_point(|column| column.last < frame).min(columns.len() - 1);
    let mut degraded = Lane { name: "degradation", class: "bad", marks: Vec::new() };
    for (index, column) in columns.iter().enumerate() {
        let words: Vec<String> = LIMITS.iter().filter_map(|(name, _)| amount_of(rows, column, name)).collect();
        if !words.is_empty() {
            degraded.marks.push((index, format!("{}\n{}", text::frames(column.first, column.last), words.join("\n"))));
        }
    }
    let mut checkpoints = Lane { name: "checkpoint", class: "m1", marks: Vec::new() };
    let mut attempts = Lane { name: "stop, resume", class: "m2", marks: Vec::new() };
    for event in &folder.record.events {
        let (lane, words) = match &event.kind {
            EventKind::Checkpoint { seconds, bytes } => {
                let (size, time) = (text::bytes(*bytes), text::seconds(*seconds));
                (&mut checkpoints, format!("checkpoint at frame {}: {size} in {time}", event.frame))
            }
            EventKind::Stop { reason } => (&mut attempts, format!("stopped after frame {}: {reason}", event.frame)),
            EventKind::Resume { attempt } => {
                (&mut attempts, format!("attempt {attempt} resumed after frame {}", event.frame))
            }
        };
        let column = at(event.frame);
        match lane.marks.last_mut() {
            Some((last, known)) if *last == column => *known = format!("{known}\n{words}"),
            _ => lane.marks.push((column, words)),
        }
    }
    [degraded, checkpoints, attempts].into_iter().filter(|lane| !lane.marks.is_empty()).collect()
}

fn amount_of(rows: &[FrameRow], column: &Column, name: &str) -> Option<String> {
    let amount: u64 = rows[column.rows.clone()].iter().filter_map(|row| row.counts.get(name)).sum();
    (amount > 0).then(|| format!("{name}: {}", text::count(amount)))
}

/// The charts that share their columns.
struct Draw<'a> {
    rows: &'a [FrameRow],
    columns: &'a [Column],
}

impl Draw<'_> {
    fn over(
        &self,
        reduce: impl Fn(&mut dyn Iterator<Item = Option<f64>>) -> Option<f64>,
        value: impl Fn(&FrameRow) -> Option<f64>,
    ) -> Vec<Option<f64>> {
        let column = |column: &Column| reduce(&mut self.rows[column.rows.clone()].iter().map(&value));
        self.columns.iter().map(column).collect()
    }

    /// A chart with one line through the largest value of each column; `None` when there is nothing to draw.
    fn peaks(
        &self,
        (size, name, class): ((f64, f64), &str, &str),
        axis: fn(&mut dyn Iterator<Item = f64>, usize) -> Axis,
        value: impl Fn(&FrameRow) -> Option<f64>,
        label: impl Fn(f64) -> String,
        tip: impl Fn(&FrameRow) -> String,
    ) -> Option<String> {
        let values = self.over(|v| largest(v), &value);
        values.iter().flatten().next()?;
        let axis = axis(&mut values.iter().flatten().copied(), Plot::labels_in(size.1));
        let mut chart = Chart::new(size, self.columns, axis, label);
        chart.line(class, &values);
        self.tips(&mut chart, |a, b| value(a) >= value(b), tip);
        Some(chart.finish(name, &[]))
    }

    /// Tips that tell of one frame of each column: the first that is at least as `worth` telling of as all others.
    fn tips(
        &self,
        chart: &mut Chart<'_>,
        worth: impl Fn(&FrameRow, &FrameRow) -> bool,
        tip: impl Fn(&FrameRow) -> String,
    ) {
        chart.tips(|column| {
            let rows = self.rows[column.rows.clone()].iter();
            let shown = rows.reduce(|best, next| if worth(best, next) { best } else { next });
            shown.map_or(String::new(), |row| format!("frame {}\n{}", row.frame, tip(row)))
        });
    }

    fn steps(&self) -> Option<String> {
        let label = |value: f64| text::scaled(value, "");
        let tip = |row: &FrameRow| {
            format!("{} time steps, {} iterations", text::count(row.steps), text::count(row.cg_iterations))
        };
        let steps = |row: &FrameRow| Some(row.steps as f64);
        let iterations = |row: &FrameRow| Some(row.cg_iterations as f64);
        let upper = self.peaks((LOW, "time steps per frame", "l1"), counts, steps, label, tip)?;
        let lower = self.peaks((LOW, "solver iterations per frame", "l2"), counts, iterations, label, tip)?;
        let drawing = format!("<h4>time steps</h4>{upper}<h4>iterations of conjugate gradients</h4>{lower}");
        Some(card("Steps and iterations", &bucketed(self.columns, "largest value"), &[], &drawing))
    }

    fn time_step(&self) -> Option<String> {
        let low = self.over(|v| smallest(v), |row| row.dt_min);
        let high = self.over(|v| largest(v), |row| row.dt_max);
        let values = low.iter().chain(&high).flatten().copied();
        values.clone().next()?;
        let axis = Axis::logarithmic_if_wide(values, Plot::labels_in(NARROW.1));
        let mut chart = Chart::new(NARROW, self.columns, axis, text::seconds);
        chart.band("b1", &low, &high);
        chart.line("l1", &low);
        chart.line("l2", &high);
        let shortest = |row: &FrameRow| row.dt_min.unwrap_or(f64::INFINITY);
        self.tips(
            &mut chart,
            |a, b| shortest(a) <= shortest(b),
            |row| {
                let word = |dt: Option<f64>| dt.map_or("unknown".to_owned(), text::seconds);
                format!("dt from {} to {}", word(row.dt_min), word(row.dt_max))
            },
        );
        let drawing = chart.finish("shortest and longest time step", &[]);
        let legend = [("f1", "shortest"), ("f2", "longest")];
        Some(card("Time step dt", &bucketed(self.columns, "range"), &legend, &drawing))
    }

    fn strain(&self) -> Option<String> {
        let value = |row: &FrameRow| row.max_strain.as_ref().map(|strain| 100.0 * strain.strain);
        let label = |value: f64| format!("{} %", text::digits(value));
        let tip = |row: &FrameRow| match &row.max_strain {
            None => "no edges".to_owned(),
            Some(strain) => {
                let ends: Vec<String> = strain.vertices.iter().map(u64::to_string).collect();
                let percent = text::digits(100.0 * strain.strain);
                format!("{percent} % between vertices {} of {}", ends.join(" and "), strain.garment)
            }
        };
        let drawing = self.peaks((NARROW, "largest strain", "l4"), numbers, value, label, tip)?;
        let columns = bucketed(self.columns, "largest value");
        let note =
            format!("Strain of the most stretched edge of all garments: extension divided by rest length. {columns}");
        Some(card("Largest strain", &note, &[], &drawing))
    }

    fn energy(&self) -> Option<String> {
        let kinetic = self.over(|v| mean(v), |row| row.kinetic_energy);
        let potential = self.over(|v| mean(v), |row| row.potential_energy);
        let total = self.over(|v| mean(v), |row| Some(row.kinetic_energy? + row.potential_energy?));
        let values = kinetic.iter().chain(&potential).chain(&total).flatten().copied();
        values.clone().next()?;
        let axis = Axis::linear(values, Plot::labels_in(NARROW.1));
        let label = |value: f64| text::scaled(value, "J");
        let mut chart = Chart::new(NARROW, self.columns, axis, label);
        chart.line("l0", &total);
        chart.line("l2", &potential);
        chart.line("l1", &kinetic);
        self.tips(
            &mut chart,
            |_, _| true,
            |row| {
                let word = |energy: Option<f64>| energy.map_or("unknown".to_owned(), label);
                format!("kinetic {}, potential {}", word(row.kinetic_energy), word(row.potential_energy))
            },
        );
        let drawing = chart.finish("kinetic, potential and total energy", &[]);
        let legend = [("f1", "kinetic"), ("f2", "potential: elastic and gravitational"), ("f0", "sum")];
        Some(card("Energy", &bucketed(self.columns, "mean"), &legend, &drawing))
    }

    fn contacts(&self) -> Option<String> {
        let mut drawing = String::new();
        for (index, (name, title)) in CONTACTS.iter().enumerate() {
            let amount = |row: &FrameRow| row.counts.get(*name).copied();
            // A count that never rose is a line on the ground: it says less than it takes.
            if self.rows.iter().filter_map(amount).all(|amount| amount == 0) {
                continue;
            }
            let value = |row: &FrameRow| amount(row).map(|amount| amount as f64);
            let tip = |row: &FrameRow| format!("{name}: {}", text::count(amount(row).unwrap_or(0)));
            let class = format!("l{}", index + 1);
            let label = |value: f64| text::scaled(value, "");
            if let Some(svg) = self.peaks((LOW, title, &class), counts, value, label, tip) {
                drawing += &format!("<h4>{}</h4>{svg}", escape(title));
            }
        }
        let note = format!("Counts per frame. {}", bucketed(self.columns, "largest value"));
        (!drawing.is_empty()).then(|| card("Contacts", &note, &[], &drawing))
    }

    fn memory(&self) -> Option<String> {
        let most = self.rows.iter().filter_map(|row| row.resident_bytes).max()?;
        // The axis is in the unit of the largest value, so that its labels are round.
        let (unit, word) = text::unit_of_bytes(most);
        let value = |row: &FrameRow| row.resident_bytes.map(|bytes| bytes as f64 / unit);
        let tip = |row: &FrameRow| row.resident_bytes.map_or("unknown".to_owned(), text::bytes);
        let label = |value: f64| format!("{} {word}", text::digits(value));
        let drawing = self.peaks((NARROW, "resident memory", "l5"), numbers, value, label, tip)?;
        let note = format!("Resident memory of the process. {}", bucketed(self.columns, "largest value"));
        Some(card("Memory", &note, &[], &drawing))
    }
}

/// An axis of numbers.
fn numbers(values: &mut dyn Iterator<Item = f64>, wanted: usize) -> Axis {
    Axis::linear(values, wanted)
}

/// An axis of whole numbers.
fn counts(values: &mut dyn Iterator<Item = f64>, wanted: usize) -> Axis {
    Axis::counts(values, wanted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_shot::run_record::reader::StageRow;

    fn row(frame: i64, stages: &[(&str, f64)]) -> FrameRow {
        let stages = stages.iter().map(|(name, seconds)| StageRow {
            stage: (*name).to_owned(),
            seconds: *seconds,
            calls: 1,
            over_ranks: None,
        });
        FrameRow { frame, seconds: 1.0, steps: 2, stages: stages.collect(), ..FrameRow::default() }
    }

    #[test]
    fn marks_stand_at_the_frames_where_limits_were_exceeded() {
        let mut rows: Vec<FrameRow> = (1001..=1004).map(|frame| row(frame, &[("a", 0.5)])).collect();
        rows[2].counts.insert("crossings".into(), 7);
        let columns = columns(&rows, 10);
        let lanes = lanes(&RunFolder::default(), &rows, &columns);
        assert_eq!(lanes.len(), 1);
        assert_eq!(lanes[0].marks, [(2, "frame 1003\ncrossings: 7".to_owned())]);
    }

    #[test]
    fn a_run_of_any_length_has_charts_of_a_bounded_size() {
        let rows: Vec<FrameRow> = (1..=5000).map(|frame| row(frame, &[("a", 0.25), ("b", 0.5)])).collect();
        let page = charts(&RunFolder::default(), &rows);
        assert!(page.len() < 400_000, "{} bytes", page.len());
        assert!(page.contains(">5000</text>") && page.contains("up to 21 frames"));
    }
}
