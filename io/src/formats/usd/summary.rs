//! Summary of a stage.

use std::path::{Path, PathBuf};

use drapery_usd::read::{Channel, Chosen, Entry, Stage, UsdError};

use super::read::mesh_data;
use crate::error::IoError;
use crate::file_summary::{ChannelSummary, FileSummary, MeshSummary, Normals, bounds, face_kinds};

/// Looks into a stage.
///
/// # Errors
/// The file cannot be opened, or a mesh of it contradicts itself.
pub(super) fn summary(path: &Path) -> Result<FileSummary, IoError> {
    let stage = Stage::open(path)?;
    let about = stage.about();
    let mut properties = Vec::new();
    let mut add = |name: &str, value: String| properties.push((name.to_owned(), value));
    let or_default =
        |said: Option<String>, default: &str| said.unwrap_or_else(|| format!("not stated; USD's default is {default}"));
    add("metersPerUnit", or_default(about.metres_per_unit.map(|metres| metres.to_string()), "0.01"));
    add("upAxis", or_default(about.up_axis.clone(), "Y"));
    add("timeCodesPerSecond", about.codes_per_second.to_string());
    add("framesPerSecond", or_default(about.frames_per_second.map(|rate| rate.to_string()), "24"));
    let range = about.range.map(|[first, last]| format!("{first} to {last}"));
    add("time codes", range.unwrap_or_else(|| "not stated".to_owned()));
    add("defaultPrim", about.default_prim.clone().unwrap_or_else(|| "not stated".to_owned()));
    add("layers", about.layers.len().to_string());
    let own = path.canonicalize().ok();
    let folder = own.as_deref().and_then(Path::parent);
    let whole = |layer: &PathBuf| layer.canonicalize().unwrap_or_else(|_| layer.clone());
    let outside = |layer: &PathBuf| folder.is_some_and(|folder| !layer.starts_with(folder));
    for layer in about.layers.iter().map(whole).filter(outside) {
        add("layer outside of its folder", layer.display().to_string());
    }
    for (_, flaw) in &about.flaws {
        add("broken", format!("{}: {}", flaw.place, flaw.what));
    }
    let mut meshes = Vec::new();
    for (place, entry) in about.meshes.iter().enumerate() {
        meshes.push(match stage.choose(&[place]) {
            Ok(chosen) => mesh_summary(&stage, entry, &chosen)?,
            // What is wrong with this one is reported, and the others are reported as they are.
            Err(error) => unreadable(entry.path.clone(), error),
        });
    }
    let channel =
        |Channel { prim, attribute, numbers, samples }| ChannelSummary::of(&prim, &attribute, numbers, samples);
    let channels = stage.channels()?.into_iter().filter_map(channel).collect();
    Ok(FileSummary { format: "USD", properties, meshes, others: about.others.clone(), channels })
}

fn unreadable(path: String, error: UsdError) -> MeshSummary {
    MeshSummary { path, topology: "unknown", problem: Some(error.what), ..MeshSummary::default() }
}

fn mesh_summary(stage: &Stage, entry: &Entry, chosen: &Chosen) -> Result<MeshSummary, IoError> {
    let path = match entry.skipped() {
        Some(why) => format!("{} (not read: {why})", entry.path),
        None => entry.path.clone(),
    };
    let codes = &chosen.codes;
    // What does not move belongs to a frame only in a stage of one frame.
    let only = stage.about().range.filter(|[first, last]| first == last && first.is_finite());
    let first = codes.first().copied().or(only.map(|[first, _]| first)).unwrap_or(0.0);
    let sample = match stage.mesh(0, first) {
        Ok(sample) => sample,
        Err(error) => return Ok(unreadable(path, error)),
    };
    let per_second = stage.about().codes_per_second;
    let seconds = |code: f64| if per_second > 0.0 { code / per_second } else { 0.0 };
    let stored = stage.stored(0, first)?;
    let has_normals = sample.normals.is_some() || stored.as_ref().is_some_and(|stored| stored.normals.is_some());
    let data = mesh_data(entry.path.clone(), sample);
    Ok(MeshSummary {
        path,
        points: data.mesh.points.len(),
        faces: face_kinds(&data.mesh.face_counts),
        topology: match (stage.faces_move(0)?, codes.is_empty()) {
            (true, _) => "changing",
            (false, false) => "constant faces, moving points",
            (false, true) => "constant",
        },
        samples: codes.len().max(1),
        times: codes
            .first()
            .zip(codes.last())
            .map(|(first, last)| [*first, *last])
            .or(only)
            .map(|all| all.map(seconds)),
        bounds: bounds(&data.mesh.points),
        uvs: data.uvs.map(|uvs| (uvs.name, uvs.values.len())),
        face_sets: data.face_sets.into_iter().map(|set| (set.name, set.faces.len())).collect(),
        attributes: data.params.into_iter().map(|param| param.name).collect(),
        normals: Normals::of(has_normals, data.split_normals.is_some()),
        velocities: stored.is_some_and(|stored| stored.velocities.is_some()),
        ..MeshSummary::default()
    })
}
