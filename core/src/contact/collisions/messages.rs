//! Messages between ranks about open collisions and zones.

use std::collections::BTreeMap;

use crate::Vec3;
use crate::contact::collisions::impact_zones::{Action, Collision, Motion, Solved, Zone, ZoneSolution};
use crate::parallel::message::{codec, is_broken};

codec!(struct Collision { pair, moves, weights, normal, target });
codec!(struct Motion { start, displacement, mobility });
codec!(struct Zone { nodes, collisions, rigid, has_released_prescribed, contradicts, was_carried });

/// Collisions and zones that a rank opens: they are sent to all ranks.
#[derive(Default)]
pub(super) struct Opened {
    pub(super) collisions: Vec<Collision>,
    pub(super) zones: Vec<Zone>,
    /// Motions of the nodes of these, by their numbers in the scene.
    pub(super) motions: BTreeMap<u32, Motion>,
}

codec!(struct Opened { collisions, zones, motions });

/// Displacement of a node by an open collision.
pub(super) struct MovedNode {
    /// Number in the scene.
    pub(super) number: u32,
    /// Displacement since the collision-free state [m].
    pub(super) displacement: Vec3,
}

codec!(struct MovedNode { number, displacement });

/// Solution of an open zone, of which all ranks know the members and the action.
pub(super) struct ZoneAnswer {
    /// Place of the zone among the open ones.
    pub(super) place: u32,
    fails: bool,
    /// Whether each member can move.
    moves: Vec<bool>,
    /// Displacement of each member since the collision-free state [m].
    displacements: Vec<Vec3>,
}

codec!(struct ZoneAnswer { place, fails, moves, displacements });

impl ZoneAnswer {
    /// Name of the message in the error of a damaged one.
    pub(super) const NAME: &str = "what came out of open zones";

    /// Returns the part of a solution that is sent.
    pub(super) fn of(solution: ZoneSolution) -> Self {
        let ZoneSolution { place, moves, solved: Solved { displacements, fails, .. }, .. } = solution;
        Self { place: place as u32, fails, moves, displacements }
    }

    /// The solution that a rank received, of a zone with these members that did this.
    ///
    /// # Panics
    /// It has not as many members.
    pub(super) fn solution(self, rank: usize, (action, members): (Action, Vec<u32>)) -> ZoneSolution {
        let Self { place, fails, moves, displacements } = self;
        if [moves.len(), displacements.len()] != [members.len(); 2] {
            is_broken(rank, Self::NAME, format_args!("{} of {} members moved", displacements.len(), members.len()));
        }
        let solved = Solved { displacements, passes: 0, fails };
        ZoneSolution { place: place as usize, action, members, moves, solved }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_of_other_members_ends_the_run() {
        let answer = || ZoneAnswer { place: 4, fails: true, moves: vec![true; 2], displacements: vec![Vec3::x(); 2] };
        let solution = answer().solution(0, (Action::Rigid, vec![7, 9]));
        assert_eq!((solution.place, solution.solved.displacements), (4, vec![Vec3::x(); 2]));
        let ended = std::panic::catch_unwind(|| answer().solution(0, (Action::Rigid, vec![7, 9, 11])));
        let said = ended.expect_err("nobody moved the third").downcast::<String>().expect("a panic with words");
        assert!(said.contains("\"what came out of open zones\"") && said.contains("2 of 3 members"), "{said}");
    }
}
