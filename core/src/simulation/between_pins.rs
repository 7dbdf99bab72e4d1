//! Constraints of pins on the cloth between them: edges whose both ends they prescribe cannot yield, so that the
//! strain of these edges is the strain of the animation.

use super::{FrameInput, Simulation, StrainRecord};
use crate::Vec3;
use crate::parallel::problems::listed;
use crate::parallel::ranks::Ranks;
use crate::pins::{HardPins, STRETCHED};
use crate::scene::{PinTarget, Scene};
use crate::tolerances::{FAR_BOUND, FAR_BOUND_EDGES, FAR_BOUND_THICKNESSES, STRETCHED_BETWEEN_PINS};

impl Simulation {
    /// Returns the warnings about how pins hold the cloth at the start, a sentence each: on rank 0, nothing
    /// elsewhere.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Whether an edge of this rank lies between two vertices that hard pins hold in all directions at some time.
    pub fn has_pinned_neighbours(&self) -> bool {
        let mut held = vec![0; self.cloth.state.x.len()];
        self.prescribed.pins.iter().flat_map(HardPins::fully_held).for_each(|(vertex, _)| held[vertex] = 1);
        between(&self.scene, &self.cloth.state.x, &held).next().is_some()
    }

    /// The most stretched edge between two vertices that hard pins hold in all directions, where these have to be at the frame of
    /// `input`; `None` where none lies between two such. For one rank, on which nothing has to be simulated for it.
    pub fn strain_between_pins_at(&self, input: &FrameInput) -> Option<StrainRecord> {
        let pins = self.prescribed.pins.as_ref()?;
        let time = self.scene.description().timeline.time(input.frame);
        let mut x = self.cloth.state.x.clone();
        let mut held = vec![0; x.len()];
        for (vertex, target) in pins.fully_held() {
            if let Some(place) = self.prescribed.targets.place_at(target, time, [&input.bodies, &input.tracks]) {
                (x[vertex], held[vertex]) = (place, 1);
            }
        }
        let stretched: Vec<(f64, [usize; 2])> = between(&self.scene, &x, &held).collect();
        self.largest_of(stretched.into_iter())
    }

    /// The same of where the vertices are now, over all ranks, which call it together; counts what is torn apart.
    pub(super) fn strain_between_pins(&mut self) -> Option<StrainRecord> {
        let pins = self.prescribed.pins.as_ref()?;
        let parts = self.scene.parts();
        let mut held = vec![0_u8; self.cloth.state.x.len()];
        for (vertex, _) in pins.fully_held().filter(|(_, target)| self.prescribed.targets.is_active(*target)) {
            held[vertex] = 1;
        }
        parts.halo().update(parts.ranks(), &mut held);
        let stretched: Vec<(f64, [usize; 2])> = between(&self.scene, &self.cloth.state.x, &held).collect();
        let torn = stretched.iter().filter(|(strain, _)| *strain > STRETCHED_BETWEEN_PINS).count();
        self.metrics.count(STRETCHED, torn as u64);
        self.largest_of(stretched.into_iter())
    }

    /// Says of vertices that were bound to the nearest place of a body how far that is, where it is too far. All ranks call it
    /// together.
    pub(super) fn warn_of_far_bound(&mut self) {
        let scene = &self.scene;
        let description = scene.description();
        let reaches = description.pins.iter().any(|pin| matches!(pin.target, PinTarget::BodyNearest { .. }));
        if !reaches {
            return;
        }
        let edges = mean_edges(scene);
        let mut far = vec![Vec::new(); description.pins.len()];
        for (pin, vertex, body, distance) in self.prescribed.targets.nearest_bound(scene) {
            let (garment, own) = scene.parts().own_vertex(vertex);
            let thickness = description.garments[garment].thickness + description.bodies[body].thickness;
            if distance > (FAR_BOUND_EDGES * edges[vertex]).max(FAR_BOUND_THICKNESSES * thickness).min(FAR_BOUND) {
                far[pin].push((distance, own));
            }
        }
        let warnings =
            far.into_iter().enumerate().filter_map(|(pin, far)| far_bound_warning(scene, pin, far)).collect();
        self.warnings = warnings;
    }
}

/// Edges that count on this rank between two held vertices, with their strain.
fn between<'a>(scene: &'a Scene, x: &'a [Vec3], held: &'a [u8]) -> impl Iterator<Item = (f64, [usize; 2])> + 'a {
    let parts = scene.parts();
    let of_garment = move |garment: usize| {
        let (first, mesh) = (parts.garment(garment).start, &scene.meshes()[garment]);
        mesh.edges().iter().filter_map(move |edge| {
            let ends = edge.vertices.map(|v| first + v as usize);
            let counts = parts.own().contains(&ends[0]) && ends.iter().all(|end| held[*end] == 1);
            counts.then(|| ((x[ends[0]] - x[ends[1]]).norm() / mesh.rest_length(*edge) - 1.0, ends))
        })
    };
    (0..scene.meshes().len()).flat_map(of_garment)
}

/// Mean rest length of the edges at each own vertex [m], that of all cloth where it has none.
fn mean_edges(scene: &Scene) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); scene.parts().local_count()];
    for (garment, mesh) in scene.meshes().iter().enumerate() {
        let first = scene.parts().garment(garment).start;
        for edge in mesh.edges() {
            for v in edge.vertices {
                let (sum, count) = &mut sums[first + v as usize];
                (*sum, *count) = (*sum + mesh.rest_length(*edge), *count + 1.0);
            }
        }
    }
    sums.into_iter().map(|(sum, count)| if count > 0.0 { sum / count } else { scene.mean_edge() }).collect()
}

/// Says in words, on rank 0, which vertices of a pin are bound too far away; `far` are those of this rank with their distances
/// [m].
fn far_bound_warning(scene: &Scene, pin: usize, far: Vec<(f64, u32)>) -> Option<String> {
    let ranks = scene.parts().ranks();
    let list = listed(ranks, far.iter().map(|(_, vertex)| [*vertex; 2]).collect())?;
    let (distance, vertex) = farthest(ranks, &far);
    let description = scene.description();
    let PinTarget::BodyNearest { body, .. } = description.pins[pin].target else { return None };
    let (garment, body) = (&description.garments[description.pins[pin].garment].name, &description.bodies[body].name);
    ranks.is_first().then(|| {
        format!(
            "garment \"{garment}\": vertices {list} are pinned to body \"{body}\", but are too far from it: more than \
             {FAR_BOUND_EDGES} of their edges and {FAR_BOUND_THICKNESSES} thicknesses, or more than {FAR_BOUND} m; the \
             farthest is vertex {vertex}, {distance:.3} m away: they keep this distance and swing with the faces \
             there. Start the garment on the body, or leave these vertices out of the pin"
        )
    })
}

/// The farthest vertex of all ranks; among equal ones that with the smallest number.
fn farthest(ranks: &Ranks, far: &[(f64, u32)]) -> (f64, u32) {
    let order = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1));
    let own = far.iter().copied().max_by(order).into_iter().collect();
    let all = ranks.all_gather_encoded("farthest vertices of a pin", own);
    all.into_iter().max_by(order).expect("a vertex is listed")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::bodies::Sample;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::scene::{
        BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinDescription, PinHold, RigidMotion,
        SceneDescription,
    };

    /// Cells of the strip along x, enough for several parts; and the first of the three rows of pinned vertices, between
    /// which parts meet.
    const CELLS: usize = 1500;
    const ROW: usize = 749;

    /// A strip of edges 2 cm long that is pinned to two plates 1 cm below; the third of the pinned rows starts so much higher [m].
    fn parted(higher: f64) -> SceneDescription {
        let at = |i: usize, k: usize| Vec3::new(0.02 * (i as f64 - ROW as f64), 0.01, 0.02 * k as f64);
        let points = (0..=CELLS).flat_map(|i| [at(i, 0), at(i, 1)]).collect();
        let number = |i: usize, k: usize| (2 * i + k) as u32;
        let faces = (0..CELLS).flat_map(|i| [number(i, 0), number(i, 1), number(i + 1, 1), number(i + 1, 0)]);
        let mesh = PolygonMesh { points, face_counts: vec![4; CELLS], face_indices: faces.collect() };
        let mut description = SceneDescription::new("parted");
        description.garments.push(GarmentDescription::new("strip", mesh, 0.2));
        let pinned = (number(ROW, 0)..number(ROW + 3, 0)).collect::<Vec<u32>>();
        let mut start = description.garments[0].mesh.points.clone();
        pinned[4..].iter().for_each(|v| start[*v as usize].y += higher);
        description.garments[0].start = Some(start);
        let triangles = vec![[0, 2, 1], [1, 2, 3], [4, 6, 5], [5, 6, 7]];
        let shape = BodyShape::Surface { triangles, point_count: 8 };
        description.bodies.push(BodyDescription::new("plates", shape, RigidMotion::at(Vec3::zeros())));
        description.pins.push(PinDescription {
            garment: 0,
            target: PinTarget::BodyNearest { body: 0, vertices: pinned },
            axes: [true; 3],
            from: f64::NEG_INFINITY,
            until: f64::INFINITY,
            hold: PinHold::Hard,
        });
        description.effects.extend(["pins", "body_collision"].map(EffectRequest::of_scene));
        description
    }

    /// The first plate ends between the second and the third row, at x = 3 cm; the second one moves away by 2 cm a frame.
    fn plates(frame: i64) -> FrameInput {
        let away = 0.02 * frame as f64;
        let plate = |low: f64, high: f64| {
            [[low, -0.5], [high, -0.5], [low, 0.6], [high, 0.6]].map(|[x, z]| Vec3::new(x, 0.0, z))
        };
        let positions = [plate(-0.5, 0.03), plate(0.03 + away, 1.0 + away)].concat();
        let time = frame as f64 / 24.0;
        FrameInput { bodies: vec![vec![Sample { time, positions }]], ..FrameInput::to_frame(frame) }
    }

    fn start(ranks: &Ranks, description: &SceneDescription) -> Simulation {
        let scene = Scene::distribute(ranks, ranks.is_first().then(|| description.clone())).expect("a sound scene");
        let input = scene.share_input(ranks.is_first().then(|| plates(0)));
        Simulation::new(scene, &input).expect("a start")
    }

    #[test]
    fn pinned_neighbours_that_are_torn_apart_are_known_named_and_counted_by_any_ranks() {
        let description = parted(0.0);
        let ahead = start(&Ranks::default(), &description);
        let known: Vec<_> = (1..4).map(|frame| ahead.strain_between_pins_at(&plates(frame))).collect();
        let strains: Vec<f64> = known.iter().flatten().map(|record| record.strain).collect();
        assert!(
            strains.iter().zip([1.0, 2.0, 3.0]).all(|(found, expected)| (found - expected).abs() < 1e-9),
            "{known:?}"
        );
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let mut simulation = start(&ranks, &description);
                let frame = |frame| {
                    let input = simulation.scene().share_input(ranks.is_first().then(|| plates(frame)));
                    let summary = simulation.advance(&input).expect("a frame");
                    (summary.between_pins, summary.metrics.counted(STRETCHED))
                };
                (1..4).map(frame).collect::<Vec<_>>()
            });
            for (record, expected) in all.expect("no rank ends early")[0].iter().zip(&known) {
                let ((found, torn), expected) = (record, expected.as_ref().expect("neighbours are pinned"));
                let found = found.as_ref().expect("neighbours are pinned");
                assert_eq!((&found.garment, found.vertices), (&expected.garment, expected.vertices), "{count} ranks");
                assert!((found.strain - expected.strain).abs() < 1e-9 && *torn == 3, "{found:?}, {torn}");
            }
        }
        assert_eq!(ahead.strain_between_pins_at(&plates(0)).map(|record| record.strain < 1e-9), Some(true));
    }

    #[test]
    fn vertices_bound_far_from_a_body_are_named_however_long_their_edges_are() {
        let of_length = |edge: f64, higher: f64| {
            let mut description = parted(higher);
            let garment = &mut description.garments[0];
            for points in garment.start.iter_mut().chain([&mut garment.mesh.points]) {
                points.iter_mut().for_each(|x| (x.x, x.z) = (x.x * edge / 0.02, x.z * edge / 0.02));
            }
            start(&Ranks::default(), &description).warnings().join("\n")
        };
        assert_eq!(of_length(0.08, 0.03), "");
        let said = of_length(0.08, 0.11);
        assert!(said.contains("or more than 0.05 m; the farthest is vertex 1502, 0.120 m away"), "{said}");
    }

    #[test]
    fn vertices_bound_far_from_a_body_are_named_by_any_ranks() {
        assert!(start(&Ranks::default(), &parted(0.04)).warnings().is_empty());
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                start(&Ranks::new(communicator), &parted(0.12)).warnings().to_vec()
            });
            let all = all.expect("no rank ends early");
            let said = all[0].join("\n");
            for part in ["garment \"strip\": vertices 1502, 1503 are", "body \"plates\"", "vertex 1502, 0.130 m away"] {
                assert!(said.contains(part), "{part}: {said}");
            }
            assert!(all[0].len() == 1 && all[1..].iter().all(Vec::is_empty));
        }
    }
}
