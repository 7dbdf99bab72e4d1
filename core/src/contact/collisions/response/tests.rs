use super::*;
use crate::contact::testing::{on_ranks, random_starts};
use crate::contact::topology::pair::PairKind;
use crate::geometry::random::SplitMix64;
use crate::parallel::ranks::Ranks;

const NODES: u32 = 24;

/// Nodes that cannot move, and part from each other.
const HELD: u32 = 5;
const PARTS: u32 = 15;

/// Nodes that move at random, and what meets in which attempt.
#[derive(Clone)]
struct Story {
    start: Vec<Vec3>,
    displacements: Vec<Vec3>,
    mobility: Vec<Vec3>,
    attempts: Vec<(u32, Vec<Collision>)>,
}

impl Story {
    fn random(random: &mut SplitMix64) -> Self {
        let normal = random.vector().normalize();
        let collision = |nodes: [u32; 4], sign: f64, target: f64| Collision {
            pair: Pair { kind: if sign > 0.0 { PairKind::PointTriangle } else { PairKind::EdgeEdge }, nodes },
            moves: nodes.map(|node| ![HELD, PARTS].contains(&node)),
            weights: [1.0, -0.5, -0.3, -0.2],
            normal: normal * sign,
            target,
        };
        // Both ways at once: no displacement is enough.
        let contradiction = |nodes| vec![collision(nodes, 1.0, 3.0), collision(nodes, -1.0, 3.0)];
        let attempts = vec![
            (7, vec![collision([0, 1, 2, 3], 1.0, 2.0), collision([20, 21, 22, 23], 1.0, 2.0)]),
            (8, vec![collision([2, 3, 13, 14], 1.0, 2.0)]),
            (9, vec![collision([13, 14, 20, 21], 1.0, 2.0)]),
            (10, contradiction([0, 1, 2, HELD])),
            (11, vec![collision([0, 2, 1, HELD], 1.0, 3.0), collision([16, 17, 18, 19], 1.0, 3.0)]),
            (12, contradiction([6, 7, 8, 9])),
            (13, vec![collision([6, 7, 9, 8], 1.0, 3.0)]),
            (14, vec![collision([0, 1, 2, PARTS], 1.0, 3.0)]),
            (15, contradiction([1, 2, 3, HELD])),
            (16, vec![collision([0, 2, 1, PARTS], 1.0, 3.0)]),
            (IMPULSE_ATTEMPTS + INELASTIC_ATTEMPTS + 1, vec![collision([10, 11, 12, HELD], 1.0, 3.0)]),
            (DROP_FROM + 1, vec![collision([10, 11, 12, PARTS], 1.0, 3.0)]),
            (DROP_FROM + 2, vec![collision([10, 12, 11, PARTS], 1.0, 3.0)]),
            (FREEZE_AFTER + 1, vec![collision([16, 17, 18, 19], -1.0, 3.0)]),
        ];
        let mobility =
            |node| if [HELD, PARTS].contains(&node) { Vec3::zeros() } else { Vec3::repeat(f64::from(1 + node % 3)) };
        Self {
            start: (0..NODES).map(|_| random.vector()).collect(),
            displacements: (0..NODES).map(|_| random.vector()).collect(),
            mobility: (0..NODES).map(mobility).collect(),
            attempts,
        }
    }

    /// After each attempt: displacements of own nodes and the nodes touched; and the numbers of closed and open zones.
    fn outcome(&self, ranks: &Ranks, starts: &[u32]) -> Vec<(Vec<Vec3>, Vec<u32>, [usize; 2])> {
        let own = starts[ranks.rank()]..starts[ranks.rank() + 1];
        let ghosts = (0..NODES).filter(|node| !own.contains(node)).collect();
        let nodes = ContactNodes::new(ranks, starts, ghosts, 0);
        let field = Kinematics { nodes: &nodes, start: &self.start, mobility: &self.mobility, gap: 1e-6 };
        let mut displacements = self.displacements.clone();
        let (mut response, mut metrics) = (Response::default(), Metrics::default());
        let mut outcome = Vec::new();
        for (attempt, collisions) in &self.attempts {
            let is_canonical =
                |collision: &&Collision| own.contains(&collision.pair.nodes.into_iter().min().unwrap_or(0));
            let collisions = collisions.iter().filter(is_canonical).copied().collect();
            let touched = response.respond(&field, *attempt, collisions, &mut displacements, &mut metrics);
            nodes.update(&mut displacements);
            let zones = [&response.closed, &response.open].map(|zones| zones.zones().len());
            outcome.push((displacements[nodes.own()].to_vec(), touched, zones));
        }
        let [_, given_up, _] = response.report(&nodes, &mut metrics);
        assert_eq!(given_up, 2, "with what is held: one after the zone has let go, one in a late attempt");
        let counts = ["zones_carried", "zones_rigid", "zone_fallbacks"].map(|name| metrics.counted(name));
        assert_eq!(ranks.sum_of(counts), [4, 1, 1]);
        outcome
    }
}

#[test]
fn zones_that_join_let_go_turn_and_stop_are_answered_alike_on_any_ranks() {
    let mut random = SplitMix64::new(61);
    let story = Story::random(&mut random);
    let alone = story.outcome(&Ranks::default(), &[0, NODES]);
    let zones: Vec<usize> = alone.iter().map(|(_, _, [closed, open])| closed + open).collect();
    assert_eq!(zones, [2, 2, 1, 1, 2, 3, 3, 3, 3, 3, 4, 4, 4, 4]);
    let (before, after) = (&alone[alone.len() - 2].0, &alone[alone.len() - 1].0);
    assert!(before[16..20].iter().all(|d| *d != Vec3::zeros()) && after[16..20].iter().all(|d| *d == Vec3::zeros()));
    let mut cuts = vec![vec![0, 12, 24], vec![0, 8, 16, 24], vec![0, 3, 5, 6, 14, 24], vec![0, 1, 24]];
    cuts.extend((2..7).map(|ranks| random_starts(&mut random, ranks, NODES as usize)));
    for starts in cuts {
        let (shared, cut) = (story.clone(), starts.clone());
        let found = on_ranks(starts.len() - 1, move |ranks| shared.outcome(&ranks, &cut));
        for (attempt, expected) in alone.iter().enumerate() {
            let displacements: Vec<Vec3> = found.iter().flat_map(|rank| &rank[attempt].0).copied().collect();
            assert_eq!(displacements, expected.0, "attempt {attempt} of {starts:?}");
            // All nodes are known everywhere, so local numbers are those of the scene.
            let touched: Vec<u32> = found.iter().flat_map(|rank| &rank[attempt].1).copied().collect();
            assert_eq!(touched, expected.1, "attempt {attempt} of {starts:?}");
            let open = found[0][attempt].2[1];
            assert!(found.iter().all(|rank| rank[attempt].2[1] == open), "open zones are known to all");
            let closed: usize = found.iter().map(|rank| rank[attempt].2[0]).sum();
            assert_eq!(closed + open, zones[attempt]);
        }
    }
}

#[test]
fn zones_of_one_rank_stay_there_until_another_names_a_node_of_theirs() {
    let story = Story::random(&mut SplitMix64::new(62));
    let found = on_ranks(2, move |ranks| story.outcome(&ranks, &[0, 12, 24]));
    let zones = |attempt: usize| [0, 1].map(|rank: usize| found[rank][attempt].2);
    assert_eq!(zones(0), [[1, 0], [1, 0]], "each has its own");
    assert_eq!(zones(1), [[0, 1], [1, 1]], "the first is open");
    assert_eq!(zones(2), [[0, 1], [0, 1]], "both are one");
}
