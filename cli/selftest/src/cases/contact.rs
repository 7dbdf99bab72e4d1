//! H23 to H37: contact.

use drapery_core::Vec3;
use drapery_core::contact::ccd;
use drapery_core::geometry::shapes::Shape;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyShape, EffectRequest, GarmentDescription, PinDescription, PinHold, PinTarget, RigidMotion, SceneDescription,
};
use drapery_core::simulation::{FrameInput, Sample};

use crate::bench::{Bench, Input, Trial};
use crate::case::{Case, Figure, Tier};
use crate::files::SHEET;
use crate::scenes::*;

/// A sheet of `cells` by `cells` squares of `dx` [m] in the plane x = 0.
pub(super) fn upright(cells: usize, dx: f64) -> GarmentDescription {
    let mut mesh = sheet(cells, cells, dx);
    mesh.points.iter_mut().for_each(|p| *p = Vec3::new(0.0, p.z, p.x));
    GarmentDescription::new("sheet", mesh, 0.2)
}

/// Adds a body of these triangles; `place` gives its points at a time [s]. Returns what the frames need.
pub(crate) fn add_mesh_body<'a>(
    description: &mut SceneDescription,
    triangles: Vec<[u32; 3]>,
    place: impl Fn(f64) -> Vec<Vec3> + Sync + 'a,
) -> Input<'a> {
    let shape = BodyShape::Surface { triangles, point_count: place(0.0).len() };
    add_body(description, shape, RigidMotion::at(Vec3::zeros()), 0.3);
    let timeline = description.timeline;
    Box::new(move |frame| {
        let time = timeline.time(frame);
        FrameInput { frame, bodies: vec![vec![Sample { time, positions: place(time) }]], ..FrameInput::default() }
    })
}

pub(super) const H23: Case = Case {
    id: "H23",
    title: "a kick of 5 to 50 m/s by a plate of 6 mm, one sample a frame",
    must: "nothing passes through the plate",
    judge: |bench| {
        let mut figures = Vec::new();
        for speed in [5.0, 20.0, 50.0] {
            let (points, triangles) = box_mesh(Vec3::new(0.003, 0.3, 0.3), 4);
            let place = |time: f64| -> Vec<Vec3> {
                points.iter().map(|p| p + Vec3::x() * (speed * (time - 1.5 / 24.0))).collect()
            };
            let mut description = scene_of(upright(12, 0.03), 24);
            add_cloth(&mut description, 0, 100.0);
            add_self_contact(&mut description);
            let input = add_mesh_body(&mut description, triangles, place);
            description.bodies[0].thickness = 0.001;
            let record = bench.simulate(&Trial { input, ..Trial::still(description, 5) })?;
            let front = speed * (5.0 - 1.5) / 24.0 + 0.003;
            let behind = record.last().positions[0].iter().filter(|x| x.x < front).count();
            figures.push(Figure::exactly(format!("vertices behind the plate at {speed} m/s"), behind as f64, 0.0));
        }
        Ok(figures)
    },
};

/// Returns the distance [m] that a patch slides in half a second down a plane of this slope [rad] from `speed` [m/s],
/// and the distance by Coulomb's law [m].
fn slide(bench: &mut Bench<'_>, friction: f64, slope: f64, speed: f64) -> Result<(f64, f64), String> {
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vec3::z_axis(), -slope);
    let mut mesh = sheet(4, 4, 0.03);
    let down = turn * Vec3::x();
    // Not below the plane by rounding.
    mesh.points.iter_mut().for_each(|p| *p = turn * (*p + Vec3::y() * 1e-6));
    let mut description = scene_of(GarmentDescription::new("patch", mesh, 0.2), 24);
    description.garments[0].velocity = down * speed;
    add_cloth(&mut description, 0, 200.0);
    add_weight(&mut description);
    add_floor(&mut description, friction);
    (description.bodies[0].motion.rotation, description.bodies[0].thickness) = (turn, 0.0);
    let record = bench.simulate(&Trial::still(description, 12))?;
    let centre = |x: &[Vec3]| x.iter().sum::<Vec3>() / x.len() as f64;
    let way = (centre(&record.last().positions[0]) - centre(&record.frames[0].positions[0])).dot(&down);
    let pull = GRAVITY * (slope.sin() - friction * slope.cos());
    let seconds: f64 = if pull < 0.0 { 0.5_f64.min(speed / -pull) } else { 0.5 };
    Ok((way, speed * seconds + 0.5 * pull * seconds * seconds))
}

pub(super) const H33: Case = Case {
    id: "H33",
    title: "friction of 0, 10 and in between on a slope of 30 degrees",
    must: "Coulomb's law",
    judge: |bench| {
        let slope = std::f64::consts::FRAC_PI_6;
        let mut figures = Vec::new();
        for (friction, speed) in [(0.0, 0.0), (0.3, 0.0), (0.3, 1.0), (0.8, 1.0), (10.0, 1.0), (10.0, 0.0)] {
            let (way, truth) = slide(bench, friction, slope, speed)?;
            let what = format!("error of the distance at friction {friction} from {speed} m/s [m]");
            figures.push(Figure::at_most(what, (way - truth).abs(), 2e-4 + 0.002 * truth));
        }
        Ok(figures)
    },
};

pub(super) const H24: Case = Case {
    id: "H24",
    title: "a sheet that stands through another at the start",
    must: "it runs, intersections never increase, and none are left after two seconds",
    judge: |bench| {
        let mut description = cloth(8, 0.02, 50.0);
        let mut other = description.garments[0].clone();
        other.name = "other".into();
        other.mesh.points.iter_mut().for_each(|p| *p = Vec3::new(0.003 + 0.2 * p.y, p.x + 0.004, p.z));
        description.garments.push(other);
        add_cloth(&mut description, 1, 50.0);
        add_self_contact(&mut description);
        let record = bench.simulate(&Trial { may_cross: true, ..Trial::still(description, 48) })?;
        let counts: Vec<usize> = record.frames.iter().map(|frame| frame.crossings).collect();
        let more = counts.windows(2).filter(|w| w[1] > w[0]).count();
        Ok(vec![
            Figure::at_least("intersections at the start", counts[0] as f64, 10.0),
            Figure::exactly("frames with more intersections than before", more as f64, 0.0),
            Figure::exactly("intersections at the end", record.last().crossings as f64, 0.0),
        ])
    },
};

/// Two boxes of one mesh, `gap` apart along x [m].
fn boxes(gap: f64, cells: i32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (one, faces) = box_mesh(Vec3::new(0.1, 0.25, 0.25), cells);
    let (other, more) = box_mesh(Vec3::new(0.1, 0.24, 0.24), cells);
    let mut triangles = faces;
    triangles.extend(more.iter().map(|t| t.map(|v| v + one.len() as u32)));
    let apart = 0.1 + 0.5 * gap;
    let points = one.iter().map(|p| p - Vec3::x() * apart).chain(other.iter().map(|p| p + Vec3::x() * apart)).collect();
    (points, triangles)
}

pub(super) const H25: Case = Case {
    id: "H25",
    title: "cloth pinched between parts of a body that pass into each other",
    must: "no flutter while it is pinched; no intersection is left 12 frames after it opens",
    judge: |bench| {
        let gap = |time: f64| 0.02 - 0.05 * (std::f64::consts::PI * time.min(1.0)).sin();
        let mut description = scene_of(upright(12, 0.033), 24);
        add_cloth(&mut description, 0, 100.0);
        add_weight(&mut description);
        add_pins(&mut description, (156..169).collect());
        add_self_contact(&mut description);
        let input = add_mesh_body(&mut description, boxes(0.0, 8).1, move |time| boxes(gap(time), 8).0);
        (description.bodies[0].thickness, description.bodies[0].max_push_speed) = (0.002, 1.0);
        let record = bench.simulate(&Trial { input, may_cross: true, ..Trial::still(description, 40) })?;
        let left = record.frames.iter().filter(|f| f.summary.frame >= 36).map(|f| f.crossings).max().unwrap_or(0);
        Ok(vec![
            Figure::at_least("pinched vertices, in all steps", record.counted("body_pinched"), 1.0),
            Figure::at_most("largest kinetic energy [J]", record.kinetic(), 0.1),
            Figure::exactly("intersections from 12 frames after it opens", left as f64, 0.0),
        ])
    },
};

pub(super) const H26: Case = Case {
    id: "H26",
    title: "a body of two balls that lie in each other",
    must: "cloth rests on the outside and is not drawn in",
    judge: |bench| {
        let (faces, unit) = unit_ball(12, 24);
        let ball = |x: f64| unit.iter().map(move |p| p * 0.12 + Vec3::x() * x);
        let points: Vec<Vec3> = ball(-0.08).chain(ball(0.08)).collect();
        let count = unit.len() as u32;
        let triangles = faces.iter().copied().chain(faces.iter().map(|t| t.map(|v| v + count))).collect();
        let mut description = cloth(14, 0.04, 100.0);
        description.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.13);
        add_weight(&mut description);
        add_self_contact(&mut description);
        let input = add_mesh_body(&mut description, triangles, move |_| points.clone());
        (description.bodies[0].thickness, description.bodies[0].max_push_speed) = (0.002, 1.0);
        let record = bench.simulate(&Trial { input, ..Trial::still(description, 24) })?;
        let facet = (std::f64::consts::PI / 24.0).cos().powi(2);
        let depth = |x: &Vec3| {
            let from = |c: f64| 0.12 * facet - (x - Vec3::x() * c).norm();
            from(-0.08).max(from(0.08))
        };
        let deepest = record.last().positions[0].iter().map(depth).fold(0.0, f64::max);
        Ok(vec![
            Figure::at_most("deepest vertex inside a ball [m]", deepest, 1e-3),
            Figure::at_most("strain", record.strain(), 0.3),
        ])
    },
};

pub(super) const H27: Case = Case {
    id: "H27",
    title: "a tube twisted by 1080 degrees",
    must: "no intersection through three turns",
    judge: |bench| {
        let around = bench.by_tier(16, 64);
        let rows = around;
        let at = |r: usize, s: usize| (r * around + s % around) as u32;
        let mut points = Vec::new();
        let mut triangles = Vec::new();
        for r in 0..=rows {
            for s in 0..around {
                let (sin, cos) = (std::f64::consts::TAU * s as f64 / around as f64).sin_cos();
                points.push(Vec3::new(0.1 * cos, 0.6 * (r as f64 / rows as f64 - 0.5), 0.1 * sin));
                if r < rows {
                    triangles.extend([
                        [at(r, s), at(r + 1, s), at(r, s + 1)],
                        [at(r, s + 1), at(r + 1, s), at(r + 1, s + 1)],
                    ]);
                }
            }
        }
        let ends: Vec<u32> = (0..around).map(|s| at(0, s)).chain((0..around).map(|s| at(rows, s))).collect();
        let rings: Vec<Vec3> = ends.iter().map(|v| points[*v as usize]).collect();
        let mut description =
            scene_of(GarmentDescription::new("tube", PolygonMesh::from_triangles(points, &triangles), 0.2), 24);
        add_cloth(&mut description, 0, 100.0);
        add_self_contact(&mut description);
        let target = PinTarget::Track { vertices: ends, track: 0 };
        let (from, until) = (f64::NEG_INFINITY, f64::INFINITY);
        description.pins.push(PinDescription { garment: 0, target, axes: [true; 3], from, until, hold: PinHold::Hard });
        description.effects.push(EffectRequest::of_scene("pins"));
        let frames = 48;
        let input = move |frame: i64| {
            let time = frame as f64 / 24.0;
            let half_turn = 3.0 * std::f64::consts::PI * frame as f64 / frames as f64;
            let turned = |p: &Vec3| {
                let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::y_axis(), half_turn * p.y.signum());
                // Twisted cloth gets shorter.
                (turn * p).component_mul(&Vec3::new(1.0, 1.0 - 0.35 * frame as f64 / frames as f64, 1.0))
            };
            let sample = Sample { time, positions: rings.iter().map(turned).collect() };
            FrameInput { frame, tracks: vec![vec![sample]], ..FrameInput::default() }
        };
        let record = bench.simulate(&Trial { input: Box::new(input), ..Trial::still(description, frames) })?;
        let crossings: usize = record.frames.iter().map(|frame| frame.crossings).sum();
        Ok(vec![
            Figure::exactly("intersections in all frames", crossings as f64, 0.0),
            Figure::at_least(
                "collisions, counted",
                record.counted("collision_hits") + record.counted("repulsions"),
                1.0,
            ),
        ])
    },
};

/// Sheets over each other, `gap` apart, the lowest at `height` [m].
fn stack(count: usize, cells: usize, dx: f64, (height, gap): (f64, f64)) -> SceneDescription {
    let mut description = SceneDescription::new("stack");
    for layer in 0..count {
        let mut mesh = sheet(cells, cells, dx);
        // Turned a little, so that edges do not lie on edges.
        let turn = nalgebra::Rotation3::from_axis_angle(&Vec3::y_axis(), 0.05 * layer as f64);
        mesh.points.iter_mut().for_each(|p| *p = turn * *p + Vec3::y() * (height + gap * layer as f64));
        description.garments.push(GarmentDescription::new(&format!("layer{layer}"), mesh, 0.2));
        add_cloth(&mut description, layer, 20.0);
    }
    add_weight(&mut description);
    add_self_contact(&mut description);
    description
}

/// Frames after the start at which ranks are compared in a heap: they meet there, but for more, seven ranks on two cores need
/// most of a minute, in which they pass each other messages of what is first at each node.
const HEAP: i64 = 2;

pub(super) const H28: Case = Case {
    id: "H28",
    title: "a stack of ten sheets that drops on the floor",
    must: "it settles, in order, and lies still to the end",
    judge: |bench| {
        let (count, cells) = bench.by_tier((10, 3), (50, 20));
        let mut description = stack(count, cells, 0.03, (0.05, 0.004));
        add_floor(&mut description, 0.5);
        description.bodies[0].thickness = 0.001;
        let record = bench.simulate(&Trial { compared: HEAP, ..Trial::still(description, 72) })?;
        let height = |x: &Vec<Vec3>| x.iter().map(|x| x.y).sum::<f64>() / x.len() as f64;
        let heights: Vec<f64> = record.last().positions.iter().map(height).collect();
        // A stack that bounces for ever is quiet in single frames.
        let seconds = bench.by_tier(1, 2);
        let at_rest =
            record.frames[24 * seconds..].iter().map(|frame| frame.summary.kinetic_energy).fold(0.0, f64::max);
        let mass: f64 = record.masses.concat().iter().sum();
        let disorder = heights.windows(2).filter(|w| w[1] <= w[0]).count();
        Ok(vec![
            Figure::at_most(format!("kinetic energy after {seconds} s [J]"), at_rest, 1e-6),
            Figure::exactly("neighbours out of order", disorder as f64, 0.0),
            Figure::at_most(
                "largest kinetic energy over the energy of the drop",
                record.kinetic() / (mass * GRAVITY * 0.1),
                1.0,
            ),
        ])
    },
};

pub(super) const H29: Case = Case {
    id: "H29",
    title: "ten layers on a ball",
    must: "they keep their order",
    judge: |bench| {
        let (count, cells) = bench.by_tier((10, 4), (10, 40));
        let mut description = stack(count, cells, 0.24 / cells as f64, (0.105, 0.003));
        let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
        add_body(&mut description, ball, RigidMotion::at(Vec3::zeros()), 0.5);
        description.bodies[0].thickness = 0.002;
        let record = bench.simulate(&Trial { compared: HEAP, ..Trial::still(description, 24) })?;
        // Over the pole the layers lie one on the other.
        let middle = |x: &Vec<Vec3>| x[x.len() / 2].norm();
        let heights: Vec<f64> = record.last().positions.iter().map(middle).collect();
        let disorder = heights.windows(2).filter(|w| w[1] <= w[0]).count();
        Ok(vec![
            Figure::exactly("neighbours out of order over the pole", disorder as f64, 0.0),
            Figure::at_least("distance of the lowest layer from the centre of the ball [m]", heights[0], 0.1),
        ])
    },
};

pub(super) const H30: Case = Case {
    id: "H30",
    title: "a sheet that slides on a sheet under its weight",
    must: "friction stops it, zones of collisions do not",
    judge: |bench| {
        let mut description = stack(2, 6, 0.03, (0.0, 0.0012));
        let mut long = sheet(40, 10, 0.03);
        long.points.iter_mut().for_each(|p| p.x += 0.4);
        description.garments[0].mesh = long;
        description.garments[1].velocity = Vec3::x();
        for effect in description.effects.iter_mut().filter(|effect| effect.effect == "self_repulsion") {
            *effect = effect.clone().with("friction", 0.3);
        }
        add_pins(&mut description, (0..41 * 11).collect());
        let record = bench.simulate(&Trial::still(description, 14))?;
        let centre = |frame: &crate::bench::Frame| {
            frame.positions[1].iter().map(|x| x.x).sum::<f64>() / frame.positions[1].len() as f64
        };
        let way = centre(record.last()) - centre(&record.frames[0]);
        // Stopped after 0.34 s.
        let truth = 1.0 / (2.0 * 0.3 * GRAVITY);
        Ok(vec![
            Figure::at_least("distance over Coulomb's", way / truth, 0.8),
            Figure::at_most("distance over Coulomb's, from above", way / truth, 1.2),
            Figure::exactly("rigid zones", record.counted("zones_rigid"), 0.0),
        ])
    },
};

pub(super) const H31: Case = Case {
    id: "H31",
    title: "cloth in a heap in which everything is near everything",
    must: "memory stays bounded, no pair is dropped silently",
    judge: |bench| {
        let scene = SHEET.replace("1001-1004", "1001-1012").replace("resolution = 6", "resolution = 22");
        let scene = scene
            .replace("position = [0.8, 0.0, 0.5]", "position = [0.8, -0.3, 0.5]")
            .replace("[gravity]", "[gravity]\n[self_repulsion]\n[self_collision]");
        let crumpled = "[garment.random_velocity]\nseed = 7\nspeed = 20.0\n[garment.stretch]";
        bench.write("scene.toml", &scene.replace("[garment.stretch]", crumpled))?;
        let ended = bench.command(&["run", "scene.toml", "--out", "out", "-q"])?;
        let text = std::fs::read_to_string(bench.folder().join("out/run.jsonl")).map_err(|e| e.to_string())?;
        let lines: Vec<serde_json::Value> = text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let bytes: Vec<f64> = lines.iter().filter_map(|line| line["resident_bytes"].as_f64()).collect();
        let (first, peak) = (bytes.first().copied().unwrap_or(f64::NAN), bytes.iter().copied().fold(0.0, f64::max));
        let dropped = lines.last().map_or(f64::NAN, |end| end["counts"]["zone_fallbacks"].as_f64().unwrap_or(0.0));
        Ok(vec![
            Figure::exactly("exit code", ended.code(), 0.0),
            Figure::at_most("peak of resident memory over the memory at the first frame", peak / first, 1.5),
            Figure::exactly("unresolved zones", dropped, 0.0),
        ])
    },
};

pub(super) const H32: Case = Case {
    id: "H32",
    title: "contacts in a plane, along an edge, at a corner, between parallels",
    must: "none is missed; those that are apart are seldom reported",
    judge: |bench| {
        let count = bench.by_tier(20_000, 1_000_000);
        let mut random = Random::new(32);
        // All coordinates are multiples of 2⁻²⁰, so that the place of contact at half the time is exact.
        let grid = |random: &mut Random| random.vector().map(|c| (c * f64::from(1 << 20)).round() / f64::from(1 << 20));
        let (mut missed, mut false_alarms) = (0, 0);
        for i in 0..count {
            let corners = [grid(&mut random), grid(&mut random), grid(&mut random)];
            let weights = match i % 4 {
                0 => [0.25, 0.25, 0.5],
                1 => [0.5, 0.5, 0.0],
                2 => [1.0, 0.0, 0.0],
                _ => [0.0, 0.125, 0.875],
            };
            let place: Vec3 = corners.iter().zip(weights).map(|(c, w)| c * w).sum();
            // Every other way lies in the plane of the triangle; the triangle moves along with a third of them.
            let way = if i % 2 == 0 { grid(&mut random) } else { corners[1] - corners[0] };
            let drift = if i % 3 == 0 { grid(&mut random) } else { Vec3::zeros() };
            let ends = |sign: f64, apart: Vec3| {
                let [a, b, c] = corners.map(|c| c + drift * sign);
                [place + (way + drift) * sign + apart, a, b, c]
            };
            let hit = ccd::point_triangle(&ends(-1.0, Vec3::zeros()), &ends(1.0, Vec3::zeros()), 0.0);
            missed += i32::from(hit.is_none());
            // Moved out of its plane and held beside it: the point never comes near.
            let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
            if normal.norm() > 1e-3 && i % 2 == 1 {
                let apart = normal.normalize() * 1e-6;
                let near = ccd::point_triangle(&ends(-1.0, apart), &ends(1.0, apart), 0.0);
                false_alarms += i32::from(near.is_some());
            }
            // Two edges that cross, or lie along each other.
            let [a, b, c] = corners;
            let middle = (a + b) * 0.5;
            let other = if i % 2 == 0 { c - middle } else { b - a };
            let edges = |sign: f64| [a, b, middle - other + way * sign, middle + other + way * sign];
            missed += i32::from(ccd::edge_edge(&edges(-1.0), &edges(1.0), 0.0).is_none());
        }
        Ok(vec![
            Figure::exactly(format!("contacts missed, of {}", 2 * count), f64::from(missed), 0.0),
            Figure::at_most(
                "share of pairs 1 µm apart that are reported",
                f64::from(false_alarms) / f64::from(count / 2),
                0.01,
            ),
        ])
    },
};

pub(super) const H34: Case = Case {
    id: "H34",
    title: "cloth at rest on a table for a long time",
    must: "it does not creep",
    judge: |bench| {
        let seconds = match bench.tier() {
            Tier::Quick => 2,
            Tier::Full => 10,
            Tier::Soak => 100,
        };
        let mut description = cloth(6, 0.03, 100.0);
        description.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.002);
        add_weight(&mut description);
        add_self_contact(&mut description);
        add_floor(&mut description, 0.4);
        description.bodies[0].thickness = 0.001;
        description.solver.max_dt = Some(1e-3);
        let record = bench.simulate(&Trial::still(description, 24 * (seconds + 1)))?;
        let pairs = record.last().positions[0].iter().zip(&record.frames[24].positions[0]);
        let drift = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / seconds as f64;
        Ok(vec![Figure::at_most("drift over the thickness [1/s]", drift / 0.0005, 1e-3)])
    },
};

pub(super) const H35: Case = Case {
    id: "H35",
    title: "cloth on a floor that speeds up",
    must: "friction carries it, or lets it lag by what Coulomb says",
    judge: |bench| {
        let mut figures = Vec::new();
        for acceleration in [2.0, 8.0] {
            let mut description = cloth(4, 0.03, 200.0);
            description.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 1e-6);
            add_weight(&mut description);
            add_floor(&mut description, 0.4);
            description.bodies[0].thickness = 0.0;
            let at = |i: i32| 0.5 * acceleration * (f64::from(i) / 480.0).powi(2);
            description.bodies[0].motion.path = (0..=240).map(|i| (f64::from(i) / 480.0, Vec3::x() * at(i))).collect();
            let record = bench.simulate(&Trial::still(description, 12))?;
            let centre = record.last().positions[0].iter().map(|x| x.x).sum::<f64>() / 25.0;
            let carried = 0.5 * 0.25 * f64::min(acceleration, 0.4 * GRAVITY);
            let what = format!("error of the distance at {acceleration} m/s² [m]");
            figures.push(Figure::at_most(what, (centre - carried).abs(), 0.01 * carried));
        }
        Ok(figures)
    },
};

pub(super) const H36: Case = Case {
    id: "H36",
    title: "a needle, and a slit between bodies thinner than their thickness",
    must: "thickness gives way, not the cloth; it is counted",
    judge: |bench| {
        let mut needle = cloth(10, 0.03, 100.0);
        needle.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.11);
        add_weight(&mut needle);
        add_self_contact(&mut needle);
        // As a mesh: of an ideal shape only vertices of cloth know.
        let (points, triangles) = box_mesh(Vec3::new(1e-4, 0.1, 1e-4), 1);
        let place = move |_: f64| points.iter().map(|p| p + Vec3::new(0.011, 0.0, 0.007)).collect();
        let input = add_mesh_body(&mut needle, triangles, place);
        needle.bodies[0].thickness = 0.001;
        let needle = bench.simulate(&Trial { input, ..Trial::still(needle, 12) })?;
        let highest = needle.last().positions[0].iter().map(|x| x.y).fold(f64::NEG_INFINITY, f64::max);
        let mut slit = scene_of(upright(8, 0.03), 24);
        add_cloth(&mut slit, 0, 100.0);
        add_weight(&mut slit);
        add_pins(&mut slit, (72..81).collect());
        for side in [-1.0, 1.0] {
            let block = BodyShape::Rigid(Shape::Box { half_extents: [0.05, 0.5, 0.5] });
            // The slit closes from 8 to 2 mm, and the bodies keep 3 mm each.
            let at = |gap: f64| Vec3::x() * (side * (0.05 + 0.5 * gap));
            let motion =
                RigidMotion { path: vec![(0.0, at(0.008)), (0.25, at(0.002))], ..RigidMotion::at(Vec3::zeros()) };
            add_body(&mut slit, block, motion, 0.3);
        }
        slit.bodies.iter_mut().for_each(|body| body.thickness = 0.003);
        let slit = bench.simulate(&Trial::still(slit, 12))?;
        let widest = slit.last().positions[0].iter().map(|x| x.x.abs()).fold(0.0, f64::max);
        Ok(vec![
            Figure::at_most("strain on the needle", needle.strain(), 0.5),
            Figure::at_least("highest vertex, over a tip at 0.1 m [m]", highest, 0.08),
            Figure::at_most("strain in the slit", slit.strain(), 0.5),
            Figure::at_most("farthest vertex from the middle of the slit [m]", widest, 0.001 + 1e-6),
            Figure::at_least("vertices between two surfaces, counted", slit.counted("body_squeezed"), 1.0),
        ])
    },
};

pub(super) const H37: Case = Case {
    id: "H37",
    title: "a body that jumps 5 m in a frame, away from under the cloth and back",
    must: "nothing explodes",
    judge: |bench| {
        let (points, triangles) = box_mesh(Vec3::new(0.2, 0.05, 0.2), 2);
        let place = move |time: f64| -> Vec<Vec3> {
            let away = if (6.5..12.5).contains(&(time * 24.0)) { Vec3::x() * 5.0 } else { Vec3::zeros() };
            points.iter().map(|p| p + away - Vec3::y() * 0.05).collect()
        };
        let mut description = cloth(10, 0.03, 100.0);
        description.garments[0].mesh.points.iter_mut().for_each(|p| p.y = 0.003);
        add_weight(&mut description);
        add_self_contact(&mut description);
        let input = add_mesh_body(&mut description, triangles, place);
        (description.bodies[0].thickness, description.bodies[0].max_push_speed) = (0.002, 1.0);
        let record = bench.simulate(&Trial { input, may_cross: true, ..Trial::still(description, 24) })?;
        let mass: f64 = record.masses.concat().iter().sum();
        Ok(vec![
            Figure::at_most("largest strain", record.strain(), 0.5),
            Figure::at_most(
                "largest kinetic energy over the energy at the body's 120 m/s",
                record.kinetic() / (0.5 * mass * 14400.0),
                0.1,
            ),
            Figure::at_most(
                "kinetic energy at the end over the energy of a fall of a second",
                record.last().summary.kinetic_energy / (0.5 * mass * 96.0),
                1.0,
            ),
        ])
    },
};
