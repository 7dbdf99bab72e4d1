//! A shot on ranks that are threads of this process.

use std::panic::resume_unwind;
use std::sync::{Mutex, PoisonError};

use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_shot::ShotError;
use drapery_shot::farm::stop::StopRequests;
use drapery_shot::remote_simulation;

/// Does something on rank 0 of `ranks` ranks with `threads` threads each; the others follow it.
///
/// # Errors
/// As `work`.
///
/// # Panics
/// A rank panics, or no thread can be started for it.
pub(crate) fn on_local_ranks<T: Send>(
    ranks: usize,
    threads: usize,
    work: impl FnOnce(&Ranks) -> Result<T, ShotError> + Send,
) -> Result<T, ShotError> {
    let work = Mutex::new(Some(work));
    let take = || work.lock().unwrap_or_else(PoisonError::into_inner).take();
    let done = LocalRanks::run(ranks, threads, |communicator| {
        let ranks = Ranks::new(communicator);
        if !ranks.is_first() {
            remote_simulation::worker_loop(&ranks, &StopRequests::default(), &|_| Ok(threads));
            return None;
        }
        let done = take().map(|work| work(&ranks));
        remote_simulation::shut_down(&ranks, 0);
        done
    });
    match done.map(|results| results.into_iter().next().flatten()) {
        Ok(Some(result)) => result,
        Ok(None) => unreachable!("the first rank does the work, once"),
        Err(error) => resume_unwind(Box::new(error.message)),
    }
}
