//! Loss of a rank in a run of several processes: a machine, a cable, a process that hangs. MPI waits for it without end, and so
//! does every other rank. Heartbeats reveal the loss; then this rank reports the lost one and ends at once, wherever it is. The
//! run resumes from its last checkpoint.

use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use drapery_core::parallel::ranks::Ranks;
use drapery_io::duration::parse_duration;
use drapery_mpi::How;
use drapery_mpi::heartbeats::{Heartbeats, Lost, News};
use drapery_shot::farm::last_words::last_words;
use drapery_shot::farm::process::Owner;

use crate::exit_code::ExitCode;
use crate::failure::Failure;
use crate::say;

/// Variable with the time after which a rank that is silent is lost; 0 for no heartbeats.
const TIMEOUT: &str = "DRAPERY_RANK_TIMEOUT";

/// The same where nobody says anything: longer than a machine stands still that swaps, or is stopped and goes on.
const DEFAULT_TIMEOUT: Duration = Duration::from_secs(30);

/// Shortest time that is taken: what is shorter ends runs on loaded machines.
const SHORTEST_TIMEOUT: Duration = Duration::from_secs(1);

/// Error of a shorter time.
const TOO_SHORT: &str = "too short: ranks on a busy machine would count as lost\n  help: give a second or more, or 0 to switch \
                         heartbeats off";

/// Longest time for rank 0 to write down why it ends, and for others to wait for it. A disk behind the network may never answer.
const WRITES: Duration = Duration::from_secs(4);

/// The folder of the run, once it is known.
static FOLDER: OnceLock<PathBuf> = OnceLock::new();

/// The exit code, once all work is done.
static CODE: OnceLock<u8> = OnceLock::new();

/// The heartbeats of this rank, if it has others.
pub(crate) struct Heartbeat(Option<Heartbeats>);

impl Heartbeat {
    /// Starts heartbeats; all ranks call it together. Rank 0 returns the error of the variable, and no rank sends any then.
    pub(crate) fn start(ranks: &Ranks) -> (Self, Result<(), Failure>) {
        if ranks.is_alone() {
            return (Self(None), Ok(()));
        }
        let timeout = timeout();
        let (of_all, refused) = match timeout {
            Ok(timeout) => (timeout, Ok(())),
            Err(failure) => (None, Err(failure)),
        };
        let is_first = ranks.is_first();
        let report = move |news| match news {
            News::Connected if is_first => {
                tracing::info!("heartbeats with all ranks: a lost one is noticed from now on")
            }
            News::Unreachable(others) if is_first => tracing::warn!(
                "no heartbeats with {}: no TCP connection can be established (a firewall?); the run continues, but may hang if \
                 such a rank, its machine or its network is lost",
                others.join(", ")
            ),
            News::Connected | News::Unreachable(_) => {}
            News::Lost(lost) => end(is_first, &lost),
        };
        match Heartbeats::start(ranks, of_all, &Owner::this_process().to_string(), report) {
            Ok(beats) => (Self(beats), refused),
            // As where no connection comes about.
            Err(error) => {
                say::complaint(format_args!(
                    "no heartbeats: {error}; the run continues, but cannot detect a lost rank"
                ));
                (Self(None), refused)
            }
        }
    }

    /// All work is done, and the program ends with this code. Silence still ends a rank that waits for the others' end.
    pub(crate) fn bye(&self, code: u8) {
        CODE.get_or_init(|| code);
        self.0.iter().for_each(Heartbeats::bye);
    }
}

/// Reads the timeout from the variable, `None` for 0; only the variable of rank 0 counts.
fn timeout() -> Result<Option<Duration>, Failure> {
    let text = std::env::var_os(TIMEOUT).unwrap_or_default().to_string_lossy().trim().to_owned();
    match text.as_str() {
        "" => Ok(Some(DEFAULT_TIMEOUT)),
        "0" | "0s" => Ok(None),
        text => {
            let time = parse_duration(text).map_err(|error| error.to_string());
            let long = time.and_then(|time| match time >= SHORTEST_TIMEOUT {
                true => Ok(Some(time)),
                false => Err(TOO_SHORT.to_owned()),
            });
            long.map_err(|error| Failure::new(ExitCode::Usage, format!("{TIMEOUT}={text}: {error}")))
        }
    }
}

/// From now on the run writes into this folder.
pub(crate) fn writes_into(folder: &std::path::Path) {
    FOLDER.get_or_init(|| folder.to_owned());
}

/// Says who is lost, once, and ends the process.
fn end(is_first: bool, lost: &[Lost]) -> ! {
    if let Some(code) = CODE.get() {
        signal_hook::low_level::exit((*code).into());
    }
    let what: Vec<String> = lost.iter().map(Lost::to_string).collect();
    let why = match lost.iter().any(|lost| lost.how == How::Silent) {
        true => ": its machine or its network is down, or the process is frozen",
        false => "",
    };
    let text = format!("{}{why}", what.join("; "));
    // Rank 0 speaks for all and writes down why. The launcher ends it as soon as another rank has ended.
    if is_first || lost.iter().any(|lost| lost.rank == 0) {
        let written = std::thread::Builder::new().spawn(move || {
            let help = format!(
                "run the same command again on machines that answer, with any number of ranks: it continues from the last \
                 checkpoint; if machines only froze for a while, raise {TIMEOUT}"
            );
            let failure = Failure::new(ExitCode::RankLost, format!("{text}\n  help: {help}"));
            failure.report();
            if let Some(folder) = FOLDER.get() {
                tracing::info!(exit_code = ExitCode::RankLost as u8, "failed: {text}");
                // Nobody else writes after it.
                std::mem::forget(last_words(folder, &text));
            }
        });
        wait_for(written.ok());
    } else {
        std::thread::sleep(WRITES);
    }
    end_the_launcher();
    signal_hook::low_level::exit(ExitCode::RankLost as i32)
}

/// Waits for a thread, but not for ever.
fn wait_for(thread: Option<std::thread::JoinHandle<()>>) {
    let begun = std::time::Instant::now();
    while thread.as_ref().is_some_and(|thread| !thread.is_finished()) && begun.elapsed() < WRITES {
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Names of the programs of Open MPI that start ranks: on the machine where the command was typed, and on the others.
const LAUNCHERS: [(&str, &str); 5] =
    [("mpirun", "KILL"), ("mpiexec", "KILL"), ("orterun", "KILL"), ("orted", "TERM"), ("prted", "TERM")];

/// Waits; then ends a process, if it is still the one that was meant: one that began at this moment. What it has started ends with
/// it, but a process that is to end in order (TERM) is left alone if it still has others: they are not of this run.
const END_LATER: &str = r#"sleep "$4"
[ "$(cut -d ' ' -f 22 "/proc/$1/stat" 2>/dev/null)" = "$2" ] || exit
children=$(cat "/proc/$1/task/"*/children 2>/dev/null)
case "$3" in
    TERM) [ -n "$children" ] || kill -s TERM "$1" ;;
    *) kill -s KILL "$1"; [ -z "$children" ] || kill -s TERM $children ;;
esac"#;

/// Scripts that may stand between the launcher and this process.
const MOST_BETWEEN: usize = 3;

/// Time for a launcher to end by itself once its ranks have ended [s].
const LAUNCHER_SECONDS: &str = "10";

/// Open MPI's launcher waits a quarter of an hour for a machine that is lost. A process that outlives this one ends it.
fn end_the_launcher() {
    if let Some((process, began, signal)) = launcher() {
        let words = ["-c", END_LATER, "sh", &process, &began, signal, LAUNCHER_SECONDS];
        let mut later = Command::new("sh");
        // Not in the group of this process, which the launcher ends.
        later.args(words).process_group(0).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let _ = later.spawn();
    }
}

/// Number of the launcher's process, when it began, and the signal that ends it: the nearest of those above this one.
fn launcher() -> Option<(String, String, &'static str)> {
    let mut process = "self".to_owned();
    for _ in 0..=MOST_BETWEEN {
        // The second field is the name, which may hold anything.
        let fields = |process: &str| {
            let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
            let (name, rest) = stat.split_once('(')?.1.rsplit_once(')')?;
            let mut words = rest.split_whitespace();
            Some((name.to_owned(), words.nth(1)?.to_owned(), words.nth(17)?.to_owned()))
        };
        process = fields(&process)?.1;
        let (name, _, began) = fields(&process)?;
        if let Some((_, signal)) = LAUNCHERS.iter().find(|(known, _)| *known == name) {
            return Some((process, began, signal));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    /// Runs the script on a process that this test has started; says whether it ended soon.
    fn ends(child: &mut std::process::Child, began: &str, signal: &str) -> bool {
        let pid = child.id().to_string();
        let done = Command::new("sh").args(["-c", END_LATER, "sh", &pid, began, signal, "0"]).status();
        assert!(done.is_ok());
        let deadline = Instant::now() + Duration::from_secs(2);
        while Instant::now() < deadline {
            if child.try_wait().unwrap().is_some() {
                return true;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        false
    }

    #[test]
    fn a_launcher_is_ended_later_and_no_other_process() {
        for signal in ["TERM", "KILL"] {
            let mut child = Command::new("sleep").arg("1000").spawn().unwrap();
            let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
            let began = stat.split(' ').nth(21).unwrap();
            assert!(!ends(&mut child, &format!("{began}1"), signal), "another process of the same number");
            assert!(ends(&mut child, began, signal));
        }
    }
}
