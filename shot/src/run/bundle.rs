//! Files that a run leaves behind when the solver gives up: the last good state, the cloth as it stood with the
//! elements concerned, the error, and the way to see it happen again.
//!
//! `OUT/debug/frame_01043.step_000012.{json,toml,h5,abc}`: what went wrong; the scene with every value; a checkpoint;
//! the garment concerned with the face set `concerned`. `drapery run --replay FILE.json` goes on from the checkpoint.

use std::fs;
use std::path::{Path, PathBuf};

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Durability, IDENTITY, PolyMeshSample, PolyMeshWriter, TimeSampling, Topology,
    XformWriter, write_face_set,
};
use drapery_core::error::StepError;
use drapery_core::observe::Tracepoint;
use drapery_core::scene::gather::VertexField;
use drapery_core::simulation::{Advance, FrameSummary, Recovery};
use drapery_io::atomic_file;
use drapery_io::checkpoint::{CheckpointReader, CheckpointWriter, Head};
use drapery_io::error::IoError;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_file;
use drapery_io::mesh_data::MeshData;
use serde_json::{Value, json};

use crate::error::ShotError;
use crate::farm::command_line::quoted;
use crate::run::dump::{self, Dump};
use crate::run::resume;
use crate::run_record::writer::recovery_value;
use crate::shot::Shot;

/// Folder inside that of a run.
const FOLDER: &str = "debug";

/// Writes the bundle of a run that has given up; returns its JSON file. The simulation stands at its last good state.
pub(super) fn write(shot: &Shot, out: &Path, head: &Head, error: &StepError) -> Result<PathBuf, IoError> {
    let folder = out.join(FOLDER);
    fs::create_dir_all(&folder).map_err(|e| IoError::creating(&folder, e))?;
    let stem = format!("frame_{:05}.step_{:06}", head.frame, head.sub_step);
    let file = |ending: &str| folder.join(format!("{stem}.{ending}"));
    let mut writer = CheckpointWriter::create(&file("h5"), head)?;
    shot.remote_simulation.save(&mut writer);
    writer.finish()?;
    atomic_file::replace(&file("toml"), shot.about.resolved.as_bytes())?;
    let recoveries = shot.simulation().recoveries();
    let (garment, vertices) = concerned(error, recoveries);
    let bundle = file("json");
    let text = json!({
        "bundle": 1,
        "application": drapery_io::cache::APPLICATION,
        "shot": shot.about.name,
        "frame": head.frame + 1,
        "from": {"frame": head.frame, "sub_step": head.sub_step, "time": head.time},
        "error": error.to_string(),
        "elements": {"garment": garment, "vertices": vertices},
        "recoveries": recoveries.iter().map(recovery_value).collect::<Vec<_>>(),
        "scene": format!("{stem}.toml"),
        "checkpoint": format!("{stem}.h5"),
        "cloth": format!("{stem}.abc"),
        "replay": format!("drapery run --replay {}", quoted(bundle.as_os_str())),
    });
    atomic_file::replace(&bundle, format!("{text:#}\n").as_bytes())?;
    write_cloth(shot, &file("abc"), (&garment, &vertices))?;
    Ok(bundle)
}

/// The garment and the vertices that are to blame.
fn concerned(error: &StepError, recoveries: &[Recovery]) -> (String, Vec<u32>) {
    let last = recoveries.iter().rfind(|recovery| !recovery.vertices.is_empty());
    match (last, error) {
        (Some(last), _) => (last.garment.clone(), last.vertices.clone()),
        // Numbers of vertices are below 2³².
        (None, StepError::NotFinite { garment, vertex, .. }) => (garment.clone(), vec![*vertex as u32]),
        (None, _) => (String::new(), Vec::new()),
    }
}

/// Writes the garment concerned, the first if none is, as it stands; its faces are those of the scene.
fn write_cloth(shot: &Shot, path: &Path, (name, vertices): (&str, &[u32])) -> Result<(), IoError> {
    let garment = shot.about.garments.iter().position(|garment| garment == name).unwrap_or(0);
    // A garment that cannot be read again has no picture.
    let Some(Ok(MeshData { mesh, .. })) = shot.garments.get(garment).map(GarmentMesh::read) else { return Ok(()) };
    let positions = shot.remote_simulation.stored(garment, VertexField::Positions, shot.about.output.units);
    let faces = mesh.faces().enumerate().filter(|(_, corners)| corners.iter().any(|v| vertices.contains(v)));
    let faces: Vec<i32> = faces.filter_map(|(face, _)| i32::try_from(face).ok()).collect();
    let counts: Vec<i32> = mesh.face_counts.iter().map(|count| *count as i32).collect();
    // Alembic winds faces the other way round.
    let indices: Vec<i32> =
        mesh.faces().flat_map(|corners| corners.iter().rev().map(|corner| *corner as i32)).collect();
    let mut archive = ArchiveWriter::create(path, &ArchiveOptions::default())?;
    let sampling = archive.add_time_sampling(TimeSampling::frames(0.0, 1.0)?)?;
    let root = archive.root();
    let xform = XformWriter::declare(&mut archive, root, &shot.about.garments[garment], sampling)?;
    let mut place = IDENTITY;
    place[12..15].copy_from_slice(shot.about.output.units.from_si(shot.origin()).as_slice());
    xform.write(&mut archive, &place)?;
    let mut cloth = PolyMeshWriter::declare(&mut archive, xform.object(), "clothShape", sampling)?;
    if !faces.is_empty() {
        write_face_set(&mut archive, cloth.object(), "concerned", &faces, false)?;
    }
    let topology = Some(Topology { face_counts: &counts, face_indices: &indices });
    cloth.write(&mut archive, &PolyMeshSample { topology, ..PolyMeshSample::of(&positions) })?;
    archive.finish(Durability::Synced)?;
    Ok(())
}

/// A bundle that was read.
#[derive(Debug, Clone)]
pub struct Bundle {
    /// Its scene.
    pub scene: PathBuf,
    /// The checkpoint from which it goes on.
    pub checkpoint: PathBuf,
    /// Description of the error.
    pub error: String,
}

impl Bundle {
    /// Reads the JSON file of a bundle.
    ///
    /// # Errors
    /// There is no such file, or it is no bundle.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        let text = input_file::text(path)?;
        let value: Value = serde_json::from_str(&text).unwrap_or_default();
        let folder = path.parent().unwrap_or(Path::new(""));
        let named = |key: &str| value[key].as_str().map(|name| folder.join(name));
        match (named("scene"), named("checkpoint"), value["error"].as_str()) {
            (Some(scene), Some(checkpoint), Some(error)) => Ok(Self { scene, checkpoint, error: error.to_owned() }),
            _ => Err(IoError::data(
                path,
                "bundle",
                "it is not a bundle of a failed run",
                "give the .json file from the folder `debug` of such a run",
            )),
        }
    }
}

impl Shot {
    /// Goes on from the last good state of a bundle to the next frame, and writes no caches: either the solver gives up
    /// again, for the same reason to the last bit, or what has changed since has mended it. What `tracepoints` ask for is
    /// written into `folder`; `note` hears of it.
    ///
    /// # Errors
    /// The checkpoint is not one of this scene; an input breaks; the solver gives up.
    pub fn replay(
        mut self,
        bundle: &Bundle,
        tracepoints: &[Tracepoint],
        folder: &Path,
        note: &mut dyn FnMut(String),
    ) -> Result<FrameSummary, ShotError> {
        let mut checkpoint = CheckpointReader::open(&bundle.checkpoint)?;
        let frame = checkpoint.head.frame;
        dump::refuse_unreachable(tracepoints, [frame + 1; 2])?;
        let start = self.inputs.at(frame)?;
        self.remote_simulation =
            resume::restored(self.remote_simulation, start, (&mut checkpoint, &bundle.checkpoint))?;
        // Steps count from the last good state: nobody knows those before it.
        let dump = Dump::start(&mut self, tracepoints, folder, 0)?;
        let input = self.remote_simulation.share(self.inputs.at(frame + 1)?);
        let advanced = loop {
            match self.remote_simulation.advance(&input, &mut || None) {
                // At a sample of the caches.
                Ok((Advance::Paused(_), _)) => {}
                advanced => break advanced,
            }
        };
        dump.iter().for_each(|dump| note(dump.in_words()));
        dump.as_ref().map_or(Ok(()), Dump::check)?;
        let (Advance::Done(summary) | Advance::Paused(summary), _) = advanced?;
        Ok(summary)
    }
}
