//! Origin of a shot: the point from which positions are counted where single precision stores them.
//!
//! Caches store single precision, and collisions keep a gap of a few of its roundings, so that what is stored does not cross.
//! Counted from the origin of the world, a rounding 100 km away is 4 mm; counted from the middle of the cloth, it is what it is
//! in a scene at the origin (decision 15).

use crate::Vec3;
use crate::error::Problem;
use crate::scene::{Scene, SceneDescription};

/// Distance of the middle of the cloth from the origin of the world, along any axis, up to which the origin stays there [m].
const FAR: f64 = 1000.0;

/// Largest coordinate that is simulated [m]: beyond, even double precision rounds by more than a ten thousandth of a millimetre.
pub const FARTHEST: f64 = 1e9;

/// Share of a garment's thickness that rounding may take without a word.
const WORTH_SAYING: f64 = 0.1;

/// The largest and the smallest coordinates, these negated.
type Bounds = [f64; 6];

impl Scene {
    /// Returns the origin from which positions are counted where single precision stores them, in caches and for the gap of
    /// collisions [m]. The description gives it, or else it is the middle of all garments at the start in whole metres, if that
    /// is far from the origin of the world. Fixed for the scene.
    pub fn origin(&self) -> Vec3 {
        self.description.origin.unwrap_or_default()
    }

    /// Chooses the origin, if the description does not, and warns where rounding is coarse all the same. All ranks call it
    /// together.
    pub(crate) fn settle_origin(&mut self) {
        let bounds: Vec<Bounds> = (0..self.meshes.len()).map(|garment| self.start_bounds(garment)).collect();
        let all = bounds.iter().fold(NOWHERE, |all, one| std::array::from_fn(|i| all[i].max(one[i])));
        let origin = self.description.origin.unwrap_or_else(|| automatic(&all));
        self.description.origin = Some(origin);
        if self.parts.ranks().is_first() {
            let garments = self.description.garments.iter().zip(&bounds);
            let coarse = garments.filter_map(|(garment, bounds)| {
                let rounding = largest_rounding(bounds, origin);
                let limit = WORTH_SAYING * garment.thickness;
                (limit > 0.0 && rounding > limit)
                    .then(|| coarse_warning(&garment.name, rounding, garment.thickness, origin))
            });
            self.warnings.extend(coarse.collect::<Vec<_>>());
        }
    }

    /// Bounds of what takes part of a garment at the start, of all ranks.
    fn start_bounds(&self, garment: usize) -> Bounds {
        let first = self.parts.garment(garment).start;
        let rest = self.meshes[garment].modelled_positions();
        let isolated = self.isolated.as_deref().unwrap_or_default();
        let mut own = NOWHERE;
        for vertex in self.parts.own_of_garment(garment).filter(|v| isolated.binary_search(&(*v as u32)).is_err()) {
            let p = self.start.as_ref().map_or(rest[vertex - first], |start| start[vertex]);
            own = std::array::from_fn(|i| own[i].max(if i < 3 { p[i] } else { -p[i - 3] }));
        }
        self.parts.ranks().max_of(own)
    }
}

/// Whether this can be a position [m] or a velocity [m/s] of a simulation: three numbers, none beyond [`FARTHEST`].
/// Squares of much larger ones overflow, and no remedy for a step that has gone wrong helps against that.
pub fn is_possible(vector: &Vec3) -> bool {
    vector.iter().all(|c| c.abs() <= FARTHEST)
}

/// The bounds of nothing.
const NOWHERE: Bounds = [f64::NEG_INFINITY; 6];

/// The middle in whole metres, where it is far from the origin of the world, and that origin otherwise.
fn automatic(bounds: &Bounds) -> Vec3 {
    let [high, low] = corners(bounds);
    let middle = 0.5 * high + 0.5 * low;
    if middle.iter().all(|c| c.is_finite()) && middle.amax() > FAR { middle.map(f64::round) } else { Vec3::zeros() }
}

fn corners(&[x, y, z, u, v, w]: &Bounds) -> [Vec3; 2] {
    [Vec3::new(x, y, z), -Vec3::new(u, v, w)]
}

/// The largest that single precision rounds by, of coordinates within these bounds counted from `origin` [m].
fn largest_rounding(bounds: &Bounds, origin: Vec3) -> f64 {
    let farthest = corners(bounds).iter().map(|corner| (corner - origin).amax()).fold(0.0, f64::max) as f32;
    // Half the distance of neighbouring numbers.
    if farthest.is_finite() { 0.5 * (f64::from(farthest) - f64::from(farthest.next_down())) } else { 0.0 }
}

/// Size of a triangle, in distances of neighbouring numbers of single precision at its place, up to which these may have taken its
/// area.
const TAKEN_BY_ROUNDING: f64 = 16.0;

/// Returns the largest coordinate of a triangle without area [m], and the spacing of single-precision numbers there [m], if
/// rounding to them may have taken its area; `None` otherwise.
pub fn coarse_place(corners: [Vec3; 3]) -> Option<(f64, f64)> {
    let [a, b, c] = corners;
    let farthest = corners.iter().map(Vec3::amax).fold(0.0, f64::max);
    let apart = f64::from((farthest as f32).next_up()) - f64::from(farthest as f32);
    let longest = [(b - a).norm(), (c - b).norm(), (a - c).norm()].into_iter().fold(0.0, f64::max);
    // Near the origin a point that is there three times is no matter of rounding.
    (farthest > FAR && longest <= TAKEN_BY_ROUNDING * apart).then_some((farthest, apart))
}

fn coarse_warning(name: &str, rounding: f64, thickness: f64, origin: Vec3) -> String {
    let [x, y, z] = <[f64; 3]>::from(origin);
    format!(
        "garment \"{name}\": positions in caches are relative to [{x}, {y}, {z}], so far from its start that rounding \
         reaches {rounding:.1e} m, more than a tenth of its thickness of {thickness} m: set shot.origin to a point \
         near the cloth"
    )
}

/// Refuses an origin that is no place.
pub(crate) fn check_origin(description: &SceneDescription, problems: &mut Vec<Problem>) {
    if description.origin.is_some_and(|origin| !is_possible(&origin)) {
        problems.push(Problem::scene(
            "shot",
            format!("its origin is not finite, or beyond {FARTHEST:e} m"),
            "write origin = \"auto\", or [x, y, z]",
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::PolygonMesh;
    use crate::parallel::local_ranks::LocalRanks;
    use crate::parallel::ranks::Ranks;
    use crate::scene::GarmentDescription;

    /// A square of 2 m around a place and a loose vertex at the origin of the world.
    fn square(name: &str, place: Vec3) -> GarmentDescription {
        let corner = |x: f64, z: f64| place + Vec3::new(x, 0.0, z);
        let points = vec![corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), Vec3::zeros()];
        GarmentDescription::new(name, PolygonMesh::from_triangles(points, &[[0, 1, 2], [0, 2, 3]]), 0.2)
    }

    fn scene_by(ranks: usize, garments: &[GarmentDescription], origin: Option<Vec3>) -> (Vec3, String) {
        let all = LocalRanks::run(ranks, 1, |communicator| {
            let ranks = Ranks::new(communicator);
            let mut description = SceneDescription::new("far");
            description.garments = garments.to_vec();
            description.origin = origin;
            let scene = Scene::distribute(&ranks, Some(description)).expect("a sound scene");
            (scene.origin(), scene.warnings().join("\n"))
        });
        let all = all.expect("no rank ends early");
        assert!(all.iter().all(|(origin, _)| *origin == all[0].0));
        all[0].clone()
    }

    #[test]
    fn the_origin_is_that_of_the_world_up_to_a_kilometre_and_beyond_the_middle_in_whole_metres() {
        let far = Vec3::new(1e5 + 0.3, -3e4, 20.4);
        let cases = [
            (vec![square("a", Vec3::new(999.0, -999.0, 0.0))], Vec3::zeros()),
            (vec![square("a", far)], Vec3::new(1e5, -3e4, 20.0)),
            (
                vec![square("a", far), square("b", far + Vec3::new(8.0, 6.0, 0.0))],
                Vec3::new(100_004.0, -29_997.0, 20.0),
            ),
        ];
        for (garments, expected) in cases {
            for ranks in 1..4 {
                let (origin, said) = scene_by(ranks, &garments, None);
                assert_eq!(origin, expected, "{ranks} ranks");
                assert!(!said.contains("shot.origin"), "{said}");
            }
        }
        let chosen = Vec3::new(0.25, 0.0, -7.0);
        assert_eq!(scene_by(1, &[square("a", Vec3::x())], Some(chosen)).0, chosen);
    }

    #[test]
    fn rounding_beyond_a_tenth_of_the_thickness_is_said_of_the_garment_that_has_it() {
        // 0.06 mm at 1.5 km, a tenth of the thickness being 0.05 mm.
        let garments = [square("near", Vec3::zeros()), square("far", Vec3::new(0.0, 0.0, 1500.0))];
        let (_, said) = scene_by(2, &garments, Some(Vec3::zeros()));
        assert!(said.contains("garment \"far\": positions in caches") && said.contains("6.1e-5 m"), "{said}");
        assert!(!said.contains("garment \"near\": positions in caches"), "{said}");
        // Between the two no place is near both: 0.03 mm.
        assert!(!scene_by(2, &garments, Some(Vec3::new(0.0, 0.0, 750.0))).1.contains("positions in caches"));
    }

    #[test]
    fn coordinates_beyond_a_million_kilometres_are_refused_on_any_ranks() {
        for ranks in 1..4 {
            for (far, is_right) in [(1e9, true), (-1.1e9, false), (1e233, false), (f64::NAN, false)] {
                let all = LocalRanks::run(ranks, 1, |communicator| {
                    let mut description = SceneDescription::new("far");
                    description.garments.push(square("a", Vec3::zeros()));
                    let PolygonMesh { points, .. } = &mut description.garments[0].mesh;
                    points[4].y = far;
                    let problems = Scene::distribute(&Ranks::new(communicator), Some(description)).err();
                    problems.map(|problems| problems.to_string())
                });
                for said in all.expect("no rank ends early") {
                    let is_named = |said: &String| said.contains("vertices 4 are not finite numbers, or beyond 1e9 m");
                    assert!(
                        if is_right { said.is_none() } else { said.as_ref().is_some_and(is_named) },
                        "{far}: {said:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn an_origin_that_is_no_place_is_refused() {
        let mut description = SceneDescription::new("nowhere");
        description.garments.push(square("a", Vec3::zeros()));
        description.origin = Some(Vec3::new(0.0, f64::NAN, 0.0));
        let problems = Scene::validate(description).expect_err("a place that is none");
        assert!(problems.to_string().contains("its origin is not finite"), "{problems}");
    }
}
