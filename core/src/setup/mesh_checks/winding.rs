//! Faces of a garment that are wound against their neighbours, said where something looks at the sides of cloth.

use crate::effects;
use crate::mesh::{sides, turned_edges};
use crate::parallel::problems::listed;
use crate::parallel::ranks::Ranks;
use crate::scene::SceneDescription;
use crate::setup::distribute::block_rows::BlockDistribution;
use crate::setup::distribute::even_blocks::joined;
use crate::setup::distribute::one_ring::Triangle;

/// Returns in words the effects of a scene that take the side that faces show for a side of this garment.
fn looking_at_sides(description: &SceneDescription, garment: usize) -> Vec<&'static str> {
    let requests = description.effects.iter();
    let acts = requests.filter(|request| request.garment.is_none_or(|of| of == garment));
    acts.filter_map(|request| effects::find(&request.effect).and_then(|spec| (spec.looks_at_sides)(request))).collect()
}

/// Says in words, on rank 0, at which edges of a garment two faces are wound against each other, if something looks at their
/// sides. `triangles` are those in this rank's block with their polygons, `blocks` those of the points. All ranks call it together.
pub(crate) fn warning(
    ranks: &Ranks,
    description: &SceneDescription,
    garment: usize,
    blocks: &BlockDistribution,
    triangles: &[Triangle],
) -> Option<String> {
    let looking = looking_at_sides(description, garment).join(" and ");
    if looking.is_empty() {
        return None;
    }
    let mut lists = vec![Vec::new(); ranks.count()];
    for side in sides(triangles.iter().map(|triangle| triangle.corners)) {
        lists[blocks.of(side[0] as usize)].push(side);
    }
    let list = listed(ranks, turned_edges(joined(ranks.all_to_all_v(lists))))?;
    let name = &description.garments[garment].name;
    ranks.is_first().then(|| {
        format!(
            "garment \"{name}\": the faces at edges {list} have opposite winding, so they show opposite sides of the \
             cloth to {looking}: make the normals consistent"
        )
    })
}

#[cfg(test)]
mod tests {
    use crate::Vec3;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;
    use crate::scene::{EffectRequest, GarmentDescription, Scene, SceneDescription};

    /// Cells of the strip.
    const CELLS: u32 = 12;

    /// A strip of quads, of which the fourth and the last are turned.
    fn strip() -> PolygonMesh {
        let points = (0..=CELLS).flat_map(|i| [Vec3::new(f64::from(i), 0.0, 0.0), Vec3::new(f64::from(i), 1.0, 0.0)]);
        let mut faces: Vec<[u32; 4]> = (0..CELLS).map(|i| [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1]).collect();
        faces[3].reverse();
        faces[CELLS as usize - 1].reverse();
        PolygonMesh { points: points.collect(), face_counts: vec![4; CELLS as usize], face_indices: faces.concat() }
    }

    fn warnings(count: usize, request: &EffectRequest) -> Vec<String> {
        let all = LocalRanks::run(count, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let mut description = SceneDescription::new("flag");
            description.garments.push(GarmentDescription::new("flag", strip(), 0.2));
            description.effects.push(request.clone());
            let scene = Scene::distribute(&ranks, ranks.is_first().then_some(description));
            scene.unwrap_or_else(|problems| panic!("{problems}")).warnings().to_vec()
        });
        let all = all.expect("no rank ends early");
        assert!(all[1..].iter().all(Vec::is_empty));
        all[0].clone()
    }

    #[test]
    fn faces_wound_against_each_other_are_named_by_any_ranks_where_something_looks_at_their_sides() {
        let looking = EffectRequest::of_scene("wind").with("normal", 2.0);
        let said = warnings(1, &looking);
        assert_eq!(said.len(), 1);
        assert!(
            said[0].contains("edges 6-7, 8-9, 22-23 have opposite winding") && said[0].contains("`normal`"),
            "{said:?}"
        );
        (2..6).for_each(|ranks| assert_eq!(warnings(ranks, &looking), said, "{ranks} ranks"));
        let inflated = EffectRequest::of_garment("pressure", 0).with_flag("open", true);
        assert!(warnings(1, &inflated).concat().contains("to `pressure`:"));
        // Friction of the air and its pressure do not depend on which side is which.
        assert!(warnings(1, &EffectRequest::of_scene("wind").with("density", 1.0)).is_empty());
        assert!(warnings(1, &EffectRequest::of_scene("gravity")).is_empty());
    }
}
