//! Impact zones as they grow during one loop of collisions: which nodes belong together, and what holds between them.

use crate::Vec3;
use crate::contact::impact_zone;
use crate::contact::impulse::{Constraint, normal_velocity};
use crate::metrics::Metrics;

/// Sizes of zones that are counted apart, in nodes.
const LARGE_ZONE: usize = 100;

/// How many times farther than any did before, the nodes of a zone may move after contacts that contradict each other: no
/// farther, or a zone that contradicts itself in every collision step would throw them ever faster.
const THROWN: f64 = 1.0;

/// All zones of a loop. They only grow.
#[derive(Debug)]
pub struct Zones {
    constraints: Vec<Constraint>,
    targets: Vec<f64>,
    /// Union-find over nodes; the smallest node of a zone stands for it.
    parent: Vec<u32>,
    /// Nodes of all constraints, ascending.
    members: Vec<u32>,
    /// Smallest nodes of the zones that were made rigid.
    rigid_roots: Vec<u32>,
    /// A node of each zone that has let go of what is prescribed, because its contacts contradicted each other.
    released: Vec<u32>,
    /// A node of each zone whose contacts contradict each other though nothing in them is prescribed.
    contradicting: Vec<u32>,
    rigid: u64,
    stopped: u64,
}

impl Zones {
    /// No zones among so many nodes.
    pub fn new(nodes: usize) -> Self {
        let parent = (0..nodes as u32).collect();
        let (constraints, targets, members) = Default::default();
        let (rigid_roots, released, contradicting) = Default::default();
        Self { constraints, targets, parent, members, rigid_roots, released, contradicting, rigid: 0, stopped: 0 }
    }

    /// Adds constraints with the relative displacement along their normals that they need [m].
    pub fn add(&mut self, constraints: impl Iterator<Item = (Constraint, f64)>) {
        for (constraint, target) in constraints {
            constraint.nodes.iter().for_each(|&node| self.join(constraint.nodes[0], node));
            self.members.extend(constraint.nodes);
            self.constraints.push(constraint);
            self.targets.push(target);
        }
        self.members.sort_unstable();
        self.members.dedup();
    }

    /// Lets everything in the zones that one of `nodes` belongs to slide, but nothing approach. Returns the nodes that may
    /// have changed. Where contacts contradict each other, as between bodies that close, impulses grow without end: such a
    /// zone stays as it was and lets go of what is prescribed, or needs to be made rigid if nothing is.
    pub fn make_inelastic(
        &mut self,
        nodes: &[u32],
        mobility: &[Vec3],
        displacements: &mut [Vec3],
        metrics: &mut Metrics,
    ) -> Vec<u32> {
        let mut roots: Vec<u32> = nodes.iter().map(|&node| self.root(node)).collect();
        roots.sort_unstable();
        roots.dedup();
        let (mut constraints, mut targets) = (Vec::new(), Vec::new());
        for i in 0..self.constraints.len() {
            if roots.binary_search(&self.root(self.constraints[i].nodes[0])).is_ok() {
                constraints.push(self.constraints[i]);
                targets.push(self.targets[i]);
            }
        }
        let mut touched: Vec<u32> = constraints.iter().flat_map(|c| c.nodes).collect();
        touched.sort_unstable();
        touched.dedup();
        let before: Vec<Vec3> = touched.iter().map(|&node| displacements[node as usize]).collect();
        let outcome = impact_zone::inelastic(&constraints, &targets, mobility, displacements);
        metrics.count("zone_sweeps", outcome.iterations as u64);
        if !outcome.converged {
            let worst = |(c, target): &(&Constraint, &f64)| {
                let shortfall = *target - normal_velocity(c, displacements);
                shortfall >= 0.5 * outcome.residual
            };
            let worst = constraints.iter().zip(&targets).filter(worst).map(|(c, _)| c.nodes[0]);
            let mut bad: Vec<u32> = worst.collect::<Vec<_>>().into_iter().map(|node| self.root(node)).collect();
            let farthest = |d: &mut dyn Iterator<Item = Vec3>| d.map(|d| d.norm()).fold(0.0, f64::max);
            let now = farthest(&mut touched.iter().map(|&node| displacements[node as usize]));
            if now > THROWN * farthest(&mut before.iter().copied()) {
                bad = roots;
            }
            bad.sort_unstable();
            bad.dedup();
            for (&node, before) in touched.iter().zip(before) {
                if bad.binary_search(&self.root(node)).is_ok() {
                    displacements[node as usize] = before;
                }
            }
            self.let_go(&bad, mobility);
        }
        touched
    }

    /// Removes the contacts with something prescribed from these zones.
    fn let_go(&mut self, roots: &[u32], mobility: &[Vec3]) {
        let prescribed = |c: &Constraint| c.nodes.iter().any(|&node| mobility[node as usize] == Vec3::zeros());
        let mut releasing = vec![false; roots.len()];
        let all: Vec<_> = self.constraints.drain(..).zip(self.targets.drain(..)).collect();
        for (constraint, target) in all {
            match roots.binary_search(&self.root(constraint.nodes[0])) {
                Ok(zone) if prescribed(&constraint) => releasing[zone] = true,
                _ => {
                    self.constraints.push(constraint);
                    self.targets.push(target);
                }
            }
        }
        self.members = self.constraints.iter().flat_map(|c| c.nodes).collect();
        self.members.sort_unstable();
        self.members.dedup();
        for (&root, releases) in roots.iter().zip(releasing) {
            if releases { &mut self.released } else { &mut self.contradicting }.push(root);
        }
    }

    /// Whether the zone of a node has let go of what is prescribed.
    pub fn has_let_go(&mut self, node: u32) -> bool {
        let root = self.root(node);
        (0..self.released.len()).any(|i| self.root(self.released[i]) == root)
    }

    /// Whether the contacts in the zone of a node contradict each other.
    pub fn contradicts(&mut self, node: u32) -> bool {
        let root = self.root(node);
        (0..self.contradicting.len()).any(|i| self.root(self.contradicting[i]) == root)
    }

    /// Calls `make_rigid` for the members of each zone that one of `nodes` belongs to; returns the nodes that may have
    /// changed.
    pub fn make_rigid(&mut self, nodes: &[u32], mut make_rigid: impl FnMut(&[u32])) -> Vec<u32> {
        let zones = self.zones_of(nodes);
        self.rigid += zones.len() as u64;
        zones.iter().for_each(|zone| make_rigid(zone));
        for node in nodes {
            let root = self.root(*node);
            self.rigid_roots.push(root);
        }
        zones.concat()
    }

    /// Whether these nodes are in one zone that was made rigid.
    pub fn are_rigid(&mut self, nodes: &[u32; 4]) -> bool {
        if self.rigid_roots.is_empty() {
            return false;
        }
        let roots = nodes.map(|node| self.root(node));
        roots.iter().all(|root| *root == roots[0]) && self.rigid_roots.contains(&roots[0])
    }

    /// Calls `stop` for each member of each zone that one of `nodes` belongs to; returns those members.
    pub fn stop(&mut self, nodes: &[u32], stop: impl FnMut(u32)) -> Vec<u32> {
        let stopped = self.zones_of(nodes).concat();
        self.stopped += 1;
        stopped.iter().copied().for_each(stop);
        stopped
    }

    /// Nodes of all zones.
    pub fn node_count(&self) -> usize {
        self.members.len()
    }

    /// Counts what there was.
    pub fn report(&mut self, metrics: &mut Metrics) {
        let all = self.members.clone();
        let zones = self.zones_of(&all);
        metrics.count("zones", zones.len() as u64);
        metrics.count("zones_large", zones.iter().filter(|zone| zone.len() > LARGE_ZONE).count() as u64);
        metrics.count("zone_nodes", self.members.len() as u64);
        metrics.count("zones_rigid", self.rigid);
        metrics.count("zone_fallbacks", self.stopped);
    }

    /// Members of each zone that one of `nodes` belongs to, ascending; zones in the order of their first member.
    fn zones_of(&mut self, nodes: &[u32]) -> Vec<Vec<u32>> {
        let mut roots: Vec<u32> = nodes.iter().map(|&node| self.root(node)).collect();
        roots.sort_unstable();
        roots.dedup();
        let mut zones = vec![Vec::new(); roots.len()];
        for i in 0..self.members.len() {
            let node = self.members[i];
            if let Ok(zone) = roots.binary_search(&self.root(node)) {
                zones[zone].push(node);
            }
        }
        zones
    }

    fn root(&mut self, mut node: u32) -> u32 {
        while self.parent[node as usize] != node {
            let above = self.parent[self.parent[node as usize] as usize];
            self.parent[node as usize] = above;
            node = above;
        }
        node
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}
