//! Parts of garments that rules of contact name.

use std::collections::BTreeMap;

use drapery_core::scene::ContactSide;
use globset::Glob;

use super::deserialize::suggestion;
use super::pins::Named;
use super::raw::{Garment, Part};
use super::render_mesh::NO_FACE_SETS;
use super::resolve::{ReadGarment, Resolver};
use super::tree::Path;
use crate::mesh_data::MeshData;

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
            let faces = self.faces_of_sets(&data, faces, ("the garment", &path))?;
            let all: Vec<&[u32]> = data.mesh.faces().collect();
            faces.iter().filter_map(|face| all.get(*face as usize)).flat_map(|face| face.iter().copied()).collect()
        };
        chosen.sort_unstable();
        chosen.dedup();
        Some(chosen)
    }

    /// Faces of the face sets that patterns name; each names one at least. Problems are recorded.
    pub(super) fn faces_of_sets(
        &mut self,
        data: &MeshData,
        patterns: &[String],
        (what, here): (&str, &Path),
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
                let help = if names.is_empty() { NO_FACE_SETS.to_owned() } else { suggestion(pattern, &names) };
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
