//! Printing that never fails: when nobody reads any more, the work goes on, and the exit code says so at its end.

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// First failure to write output, with its reason. A reader that has gone away (`drapery run … | head`) is no failure.
static LOST: OnceLock<String> = OnceLock::new();

/// Whether the loss was reported.
static REPORTED: AtomicBool = AtomicBool::new(false);

/// A line on standard output.
pub(crate) fn line(text: impl Display) {
    note_loss(STANDARD_OUTPUT, writeln!(std::io::stdout().lock(), "{}", visible(&text.to_string())));
}

/// A line on standard error. It is written as a whole: ranks that lose the same one complain into one file at the same time.
pub(crate) fn complaint(text: impl Display) {
    let _ = std::io::stderr().lock().write_all(format!("{text}\n").as_bytes());
}

/// A text without what a terminal would obey: names come from files, and files from strangers.
pub(crate) fn visible(text: &str) -> String {
    text.replace(|c: char| c.is_control() && !matches!(c, '\n' | '\t'), "\u{fffd}")
}

/// The same as a message: a line that is longer than any path is shown without its middle.
pub(crate) fn message(text: &str) -> String {
    let lines: Vec<String> = visible(text).split('\n').map(short).collect();
    lines.join("\n")
}

/// Longest line of a message [bytes]: a path of the longest that systems know, and words around it.
const LONGEST_LINE: usize = 6000;

/// Length of the end of a longer line that is shown [bytes].
const END_SHOWN: usize = 500;

fn short(line: &str) -> String {
    if line.len() <= LONGEST_LINE {
        return line.to_owned();
    }
    let (start, rest) = line.split_at(line.floor_char_boundary(LONGEST_LINE - END_SHOWN));
    let (left_out, end) = rest.split_at(rest.ceil_char_boundary(rest.len() - END_SHOWN));
    format!("{start}[… {} bytes …]{end}", left_out.len())
}

/// Name of standard output in messages.
pub(crate) const STANDARD_OUTPUT: &str = "standard output";

/// Takes note of what became of something that was printed, or written to a log.
pub(crate) fn note_loss(place: &str, printed: std::io::Result<()>) {
    if let Err(error) = printed
        && error.kind() != ErrorKind::BrokenPipe
    {
        LOST.get_or_init(|| format!("{place} could not be written: {error}"));
    }
}

/// Tells, once, that output is lost: in the middle of what takes long, so that somebody can look after it.
pub(crate) fn warn_of_loss() {
    if let Some(error) = LOST.get()
        && !REPORTED.swap(true, Ordering::Relaxed)
    {
        tracing::warn!("{error}; the command continues without it");
    }
}

/// Says why a command fails that has done everything but print all of it; an error of reading or writing.
pub(crate) fn loss() -> Option<String> {
    note_loss(STANDARD_OUTPUT, std::io::stdout().flush());
    let error = LOST.get()?;
    Some(format!(
        "{error}\n  \
         help: free space there, or redirect it; the files that the command wrote are complete"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_to_a_terminal_are_not_printed_and_messages_are_not_longer_than_screens() {
        let long = format!("é{}z\nend", "é".repeat(1_000_000));
        let shown = message(&long);
        assert!(shown.len() < 6100 && shown.starts_with("éé") && shown.ends_with("z\nend"), "{}", shown.len());
        assert!(shown.contains(" bytes …]") && message("short\u{1b}") == "short\u{fffd}");
        assert_eq!(visible("a\tb\n\u{1b}[2Jc\u{9b}1m\r\u{7f}é"), "a\tb\n\u{fffd}[2Jc\u{fffd}1m\u{fffd}\u{fffd}é");
    }
}
