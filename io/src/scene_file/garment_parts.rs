//! Parts of garments that rules of contact name.

use std::collections::BTreeMap;

use drapery_core::scene::ContactSide;
use globset::Glob;

use super::deserialize::suggestion;
use super::pins::Named;
use super::raw::{Garment, Part};
use super::resolve::{ReadGarment, Resolver};
use super::tree::Path;
use crate::mesh_data::MeshData;

/// Remedy where a part names face sets and the garment has none.
const NO_FACE_SETS: &str = "it has none at all: make a face set of these faces (a group `g` in OBJ) and export the file again, or \
                            choose the part by `map`, `vertices` or `where`";

impl Resolver<'_> {
    /// The parts of a garment by their names, each with its vertices. Problems are recorded.
    pub(super) fn parts(
        &mut self,
        garment: &Garment,
        path: &Path,
        read: &ReadGarment<'_>,
    ) -> BTreeMap<String, Vec<u32>> {
        let mut all = BTreeMap::new();
        for (number, part) in garment.part.iter().enumerate() {
            let path = path.clone().key("part").index(number);
            let Some(vertices) = self.part(part, &path, read) else { continue };
            if all.insert(part.name.clone(), vertices).is_some() {
                self.error(&path.clone().key("name"), format!("two parts have the name \"{}\"", part.name));
            }
            let names = [format!("{}.{}", garment.name, part.name), format!("garment.{}.{}", garment.name, part.name)];
            if !self.scene.document.contact.iter().any(|rule| rule.between.iter().any(|name| names.contains(name))) {
                let help = format!("name it as \"{}\" in `between`, or leave the part out", names[0]);
                self.error_with(&path, "no [[contact]] names this part".to_owned(), help);
            }
        }
        all
    }

    /// The vertices of one part, ascending.
    fn part(&mut self, part: &Part, path: &Path, read: &ReadGarment<'_>) -> Option<Vec<u32>> {
        let Part { vertices, region, map, faces, .. } = part;
        let named =
            Named { vertices: vertices.as_deref(), corners: None, nodes: None, region: *region, map: map.as_deref() };
        if named.ways() + usize::from(!faces.is_empty()) != 1 {
            self.error(path, "a part needs exactly one of `faces`, `map`, `vertices` and `where`");
            return None;
        }
        let mut chosen = if faces.is_empty() {
            self.chosen((path, "part"), &named, read)?
        } else {
            let path = path.clone().key("faces");
            let data = self.of_file(&path, read.mesh.read())?;
            let faces = self.faces_of_sets(&data, faces, &path, ("the garment", NO_FACE_SETS))?;
            let all: Vec<&[u32]> = data.mesh.faces().collect();
            faces.iter().filter_map(|face| all.get(*face as usize)).flat_map(|face| face.iter().copied()).collect()
        };
        chosen.sort_unstable();
        chosen.dedup();
        Some(chosen)
    }

    /// Faces of the face sets that patterns name; each names one at least. Problems are recorded, with the remedy `without` where
    /// the mesh has no face sets.
    pub(super) fn faces_of_sets(
        &mut self,
        data: &MeshData,
        patterns: &[String],
        here: &Path,
        (what, without): (&str, &str),
    ) -> Option<Vec<u32>> {
        let mut faces = Vec::new();
        for (index, pattern) in patterns.iter().enumerate() {
            let at = here.clone().index(index);
            let glob = Glob::new(pattern).map(|glob| glob.compile_matcher()).map_err(|error| error.to_string());
            let glob = self.check(&at, glob)?;
            let before = faces.len();
            let named = data.face_sets.iter().filter(|set| glob.is_match(&set.name));
            faces.extend(named.flat_map(|set| set.faces.iter().copied()));
            if faces.len() == before {
                let names: Vec<&str> = data.face_sets.iter().map(|set| set.name.as_str()).collect();
                let text = format!("{what} has no face set `{pattern}`");
                let help = if names.is_empty() { without.to_owned() } else { suggestion(pattern, &names) };
                self.error_with(&at, text, help);
                return None;
            }
        }
        Some(faces)
    }

    /// The part that a name means, as in "coat.pocket"; parts that could not be read have been reported.
    pub(super) fn part_named(&self, name: &str) -> Option<Option<ContactSide>> {
        let in_garment = |garment: &Garment| {
            let rest = name.strip_prefix("garment.").unwrap_or(name);
            let part = rest.strip_prefix(garment.name.as_str())?.strip_prefix('.')?;
            garment.part.iter().any(|written| written.name == part).then(|| (garment.name.clone(), part.to_owned()))
        };
        let (garment, part) = self.scene.document.garment.iter().find_map(in_garment)?;
        let number = self.description.garments.iter().position(|read| read.name == garment);
        let side = number.and_then(|number| {
            let part = self.description.garments[number].parts.keys().position(|name| *name == part)?;
            Some(ContactSide::Part(number, part))
        });
        Some(side)
    }
}

#[cfg(test)]
mod tests {
    use drapery_core::scene::ContactSide::{Body, Garment, Part};

    use crate::scene_file::parse;
    use crate::shot_description::ShotDescription;

    /// Two squares beside each other, the second one as group `pocket_left`, and a loose triangle.
    const COAT: &str = "v 0 1 0\nv 1 1 0\nv 1 1 1\nv 0 1 1\nv 2 1 0\nv 2 1 1\nv 5 1 0\nv 6 1 0\nv 5 1 1\n\
                        g cloth\nf 1 4 3 2\ng pocket_left\nf 2 3 6 5\ng cloth\nf 7 9 8\n";

    fn resolved(part: &str, rule: &str) -> Result<ShotDescription, String> {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("coat.obj"), COAT).expect("a file");
        let text = format!(
            "drapery = 1\nshot.frames = \"1-2\"\n[units]\nlength = \"m\"\nup = \"Y\"\n[self_collision]\n[[body]]\nname = \"ball\"\n\
             shape.sphere.radius = 0.1\n[[garment]]\nname = \"coat\"\nrest = \"coat.obj\"\ndensity = 0.2\n{part}\n{rule}\n"
        );
        let scene = parse(&text, "s.toml", folder.path(), &[]).map_err(|error| error.to_string())?;
        scene.resolve().map_err(|errors| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
    }

    fn part(selection: &str) -> String {
        format!("[[garment.part]]\nname = \"pocket\"\n{selection}")
    }

    fn rule(between: &str) -> String {
        format!("[[contact]]\nbetween = [{between}]\nignore = true")
    }

    #[test]
    fn parts_are_chosen_and_named_in_rules() {
        for (selection, vertices) in [
            ("faces = [\"pocket*\"]", vec![1, 2, 4, 5]),
            ("vertices = [8, 6, 7]", vec![6, 7, 8]),
            ("where = { box = { min = [4, 0, -1], max = [9, 2, 2] } }", vec![6, 7, 8]),
        ] {
            for (between, sides) in [
                ("\"coat.pocket\", \"coat\"", [Part(0, 0), Garment(0)]),
                ("\"ball\", \"garment.coat.pocket\"", [Body(0), Part(0, 0)]),
            ] {
                let shot = resolved(&part(selection), &rule(between)).unwrap_or_else(|text| panic!("{text}"));
                assert_eq!(shot.scene.garments[0].parts, [("pocket".to_owned(), vertices.clone())].into());
                assert_eq!(shot.scene.contacts[0].between, sides);
                // The scene as it is kept beside a run reads the same.
                assert!(shot.resolved.contains("[[garment.part]]"), "{}", shot.resolved);
            }
        }
    }

    #[test]
    fn parts_that_cannot_be_are_named_with_what_to_do() {
        let named = rule("\"coat.pocket\", \"coat\"");
        for (part, rule, words) in [
            (part("faces = [\"pouch\"]"), &named, ["the garment has no face set `pouch`", "pocket_left"]),
            (part("vertices = [9]"), &named, ["vertex 9 does not exist", "numbered from 0"]),
            (part(""), &named, ["a part needs exactly one of `faces`, `map`, `vertices` and `where`", ""]),
            (part("vertices = [1]") + "\nfaces = [\"pocket*\"]", &named, ["exactly one of", ""]),
            (
                part("vertices = [1]"),
                &rule("\"coat.pokcet\", \"coat\""),
                ["no garment and no body \"coat.pokcet\"", "coat.pocket"],
            ),
            (
                part("vertices = [1]"),
                &rule("\"coat\", \"coat\""),
                ["no [[contact]] names this part", "\"coat.pocket\" in `between`"],
            ),
            (
                part("vertices = [1]") + "\n" + &part("vertices = [2]"),
                &named,
                ["two parts have the name \"pocket\"", ""],
            ),
        ] {
            let text = resolved(&part, rule).expect_err("it cannot be");
            assert!(words.iter().all(|word| text.contains(word)), "{words:?}\n{text}");
        }
    }
}
