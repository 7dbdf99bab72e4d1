//! Figures of one run beside others.

use std::collections::BTreeMap;
use std::path::PathBuf;

use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::reader::median;

use crate::diff;
use crate::page::text;
use crate::report::status::{degradations, retries};

/// Figures of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct RunFigures {
    /// `done`, `stopped`, `running`, `failed`, or that nothing was run.
    pub(super) state: String,
    /// Frames delivered, and to deliver.
    pub(super) frames: (i64, i64),
    /// Time of all frames [s].
    pub(super) seconds: f64,
    /// Median time of a frame [s].
    pub(super) median: Option<f64>,
    /// The garment with the largest 99.9th percentile of strains, that strain, and the limit of its fabric.
    pub(super) strain: Option<(String, f64, Option<f64>)>,
    /// Total of the counts that should be zero.
    pub(super) degradations: u64,
    /// Retries of failed collision steps.
    pub(super) retries: u64,
    /// Root mean square and largest distance from the first run [m]; `None` where nothing can be compared.
    pub(super) distance: Option<[f64; 2]>,
}

impl RunFigures {
    /// Heads of the cells.
    pub(super) const HEADS: [&'static str; 9] =
        ["state", "frames", "time", "time/frame", "strain", "degradations", "retries", "distance rms", "distance max"];

    /// The figures of a run, beside those of the first.
    pub(super) fn of(run: &RunFolder, first: &RunFolder) -> Self {
        let rows: Vec<_> = run.record.frames.iter().filter(|row| row.steps > 0).collect();
        let seconds: Vec<f64> = rows.iter().map(|row| row.seconds).collect();
        let strains = rows.iter().flat_map(|row| &row.strains);
        let worst = strains.max_by(|a, b| a.p99_9.total_cmp(&b.p99_9));
        let limit = |name: &str| run.manifest.garments.iter().find(|garment| garment.name == name)?.strain_limit;
        Self {
            state: run.manifest.state.to_string(),
            frames: run.delivered(),
            // The sum of nothing is a negative zero.
            seconds: seconds.iter().sum::<f64>() + 0.0,
            median: median(&seconds),
            strain: worst.map(|worst| (worst.garment.clone(), worst.p99_9, limit(&worst.garment))),
            degradations: degradations(run).iter().fold(0, |sum, found| sum.saturating_add(found.total)),
            retries: retries(run).map_or(0, |(total, _)| total),
            distance: distance(run, first),
        }
    }

    /// Each figure as text, in the order of [`Self::HEADS`].
    pub(super) fn cells(&self) -> [String; 9] {
        let percent = |value: f64| format!("{} %", text::digits(100.0 * value));
        let strain = |(garment, strain, limit): &(String, f64, Option<f64>)| {
            let limit = limit.map_or(String::new(), |limit| format!(" of {}", percent(limit)));
            format!("{garment} {}{limit}", percent(*strain))
        };
        let distance =
            |index: usize| self.distance.map_or(String::new(), |distance| text::millimetres(distance[index]));
        [
            self.state.clone(),
            format!("{} of {}", self.frames.0, self.frames.1),
            text::seconds(self.seconds),
            self.median.map_or(String::new(), text::seconds),
            self.strain.as_ref().map_or(String::new(), strain),
            text::count(self.degradations),
            text::count(self.retries),
            distance(0),
            distance(1),
        ]
    }
}

/// Root mean square and largest distance of the vertices of two runs [m], over the first cache of each garment that both have. `None`
/// where a cache cannot be read, meshes differ, or the runs have no frame in common.
fn distance(run: &RunFolder, first: &RunFolder) -> Option<[f64; 2]> {
    let (own, others) = (caches(run), caches(first));
    let (mut squares, mut count, mut most) = (0.0, 0_usize, 0.0_f64);
    for (name, path) in &own {
        let other = others.get(name)?;
        if path == other {
            continue;
        }
        let compared = diff::compare(path, other, 0.0).ok()?;
        for part in compared.parts.iter().filter(|part| part.verdict == diff::Verdict::Differs) {
            // Without distances it is the meshes that differ.
            part.worst.as_ref()?;
            for frame in &part.frames {
                squares += frame.rms * frame.rms;
                count += 1;
                most = most.max(frame.max);
            }
        }
    }
    (!own.is_empty()).then(|| [(squares / count.max(1) as f64).sqrt(), most])
}

/// The first cache of each garment that is there, without render meshes.
fn caches(run: &RunFolder) -> BTreeMap<&str, PathBuf> {
    let simulated = run.manifest.garments.iter().filter(|garment| garment.render_mesh_of.is_none());
    let file = |garment: &&drapery_shot::run_record::manifest::ManifestGarment| {
        garment.files.iter().filter_map(|name| run.cache(name)).find(|path| path.is_file())
    };
    simulated.filter_map(|garment| Some((garment.name.as_str(), file(&garment)?))).collect()
}
