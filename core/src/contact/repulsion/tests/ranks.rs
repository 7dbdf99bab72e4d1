use super::*;
use crate::contact::repulsion::ghost_constraints::send_to_ghosts;
use crate::contact::testing::{below, held, on_ranks, random_starts};
use crate::geometry::random::SplitMix64;
use crate::parallel::ranks::Ranks;

const NODES: usize = 400;

/// Random pairs of both kinds, thick enough for many to be active.
#[derive(Clone)]
struct Heap {
    /// Nodes of the pairs of each kind, ascending.
    pairs: [Vec<[u32; 4]>; 2],
    sides: Vec<Vec3>,
    /// Positions in three steps.
    x: [Vec<Vec3>; 3],
    v: Vec<Vec3>,
    mobility: Vec<f64>,
    /// Bodies under some of the nodes.
    constraints: Vec<BodyConstraints>,
}

impl Heap {
    fn random(random: &mut SplitMix64) -> Self {
        let mut node = |first: usize| (first + below(random, 30)) % NODES;
        let pairs = [0, 1].map(|_| {
            let mut pairs: Vec<[u32; 4]> = (0..3 * NODES)
                .map(|i| [0; 4].map(|_| node(i / 3) as u32))
                .filter(|[a, b, c, d]| a != b && a != c && a != d && b != c && b != d && c != d)
                .collect();
            pairs.sort_unstable();
            pairs.dedup();
            pairs
        });
        let support = |random: &mut SplitMix64, i: usize| {
            let one = |random: &mut SplitMix64| BodyConstraint {
                normal: random.vector().normalize(),
                least: random.signed() - 0.5,
            };
            [i.is_multiple_of(3).then(|| one(random)), i.is_multiple_of(6).then(|| one(random))]
        };
        let vectors = |random: &mut SplitMix64| (0..NODES).map(|_| random.vector()).collect();
        Self {
            pairs,
            sides: (0..3 * NODES).map(|_| random.vector().normalize()).collect(),
            x: std::array::from_fn(|_| vectors(random)),
            v: vectors(random),
            mobility: (0..NODES).map(|i| if i % 9 == 0 { 0.0 } else { 2.0 + random.signed() }).collect(),
            constraints: (0..NODES).map(|i| support(random, i)).collect(),
        }
    }

    /// The pairs that a rank holds, with their sides, as `record_orientations` leaves them.
    fn repulsions(&self, ranks: &Ranks, starts: &[u32]) -> (ContactNodes, Repulsions) {
        let mut repulsions = Repulsions::new(LAWS, RepulsionPlace::Impulses);
        let all: Vec<[u32; 4]> = self.pairs.iter().flatten().copied().collect();
        let (nodes, _) = held(ranks, starts, 0, &all);
        let local = |node: u32| nodes.local(node).expect("a node of a pair that is held is here");
        for kind in KINDS {
            let of_kind = &mut repulsions.kinds[kind as usize];
            let own = starts[ranks.rank()]..starts[ranks.rank() + 1];
            for (pair, side) in self.pairs[kind as usize].iter().zip(&self.sides) {
                if pair.iter().any(|node| own.contains(node)) {
                    let (start_distance, axis) = match kind {
                        PairKind::PointTriangle => (0.5_f64.copysign(side.x), Vec3::x()),
                        PairKind::EdgeEdge => (0.5, *side),
                    };
                    let pair = Pair { kind, nodes: pair.map(local) };
                    of_kind.oriented.push(OrientedPair { pair, thickness: 0.5, start_distance, axis });
                }
            }
        }
        repulsions.sort_by_colours(&nodes);
        (nodes, repulsions)
    }

    /// Velocities of this rank's own nodes after three steps, and the counts.
    fn steps(&self, ranks: &Ranks, starts: &[u32]) -> (Vec<Vec3>, [u64; 2]) {
        let (nodes, mut repulsions) = self.repulsions(ranks, starts);
        let numbers: Vec<usize> = (0..nodes.cloth() as u32).map(|node| nodes.number(node) as usize).collect();
        let mobility: Vec<f64> = numbers.iter().map(|n| self.mobility[*n]).collect();
        let mut v: Vec<Vec3> = numbers.iter().map(|n| self.v[*n]).collect();
        // Those of ghosts come from their owners.
        let own_supports =
            |(i, n): (usize, &usize)| if nodes.is_own(i as u32) { self.constraints[*n] } else { [None; 2] };
        let mut constraints: Vec<BodyConstraints> = numbers.iter().enumerate().map(own_supports).collect();
        send_to_ghosts(&nodes, &mut constraints, &mut v.clone());
        let mut metrics = Metrics::default();
        for (x, passes) in self.x.iter().zip([Passes::Full, Passes::WithoutSprings, Passes::Full]) {
            let x: Vec<Vec3> = numbers.iter().map(|n| x[*n]).collect();
            // What ghosts had before must not matter.
            (0..nodes.cloth()).filter(|i| !nodes.is_own(*i as u32)).for_each(|i| v[i] = Vec3::repeat(f64::NAN));
            let constraints = (passes == Passes::WithoutSprings).then_some(constraints.as_slice());
            let at = RepulsionStep {
                nodes: &nodes,
                dt: 0.1,
                x: &x,
                mobility: &mobility,
                friction: PairFriction::default(),
                constraints,
            };
            repulsions.positions_changed();
            repulsions.apply(passes, &at, &mut v, &mut metrics);
        }
        let counts = ["repulsions", "attractions"].map(|name| metrics.counted(name));
        (v[nodes.own()].to_vec(), ranks.sum_of(counts))
    }
}

#[test]
fn any_number_of_ranks_gives_the_same_bits() {
    let mut random = SplitMix64::new(31);
    let heap = Heap::random(&mut random);
    let (expected, counts) = heap.steps(&Ranks::default(), &[0, NODES as u32]);
    assert!(expected.iter().zip(&heap.v).filter(|(a, b)| a != b).count() > NODES / 2, "most nodes are pushed");
    assert!(counts[0] > 200 && counts[1] > 200, "{counts:?}");
    for ranks in [2, 3, 5, 8] {
        let starts = random_starts(&mut random, ranks, NODES);
        let heap = heap.clone();
        let (found, counted): (Vec<_>, Vec<_>) =
            on_ranks(ranks, move |ranks| heap.steps(&ranks, &starts)).into_iter().unzip();
        let found = found.concat();
        let bits = |v: &[Vec3]| -> Vec<[u64; 3]> { v.iter().map(|v| [v.x, v.y, v.z].map(f64::to_bits)).collect() };
        assert!(bits(&expected) == bits(&found), "{ranks} ranks");
        assert_eq!(counted, vec![counts; ranks]);
    }
}
