//! The cloth after a line of the two listings (`crate::step`, `crate::simulation`): its values, to find the line in which
//! something goes wrong, and checksums, to find the line in which two runs come to different bits.
//!
//! Without an observer ([`crate::simulation::Simulation::observe`]) a line costs the question whether there is one. Looking changes
//! nothing.

use std::fmt;
use std::str::FromStr;

use crate::Vec3;
use crate::geometry::random::SplitMix64;
use crate::parallel::parts::Parts;
use crate::scene::Scene;
use crate::scene::gather::{LocalValues, VertexField};

/// Labels of the lines: the start of a collision step, the lines of a time step, and the end of a collision step.
pub const LINES: [&str; 10] = ["A", "B.1", "B.2", "B.3", "B.4", "B.5", "B.6", "B.7", "B.8", "C"];

/// A line after which the cloth is looked at: in every time step, in those of a frame, or in one.
///
/// As text `B.4`, `B.4@1005` or `B.4@1005.3`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tracepoint {
    /// One of [`LINES`].
    pub line: &'static str,
    /// The frame on the way to which the step is made; `None` for all.
    pub frame: Option<i64>,
    /// The step on the way to that frame, from 1; those that were taken back count. `None` for all.
    pub step: Option<u64>,
}

impl FromStr for Tracepoint {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (line, at) = text.split_once('@').map_or((text, None), |(line, at)| (line, Some(at)));
        let known = LINES.iter().find(|known| known.eq_ignore_ascii_case(line));
        let line = known.ok_or_else(|| format!("there is no line \"{line}\"; use one of {}", LINES.join(", ")))?;
        let (frame, step) = at.map_or((None, None), |at| {
            at.split_once('.').map_or((Some(at), None), |(frame, step)| (Some(frame), Some(step)))
        });
        let frame = frame.map(str::parse).transpose();
        let step = step.map(str::parse).transpose().ok().filter(|step| *step != Some(0));
        match (frame, step) {
            (Ok(frame), Some(step)) => Ok(Self { line, frame, step }),
            _ => Err(format!("\"{}\" is neither a frame nor a frame and step such as 1005.3", at.unwrap_or_default())),
        }
    }
}

impl fmt::Display for Tracepoint {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.line)?;
        self.frame.map_or(Ok(()), |frame| write!(out, "@{frame}"))?;
        self.step.map_or(Ok(()), |step| write!(out, ".{step}"))
    }
}

/// A quantity that the listing names, with its values at the local vertices.
#[derive(Debug, Clone, Copy)]
pub struct Quantity<'a> {
    /// Its name: `x` and `x_new` are positions [m], `v`, `v_half` and `v_star` velocities [m/s].
    pub name: &'static str,
    /// One for each local vertex.
    pub values: &'a [Vec3],
}

impl Quantity<'_> {
    fn field(&self) -> VertexField {
        if self.name.starts_with('x') { VertexField::Positions } else { VertexField::Velocities }
    }
}

/// The cloth after a line.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// One of [`LINES`].
    pub line: &'static str,
    /// The frame on the way to which it is.
    pub frame: i64,
    /// The time step on the way to that frame, from 1: the coming one after A, the last one after C.
    pub step: u64,
    /// Start of the step [s]; the present time after A and C.
    pub time: f64,
    /// Length of the step [s]; zero after A and C.
    pub dt: f64,
    /// For each garment the quantities that the line leaves, each with one value for every vertex in the garment's own order.
    pub garments: Vec<Vec<(&'static str, Vec<Vec3>)>>,
}

/// Receiver of the observations. Rank 0 has one; the other ranks only bring their vertices.
pub type Sink = Box<dyn FnMut(Observation) + Send>;

/// Checksums of the cloth after a line: the same on any number of ranks and threads where the quantities have the same bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineChecksums {
    /// One of [`LINES`].
    pub line: &'static str,
    /// The frame on the way to which it is.
    pub frame: i64,
    /// The time step on the way to that frame, from 1: the coming one after A, the last one after C.
    pub step: u64,
    /// The quantities that the line leaves, each with the checksum of its values at all vertices of the scene.
    pub quantities: Vec<(&'static str, u64)>,
}

/// Receiver of the checksums, on rank 0.
pub type ChecksumSink = Box<dyn FnMut(LineChecksums) + Send>;

/// Content of the report of an observer, and its recipient.
enum Report {
    /// Values of the quantities, after the lines of the tracepoints.
    Values { tracepoints: Vec<Tracepoint>, sink: Option<Sink> },
    /// Checksums of the quantities, after every line.
    Checksums { sink: Option<ChecksumSink> },
}

/// Looks at the cloth after some lines. All ranks of a simulation have one, with the same tracepoints.
pub struct Observer {
    report: Report,
    frame: i64,
    /// Steps on the way to that frame.
    steps: u64,
}

impl Observer {
    /// An observer of the lines of these tracepoints, in a simulation that has made `steps` steps on the way to `frame`, its next
    /// one. Rank 0 has the sink.
    pub fn new(tracepoints: Vec<Tracepoint>, (frame, steps): (i64, u64), sink: Option<Sink>) -> Self {
        Self { report: Report::Values { tracepoints, sink }, frame, steps }
    }

    /// An observer of checksums after every line, in a simulation that is on the way to `frame`. Rank 0 has the sink.
    pub fn of_checksums(frame: i64, sink: Option<ChecksumSink>) -> Self {
        Self { report: Report::Checksums { sink }, frame, steps: 0 }
    }

    /// The simulation goes on towards a frame.
    pub(crate) fn begin_frame(&mut self, frame: i64) {
        if self.frame != frame {
            (self.frame, self.steps) = (frame, 0);
        }
    }

    /// A time step begins.
    pub(crate) fn begin_step(&mut self) {
        self.steps += 1;
    }

    /// Gives the sink the quantities after a line; `step` is the number of the step, counted from the present one. All
    /// ranks call it together.
    pub(crate) fn after(&mut self, at: Place, scene: &Scene, quantities: &[Quantity<'_>]) {
        let Place { line, time, dt } = at;
        let (frame, step) = (self.frame, if line == LINES[0] { self.steps + 1 } else { self.steps });
        match &mut self.report {
            Report::Values { tracepoints, sink } => {
                let is_here = |point: &Tracepoint| {
                    let (in_frame, in_step) =
                        (point.frame.is_none_or(|f| f == frame), point.step.is_none_or(|s| s == step));
                    point.line == line && in_frame && in_step
                };
                if !tracepoints.iter().any(is_here) {
                    return;
                }
                let gather = |garment: usize, quantity: &Quantity<'_>| {
                    let local = LocalValues { field: quantity.field(), values: quantity.values };
                    (quantity.name, scene.gather_garment(garment, local, &|value| *value).unwrap_or_default())
                };
                let of_garment = |garment| quantities.iter().map(|quantity| gather(garment, quantity)).collect();
                let garments = (0..scene.meshes().len()).map(of_garment).collect();
                if let Some(sink) = sink {
                    sink(Observation { line, frame, step, time, dt, garments });
                }
            }
            Report::Checksums { sink } => {
                let own: Vec<u64> =
                    quantities.iter().map(|quantity| checksum(scene.parts(), quantity.values)).collect();
                let of_ranks = scene.parts().ranks().all_gather_v(&own);
                if let Some(sink) = sink {
                    let sum = |at: usize| of_ranks.iter().fold(0, |sum: u64, of_rank| sum.wrapping_add(of_rank[at]));
                    let quantities = quantities.iter().enumerate().map(|(at, q)| (q.name, sum(at))).collect();
                    sink(LineChecksums { line, frame, step, quantities });
                }
            }
        }
    }
}

/// Checksum of the values of a rank's own vertices: a sum over vertices, so that any split among ranks has the same in all. Each
/// term mixes the vertex' number in the scene with the bits of its value.
fn checksum(parts: &Parts, values: &[Vec3]) -> u64 {
    let of_vertex = |vertex: usize| {
        let number = SplitMix64::new(u64::from(parts.number(vertex))).bits();
        let mix = |sum: u64, component: &f64| SplitMix64::mixed(sum.rotate_left(1) ^ component.to_bits());
        values[vertex].iter().fold(number, mix)
    };
    parts.own().map(of_vertex).fold(0, u64::wrapping_add)
}

/// A line of the listings, and when it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// One of [`LINES`].
    pub(crate) line: &'static str,
    /// Start of the step [s].
    pub(crate) time: f64,
    /// Length of the step [s].
    pub(crate) dt: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tracepoint_is_written_as_it_is_read() {
        for text in ["A", "B.4", "B.4@1005", "C@-12.3", "B.8@0.1"] {
            assert_eq!(text.parse::<Tracepoint>().map(|point| point.to_string()), Ok(text.to_owned()));
        }
        assert_eq!("b.4@7.2".parse(), Ok(Tracepoint { line: "B.4", frame: Some(7), step: Some(2) }));
        for text in ["", "B", "B.9", "B.4@", "B.4@x", "B.4@1.", "B.4@1.0", "B.4@1.2.3", "B.4@1.-2", "B.4 @1"] {
            assert!(text.parse::<Tracepoint>().is_err(), "{text}");
        }
    }
}
