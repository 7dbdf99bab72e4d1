use super::*;
use crate::contact::bodies::constraints::BodyConstraint;
use crate::contact::broad_phase::bvh_search::PairSearch;
use crate::contact::topology::pair_friction::PairFriction;
use crate::contact::topology::surface::ContactSurface;
use crate::mesh::PolygonMesh;
use crate::scene::{GarmentDescription, Scene, SceneDescription};
use crate::state::State;

mod history_figure;
mod ranks;

pub(super) const LAWS: Laws = Laws { stiffness: 30.0, limit: 0.1, friction: 0.4, edge_attraction: -0.3 };

/// Pairs that approach until the next collision-free state, for tests in which nothing else is near.
const SLACK: f64 = 0.05;

pub(super) const THICKNESS: f64 = 0.1_f32 as f64;

/// Two triangles, `second` above the first, as one scene.
fn two_triangles(second: [[f64; 3]; 3]) -> Scene {
    let mut description = SceneDescription::new("pair");
    let first = [[0.0, 0.0, -0.45], [0.0, 0.0, 0.45], [0.45, 0.0, 0.0]];
    for (name, corners) in [("below", first), ("above", second)] {
        let mesh = PolygonMesh::from_triangles(corners.map(Vec3::from).to_vec(), &[[0, 1, 2]]);
        let garment = GarmentDescription { thickness: THICKNESS, ..GarmentDescription::new(name, mesh, 0.2) };
        description.garments.push(garment);
    }
    Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"))
}

/// A corner over the inside of the triangle (scene 33), and an edge across one of its edges (scene 34).
pub(super) fn scenes() -> [Scene; 2] {
    let corner = [[0.225, 0.025, 0.0], [0.4, 0.8, 0.2], [0.4, 0.8, -0.2]];
    let edge = [[-0.45, 0.025, 0.0], [0.45, 0.025, 0.1], [0.0, 0.9, 0.05]];
    [corner, edge].map(two_triangles)
}

struct Pushed {
    nodes: ContactNodes,
    proximity: ProximityList,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    mobility: Vec<f64>,
    repulsions: Repulsions,
}

impl Pushed {
    /// The scene with its sides taken.
    fn new(scene: &Scene, laws: Laws) -> Self {
        let mut surface = ContactSurface::new(scene, 1.0);
        let mut state = State::at_start(scene);
        let mut proximity = ProximityList::new(&surface);
        proximity.rebuild(&mut surface, &mut PairSearch::new(), &mut state.x, SLACK, 0.0, None);
        proximity.update_displacements(&surface, [&state.x; 2].map(Vec::as_slice), [0.0; 2]);
        let (nodes, repulsions) = (surface.nodes().clone(), Repulsions::new(laws, RepulsionPlace::Impulses));
        let mobility = scene.masses().iter().map(|m| 1.0 / m).collect();
        let mut pushed = Self { nodes, proximity, x: state.x, v: state.v, mobility, repulsions };
        pushed.record();
        pushed
    }

    /// Takes the sides where the nodes are.
    fn record(&mut self) {
        self.repulsions.record_orientations(&self.nodes, &self.proximity, &self.x, SLACK, &|_| false);
    }

    fn apply(&mut self, passes: Passes, dt: f64) -> Metrics {
        let mut metrics = Metrics::default();
        let at = RepulsionStep {
            nodes: &self.nodes,
            dt,
            x: &self.x,
            mobility: &self.mobility,
            friction: PairFriction::default(),
            constraints: None,
        };
        self.repulsions.apply(passes, &at, &mut self.v, &mut metrics);
        metrics
    }

    fn step(&mut self, dt: f64) {
        self.repulsions.positions_changed();
        self.apply(Passes::Full, dt);
        self.x.iter_mut().zip(&self.v).for_each(|(x, v)| *x += v * dt);
    }

    /// The signed distance of the only pair that is active.
    fn distance(&mut self) -> Option<f64> {
        let at = RepulsionStep {
            nodes: &self.nodes,
            dt: 1.0,
            x: &self.x,
            mobility: &self.mobility,
            friction: PairFriction::default(),
            constraints: None,
        };
        self.repulsions.refresh(&at);
        let kinds = &self.repulsions.kinds;
        kinds.iter().flat_map(|k| &k.active).map(|t| t.distance).min_by(f64::total_cmp)
    }

    /// Moves the second garment.
    fn shift(&mut self, by: f64) {
        self.x[3..].iter_mut().for_each(|x| x.y += by);
    }
}

#[test]
fn a_pair_that_has_passed_through_is_pulled_back_and_without_its_history_is_not() {
    for scene in scenes() {
        for has_history in [true, false] {
            let mut pushed = Pushed::new(&scene, LAWS);
            // Through by half the thickness.
            pushed.shift(-0.025 - 0.5 * THICKNESS);
            let before = pushed.distance().expect("an active pair");
            assert!((before.abs() - 0.5 * THICKNESS).abs() < 0.05 * THICKNESS, "{before}");
            if !has_history {
                pushed.record();
            }
            for _ in 0..400 {
                pushed.step(1e-2);
            }
            let above = pushed.x[3..].iter().map(|x| x.y).fold(f64::INFINITY, f64::min);
            let below = pushed.x[..3].iter().map(|x| x.y).fold(f64::NEG_INFINITY, f64::max);
            let sum = above - below;
            assert_eq!(sum > 0.0, has_history, "apart by {sum}");
        }
    }
}

#[test]
fn repulsions_keep_momentum_and_never_add_more_energy_than_their_limit() {
    for scene in scenes() {
        let mut pushed = Pushed::new(&scene, LAWS);
        for (i, v) in pushed.v.iter_mut().enumerate() {
            *v = Vec3::new(0.3, if i < 3 { 1.0 } else { -1.5 }, 0.1 * i as f64);
        }
        let momentum = |p: &Pushed| -> (Vec3, Vec3) {
            let each = || p.mobility.iter().zip(&p.v).zip(&p.x).map(|((w, v), x)| (v / *w, x));
            (each().map(|(p, _)| p).sum(), each().map(|(p, x)| x.cross(&p)).sum())
        };
        let before = momentum(&pushed);
        let metrics = pushed.apply(Passes::Full, 1e-3);
        let after = momentum(&pushed);
        assert!(metrics.counted("repulsions") > 0);
        assert!((before.0 - after.0).norm() <= 1e-12 * before.0.norm(), "linear");
        // Forces act along the line of closest points, friction at both ends of it: the couple of a pair at a distance.
        let arm = THICKNESS * before.0.norm();
        assert!((before.1 - after.1).norm() <= arm, "angular");
    }
}

#[test]
fn friction_stops_sliding_within_its_cone_and_only_there() {
    let scene = &scenes()[0];
    for (friction, slides) in [(0.0, true), (0.05, true), (10.0, false)] {
        let mut pushed = Pushed::new(scene, Laws { friction, stiffness: 0.0, ..LAWS });
        pushed.v[3..].fill(Vec3::new(1.0, -1.0, 0.0));
        pushed.apply(Passes::WithoutSprings, 1e-3);
        let active = pushed.repulsions.kinds[0].active.first().expect("a corner over a triangle");
        let v: Vec<Vec3> = active.nodes.iter().map(|n| pushed.v[*n as usize]).collect();
        let relative: Vec3 = v.iter().zip(active.weights).map(|(v, w)| v * w).sum();
        assert!(relative.dot(&active.normal) > -1e-12, "approach is stopped");
        let sliding = (relative - active.normal * relative.dot(&active.normal)).norm();
        let bound = (1.0 - friction).max(0.0);
        assert!((sliding - bound).abs() < 1e-9, "{sliding} for {friction}");
        assert_eq!(sliding > 1e-9, slides);
    }
}

/// A level square of `cells` by `cells` squares of 0.2 m.
fn patch(cells: u32, shift: &Vec3) -> PolygonMesh {
    let side = cells + 1;
    let at = |i: u32| (f64::from(i) - 0.5 * f64::from(cells)) * 0.2;
    let points = (0..side * side).map(|n| shift + Vec3::new(at(n % side), 0.0, at(n / side))).collect();
    let corners = (0..cells * cells).map(|n| n % cells + side * (n / cells));
    let triangles: Vec<[u32; 3]> =
        corners.flat_map(|a| [[a, a + side, a + 1], [a + 1, a + side, a + side + 1]]).collect();
    PolygonMesh::from_triangles(points, &triangles)
}

#[test]
fn pairs_of_the_same_vertices_share_the_load_that_friction_bears() {
    let mut description = SceneDescription::new("patches");
    for (name, cells, shift) in [("below", 6, Vec3::zeros()), ("above", 3, Vec3::new(0.013, 0.06, 0.007))] {
        let mesh = patch(cells, &shift);
        let garment = GarmentDescription { thickness: THICKNESS, ..GarmentDescription::new(name, mesh, 0.2) };
        description.garments.push(garment);
    }
    let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
    let upper = scene.parts().own_of_garment(1);
    for passes in [Passes::WithoutSprings, Passes::Full] {
        let mut pushed = Pushed::new(&scene, Laws { friction: 0.2, ..LAWS });
        pushed.v[upper.clone()].fill(Vec3::new(3.0, -1.0, 0.0));
        let momentum = |p: &Pushed| -> Vec3 { upper.clone().map(|i| p.v[i] / p.mobility[i]).sum() };
        let before = momentum(&pushed);
        let metrics = pushed.apply(passes, 1e-3);
        let pairs = metrics.counted("repulsions");
        assert!(pairs > 3 * upper.len() as u64, "{pairs} pairs on {} vertices", upper.len());
        let impulse = momentum(&pushed) - before;
        let share = -impulse.x / impulse.y;
        // Everything slides: friction is Coulomb's of the whole load, not of each pair's as if it were alone.
        assert!((share - 0.2).abs() < 1e-3, "{share}");
    }
}

#[test]
fn a_pair_beside_each_other_has_no_side() {
    // The corner is as high above the plane as it is thick, but far outside of the triangle.
    let scene = two_triangles([[-0.04, 0.004, 0.0], [-0.4, 0.8, 0.2], [-0.4, 0.8, -0.2]]);
    let pushed = Pushed::new(&scene, LAWS);
    assert!(pushed.repulsions.kinds[0].oriented.is_empty());
}

#[test]
fn a_free_node_is_not_thrown_by_held_ones() {
    // The corner stands over the triangle's edge, nearly: the third corner has a fiftieth of the weight.
    let scene = two_triangles([[0.009, 0.025, 0.0], [0.4, 0.8, 0.2], [0.4, 0.8, -0.2]]);
    let mut pushed = Pushed::new(&scene, LAWS);
    let free = (0..3).find(|i| pushed.x[*i].x > 0.4).expect("the triangle has a third corner");
    (0..6).filter(|i| *i != free).for_each(|i| pushed.mobility[i] = 0.0);
    let dt = 1e-2;
    assert!((pushed.distance().expect("an active pair") - 0.025).abs() < 1e-12);
    pushed.step(dt);
    // No faster than the pair may part.
    let (speed, allowed) = (pushed.v[free].norm(), LAWS.limit / dt * (THICKNESS - 0.025));
    assert!(speed > 0.0 && speed < allowed, "{speed} m/s of {allowed} m/s");
}

#[test]
fn a_node_on_a_body_passes_impulses_on_and_the_body_bears_them() {
    // The corner over the triangle falls; then the triangle, with the corner under it.
    for falls in [0, 1] {
        let scene = &scenes()[0];
        let mut pushed = Pushed::new(scene, LAWS);
        let corner = (3..6).find(|i| pushed.x[*i].y < 0.1).expect("the corner is the lowest");
        let up = if falls == 0 { Vec3::y() } else { -Vec3::y() };
        let lies: Vec<usize> = if falls == 0 { (0..3).collect() } else { vec![corner] };
        let mut constraints = vec![BodyConstraints::default(); 6];
        // The body moves, so that nothing depends on its standing still.
        let least = 0.25;
        lies.iter().for_each(|i| constraints[*i][0] = Some(BodyConstraint { normal: up, least }));
        let start = up * least + Vec3::new(0.01, 0.0, 0.02);
        pushed.v.fill(start);
        let falling: Vec<usize> = if falls == 0 { vec![corner] } else { (0..3).collect() };
        falling.iter().for_each(|i| pushed.v[*i] -= up);
        let momentum = |p: &Pushed| -> f64 { p.mobility.iter().zip(&p.v).map(|(w, v)| v.dot(&up) / w).sum() };
        let (before, at_start) = (momentum(&pushed), pushed.v.clone());
        let mut metrics = Metrics::default();
        let (nodes, x, mobility) = (&pushed.nodes, &pushed.x, &pushed.mobility);
        let at = RepulsionStep {
            nodes,
            dt: 1e-3,
            x,
            mobility,
            friction: PairFriction::default(),
            constraints: Some(&constraints),
        };
        pushed.repulsions.apply(Passes::WithoutSprings, &at, &mut pushed.v, &mut metrics);
        let bears = (before - momentum(&pushed)).abs();
        assert!(bears < 1e-12, "what was given and what bodies have to bear differ by {bears} N s");
        // The first impulse on a node stops all of the approach: no sweep is needed to wear it down.
        let active = pushed.repulsions.kinds[0].active.first().expect("a corner over a triangle");
        let stopped = |i: &u32| {
            let lies_here = lies.contains(&(*i as usize));
            if lies_here { start } else { pushed.v[*i as usize] }
        };
        let approach: f64 =
            active.nodes.iter().zip(active.weights).map(|(i, w)| stopped(i).dot(&active.normal) * w).sum();
        assert!(approach.abs() < 1e-12, "{approach} m/s are left");
        let laid = |i: &usize| (pushed.v[*i] - at_start[*i]).dot(&up);
        assert!(lies.iter().all(|i| laid(i) < 0.0), "the body gets a load");
    }
}

#[test]
fn friction_between_a_node_on_a_body_and_another_is_coulombs_of_all_that_it_bears() {
    for friction in [0.05, 0.4] {
        let mut pushed = Pushed::new(&scenes()[0], Laws { friction, ..LAWS });
        let mut constraints = vec![BodyConstraints::default(); 6];
        constraints[..3].iter_mut().for_each(|s| s[0] = Some(BodyConstraint { normal: Vec3::y(), least: 0.0 }));
        pushed.v[3..].fill(Vec3::new(1.0, -1.0, 0.0));
        let impulse = |p: &Pushed, v: &[Vec3]| -> Vec3 { (3..6).map(|i| (p.v[i] - v[i]) / p.mobility[i]).sum() };
        let at_start = pushed.v.clone();
        let (nodes, x, mobility) = (&pushed.nodes, &pushed.x, &pushed.mobility);
        let at = RepulsionStep {
            nodes,
            dt: 1e-3,
            x,
            mobility,
            friction: PairFriction::default(),
            constraints: Some(&constraints),
        };
        pushed.repulsions.apply(Passes::WithoutSprings, &at, &mut pushed.v, &mut Metrics::default());
        let given = impulse(&pushed, &at_start);
        assert!((-given.x / given.y - friction).abs() < 1e-9, "{} for {friction}", -given.x / given.y);
    }
}

#[test]
fn nodes_between_two_bodies_are_not_thrown() {
    // The corner stands over the triangle's edge, nearly, and bodies bear all but the third corner.
    let scene = two_triangles([[0.009, 0.025, 0.0], [0.4, 0.8, 0.2], [0.4, 0.8, -0.2]]);
    let mut pushed = Pushed::new(&scene, LAWS);
    let free = (0..3).find(|i| pushed.x[*i].x > 0.4).expect("the triangle has a third corner");
    let mut constraints = vec![BodyConstraints::default(); 6];
    for i in (0..6).filter(|i| *i != free) {
        let normal = if i < 3 { Vec3::y() } else { -Vec3::y() };
        constraints[i][0] = Some(BodyConstraint { normal, least: 0.0 });
    }
    pushed.v[free] = Vec3::y();
    let (nodes, x, mobility) = (&pushed.nodes, &pushed.x, &pushed.mobility);
    let at = RepulsionStep {
        nodes,
        dt: 1e-3,
        x,
        mobility,
        friction: PairFriction::default(),
        constraints: Some(&constraints),
    };
    pushed.repulsions.apply(Passes::WithoutSprings, &at, &mut pushed.v, &mut Metrics::default());
    let speed = pushed.v[free].norm();
    assert!(speed <= 1.0, "{speed} m/s");
}
