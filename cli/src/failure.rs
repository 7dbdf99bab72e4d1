//! Errors on their way out: the text, once, and the exit code.

use drapery_core::error::{ProblemKind, StepError};
use drapery_io::error::{IoError, IoErrorKind};
use drapery_io::shot::ShotError;

use crate::exit_code::ExitCode;
use crate::say;

/// Why the program ends early.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) code: ExitCode,
    text: String,
}

impl Failure {
    /// An error with its text.
    pub(crate) fn new(code: ExitCode, text: impl Into<String>) -> Self {
        Self { code, text: text.into() }
    }

    /// A fault of the program itself; the panic has printed its own message.
    pub(crate) fn internal() -> Self {
        Self::new(ExitCode::Internal, "this is a fault of Drapery; please report it with the lines above")
    }

    /// Prints it, on standard error. Farm software takes the word `Error:` for a fatal error, so it is used here only.
    pub(crate) fn report(&self) {
        tracing::debug!(exit_code = self.code as u8, text = self.text.as_str(), "failed");
        say::complaint(format_args!("Error: {}", self.text));
    }
}

impl From<IoError> for Failure {
    fn from(error: IoError) -> Self {
        Self::new(code_of(&error), error.to_string())
    }
}

impl From<ShotError> for Failure {
    fn from(error: ShotError) -> Self {
        let code = match &error {
            ShotError::Io(error) => code_of(error),
            ShotError::Frames(_) => ExitCode::Usage,
            ShotError::Step(StepError::Input { .. }) => ExitCode::BadInput,
            ShotError::Step(_) => ExitCode::SolverGaveUp,
            // Whoever corrects the scene first may find that the data was right.
            ShotError::Problems(problems) if problems.0.iter().any(|p| p.kind == ProblemKind::Scene) => ExitCode::Scene,
            ShotError::Problems(_) => ExitCode::BadInput,
        };
        let text = match &error {
            ShotError::Problems(problems) if problems.0.len() > 1 => format!("{} problems\n{error}", problems.0.len()),
            _ => error.to_string(),
        };
        Self::new(code, text)
    }
}

fn code_of(error: &IoError) -> ExitCode {
    match error.kind() {
        IoErrorKind::MissingInput => ExitCode::MissingInput,
        IoErrorKind::BadInput => ExitCode::BadInput,
        IoErrorKind::CannotCreate => ExitCode::CannotCreate,
        IoErrorKind::Io => ExitCode::Io,
        IoErrorKind::Internal => ExitCode::Internal,
    }
}
