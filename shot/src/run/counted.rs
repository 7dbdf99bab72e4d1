//! Counts of frames that are done, from the record: an attempt that resumes, or finds nothing to do, reports them for
//! the whole run.

use drapery_io::checkpoint::Head;
use serde_json::Value;

use crate::checkpoints::Loaded;
use crate::overstretched;
use crate::pinned;
use crate::quality::{self, Exceeded};
use crate::run::observer::Observer;
use crate::run::totals::{self, Totals};
use crate::run_record::RECORD;
use crate::run_record::reader::{FrameRow, Record, in_words, recovery_line};
use crate::run_record::strains::WorstStrains;

/// Results that a run has to answer for.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Counted {
    /// Counts that should have stayed zero, in the order in which they rose.
    pub(super) exceeded: Vec<Exceeded>,
    /// Frames whose counts are not known, as ranges.
    pub(super) uncounted: Vec<[i64; 2]>,
    /// Largest strains of each garment.
    pub(super) strains: Vec<WorstStrains>,
    /// The largest strain between pins that was reported.
    reported_strain: f64,
    /// The largest strain of any cloth that was.
    reported_overstretch: f64,
}

impl Counted {
    /// Collects the counts of the frames from `start` to `last`; `note` hears the remarks made on each of them when
    /// it was simulated.
    pub(super) fn of(record: &Record, [start, last]: [i64; 2], note: &mut dyn FnMut(String)) -> Self {
        let mut counted = Self { uncounted: record.uncounted(start, last), ..Self::default() };
        if !counted.uncounted.is_empty() {
            let frames = in_words(&counted.uncounted);
            note(format!("{frames}: counts are unknown, because {RECORD} is incomplete"));
        }
        for row in record.frames.iter().filter(|row| (start..=last).contains(&row.frame)) {
            counted.add(row).into_iter().for_each(&mut *note);
        }
        counted
    }

    /// Adds the line of a frame as it stands in the record, so that the same is said when that is read again.
    pub(super) fn add_line(&mut self, line: Value, frame: i64) -> Vec<String> {
        // A number that JSON has no form for makes the line one that the record is read without.
        let Ok(row) = serde_json::from_value(line) else {
            self.uncounted.push([frame, frame]);
            return Vec::new();
        };
        self.add(&row)
    }

    /// Adds a frame; returns what is to be said of it.
    fn add(&mut self, row: &FrameRow) -> Vec<String> {
        WorstStrains::add(&mut self.strains, row);
        let risen = quality::watch(&mut self.exceeded, row.frame, |name| row.amount(name));
        let limits = risen.iter().map(quality::first_rise);
        let torn = pinned::news(&mut self.reported_strain, row);
        let overstretched = overstretched::news(&mut self.reported_overstretch, row);
        recovery_line(row).into_iter().chain(limits).chain(torn).chain(overstretched).collect()
    }
}

/// Work of a run before this attempt.
#[derive(Default)]
pub(super) struct SoFar {
    /// Totals of that work.
    pub(super) totals: Totals,
    /// Results that it has to answer for.
    pub(super) counted: Counted,
}

impl SoFar {
    /// Up to a checkpoint of a run that started at frame `start`. Counts are those of the record, so that the same ones are found
    /// in it when all is done; times come from the account, or from the record where that is lost.
    pub(super) fn of(found: &Loaded, start: i64, record: &Record, observer: &mut dyn Observer) -> Self {
        let Head { frame, sub_step, .. } = found.checkpoint.head;
        let mut counted = Counted::of(record, [start, frame], &mut |text| observer.note(text));
        let is_lost = found.account.is_none();
        if is_lost {
            let file = found.path.with_extension("json");
            let what = "this file of times and counts is missing or damaged; those of whole frames are in the record";
            observer.note(format!("{}: {what}", file.display()));
        }
        if sub_step > 0 && (is_lost || record.partly_counted.contains(&(frame + 1))) {
            counted.uncounted.push([frame + 1, frame + 1]);
            observer.note(format!("frame {}: counts of its first part are unknown", frame + 1));
        }
        let totals = match &found.account {
            Some(account) => Totals::from_json(&account.totals, frame + 1, sub_step),
            None => totals::of_rows(record.frames.iter().filter(|row| row.frame <= frame), sub_step),
        };
        Self { totals, counted }
    }
}
