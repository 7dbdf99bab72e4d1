//! The ranks of this run: the processes that `mpirun` has started, or this one alone. Rank 0 does what the command says; the
//! others follow it in `run`, and wait for its end in everything else.

use drapery_core::parallel::ranks::Ranks;
use drapery_shot::farm::process::Owner;
use drapery_shot::farm::stop::StopRequests;
use drapery_shot::remote_simulation;

use crate::args::Command;
use crate::config::Resolved;
use crate::exit_code::ExitCode;
use crate::failure::{Failure, MORE_THREADS};
use crate::signals::{self, Unasked};

#[cfg(feature = "mpi")]
pub(crate) use crate::lost_rank::{Heartbeat, writes_into};

/// Variables by which launchers say which of their processes this one is: those of Open MPI, of PMIx, and of MPICH, Intel MPI
/// and Slurm.
const RANK: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK"];

/// Variables by which they say how many there are.
#[cfg(not(feature = "mpi"))]
const SIZE: [&str; 3] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_NTASKS"];

/// The first of these variables that is a number.
fn variable(names: &[&str]) -> Option<usize> {
    names.iter().find_map(|name| std::env::var(name).ok()?.trim().parse().ok())
}

/// Whether this process speaks for all when they have not found each other.
pub(crate) fn is_spokesman() -> bool {
    variable(&RANK).unwrap_or(0) == 0
}

/// Joins the ranks that a launcher has started.
#[cfg(feature = "mpi")]
pub(crate) fn join(_command: Option<&Command>) -> Result<Ranks, Failure> {
    match drapery_mpi::World::start() {
        Ok(Some(world)) => Ok(Ranks::new(std::sync::Arc::new(world))),
        Ok(None) => Ok(Ranks::default()),
        Err(error) => Err(Failure::new(ExitCode::Usage, error.to_string())),
    }
}

/// This process alone. One of many that run the same shot is refused: they would fight for one folder.
#[cfg(not(feature = "mpi"))]
pub(crate) fn join(command: Option<&Command>) -> Result<Ranks, Failure> {
    // Tasks of Slurm alone may be anything; those that its launcher connects have a rank.
    let many = variable(&RANK).and_then(|_| variable(&SIZE)).filter(|count| *count > 1);
    match (many, command) {
        (Some(count), Some(Command::Run(_))) => Err(Failure::new(
            ExitCode::Usage,
            format!(
                "started as one of {count} processes, but this program was built without MPI: each would simulate the whole \
                 shot into the same folder\n  help: start it without mpirun, or build it with \
                 `cargo build --release -p drapery --features mpi`"
            ),
        )),
        _ => Ok(Ranks::default()),
    }
}

/// Heartbeat of a program without MPI, which sends none.
#[cfg(not(feature = "mpi"))]
pub(crate) struct Heartbeat;

#[cfg(not(feature = "mpi"))]
impl Heartbeat {
    pub(crate) fn start(_ranks: &Ranks) -> (Self, Result<(), Failure>) {
        (Self, Ok(()))
    }

    pub(crate) fn bye(&self, _code: u8) {}
}

/// Nobody asks for the folder of the run.
#[cfg(not(feature = "mpi"))]
pub(crate) fn writes_into(_folder: &std::path::Path) {}

/// Does the work of a rank other than 0; returns its exit code.
pub(crate) fn follow(command: &Command, ranks: &Ranks) -> u8 {
    let requests = StopRequests::default();
    // What the settings say of exit codes is known to rank 0, which ends with them.
    let unasked = Unasked { code: ExitCode::Stopped as u8, by_term: false, command: "the same command".to_owned() };
    let listening = match command {
        Command::Run(_) => signals::listen(&requests, &unasked).map_err(|failure| failure.to_string()),
        _ => Ok(()),
    };
    remote_simulation::worker_loop(ranks, &requests, &|threads| {
        let started = start_pool(ranks, threads);
        listening.clone().and(started)
    })
}

/// Starts the threads of all ranks: the number asked for on each, or else the processors that each has for itself. Returns the
/// number on this one, and on all.
pub(crate) fn start_threads(
    ranks: &Ranks,
    asked: Option<Resolved<usize>>,
) -> Result<(Resolved<usize>, Vec<usize>), Failure> {
    let source = match &asked {
        Some(asked) => asked.source,
        None if ranks.is_alone() => "cores of this machine",
        None => "cores of this machine, shared by its ranks",
    };
    let all =
        remote_simulation::start_threads(ranks, asked.map(|asked| asked.value), &|threads| start_pool(ranks, threads));
    let all = all.map_err(|error| Failure::new(ExitCode::NoMemory, error))?;
    Ok((Resolved { value: all[0], source }, all))
}

/// Makes the pool that all parallel work uses; returns the number of its threads. All ranks call it together.
fn start_pool(ranks: &Ranks, threads: Option<usize>) -> Result<usize, String> {
    let threads = threads.unwrap_or_else(|| processors(ranks));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.map(|()| threads)
        .map_err(|error| format!("{threads} threads could not be started: {error}\n  help: {MORE_THREADS}"))
}

/// Processors that this rank has for itself: those that it may use, divided by the ranks on this machine that may use the same.
fn processors(ranks: &Ranks) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    if ranks.is_alone() {
        return cores;
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    // A launcher may have bound each rank to processors of its own.
    let allowed = status.lines().find(|line| line.starts_with("Cpus_allowed_list:")).unwrap_or_default();
    let Owner { host, boot, .. } = Owner::this_process();
    let own = format!("{host} {boot} {allowed}");
    let sharing = ranks.all_gather_v(own.as_bytes()).iter().filter(|other| **other == own.as_bytes()).count();
    (cores / sharing.max(1)).max(1)
}

/// The command line that starts a program on as many ranks.
pub(crate) fn launcher(ranks: usize) -> String {
    if ranks > 1 { format!("mpirun -n {ranks} ") } else { String::new() }
}
