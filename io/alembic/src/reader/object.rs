//! Objects of an open archive.

use std::sync::Arc;

use super::open_file::{Node, Shared};
use super::properties::{Compound, Samples};
use crate::error::AlembicError;
use crate::geom::Visibility;
use crate::metadata::MetaData;
use crate::property::{DataType, PodType};

/// Kind of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Schema {
    /// Polygon mesh.
    PolyMesh,
    /// Subdivision surface; readable as a polygon mesh.
    SubD,
    /// Transform.
    Xform,
    /// Named group of faces of the parent mesh.
    FaceSet,
    /// Point cloud.
    Points,
    /// Curves.
    Curves,
    /// Camera.
    Camera,
    /// No schema: a plain group.
    Group,
    /// Instance whose source is not in the file.
    DanglingInstance,
    /// A schema unknown to this crate; see [`Object::schema_name`].
    Other,
}

/// An object of an open archive. Copies are cheap.
#[derive(Debug, Clone)]
pub struct Object {
    pub(super) shared: Arc<Shared>,
    pub(super) index: usize,
}

impl Object {
    fn node(&self) -> &Node {
        &self.shared.nodes[self.index]
    }

    fn other(&self, index: usize) -> Object {
        Object { shared: self.shared.clone(), index }
    }

    /// Name, unique among siblings.
    pub fn name(&self) -> &str {
        &self.node().name
    }

    /// Full path, such as `/body/bodyShape`.
    pub fn path(&self) -> &str {
        &self.node().path
    }

    /// Metadata; of an instance, that of its source.
    pub fn metadata(&self) -> &MetaData {
        &self.node().metadata
    }

    /// Name of the schema as stored, such as `AbcGeom_PolyMesh_v1`; empty for a plain group.
    pub fn schema_name(&self) -> &str {
        self.metadata().get("schema").unwrap_or_default()
    }

    /// Kind of the object.
    pub fn schema(&self) -> Schema {
        match self.schema_name() {
            "AbcGeom_PolyMesh_v1" => Schema::PolyMesh,
            "AbcGeom_SubD_v1" => Schema::SubD,
            "AbcGeom_Xform_v3" => Schema::Xform,
            "AbcGeom_FaceSet_v1" => Schema::FaceSet,
            "AbcGeom_Points_v1" => Schema::Points,
            "AbcGeom_Curve_v2" => Schema::Curves,
            "AbcGeom_Camera_v1" => Schema::Camera,
            "" if self.metadata().get("isInstance") == Some("1") => Schema::DanglingInstance,
            "" => Schema::Group,
            _ => Schema::Other,
        }
    }

    /// Path of the source when this object is an instance.
    pub fn instance_of(&self) -> Option<&str> {
        self.node().instance_of.as_deref()
    }

    /// Parent object; none for the top object.
    pub fn parent(&self) -> Option<Object> {
        self.node().parent.map(|index| self.other(index))
    }

    /// Child objects in stored order.
    pub fn children(&self) -> impl Iterator<Item = Object> + '_ {
        self.node().children.iter().map(|&index| self.other(index))
    }

    /// The top compound. Reads all property headers of the object.
    pub fn properties(&self) -> Result<Compound, AlembicError> {
        Compound::of_group(&self.shared, self.node().group, self.path())
    }

    /// Value of `visible` at `time` (s); inherited when there is none.
    pub fn visibility_at(&self, time: f64) -> Result<Visibility, AlembicError> {
        let properties = self.properties()?;
        let Some(samples) = visible(&properties) else { return Ok(Visibility::Inherited) };
        let value = samples.values::<i8>(samples.floor_index(time))?;
        Ok(value.first().map_or(Visibility::Inherited, |&value| Visibility::from_value(value)))
    }

    /// Whether it is hidden at all times: the nearest of it and its parents that does not inherit its visibility says so.
    pub fn is_hidden(&self) -> Result<bool, AlembicError> {
        let line: Vec<Object> = std::iter::successors(Some(self.clone()), Object::parent).collect();
        let mut times = Vec::new();
        for object in &line {
            let properties = object.properties()?;
            if let Some(samples) = visible(&properties) {
                times.extend((0..samples.len()).map(|index| samples.time_sampling().time(index)));
            }
        }
        for time in &times {
            let mut seen = Visibility::Inherited;
            for object in &line {
                if seen == Visibility::Inherited {
                    seen = object.visibility_at(*time)?;
                }
            }
            if seen != Visibility::Hidden {
                return Ok(false);
            }
        }
        Ok(!times.is_empty())
    }

    /// The compound of the schema, with the message for an object of another kind.
    pub(super) fn schema_compound(&self, name: &str, wanted: &str) -> Result<Compound, AlembicError> {
        let properties = self.properties()?;
        properties.compound(name).cloned().ok_or_else(|| {
            let reason = match self.instance_of() {
                Some(source) => format!("an instance of `{source}`, which is not in the file or has no `{name}`"),
                None => format!("not a {wanted}: it has no `{name}` compound (schema `{}`)", self.schema_name()),
            };
            self.missing("", reason, &format!("choose an object that is a {wanted}"))
        })
    }

    pub(super) fn missing(&self, property: &str, reason: String, help: &str) -> AlembicError {
        let place = if property.is_empty() { self.path().to_owned() } else { format!("{}:{property}", self.path()) };
        AlembicError::Missing { path: self.shared.source.path.clone(), place, reason, help: help.to_owned() }
    }

    pub(super) fn damaged(&self, property: &str, reason: String) -> AlembicError {
        let place = if property.is_empty() { self.path().to_owned() } else { format!("{}:{property}", self.path()) };
        AlembicError::Damaged { path: self.shared.source.path.clone(), place, reason }
    }
}

/// The samples of `visible` of an object, if it has any of the type that the format gives it.
fn visible(properties: &Compound) -> Option<&Samples> {
    let is_char = |samples: &&Samples| samples.data_type() == DataType::new(PodType::I8, 1);
    properties.samples("visible").filter(is_char).filter(|samples| !samples.is_empty())
}
