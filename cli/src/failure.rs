//! Errors on their way out: the text, once, and the exit code.

use std::io::IsTerminal;
use std::sync::Arc;

use drapery_analysis::study::error::StudyError;
use drapery_io::error::{IoError, OPEN_FILES};
use drapery_io::platform;
use drapery_io::scene_file::SceneFileError;
use drapery_shot::ShotError;
use drapery_shot::fault::FaultKind;
use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme, NamedSource, SourceSpan};

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
        Self { code, text: say::message(&text.into()) }
    }

    /// The system refuses what every process needs: threads, or files that are open. `what` is what could not be done.
    pub(crate) fn refused(what: &str, error: &std::io::Error) -> Self {
        let (code, help) = match platform::is_out_of_files(error) {
            true => (ExitCode::Io, OPEN_FILES),
            false => (ExitCode::NoMemory, MORE_THREADS),
        };
        Self::new(code, format!("{what}: {error}\n  help: {help}"))
    }

    /// The same, of one run of several.
    pub(crate) fn in_run(self, name: &str) -> Self {
        Self { text: format!("run {name}: {}", self.text), ..self }
    }

    /// A fault of the program itself; the panic has printed its own message.
    pub(crate) fn internal() -> Self {
        Self::new(ExitCode::Internal, "this is a bug in Drapery; please report it with the lines above")
    }

    /// Prints it, on standard error. Farm software takes the word `Error:` for a fatal error, so it is used here only.
    pub(crate) fn report(&self) {
        tracing::debug!(exit_code = self.code as u8, text = self.text.as_str(), "failed");
        say::complaint(format_args!("Error: {}", self.text));
    }
}

/// Advice where the system starts no more threads.
pub(crate) const MORE_THREADS: &str =
    "ask for fewer threads (--threads), or allow more processes and memory (ulimit -u, ulimit -v)";

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Colours are for terminals.
        let mut parts = self.text.split("\u{1b}[");
        f.write_str(parts.next().unwrap_or_default())?;
        parts.try_for_each(|part| f.write_str(part.split_once('m').map_or(part, |(_, text)| text)))
    }
}

impl From<IoError> for Failure {
    fn from(error: IoError) -> Self {
        Self::new(FaultKind::of_io(&error).into(), error.to_string())
    }
}

impl From<ShotError> for Failure {
    fn from(error: ShotError) -> Self {
        let code = FaultKind::of_shot(&error).into();
        let text = match &error {
            ShotError::Problems(problems) if problems.0.len() > 1 => format!("{} problems\n{error}", problems.0.len()),
            _ => error.to_string(),
        };
        Self::new(code, text)
    }
}

impl From<StudyError> for Failure {
    fn from(error: StudyError) -> Self {
        match error {
            StudyError::Scene(errors) => errors.into(),
            StudyError::Shot(error) => error.into(),
            StudyError::Io(error) => error.into(),
            StudyError::Asked(_) => Self::new(ExitCode::Usage, error.to_string()),
            StudyError::Other { .. } => Self::new(ExitCode::CannotCreate, error.to_string()),
        }
    }
}

impl From<SceneFileError> for Failure {
    fn from(error: SceneFileError) -> Self {
        vec![error].into()
    }
}

impl From<Vec<SceneFileError>> for Failure {
    fn from(errors: Vec<SceneFileError>) -> Self {
        let errors: Vec<SceneFileError> = errors.into_iter().flat_map(SceneFileError::each).collect();
        let code = FaultKind::of_scene(&errors).into();
        let count = match errors.as_slice() {
            // The scene file itself could not be read.
            [one] if one.location.is_none() => return Self::new(code, one.to_string()),
            [_] => "a problem".to_owned(),
            many => format!("{} problems", many.len()),
        };
        let more = match errors.len().saturating_sub(MOST_EXCERPTS) {
            0 => String::new(),
            more => format!("\n{more} more will be shown once these are fixed"),
        };
        let excerpts: String = errors.into_iter().take(MOST_EXCERPTS).map(excerpt).collect();
        // Excerpts have colours, and nothing else that a terminal obeys.
        Self { code, text: format!("{count} in the scene file\n{}{more}", excerpts.trim_end()) }
    }
}

/// Problems of a scene that are shown at once: a fault that is in every one of many garments is seen in the first of them.
const MOST_EXCERPTS: usize = 40;

/// A scene error with the line that it is about.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{message}")]
struct SceneExcerpt {
    message: String,
    #[help]
    help: Option<String>,
    #[source_code]
    source_text: NamedSource<Arc<str>>,
    #[label]
    span: SourceSpan,
}

/// The error with an excerpt of the scene and a mark under the words that are meant.
fn excerpt(error: SceneFileError) -> String {
    let Some(location) = error.location.as_ref().filter(|location| location.fits_a_screen()) else {
        return say::message(&format!("{error}\n"));
    };
    // As many bytes as before, so that the mark stays under the words.
    let seen = |c: char| c.is_ascii_control() && !matches!(c, '\n' | '\r' | '\t');
    let report = SceneExcerpt {
        message: say::message(&error.message),
        help: error.help.as_deref().map(say::message),
        source_text: NamedSource::new(say::visible(&location.source_name), location.source.replace(seen, "?").into()),
        span: location.span.clone().into(),
    };
    let colours = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let theme = if colours { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
    let handler = GraphicalReportHandler::new_themed(theme).with_wrap_lines(false).with_links(false);
    let mut text = String::new();
    match handler.render_report(&mut text, &report) {
        Ok(()) => text,
        // The plain form has its own excerpt.
        Err(_) => say::message(&format!("{error}\n")),
    }
}
