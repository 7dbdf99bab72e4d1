//! What will be done: the scene with its files opened, threads and folder resolved, each with where it came from.

use std::path::PathBuf;

use drapery_io::scene_file;
use drapery_io::shot::Shot;

use crate::args::{FrameRange, SceneArgs};
use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// Environment variables that give the number of threads, the first one wins.
const THREAD_VARIABLES: [&str; 4] = ["DRAPERY_THREADS", "OMP_NUM_THREADS", "CUE_THREADS", "SLURM_CPUS_PER_TASK"];

/// Number of threads and who said so.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Threads {
    pub(crate) count: usize,
    pub(crate) source: &'static str,
}

impl Threads {
    /// Flag, then environment, then the cores of the machine.
    pub(crate) fn choose(flag: Option<u16>) -> Self {
        Self::from_sources(flag, |name| std::env::var(name).ok())
    }

    fn from_sources(flag: Option<u16>, variable: impl Fn(&str) -> Option<String>) -> Self {
        if let Some(count) = flag {
            return Self { count: count.into(), source: "--threads" };
        }
        for name in THREAD_VARIABLES {
            let Some(text) = variable(name) else { continue };
            // OMP_NUM_THREADS may be a list, one number a nesting level.
            match text.split(',').next().unwrap_or_default().trim().parse() {
                Ok(count) if count > 0 => return Self { count, source: name },
                _ => tracing::warn!("{name}={text} is not a number of threads and is passed over"),
            }
        }
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { count: cores, source: "cores of this machine" }
    }

    /// Makes the pool that all parallel work uses.
    pub(crate) fn start_pool(&self) -> Result<(), Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.count).build_global();
        pool.map_err(|e| Failure::new(ExitCode::Internal, format!("{} threads could not be started: {e}", self.count)))
    }
}

/// The shot that the arguments name, checked, and the threads it will use.
pub(crate) fn prepare(args: &SceneArgs) -> Result<(Shot, Threads), Failure> {
    let threads = Threads::choose(args.threads);
    threads.start_pool()?;
    let description = scene_file::load(&args.scene, &args.settings)?.resolve()?;
    let frames = args.frames.map(|FrameRange { first, last }| [first, last]);
    let shot = Shot::prepare(description, frames)?;
    for warning in shot.warnings() {
        tracing::warn!("{warning}");
    }
    Ok((shot, threads))
}

/// Where a run of this shot goes when nobody says.
pub(crate) fn default_folder(shot: &Shot) -> PathBuf {
    PathBuf::from("out").join(shot.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_flag_wins_over_the_environment_and_that_over_the_cores() {
        let set = |name: &str| match name {
            "OMP_NUM_THREADS" => Some("3,2".to_owned()),
            "CUE_THREADS" => Some("7".to_owned()),
            _ => None,
        };
        assert_eq!(Threads::from_sources(Some(5), set), Threads { count: 5, source: "--threads" });
        assert_eq!(Threads::from_sources(None, set), Threads { count: 3, source: "OMP_NUM_THREADS" });
        let broken = |name: &str| (name == "DRAPERY_THREADS").then(|| "many".to_owned());
        assert_eq!(Threads::from_sources(None, broken).source, "cores of this machine");
    }
}
