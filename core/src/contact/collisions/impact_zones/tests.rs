//! Zones as they grow, and their figure in `docs/theory/self_contact.md`: a stack of layers between which pairs meet.

use super::{Action, Collision, Motion, Zones};
use crate::Vec3;
use crate::contact::topology::pair::{Pair, PairKind};
use crate::geometry::distance::closest_on_triangle;
use crate::testing::Figure;

/// Layers, each a triangle with one that is smaller above it, and the distance between two at the start [m].
const LAYERS: usize = 6;
const APART: f64 = 0.1;

/// A pair meets that ends closer than this, and is opened to twice as much [m].
const GAP: f64 = 0.035;

/// Displacements of the layers along x and y [m]: the lowest and the highest close on the others, which stand still; each slides
/// to its own side.
const PATHS: [[f64; 2]; LAYERS] = [[-0.1, 0.42], [0.2, 0.0], [-0.2, 0.0], [0.25, 0.0], [-0.15, 0.0], [0.2, -0.44]];

fn start(layer: usize, corner: usize) -> Vec3 {
    let size = 0.7 - 0.07 * layer as f64;
    let [x, z] = [[-1.0, -0.6], [1.0, -0.6], [0.0, 1.1]][corner];
    Vec3::new(size * x, APART * layer as f64, size * z)
}

fn motions() -> Vec<Motion> {
    let of = |node: usize| {
        let [along, up] = PATHS[node / 3];
        Motion {
            start: start(node / 3, node % 3),
            displacement: Vec3::new(along, up, 0.0),
            mobility: Vec3::repeat(1.0),
        }
    };
    (0..3 * LAYERS).map(of).collect()
}

/// The corners of layers that end closer to the plane of the one below than they may.
fn collisions(motions: &[Motion]) -> Vec<Collision> {
    let mut found = Vec::new();
    for point in 3..3 * LAYERS {
        let first = 3 * (point / 3 - 1);
        let nodes = [point, first, first + 1, first + 2];
        let [p, a, b, c] = nodes.map(|node| motions[node].start);
        let of = closest_on_triangle(&p, &[a, b, c]).weights;
        let collision = Collision {
            pair: Pair { kind: PairKind::PointTriangle, nodes: nodes.map(|node| node as u32) },
            moves: [true; 4],
            weights: [1.0, -of[0], -of[1], -of[2]],
            normal: Vec3::y(),
            target: 2.0 * GAP - APART,
        };
        let apart: f64 =
            nodes.iter().zip(collision.weights).map(|(node, weight)| weight * motions[*node].displacement.y).sum();
        if APART + apart < GAP {
            found.push(collision);
        }
    }
    found
}

/// The layers at their ends, seen from the side and a little from above, each in the colour of its zone.
fn draw(figure: &mut Figure, left: f64, words: &[&str], zones: &Zones, motions: &[Motion]) {
    let colours = ["#b03030", "#1c5fa8", "#2f8f4e"];
    for (layer, nodes) in motions.chunks(3).enumerate() {
        let zone = zones.zones().iter().position(|zone| zone.nodes.contains(&(3 * layer as u32)));
        let place = |node: &Motion| {
            let x = node.start + node.displacement;
            [left + 75.0 + 85.0 * x.x, 165.0 - 230.0 * x.y + 10.0 * x.z]
        };
        let points: Vec<[f64; 2]> = nodes.iter().map(place).collect();
        figure.polygon(&points, zone.map_or("#777", |zone| colours[zone % colours.len()]));
    }
    for (line, words) in words.iter().enumerate() {
        figure.words([left + 75.0, 205.0 + 18.0 * line as f64], "middle", "#222", words);
    }
}

/// Draws the meaning of a triangle and of its colours below the rounds.
fn legend(figure: &mut Figure) {
    figure.words([12.0, 257.0], "start", "#222", "a triangle: a layer, seen from the side");
    let rows = [("#777", "in no zone"), ("#b03030", "first zone"), ("#1c5fa8", "second zone")];
    for (index, (colour, words)) in rows.into_iter().enumerate() {
        let left = 300.0 + 150.0 * index as f64;
        figure.polygon(&[[left, 246.0], [left + 16.0, 246.0], [left + 16.0, 258.0], [left, 258.0]], colour);
        figure.words([left + 22.0, 257.0], "start", "#222", words);
    }
}

/// Lets the zone of every collision act until nothing meets; draws each round.
fn grow(action: Action, mut see: impl FnMut(usize, &Zones, &[Motion])) -> (Zones, Vec<Motion>) {
    let (mut zones, mut motions) = (Zones::default(), motions());
    for round in 0..20 {
        see(round, &zones, &motions);
        let met = collisions(&motions);
        if met.is_empty() {
            return (zones, motions);
        }
        for place in zones.add(Vec::new(), round as u32, &met) {
            let zone = zones.zone_mut(place);
            let members = zone.members();
            let of_members: Vec<Motion> = members.iter().map(|node| motions[*node as usize]).collect();
            let solved = zone.solve(action, &members, &of_members, GAP);
            assert!(!solved.fails);
            for (node, displacement) in members.iter().zip(solved.displacements) {
                motions[*node as usize].displacement = displacement;
            }
        }
    }
    panic!("pairs go on meeting");
}

#[test]
fn zones_grow_until_nothing_meets_and_the_figure_shows_it() {
    let mut figure = Figure::new("Impact zones that grow, inelastic and rigid", [770.0, 265.0]);
    let mut sizes = Vec::new();
    let (zones, sliding) = grow(Action::Inelastic, |round, zones, motions| {
        sizes.push(zones.zones().len());
        let words: &[&str] = match round {
            0 => &["ends of the paths:", "layers have passed"],
            1 => &["two zones"],
            2 => &["they grow"],
            _ => &["one zone, inelastic:", "layers slide"],
        };
        draw(&mut figure, 5.0 + 152.0 * round as f64, words, zones, motions);
    });
    assert_eq!(sizes, [0, 2, 2, 1]);
    let (_, rigid) = grow(Action::Rigid, |_, _, _| ());
    draw(&mut figure, 613.0, &["the same, rigid:", "one body"], &zones, &rigid);
    let along = |motions: &[Motion]| motions.iter().map(|motion| motion.displacement.x).collect::<Vec<_>>();
    let spread = |x: &[f64]| x.iter().fold(f64::MIN, |a, b| a.max(*b)) - x.iter().fold(f64::MAX, |a, b| a.min(*b));
    assert!((spread(&along(&sliding)) - spread(&along(&motions()))).abs() < 0.02, "tangential motion stays");
    let sum = |motions: &[Motion]| motions.iter().map(|motion| motion.displacement).sum::<Vec3>();
    for moved in [&sliding, &rigid] {
        assert!((sum(moved) - sum(&motions())).norm() < 1e-12, "momentum");
    }
    legend(&mut figure);
    figure.assert_written("impact_zones.svg");
}

#[test]
fn a_zone_follows_what_is_prescribed_until_that_parts() {
    let mobility = |node: u32| if node == 0 { Vec3::repeat(1.0) } else { Vec3::zeros() };
    let collision = |normal: Vec3| Collision {
        pair: Pair { kind: PairKind::PointTriangle, nodes: [0, 1, 2, 3] },
        moves: [true, false, false, false],
        weights: [1.0, -0.4, -0.3, -0.3],
        normal,
        target: 1.0,
    };
    let mut zones = Zones::default();
    zones.add(Vec::new(), 7, &[collision(Vec3::y()), collision(-Vec3::y())]);
    let zone = zones.zone_mut(0);
    let motion = |node: u32, displacement: Vec3| Motion {
        start: start(0, node as usize % 3) + Vec3::y() * f64::from(node),
        displacement,
        mobility: mobility(node),
    };
    let alike: Vec<Motion> = (0..4).map(|node| motion(node, if node == 0 { Vec3::x() } else { Vec3::z() })).collect();
    let members = zone.members();
    assert!(zone.solve(Action::Inelastic, &members, &alike, GAP).fails, "one pair pushes up, the other one down");
    zone.note(Action::Inelastic, true);
    assert!(zone.contradicts && zone.has_prescribed());
    let carried = zone.solve(Action::Carry, &members, &alike, GAP);
    assert!(!carried.fails && carried.displacements.iter().all(|d| (d - Vec3::z()).norm() < 1e-9));
    // A fifth node that stays behind: no affine map of five points in space has all their motions.
    zone.collisions[1].1.pair.nodes = [0, 4, 5, 6];
    let members = zone.members();
    let parting: Vec<Motion> = (0..7)
        .map(|node| motion(node, if node > 3 { Vec3::z() * f64::from(node % 2) } else { Vec3::zeros() }))
        .collect();
    assert!(zone.solve(Action::Carry, &members, &parting, GAP).fails);
    zone.note(Action::Carry, true);
    assert!(zone.was_carried && !zone.contradicts && zone.has_prescribed(), "an inelastic solve has another chance");
    zone.note(Action::Inelastic, true);
    assert!(zone.has_released_prescribed && zone.collisions.is_empty());
}
