//! The laws of pairs in the solves, against differences of the force and against Coulomb's law.

use super::*;
use crate::contact::repulsion::tests::{LAWS, THICKNESS, scenes};
use crate::contact::topology::pair::{Pair, PairKind};
use crate::geometry::random::SplitMix64;

/// A pair of two triangles of a scene, a corner over a face or an edge over an edge, at a distance, above by `overlap` of the
/// thickness.
struct CloseTriangles {
    surface: ContactSurface,
    pair: OrientedPair,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    mobility: Vec<f64>,
    unrepelled: UnrepelledMotion,
}

impl CloseTriangles {
    fn new(kind: PairKind) -> Self {
        let scene = &scenes()[kind as usize];
        let surface = ContactSurface::new(scene, 1.0);
        let mut x: Vec<Vec3> = surface.rest().to_vec();
        let upper: Vec<usize> = (0..6).filter(|node| x[*node].y > 0.0).collect();
        let lower: Vec<usize> = (0..6).filter(|node| x[*node].y == 0.0).collect();
        let by_height = |a: &usize, b: &usize| x[*a].y.total_cmp(&x[*b].y);
        let (mut upper, mut lower) = (upper, lower);
        upper.sort_by(by_height);
        // The long edge of the lower triangle lies in x = 0.
        lower.sort_by(|a, b| x[*a].x.total_cmp(&x[*b].x));
        let nodes = match kind {
            PairKind::PointTriangle => [upper[0], lower[0], lower[1], lower[2]],
            PairKind::EdgeEdge => [upper[0], upper[1], lower[0], lower[1]],
        };
        let pair = Pair { kind, nodes: nodes.map(|node| node as u32) };
        let up = Vec3::y();
        let at = pair.positions(&x);
        let in_front = match kind {
            PairKind::PointTriangle => (at[2] - at[1]).cross(&(at[3] - at[1])).dot(&up),
            PairKind::EdgeEdge => 1.0,
        };
        let start_distance = pair.closest(&at).apart.norm().copysign(in_front);
        let pair = OrientedPair { pair, thickness: THICKNESS as f32, start_distance, axis: up };
        let mobility: Vec<f64> = surface.mobility().iter().map(Vec3::max).collect();
        x.iter_mut().filter(|x| x.y > 0.0).for_each(|x| x.y += 0.04);
        Self { v: vec![Vec3::zeros(); x.len()], surface, pair, x, mobility, unrepelled: UnrepelledMotion::default() }
    }

    fn force(&self) -> Option<PairForce> {
        self.force_after(PairHistory::NONE)
    }

    fn force_after(&self, history: PairHistory) -> Option<PairForce> {
        self.force_of(history, false)
    }

    fn force_of(&self, history: PairHistory, is_guess: bool) -> Option<PairForce> {
        let Self { surface, x, v, mobility, unrepelled, .. } = self;
        let displacements: Vec<Vec3> = x.iter().zip(surface.rest()).map(|(x, rest)| x - rest).collect();
        let displacements = &displacements;
        let stage = PairStage { surface, x, displacements, v, mobility, unrepelled, dt: 0.005, is_guess };
        let is_out_of_touch = self.pair.is_out_of_touch(&stage, self.pair.longest_damping_time(&stage));
        let force = self.pair.force(&LAWS, &stage, |_| history);
        assert!(!is_out_of_touch || force.is_none(), "a pair that was dismissed pushes: {force:?}");
        force
    }

    fn is_out_of_touch(&self) -> bool {
        let Self { surface, x, v, mobility, unrepelled, .. } = self;
        let displacements: Vec<Vec3> = x.iter().zip(surface.rest()).map(|(x, rest)| x - rest).collect();
        let displacements = &displacements;
        let stage = PairStage { surface, x, displacements, v, mobility, unrepelled, dt: 0.005, is_guess: false };
        self.pair.is_out_of_touch(&stage, self.pair.longest_damping_time(&stage))
    }

    /// Moves the upper triangle.
    fn shift(&mut self, by: Vec3) {
        let rest = self.surface.rest();
        self.x.iter_mut().zip(rest).filter(|(_, rest)| rest.y > 0.0).for_each(|(x, _)| *x += by);
    }

    /// Presses the upper triangle down with an acceleration [m/s²]; a body may hold the lower one.
    fn press(&mut self, acceleration: f64, is_held: bool) {
        let Self { surface, mobility, unrepelled, .. } = self;
        let of_node = |rest: &Vec3| match rest.y > 0.0 {
            true => Some(Vec3::y() * -acceleration),
            false => (!is_held).then(Vec3::zeros),
        };
        unrepelled.set(surface.nodes(), mobility, surface.rest().iter().map(of_node));
    }

    /// Gives the upper triangle a velocity.
    fn throw(&mut self, velocity: Vec3) {
        let rest = self.surface.rest();
        self.v.iter_mut().zip(rest).filter(|(_, rest)| rest.y > 0.0).for_each(|(v, _)| *v = velocity);
    }
}

#[test]
fn stiffness_and_damping_of_a_pair_are_the_differences_of_its_force() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let mut touching = CloseTriangles::new(kind);
        let found = touching.force().expect("it is in touch");
        assert!(found.distance > 0.0 && found.distance < THICKNESS && found.force.dot(&found.normal) > 0.0);
        assert!(found.weights.iter().sum::<f64>().abs() < 1e-12);
        let step = 1e-6;
        touching.shift(Vec3::y() * step);
        let moved = touching.force().expect("it is in touch");
        let difference = (found.force - moved.force).norm() / step;
        assert!((difference - found.stiffness).abs() < 1e-3 * found.stiffness, "{difference} {}", found.stiffness);
        touching.throw(Vec3::y() * step);
        let thrown = touching.force().expect("it is in touch");
        let difference = (moved.force - thrown.force).norm() / step;
        assert!((difference - found.damping[0]).abs() < 1e-3 * found.damping[0], "{difference} {:?}", found.damping);
        // Beyond its thickness a pair that approaches has less of its damper the farther it is.
        touching.shift(Vec3::y() * (1.5 * THICKNESS - moved.distance));
        touching.throw(Vec3::y() * (-2.0 * THICKNESS * found.stiffness / found.damping[0]));
        let approaching = touching.force().expect("it approaches");
        touching.shift(Vec3::y() * step);
        let difference = (approaching.force - touching.force().expect("it approaches").force).norm() / step;
        let stiffness = approaching.stiffness;
        assert!((difference - stiffness).abs() < 5e-3 * stiffness, "{kind:?}: {difference} {stiffness}");
    }
}

#[test]
fn a_pair_that_was_pressed_stays_in_a_guess_that_parts_it_a_little() {
    let spring = PairSpring::new(1000.0, THICKNESS, false);
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        for overlap in [0.03, 0.2] {
            let mut touching = CloseTriangles::new(kind);
            let at_start = touching.force().expect("it is in touch");
            touching.shift(Vec3::y() * ((1.0 - overlap) * THICKNESS - at_start.distance));
            let pressed = touching.force().expect("it is in touch");
            let after = |push: f64| PairHistory { pushes: [push, 0.0], first_slip: Some(0.0) };
            // The law goes on along its tangent at the push before, or at the onset.
            touching.shift(Vec3::y() * ((overlap + 0.05) * THICKNESS));
            let kept = touching.force_of(after(pressed.push), true).expect("it was pressed");
            let about = overlap.min(0.1) * THICKNESS;
            let (push, stiffness) = spring.at(about);
            let push = push - stiffness * (about + 0.05 * THICKNESS);
            let scale = pressed.push / spring.at(overlap * THICKNESS).0;
            let is_near = |found: f64, expected: f64| (found / (scale * expected) - 1.0).abs() < 1e-6;
            assert!(is_near(kept.push, push) && is_near(kept.stiffness, stiffness), "{kind:?} {overlap}: {kept:?}");
            assert!(kept.push < 0.0);
            for push in [0.0, -pressed.push] {
                assert_eq!(touching.force_of(after(push), true), None, "a pair that bore nothing");
            }
            assert_eq!(touching.force_of(PairHistory::NONE, true), None, "a pair that was not in touch");
            assert_eq!(touching.force_of(after(pressed.push), false), None, "the start of a step");
            touching.shift(Vec3::y() * (0.06 * THICKNESS));
            assert_eq!(touching.force_of(after(pressed.push), true), None, "a pair that has parted");
        }
    }
}

#[test]
fn newtons_method_comes_to_a_light_load_in_a_few_rounds() {
    let spring = PairSpring::new(1000.0, THICKNESS, false);
    let load = spring.at(0.02 * THICKNESS).0;
    for first in [0.05, 0.4, 0.9, 3.0] {
        let rounds = |is_linearised: bool| -> usize {
            let (mut y, mut history) = (first * THICKNESS, PairHistory::NONE);
            for round in 1.. {
                let (push, stiffness) = if is_linearised { spring.linearised(y, &history) } else { spring.at(y) };
                // The solve puts the pair where its tangent bears the load.
                y += (load - push) / stiffness;
                history = PairHistory { pushes: [load, history.pushes[0]], first_slip: Some(0.0) };
                if (y / THICKNESS - 0.02).abs() < 0.02 {
                    return round;
                }
            }
            unreachable!("the loop ends at the load")
        };
        assert!(rounds(true) <= 3 && rounds(true) <= rounds(false), "from {first}: {} rounds", rounds(true));
        assert!(first < 0.5 || rounds(false) >= 5, "from {first}: the law itself would do in {}", rounds(false));
    }
}

#[test]
fn a_guess_is_pushed_by_a_tangent_of_the_law() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let mut touching = CloseTriangles::new(kind);
        let distance = touching.force().expect("it is in touch").distance;
        for overlap in [0.05, 0.5, 0.9, 4.0] {
            touching
                .shift(Vec3::y() * ((1.0 - overlap) * THICKNESS - touching.force().map_or(distance, |f| f.distance)));
            let law = touching.force().expect("it is in touch").push;
            let guess = |solved: Option<f64>| {
                let history = PairHistory { pushes: [solved.unwrap_or(0.0); 2], first_slip: solved.map(|_| 0.0) };
                touching.force_of(history, true).expect("it is in touch").push
            };
            assert!((guess(Some(law)) - law).abs() < 1e-9 * law, "{kind:?}, {overlap}: where the law bears the load");
            for solved in [None, Some(-law), Some(0.1 * law), Some(2.0 * law)] {
                let push = guess(solved);
                assert!(push <= law * (1.0 + 1e-12), "{kind:?}, {overlap}, {solved:?}: {push} N of {law} N");
            }
        }
    }
}

#[test]
fn edges_share_a_spring_at_their_ends_and_have_none_where_they_are_parallel() {
    let touching = CloseTriangles::new(PairKind::EdgeEdge);
    let [a, b, c, d] = touching.pair.pair.nodes.map(|node| node as usize);
    let mollifier = |other: [Vec3; 2], along: [f64; 2]| {
        let mut x = touching.x.clone();
        [x[a], x[b]] = [Vec3::zeros(), Vec3::x()];
        [x[c], x[d]] = other;
        touching.pair.mollifier(&x, [1.0 - along[0], along[0], along[1] - 1.0, -along[1]])
    };
    let across = [Vec3::y(), Vec3::new(0.5, 1.0, 0.8)];
    assert_eq!(mollifier(across, [0.5, 0.5]), 1.0);
    assert_eq!(mollifier(across, [0.2, 0.8]), 1.0);
    // Half-way between 1/6 and 1.
    assert!((mollifier(across, [0.1, 0.5]) - 7.0 / 12.0).abs() < 1e-12);
    assert!((mollifier(across, [0.0, 1.0]) - 1.0 / 36.0).abs() < 1e-12, "a vertex on a vertex");
    for end in [[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0]] {
        assert!((mollifier(across, end) - 1.0 / 6.0).abs() < 1e-12, "{end:?}");
    }
    let nearly = |sine: f64| [Vec3::y(), Vec3::new((1.0_f64 - sine * sine).sqrt(), 1.0, sine)];
    assert_eq!(mollifier(nearly(0.0), [0.5, 0.5]), 0.0);
    assert!((mollifier(nearly(0.1), [0.5, 0.5]) - 0.5).abs() < 1e-12);
    assert!((mollifier(nearly(0.21), [0.5, 0.5]) - 1.0).abs() < 1e-12);
    assert_eq!(CloseTriangles::new(PairKind::PointTriangle).pair.mollifier(&touching.x, [1.0, -1.0, 0.0, 0.0]), 1.0);
}

#[test]
fn a_pair_in_the_solves_keeps_its_distance_under_pressure() {
    let mut touching = CloseTriangles::new(PairKind::PointTriangle);
    let edges: Vec<f64> = touching.pair.pair.nodes.map(|node| touching.surface.edge_length()[node as usize]).to_vec();
    let edge = edges.iter().sum::<f64>() / 4.0;
    // Area of a vertex in a mesh of equilateral triangles.
    let area = 3.0_f64.sqrt() / 2.0 * edge * edge;
    // 1 kPa (s + 3 s³ + 50 s⁴) with s = o/H, less 50 Pa of the onset over a tenth of the thickness, which is quadratic; 210 kPa s more beyond H.
    for (overlap, pressure) in [(0.05, 13.1875), (0.5, 3950.0), (0.9, 35_842.0), (1.5, 158_950.0), (11.0, 2_153_950.0)]
    {
        let distance = touching.force().expect("it is in touch").distance;
        touching.shift(Vec3::y() * ((1.0 - overlap) * THICKNESS - distance));
        let found = touching.force().expect("it is in touch").force.norm() / area;
        assert!((found - pressure).abs() < 1e-6 * pressure, "{found} Pa at {overlap} of the thickness, not {pressure}");
    }
}

#[test]
fn a_body_that_presses_cloth_meets_a_push_without_the_fourth_power() {
    let [on_cloth, on_body] = [false, true].map(|is_on_body| PairSpring::new(1.0, 1.0, is_on_body));
    for (overlap, cube, difference) in [(0.1, 0.053, 0.005), (0.5, 0.825, 3.125), (1.0, 3.95, 50.0)] {
        let [cloth, body] = [&on_cloth, &on_body].map(|spring| spring.at(overlap).0);
        assert!((body - cube).abs() < 1e-12 && (cloth - body - difference).abs() < 1e-12, "{overlap}: {body} {cloth}");
    }
}

#[test]
fn a_pair_bears_what_presses_it_at_half_of_its_thickness() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let mut touching = CloseTriangles::new(kind);
        let free = touching.force().expect("it is in touch");
        touching.shift(Vec3::y() * (0.5 * THICKNESS - free.distance));
        let unpressed = touching.force().expect("it is in touch");
        let (bears, slow) = (unpressed.push, unpressed.damping[0] / unpressed.stiffness);
        for is_held in [true, false] {
            // Reduced mass of the points that meet: of the upper ones alone where a body holds the lower triangle.
            let nodes = free.nodes.into_iter().zip(free.weights).filter(|(_, weight)| *weight > 0.0 || !is_held);
            let response: f64 = nodes.map(|(node, weight)| weight * weight * touching.mobility[node as usize]).sum();
            for share in [0.5, 3.0, 1e3] {
                let pressing = share * bears;
                touching.press(pressing * response, is_held);
                let found = touching.force().expect("it is in touch");
                let expected = pressing.max(bears);
                assert!((found.push - expected).abs() < 1e-5 * expected, "{kind:?}, {share}: {} N", found.push);
                // The damping time of a spring is that of its frequency.
                let (time, due) = (found.damping[0] / found.stiffness, slow * (bears / expected).sqrt());
                assert!((time - due).abs() < 1e-5 * due, "{kind:?}, {share}: {time} s, not {due} s");
            }
            touching.press(-1e4 * bears * response, is_held);
            let found = touching.force().expect("it is in touch").push;
            assert!((found - bears).abs() < 1e-5 * bears, "what parts is not pressed: {found} N");
        }
    }
}

#[test]
fn displacements_prove_only_what_is_so() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let touching = CloseTriangles::new(kind);
        let (x, mut proven) = (touching.surface.rest(), 0);
        let mut random = SplitMix64::new(3);
        for _ in 0..2000 {
            let displacements: Vec<Vec3> = x.iter().map(|_| random.vector() * 0.01).collect();
            let moved: Vec<Vec3> = x.iter().zip(&displacements).map(|(x, displacement)| x + displacement).collect();
            let distance = touching.pair.pair.closest(&touching.pair.pair.positions(&moved)).apart.norm();
            for reach in [0.1 * touching.pair.start_distance.abs(), 0.9 * touching.pair.start_distance.abs()] {
                let is_beyond = touching.pair.is_beyond(&displacements, reach);
                assert!(!is_beyond || distance > reach, "{kind:?}: {distance} m, not beyond {reach} m");
                proven += u32::from(is_beyond);
            }
        }
        // Any two nodes that approach each other may close the distance.
        let (nodes, first) = (touching.pair.pair.nodes, if kind == PairKind::PointTriangle { 1 } else { 2 });
        for (one, other) in (0..first).flat_map(|one| (first..4).map(move |other| (one, other))) {
            let mut displacements = [Vec3::zeros(); 6];
            for (node, side) in [(one, 1.0), (other, -1.0)] {
                displacements[nodes[node] as usize] = Vec3::y() * (0.3 * side * touching.pair.start_distance.abs());
            }
            assert!(
                !touching.pair.is_beyond(&displacements, 0.5 * touching.pair.start_distance.abs()),
                "{kind:?} {one} {other}"
            );
        }
        // What moves as one stays as far apart.
        assert!(touching.pair.is_beyond(&[Vec3::x(); 6], 0.9 * touching.pair.start_distance.abs()), "{kind:?}");
        assert!(proven > 100, "{kind:?}: {proven} of 4000 are proven");
    }
}

#[test]
fn a_pair_pushes_and_never_pulls() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let mut touching = CloseTriangles::new(kind);
        touching.throw(Vec3::y() * 1e3);
        assert_eq!(touching.force(), None, "what leaves fast enough");
        touching.throw(Vec3::zeros());
        touching.shift(Vec3::y() * THICKNESS);
        assert_eq!(touching.force(), None, "what is farther apart than its thickness");
        // Through the other: harder than in touch, and back to the side where it belongs.
        touching.shift(Vec3::y() * -2.0 * THICKNESS);
        let found = touching.force().expect("it has passed through");
        assert!(found.distance < 0.0 && found.force.y > 0.0);
    }
}

#[test]
fn a_pair_that_approaches_is_pushed_before_it_touches_and_one_that_has_passed_far_through_is_pulled_back() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let mut touching = CloseTriangles::new(kind);
        let place = |touching: &mut CloseTriangles, distance: f64| {
            let before =
                touching.pair.touch(&LAWS, &touching.x, [f64::INFINITY; 2]).expect("they are in front of each other").2;
            touching.shift(Vec3::y() * (distance - before));
        };
        // At rest, with an overlap within the onset.
        place(&mut touching, 0.95 * THICKNESS);
        let at_rest = touching.force().expect("it is in touch");
        let damping_time = at_rest.damping[0] / at_rest.stiffness;
        place(&mut touching, 1.5 * THICKNESS);
        assert_eq!(touching.force(), None);
        // Half-way to where pairs are looked for it has half of its damper.
        touching.throw(Vec3::y() * (-0.55 * THICKNESS / (0.5 * damping_time)));
        let approaching = touching.force().expect("it approaches");
        assert!((approaching.push - at_rest.push).abs() < 1e-9 * at_rest.push, "{kind:?}: {} N", approaching.push);
        place(&mut touching, 2.1 * THICKNESS);
        touching.throw(Vec3::y() * -1e3);
        assert_eq!(touching.force(), None, "{kind:?}: too far to be looked for");
        touching.throw(Vec3::zeros());
        place(&mut touching, -19.0 * THICKNESS);
        assert!(touching.force().is_some_and(|found| found.force.y > 0.0), "{kind:?}: it has passed through");
        place(&mut touching, -21.0 * THICKNESS);
        assert_eq!(touching.force(), None, "{kind:?}: it is another layer's by now");
    }
}

#[test]
fn a_pair_that_lands_on_its_onset_hardly_bounces() {
    let touching = CloseTriangles::new(PairKind::PointTriangle);
    let found = touching.force().expect("it is in touch");
    // Stiffness k of the linear spring and reduced mass, from the stiffness where onset is over: k (1 + 9 (o/H)²).
    let overlap = 1.0 - found.distance / THICKNESS;
    let linear = found.stiffness / (1.0 + 9.0 * overlap * overlap);
    let damping_time = found.damping[0] / found.stiffness;
    let response = (PAIR_DAMPING / damping_time).powi(2) / linear;
    let spring = PairSpring::new(linear, THICKNESS, false);
    // At the speed at which the linear spring alone would stop it within the onset; small steps, exact but for their error.
    let speed = ONSET * THICKNESS * (linear * response).sqrt();
    let dt = 1e-4 * ONSET * THICKNESS / speed;
    let (mut overlap, mut v) = (0.0, -speed);
    while overlap >= 0.0 {
        v += dt * response * spring.at((overlap - damping_time * v).max(0.0)).0;
        overlap -= dt * v;
    }
    assert!(v > 0.0 && v < 0.1 * speed, "it leaves with {} of its speed", v / speed);
}

#[test]
fn friction_of_a_pair_is_that_of_coulomb_and_never_above_what_holds_it() {
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let mut touching = CloseTriangles::new(kind);
        for speed in [10.0, 0.5 * SLOW_SLIP] {
            touching.throw(Vec3::x() * speed);
            let first = touching.force().expect("it is in touch");
            let push = first.force.dot(&first.normal);
            assert!((first.force - first.normal * push).norm() < 1e-12 * push, "nothing is known of what it bears");
            let history = PairHistory { pushes: [push; 2], ..PairHistory::after(&first) };
            let found = touching.force_after(history).expect("it is in touch");
            let friction = found.force - found.normal * push;
            let most = LAWS.friction * push;
            assert!(friction.norm() <= most * (1.0 + 1e-12) && friction.x < 0.0, "{speed}: {friction:?} {most}");
            let coulomb = (friction.norm() - most).abs() < 1e-9 * most;
            assert_eq!(coulomb, speed > SLOW_SLIP, "{speed}: {} {most}", friction.norm());
        }
    }
}

#[test]
fn friction_counts_on_what_both_solves_before_bore_and_on_the_speed_at_the_beginning() {
    let mut touching = CloseTriangles::new(PairKind::EdgeEdge);
    touching.throw(Vec3::x() * 10.0);
    let friction = |history: PairHistory| {
        let found = touching.force_after(history).expect("it is in touch");
        (found.force - found.normal * found.force.dot(&found.normal)).norm()
    };
    let push = touching.force().expect("it is in touch").push;
    let after = |pushes: [f64; 2], first_slip: f64| friction(PairHistory { pushes, first_slip: Some(first_slip) });
    let whole = after([push, push], 10.0);
    assert!((whole - LAWS.friction * push).abs() < 1e-9 * whole);
    assert!((after([push, 0.25 * push], 10.0) - 0.25 * whole).abs() < 1e-9 * whole);
    assert!((after([0.25 * push, push], 10.0) - 0.25 * whole).abs() < 1e-9 * whole);
    assert!(after([push, -push], 10.0) < 1e-9 * whole, "what a solve has pulled at bears nothing");
    // It has slowed down from twice its speed: a damper that is Coulomb's friction there.
    assert!((after([push, push], 20.0) - 0.5 * whole).abs() < 1e-9 * whole);
}

#[test]
fn pairs_that_are_out_of_touch_do_not_push() {
    let mut random = SplitMix64::new(4);
    for kind in [PairKind::PointTriangle, PairKind::EdgeEdge] {
        let [mut dismissed, mut pushing] = [0; 2];
        for round in 0..20_000 {
            let mut touching = CloseTriangles::new(kind);
            touching.shift(Vec3::y() * (-0.041 + 1.5 * THICKNESS * random.signed().abs()));
            let size = THICKNESS * [0.1, 0.5, 2.0][round % 3];
            let speed = [0.1, 1.0, 5.0][round / 3 % 3];
            if round % 4 == 0 {
                // Straight towards each other, where the bound is closest to the truth.
                touching.throw(Vec3::y() * (speed * random.signed()));
            } else {
                touching.x.iter_mut().for_each(|x| *x += random.vector() * size);
                touching.v.iter_mut().for_each(|v| *v = random.vector() * speed);
            }
            let force = touching.force();
            // The bound holds for a pair that a guess parts, too.
            touching.force_of(PairHistory { pushes: [1.0, 1.0], first_slip: Some(0.0) }, true);
            dismissed += u32::from(touching.is_out_of_touch());
            pushing += u32::from(force.is_some());
        }
        assert!(dismissed > 1000 && pushing > 1000, "{kind:?}: {dismissed} dismissed, {pushing} push");
    }
}
