//! `[garment.render_mesh]`: the mesh that is rendered in the place of a garment.

use std::collections::{BTreeMap, VecDeque};

use drapery_core::Vec3;
use drapery_core::mesh::MeshStream;
use drapery_core::settings::Dimension;

use crate::error::IoError;
use crate::garment_mesh::{GarmentMesh, GarmentReader};
use crate::mesh_data::MeshData;
use crate::shot_description::{RENDER, RenderMeshDescription};

use super::garments::FromFile;
use super::raw::{Garment, RenderMesh};
use super::resolve::Resolver;
use super::tree::Path;

/// Memory of a point of a render mesh: its mesh while it is read, its binding, a frame of it [bytes].
const OF_POINT: f64 = 400.0;

/// Longest name of a garment with a render mesh [bytes]: that of its caches is longer.
const LONGEST_NAME: usize = 235 - RENDER.len();

/// Remedy where parts are to stay rigid and the file has no face sets.
const NO_FACE_SETS: &str = "it has none at all: make a face set of each part that stays rigid (a group `g` in OBJ), export the \
                            file again, or leave `rigid` out";

/// Attributes that the moving normals take the place of.
const NORMALS: [&str; 2] = ["N", "normals"];

/// A mesh of a file that follows a garment: without its normals, which are those of one pose.
struct Following {
    file: FromFile,
    garment: String,
}

impl GarmentReader for Following {
    fn read(&self) -> Result<MeshData, IoError> {
        let mut data = self.file.read()?;
        data.params.retain(|param| !NORMALS.contains(&param.name.as_str()));
        data.render_mesh_of = Some(self.garment.clone());
        Ok(data)
    }

    fn points(&self, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        self.file.points(take)
    }

    fn faces(&self, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        self.file.faces(take)
    }
}

impl Resolver<'_> {
    /// Resolves the render mesh of a garment, which is the next in the description. Problems are recorded.
    pub(super) fn render_mesh(
        &mut self,
        garment: &Garment,
        written: &RenderMesh,
        path: &Path,
    ) -> Option<RenderMeshDescription> {
        let here = path.clone().key("render_mesh");
        let name = self.render_name(garment, &here)?;
        let file = here.clone().key("file");
        let max_distance = self.quantity(&here.clone().key("max_distance"), &written.max_distance, Dimension::Length);
        let (named, time) = self.file_at(&file, &written.file)?;
        let source = self.open(&file, &named, written.path.as_deref(), written.units)?;
        let time = self.time_in(&file, &source, time)?;
        let object = source.object_path();
        let (path_of_file, units) = (source.path().to_owned(), source.units());
        source.left_out().into_iter().for_each(|what| self.warn(&named, &what));
        let reader = FromFile::of(&source, written.path.clone(), time);
        let reader = Following { file: reader, garment: garment.name.clone() };
        let mesh = GarmentMesh::new(&path_of_file, object, reader);
        let mesh = self.of_file(&file, mesh)?;
        if mesh.face_count() == 0 {
            let help = "export it with polygons, or choose another object with `path`".to_owned();
            self.data_error(&file, "the render mesh has no faces", help);
            return None;
        }
        self.has_room_for(&file, mesh.point_count() as f64, OF_POINT)?;
        let data = self.of_file(&file, mesh.read())?;
        let rigid = self.rigid_parts(&data, written, &here)?;
        let garment = self.description.garments.len();
        let max_distance = max_distance?;
        Some(RenderMeshDescription { garment, name, file: path_of_file, units, mesh, max_distance, rigid })
    }

    /// The name of its caches, which no garment may have.
    fn render_name(&mut self, garment: &Garment, here: &Path) -> Option<String> {
        let name = format!("{}{RENDER}", garment.name);
        if garment.name.len() > LONGEST_NAME {
            let text = format!("the caches of the render mesh would be called \"{name}\", which is too long for files");
            self.error_with(here, text, format!("give the garment a name of at most {LONGEST_NAME} bytes"));
            return None;
        }
        if self.scene.document.garment.iter().any(|other| other.name == name) {
            let text = format!("the caches of the render mesh would be called \"{name}\", like a garment");
            self.error_with(here, text, "rename that garment".to_owned());
            return None;
        }
        Some(name)
    }

    /// Points of each part that stays rigid: of every connected piece of the face sets that are named.
    fn rigid_parts(&mut self, data: &MeshData, written: &RenderMesh, here: &Path) -> Option<Vec<Vec<u32>>> {
        let faces =
            self.faces_of_sets(data, &written.rigid, &here.clone().key("rigid"), ("the render mesh", NO_FACE_SETS))?;
        Some(connected(data, faces))
    }
}

/// The points of each connected piece of some faces.
fn connected(data: &MeshData, mut faces: Vec<u32>) -> Vec<Vec<u32>> {
    faces.sort_unstable();
    faces.dedup();
    let all: Vec<&[u32]> = data.mesh.faces().collect();
    let mut around: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &face in faces.iter().filter(|face| (**face as usize) < all.len()) {
        all[face as usize].iter().for_each(|point| around.entry(*point).or_default().push(face));
    }
    let mut parts = Vec::new();
    while let Some((&first, _)) = around.first_key_value() {
        let (mut part, mut waiting) = (Vec::new(), VecDeque::from([first]));
        while let Some(point) = waiting.pop_front() {
            let Some(faces) = around.remove(&point) else { continue };
            part.push(point);
            waiting.extend(faces.iter().flat_map(|face| all[*face as usize].iter().copied()));
        }
        part.sort_unstable();
        parts.push(part);
    }
    parts
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path as FilePath;

    use super::super::{SceneFile, parse};
    use super::*;

    /// A flap of cloth of two quads, two buttons of a triangle each in one set, and a third in another.
    const MESH: &str = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 0 1\nv 1 0 1\nv 2 0 1\nv 5 0 0\nv 5 1 0\nv 5 0 1\nv 6 0 0\n\
                        v 6 1 0\nv 6 0 1\nv 7 0 0\nv 7 1 0\nv 7 0 1\ng cloth\nf 1 4 5 2\nf 2 5 6 3\ng button_left\n\
                        f 7 8 9\nf 10 11 12\ng button_right\nf 13 14 15\n";

    fn scene(folder: &FilePath, table: &str, more: &str) -> Result<SceneFile, String> {
        fs::write(folder.join("fine.obj"), MESH).unwrap();
        let text = format!(
            "drapery = 1\n[shot]\nname = \"s\"\nframes = \"1-2\"\n[units]\nlength = \"cm\"\n[[garment]]\nname = \"coat\"\n\
             density = 0.1\npanel = {{ resolution = 2 }}\n[garment.render_mesh]\nfile = \"fine.obj\"\n{table}\n{more}"
        );
        parse(&text, "scene.toml", folder, &[]).map_err(|error| error.to_string())
    }

    fn resolved(table: &str, more: &str) -> Result<RenderMeshDescription, String> {
        let folder = tempfile::tempdir().unwrap();
        let shot = scene(folder.path(), table, more)?.resolve().map_err(|errors| errors[0].to_string())?;
        assert_eq!(shot.garments.len(), shot.scene.garments.len(), "a render mesh is no garment");
        assert!(shot.input_files.iter().any(|file| file.ends_with("fine.obj")), "a change of it is noticed");
        let found = shot.render_meshes.into_iter().next().unwrap();
        assert_eq!(found.mesh.positions().unwrap()[1].x, 0.01, "in the units of the scene");
        Ok(found)
    }

    #[test]
    fn each_piece_of_a_rigid_face_set_is_a_part() {
        let found = resolved("rigid = [\"button_*\"]", "").unwrap();
        assert_eq!(found.rigid, [[6, 7, 8], [9, 10, 11], [12, 13, 14]]);
        assert_eq!((found.name.as_str(), found.garment, found.max_distance), ("coat_render", 0, 0.02));
        assert_eq!(resolved("rigid = [\"button_left\"]\nmax_distance = \"5 mm\"", "").unwrap().rigid.len(), 2);
        assert!(resolved("", "").unwrap().rigid.is_empty());
    }

    #[test]
    fn what_cannot_be_meant_is_refused_with_the_line() {
        let garment = "[[garment]]\nname = \"coat_render\"\ndensity = 1\npanel = { resolution = 2 }";
        for (table, more, expected) in [
            ("rigid = [\"butons*\"]", "", "the render mesh has no face set `butons*`"),
            ("rigid = [\"[\"]", "", "scene.toml:13"),
            ("max_distance = \"2 kg\"", "", "scene.toml:13"),
            ("max_distance = -1", "", "max_distance"),
            ("path = \"/no/such\"", "", "fine.obj"),
            ("smooth = 3", "", "unknown key `smooth`"),
            ("", garment, "like a garment"),
        ] {
            let message = resolved(table, more).map(|_| ()).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn a_render_mesh_without_face_sets_is_told_how_to_get_them() {
        let without: String =
            MESH.lines().filter(|line| !line.starts_with('g')).map(|line| format!("{line}\n")).collect();
        let folder = tempfile::tempdir().unwrap();
        let scene = scene(folder.path(), "rigid = [\"button*\"]", "").unwrap();
        fs::write(folder.path().join("fine.obj"), without).unwrap();
        let message = scene.resolve().map(|_| ()).unwrap_err()[0].to_string();
        assert!(
            message.contains("has no face set `button*`") && message.contains("make a face set of each part"),
            "{message}"
        );
        assert!(!message.contains("allowed here"), "{message}");
    }
}
