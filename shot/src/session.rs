//! A shot in the hands of another program: stepped frame by frame in memory, with bodies that the program may move itself, and
//! states to go back to. Nothing is written unless somebody saves a state.
//!
//! Frames have the bits of those that [`Shot::run`] writes: both advance by the same pieces.

use std::path::Path;
use std::sync::Arc;

use drapery_core::Vec3;
use drapery_core::error::{ChangeError, Problem, Problems, StepError};
use drapery_core::scene::gather::VertexField;
use drapery_core::scene::{BodyShape, Scene, is_possible};
use drapery_core::settings::SettingValue;
use drapery_core::simulation::{FrameInput, FrameSummary, RestoreError, Sample};
use drapery_core::snapshot::{Snapshot, SnapshotSource};

use crate::error::ShotError;
use crate::farm::stop::{Reason, Request};
use crate::long_frames::Watch;
use crate::shot::Shot;
use crate::towards_frame::{Reached, towards_frame};

mod state_file;

/// A shot at some state.
pub struct Session {
    /// Gone after a state could not be restored, which leaves no simulation.
    shot: Option<Shot>,
    /// For each body where the program has it.
    moved: Vec<Moved>,
    /// States free of collisions since the last frame.
    sub_step: u64,
    /// Work done since the last frame.
    so_far: Option<FrameSummary>,
    /// Positions [m] and velocities [m/s] of each garment that somebody has looked at since the state changed.
    views: Vec<[Option<Vec<Vec3>>; 2]>,
    /// Work done to reach the present frame.
    summary: Option<FrameSummary>,
}

/// Places of a body set by the program [m]; where nothing is said, the scene moves it.
#[derive(Debug, Clone, Default, PartialEq)]
struct Moved {
    /// At the last frame.
    here: Option<Vec<Vec3>>,
    /// At the next one.
    next: Option<Vec<Vec3>>,
}

/// A state of a session, in memory. It belongs to the scene of that session.
#[derive(Clone)]
pub struct SavedState {
    frame: i64,
    sub_step: u64,
    so_far: Option<FrameSummary>,
    summary: Option<FrameSummary>,
    moved: Vec<Moved>,
    snapshot: Snapshot,
    scene: Arc<Scene>,
}

impl SavedState {
    /// The last frame that was reached.
    pub fn frame(&self) -> i64 {
        self.frame
    }
}

/// Progress of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// The frame is reached; [`Session::summary`] says what was done.
    Frame,
    /// It was cancelled at a state on the way, from which it goes on.
    Cancelled,
}

impl Session {
    /// A checked shot at its start.
    pub fn new(shot: Shot) -> Self {
        let [garments, bodies] = [shot.about.garments.len(), shot.inputs.bodies.len()];
        Self {
            shot: Some(shot),
            moved: vec![Moved::default(); bodies],
            sub_step: 0,
            so_far: None,
            views: vec![[None, None]; garments],
            summary: None,
        }
    }

    /// The shot.
    ///
    /// # Errors
    /// A state could not be restored, which has left no simulation.
    pub fn shot(&self) -> Result<&Shot, ShotError> {
        self.shot.as_ref().ok_or_else(gone)
    }

    /// The last frame that was reached: that of the start, pre-roll included, at first.
    ///
    /// # Errors
    /// As [`Session::shot`].
    pub fn frame(&self) -> Result<i64, ShotError> {
        Ok(self.shot()?.simulation().frame())
    }

    /// Returns the work done to reach it; `None` at the start, and where a file was restored.
    pub fn summary(&self) -> Option<&FrameSummary> {
        self.summary.as_ref()
    }

    /// Puts a body that is a mesh where it is to be at the next frame [m, Y up], one place for each of its points. It moves
    /// there on straight lines, and stays until it is put elsewhere: the scene no longer moves it.
    ///
    /// # Errors
    /// There is no such body, or it is an analytic shape; there are more or fewer places than points, or one is not
    /// finite or too
    /// far away. A frame was cancelled on the way and is not finished.
    pub fn move_body(&mut self, body: usize, positions: &[Vec3]) -> Result<(), ShotError> {
        let next = self.frame()? + 1;
        let shot = self.shot()?;
        let bodies = &shot.simulation().scene().description().bodies;
        let refuse = |place: String, what: String, advice: &str| {
            Err(ShotError::Problems(Problems(vec![Problem::data(place, what, advice)])))
        };
        let Some(described) = bodies.get(body) else {
            return Err(unknown("body", body, (bodies.len(), "bodies")));
        };
        let place = format!("body \"{}\", frame {next}", described.name);
        let BodyShape::Surface { point_count, .. } = &described.shape else {
            return refuse(place, "it is an analytic shape, which the scene moves".into(), "make it a mesh");
        };
        if positions.len() != *point_count {
            let what = format!("{} places are given for {point_count} points", positions.len());
            return refuse(place, what, "give a place for each point of the mesh, in its order");
        }
        if let Some(vertex) = positions.iter().position(|position| !is_possible(position)) {
            let what = format!("{:?} m is no place", <[f64; 3]>::from(positions[vertex]));
            return refuse(format!("{place}, vertex {vertex}"), what, "give finite numbers, in metres");
        }
        if self.sub_step > 0 {
            let advice = "advance to it first, or go back to a state at a frame";
            return refuse(place, "this frame has already begun with the body at its old position".into(), advice);
        }
        self.moved[body].next = Some(positions.to_vec());
        Ok(())
    }

    /// Gives a number of the scene another value from the next frame on, by its path (`garment.skirt.stretch.stiffness`,
    /// `body.hero.friction`): one number, or the three of a vector, in SI units. States do not hold it.
    ///
    /// # Errors
    /// The scene has no such number, the value does not fit it, or a curve of the scene changes it. A frame was cancelled on the
    /// way and is not finished.
    pub fn set_number(&mut self, path: &str, value: &[f64]) -> Result<(), ShotError> {
        let refuse = |problem: Problem| ShotError::Problems(Problems(vec![problem]));
        let value = match *value {
            [number] => SettingValue::Number(number),
            [x, y, z] => SettingValue::Vector([x, y, z]),
            _ => {
                let what = format!("{} numbers are given", value.len());
                return Err(refuse(Problem::data(path, what, "give one number, or the three of a vector")));
            }
        };
        if self.sub_step > 0 {
            let advice = "advance to it first, or go back to a state at a frame";
            let what = "the next frame has already begun with the old number";
            return Err(refuse(Problem::data(path, what, advice)));
        }
        let mut shot = self.shot.take().ok_or_else(gone)?;
        let set = shot.remote_simulation.set(&[(path.to_owned(), value)]);
        match set {
            // Nothing of it may be used: the shot is dropped.
            Err(ChangeError::Broken(problem)) => Err(refuse(problem)),
            Err(ChangeError::Refused(problem)) => {
                self.shot = Some(shot);
                Err(refuse(problem))
            }
            Ok(()) => {
                self.shot = Some(shot);
                Ok(())
            }
        }
    }

    /// Goes on to the next frame, or to where `cancelled` says so: it is asked at every state free of collisions, from any
    /// thread. Called again after that, it goes on from there with the bits of a frame that was never cancelled.
    ///
    /// # Errors
    /// The last frame of the shot is reached; an input breaks; the solver gives up, which leaves the last good state.
    pub fn next_frame(&mut self, cancelled: &mut (dyn FnMut() -> bool + Send)) -> Result<Progress, ShotError> {
        let frame = self.frame()? + 1;
        if frame > self.shot()?.about.last_frame {
            let text = format!("frame {frame}: the shot ends at frame {}\n  help: raise shot.frames", frame - 1);
            return Err(ShotError::Frames(text));
        }
        self.views.fill([None, None]);
        let input = self.input(frame, |moved| moved.next.as_ref().or(moved.here.as_ref()))?;
        let shot = self.shot.as_mut().ok_or_else(gone)?;
        let input = shot.remote_simulation.share(input);
        let watch = Watch::start(shot.remote_simulation.simulation(), self.sub_step);
        let mut ask = || cancelled().then_some(Request::StopAtOnce(Reason::Program));
        loop {
            let so_far = (&mut self.sub_step, &mut self.so_far);
            let reached = towards_frame(&mut shot.remote_simulation, &input, so_far, &watch, &mut ask);
            if let Err(error @ StepError::Broken { .. }) = reached {
                self.shot = None;
                return Err(error.into());
            }
            match reached? {
                Reached::Frame(summary) => {
                    (self.sub_step, self.so_far) = (0, None);
                    for moved in &mut self.moved {
                        moved.here = moved.next.take().or(moved.here.take());
                    }
                    self.summary = Some(*summary);
                    return Ok(Progress::Frame);
                }
                Reached::State(Some(Request::StopAtOnce(_))) => return Ok(Progress::Cancelled),
                // A sample of the shutter, at which a step ends, or a frame that takes long.
                Reached::State(_) => watch.check(shot.remote_simulation.simulation(), self.sub_step)?,
            }
        }
    }

    /// The input of a frame, with bodies where `chosen` says that the program has them.
    fn input(&self, frame: i64, chosen: fn(&Moved) -> Option<&Vec<Vec3>>) -> Result<FrameInput, ShotError> {
        let inputs = &self.shot()?.inputs;
        let (mut input, time) = (inputs.at(frame)?, inputs.timeline.time(frame));
        for (samples, moved) in input.bodies.iter_mut().zip(&self.moved) {
            if let Some(positions) = chosen(moved) {
                *samples = vec![Sample { time, positions: positions.clone() }];
            }
        }
        Ok(input)
    }

    /// A field of a garment in its own order [m, m/s], at the present state. It is put in order when it is first asked for, and
    /// kept until the state changes.
    ///
    /// # Errors
    /// There is no such garment; as [`Session::shot`].
    pub fn field(&mut self, garment: usize, field: VertexField) -> Result<&[Vec3], ShotError> {
        let shot = self.shot.as_ref().ok_or_else(gone)?;
        let count = self.views.len();
        let Some(view) = self.views.get_mut(garment) else {
            return Err(unknown("garment", garment, (count, "garments")));
        };
        let kept = &mut view[usize::from(field == VertexField::Velocities)];
        Ok(kept.get_or_insert_with(|| shot.remote_simulation.field(garment, field)))
    }

    /// Takes a field of a garment out of the session, for a caller that keeps it.
    ///
    /// # Errors
    /// The errors of [`Session::field`].
    pub fn take_field(&mut self, garment: usize, field: VertexField) -> Result<Vec<Vec3>, ShotError> {
        self.field(garment, field)?;
        let kept = &mut self.views[garment][usize::from(field == VertexField::Velocities)];
        Ok(kept.take().unwrap_or_default())
    }

    /// The present state.
    ///
    /// # Errors
    /// As [`Session::shot`].
    pub fn save(&self) -> Result<SavedState, ShotError> {
        let shot = self.shot()?;
        let mut snapshot = Snapshot::default();
        shot.remote_simulation.save(&mut snapshot);
        Ok(SavedState {
            frame: shot.simulation().frame(),
            sub_step: self.sub_step,
            so_far: self.so_far.clone(),
            summary: self.summary.clone(),
            moved: self.moved.clone(),
            snapshot,
            scene: shot.simulation().shared_scene(),
        })
    }

    /// Goes back to a state, or forward, with the same bits from there on.
    ///
    /// # Errors
    /// The state belongs to another session.
    pub fn restore(&mut self, state: &SavedState) -> Result<(), ShotError> {
        if !state.scene.is_form_of(self.shot()?.simulation().scene()) {
            let text =
                "this state belongs to another simulation\n  help: states of one simulation go to another by files";
            return Err(ShotError::Resume(text.to_owned()));
        }
        self.go_to((state.frame, state.moved.clone()), &mut state.snapshot.clone(), Path::new("state"))?;
        (self.sub_step, self.so_far, self.summary) = (state.sub_step, state.so_far.clone(), state.summary.clone());
        Ok(())
    }

    /// Builds the simulation at a saved state of a frame, with bodies where they were then; after an error they are where they were before.
    fn go_to(
        &mut self,
        (frame, moved): (i64, Vec<Moved>),
        source: &mut dyn SnapshotSource,
        path: &Path,
    ) -> Result<(), ShotError> {
        let before = std::mem::replace(&mut self.moved, moved);
        let built = self.build_at(frame, source, path);
        if built.is_err() {
            self.moved = before;
        }
        built
    }

    fn build_at(&mut self, frame: i64, source: &mut dyn SnapshotSource, path: &Path) -> Result<(), ShotError> {
        let input = self.input(frame, |moved| moved.here.as_ref())?;
        let mut shot = self.shot.take().ok_or_else(gone)?;
        shot.remote_simulation = shot.remote_simulation.restored(input, source).map_err(|error| match error {
            RestoreError::Problems(problems) => ShotError::Problems(problems),
            RestoreError::Snapshot(error) => ShotError::Resume(format!("{}: {error}", path.display())),
        })?;
        self.views.fill([None, None]);
        self.shot = Some(shot);
        Ok(())
    }
}

/// A number that no garment or body has.
fn unknown(what: &str, number: usize, (count, all): (usize, &str)) -> ShotError {
    let advice = "look their numbers up by their names";
    ShotError::Unknown(format!("{what} {number}: the scene has {count} {all}, counted from 0\n  help: {advice}"))
}

/// There is no simulation any more.
fn gone() -> ShotError {
    let text = "this simulation ended when a state or a change could not be built\n  help: prepare the scene again";
    ShotError::Resume(text.to_owned())
}
