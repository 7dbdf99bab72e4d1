//! Caches as one binary layer, which stands for itself.

use std::fs::File;

use drapery_usd::write::{About, Distinct, MeshPath, Moving, PartOfShot, SingleLayer, WriteError, identifier};

use super::write::{Form, layer_units, purpose_of, still_mesh, write_error};
use crate::cache::{APPLICATION, CacheFrame, CachePlan};
use crate::error::IoError;
use crate::formats::{SingleFormat, SinglePlan, SingleWriter};
use crate::normals::SplitNormals;

/// The format. Positions, velocities and normals are in memory until the layer is written.
pub(super) const SINGLE: SingleFormat =
    SingleFormat { create: |plan| Box::new(Writer::of(plan)), most_bytes: 2_000_000_000 };

/// A layer being put together.
struct Writer<'a> {
    plan: SinglePlan<'a>,
    layer: SingleLayer,
    /// Name of the prim that stands for the layer.
    root: String,
    /// The prim of each mesh.
    paths: Vec<MeshPath>,
    /// Prims right below the root of a shot; none of other layers.
    prims: Vec<String>,
    /// Number of meshes that are in the layer.
    begun: usize,
    /// Normals of the last of them that hard edges split.
    split_normals: Option<SplitNormals>,
}

impl<'a> Writer<'a> {
    /// A layer that says what it is.
    fn of(plan: SinglePlan<'a>) -> Self {
        let mut application = vec![("application", APPLICATION.to_owned())];
        let (mut paths, mut prims) = (Vec::new(), Vec::new());
        let (root, units) = match plan.shot {
            Some(shot) => {
                let (root, mut names) = (identifier(shot.name), Distinct::default());
                for cache in &plan.caches {
                    let prim = names.identifier(cache.garment);
                    paths.push(MeshPath::of(&cache.object_path()).in_shot(&root, &prim));
                    prims.push(prim);
                }
                application.push(("shot", shot.name.to_owned()));
                (root, layer_units(shot.units, shot.fps))
            }
            None => {
                plan.caches.iter().for_each(|cache| paths.push(distinct(&cache.object_path(), &paths)));
                let first = &plan.caches[0];
                let rate = first.timeline;
                application.push(("fps", format!("{}/{}", rate.fps_numerator, rate.fps_denominator)));
                (paths[0].root().to_owned(), layer_units(first.units, first.timeline.fps()))
            }
        };
        let about = About { units, default_prim: &root, frames: plan.frames, properties: &application };
        let layer = SingleLayer::new(&about);
        Self { plan, layer, root, paths, prims, begun: 0, split_normals: None }
    }

    /// Says what the prims of a shot, or the one of all meshes, are.
    fn name_prims(&mut self) -> Result<(), WriteError> {
        let Some(shot) = self.plan.shot else { return self.layer.set_kinds(&self.root, self.paths.len() > 1) };
        self.layer.set_kinds(&self.root, true)?;
        self.layer.set_shot(&self.root, shot.name)?;
        for (prim, cache) in self.prims.iter().zip(&shot.caches) {
            let part = PartOfShot { prim, name: cache.name, purpose: purpose_of(cache.part) };
            self.layer.set_part(&self.root, &part)?;
        }
        Ok(())
    }
}

impl SingleWriter for Writer<'_> {
    fn write(&mut self, mesh: usize, frame: &CacheFrame<'_>) -> Result<(), IoError> {
        let refused = |error: WriteError| write_error(self.plan.path, &error);
        let plan = &self.plan.caches[mesh];
        let CachePlan { velocities, normals, crossings, sub_frames, ref attributes, .. } = *plan;
        if mesh == self.begun {
            let (units, origin) = (plan.units.into(), plan.file_origin());
            let form = Form { units, origin, velocities, normals, crossings, attributes };
            let data = plan.mesh.read()?;
            self.split_normals = data.split_normals.clone();
            self.layer.add_mesh(still_mesh(data, &self.paths[mesh], form)).map_err(refused)?;
            self.begun += 1;
        }
        let behind = frame.sub_frame.checked_sub(1).map_or(0.0, |number| sub_frames[number]);
        let numbers = attributes.moving_of(frame.values);
        let at_corners = self.split_normals.as_ref().map(|split| split.at_corners(frame.normals));
        let moving = Moving {
            time_code: frame.frame as f64 + behind,
            points: frame.positions,
            velocities: velocities.then_some(frame.velocities),
            normals: normals.then_some(at_corners.as_deref().unwrap_or(frame.normals)),
            crossings: frame.crossings,
            numbers: &numbers,
        };
        self.layer.add_frame(&moving).map_err(refused)
    }

    fn finish(&mut self, file: &mut File) -> Result<(), IoError> {
        self.name_prims().map_err(|error| write_error(self.plan.path, &error))?;
        self.layer.write(file).map_err(|e| IoError::writing(self.plan.path, e))
    }
}

/// The path of a mesh as USD spells it; another one where that is taken.
fn distinct(object_path: &str, taken: &[MeshPath]) -> MeshPath {
    let mut path = MeshPath::of(object_path);
    let mut number = 1;
    while taken.contains(&path) {
        number += 1;
        path = MeshPath::of(&format!("{object_path}_{number}"));
    }
    path
}
