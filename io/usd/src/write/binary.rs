//! A binary layer being put together: prims and properties in the order in which they are declared.

use std::io::{Cursor, Seek, Write};

use openusd::sdf::{self, AbstractData, ChildrenKey, Data, FieldKey, Path, SpecType, Specifier, Value};
use openusd::tf::Token;
use openusd::usdc::CrateWriter;

use super::Units;

/// Why a layer could not be put together.
#[derive(Debug, thiserror::Error)]
#[error("{place}: {what}")]
pub struct WriteError {
    /// The prim or property.
    pub place: String,
    /// Description of the fault.
    pub what: String,
}

/// A binary layer.
pub(super) struct BinaryLayer {
    data: Data,
}

/// A prim of the layer.
#[derive(Debug, Clone)]
pub(super) struct Prim {
    path: Path,
}

/// Declaration of a property beside its name and type.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Declared<'a> {
    /// It has one value for all times.
    pub(super) uniform: bool,
    /// No schema knows it.
    pub(super) custom: bool,
    /// Part of the mesh that a value of a primvar belongs to.
    pub(super) interpolation: Option<&'a str>,
    /// Count of numbers in one value of a primvar, where its type does not say.
    pub(super) element_size: Option<i32>,
}

impl BinaryLayer {
    /// A layer without prims.
    pub(super) fn new(units: Units, default_prim: &str) -> Self {
        let mut data = Data::new();
        let root = data.create_spec(Path::abs_root(), SpecType::PseudoRoot);
        root.add(FieldKey::DefaultPrim, token(default_prim));
        root.add(FieldKey::TimeCodesPerSecond, Value::Double(units.time_codes_per_second));
        root.add(FieldKey::FramesPerSecond, Value::Double(units.time_codes_per_second));
        root.add("metersPerUnit", Value::Double(units.metres_per_unit));
        root.add("upAxis", token(units.up_axis()));
        Self { data }
    }

    /// The pseudo-root, parent of root prims.
    pub(super) fn root(&self) -> Prim {
        Prim { path: Path::abs_root() }
    }

    /// Adds a child if there is none of this name: defined with its type, or an opinion over a prim of another layer without one.
    pub(super) fn prim(&mut self, parent: &Prim, name: &str, kind: Option<&str>) -> Result<Prim, WriteError> {
        let path = parent.path.append_path(name).map_err(|e| refused(&format!("{}/{name}", parent.path), &e))?;
        if self.data.has_spec(&path) {
            return Ok(Prim { path });
        }
        self.append_name(&parent.path, ChildrenKey::PrimChildren, name);
        let spec = self.data.create_spec(path.clone(), SpecType::Prim);
        let specifier = if kind.is_some() { Specifier::Def } else { Specifier::Over };
        spec.add(FieldKey::Specifier, Value::Specifier(specifier));
        if let Some(kind) = kind {
            spec.add(FieldKey::TypeName, token(kind));
        }
        Ok(Prim { path })
    }

    /// Sets a field of a property that is declared.
    pub(super) fn property_field(
        &mut self,
        prim: &Prim,
        name: &str,
        (field, value): (&str, Value),
    ) -> Result<(), WriteError> {
        let path = prim.path.append_property(name).map_err(|e| refused(name, &e))?;
        self.data.set_field(&path, field, value);
        Ok(())
    }

    /// Type of the prim at a path, if there is one.
    pub(super) fn kind_at(&self, path: &str) -> Option<String> {
        let path = Path::new(path).ok()?;
        match self.data.spec(&path)?.get(FieldKey::TypeName.as_str()) {
            Some(Value::Token(kind)) => Some(kind.as_str().to_owned()),
            _ => Some(String::new()),
        }
    }

    /// The text that an attribute of the prim at a path has for all times.
    pub(super) fn text_at(&self, path: &str, name: &str) -> Option<String> {
        let path = Path::new(path).ok()?.append_property(name).ok()?;
        match self.data.spec(&path)?.get(FieldKey::Default.as_str()) {
            Some(Value::String(text)) => Some(text.clone()),
            _ => None,
        }
    }

    /// Names of the children of a prim.
    pub(super) fn children(&self, prim: &Prim) -> Vec<String> {
        let names = self.data.spec(&prim.path).and_then(|spec| spec.get(ChildrenKey::PrimChildren.as_str()));
        match names {
            Some(Value::TokenVec(names)) => names.iter().map(|name| name.as_str().to_owned()).collect(),
            _ => Vec::new(),
        }
    }

    /// Sets a field of a prim.
    pub(super) fn field(&mut self, prim: &Prim, name: &str, value: Value) {
        self.data.set_field(&prim.path, name, value);
    }

    /// Adds an attribute with a value for all times, or none.
    pub(super) fn attribute(
        &mut self,
        prim: &Prim,
        (name, kind): (&str, &str),
        declared: Declared<'_>,
        value: Option<Value>,
    ) -> Result<(), WriteError> {
        let path = self.property(prim, name, SpecType::Attribute)?;
        let mut add = |key: &str, value| self.data.set_field(&path, key, value);
        add(FieldKey::TypeName.as_str(), token(kind));
        if declared.uniform {
            add(FieldKey::Variability.as_str(), Value::Variability(sdf::Variability::Uniform));
        }
        if declared.custom {
            add(FieldKey::Custom.as_str(), Value::Bool(true));
        }
        if let Some(interpolation) = declared.interpolation {
            add("interpolation", token(interpolation));
        }
        if let Some(size) = declared.element_size {
            add("elementSize", Value::Int(size));
        }
        if let Some(value) = value {
            add(FieldKey::Default.as_str(), value);
        }
        Ok(())
    }

    /// Adds an attribute with one sample.
    pub(super) fn sample(
        &mut self,
        prim: &Prim,
        (name, kind): (&str, &str),
        declared: Declared<'_>,
        (time, value): (f64, Value),
    ) -> Result<(), WriteError> {
        self.attribute(prim, (name, kind), declared, None)?;
        let path = prim.path.append_property(name).map_err(|e| refused(name, &e))?;
        self.data.set_field(&path, FieldKey::TimeSamples.as_str(), Value::TimeSamples(vec![(time, value)]));
        Ok(())
    }

    /// Adds a sample to an attribute that is declared; they come in the order of their times.
    pub(super) fn append_sample(&mut self, prim: &Prim, name: &str, sample: (f64, Value)) -> Result<(), WriteError> {
        let path = prim.path.append_property(name).map_err(|e| refused(name, &e))?;
        let Some(spec) = self.data.spec_mut(&path) else { return Ok(()) };
        match spec.get_mut(FieldKey::TimeSamples.as_str()) {
            Some(Value::TimeSamples(samples)) => samples.push(sample),
            _ => spec.add(FieldKey::TimeSamples, Value::TimeSamples(vec![sample])),
        }
        Ok(())
    }

    /// Adds a relationship to one prim.
    pub(super) fn relationship(&mut self, prim: &Prim, name: &str, target: &str) -> Result<(), WriteError> {
        let target = Path::new(target).map_err(|e| refused(target, &e))?;
        let path = self.property(prim, name, SpecType::Relationship)?;
        let targets = sdf::ListOp::explicit([target]);
        self.data.set_field(&path, FieldKey::TargetPaths.as_str(), Value::PathListOp(targets));
        Ok(())
    }

    /// The file.
    pub(super) fn bytes(&self) -> Result<Vec<u8>, WriteError> {
        let mut file = Cursor::new(Vec::new());
        self.write(&mut file)?;
        Ok(file.into_inner())
    }

    /// Writes the file.
    pub(super) fn write(&self, out: &mut (impl Write + Seek)) -> Result<(), WriteError> {
        CrateWriter::write(&self.data, out).map_err(|e| refused("layer", &e))
    }

    fn property(&mut self, prim: &Prim, name: &str, kind: SpecType) -> Result<Path, WriteError> {
        let path = prim.path.append_property(name).map_err(|e| refused(&format!("{}.{name}", prim.path), &e))?;
        self.append_name(&prim.path, ChildrenKey::PropertyChildren, name);
        self.data.create_spec(path.clone(), kind);
        Ok(path)
    }

    /// Appends to the names of a prim's children, whose order is that of the file.
    fn append_name(&mut self, parent: &Path, key: ChildrenKey, name: &str) {
        let Some(spec) = self.data.spec_mut(parent) else { return };
        match spec.get_mut(key.as_str()) {
            Some(Value::TokenVec(names)) => names.push(name.into()),
            _ => spec.add(key, Value::TokenVec(vec![name.into()])),
        }
    }
}

/// A token.
pub(super) fn token(text: &str) -> Value {
    Value::Token(Token::from(text))
}

fn refused(place: &str, error: &dyn std::error::Error) -> WriteError {
    WriteError { place: place.to_owned(), what: error.to_string() }
}
