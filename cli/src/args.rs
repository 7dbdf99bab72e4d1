//! Arguments of the command line.

mod values;
mod wedge;

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::LazyLock;
use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};

use drapery_analysis::bits::Layout;
use drapery_analysis::study::vary::parse_vary;
use drapery_core::effects::{LISTED, REGISTRY};
use drapery_core::observe::Tracepoint;
use drapery_core::scene::Integrator;
use drapery_io::checkpoint::Every;
use drapery_io::duration::parse_duration;
use drapery_io::units::{LengthUnit, UpAxis};
use drapery_shot::run::Resume;

use crate::{Invocation, exit_code};

pub(crate) use values::{FrameRange, SeedRange};
use values::{
    parse_frame_budget, parse_frames, parse_length, parse_rate, parse_resume, parse_seeds, parse_setting,
    parse_tolerance, parse_up,
};
pub(crate) use wedge::WedgeArgs;

/// Text of `--version`: the version, and the features of this build that not every build has.
static LONG_VERSION: LazyLock<String> = LazyLock::new(|| {
    let features =
        [("effects", REGISTRY.len() == LISTED.len()), ("mpi", cfg!(feature = "mpi")), ("usd", cfg!(feature = "usd"))];
    let features: Vec<&str> = features.iter().filter(|(_, has)| *has).map(|(name, _)| *name).collect();
    format!("{}\nfeatures: {}", env!("CARGO_PKG_VERSION"), features.join(" "))
});

/// Offline cloth solver: animated bodies and garments in, vertex caches out.
#[derive(Debug, Parser)]
#[command(name = "drapery", version, long_version = LONG_VERSION.as_str(), after_help = exit_code::TABLE, max_term_width = 120)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    #[command(flatten)]
    pub(crate) log: LogArgs,
    /// Site file with defaults for run, plan, check, study, wedge and materials [default: DRAPERY_CONFIG]
    #[arg(long, value_name = "FILE", global = true)]
    pub(crate) config: Option<PathBuf>,
}

/// Parses the command line. `run`, `study` and `wedge` keep its words, `selftest` and `wedge` the name of the program.
///
/// # Errors
/// The command line is not understood, or asks for help.
pub(crate) fn parse(invocation: &Invocation) -> Result<Cli, clap::Error> {
    let mut cli = Cli::try_parse_from(&invocation.words)?;
    match &mut cli.command {
        Command::Run(RunArgs { words, .. }) | Command::Study(StudyArgs { words, .. }) => {
            words.clone_from(&invocation.words);
        }
        Command::Selftest(args) => args.program.clone_from(&invocation.program),
        Command::Wedge(args) => {
            args.program.clone_from(&invocation.program);
            args.config.clone_from(&cli.config);
            args.words.clone_from(&invocation.words);
        }
        _ => {}
    }
    Ok(cli)
}

/// Amount and destination of the log.
#[derive(Debug, Args)]
pub(crate) struct LogArgs {
    /// Print more (twice: everything); at the end of a run, a table of times and counts
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub(crate) verbose: u8,
    /// Print errors only
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Also write the log as JSON lines to this file
    #[arg(long, value_name = "FILE", global = true)]
    pub(crate) log_json: Option<PathBuf>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Simulate a scene and write the caches
    Run(RunArgs),
    /// Report every problem of a scene and of each frame of its inputs, without simulating
    Check(CheckArgs),
    /// Show what will run and why: effects, settings, memory, threads, formats
    Plan(PlanArgs),
    /// Show the contents of a mesh or cache file
    Info(FileArgs),
    /// Write a cache in another format, with other frames, or in another unit or axis
    Convert(ConvertArgs),
    /// Check that other applications can load caches and that cloth has no intersections; warn of those along the other
    /// diagonals of quads
    Verify(VerifyArgs),
    /// Show the progress of runs: frames, rate, time left, last checkpoint; reads only
    Status(StatusArgs),
    /// Ask a run in progress, on any machine, to write a checkpoint and stop
    Stop(StopArgs),
    /// Compare two caches, checkpoints or runs, frame by frame
    Diff(DiffArgs),
    /// Write an HTML report of a run: time, strain, contacts, degradations, pictures; of several runs, all side by side
    Report(ReportArgs),
    /// Show a run in the browser, in progress or done: turntable, strain, thickness, contact; reads only
    View(ViewArgs),
    /// Measure the cost of accuracy: run a scene with many settings, compare errors and times, and recommend one
    Study(StudyArgs),
    /// Run every combination of some values of a scene (materials, friction, …), with one contact sheet and one table of all
    Wedge(WedgeArgs),
    /// Print the JSON schema of scene files, for editors
    Schema,
    /// List the materials: presets, and those in files
    Materials(ListArgs),
    /// Test this build: hard cases, drape of the preset materials, or bits on several ranks
    Selftest(SelftestArgs),
}

/// A scene and what is changed in it.
#[derive(Debug, Clone, Args)]
pub(crate) struct SceneArgs {
    /// Scene file
    pub(crate) scene: PathBuf,
    /// Frames to deliver, for example 1001-1100 [default: the scene's range]
    #[arg(long, value_name = "A-B", value_parser = parse_frames, allow_hyphen_values = true)]
    pub(crate) frames: Option<FrameRange>,
    /// Set a parameter or any key of the scene, for example resolution=80 or garment.skirt.material=silk_light; repeatable
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = parse_setting)]
    pub(crate) settings: Vec<(String, String)>,
    /// Settings file from `drapery study --write-preset`; --set overrides it. A preset of the solver is set by --set
    /// solver.preset=production
    #[arg(long, value_name = "FILE")]
    pub(crate) preset: Option<PathBuf>,
    /// Effects to leave out, for example wind,self_collision; replaces `effects.without` of the scene
    #[arg(long, value_name = "NAMES", value_delimiter = ',', conflicts_with = "only")]
    pub(crate) without: Vec<String>,
    /// Effects to run; the scene's other effects are left out. Replaces `effects.only` of the scene
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) only: Vec<String>,
    /// Number of threads of each process [default: DRAPERY_THREADS, OMP_NUM_THREADS, CUE_THREADS, SLURM_CPUS_PER_TASK,
    /// the site file, or all cores, shared by the processes of mpirun on a machine]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    #[command(flatten)]
    pub(crate) materials: MaterialsArgs,
}

/// Folders of materials.
#[derive(Debug, Clone, Args)]
pub(crate) struct MaterialsArgs {
    /// Folders of material files, as in A:B [default: DRAPERY_MATERIALS, or the site file]
    #[arg(long, value_name = "DIRS")]
    pub(crate) materials: Option<OsString>,
}

/// Arguments of `materials`.
#[derive(Debug, Args)]
pub(crate) struct ListArgs {
    /// The material to show [default: all]
    pub(crate) name: Option<String>,
    #[command(flatten)]
    pub(crate) materials: MaterialsArgs,
    /// Print JSON, in SI units
    #[arg(long)]
    pub(crate) json: bool,
}

/// Settings of a run that change no result.
#[derive(Debug, Default, Args)]
pub(crate) struct RunSettingsArgs {
    /// Folder for the caches and the record of the run [default: out/<shot name>]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Time limit, for example 11h50m: the run writes a checkpoint and stops in time before it [default: the site file]
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub(crate) max_wall: Option<Duration>,
    /// Interval of checkpoints: a number of frames (10f), a time (15m), or `auto`; longer if they would take more
    /// than a twentieth of the time [default: the site file, or auto]
    #[arg(long, value_name = "N")]
    pub(crate) checkpoint_every: Option<Every>,
    /// Number of recent checkpoints to keep [default: the site file, or 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) keep: Option<u16>,
    /// Exit code when stopped early at a checkpoint (99 makes SGE start the job again) [default: the site file, or 75]
    #[arg(long, value_name = "N")]
    pub(crate) resumable_exit_code: Option<u8>,
    /// End of the run after SIGTERM, once its checkpoint is written [default: the site file, or exit]
    #[arg(long, value_enum)]
    pub(crate) on_term: Option<OnTerm>,
    /// Style of the progress report [default: DRAPERY_PROGRESS, the site file, or auto]
    #[arg(long, value_enum)]
    pub(crate) progress: Option<ProgressStyle>,
}

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// All that was typed, for the command line that continues the run.
    #[arg(skip)]
    pub(crate) words: Vec<OsString>,
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    #[command(flatten)]
    pub(crate) settings: RunSettingsArgs,
    /// Checkpoint to resume from if the folder holds a run of this shot: `auto` is the last good one, a frame number
    /// the one of that frame; `never` refuses such a folder
    #[arg(long, value_name = "auto|never|FRAME", default_value = "auto", value_parser = parse_resume)]
    #[arg(allow_hyphen_values = true)]
    pub(crate) resume: Resume,
    /// Resume even if the scene or its inputs have changed; frames that are simulated again are moved to stale/, and the
    /// change is recorded
    #[arg(long)]
    pub(crate) resume_with_changes: bool,
    /// Replace the run in the folder and start over
    #[arg(long, conflicts_with_all = ["resume", "resume_with_changes"])]
    pub(crate) overwrite: bool,
    /// Take over the folder from another run that holds its lock; make sure that this run has ended
    #[arg(long)]
    pub(crate) steal_lock: bool,
    /// Frames at which checkpoints are written and kept, for example 1040,1066
    #[arg(long, value_name = "FRAMES", value_delimiter = ',', allow_hyphen_values = true)]
    pub(crate) pin_checkpoint: Vec<i64>,
    /// End with exit code 81 if a count that should be zero is not, such as intersections (`crossings`); all frames are
    /// written
    #[arg(long)]
    pub(crate) strict: bool,
    /// Write the cloth after a stage of a time step to DIR/dump, for example B.4 in every step, B.4@1005 in the steps
    /// to frame 1005, or B.4@1005.3 in the third of them; stages are A, B.1 to B.8 and C (docs/reference/dump.md)
    #[arg(long, value_name = "LINE[@FRAME[.STEP]]", value_delimiter = ',')]
    pub(crate) dump: Vec<Tracepoint>,
    /// SCENE is a bundle (DIR/debug/*.json) that a run left when the solver gave up: resume from its last good state to
    /// the next frame, and write nothing but what --dump asks for
    #[arg(long, conflicts_with_all = ["resume", "resume_with_changes", "overwrite", "steal_lock", "strict", "frames"])]
    pub(crate) replay: bool,
}

/// Arguments of `check`.
#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    /// Print JSON: frames, and the warnings with their rules; or the error
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    #[command(flatten)]
    pub(crate) settings: RunSettingsArgs,
    /// Simulate the first frames in memory to measure the cost of each effect; 1 frame if no number is given
    #[arg(long, value_name = "FRAMES", num_args = 0..=1, default_missing_value = "1", require_equals = true)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) measure: Option<u32>,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// One file.
#[derive(Debug, Args)]
pub(crate) struct FileArgs {
    /// Mesh or cache file
    pub(crate) file: PathBuf,
}

/// Arguments of `convert`.
///
/// The cache goes through frame by frame; faces, texture coordinates, face sets and other attributes go with it. Numbers are
/// copied where unit and axis stay.
#[derive(Debug, Args)]
pub(crate) struct ConvertArgs {
    /// A cache (.abc or .h5), or any stage of USD
    pub(crate) from: PathBuf,
    /// The new cache; its extension says the format: .abc, .h5, .usd, .usdc for one binary layer with all meshes, or .pc2 or .mdd
    /// for points alone
    pub(crate) to: PathBuf,
    /// Path of the mesh, where the cache holds several
    #[arg(long, value_name = "PATH")]
    pub(crate) object: Option<String>,
    /// Frames to take, for example 1001-1100 [default: all]
    #[arg(long, value_name = "A-B", value_parser = parse_frames, allow_hyphen_values = true)]
    pub(crate) frames: Option<FrameRange>,
    /// Unit of the old cache: m, cm, mm, in or ft [default: as stated in the file, or m]
    #[arg(long, value_name = "UNIT", value_parser = parse_length)]
    pub(crate) from_length: Option<LengthUnit>,
    /// Up axis of the old cache: Y or Z [default: as stated in the file, or Y]
    #[arg(long, value_name = "AXIS", value_parser = parse_up)]
    pub(crate) from_up: Option<UpAxis>,
    /// Unit of the new cache: m, cm, mm, in or ft [default: as in the old cache]
    #[arg(long, value_name = "UNIT", value_parser = parse_length)]
    pub(crate) length: Option<LengthUnit>,
    /// Up axis of the new cache: Y or Z [default: as in the old cache]
    #[arg(long, value_name = "AXIS", value_parser = parse_up)]
    pub(crate) up: Option<UpAxis>,
    /// Frame rate, for example 24 or 24000/1001, if the cache does not state it
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub(crate) fps: Option<(u32, u32)>,
    /// Write the simulated triangles instead of the original faces, so that renderers cannot split quads differently
    #[arg(long)]
    pub(crate) triangles: bool,
    /// Replace an existing file
    #[arg(long)]
    pub(crate) overwrite: bool,
}

/// Arguments of `verify`.
///
/// Intersections are decided without rounding, on the positions as they are stored: edges that pass through a triangle of
/// the same mesh or of another, or touch one with which they share no point. Give the garments of a shot together.
#[derive(Debug, Args)]
pub(crate) struct VerifyArgs {
    /// Alembic files or USD stages that belong together; with --record also HDF5 caches
    #[arg(required_unless_present = "record", value_name = "CACHE")]
    pub(crate) files: Vec<PathBuf>,
    /// Also compare every frame with the record of the run in this folder; without CACHE, compare all caches of that run
    #[arg(long, value_name = "DIR")]
    pub(crate) record: Option<PathBuf>,
    /// Also report intersections of the caches with this mesh, read in the unit of the caches; they break no rule
    #[arg(long, value_name = "FILE")]
    pub(crate) body: Option<PathBuf>,
}

/// Arguments of `status`.
#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// Folders of runs, or of wedges for all of their runs
    #[arg(value_name = "DIR", required = true)]
    pub(crate) folders: Vec<PathBuf>,
    /// Print a JSON object for each run, one a line
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `view`.
///
/// The page is for this machine alone (127.0.0.1), and is served until Ctrl-C. It follows a run in progress.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// Folder of the run
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
    /// Port of the page [default: the first free one from 8017 on]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) port: Option<u16>,
    /// Print the address, and open no browser
    #[arg(long)]
    pub(crate) no_browser: bool,
    /// Write a page with the frames inside, which needs neither the run nor this program, and end; up to 18 MB: longer runs with every
    /// second or third frame
    #[arg(long, value_name = "FILE", conflicts_with_all = ["port", "no_browser"])]
    pub(crate) page: Option<PathBuf>,
}

/// Arguments of `stop`.
#[derive(Debug, Args)]
pub(crate) struct StopArgs {
    /// Folder of the run
    #[arg(value_name = "DIR")]
    pub(crate) folder: PathBuf,
}

/// Arguments of `diff`.
#[derive(Debug, Args)]
pub(crate) struct DiffArgs {
    /// A cache (.abc or .h5), a stage of USD, a checkpoint, or the folder of a run
    pub(crate) a: PathBuf,
    /// File or folder to compare with; caches may be of different formats and units
    pub(crate) b: PathBuf,
    /// Largest accepted distance between corresponding vertices, in metres; 0 accepts identical positions only
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.0,
        value_parser = parse_tolerance,
        allow_hyphen_values = true
    )]
    pub(crate) tolerance: f64,
    /// Print JSON, with every frame
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `selftest`.
#[derive(Debug, Args)]
pub(crate) struct SelftestArgs {
    /// A file that starts the command, which cases of the command need.
    #[arg(skip)]
    pub(crate) program: Option<PathBuf>,
    /// The hard cases: `quick` takes minutes, `full` takes larger scenes and combinations of cases, `soak` a weekend
    #[arg(long, value_enum, value_name = "TIER", num_args = 0..=1, default_missing_value = "quick")]
    pub(crate) hard: Option<HardTier>,
    /// Garments that start crossed and have to come free within 48 frames, each drawn by a seed
    #[arg(long, conflicts_with_all = ["hard", "cases"])]
    pub(crate) tangles: bool,
    /// The drape test of these preset materials, or of all: a disc hangs over its support at three mesh densities, six mountings
    /// each
    #[arg(long, value_name = "MATERIAL", num_args = 0.., required_unless_present_any = ["hard", "tangles", "bits"], conflicts_with_all = ["hard", "tangles"])]
    pub(crate) drape: Option<Vec<String>>,
    /// Compare the bits of this scene on one rank and on the numbers of --ranks, after every line of every step; print the
    /// first line that differs
    #[arg(long, value_name = "SCENE", conflicts_with_all = ["hard", "tangles", "drape", "integrator", "cases", "seeds", "json"])]
    pub(crate) bits: Option<PathBuf>,
    /// Numbers of ranks to compare, with threads per rank as in 3x2
    #[arg(long, value_name = "N", value_delimiter = ',', requires = "bits", default_value = "2,3,4,7,2x2")]
    pub(crate) ranks: Vec<Layout>,
    /// Last frame to compare [default: the scene's last]
    #[arg(long, value_name = "FRAME", requires = "bits", allow_hyphen_values = true)]
    pub(crate) last: Option<i64>,
    /// Set a parameter or any key of the scene, as for `run`; repeatable
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = parse_setting, requires = "bits")]
    pub(crate) settings: Vec<(String, String)>,
    /// Integrator of the scenes of the hard cases and tangles
    #[arg(long, value_parser = integrators(), value_name = "WORD", default_value = Integrator::WORDS[0].name, conflicts_with = "drape")]
    pub(crate) integrator: Integrator,
    /// Only these cases, for example H23; repeatable
    #[arg(long = "case", value_name = "ID")]
    pub(crate) cases: Vec<String>,
    /// Only the combinations of three cases, or the tangles, that these seeds draw, for example 17 or 0-199
    #[arg(long = "seed", value_name = "A-B", value_parser = parse_seeds, conflicts_with = "cases")]
    pub(crate) seeds: Option<SeedRange>,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Extent of the tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum HardTier {
    /// Up to 2000 triangles a case
    Quick,
    /// Larger and longer
    Full,
    /// The longest
    Soak,
}

/// Parser of the words of integrators in scenes.
fn integrators() -> impl TypedValueParser<Value = Integrator> {
    let words = Integrator::ALL.iter().zip(Integrator::WORDS);
    let words = words.map(|(integrator, word)| PossibleValue::new(integrator.word()).help(word.help));
    PossibleValuesParser::new(words).map(|word| Integrator::find(&word).expect("the parser knows these words alone"))
}

/// Arguments of `report`.
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// Folder of the run; the page is written into it as report.html. With several folders, or with the folder of a wedge, the page
    /// compares the runs
    #[arg(value_name = "DIR", required = true)]
    pub(crate) folders: Vec<PathBuf>,
    /// The page that compares several runs, with its table beside it as CSV; a name in .csv is that of the table. Only pages and tables of
    /// Drapery are replaced [default: comparison.html]
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
}

/// Arguments of `study`.
#[derive(Debug, Args)]
pub(crate) struct StudyArgs {
    /// All that was typed, for the record.
    #[arg(skip)]
    pub(crate) words: Vec<OsString>,
    /// Scene file
    #[arg(required_unless_present = "from")]
    pub(crate) scene: Option<PathBuf>,
    /// Settings to vary, for example cfl=4,2,1 cg_tolerance=1e-2,1e-4 thickness=x0.5 without=bending resolution=20,40, or any
    /// key that --set takes [default: steps and solves, and one at a time everything else that costs time]
    #[arg(long, value_name = "NAME=A,B", num_args = 1.., value_parser = parse_vary)]
    pub(crate) vary: Vec<(String, Vec<String>)>,
    /// Run all combinations of the varied settings, instead of one change at a time
    #[arg(long, requires = "vary")]
    pub(crate) grid: bool,
    /// Run N of the combinations, chosen so that every value occurs equally often (Latin hypercube)
    #[arg(long, value_name = "N", requires = "vary", conflicts_with = "grid", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) latin: Option<u32>,
    /// Frames to study, from the first frame of the scene on [default: as many as the time allows]
    #[arg(long, value_name = "A-B", value_parser = parse_frames, allow_hyphen_values = true)]
    pub(crate) frames: Option<FrameRange>,
    /// Time limit of the study, for example 2m; the same command again resumes it
    #[arg(long, value_name = "TIME", value_parser = parse_duration, default_value = "10m")]
    pub(crate) max_wall: Duration,
    /// Time limit per frame for the recommended setting, for example 10s/frame
    #[arg(long, value_name = "TIME/frame", value_parser = parse_frame_budget)]
    pub(crate) budget: Option<Duration>,
    /// Copies with perturbed start positions, which give the predictability horizon
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub(crate) copies: u32,
    /// Number of runs that time each setting, the first one included
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) repeats: u32,
    /// Folder of the study [default: out/<scene>_study]
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Replace the study in the folder and start over
    #[arg(long)]
    pub(crate) overwrite: bool,
    /// Do not simulate: rewrite table, study.csv and report.html from this study.json
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "vary", "frames", "out", "overwrite", "settings"])]
    pub(crate) from: Option<PathBuf>,
    /// Write the recommended setting into this file, for --preset
    #[arg(long, value_name = "FILE")]
    pub(crate) write_preset: Option<PathBuf>,
    /// Set a parameter or any key of the scene for all runs; repeatable
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = parse_setting)]
    pub(crate) settings: Vec<(String, String)>,
    /// Number of threads [default: as for run]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,
    #[command(flatten)]
    pub(crate) materials: MaterialsArgs,
}

/// Style of the progress report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressStyle {
    /// A bar on a terminal, otherwise one line per frame
    Auto,
    /// ALF_PROGRESS n% (Tractor, Deadline, OpenCue)
    Alf,
    /// TR_PROGRESS n (Tractor)
    Tr,
    /// openjd_progress: n (Deadline Cloud)
    Openjd,
    /// Progress: n% (Deadline 10)
    Deadline,
    /// One JSON object per frame
    Json,
    /// Nothing
    None,
}

/// End of a run that SIGTERM has stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum OnTerm {
    /// Exit with the code of a resumable run
    Exit,
    /// End by the signal, for sites where this marks a job that a person has cancelled
    Signal,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
