//! Meshes with all their frames in one binary layer, which stands for itself.
//!
//! A binary layer can only be written as a whole, so all its numbers are in memory until it is.

use std::collections::HashMap;
use std::io::{BufWriter, Seek, Write};

use openusd::sdf::Value;

use super::Units;
use super::binary::{BinaryLayer, Declared, Prim, WriteError, token};
use super::mesh::{
    CROSSINGS, EXTENT, Moving, NORMALS, NUMBERS, POINTS, StillMesh, VELOCITIES, add_prims, extent, primvar_of, vectors,
};

/// Description that a layer gives of itself.
#[derive(Debug)]
pub struct About<'a> {
    /// Meaning of its numbers.
    pub units: Units,
    /// Name of the prim that stands for it.
    pub default_prim: &'a str,
    /// First and last frame.
    pub frames: [i64; 2],
    /// Provenance, as name and text: how it was made.
    pub properties: &'a [(&'a str, String)],
}

/// Properties stated of a shot's garment or render mesh beside its mesh.
#[derive(Debug)]
pub struct PartOfShot<'a> {
    /// Its prim, below the root.
    pub prim: &'a str,
    /// Its name.
    pub name: &'a str,
    /// Purpose, if it is not for everything: `render` or `proxy`.
    pub purpose: Option<&'static str>,
}

/// A layer being put together.
pub struct SingleLayer {
    layer: BinaryLayer,
    meshes: Vec<Prim>,
}

impl SingleLayer {
    /// A layer without meshes.
    pub fn new(about: &About<'_>) -> Self {
        let mut layer = BinaryLayer::new(about.units, about.default_prim);
        let root = layer.root();
        let [first, last] = about.frames.map(|frame| Value::Double(frame as f64));
        layer.field(&root, "startTimeCode", first);
        layer.field(&root, "endTimeCode", last);
        let texts = about.properties.iter().map(|(name, text)| ((*name).to_owned(), Value::String(text.clone())));
        let ours = Value::Dictionary(texts.collect::<HashMap<_, _>>());
        layer.field(&root, "customLayerData", Value::Dictionary([("drapery".to_owned(), ours)].into()));
        Self { layer, meshes: Vec::new() }
    }

    /// Adds a mesh without frames. Prims above it that are there already are shared.
    ///
    /// # Errors
    /// A name or a material's path is none that USD accepts.
    pub fn add_mesh(&mut self, still: StillMesh<'_>) -> Result<(), WriteError> {
        // Prims above it may be those of other meshes too.
        let shifted = still.path.prims().len() - 1;
        let mesh = add_prims(&mut self.layer, still, shifted)?;
        self.meshes.push(mesh);
        Ok(())
    }

    /// Says what the root is: a component, or, with `several` meshes, an assembly of the components below it.
    ///
    /// # Errors
    /// Never for a root that is there.
    pub fn set_kinds(&mut self, root: &str, several: bool) -> Result<(), WriteError> {
        let prim = self.layer.prim(&self.layer.root(), root, Some("Xform"))?;
        let parts = if several { self.layer.children(&prim) } else { Vec::new() };
        let kind = if parts.is_empty() { "component" } else { "assembly" };
        self.layer.field(&prim, "kind", token(kind));
        for part in parts {
            // What holds materials is no part.
            if self.layer.kind_at(&format!("/{root}/{part}")).as_deref() == Some("Scope") {
                continue;
            }
            let part = self.layer.prim(&prim, &part, Some("Xform"))?;
            self.layer.field(&part, "kind", token("component"));
        }
        Ok(())
    }

    /// Says what the prim of a shot is called, where its own name does not tell.
    ///
    /// # Errors
    /// Never for a root that is there.
    pub fn set_shot(&mut self, root: &str, name: &str) -> Result<(), WriteError> {
        let prim = self.layer.prim(&self.layer.root(), root, Some("Xform"))?;
        self.set_name(&prim, root, name);
        Ok(())
    }

    /// Says what a part of a shot is called and what it is for.
    ///
    /// # Errors
    /// Never for a part that is there.
    pub fn set_part(&mut self, root: &str, part: &PartOfShot<'_>) -> Result<(), WriteError> {
        let root = self.layer.prim(&self.layer.root(), root, Some("Xform"))?;
        let prim = self.layer.prim(&root, part.prim, Some("Xform"))?;
        self.set_name(&prim, part.prim, part.name);
        match part.purpose {
            Some(purpose) => {
                let declared = Declared { uniform: true, ..Declared::default() };
                self.layer.attribute(&prim, ("purpose", "token"), declared, Some(token(purpose)))
            }
            None => Ok(()),
        }
    }

    fn set_name(&mut self, prim: &Prim, identifier: &str, name: &str) {
        if name != identifier {
            self.layer.field(prim, "displayName", Value::String(name.to_owned()));
        }
    }

    /// Adds a frame of the mesh that was added last.
    ///
    /// # Errors
    /// Never for a mesh that has been added.
    pub fn add_frame(&mut self, frame: &Moving<'_>) -> Result<(), WriteError> {
        let Some(mesh) = self.meshes.last() else { return Ok(()) };
        let time = frame.time_code;
        let mut add = |(name, _): (&str, &str), value| self.layer.append_sample(mesh, name, (time, value));
        add(POINTS, vectors(frame.points))?;
        if let Some(velocities) = frame.velocities {
            add(VELOCITIES, vectors(velocities))?;
        }
        if let Some(normals) = frame.normals {
            add(NORMALS, vectors(normals))?;
        }
        add(EXTENT, vectors(&extent(frame.points)))?;
        if let Some(crossings) = frame.crossings {
            add(CROSSINGS, Value::Uint(crossings))?;
        }
        let mut numbers = frame.numbers.iter();
        numbers.try_for_each(|(name, all)| add((&primvar_of(name), NUMBERS), Value::FloatVec(all.to_vec())))
    }

    /// Writes the layer.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn write(&self, out: impl Write + Seek) -> Result<(), std::io::Error> {
        let mut out = BufWriter::new(out);
        self.layer.write(&mut out).map_err(|error| std::io::Error::other(error.what))?;
        out.flush()
    }
}
