//! Direction in which to draw cloth out along the lines in which it meets itself.
//!
//! Inside a line both surfaces go on, and to first order it gets no shorter whichever way they are pushed; only at an end,
//! where one of them has its border, it does. Pushed at both ends at once, two sheets that cross from border to border pull
//! against each other for ever. So one end leads: its border is drawn along the line, and all of the line with it.

use std::collections::{BTreeMap, VecDeque};

use super::{Known, Place};
use crate::Vec3;
use crate::geometry::crossings::Crossing;

/// Two triangles that meet, each by its nodes ascending, the smaller first.
type Meeting = [[u32; 3]; 2];

/// Crossings in which a piece of the line between two triangles ends, and whether the first triangle has their edge.
type Pieces = BTreeMap<Meeting, Vec<(usize, bool)>>;

/// A crossing of a line with an end.
#[derive(Clone, Copy)]
pub(super) struct OnLine {
    /// Unit direction in which its edge is to move past its triangle.
    pub direction: Option<Vec3>,
    /// Whether its edge is of the surface that has the border at the end.
    pub is_drawn: bool,
}

/// Direction of each crossing of a line with an end. The first end in the order of the crossings leads; lines without ends have none.
pub(super) fn along_lines(known: &Known, crossings: &[Crossing], places: &[Option<Place>]) -> Vec<Option<OnLine>> {
    let meetings: Vec<Vec<(Meeting, bool)>> = crossings.iter().map(|crossing| meetings(known, crossing)).collect();
    let mut pieces = Pieces::new();
    for (i, of_crossing) in meetings.iter().enumerate() {
        of_crossing.iter().for_each(|(meeting, first)| pieces.entry(*meeting).or_default().push((i, *first)));
    }
    let mut directions = vec![None; crossings.len()];
    let mut seen = vec![false; crossings.len()];
    for end in 0..crossings.len() {
        let is_end = known.edges[&crossings[end].edge].corners.len() == 1;
        let Some(place) = places[end].as_ref().filter(|_| is_end && !seen[end]) else { continue };
        seen[end] = true;
        directions[end] = Some(OnLine { direction: place.shortening(), is_drawn: true });
        // A crossing, where the line came from, and whether its edge is of the surface that is drawn.
        let mut queue = VecDeque::from([(end, place.point, true)]);
        while let Some((at, from, is_drawn)) = queue.pop_front() {
            let point = places[at].as_ref().map_or(from, |place| place.point);
            for (meeting, first) in &meetings[at] {
                for (next, next_first) in &pieces[meeting] {
                    if std::mem::replace(&mut seen[*next], true) {
                        continue;
                    }
                    let drawn = is_drawn == (first == next_first);
                    let direction = places[*next].as_ref().and_then(|place| place.away_from(&point, drawn));
                    directions[*next] = Some(OnLine { direction, is_drawn: drawn });
                    queue.push_back((*next, point, drawn));
                }
            }
        }
    }
    directions
}

/// The pairs of triangles that meet in a crossing.
fn meetings(known: &Known, crossing: &Crossing) -> Vec<(Meeting, bool)> {
    let sorted = |mut triangle: [u32; 3]| {
        triangle.sort_unstable();
        triangle
    };
    let other = sorted(crossing.triangle);
    let [p, q] = crossing.edge;
    let meeting = |number: u32| {
        let own = sorted([p, q, number]);
        if own < other { ([own, other], true) } else { ([other, own], false) }
    };
    known.edges[&crossing.edge].corners.iter().map(|(number, _)| meeting(*number)).collect()
}
