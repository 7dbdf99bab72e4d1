//! The same bits on any number of ranks and threads: the checksums of the cloth after every line of the listings, compared with
//! those of one rank and one thread.

use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

use drapery_core::Vec3;
use drapery_core::metrics::Metrics;
use drapery_core::observe::{LINES, LineChecksums, Observation, Tracepoint};
use drapery_shot::ShotError;
use drapery_shot::fault::Fault;
use drapery_shot::scene_source::SceneSource;
use drapery_shot::steps::SteppedShot;

use crate::local_run::on_local_ranks;

/// Vertices that a difference names.
const NAMED: usize = 8;

/// Ranks, which are threads of this process with messages between them, and the threads of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Number of ranks.
    pub ranks: usize,
    /// Threads of each rank.
    pub threads: usize,
}

impl Layout {
    /// One rank with one thread: what others are compared with.
    pub const ALONE: Self = Self { ranks: 1, threads: 1 };
}

impl FromStr for Layout {
    type Err = String;

    /// Reads `3`, three ranks of one thread, or `3x2`, three ranks of two threads each.
    fn from_str(text: &str) -> Result<Self, String> {
        let (ranks, threads) = text.split_once('x').unwrap_or((text, "1"));
        let number = |word: &str| word.parse::<usize>().ok().filter(|number| (1..=1024).contains(number));
        let layout = number(ranks).zip(number(threads)).map(|(ranks, threads)| Self { ranks, threads });
        layout.ok_or_else(|| format!("`{text}` is not a number of ranks; write 3, or 3x2 for two threads on each"))
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        let Self { ranks, threads } = *self;
        write!(out, "{ranks} rank{} of {threads} thread{}", plural(ranks), plural(threads))
    }
}

/// A line after which the cloth has other bits than on one rank.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Line, frame and step, as `--dump` takes them.
    pub tracepoint: Tracepoint,
    /// The first quantity that differs; none where the runs come to different lines.
    pub quantity: Option<&'static str>,
    /// Number of vertices whose values differ.
    pub count: usize,
    /// The first of them.
    pub vertices: Vec<DifferentVertex>,
}

/// A vertex with other bits.
#[derive(Debug, Clone, PartialEq)]
pub struct DifferentVertex {
    /// Its garment, by the order of the scene.
    pub garment: usize,
    /// Its number in that.
    pub vertex: usize,
    /// The values on one rank and on many.
    pub values: [Vec3; 2],
}

impl fmt::Display for Difference {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(quantity) = self.quantity else {
            return write!(out, "the sequence of lines differs from {} on", self.tracepoint);
        };
        write!(out, "{quantity} differs after {} at {} vertices", self.tracepoint, self.count)?;
        for DifferentVertex { garment, vertex, values: [alone, many] } in &self.vertices {
            write!(
                out,
                "\n  garment {garment}, vertex {vertex}: {:?}; on one rank: {:?}",
                many.data.0[0], alone.data.0[0]
            )?;
        }
        Ok(())
    }
}

/// The checksums of a run.
type Trace = Vec<LineChecksums>;

/// A scene whose bits are compared.
pub struct BitsCheck<'a> {
    scene: &'a SceneSource,
    /// Last frame that is simulated.
    last: Option<i64>,
    alone: Trace,
    /// Counts of all frames on one rank.
    metrics: Metrics,
}

impl<'a> BitsCheck<'a> {
    /// Simulates a scene on one rank, up to `last` or to its last frame.
    ///
    /// # Errors
    /// The scene cannot be read or started; the solver gives up.
    pub fn new(scene: &'a SceneSource, last: Option<i64>) -> Result<Self, Fault> {
        let mut check = Self { scene, last, alone: Vec::new(), metrics: Metrics::default() };
        (check.alone, check.metrics) = check.trace(Layout::ALONE, None)?;
        Ok(check)
    }

    /// Number of lines that are compared.
    pub fn lines(&self) -> usize {
        self.alone.len()
    }

    /// A count of all frames, such as `collision_hits`.
    pub fn counted(&self, name: &str) -> u64 {
        self.metrics.counted(name)
    }

    /// The first line after which this layout has other bits, with the vertices that differ there.
    ///
    /// # Errors
    /// As [`BitsCheck::new`].
    pub fn compare(&self, layout: Layout) -> Result<Option<Difference>, Fault> {
        let (found, _) = self.trace(layout, Some(&self.alone))?;
        let differs = |(at, (a, b)): (usize, (&LineChecksums, &LineChecksums))| (a != b).then_some(at);
        let Some(at) = self.alone.iter().zip(&found).enumerate().find_map(differs) else {
            let shorter = self.alone.len().min(found.len());
            let rest = self.alone.get(shorter).or(found.get(shorter));
            return Ok(rest.map(other_lines));
        };
        let (alone, many) = (&self.alone[at], &found[at]);
        if (alone.line, alone.frame, alone.step) != (many.line, many.frame, many.step) {
            return Ok(Some(other_lines(alone)));
        }
        let pairs = alone.quantities.iter().zip(&many.quantities);
        let quantity = pairs.filter(|(a, b)| a != b).map(|((name, _), _)| *name).next();
        let difference = Difference { quantity, ..other_lines(alone) };
        // The end of a step has no name of its own among those that are dumped.
        if !LINES.contains(&alone.line) {
            return Ok(Some(difference));
        }
        let values = [Layout::ALONE, layout].map(|layout| self.values(layout, difference.tracepoint));
        let [Some(alone), Some(many)] = [values[0].clone()?, values[1].clone()?] else { return Ok(Some(difference)) };
        let mut vertices = different_vertices(quantity.unwrap_or_default(), &alone, &many);
        let count = vertices.len();
        vertices.truncate(NAMED);
        Ok(Some(Difference { count, vertices, ..difference }))
    }

    /// The checksums of a run; with those `expected` it ends after the frame in which they first differ.
    fn trace(&self, layout: Layout, expected: Option<&Trace>) -> Result<(Trace, Metrics), Fault> {
        let trace = Arc::new(Mutex::new(Trace::new()));
        let sink = Arc::clone(&trace);
        let metrics = self.simulate(layout, self.last, |shot| {
            shot.observe_checksums(Box::new(move |line| lock(&sink).push(line)));
            let trace = Arc::clone(&trace);
            let mut compared = 0;
            move || {
                let trace = lock(&trace);
                let begun = compared;
                compared = trace.len();
                expected.is_none_or(|expected| expected.get(begun..compared) == Some(&trace[begun..]))
            }
        })?;
        Ok((std::mem::take(&mut lock(&trace)), metrics))
    }

    /// The values after a line.
    fn values(&self, layout: Layout, tracepoint: Tracepoint) -> Result<Option<Observation>, Fault> {
        let found = Arc::new(Mutex::new(None));
        let sink = Arc::clone(&found);
        self.simulate(layout, tracepoint.frame, |shot| {
            shot.observe(&[tracepoint], Box::new(move |observation| *lock(&sink) = Some(observation)));
            || true
        })?;
        Ok(lock(&found).take())
    }

    /// Simulates the scene up to a frame, or to its last one, as long as the function that `observe` returns says so after a frame.
    /// Returns the counts of all frames.
    fn simulate<F: FnMut() -> bool>(
        &self,
        layout: Layout,
        last: Option<i64>,
        observe: impl FnOnce(&mut SteppedShot) -> F + Send,
    ) -> Result<Metrics, Fault> {
        let description = self.scene.read()?.resolve()?;
        on_local_ranks(layout.ranks, layout.threads, |ranks| {
            let mut shot = SteppedShot::start(ranks, description, 1)?;
            let (mut goes_on, mut metrics) = (observe(&mut shot), Metrics::default());
            while shot.simulation().frame() < last.unwrap_or(shot.last_frame()) {
                // Without a request to stop every frame is done.
                let Some(frame) = shot.next_frame(&mut || false)? else { break };
                metrics.add(&frame.summary.metrics);
                if !goes_on() {
                    break;
                }
            }
            Ok::<Metrics, ShotError>(metrics)
        })
        .map_err(Fault::from)
    }
}

/// A difference in which lines there are.
fn other_lines(line: &LineChecksums) -> Difference {
    let tracepoint = Tracepoint { line: line.line, frame: Some(line.frame), step: Some(line.step) };
    Difference { tracepoint, quantity: None, count: 0, vertices: Vec::new() }
}

/// The vertices at which a quantity has other bits.
fn different_vertices(quantity: &str, alone: &Observation, many: &Observation) -> Vec<DifferentVertex> {
    let mut all = Vec::new();
    for (garment, (a, b)) in alone.garments.iter().zip(&many.garments).enumerate() {
        let of = |quantities: &[(&'static str, Vec<Vec3>)]| {
            quantities.iter().find(|(name, _)| *name == quantity).map_or_else(Vec::new, |(_, values)| values.clone())
        };
        let bits = |value: &Vec3| value.map(f64::to_bits);
        let pairs = of(a).into_iter().zip(of(b)).enumerate();
        let different = pairs.filter(|(_, (a, b))| bits(a) != bits(b));
        all.extend(different.map(|(vertex, (a, b))| DifferentVertex { garment, vertex, values: [a, b] }));
    }
    all
}

/// Locks what a panic cannot leave half done.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
