//! `drapery info`: what a mesh or cache holds.

use std::path::Path;

use drapery_io::file_summary::{ChannelSummary, MeshSummary, Normals};
use drapery_io::formats;
use drapery_shot::run_record::MANIFEST;

use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Prints what a file holds.
pub(crate) fn info(path: &Path) -> Result<ExitCode, Failure> {
    if path.join(MANIFEST).is_file() {
        let text = format!(
            "{0}: this is a run folder\n  help: use `drapery status {0}` for its progress, or give one of its caches",
            path.display()
        );
        return Err(Failure::new(ExitCode::BadInput, text));
    }
    let summary = formats::inspect(path)?;
    say::line(format_args!("{}: {}", path.display(), summary.format));
    for (name, value) in &summary.properties {
        say::line(format_args!("  {name}: {value}"));
    }
    let find = |key: &str| summary.properties.iter().find(|(name, _)| name.eq_ignore_ascii_case(key));
    let rate = |key: &str| find(key)?.1.parse().ok().filter(|fps: &f64| *fps > 0.0);
    // A time code of a stage is a frame unless the stage states frames per second.
    let fps =
        ["DCC_FPS", "fps", "framesPerSecond", "timeCodesPerSecond", "FramesPerTimeUnit"].into_iter().find_map(rate);
    summary.meshes.iter().for_each(|mesh| print_mesh(mesh, fps));
    for (path, kind) in &summary.others {
        say::line(format_args!("{path}: {kind}"));
    }
    for ChannelSummary { channel, numbers, samples } in &summary.channels {
        let numbers = if *numbers == 1 { "one number" } else { "three numbers" };
        let samples = if *samples == 1 { "one sample".to_owned() } else { format!("{samples} samples") };
        say::line(format_args!("channel {channel}: {numbers}, {samples}"));
    }
    Ok(ExitCode::Done)
}

fn print_mesh(mesh: &MeshSummary, fps: Option<f64>) {
    let [triangles, quads, others] = mesh.faces;
    say::line(format_args!("{}: mesh", mesh.path));
    if let Some(problem) = &mesh.problem {
        say::line(format_args!("  cannot be read: {problem}"));
        return;
    }
    say::line(format_args!("  points: {}", mesh.points));
    say::line(format_args!("  faces: {triangles} triangles, {quads} quads, {others} with more corners"));
    say::line(format_args!("  topology: {}", mesh.topology));
    let mut samples = mesh.samples.to_string();
    if let Some([first, last]) = mesh.times {
        samples += &format!(" from {first:.6} s to {last:.6} s");
        if let Some(fps) = fps {
            samples += &format!(", frames {:.3} to {:.3} at {fps} fps", first * fps, last * fps);
        }
    }
    say::line(format_args!("  samples: {samples}"));
    if let Some([low, high]) = mesh.bounds {
        say::line(format_args!("  bounds of the first sample: {low:.6?} to {high:.6?}"));
    }
    if let Some((name, values)) = &mesh.uvs {
        say::line(format_args!("  UVs: {name}, {values} values"));
    }
    for (name, faces) in &mesh.face_sets {
        say::line(format_args!("  face set {name}: {faces} faces"));
    }
    let normals = match mesh.normals {
        Normals::No => "no",
        Normals::Smooth => "smooth",
        Normals::Split => "split by hard edges",
    };
    say::line(format_args!("  normals: {normals}"));
    if !mesh.attributes.is_empty() {
        say::line(format_args!("  attributes: {}", mesh.attributes.join(", ")));
    }
    say::line(format_args!("  velocities: {}", if mesh.velocities { "yes" } else { "no" }));
}
