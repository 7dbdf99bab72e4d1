//! Crossings: after C, at frames, and of the state as caches will store it.

use rayon::prelude::*;

use super::{Geometric, SelfContact};
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::collisions::collision_loop::{MARGIN, holds_all};
use crate::contact::intersections::exact::{crossings, pinched_vertices};
use crate::contact::intersections::tangle::Tangle;
use crate::contact::intersections::untangle::push_apart;
use crate::contact::topology::nodes::ContactNodes;
use crate::contact::topology::surface::ContactSurface;
use crate::geometry::aabb::Aabb;
use crate::geometry::crossings::Crossing;
use crate::metrics::Metrics;

/// Rounds in which what would cross more stays where it was; then everything does.
const REVERT_ROUNDS: u32 = 6;

impl SelfContact {
    /// Edges that crossed triangles when it was last looked for them.
    pub(crate) fn known_crossings(&self) -> &[Crossing] {
        self.geometric.as_ref().map_or(&[], |g| &g.crossings)
    }

    /// Number of crossings that the wearing order decides; the same on all ranks.
    pub(crate) fn tangled(&self) -> usize {
        self.geometric.as_ref().map_or(0, |geometric| geometric.counts(&self.surface, &geometric.crossings)[1])
    }

    /// Says whether lines may wander that the wearing order decides, for which their number may grow.
    pub(crate) fn let_wander(&mut self, lets_wander: bool) {
        self.geometric.iter_mut().for_each(|geometric| geometric.lets_wander = lets_wander);
    }

    /// Finds the crossings that the state has now: around the nodes in `moved` (own ones), if these are given and there were none
    /// before, else all.
    /// More of cloth with cloth than before are not accepted: what makes them stays where it was.
    pub(super) fn check(
        &mut self,
        moved: Option<&[u32]>,
        (x, v): (&mut [Vec3], &mut [Vec3]),
        bodies: &Bodies,
        duration: f64,
        metrics: &mut Metrics,
    ) {
        let Some(geometric) = &mut self.geometric else { return };
        let allowed = geometric.allowed(&self.surface);
        let (surface, nodes, paths) = (&self.surface, self.surface.nodes(), &mut self.paths);
        metrics.count_once(nodes.ranks(), "crossing_checks", 1);
        let before = &geometric.crossings;
        let only = moved.filter(|_| before.is_empty()).map(|moved| marks(nodes, moved));
        let mut stopped = vec![0; nodes.count()];
        let mut round = 0;
        let found = loop {
            let end = &paths.end;
            self.search.refit(surface, |i| Aabb::of_point(&end[i]));
            let found = crossings(surface, &self.search, end, only.as_deref().filter(|_| round == 0));
            let [lines_begin, lines_grow] = geometric.exceeds(surface, &found, allowed);
            if !(lines_begin || lines_grow) || round > REVERT_ROUNDS {
                break found;
            }
            metrics.count_once(nodes.ranks(), "crossings_reverted", 1);
            let is_refused = |c: &&Crossing| {
                let is_new = surface.is_cloth(c) && before.binary_search(c).is_err();
                is_new && (lines_grow || !geometric.tangle.continues(c))
            };
            let new = found.iter().filter(is_refused);
            let numbers = new.flat_map(|c| c.edge.iter().chain(&c.triangle));
            numbers.filter_map(|number| nodes.local(*number)).for_each(|node| stopped[node as usize] = 1);
            // The neighbours of what stays too: nothing new may be made at its border. At last everything stays.
            surface.grow(&mut stopped);
            nodes.update(&mut stopped);
            for (node, vertex) in nodes.own().zip(surface.place()) {
                if stopped[node] != 0 || round == REVERT_ROUNDS {
                    let change = paths.start[node] - paths.end[node];
                    paths.end[node] = paths.start[node];
                    x[vertex] = paths.start[node];
                    v[vertex] += (change / duration).component_mul(&surface.free_axes(node));
                }
            }
            nodes.update(&mut paths.end);
            round += 1;
        };
        geometric.note_crossings(surface, found, bodies);
        // Where a body crosses itself there is no way out yet.
        let pinched = |c: &Crossing| surface.is_pinched(c, bodies);
        let free: Vec<Crossing> = geometric.crossings.iter().filter(|c| !pinched(c)).copied().collect();
        let velocity = |node: u32| (paths.end[node as usize] - paths.start[node as usize]) / duration;
        push_apart(surface, &free, &paths.end, velocity, &mut v[surface.place()]);
    }

    /// All crossings of the state `x` [m], with bodies where they stand, in numbers of the scene; the pairs that cross are left
    /// alone from now on.
    pub(crate) fn check_everything(&mut self, x: &[Vec3], bodies: &Bodies) -> &[Crossing] {
        self.surface.gather(x, bodies, &mut self.paths.end);
        let near = self.near_others();
        let end = &self.paths.end;
        let has_bodies = !self.surface.bodies().triangles().is_empty();
        let may_cross = |near: &Vec<u8>| self.surface.ranks().any(near.contains(&1));
        let found = if has_bodies || near.as_ref().is_none_or(may_cross) {
            self.search.refit(&self.surface, |i| Aabb::of_point(&end[i]));
            crossings(&self.surface, &self.search, end, near.as_deref())
        } else {
            Vec::new()
        };
        match &mut self.geometric {
            Some(geometric) => {
                geometric.note_crossings(&self.surface, found, bodies);
                &geometric.crossings
            }
            None => &[],
        }
    }

    /// The nodes of pairs that may touch at the end of the paths, one entry for each node, if no other cloth can cross cloth: nothing
    /// crossed before, and all pairs that can have met since the list was made are in it. An edge comes to cross a triangle
    /// only when its ends meet the triangle or it meets the triangle's edges.
    fn near_others(&mut self) -> Option<Vec<u8>> {
        let Self { surface, proximity, paths, geometric, elapsed, .. } = self;
        if geometric.as_ref().is_none_or(|g| !g.crossings.is_empty()) {
            return None;
        }
        let used = proximity.update_displacements(surface, [&paths.end; 2].map(Vec::as_slice), [*elapsed; 2]);
        if !holds_all(proximity, used) {
            return None;
        }
        let mut near = vec![0; surface.nodes().count()];
        proximity.mark_in_contact(MARGIN, &mut near);
        surface.nodes().update(&mut near);
        Some(near)
    }

    /// Number of crossings of cloth with cloth when every vertex of the state `x` [m] is where `place` puts it; the same on all
    /// ranks.
    pub(crate) fn crossings_when(
        &mut self,
        x: &[Vec3],
        bodies: &Bodies,
        place: &(dyn Fn(&Vec3) -> Vec3 + Sync),
    ) -> usize {
        self.surface.gather(x, bodies, &mut self.paths.end);
        let cloth = self.surface.nodes().cloth();
        self.paths.end[..cloth].par_iter_mut().for_each(|x| *x = place(x));
        let end = &self.paths.end;
        self.search.refit(&self.surface, |i| Aabb::of_point(&end[i]));
        let found = crossings(&self.surface, &self.search, end, None);
        found.iter().filter(|crossing| self.surface.is_cloth(crossing)).count()
    }
}

impl Geometric {
    /// Numbers of crossings of cloth with cloth that are not of tangles, and of those that are.
    fn counts(&self, surface: &ContactSurface, crossings: &[Crossing]) -> [usize; 2] {
        let among_cloth = || crossings.iter().filter(|crossing| surface.is_cloth(crossing));
        let tangled = among_cloth().filter(|crossing| self.tangle.continues(crossing)).count();
        [among_cloth().count() - tangled, tangled]
    }

    /// The largest numbers that are accepted: no more than before. Lines that wander over the cloth have more crossings at one time and
    /// fewer at another.
    fn allowed(&self, surface: &ContactSurface) -> [usize; 2] {
        let [others, tangled] = self.counts(surface, &self.crossings);
        [others, if self.lets_wander { usize::MAX } else { tangled }]
    }

    /// Whether each number is larger than accepted.
    fn exceeds(&self, surface: &ContactSurface, found: &[Crossing], allowed: [usize; 2]) -> [bool; 2] {
        let [others, tangled] = self.counts(surface, found);
        [others > allowed[0], tangled > allowed[1]]
    }

    /// Takes note of what crosses now.
    fn note_crossings(&mut self, surface: &ContactSurface, crossings: Vec<Crossing>, bodies: &Bodies) {
        self.tangle = Tangle::of(surface, &crossings);
        self.pinched = pinched_vertices(surface, &crossings, bodies);
        self.crossings = crossings;
    }
}

/// One entry for each node, not zero for these own nodes and their copies.
fn marks(nodes: &ContactNodes, own: &[u32]) -> Vec<u8> {
    let mut marks = vec![0; nodes.count()];
    own.iter().for_each(|node| marks[*node as usize] = 1);
    nodes.update(&mut marks);
    marks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::self_contact::CollisionSettings;
    use crate::geometry::random::SplitMix64;
    use crate::mesh::PolygonMesh;
    use crate::scene::{GarmentDescription, Scene, SceneDescription};
    use crate::state::State;

    const N: u32 = 7;

    /// Two sheets, 3 mm apart.
    fn sheets() -> Scene {
        let mut description = SceneDescription::new("sheets");
        let corners = (0..(N - 1) * N).filter(|k| k % N < N - 1);
        let triangles: Vec<_> = corners.flat_map(|k| [[k, k + N, k + 1], [k + 1, k + N, k + 1 + N]]).collect();
        for (name, height) in [("lower", 0.0), ("upper", 0.003)] {
            let at = |k: u32| Vec3::new(f64::from(k % N) * 0.01, height, f64::from(k / N) * 0.01);
            let mesh = PolygonMesh::from_triangles((0..N * N).map(at).collect(), &triangles);
            description.garments.push(GarmentDescription::new(name, mesh, 0.2));
        }
        Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
    }

    #[test]
    fn looking_around_close_pairs_alone_finds_what_looking_everywhere_finds() {
        let (scene, mut random) = (sheets(), SplitMix64::new(17));
        let mut all = 0;
        for round in 0..40 {
            let bodies = Bodies::new(&scene, &[], 0.0).expect("there are none");
            let state = State::at_start(&scene);
            let contact = || SelfContact::new(&scene, None, Some(CollisionSettings { max_steps: 16 }));
            let (mut sleeping, mut everywhere) = (contact(), contact());
            sleeping.begin_collision_step(&state, &bodies, 1e-3, &mut Metrics::default());
            // Some vertices go nearly as far towards the other sheet as the list reaches; in the first rounds hardly any do.
            let reach = sleeping.proximity.skin() - MARGIN;
            let share = 0.005 * f64::from(round);
            let mut move_one = |(x, edge): (&Vec3, &f64)| {
                let far = if random.signed().abs() < share { 0.8 } else { 0.1 };
                let across = Vec3::y() * if x.y > 0.0 { -1.0 } else { 1.0 };
                x + (across + random.vector() * 0.3).normalize() * far * reach * *edge
            };
            let x: Vec<Vec3> = state.x.iter().zip(sleeping.surface.edge_length()).map(&mut move_one).collect();
            let found = sleeping.check_everything(&x, &bodies).to_vec();
            assert_eq!(found, everywhere.check_everything(&x, &bodies));
            sleeping.geometric.as_mut().expect("it collides").crossings.clear();
            let partly = sleeping.near_others().is_some_and(|near| near.contains(&0));
            all += if partly { found.len() } else { 0 };
            assert!(everywhere.near_others().is_none(), "there is no list");
        }
        assert!(all > 100, "{all} crossings while some nodes were far from all others");
    }
}
