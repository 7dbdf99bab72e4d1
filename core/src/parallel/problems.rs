//! Problems that ranks find, alike on all of them.

use crate::error::{Problem, ProblemKind, Problems};
use crate::parallel::message::codec;
use crate::parallel::ranks::Ranks;

/// Elements of one kind that are listed before the rest is only counted.
pub(crate) const LISTED: usize = 5;

codec!(enum ProblemKind { 0 => Scene, 1 => Data });
codec!(struct Problem { place, what, advice, kind });

/// The problems of all ranks, each once, as an error on every rank.
pub(crate) fn agree(ranks: &Ranks, problems: Vec<Problem>) -> Result<(), Problems> {
    if !ranks.any(!problems.is_empty()) {
        return Ok(());
    }
    let mut together: Vec<Problem> = Vec::new();
    for problem in ranks.all_gather_encoded("problems of all ranks", problems) {
        if !together.contains(&problem) {
            together.push(problem);
        }
    }
    Err(Problems(together))
}

/// The elements of all ranks as text, those with the smallest numbers first; `None` when there are none. Two numbers that
/// differ are the ends of an edge.
pub(crate) fn listed(ranks: &Ranks, mut elements: Vec<[u32; 2]>) -> Option<String> {
    elements.sort_unstable();
    elements.dedup();
    let [count] = ranks.sum_of([elements.len() as u64]);
    if count == 0 {
        return None;
    }
    elements.truncate(LISTED);
    let mut all = ranks.all_gather_v(&elements).concat();
    all.sort_unstable();
    let name = |[a, b]: &[u32; 2]| if a == b { a.to_string() } else { format!("{a}-{b}") };
    let names: Vec<String> = all.iter().take(LISTED).map(name).collect();
    let more = count.saturating_sub(LISTED as u64);
    Some(if more > 0 { format!("{} and {more} more", names.join(", ")) } else { names.join(", ") })
}
