//! One advance towards a frame: what the frame loop of a run and a shot in the hands of another program have in common.

use drapery_core::error::StepError;
use drapery_core::simulation::{Advance, FrameInput, FrameSummary};

use crate::farm::stop::Request;
use crate::long_frames::Watch;
use crate::remote_simulation::RemoteSimulation;

/// Point that an advance reached.
pub(crate) enum Reached {
    /// The frame; this is what was done since the one before.
    Frame(Box<FrameSummary>),
    /// A state free of collisions on the way to it, because of a request, or without one because of a sample.
    State(Option<Request>),
}

/// Goes on towards the frame of `input` until it is there or something is asked for. `sub_step` counts the states free of
/// collisions since the last frame, and `so_far` is what was done since then; both are brought up to date.
pub(crate) fn towards_frame(
    simulation: &mut RemoteSimulation,
    input: &FrameInput,
    (sub_step, so_far): (&mut u64, &mut Option<FrameSummary>),
    watch: &Watch,
    ask: &mut (dyn FnMut() -> Option<Request> + Send),
) -> Result<Reached, StepError> {
    let mut count_and_ask = || {
        *sub_step += 1;
        ask().or_else(|| watch.is_due(*sub_step).then_some(Request::Report))
    };
    let (advance, request) = simulation.advance(input, &mut count_and_ask)?;
    let (Advance::Done(last) | Advance::Paused(last)) = &advance;
    let summary = so_far.as_ref().map_or_else(|| last.clone(), |before| last.clone().after(before));
    Ok(match advance {
        Advance::Done(_) => Reached::Frame(Box::new(summary)),
        Advance::Paused(_) => {
            *so_far = Some(summary);
            Reached::State(request)
        }
    })
}
