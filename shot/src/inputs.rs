//! Everything that moves by files, frame by frame.

use drapery_core::error::{Problem, Problems};
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{BodyShape, PinTarget, Scene, SceneDescription, Timeline, is_possible};
use drapery_core::simulation::FrameInput;
use drapery_io::error::IoError;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::input_motion::{InputMotion, Preroll};
use drapery_io::wind_file::WindFile;

use crate::check::{BodySurface, Span, check_faces, check_motion, check_size, path_warning, spin_warning};
use crate::error::ShotError;
use crate::loose_points;
use crate::remote_simulation::RemoteSimulation;

/// Everything that moves by files.
#[derive(Debug)]
pub(super) struct Inputs {
    pub(super) timeline: Timeline,
    pub(super) preroll: Preroll,
    pub(super) bodies: Vec<Option<InputMotion>>,
    pub(super) tracks: Vec<InputMotion>,
    pub(super) wind: Option<WindFile>,
    /// Samples between a frame and the next, as fractions of a frame, and the frame from which on there are some.
    pub(super) sub_frames: (Vec<f64>, i64),
}

impl Inputs {
    /// Collects the input that the solver needs to reach a frame.
    pub(super) fn at(&self, frame: i64) -> Result<FrameInput, IoError> {
        let samples = |motion: &InputMotion| motion.samples(self.timeline, self.preroll, frame);
        let bodies =
            self.bodies.iter().map(|body| body.as_ref().map_or(Ok(Vec::new()), samples)).collect::<Result<_, _>>()?;
        let tracks = self.tracks.iter().map(samples).collect::<Result<_, _>>()?;
        let wind = self.wind.as_ref().map_or(Ok(Vec::new()), |wind| wind.samples(self.timeline, frame))?;
        Ok(FrameInput { frame, bodies, tracks, wind, output_times: self.output_times(frame) })
    }

    /// Times of the samples between the frame before this one and this one [s].
    fn output_times(&self, frame: i64) -> Vec<f64> {
        let (fractions, from) = &self.sub_frames;
        let (before, duration) = (self.timeline.time(frame - 1), self.timeline.frame_duration());
        let fractions = if frame > *from { fractions.as_slice() } else { &[] };
        fractions.iter().map(|fraction| before + fraction * duration).collect()
    }

    /// Problems of all frames of all inputs.
    pub(super) fn check(
        &self,
        (scene, garments): (&SceneDescription, &[GarmentMesh]),
        last_frame: i64,
        warnings: &mut Vec<String>,
    ) -> Vec<Problem> {
        let span = Span { timeline: self.timeline, last_frame };
        let mut problems = Vec::new();
        for (body, motion) in scene.bodies.iter().zip(&self.bodies) {
            if let (BodyShape::Surface { triangles, point_count }, Some(motion)) = (&body.shape, motion) {
                let surface = BodySurface { triangles, point_count: *point_count, faces_inwards: body.faces_inwards };
                problems.extend(check_motion(motion, span, Some(surface), warnings));
                problems.extend(check_size(motion, span, garments, warnings));
                problems.extend(check_faces(motion, span, triangles, warnings));
            } else {
                let place = format!("body \"{}\"", body.name);
                warnings.extend(path_warning(&place, &body.motion.path));
                if let BodyShape::Rigid(shape) = &body.shape {
                    warnings.extend(spin_warning(&place, shape, &body.motion));
                }
            }
        }
        for (number, pin) in scene.pins.iter().enumerate() {
            if let (PinTarget::Path { offsets, .. }, Some(garment)) = (&pin.target, scene.garments.get(pin.garment)) {
                warnings.extend(path_warning(&format!("garment \"{}\", pin {number}", garment.name), offsets));
            }
        }
        let described = garments.iter().zip(&scene.garments);
        problems.extend(described.filter_map(|(mesh, garment)| loose_points::far_away(mesh, garment)));
        for track in &self.tracks {
            problems.extend(check_motion(track, span, None, warnings));
        }
        problems.extend(self.wind.as_ref().and_then(|wind| wind.check(self.timeline, last_frame)));
        problems
    }

    /// The simulation at its start, or more problems.
    pub(super) fn start(
        &self,
        ranks: &Ranks,
        scene: Scene,
        problems: &mut Vec<Problem>,
    ) -> Result<Option<RemoteSimulation>, ShotError> {
        let input = self.at(self.timeline.start)?;
        let samples = input.bodies.iter().chain(&input.tracks).flatten();
        let wind = input.wind.iter().flat_map(|sample| &sample.velocities);
        if !problems.is_empty() && samples.flat_map(|s| &s.positions).chain(wind).any(|p| !is_possible(p)) {
            // The check of the samples has said so already.
            return Ok(None);
        }
        match RemoteSimulation::start(ranks, scene, input) {
            Ok(remote_simulation) => Ok(Some(remote_simulation)),
            Err(Problems(found)) => {
                problems.extend(found);
                Ok(None)
            }
        }
    }
}
