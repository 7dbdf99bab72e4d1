//! Momentum, energy and optimality of both kinds of zone.

use nalgebra::{DMatrix, DVector, Matrix3, UnitQuaternion};

use super::rigid::RigidMotion;
use super::{ZoneNode, carried, inelastic, rigid};
use crate::Vec3;
use crate::contact::collisions::impulse::{Constraint, normal_velocity};
use crate::geometry::random::SplitMix64;

/// A zone of 1 to 12 kg nodes in a metre, moving by up to `reach` metres, far from the origin.
fn random_zone(random: &mut SplitMix64, count: usize, reach: f64) -> Vec<ZoneNode> {
    let node = |random: &mut SplitMix64| {
        let start = random.vector() + Vec3::new(3.0, -2.0, 5.0);
        let mobility = Vec3::repeat(1.0 / (6.5 + 5.5 * random.signed()));
        ZoneNode { start, end: start + random.vector() * reach, mobility }
    };
    (0..count).map(|_| node(random)).collect()
}

/// Returns the displacement of a node by the motion of a rigid zone [m].
fn displacement_of(motion: &RigidMotion, node: &ZoneNode) -> Vec3 {
    motion.displacement + motion.turn.cross(&(node.start - motion.centre))
}

fn mass(node: &ZoneNode) -> f64 {
    1.0 / node.mobility.max()
}

/// Σ m (end − start) and Σ m start × (end − start).
fn momenta(nodes: &[ZoneNode]) -> [Vec3; 2] {
    let path = |n: &ZoneNode| (n.end - n.start) * mass(n);
    [nodes.iter().map(path).sum(), nodes.iter().map(|n| n.start.cross(&path(n))).sum()]
}

/// Size of the terms in the sums of `momenta`.
fn sizes(nodes: &[ZoneNode]) -> [f64; 2] {
    let path = |n: &ZoneNode| (n.end - n.start).norm() * mass(n);
    [nodes.iter().map(path).sum(), nodes.iter().map(|n| n.start.norm() * path(n)).sum()]
}

/// Largest change of a distance between two nodes, relative to it.
fn distortion(nodes: &[ZoneNode]) -> f64 {
    let mut worst = 0.0_f64;
    for a in nodes {
        for b in nodes {
            let [before, now] = [(a.start - b.start).norm(), (a.end - b.end).norm()];
            worst = worst.max((now - before).abs() / before.max(1e-3));
        }
    }
    worst
}

#[test]
fn a_rigid_zone_keeps_linear_and_angular_momentum() {
    let mut random = SplitMix64::new(1);
    for trial in 0..300 {
        let mut nodes = random_zone(&mut random, 4 + trial % 20, 0.3);
        let (before, size) = (momenta(&nodes), sizes(&nodes));
        let motion = rigid(&mut nodes);
        for (before, (after, size)) in before.iter().zip(momenta(&nodes).iter().zip(size)) {
            assert!((after - before).norm() <= 1e-12 * size, "trial {trial}: {before} became {after}");
        }
        let velocity = |n: &ZoneNode| displacement_of(&motion, n) * mass(n);
        let linear: Vec3 = nodes.iter().map(velocity).sum();
        let angular: Vec3 = nodes.iter().map(|n| n.start.cross(&velocity(n))).sum();
        assert!((linear - before[0]).norm() <= 1e-12 * size[0], "trial {trial}");
        assert!((angular - before[1]).norm() <= 1e-12 * size[1], "trial {trial}");
    }
}

#[test]
fn a_rigid_zone_keeps_its_distances() {
    let mut random = SplitMix64::new(2);
    for reach in [1e-9, 1e-3, 0.3, 100.0] {
        for count in 1..20 {
            let mut nodes = random_zone(&mut random, count, reach);
            rigid(&mut nodes);
            // The positions themselves are rounded at their distance from the origin.
            let bound = 1e-12 * (1.0 + reach);
            assert!(distortion(&nodes) <= bound, "{count} nodes, {reach} m: {}", distortion(&nodes));
        }
    }
}

#[test]
fn a_rigid_zone_never_has_more_energy() {
    let mut random = SplitMix64::new(3);
    for reach in [1e-3, 0.3, 100.0] {
        for count in 1..20 {
            let mut nodes = random_zone(&mut random, count, reach);
            let energy = |v: &dyn Fn(&ZoneNode) -> Vec3, nodes: &[ZoneNode]| -> f64 {
                nodes.iter().map(|n| 0.5 * mass(n) * v(n).norm_squared()).sum()
            };
            let before = energy(&|n| n.end - n.start, &nodes);
            let motion = rigid(&mut nodes);
            let after = energy(&|n| displacement_of(&motion, n), &nodes);
            // Places are rounded at their distance from the origin, so velocities are at about 1e-15 m over the reach.
            assert!(
                after <= before * (1.0 + 1e-13 + 1e-14 / reach),
                "{count} nodes, {reach} m: {before} J became {after} J"
            );
        }
    }
}

#[test]
fn a_zone_that_moved_rigidly_moves_on_so() {
    let mut random = SplitMix64::new(4);
    for angle in [1e-6, 0.1, 1.0] {
        let mut nodes = random_zone(&mut random, 7, 0.0);
        let turn = UnitQuaternion::from_scaled_axis(random.vector().normalize() * angle);
        let (centre, shift) = (random.vector(), random.vector());
        for node in &mut nodes {
            node.end = turn * (node.start - centre) + centre + shift;
        }
        let expected = nodes.clone();
        rigid(&mut nodes);
        for (node, expected) in nodes.iter().zip(&expected) {
            assert!((node.end - expected.end).norm() < 1e-12, "{angle}");
        }
    }
}

#[test]
fn a_collinear_zone_turns_across_its_line_only() {
    let mut random = SplitMix64::new(5);
    for _ in 0..50 {
        let (line, origin) = (random.vector(), random.vector());
        let mut nodes = random_zone(&mut random, 5, 0.1);
        for node in &mut nodes {
            let path = node.end - node.start;
            node.start = origin + line * random.signed();
            node.end = node.start + path;
        }
        let (before, size) = (momenta(&nodes), sizes(&nodes));
        let motion = rigid(&mut nodes);
        let after = momenta(&nodes);
        assert!((after[0] - before[0]).norm() <= 1e-12 * size[0]);
        assert!((after[1] - before[1]).norm() <= 1e-12 * size[1]);
        assert!(distortion(&nodes) < 1e-12);
        assert!(motion.turn.dot(&line).abs() <= 1e-9 * motion.turn.norm() * line.norm());
    }
}

#[test]
fn nodes_in_one_point_move_with_their_mean() {
    let mut random = SplitMix64::new(6);
    let mut nodes = random_zone(&mut random, 4, 0.1);
    for node in &mut nodes {
        node.end -= node.start;
        node.start = Vec3::zeros();
    }
    let before = momenta(&nodes);
    rigid(&mut nodes);
    assert!((momenta(&nodes)[0] - before[0]).norm() < 1e-14);
    assert!(nodes.iter().all(|n| n.end == nodes[0].end));
}

/// A random zone of nine nodes, the first of which are prescribed and move as one rigid body; its turn, and its shift [m].
fn led_zone(random: &mut SplitMix64, prescribed: usize) -> (Vec<ZoneNode>, UnitQuaternion<f64>, Vec3) {
    let mut nodes = random_zone(random, 9, 0.1);
    let (turn, shift) = (UnitQuaternion::from_scaled_axis(random.vector()), random.vector());
    for node in &mut nodes[..prescribed] {
        node.mobility = Vec3::zeros();
        node.end = turn * node.start + shift;
    }
    (nodes, turn, shift)
}

#[test]
fn prescribed_nodes_stay_and_the_others_follow_them() {
    let mut random = SplitMix64::new(7);
    for prescribed in 1..6 {
        let (mut nodes, turn, shift) = led_zone(&mut random, prescribed);
        let before = nodes.clone();
        rigid(&mut nodes);
        assert_eq!(nodes[..prescribed], before[..prescribed]);
        assert!(distortion(&nodes) < 1e-12, "{prescribed} prescribed: {}", distortion(&nodes));
        if prescribed >= 3 {
            let expected = |n: &ZoneNode| turn * n.start + shift;
            assert!(nodes.iter().all(|n| (n.end - expected(n)).norm() < 1e-12));
        }
    }
}

#[test]
fn a_zone_is_carried_as_what_is_prescribed_moves() {
    let mut random = SplitMix64::new(9);
    for prescribed in 1..7 {
        let (mut nodes, ..) = led_zone(&mut random, prescribed);
        let (deviation, distortion) = (carried(&mut nodes), distortion(&nodes));
        assert!(deviation < 1e-9 && distortion < 1e-9, "{prescribed} prescribed: {deviation} m, {distortion}");
        // Shear and stretch as well, which four nodes determine.
        let map = Matrix3::identity() + Matrix3::from_fn(|_, _| 0.2 * random.signed());
        nodes.iter_mut().take(prescribed).for_each(|node| node.end = map * node.start);
        let expected: Vec<Vec3> = nodes.iter().map(|node| map * node.start).collect();
        assert!(carried(&mut nodes) < 1e-3, "{prescribed} prescribed");
        if prescribed > 4 {
            assert!(nodes.iter().zip(&expected).all(|(node, end)| (node.end - end).norm() < 1e-3));
            nodes[0].end += Vec3::x();
            assert!(carried(&mut nodes) > 0.1, "one of them parts from the others");
        }
    }
}

#[test]
fn a_zone_turns_freely_about_what_one_or_two_prescribed_nodes_leave() {
    // A mass on an arm of one metre, driven across it by a millimetre: it turns by the angle whose sine is 1e-3.
    let fixed = |at: Vec3| ZoneNode { start: at, end: at, mobility: Vec3::zeros() };
    let driven = ZoneNode { start: Vec3::x(), end: Vec3::new(1.0, 0.0, 1e-3), mobility: Vec3::repeat(2.0) };
    for held in [vec![fixed(Vec3::zeros())], vec![fixed(Vec3::y()), fixed(-Vec3::y())]] {
        let mut nodes = held;
        nodes.push(driven);
        rigid(&mut nodes);
        let end = nodes[nodes.len() - 1].end;
        let expected = Vec3::new(1e-3_f64.asin().cos(), 0.0, 1e-3);
        assert!((end - expected).norm() < 1e-15, "{end}");
    }
}

#[test]
fn prescribed_directions_of_a_node_stay() {
    let mut random = SplitMix64::new(8);
    let mut nodes = random_zone(&mut random, 6, 0.1);
    nodes[2].mobility.y = 0.0;
    let before = nodes[2];
    rigid(&mut nodes);
    assert_eq!(nodes[2].end.y, before.end.y);
    assert_ne!(nodes[2].end.x, before.end.x);
}

#[test]
fn a_zone_is_finite_whatever_it_is_given() {
    for nodes in [0, 1, 2, 5] {
        for (start, end) in [(0.0, 0.0), (1e-160, 1e-160), (1e-9, 1e9), (1e50, -1e50)] {
            for mobility in [0.0, 1e-12, 1e12] {
                let node = |i: usize| ZoneNode {
                    start: Vec3::new(i as f64, 1.0, (i % 2) as f64) * start,
                    end: Vec3::new(1.0, (i % 3) as f64, i as f64) * end,
                    mobility: Vec3::repeat(mobility),
                };
                let mut nodes: Vec<_> = (0..nodes).map(node).collect();
                let mut follow = nodes.clone();
                assert!(carried(&mut follow).is_finite() && follow.iter().all(|n| n.end.iter().all(|x| x.is_finite())));
                let motion = rigid(&mut nodes);
                let finite = |v: Vec3| v.iter().all(|x| x.is_finite());
                let is_finite = |n: &ZoneNode| finite(n.end) && finite(displacement_of(&motion, n));
                assert!(nodes.iter().all(is_finite), "{start} {end} {mobility}: {nodes:?} {motion:?}");
            }
        }
    }
}

/// Random contacts among nodes at random places, each pushing along the line between its points; some nodes are
/// prescribed, some contacts repeated.
struct Contacts {
    x: Vec<Vec3>,
    constraints: Vec<Constraint>,
    mobility: Vec<Vec3>,
    v: Vec<Vec3>,
}

impl Contacts {
    fn random(random: &mut SplitMix64, nodes: usize, count: usize) -> Self {
        let x: Vec<Vec3> = (0..nodes).map(|_| random.vector()).collect();
        let mut constraints: Vec<Constraint> = Vec::new();
        let pick = |random: &mut SplitMix64| ((random.signed() + 1.0) * 0.5 * nodes as f64) as u32 % nodes as u32;
        while constraints.len() < count {
            if constraints.len() % 7 == 6 {
                constraints.push(constraints[constraints.len() / 2]);
            }
            let first = pick(random);
            let nodes: [u32; 4] = std::array::from_fn(|i| (first + pick(random) % 5 + 5 * i as u32) % nodes as u32);
            let [a, b] = [0.5 + 0.5 * random.signed(), 0.5 + 0.5 * random.signed()];
            let weights =
                if first % 2 == 0 { [1.0, -a * b, -a * (1.0 - b), a - 1.0] } else { [1.0 - a, a, b - 1.0, -b] };
            let apart: Vec3 = nodes.iter().zip(weights).map(|(&q, w)| x[q as usize] * w).sum();
            constraints.push(Constraint { nodes, weights, normal: apart.normalize() });
        }
        let mobility =
            |_| if random.signed() < -0.9 { Vec3::zeros() } else { Vec3::repeat(600.0 + 500.0 * random.signed()) };
        let mobility: Vec<Vec3> = (0..nodes).map(mobility).collect();
        // Prescribed nodes at rest, so that the constraints can all be satisfied by everything at rest.
        let v = mobility.iter().map(|m| if m.x == 0.0 { Vec3::zeros() } else { random.vector() }).collect();
        Self { x, constraints, mobility, v }
    }

    fn energy(&self) -> f64 {
        let nodes = self.v.iter().zip(&self.mobility).filter(|(_, m)| m.x > 0.0);
        nodes.map(|(v, m)| 0.5 * v.norm_squared() / m.x).sum()
    }
}

/// Impulses by the active-set method of Lawson and Hanson on the dense matrix: slow, and nothing in common with the
/// solver.
fn dense_velocities(contacts: &Contacts, targets: &[f64]) -> Vec<Vec3> {
    let (rows, columns) = (contacts.constraints.len(), 3 * contacts.v.len());
    let mut a = DMatrix::zeros(rows, columns);
    for (i, c) in contacts.constraints.iter().enumerate() {
        for (q, w) in c.nodes.iter().zip(c.weights) {
            for axis in 0..3 {
                a[(i, 3 * *q as usize + axis)] += w * c.normal[axis];
            }
        }
    }
    let mobility = DVector::from_iterator(columns, contacts.mobility.iter().flat_map(|m| m.iter().copied()));
    let v = DVector::from_iterator(columns, contacts.v.iter().flat_map(|v| v.iter().copied()));
    let matrix = &a * DMatrix::from_diagonal(&mobility) * a.transpose();
    let excess = &a * &v - DVector::from_row_slice(targets);
    let mut impulses = DVector::<f64>::zeros(rows);
    let mut active = vec![false; rows];
    for _ in 0..20 * rows {
        let gradient = &matrix * &impulses + &excess;
        let worst = (0..rows).filter(|&i| !active[i]).min_by(|&i, &j| gradient[i].total_cmp(&gradient[j]));
        match worst {
            Some(i) if gradient[i] < -1e-11 => active[i] = true,
            _ => break,
        }
        loop {
            let set: Vec<usize> = (0..rows).filter(|&i| active[i]).collect();
            let sub = DMatrix::from_fn(set.len(), set.len(), |i, j| matrix[(set[i], set[j])]);
            let right = DVector::from_fn(set.len(), |i, _| -excess[set[i]]);
            let solution = sub.svd(true, true).solve(&right, 1e-9).expect("both factors were asked for");
            let bound = |k: usize| impulses[set[k]] / (impulses[set[k]] - solution[k]);
            let negative = (0..set.len()).filter(|&k| solution[k] <= 0.0);
            let Some(first) = negative.min_by(|&i, &j| bound(i).total_cmp(&bound(j))) else {
                set.iter().enumerate().for_each(|(k, &i)| impulses[i] = solution[k]);
                break;
            };
            let part = bound(first);
            for (k, &i) in set.iter().enumerate() {
                impulses[i] += part * (solution[k] - impulses[i]);
            }
            impulses[set[first]] = 0.0;
            active[set[first]] = false;
        }
    }
    let end = v + DMatrix::from_diagonal(&mobility) * a.transpose() * impulses;
    end.as_slice().chunks(3).map(Vec3::from_column_slice).collect()
}

#[test]
fn an_inelastic_zone_is_the_solution_of_the_quadratic_program() {
    let mut random = SplitMix64::new(9);
    for trial in 0..60 {
        let mut contacts = Contacts::random(&mut random, 24, 2 + trial / 2);
        let targets: Vec<f64> = contacts.constraints.iter().map(|_| 0.0).collect();
        let expected = dense_velocities(&contacts, &targets);
        let outcome = inelastic(&contacts.constraints, &targets, &contacts.mobility, &mut contacts.v);
        assert!(outcome.converged, "trial {trial}: {outcome:?}");
        for (v, expected) in contacts.v.iter().zip(&expected) {
            assert!((v - expected).norm() < 1e-6, "trial {trial}: {v} instead of {expected}, {outcome:?}");
        }
    }
}

#[test]
fn large_redundant_zones_converge_and_keep_momentum() {
    let mut random = SplitMix64::new(10);
    for (nodes, count) in [(300, 400), (300, 3000), (2000, 10_000), (4000, 10_000)] {
        let mut contacts = Contacts::random(&mut random, nodes, count);
        contacts.mobility.iter_mut().for_each(|m| *m = Vec3::repeat(m.x.max(1.0)));
        let momenta = |c: &Contacts| -> [Vec3; 2] {
            let of = |i: usize| c.v[i] / c.mobility[i].x;
            [(0..nodes).map(of).sum(), (0..nodes).map(|i| c.x[i].cross(&of(i))).sum()]
        };
        let size: f64 = contacts.v.iter().zip(&contacts.mobility).map(|(v, m)| v.norm() / m.x).sum();
        let (before, energy) = (momenta(&contacts), contacts.energy());
        let targets = vec![0.0; contacts.constraints.len()];
        let outcome = inelastic(&contacts.constraints, &targets, &contacts.mobility, &mut contacts.v);
        println!("{nodes} nodes, {count} contacts: {outcome:?}");
        assert!(outcome.converged, "{outcome:?}");
        for (after, before) in momenta(&contacts).iter().zip(before) {
            assert!((after - before).norm() <= 1e-12 * size, "{before} became {after}");
        }
        assert!(contacts.energy() <= energy);
    }
}

#[test]
fn a_long_stack_stops_on_the_ground() {
    // Each falls on the one below; the lowest is prescribed. Nothing but rest satisfies all contacts.
    let links = 400;
    let weights = [1.0, -1.0, 0.0, 0.0];
    let contact = |i: u32| Constraint { nodes: [i + 1, i, i, i], weights, normal: Vec3::y() };
    let constraints: Vec<_> = (0..links).map(contact).collect();
    let mut mobility = vec![Vec3::repeat(1e3); links as usize + 1];
    let mut v = vec![Vec3::new(0.3, -1.0, 0.0); links as usize + 1];
    mobility[0] = Vec3::zeros();
    v[0] = Vec3::zeros();
    let outcome = inelastic(&constraints, &vec![0.0; links as usize], &mobility, &mut v);
    println!("{outcome:?}");
    assert!(outcome.converged, "{outcome:?}");
    assert!(v[1..].iter().all(|v| v.y.abs() < 1e-8 && v.x == 0.3));
}

#[test]
fn targets_are_reached_and_contacts_that_separate_are_left_alone() {
    let weights = [1.0, -0.5, -0.25, -0.25];
    let contact =
        |first: u32| Constraint { nodes: [first, first + 1, first + 2, first + 3], weights, normal: Vec3::z() };
    let constraints = [contact(0), contact(4)];
    let mut v = vec![Vec3::zeros(); 8];
    v[0] = Vec3::new(1.0, 2.0, -3.0);
    v[4] = Vec3::new(1.0, 2.0, 3.0);
    let before = v.clone();
    let outcome = inelastic(&constraints, &[0.5, 0.5], &[Vec3::repeat(10.0); 8], &mut v);
    assert!(outcome.converged);
    assert!((normal_velocity(&constraints[0], &v) - 0.5).abs() < 1e-8);
    assert_eq!(v[4..], before[4..]);
}

#[test]
fn a_single_contact_goes_on_sliding() {
    let constraint = Constraint { nodes: [0, 1, 2, 3], weights: [0.7, 0.3, -0.2, -0.8], normal: Vec3::y() };
    let mut random = SplitMix64::new(11);
    let mut v: Vec<Vec3> = (0..4).map(|_| random.vector()).collect();
    v[0].y = -5.0;
    let before = v.clone();
    inelastic(&[constraint], &[0.0], &[Vec3::repeat(10.0); 4], &mut v);
    assert!(v.iter().zip(&before).all(|(v, before)| v.x == before.x && v.z == before.z && v.y != before.y));
}

#[test]
fn contradicting_and_hopeless_contacts_are_reported() {
    // A node between two prescribed walls that close at 1 m/s each, and a contact between prescribed nodes alone.
    let wall =
        |nodes: [u32; 4], sign: f64| Constraint { nodes, weights: [1.0, -1.0, 0.0, 0.0], normal: Vec3::x() * sign };
    let constraints = [wall([0, 1, 1, 1], 1.0), wall([0, 2, 2, 2], -1.0), wall([2, 1, 1, 1], 1.0)];
    let mobility = [Vec3::repeat(1e3), Vec3::zeros(), Vec3::zeros()];
    let mut v = vec![Vec3::zeros(), Vec3::x(), -Vec3::x()];
    let outcome = inelastic(&constraints[..2], &[0.0; 2], &mobility, &mut v);
    println!("{outcome:?}");
    assert!(!outcome.converged && outcome.residual >= 1.0);
    assert!(v[0].iter().all(|x| x.abs() <= 1.0 + 1e-9));
    assert_eq!(v[1..], [Vec3::x(), -Vec3::x()]);
    let outcome = inelastic(&constraints[2..], &[0.0], &mobility, &mut v);
    assert!(!outcome.converged && outcome.residual == 2.0);
}
