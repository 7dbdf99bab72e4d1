//! A simulation on many ranks. Rank 0 leads: it reads, writes and decides, and says before every operation of all ranks what
//! comes next. The others [`worker_loop`]: they do the same operation with their share of the cloth, and touch no file.

use std::time::SystemTime;

use drapery_core::Vec3;
use drapery_core::effects::cost::FrameCost;
use drapery_core::error::{ChangeError, Problems, StepError};
use drapery_core::observe::{ChecksumSink, Observer, Sink, Tracepoint};
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::gather::VertexField;
use drapery_core::scene::{Scene, SceneDescription};
use drapery_core::settings::SettingValue;
use drapery_core::simulation::{Advance, FrameInput, FrameSummary, RestoreError, Simulation};
use drapery_core::snapshot::{SnapshotSink, SnapshotSource};
use drapery_io::error::IoError;
use drapery_io::units::Units;

use crate::error::ShotError;
use crate::farm::stop::{Request, StopRequests};

/// Next action of all ranks.
#[derive(Debug, Clone)]
enum Command {
    /// Start threads: `count` on each rank, or as each rank finds right.
    Threads { count: Option<usize> },
    /// Take a share of the scene.
    Scene,
    /// Take the input of a frame.
    Input,
    /// Build the simulation at its start, from that input.
    Start,
    /// Build it at a checkpoint, from that input.
    Restore,
    /// Look at the cloth after these lines; `steps` were made since the last frame.
    Observe { tracepoints: Vec<String>, steps: u64 },
    /// Take checksums of the cloth after every line.
    Checksums,
    /// Go on towards the frame of that input.
    Advance,
    /// Say what is asked for here.
    Agree,
    /// Give a field of a garment.
    Stored { garment: usize, velocities: bool, units: Units },
    /// Give a field of a garment as the solver has it.
    Field { garment: usize, velocities: bool },
    /// Look for crossings of what caches store.
    Crossings { units: Units },
    /// Give positions and velocities.
    State,
    /// Give everything that time has changed.
    Save,
    /// Give numbers of the scene other values.
    Set { numbers: Vec<(String, SettingValue)> },
    /// Give the contact of all garments.
    Contact,
    /// End with this exit code.
    End { code: u8 },
}

drapery_core::codec! { enum Command {
    0 => Threads { count },
    1 => Scene,
    2 => Input,
    3 => Start,
    4 => Restore,
    5 => Observe { tracepoints, steps },
    6 => Advance,
    7 => Agree,
    8 => Stored { garment, velocities, units },
    9 => Field { garment, velocities },
    10 => Crossings { units },
    11 => State,
    12 => Save,
    13 => End { code },
    14 => Checksums,
    15 => Set { numbers },
    16 => Contact,
} }

/// Name of the message that a command is.
const COMMAND: &str = "command of rank 0";

fn announce(ranks: &Ranks, command: Command) {
    if !ranks.is_alone() {
        ranks.broadcast_encoded(COMMAND, Some(command));
    }
}

fn receive(ranks: &Ranks) -> Command {
    ranks.broadcast_encoded(COMMAND, None)
}

/// A simulation on all ranks, as rank 0 has it.
pub(super) struct RemoteSimulation {
    ranks: Ranks,
    simulation: Simulation,
}

impl RemoteSimulation {
    /// The checked scene, on all ranks.
    pub(super) fn distribute(ranks: &Ranks, description: SceneDescription) -> Result<Scene, Problems> {
        announce(ranks, Command::Scene);
        Scene::distribute(ranks, Some(description))
    }

    /// The simulation at its start.
    pub(super) fn start(ranks: &Ranks, scene: Scene, input: FrameInput) -> Result<Self, Problems> {
        let input = share(ranks, &scene, input);
        announce(ranks, Command::Start);
        let simulation = Simulation::new(scene, &input)?;
        Ok(Self { ranks: ranks.clone(), simulation })
    }

    /// The simulation at a checkpoint of the frame of `input`.
    pub(super) fn restored(self, input: FrameInput, source: &mut dyn SnapshotSource) -> Result<Self, RestoreError> {
        let Self { ranks, simulation } = self;
        let scene = simulation.shared_scene();
        // Its room is needed for the one to come.
        drop(simulation);
        let input = share(&ranks, &scene, input);
        announce(&ranks, Command::Restore);
        let simulation = Simulation::restore_from(scene, &input, Some(source))?;
        Ok(Self { ranks, simulation })
    }

    /// The ranks.
    pub(super) fn ranks(&self) -> &Ranks {
        &self.ranks
    }

    /// This rank's part of the simulation.
    pub(super) fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// Gives every rank what it needs of the input of a frame; returns what this one needs.
    pub(super) fn share(&self, input: FrameInput) -> FrameInput {
        share(&self.ranks, self.simulation.scene(), input)
    }

    /// Gives `sink` the cloth after these lines from now on; `steps` were made since the last frame.
    pub(super) fn observe(&mut self, tracepoints: &[Tracepoint], steps: u64, sink: Sink) {
        let as_text = tracepoints.iter().map(Tracepoint::to_string).collect();
        announce(&self.ranks, Command::Observe { tracepoints: as_text, steps });
        observe(&mut self.simulation, tracepoints.to_vec(), steps, Some(sink));
    }

    /// Gives `sink` checksums of the cloth after every line from now on.
    pub(super) fn observe_checksums(&mut self, sink: ChecksumSink) {
        announce(&self.ranks, Command::Checksums);
        observe_checksums(&mut self.simulation, Some(sink));
    }

    /// Goes on towards the frame that was shared last. At states free of collisions `ask` says what is asked for here; what all
    /// ranks agree on is returned with the advance.
    pub(super) fn advance(
        &mut self,
        input: &FrameInput,
        ask: &mut (dyn FnMut() -> Option<Request> + Send),
    ) -> Result<(Advance, Option<Request>), StepError> {
        announce(&self.ranks, Command::Advance);
        advance(&self.ranks, &mut self.simulation, input, ask)
    }

    /// Goes on by these frames, all of them on this rank; returns what one has cost in the mean.
    pub(super) fn trial(
        &mut self,
        inputs: impl Iterator<Item = Result<FrameInput, IoError>>,
    ) -> Result<FrameCost, ShotError> {
        let (mut all, mut frames) = (FrameSummary::empty(self.simulation.frame()), 0.0);
        for input in inputs {
            let summary = self.simulation.advance(&input?)?;
            (all, frames) = (summary.after(&all), frames + 1.0);
        }
        let mut cost = self.simulation.measured_cost(&all).map_err(ShotError::Problems)?;
        cost.divide(frames);
        Ok(cost)
    }

    /// Returns the request on which all ranks agree when `own` is asked for here.
    pub(super) fn agree(&self, own: Option<Request>) -> Option<Request> {
        announce(&self.ranks, Command::Agree);
        agree(&self.ranks, own)
    }

    /// A field of a garment in its own order, as caches in `units` store it.
    pub(super) fn stored(&self, garment: usize, field: VertexField, units: Units) -> Vec<[f32; 3]> {
        let velocities = field == VertexField::Velocities;
        announce(&self.ranks, Command::Stored { garment, velocities, units });
        stored(&self.simulation, garment, field, units).expect("rank 0 gets what is stored")
    }

    /// A field of a garment in its own order, as the solver has it [m, m/s].
    pub(super) fn field(&self, garment: usize, field: VertexField) -> Vec<Vec3> {
        let velocities = field == VertexField::Velocities;
        announce(&self.ranks, Command::Field { garment, velocities });
        field_of(&self.simulation, garment, field)
    }

    /// Number of pairs of an edge and a triangle of cloth that meet in what caches in `units` store: rounded to single
    /// precision in the file's unit, cloth that is free of crossings in the solver's doubles might touch.
    pub(super) fn crossings_of_stored(&mut self, units: Units) -> u32 {
        announce(&self.ranks, Command::Crossings { units });
        crossings_of_stored(&mut self.simulation, units)
    }

    /// Contact of the vertices of each garment in its own order ([`Simulation::contact`]).
    pub(super) fn contact(&self) -> Vec<Vec<f32>> {
        announce(&self.ranks, Command::Contact);
        self.simulation.contact().expect("rank 0 gets what is stored")
    }

    /// Positions [m] and velocities [m/s] of all vertices, in the order of the scene.
    pub(super) fn state(&self) -> [Vec<Vec3>; 2] {
        announce(&self.ranks, Command::State);
        state(&self.ranks, &self.simulation)
    }

    /// Gives numbers of the scene other values from the next step on.
    pub(super) fn set(&mut self, numbers: &[(String, SettingValue)]) -> Result<(), ChangeError> {
        announce(&self.ranks, Command::Set { numbers: numbers.to_vec() });
        self.simulation.set(numbers)
    }

    /// Everything that time has changed.
    pub(super) fn save(&self, sink: &mut dyn SnapshotSink) {
        announce(&self.ranks, Command::Save);
        self.simulation.save(Some(sink));
    }
}

/// Starts the threads of all ranks, `count` each or as each finds right: with `start`, which all call together and which
/// returns their number. To be called by rank 0, once; returns the number of threads of every rank.
///
/// # Errors
/// The error of the first rank on which something went wrong.
pub fn start_threads(
    ranks: &Ranks,
    count: Option<usize>,
    start: &dyn Fn(Option<usize>) -> Result<usize, String>,
) -> Result<Vec<usize>, String> {
    announce(ranks, Command::Threads { count });
    let all = ranks.gather_encoded(THREADS, &start(count));
    let of_rank = |(rank, started): (usize, Result<usize, String>)| {
        started.map_err(|error| if rank == 0 { error } else { format!("rank {rank}: {error}") })
    };
    all.into_iter().enumerate().map(of_rank).collect()
}

/// Name of the messages that say how many threads were started.
const THREADS: &str = "number of threads";

/// Ends all other ranks, each with the exit code of rank 0. They do nothing more after that.
pub fn shut_down(ranks: &Ranks, code: u8) {
    announce(ranks, Command::End { code });
}

/// Runs a rank other than 0: carries out the commands of rank 0, until the end. `requests` are the requests that come
/// to this rank, such as signals; [`start_threads`] calls the parameter `start_threads` here. Returns the exit code.
///
/// # Panics
/// Rank 0 gives commands in an impossible sequence, which is a fault of the program.
pub fn worker_loop(
    ranks: &Ranks,
    requests: &StopRequests,
    start_threads: &dyn Fn(Option<usize>) -> Result<usize, String>,
) -> u8 {
    let mut worker = Worker::default();
    loop {
        match receive(ranks) {
            Command::End { code } => return code,
            Command::Threads { count } => drop(ranks.gather_encoded(THREADS, &start_threads(count))),
            command => worker.execute(ranks, command, requests),
        }
    }
}

/// State of a rank other than 0.
#[derive(Default)]
struct Worker {
    scene: Option<Scene>,
    simulation: Option<Simulation>,
    input: Option<FrameInput>,
}

impl Worker {
    /// Does what rank 0 does. Errors are the same there, and rank 0 reports them.
    fn execute(&mut self, ranks: &Ranks, command: Command, requests: &StopRequests) {
        let poll = || requests.poll(SystemTime::now());
        match command {
            Command::Scene => self.scene = Scene::distribute(ranks, None).ok(),
            Command::Input => {
                let scene = self.simulation.as_ref().map(Simulation::scene).or(self.scene.as_ref());
                self.input = scene.map(|scene| scene.share_input(None));
            }
            Command::Start => {
                let scene = self.scene.take().expect("a scene comes before its simulation");
                self.simulation = Simulation::new(scene, self.input()).ok();
            }
            Command::Restore => {
                let scene = self.simulation.take().expect("a simulation is started before it goes back").shared_scene();
                self.simulation = Simulation::restore_from(scene, self.input(), None).ok();
            }
            Command::Observe { tracepoints, steps } => {
                let points = tracepoints.iter().map(|text| text.parse().expect("rank 0 writes what can be read"));
                observe(self.started(), points.collect(), steps, None);
            }
            Command::Checksums => observe_checksums(self.started(), None),
            Command::Advance => {
                let input = self.input.take().expect("an input comes before its frame");
                let simulation = self.simulation.as_mut().expect("a simulation is started before it advances");
                drop(advance(ranks, simulation, &input, &mut || poll()));
                self.input = Some(input);
            }
            Command::Agree => drop(agree(ranks, poll())),
            Command::Stored { garment, velocities, units } => {
                stored(self.started(), garment, vertex_field(velocities), units);
            }
            Command::Field { garment, velocities } => {
                field_of(self.started(), garment, vertex_field(velocities));
            }
            Command::Crossings { units } => drop(crossings_of_stored(self.started(), units)),
            Command::Contact => drop(self.started().contact()),
            Command::State => drop(state(ranks, self.started())),
            Command::Save => self.started().save(None),
            Command::Set { numbers } => drop(self.started().set(&numbers)),
            // Not the simulation's business.
            Command::Threads { .. } | Command::End { .. } => {}
        }
    }

    fn input(&self) -> &FrameInput {
        self.input.as_ref().expect("an input comes before what needs it")
    }

    fn started(&mut self) -> &mut Simulation {
        self.simulation.as_mut().expect("a simulation is started before anything is asked of it")
    }
}

fn share(ranks: &Ranks, scene: &Scene, input: FrameInput) -> FrameInput {
    announce(ranks, Command::Input);
    scene.share_input(Some(input))
}

fn observe(simulation: &mut Simulation, tracepoints: Vec<Tracepoint>, steps: u64, sink: Option<Sink>) {
    let next = simulation.frame() + 1;
    simulation.observe(Some(Observer::new(tracepoints, (next, steps), sink)));
}

fn observe_checksums(simulation: &mut Simulation, sink: Option<ChecksumSink>) {
    let next = simulation.frame() + 1;
    simulation.observe(Some(Observer::of_checksums(next, sink)));
}

fn advance(
    ranks: &Ranks,
    simulation: &mut Simulation,
    input: &FrameInput,
    ask: &mut (dyn FnMut() -> Option<Request> + Send),
) -> Result<(Advance, Option<Request>), StepError> {
    let mut agreed = None;
    let mut pause = |_| {
        agreed = agree(ranks, ask());
        agreed.is_some()
    };
    let advance = simulation.advance_or_pause(input, &mut pause)?;
    Ok((advance, agreed))
}

/// Positions [m] and velocities [m/s] of all vertices in the order of the scene, in which ranks follow each other; on rank 0.
fn state(ranks: &Ranks, simulation: &Simulation) -> [Vec<Vec3>; 2] {
    let (state, own) = (simulation.state(), simulation.scene().parts().own());
    [&state.x, &state.v].map(|field| ranks.gather(&field[own.clone()]).concat())
}

/// The most urgent of what the ranks are asked for.
fn agree(ranks: &Ranks, own: Option<Request>) -> Option<Request> {
    if ranks.is_alone() { own } else { Request::of_urgency(ranks.max(Request::urgency(own))) }
}

/// A field of a garment as caches in `units` store it; on rank 0.
fn stored(simulation: &Simulation, garment: usize, field: VertexField, units: Units) -> Option<Vec<[f32; 3]>> {
    let origin = simulation.scene().origin();
    match field {
        VertexField::Positions => simulation.stored(garment, field, &|x| units.stored_from(origin, *x)),
        VertexField::Velocities => simulation.stored(garment, field, &|v| units.stored(*v)),
    }
}

fn vertex_field(velocities: bool) -> VertexField {
    if velocities { VertexField::Velocities } else { VertexField::Positions }
}

/// A field of a garment in its own order; on rank 0.
fn field_of(simulation: &Simulation, garment: usize, field: VertexField) -> Vec<Vec3> {
    let mut values = Vec::new();
    match field {
        VertexField::Positions => simulation.garment_positions(garment, &mut values),
        VertexField::Velocities => simulation.garment_velocities(garment, &mut values),
    }
    values
}

/// Crossings of cloth with cloth where caches in `units` have its vertices, counted from their origin as they are stored:
/// nothing is rounded but what the caches round.
fn crossings_of_stored(simulation: &mut Simulation, units: Units) -> u32 {
    let origin = simulation.scene().origin();
    simulation.crossings_when(&|x| Vec3::from(units.stored_from(origin, *x).map(f64::from)))
}

#[cfg(test)]
mod tests {
    use drapery_core::parallel::local_ranks::LocalRanks;
    use drapery_io::units::{LengthUnit, UpAxis};

    use super::*;

    #[test]
    fn commands_come_to_other_ranks_as_they_were_announced() {
        let units = Units { length: LengthUnit::Inch, up: UpAxis::Z };
        let all = [
            Command::Threads { count: None },
            Command::Threads { count: Some(7) },
            Command::Observe { tracepoints: vec!["B.4@1002.1".to_owned(), "C".to_owned()], steps: u64::MAX },
            Command::Stored { garment: 3, velocities: true, units },
            Command::Crossings { units: Units::SI },
            Command::Save,
            Command::End { code: 75 },
        ];
        let received = LocalRanks::run(3, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let through = |command: &Command| {
                if ranks.is_first() {
                    announce(&ranks, command.clone())
                } else {
                    return format!("{:?}", receive(&ranks));
                }
                format!("{command:?}")
            };
            all.iter().map(through).collect::<Vec<_>>()
        });
        for of_rank in received.expect("no rank ends early") {
            assert_eq!(of_rank, all.each_ref().map(|command| format!("{command:?}")));
        }
    }

    #[test]
    fn threads_are_started_on_every_rank_and_the_first_failure_is_named_with_its_rank() {
        let started = LocalRanks::run(3, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let start = |count: Option<usize>| match (count, ranks.rank()) {
                (Some(_), 2) => Err("no threads".to_owned()),
                (count, rank) => Ok(count.unwrap_or(10 + rank)),
            };
            if !ranks.is_first() {
                worker_loop(&ranks, &StopRequests::default(), &start);
                return Vec::new();
            }
            let both = vec![start_threads(&ranks, None, &start), start_threads(&ranks, Some(4), &start)];
            shut_down(&ranks, 0);
            both
        });
        let both = &started.expect("no rank ends early")[0];
        assert_eq!(both[0], Ok(vec![10, 11, 12]));
        assert_eq!(both[1], Err("rank 2: no threads".to_owned()));
    }
}
