//! Painted maps of garments: attributes of the rest shape, or lists of numbers in files.

use std::collections::BTreeMap;

use drapery_core::mesh::MeshStream;
use drapery_core::scene::vertex_maps::{MapCurves, PaintedMap, PaintedMaps};

use crate::error::IoError;
use crate::garment_mesh::GarmentMesh;
use crate::input_file;
use crate::mesh_data::{DataType, MeshData, MeshParam, Scope};

use super::deserialize::suggestion;
use super::raw::{FILE, Garment};
use super::resolve::Resolver;
use super::tree::Path;

/// A map holds vertices where it is above this.
const HELD: f64 = 0.5;

impl Resolver<'_> {
    /// Resolves the maps of a garment, and those that change over time. Problems are recorded, and the map is then left out.
    pub(super) fn maps(&mut self, garment: &Garment, path: &Path, mesh: &GarmentMesh) -> (PaintedMaps, MapCurves) {
        let (mut maps, mut over_time) = (PaintedMaps::new(), MapCurves::new());
        let written = garment.maps.written();
        let curves: BTreeMap<String, Vec<(f64, String)>> = {
            let of = |name: &String| path.clone().key("maps").key(name);
            let keys = |name: &String| self.scene.map_curves.iter().find(|curve| curve.path == of(name));
            written.iter().filter_map(|(name, _)| Some((name.clone(), keys(name)?.keys.clone()))).collect()
        };
        let names = written.iter().map(|(_, name)| name).chain(curves.values().flatten().map(|(_, name)| name));
        let mut data = None;
        if names.clone().any(|name| !name.starts_with(FILE)) {
            data = self.of_file(path, mesh.read());
        }
        for (of, name) in &written {
            let here = path.clone().key("maps").key(of.as_str());
            let absolute = garment.absolute_maps.iter().any(|absolute| absolute == of);
            let mut read = |name: &str| {
                let values = self.values(&here, name, mesh, data.as_ref())?;
                Some(PaintedMap { values, absolute })
            };
            match curves.get(of) {
                Some(keys) => {
                    let read = keys.iter().map(|(frame, name)| Some((*frame, read(name)?)));
                    if let Some(curve) = read.collect::<Option<Vec<_>>>() {
                        over_time.insert(of.clone(), curve);
                    }
                }
                None => maps.extend(read(name).map(|map| (of.clone(), map))),
            }
        }
        for (index, absolute) in garment.absolute_maps.iter().enumerate() {
            if written.iter().all(|(of, _)| of != absolute) {
                let here = path.clone().key("absolute_maps").index(index);
                let names: Vec<&str> = written.iter().map(|(of, _)| of.as_str()).collect();
                let help = match names.is_empty() {
                    true => format!("write one: maps = {{ {absolute} = \"NAME\" }}"),
                    false => suggestion(absolute, &names),
                };
                self.error_with(&here, format!("there is no map of `{absolute}`"), help);
            }
        }
        (maps, over_time)
    }

    /// The vertices of a garment where the map of a pin or band is above one half. Problems are recorded.
    pub(super) fn painted_vertices(
        &mut self,
        (path, what): (&Path, &str),
        name: &str,
        mesh: &GarmentMesh,
    ) -> Option<Vec<u32>> {
        let data = match name.starts_with(FILE) {
            true => None,
            false => Some(self.of_file(path, mesh.read())?),
        };
        let values = self.values(path, name, mesh, data.as_ref())?;
        let painted: Vec<u32> =
            (0..).zip(&values).filter(|(_, value)| **value > HELD).map(|(vertex, _)| vertex).collect();
        if painted.is_empty() {
            let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let help = format!("paint the vertices to be held with 1; its largest value is {most}");
            self.error_with(
                path,
                format!("the map `{name}` is nowhere above {HELD}, so this {what} holds no vertex"),
                help,
            );
            return None;
        }
        Some(painted)
    }

    /// Values of a map, one finite number for each vertex: of a text file, or of an attribute of `data`, the rest shape. Problems are
    /// recorded.
    fn values(&mut self, path: &Path, name: &str, mesh: &GarmentMesh, data: Option<&MeshData>) -> Option<Vec<f64>> {
        let (values, source) = match name.strip_prefix(FILE) {
            Some(file) => (self.map_file(path, file)?, self.scene.folder.join(file).display().to_string()),
            None => {
                let found = attribute(data?, name);
                let values = found.map_err(|(what, help)| self.error_with(path, what, help)).ok()?;
                (values, format!("{}, attribute `{name}`", mesh.path().display()))
            }
        };
        let (found, count) = (values.len(), mesh.point_count());
        if found != count {
            let what = format!("{source}: this map has {found} values, but the garment has {count} vertices");
            let help =
                "paint it on the rest shape of this garment: one value for each vertex, in the order of its points";
            self.data_error(path, what, help.to_owned());
            return None;
        }
        if let Some(vertex) = values.iter().position(|value| !value.is_finite()) {
            let what = format!("{source}: the value of vertex {vertex} is {}, not a finite number", values[vertex]);
            self.data_error(path, what, "repaint this vertex, and export the rest shape again".to_owned());
            return None;
        }
        Some(values)
    }

    /// The numbers of a text file, separated by commas, blanks or lines; a list in brackets, as of JSON, is one too.
    fn map_file(&mut self, path: &Path, file: &str) -> Option<Vec<f64>> {
        let file = self.scene.folder.join(file);
        let numbers = input_file::text(&file).and_then(|text| {
            numbers(&text).map_err(|(line, what)| {
                let advice = "a map holds one number for each vertex, separated by commas or lines";
                IoError::data(&file, format!("line {line}"), what, advice)
            })
        });
        if !self.input_files.contains(&file) {
            self.input_files.push(file);
        }
        self.of_file(path, numbers)
    }
}

/// All numbers of a text, or the line of the first word that is none.
fn numbers(text: &str) -> Result<Vec<f64>, (usize, String)> {
    let mut found = Vec::new();
    for (line, text) in text.lines().enumerate() {
        let words = text.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|word| !word.is_empty());
        for word in words {
            let number = word.parse().ok().filter(|number: &f64| number.is_finite());
            let wrong = || (line + 1, format!("`{word}` is not a number, for vertex {}", found.len()));
            found.push(number.ok_or_else(wrong)?);
        }
    }
    Ok(found)
}

/// The values of an attribute for each point; else the reason, and what to do.
fn attribute(data: &MeshData, name: &str) -> Result<Vec<f64>, (String, String)> {
    let usable = |param: &&MeshParam| matches!(param.scope, Scope::Vertex | Scope::Varying | Scope::Constant);
    let Some(param) = data.params.iter().filter(usable).find(|param| param.name == name) else {
        let names: Vec<&str> = data.params.iter().filter(usable).map(|param| param.name.as_str()).collect();
        return Err(match (names.is_empty(), data.params.iter().any(|param| param.name == name)) {
            (_, true) => (
                format!("the attribute `{name}` does not have one value for each point"),
                "store it for points (per vertex), not for corners or faces, and export again".to_owned(),
            ),
            (true, _) => (
                format!("the rest shape has no attribute `{name}`, nor any other for its points"),
                format!("paint it and export the rest shape with its attributes, or write \"{FILE}NUMBERS.txt\""),
            ),
            (false, _) => (format!("the rest shape has no attribute `{name}`"), suggestion(name, &names)),
        });
    };
    let damaged = |what: &str| (format!("the attribute `{name}` {what}"), "export the rest shape again".to_owned());
    let no_numbers = || (format!("the attribute `{name}` does not hold numbers"), "paint it as numbers".to_owned());
    let values = components(param).ok_or_else(no_numbers)?;
    let at = |index: u32| values.get(index as usize).copied();
    let shared = match &param.indices {
        Some(indices) => indices.iter().map(|index| at(*index)).collect(),
        None => Some(values.clone()),
    };
    let values = shared.ok_or_else(|| damaged("refers to values that it does not have"))?;
    let points = data.mesh.points.len();
    match values.as_slice() {
        [value] if param.scope == Scope::Constant => Ok(vec![*value; points]),
        _ => Ok(values),
    }
}

/// The first component of every value: what is painted in a colour is its red.
fn components(param: &MeshParam) -> Option<Vec<f64>> {
    use crate::mesh_data::PodType::{F32, F64, I8, I16, I32, U8, U16, U32};
    let DataType { pod, extent } = param.data_type;
    let bytes = &param.values;
    let all: Vec<f64> = match pod {
        F32 => bytes.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect(),
        F64 => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect(),
        I32 => bytes.as_chunks().0.iter().map(|b| f64::from(i32::from_le_bytes(*b))).collect(),
        U32 => bytes.as_chunks().0.iter().map(|b| f64::from(u32::from_le_bytes(*b))).collect(),
        I16 => bytes.as_chunks().0.iter().map(|b| f64::from(i16::from_le_bytes(*b))).collect(),
        U16 => bytes.as_chunks().0.iter().map(|b| f64::from(u16::from_le_bytes(*b))).collect(),
        I8 => bytes.iter().map(|b| f64::from(*b as i8)).collect(),
        U8 => bytes.iter().map(|b| f64::from(*b)).collect(),
        _ => return None,
    };
    Some(all.into_iter().step_by(usize::from(extent).max(1)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_core::Vec3;
    use drapery_core::mesh::PolygonMesh;

    #[test]
    fn lists_of_numbers_are_read_from_lines_commas_and_brackets() {
        assert_eq!(numbers("1\n0.5, 2e-1\n").unwrap(), [1.0, 0.5, 0.2]);
        assert_eq!(numbers("[1, 2,\n 3]").unwrap(), [1.0, 2.0, 3.0]);
        assert_eq!(numbers("1\n2 x").unwrap_err(), (2, "`x` is not a number, for vertex 2".to_owned()));
        assert_eq!(numbers("1\n\nnan").unwrap_err(), (3, "`nan` is not a number, for vertex 1".to_owned()));
    }

    #[test]
    fn attributes_of_points_are_found_by_name_and_colours_give_their_red() {
        let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
        let param = |name: &str, scope, extent, values: &[f32], indices| MeshParam {
            name: name.into(),
            scope,
            data_type: DataType { pod: crate::mesh_data::PodType::F32, extent },
            interpretation: String::new(),
            source_name: None,
            values: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            indices,
        };
        let params = vec![
            param("thick", Scope::Vertex, 1, &[1.0, 0.5, 0.25], None),
            param("shared", Scope::Varying, 1, &[2.0, 3.0], Some(vec![1, 0, 1])),
            param("red", Scope::Vertex, 3, &[0.1, 9.0, 9.0, 0.2, 9.0, 9.0, 0.3, 9.0, 9.0], None),
            param("all", Scope::Constant, 1, &[4.0], None),
            param("corner", Scope::FaceVarying, 1, &[1.0; 3], None),
        ];
        let data = MeshData { params, ..MeshData::new(mesh) };
        assert_eq!(attribute(&data, "thick").unwrap(), [1.0, 0.5, 0.25]);
        assert_eq!(attribute(&data, "shared").unwrap(), [3.0, 2.0, 3.0]);
        assert_eq!(attribute(&data, "red").unwrap(), [0.1_f32, 0.2, 0.3].map(f64::from));
        assert_eq!(attribute(&data, "all").unwrap(), [4.0; 3]);
        assert!(attribute(&data, "thik").unwrap_err().1.contains("thick"));
        assert!(attribute(&data, "corner").unwrap_err().0.contains("for each point"));
        let bare = MeshData { params: Vec::new(), ..data };
        assert!(attribute(&bare, "thick").unwrap_err().1.contains("file:NUMBERS.txt"));
    }

    #[test]
    fn every_map_of_the_solver_can_be_written_in_a_scene() {
        for name in drapery_core::effects::maps().map(|(map, _)| map.name) {
            let scene = serde_json::json!({ "name": "shirt", "maps": { name: "file:map.txt" } });
            let garment: Garment = serde_json::from_value(scene).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(garment.maps.written(), [(name.to_owned(), "file:map.txt".to_owned())]);
        }
    }
}
