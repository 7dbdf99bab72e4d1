//! Suspicious conditions of the cloth at the start, known when a simulation starts: crossings there, vertices inside bodies, and edges that
//! are far from their length at rest.

use std::collections::BTreeMap;

use super::Simulation;
use crate::contact::self_contact::layers::layer_sides;
use crate::geometry::crossings::Crossing;
use crate::parallel::message::codec;
use crate::tolerances::{COLLAPSED_AT_START, STRETCHED_AT_START};

/// Cloth that crosses itself, other cloth or a body at the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StartCrossings {
    /// The objects of the edge and of the triangle below, as in `garment "skirt"`; the same twice of cloth that crosses itself.
    pub objects: [String; 2],
    /// Pairs of an edge of one of them and a triangle of the other.
    pub pairs: u64,
    /// The vertices of one of these edges, each by its number in its object.
    pub edge: [u32; 2],
    /// Vertices of the triangle, each by its number in its object.
    pub triangle: [u32; 3],
}

/// A garment that is partly inside a body at the start.
#[derive(Debug, Clone, PartialEq)]
pub struct StartInside {
    /// Name of the garment.
    pub garment: String,
    /// Name of the body.
    pub body: String,
    /// Number of its free vertices inside.
    pub vertices: u64,
    /// Depth of the deepest [m], and its number in the garment's own order.
    pub deepest: (f64, u32),
}

/// Two garments that lie the other way round at the start than their layers say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StartLayers {
    /// Name of the garment with the larger layer.
    pub outer: String,
    /// Name of the other one.
    pub inner: String,
    /// Points close to a face of the other one, on the side that the layers say.
    pub right: u64,
    /// Points on the other side, which are more.
    pub wrong: u64,
}

/// A garment of which some edges are far from their length at rest at the start.
#[derive(Debug, Clone, PartialEq)]
pub struct StartLengths {
    /// Name of the garment.
    pub garment: String,
    /// Number of its edges.
    pub edges: u64,
    /// Edges whose ends are in one place, or nearly so ([`COLLAPSED_AT_START`]).
    pub collapsed: u64,
    /// Edges that are far too long ([`STRETCHED_AT_START`]).
    pub stretched: u64,
    /// The longest of these by its length at rest: its strain, and its vertices in the garment's own order.
    pub longest: Option<(f64, [u32; 2])>,
}

/// A vertex of some number of the scene.
struct NumberedVertex {
    number: u32,
    /// Its number in its garment.
    vertex: u32,
}

codec!(struct NumberedVertex { number, vertex });

impl Simulation {
    /// Objects that cross each other at the start, each two once; looked for in scenes with `self_collision` only.
    pub fn start_crossings(&self) -> &[StartCrossings] {
        &self.start_crossings
    }

    /// Garments that are partly inside a body at the start.
    pub fn start_inside(&self) -> &[StartInside] {
        &self.start_inside
    }

    /// Garments that lie the other way round at the start than their layers say.
    pub fn start_layers(&self) -> &[StartLayers] {
        &self.start_layers
    }

    /// Garments of which edges are far from their length at rest at the start.
    pub fn start_lengths(&self) -> &[StartLengths] {
        &self.start_lengths
    }

    /// Finds crossings, wrong layers and wrong lengths. All ranks call it together, when the cloth and its crossings are known.
    pub(super) fn look_at_start(&mut self) {
        self.start_crossings = self.crossings_of_objects();
        self.start_layers = self.wrong_layers();
        self.start_lengths =
            (0..self.scene.meshes().len()).filter_map(|garment| self.lengths_of_garment(garment)).collect();
    }

    fn crossings_of_objects(&self) -> Vec<StartCrossings> {
        let mut found: BTreeMap<[usize; 2], (u64, Crossing)> = BTreeMap::new();
        for crossing in &self.crossings {
            let [a, b] = [self.object_of(crossing.edge[0]).0, self.object_of(crossing.triangle[0]).0];
            found.entry([a.min(b), a.max(b)]).or_insert((0, *crossing)).0 += 1;
        }
        if found.is_empty() {
            // As on all ranks.
            return Vec::new();
        }
        let parts = self.scene.parts();
        let named = found.values().flat_map(|(_, c)| c.edge.iter().chain(&c.triangle));
        let here = named.filter_map(|number| {
            let local = parts.local(*number).filter(|local| parts.own().contains(local))?;
            Some(NumberedVertex { number: *number, vertex: parts.own_vertex(local).1 })
        });
        let names = parts.ranks().all_gather_encoded("vertices that cross at the start", here.collect());
        let in_object = |number: u32| {
            let of_cloth = names.iter().find(|named| named.number == number).map(|named| named.vertex);
            of_cloth.unwrap_or_else(|| self.object_of(number).1)
        };
        let of_objects = |(pairs, Crossing { edge, triangle }): (u64, Crossing)| StartCrossings {
            objects: [edge[0], triangle[0]].map(|number| self.object_name(self.object_of(number).0)),
            pairs,
            edge: edge.map(in_object),
            triangle: triangle.map(in_object),
        };
        found.into_values().map(of_objects).collect()
    }

    fn wrong_layers(&self) -> Vec<StartLayers> {
        let sides = layer_sides(&self.scene, &self.cloth.state.x, &self.prescribed.bodies).into_iter();
        let names = |[outer, inner]: [usize; 2]| {
            [outer, inner].map(|garment| self.scene.description().garments[garment].name.clone())
        };
        let of_pair = |(garments, [right, wrong]): ([usize; 2], [u64; 2])| {
            let [outer, inner] = names(garments);
            StartLayers { outer, inner, right, wrong }
        };
        sides.filter(|(_, [right, wrong])| wrong > right).map(of_pair).collect()
    }

    /// The object of a node by its number of the scene, garments first, then bodies; and its number among the nodes of that,
    /// for garments in the order of the solver.
    fn object_of(&self, number: u32) -> (usize, u32) {
        let garments = self.scene.parts().partition().garments();
        if let Some(garment) = garments.iter().position(|garment| garment.contains(&(number as usize))) {
            return (garment, number - garments[garment].start as u32);
        }
        let mut point = number as usize - self.scene.parts().partition().vertex_count();
        for body in 0..self.scene.description().bodies.len() {
            let points = self.scene.contact_points(body);
            if point < points {
                return (garments.len() + body, point as u32);
            }
            point -= points;
        }
        unreachable!("crossings have nodes of cloth and of bodies alone")
    }

    fn object_name(&self, object: usize) -> String {
        let description = self.scene.description();
        match description.garments.get(object) {
            Some(garment) => format!("garment \"{}\"", garment.name),
            None => format!("body \"{}\"", description.bodies[object - description.garments.len()].name),
        }
    }

    fn lengths_of_garment(&self, garment: usize) -> Option<StartLengths> {
        let (parts, x) = (self.scene.parts(), &self.cloth.state.x);
        let (first, mesh) = (parts.garment(garment).start, &self.scene.meshes()[garment]);
        let (mut counts, mut stretched) = ([0; 3], Vec::new());
        for edge in mesh.edges() {
            let ends = edge.vertices.map(|v| first + v as usize);
            // Each edge counts at the rank that owns its first vertex.
            if !parts.own().contains(&ends[0].min(ends[1])) {
                continue;
            }
            let strain = (x[ends[1]] - x[ends[0]]).norm() / mesh.rest_length(*edge) - 1.0;
            counts[0] += 1;
            counts[1] += u64::from(strain < COLLAPSED_AT_START);
            if strain > STRETCHED_AT_START {
                counts[2] += 1;
                stretched.push((strain, ends));
            }
        }
        let [edges, collapsed, stretched_edges] = parts.ranks().sum_of(counts);
        if collapsed + stretched_edges == 0 {
            return None;
        }
        let longest = self.largest_of(stretched.into_iter()).map(|record| (record.strain, record.vertices));
        let garment = self.scene.description().garments[garment].name.clone();
        Some(StartLengths { garment, edges, collapsed, stretched: stretched_edges, longest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::contact::bodies::Sample;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;
    use crate::scene::{
        BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, Scene, SceneDescription,
    };
    use crate::simulation::FrameInput;

    /// Cells of the strip along x, enough for several parts.
    const CELLS: u32 = 1500;

    /// A strip of cells of 2 cm in the plane y = 0, each cut from its corner at the origin to the one across.
    fn strip() -> SceneDescription {
        let points = (0..=CELLS).flat_map(|i| [0.0, 0.02].map(|z| Vec3::new(0.02 * f64::from(i), 0.0, z))).collect();
        let cell = |i: u32| {
            let [a, b, c, d] = [2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2];
            [[a, b, c], [a, c, d]]
        };
        let triangles: Vec<_> = (0..CELLS).flat_map(cell).collect();
        let mut description = SceneDescription::new("strip");
        description.garments.push(GarmentDescription::new(
            "strip",
            PolygonMesh::from_triangles(points, &triangles),
            0.2,
        ));
        description
    }

    /// A narrow spike of which the tip is 1 mm above the strip, in the middle of a triangle of its cell 1000, and the base 5 cm below.
    fn spike() -> (BodyDescription, Vec<Vec3>) {
        let around = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            Vec3::new(20.01 + 0.004 * cos, -0.05, 0.004 + 0.004 * sin)
        };
        let points = vec![Vec3::new(20.01, 0.001, 0.004), around(0.0), around(120.0), around(240.0)];
        let triangles = vec![[1, 2, 3], [0, 2, 1], [0, 3, 2], [0, 1, 3]];
        let shape = BodyShape::Surface { triangles, point_count: 4 };
        (BodyDescription::new("spike", shape, RigidMotion::at(Vec3::zeros())), points)
    }

    fn start(ranks: &Ranks, description: &SceneDescription, bodies: &[Vec<Vec3>]) -> Simulation {
        let scene = Scene::distribute(ranks, ranks.is_first().then(|| description.clone())).expect("a sound scene");
        let sample = |positions: &Vec<Vec3>| vec![Sample { time: 0.0, positions: positions.clone() }];
        let input = FrameInput { bodies: bodies.iter().map(sample).collect(), ..FrameInput::to_frame(0) };
        let input = scene.share_input(ranks.is_first().then_some(input));
        Simulation::new(scene, &input).unwrap_or_else(|problems| panic!("{problems}"))
    }

    #[test]
    fn what_crosses_at_the_start_is_counted_by_objects_and_named_by_any_ranks() {
        let mut description = strip();
        let collide = ["self_repulsion", "self_collision", "body_collision"];
        description.effects.extend(collide.map(EffectRequest::of_scene));
        // A blade through a triangle of cell 500: two of its edges go through, and no edge of the strip meets it.
        let blade = [[10.005, 0.01], [10.005, -0.01], [10.006, -0.01]].map(|[x, y]| Vec3::new(x, y, 0.007));
        let blade = PolygonMesh::from_triangles(blade.to_vec(), &[[0, 1, 2]]);
        description.garments.push(GarmentDescription::new("blade", blade, 0.2));
        let (body, points) = spike();
        description.bodies.push(body);
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                start(&Ranks::new(communicator), &description, std::slice::from_ref(&points)).start_crossings().to_vec()
            });
            for found in all.expect("no rank ends early") {
                let [blade, spike] = &found[..] else { panic!("{found:?}") };
                let [strip_name, blade_name, spike_name] =
                    ["garment \"strip\"", "garment \"blade\"", "body \"spike\""].map(str::to_owned);
                // The three edges of the spike that meet in its tip.
                assert_eq!((blade.pairs, spike.pairs), (2, 3), "{count} ranks");
                assert_eq!((&blade.objects[0], &blade.objects[1]), (&blade_name, &strip_name));
                assert_eq!((&spike.objects[0], &spike.objects[1]), (&spike_name, &strip_name));
                let mut of_cell = [blade.triangle, spike.triangle];
                of_cell.iter_mut().for_each(|triangle| triangle.sort_unstable());
                assert_eq!(of_cell, [[1000, 1001, 1003], [2000, 2002, 2003]]);
                // Of the blade its upper vertex is an end of both edges.
                assert!(blade.edge.contains(&0) && spike.edge == [0, 1], "{found:?}");
            }
        }
        // Pulled out of the strip, neither crosses it.
        description.garments[1].mesh.points.iter_mut().for_each(|point| point.y += 1.0);
        let below: Vec<Vec3> = points.iter().map(|point| point - Vec3::y()).collect();
        assert_eq!(start(&Ranks::default(), &description, &[below]).start_crossings(), []);
    }

    #[test]
    fn edges_that_start_collapsed_or_far_too_long_are_counted_and_named_by_any_ranks() {
        let posed = |height: f64, gap: f64| {
            let mut description = strip();
            let mut points = description.garments[0].mesh.points.clone();
            points[1400].y += height;
            points[1601].z = gap;
            description.garments[0].start = Some(points);
            description
        };
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                [posed(0.1, 0.0), posed(0.03, 0.001)].map(|scene| start(&ranks, &scene, &[]).start_lengths().to_vec())
            });
            for [odd, plausible] in all.expect("no rank ends early") {
                let [StartLengths { garment, edges, collapsed, stretched, longest }] = &odd[..] else {
                    panic!("{odd:?}")
                };
                // Four edges meet in the vertex that is lifted by 10 cm.
                assert_eq!((garment.as_str(), *edges, *collapsed, *stretched), ("strip", 6001, 1, 4), "{count} ranks");
                let (strain, vertices) = longest.expect("one is the longest");
                assert!((strain - (26.0_f64.sqrt() - 1.0)).abs() < 1e-9 && vertices.contains(&1400), "{longest:?}");
                assert_eq!(plausible, [], "{count} ranks");
            }
        }
        assert_eq!(start(&Ranks::default(), &strip(), &[]).start_lengths(), []);
    }
}
