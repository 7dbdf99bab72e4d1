//! Garments in which short edges lower the thickness that repulsions keep, known when a simulation starts.

use crate::effects::registry::PlannedEffect;
use crate::effects::self_repulsion;
use crate::mesh::TriangleMesh;
use crate::scene::Scene;
use crate::tolerances::THICKNESS_ROUNDING;

/// A garment of which some vertices keep less than the thickness that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct LoweredThickness {
    /// Name of the garment.
    pub garment: String,
    /// Thickness of the garment [m].
    pub asked: f64,
    /// The least that a vertex keeps of what it was to keep [m].
    pub least: f64,
    /// Number of vertices that keep less than they were to, and of all vertices of the garment.
    pub vertices: [u64; 2],
}

impl LoweredThickness {
    /// Describes in words the thickness that is kept.
    pub fn kept(&self) -> String {
        let Self { asked, least, vertices: [lowered, all], .. } = self;
        let (asked, least) = (1e3 * asked, 1e3 * least);
        format!("{lowered} of {all} vertices keep less than the thickness of {asked:.3} mm, down to {least:.3} mm")
    }
}

/// The garments concerned, which the plan of repulsions notes, too; `clamp` is the largest thickness of a vertex as a fraction of
/// its shortest rest edge. All ranks call it together and get the same.
pub(super) fn lowered_thickness(scene: &Scene, clamp: f64, plan: &mut [PlannedEffect]) -> Vec<LoweredThickness> {
    let lowered = garments_below(scene, clamp);
    if let Some(effect) = plan.iter_mut().find(|effect| effect.name == self_repulsion::SPEC.name) {
        effect.notes.extend(lowered.iter().map(|found| format!("garment {}: {}", found.garment, found.kept())));
    }
    lowered
}

fn garments_below(scene: &Scene, clamp: f64) -> Vec<LoweredThickness> {
    let (parts, garments) = (scene.parts(), &scene.description().garments);
    let of_garment = |(g, mesh): (usize, &TriangleMesh)| {
        let first = parts.garment(g).start;
        let is_own = |v: u32| parts.own().contains(&(first + v as usize));
        // Own vertices have all their edges here.
        let mut shortest = vec![f64::INFINITY; mesh.rest_positions().len()];
        for edge in mesh.edges() {
            let length = mesh.rest_length(*edge);
            for v in edge.vertices {
                shortest[v as usize] = shortest[v as usize].min(length);
            }
        }
        let (asked, painted) = (garments[g].thickness, scene.painted(g, "thickness"));
        let (mut lowered, mut least, mut all) = (0, f64::INFINITY, 0);
        for (v, edge) in shortest.iter().enumerate().filter(|(v, _)| is_own(*v as u32)) {
            all += 1;
            let own = painted.map_or(asked, |map| map.at(v, asked));
            if clamp * edge < own * (1.0 - THICKNESS_ROUNDING) {
                (lowered, least) = (lowered + 1, least.min(clamp * edge));
            }
        }
        let vertices = parts.ranks().sum_of([lowered, all]);
        let least = -parts.ranks().max(-least);
        LoweredThickness { garment: garments[g].name.clone(), asked, least, vertices }
    };
    let all: Vec<_> = scene.meshes().iter().enumerate().map(of_garment).collect();
    all.into_iter().filter(|garment| garment.vertices[0] > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;
    use crate::scene::{GarmentDescription, SceneDescription};

    /// A strip of squares of 1 cm whose last ones are 2 mm long, so long that it has several parts.
    fn strip(thickness: f64) -> SceneDescription {
        const CELLS: usize = 1500;
        let x = |i: usize| {
            if i < CELLS - 9 { 0.01 * i as f64 } else { 0.01 * (CELLS - 10) as f64 + 0.002 * (i + 10 - CELLS) as f64 }
        };
        let points = (0..=CELLS).flat_map(|i| [0.0, 0.01].map(|z| Vec3::new(x(i), 0.0, z))).collect();
        let number = |i: usize, k: usize| (2 * i + k) as u32;
        let faces = (0..CELLS).flat_map(|i| [number(i, 0), number(i, 1), number(i + 1, 1), number(i + 1, 0)]);
        let mesh = PolygonMesh { points, face_counts: vec![4; CELLS], face_indices: faces.collect() };
        let mut description = SceneDescription::new("short");
        description.garments.push(GarmentDescription::new("strip", mesh, 0.2));
        description.garments[0].thickness = thickness;
        description
    }

    #[test]
    fn short_edges_lower_the_thickness_to_their_share_as_any_ranks_say() {
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let lowered = |thickness: f64| {
                    let description = ranks.is_first().then(|| strip(thickness));
                    garments_below(&Scene::distribute(&ranks, description).expect("a sound scene"), 0.4)
                };
                // 0.4 times 1 cm are 4 mm, times 2 mm are 0.8 mm.
                (lowered(0.0008), lowered(0.001), lowered(0.0041))
            });
            for (none, some, everywhere) in all.expect("no rank ends early") {
                assert_eq!(none, [], "{count} ranks");
                let [some, everywhere] = [some, everywhere].map(|mut found| found.remove(0));
                assert_eq!((some.vertices, everywhere.vertices), ([22, 3002], [3002, 3002]), "{count} ranks");
                assert!((some.least - 0.0008).abs() < 1e-12 && (everywhere.least - 0.0008).abs() < 1e-12);
                let kept = "22 of 3002 vertices keep less than the thickness of 1.000 mm, down to 0.800 mm";
                assert_eq!(some.kept(), kept);
            }
        }
    }
}
