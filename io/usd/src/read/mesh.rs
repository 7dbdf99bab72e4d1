//! A mesh of a stage: its points in the world, its faces, and what is handed through.

use openusd::sdf::Value;
use openusd::usd::{AttributeQuery, Prim};

use super::error::UsdError;
use super::instancer::{Instances, repeat_faces, repeat_primvar, repeat_subset};
use super::matrix::{Matrix, determinant, transform_point};
use super::primvars::{self, metadata};
use super::reading::Reading;
use super::skin::Skin;
use super::transform::{Transform, transform_all};
use super::values::{integers, vectors, word};
use super::{Element, Entry, Faces, Meaning, MeshSample, Primvar, Stored, Subset};
use crate::material::{BINDING, BoundMaterial, SOURCE_PATH, STRENGTH, STRONGER};
use crate::write::NORMAL_INDICES;
use crate::{Interpolation, RENDER_MESH_OF};

/// Attributes of meshes that clips may hold.
const IN_CLIPS: [(&str, &str); 6] = [
    ("points", "point3f[]"),
    ("velocities", "vector3f[]"),
    ("normals", "normal3f[]"),
    ("extent", "float3[]"),
    ("faceVertexCounts", "int[]"),
    ("faceVertexIndices", "int[]"),
];

/// A mesh, and where its values come from.
pub(crate) struct Mesh {
    path: String,
    prim: Prim,
    points: AttributeQuery,
    /// Codes of the samples of the points; none when they do not move by themselves.
    point_codes: Vec<f64>,
    face_counts: AttributeQuery,
    face_indices: AttributeQuery,
    /// Whether it has samples of faces.
    faces_move: bool,
    left_handed: bool,
    transform: Transform,
    skin: Option<Skin>,
    instances: Option<Instances>,
}

impl Mesh {
    /// Makes a mesh ready. Notes are what somebody may want to know.
    pub(crate) fn open(reading: &Reading, entry: &Entry, notes: &mut Vec<String>) -> Result<Self, UsdError> {
        let path = entry.prototype.as_ref().map_or(entry.path.as_str(), |prototype| prototype.mesh.as_str());
        let prim = reading.stage.prim(path).map_err(|error| reading.bad(path, error.to_string(), "export it again"))?;
        reading.declare(&prim, &IN_CLIPS)?;
        let [points, face_counts, face_indices] =
            ["points", "faceVertexCounts", "faceVertexIndices"].map(|name| prim.attribute(name).query());
        let moving = |query: &AttributeQuery| Ok::<_, UsdError>(!reading.times(query)?.is_empty());
        let instances =
            entry.prototype.as_ref().map(|prototype| Instances::of(reading, prototype, &prim)).transpose()?;
        let come_and_go = instances.as_ref().map_or(Ok(false), |instances| instances.come_and_go(reading))?;
        let faces_move = moving(&face_counts)? || moving(&face_indices)? || come_and_go;
        let left_handed = reading.word(&prim, "orientation")?.is_some_and(|word| word == "leftHanded");
        let scheme = reading.word(&prim, "subdivisionScheme")?.unwrap_or_else(|| "catmullClark".to_owned());
        if scheme != "none" {
            notes.push(format!(
                "{path} is rendered as a subdivision surface ({scheme}); cloth collides with its cage, the points of \
                 the file"
            ));
        }
        let skin = if entry.skinnable { Skin::of(reading, &prim, notes)? } else { None };
        let has_weights = || reading.ok(prim.attribute("primvars:skel:jointIndices").has_authored_value(), &prim);
        if skin.as_ref().is_none_or(|skin| !skin.has_joints()) && has_weights()? {
            notes.push(format!(
                "{path} has joint weights without effect, as in USD: they need a SkelRoot above it, SkelBindingAPI and \
                 a skeleton"
            ));
        }
        let point_codes = reading.times(&points)?;
        let transform = Transform::of(reading, &prim)?;
        let path = path.to_owned();
        Ok(Self {
            path,
            prim,
            points,
            point_codes,
            face_counts,
            face_indices,
            faces_move,
            left_handed,
            transform,
            skin,
            instances,
        })
    }

    /// Its prim.
    pub(crate) fn prim(&self) -> &Prim {
        &self.prim
    }

    /// Codes at which something of it is stored.
    pub(crate) fn times(&self, reading: &Reading) -> Result<Vec<f64>, UsdError> {
        let mut times = self.point_codes.clone();
        for faces in [&self.face_counts, &self.face_indices] {
            times.extend(reading.times(faces)?);
        }
        if let Some(instances) = &self.instances {
            times.extend(instances.times(reading)?);
            return Ok(times);
        }
        match self.skin.as_ref() {
            Some(skin) => {
                times.extend(skin.times(reading)?);
                if !skin.has_joints() {
                    times.extend(self.transform.times(reading)?);
                }
            }
            None => times.extend(self.transform.times(reading)?),
        }
        Ok(times)
    }

    /// Whether faces may be others from time to time.
    pub(crate) fn faces_move(&self) -> bool {
        self.faces_move
    }

    fn bad(&self, reading: &Reading, what: String) -> UsdError {
        reading.bad(self.path.as_str(), what, "export the mesh again")
    }

    /// Points as stored, in the mesh's own space; linear between samples.
    fn local_points(&self, reading: &Reading, code: f64) -> Result<Vec<[f64; 3]>, UsdError> {
        let after = self.point_codes.partition_point(|sample| *sample < code);
        let next = self.point_codes.get(after).copied();
        let before = after.checked_sub(1).and_then(|index| self.point_codes.get(index)).copied();
        let (Some(from), Some(to)) = (before, next.filter(|next| *next != code)) else {
            return self.sample(reading, code);
        };
        let mut points = self.sample(reading, from)?;
        let others = self.sample(reading, to)?;
        if points.len() != others.len() {
            let what = format!(
                "it has {} points at time code {from} and {} at {to}, so nothing can be interpolated in between",
                points.len(),
                others.len()
            );
            return Err(self.bad(reading, what));
        }
        let share = (code - from) / (to - from);
        for (point, other) in points.iter_mut().zip(&others) {
            *point = std::array::from_fn(|axis| point[axis] + (other[axis] - point[axis]) * share);
        }
        Ok(points)
    }

    fn sample(&self, reading: &Reading, code: f64) -> Result<Vec<[f64; 3]>, UsdError> {
        match reading.value_at(&self.points, code)? {
            None => Err(self.bad(reading, format!("it has no points at time code {code}"))),
            Some(value) => vectors(&value)
                .ok_or_else(|| self.bad(reading, "its points are not a list of points (point3f[])".to_owned())),
        }
    }

    /// Returns the data stored at a time code, where only transforms are between them and the world.
    pub(crate) fn stored(&self, reading: &Reading, code: f64) -> Result<Option<Stored>, UsdError> {
        if self.skin.is_some() || self.instances.is_some() {
            return Ok(None);
        }
        let list = |value: Option<Value>| {
            let found = value.as_ref().and_then(vectors)?;
            Some(found.into_iter().map(|v| v.map(|x| x as f32)).collect::<Vec<_>>())
        };
        let points = reading.value_at(&self.points, code)?;
        let points = list(points).ok_or_else(|| self.bad(reading, format!("it has no points at time code {code}")))?;
        let velocities = list(reading.value_at(&self.prim.attribute("velocities").query(), code)?);
        if let Some(velocities) = velocities.as_ref().filter(|velocities| velocities.len() != points.len()) {
            let (found, wanted) = (velocities.len(), points.len());
            return Err(self.bad(reading, format!("{found} velocities for {wanted} points at time code {code}")));
        }
        let normals = self.prim.attribute("normals");
        let interpolation = metadata(reading, &normals, "interpolation")?.as_ref().and_then(word);
        let at_points = matches!(interpolation.as_deref(), None | Some("vertex" | "varying"));
        let normals = if at_points { list(reading.value_at(&normals.query(), code)?) } else { None };
        let normals = normals.filter(|normals| normals.len() == points.len());
        let extent = list(reading.value_at(&self.prim.attribute("extent").query(), code)?);
        let extent = extent.and_then(|extent| <[[f32; 3]; 2]>::try_from(extent).ok());
        Ok(Some(Stored { points, velocities, normals, extent, to_world: self.to_world(reading, code)? }))
    }

    /// From its own space to the world.
    pub(crate) fn to_world(&self, reading: &Reading, code: f64) -> Result<Matrix, UsdError> {
        self.transform.at(reading, code)
    }

    /// The same where it is all there is, and never changes.
    pub(crate) fn fixed_to_world(&self, reading: &Reading) -> Result<Option<Matrix>, UsdError> {
        match self.skin.is_none() && self.instances.is_none() && self.transform.times(reading)?.is_empty() {
            true => Ok(Some(self.to_world(reading, 0.0)?)),
            false => Ok(None),
        }
    }

    /// Whole numbers of an attribute.
    pub(crate) fn integers(&self, reading: &Reading, name: &str, code: f64) -> Result<Option<Vec<i64>>, UsdError> {
        let value = reading.value_at(&self.prim.attribute(name).query(), code)?;
        Ok(value.as_ref().and_then(super::values::all_integers))
    }

    /// Numbers of an attribute in single precision, those of vectors one after the other.
    pub(crate) fn floats(&self, reading: &Reading, name: &str, code: f64) -> Result<Option<Vec<f32>>, UsdError> {
        let value = reading.value_at(&self.prim.attribute(name).query(), code)?;
        Ok(value.and_then(super::values::floats))
    }

    /// Text of an attribute.
    pub(crate) fn text(&self, reading: &Reading, name: &str) -> Result<Option<String>, UsdError> {
        Ok(reading.value(&self.prim.attribute(name))?.as_ref().and_then(super::values::word))
    }

    /// Points in the world.
    pub(crate) fn points(&self, reading: &Reading, code: f64) -> Result<Vec<[f64; 3]>, UsdError> {
        let mut points = self.local_points(reading, code)?;
        if let Some(instances) = &self.instances {
            let places = instances.at(reading, code, points.len())?;
            let each = |place: &Matrix| points.iter().map(|point| transform_point(*point, place)).collect::<Vec<_>>();
            return Ok(places.iter().flat_map(each).collect());
        }
        if let Some(skin) = &self.skin {
            skin.shape(reading, code, &mut points)?;
            if skin.has_joints() {
                skin.bend(reading, code, &mut points)?;
                return Ok(points);
            }
        }
        transform_all(&mut points, &self.transform.at(reading, code)?);
        Ok(points)
    }

    /// Faces, counter-clockwise in the world as seen from outside, at all places of the mesh.
    pub(crate) fn faces(&self, reading: &Reading, code: f64) -> Result<Faces, UsdError> {
        let (faces, points) = self.stored_faces(reading, code)?;
        Ok(repeat_faces(&faces, points, &self.turned(reading, code, points)?))
    }

    /// Whether faces run the other way in the world than in the file, at each place of the mesh.
    fn turned(&self, reading: &Reading, code: f64, points: usize) -> Result<Vec<bool>, UsdError> {
        let mirrored = match (&self.instances, self.skin.as_ref().filter(|skin| skin.has_joints())) {
            (Some(instances), _) => {
                instances.at(reading, code, points)?.iter().map(|place| determinant(place) < 0.0).collect()
            }
            (None, Some(skin)) => vec![skin.is_mirrored(reading, code)?],
            (None, None) => vec![determinant(&self.transform.at(reading, code)?) < 0.0],
        };
        Ok(mirrored.into_iter().map(|mirrored: bool| mirrored != self.left_handed).collect())
    }

    /// Faces as they are stored, and the number of points.
    fn stored_faces(&self, reading: &Reading, code: f64) -> Result<(Faces, usize), UsdError> {
        let point_count = self.sample(reading, code)?.len();
        let list = |query: &AttributeQuery| -> Result<Vec<i32>, UsdError> {
            let value = reading.value_at(query, code)?;
            let missing =
                || self.bad(reading, format!("`{}` is not a list of whole numbers", query.attribute().name()));
            value.as_ref().and_then(integers).map(<[i32]>::to_vec).ok_or_else(missing)
        };
        let (counts, indices) = (list(&self.face_counts)?, list(&self.face_indices)?);
        if let Some((face, count)) = counts.iter().enumerate().find(|(_, count)| **count < 3) {
            return Err(self.bad(reading, format!("face {face} has {count} corners; at least 3 are needed")));
        }
        let corners: u64 = counts.iter().map(|count| count.unsigned_abs() as u64).sum();
        if corners != indices.len() as u64 {
            let what = format!("its faces have {corners} corners, but faceVertexIndices has {} values", indices.len());
            return Err(self.bad(reading, what));
        }
        let outside = |index: &i32| usize::try_from(*index).map_or(true, |index| index >= point_count);
        if let Some((corner, index)) = indices.iter().enumerate().find(|(_, index)| outside(index)) {
            let what = format!("corner {corner} is point {index}, but the mesh has {point_count} points");
            return Err(self.bad(reading, what));
        }
        let faces = Faces {
            counts: counts.into_iter().map(i32::unsigned_abs).collect(),
            indices: indices.into_iter().map(i32::unsigned_abs).collect(),
        };
        Ok((faces, point_count))
    }

    /// The mesh with what is handed through.
    pub(crate) fn read(&self, reading: &Reading, code: f64) -> Result<MeshSample, UsdError> {
        let (stored, point_count) = self.stored_faces(reading, code)?;
        let turned = self.turned(reading, code, point_count)?;
        let mut primvars = primvars::read(reading, &self.prim, code)?;
        primvars.retain(|primvar| primvars::unfitting(primvar, &stored, point_count).is_none());
        let subdivision = reading.word(&self.prim, "subdivisionScheme")?.unwrap_or_else(|| "catmullClark".to_owned());
        let normals = self.split_normals(reading, code, (&subdivision, &primvars))?;
        let primvars = primvars.into_iter();
        let mut subsets = self.subsets(reading, code, stored.counts.len())?;
        subsets.iter_mut().for_each(|subset| repeat_subset(subset, stored.counts.len(), turned.len()));
        Ok(MeshSample {
            subsets,
            faces: repeat_faces(&stored, point_count, &turned),
            points: self.points(reading, code)?,
            primvars: primvars.filter_map(|primvar| repeat_primvar(primvar, &stored.counts, &turned)).collect(),
            normals: normals.and_then(|normals| repeat_primvar(normals, &stored.counts, &turned)),
            subdivision,
            material: material(reading, &self.prim, true)?,
            double_sided: match reading.value(&self.prim.attribute("doubleSided"))? {
                Some(Value::Bool(both)) => Some(both),
                _ => None,
            },
            render_mesh_of: reading.word(&self.prim, RENDER_MESH_OF)?,
        })
    }

    /// Primvars that are not read, as they have too few or too many values.
    pub(crate) fn unfitting_primvars(&self, reading: &Reading, code: f64) -> Result<Vec<String>, UsdError> {
        let primvars = primvars::read(reading, &self.prim, code)?;
        // A mesh that contradicts itself says so where it is read.
        let Ok((faces, points)) = self.stored_faces(reading, code) else { return Ok(Vec::new()) };
        Ok(primvars.iter().filter_map(|primvar| primvars::unfitting(primvar, &faces, points)).collect())
    }

    /// Normals that tell hard edges: of face corners or faces. Those of a subdivision surface have no effect in USD.
    fn split_normals(
        &self,
        reading: &Reading,
        code: f64,
        (subdivision, primvars): (&str, &[Primvar]),
    ) -> Result<Option<Primvar>, UsdError> {
        let plain = Primvar {
            name: "normals".to_owned(),
            interpolation: Interpolation::FaceVarying,
            element: Element::I32,
            extent: 1,
            meaning: Meaning::Numbers,
            values: Vec::new(),
            indices: None,
        };
        if let Some(numbers) = self.integers(reading, NORMAL_INDICES.0, code)? {
            let values = numbers.iter().flat_map(|number| (*number as i32).to_le_bytes()).collect();
            return Ok(Some(Primvar { values, ..plain }));
        }
        let split = [Interpolation::FaceVarying, Interpolation::Uniform];
        let is_vector = |primvar: &&Primvar| (primvar.element, primvar.extent) == (Element::F32, 3);
        if subdivision != "none" {
            return Ok(None);
        }
        // They count more than the attribute.
        if let Some(normals) = primvars.iter().find(|primvar| primvar.name == plain.name) {
            return Ok(Some(normals)
                .filter(is_vector)
                .filter(|normals| split.contains(&normals.interpolation))
                .cloned());
        }
        let attribute = self.prim.attribute("normals");
        let word = metadata(reading, &attribute, "interpolation")?.as_ref().and_then(word);
        let interpolation = split.into_iter().find(|each| word.as_deref() == Some(each.word()));
        let Some(interpolation) = interpolation else { return Ok(None) };
        let value = reading.value_at(&attribute.query(), code)?;
        let Some(all) = value.as_ref().and_then(vectors) else { return Ok(None) };
        let values = all.iter().flatten().flat_map(|number| (*number as f32).to_le_bytes()).collect();
        Ok(Some(Primvar { interpolation, element: Element::F32, extent: 3, meaning: Meaning::Normal, values, ..plain }))
    }

    fn subsets(&self, reading: &Reading, code: f64, faces: usize) -> Result<Vec<Subset>, UsdError> {
        let mut subsets = Vec::new();
        for prim in reading.ok(self.prim.children(), &self.prim)? {
            let of_faces = || Ok::<_, UsdError>(reading.word(&prim, "elementType")?.is_none_or(|word| word == "face"));
            if reading.kind(&prim)? != "GeomSubset" || !of_faces()? {
                continue;
            }
            let Some(value) = reading.value_at(&prim.attribute("indices").query(), code)? else { continue };
            let wrong = |what: String| reading.bad(prim.path().as_str(), what, "export the mesh again");
            let listed = integers(&value).ok_or_else(|| wrong("its indices are not a list of faces".to_owned()))?;
            let outside = |face: &&i32| usize::try_from(**face).map_or(true, |face| face >= faces);
            if let Some(face) = listed.iter().find(outside) {
                return Err(wrong(format!("it holds face {face}, but the mesh has {faces} faces")));
            }
            let mut list: Vec<u32> = listed.iter().map(|face| face.unsigned_abs()).collect();
            list.sort_unstable();
            list.dedup();
            let name = prim.path().name().unwrap_or_default().to_owned();
            subsets.push(Subset { name, faces: list, material: material(reading, &prim, false)? });
        }
        Ok(subsets)
    }
}

/// The material that a prim is bound to, or one of its ancestors: the nearest one, unless one above is stronger.
fn material(reading: &Reading, prim: &Prim, inherited: bool) -> Result<Option<BoundMaterial>, UsdError> {
    let mut found: Option<BoundMaterial> = None;
    let mut next = Some(prim.clone());
    while let Some(prim) = next.filter(|prim| prim.path().as_str() != "/") {
        if let Some(bound) = reading.targets(&prim, BINDING)?.first() {
            let strength = reading.ok(prim.relationship(BINDING).get_metadata::<Value>(STRENGTH), &prim)?;
            let is_stronger = strength.as_ref().and_then(word).is_some_and(|word| word == STRONGER);
            if found.is_none() || is_stronger {
                // A path that leads nowhere is a binding all the same.
                let at = reading.stage.prim(bound.as_str()).ok();
                let source = at.and_then(|at| reading.word(&at, SOURCE_PATH).ok().flatten());
                found = Some(BoundMaterial { path: bound.as_str().to_owned(), source, is_stronger });
            }
        }
        next = if inherited { prim.parent() } else { None };
    }
    Ok(found)
}
