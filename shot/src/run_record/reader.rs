//! Reading `run.jsonl`: one line a frame, and the events between frames.
//!
//! The file may be read while a run writes it, so the last line may be half a line; lines that cannot be understood are
//! counted and passed over. A run that was resumed may have written frames more than once: the last word counts.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::path::Path;

use drapery_io::error::IoError;
use drapery_io::input_file;
use drapery_io::shot_description::FRAMES;
use serde::Deserialize;
use serde_json::Value;

use crate::frame_digest::FrameDigests;
use crate::quality::{RETRIES, is_limit};

/// A whole record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Its first line.
    pub header: Header,
    /// Frames in ascending order, each once; the first is the one at which the simulation started.
    pub frames: Vec<FrameRow>,
    /// Checkpoints, stops and resumes, in the order in which they happened.
    pub events: Vec<Event>,
    /// Frames of which a part was simulated by an attempt whose counts are lost.
    pub partly_counted: BTreeSet<i64>,
    /// Lines that could not be understood; half a line at the end of a record that is being written is none of them.
    pub unreadable: usize,
}

/// Facts that are known before the first frame.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Header {
    /// Program and version.
    pub application: String,
    /// Frame at which the simulation starts, before the first delivered one if there is a pre-roll.
    pub start_frame: Option<i64>,
    /// Integrator of the first frame; empty in records of earlier programs.
    pub integrator: String,
    /// Effects in the order of execution.
    pub effects: Vec<EffectRow>,
}

/// An effect, and why it is there.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct EffectRow {
    /// Its name.
    pub effect: String,
    /// Garment that it acts on; all of them when `None`.
    pub garment: Option<String>,
    /// Part of the scene that asked for it.
    pub because: String,
    /// Memory that it takes.
    pub bytes: u64,
}

/// One frame.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct FrameRow {
    /// Its number.
    pub frame: i64,
    /// Seconds that it took, reading and writing included.
    pub seconds: f64,
    /// Time steps.
    pub steps: u64,
    /// Shortest time step [s].
    pub dt_min: Option<f64>,
    /// Longest time step [s].
    pub dt_max: Option<f64>,
    /// Iterations of conjugate gradients.
    pub cg_iterations: u64,
    /// Most stretched edge.
    pub max_strain: Option<StrainRow>,
    /// Strains of each garment's edges.
    pub strains: Vec<GarmentStrainsRow>,
    /// Most stretched edge between two pinned vertices, if any are neighbours.
    pub strain_between_pins: Option<StrainRow>,
    /// Cloth that is longer than cloth can be, if there is some.
    pub overstretched: Option<OverstretchedRow>,
    /// Energy of motion [J].
    pub kinetic_energy: Option<f64>,
    /// Elastic energy and that of gravity [J].
    pub potential_energy: Option<f64>,
    /// Seconds of the solver's stages, in the order of execution.
    pub stages: Vec<StageRow>,
    /// Counts by name.
    pub counts: BTreeMap<String, u64>,
    /// Memory that the process occupied at the end of the frame.
    pub resident_bytes: Option<u64>,
    /// Recoveries from steps that went wrong, as [`recovery_line`] reads them.
    pub recoveries: Vec<Value>,
    /// Integrator of the frames behind this one, where it changes.
    pub next_integrator: Option<String>,
    /// Digests of what the caches hold of the frame, by garment; empty where none were recorded.
    pub digests: FrameDigests,
    /// The same of the samples between this frame and the next, by their number from 1; they have lines of their own.
    #[serde(skip)]
    pub samples: BTreeMap<u64, FrameDigests>,
}

/// The most stretched edge of a frame.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct StrainRow {
    /// Its garment.
    pub garment: String,
    /// Its ends.
    pub vertices: Vec<u64>,
    /// Extension by rest length.
    pub strain: f64,
}

/// Cloth of a frame that is more than twice as long as at rest.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct OverstretchedRow {
    /// The most stretched edge.
    #[serde(flatten)]
    pub most: StrainRow,
    /// Edges that are more than twice as long.
    pub edges: u64,
    /// Vertices that bodies pinch.
    pub pinched: u64,
    /// Bodies that cross themselves.
    pub bodies: Vec<String>,
}

/// Stretch of a garment's edges at the end of a frame.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct GarmentStrainsRow {
    /// The garment.
    pub garment: String,
    /// Extension of its most stretched edge, by rest length.
    pub largest: f64,
    /// The same of the edge that one in a thousand exceeds.
    pub p99_9: f64,
}

/// Seconds of a stage.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct StageRow {
    /// Its label.
    pub stage: String,
    /// Seconds spent in it.
    pub seconds: f64,
    /// Number of times that it ran.
    pub calls: u64,
    /// Time that the ranks spent in it, where there were several; `seconds` is then the mean.
    pub over_ranks: Option<OverRanks>,
}

/// Seconds of a stage on the ranks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct OverRanks {
    /// On the rank that spent the least.
    pub min: f64,
    /// On the one that spent the most.
    pub max: f64,
}

/// Something that happened between two frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Last frame before it.
    pub frame: i64,
    /// Kind of the event.
    pub kind: EventKind,
}

/// Event that can happen between two frames.
#[derive(Debug, Clone, PartialEq)]
pub enum EventKind {
    /// The state was written to the disk.
    Checkpoint {
        /// Seconds that it took.
        seconds: f64,
        /// Size of the file.
        bytes: u64,
    },
    /// The run stopped early at a valid state, or failed.
    Stop {
        /// Why.
        reason: String,
    },
    /// The run went on from a checkpoint.
    Resume {
        /// Number of the attempt, from 1.
        attempt: u64,
    },
}

impl FrameRow {
    /// A count of the frame. Events of steps that went wrong are counted where their count is missing.
    pub fn amount(&self, name: &str) -> u64 {
        let events = self.recoveries.iter().filter(|event| event["rung"] == name).count() as u64;
        self.counts.get(name).copied().unwrap_or(0).max(events)
    }
}

impl Record {
    /// Reads the record of a run; an empty one if there is none yet.
    ///
    /// # Errors
    /// The file is there and cannot be read.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        match input_file::open(path) {
            Ok(file) => Self::from_lines(path, BufReader::new(file)),
            Err(IoError::Missing { .. }) => Ok(Self::default()),
            Err(error) => Err(error),
        }
    }

    /// Reads lines; see the module.
    fn from_lines(path: &Path, mut reader: impl BufRead) -> Result<Self, IoError> {
        let mut record = Self::default();
        let mut frames = BTreeMap::new();
        let mut line = Vec::new();
        while input_file::read_line(path, &mut reader, &mut line)? {
            let is_whole = line.ends_with(b"\n");
            match serde_json::from_slice(&line) {
                Ok(value) => record.take(value, &mut frames),
                Err(_) => record.unreadable += usize::from(is_whole),
            }
        }
        record.frames = frames.into_values().collect();
        Ok(record)
    }

    fn take(&mut self, line: Value, frames: &mut BTreeMap<i64, FrameRow>) {
        let last = || frames.last_key_value().map_or(0, |(frame, _)| *frame);
        let at = line["frame"].as_i64();
        let kind = line["record"].as_str().unwrap_or_default().to_owned();
        let begins_uncounted = line["counts_lost"] == true;
        let event = match kind.as_str() {
            "header" => {
                // A second header is that of an attempt that went on; it says the same.
                return self.header = serde_json::from_value(line).unwrap_or_default();
            }
            "start" | "frame" => {
                match serde_json::from_value::<FrameRow>(line) {
                    Ok(row) if FRAMES.contains(&row.frame) => drop(frames.insert(row.frame, row)),
                    Ok(_) | Err(_) => self.unreadable += 1,
                }
                return;
            }
            "digests" => {
                let row = at.and_then(|frame| frames.get_mut(&frame));
                match (row, serde_json::from_value(line["digests"].clone())) {
                    (Some(row), Ok(digests)) => row.digests = digests,
                    _ => self.unreadable += 1,
                }
                return;
            }
            "sample" => {
                let row = at.and_then(|frame| frames.get_mut(&frame)).zip(line["sub_frame"].as_u64());
                match (row, serde_json::from_value(line["digests"].clone())) {
                    (Some((row, number)), Ok(digests)) => drop(row.samples.insert(number, digests)),
                    _ => self.unreadable += 1,
                }
                return;
            }
            "checkpoint" => EventKind::Checkpoint {
                seconds: line["seconds"].as_f64().unwrap_or(0.0),
                bytes: line["bytes"].as_u64().unwrap_or(0),
            },
            "stop" => EventKind::Stop { reason: line["reason"].as_str().unwrap_or("unknown").to_owned() },
            "resume" => EventKind::Resume { attempt: line["attempt"].as_u64().unwrap_or(0) },
            "end" if line["state"] == "failed" => {
                EventKind::Stop { reason: line["error"].as_str().unwrap_or("failed").to_owned() }
            }
            _ => return,
        };
        let frame = at.filter(|frame| FRAMES.contains(frame)).unwrap_or_else(last);
        if matches!(event, EventKind::Resume { .. }) {
            // What came after the checkpoint is simulated again.
            frames.split_off(&(frame + 1));
            if line["sub_step"] == 0
                && let Some(row) = frames.get_mut(&frame)
            {
                row.samples.clear();
            }
            self.partly_counted.split_off(&(frame + 1));
            if begins_uncounted {
                self.partly_counted.insert(frame + 1);
            }
        }
        self.events.push(Event { frame, kind: event });
    }

    /// Frames from `first` to `last` whose counts are not known, or only in part, as ranges: lines that are missing or cannot be
    /// understood, and frames that an attempt went on with whose counts were lost.
    pub fn uncounted(&self, first: i64, last: i64) -> Vec<[i64; 2]> {
        let known = |row: &&FrameRow| (first..=last).contains(&row.frame) && !self.partly_counted.contains(&row.frame);
        gaps(first, last, self.frames.iter().filter(known).map(|row| row.frame))
    }

    /// Totals of all counts.
    pub fn totals(&self) -> BTreeMap<&str, u64> {
        let mut totals = BTreeMap::new();
        for (name, amount) in self.frames.iter().flat_map(|row| &row.counts) {
            let total: &mut u64 = totals.entry(name.as_str()).or_default();
            *total = total.saturating_add(*amount);
        }
        totals
    }
}

/// Ranges of the numbers from `first` to `last` that do not come in `present`, which ascends and holds no others.
pub(crate) fn gaps(first: i64, last: i64, present: impl Iterator<Item = i64>) -> Vec<[i64; 2]> {
    let (mut next, mut found) = (first, Vec::new());
    for number in present.chain([last + 1]) {
        if number > next {
            found.push([next, number - 1]);
        }
        next = number + 1;
    }
    found
}

/// Ranges of frames in words, as in `frames 1001-1003, 1007`.
pub fn in_words(ranges: &[[i64; 2]]) -> String {
    let one = |[first, last]: &[i64; 2]| if first == last { first.to_string() } else { format!("{first}-{last}") };
    let is_one = matches!(ranges, [[first, last]] if first == last);
    let word = if is_one { "frame" } else { "frames" };
    format!("{word} {}", ranges.iter().map(one).collect::<Vec<_>>().join(", "))
}

/// The value in the middle, of an even number the upper one; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// Describes a frame in which steps went wrong; returns nothing where none did. Whether a mark of it is left in the
/// result is said, too.
pub(crate) fn recovery_line(row: &FrameRow) -> Option<String> {
    let first = row.recoveries.first()?;
    let word = |key: &str| first[key].as_str().unwrap_or_default();
    let vertices: Vec<u64> = first["vertices"].as_array().into_iter().flatten().filter_map(Value::as_u64).collect();
    let place = match word("garment") {
        "" => String::new(),
        garment => format!(", garment \"{garment}\", vertices {vertices:?}"),
    };
    // The first of a frame are kept, and all are counted.
    let counted = RETRIES.iter().fold(0_u64, |sum, (name, _)| sum.saturating_add(row.amount(name)));
    let more = match counted.max(row.recoveries.len() as u64) - 1 {
        0 => String::new(),
        1 => "; 1 more retry in this frame".to_owned(),
        also => format!("; {also} more retries in this frame"),
    };
    let level = word("rung");
    let done = RETRIES.iter().find(|(name, _)| *name == level).map_or(level, |(_, words)| *words);
    let is_marked = RETRIES.iter().any(|(name, _)| is_limit(name) && row.amount(name) > 0);
    let end = if is_marked { "" } else { "; every step succeeded in the end" };
    let (frame, time) = (first["frame"].as_i64().unwrap_or_default(), first["time"].as_f64().unwrap_or_default());
    let trouble = word("trouble");
    Some(format!("frame {frame}, time {time:.6} s{place}: a step was {done} ({trouble}){more}{end}"))
}

/// A count of every frame in a record; frames that a resumed run came to again count the last time.
pub fn frame_counts(record: &Path, name: &str) -> BTreeMap<i64, u64> {
    let text = input_file::bytes(record).unwrap_or_default();
    let lines = text.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice::<Value>(line).ok());
    lines.filter_map(|line| Some((line["frame"].as_i64()?, line["counts"][name].as_u64()?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(text: &str) -> Record {
        Record::from_lines(Path::new("run.jsonl"), text.as_bytes()).unwrap()
    }

    #[test]
    fn half_a_line_at_the_end_is_no_complaint_and_a_broken_line_inside_is_one() {
        let text = [
            "{\"record\":\"frame\",\"frame\":1,\"steps\":4}",
            "{\"record\":\"frame\",\"fra",
            "{\"record\":\"frame\",\"frame\":2}",
            "{\"rec",
        ];
        let record = record(&text.join("\n"));
        assert_eq!(record.frames.iter().map(|row| row.frame).collect::<Vec<_>>(), [1, 2]);
        assert_eq!((record.frames[0].steps, record.unreadable), (4, 1));
    }

    #[test]
    fn frames_after_the_checkpoint_that_a_run_goes_on_from_count_only_when_they_come_again() {
        let frame = |n: i64, steps: u64| format!("{{\"record\":\"frame\",\"frame\":{n},\"steps\":{steps}}}\n");
        let mut text = frame(1, 1) + "{\"record\":\"checkpoint\",\"frame\":1,\"seconds\":0.5,\"bytes\":7}\n";
        text += &(frame(2, 1) + &frame(3, 1) + "{\"record\":\"stop\",\"reason\":\"signal TERM\"}\n");
        text += "{\"record\":\"resume\",\"frame\":1,\"attempt\":2}\n";
        text += &frame(2, 9);
        let record = record(&text);
        assert_eq!(record.frames.iter().map(|row| (row.frame, row.steps)).collect::<Vec<_>>(), [(1, 1), (2, 9)]);
        let kinds: Vec<_> = record.events.iter().map(|event| (event.frame, event.kind.clone())).collect();
        assert_eq!(kinds[0], (1, EventKind::Checkpoint { seconds: 0.5, bytes: 7 }));
        assert_eq!(kinds[1], (3, EventKind::Stop { reason: "signal TERM".into() }));
        assert_eq!(kinds[2], (1, EventKind::Resume { attempt: 2 }));
    }

    #[test]
    fn frames_without_a_line_and_frames_begun_without_an_account_are_uncounted() {
        let frame = |n: i64| format!("{{\"record\":\"frame\",\"frame\":{n}}}\n");
        let resume = "{\"record\":\"resume\",\"frame\":5,\"sub_step\":3,\"counts_lost\":true}\n";
        let record = record(&(frame(2) + &frame(3) + &frame(5) + resume + &frame(6) + &frame(7)));
        assert_eq!(record.uncounted(1, 8), [[1, 1], [4, 4], [6, 6], [8, 8]]);
        assert_eq!(record.uncounted(2, 3), [[0; 2]; 0]);
        assert_eq!(in_words(&record.uncounted(1, 8)), "frames 1, 4, 6, 8");
        assert_eq!((in_words(&[[7, 9]]).as_str(), in_words(&[[7, 7]]).as_str()), ("frames 7-9", "frame 7"));
    }

    #[test]
    fn samples_belong_to_the_frame_before_them_until_a_run_goes_on_from_it() {
        let frame = |n: i64| format!("{{\"record\":\"frame\",\"frame\":{n}}}\n");
        let sample = |n: i64, number: u64| {
            let digests = "{\"flag\":{\"positions\":\"aa\"}}";
            format!("{{\"record\":\"sample\",\"frame\":{n},\"sub_frame\":{number},\"digests\":{digests}}}\n")
        };
        let text = frame(1) + &sample(1, 1) + &sample(1, 2) + &frame(2) + &sample(2, 1);
        let numbers = |record: &Record| -> Vec<Vec<u64>> {
            record.frames.iter().map(|row| row.samples.keys().copied().collect()).collect()
        };
        assert_eq!(numbers(&record(&text)), [vec![1, 2], vec![1]]);
        let resumed = |sub_step: u64| {
            let resume = format!("{{\"record\":\"resume\",\"frame\":2,\"sub_step\":{sub_step}}}\n");
            numbers(&record(&(text.clone() + &resume)))
        };
        assert_eq!((resumed(3), resumed(0)), (vec![vec![1, 2], vec![1]], vec![vec![1, 2], vec![]]));
        assert_eq!(record(&sample(1, 1)).unreadable, 1, "of a frame that is not there");
    }

    #[test]
    fn numbers_that_json_cannot_hold_are_absent() {
        let record = record("{\"record\":\"frame\",\"frame\":1,\"kinetic_energy\":null,\"dt_min\":0.5}\n");
        assert_eq!((record.frames[0].kinetic_energy, record.frames[0].dt_min), (None, Some(0.5)));
    }

    #[test]
    fn the_median_of_ten_frames_ignores_one_slow_frame() {
        assert_eq!(median(&[1.0, 1.0, 99.0, 1.0, 2.0]), Some(1.0));
        assert_eq!(median(&[]), None);
    }
}
