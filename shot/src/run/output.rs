//! The folder of a run: caches, manifest, record and the resolved scene.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use drapery_core::mesh::MeshStream;
use drapery_core::metrics::Metrics;
use drapery_core::scene::gather::VertexField;
use drapery_io::atomic_file;
use drapery_io::attributes::Attribute;
use drapery_io::cache::{APPLICATION, CacheFrame, CacheMark, CachePlan, CacheWriter};
use drapery_io::checkpoint::Head;
use drapery_io::convert::write_shot;
use drapery_io::error::IoError;
use drapery_io::formats::{self, Part, ShotCache, ShotFiles};
use drapery_io::units::Units;
use serde_json::{Value, json};

use crate::checkpoints::{Account, Saved, store};
use crate::error::ShotError;
use crate::farm::digest::Fingerprint;
use crate::farm::stop::Reason;
use crate::frame_digest::{FrameDigests, GarmentDigests};
use crate::point_attributes::FrameAttributes;
use crate::quality::{CROSSINGS_OTHER_DIAGONAL, CROSSINGS_WRITTEN};
use crate::remote_simulation::RemoteSimulation;
use crate::render_mesh::RenderMesh;
use crate::run::belts::{self, BeltDigests};
use crate::run::continued::{Continued, Planned};
use crate::run::folder::{file_name, files_of_run, remove, write_fingerprint};
use crate::run::ignored::Ignored;
use crate::run::options::RunOptions;
use crate::run::totals::Totals;
use crate::run_record::manifest::{AttemptRecord, Manifest, ManifestCheckpoint, ManifestGarment};
use crate::run_record::manifest::{former_files, listed_files, listed_layers};
use crate::run_record::writer::{RunRecord, counts, digests_record, failure_record, stages};
use crate::run_record::{MANIFEST, RESOLVED};
use crate::shot::Shot;
use crate::written_faces::{OtherCut, WrittenFaces};

/// Output that is being written.
pub(super) struct Output {
    folder: PathBuf,
    manifest: Manifest,
    record: RunRecord,
    /// The caches of each garment, then of each render mesh.
    writers: Vec<Vec<Box<dyn CacheWriter>>>,
    units: Units,
    velocities: bool,
    attributes: FrameAttributes,
    /// Whether crossings of what is written are counted: in scenes that promise cloth without them.
    crossings: bool,
    /// Faces that others may cut otherwise, if there are any.
    faces: Option<WrittenFaces>,
    /// Crossings that appear if they do, in the output written since somebody last asked.
    other_cuts: Vec<OtherCut>,
    /// Number of garments, which come before the render meshes.
    garments: usize,
    /// Files over all caches of a format.
    layers: Vec<ShotLayer>,
    /// Digests of the caches of belts.
    belts: BeltDigests,
    /// The shot as one file, if the scene asks for it; there when the run is done.
    single: Option<PathBuf>,
    /// Frames per second.
    fps: f64,
}

/// A file over all caches of a format.
struct ShotLayer {
    path: PathBuf,
    write: fn(&Path, &ShotFiles<'_>) -> Result<(), IoError>,
    /// Names of the caches, garment by garment.
    files: Vec<String>,
}

/// Data that goes into the folder of an attempt beside its scene.
pub(super) struct Start<'a> {
    /// Options of the run.
    pub(super) options: &'a RunOptions,
    /// Fingerprint of its dependencies.
    pub(super) fingerprint: &'a Fingerprint,
    /// All attempts; the last one is this.
    pub(super) attempts: Vec<AttemptRecord>,
}

/// Point from which a run goes on.
pub(super) struct From<'a> {
    /// Head of the checkpoint.
    pub(super) head: &'a Head,
    /// Account of the run up to there, if that is known.
    pub(super) account: Option<&'a Account>,
    /// The checkpoint, relative to the folder.
    pub(super) checkpoint: ManifestCheckpoint,
    /// Whether caches that are there have another form than is asked for now.
    pub(super) other_form: bool,
}

impl Output {
    /// Prepares the folder for a run from the start, which replaces what is left of an earlier one.
    pub(super) fn create(shot: &Shot, start: Start<'_>) -> Result<Self, IoError> {
        let folder = start.options.out.clone();
        let planned = planned(shot, &folder);
        let old = files_of_run(&folder, &paths(&planned));
        // First of all: a folder with a manifest holds a run, which may be started again.
        let manifest = manifest(shot, start.options, &planned, start.attempts);
        manifest.write(&folder)?;
        let its_manifest = folder.join(MANIFEST);
        for path in old.iter().filter(|path| **path != its_manifest) {
            remove(path)?;
        }
        describe(shot, start.fingerprint, &folder)?;
        let mut record = RunRecord::create(&folder)?;
        record.line(&shot.header(start.options.threads))?;
        let create = |cache: &Planned, plan: CachePlan<'_>| (cache.create)(&cache.path, &plan);
        let writers = of_objects(shot, &planned, create)?;
        let belts = belts::write(shot, &folder)?;
        Self::new(shot, &planned, manifest, record, (folder, writers, belts))
    }

    /// Goes on in the folder of a run that stopped: cuts caches and record back to a checkpoint.
    pub(super) fn resume(shot: &Shot, start: Start<'_>, from: From<'_>) -> Result<Self, IoError> {
        let folder = start.options.out.clone();
        let planned = planned(shot, &folder);
        let continued = Continued::of(from.head, &folder, from.other_form);
        let rewritten = RefCell::new(BTreeMap::<i64, FrameDigests>::new());
        let resume = |cache: &Planned, plan: CachePlan<'_>| {
            let garment = plan.garment.to_owned();
            let mut take = |frame, digests| {
                rewritten.borrow_mut().entry(frame).or_default().insert(garment.clone(), digests);
            };
            continued.open(cache, plan, &mut take)
        };
        let writers = of_objects(shot, &planned, resume)?;
        let belts = belts::write(shot, &folder)?;
        // Of the frames so far it would hold too many or too few, whether this run writes it again or not.
        let is_single = |path: &&PathBuf| formats::of_file(path).is_some_and(|format| format.single.is_some());
        listed_layers(&folder).iter().filter(is_single).try_for_each(|path| remove(path))?;
        describe(shot, start.fingerprint, &folder)?;
        let mut record = RunRecord::resume(&folder, from.head.frame, from.account.map(|account| account.record_bytes))?;
        let attempt = start.attempts.last().map_or(0, |attempt| attempt.attempt);
        record.line(&json!({
            "record": "resume",
            "frame": from.head.frame,
            "sub_step": from.head.sub_step,
            "checkpoint": from.checkpoint.file,
            "attempt": attempt,
            "changes": start.attempts.last().map(|attempt| attempt.changes.clone()).unwrap_or_default(),
            "counts_lost": from.account.is_none() && from.head.sub_step > 0,
        }))?;
        if from.other_form {
            let mut lines = rewritten.into_inner();
            let of_belts = |frame: &i64| belts.get(&(*frame, 0)).cloned().unwrap_or_default();
            lines.iter_mut().for_each(|(frame, all)| all.extend(of_belts(frame)));
            lines.iter().try_for_each(|(frame, all)| record.line(&digests_record(*frame, all)))?;
        }
        let mut manifest = manifest(shot, start.options, &planned, start.attempts);
        manifest.former = former(&folder, &planned_files(shot, &folder));
        manifest.last_complete_frame = from.head.delivered;
        manifest.checkpoint = Some(from.checkpoint);
        manifest.write(&folder)?;
        let output = Self::new(shot, &planned, manifest, record, (folder, writers, belts))?;
        output.write_layers(from.head.delivered)?;
        Ok(output)
    }

    fn new(
        shot: &Shot,
        planned: &[Planned],
        manifest: Manifest,
        record: RunRecord,
        (folder, writers, belts): (PathBuf, Vec<Vec<Box<dyn CacheWriter>>>, BeltDigests),
    ) -> Result<Self, IoError> {
        let about = &shot.about;
        let (units, velocities, crossings) = (about.output.units, about.output.velocities, about.keeps_free);
        let (layers, single) = (layers(shot, planned, &folder), shot.single_layer(&folder));
        let fps = about.timeline.fps();
        let garments = shot.garments.len();
        let faces = WrittenFaces::of(&shot.written, &shot.inputs, shot.simulation(), units)?;
        let attributes = FrameAttributes::of(&about.output, &shot.written)?;
        let other_cuts = Vec::new();
        Ok(Self {
            folder,
            manifest,
            record,
            writers,
            units,
            velocities,
            attributes,
            crossings,
            faces,
            other_cuts,
            garments,
            layers,
            belts,
            single,
            fps,
        })
    }

    /// The cache files, and the one of the whole shot where it is there.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let caches = self.writers.iter().flatten().map(|writer| writer.path().to_owned());
        caches.chain(self.single.clone().filter(|path| path.is_file())).collect()
    }

    /// The files over the caches of all garments of a format.
    pub(super) fn layer_files(&self) -> Vec<PathBuf> {
        self.layers.iter().map(|layer| layer.path.clone()).filter(|path| path.is_file()).collect()
    }

    /// Writes the state of the simulation as a frame of every cache, then tells the manifest; returns digests of what was written.
    pub(super) fn write_frame(
        &mut self,
        frame: i64,
        shown: (&mut RemoteSimulation, &[RenderMesh]),
        spent: &mut Metrics,
    ) -> Result<FrameDigests, IoError> {
        let digests = self.write_sample((frame, 0), shown, spent)?;
        self.write_layers(Some(frame))?;
        self.manifest.last_complete_frame = Some(frame);
        Ok(digests)
    }

    /// Writes the state of the simulation as a sample of every cache that has such: frame, and which one behind it, 0 for the frame
    /// itself.
    pub(super) fn write_sample(
        &mut self,
        sample: (i64, usize),
        (remote_simulation, render_meshes): (&mut RemoteSimulation, &[RenderMesh]),
        spent: &mut Metrics,
    ) -> Result<FrameDigests, IoError> {
        let units = self.units;
        let crossings =
            self.crossings.then(|| spent.stage("check caches", |_| remote_simulation.crossings_of_stored(units)));
        if let Some(count) = crossings {
            spent.count(CROSSINGS_WRITTEN, u64::from(count));
        }
        let written = spent.stage("write caches", |_| self.write_caches(sample, remote_simulation, crossings));
        let mut digests = written?;
        if let Some(faces) = &mut self.faces {
            let found = spent.stage("check caches", |_| faces.find(remote_simulation.simulation()));
            spent.count(CROSSINGS_OTHER_DIAGONAL, found.iter().map(|cut| cut.count as u64).sum());
            self.other_cuts.extend(found);
        }
        if !render_meshes.is_empty() {
            let written =
                spent.stage("render meshes", |_| self.write_render_meshes(sample, remote_simulation, render_meshes));
            digests.extend(written?);
        }
        digests.extend(self.belts.get(&sample).cloned().unwrap_or_default());
        Ok(digests)
    }

    /// Takes the crossings along diagonals that the solver did not take, in the output written since the last call.
    pub(super) fn take_other_cuts(&mut self) -> Vec<OtherCut> {
        std::mem::take(&mut self.other_cuts)
    }

    /// Notes in the manifest that this attempt has finished a frame, pre-roll included, which took so long [s].
    pub(super) fn frame_done(&mut self, frame: i64, seconds: f64) -> Result<(), IoError> {
        if let Some(attempt) = self.manifest.attempts.last_mut() {
            attempt.last_frame = Some(frame);
            attempt.seconds += seconds;
        }
        self.manifest.write(&self.folder)
    }

    /// Whether the caches are those that a checkpoint tells of.
    pub(super) fn has_caches_of(&self, head: &Head) -> bool {
        let marks = self.writers.iter().flatten().map(|writer| serde_json::to_value(writer.mark()).unwrap_or_default());
        marks.eq(head.caches.iter().cloned())
    }

    /// Brings the caches to the disk; returns what they are then, and the length of the record.
    pub(super) fn mark(&mut self) -> Result<(Vec<CacheMark>, u64), IoError> {
        self.record.check()?;
        for writer in self.writers.iter_mut().flatten() {
            writer.sync()?;
        }
        Ok((self.writers.iter().flatten().map(|writer| writer.mark()).collect(), self.record.length()?))
    }

    /// Notes a checkpoint that was written.
    pub(super) fn checkpoint_saved(&mut self, saved: &Saved, frame: i64, sub_step: u64) -> Result<(), IoError> {
        self.record.line(&json!({
            "record": "checkpoint",
            "frame": frame,
            "sub_step": sub_step,
            "seconds": saved.seconds,
            "bytes": saved.bytes,
        }))?;
        self.manifest.checkpoint = Some(manifest_checkpoint(&saved.path, frame, sub_step));
        self.manifest.write(&self.folder)
    }

    /// One garment after the other: no more than one is in memory as a whole.
    fn write_caches(
        &mut self,
        (frame, sub_frame): (i64, usize),
        remote_simulation: &RemoteSimulation,
        crossings: Option<u32>,
    ) -> Result<FrameDigests, IoError> {
        self.attributes.take(remote_simulation);
        let mut digests = FrameDigests::new();
        let (units, with_velocities) = (self.units, self.velocities);
        let of_garments = self.writers.iter_mut().take(self.garments).enumerate();
        for (garment, writers) in of_garments.filter(|(_, writers)| !writers.is_empty()) {
            let positions = remote_simulation.stored(garment, VertexField::Positions, units);
            let velocities = if with_velocities {
                remote_simulation.stored(garment, VertexField::Velocities, units)
            } else {
                Vec::new()
            };
            let (positions, velocities) = (positions.as_slice(), velocities.as_slice());
            self.faces.iter_mut().for_each(|faces| faces.place(garment, positions));
            let normals = &self.attributes.normals(garment, positions)[..];
            let strain = self.attributes.strain(garment, positions);
            let values = self.attributes.values(garment, &strain);
            for writer in writers {
                writer.write(&CacheFrame { frame, sub_frame, positions, velocities, normals, crossings, values })?;
            }
            let name = self.manifest.garments[garment].name.clone();
            digests.insert(name, GarmentDigests::of(positions, velocities));
        }
        Ok(digests)
    }

    /// The render meshes, one after the other.
    fn write_render_meshes(
        &mut self,
        (frame, sub_frame): (i64, usize),
        remote_simulation: &RemoteSimulation,
        render_meshes: &[RenderMesh],
    ) -> Result<FrameDigests, IoError> {
        let mut digests = FrameDigests::new();
        let (units, with_velocities) = (self.units, self.velocities);
        let origin = remote_simulation.simulation().scene().origin();
        let of_meshes = self.writers.iter_mut().skip(self.garments).zip(render_meshes);
        for (writers, mesh) in of_meshes.filter(|(writers, _)| !writers.is_empty()) {
            let field = |field| remote_simulation.field(mesh.garment, field);
            let (x, v) = (field(VertexField::Positions), with_velocities.then(|| field(VertexField::Velocities)));
            let placed = mesh.placed(&x, v.as_deref(), (units, origin));
            let (positions, velocities, normals) = (&placed.positions[..], &placed.velocities[..], &placed.normals[..]);
            let (crossings, values) = (None, self.attributes.followed(mesh.garment, mesh.binding(), (&x, origin)));
            let values = values.values();
            for writer in writers {
                writer.write(&CacheFrame { frame, sub_frame, positions, velocities, normals, crossings, values })?;
            }
            digests.insert(mesh.name.clone(), GarmentDigests::of(positions, velocities));
        }
        Ok(digests)
    }

    /// Writes the files over all caches, with the frames up to `last`; removes them when there is no frame.
    fn write_layers(&self, last: Option<i64>) -> Result<(), IoError> {
        for layer in &self.layers {
            let Some(last) = last else {
                remove(&layer.path)?;
                continue;
            };
            (layer.write)(&layer.path, &self.shot_files(layer, last))?;
        }
        Ok(())
    }

    /// The caches that a layer is over, with the frames up to `last`.
    fn shot_files(&self, layer: &ShotLayer, last: i64) -> ShotFiles<'_> {
        let all = &self.manifest.garments;
        let part = |one: &ManifestGarment| match one.render_mesh_of {
            Some(_) => Part::RenderMesh,
            None if all.iter().any(|other| other.render_mesh_of.as_ref() == Some(&one.name)) => Part::Followed,
            None => Part::Alone,
        };
        let caches = all.iter().zip(layer.files.iter().cloned());
        let caches = caches.map(|(one, file)| ShotCache { name: &one.name, file, part: part(one) });
        ShotFiles {
            name: &self.manifest.shot,
            units: self.units,
            fps: self.fps,
            frames: [self.manifest.first_frame, last],
            caches: caches.collect(),
        }
    }

    /// Writes the shot as one file, where the scene asks for it.
    fn write_single(&self) -> Result<(), IoError> {
        let Some(path) = &self.single else { return Ok(()) };
        let layer = self.layers.iter().find(|layer| layer.path.with_extension("") == path.with_extension(""));
        match (layer, self.manifest.last_complete_frame) {
            (Some(layer), Some(last)) => write_shot(path, &self.shot_files(layer, last)),
            _ => Ok(()),
        }
    }

    /// Appends a line to the record.
    pub(super) fn record(&mut self, line: &Value) -> Result<(), IoError> {
        self.record.line(line)
    }

    /// Brings everything to the disk and says that the run is complete.
    pub(super) fn finish(&mut self, totals: &Totals, frames: u64) -> Result<(), IoError> {
        // They are small: one that another program has removed is put back.
        self.write_layers(self.manifest.last_complete_frame)?;
        self.write_single()?;
        let end = json!({
            "record": "end",
            "state": "done",
            "frames": frames,
            "seconds": totals.seconds,
            "stages": stages(&totals.metrics),
            "counts": counts(&totals.metrics),
        });
        self.end("done", "done", &end)
    }

    /// Says that the run stopped early at a state from which it goes on, and why.
    pub(super) fn stop(&mut self, reason: Reason, frame: i64) -> Result<(), IoError> {
        let end = json!({"record": "stop", "reason": reason.word(), "frame": frame});
        self.end("stopped", reason.word(), &end)
    }

    /// Says that the run ended early, and why. The caches keep the frames before.
    pub(super) fn fail(&mut self, error: &ShotError) -> Result<(), IoError> {
        self.manifest.error = Some(error.to_string());
        // One of them may be what failed; the others are brought to the disk all the same.
        self.writers.iter_mut().flatten().for_each(|writer| _ = writer.finish());
        // The manifest says it also where the record cannot.
        let recorded = self.record.line(&failure_record(&error.to_string()));
        self.say("failed", "failed").and(recorded)
    }

    fn end(&mut self, state: &'static str, how: &str, record: &Value) -> Result<(), IoError> {
        for writer in self.writers.iter_mut().flatten() {
            writer.finish()?;
        }
        self.record.check()?;
        self.record.line(record)?;
        self.say(state, how)
    }

    /// Writes state and end of the attempt into the manifest.
    fn say(&mut self, state: &'static str, how: &str) -> Result<(), IoError> {
        self.manifest.state = state.into();
        if let Some(attempt) = self.manifest.attempts.last_mut() {
            attempt.end = Some(how.to_owned());
        }
        self.manifest.write(&self.folder)
    }
}

/// Refuses what [`Output::resume`] would refuse, as long as nothing is touched: a cache that is missing, damaged, too long or of
/// another plan. Returns notes of caches that are written again because they are gone.
pub(super) fn check_resume(shot: &Shot, folder: &Path, head: &Head, other_form: bool) -> Result<Vec<String>, IoError> {
    let continued = Continued::of(head, folder, other_form);
    let planned = planned(shot, folder);
    let notes = planned.iter().filter_map(|cache| continued.check(cache, cache_plan(shot, cache.object)).transpose());
    notes.collect()
}

/// Returns the entry of a checkpoint in the manifest.
pub(super) fn manifest_checkpoint(path: &Path, frame: i64, sub_step: u64) -> ManifestCheckpoint {
    ManifestCheckpoint { file: format!("{}/{}", store::FOLDER, file_name(path)), frame, sub_step }
}

/// Writes beside the caches what they come from.
fn describe(shot: &Shot, fingerprint: &Fingerprint, folder: &Path) -> Result<(), IoError> {
    atomic_file::replace(&folder.join(RESOLVED), shot.about.resolved.as_bytes())?;
    write_fingerprint(folder, fingerprint)
}

/// The caches of each garment and of each render mesh, opened by `open`.
fn of_objects(
    shot: &Shot,
    planned: &[Planned],
    open: impl Fn(&Planned, CachePlan<'_>) -> Result<Box<dyn CacheWriter>, IoError>,
) -> Result<Vec<Vec<Box<dyn CacheWriter>>>, IoError> {
    let of_object = |object: usize| {
        let caches = planned.iter().filter(|cache| cache.object == object);
        caches.map(|cache| open(cache, cache_plan(shot, object))).collect()
    };
    (0..shot.garments.len() + shot.render_meshes.len()).map(of_object).collect()
}

/// The files over all caches of a format.
fn layers(shot: &Shot, planned: &[Planned], folder: &Path) -> Vec<ShotLayer> {
    let formats = shot.about.output.formats.iter().filter_map(|word| formats::by_extension(word));
    let layer = |format: &'static formats::Format| {
        let over = format.shot.as_ref()?;
        let is_of = |cache: &&Planned| cache.path.extension().is_some_and(|extension| extension == format.extension);
        let files = planned.iter().filter(is_of).map(|cache| file_name(&cache.path)).collect();
        let path = folder.join(format!("{}.{}", shot.about.name, over.extension));
        Some(ShotLayer { path, write: over.write, files })
    };
    formats.filter_map(layer).collect()
}

/// All files that a shot writes for other programs into a folder: caches, those of belts, and files over them.
pub(super) fn planned_outputs(shot: &Shot, folder: &Path) -> Vec<PathBuf> {
    let planned = planned(shot, folder);
    let over = layers(shot, &planned, folder).into_iter().map(|layer| layer.path);
    let belts = belts::files(shot, folder);
    paths(&planned).into_iter().chain(over).chain(shot.single_layer(folder)).chain(belts).collect()
}

/// The files over the caches of all garments of a format that a shot writes into a folder.
pub(super) fn planned_layers(shot: &Shot, folder: &Path) -> Vec<PathBuf> {
    layers(shot, &planned(shot, folder), folder).into_iter().map(|layer| layer.path).collect()
}

/// The caches that a shot writes into a folder, those of belts too.
pub(super) fn planned_files(shot: &Shot, folder: &Path) -> Vec<PathBuf> {
    paths(&planned(shot, folder)).into_iter().chain(belts::files(shot, folder)).collect()
}

/// Names of caches in a folder that its manifest lists, and that are not written any more.
fn former(folder: &Path, planned: &[PathBuf]) -> Vec<String> {
    let listed = listed_files(folder).into_iter().chain(former_files(folder));
    listed.filter(|path| !planned.contains(path) && path.is_file()).map(|path| file_name(&path)).collect()
}

fn paths(planned: &[Planned]) -> Vec<PathBuf> {
    planned.iter().map(|cache| cache.path.clone()).collect()
}

fn planned(shot: &Shot, folder: &Path) -> Vec<Planned> {
    let formats = shot.about.output.formats.iter().filter_map(|word| formats::by_extension(word));
    let writable: Vec<_> = formats.filter_map(|f| Some((f.extension, (f.create?, f.resume?, f.check?)))).collect();
    let caches = |(object, name): (usize, &str)| {
        let path = |extension: &str| folder.join(format!("{name}.{extension}"));
        let cache = |&(extension, (create, resume, check)): &(&str, _)| Planned {
            object,
            path: path(extension),
            create,
            resume,
            check,
        };
        writable.iter().map(cache).collect()
    };
    shot.cache_names().enumerate().flat_map(|named| -> Vec<Planned> { caches(named) }).collect()
}

fn cache_plan(shot: &Shot, object: usize) -> CachePlan<'_> {
    let about = &shot.about;
    let render_mesh = object.checked_sub(shot.garments.len()).map(|index| &shot.render_meshes[index]);
    let name = render_mesh.map_or_else(|| &about.garments[object], |mesh| &mesh.name);
    let mesh = render_mesh.map_or_else(|| &shot.written[object], |mesh| &mesh.mesh);
    CachePlan {
        normals: render_mesh.is_some() || about.output.has(Attribute::Normals),
        // Counted of what is simulated.
        crossings: about.keeps_free && render_mesh.is_none(),
        attributes: shot.attributes[object].clone(),
        ..shot.cache_plan(name, mesh)
    }
}

fn manifest(shot: &Shot, options: &RunOptions, planned: &[Planned], attempts: Vec<AttemptRecord>) -> Manifest {
    let about = &shot.about;
    let Ignored { pairs: ignored, parts } = Ignored::of(shot.simulation().scene().description());
    let followed = shot.render_meshes.iter().map(|mesh| Some(about.garments[mesh.garment].clone()));
    let render_mesh_of = shot.garments.iter().map(|_| None).chain(followed);
    let garments = shot.cache_names().zip(render_mesh_of).enumerate().map(|(index, (name, render_mesh_of))| {
        let (plan, fabric) = (cache_plan(shot, index), about.fabrics.get(index).and_then(Option::as_ref));
        ManifestGarment {
            name: name.to_owned(),
            object_path: plan.object_path(),
            points: plan.mesh.point_count(),
            material: fabric.map(|fabric| fabric.name.clone()),
            strain_limit: fabric.map(|fabric| fabric.strain_limit),
            parts: parts.get(index).cloned().unwrap_or_default(),
            render_mesh_of,
            files: planned.iter().filter(|cache| cache.object == index).map(|cache| file_name(&cache.path)).collect(),
        }
    });
    let over = layers(shot, planned, &options.out).into_iter().map(|layer| layer.path);
    Manifest {
        application: APPLICATION.to_owned(),
        shot: about.name.clone(),
        scene: about.scene_path.display().to_string(),
        state: "running".into(),
        error: None,
        first_frame: about.first_frame,
        last_frame: about.last_frame,
        last_complete_frame: None,
        fps: format!("{}/{}", about.timeline.fps_numerator, about.timeline.fps_denominator),
        length_unit: about.output.units.length.word().to_owned(),
        up_axis: format!("{:?}", about.output.units.up),
        origin: shot.origin().into(),
        garments: garments.collect(),
        bodies: belts::listed(shot, &options.out),
        ignored,
        layers: over.chain(shot.single_layer(&options.out)).map(|path| file_name(&path)).collect(),
        threads: options.threads,
        former: Vec::new(),
        command: Some(options.command.clone()),
        checkpoint: None,
        attempts,
    }
}
