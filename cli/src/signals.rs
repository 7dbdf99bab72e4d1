//! Signals with which schedulers and people ask a run to stop. The program does not die of them, and does not send them
//! on to itself: farm software takes death by a signal for the wish of a person, and does not start the job again. Where
//! a site wants just that (`--on-term signal`), it ends by SIGTERM once everything is on the disk.
//!
//! SIGHUP comes when a terminal closes or a connection breaks. It is obeyed unless the program was started to survive it (by nohup).
//!
//! Inputs that take minutes to read, and steps that take minutes, do not ask for requests. Where nothing was simulated yet, or a
//! second signal came, the program ends without being asked after a while: as after SIGKILL, files are what they were at the last
//! checkpoint, but with the exit code of a stop.

use std::time::{Duration, SystemTime};

use drapery_shot::farm::stop::{Reason, Signal, SignalOrder, StopRequests};
use signal_hook::consts::SIGTERM;
#[cfg(unix)]
use signal_hook::consts::{SIGHUP, SIGINT, SIGUSR1, SIGUSR2, SIGXCPU, SIGXFSZ};

use crate::failure::Failure;
use crate::say;

/// The signals, and what they are called where they are obeyed.
#[cfg(unix)]
const HEARD: [(i32, Signal); 6] = [
    (SIGTERM, Signal::Terminate),
    (SIGUSR1, Signal::User1),
    (SIGUSR2, Signal::User2),
    (SIGINT, Signal::Interrupt),
    (SIGXCPU, Signal::CpuLimit),
    (SIGHUP, Signal::HangUp),
];

/// Time for the run to end at a state that it can resume from: after a signal before its first step, and after a second signal.
const PATIENCE: [Duration; 2] = [Duration::from_secs(5), Duration::from_secs(3)];

/// The run asks for requests once before its first step; there is nothing to be saved then.
const START: u64 = 1;

/// Hands signals on as requests, from now until the program ends. To be called once, before anything takes long. `unasked` is what
/// the program ends with where the run does not ask for requests.
pub(crate) fn listen(requests: &StopRequests, unasked: &Unasked) -> Result<(), Failure> {
    let (requests, unasked) = (requests.clone(), unasked.clone());
    let hear = move |signal| {
        let order = requests.signal(signal, SystemTime::now());
        unasked.watch(&requests, signal, order);
    };
    on_each_signal(hear).map_err(|error| Failure::refused("signals cannot be listened to", &error))
}

/// Calls `hear` with each signal, on a thread of its own and not in the handler: it may look at a clock and take a lock.
#[cfg(unix)]
fn on_each_signal(hear: impl Fn(Signal) + Send + 'static) -> std::io::Result<()> {
    let heard = HEARD.iter().map(|(number, _)| *number).filter(|number| *number != SIGHUP || !is_ignored(SIGHUP));
    let mut signals = signal_hook::iterator::Signals::new(heard)?;
    let listen = move || {
        for number in signals.forever() {
            HEARD.iter().filter(|(heard, _)| *heard == number).for_each(|(_, signal)| hear(*signal));
        }
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(listen).map(drop)
}

/// The same on Windows, where Ctrl-C and Ctrl-Break are all that can be heard.
#[cfg(windows)]
fn on_each_signal(hear: impl Fn(Signal) + Send + 'static) -> std::io::Result<()> {
    ctrlc::set_handler(move || hear(Signal::Interrupt)).map_err(std::io::Error::other)
}

/// From now on a file that may not grow any more (`ulimit -f`) is an error of writing, and does not end the program by a signal.
pub(crate) fn outlive_limits_of_files() -> Result<(), Failure> {
    // Windows sets no such limit.
    #[cfg(unix)]
    signal_hook::flag::register(SIGXFSZ, std::sync::Arc::default())
        .map_err(|error| Failure::refused("limits of files cannot be watched", &error))?;
    Ok(())
}

/// Whether the parent process wants the program to ignore a signal, as `nohup` does; taken for granted where the system does
/// not tell.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_none_or(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Exit of the program where the run does not ask for requests.
#[derive(Debug, Clone)]
pub(crate) struct Unasked {
    /// Exit code.
    pub(crate) code: u8,
    /// Whether SIGTERM ends it by itself instead (`--on-term signal`).
    pub(crate) by_term: bool,
    /// The command that continues the run.
    pub(crate) command: String,
}

impl Unasked {
    /// Ends the program after a while, if the run may be ended now and has not asked for requests by then.
    fn watch(&self, requests: &StopRequests, signal: Signal, order: SignalOrder) {
        let Some(before) = requests.polls() else { return };
        let patience = match order {
            SignalOrder::First if before <= START => PATIENCE[0],
            SignalOrder::Later => PATIENCE[1],
            _ => return,
        };
        let (requests, Self { code, by_term, command }) = (requests.clone(), self.clone());
        let end = move || {
            std::thread::sleep(patience);
            if requests.polls() != Some(before) {
                return;
            }
            let reason = Reason::Signal(signal);
            let when = if before <= START { "before the first step was complete" } else { "during a step" };
            say::complaint(format_args!(
                "stopped ({reason}) {when}, without another checkpoint; continue with: {command}"
            ));
            if by_term && signal == Signal::Terminate {
                end_by_term();
            }
            // Whatever the other threads are in the middle of, it is not waited for.
            signal_hook::low_level::exit(code.into());
        };
        // Without a thread, the run ends when it asks.
        let _ = std::thread::Builder::new().name("patience".to_owned()).spawn(end);
    }
}

/// Exit code that a shell shows for a program that SIGTERM has ended.
pub(crate) const ENDED_BY_TERM: u8 = 128 + SIGTERM as u8;

/// Ends the program by SIGTERM. If the system refuses, it is left to end with the exit code that shells show for this.
pub(crate) fn end_by_term() {
    let _ = signal_hook::low_level::emulate_default_handler(SIGTERM);
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use drapery_shot::farm::stop::{Reason, Request};
    use std::time::{Duration, Instant};

    /// Polls until the request differs from `old`, for at most 20 s; returns the last request.
    fn poll_until_new(requests: &StopRequests, old: Option<Request>) -> Option<Request> {
        let deadline = Instant::now() + Duration::from_secs(20);
        while requests.poll(SystemTime::now()) == old && Instant::now() < deadline {
            std::thread::yield_now();
        }
        requests.poll(SystemTime::now())
    }

    #[test]
    fn signals_become_requests_and_the_process_lives_on() {
        let unasked = Unasked { code: 75, by_term: false, command: "drapery run".to_owned() };
        // The parent process of the tests may have asked for some to be ignored.
        for (number, signal) in HEARD.into_iter().filter(|(number, _)| *number != SIGHUP || !is_ignored(SIGHUP)) {
            let requests = StopRequests::default();
            // A run that has begun to step.
            assert_eq!(requests.poll(SystemTime::now()), None);
            // Listeners of earlier rounds hear it as well.
            listen(&requests, &unasked).unwrap();
            signal_hook::low_level::raise(number).unwrap();
            let first = poll_until_new(&requests, None);
            assert_eq!(first, Some(Request::Stop(Reason::Signal(signal))));
            let (second, as_signal) =
                if number == SIGTERM { (SIGINT, Signal::Interrupt) } else { (SIGTERM, Signal::Terminate) };
            signal_hook::low_level::raise(second).unwrap();
            let now = poll_until_new(&requests, first);
            requests.finish();
            assert_eq!(now, Some(Request::StopAtOnce(Reason::Signal(as_signal))));
        }
    }
}
