//! Tangles: garments that start crossed, drawn from seeds, and whether they come free.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{EffectRequest, GarmentDescription, SceneDescription, SeamDescription};
use drapery_core::self_intersections;
use drapery_core::tolerances::OVERSTRETCHED;

use crate::bench::{Bench, Input, Record, Trial};
use crate::case::Figure;
use crate::cases::add_mesh_body;
use crate::scenes::*;

/// Frames of the settle in which a tangle has to come free.
const FRAMES: i64 = 48;

/// Tangles of `drapery selftest --tangles`.
pub const COUNT: u64 = 20;

/// Size of the cells [m].
const CELL: f64 = 0.01;

/// Stiffness of the cloth [N/m].
const STIFFNESS: f64 = 50.0;

/// Kinds of tangles, each with what makes its scene.
const KINDS: [(&str, Kind); 8] = [
    ("a sheet through a sheet", sheet_through_sheet),
    ("a sleeve through a bodice", sleeve_through_bodice),
    ("a pocket through its panel", pocket_through_panel),
    ("a hem tucked under", hem_tucked_under),
    ("three layers through each other", three_layers),
    ("a strip wound through itself", wound_through_itself),
    ("a tube that is partly inside the body", inside_the_body),
    ("a collar folded in", collar_folded_in),
];

type Kind = fn(&mut Random) -> Tangle;

/// A scene that starts crossed.
struct Tangle {
    description: SceneDescription,
    /// Points and triangles of a body at rest.
    body: Option<(Vec<Vec3>, Vec<[u32; 3]>)>,
}

/// The kind of tangle that a seed draws.
pub fn title(seed: u64) -> &'static str {
    KINDS[seed as usize % KINDS.len()].0
}

/// The tangle of a seed, with contact.
fn tangle(seed: u64) -> Tangle {
    let (_, kind) = KINDS[seed as usize % KINDS.len()];
    let mut tangle = kind(&mut Random::new(seed));
    add_self_contact(&mut tangle.description);
    tangle
}

/// The garments of a seed, with contact; without the body that some kinds have.
pub fn scene(seed: u64) -> SceneDescription {
    tangle(seed).description
}

/// Runs the tangle of a seed.
///
/// # Errors
/// The errors of [`Bench::simulate`].
pub fn judge(bench: &mut Bench<'_>, seed: u64) -> Result<Vec<Figure>, String> {
    let Tangle { mut description, body } = tangle(seed);
    let input: Input<'_> = match &body {
        None => Trial::still(description.clone(), 0).input,
        Some((points, triangles)) => add_mesh_body(&mut description, triangles.clone(), |_| points.clone()),
    };
    let garments = description.garments.clone();
    let record = bench.simulate(&Trial { input, may_cross: true, ..Trial::still(description, FRAMES) })?;
    let counts: Vec<usize> = record.frames.iter().map(|frame| frame.crossings).collect();
    let most = counts.iter().copied().max().unwrap_or(0);
    let (left, places) = left_crossed(&garments, &record);
    let mut figures = vec![
        Figure::at_least("intersections at the start", counts[0] as f64, 1.0),
        Figure::at_most("most intersections in a frame", most as f64, counts[0] as f64),
        Figure::exactly(format!("intersections at the end{places}"), left.max(record.last().crossings) as f64, 0.0),
    ];
    let wrong = on_the_wrong_side(&garments, &record);
    figures.push(Figure::exactly("vertices on the wrong side at the end", wrong as f64, 0.0));
    figures.push(Figure::at_most("largest strain", record.strain(), OVERSTRETCHED));
    Ok(figures)
}

/// Intersections of cloth with cloth at the end, counted anew; and where they are, by garments.
fn left_crossed(garments: &[GarmentDescription], record: &Record) -> (usize, String) {
    let (mut points, mut triangles, mut owners) = (Vec::new(), Vec::new(), Vec::new());
    for (g, (garment, positions)) in garments.iter().zip(&record.last().positions).enumerate() {
        let first = points.len() as u32;
        triangles.extend(garment.mesh.face_indices.chunks(3).map(|t| [t[0], t[1], t[2]].map(|v| v + first)));
        points.extend_from_slice(positions);
        owners.resize(points.len(), g);
    }
    let found = self_intersections(&triangles, &points);
    let mut places: BTreeMap<[usize; 2], (usize, Vec3)> = BTreeMap::new();
    for crossing in &found {
        let [a, b] = [crossing.edge[0], crossing.triangle[0]].map(|vertex| owners[vertex as usize]);
        let entry = places.entry([a.min(b), a.max(b)]).or_insert((0, Vec3::zeros()));
        *entry = (entry.0 + 1, entry.1 + points[crossing.edge[0] as usize]);
    }
    let place = |(&[a, b], &(count, sum)): (&[usize; 2], &(usize, Vec3))| {
        let [x, y, z] = (sum / count as f64).into();
        format!("; {} through {}: {count} around ({x:.2}, {y:.2}, {z:.2}) m", garments[a].name, garments[b].name)
    };
    (found.len(), places.iter().map(place).collect())
}

/// Vertices of a garment that are close to a face of another and on the other side of it than their layers say.
fn on_the_wrong_side(garments: &[GarmentDescription], record: &Record) -> usize {
    let mut wrong = 0;
    for (a, outer) in garments.iter().enumerate() {
        for (b, inner) in garments.iter().enumerate() {
            if outer.layer.is_some() && inner.layer.is_some() && outer.layer > inner.layer {
                let [x, y] = [a, b].map(|garment| record.last().positions[garment].as_slice());
                let faces = inner_faces(&inner.mesh);
                wrong += x.iter().filter(|point| is_behind(point, &faces, y)).count();
            }
        }
    }
    wrong
}

/// The triangles without a vertex on the border: cloth may hang over a border on either side.
fn inner_faces(mesh: &PolygonMesh) -> Vec<[u32; 3]> {
    let triangles: Vec<[u32; 3]> = mesh.face_indices.chunks(3).map(|t| [t[0], t[1], t[2]]).collect();
    let edges = triangles.iter().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
    let mut counts: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    edges.for_each(|[p, q]| *counts.entry([*p.min(q), *p.max(q)]).or_default() += 1);
    let border: BTreeSet<u32> = counts.iter().filter(|(_, count)| **count == 1).flat_map(|(edge, _)| *edge).collect();
    triangles.into_iter().filter(|triangle| !triangle.iter().any(|vertex| border.contains(vertex))).collect()
}

/// Whether a point is behind the closest of these faces that it is over, and closer than half a cell.
fn is_behind(point: &Vec3, faces: &[[u32; 3]], x: &[Vec3]) -> bool {
    let over = faces.iter().filter_map(|triangle| {
        let [a, b, c] = triangle.map(|v| x[v as usize]);
        let normal = (b - a).cross(&(c - a));
        let area = normal.norm_squared();
        let weights = [(b, c), (c, a), (a, b)].map(|(p, q)| (p - point).cross(&(q - point)).dot(&normal) / area);
        let is_over = weights.iter().all(|weight| *weight >= 0.0);
        is_over.then(|| (point - a).dot(&normal) / area.sqrt())
    });
    let closest = over.min_by(|one, other| one.abs().total_cmp(&other.abs()));
    closest.is_some_and(|height| height < 0.0 && height > -0.5 * CELL)
}

/// A sheet that `place` puts in space: by its coordinates along both sides from its corner [m].
fn placed(name: &str, cells: [usize; 2], layer: Option<u32>, place: impl Fn(f64, f64) -> Vec3) -> GarmentDescription {
    let mesh = sheet(cells[0], cells[1], CELL);
    let half = [cells[0], cells[1]].map(|cells| 0.5 * cells as f64 * CELL);
    let points: Vec<Vec3> = mesh.points.iter().map(|p| place(p.x + half[0], p.z + half[1])).collect();
    GarmentDescription { start: Some(points), layer, ..GarmentDescription::new(name, mesh, 0.2) }
}

/// A tube, seen from outside by its faces' fronts: `place` gives its points by the share of the way around and the distance along [m].
fn tube(
    name: &str,
    [around, along]: [usize; 2],
    layer: Option<u32>,
    place: impl Fn(f64, f64) -> Vec3,
) -> GarmentDescription {
    let points = (0..=along).flat_map(|k| (0..around).map(move |i| (i, k)));
    let points = points.map(|(i, k)| place(i as f64 / around as f64, k as f64 * CELL)).collect();
    let at = |i: usize, k: usize| (i % around + around * k) as u32;
    let cells = (0..along).flat_map(|k| (0..around).map(move |i| (i, k)));
    let triangles: Vec<[u32; 3]> = cells
        .flat_map(|(i, k)| {
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            if (i + k) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
        })
        .collect();
    GarmentDescription { layer, ..GarmentDescription::new(name, PolygonMesh::from_triangles(points, &triangles), 0.2) }
}

/// A scene of these garments, all of one cloth.
fn dressed(garments: Vec<GarmentDescription>, has_weight: bool) -> SceneDescription {
    let mut garments = garments.into_iter();
    let mut description = scene_of(garments.next().expect("a tangle has a garment"), 24);
    description.garments.extend(garments);
    (0..description.garments.len()).for_each(|garment| add_cloth(&mut description, garment, STIFFNESS));
    if has_weight {
        add_weight(&mut description);
    }
    description
}

/// The corners of a sheet of `cells` squares.
fn corners([x, z]: [usize; 2]) -> Vec<u32> {
    [0, x, (x + 1) * z, (x + 1) * (z + 1) - 1].map(|vertex| vertex as u32).into()
}

/// A level sheet at this height, held at its corners.
fn bed(cells: [usize; 2]) -> GarmentDescription {
    placed("bed", cells, Some(1), |x, z| Vec3::new(x, 0.0, z))
}

fn sheet_through_sheet(random: &mut Random) -> Tangle {
    let cells = [20, 20];
    let (tilt, shift, turn) = (0.3 * random.number(), 0.01 * random.number(), 0.4 * random.number());
    let (sin, cos) = turn.sin_cos();
    let upper = placed("upright", [14, 14], Some(2), |x, y| {
        let (x, y) = (x - 0.07, y - 0.07);
        let along = Vec3::new(cos, 0.0, sin);
        let across = Vec3::new(-sin, 0.0, cos);
        Vec3::new(0.1 + shift, 0.0, 0.1) + along * x + Vec3::y() * (y * tilt.cos() + 0.0031) + across * (y * tilt.sin())
    });
    let mut description = dressed(vec![bed(cells), upper], true);
    add_pins(&mut description, corners(cells));
    Tangle { description, body: None }
}

fn sleeve_through_bodice(random: &mut Random) -> Tangle {
    let (out, lift) = (0.03 + 0.01 * random.number(), 0.02 * random.number());
    let bodice = tube("bodice", [62, 20], Some(2), |turn, y| {
        let (sin, cos) = (-turn * TAU).sin_cos();
        Vec3::new(0.1 * cos, y, 0.1 * sin)
    });
    let sleeve = tube("sleeve", [24, 10], Some(1), |turn, x| {
        let (sin, cos) = (turn * TAU).sin_cos();
        Vec3::new(x + out, 0.1 + lift + 0.038 * cos, 0.038 * sin)
    });
    let mut description = dressed(vec![bodice, sleeve], false);
    add_pins(&mut description, (0..62).chain(62 * 20..62 * 21).collect());
    Tangle { description, body: None }
}

fn pocket_through_panel(random: &mut Random) -> Tangle {
    let (cells, tilt, side) = ([20, 20], 0.25 + 0.1 * random.number(), 0.2 * random.number());
    // Their fronts look along z.
    let panel = placed("panel", cells, Some(1), |x, y| Vec3::new(x, -y, 0.0));
    let pocket = placed("pocket", [8, 8], Some(2), |x, y| {
        let depth = 0.004 - tilt * (x - 0.03) + side * (y - 0.08);
        Vec3::new(0.0571 + x, -0.0553 - y, depth)
    });
    let mut description = dressed(vec![panel, pocket], true);
    add_pins(&mut description, (0..21).collect());
    let pairs = (0..9).map(|i| [i + 9 * 8, 6 + i + 21 * 14]).collect();
    let seam = SeamDescription { rest_gap: Some(0.002), ..SeamDescription::new([1, 0], pairs, 400.0) };
    description.seams.push(seam);
    description.effects.push(EffectRequest::of_scene("seams"));
    Tangle { description, body: None }
}

fn hem_tucked_under(random: &mut Random) -> Tangle {
    let (cells, height, turn) = ([22, 20], 0.011 + 0.002 * random.number(), 0.2 * random.number());
    let radius = 0.012;
    let outer = placed("outer", [16, 14], Some(2), |x, z| {
        let fold = 0.16 - (0.045 + std::f64::consts::PI * radius);
        let (along, y) = if x < fold {
            (x, height)
        } else if x - fold < std::f64::consts::PI * radius {
            let angle = (x - fold) / radius;
            (fold + radius * angle.sin(), height - radius * (1.0 - angle.cos()))
        } else {
            (fold - (x - fold - std::f64::consts::PI * radius), height - 2.0 * radius)
        };
        Vec3::new(0.032 + along + turn * (z - 0.07), y, 0.031 + z)
    });
    let mut description = dressed(vec![bed(cells), outer], true);
    add_pins(&mut description, corners(cells));
    Tangle { description, body: None }
}

fn three_layers(random: &mut Random) -> Tangle {
    let cells = [18, 18];
    let wave = |random: &mut Random| {
        let [a, b] = [random.number(), random.number()];
        move |x: f64, z: f64| 0.004 * ((35.0 * x + 3.0 * a).sin() + (35.0 * z + 3.0 * b).sin())
    };
    let waves = [wave(random), wave(random), wave(random)];
    let layer = |(k, wave): (usize, &dyn Fn(f64, f64) -> f64)| {
        let shift = 0.0013 * k as f64;
        let place = |x: f64, z: f64| Vec3::new(x + shift, 0.002 * k as f64 + wave(x, z), z + shift);
        placed(["lower", "middle", "upper"][k], cells, Some(k as u32 + 1), place)
    };
    let garments = waves.iter().enumerate().map(|(k, wave)| layer((k, wave))).collect();
    let mut description = dressed(garments, true);
    add_pins(&mut description, corners(cells));
    Tangle { description, body: None }
}

fn wound_through_itself(random: &mut Random) -> Tangle {
    let (amplitude, phase) = (0.006 + 0.001 * random.number(), random.number());
    // Nearly two turns; the second passes through the first.
    let strip = placed("strip", [60, 6], None, |s, y| {
        let angle = s / 0.05;
        let second = (angle / TAU - 1.0).max(0.0);
        let radius = 0.05 + 0.004 * angle / TAU + amplitude * (2.0 * angle + phase).sin() * second.min(0.3) / 0.3;
        Vec3::new(radius * angle.cos(), y + 0.002 * angle, radius * angle.sin())
    });
    Tangle { description: dressed(vec![strip], false), body: None }
}

fn inside_the_body(random: &mut Random) -> Tangle {
    let (faces, unit) = unit_ball(16, 32);
    let points: Vec<Vec3> = unit.iter().map(|p| p * 0.1).collect();
    let shift = 0.010 + 0.003 * random.number();
    let belt = tube("tube", [64, 10], Some(1), |turn, y| {
        let (sin, cos) = (-turn * TAU).sin_cos();
        Vec3::new(0.103 * cos + shift, y - 0.05, 0.103 * sin)
    });
    Tangle { description: dressed(vec![belt], false), body: Some((points, faces)) }
}

fn collar_folded_in(random: &mut Random) -> Tangle {
    let (share, depth) = (0.35 + 0.1 * random.number(), 0.005);
    let coat = tube("coat", [40, 14], Some(1), |turn, y| {
        let (sin, cos) = (-turn * TAU).sin_cos();
        Vec3::new(0.064 * cos, y, 0.064 * sin)
    });
    // From its lower border up to the seam with the coat.
    let collar = tube("collar", [40, 5], Some(2), |turn, y| {
        let (sin, cos) = (-turn * TAU).sin_cos();
        let inside = ((TAU * (turn - 0.5)).cos() - (TAU * 0.5 * share).cos()) * 3.0;
        let radius = 0.064 + (0.003 - depth * (0.5 + 0.5 * inside.tanh())) * (1.0 - (y / 0.05 - 0.2).max(0.0)) + 0.0005;
        Vec3::new(radius * cos, 0.0903 + y, radius * sin)
    });
    // No weight: the shoulders that would bear it are not there.
    let mut description = dressed(vec![coat, collar], false);
    add_pins(&mut description, (0..40).collect());
    let pairs = (0..40).map(|i| [i + 40 * 5, i + 40 * 14]).collect();
    description.seams.push(SeamDescription { rest_gap: Some(0.001), ..SeamDescription::new([1, 0], pairs, 400.0) });
    description.effects.push(EffectRequest::of_scene("seams"));
    Tangle { description, body: None }
}
