//! Settings of a planned run, each with its source.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use clap::ValueEnum;
use drapery_io::checkpoint::Every;
use drapery_shot::Shot;
use serde_json::{Value, json};

use crate::args::PlanArgs;
use crate::config::{DEFAULT, Environment, Limit, Resolved, RunSettings, SITE_FILE};
use crate::plan;
use crate::progress::duration;

/// One thing that is not of the scene: what it is, its value, and who said it.
pub(super) struct Provenance {
    pub(super) what: &'static str,
    pub(super) value: Value,
    pub(super) text: String,
    pub(super) source: &'static str,
}

impl Provenance {
    fn new(what: &'static str, value: Value, source: &'static str) -> Self {
        let text = match &value {
            Value::String(text) => text.clone(),
            Value::Null => "none".to_owned(),
            Value::Array(items) if items.is_empty() => "none".to_owned(),
            other => other.to_string(),
        };
        Self { what, value, text, source }
    }
}

/// Everything, in the order in which it is shown.
pub(super) fn all(
    args: &PlanArgs,
    around: &Environment,
    settings: &RunSettings,
    (shot, threads): (&Shot, &Resolved<usize>),
) -> Vec<Provenance> {
    let out = match &args.settings.out {
        Some(out) => Provenance::new("out", path(out), "--out"),
        None => Provenance::new("out", path(&plan::default_folder(shot)), DEFAULT),
    };
    let config = match &around.site_path {
        Some(file) => Provenance::new("config", path(&file.value), file.source),
        None => Provenance::new("config", Value::Null, DEFAULT),
    };
    let RunSettings { progress, resumable_exit_code: code, on_term, checkpoint_every: every, keep, limits } = settings;
    let mut all = vec![
        out,
        config,
        Provenance::new("threads", json!(threads.value), threads.source),
        Provenance::new("progress", word(progress.value), progress.source),
        Provenance::new("resumable_exit_code", json!(code.value), code.source),
        Provenance::new("on_term", word(on_term.value), on_term.source),
        Provenance::new("checkpoint_every", json!(every_text(every.value)), every.source),
        Provenance::new("keep", json!(keep.value), keep.source),
    ];
    all.extend(limits.iter().map(limit));
    let search = around.search(&args.scene.materials);
    let folders = search.value.materials.iter().map(|folder| path(folder)).collect();
    all.push(Provenance::new("materials", folders, search.source));
    if !search.value.maps.pairs().is_empty() {
        let maps = search.value.maps.pairs();
        let text: Vec<String> = maps.iter().map(|(from, to)| format!("{from}/ -> {to}/")).collect();
        let value: serde_json::Map<String, Value> = maps.iter().map(|(from, to)| (from.clone(), json!(to))).collect();
        all.push(Provenance { text: text.join(", "), ..Provenance::new("paths", value.into(), SITE_FILE) });
    }
    all
}

/// A path; what of it is not UTF-8 cannot be said in JSON.
fn path(path: &Path) -> Value {
    path.to_string_lossy().into()
}

/// A limit of time: a span in seconds, or seconds since 1970.
fn limit(limit: &Resolved<Limit>) -> Provenance {
    let (what, seconds, text) = match limit.value {
        Limit::After(time) => ("max_wall", time.as_secs_f64(), duration(time.as_secs_f64())),
        Limit::At(key, _, at) => {
            let seconds = at.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
            let left = at.duration_since(SystemTime::now()).unwrap_or_default().as_secs_f64();
            (key, seconds, format!("{seconds} (in {})", duration(left)))
        }
    };
    Provenance { text, ..Provenance::new(what, json!(seconds), limit.source) }
}

fn every_text(every: Every) -> String {
    match every {
        Every::Auto => "auto".to_owned(),
        Every::Frames(frames) => format!("{frames}f"),
        Every::Seconds(seconds) => format!("{seconds}s"),
    }
}

/// The word of the command line.
fn word(value: impl ValueEnum) -> Value {
    value.to_possible_value().map_or(Value::Null, |word| json!(word.get_name()))
}
