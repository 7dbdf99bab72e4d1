//! Errors that point at the line of the scene file that caused them.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use crate::error::{IoError, IoErrorKind};

/// One thing wrong with a scene file: what, where, and what to write instead.
///
/// `Display` shows all of it, with the line and a caret; a program that draws its own frames takes the parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneFileError {
    /// Fault, in words.
    pub message: String,
    /// Remedy, if there is one to give.
    pub help: Option<String>,
    /// Place in the file; `None` when the file could not be read at all.
    pub location: Option<Location>,
    /// Whose fault it is; it decides the exit code of the command.
    pub kind: SceneErrorKind,
    /// The next error that was found in the same go, such as a further unknown key.
    pub next: Option<Box<SceneFileError>>,
}

/// Kind of a [`SceneFileError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneErrorKind {
    /// The scene file itself.
    Scene,
    /// A file that is not there or may not be read.
    Missing,
    /// The system refused to read a file that is there; another attempt may succeed.
    Reading,
    /// The content of a file that the scene names.
    Data,
    /// This machine has too little memory for it.
    Memory,
}

/// Longest line that is shown [bytes]; of a file that is no scene all may be one line.
const LONGEST_SHOWN: usize = 1000;

/// A stretch of text in a scene file or in a `--set` argument.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// Name of the source: the path of the file, or `--set name=value`.
    pub source_name: String,
    /// All of its text.
    pub source: Arc<str>,
    /// Bytes of the text that are meant.
    pub span: Range<usize>,
}

impl Location {
    /// Line and column of the first character, both from 1; columns count characters.
    pub fn line_column(&self) -> (usize, usize) {
        let before = &self.source[..self.start()];
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// Whether the lines around it are short enough to be shown.
    pub fn fits_a_screen(&self) -> bool {
        let (line, _) = self.line_column();
        self.source.lines().skip(line.saturating_sub(2)).take(3).all(|line| line.len() <= LONGEST_SHOWN)
    }

    /// Start of the span, moved to a character of the text if it points outside.
    fn start(&self) -> usize {
        floor_char(&self.source, self.span.start)
    }
}

/// The last start of a character at or before byte `index`.
fn floor_char(text: &str, index: usize) -> usize {
    (0..=index.min(text.len())).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0)
}

impl SceneFileError {
    /// An error of the scene file at a location.
    pub(super) fn at(location: Location, message: impl Into<String>, help: Option<String>) -> Self {
        Self { message: message.into(), help, location: Some(location), kind: SceneErrorKind::Scene, next: None }
    }

    /// An error of a file that the scene names at `location`.
    pub fn of_file(location: Option<Location>, error: &IoError) -> Self {
        let text = error.to_string();
        let (message, help) = match text.split_once("\n  help: ") {
            Some((message, help)) => (message.to_owned(), Some(help.to_owned())),
            None => (text, None),
        };
        let kind = match error.kind() {
            IoErrorKind::MissingInput => SceneErrorKind::Missing,
            IoErrorKind::Io => SceneErrorKind::Reading,
            _ => SceneErrorKind::Data,
        };
        Self { message, help, location, kind, next: None }
    }

    /// Both errors as one, in the order of the text.
    #[must_use]
    pub(super) fn and(self, other: Self) -> Self {
        let mut all = self.each();
        all.extend(other.each());
        all.sort_by_cached_key(|error| error.location.as_ref().map(|at| (at.source_name.clone(), at.span.start)));
        let first = all.remove(0);
        let next = all.into_iter().rev().fold(None, |next, error| Some(Box::new(Self { next, ..error })));
        Self { next, ..first }
    }

    /// The error and those that were found in the same go, each for itself.
    pub fn each(self) -> Vec<Self> {
        let (mut all, mut next) = (Vec::new(), Some(self));
        while let Some(mut error) = next {
            next = error.next.take().map(|next| *next);
            all.push(error);
        }
        all
    }
}

impl fmt::Display for SceneFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.location {
            Some(location) => write_excerpt(f, location, &self.message)?,
            None => f.write_str(&self.message)?,
        }
        if let Some(help) = &self.help {
            write!(f, "\n  help: {help}")?;
        }
        match &self.next {
            Some(next) => write!(f, "\n{next}"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for SceneFileError {}

/// `name:line:column: message`, the line, and carets below the span.
fn write_excerpt(f: &mut fmt::Formatter<'_>, location: &Location, message: &str) -> fmt::Result {
    let (line, column) = location.line_column();
    let text = location.source.lines().nth(line - 1).unwrap_or("");
    let end = floor_char(&location.source, location.span.end.max(location.start()));
    let width = location.source[location.start()..end].lines().next().unwrap_or("").chars().count().max(1);
    let gutter = line.to_string().len();
    write!(f, "{}:{line}:{column}: {message}", location.source_name)?;
    if !location.fits_a_screen() {
        return Ok(());
    }
    writeln!(f)?;
    writeln!(f, "{:gutter$} |", "")?;
    writeln!(f, "{line} | {text}")?;
    // Tabs are repeated, so that the carets stand below the span however wide a tab is shown.
    let lead: String = text.chars().take(column - 1).map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
    write!(f, "{:gutter$} | {lead}{}", "", "^".repeat(width))
}
