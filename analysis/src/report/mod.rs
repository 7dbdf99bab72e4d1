//! Information from a run folder: its state for `drapery status`, and the page of `drapery report`.
//!
//! The page is one file that needs nothing else: no script, no font, no picture from elsewhere. Charts are SVG whose
//! colours follow the reader's light or dark style; what a column stands for is in its tooltip. The same folder gives
//! the same bytes.

pub mod status;

mod bodies;
mod chart;
mod charts;
mod contact_sheet;
mod raster;
mod tables;
mod thin;

use std::path::{Path, PathBuf};

use drapery_io::atomic_file;
use drapery_io::error::IoError;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::reader::{FrameRow, median};

use crate::page::text::{self, escape};
use crate::page::{document, tile};

use status::{Degradation, degradations, retries};

/// File name of the page, in the folder of the run.
pub const PAGE: &str = "report.html";

/// Writes the page about a run into its folder, and says where.
///
/// # Errors
/// The folder holds no run, its manifest or record cannot be read, or the page cannot be written.
pub fn write(folder: &Path) -> Result<PathBuf, IoError> {
    let run = RunFolder::read(folder)?;
    let path = folder.join(PAGE);
    atomic_file::replace(&path, page(&run).as_bytes())?;
    Ok(path)
}

/// The page about a run.
pub fn page(run: &RunFolder) -> String {
    // Nothing is simulated at the start, so it would only spoil the scales.
    let rows: Vec<FrameRow> = run.record.frames.iter().filter(|row| row.steps > 0).cloned().collect();
    let found = degradations(run);
    let title = if run.manifest.shot.is_empty() { "run" } else { &run.manifest.shot };
    let mut body = header(run, title);
    body += &tiles(run, &rows, &found);
    body += &contact_sheet::sheet(run);
    body += "<section><h2>Over the frames</h2><p>Point at a column for its figures.</p>";
    body += &if rows.is_empty() { "<p>No frame is simulated yet.</p>".to_owned() } else { charts::charts(run, &rows) };
    body += "</section>";
    body += &tables::degradations(run, &found);
    body += &tables::retries(run);
    body += &tables::strains(&rows);
    body += &tables::stages(&rows);
    body += &tables::attempts(run);
    body += &tables::provenance(run);
    let made = format!(
        "Made by drapery report from {} and {}.",
        drapery_shot::run_record::MANIFEST,
        drapery_shot::run_record::RECORD
    );
    let materials = materials(run);
    let of_what = if materials.is_empty() { title.to_owned() } else { format!("{title}, {materials}") };
    document(&format!("{of_what}: Drapery run"), &body, &made)
}

/// Materials of the garments, each once.
fn materials(run: &RunFolder) -> String {
    let mut names: Vec<&str> = Vec::new();
    for name in run.manifest.garments.iter().filter_map(|garment| garment.material.as_deref()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names.join(", ")
}

fn header(run: &RunFolder, title: &str) -> String {
    let manifest = &run.manifest;
    let garments: Vec<String> = manifest
        .garments
        .iter()
        .map(|garment| {
            let material = garment.material.as_ref().map_or(String::new(), |material| format!("{material}, "));
            format!("{} ({material}{} points)", garment.name, text::count(garment.points as u64))
        })
        .collect();
    let (first, last) = (manifest.first_frame, manifest.last_frame);
    let rate = manifest.fps.strip_suffix("/1").unwrap_or(&manifest.fps);
    let mut header = format!(
        "<header><h1>{} <span class=\"state {state}\">{state}</span></h1>\
         <p>frames {first} to {last} at {} fps · {} · {}</p>",
        escape(title),
        escape(rate),
        escape(&garments.join(", ")),
        if manifest.threads == 1 { "1 thread".to_owned() } else { format!("{} threads", manifest.threads) },
        state = escape(&manifest.state),
    );
    let attempts = manifest.attempts.iter().filter(|attempt| !attempt.began.is_empty());
    if let Some(first) = attempts.map(|attempt| &attempt.began).next() {
        header += &format!("<p>begun {}</p>", escape(first));
    }
    if let Some(error) = &manifest.error {
        header += &format!("<pre>{}</pre>", escape(error));
    }
    if let (Some(command), true) = (&manifest.command, manifest.state != "done") {
        header += &format!("<p>To resume: <code>{}</code></p>", escape(command));
    }
    header + "</header>\n"
}

/// The figures that matter most.
fn tiles(run: &RunFolder, rows: &[FrameRow], found: &[Degradation]) -> String {
    let (done, total) = run.delivered();
    let whole: f64 = run.record.frames.iter().map(|row| row.seconds).sum();
    let seconds: Vec<f64> = rows.iter().map(|row| row.seconds).collect();
    let slowest = rows.iter().max_by(|a, b| a.seconds.total_cmp(&b.seconds));
    let mut tiles = tile("", &format!("{done} of {total}"), "frames complete");
    let note =
        slowest.map_or(String::new(), |row| format!("; longest {} in frame {}", text::seconds(row.seconds), row.frame));
    tiles += &tile("", &text::seconds(whole), "time of all frames");
    if let Some(median) = median(&seconds) {
        tiles += &tile("", &text::seconds(median), &format!("median of a frame{note}"));
    }
    let strain = |row: &&FrameRow| row.max_strain.as_ref().map_or(f64::NEG_INFINITY, |strain| strain.strain);
    let most = rows.iter().max_by(|a, b| strain(a).total_cmp(&strain(b)));
    if let Some((frame, strain)) = most.and_then(|row| Some((row.frame, row.max_strain.as_ref()?))) {
        let value = format!("{} %", text::digits(100.0 * strain.strain));
        tiles += &tile("", &value, &format!("largest strain, {} in frame {frame}", strain.garment));
    }
    let count: u64 = found.iter().map(|degradation| degradation.total).sum();
    let frames = found.iter().map(|degradation| degradation.first_frame).min();
    tiles += &match frames {
        Some(first) => tile("alarm", &text::count(count), &format!("degradations, first in frame {first}")),
        None => tile("fine", "0", "degradations: every limit is kept"),
    };
    if let Some((amount, first)) = retries(run) {
        let what = format!("attempts at steps that went wrong, all mended, first in frame {first}");
        tiles += &tile("", &text::count(amount), &what);
    }
    if let Some(peak) = rows.iter().filter_map(|row| row.resident_bytes).max() {
        tiles += &tile("", &text::bytes(peak), "most memory, resident");
    }
    format!("<div class=\"tiles\">{tiles}</div>\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_shot::run_record::reader::{Event, EventKind};

    fn run(frames: i64) -> RunFolder {
        let mut run = RunFolder::default();
        run.manifest.shot = "a <b> & \"c\"".into();
        run.manifest.state = "stopped".into();
        run.manifest.command = Some("drapery run 's.toml'".into());
        (run.manifest.first_frame, run.manifest.last_frame) = (1001, 1000 + frames);
        for frame in 1001..=1000 + frames {
            let counts = [("crossings".to_owned(), u64::from(frame == 1003)), ("zones".to_owned(), 5)];
            run.record.frames.push(FrameRow {
                frame,
                seconds: 2.0,
                steps: 8,
                dt_min: Some(1e-6),
                dt_max: Some(4e-3),
                kinetic_energy: Some(1.0),
                potential_energy: Some(-3.0),
                counts: counts.into(),
                resident_bytes: Some(1 << 30),
                ..FrameRow::default()
            });
        }
        run.record.events.push(Event { frame: 1002, kind: EventKind::Checkpoint { seconds: 0.1, bytes: 1 << 20 } });
        run
    }

    #[test]
    fn the_page_needs_nothing_else_and_is_made_of_closed_elements() {
        let page = page(&run(12));
        for word in ["http", "<script", "javascript", "url(", "@import"] {
            assert!(!page.contains(word), "{word}");
        }
        assert!(page.contains("a &lt;b&gt; &amp; &quot;c&quot;") && !page.contains("a <b>"));
        for element in ["main", "section", "figure", "div", "svg", "table", "tr", "td", "ul", "li", "text", "title"] {
            let opened = page.matches(&format!("<{element}>")).count() + page.matches(&format!("<{element} ")).count();
            assert_eq!(opened, page.matches(&format!("</{element}>")).count(), "{element}");
        }
    }

    #[test]
    fn what_was_degraded_stands_at_its_frame_and_what_was_not_is_said() {
        let bad = page(&run(12));
        assert!(bad.contains("degradations, first in frame 1003") && bad.contains("frame 1003\ncrossings: 1"));
        let good = page(&run(2));
        assert!(good.contains("every limit is kept"), "{good}");
    }

    #[test]
    fn steps_that_were_mended_are_told_apart_from_those_that_were_not() {
        let mut run = run(2);
        let event = |level: &str| serde_json::json!({"trouble": "solve diverged", "rung": level, "garment": "skirt"});
        run.record.frames[0].counts.insert("retried_shorter".into(), 3);
        run.record.frames[0].recoveries = vec![event("retried_shorter")];
        let mended = page(&run);
        assert!(
            mended.contains("every limit is kept") && mended.contains("all mended, first in frame 1001"),
            "{mended}"
        );
        assert!(mended.contains("<code>retried_shorter</code>") && mended.contains("solve diverged"), "{mended}");
        // What left a mark is a degradation, also where only its event is there.
        run.record.frames[1].recoveries = vec![event("retried_held")];
        let marked = page(&run);
        assert!(marked.contains("degradations, first in frame 1002"), "{marked}");
    }

    #[test]
    fn pages_of_two_materials_differ_and_say_what_was_typed_and_when() {
        use drapery_shot::run_record::manifest::{AttemptRecord, ManifestGarment};
        let of = |material: &str| {
            let mut run = run(2);
            let garment =
                ManifestGarment { name: "sheet".into(), material: Some(material.into()), ..Default::default() };
            run.manifest.garments = vec![garment];
            run.manifest.command = Some(format!("drapery run s.toml --set fabric={material}"));
            run.manifest.state = "done".into();
            let began = "2026-05-04 09:30:00 UTC".to_owned();
            run.manifest.attempts = vec![AttemptRecord { attempt: 1, began, ..Default::default() }];
            page(&run)
        };
        let (silk, wool) = (of("silk_light"), of("wool"));
        assert!(
            silk.contains(", silk_light: Drapery run</title>") && wool.contains(", wool: Drapery run</title>"),
            "{silk}"
        );
        assert!(silk.contains("--set fabric=silk_light") && silk.contains("2026-05-04 09:30:00 UTC"), "{silk}");
    }

    #[test]
    fn a_run_of_2400_frames_makes_a_page_of_less_than_a_megabyte_without_pictures() {
        let page = page(&run(2400));
        assert!(page.len() < 1 << 20, "{} bytes", page.len());
        assert!(page.contains("1 GiB") && page.contains("To resume: <code>drapery run &#39;s.toml&#39;</code>"));
    }

    #[test]
    fn a_run_without_frames_has_a_page() {
        assert!(page(&RunFolder::default()).contains("No frame is simulated yet"));
    }
}
