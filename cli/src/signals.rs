//! Signals with which schedulers and people ask a run to stop. The program does not die of them, and does not send them
//! on to itself: farm software takes death by a signal for the wish of a person, and does not start the job again. Where
//! a site wants just that (`--on-term signal`), it ends by SIGTERM once everything is on the disk.

use std::time::SystemTime;

use drapery_shot::farm::stop::{Signal, StopRequests};
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU};
use signal_hook::iterator::Signals;

use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// The signals, and what they are called where they are obeyed.
const HEARD: [(i32, Signal); 5] = [
    (SIGTERM, Signal::Terminate),
    (SIGUSR1, Signal::User1),
    (SIGUSR2, Signal::User2),
    (SIGINT, Signal::Interrupt),
    (SIGXCPU, Signal::CpuLimit),
];

/// Hands signals on as requests, from now until the program ends. To be called once, before anything takes long.
pub(crate) fn listen(requests: &StopRequests) -> Result<(), Failure> {
    let failure = |error| Failure::new(ExitCode::Internal, format!("signals cannot be listened to: {error}"));
    let mut signals = Signals::new(HEARD.map(|(number, _)| number)).map_err(failure)?;
    let requests = requests.clone();
    // A thread of its own and no work in the handler: it may look at a clock and take a lock.
    let listen = move || {
        for number in signals.forever() {
            if let Some((_, signal)) = HEARD.iter().find(|(heard, _)| *heard == number) {
                requests.signal(*signal, SystemTime::now());
            }
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(listen).map_err(failure)?;
    Ok(())
}

/// Exit code that a shell shows for a program that SIGTERM has ended.
pub(crate) const ENDED_BY_TERM: u8 = 128 + SIGTERM as u8;

/// Ends the program by SIGTERM. If the system refuses, it is left to end with the exit code that shells show for this.
pub(crate) fn end_by_term() {
    let _ = signal_hook::low_level::emulate_default_handler(SIGTERM);
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_shot::farm::stop::{Reason, Request};
    use std::time::{Duration, Instant};

    /// What is asked for, once that is no longer what it was.
    fn poll_until_new(requests: &StopRequests, old: Option<Request>) -> Option<Request> {
        let deadline = Instant::now() + Duration::from_secs(20);
        while requests.poll(SystemTime::now()) == old && Instant::now() < deadline {
            std::thread::yield_now();
        }
        requests.poll(SystemTime::now())
    }

    #[test]
    fn signals_become_requests_and_the_process_lives_on() {
        for (number, signal) in HEARD {
            let requests = StopRequests::default();
            // Listeners of earlier rounds hear it as well.
            listen(&requests).unwrap();
            signal_hook::low_level::raise(number).unwrap();
            let first = poll_until_new(&requests, None);
            assert_eq!(first, Some(Request::Stop(Reason::Signal(signal))));
            let (second, as_signal) =
                if number == SIGTERM { (SIGINT, Signal::Interrupt) } else { (SIGTERM, Signal::Terminate) };
            signal_hook::low_level::raise(second).unwrap();
            let now = poll_until_new(&requests, first);
            assert_eq!(now, Some(Request::StopAtOnce(Reason::Signal(as_signal))));
        }
    }
}
