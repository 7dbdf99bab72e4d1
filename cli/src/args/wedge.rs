//! Arguments of `wedge`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use drapery_analysis::study::vary::parse_values;
use drapery_io::duration::parse_duration;

use super::SceneArgs;

/// Arguments of `wedge`.
///
/// Every run has a folder of its own in DIR, named by its values, and is continued, looked at and verified like any other run.
/// The same command again continues what is not done, and adds the runs of new values.
#[derive(Debug, Args)]
pub(crate) struct WedgeArgs {
    /// File that starts the command, which starts the runs.
    #[arg(skip)]
    pub(crate) program: Option<PathBuf>,
    /// Site file as typed.
    #[arg(skip)]
    pub(crate) config: Option<PathBuf>,
    /// All that was typed, for the command that continues the wedge.
    #[arg(skip)]
    pub(crate) words: Vec<OsString>,
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    /// A parameter or any key of the scene, and its values, for example garment.skirt.material=silk_light,denim_11oz;
    /// repeatable: every combination is run. Brackets and quotes hold a value with commas together
    #[arg(long, value_name = "KEY=A,B", value_parser = parse_values, required = true)]
    pub(crate) vary: Vec<(String, Vec<String>)>,
    /// Folder for the runs, the page comparison.html and the table comparison.csv [default: out/<scene>_wedge]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Number of runs at the same time; they share the threads
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) jobs: u16,
    /// Largest number of runs
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub(crate) most: usize,
    /// Time limit of the wedge, for example 11h50m: runs stop at a checkpoint in time before it
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) max_wall: Option<Duration>,
    /// Run nothing: print the command of each run on a line, for a scheduler with one job a run. The same command without --list then
    /// writes the page
    #[arg(long, conflicts_with_all = ["jobs", "max_wall"])]
    pub(crate) list: bool,
}
