//! A shot that was checked and can run. Everything is checked before anything is written ([`Shot::prepare`]). The simulation
//! always starts at the scene's first frame minus its pre-roll, because cloth has a history; only the end of the range can
//! be chosen.

use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::effects::cost::FrameCost;
use drapery_core::effects::self_collision;
use drapery_core::error::Problems;
use drapery_core::mesh::MeshStream;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::gather::VertexField;
use drapery_core::scene::{Integrator, Scene, Timeline};
use drapery_core::simulation::Simulation;
use drapery_io::attributes::{Attribute, PointAttributes};
use drapery_io::cache::{APPLICATION, CachePlan};
use drapery_io::checkpoint::FORMAT_VERSION;
use drapery_io::error::IoError;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::memory_mesh::MemoryMeshes;
use drapery_io::mesh_data::MeshData;
use drapery_io::shot_description::{BodyThickness, Fabric, OutputDescription, RenderMeshDescription, ShotDescription};
use drapery_io::units::Units;

use crate::error::ShotError;
use crate::farm::digest::{Fingerprint, Versions};
use crate::inputs::Inputs;
use crate::long_frames;
use crate::point_attributes;
use crate::remote_simulation::RemoteSimulation;
use crate::render_mesh::{JudgedBinding, RenderMesh};
use crate::rules::{self, Facts, Warning};
use crate::single_layer;
use crate::written_faces::{OtherCut, WrittenFaces};

/// A shot that was checked and can run.
pub struct Shot {
    pub(crate) remote_simulation: RemoteSimulation,
    pub(crate) inputs: Inputs,
    pub(crate) garments: Vec<GarmentMesh>,
    /// These as they are written.
    pub(crate) written: Vec<GarmentMesh>,
    pub(crate) render_meshes: Vec<RenderMesh>,
    /// Attributes at the points of the caches of garments, then of render meshes.
    pub(crate) attributes: Vec<PointAttributes>,
    pub(crate) about: About,
    pub(crate) warnings: Vec<Warning>,
}

/// Name, end and output of a shot.
#[derive(Debug)]
pub(crate) struct About {
    pub(crate) name: String,
    pub(crate) scene_path: PathBuf,
    pub(crate) input_files: Vec<PathBuf>,
    pub(crate) referred_files: Vec<PathBuf>,
    /// Meshes in memory that it may name beside files.
    pub(crate) meshes: MemoryMeshes,
    pub(crate) timeline: Timeline,
    /// First and last frame that are delivered.
    pub(crate) first_frame: i64,
    pub(crate) last_frame: i64,
    /// Last frame of the scene, also where a run is asked for fewer.
    pub(crate) scene_last_frame: i64,
    /// Names of the garments.
    pub(crate) garments: Vec<String>,
    /// Their materials; `None` where the scene names none.
    pub(crate) fabrics: Vec<Option<Fabric>>,
    /// Whether the scene promises cloth without crossings.
    pub(crate) keeps_free: bool,
    pub(crate) output: OutputDescription,
    /// For each body that is a mesh what its faces and those of the cloth ask for.
    pub(crate) body_thickness: Vec<Option<BodyThickness>>,
    pub(crate) resolved: String,
}

/// Size of a render mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenderMeshSize<'a> {
    /// Its name, by which its caches are called.
    pub name: &'a str,
    /// The garment that it follows.
    pub garment: &'a str,
    /// Number of points.
    pub points: usize,
    /// Number of triangles that its faces are cut into.
    pub triangles: usize,
    /// Size of a sample of it in a cache [bytes].
    pub bytes_per_sample: usize,
}

impl Shot {
    /// [`Shot::prepare_on`] one rank.
    ///
    /// # Errors
    /// As there.
    pub fn prepare(description: ShotDescription, frames: Option<[i64; 2]>) -> Result<Self, ShotError> {
        Self::prepare_on(&Ranks::default(), description, frames)
    }

    /// Checks the scene and every frame of its inputs, and builds the simulation at its start. Writes nothing.
    ///
    /// `frames` are the first and last frame asked for; the whole range of the scene when `None`. This is rank 0 of `ranks`;
    /// the others follow until they are dismissed, also when there is an error.
    ///
    /// # Errors
    /// All problems at once; a file that cannot be read; frames that cannot be simulated.
    pub fn prepare_on(
        ranks: &Ranks,
        description: ShotDescription,
        frames: Option<[i64; 2]>,
    ) -> Result<Self, ShotError> {
        let ShotDescription { scene, bodies, tracks, wind, garments, render_meshes, preroll, output, .. } = description;
        let mut warnings = description.warnings;
        let last_frame = last_frame(description.frames, frames)?;
        let timeline = scene.timeline;
        let first_frame = if output.preroll { timeline.start } else { timeline.origin };
        let sub_frames = (output.sub_frames.clone(), first_frame);
        let inputs = Inputs { timeline, preroll, bodies, tracks, wind, sub_frames };
        let mut problems = inputs.check((&scene, &garments), last_frame, &mut warnings);
        problems.extend(single_layer::problem(&output, [first_frame, last_frame], (&garments, &render_meshes)));
        let (check, body_thickness) = (description.check, description.body_thickness);
        let points: Vec<usize> = garments.iter().map(MeshStream::point_count).collect();
        let thickness = point_attributes::thickness_of(&scene, &output, &points);
        let facts = Facts {
            scene: &scene,
            inputs: &inputs,
            garments: &garments,
            output: &output,
            check: &check,
            body_thickness: &body_thickness,
            last_frame: description.frames[1],
        };
        let mut of_rules = rules::of_scene(&facts);
        let about = About {
            name: description.name,
            scene_path: description.scene_path,
            input_files: description.input_files,
            referred_files: description.referred_files,
            meshes: description.meshes,
            timeline,
            first_frame,
            last_frame,
            scene_last_frame: description.frames[1],
            garments: scene.garments.iter().map(|garment| garment.name.clone()).collect(),
            fabrics: check.fabrics.clone(),
            keeps_free: scene.effects.iter().any(|request| request.effect == self_collision::SPEC.name),
            output,
            body_thickness,
            resolved: description.resolved,
        };
        let remote_simulation = match RemoteSimulation::distribute(ranks, scene) {
            Err(Problems(found)) => {
                problems.extend(found);
                None
            }
            Ok(scene) => {
                warnings.extend_from_slice(scene.warnings());
                inputs.start(ranks, scene, &mut problems)?
            }
        };
        if let Some(remote_simulation) = &remote_simulation {
            let (simulation, min_dt) =
                (remote_simulation.simulation(), remote_simulation.simulation().scene().description().solver.min_dt);
            problems.extend(long_frames::judge(&simulation.planned_steps(), min_dt, &mut warnings));
        }
        let Some(remote_simulation) = remote_simulation.filter(|_| problems.is_empty()) else {
            problems.iter_mut().for_each(|problem| problem.place = check.with_line(&problem.place));
            return Err(ShotError::Problems(Problems(problems)));
        };
        warnings.extend_from_slice(remote_simulation.simulation().warnings());
        of_rules.extend(rules::of_simulation(remote_simulation.simulation(), &check.silenced));
        let written = if about.output.triangles { cut(&garments)? } else { garments.clone() };
        let cuts = start_cuts(&written, &inputs, &remote_simulation, about.output.units)?;
        of_rules.extend(rules::of_other_cuts(&cuts, &check.silenced));
        let bind = |mesh: RenderMeshDescription| {
            let garment = (&garments[mesh.garment], about.garments[mesh.garment].as_str());
            RenderMesh::bind(mesh, garment)
        };
        let bound = render_meshes.into_iter().map(bind).collect::<Result<Vec<_>, _>>()?;
        let (render_meshes, bindings): (Vec<RenderMesh>, Vec<JudgedBinding>) = bound.into_iter().unzip();
        warnings.extend(bindings.iter().filter_map(JudgedBinding::loose_in_words));
        of_rules.extend(rules::of_bindings(&bindings, &check.silenced));
        let origin = remote_simulation.simulation().scene().origin();
        let attributes = point_attributes::planned(&about.output, origin, (&written, &thickness), &render_meshes)?;
        of_rules.iter_mut().for_each(|warning| warning.object = check.with_line(&warning.object));
        let warnings = warnings.into_iter().map(Warning::from).chain(of_rules).collect();
        Ok(Self { remote_simulation, inputs, garments, written, render_meshes, attributes, about, warnings })
    }

    /// Returns warnings about suspicious input that was accepted.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The simulation at its start: what will run, and why.
    pub fn simulation(&self) -> &Simulation {
        self.remote_simulation.simulation()
    }

    /// Simulates the first frames after the start, in memory and on one rank, and says what one of them has cost in the mean.
    ///
    /// # Errors
    /// An input breaks; the solver gives up.
    pub fn trial(mut self, frames: u32) -> Result<FrameCost, ShotError> {
        let start = self.about.timeline.start;
        let inputs = (1..=i64::from(frames)).map(|frame| self.inputs.at(start + frame));
        self.remote_simulation.trial(inputs)
    }

    /// Name of the shot.
    pub fn name(&self) -> &str {
        &self.about.name
    }

    /// First and last frame that are delivered.
    pub fn frames(&self) -> [i64; 2] {
        [self.about.first_frame, self.about.last_frame]
    }

    /// Frame rate, first frame and start of the simulation.
    pub fn timeline(&self) -> Timeline {
        self.about.timeline
    }

    /// Returns the description of the output.
    pub fn output(&self) -> &OutputDescription {
        &self.about.output
    }

    /// Bytes of the attributes of all garments in a sample of their caches, in each format, and of those that are there once.
    pub fn attribute_bytes(&self) -> [usize; 2] {
        let points: usize = self.written.iter().map(MeshStream::point_count).sum();
        point_attributes::bytes_per_point(&self.about.output).map(|bytes| bytes * points)
    }

    /// For each body that is a mesh what keeps coarse faces from showing through, and whether the scene says otherwise; `None` for
    /// the others.
    pub fn body_thickness(&self) -> &[Option<BodyThickness>] {
        &self.about.body_thickness
    }

    /// The file of the whole shot in this folder, if the scene asks for one.
    pub(crate) fn single_layer(&self, folder: &Path) -> Option<PathBuf> {
        single_layer::path(&self.about.output, &self.about.name, folder)
    }

    /// Returns the origin of the positions in the caches [m].
    pub fn origin(&self) -> Vec3 {
        self.simulation().scene().origin()
    }

    /// Plan of a cache of this name that holds positions and velocities of a mesh.
    pub(crate) fn cache_plan<'a>(&'a self, name: &'a str, mesh: &'a GarmentMesh) -> CachePlan<'a> {
        let about = &self.about;
        CachePlan {
            garment: name,
            mesh,
            units: about.output.units,
            origin: self.origin(),
            timeline: about.timeline,
            first_frame: about.first_frame,
            last_frame: about.last_frame,
            velocities: about.output.velocities,
            normals: false,
            crossings: false,
            sub_frames: &about.output.sub_frames,
            attributes: PointAttributes::default(),
        }
    }

    /// Files that are read and that the scene does not name: layers that others refer to, from whatever folder.
    pub fn referred_files(&self) -> &[PathBuf] {
        &self.about.referred_files
    }

    /// The scene with every default written out.
    pub fn resolved(&self) -> &str {
        &self.about.resolved
    }

    /// Computes the fingerprint of the dependencies of the shot: the scene, its inputs and the program.
    ///
    /// # Errors
    /// An input cannot be read.
    pub fn fingerprint(&self) -> Result<Fingerprint, IoError> {
        let about = &self.about;
        let (format, application) = (FORMAT_VERSION, APPLICATION);
        let scene = self.simulation().scene();
        let chosen = scene.description().solver.integrator;
        let integrator = if scene.may_change_integrator() { Integrator::Auto } else { chosen };
        let (solver, integrator) = (drapery_core::solver_version(integrator), integrator.word());
        let versions = Versions { solver, integrator, format, application };
        let of_files = Fingerprint::of(&about.resolved, &about.scene_path, &about.input_files, versions)?;
        Ok(of_files.with_meshes(&about.meshes))
    }

    /// The mesh of a garment as it comes from its file, with everything that is handed through.
    ///
    /// # Errors
    /// It can no longer be read, or has changed.
    ///
    /// # Panics
    /// There is no such garment.
    pub fn garment_mesh(&self, garment: usize) -> Result<MeshData, IoError> {
        self.garments[garment].read()
    }

    /// Meshes that are rendered in the place of garments.
    pub fn render_meshes(&self) -> impl Iterator<Item = RenderMeshSize<'_>> {
        let output = &self.about.output;
        let [moving, _] = point_attributes::bytes_per_point(output);
        // They have normals anyway.
        let others = moving - if output.has(Attribute::Normals) { Attribute::Normals.bytes() } else { 0 };
        self.render_meshes.iter().map(move |mesh| RenderMeshSize {
            name: &mesh.name,
            garment: &self.about.garments[mesh.garment],
            points: mesh.mesh.point_count(),
            triangles: mesh.triangle_count(),
            bytes_per_sample: mesh.bytes_per_sample(output.velocities) + mesh.mesh.point_count() * others,
        })
    }

    /// Names of the caches: of all garments, then of all render meshes.
    pub(crate) fn cache_names(&self) -> impl Iterator<Item = &str> {
        self.about.garments.iter().chain(self.render_meshes.iter().map(|mesh| &mesh.name)).map(String::as_str)
    }

    /// Number of frames that a run computes, pre-roll included.
    pub fn frame_count(&self) -> u64 {
        self.about.last_frame.abs_diff(self.about.timeline.start) + 1
    }
}

/// Garments with the triangles that are simulated.
fn cut(garments: &[GarmentMesh]) -> Result<Vec<GarmentMesh>, IoError> {
    garments.iter().map(GarmentMesh::cut).collect()
}

/// Finds crossings at the start along diagonals that the solver does not take.
fn start_cuts(
    written: &[GarmentMesh],
    inputs: &Inputs,
    remote_simulation: &RemoteSimulation,
    units: Units,
) -> Result<Vec<OtherCut>, IoError> {
    let simulation = remote_simulation.simulation();
    let Some(mut faces) = WrittenFaces::of(written, inputs, simulation, units)? else { return Ok(Vec::new()) };
    for garment in 0..written.len() {
        faces.place(garment, &remote_simulation.stored(garment, VertexField::Positions, units));
    }
    Ok(faces.find(simulation))
}

/// Refuses a description for what can be seen without building the simulation, such as a setting that its integrator does not have.
///
/// # Errors
/// All problems at once.
pub fn check_description(description: &ShotDescription) -> Result<(), ShotError> {
    let mut problems = Scene::problems_of(&description.scene);
    problems.iter_mut().for_each(|problem| problem.place = description.check.with_line(&problem.place));
    if problems.is_empty() { Ok(()) } else { Err(ShotError::Problems(Problems(problems))) }
}

/// Returns the last frame of a run that is asked for these frames of a scene.
///
/// # Errors
/// The range starts elsewhere than the scene's own, or ends after it: frames that are not delivered are not left out silently.
pub fn last_frame(scene: [i64; 2], asked: Option<[i64; 2]>) -> Result<i64, ShotError> {
    let [scene_first, scene_last] = scene;
    let Some([first, last]) = asked else {
        return Ok(scene_last);
    };
    if first != scene_first || last < scene_first {
        return Err(ShotError::Frames(format!(
            "frames {first}-{last}: cloth depends on the frames before, so a run starts at frame {scene_first}\n  \
             help: ask for {scene_first}-{} and use the part that you need; --set shot.frames=A-B changes the frames \
             of the scene",
            last.clamp(scene_first, scene_last.max(scene_first))
        )));
    }
    if last > scene_last {
        return Err(ShotError::Frames(format!(
            "frames {first}-{last}: the shot ends at frame {scene_last}\n  \
             help: ask for {scene_first}-{scene_last}, or extend the scene, if its inputs cover these frames, with \
             --set shot.frames={first}-{last}"
        )));
    }
    Ok(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_starts_at_the_first_frame_and_asks_for_no_frame_that_the_shot_does_not_have() {
        let of = |asked| last_frame([1001, 1100], asked);
        let refused = |asked| of(Some(asked)).unwrap_err().to_string();
        assert_eq!(of(None).unwrap(), 1100);
        assert_eq!(of(Some([1001, 1010])).unwrap(), 1010);
        assert_eq!(of(Some([1001, 1100])).unwrap(), 1100);
        let long = refused([1001, 1200]);
        assert!(long.contains("the shot ends at frame 1100") && long.contains("shot.frames=1001-1200"), "{long}");
        let late = refused([1050, 1060]);
        assert!(late.contains("1001-1060"), "{late}");
        let early = refused([990, 1010]);
        assert!(early.contains("starts at frame 1001") && early.contains("ask for 1001-1010"), "{early}");
        assert!(of(Some([900, 950])).is_err());
    }
}
