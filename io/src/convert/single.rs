//! Caches as one binary layer of USD: all meshes of a file with all their frames.

use std::fs::{self, File};
use std::path::Path;

use drapery_usd::write::{About, MeshPath, Moving, SingleLayer, WriteError};

use super::{Conversion, Converted, Work, aside, chosen, described, plan, rate, samples};
use crate::cache::{APPLICATION, CachePlan};
use crate::cache_frames::CacheFrames;
use crate::error::IoError;
use crate::formats::usd_writer::{Form, layer_units, still_mesh, write_error};
use crate::garment_mesh::GarmentMesh;

/// Most bytes of positions and velocities of one layer, which are in memory until it is written.
const MOST_BYTES: u64 = 2_000_000_000;

/// Whether a file of this name is such a layer.
pub(super) fn is_asked_for(to: &Path) -> bool {
    to.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("usdc"))
}

/// A mesh that goes into the layer.
struct Part<'a> {
    work: Work<'a>,
    samples: std::ops::Range<usize>,
    path: MeshPath,
}

/// Writes the layer under another name, and gives it its own when it is whole.
pub(super) fn convert(conversion: &Conversion, wrote: &mut dyn FnMut(i64)) -> Result<Converted, IoError> {
    let source = CacheFrames::open(&conversion.from)?;
    let meshes = match &conversion.object {
        Some(object) => vec![chosen(&source, Some(object))?],
        None => (0..source.meshes().len()).collect(),
    };
    let mut kept = Vec::new();
    for mesh in meshes {
        let samples = shown(&source, mesh, conversion)?;
        kept.push((mesh, GarmentMesh::kept(described(&source, mesh, samples.start)?), samples));
    }
    let garment = conversion.to.file_stem().unwrap_or_default().to_string_lossy();
    let mut parts: Vec<Part<'_>> = Vec::new();
    for (mesh, kept, samples) in &kept {
        let plan = plan(conversion, (&source, *mesh), samples, (&garment, kept))?;
        let path = distinct(&plan.object_path(), &parts);
        parts.push(Part { work: Work { source: &source, mesh: *mesh, plan }, samples: samples.clone(), path });
    }
    refuse_too_much(conversion, &parts)?;
    let (aside, to) = (aside(&conversion.to), &conversion.to);
    let layer = layer(conversion, &source, &parts, wrote)?;
    let written = File::create(&aside)
        .map_err(|e| IoError::creating(&aside, e))
        .and_then(|mut file| layer.write(&mut file).and_then(|()| file.sync_all()).map_err(|e| IoError::writing(to, e)))
        .and_then(|()| fs::rename(&aside, to).map_err(|e| IoError::writing(to, e)));
    if let Err(error) = written {
        // Half a layer would only confuse; if it cannot be removed either, the first error says why.
        let _ = fs::remove_file(&aside);
        return Err(error);
    }
    let points = parts.iter().map(|part| source.meshes()[part.work.mesh].points).sum();
    Ok(Converted { frames: frames_of(&parts), points, units: parts[0].work.plan.units })
}

/// The samples of a mesh that are written: all that are asked for, and one of what does not move.
fn shown(source: &CacheFrames, mesh: usize, conversion: &Conversion) -> Result<std::ops::Range<usize>, IoError> {
    if source.moves(mesh) { samples(source, mesh, conversion.frames) } else { Ok(0..1) }
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
    let moves = parts.iter().any(|part| part.samples.len() > 1);
    let plans = parts.iter().filter(|part| !moves || part.samples.len() > 1).map(|part| &part.work.plan);
    let (first, last) = (plans.clone().map(|plan| plan.first_frame).min(), plans.map(|plan| plan.last_frame).max());
    [first.unwrap_or_default(), last.unwrap_or_default()]
}

/// Says that a layer would be too large to be held in memory as a whole.
fn refuse_too_much(conversion: &Conversion, parts: &[Part<'_>]) -> Result<(), IoError> {
    let bytes_of = |part: &Part<'_>| {
        let CachePlan { velocities, mesh, .. } = &part.work.plan;
        let points = drapery_core::mesh::MeshStream::point_count(*mesh) as u64;
        points.saturating_mul(part.samples.len() as u64).saturating_mul(if *velocities { 24 } else { 12 })
    };
    let bytes = parts.iter().map(bytes_of).fold(0_u64, u64::saturating_add);
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let (megabytes, most) = (bytes / 1_000_000, MOST_BYTES / 1_000_000);
    let what = format!("positions and velocities take {megabytes} MB, and one layer has at most {most} MB");
    let advice = "choose fewer frames with --frames A-B or one mesh with --object, or write a .usd file: each of its frames is a \
                  layer of its own";
    Err(IoError::data(&conversion.to, "size", what, advice))
}

/// The layer with everything in it.
fn layer(
    conversion: &Conversion,
    source: &CacheFrames,
    parts: &[Part<'_>],
    wrote: &mut dyn FnMut(i64),
) -> Result<SingleLayer, IoError> {
    let refused = |error: WriteError| write_error(&conversion.to, &error);
    let (numerator, denominator) = rate(source, conversion.fps)?;
    let root = parts[0].path.root();
    let mut layer = SingleLayer::new(&About {
        units: layer_units(parts[0].work.plan.units, f64::from(numerator) / f64::from(denominator)),
        default_prim: root,
        frames: frames_of(parts),
        properties: &[("application", APPLICATION.to_owned()), ("fps", format!("{numerator}/{denominator}"))],
    });
    for (index, Part { work, samples, path }) in parts.iter().enumerate() {
        let plan = &work.plan;
        let CachePlan { velocities, normals, crossings, .. } = *plan;
        let form = Form { origin: plan.file_origin(), velocities, normals, crossings };
        layer.add_mesh(still_mesh(plan.mesh.read()?, path, form)).map_err(refused)?;
        work.frames(samples.clone(), &mut |frame| {
            let moving = Moving {
                time_code: frame.frame as f64,
                points: frame.positions,
                velocities: velocities.then_some(frame.velocities),
                normals: normals.then_some(frame.normals),
                crossings: frame.crossings,
            };
            layer.add_frame(&moving).map_err(refused)?;
            // A frame is there when all meshes have it.
            if index + 1 == parts.len() {
                wrote(frame.frame);
            }
            Ok(())
        })?;
    }
    layer.set_kinds(root, parts.len() > 1).map_err(refused)?;
    Ok(layer)
}
