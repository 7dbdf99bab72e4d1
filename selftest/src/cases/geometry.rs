//! H11 to H22: the geometry of the cloth.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget};

use crate::bench::Trial;
use crate::case::{Case, Figure};
use crate::scenes::*;

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
