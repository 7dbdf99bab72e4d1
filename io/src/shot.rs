//! The frame loop that the command, and any other door to the solver, runs: inputs in, frames through the solver,
//! caches out.
//!
//! Everything is checked before anything is written ([`Shot::prepare`]). The simulation always starts at the scene's
//! first frame minus its pre-roll, because cloth has a history; only the end of the range can be chosen.

pub(crate) mod check;
pub mod motion;
mod output;
pub mod quality;
mod written;

use std::path::PathBuf;

use drapery_core::Vec3;
use drapery_core::effects::PlannedEffect;
use drapery_core::error::{Problem, Problems, StepError};
use drapery_core::metrics::Metrics;
use drapery_core::scene::{BodyShape, Scene, SceneDescription, Timeline};
use drapery_core::simulation::{FrameInput, FrameSummary, Simulation};
use serde_json::json;

use crate::cache::MeshData;
use crate::error::IoError;
use crate::formats;
use crate::run_record;
use crate::shot::check::{Span, check_faces, check_motion, check_size};
use crate::shot::motion::{InputMotion, Preroll};
use crate::shot::output::Output;
use crate::shot::quality::Exceeded;
use crate::units::Units;

/// A scene with its files opened: everything that a run needs.
#[derive(Debug)]
pub struct ShotDescription {
    /// Name of the shot.
    pub name: String,
    /// Scene file, for the record; empty when there is none.
    pub scene_path: PathBuf,
    /// All files that are read, so that none is overwritten.
    pub input_files: Vec<PathBuf>,
    /// What is simulated.
    pub scene: SceneDescription,
    /// For each body of the scene its file; `None` for analytic shapes.
    pub bodies: Vec<Option<InputMotion>>,
    /// Pin targets, in the order of the tracks.
    pub tracks: Vec<InputMotion>,
    /// For each garment of the scene the mesh as it came from its file, with everything to hand through.
    pub garments: Vec<MeshData>,
    /// First and last frame of the shot.
    pub frames: [i64; 2],
    /// Frames before the first one.
    pub preroll: Preroll,
    /// What is written.
    pub output: OutputDescription,
    /// The scene with every default written out.
    pub resolved: String,
    /// What is suspicious but was accepted.
    pub warnings: Vec<String>,
}

/// What a run writes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputDescription {
    /// Words of [`crate::formats::FORMATS`].
    pub formats: Vec<String>,
    /// Units and up axis of the caches.
    pub units: Units,
    /// Whether velocities are stored.
    pub velocities: bool,
}

/// Why a shot could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ShotError {
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The scene or its inputs are wrong; all problems.
    #[error("{0}")]
    Problems(Problems),
    /// The frames asked for cannot be simulated.
    #[error("{0}")]
    Frames(String),
    /// The solver gave up.
    #[error(transparent)]
    Step(#[from] StepError),
}

/// A shot that was checked and can run.
pub struct Shot {
    simulation: Simulation,
    inputs: Inputs,
    garments: Vec<MeshData>,
    about: About,
    warnings: Vec<String>,
}

/// What a shot is called, where it ends and what it writes.
#[derive(Debug)]
struct About {
    name: String,
    scene_path: PathBuf,
    input_files: Vec<PathBuf>,
    timeline: Timeline,
    last_frame: i64,
    output: OutputDescription,
    resolved: String,
}

/// How a run is made.
#[derive(Debug, Clone)]
pub struct RunOptions {
    /// Folder of the output.
    pub out: PathBuf,
    /// Whether a run that the folder holds is replaced.
    pub overwrite: bool,
    /// Number of threads, for the record; the caller has set up the pool.
    pub threads: usize,
}

/// One frame that is done.
#[derive(Debug, Clone, Copy)]
pub struct FrameReport<'a> {
    /// Its number.
    pub frame: i64,
    /// Last frame of the run.
    pub last_frame: i64,
    /// Whether it lies before the first frame that is delivered.
    pub is_preroll: bool,
    /// Frames done so far, pre-roll included.
    pub done: u64,
    /// Frames in all, pre-roll included.
    pub total: u64,
    /// Seconds it took, reading and writing included.
    pub seconds: f64,
    /// What the solver reports; `None` for the frame at which the simulation starts.
    pub summary: Option<&'a FrameSummary>,
}

/// What a whole run took and wrote.
#[derive(Debug, Clone, PartialEq)]
pub struct RunReport {
    /// Stages and counts of all frames.
    pub metrics: Metrics,
    /// Seconds of all frames.
    pub seconds: f64,
    /// Frames delivered.
    pub frames: u64,
    /// The caches.
    pub files: Vec<PathBuf>,
    /// Counts that should have stayed zero, in the order in which they rose.
    pub exceeded: Vec<Exceeded>,
}

impl Shot {
    /// Checks the scene and every frame of its inputs, and builds the simulation at its start. Writes nothing.
    ///
    /// `frames` are the first and last frame asked for; the whole range of the scene when `None`.
    ///
    /// # Errors
    /// All problems at once; a file that cannot be read; frames that cannot be simulated.
    pub fn prepare(description: ShotDescription, frames: Option<[i64; 2]>) -> Result<Self, ShotError> {
        let ShotDescription { scene, bodies, tracks, garments, preroll, output, .. } = description;
        let mut warnings = description.warnings;
        let last_frame = last_frame(description.frames, frames, &mut warnings)?;
        let timeline = scene.timeline;
        let inputs = Inputs { timeline, preroll, bodies, tracks };
        let mut problems = inputs.check(&scene, last_frame, &mut warnings);
        let simulation = match Scene::validate(scene) {
            Err(Problems(found)) => {
                problems.extend(found);
                None
            }
            Ok(scene) => inputs.start(scene, &mut problems)?,
        };
        let Some(simulation) = simulation.filter(|_| problems.is_empty()) else {
            return Err(ShotError::Problems(Problems(problems)));
        };
        for format in output.formats.iter().filter_map(|word| formats::by_extension(word)) {
            if let Some(feature) = format.left_out {
                let extension = format.extension;
                warnings.push(format!("no .{extension} files are written: this build has no feature `{feature}`"));
            }
        }
        let (name, resolved) = (description.name, description.resolved);
        let (scene_path, input_files) = (description.scene_path, description.input_files);
        let about = About { name, scene_path, input_files, timeline, last_frame, output, resolved };
        Ok(Self { simulation, inputs, garments, about, warnings })
    }

    /// What is suspicious but was accepted.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The simulation at its start: what will run, and why.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// Name of the shot.
    pub fn name(&self) -> &str {
        &self.about.name
    }

    /// First and last frame that are delivered.
    pub fn frames(&self) -> [i64; 2] {
        [self.about.timeline.origin, self.about.last_frame]
    }

    /// Frame rate, first frame and start of the simulation.
    pub fn timeline(&self) -> Timeline {
        self.about.timeline
    }

    /// What is written.
    pub fn output(&self) -> &OutputDescription {
        &self.about.output
    }

    /// The scene with every default written out.
    pub fn resolved(&self) -> &str {
        &self.about.resolved
    }

    /// Number of frames that a run computes, pre-roll included.
    pub fn frame_count(&self) -> u64 {
        self.about.last_frame.abs_diff(self.about.timeline.start) + 1
    }

    /// Simulates and writes all frames; `observer` hears of each when it is on the disk.
    ///
    /// # Errors
    /// The folder holds another run or cannot be written; an input breaks; the solver gives up. Frames before stay
    /// valid.
    pub fn run(
        mut self,
        options: &RunOptions,
        observer: &mut dyn FnMut(&FrameReport<'_>),
    ) -> Result<RunReport, ShotError> {
        let mut output = Output::create(&self, options)?;
        match self.run_frames(&mut output, observer) {
            Ok(report) => {
                output.finish(&report)?;
                Ok(report)
            }
            Err(error) => {
                // The first error is the one that counts; a full disk would refuse this record too.
                let _ = output.fail(&error);
                Err(error)
            }
        }
    }

    fn run_frames(
        &mut self,
        output: &mut Output,
        observer: &mut dyn FnMut(&FrameReport<'_>),
    ) -> Result<RunReport, ShotError> {
        let (timeline, last_frame, total) = (self.about.timeline, self.about.last_frame, self.frame_count());
        let mut all = Metrics::default();
        let (mut seconds, mut exceeded) = (0.0, Vec::new());
        for frame in timeline.start..=last_frame {
            let mut spent = Metrics::default();
            let summary = match frame == timeline.start {
                true => None,
                false => {
                    let input = spent.stage("read inputs", |_| self.inputs.at(frame))?;
                    Some(spent.stage("simulate", |_| self.simulation.advance(&input))?)
                }
            };
            let is_preroll = frame < timeline.origin;
            if !is_preroll {
                output.write_frame(frame, &self.simulation, &mut spent)?;
            }
            let taken: f64 = spent.stages().iter().map(|stage| stage.seconds).sum();
            seconds += taken;
            all.add(&spent);
            quality::watch(&mut exceeded, frame, &spent);
            match &summary {
                Some(summary) => {
                    all.add(&summary.metrics);
                    quality::watch(&mut exceeded, frame, &summary.metrics);
                    output.record(&run_record::frame_record(summary, &spent, taken))?;
                }
                None => output.record(&run_record::start_record(frame, &spent, taken))?,
            }
            let done = frame.abs_diff(timeline.start) + 1;
            observer(&FrameReport {
                frame,
                last_frame,
                is_preroll,
                done,
                total,
                seconds: taken,
                summary: summary.as_ref(),
            });
        }
        let frames = last_frame.abs_diff(timeline.origin) + 1;
        Ok(RunReport { metrics: all, seconds, frames, files: output.files(), exceeded })
    }

    /// Head of the record: what will run.
    fn header(&self, threads: usize) -> serde_json::Value {
        let timeline = self.about.timeline;
        let effect = |effect: &PlannedEffect| {
            let (garment, because) = (&effect.garment, &effect.because);
            json!({"effect": effect.name, "garment": garment, "because": because, "bytes": effect.bytes})
        };
        json!({
            "record": "header",
            "application": crate::cache::APPLICATION,
            "shot": self.about.name,
            "scene": self.about.scene_path,
            "fps": [timeline.fps_numerator, timeline.fps_denominator],
            "start_frame": timeline.start,
            "first_frame": timeline.origin,
            "last_frame": self.about.last_frame,
            "threads": threads,
            "effects": self.simulation.plan().iter().map(effect).collect::<Vec<_>>(),
        })
    }
}

/// The last frame of a run. A range that ends after the scene's own is cut; one that starts elsewhere is refused.
fn last_frame(scene: [i64; 2], asked: Option<[i64; 2]>, warnings: &mut Vec<String>) -> Result<i64, ShotError> {
    let [scene_first, scene_last] = scene;
    let Some([first, last]) = asked else {
        return Ok(scene_last);
    };
    if first > scene_first || last < scene_first {
        return Err(ShotError::Frames(format!(
            "frames {first}-{last}: cloth depends on the frames before, so a run starts at frame {scene_first}\n  \
             help: ask for {scene_first}-{}, and take what you need of it",
            last.clamp(scene_first, scene_last.max(scene_first))
        )));
    }
    if first < scene_first || last > scene_last {
        warnings.push(format!("frames {first}-{last} are cut to those of the shot, {scene_first}-{scene_last}"));
    }
    Ok(last.min(scene_last))
}

/// Everything that moves by files.
#[derive(Debug)]
struct Inputs {
    timeline: Timeline,
    preroll: Preroll,
    bodies: Vec<Option<InputMotion>>,
    tracks: Vec<InputMotion>,
}

impl Inputs {
    /// What the solver needs to reach a frame.
    fn at(&self, frame: i64) -> Result<FrameInput, IoError> {
        let samples = |motion: &InputMotion| motion.samples(self.timeline, self.preroll, frame);
        let bodies =
            self.bodies.iter().map(|body| body.as_ref().map_or(Ok(Vec::new()), samples)).collect::<Result<_, _>>()?;
        let tracks = self.tracks.iter().map(samples).collect::<Result<_, _>>()?;
        Ok(FrameInput { frame, bodies, tracks })
    }

    /// Problems of all frames of all inputs.
    fn check(&self, scene: &SceneDescription, last_frame: i64, warnings: &mut Vec<String>) -> Vec<Problem> {
        let span = Span { timeline: self.timeline, last_frame };
        let mut problems = Vec::new();
        for (body, motion) in scene.bodies.iter().zip(&self.bodies) {
            if let (BodyShape::Surface { triangles, point_count }, Some(motion)) = (&body.shape, motion) {
                problems.extend(check_motion(motion, span, Some(*point_count)));
                problems.extend(check_size(motion, span, warnings));
                problems.extend(check_faces(motion, span, triangles, warnings));
            }
        }
        for track in &self.tracks {
            problems.extend(check_motion(track, span, None));
        }
        problems
    }

    /// The simulation at its start, or more problems.
    fn start(&self, scene: Scene, problems: &mut Vec<Problem>) -> Result<Option<Simulation>, ShotError> {
        let input = self.at(self.timeline.start)?;
        let finite = |p: &Vec3| p.iter().all(|x| x.is_finite());
        let samples = input.bodies.iter().chain(&input.tracks).flatten();
        if !problems.is_empty() && samples.flat_map(|s| &s.positions).any(|p| !finite(p)) {
            // The check of the samples has said so already.
            return Ok(None);
        }
        match Simulation::new(scene, &input) {
            Ok(simulation) => Ok(Some(simulation)),
            Err(Problems(found)) => {
                problems.extend(found);
                Ok(None)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_cut_at_its_ends_but_always_starts_at_the_first_frame() {
        let mut warnings = Vec::new();
        assert_eq!(last_frame([1001, 1100], None, &mut warnings).unwrap(), 1100);
        assert_eq!(last_frame([1001, 1100], Some([1001, 1010]), &mut warnings).unwrap(), 1010);
        assert!(warnings.is_empty());
        assert_eq!(last_frame([1001, 1100], Some([990, 1200]), &mut warnings).unwrap(), 1100);
        assert_eq!(warnings.len(), 1);
        let late = last_frame([1001, 1100], Some([1050, 1060]), &mut warnings).unwrap_err();
        assert!(late.to_string().contains("1001-1060"), "{late}");
        assert!(last_frame([1001, 1100], Some([900, 950]), &mut warnings).is_err());
    }
}
