//! The log: short words on standard error, and everything as JSON lines in a file if one is asked for.

use std::fs::File;
use std::io::IsTerminal;
use std::sync::Mutex;

use drapery_io::error::IoError;
use tracing_subscriber::filter::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Layer, fmt};

use crate::args::LogArgs;
use crate::failure::Failure;

/// Sets up the log.
pub(crate) fn start(args: &LogArgs) -> Result<(), Failure> {
    let level = match (args.quiet, args.verbose) {
        (true, _) => "error",
        (_, 0) => "warn",
        (_, 1) => "info",
        _ => "debug",
    };
    // DRAPERY_LOG chooses levels when no flag does.
    let chosen = std::env::var("DRAPERY_LOG").ok().filter(|_| !args.quiet && args.verbose == 0);
    let filter = |level: &str| EnvFilter::try_new(level).unwrap_or_else(|_| EnvFilter::new("warn"));
    let words = fmt::layer()
        .without_time()
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr)
        .with_filter(filter(chosen.as_deref().unwrap_or(level)));
    let lines = match &args.log_json {
        None => None,
        Some(path) => {
            let file = File::create(path).map_err(|e| Failure::from(IoError::creating(path, e)))?;
            Some(fmt::layer().json().with_writer(Mutex::new(file)).with_filter(filter("debug")))
        }
    };
    tracing_subscriber::registry().with(words).with(lines).init();
    Ok(())
}
