//! Garments and parts of garments that pass through each other by rules of contact, for the manifest.

use std::collections::BTreeMap;

use drapery_core::scene::{ContactMatrix, ContactSide, GarmentDescription, SceneDescription};

use crate::run_record::manifest::part_name;

/// Objects of cloth that pass through each other.
#[derive(Debug, Default)]
pub(super) struct Ignored {
    /// Names of the objects of each pair.
    pub(super) pairs: Vec<[String; 2]>,
    /// For each garment the points of its parts, as ranges; nothing where no pair is there.
    pub(super) parts: Vec<BTreeMap<String, Vec<[u32; 2]>>>,
}

impl Ignored {
    /// The pairs of a scene, after closer rules have replaced wider ones.
    pub(super) fn of(scene: &SceneDescription) -> Self {
        let Some(matrix) = ContactMatrix::of(scene) else { return Self::default() };
        let of_garment = |(number, garment): (usize, &GarmentDescription)| {
            let whole = (ContactSide::Garment(number), garment.name.clone());
            let parts = garment.parts.keys().enumerate();
            let parts = parts.map(|(part, name)| (ContactSide::Part(number, part), part_name(&garment.name, name)));
            std::iter::once(whole).chain(parts).collect::<Vec<_>>()
        };
        let objects: Vec<(ContactSide, String)> = scene.garments.iter().enumerate().flat_map(of_garment).collect();
        let mut pairs = Vec::new();
        for (place, (a, name)) in objects.iter().enumerate() {
            for (b, other) in &objects[place..] {
                if matrix.of_sides(scene, [*a, *b]).is_ignored {
                    pairs.push([name.clone(), other.clone()]);
                }
            }
        }
        if pairs.is_empty() {
            return Self::default();
        }
        let ranges_of = |(name, points): (&String, &Vec<u32>)| (name.clone(), ranges(points));
        let parts = scene.garments.iter().map(|garment| garment.parts.iter().map(ranges_of).collect()).collect();
        Self { pairs, parts }
    }
}

/// Numbers as ranges, each with its last one, ascending.
fn ranges(numbers: &[u32]) -> Vec<[u32; 2]> {
    let mut sorted = numbers.to_vec();
    sorted.sort_unstable();
    let mut ranges: Vec<[u32; 2]> = Vec::new();
    for number in sorted {
        match ranges.last_mut() {
            Some([_, last]) if number <= last.saturating_add(1) => *last = number,
            _ => ranges.push([number; 2]),
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run_record::manifest::ManifestGarment;

    #[test]
    fn points_are_found_in_the_ranges_of_their_part() {
        let pocket = ranges(&[7, 3, 4, 5, 4, 9]);
        assert_eq!(pocket, [[3, 5], [7, 7], [9, 9]]);
        let parts = BTreeMap::from([("pocket".to_owned(), pocket)]);
        let coat = ManifestGarment { name: "coat".into(), parts, ..Default::default() };
        for (points, object) in [
            (&[3_u32, 5, 9][..], "coat.pocket"),
            (&[7], "coat.pocket"),
            (&[3, 6], "coat"),
            (&[2, 8], "coat"),
            (&[], "coat"),
        ] {
            assert_eq!(coat.object_of(points), object, "{points:?}");
        }
    }
}
