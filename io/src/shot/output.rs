//! The folder of a run: caches, manifest, record and the resolved scene.

use std::fs;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::metrics::Metrics;
use drapery_core::simulation::Simulation;
use serde_json::{Value, json};

use crate::atomic_file;
use crate::cache::{APPLICATION, CacheFrame, CachePlan, CacheWriter};
use crate::error::IoError;
use crate::formats::{self, CreateCache};
use crate::run_record::{self, MANIFEST, Manifest, ManifestGarment, RECORD, RESOLVED, RunRecord};
use crate::shot::quality::CROSSINGS_WRITTEN;
use crate::shot::written::WrittenCrossings;
use crate::shot::{RunOptions, RunReport, Shot, ShotError};

/// What is being written.
pub(super) struct Output {
    folder: PathBuf,
    manifest: Manifest,
    record: RunRecord,
    /// The caches of each garment.
    writers: Vec<Vec<Box<dyn CacheWriter>>>,
    /// Looks at what is written, in scenes that promise cloth without crossings.
    written: Option<WrittenCrossings>,
    positions: Vec<Vec3>,
    velocities: Vec<Vec3>,
}

/// A cache to be: garment, file, and how it is made.
struct Planned {
    garment: usize,
    path: PathBuf,
    create: CreateCache,
}

impl Output {
    /// Prepares the folder. Nothing of an earlier run is touched unless it may be replaced.
    pub(super) fn create(shot: &Shot, options: &RunOptions) -> Result<Self, IoError> {
        let folder = options.out.clone();
        let planned = planned(shot, &folder);
        let mut old: Vec<PathBuf> = [MANIFEST, RECORD, RESOLVED].map(|name| folder.join(name)).into();
        old.extend(planned.iter().map(|cache| cache.path.clone()));
        // Caches of the earlier run that this one does not write again would belong to nothing.
        old.extend(run_record::listed_files(&folder));
        old.retain(|path| path.exists());
        refuse_inputs(shot, &old)?;
        if let (Some(path), false) = (old.first(), options.overwrite) {
            return Err(IoError::OutputExists { path: path.clone() });
        }
        old.sort();
        old.dedup();
        for path in old {
            fs::remove_file(&path).map_err(|e| IoError::creating(&path, e))?;
        }
        fs::create_dir_all(&folder).map_err(|e| IoError::creating(&folder, e))?;
        atomic_file::replace(&folder.join(RESOLVED), shot.about.resolved.as_bytes())?;
        let mut record = RunRecord::create(&folder)?;
        record.line(&shot.header(options.threads))?;
        let mut writers: Vec<Vec<_>> = shot.garments.iter().map(|_| Vec::new()).collect();
        let written = WrittenCrossings::new(&shot.simulation, shot.about.output.units);
        for cache in &planned {
            writers[cache.garment].push(create(shot, cache, written.is_some())?);
        }
        let manifest = manifest(shot, options, &planned);
        manifest.write(&folder)?;
        Ok(Self { folder, manifest, record, writers, written, positions: Vec::new(), velocities: Vec::new() })
    }

    /// The cache files.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        self.writers.iter().flatten().map(|writer| writer.path().to_owned()).collect()
    }

    /// Writes the state of the simulation as a frame of every cache, then tells the manifest.
    pub(super) fn write_frame(
        &mut self,
        frame: i64,
        simulation: &Simulation,
        spent: &mut Metrics,
    ) -> Result<(), IoError> {
        let written = self.written.as_mut();
        let crossings = written.map(|check| spent.stage("check caches", |_| check.crossings_of_written(simulation)));
        if let Some(count) = crossings {
            spent.count(CROSSINGS_WRITTEN, u64::from(count));
        }
        spent.stage("write caches", |_| self.write_caches(frame, simulation, crossings))?;
        self.manifest.last_complete_frame = Some(frame);
        self.manifest.write(&self.folder)
    }

    fn write_caches(&mut self, frame: i64, simulation: &Simulation, crossings: Option<u32>) -> Result<(), IoError> {
        for (garment, writers) in self.writers.iter_mut().enumerate() {
            simulation.garment_positions(garment, &mut self.positions);
            simulation.garment_velocities(garment, &mut self.velocities);
            let (positions, velocities) = (self.positions.as_slice(), self.velocities.as_slice());
            for writer in writers {
                writer.write(&CacheFrame { frame, positions, velocities, crossings })?;
            }
        }
        Ok(())
    }

    /// Appends a line to the record.
    pub(super) fn record(&mut self, line: &Value) -> Result<(), IoError> {
        self.record.line(line)
    }

    /// Brings everything to the disk and says that the run is complete.
    pub(super) fn finish(&mut self, report: &RunReport) -> Result<(), IoError> {
        for writer in self.writers.iter_mut().flatten() {
            writer.finish()?;
        }
        self.record.line(&json!({
            "record": "end",
            "state": "done",
            "frames": report.frames,
            "seconds": report.seconds,
            "stages": run_record::stages(&report.metrics),
            "counts": run_record::counts(&report.metrics),
        }))?;
        self.manifest.state = "done";
        self.manifest.write(&self.folder)
    }

    /// Says that the run ended early, and why. The caches keep the frames before.
    pub(super) fn fail(&mut self, error: &ShotError) -> Result<(), IoError> {
        for writer in self.writers.iter_mut().flatten() {
            writer.finish()?;
        }
        self.record.line(&json!({"record": "end", "state": "failed", "error": error.to_string()}))?;
        self.manifest.state = "failed";
        self.manifest.error = Some(error.to_string());
        self.manifest.write(&self.folder)
    }
}

fn garment_names(shot: &Shot) -> impl Iterator<Item = &str> {
    shot.simulation.scene().description().garments.iter().map(|garment| garment.name.as_str())
}

fn planned(shot: &Shot, folder: &Path) -> Vec<Planned> {
    let formats = shot.about.output.formats.iter().filter_map(|word| formats::by_extension(word));
    let writable: Vec<_> = formats.filter_map(|format| Some((format.extension, format.create?))).collect();
    let caches = |(garment, name): (usize, &str)| {
        let path = |extension: &str| folder.join(format!("{name}.{extension}"));
        writable.iter().map(|(extension, create)| Planned { garment, path: path(extension), create: *create }).collect()
    };
    garment_names(shot).enumerate().flat_map(|named| -> Vec<Planned> { caches(named) }).collect()
}

/// An output that is an input of the same shot would be destroyed before it is read.
fn refuse_inputs(shot: &Shot, outputs: &[PathBuf]) -> Result<(), IoError> {
    let real = |path: &PathBuf| fs::canonicalize(path).ok();
    let inputs: Vec<PathBuf> = shot.about.input_files.iter().chain([&shot.about.scene_path]).filter_map(real).collect();
    match outputs.iter().find(|output| real(output).is_some_and(|output| inputs.contains(&output))) {
        Some(output) => Err(IoError::OutputIsInput { path: output.clone() }),
        None => Ok(()),
    }
}

fn create(shot: &Shot, cache: &Planned, crossings: bool) -> Result<Box<dyn CacheWriter>, IoError> {
    let (about, scene) = (&shot.about, shot.simulation.scene());
    let plan = CachePlan {
        garment: &scene.description().garments[cache.garment].name,
        mesh: &shot.garments[cache.garment],
        triangles: scene.meshes()[cache.garment].triangles(),
        units: about.output.units,
        timeline: about.timeline,
        first_frame: about.timeline.origin,
        last_frame: about.last_frame,
        velocities: about.output.velocities,
        crossings,
    };
    (cache.create)(&cache.path, &plan)
}

fn manifest(shot: &Shot, options: &RunOptions, planned: &[Planned]) -> Manifest {
    let about = &shot.about;
    let file_name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let garments = garment_names(shot).zip(&shot.garments).enumerate().map(|(index, (name, mesh))| ManifestGarment {
        name: name.to_owned(),
        object_path: if mesh.object_path.is_empty() {
            format!("/{name}/{name}Shape")
        } else {
            mesh.object_path.clone()
        },
        points: mesh.mesh.points.len(),
        files: planned.iter().filter(|cache| cache.garment == index).map(|cache| file_name(&cache.path)).collect(),
    });
    Manifest {
        application: APPLICATION.to_owned(),
        shot: about.name.clone(),
        scene: about.scene_path.display().to_string(),
        state: "running",
        error: None,
        first_frame: about.timeline.origin,
        last_frame: about.last_frame,
        last_complete_frame: None,
        fps: format!("{}/{}", about.timeline.fps_numerator, about.timeline.fps_denominator),
        length_unit: about.output.units.length.word().to_owned(),
        up_axis: format!("{:?}", about.output.units.up),
        garments: garments.collect(),
        threads: options.threads,
    }
}
