//! Garments in which short edges lower the thickness that repulsions keep, their own or one by rule, known when a simulation starts.

use crate::effects::registry::PlannedEffect;
use crate::effects::self_repulsion;
use crate::mesh::TriangleMesh;
use crate::scene::Scene;
use crate::scene::contact_matrix::{ContactMatrix, objects_of_vertices};
use crate::tolerances::THICKNESS_ROUNDING;

/// A garment of which some vertices keep less than the thickness that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct LoweredThickness {
    /// Name of the garment.
    pub garment: String,
    /// The other side of the rule of contact that sets the thickness, in words; `None` for the garment's own thickness.
    pub by_rule_with: Option<String>,
    /// Whether a painted map says the thickness of each vertex, in metres.
    pub is_painted: bool,
    /// Thickness of the garment, or by the rule [m].
    pub asked: f64,
    /// The least that a vertex keeps of what it was to keep [m].
    pub least: f64,
    /// Number of vertices that keep less than they were to, and of all vertices of the garment, or of those that the rule concerns.
    pub vertices: [u64; 2],
}

impl LoweredThickness {
    /// Describes in words the thickness that is kept.
    pub fn kept(&self) -> String {
        let Self { asked, least, vertices: [lowered, all], .. } = self;
        let (asked, least) = (1e3 * asked, 1e3 * least);
        let asked = match (&self.by_rule_with, self.is_painted) {
            (None, true) => "in their map".to_owned(),
            (None, false) => format!("of {asked:.3} mm"),
            (Some(other), _) => format!("of {asked:.3} mm from {other}"),
        };
        format!("{lowered} of {all} vertices keep less than the thickness {asked}, down to {least:.3} mm")
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
    let (matrix, objects) = (ContactMatrix::of(scene.description()), objects_of_vertices(scene));
    let of_garment = |(g, mesh): (usize, &TriangleMesh)| -> Vec<LoweredThickness> {
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
        let count = |asked: f64, by_rule_with: Option<String>, of: &dyn Fn(usize) -> Option<f64>| {
            let (mut lowered, mut least, mut all) = (0, f64::INFINITY, 0);
            for (v, edge) in shortest.iter().enumerate().filter(|(v, _)| is_own(*v as u32)) {
                let Some(wanted) = of(v) else { continue };
                all += 1;
                if clamp * edge < wanted * (1.0 - THICKNESS_ROUNDING) {
                    (lowered, least) = (lowered + 1, least.min(clamp * edge));
                }
            }
            let vertices = parts.ranks().sum_of([lowered, all]);
            let least = -parts.ranks().max(-least);
            let (garment, is_painted) = (garments[g].name.clone(), false);
            LoweredThickness { garment, by_rule_with, is_painted, asked, least, vertices }
        };
        let (asked, painted) = (garments[g].thickness, scene.painted(g, "thickness"));
        let own = count(asked, None, &|v| Some(painted.map_or(asked, |map| map.at(v, asked))));
        let mut found = vec![LoweredThickness { is_painted: painted.is_some_and(|map| map.absolute), ..own }];
        for rule in scene.description().contacts.iter().filter(|rule| rule.body().is_none()) {
            let (Some(asked), Some(matrix)) = (rule.thickness, &matrix) else { continue };
            let [one, other] = rule.between;
            let sides = if one == other { vec![[one, other]] } else { vec![[one, other], [other, one]] };
            for [side, other] in sides {
                if side.garment() != Some(g) {
                    continue;
                }
                let by_rule = matrix.with_thickness_of(scene.description(), rule, [side, other]);
                let is_of_side = |v: usize| by_rule.contains(&(objects[first + v - parts.own().start] as usize));
                let other = scene.description().contact_side(other);
                found.push(count(asked, Some(other), &|v| is_of_side(v).then_some(asked)));
            }
        }
        found
    };
    let all = scene.meshes().iter().enumerate().flat_map(of_garment);
    all.filter(|garment| garment.vertices[0] > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;
    use crate::scene::{ContactRule, ContactSide, EffectRequest, GarmentDescription, SceneDescription};

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
    fn short_edges_lower_the_thickness_of_a_rule_for_its_sides_alone_as_any_ranks_say() {
        for count in 1..4 {
            let all = LocalRanks::run(count, 1, |communicator| {
                let ranks = Ranks::new(communicator);
                let described = || {
                    let mut description = strip(0.0005);
                    // The last vertices, whose edges are short, and some of the first.
                    let vertices = (0..100).chain(2990..3002).collect();
                    description.garments[0].parts.insert("end".into(), vertices);
                    description.effects.push(EffectRequest::of_scene(self_repulsion::SPEC.name));
                    let sides = [ContactSide::Part(0, 0), ContactSide::Garment(0)];
                    description.contacts.push(ContactRule { thickness: Some(0.003), ..ContactRule::new(sides) });
                    description
                };
                let description = ranks.is_first().then(described);
                garments_below(&Scene::distribute(&ranks, description).expect("a sound scene"), 0.4)
            });
            for found in all.expect("no rank ends early") {
                let kept: Vec<String> = found.iter().map(LoweredThickness::kept).collect();
                let words = "vertices keep less than the thickness of 3.000 mm from";
                let of_part = format!("12 of 112 {words} garment \"strip\", down to 0.800 mm");
                let of_rest = format!("10 of 2890 {words} part \"end\" of garment \"strip\", down to 0.800 mm");
                assert_eq!(kept, [of_part, of_rest], "{count} ranks");
            }
        }
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
