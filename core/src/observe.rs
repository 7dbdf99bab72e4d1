//! The cloth after a line of the two listings (`crate::step`, `crate::simulation`), for whoever looks for the line in which
//! something goes wrong.
//!
//! Nobody looks unless asked to ([`crate::simulation::Simulation::observe`]): then a line costs the question whether there is
//! an observer. Looking changes nothing.

use std::fmt;
use std::str::FromStr;

use crate::Vec3;
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
        let line = known.ok_or_else(|| format!("there is no line \"{line}\"; there are {}", LINES.join(", ")))?;
        let (frame, step) = at.map_or((None, None), |at| {
            at.split_once('.').map_or((Some(at), None), |(frame, step)| (Some(frame), Some(step)))
        });
        let frame = frame.map(str::parse).transpose();
        let step = step.map(str::parse).transpose().ok().filter(|step| *step != Some(0));
        match (frame, step) {
            (Ok(frame), Some(step)) => Ok(Self { line, frame, step }),
            _ => Err(format!("\"{}\" is no frame, nor a frame and its step as in 1005.3", at.unwrap_or_default())),
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

/// Who is given the observations: rank 0 has one, the other ranks only bring their vertices.
pub type Sink = Box<dyn FnMut(Observation) + Send>;

/// Looks at the cloth after some lines. All ranks of a simulation have one, with the same tracepoints.
pub struct Observer {
    tracepoints: Vec<Tracepoint>,
    sink: Option<Sink>,
    frame: i64,
    /// Steps on the way to that frame.
    steps: u64,
}

impl Observer {
    /// An observer in a simulation that has made so many steps on the way to its next frame. Rank 0 has the sink.
    pub fn new(tracepoints: Vec<Tracepoint>, (frame, steps): (i64, u64), sink: Option<Sink>) -> Self {
        Self { tracepoints, sink, frame, steps }
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

    /// Gives the quantities after a line to whoever asked for them; `step` is its number, counted from the present one. All
    /// ranks call it together.
    pub(crate) fn after(&mut self, at: Place, scene: &Scene, quantities: &[Quantity<'_>]) {
        let Place { line, time, dt } = at;
        let step = if line == LINES[0] { self.steps + 1 } else { self.steps };
        let is_here = |point: &Tracepoint| {
            let (in_frame, in_step) =
                (point.frame.is_none_or(|f| f == self.frame), point.step.is_none_or(|s| s == step));
            point.line == line && in_frame && in_step
        };
        if !self.tracepoints.iter().any(is_here) {
            return;
        }
        let gather = |garment: usize, quantity: &Quantity<'_>| {
            let local = LocalValues { field: quantity.field(), values: quantity.values };
            (quantity.name, scene.gather_garment(garment, local, &|value| *value).unwrap_or_default())
        };
        let of_garment = |garment| quantities.iter().map(|quantity| gather(garment, quantity)).collect();
        let garments = (0..scene.meshes().len()).map(of_garment).collect();
        if let Some(sink) = &mut self.sink {
            sink(Observation { line, frame: self.frame, step, time, dt, garments });
        }
    }
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
