//! H11 to H22: the geometry of the cloth.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget, SceneDescription};

use crate::bench::{Bench, Ended, Record, Trial};
use crate::case::{Case, Figure};
use crate::files::{BODY, FROM_FILES, SKIRT, obj};
use crate::scenes::*;

pub(super) const H11: Case = Case {
    id: "H11",
    title: "slivers with an aspect of 1e4",
    must: "forces stay finite, the sheet hangs as one without slivers",
    judge: |bench| {
        let run = |bench: &mut Bench<'_>, sliver: bool| {
            let mut description = cloth(10, 0.02, 100.0);
            if sliver {
                // The column in the middle is a ten thousandth as wide as it is high.
                let narrow = |x: f64| if x > 0.01 { x - 0.02 + 2e-6 } else { x };
                description.garments[0].mesh.points.iter_mut().for_each(|p| p.x = narrow(p.x));
            }
            add_weight(&mut description);
            add_pins(&mut description, (0..=10).collect());
            bench.simulate(&Trial::still(description, 6))
        };
        let (plain, sliver) = (run(bench, false)?, run(bench, true)?);
        let lowest = |record: &Record| record.last().positions[0].iter().map(|x| x.y).fold(0.0, f64::min);
        // Strain of the narrow cells has no meaning for the eye: what counts is the sheet.
        Ok(vec![Figure::at_most(
            "error of the lowest vertex against the sheet without slivers",
            (lowest(&sliver) / lowest(&plain) - 1.0).abs(),
            0.05,
        )])
    },
};

/// Runs a garment of this OBJ text beside a body, without contact; how it ended.
fn run_mesh(bench: &Bench<'_>, skirt: &str) -> Result<Ended, String> {
    bench.write("scene.toml", FROM_FILES)?;
    bench.write("body.obj", BODY)?;
    bench.write("skirt.obj", skirt)?;
    bench.command(&["run", "scene.toml", "--out", "out", "--overwrite"])
}

/// Tolerance of solves in long steps where two ways to write one scene are compared, or rest is looked for [m/s]: these differ by
/// what solves leave.
const SOLVED_TIGHTLY: f64 = 1e-11;

pub(super) const H12: Case = Case {
    id: "H12",
    title: "faces without area, edges without length, points at one position",
    must: "they are inert, with a message for each; the others move",
    judge: |bench| {
        let mut figures = Vec::new();
        for (what, more) in
            [("a face without area", "v 4 1 0\nf 1 2 5\n"), ("points at one position", "v 2 1 0\nf 1 5 4\n")]
        {
            let ended = run_mesh(bench, &format!("{SKIRT}{more}"))?;
            figures.push(Figure::exactly(format!("exit code, {what}"), ended.code(), 0.0));
            let lacking = ended.missing(&["garment \"skirt\"", "faces 1"]);
            figures.push(Figure::exactly(format!("expected words missing from the message, {what}"), lacking, 0.0));
        }
        let tolerance = bench.by_integrator(None, Some(SOLVED_TIGHTLY));
        let clean = bench.simulate(&Trial::still(hanging(tolerance, |_, _| {}), 12))?;
        let odd = bench.simulate(&Trial::still(hanging(tolerance, add_flat_faces), 12))?;
        let bar = same_motion(bench, tolerance, &clean)?;
        let mass = |record: &Record, count: usize| record.masses[0][..count].iter().sum::<f64>();
        figures.push(Figure::at_most("error of the mass", (mass(&odd, 121) / mass(&clean, 121) - 1.0).abs(), 1e-14));
        figures.push(Figure::at_most("distance from the clean mesh [m]", farthest(&clean, &odd), bar));
        let x = &odd.last().positions[0];
        figures.push(Figure::exactly(
            "distance of a coincident vertex from the one it follows [m]",
            (x[121] - x[60]).norm(),
            0.0,
        ));
        // Two panels whose common border is there twice, without being sewn: they fall, and do not repel each other.
        let panels = Trial { is_isolated: true, ..Trial::still(two_panels(tolerance), 12) };
        let record = bench.simulate(&panels)?;
        figures.push(Figure::at_most(
            "kinetic energy of two panels that lie edge to edge [J]",
            record.kinetic(),
            1e-12,
        ));
        figures.push(Figure::exactly("intersections of them", record.frames[0].crossings as f64, 0.0));
        Ok(figures)
    },
};

/// A sheet that hangs by two corners and touches itself, with what `change` does to its points and triangles.
fn hanging(tolerance: Option<f64>, change: fn(&mut Vec<Vec3>, &mut Vec<[u32; 3]>)) -> SceneDescription {
    let mut description = cloth(10, 0.02, 100.0);
    description.solver.cg_tolerance = tolerance;
    let mesh = &mut description.garments[0].mesh;
    let (mut points, mut triangles) = (mesh.points.clone(), triangles_of(mesh));
    change(&mut points, &mut triangles);
    *mesh = PolygonMesh::from_triangles(points, &triangles);
    add_weight(&mut description);
    add_self_contact(&mut description);
    add_pins(&mut description, vec![0, 10]);
    description
}

/// A point that lies on vertex 60, one beside the sheet, and faces without area: with these, with three vertices in a row, and
/// with one of them twice.
fn add_flat_faces(points: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>) {
    points.extend([points[60], points[10] + Vec3::x()]);
    triangles.extend([[60, 121, 61], [9, 10, 122], [55, 56, 57], [3, 3, 4]]);
}

/// Two sheets side by side in a plane, whose common border has two vertices in each place.
fn two_panels(tolerance: Option<f64>) -> SceneDescription {
    let mut mesh = sheet(6, 6, 0.02);
    let mut triangles = triangles_of(&mesh);
    let count = mesh.points.len() as u32;
    let beside: Vec<Vec3> = mesh.points.iter().map(|p| p + Vec3::x() * 0.12).collect();
    triangles.extend(triangles.clone().iter().map(|corners| corners.map(|v| v + count)));
    mesh.points.extend(beside);
    let mesh = PolygonMesh::from_triangles(mesh.points, &triangles);
    let mut description = scene_of(GarmentDescription::new("panels", mesh, 0.2), 24);
    description.solver.cg_tolerance = tolerance;
    add_cloth(&mut description, 0, 100.0);
    add_self_contact(&mut description);
    description
}

/// Largest distance of a run of [`hanging`] from `clean` that counts as the same motion [m].
fn same_motion(bench: &mut Bench<'_>, tolerance: Option<f64>, clean: &Record) -> Result<f64, String> {
    bench.same_motion(hanging(tolerance, |_, _| {}), |bench, finer| {
        Ok(farthest(clean, &bench.simulate_once(&Trial::still(finer, 12))?))
    })
}

/// Largest distance of a vertex in one run from where it is in another, in any frame [m].
fn farthest(run: &Record, other: &Record) -> f64 {
    let pairs = run.frames.iter().zip(&other.frames).flat_map(|(a, b)| a.positions[0].iter().zip(&b.positions[0]));
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// The triangles of a mesh that has no other faces.
fn triangles_of(mesh: &PolygonMesh) -> Vec<[u32; 3]> {
    mesh.face_indices.as_chunks().0.to_vec()
}

pub(super) const H13: Case = Case {
    id: "H13",
    title: "three faces on an edge, and faces that share one vertex",
    must: "it runs, with bending on every pair of faces, and its energy does not grow",
    judge: |bench| {
        // A sheet with a fin along its middle, and a leaf that hangs on by one vertex.
        let mut mesh = sheet(8, 8, 0.02);
        let mut triangles = mesh.triangulate().0;
        let mut points = std::mem::take(&mut mesh.points);
        let middle: Vec<u32> = (0..9).map(|k| 4 + 9 * k).collect();
        let fin = points.len() as u32;
        points.extend(middle.iter().map(|v| points[*v as usize] + Vec3::y() * 0.02).collect::<Vec<_>>());
        for k in 0..8_u32 {
            let (a, b) = (middle[k as usize], middle[k as usize + 1]);
            triangles.extend([[a, b, fin + k], [b, fin + k + 1, fin + k]]);
        }
        let leaf = points.len() as u32;
        points.extend([Vec3::new(-0.1, 0.0, -0.1), Vec3::new(-0.1, 0.0, -0.08)]);
        triangles.push([0, leaf, leaf + 1]);
        let mesh = PolygonMesh::from_triangles(points, &triangles);
        let mut description = scene_of(GarmentDescription::new("fin", mesh, 0.2), 24);
        add_cloth(&mut description, 0, 50.0);
        add_self_contact(&mut description);
        let mut random = Random::new(13);
        let count = description.garments[0].mesh.points.len();
        description.garments[0].start_velocities = Some((0..count).map(|_| random.vector() * 0.3).collect());
        let record = bench.simulate(&Trial { is_isolated: true, ..Trial::still(description, 24) })?;
        Ok(vec![Figure::at_most("largest strain", record.strain(), 0.5)])
    },
};

pub(super) const H14: Case = Case {
    id: "H14",
    title: "duplicate faces, one of them flipped",
    must: "accepted with a warning; the same motion as without them",
    judge: |bench| {
        let mut figures = Vec::new();
        for (what, more) in [("twice", "f 1 4 3 2\n"), ("flipped", "f 1 2 3 4\n")] {
            let ended = run_mesh(bench, &format!("{SKIRT}{more}"))?;
            figures.push(Figure::exactly(format!("exit code, {what}"), ended.code(), 0.0));
            figures.push(Figure::exactly(
                format!("expected words missing from the message, {what}"),
                ended.missing(&["faces 1"]),
                0.0,
            ));
        }
        let repeat = |_: &mut Vec<Vec3>, triangles: &mut Vec<[u32; 3]>| {
            let [first, second] = [triangles[7], triangles[80]];
            triangles.extend([first, [second[1], second[0], second[2]]]);
        };
        let tolerance = bench.by_integrator(None, Some(SOLVED_TIGHTLY));
        let clean = bench.simulate(&Trial::still(hanging(tolerance, |_, _| {}), 12))?;
        let odd = bench.simulate(&Trial::still(hanging(tolerance, repeat), 12))?;
        figures.push(Figure::exactly("distance from the mesh without them [m]", farthest(&clean, &odd), 0.0));
        Ok(figures)
    },
};

pub(super) const H15: Case = Case {
    id: "H15",
    title: "points without a face, and a mesh without faces",
    must: "points stay in the output; a garment without faces or without points is refused",
    judge: |bench| {
        let loose = run_mesh(bench, &format!("{SKIRT}v 9 9 9\n"))?;
        let points = point_count(&bench.folder().join("out/skirt.abc")).map_err(|e| e.to_string())? as f64;
        let empty = run_mesh(bench, "v 2 1 0\nv 3 1 0\nv 3 1 1\n")?;
        let nothing = run_mesh(bench, "")?;
        let far = Vec3::new(9.0, 9.0, 9.0);
        let tolerance = bench.by_integrator(None, Some(SOLVED_TIGHTLY));
        let clean = bench.simulate(&Trial::still(hanging(tolerance, |_, _| {}), 12))?;
        let odd =
            bench.simulate(&Trial::still(hanging(tolerance, |points, _| points.push(Vec3::new(9.0, 9.0, 9.0))), 12))?;
        Ok(vec![
            Figure::exactly("exit code, a loose point", loose.code(), 0.0),
            Figure::exactly(
                "expected words missing from the message, a loose point",
                loose.missing(&["garment \"skirt\"", "vertices 4 belong to no face"]),
                0.0,
            ),
            Figure::exactly("points in the cache of the skirt with a loose point", points, 5.0),
            Figure::exactly("exit code, no faces", empty.code(), 65.0),
            Figure::exactly(
                "expected words missing from the message, no faces",
                empty.missing(&["garment \"skirt\"", "no faces"]),
                0.0,
            ),
            Figure::exactly("exit code, no points", nothing.code(), 65.0),
            Figure::at_most(
                "distance of the others from the mesh without a loose point [m]",
                farthest(&clean, &odd),
                same_motion(bench, tolerance, &clean)?,
            ),
            Figure::exactly("displacement of the loose point [m]", (odd.last().positions[0][121] - far).norm(), 0.0),
        ])
    },
};

pub(super) const H16: Case = Case {
    id: "H16",
    title: "quads, a concave polygon and one that is not flat",
    must: "they run, and the cache has the polygons of the file",
    judge: |bench| {
        // A quad, a concave one with its dent at the fourth point, and a hexagon whose corners rise and fall.
        let mesh = "v 2 1 0\nv 3 1 0\nv 3 1 1\nv 2 1 1\nv 4 1 0\nv 3.2 1 0.3\nv 4 1 1\n\
                    v 5 1.1 0\nv 6 1 0\nv 6.5 1.2 0.5\nv 6 1 1\nv 5 1.1 1\nv 4.5 1 0.5\n\
                    f 1 4 3 2\nf 2 6 3 7 5\nf 13 12 11 10 9 8\n";
        let ended = run_mesh(bench, mesh)?;
        let info = bench.command(&["info", "out/skirt.abc"])?;
        let path = bench.folder().join("out/skirt.abc");
        let counts = face_counts(&path).map_err(|e| e.to_string())?;
        Ok(vec![
            Figure::exactly("exit code", ended.code(), 0.0),
            Figure::exactly("exit code of info", info.code(), 0.0),
            Figure::exactly(
                "polygons of 4, 5 and 6 corners in the cache",
                f64::from(u8::from(counts == [4, 5, 6])),
                1.0,
            ),
        ])
    },
};

/// Points of the garment in a cache.
fn point_count(path: &std::path::Path) -> Result<usize, drapery_alembic::AlembicError> {
    let archive = drapery_alembic::Archive::open(path)?;
    drapery_alembic::PolyMesh::all(&archive)?.first().map_or(Ok(0), |mesh| Ok(mesh.positions(0)?.len()))
}

/// Corners of each face of the garment in a cache.
fn face_counts(path: &std::path::Path) -> Result<Vec<i32>, drapery_alembic::AlembicError> {
    let archive = drapery_alembic::Archive::open(path)?;
    drapery_alembic::PolyMesh::all(&archive)?.first().map_or(Ok(Vec::new()), |mesh| mesh.face_counts(0))
}

pub(super) const H18: Case = Case {
    id: "H18",
    title: "every vertex pinned, and pins that contradict each other",
    must: "pinned cloth follows its targets exactly; two hard pins on a vertex are refused with its number",
    judge: |bench| {
        let held = |vertices: Vec<u32>, to: Vec3| PinDescription {
            garment: 0,
            target: PinTarget::Path {
                anchor: PinAnchor::Start,
                vertices,
                offsets: vec![(0.0, Vec3::zeros()), (1.0, to)],
            },
            axes: [true; 3],
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            hold: PinHold::Hard,
        };
        let mut description = cloth(6, 0.03, 100.0);
        add_weight(&mut description);
        description.effects.push(drapery_core::scene::EffectRequest::of_scene("pins"));
        let way = Vec3::new(0.5, 1.0, -0.25);
        description.pins.push(held((0..49).collect(), way));
        let contradicting = {
            let mut other = description.clone();
            other.pins.push(held(vec![17], Vec3::zeros()));
            bench.simulate(&Trial::still(other, 1)).err().unwrap_or_default()
        };
        let record = bench.simulate(&Trial::still(description, 24))?;
        let pairs = record.frames[0].positions[0].iter().zip(&record.last().positions[0]);
        let off = pairs.map(|(a, b)| (b - a - way).norm()).fold(0.0, f64::max);
        let named = contradicting.contains("refused") && contradicting.contains("vertex 17");
        Ok(vec![
            Figure::at_most("distance from the targets [m]", off, 1e-15),
            Figure::exactly("the contradiction is refused and named", f64::from(u8::from(named)), 1.0),
        ])
    },
};

pub(super) const H19: Case = Case {
    id: "H19",
    title: "pins that part to ten times their distance in a frame",
    must: "strain is what the pins ask for, no more; nothing becomes infinite",
    judge: |bench| {
        let mut description = cloth(10, 0.02, 50.0);
        description.effects.push(drapery_core::scene::EffectRequest::of_scene("pins"));
        for (row, way) in [(0, -0.9), (10, 0.9)] {
            description.pins.push(PinDescription {
                garment: 0,
                target: PinTarget::Path {
                    anchor: PinAnchor::Start,
                    vertices: (0..=10).map(|k| row + 11 * k).collect(),
                    offsets: vec![(0.0, Vec3::zeros()), (1.0 / 24.0, Vec3::x() * way)],
                },
                axes: [true; 3],
                from: f64::NEG_INFINITY,
                until: f64::INFINITY,
                hold: PinHold::Hard,
            });
        }
        let record = bench.simulate(&Trial::still(description, 6))?;
        let end = record.last().summary.max_strain.as_ref().map_or(f64::INFINITY, |s| s.strain);
        Ok(vec![
            Figure::at_most("largest strain in any frame", record.strain(), 30.0),
            Figure::at_most("largest strain at the end, where 9 is asked for", end, 9.9),
        ])
    },
};

pub(super) const H20: Case = Case {
    id: "H20",
    title: "edges from 0.5 to 50 mm in one mesh",
    must: "the plan says what they cost, or that they were softened",
    judge: |bench| {
        let mut mesh = sheet(24, 24, 1.0 / 24.0);
        let share = |c: f64| 0.5 * ((4.6 * (c + 0.5)).exp() - 1.0) / (4.6_f64.exp() - 1.0);
        mesh.points.iter_mut().for_each(|p| *p = Vec3::new(2.0 + share(p.x), 1.0, share(p.z)));
        bench.write("scene.toml", FROM_FILES)?;
        bench.write("body.obj", BODY)?;
        bench.write("skirt.obj", &obj(&mesh))?;
        let plan = bench.command(&["plan", "scene.toml"])?;
        let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 240);
        add_cloth(&mut description, 0, 100.0);
        add_weight(&mut description);
        add_pins(&mut description, vec![0, 24]);
        let record = bench.simulate(&Trial::still(description, 3))?;
        Ok(vec![
            Figure::exactly("exit code of the plan", plan.code(), 0.0),
            Figure::exactly("words that the plan lacks", plan.missing(&["are softened"]), 0.0),
            Figure::at_most("strain", record.strain(), 0.1),
        ])
    },
};

pub(super) const H21: Case = Case {
    id: "H21",
    title: "cloth twice as thick as its edges are long, and a hundred times thinner",
    must: "thickness is clamped by the mesh: it bends as thin cloth does",
    judge: |bench| {
        let run = |bench: &mut Bench<'_>, thickness: f64| {
            let mut description = cloth(10, 0.02, 100.0);
            description.garments[0].thickness = thickness;
            add_weight(&mut description);
            add_self_contact(&mut description);
            add_pins(&mut description, (0..2).flat_map(|i| (0..=10).map(move |k| i + 11 * k)).collect());
            let record = bench.simulate(&Trial::still(description, 12))?;
            Ok::<f64, String>(record.last().positions[0].iter().map(|x| x.y).fold(0.0, f64::min))
        };
        let [usual, thick, thin] = [5e-4, 0.04, 5e-6].map(|thickness| run(bench, thickness));
        let (usual, thick, thin) = (usual?, thick?, thin?);
        Ok(vec![
            Figure::at_most("error of the droop, thick", (thick / usual - 1.0).abs(), 0.05),
            Figure::at_most("error of the droop, thin", (thin / usual - 1.0).abs(), 0.05),
        ])
    },
};

pub(super) const H22: Case = Case {
    id: "H22",
    title: "one triangle, and two",
    must: "they fall as everything falls",
    judge: |bench| {
        let mut figures = Vec::new();
        for count in [1, 2] {
            let points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1], [0.1, 0.0, 0.1]];
            let triangles = [[0, 2, 1], [1, 2, 3]];
            let mesh = PolygonMesh::from_triangles(
                points[..count + 2].iter().map(|p| Vec3::from(*p)).collect(),
                &triangles[..count],
            );
            let mut description = scene_of(GarmentDescription::new("leaf", mesh, 0.2), 24);
            add_cloth(&mut description, 0, 50.0);
            add_self_contact(&mut description);
            add_weight(&mut description);
            let record = bench.simulate(&Trial::still(description, 12))?;
            let fall = 0.5 * GRAVITY * 0.25;
            let error = record.last().positions[0].iter().map(|x| (x.y + fall).abs()).fold(0.0, f64::max);
            figures.push(Figure::at_most(format!("error of {count} after a fall of 1.2 m [m]"), error, 1e-12));
        }
        Ok(figures)
    },
};
