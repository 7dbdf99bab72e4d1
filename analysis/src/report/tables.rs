//! The tables of the page.

use std::collections::BTreeMap;

use drapery_io::input_file;
use drapery_shot::quality::{INEXACT, RETRIES};
use drapery_shot::run_record::RESOLVED;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::manifest::ManifestGarment;
use drapery_shot::run_record::reader::{EventKind, FrameRow, OverRanks, StageRow};
use drapery_shot::run_record::strains::WorstStrains;

use super::status::Degradation;
use crate::page::table::{Cell, number, section, table, words};
use crate::page::text::{self, escape};

/// Letters of the resolved scene that the page shows at most.
const SCENE_LETTERS: usize = 60_000;

/// Counts that should be zero and are not.
pub(super) fn degradations(run: &RunFolder, found: &[Degradation]) -> String {
    let inexact = inexact(run);
    if found.is_empty() {
        return format!(
            "<section><h2>Degradations</h2><div class=\"card\"><p class=\"none\">None: no limit is exceeded in any \
             frame.</p>{inexact}</div></section>\n"
        );
    }
    let frames = run.record.frames.len().max(1);
    let row = |found: &Degradation| {
        vec![
            (format!("<code>{}</code>", escape(found.name)), false),
            words(found.meaning),
            number(text::count(found.total)),
            number(format!("{} of {frames}", found.frames)),
            number(found.first_frame.to_string()),
            number(found.worst_frame.to_string()),
        ]
    };
    let heads = [
        words("count"),
        words("meaning"),
        number("total"),
        number("frames"),
        number("first frame"),
        number("worst frame"),
    ];
    section("Degradations", &inexact, &heads, &found.iter().map(row).collect::<Vec<_>>())
}

/// A sentence for each count of [`INEXACT`] that is not zero.
fn inexact(run: &RunFolder) -> String {
    let sentence = |&(name, meaning): &(&str, &str)| {
        let total = run.record.frames.iter().fold(0, |sum: u64, row| sum.saturating_add(row.amount(name)));
        let text = format!("<p><code>{name}</code> {}: {}.</p>", text::count(total), escape(meaning));
        (total > 0).then_some(text)
    };
    INEXACT.iter().filter_map(sentence).collect()
}

/// Table of the attempts to mend steps that went wrong; empty without any.
pub(super) fn retries(run: &RunFolder) -> String {
    let frames = &run.record.frames;
    let row = |&(name, words_of_it): &(&str, &str)| {
        let amounts: Vec<(i64, u64)> = frames.iter().map(|row| (row.frame, row.amount(name))).collect();
        let bad: Vec<&(i64, u64)> = amounts.iter().filter(|(_, amount)| *amount > 0).collect();
        let total = bad.iter().fold(0, |sum: u64, (_, amount)| sum.saturating_add(*amount));
        let (first, _) = bad.first()?;
        let cells = vec![
            (format!("<code>{}</code>", escape(name)), false),
            words(words_of_it),
            number(text::count(total)),
            number(format!("{} of {}", bad.len(), frames.len())),
            number(first.to_string()),
            words(troubles(run, name)),
        ];
        Some(cells)
    };
    let rows: Vec<Vec<Cell>> = RETRIES.iter().filter_map(row).collect();
    if rows.is_empty() {
        return String::new();
    }
    let note = "<p>A collision step that fails is rejected and retried, each time more carefully. A step that succeeds on a \
                retry is as good as any other; marks in the result are listed under Degradations.</p>";
    let heads = [
        words("count"),
        words("action"),
        number("total"),
        number("frames"),
        number("first frame"),
        words("cause, from the recorded events"),
    ];
    section("Retried steps", note, &heads, &rows)
}

/// Failures that led to a level of retries, with the number of events of each.
fn troubles(run: &RunFolder, level: &str) -> String {
    let mut found: BTreeMap<&str, (u64, &str)> = BTreeMap::new();
    for event in run.record.frames.iter().flat_map(|row| &row.recoveries).filter(|event| event["rung"] == level) {
        let (trouble, garment) = (event["trouble"].as_str(), event["garment"].as_str());
        let (amount, first) = found.entry(trouble.unwrap_or("unknown")).or_insert((0, ""));
        *amount += 1;
        if first.is_empty() {
            *first = garment.unwrap_or_default();
        }
    }
    let one = |(trouble, (amount, garment)): (&str, (u64, &str))| match garment {
        "" => format!("{trouble} ({amount})"),
        garment => format!("{trouble} ({amount}; garment {garment})"),
    };
    found.into_iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Returns a table of the strain of each garment beside the largest that its fabric takes, in the order in which they appear; nothing
/// for runs without strains.
pub(super) fn strains(rows: &[FrameRow], garments: &[ManifestGarment]) -> String {
    let worst = WorstStrains::of(rows);
    if worst.is_empty() {
        return String::new();
    }
    let percent = |value: f64| format!("{} %", text::digits(100.0 * value));
    let limit_of = |name: &str| garments.iter().find(|garment| garment.name == name)?.strain_limit;
    let line = |WorstStrains { garment, largest, p99_9 }: &WorstStrains| {
        let limit = limit_of(garment).map_or(String::new(), percent);
        let [largest, p99_9] =
            [largest, p99_9].map(|peak| [number(percent(peak.strain)), number(peak.frame.to_string())]);
        [vec![words(garment)], largest.into(), p99_9.into(), vec![number(limit)]].concat()
    };
    let is_beyond = |worst: &&WorstStrains| limit_of(&worst.garment).is_some_and(|limit| worst.exceeds(limit));
    let beyond: Vec<&str> = worst.iter().filter(is_beyond).map(|worst| &*worst.garment).collect();
    let mut note =
        "<p>Strain of edges at the end of each frame (extension divided by rest length): the largest, and the 99.9th \
                    percentile, each in its worst frame; and the largest strain that the fabric takes.</p>"
            .to_owned();
    if !beyond.is_empty() {
        note += &format!(
            "<p>Stretched beyond the limit of the fabric: {}. An empty table <code>[garment.strain_limit]</code> keeps cloth below \
             it where neither pins nor bodies pull it longer; with long steps an <code>extension</code> under \
             <code>[garment.stretch]</code> makes the fabric stiffen.</p>",
            escape(&beyond.join(", "))
        );
    }
    let heads = [
        words("garment"),
        number("largest"),
        number("in frame"),
        number("99.9th percentile"),
        number("in frame"),
        number("limit of the fabric"),
    ];
    section("Strain by garment", &note, &heads, &worst.iter().map(line).collect::<Vec<_>>())
}

/// Returns a table of the time spent in each stage: in a run on several ranks the mean, and the least and the most of
/// one rank.
pub(super) fn stages(rows: &[FrameRow]) -> String {
    let mut totals: Vec<StageRow> = Vec::new();
    for stage in rows.iter().flat_map(|row| &row.stages) {
        match totals.iter_mut().find(|total| total.stage == stage.stage) {
            Some(total) => {
                total.seconds += stage.seconds;
                total.calls += stage.calls;
                if let Some(OverRanks { min, max }) = stage.over_ranks {
                    let total = total.over_ranks.get_or_insert_default();
                    (total.min, total.max) = (total.min + min, total.max + max);
                }
            }
            None => totals.push(stage.clone()),
        }
    }
    let whole: f64 = rows.iter().map(|row| row.seconds).sum();
    let staged: f64 = totals.iter().map(|stage| stage.seconds).sum();
    let mut lines: Vec<Vec<Cell>> =
        totals.iter().map(|stage| stage_row(&stage.stage, stage.seconds, whole, text::count(stage.calls))).collect();
    if !lines.is_empty() {
        let rest = (whole - staged).max(0.0);
        lines.push(stage_row("other: reading, checking, writing", rest, whole, String::new()));
    }
    let mut heads = vec![words("stage"), number("time"), number("share"), words(""), number("calls")];
    if totals.iter().any(|stage| stage.over_ranks.is_some()) {
        heads.extend([number("min over ranks"), number("max over ranks")]);
        let spreads = totals.iter().map(|stage| stage.over_ranks).chain([None]);
        for (line, spread) in lines.iter_mut().zip(spreads) {
            let seconds = |of: fn(&OverRanks) -> f64| spread.as_ref().map_or(String::new(), |s| text::seconds(of(s)));
            line.extend([number(seconds(|s| s.min)), number(seconds(|s| s.max))]);
        }
    }
    let page = section("Time by stage", "", &heads, &lines);
    // The bar is drawn in its own kind of cell.
    page.replace("<td><i style", "<td class=\"bar\"><i style")
}

fn stage_row(name: &str, seconds: f64, whole: f64, calls: String) -> Vec<Cell> {
    let share = 100.0 * seconds / whole.max(f64::MIN_POSITIVE);
    vec![
        words(name),
        number(text::seconds(seconds)),
        number(format!("{share:.1} %")),
        (format!("<i style=\"width:{share:.1}%\"></i>"), false),
        number(calls),
    ]
}

/// Processes that worked on the run, and the checkpoints between them.
pub(super) fn attempts(run: &RunFolder) -> String {
    let frame = |frame: Option<i64>| number(frame.map_or(String::new(), |frame| frame.to_string()));
    let rows: Vec<Vec<Cell>> = run
        .manifest
        .attempts
        .iter()
        .map(|attempt| {
            vec![
                number(attempt.attempt.to_string()),
                words(&attempt.began),
                words(format!("{}:{}", attempt.host, attempt.pid)),
                number(attempt.ranks.max(1).to_string()),
                number(attempt.threads.to_string()),
                frame(Some(attempt.first_frame)),
                frame(attempt.last_frame),
                number(text::seconds(attempt.seconds)),
                words(attempt.end.as_deref().unwrap_or("none: still running, or killed")),
            ]
        })
        .collect();
    let heads = [
        number("attempt"),
        words("started"),
        words("process"),
        number("ranks"),
        number("threads per rank"),
        number("first frame"),
        number("last frame"),
        number("time"),
        words("end"),
    ];
    let attempts = if rows.is_empty() { String::new() } else { table(&heads, &rows) };
    let checkpoints = checkpoints(run);
    if attempts.is_empty() && checkpoints.is_empty() {
        return String::new();
    }
    format!("<section><h2>Attempts and checkpoints</h2><div class=\"card\">{checkpoints}{attempts}</div></section>\n")
}

/// Describes the checkpoints of a run and the time and space that they took.
fn checkpoints(run: &RunFolder) -> String {
    let (mut count, mut seconds, mut slowest, mut largest) = (0_u64, 0.0, 0.0_f64, 0);
    for event in &run.record.events {
        if let EventKind::Checkpoint { seconds: took, bytes } = event.kind {
            count += 1;
            seconds += took;
            slowest = slowest.max(took);
            largest = largest.max(bytes);
        }
    }
    let mut text = String::new();
    if count > 0 {
        let whole: f64 = run.record.frames.iter().map(|row| row.seconds).sum();
        let share = 100.0 * seconds / whole.max(f64::MIN_POSITIVE);
        text += &format!(
            "<p>{} checkpoints written in {} ({share:.1} % of the time of all frames); slowest {}, largest {}.</p>",
            text::count(count),
            text::seconds(seconds),
            text::seconds(slowest),
            text::bytes(largest)
        );
    }
    if let Some(last) = &run.manifest.checkpoint {
        let steps = if last.sub_step == 0 { String::new() } else { format!(" and {} steps", last.sub_step) };
        text += &format!("<p>Latest: frame {}{steps}, <code>{}</code>.</p>", last.frame, escape(&last.file));
    }
    text
}

/// Returns the integrator of a run, and the frames behind which it changed.
fn integrators(run: &RunFolder) -> String {
    let first = run.record.header.integrator.clone();
    let changes = run.record.frames.iter().filter_map(|row| Some((row.frame, row.next_integrator.as_ref()?)));
    changes.fold(first, |text, (frame, next)| format!("{text}, {next} from frame {} on", frame + 1))
}

/// Returns a table of the scene that was run, and of the command and the program that ran it.
pub(super) fn provenance(run: &RunFolder) -> String {
    let manifest = &run.manifest;
    let of_bodies = manifest.bodies.iter().flat_map(|body| &body.files);
    let files = manifest.garments.iter().flat_map(|garment| &garment.files).chain(of_bodies);
    let files: Vec<&str> = files.map(String::as_str).collect();
    let scene = input_file::text(&run.path.join(RESOLVED)).ok();
    let mut facts = vec![
        ("scene", manifest.scene.clone()),
        ("command", manifest.command.clone().unwrap_or_default()),
        ("program", manifest.application.clone()),
        ("integrator", integrators(run)),
        ("threads", manifest.threads.to_string()),
        ("caches", format!("{} (lengths in {}, {} up)", files.join(", "), manifest.length_unit, manifest.up_axis)),
    ];
    if run.record.unreadable > 0 {
        let lines = run.record.unreadable;
        facts.push(("record", format!("{lines} lines of run.jsonl could not be parsed and were skipped")));
    }
    let set = scene.as_deref().map(set_by_hand).unwrap_or_default();
    if !set.is_empty() {
        facts.insert(2, ("set on the command line", set.join("\n")));
    }
    let fact = |(name, text): &(&str, String)| vec![words(name), (format!("<code>{}</code>", escape(text)), false)];
    let facts: Vec<Vec<Cell>> = facts.iter().map(fact).collect();
    let mut page = section("Provenance", "", &[words(""), words("")], &facts);
    let effect = |effect: &drapery_shot::run_record::reader::EffectRow| {
        vec![
            (format!("<code>{}</code>", escape(&effect.effect)), false),
            words(effect.garment.as_deref().unwrap_or("all")),
            words(&effect.because),
            number(text::bytes(effect.bytes)),
        ]
    };
    let effects: Vec<Vec<Cell>> = run.record.header.effects.iter().map(effect).collect();
    let heads = [words("effect"), words("garment"), words("reason"), number("memory")];
    page += &section("Effects, in the order of execution", "", &heads, &effects);
    let totals: Vec<Vec<Cell>> = run
        .record
        .totals()
        .into_iter()
        .map(|(name, total)| vec![(format!("<code>{}</code>", escape(name)), false), number(text::count(total))])
        .collect();
    let mut folded = String::new();
    if !totals.is_empty() {
        let table = table(&[words("count"), number("total of all frames")], &totals);
        folded += &format!("<div class=\"card\"><details><summary>All counts</summary>{table}</details></div>");
    }
    if let Some(scene) = scene {
        let shown: String = scene.chars().take(SCENE_LETTERS).collect();
        let rest = if shown.len() < scene.len() { "\n… the rest is in resolved.toml" } else { "" };
        folded += &format!(
            "<div class=\"card\"><details><summary>Resolved scene, with all defaults</summary><pre>{}{rest}</pre></details></div>",
            escape(&shown)
        );
    }
    page + &format!("<section><h2>Details</h2>{folded}</section>\n")
}

/// Values of the resolved scene that `--set` or `--preset` have set, each with its table.
fn set_by_hand(resolved: &str) -> Vec<String> {
    let (mut table, mut found) = ("", Vec::new());
    for line in resolved.lines() {
        if let Some(name) = line.trim_start_matches('[').strip_suffix(']').filter(|_| line.starts_with('[')) {
            table = name.trim_end_matches(']');
        }
        if let Some((_, parameter)) = line.split_once("# parameter ").filter(|_| line.ends_with("(--set)")) {
            found.push(parameter.trim_end_matches("(--set)").trim_end().to_owned());
        } else if let Some((value, origin)) = line.rsplit_once(" # ")
            && origin == "--set"
        {
            let dot = if table.is_empty() { "" } else { "." };
            found.push(format!("{table}{dot}{}", value.trim_end()));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_shot::run_record::reader::GarmentStrainsRow;

    #[test]
    fn values_that_were_set_by_hand_are_found_with_their_tables() {
        let resolved = "# parameter fabric = \"silk\" (--set)\n# parameter size = 4 (scene)\n[solver]\ncfl = 2   # --set\n\
                        [[garment]]\nmaterial = \"silk\"   # --set fabric\nname = \"a # b\"   # scene\n";
        assert_eq!(set_by_hand(resolved), ["fabric = \"silk\"", "solver.cfl = 2"]);
    }

    #[test]
    fn a_garment_beyond_the_limit_of_its_fabric_is_named_with_what_to_do() {
        let garment =
            |name: &str, strain_limit| ManifestGarment { name: name.into(), strain_limit, ..Default::default() };
        let strains_of = |garment: &str, p99_9| GarmentStrainsRow { garment: garment.into(), largest: 0.2, p99_9 };
        let rows = [0.09, 0.05].map(|p99_9| FrameRow {
            strains: vec![strains_of("skirt", p99_9), strains_of("shirt", p99_9), strains_of("ribbon", p99_9)],
            ..FrameRow::default()
        });
        let garments = [garment("skirt", Some(0.085)), garment("shirt", Some(0.134)), garment("ribbon", None)];
        let page = strains(&rows, &garments);
        assert!(
            page.contains("beyond the limit of the fabric: skirt. An empty") && page.contains(">8.5 %</td>"),
            "{page}"
        );
        assert!(page.contains(">13.4 %</td>"), "{page}");
        assert!(!strains(&rows[1..], &garments).contains("beyond the limit"));
    }

    #[test]
    fn stages_of_several_ranks_show_the_least_and_the_most_of_one() {
        let row = |over_ranks| FrameRow {
            seconds: 2.0,
            stages: vec![StageRow { stage: "dt".into(), seconds: 1.5, calls: 1, over_ranks }],
            ..FrameRow::default()
        };
        assert!(!stages(&[row(None)]).contains("over ranks"));
        let page = stages(&[row(Some(OverRanks { min: 1.0, max: 2.0 })), row(Some(OverRanks { min: 0.5, max: 3.0 }))]);
        let [least, most] = [1.5, 5.0].map(|seconds| format!(">{}</td>", text::seconds(seconds)));
        assert!(page.contains("max over ranks") && page.contains(&(least + "<td class=\"n\"" + &most)), "{page}");
    }
}
