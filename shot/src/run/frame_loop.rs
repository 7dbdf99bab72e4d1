//! The frame loop: starts, goes on where an earlier attempt stopped, and stops when it is asked to.
//!
//! Frames come from inputs through the solver into the caches. At states free of collisions the loop looks for requests to
//! stop and for checkpoints that are due; it resumes from a checkpoint with the same bits as if it had never stopped.

use std::collections::BTreeSet;
use std::time::{Instant, SystemTime};

use drapery_core::error::StepError;
use drapery_core::metrics::Metrics;
use drapery_core::simulation::FrameSummary;
use drapery_io::checkpoint::{FORMAT_VERSION, Head};
use drapery_io::duration::utc;
use drapery_io::error::IoError;
use drapery_io::input_file;
use serde_json::json;

use crate::checkpoints::{Account, Cadence, Loaded, Store};
use crate::error::ShotError;
use crate::farm::command_line::quoted;
use crate::farm::digest::Fingerprint;
use crate::farm::last_words;
use crate::farm::lock::RunLock;
use crate::farm::stale;
use crate::farm::stop::{Reason, Request};
use crate::frame_digest::FrameDigests;
use crate::long_frames::Watch;
use crate::run::belts;
use crate::run::counted::{Counted, SoFar};
use crate::run::dump::{self, Dump};
use crate::run::folder::{Earlier, Held, files_of_run, refuse_inputs};
use crate::run::input_watch::InputWatch;
use crate::run::observer::{FrameReport, Observer, Outcome, RunReport};
use crate::run::options::{Resume, RunOptions};
use crate::run::output::{From, Output, Start, check_resume, manifest_checkpoint};
use crate::run::output::{planned_files, planned_layers, planned_outputs};
use crate::run::reserve::Reserve;
use crate::run::totals::{Partial, Totals};
use crate::run::{bundle, resume};
use crate::run_record::RECORD;
use crate::run_record::manifest::{AttemptRecord, former_files, listed_files};
use crate::run_record::reader::Record;
use crate::run_record::strains::beyond_fabric;
use crate::run_record::writer::{SIMULATE, frame_record, sample_record, start_record};
use crate::shot::Shot;
use crate::towards_frame::{Reached, towards_frame};
use crate::written_faces::OtherCut;

/// A run in progress.
struct Run<'a> {
    shot: Shot,
    options: &'a RunOptions,
    fingerprint: Fingerprint,
    output: Output,
    store: Store,
    lock: RunLock,
    /// Room to say that the run failed.
    reserve: Option<Reserve>,
    cadence: Cadence,
    clock: Instant,
    attempt: u32,
    totals: Totals,
    /// Counts of the frames so far that should have stayed zero.
    counted: Counted,
    /// Whether it begins at the first frame.
    is_new: bool,
    /// Writer of the cloth after lines of the listings, if it is written.
    dump: Option<Dump>,
    /// Objects of which it was said that they cross along other diagonals.
    reported_cuts: BTreeSet<(String, String, bool)>,
    /// Frame and step of the last checkpoint that tells of the caches as they are.
    saved: Option<(i64, u64)>,
    inputs: InputWatch,
}

impl Shot {
    /// Simulates and writes all frames that are not there yet; `observer` hears of each when it is on the disk.
    ///
    /// # Errors
    /// The folder holds another run, is in use or cannot be written; an input breaks; the solver gives up. Frames before
    /// stay valid.
    pub fn run(self, options: &RunOptions, observer: &mut dyn Observer) -> Result<RunReport, ShotError> {
        if options.out.to_str().is_none() {
            return Err(IoError::OutputNotUtf8 { path: options.out.clone() }.into());
        }
        dump::refuse_unreachable(&options.dump, [self.about.timeline.start + 1, self.about.last_frame])?;
        options.refuse_pins_outside([self.about.timeline.start, self.about.scene_last_frame])?;
        // An earlier run's caches give way to those of this one.
        let planned = planned_outputs(&self, &options.out);
        let [listed, former] = [listed_files(&options.out), former_files(&options.out)];
        refuse_inputs(&self, &[planned.as_slice(), &listed, &former].concat())?;
        if !options.overwrite {
            files_of_run(&options.out, &planned).iter().try_for_each(|file| input_file::check(file))?;
        }
        let inputs = InputWatch::new(&self.about.input_files);
        let fingerprint = self.fingerprint()?;
        let earlier = Earlier::unless_replaced(options)?;
        let (mut notes, mut changed) = (Vec::new(), Vec::new());
        if let Some(earlier) = &earlier {
            changed = resume::changes(earlier, &options.out, &fingerprint, &mut |text| notes.push(text));
        }
        let forbidden = !changed.is_empty() && !options.with_changes && !matches!(options.resume, Resume::Never);
        if forbidden {
            return Err(resume::refusal(earlier.as_ref(), &options.out, changed));
        }
        resume::refuse_others(&self, options, earlier.as_ref())?;
        if changed.is_empty() && resume::is_complete(&self, options, earlier.as_ref(), &fingerprint) {
            return self.nothing_to_do(options, observer);
        }
        let mut run = Run::prepare(self, options, (fingerprint, inputs), (changed, notes), observer)?;
        dump::passed_over(&options.dump, run.shot.simulation().frame())
            .into_iter()
            .for_each(|text| observer.note(text));
        let ended = run.all(observer);
        run.dump.iter().for_each(|dump| dump.report(observer));
        match ended {
            Ok(outcome) => run.end(outcome),
            Err(error) => {
                // The first error is the one that counts. What was taken over belongs to somebody else.
                if run.lock.still_mine() {
                    run.leave_bundle(&error, observer);
                    run.fail(&error);
                }
                // Where the folder is gone, whatever was to be written into it next could not be found.
                Err(match (error, run.lock.check()) {
                    (ShotError::Io(_), Err(gone)) => gone.into(),
                    (error, _) => error,
                })
            }
        }
    }

    /// Says of the run what was said when it was made; its record tells.
    fn nothing_to_do(&self, options: &RunOptions, observer: &mut dyn Observer) -> Result<RunReport, ShotError> {
        let record = Record::read(&options.out.join(RECORD))?;
        let frames = [self.about.timeline.start, self.about.last_frame];
        dump::nothing_left(&options.dump, self.about.last_frame).into_iter().for_each(|text| observer.note(text));
        let Counted { exceeded, uncounted, strains, .. } =
            Counted::of(&record, frames, &mut |text| observer.note(text));
        Ok(RunReport {
            outcome: Outcome::NothingToDo,
            frame: self.about.last_frame,
            metrics: Metrics::default(),
            seconds: 0.0,
            frames: self.delivered_frames(),
            files: planned_files(self, &options.out).into_iter().chain(self.single_layer(&options.out)).collect(),
            layers: planned_layers(self, &options.out),
            exceeded,
            uncounted,
            beyond_fabric: beyond_fabric(&strains, &self.about.garments, &self.about.fabrics),
            ranks: self.remote_simulation.ranks().count(),
        })
    }

    fn delivered_frames(&self) -> u64 {
        self.about.last_frame.abs_diff(self.about.first_frame) + 1
    }

    /// Head of the record: what will run.
    pub(super) fn header(&self, threads: usize) -> serde_json::Value {
        let timeline = self.about.timeline;
        let effect = |effect: &drapery_core::effects::PlannedEffect| {
            let (garment, because) = (&effect.garment, &effect.because);
            json!({"effect": effect.name, "garment": garment, "because": because, "bytes": effect.bytes})
        };
        json!({
            "record": "header",
            "application": drapery_io::cache::APPLICATION,
            "shot": self.about.name,
            "scene": self.about.scene_path.to_string_lossy(),
            "fps": [timeline.fps_numerator, timeline.fps_denominator],
            "start_frame": timeline.start,
            "first_frame": self.about.first_frame,
            "last_frame": self.about.last_frame,
            "threads": threads,
            "ranks": self.remote_simulation.ranks().count(),
            "origin": <[f64; 3]>::from(self.origin()),
            "integrator": self.simulation().scene().description().solver.integrator.word(),
            "effects": self.simulation().plan().iter().map(effect).collect::<Vec<_>>(),
        })
    }
}

impl<'a> Run<'a> {
    /// Takes the folder and brings the simulation to where the run begins.
    fn prepare(
        mut shot: Shot,
        options: &'a RunOptions,
        (fingerprint, inputs): (Fingerprint, InputWatch),
        (changes, notes): (Vec<String>, Vec<String>),
        observer: &mut dyn Observer,
    ) -> Result<Self, ShotError> {
        let out = &options.out;
        let Held { owner, lock, attempt, store } = Held::take(options, notes, observer)?;
        // Read again under the lock: another run may have gone on in the meantime.
        let earlier = Earlier::unless_replaced(options)?;
        let record = earlier.as_ref().map(|_| Record::read(&out.join(RECORD))).transpose()?;
        let note = &mut |text| observer.note(text);
        let mut found = resume::decide(&shot, options, (record.as_ref(), &fingerprint), &store, note)?;
        if let Some(found) = &mut found {
            let input = shot.inputs.at(found.checkpoint.head.frame)?;
            shot.remote_simulation =
                resume::restored(shot.remote_simulation, input, (&mut found.checkpoint, &found.path))?;
        }
        let differs = |earlier: &Earlier| {
            earlier.has_other_form(&fingerprint) || earlier.origin() != <[f64; 3]>::from(shot.origin())
        };
        let other_form = earlier.as_ref().is_some_and(differs);
        if let Some(found) = &found {
            let lost = check_resume(&shot, out, &found.checkpoint.head, other_form)?;
            lost.into_iter().for_each(|text| observer.note(text));
        }
        let reserve = Reserve::take(out)?;
        let mut attempts = earlier.as_ref().map_or_else(Vec::new, |earlier| earlier.attempts.clone());
        attempts.push(AttemptRecord {
            attempt: attempt.number,
            host: owner.host.clone(),
            pid: owner.pid,
            began: utc(SystemTime::now()),
            threads: options.threads,
            ranks: shot.remote_simulation.ranks().count(),
            first_frame: found.as_ref().map_or(shot.about.timeline.start, |found| found.checkpoint.head.frame + 1),
            changes,
            ..AttemptRecord::default()
        });
        let start = Start { options, fingerprint: &fingerprint, attempts };
        let before = (earlier.as_ref(), found.as_ref(), &record.unwrap_or_default());
        let begun = Self::begin(&shot, start, before, (&store, attempt.number, other_form), observer);
        let (output, SoFar { totals, counted }) = match begun {
            Ok(begun) => begun,
            Err(error) => {
                drop(reserve);
                // The first error counts.
                let _ = last_words::failed_to_begin(out, &error.to_string());
                return Err(error);
            }
        };
        let head = found.as_ref().map(|found| &found.checkpoint.head).filter(|head| output.has_caches_of(head));
        let saved = head.map(|head| (head.frame, head.sub_step));
        let (reserve, attempt) = (Some(reserve), attempt.number);
        let cadence = Cadence::new(options.checkpoint_every, 0.0);
        let (clock, is_new) = (Instant::now(), found.is_none());
        Ok(Self {
            shot,
            options,
            fingerprint,
            output,
            store,
            lock,
            reserve,
            cadence,
            clock,
            attempt,
            totals,
            counted,
            is_new,
            dump: None,
            reported_cuts: BTreeSet::new(),
            saved,
            inputs,
        })
    }

    /// Prepares the folder to go on from the checkpoint that was found, or from the start: sets aside what comes after it, and opens
    /// the output. Returns it with the totals up to there.
    fn begin(
        shot: &Shot,
        start: Start<'_>,
        (earlier, found, record): (Option<&Earlier>, Option<&Loaded>, &Record),
        (store, attempt, other_form): (&Store, u32, bool),
        observer: &mut dyn Observer,
    ) -> Result<(Output, SoFar), ShotError> {
        let out = &start.options.out;
        if let Some(earlier) = earlier
            && resume::set_aside_after(shot, out, earlier, found, (store, attempt))?
        {
            let (set_aside, removed) = (stale::attempt(out, attempt), stale::prune(out, start.fingerprint)?);
            observer.note(format!(
                "frames that are simulated again were moved to {}{}",
                set_aside.display(),
                stale::removed_in_words(&removed)
            ));
        }
        let Some(found) = found else {
            return Ok((Output::create(shot, start)?, SoFar::default()));
        };
        let head = &found.checkpoint.head;
        let so_far = SoFar::of(found, shot.about.timeline.start, record, observer);
        let checkpoint = manifest_checkpoint(&found.path, head.frame, head.sub_step);
        let from = From { head, account: found.account.as_ref(), checkpoint, other_form };
        observer.resumed(head.frame, head.frame.abs_diff(shot.about.timeline.start) + 1);
        Ok((Output::resume(shot, start, from)?, so_far))
    }

    /// Opens the writer of the cloth after lines of the listings, then all frames that are missing.
    fn all(&mut self, observer: &mut dyn Observer) -> Result<Outcome, ShotError> {
        self.dump = Dump::of_run(&mut self.shot, self.options, &self.totals)?;
        self.frames(observer)
    }

    /// All frames that are missing.
    fn frames(&mut self, observer: &mut dyn Observer) -> Result<Outcome, ShotError> {
        if self.is_new {
            let start = self.shot.about.timeline.start;
            self.totals.partial.spent = Metrics::default();
            self.finish_frame(start, None, observer)?;
            if let Some(reason) = self.between_frames()? {
                return Ok(Outcome::Stopped(reason));
            }
        } else if self.saved.is_none() {
            self.checkpoint()?;
        }
        while self.shot.simulation().frame() < self.shot.about.last_frame {
            if let Some(reason) = self.next_frame(observer)? {
                return Ok(Outcome::Stopped(reason));
            }
        }
        Ok(Outcome::Done)
    }

    /// Goes on to the next frame; returns why, if it is to stop.
    fn next_frame(&mut self, observer: &mut dyn Observer) -> Result<Option<Reason>, ShotError> {
        let frame = self.shot.simulation().frame() + 1;
        let (shot, spent) = (&self.shot, &mut self.totals.partial.spent);
        let input =
            spent.stage("read inputs", |_| shot.inputs.at(frame).map(|input| shot.remote_simulation.share(input)))?;
        let mut watch = Watch::start(self.shot.simulation(), self.totals.partial.sub_step);
        loop {
            let Partial { spent, sub_step, summary: before } = &mut self.totals.partial;
            let (requests, cadence, clock) = (&self.options.requests, &self.cadence, &self.clock);
            let mut ask = || {
                let due = || cadence.due(clock.elapsed().as_secs_f64(), false).then_some(Request::Checkpoint);
                requests.poll(SystemTime::now()).or_else(due)
            };
            let remote_simulation = &mut self.shot.remote_simulation;
            let so_far = (&mut *sub_step, before);
            let reached =
                spent.stage(SIMULATE, |_| towards_frame(remote_simulation, &input, so_far, &watch, &mut ask))?;
            self.dump.as_ref().map_or(Ok(()), Dump::check)?;
            let request = match reached {
                Reached::State(request) => request,
                Reached::Frame(summary) => {
                    self.finish_frame(frame, Some(&summary), observer)?;
                    return self.between_frames();
                }
            };
            let done = *sub_step;
            let time = self.shot.simulation().state().time;
            if let Some(number) = input.output_times.iter().position(|output| *output == time) {
                let Shot { remote_simulation, render_meshes, .. } = &mut self.shot;
                let spent = &mut self.totals.partial.spent;
                let sample = (frame - 1, number + 1);
                let digests = self.output.write_sample(sample, (remote_simulation, render_meshes), spent)?;
                self.output.record(&sample_record(sample, &digests))?;
            }
            watch.check(self.shot.simulation(), done)?;
            if watch.tells() {
                let timeline = self.shot.about.timeline;
                let since = self.shot.simulation().state().time - timeline.time(frame - 1);
                observer.underway(frame, done, since / timeline.frame_duration());
            }
            match request {
                // Without a request: at a sample.
                Some(Request::Report) | None => {}
                Some(Request::StopAtOnce(reason)) => return Ok(Some(reason)),
                Some(Request::Stop(reason)) => {
                    self.checkpoint()?;
                    return Ok(Some(reason));
                }
                Some(Request::Checkpoint) => self.checkpoint()?,
            }
        }
    }

    /// Writes a frame and everything about it.
    fn finish_frame(
        &mut self,
        frame: i64,
        summary: Option<&FrameSummary>,
        observer: &mut dyn Observer,
    ) -> Result<(), ShotError> {
        self.lock.check()?;
        let mut spent = std::mem::take(&mut self.totals.partial).spent;
        let Shot { about, remote_simulation, render_meshes, .. } = &mut self.shot;
        let is_preroll = frame < about.first_frame;
        let digests = match is_preroll {
            true => FrameDigests::new(),
            false => self.output.write_frame(frame, (remote_simulation, render_meshes), &mut spent)?,
        };
        let taken = spent.stages().iter().fold(0.0, |sum, stage| sum + stage.seconds);
        let totals = &mut self.totals;
        totals.seconds += taken;
        totals.metrics.add(&spent);
        summary.into_iter().for_each(|summary| totals.metrics.add(&summary.metrics));
        let mut line = match summary {
            Some(summary) => frame_record(summary, &spent, taken),
            None => start_record(frame, &spent, taken),
        };
        if !digests.is_empty() {
            line["digests"] = json!(digests);
        }
        self.report_other_cuts(frame, &mut line, observer);
        for path in self.inputs.written_over(&self.fingerprint.digests) {
            observer.note(format!(
                "input {} was written over and holds something else now: frame {frame} and those after it may follow either\n  \
                 help: start over with --overwrite; save new versions under a new name, or rename them into place",
                path.display()
            ));
        }
        self.output.record(&line)?;
        self.counted.add_line(line, frame).into_iter().for_each(|text| observer.note(text));
        self.output.frame_done(frame, taken)?;
        self.options.requests.note_frame(taken);
        self.cadence.frame_done();
        let about = &self.shot.about;
        observer.frame(&FrameReport {
            frame,
            last_frame: about.last_frame,
            is_preroll,
            done: frame.abs_diff(about.timeline.start) + 1,
            total: self.shot.frame_count(),
            seconds: taken,
            summary,
        });
        Ok(())
    }

    /// Notes in the record what crosses in a frame along diagonals that the solver did not take, and says of which objects once.
    fn report_other_cuts(&mut self, frame: i64, line: &mut serde_json::Value, observer: &mut dyn Observer) {
        let cuts = self.output.take_other_cuts();
        if cuts.is_empty() {
            return;
        }
        line["other_diagonal"] = cuts.iter().map(OtherCut::to_json).collect();
        for cut in &cuts {
            let objects = (cut.garment.clone(), cut.other.clone(), cut.is_body);
            if self.reported_cuts.insert(objects) {
                observer.note(format!("frame {frame}: {}\n  help: write {}", cut.in_words(), cut.line()));
            }
        }
    }

    /// At a frame: looks for requests, and writes a checkpoint if one is due. Returns why, if the run is to stop.
    fn between_frames(&mut self) -> Result<Option<Reason>, ShotError> {
        let frame = self.shot.simulation().frame();
        let is_last = frame == self.shot.about.last_frame;
        let own = self.options.requests.poll(SystemTime::now());
        let stop = match self.shot.remote_simulation.agree(own) {
            Some(Request::StopAtOnce(reason)) if !is_last => return Ok(Some(reason)),
            Some(Request::Stop(reason)) if !is_last => Some(reason),
            Some(Request::Checkpoint) => {
                self.checkpoint()?;
                None
            }
            _ => None,
        };
        let due = self.cadence.due(self.clock.elapsed().as_secs_f64(), true);
        if is_last || stop.is_some() || due || self.store.is_pinned(frame) {
            self.checkpoint()?;
        }
        Ok(stop)
    }

    /// Writes, after the solver has given up, a checkpoint to go on from once that is mended, and a bundle to replay.
    fn leave_bundle(&mut self, error: &ShotError, observer: &mut dyn Observer) {
        let ShotError::Step(error) = error else { return };
        if matches!(error, StepError::Input { .. } | StepError::Broken { .. }) {
            return;
        }
        let head = self.head(Vec::new());
        let written = self.checkpoint().map_err(|e| e.to_string());
        let bundle = bundle::write(&self.shot, &self.options.out, &head, error).map_err(|e| e.to_string());
        observer.note(match written.and(bundle) {
            Ok(path) => format!(
                "the last good state and the failure are in {}; replay the failure with: drapery run --replay {}",
                path.display(),
                quoted(path.as_os_str())
            ),
            Err(error) => format!("the failure could not be saved: {error}"),
        });
    }

    /// Returns the head of a checkpoint of the present state.
    fn head(&self, caches: Vec<serde_json::Value>) -> Head {
        let simulation = self.shot.simulation();
        let (frame, timeline) = (simulation.frame(), self.shot.about.timeline);
        Head {
            format_version: FORMAT_VERSION,
            application: drapery_io::cache::APPLICATION.to_owned(),
            shot: self.shot.about.name.clone(),
            frame,
            sub_step: self.totals.partial.sub_step,
            time: simulation.state().time,
            delivered: (frame >= self.shot.about.first_frame).then_some(frame),
            fps: [timeline.fps_numerator, timeline.fps_denominator],
            digests: self.fingerprint.digests.clone(),
            caches,
        }
    }

    /// Writes a checkpoint of the present state, unless there is one.
    fn checkpoint(&mut self) -> Result<(), ShotError> {
        let simulation = self.shot.simulation();
        let (frame, sub_step) = (simulation.frame(), self.totals.partial.sub_step);
        if self.saved == Some((frame, sub_step)) {
            return Ok(());
        }
        self.lock.check()?;
        let (marks, record_bytes) = self.output.mark()?;
        // A mark is of texts and numbers: it always has a JSON form.
        let head = self.head(marks.iter().filter_map(|mark| serde_json::to_value(mark).ok()).collect());
        let account = Account { attempt: self.attempt, record_bytes, totals: self.totals.to_json() };
        let saved = self.store.save(&head, &account, |sink| self.shot.remote_simulation.save(sink))?;
        self.saved = Some((frame, sub_step));
        self.cadence.saved(self.clock.elapsed().as_secs_f64(), saved.seconds);
        self.options.requests.note_checkpoint(saved.seconds);
        self.output.checkpoint_saved(&saved, frame, sub_step)?;
        Ok(())
    }

    /// Says that the run failed, and why, in the room that was kept for that.
    fn fail(&mut self, error: &ShotError) {
        self.reserve = None;
        // The first error counts.
        let _ = self.output.fail(error);
    }

    /// Brings everything to the disk and gives the folder back.
    fn end(mut self, outcome: Outcome) -> Result<RunReport, ShotError> {
        let frame = self.shot.simulation().frame();
        let frames = u64::try_from(frame - self.shot.about.first_frame + 1).unwrap_or(0);
        match self.lock.check().and_then(|()| match outcome {
            Outcome::Stopped(reason) => self.output.stop(reason, frame),
            Outcome::Done | Outcome::NothingToDo => self.output.finish(&self.totals, frames),
        }) {
            Ok(()) => {}
            Err(error @ (IoError::LockLost { .. } | IoError::LockGone { .. })) => return Err(error.into()),
            Err(error) => {
                let error = ShotError::from(error);
                self.fail(&error);
                return Err(error);
            }
        }
        self.options.requests.finish();
        Ok(RunReport {
            outcome,
            frame,
            metrics: self.totals.metrics,
            seconds: self.totals.seconds,
            frames,
            files: self.output.files().into_iter().chain(belts::files(&self.shot, &self.options.out)).collect(),
            layers: self.output.layer_files(),
            beyond_fabric: beyond_fabric(&self.counted.strains, &self.shot.about.garments, &self.shot.about.fabrics),
            exceeded: self.counted.exceeded,
            uncounted: self.counted.uncounted,
            ranks: self.shot.remote_simulation.ranks().count(),
        })
    }
}
