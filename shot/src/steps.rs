//! A shot that is simulated frame by frame without writing anything: what a study measures.

use drapery_core::Vec3;
use drapery_core::clock::Watch;
use drapery_core::observe::{ChecksumSink, Sink, Tracepoint};
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::Timeline;
use drapery_core::simulation::{Advance, FrameInput, FrameSummary, Simulation};
use drapery_io::shot_description::ShotDescription;

use crate::error::ShotError;
use crate::farm::stop::{Reason, Request};
use crate::inputs::Inputs;
use crate::remote_simulation::RemoteSimulation;

/// A frame that is done.
#[derive(Debug, Clone)]
pub struct SteppedFrame {
    /// Report of the solver.
    pub summary: FrameSummary,
    /// Seconds that reading its inputs and simulating it took.
    pub seconds: f64,
}

/// A shot at some frame; nothing of it goes to the disk.
pub struct SteppedShot {
    remote_simulation: RemoteSimulation,
    inputs: Inputs,
    /// Interval of the samples of deforming bodies [frames]; 1 takes every sample there is.
    body_frames: u32,
    last_frame: i64,
}

impl SteppedShot {
    /// Builds the simulation of a scene without looking at all frames of its inputs first. `body_frames` above 1 shows the
    /// solver deforming bodies at every `body_frames` frames only, on straight lines between them. To be called by rank 0, which the
    /// others follow ([`crate::remote_simulation::worker_loop`]).
    ///
    /// # Errors
    /// As [`crate::Shot::prepare`], for the start frame.
    pub fn start(ranks: &Ranks, description: ShotDescription, body_frames: u32) -> Result<Self, ShotError> {
        let ShotDescription { scene, bodies, tracks, wind, preroll, frames, .. } = description;
        let inputs = Inputs { timeline: scene.timeline, preroll, bodies, tracks, wind, sub_frames: Default::default() };
        let scene = RemoteSimulation::distribute(ranks, scene).map_err(ShotError::Problems)?;
        let mut problems = Vec::new();
        let remote_simulation = inputs.start(ranks, scene, &mut problems)?;
        let remote_simulation =
            remote_simulation.ok_or(ShotError::Problems(drapery_core::error::Problems(problems)))?;
        Ok(Self { remote_simulation, inputs, body_frames: body_frames.max(1), last_frame: frames[1] })
    }

    /// Gives `sink` checksums of the cloth after every line of the listings from now on.
    pub fn observe_checksums(&mut self, sink: ChecksumSink) {
        self.remote_simulation.observe_checksums(sink);
    }

    /// Gives `sink` the cloth after the lines of these tracepoints from now on.
    pub fn observe(&mut self, tracepoints: &[Tracepoint], sink: Sink) {
        self.remote_simulation.observe(tracepoints, 0, sink);
    }

    /// Positions [m] and velocities [m/s] of all vertices, in the order of the scene.
    pub fn state(&self) -> [Vec<Vec3>; 2] {
        self.remote_simulation.state()
    }

    /// The simulation as it is, as far as rank 0 has it.
    pub fn simulation(&self) -> &Simulation {
        self.remote_simulation.simulation()
    }

    /// Frame rate, first frame and start of the simulation.
    pub fn timeline(&self) -> Timeline {
        self.inputs.timeline
    }

    /// Last frame of the shot.
    pub fn last_frame(&self) -> i64 {
        self.last_frame
    }

    /// Goes on to the next frame; `None` if `give_up` said so at a state on the way, after which this is of no more use.
    ///
    /// # Errors
    /// An input breaks; the solver gives up.
    pub fn next_frame(
        &mut self,
        report_failure: &mut (dyn FnMut() -> bool + Send),
    ) -> Result<Option<SteppedFrame>, ShotError> {
        let watch = Watch::start();
        let input = self.input(self.simulation().frame() + 1)?;
        let input = self.remote_simulation.share(input);
        let mut ask = || report_failure().then_some(Request::StopAtOnce(Reason::MaxWall));
        match self.remote_simulation.advance(&input, &mut ask)? {
            (Advance::Done(summary), _) => Ok(Some(SteppedFrame { summary, seconds: watch.seconds() })),
            (Advance::Paused(_), _) => Ok(None),
        }
    }

    /// The input of a frame, with deforming bodies as seldom as asked for.
    fn input(&self, frame: i64) -> Result<FrameInput, ShotError> {
        let mut input = self.inputs.at(frame)?;
        if self.body_frames == 1 {
            return Ok(input);
        }
        let (every, start) = (i64::from(self.body_frames), self.timeline().start);
        let before = start + (frame - start).div_euclid(every) * every;
        let (a, b) = (self.inputs.at(before)?, self.inputs.at((before + every).min(self.last_frame.max(frame)))?);
        let span = (b.frame - a.frame).max(1) as f64;
        let share = (frame - a.frame) as f64 / span;
        for (body, (a, b)) in input.bodies.iter_mut().zip(a.bodies.into_iter().zip(b.bodies)) {
            let (Some(mut here), Some(a), Some(b)) = (body.pop(), a.last(), b.last()) else { continue };
            let between = |(a, b): (&Vec3, &Vec3)| a.lerp(b, share);
            here.positions = a.positions.iter().zip(&b.positions).map(between).collect();
            *body = vec![here];
        }
        Ok(input)
    }
}
