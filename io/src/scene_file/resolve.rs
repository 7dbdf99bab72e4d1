//! From the scene file to the solver's description: units, files, shapes.

use std::path::PathBuf;

use drapery_core::Vec3;
use drapery_core::effects::{INPUTS, REGISTRY};
use drapery_core::geometry::coarseness::Ridges;
use drapery_core::scene::{Described, EffectRequest, PinTarget, SceneDescription, SolverSettings, Timeline};
use drapery_core::settings::{Dimension, Field, SettingValue, Settings};

use crate::attributes::Attribute;
use crate::error::IoError;
use crate::formats::by_extension;
use crate::garment_mesh::GarmentMesh;
use crate::input_motion::{InputMotion, Preroll};
use crate::mesh_data::MeshData;
use crate::mesh_source::MeshSource;
use crate::shot_description::{FRAMES, OutputDescription, RenderMeshDescription, ShotDescription};
use crate::units::Units;
use crate::wind_file::WindFile;

use super::deserialize::dotted;
use super::diagnostics::{SceneErrorKind, SceneFileError};
use super::frame_rate::frame_rate;
use super::memory::{Memory, NoRoom};
use super::raw::{self, FileUnits, Quantity};
use super::tree::{Path, Segment};
use super::{SceneFile, curves, effects, fields, file_names, ranges, resolved, thickness};

/// Data of a garment that pins need.
pub(super) struct ReadGarment<'a> {
    pub(super) points: usize,
    /// Its rest shape.
    pub(super) mesh: &'a GarmentMesh,
    /// Start positions of its points, if a pin looks.
    pub(super) places: &'a [Vec3],
    pub(super) grid: Option<[u32; 2]>,
    pub(super) units: Option<FileUnits>,
}

/// Collects what is read and every problem on the way.
pub(super) struct Resolver<'a> {
    pub(super) scene: &'a SceneFile,
    errors: Vec<SceneFileError>,
    timeline: Timeline,
    preroll: Preroll,
    pub(super) description: SceneDescription,
    pub(super) garments: Vec<GarmentMesh>,
    pub(super) render_meshes: Vec<RenderMeshDescription>,
    /// Points of each garment along both directions of its panel, if it is one.
    pub(super) grids: Vec<Option<[u32; 2]>>,
    /// For each body its file; `None` for ideal shapes and for bodies that could not be read.
    pub(super) bodies: Vec<Option<InputMotion>>,
    /// The edges of each of these.
    pub(super) ridges: Vec<Option<Ridges>>,
    pub(super) tracks: Vec<InputMotion>,
    pub(super) wind: Option<WindFile>,
    pub(super) input_files: Vec<PathBuf>,
    pub(super) referred_files: Vec<PathBuf>,
    /// Warnings about files that can be read.
    warnings: Vec<String>,
    /// The unit [m] that a body's file states, where its size shows that it is not meant.
    pub(super) misstated: Option<f64>,
    /// Memory that the garments so far need.
    pub(super) memory: Memory,
}

/// Resolves a scene file for a number of ranks.
pub(super) fn resolve(scene: &SceneFile, ranks: usize) -> Result<ShotDescription, Vec<SceneFileError>> {
    let document = &scene.document;
    let mut resolver = Resolver {
        scene,
        errors: Vec::new(),
        timeline: Timeline::default(),
        preroll: Preroll { settle: document.shot.preroll.settle, blend: document.shot.preroll.blend },
        description: SceneDescription::new(&document.shot.name),
        garments: Vec::new(),
        render_meshes: Vec::new(),
        grids: Vec::new(),
        bodies: Vec::new(),
        ridges: Vec::new(),
        tracks: Vec::new(),
        wind: None,
        input_files: scene.material_files.clone(),
        referred_files: Vec::new(),
        warnings: Vec::new(),
        misstated: None,
        memory: Memory::new(scene, ranks),
    };
    // Without frames no file can be asked for a pose, so this is reported alone.
    let Some((first, last)) = resolver.shot() else {
        return Err(resolver.errors);
    };
    resolver.solver();
    for (index, body) in document.body.iter().enumerate() {
        resolver.body(body, &Path::default().key("body").index(index));
    }
    for (index, garment) in document.garment.iter().enumerate() {
        resolver.garment(garment, &Path::default().key("garment").index(index));
    }
    if document.garment.is_empty() {
        resolver.error_with(&Path::default(), "the scene has no garment", "add a [[garment]]".to_owned());
    }
    let (ridges, bodies) = (std::mem::take(&mut resolver.ridges), &mut resolver.description.bodies);
    let body_thickness = thickness::of_bodies(&scene.root, ridges, &resolver.garments, bodies);
    for (index, seam) in document.seam.iter().enumerate() {
        resolver.seam(seam, &Path::default().key("seam").index(index));
    }
    resolver.contacts();
    resolver.effects(last);
    resolver.output();
    let check = resolver.check_description();
    if !resolver.errors.is_empty() {
        return Err(resolver.errors);
    }
    // What material files say is written out.
    let named_files = resolver.input_files[scene.material_files.len()..].to_vec();
    if !scene.path.as_os_str().is_empty() {
        resolver.input_files.insert(0, scene.path.clone());
    }
    let root = thickness::root(scene, &resolver.description, &body_thickness);
    let resolved = resolved::write(scene, &curves::put_back(root, &scene.curves, &scene.map_curves));
    let unnamed = file_names::not_utf8(&named_files);
    Ok(ShotDescription {
        name: document.shot.name.clone(),
        scene_path: scene.path.clone(),
        input_files: resolver.input_files,
        referred_files: resolver.referred_files,
        meshes: scene.meshes.clone(),
        scene: resolver.description,
        bodies: resolver.bodies,
        tracks: resolver.tracks,
        wind: resolver.wind,
        garments: resolver.garments,
        render_meshes: resolver.render_meshes,
        frames: [first, last],
        preroll: resolver.preroll,
        output: output(scene),
        check,
        resolved,
        body_thickness,
        warnings: file_names::one_on_some_disks(&document.garment)
            .into_iter()
            .chain(unnamed)
            .chain(resolver.warnings)
            .collect(),
    })
}

pub(super) fn written(units: FileUnits) -> Units {
    Units { length: units.length, up: units.up }
}

fn output(scene: &SceneFile) -> OutputDescription {
    let output = &scene.document.output;
    let word = |format: &raw::Format| match format {
        raw::Format::Abc => "abc".to_owned(),
        raw::Format::H5 => "h5".to_owned(),
        raw::Format::Usd => "usd".to_owned(),
    };
    let mut attributes: Vec<Attribute> = output.attributes.iter().map(|written| (*written).into()).collect();
    attributes.sort_unstable();
    attributes.dedup();
    OutputDescription {
        attributes,
        formats: output.format.iter().map(word).collect(),
        units: scene.document.units.map_or(Units::SI, written),
        velocities: output.velocities,
        sub_frames: output.sub_frames(),
        preroll: output.preroll,
        usd_single: output.usd_single,
        triangles: output.faces == raw::Faces::Triangles,
    }
}

impl Resolver<'_> {
    /// Checks what is to be written.
    fn output(&mut self) {
        self.formats();
        self.attributes();
        self.shutter();
        self.single_layer();
    }

    /// Records a problem at a path.
    pub(super) fn error(&mut self, path: &Path, message: impl Into<String>) {
        self.errors.push(self.scene.sources.error(&path.place(&self.scene.root), message, None));
    }

    /// Records a problem and what to do about it.
    pub(super) fn error_with(&mut self, path: &Path, message: impl Into<String>, help: String) {
        self.errors.push(self.scene.sources.error(&path.place(&self.scene.root), message, Some(help)));
    }

    /// Records a problem of a file's content.
    pub(super) fn data_error(&mut self, path: &Path, message: impl Into<String>, help: String) {
        let error = self.scene.sources.error(&path.place(&self.scene.root), message, Some(help));
        self.errors.push(SceneFileError { kind: SceneErrorKind::Data, ..error });
    }

    /// Takes note of a garment of `points` points; refuses it, as a lack of memory, where they have no room. Called before its
    /// points are anywhere.
    pub(super) fn has_room(&mut self, path: &Path, points: f64) -> Option<()> {
        self.has_room_for(path, points, self.memory.of_point(path))
    }

    /// The same for points that take so much each [bytes].
    pub(super) fn has_room_for(&mut self, path: &Path, points: f64, of_point: f64) -> Option<()> {
        let Err(NoRoom { what, advice }) = self.memory.take(points, of_point) else {
            return Some(());
        };
        let error = self.scene.sources.error(&path.place(&self.scene.root), what, Some(advice));
        self.errors.push(SceneFileError { kind: SceneErrorKind::Memory, ..error });
        None
    }

    /// The value, or `None` after recording why there is none.
    pub(super) fn check<T>(&mut self, path: &Path, result: Result<T, String>) -> Option<T> {
        result.map_err(|message| self.error(path, message)).ok()
    }

    /// The value, or `None` after recording what is wrong with a file.
    pub(super) fn of_file<T>(&mut self, path: &Path, result: Result<T, IoError>) -> Option<T> {
        // What no object of the file has is `path`, which stands beside the name of the file.
        let beside = || Path([&path.0[..path.0.len() - 1], &[Segment::Key("path".to_owned())]].concat());
        let is_path = |error: &IoError| error.to_string().contains("no mesh path matches");
        let place = match &result {
            Err(error) if is_path(error) && !path.0.is_empty() => beside().place(&self.scene.root),
            _ => path.place(&self.scene.root),
        };
        let location = self.scene.sources.location(&place);
        result.map_err(|error| self.errors.push(SceneFileError::of_file(Some(location), &error))).ok()
    }

    /// A number of a dimension, in the range of its key.
    pub(super) fn quantity(&mut self, path: &Path, quantity: &Quantity, dimension: Dimension) -> Option<f64> {
        let value = self.check(path, quantity.si(dimension))?;
        let in_range = ranges::at(path).map_or(Ok(()), |range| range.check(value));
        let at_key = |what| format!("`{}` [{}]: {what}", dotted(path), dimension.si_unit());
        self.check(path, in_range.map_err(at_key))?;
        Some(value)
    }

    /// Takes note of what somebody should know of a file.
    pub(super) fn warn(&mut self, file: &str, note: &str) {
        let text = format!("{file}: {note}");
        if !self.warnings.contains(&text) {
            self.warnings.push(text);
        }
    }

    /// Takes note of a file that the shot reads.
    pub(super) fn takes(&mut self, file: PathBuf) {
        if !self.input_files.contains(&file) {
            self.input_files.push(file);
        }
    }

    /// Reads a mesh at a time of its file [s], its first sample when `None`; problems point at `path`.
    pub(super) fn mesh(&mut self, path: &Path, source: &MeshSource, time: Option<f64>) -> Option<MeshData> {
        let read = source.mesh_at(time.unwrap_or_else(|| source.first_time()));
        self.of_file(path, read)
    }

    /// Time of the shot's first frame in files [s].
    pub(super) fn first_file_time(&self) -> f64 {
        self.timeline.file_time(self.timeline.origin)
    }

    /// Splits `"file.abc@101"` into the file and the time of the frame in it.
    pub(super) fn file_at(&mut self, path: &Path, text: &str) -> Option<(String, Option<f64>)> {
        let Some((file, frame)) = text.rsplit_once('@') else {
            return Some((text.to_owned(), None));
        };
        match frame.trim().parse::<f64>() {
            Ok(frame) if frame.is_finite() => Some((file.to_owned(), Some(frame * self.timeline.frame_duration()))),
            _ => {
                self.error_with(path, format!("`{frame}` is not a frame"), "write \"file.abc@101\"".to_owned());
                None
            }
        }
    }

    /// The time in a file [s] of the frame that stands behind its name, or of its first sample without one. A frame outside of its
    /// samples is refused.
    pub(super) fn time_in(&mut self, path: &Path, source: &MeshSource, asked: Option<f64>) -> Option<f64> {
        let Some(time) = asked else { return Some(source.first_time()) };
        if source.covers(time, time) {
            return Some(time);
        }
        let duration = self.timeline.frame_duration();
        let frame = |time: f64| (time / duration * 1e3).round() / 1e3;
        let (Some(first), Some(last)) = (source.sample_times().first(), source.sample_times().last()) else {
            return Some(time);
        };
        let what = format!(
            "frame {} is outside of the samples of {}, which cover frames {} to {} at {:.6} fps",
            frame(time),
            source.path().display(),
            frame(*first),
            frame(*last),
            1.0 / duration
        );
        self.data_error(path, what, "choose one of these frames, or export this frame too; check shot.fps".to_owned());
        None
    }

    fn shot(&mut self) -> Option<(i64, i64)> {
        let shot = &self.scene.document.shot;
        let here = Path::default().key("shot");
        if let Err(what) = file_names::usable_for_folder(&shot.name) {
            let help = "use letters, digits, _ and -; it names the folder of the run".to_owned();
            self.error_with(
                &here.clone().key("name"),
                format!("{:?} cannot be the name of a shot: {what}", shot.name),
                help,
            );
        }
        let fps = self.check(&here.clone().key("fps"), frame_rate(&shot.fps));
        let frames = self.check(&here.key("frames"), frame_range(&shot.frames));
        let ((fps_numerator, fps_denominator), (first, last)) = (fps?, frames?);
        let start = first - self.preroll.frames();
        if let raw::Origin::At(place) = shot.origin {
            self.description.origin = Some(place.into());
        }
        self.timeline = Timeline { fps_numerator, fps_denominator, origin: first, start };
        self.description.timeline = self.timeline;
        Some((first, last))
    }

    fn solver(&mut self) {
        let settings = self.settings(&Path::default().key("solver"), SolverSettings::FIELDS);
        self.description.solver = SolverSettings::of(&settings);
    }

    /// Returns the settings that the table at a path states by these rows, with their defaults.
    pub(super) fn settings(&self, path: &Path, fields: &[Field]) -> Settings {
        fields::settings(path.find(&self.scene.root), fields)
    }

    /// A shutter that does not open before it closes, or that nothing samples; samples that nothing holds.
    fn shutter(&mut self) {
        let raw::Output { samples, shutter: [open, close], .. } = self.scene.document.output;
        let here = Path::default().key("output").key("shutter");
        if !(open < close && close - open <= 1.0) {
            let what = format!("the shutter from {open} to {close} is empty, or longer than a frame");
            self.error_with(&here, what, "write when it opens and closes, as in [-0.25, 0.25]".to_owned());
        } else if samples == 1 && [open, close] != raw::Output::default().shutter {
            let help = "write samples = 3 beside it, or leave it out".to_owned();
            self.error_with(&here, "`shutter` requires `samples` above 1", help);
        }
    }

    /// One layer of caches that are not written.
    fn single_layer(&mut self) {
        let output = &self.scene.document.output;
        if output.usd_single && !output.format.iter().any(|format| matches!(format, raw::Format::Usd)) {
            let here = Path::default().key("output").key("usd_single");
            let help = "add \"usd\" to output.format, or leave usd_single out".to_owned();
            self.error_with(&here, "there are no USD caches that could be one layer", help);
        }
    }

    /// Attributes that are named twice.
    fn attributes(&mut self) {
        let written = &self.scene.document.output.attributes;
        for index in (0..written.len()).filter(|index| written[..*index].contains(&written[*index])) {
            let here = Path::default().key("output").key("attributes").index(index);
            let word = Attribute::from(written[index]).word();
            self.error_with(&here, format!("the attribute \"{word}\" is listed twice"), "list it once".to_owned());
        }
    }

    /// Formats that are named twice, or that are not in this build of the program.
    fn formats(&mut self) {
        let words = output(self.scene).formats;
        for (index, word) in words.iter().enumerate().filter(|(index, word)| words[..*index].contains(word)) {
            let here = Path::default().key("output").key("format").index(index);
            self.error_with(&here, format!("the format \"{word}\" is listed twice"), "list it once".to_owned());
        }
        for (index, word) in words.iter().enumerate().filter(|(_, word)| by_extension(word).is_none()) {
            self.error_with(
                &Path::default().key("output").key("format").index(index),
                format!("this program was built without the format \"{word}\""),
                format!("build it with `make build`, or with --features {word} --ignore-rust-version"),
            );
        }
    }

    /// Requests of the tables, and those that bodies and pins imply.
    fn effects(&mut self, last_frame: i64) {
        let mut requests = effects::requests(&self.scene.root);
        for input in INPUTS.iter().filter(|input| input.asks.is_some_and(|asks| asks(&self.description))) {
            let because = (input.because)(&self.description);
            if !because.is_empty() {
                requests.push(EffectRequest { because, ..EffectRequest::of_scene(input.effect) });
            }
        }
        self.wind_file(&requests);
        // In the order of the registry, as they run, so that two ways of writing a scene give one description.
        requests.sort_by_key(|r| (REGISTRY.iter().position(|spec| spec.name == r.effect), r.garment));
        self.description.effects = requests;
        self.curves(last_frame);
        self.choose_effects();
    }

    /// Hands the curves to the description. One whose keys all lie before the shot, or all behind it, would never change its number.
    fn curves(&mut self, last_frame: i64) {
        let frames = [self.description.timeline.start, last_frame];
        for curves::Curve { path, number, keys, file, .. } in &self.scene.curves {
            file.iter().for_each(|file| self.takes(file.path.clone()));
            // A property that never changes in its file holds for the whole shot.
            if !(keys.len() == 1 && file.is_some()) {
                self.within_the_shot(path, "this curve", keys.iter().map(|(frame, _)| *frame), frames);
            }
            self.description.curves.insert(number.clone(), keys.clone());
        }
        for curves::MapKeys { path, keys, .. } in &self.scene.map_curves {
            self.within_the_shot(path, "this list of maps", keys.iter().map(|(frame, _)| *frame), frames);
        }
    }

    /// Refuses keys of which none can change anything from the first to the last frame.
    fn within_the_shot(
        &mut self,
        path: &Path,
        what: &str,
        mut keys: impl DoubleEndedIterator<Item = f64>,
        [start, last]: [i64; 2],
    ) {
        let Some(end) = keys.next_back() else { return };
        let begin = keys.next().unwrap_or(end);
        let text = if end < start as f64 {
            format!("{what} ends at frame {end}, before the first frame that is simulated, {start}")
        } else if begin > last as f64 {
            format!("{what} begins at frame {begin}, after the last frame of the shot, {last}")
        } else {
            return;
        };
        self.error_with(path, text, "write keys within the shot, or one value".to_owned());
    }

    /// Does without what `[effects]` leaves out.
    fn choose_effects(&mut self) {
        let scene = self.scene;
        let raw::EffectChoice { without, only } = &scene.document.effects;
        let here = Path::default().key("effects");
        let (key, chosen) = match (without.is_empty(), only.is_empty()) {
            (true, true) => return,
            (false, true) => ("without", self.description.leave_out(without)),
            (true, false) => ("only", self.description.keep_only(only)),
            (false, false) => return self.error(&here, "`without` and `only` exclude each other: give one of them"),
        };
        for problem in chosen.err().into_iter().flatten() {
            self.error_with(&here.clone().key(key), problem.what, problem.advice);
        }
        if self.description.bodies.is_empty() {
            self.bodies.clear();
        }
        self.wind.take_if(|_| self.description.wind.is_none());
        self.drop_idle_tracks();
    }

    /// Tracks that no pin follows are not read.
    fn drop_idle_tracks(&mut self) {
        let mut tracks: Vec<Option<InputMotion>> = self.tracks.drain(..).map(Some).collect();
        for pin in &mut self.description.pins {
            if let PinTarget::Track { track, .. } = &mut pin.target
                && let Some(followed) = tracks.get_mut(*track).and_then(Option::take)
            {
                *track = self.tracks.len();
                self.tracks.push(followed);
            }
        }
    }
}

impl Resolver<'_> {
    /// Opens the grid of the wind, if the scene names a file.
    fn wind_file(&mut self, requests: &[EffectRequest]) {
        let wind = requests.iter().find(|request| request.effect == "wind");
        let Some(SettingValue::Text(file)) = wind.and_then(|wind| wind.settings.get("file")) else { return };
        let file = self.scene.folder.join(file);
        let opened = WindFile::open(&file);
        if !self.input_files.contains(&file) {
            self.input_files.push(file);
        }
        self.wind = self.of_file(&Path::default().key("wind").key("file"), opened);
        self.description.wind = self.wind.as_ref().map(WindFile::shape);
    }
}

/// First and last frame of `"1001-1100"`, `"-10-20"` or `"7"`.
fn frame_range(text: &str) -> Result<(i64, i64), String> {
    let wrong = || format!("`{text}` is not a range of frames; write \"1001-1100\"");
    let text = text.trim();
    // A minus at the very start belongs to the first number.
    let (first, last) = match text.char_indices().skip(1).find(|(_, c)| *c == '-') {
        Some((split, _)) => (&text[..split], &text[split + 1..]),
        None => (text, text),
    };
    let (first, last) = (first.trim().parse().map_err(|_| wrong())?, last.trim().parse().map_err(|_| wrong())?);
    if first > last {
        return Err(format!("the range of frames {first}-{last} runs backwards"));
    }
    if !FRAMES.contains(&first) || !FRAMES.contains(&last) {
        return Err(format!("frames are numbered from {} to {}", FRAMES.start(), FRAMES.end()));
    }
    Ok((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_ranges_may_be_negative_but_not_backwards() {
        assert_eq!(frame_range("1001-1100"), Ok((1001, 1100)));
        assert_eq!(frame_range("-10-20"), Ok((-10, 20)));
        assert_eq!(frame_range("-10--5"), Ok((-10, -5)));
        assert_eq!(frame_range("7"), Ok((7, 7)));
        assert!(frame_range("20-10").unwrap_err().contains("backwards"));
        assert!(frame_range("first-last").is_err());
        // Their difference has no room in 64 bits.
        assert!(frame_range("-9223372036854775807-9223372036854775807").unwrap_err().contains("numbered from"));
    }
}
