//! The log: short words on standard error, everything as JSON lines in a file if one is asked for, and both in the folder
//! of a run once that is known.

use std::fs::File;
use std::io::{IsTerminal, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use drapery_io::error::IoError;
use drapery_io::{input_file, platform};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::filter::{EnvFilter, filter_fn};
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Layer, fmt};

use crate::args::LogArgs;
use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Bytes that wait for a file at most: more than any run says before its folder is known.
const MOST_WAITING: usize = 1 << 20;

/// Target of events that belong into files only: standard error has the same in another form.
pub(crate) const OF_FILES: &str = "files";

/// Warnings that were given so far.
static WARNINGS: AtomicUsize = AtomicUsize::new(0);

/// Number of warnings that were given so far, whether or not they are shown.
pub(crate) fn warnings() -> usize {
    WARNINGS.load(Ordering::Relaxed)
}

/// Counts warnings where they are given, so that none is left out of the number at the end.
struct CountWarnings;

impl<S: Subscriber> Layer<S> for CountWarnings {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        if *event.metadata().level() == Level::WARN {
            WARNINGS.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// A file that is not known yet when the log is set up; until then it is kept in memory what goes there.
#[derive(Debug, Clone)]
struct LateFile(Arc<Mutex<Place>>);

#[derive(Debug)]
enum Place {
    Waiting(Vec<u8>),
    File(LogFile),
}

/// A log. A failure to write it is reported at the end of the command: the code that writes to a log ignores errors.
#[derive(Debug)]
struct LogFile {
    /// Name in messages.
    name: String,
    file: File,
}

impl Write for LogFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        say::note_loss(&self.name, self.file.write_all(bytes));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Default for LateFile {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(Place::Waiting(Vec::new()))))
    }
}

impl LateFile {
    fn open(&self, file: File) {
        let mut log = LogFile { name: "the log in the folder of the run".to_owned(), file };
        let mut place = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Place::Waiting(bytes) = &*place {
            // It takes all of it.
            let _ = log.write_all(bytes);
        }
        *place = Place::File(log);
    }
}

impl Write for LateFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Place::File(file) => file.write(bytes),
            Place::Waiting(waiting) => {
                if waiting.len() + bytes.len() <= MOST_WAITING {
                    waiting.extend_from_slice(bytes);
                }
                Ok(bytes.len())
            }
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The logs in the folder of a run: words, and JSON lines.
#[derive(Debug, Default)]
pub(crate) struct FolderLogs([LateFile; 2]);

impl FolderLogs {
    /// From now on everything is written to these, too.
    pub(crate) fn open(&self, files: [File; 2]) {
        self.0.iter().zip(files).for_each(|(late, file)| late.open(file));
    }
}

/// With what each line of a log begins, and no scene, mesh or cache.
const LINE: &[u8] = b"{\"timestamp\"";

/// Creates a log, in the place of an earlier one. Another file of this name is one that was named by mistake, and is kept. Pipes are what
/// shells make of `--log-json >(PROGRAM)`.
fn create(path: &Path) -> Result<File, Failure> {
    if let Some(pipe) = platform::open_pipe_to_write(path) {
        let help = "start the program that reads it first, or give the name of a file";
        let text = format!("{}: no program reads from this pipe\n  help: {help}", path.display());
        return pipe.map_err(|_| Failure::new(ExitCode::CannotCreate, text));
    }
    let mut start = Vec::new();
    if let Ok(file) = input_file::open(path) {
        file.take(LINE.len() as u64).read_to_end(&mut start).map_err(|e| IoError::reading(path, e))?;
    }
    if !start.is_empty() && start != LINE {
        let help = "give another name, or remove the file";
        let text =
            format!("{}: this file exists and is not a log; it is not overwritten\n  help: {help}", path.display());
        return Err(Failure::new(ExitCode::CannotCreate, text));
    }
    Ok(File::create(path).map_err(|e| IoError::creating(path, e))?)
}

/// Sets up the log; the logs in the folder of a run wait for their files.
pub(crate) fn start(args: &LogArgs) -> Result<FolderLogs, Failure> {
    let level = match (args.quiet, args.verbose) {
        (true, _) => "error",
        (_, 0) => "warn",
        (_, 1) => "info",
        _ => "debug",
    };
    // DRAPERY_LOG chooses levels when no flag does.
    let chosen = std::env::var_os("DRAPERY_LOG")
        .map(|text| text.to_string_lossy().into_owned())
        .filter(|_| !args.quiet && args.verbose == 0);
    let not_levels = chosen.as_ref().and_then(|chosen| EnvFilter::try_new(chosen).err());
    let filter = |level: &str| EnvFilter::try_new(level).unwrap_or_else(|_| EnvFilter::new("warn"));
    let words = fmt::layer()
        .without_time()
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .with_filter(filter_fn(|about| about.target() != OF_FILES))
        .with_filter(filter(chosen.as_deref().unwrap_or(level)));
    let lines = match &args.log_json {
        None => None,
        Some(path) => {
            let file = create(path)?;
            let file = LogFile { name: path.display().to_string(), file };
            Some(fmt::layer().json().with_writer(Mutex::new(file)).with_filter(filter("debug")))
        }
    };
    let logs = FolderLogs::default();
    let [folder_words, folder_lines] = logs.0.clone();
    let folder_words = fmt::layer()
        .with_target(false)
        .with_ansi(false)
        .with_writer(move || folder_words.clone())
        .with_filter(filter("info"));
    let folder_lines = fmt::layer().json().with_writer(move || folder_lines.clone()).with_filter(filter("debug"));
    tracing_subscriber::registry()
        .with(CountWarnings)
        .with(words)
        .with(lines)
        .with(folder_words)
        .with(folder_lines)
        .init();
    if let (Some(error), Some(chosen)) = (not_levels, chosen) {
        tracing::warn!("DRAPERY_LOG={chosen} is not a log filter and is ignored: {error}");
    }
    Ok(logs)
}
