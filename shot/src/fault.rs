//! Faults, in the parts that a program needs: the party at fault, as a number that never changes, and the object,
//! frame and element that are meant. The exit codes of the command, and the errors of every other door to the solver,
//! are these.

use std::fmt;
use std::path::Path;

use drapery_core::error::{Problem, ProblemKind, StepError};
use drapery_io::error::{IoError, IoErrorKind};
use drapery_io::scene_file::{SceneErrorKind, SceneFileError};

use crate::error::ShotError;

/// Whose fault it is. The numbers are the exit codes of the command; they never change their meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum FaultKind {
    /// A request is not possible, such as frames that the shot does not have.
    Usage = 2,
    /// An input holds data that cannot be used.
    BadInput = 65,
    /// An input file is missing.
    MissingInput = 66,
    /// A fault of the program itself.
    Internal = 70,
    /// The machine has too little memory for the shot.
    NoMemory = 71,
    /// An output could not be created, or holds another run.
    CannotCreate = 73,
    /// Reading or writing failed.
    Io = 74,
    /// The scene is wrong.
    Scene = 78,
    /// The solver gave up.
    SolverGaveUp = 80,
}

/// Description of an error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Whose fault it is.
    pub kind: FaultKind,
    /// All of it in words: what, where, and what to do.
    pub message: String,
    /// Name of the garment or body, or path of the file, that is meant.
    pub object: Option<String>,
    /// Frame that is meant.
    pub frame: Option<i64>,
    /// Number of the vertex, face, edge or corner that is meant, from 0; of a scene, the line, from 1.
    pub element: Option<u64>,
}

impl Fault {
    /// One that is not about an object.
    pub fn new(kind: FaultKind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into(), object: None, frame: None, element: None }
    }

    /// One at a place in words, as in `body "hero", frame 1003, vertex 12`.
    fn at(kind: FaultKind, message: String, place: &str) -> Self {
        let quoted = place.split('"').nth(1).map(str::to_owned);
        let element = ["vertex", "face", "edge", "point", "corner"];
        let element = element.iter().find_map(|word| number_after(place, word));
        Self {
            object: quoted,
            frame: number_after(place, "frame"),
            element: element.and_then(|number| u64::try_from(number).ok()),
            ..Self::new(kind, message)
        }
    }

    fn of_file(kind: FaultKind, message: String, path: &Path, place: &str) -> Self {
        let fault = Self::at(kind, message, place);
        Self { object: Some(fault.object.unwrap_or_else(|| path.display().to_string())), ..fault }
    }
}

/// The number behind a word.
fn number_after(text: &str, word: &str) -> Option<i64> {
    let mut words = text.split([' ', ',', ':', '(', ')']).filter(|word| !word.is_empty());
    words.find(|found| *found == word)?;
    words.next()?.parse().ok()
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Fault {}

impl FaultKind {
    /// Returns the kind of an error of files.
    pub fn of_io(error: &IoError) -> Self {
        match error.kind() {
            IoErrorKind::MissingInput => Self::MissingInput,
            IoErrorKind::BadInput => Self::BadInput,
            IoErrorKind::CannotCreate => Self::CannotCreate,
            IoErrorKind::Io => Self::Io,
            IoErrorKind::Internal => Self::Internal,
        }
    }

    /// Returns the kind of an error of a shot.
    pub fn of_shot(error: &ShotError) -> Self {
        match error {
            ShotError::Io(error) => Self::of_io(error),
            ShotError::Unknown(_) | ShotError::Frames(_) | ShotError::Resume(_) => Self::Usage,
            ShotError::Changed { .. } | ShotError::OtherState { .. } => Self::CannotCreate,
            ShotError::FingerprintLost { .. } => Self::CannotCreate,
            ShotError::FrameChanged { .. } | ShotError::Step(StepError::Input { .. }) => Self::BadInput,
            ShotError::Step(StepError::Broken { .. }) => Self::Internal,
            ShotError::Step(_) => Self::SolverGaveUp,
            // With the scene corrected, the data may turn out to be right.
            ShotError::Problems(problems) if problems.0.iter().any(|p| p.kind == ProblemKind::Scene) => Self::Scene,
            ShotError::Problems(_) => Self::BadInput,
        }
    }

    /// Returns the kind for all errors of a scene file together.
    pub fn of_scene(errors: &[SceneFileError]) -> Self {
        let has = |kind: SceneErrorKind| errors.iter().any(|error| error.kind == kind);
        match () {
            () if has(SceneErrorKind::Scene) => Self::Scene,
            () if has(SceneErrorKind::Memory) => Self::NoMemory,
            () if has(SceneErrorKind::Missing) => Self::MissingInput,
            () if has(SceneErrorKind::Reading) => Self::Io,
            () => Self::BadInput,
        }
    }
}

impl From<IoError> for Fault {
    fn from(error: IoError) -> Self {
        let (kind, message) = (FaultKind::of_io(&error), error.to_string());
        match &error {
            IoError::Data { path, place, .. } | IoError::MissingPart { path, place, .. } => {
                Self::of_file(kind, message, path, place)
            }
            IoError::Missing { path } | IoError::Read { path, .. } | IoError::Write { path, .. } => {
                Self::of_file(kind, message, path, "")
            }
            _ => Self::new(kind, message),
        }
    }
}

impl From<ShotError> for Fault {
    fn from(error: ShotError) -> Self {
        let (kind, message) = (FaultKind::of_shot(&error), error.to_string());
        match error {
            ShotError::Io(error) => error.into(),
            ShotError::Problems(problems) => match problems.0.first() {
                Some(Problem { place, .. }) => Self::at(kind, message, place),
                None => Self::new(kind, message),
            },
            // Its words begin with the garment, the vertex and the frame.
            ShotError::Step(_) => Self::at(kind, message.clone(), message.lines().next().unwrap_or_default()),
            _ => Self::new(kind, message),
        }
    }
}

impl From<Vec<SceneFileError>> for Fault {
    fn from(errors: Vec<SceneFileError>) -> Self {
        let texts: Vec<String> = errors.iter().map(SceneFileError::to_string).collect();
        let fault = Self::new(FaultKind::of_scene(&errors), texts.join("\n"));
        let Some(location) = errors.into_iter().find_map(|error| error.location) else { return fault };
        let line = location.line_column().0 as u64;
        Self { object: Some(location.source_name), element: Some(line), ..fault }
    }
}

impl From<SceneFileError> for Fault {
    fn from(error: SceneFileError) -> Self {
        vec![error].into()
    }
}

#[cfg(test)]
mod tests {
    use drapery_core::error::{Problems, ShortStep};

    use super::*;

    #[test]
    fn a_fault_names_the_object_the_frame_and_the_element() {
        let parts = |fault: Fault| (fault.kind as u8, fault.object, fault.frame, fault.element);
        let problem = Problem::data("body \"hero\", frame -12, vertex 7", "it is far away", "look at it");
        let problems = ShotError::Problems(Problems(vec![problem]));
        assert_eq!(parts(problems.into()), (65, Some("hero".into()), Some(-12), Some(7)));
        let not_finite =
            StepError::NotFinite { garment: "skirt".into(), vertex: 3, frame: 1004, time: 0.1, stage: "B.3", dt: 1e-3 };
        assert_eq!(parts(ShotError::from(not_finite).into()), (80, Some("skirt".into()), Some(1004), Some(3)));
        let short =
            StepError::StepTooSmall { frame: 5, time: 0.0, dt: 1e-9, min_dt: 1e-8, because: ShortStep::StrainRate };
        assert_eq!(parts(ShotError::from(short).into()), (80, None, Some(5), None));
        let data = IoError::data(Path::new("a.obj"), "face 12", "it has 2 corners", "export it again");
        assert_eq!(parts(data.into()), (65, Some("a.obj".into()), None, Some(12)));
        let (path, place) = ("set.usda".into(), "/set/chair".to_owned());
        let part = IoError::MissingPart { path, place, what: "no chair.usdc".into(), advice: "put it there".into() };
        assert_eq!(parts(part.into()), (66, Some("set.usda".into()), None, None));
        let missing = IoError::Missing { path: "b.abc".into() };
        assert_eq!(parts(missing.into()), (66, Some("b.abc".into()), None, None));
    }

    #[test]
    fn a_fault_of_a_scene_names_the_line() {
        let scene = drapery_io::scene_file::parse("drapery = 1\n[gravty]\n", "s.toml", Path::new(""), &[]);
        let fault = Fault::from(scene.unwrap_err());
        assert_eq!((fault.kind, fault.object.as_deref(), fault.element), (FaultKind::Scene, Some("s.toml"), Some(2)));
        assert!(fault.message.contains("gravity"), "{fault}");
    }
}
