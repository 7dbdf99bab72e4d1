//! Ranks as threads of one process, with channels between them: the whole distributed path without any MPI.
//!
//! A rank that panics, or that ends while another still wants a message of it, closes its channels. A rank that waits
//! for it then unwinds as well, silently, and closes its own: so all ranks end, and the caller learns who was the first.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::parallel::communicator::{Communicator, Exchange, Expected, Message};

/// Ranks as threads of this process.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{FrameInput, LocalRanks, Ranks, Scene, Simulation};
/// let steps = LocalRanks::run(2, 1, |communicator| {
///     let ranks = Ranks::new(communicator);
///     let scene = Scene::distribute(&ranks, ranks.is_first().then(|| description.clone())).expect("a valid scene");
///     let mut simulation = Simulation::new(scene, &FrameInput::to_frame(0)).expect("a valid start");
///     simulation.advance(&FrameInput::to_frame(1)).expect("a step of free fall").steps
/// });
/// assert!(steps.is_ok_and(|steps| steps[0] == steps[1]));
/// ```
#[derive(Debug)]
pub struct LocalRanks;

/// Why ranks ended before their work was done.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("rank {rank}: {message}")]
pub struct CommError {
    /// The rank that was the first to fail.
    pub rank: usize,
    /// Description of its failure.
    pub message: String,
}

impl LocalRanks {
    /// Calls `work` once on each of `ranks` ranks, all at the same time, and returns the results in the order of ranks.
    ///
    /// Each rank works inside its own pool of `threads` threads (zero: as many as the machine has). An error names the
    /// first rank that panicked, after all of them have ended; if none did, one that missed a message of a rank that
    /// had already returned.
    pub fn run<T: Send>(
        ranks: usize,
        threads: usize,
        work: impl Fn(Arc<dyn Communicator>) -> T + Sync,
    ) -> Result<Vec<T>, CommError> {
        let failures = Failures::default();
        let results = std::thread::scope(|scope| {
            let mut running = Vec::new();
            for (rank, lines) in connect(ranks).enumerate() {
                let (work, failures) = (&work, &failures);
                let life = move || live(LocalRank::new(rank, ranks, lines), threads, work, failures);
                match std::thread::Builder::new().name(format!("rank {rank}")).spawn_scoped(scope, life) {
                    Ok(thread) => running.push(thread),
                    Err(e) => failures.panicked(rank, format!("no thread for it: {e}")),
                }
            }
            // A rank's thread catches what its work throws: joining it fails only if recording that failed.
            running.into_iter().map(|thread| thread.join().ok().flatten()).collect::<Option<Vec<T>>>()
        });
        match (failures.first(), results) {
            (None, Some(results)) => Ok(results),
            (Some(failure), _) => Err(failure),
            (None, None) => unreachable!("a rank without a result has left its failure"),
        }
    }
}

/// First failure of each kind, the kinds in order of precedence.
#[derive(Default)]
struct Failures {
    panicked: Mutex<Option<CommError>>,
    lost: Mutex<Option<CommError>>,
}

impl Failures {
    fn panicked(&self, rank: usize, message: String) {
        lock(&self.panicked).get_or_insert(CommError { rank, message });
    }

    fn lost(&self, rank: usize, peer: usize) {
        let message = format!("it waited for rank {peer}, which had already ended");
        lock(&self.lost).get_or_insert(CommError { rank, message });
    }

    fn first(&self) -> Option<CommError> {
        lock(&self.panicked).take().or_else(|| lock(&self.lost).take())
    }
}

/// Thrown by a rank whose peer is gone.
struct Lost {
    peer: usize,
}

/// The thread of a rank: works, leaves a failure if there was one, and only then lets the others notice.
fn live<T: Send>(
    rank: LocalRank,
    threads: usize,
    work: &(impl Fn(Arc<dyn Communicator>) -> T + Sync),
    failures: &Failures,
) -> Option<T> {
    let number = rank.rank;
    let name = move |thread| format!("rank {number}, worker {thread}");
    let rank = Arc::new(rank);
    let result = match rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(name).build() {
        Ok(pool) => catch_unwind(AssertUnwindSafe(|| pool.install(|| work(rank.clone())))),
        Err(e) => Err(Box::new(format!("no threads for it: {e}")) as Box<dyn Any + Send>),
    };
    let result = result.map_err(|thrown| match thrown.downcast_ref::<Lost>() {
        Some(lost) => failures.lost(number, lost.peer),
        None => failures.panicked(number, text_of(thrown.as_ref())),
    });
    rank.leave();
    result.ok()
}

/// The message of a panic.
fn text_of(thrown: &(dyn Any + Send)) -> String {
    let text = thrown.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| thrown.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without words".to_owned())
}

/// Locks what a panic cannot leave half done.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Both ends of a rank's channels: one to and one from each rank, itself included to keep the numbers simple.
#[derive(Default)]
struct Ends {
    to: Vec<Sender<Vec<u8>>>,
    from: Vec<Receiver<Vec<u8>>>,
}

/// A rank's channels. What all ranks do together has its own, so that it may come between the start and the end of an
/// exchange.
struct Lines {
    together: Ends,
    exchange: Ends,
}

/// Channels between all ranks.
fn connect(ranks: usize) -> impl Iterator<Item = Lines> {
    let [together, exchange] = [ends(ranks), ends(ranks)];
    together.into_iter().zip(exchange).map(|(together, exchange)| Lines { together, exchange })
}

/// One channel from each rank to each.
fn ends(ranks: usize) -> Vec<Ends> {
    let mut ends: Vec<Ends> = (0..ranks).map(|_| Ends::default()).collect();
    for from in 0..ranks {
        for to in 0..ranks {
            let (sender, receiver) = channel();
            ends[from].to.push(sender);
            ends[to].from.push(receiver);
        }
    }
    ends
}

/// One of the ranks.
struct LocalRank {
    rank: usize,
    ranks: usize,
    /// None once the rank has ended, even if its communicator has outlived it.
    lines: Mutex<Option<Lines>>,
    exchanging: AtomicBool,
}

impl LocalRank {
    fn new(rank: usize, ranks: usize, lines: Lines) -> Self {
        Self { rank, ranks, lines: Mutex::new(Some(lines)), exchanging: AtomicBool::new(false) }
    }

    /// Closes the channels, so that nobody waits for this rank any more.
    fn leave(&self) {
        drop(lock(&self.lines).take());
    }

    /// Works with the channels.
    fn with<T>(&self, use_them: impl FnOnce(&Lines) -> T) -> T {
        use_them(lock(&self.lines).as_ref().expect("a communicator is used by its rank, which has not ended"))
    }

    /// Numbers of the other ranks.
    fn others(&self) -> impl Iterator<Item = usize> {
        let own = self.rank;
        (0..self.ranks).filter(move |rank| *rank != own)
    }

    /// The bytes of every rank, in the order of ranks.
    fn of_all(&self, own: &[u8]) -> Vec<Vec<u8>> {
        self.with(|lines| {
            self.others().for_each(|to| lines.together.send(to, own.to_vec()));
            let of = |rank| if rank == self.rank { own.to_vec() } else { lines.together.receive(rank) };
            (0..self.ranks).map(of).collect()
        })
    }
}

impl Ends {
    fn send(&self, to: usize, bytes: Vec<u8>) {
        self.to[to].send(bytes).unwrap_or_else(|_| resume_unwind(Box::new(Lost { peer: to })));
    }

    fn receive(&self, from: usize) -> Vec<u8> {
        self.from[from].recv().unwrap_or_else(|_| resume_unwind(Box::new(Lost { peer: from })))
    }
}

impl Communicator for LocalRank {
    fn rank(&self) -> usize {
        self.rank
    }

    fn ranks(&self) -> usize {
        self.ranks
    }

    fn barrier(&self) {
        self.of_all(&[]);
    }

    fn max(&self, values: &mut [f64]) {
        let own: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        for bytes in self.of_all(&own) {
            let (others, _) = bytes.as_chunks::<8>();
            assert_eq!(others.len(), values.len(), "all ranks ask for the largest of equally many values");
            for (value, other) in values.iter_mut().zip(others) {
                let other = f64::from_le_bytes(*other);
                // The two zeros are told apart, else the order of ranks would choose between them.
                if value.total_cmp(&other).is_lt() {
                    *value = other;
                }
            }
        }
    }

    fn broadcast(&self, bytes: &mut Vec<u8>) {
        self.with(|lines| match self.rank {
            0 => self.others().for_each(|to| lines.together.send(to, bytes.clone())),
            _ => *bytes = lines.together.receive(0),
        });
    }

    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8> {
        let all = self.of_all(own);
        let equal = all.iter().map(Vec::len).eq(lengths.iter().copied());
        assert!(equal, "a rank gives as many bytes as all ranks expect of it");
        all.concat()
    }

    fn gather(&self, own: Vec<u8>) -> Vec<Vec<u8>> {
        self.with(|lines| {
            if self.rank > 0 {
                lines.together.send(0, own);
                return Vec::new();
            }
            std::iter::once(own).chain(self.others().map(|from| lines.together.receive(from))).collect()
        })
    }

    fn start(&self, messages: Vec<Message>, from: &[Expected]) -> Box<dyn Exchange + '_> {
        let unfinished = self.exchanging.swap(true, Ordering::Relaxed);
        assert!(!unfinished, "an exchange is finished before the next one starts");
        let mut peers: Vec<usize> = from.iter().map(|expected| expected.from).collect();
        peers.sort_unstable();
        assert!(peers.windows(2).all(|pair| pair[0] < pair[1]), "each rank is expected once");
        peers.extend(messages.iter().map(|message| message.to));
        assert!(!peers.contains(&self.rank), "a rank sends nothing to itself");
        self.with(|lines| messages.into_iter().for_each(|Message { to, bytes }| lines.exchange.send(to, bytes)));
        Box::new(Underway { rank: self, from: from.to_vec() })
    }
}

/// Messages that wait in their channels, or will.
struct Underway<'a> {
    rank: &'a LocalRank,
    from: Vec<Expected>,
}

impl Exchange for Underway<'_> {
    fn finish(self: Box<Self>) -> Vec<Vec<u8>> {
        self.rank.exchanging.store(false, Ordering::Relaxed);
        self.rank.with(|lines| {
            let receive = |expected: &Expected| {
                let bytes = lines.exchange.receive(expected.from);
                let fits = expected.length.is_none_or(|length| length == bytes.len());
                assert!(fits, "rank {} sends {} bytes, expected was another number", expected.from, bytes.len());
                bytes
            };
            self.from.iter().map(receive).collect()
        })
    }
}
