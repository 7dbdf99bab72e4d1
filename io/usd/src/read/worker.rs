//! The thread that a stage lives on.
//!
//! Stages that `openusd` composes belong to one thread, while readers here go from thread to thread; and damaged
//! layers may make it panic. So a stage stays on a thread of its own, which answers questions. A panic there is the
//! answer to one question, an error like any other, and everything that this stage is asked afterwards gets the same
//! answer: what it left half done is not trusted.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{self, Sender};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, JoinHandle};

/// Stack of the thread [bytes]: parsers go down with the nesting of a layer. What is not used takes no memory.
const STACK: usize = 64 << 20;

thread_local! {
    /// Whether a panic on this thread is an answer.
    static ANSWERS: Cell<bool> = const { Cell::new(false) };
}

/// Whether a panic on this thread becomes an error, of which somebody else tells the user.
pub fn answers_panics() -> bool {
    ANSWERS.get()
}

type Job<S> = Box<dyn FnOnce(&S) + Send>;

/// Something that stays on its own thread, and can be asked.
pub(crate) struct Worker<S: 'static> {
    /// Taken when the thread is to end.
    jobs: Option<Sender<Job<S>>>,
    thread: Option<JoinHandle<()>>,
    /// Message of the first panic.
    broken: Mutex<Option<Panicked>>,
}

/// Message of the library when it gave up.
#[derive(Debug, Clone)]
pub(crate) struct Panicked(pub(crate) String);

impl<S: 'static> Worker<S> {
    /// Makes what is asked later, on its thread.
    ///
    /// The error is that of `make`, or of a panic in it.
    pub(crate) fn start<E: Send + From<Panicked> + 'static>(
        make: impl FnOnce() -> Result<S, E> + Send + 'static,
    ) -> Result<Self, E> {
        let (jobs, to_do) = mpsc::channel::<Job<S>>();
        let (answer, made) = mpsc::channel();
        let run = move || {
            ANSWERS.set(true);
            let state = match attempt(make) {
                Ok(Ok(state)) => state,
                Ok(Err(error)) => return drop(answer.send(Err(error))),
                Err(panicked) => return drop(answer.send(Err(panicked.into()))),
            };
            drop(answer.send(Ok(())));
            to_do.into_iter().for_each(|job| job(&state));
            // What is dropped may be as damaged as what was read.
            drop(catch_unwind(AssertUnwindSafe(|| drop(state))));
        };
        let thread = thread::Builder::new()
            .name("usd".to_owned())
            .stack_size(STACK)
            .spawn(run)
            .map_err(|error| Panicked(format!("no thread could be started: {error}")))?;
        let worker = Self { jobs: Some(jobs), thread: Some(thread), broken: Mutex::default() };
        match made.recv() {
            Ok(Ok(())) => Ok(worker),
            Ok(Err(error)) => Err(error),
            Err(_) => Err(Panicked("its thread has ended".to_owned()).into()),
        }
    }

    /// Asks, and waits for the answer.
    pub(crate) fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&S) -> T + Send + 'static,
    ) -> Result<T, Panicked> {
        let mut broken = self.broken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(panicked) = &*broken {
            return Err(panicked.clone());
        }
        let (answer, given) = mpsc::channel();
        let job: Job<S> = Box::new(move |state| drop(answer.send(attempt(|| question(state)))));
        let ended = || Panicked("its thread has ended".to_owned());
        self.jobs.as_ref().ok_or_else(ended)?.send(job).map_err(|_| ended())?;
        let given = given.recv().unwrap_or_else(|_| Err(ended()));
        given.inspect_err(|panicked| *broken = Some(panicked.clone()))
    }
}

impl<S> Drop for Worker<S> {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has been reported already.
            drop(thread.join());
        }
    }
}

/// The value, or what the panic said.
fn attempt<T>(work: impl FnOnce() -> T) -> Result<T, Panicked> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        Panicked(text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    impl From<Panicked> for String {
        fn from(panicked: Panicked) -> Self {
            panicked.0
        }
    }

    #[test]
    fn a_panic_is_an_answer_to_that_question_and_to_all_after_it() {
        let worker = Worker::start(|| Ok::<_, String>(std::rc::Rc::new(7))).ok().unwrap();
        assert_eq!(worker.ask(|state| **state + 1).ok(), Some(8));
        let panicked = worker.ask(|_| -> u32 { panic!("a damaged layer") }).err().unwrap();
        assert_eq!(panicked.0, "a damaged layer");
        assert_eq!(worker.ask(|state| **state).err().unwrap().0, "a damaged layer");
        let failed = Worker::<u32>::start(|| -> Result<u32, String> { panic!("at once") });
        assert_eq!(failed.err().unwrap(), "at once");
        assert!(!answers_panics());
    }
}
