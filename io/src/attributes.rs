//! Attributes at the points of a cache, for shading and checks: normals, rest positions, strain, contact and thickness. A scene
//! asks for them in `[output] attributes`.
//!
//! | attribute | each frame | unit | Alembic | USD | HDF5 |
//! |---|---|---|---|---|---|
//! | normals | yes | none | `N` | `normals` | `normals` |
//! | rest positions | no | length of the file | `Pref` | `primvars:rest` | `rest` |
//! | strain | yes | none | `strain` | `primvars:strain` | `strain` |
//! | contact | yes | none | `contact` | `primvars:contact` | `contact` |
//! | thickness | no | length of the file | `thickness` | `primvars:thickness` | `thickness` |

use std::sync::Arc;

use drapery_core::Vec3;

use crate::error::IoError;
use crate::garment_mesh::{GarmentMesh, triangles_of};
use crate::mesh_data::{Connectivity, DataType, MeshData, MeshParam, PodType, Scope};
use crate::normals::{self, SplitNormals};
use crate::units::Units;

/// An attribute that a scene can ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Attribute {
    /// Normals, smooth but for hard edges.
    Normals,
    /// Positions at rest.
    Rest,
    /// Greatest strain of the edges at a point.
    Strain,
    /// Contact with bodies and other cloth, from 0 to 1.
    Contact,
    /// Thickness of the fabric.
    Thickness,
}

/// Name of the strain in every format.
pub(crate) const STRAIN: &str = "strain";

/// Name of the contact in every format.
pub(crate) const CONTACT: &str = "contact";

/// Name of the thickness in every format.
pub(crate) const THICKNESS: &str = "thickness";

/// Name of the rest positions in USD and HDF5.
pub(crate) const REST: &str = "rest";

/// Name of the rest positions in Alembic, by which Maya, Katana and renderers know them.
pub(crate) const PREF: &str = "Pref";

/// List in a cache of its attributes that are this program's: a mesh may have others of the same names.
pub(crate) const LISTED: &str = "attributes";

impl Attribute {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Normals, Self::Rest, Self::Strain, Self::Contact, Self::Thickness];

    /// Its word in the scene file.
    pub fn word(self) -> &'static str {
        match self {
            Self::Normals => "normals",
            Self::Rest => REST,
            Self::Strain => STRAIN,
            Self::Contact => CONTACT,
            Self::Thickness => THICKNESS,
        }
    }

    /// Bytes of one value.
    pub fn bytes(self) -> usize {
        match self {
            Self::Normals | Self::Rest => size_of::<[f32; 3]>(),
            Self::Strain | Self::Contact | Self::Thickness => size_of::<f32>(),
        }
    }

    /// Whether it has one value for all frames.
    pub fn is_still(self) -> bool {
        matches!(self, Self::Rest | Self::Thickness)
    }
}

/// Attributes of a cache beside its normals; none by default.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointAttributes {
    /// Rest positions, in the unit and axes of the file and counted from its origin, as positions are.
    pub rest: Option<Arc<[[f32; 3]]>>,
    /// Thickness in the unit of the file.
    pub thickness: Option<Arc<[f32]>>,
    /// Whether frames come with strain.
    pub strain: bool,
    /// Whether frames come with contact.
    pub contact: bool,
}

/// Attributes of one sample, one number for each point; empty where the cache has none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PointValues<'a> {
    /// Greatest strain of the edges at each point: length over rest length, less one.
    pub strain: &'a [f32],
    /// Contact of each point, from 0 to 1.
    pub contact: &'a [f32],
}

/// The same, read back; `None` where the cache has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StoredValues {
    /// Strain.
    pub strain: Option<Vec<f32>>,
    /// Contact.
    pub contact: Option<Vec<f32>>,
}

impl StoredValues {
    /// Reads those that a cache has, by their names.
    ///
    /// # Errors
    /// The error of `read`.
    pub(crate) fn read<E>(
        attributes: &PointAttributes,
        mut read: impl FnMut(&'static str) -> Result<Vec<f32>, E>,
    ) -> Result<Self, E> {
        Ok(Self {
            strain: attributes.strain.then(|| read(STRAIN)).transpose()?,
            contact: attributes.contact.then(|| read(CONTACT)).transpose()?,
        })
    }

    /// The values that are there, with their names.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &[f32])> {
        [(STRAIN, self.strain.as_deref()), (CONTACT, self.contact.as_deref())]
            .into_iter()
            .filter_map(|(name, values)| Some((name, values?)))
    }

    /// The values in the form in which they are written.
    pub fn values(&self) -> PointValues<'_> {
        PointValues {
            strain: self.strain.as_deref().unwrap_or_default(),
            contact: self.contact.as_deref().unwrap_or_default(),
        }
    }
}

impl PointAttributes {
    /// Names of the numbers that come with every frame.
    pub(crate) fn moving(&self) -> impl Iterator<Item = &'static str> {
        [self.strain.then_some(STRAIN), self.contact.then_some(CONTACT)].into_iter().flatten()
    }

    /// The numbers that come with a frame, with their names.
    pub(crate) fn moving_of<'a>(&self, values: PointValues<'a>) -> Vec<(&'static str, &'a [f32])> {
        self.moving().map(|name| (name, if name == STRAIN { values.strain } else { values.contact })).collect()
    }

    /// Words of all of them, as a cache lists them; `None` if there are none.
    pub(crate) fn listed(&self) -> Option<String> {
        let still = [(self.rest.is_some(), REST), (self.thickness.is_some(), THICKNESS)];
        let still = still.into_iter().filter_map(|(is_there, word)| is_there.then_some(word));
        let words: Vec<&str> = still.chain(self.moving()).collect();
        (!words.is_empty()).then(|| words.join(" "))
    }

    /// The attributes that a cache lists; `rest` and `thickness` read what does not move.
    ///
    /// # Errors
    /// The error of these.
    pub(crate) fn of_listed<E>(
        listed: &str,
        rest: impl FnOnce() -> Result<Vec<[f32; 3]>, E>,
        thickness: impl FnOnce() -> Result<Vec<f32>, E>,
    ) -> Result<Self, E> {
        let has = |word: &str| listed.split(' ').any(|listed| listed == word);
        Ok(Self {
            rest: has(REST).then(|| rest().map(Arc::from)).transpose()?,
            thickness: has(THICKNESS).then(|| thickness().map(Arc::from)).transpose()?,
            strain: has(STRAIN),
            contact: has(CONTACT),
        })
    }

    /// Whether one of them has this name in a file; `rest` is the name of rest positions there.
    pub(crate) fn has(&self, name: &str, rest: &str) -> bool {
        (self.rest.is_some() && name == rest)
            || (self.thickness.is_some() && name == THICKNESS)
            || self.moving().any(|moving| moving == name)
    }

    /// Adds what does not move to what is handed through of a mesh, which has no others of the same names then; `rest` is the name of
    /// rest positions in the format.
    pub(crate) fn add_to(&self, data: &mut MeshData, rest: &str) {
        data.params.retain(|param| !self.has(&param.name, rest));
        let mut add = |name: &str, extent: u8, interpretation: &str, numbers: &[f32]| {
            data.params.push(MeshParam {
                name: name.to_owned(),
                scope: Scope::Vertex,
                data_type: DataType::new(PodType::F32, extent),
                interpretation: interpretation.to_owned(),
                source_name: None,
                values: numbers.iter().flat_map(|number| number.to_le_bytes()).collect(),
                indices: None,
            });
        };
        if let Some(all) = &self.rest {
            add(rest, 3, "point", all.as_flattened());
        }
        if let Some(all) = &self.thickness {
            add(THICKNESS, 1, "", all);
        }
    }

    /// The same in another unit and axis, counted from another origin [m].
    #[must_use]
    pub(crate) fn converted(&self, (from, from_origin): (Units, Vec3), (to, to_origin): (Units, Vec3)) -> Self {
        if (from, from_origin) == (to, to_origin) {
            return self.clone();
        }
        let rest = |at: &[f32; 3]| to.stored_from(to_origin, from.to_si(Vec3::from(at.map(f64::from))) + from_origin);
        let thickness = |h: &f32| (f64::from(*h) * from.length.metres() / to.length.metres()) as f32;
        Self {
            rest: self.rest.as_ref().map(|all| all.iter().map(rest).collect()),
            thickness: self.thickness.as_ref().map(|all| all.iter().map(thickness).collect()),
            ..*self
        }
    }
}

/// Rest positions of a mesh [m] as a cache in `units` that counts positions from `origin` [m] stores them.
///
/// # Errors
/// The mesh cannot be read.
pub fn rest_positions(mesh: &GarmentMesh, (units, origin): (Units, Vec3)) -> Result<Arc<[[f32; 3]]>, IoError> {
    Ok(mesh.positions()?.into_iter().map(|x| units.stored_from(origin, x)).collect())
}

/// The edges of the triangles that are simulated, with their lengths at rest.
#[derive(Debug, Clone)]
pub struct RestEdges(Vec<([u32; 2], f64)>);

impl RestEdges {
    /// The edges of a mesh at rest [m].
    pub fn of(data: &MeshData) -> Self {
        let points = &data.mesh.points;
        let sides = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]);
        let mut edges: Vec<[u32; 2]> = triangles_of(data).into_iter().flat_map(sides).collect();
        edges.sort_unstable();
        edges.dedup();
        let length = |[a, b]: [u32; 2]| (points[a as usize] - points[b as usize]).norm();
        Self(edges.into_iter().map(|edge| (edge, length(edge))).filter(|(_, length)| *length > 0.0).collect())
    }

    /// The greatest strain of the edges at each point, of positions as a file in a unit of `metres` stores them: length over length
    /// at rest, less one. Zero at a point without edges. They follow from these positions by sums, products, quotients and roots
    /// alone: on any machine they are the same.
    pub fn strain(&self, positions: &[[f32; 3]], metres: f64) -> Vec<f32> {
        let mut greatest = vec![f64::NEG_INFINITY; positions.len()];
        for ([a, b], rest) in &self.0 {
            let [p, q] = [a, b].map(|v| Vec3::from(positions[*v as usize].map(f64::from)));
            let strain = (p - q).norm() * metres / rest - 1.0;
            [a, b].into_iter().for_each(|v| greatest[*v as usize] = greatest[*v as usize].max(strain));
        }
        greatest.into_iter().map(|strain| if strain.is_finite() { strain as f32 } else { 0.0 }).collect()
    }
}

/// The attributes of a garment that follow from its positions as they are stored: normals and strain.
#[derive(Debug, Clone, Default)]
pub struct FromPositions {
    faces: Option<(Connectivity, Option<SplitNormals>)>,
    edges: Option<RestEdges>,
}

impl FromPositions {
    /// The attributes that are asked for, of a mesh at rest. Nothing is read if none is.
    ///
    /// # Errors
    /// The mesh cannot be read.
    pub fn new(mesh: &GarmentMesh, normals: bool, strain: bool) -> Result<Self, IoError> {
        if !(normals || strain) {
            return Ok(Self::default());
        }
        let data = mesh.read()?;
        let edges = strain.then(|| RestEdges::of(&data));
        let (face_counts, face_indices) = (data.mesh.face_counts, data.mesh.face_indices);
        let faces = normals.then_some((Connectivity { face_counts, face_indices }, data.split_normals));
        Ok(Self { faces, edges })
    }

    /// Normals at the points, or those that hard edges split; none if they are not asked for.
    pub fn normals(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let Some((faces, split)) = &self.faces else { return Vec::new() };
        normals::of_faces((&faces.face_counts, &faces.face_indices), split.as_ref(), positions)
    }

    /// Whether strain is asked for.
    pub fn has_strain(&self) -> bool {
        self.edges.is_some()
    }

    /// Strain at the points, of positions in a unit of `metres`; none if it is not asked for.
    pub fn strain(&self, positions: &[[f32; 3]], metres: f64) -> Vec<f32> {
        self.edges.as_ref().map_or_else(Vec::new, |edges| edges.strain(positions, metres))
    }
}

#[cfg(test)]
mod tests {
    use drapery_core::mesh::PolygonMesh;

    use super::*;
    use crate::units::{LengthUnit, UpAxis};

    #[test]
    fn strain_is_that_of_the_most_stretched_edge_at_each_point() {
        let rest = vec![Vec3::zeros(), Vec3::x(), Vec3::new(0.0, 2.0, 0.0), Vec3::new(9.0, 0.0, 0.0)];
        let edges = RestEdges::of(&MeshData::new(PolygonMesh::from_triangles(rest, &[[0, 1, 2]])));
        // In centimetres: the first edge is 25 % longer, the second as long, the third the hypotenuse.
        let strain = edges.strain(&[[0.0; 3], [125.0, 0.0, 0.0], [0.0, 200.0, 0.0], [900.0, 0.0, 0.0]], 0.01);
        let hypotenuse = ((1.25_f64 * 1.25 + 4.0).sqrt() / 5.0_f64.sqrt() - 1.0) as f32;
        assert_eq!(strain, [0.25, 0.25, hypotenuse, 0.0]);
    }

    #[test]
    fn attributes_take_the_place_of_others_of_their_names_and_are_found_by_their_list() {
        let of_source = |name: &str| MeshParam {
            name: name.into(),
            scope: Scope::Vertex,
            data_type: DataType::new(PodType::F32, 1),
            interpretation: String::new(),
            source_name: None,
            values: Vec::new(),
            indices: None,
        };
        let mut data = MeshData { params: ["Pref", "strain", "wear"].map(of_source).into(), ..MeshData::default() };
        let rest: Arc<[[f32; 3]]> = Arc::from([[1.0, 2.0, 3.0]]);
        let all = PointAttributes { rest: Some(Arc::clone(&rest)), strain: true, ..PointAttributes::default() };
        all.add_to(&mut data, PREF);
        let names: Vec<&str> = data.params.iter().map(|param| param.name.as_str()).collect();
        assert_eq!(names, ["wear", "Pref"]);
        let listed = all.listed().unwrap();
        let found = PointAttributes::of_listed(&listed, || Ok::<_, ()>(rest.to_vec()), || Err(())).unwrap();
        assert_eq!((listed.as_str(), found), ("rest strain", all));
        assert_eq!(PointAttributes::default().listed(), None);
    }

    #[test]
    fn rest_positions_and_thickness_go_into_other_units_as_positions_and_lengths_do() {
        let thickness: Arc<[f32]> = Arc::from([0.001]);
        let rest: Arc<[[f32; 3]]> = Arc::from([[1.0, 2.0, 3.0]]);
        let all = PointAttributes { rest: Some(rest), thickness: Some(thickness), ..PointAttributes::default() };
        let centimetres = Units { length: LengthUnit::Centimetre, up: UpAxis::Z };
        let converted = all.converted((Units::SI, Vec3::x()), (centimetres, Vec3::zeros()));
        assert_eq!(converted.rest.as_deref(), Some(&[[200.0, -300.0, 200.0]][..]));
        assert_eq!(converted.thickness.as_deref(), Some(&[0.1][..]));
        assert_eq!(converted.converted((centimetres, Vec3::zeros()), (Units::SI, Vec3::x())).rest, all.rest);
    }
}
