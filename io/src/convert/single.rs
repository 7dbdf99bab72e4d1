//! Caches as one binary layer of USD: all meshes of a file with all their frames, or all caches of a shot.

use std::fs::{self, File};
use std::path::Path;

use drapery_core::mesh::MeshStream;
use drapery_usd::write::{
    About, Distinct, MeshPath, Moving, PartOfShot, SingleLayer, Units as LayerUnits, WriteError, identifier,
};

use super::samples::{self, Chosen};
use super::{Conversion, Converted, Work, aside, chosen, described, doubts, opened, plan, rate};
use crate::atomic_file::put;
use crate::cache::{APPLICATION, CachePlan};
use crate::cache_frames::CacheFrames;
use crate::error::IoError;
use crate::formats::ShotFiles;
use crate::formats::usd_writer::{Form, layer_units, purpose_of, still_mesh, write_error};
use crate::garment_mesh::GarmentMesh;

/// Most bytes of positions, velocities and normals of one layer, which are in memory until it is written.
pub(super) const MOST_BYTES: u64 = 2_000_000_000;

/// Bytes of a vector in single precision.
const VECTOR: u64 = 12;

/// Whether a file of this name is such a layer.
pub(super) fn is_asked_for(to: &Path) -> bool {
    to.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("usdc"))
}

/// Bytes that so many vectors take in a layer.
pub(super) fn bytes_of(vectors: u64) -> u64 {
    vectors.saturating_mul(VECTOR)
}

/// A mesh that goes into the layer.
struct Part<'a> {
    work: Work<'a>,
    samples: &'a Chosen,
    path: MeshPath,
}

/// Writes the layer under another name, and gives it its own when it is whole.
pub(super) fn convert(conversion: &Conversion, wrote: &mut dyn FnMut(i64)) -> Result<Converted, IoError> {
    let source = opened(conversion)?;
    let (numerator, denominator) = rate(&source, conversion.fps)?;
    let meshes = match &conversion.object {
        Some(object) => vec![chosen(&source, Some(object))?],
        None => (0..source.meshes().len()).collect(),
    };
    let (mut kept, mut left_out) = (Vec::new(), Vec::new());
    for mesh in meshes {
        let (samples, lacking) = shown(&source, mesh, conversion)?;
        left_out.extend(lacking);
        left_out.extend(source.left_out(mesh)?);
        kept.push((
            mesh,
            GarmentMesh::kept(described(&source, mesh, (samples.all[0].0, conversion.triangles))?),
            samples,
        ));
    }
    if conversion.object.is_none() {
        left_out.extend(source.hidden());
    }
    let garment = conversion.to.file_stem().unwrap_or_default().to_string_lossy();
    let mut parts: Vec<Part<'_>> = Vec::new();
    for (mesh, kept, samples) in &kept {
        let plan = plan(conversion, (&source, *mesh), samples, (&garment, kept))?;
        let path = distinct(&plan.object_path(), &parts);
        parts.push(Part { work: Work { source: &source, mesh: *mesh, plan }, samples, path });
    }
    refuse_too_much(conversion, &parts)?;
    let doubts = doubts(conversion, &source, kept.iter().map(|(mesh, _, samples)| (*mesh, samples)))?;
    let units = layer_units(parts[0].work.plan.units, f64::from(numerator) / f64::from(denominator));
    let fps = format!("{numerator}/{denominator}");
    let properties = [("application", APPLICATION.to_owned()), ("fps", fps)];
    let root = parts[0].path.root();
    let mut layer = begun((units, root), frames_of(&parts), &properties);
    add(&mut layer, &parts, &conversion.to, wrote)?;
    layer.set_kinds(root, parts.len() > 1).map_err(|error| write_error(&conversion.to, &error))?;
    place(&layer, &conversion.to)?;
    let points = parts.iter().map(|part| part.work.source.meshes()[part.work.mesh].points).sum();
    Ok(Converted { frames: frames_of(&parts), points, units: parts[0].work.plan.units, left_out, doubts })
}

/// Writes all caches of a shot, which lie beside `to`, as one layer: prims, attributes and values are those of the shot's stage.
///
/// # Errors
/// A cache cannot be read; there is too much for one layer; the disk refuses. A layer that was there before then stays.
pub(super) fn write_shot(to: &Path, shot: &ShotFiles<'_>) -> Result<(), IoError> {
    let conversion = Conversion { to: to.to_owned(), frames: Some(shot.frames), ..Conversion::default() };
    let mut opened = Vec::new();
    for cache in &shot.caches {
        let source = CacheFrames::open(&to.with_file_name(&cache.file))?;
        let (samples, _) = samples::chosen(&source, 0, Some(shot.frames), to)?;
        let kept = GarmentMesh::kept(described(&source, 0, (samples.all[0].0, false))?);
        opened.push((cache, source, samples, kept));
    }
    let root = identifier(shot.name);
    let (mut names, mut parts, mut about) = (Distinct::default(), Vec::new(), Vec::new());
    for (cache, source, samples, kept) in &opened {
        let plan = plan(&conversion, (source, 0), samples, (cache.name, kept))?;
        let prim = names.identifier(cache.name);
        let path = MeshPath::of(&plan.object_path()).in_shot(&root, &prim);
        parts.push(Part { work: Work { source, mesh: 0, plan }, samples, path });
        about.push((prim, cache));
    }
    refuse_too_much(&conversion, &parts)?;
    let refused = |error: WriteError| write_error(to, &error);
    let properties = [("application", APPLICATION.to_owned()), ("shot", shot.name.to_owned())];
    let mut layer = begun((layer_units(shot.units, shot.fps), &root), shot.frames, &properties);
    add(&mut layer, &parts, to, &mut |_| {})?;
    layer.set_kinds(&root, true).map_err(refused)?;
    layer.set_shot(&root, shot.name).map_err(refused)?;
    for (prim, cache) in &about {
        let part = PartOfShot { prim, name: cache.name, purpose: purpose_of(cache.part) };
        layer.set_part(&root, &part).map_err(refused)?;
    }
    place(&layer, to)
}

/// The samples of a mesh that are written: all that are asked for, and one of what does not move.
fn shown(source: &CacheFrames, mesh: usize, conversion: &Conversion) -> Result<(Chosen, Vec<String>), IoError> {
    if source.moves(mesh) {
        samples::chosen(source, mesh, conversion.frames, &conversion.to)
    } else {
        Ok((samples::still(source, mesh), Vec::new()))
    }
}

/// The path of a mesh as USD spells it; another one where that is taken.
fn distinct(object_path: &str, parts: &[Part<'_>]) -> MeshPath {
    let is_free = |path: &MeshPath| parts.iter().all(|part| part.path != *path);
    let mut path = MeshPath::of(object_path);
    let mut number = 1;
    while !is_free(&path) {
        number += 1;
        path = MeshPath::of(&format!("{object_path}_{number}"));
    }
    path
}

/// First and last frame of what moves, or of all.
fn frames_of(parts: &[Part<'_>]) -> [i64; 2] {
    let moves = parts.iter().any(|part| part.samples.all.len() > 1);
    let plans = parts.iter().filter(|part| !moves || part.samples.all.len() > 1).map(|part| &part.work.plan);
    let (first, last) = (plans.clone().map(|plan| plan.first_frame).min(), plans.map(|plan| plan.last_frame).max());
    [first.unwrap_or_default(), last.unwrap_or_default()]
}

/// Says that a layer would be too large to be held in memory as a whole.
fn refuse_too_much(conversion: &Conversion, parts: &[Part<'_>]) -> Result<(), IoError> {
    let bytes_of = |part: &Part<'_>| {
        let CachePlan { velocities, normals, mesh, .. } = &part.work.plan;
        let vectors = 1 + u64::from(*velocities) + u64::from(*normals);
        let samples = part.samples.all.len() as u64;
        bytes_of((mesh.point_count() as u64).saturating_mul(samples).saturating_mul(vectors))
    };
    let bytes = parts.iter().map(bytes_of).fold(0_u64, u64::saturating_add);
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let (megabytes, most) = (bytes / 1_000_000, MOST_BYTES / 1_000_000);
    let what = format!("positions, velocities and normals take {megabytes} MB, and one layer has at most {most} MB");
    let advice = "choose fewer frames with --frames A-B or one mesh with --object, or write a .usd file: each of its frames is a \
                  layer of its own";
    Err(IoError::data(&conversion.to, "size", what, advice))
}

/// A layer that says what it is.
fn begun((units, root): (LayerUnits, &str), frames: [i64; 2], properties: &[(&str, String)]) -> SingleLayer {
    SingleLayer::new(&About { units, default_prim: root, frames, properties })
}

/// Adds all meshes with all their samples.
fn add(layer: &mut SingleLayer, parts: &[Part<'_>], to: &Path, wrote: &mut dyn FnMut(i64)) -> Result<(), IoError> {
    let refused = |error: WriteError| write_error(to, &error);
    for (index, Part { work, samples, path }) in parts.iter().enumerate() {
        let plan = &work.plan;
        let CachePlan { velocities, normals, crossings, sub_frames, .. } = *plan;
        let form = Form { origin: plan.file_origin(), velocities, normals, crossings };
        layer.add_mesh(still_mesh(plan.mesh.read()?, path, form)).map_err(refused)?;
        work.frames(samples, &mut |frame| {
            let behind = frame.sub_frame.checked_sub(1).map_or(0.0, |number| sub_frames[number]);
            let moving = Moving {
                time_code: frame.frame as f64 + behind,
                points: frame.positions,
                velocities: velocities.then_some(frame.velocities),
                normals: normals.then_some(frame.normals),
                crossings: frame.crossings,
            };
            layer.add_frame(&moving).map_err(refused)?;
            // A frame is there when all meshes have it.
            if index + 1 == parts.len() && frame.sub_frame == 0 {
                wrote(frame.frame);
            }
            Ok(())
        })?;
    }
    Ok(())
}

/// Writes a layer under another name, and gives it its own when it is whole.
fn place(layer: &SingleLayer, to: &Path) -> Result<(), IoError> {
    let aside = aside(to);
    let written = File::create(&aside)
        .map_err(|e| IoError::creating(&aside, e))
        .and_then(|mut file| layer.write(&mut file).and_then(|()| file.sync_all()).map_err(|e| IoError::writing(to, e)))
        .and_then(|()| put(&aside, to));
    if written.is_err() {
        // Half a layer would only confuse; if it cannot be removed either, the first error says why.
        let _ = fs::remove_file(&aside);
    }
    written
}
