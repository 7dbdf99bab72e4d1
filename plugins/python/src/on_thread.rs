//! Work on a thread of its own, while the thread that called answers Python: it runs signal handlers, so that Ctrl-C is heard,
//! and calls back, so that callbacks run where the program expects them. Python's lock is not held meanwhile.

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread;
use std::time::{Duration, Instant};

use drapery_shot::fault::{Fault, FaultKind};
use pyo3::prelude::*;

use crate::errors::raised;

/// Interval between checks for signals.
const EVERY: Duration = Duration::from_millis(50);

/// Stack of the thread [bytes], as large as a main thread has on Linux; a thread of the standard library has a quarter.
const STACK_BYTES: usize = 8 << 20;

/// Something to be done by the thread that called.
type Call = Box<dyn FnOnce(Python<'_>) -> PyResult<()> + Send>;

/// The thread that called, as the work sees it.
#[derive(Clone)]
pub(crate) struct Caller {
    calls: Sender<(Call, Sender<()>)>,
    cancelled: Arc<AtomicBool>,
}

impl Caller {
    /// Does something on the thread that called, with Python's lock, and waits for it. What it raises cancels the work.
    pub(crate) fn call(&self, work: impl FnOnce(Python<'_>) -> PyResult<()> + Send + 'static) {
        let (done, waits) = mpsc::channel();
        if self.calls.send((Box::new(work), done)).is_ok() {
            // An end without an answer is one, too.
            let _ = waits.recv();
        }
    }

    /// Whether the work is to end: a signal or a call has raised something.
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// The same for a caller that keeps it.
    pub(crate) fn cancelled(&self) -> Arc<AtomicBool> {
        self.cancelled.clone()
    }
}

/// Does the work; raises what a signal or a call has raised meanwhile, else what went wrong.
pub(crate) fn on_thread<T: Send>(py: Python<'_>, work: impl FnOnce(&Caller) -> Result<T, Fault> + Send) -> PyResult<T> {
    let (calls, inbox) = mpsc::channel::<(Call, Sender<()>)>();
    let cancelled = Arc::new(AtomicBool::new(false));
    let caller = Caller { calls, cancelled: cancelled.clone() };
    py.detach(move || {
        thread::scope(|scope| {
            let build = thread::Builder::new().name("drapery".to_owned()).stack_size(STACK_BYTES);
            let worker = build.spawn_scoped(scope, move || work(&caller)).map_err(|error| {
                raised(Fault::new(FaultKind::NoMemory, format!("a thread could not be started: {error}")))
            })?;
            let (mut raises, mut looked) = (None, Instant::now());
            let mut keep = |result: PyResult<()>| {
                if let Err(error) = result {
                    cancelled.store(true, Ordering::Relaxed);
                    raises.get_or_insert(error);
                }
            };
            loop {
                match inbox.recv_timeout(EVERY) {
                    Ok((call, done)) => {
                        keep(Python::attach(call));
                        // The work may have ended meanwhile.
                        let _ = done.send(());
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                if looked.elapsed() >= EVERY {
                    looked = Instant::now();
                    keep(Python::attach(|py| py.check_signals()));
                }
            }
            let done = worker.join();
            raises.map_or(Ok(()), Err)?;
            match done {
                Ok(result) => result.map_err(raised),
                Err(panic) => Err(raised(Fault::new(
                    FaultKind::Internal,
                    format!("this is a bug in Drapery; please report it with this text: {}", words(&*panic)),
                ))),
            }
        })
    })
}

/// Returns the message of a panic.
fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no words")
}
