//! Checks of painted maps and of seams.

use super::{check_values, report};
use crate::effects::registry::maps;
use crate::error::Problem;
use crate::scene::{GarmentDescription, Mass, SceneDescription};

/// Names and values of painted maps.
pub(crate) fn check_maps(garment: &GarmentDescription, problems: &mut Vec<Problem>) {
    for (name, map) in &garment.maps {
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
            let what = format!("the values of vertices {list} are not numbers {least}");
            Problem::data(&place, what, "paint these vertices anew")
        });
        if known.is_some_and(|(known, _)| known.is_share) && map.absolute {
            let what = format!("a map of {name} is a share of what the {name} does");
            problems.push(Problem::scene(&place, what, "leave it out of `absolute_maps`"));
        }
        if name == "density" && matches!(garment.mass, Mass::UniformTotal(_)) {
            let what = "it contradicts a total mass, which is the same for every vertex";
            problems.push(Problem::scene(&place, what, "give the garment a `density`"));
        }
    }
}

/// Maps of what nothing in the scene looks at.
pub(crate) fn check_maps_are_used(description: &SceneDescription, problems: &mut Vec<Problem>) {
    for (g, garment) in description.garments.iter().enumerate() {
        for (map, looker) in maps().filter(|(map, _)| garment.maps.contains_key(map.name)) {
            let Some(looker) = looker.map(|spec| spec.name) else { continue };
            // A map of what was left out is left out with it.
            if description.left_out.iter().any(|out| out == looker) {
                continue;
            }
            let place = format!("garment \"{}\", map of {}", garment.name, map.name);
            let mut requests = description.effects.iter().filter(|e| e.effect == looker);
            if !requests.any(|e| e.garment.is_none_or(|garment| garment == g)) {
                let advice = format!("leave it out, or ask for {looker}");
                problems.push(Problem::scene(place, "nothing in this scene looks at it", advice));
            } else if map.varies.is_some_and(|varies| !varies(description, g)) {
                let advice = format!("write `{}` as well, or leave the map out", map.name);
                problems.push(Problem::scene(place, "there is nothing that it would vary", advice));
            }
        }
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
        if seam.pairs.is_empty() {
            refuse("it has no pairs".into(), "say which vertices it sews");
        }
        check_values(&format!("seam {s}"), seam, problems);
    }
}
