//! Lines on standard error while a command prepares something large: what it is at, so that nobody takes it for dead.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// When the first line is due, and how long until the next.
const DUE: [Duration; 2] = [Duration::from_secs(4), Duration::from_secs(20)];

/// Current activity of the program.
static AT: Mutex<String> = Mutex::new(String::new());

/// Says what the program is at from now on.
pub(crate) fn at(what: impl Into<String>) {
    // A text is whole at every moment.
    *AT.lock().unwrap_or_else(PoisonError::into_inner) = what.into();
}

/// Says from time to time what the program is at, until it is dropped.
#[derive(Debug)]
pub(crate) struct Patience {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Patience {
    /// From now on, on standard error.
    pub(crate) fn start() -> Self {
        Self::saying(DUE, |line| crate::say::complaint(format_args!("{line}")))
    }

    fn saying([first, next]: [Duration; 2], say: impl Fn(String) + Send + 'static) -> Self {
        let (end, ended) = channel();
        let begun = Instant::now();
        let lines = move || {
            let mut wait = first;
            while ended.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                let at = AT.lock().unwrap_or_else(PoisonError::into_inner).clone();
                if !at.is_empty() {
                    say(format!("{at}; {} s so far", begun.elapsed().as_secs()));
                }
                wait = next;
            }
        };
        // Without a thread the work goes on, in silence.
        let thread = thread::Builder::new().name("patience".to_owned()).spawn(lines).ok();
        Self { end: Some(end), thread }
    }
}

impl Drop for Patience {
    fn drop(&mut self) {
        drop(self.end.take());
        // It has nothing to give back, also if it has panicked.
        self.thread.take().map(JoinHandle::join);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn what_takes_long_is_said_again_and_again_and_what_ends_soon_never() {
        let said = Arc::new(Mutex::new(Vec::new()));
        let heard = said.clone();
        let soon = Duration::from_millis(1);
        at("building 1 garment");
        let patience = Patience::saying([soon, soon], move |line| heard.lock().expect("no panic").push(line));
        // As often as the machine gets to it.
        while said.lock().expect("no panic").len() < 2 {
            thread::sleep(soon);
        }
        drop(patience);
        assert!(said.lock().expect("no panic").iter().all(|line| line.starts_with("building 1 garment; ")));
        let count = said.lock().expect("no panic").len();
        thread::sleep(10 * soon);
        assert_eq!(said.lock().expect("no panic").len(), count, "nothing is said after the end");
        let begun = Instant::now();
        drop(Patience::saying([Duration::from_secs(3600); 2], |line| panic!("{line}")));
        assert!(begun.elapsed() < Duration::from_secs(3600), "nobody waits for a line that is not due");
    }
}
