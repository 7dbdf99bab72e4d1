//! Checks of painted maps and of seams.

use std::collections::BTreeSet;

use super::{check_values, report};
use crate::effects::registry::maps;
use crate::effects::spec::{EffectSpec, MapSpec};
use crate::error::Problem;
use crate::scene::vertex_maps::PaintedMap;
use crate::scene::{
    BodyDescription, Described, FacePoint, GarmentDescription, LARGEST_DENSITY, LARGEST_THICKNESS, Mass,
    PinDescription, SMALLEST_DENSITY, SceneDescription,
};
use crate::settings::{Field, Settings, Written, short};
use crate::tolerances::WEIGHTS_ROUNDING;

/// The maps of a garment, and the keys of those that change over time, by what they are of.
fn all_maps(garment: &GarmentDescription) -> impl Iterator<Item = (&String, &PaintedMap)> {
    let keys = garment.map_curves.iter().flat_map(|(of, curve)| curve.iter().map(move |(_, map)| (of, map)));
    garment.maps.iter().chain(keys)
}

/// Names and values of painted maps.
pub(crate) fn check_maps(garment: &GarmentDescription, problems: &mut Vec<Problem>) {
    for (name, map) in all_maps(garment) {
        let place = format!("garment \"{}\", map of {name}", garment.name);
        let known = maps().find(|(known, _)| known.name == name);
        if known.is_none() {
            let names: Vec<&str> = maps().map(|(known, _)| known.name).collect();
            let advice = format!("there are maps of {}", names.join(", "));
            problems.push(Problem::scene(&place, "this quantity cannot be painted", advice));
        }
        let (values, points) = (map.values.len(), garment.point_count());
        if values != points {
            let what = format!("it has {values} values for {points} vertices");
            problems.push(Problem::data(&place, what, "paint it on the rest shape of this garment"));
        }
        // Cloth without mass would move infinitely fast.
        let least_is_possible = name != "density";
        let possible = |value: f64| value.is_finite() && (value > 0.0 || (value == 0.0 && least_is_possible));
        let broken = (0..values).filter(|v| !possible(map.values[*v]));
        report(broken, problems, |list| {
            let least = if least_is_possible { "zero or more" } else { "above zero" };
            let what = format!("the values of vertices {list} have to be {least}");
            Problem::data(&place, what, "repaint these vertices")
        });
        if known.is_some_and(|(known, _)| known.is_share) && map.absolute {
            let what = format!("a map of {name} is a factor without a unit");
            problems.push(Problem::scene(&place, what, "leave it out of `absolute_maps`"));
        }
        if name == "density" && matches!(garment.mass, Mass::UniformTotal(_)) {
            let what = "a map of density cannot be combined with `total_mass`, which is the same for every vertex";
            problems.push(Problem::scene(&place, what, "give the garment a `density`"));
        }
    }
}

/// Maps of what nothing in the scene looks at.
pub(crate) fn check_maps_are_used(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for (g, garment) in description.garments.iter().enumerate() {
        let is_painted = |name: &str| garment.maps.contains_key(name) || garment.map_curves.contains_key(name);
        for (map, looker) in maps().filter(|(map, _)| is_painted(map.name)) {
            let Some(looker) = looker.map(|spec| spec.name) else { continue };
            // A map of what was left out is left out with it.
            if description.left_out.iter().any(|out| out == looker) {
                continue;
            }
            let place = format!("garment \"{}\", map of {}", garment.name, map.name);
            let mut requests = description.effects.iter().filter(|e| e.effect == looker);
            if !requests.any(|e| e.garment.is_none_or(|garment| garment == g)) {
                let advice = format!("leave it out, or ask for {looker}");
                problems.push(Problem::scene(place, "nothing in this scene uses it", advice));
            } else if map.varies.is_some_and(|varies| !varies(description, g)) {
                let advice = format!("write `{}` as well, or leave the map out", map.name);
                problems.push(Problem::scene(place, "the quantity that it multiplies is not set", advice));
            }
        }
        for (map, looker) in maps() {
            for (_, painted) in all_maps(garment).filter(|(of, _)| *of == map.name) {
                let place = format!("garment \"{}\", map of {}", garment.name, map.name);
                for varied in Varied::all(description, g, (map, looker)) {
                    varied.check(painted, &place, problems);
                }
            }
        }
    }
}

/// A number of a scene that a map varies from vertex to vertex.
struct Varied {
    /// Its key.
    name: &'static str,
    /// Value of the whole garment.
    of_garment: f64,
    /// Smallest and largest that a scene may write there; zero as the smallest where zero switches off.
    range: (f64, f64),
    /// In what it counts.
    unit: &'static str,
}

impl Varied {
    /// Returns the numbers that a map of a garment varies, as far as the scene gives them.
    fn all(description: &SceneDescription, g: usize, (map, looker): (&MapSpec, Option<&EffectSpec>)) -> Vec<Self> {
        let garment = &description.garments[g];
        let Some(looker) = looker.filter(|_| !map.rows.is_empty()) else {
            return Self::of_garment(garment, map.name).into_iter().collect();
        };
        let of_pins = description.pins.iter().filter(|pin| pin.garment == g);
        let of_effect = description.effects.iter().filter(|e| e.effect == looker.name);
        let of_effect = of_effect.filter(|e| e.garment.is_none_or(|garment| garment == g));
        let tables: Vec<(&'static [Field], Written)> = match looker.name {
            "attachments" => of_pins.map(|pin| (PinDescription::FIELDS, pin.written())).collect(),
            "body_collision" => {
                description.bodies.iter().map(|body| (BodyDescription::FIELDS, body.written())).collect()
            }
            _ => of_effect.map(|e| (looker.fields, e.settings.clone())).collect(),
        };
        let of_table = |(fields, written): (&'static [Field], Written)| {
            // What is wrong with the settings themselves is reported elsewhere.
            let settings = Settings::check(fields, &written).ok();
            let varied = |field: &Field| {
                let of_garment = settings.as_ref()?.optional(field.name)?;
                let Field { name, range: (_, most), dimension, .. } = *field;
                Some(Self { name, of_garment, range: (0.0, most), unit: dimension.si_unit() })
            };
            fields.iter().filter(|field| map.rows.contains(&field.name)).filter_map(varied).collect::<Vec<_>>()
        };
        tables.into_iter().flat_map(of_table).collect()
    }

    /// Returns the number that belongs to the garment itself.
    fn of_garment(garment: &GarmentDescription, map: &str) -> Option<Self> {
        match (map, garment.mass) {
            ("density", Mass::Density(of_garment)) => {
                let range = (SMALLEST_DENSITY, LARGEST_DENSITY);
                Some(Self { name: "density", of_garment, range, unit: "kg/m²" })
            }
            ("thickness", _) => {
                let range = (0.0, LARGEST_THICKNESS);
                Some(Self { name: "thickness", of_garment: garment.thickness, range, unit: "m" })
            }
            _ => None,
        }
    }

    /// Refuses vertices at which the map makes a number that no scene may write.
    fn check(&self, painted: &PaintedMap, place: &str, problems: &mut Vec<Problem>) {
        let Self { name, of_garment, range: (least, most), unit } = *self;
        // Zero switches off, and values that are no numbers above zero are refused by `check_maps`.
        let counts = |value: f64| value > 0.0 && value.is_finite();
        let misfit = |v: &usize| counts(painted.values[*v]) && !(least..=most).contains(&painted.at(*v, of_garment));
        let misfits = (0..painted.values.len()).filter(misfit);
        let Some(first) = misfits.clone().next() else { return };
        let with_unit = |number: f64| format!("{} {unit}", short(number)).trim_end().to_owned();
        let made = with_unit(painted.at(first, of_garment));
        let how = match painted.absolute {
            true => String::new(),
            false => format!(" instead of {}", short(of_garment)),
        };
        report(misfits, problems, |list| {
            let (least, most) = (short(least), with_unit(most));
            let what =
                format!("the values of vertices {list} give a `{name}` of {made}{how}; the range is {least} to {most}");
            Problem::data(place, what, "repaint these vertices")
        });
    }
}

/// Vertices and numbers of elastic bands.
pub(crate) fn check_elastics(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for (number, band) in description.elastics.iter().enumerate() {
        let place = format!("elastic {number}");
        let Some(garment) = description.garments.get(band.garment) else {
            let what = "it names a garment that does not exist";
            problems.push(Problem::scene(place, what, "correct its garment"));
            continue;
        };
        let place = format!("garment \"{}\", {place}", garment.name);
        let count = garment.point_count();
        if let Some(vertex) = band.vertices.iter().find(|vertex| **vertex as usize >= count) {
            let what = format!("vertex {vertex} does not exist: the garment has {count}, numbered from 0");
            problems.push(Problem::scene(&place, what, "use vertex numbers of this mesh"));
        }
        check_values(&place, band, problems);
    }
}

/// Names, pairs, numbers and times of seams.
pub(crate) fn check_seams(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for (s, seam) in description.seams.iter().enumerate() {
        let mut refuse = |what: String, advice: &str| {
            problems.push(Problem::scene(format!("seam {s}"), what, advice));
        };
        let counts = seam.garments.map(|g| description.garments.get(g).map(|garment| garment.point_count()));
        let [Some(a), Some(b)] = counts else {
            refuse("it names a garment that does not exist".into(), "correct its garments");
            continue;
        };
        if let Some([p, q]) = seam.pairs.iter().find(|[p, q]| *p as usize >= a || *q as usize >= b) {
            refuse(
                format!("vertices {p} and {q} are sewn, but its garments have {a} and {b} vertices"),
                "correct the numbers; they count from 0",
            );
        } else if let Some([p, _]) = seam.pairs.iter().find(|[p, q]| seam.garments[0] == seam.garments[1] && p == q) {
            refuse(format!("vertex {p} is sewn to itself"), "sew it to another one, or to none");
        }
        match (seam.opens, seam.opened) {
            (None, Some(_)) => refuse("it has an `opened` without `opens`".into(), "write when it starts to open"),
            (Some(opens), Some(opened)) if opened < opens => {
                let what = format!("it is open at {opened} s, before it starts to open at {opens} s");
                refuse(what, "write an `opened` after `opens`");
            }
            (Some(opens), _) if opens < seam.until => {
                let what = format!("it opens at {opens} s, before it is closed at {} s", seam.until);
                refuse(what, "write an `opens` after `closed`");
            }
            _ => {}
        }
        if let Some(point) =
            seam.faces.iter().find(|p| p.vertex as usize >= a || p.corners.iter().any(|c| *c as usize >= b))
        {
            let FacePoint { vertex, corners, .. } = point;
            refuse(
                format!("vertex {vertex} is sewn to the face {corners:?}, but its garments have {a} and {b} vertices"),
                "correct the numbers; they count from 0",
            );
        } else if let Some(point) =
            seam.faces.iter().find(|p| seam.garments[0] == seam.garments[1] && p.corners.contains(&p.vertex))
        {
            refuse(format!("vertex {} is sewn to a face of its own", point.vertex), "sew it to another face");
        }
        let is_barycentric = |p: &&FacePoint| (p.weights.iter().sum::<f64>() - 1.0).abs() <= WEIGHTS_ROUNDING;
        if let Some(point) = seam.faces.iter().find(|p| !is_barycentric(p)) {
            let what = format!("the weights of the face of vertex {} do not add up to one", point.vertex);
            refuse(what, "give barycentric weights");
        }
        if seam.stitches() == 0 {
            refuse("it has no stitches".into(), "list the vertices to sew");
        }
        check_values(&format!("seam {s}"), seam, problems);
    }
    check_breakable_stitches(description, problems);
}

/// Stitches that can break are known by their vertices.
fn check_breakable_stitches(description: &SceneDescription, problems: &mut Vec<Problem>) {
    let mut seen = BTreeSet::new();
    for (s, seam) in description.seams.iter().enumerate().filter(|(_, seam)| seam.break_force.is_some()) {
        let pairs = seam.pairs.iter().map(|[p, q]| (*p, [*q; 3]));
        let faces = seam.faces.iter().map(|point| (point.vertex, point.corners));
        let twice = pairs.chain(faces).find(|(vertex, to)| !seen.insert((seam.garments, *vertex, *to)));
        if let Some((vertex, _)) = twice {
            let what = format!("vertex {vertex} is sewn twice to the same place by seams with a `break_force`");
            problems.push(Problem::scene(format!("seam {s}"), what, "leave one of the two stitches out"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::mesh::PolygonMesh;
    use crate::scene::EffectRequest;

    /// Returns the problems with these values of a map.
    fn problems(of: &str, values: [f64; 3], absolute: bool) -> String {
        let mut description = SceneDescription::new("maps");
        let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
        description.garments.push(GarmentDescription::new("flag", mesh, 0.2));
        description.garments[0].maps.insert(of.into(), PaintedMap { values: values.into(), absolute });
        description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 300.0));
        description.effects.push(EffectRequest::of_scene("self_repulsion").with("friction", 0.25));
        description.effects.push(EffectRequest::of_scene("wind").with("density", 1.0));
        let mut problems = Vec::new();
        check_maps(&description.garments[0], &mut problems);
        check_maps_are_used(&description, &mut problems);
        problems.iter().map(|problem| format!("{}: {}", problem.place, problem.what)).collect::<Vec<_>>().join("; ")
    }

    #[test]
    fn a_map_makes_no_number_that_a_scene_could_not_write() {
        for (of, values, absolute, words) in [
            (
                "stretch",
                [1.0, 1e308, 1e7],
                false,
                "garment \"flag\", map of stretch: the values of vertices 1, 2 give a `stiffness` of inf N/m instead \
                 of 300; the range is 0 to 1e8 N/m",
            ),
            ("stretch", [1e9, 1.0, 1.0], true, "vertices 0 give a `stiffness` of 1e9 N/m; the range is 0 to 1e8"),
            ("stretch_damping", [1.0, 1.0, 2e3], false, "vertices 2 give a `damping_ratio` of 2000"),
            ("self_friction", [1.0, 401.0, 1.0], false, "vertices 1 give a `friction` of 100.25"),
            ("density", [1.0, 1e7, 1e-9], false, "vertices 1, 2 give a `density` of 2e6 kg/m² instead of 0.2"),
            ("thickness", [1e4, 1.0, 1.0], true, "vertices 0 give a `thickness` of 10000 m; the range is 0 to 1000 m"),
        ] {
            let text = problems(of, values, absolute);
            assert!(text.contains(words), "{words}\n{text}");
        }
        for (of, values, absolute) in [
            ("stretch", [0.0, 1.0, 3e5], false),
            ("stretch", [0.0, 1.0, 1e8], true),
            ("density", [1e-3, 1.0, 100.0], false),
            ("thickness", [0.0, 1.0, 2.0], false),
        ] {
            assert_eq!(problems(of, values, absolute), "", "{of}");
        }
        // Each value that is no number is reported once.
        let text = problems("stretch", [-1.0, f64::NAN, f64::INFINITY], false);
        assert_eq!(text, "garment \"flag\", map of stretch: the values of vertices 0, 1, 2 have to be zero or more");
    }

    #[test]
    fn the_rows_that_maps_vary_exist() {
        for (map, looker) in maps() {
            let Some(looker) = looker else { continue };
            let fields = match looker.name {
                "attachments" => PinDescription::FIELDS,
                "body_collision" => BodyDescription::FIELDS,
                _ => looker.fields,
            };
            for row in map.rows {
                assert!(fields.iter().any(|field| field.name == *row), "{}: {row}", map.name);
            }
            assert!(!map.rows.is_empty() || map.name == "thickness", "{}", map.name);
        }
    }
}
