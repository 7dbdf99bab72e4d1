//! Settings of a run, from flags, environment and site file. A flag wins over the environment, the environment over the site
//! file, and the site file over the default. Each value keeps its source.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use clap::ValueEnum;
use drapery_core::settings::nearest;
use drapery_io::checkpoint::Every;
use drapery_io::duration::parse_epoch;
use drapery_io::scene_file::{SceneErrorKind, SearchPaths};
use drapery_io::site_file::SiteFile;
use drapery_shot::farm::stop::{Reason, StopRequests};
use drapery_shot::run::RunOptions;

use crate::args::{MaterialsArgs, OnTerm, ProgressStyle, RunSettingsArgs};
use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// Variable that names the site file.
const CONFIG: &str = "DRAPERY_CONFIG";

/// Variable with folders of material files.
const MATERIALS: &str = "DRAPERY_MATERIALS";

/// Variable with the mode of progress.
const PROGRESS: &str = "DRAPERY_PROGRESS";

/// Environment variables that give the number of threads, the first one wins.
const THREADS: [&str; 4] = ["DRAPERY_THREADS", "OMP_NUM_THREADS", "CUE_THREADS", "SLURM_CPUS_PER_TASK"];

/// Points of time at which a run is to have stopped, from the environment: the variable, its key in a plan, and what a
/// stop is then called.
const STOP_TIMES: [(&str, &str, Reason); 2] =
    [("DRAPERY_STOP_AT", "stop_at", Reason::StopAt), ("SLURM_JOB_END_TIME", "job_end", Reason::JobEnd)];

/// Sources of a value that neither a flag nor a variable gives.
pub(crate) const SITE_FILE: &str = "site file";
pub(crate) const DEFAULT: &str = "default";

/// A value and who said so.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Resolved<T> {
    pub(crate) value: T,
    pub(crate) source: &'static str,
}

impl<T> Resolved<T> {
    fn new(value: T, source: &'static str) -> Self {
        Self { value, source }
    }
}

/// The first of a flag, a site file's word and a default.
fn first_of<T>(flag: Option<T>, name: &'static str, site: Option<T>, default: T) -> Resolved<T> {
    match (flag, site) {
        (Some(value), _) => Resolved::new(value, name),
        (None, Some(value)) => Resolved::new(value, SITE_FILE),
        (None, None) => Resolved::new(default, DEFAULT),
    }
}

/// Environment variables and site file of the command.
pub(crate) struct Environment {
    variable: fn(&str) -> Option<OsString>,
    /// The site file and who named it.
    pub(crate) site_path: Option<Resolved<PathBuf>>,
    site: SiteFile,
}

impl Environment {
    /// Reads the site file that the flag or the environment names.
    pub(crate) fn find(config: Option<&Path>) -> Result<Self, Failure> {
        Self::with(config, |name| {
            // A variable is often emptied to take it back.
            std::env::var_os(name).filter(|text| !text.to_string_lossy().trim().is_empty())
        })
    }

    fn with(config: Option<&Path>, variable: fn(&str) -> Option<OsString>) -> Result<Self, Failure> {
        let flag = config.map(|path| Resolved::new(path.to_owned(), "--config"));
        let site_path = flag.or_else(|| Some(Resolved::new(PathBuf::from(variable(CONFIG)?), CONFIG)));
        let site = match &site_path {
            None => SiteFile::default(),
            Some(Resolved { value: path, source }) => SiteFile::read(path).map_err(|error| match error.kind {
                SceneErrorKind::Missing => {
                    Failure::new(ExitCode::MissingInput, format!("site file from {source}: {error}"))
                }
                SceneErrorKind::Scene | SceneErrorKind::Memory => Failure::new(ExitCode::Scene, error.to_string()),
                SceneErrorKind::Reading => Failure::new(ExitCode::Io, error.to_string()),
                SceneErrorKind::Data => Failure::new(ExitCode::BadInput, error.to_string()),
            })?,
        };
        Ok(Self { variable, site_path, site })
    }

    /// A variable whose words are plain text.
    fn word(&self, name: &str) -> Option<String> {
        (self.variable)(name).map(|text| text.to_string_lossy().into_owned())
    }

    /// Number of threads that somebody asks for: flag, environment, site file.
    pub(crate) fn threads(&self, flag: Option<u16>) -> Option<Resolved<usize>> {
        if let Some(count) = flag {
            return Some(Resolved::new(count.into(), "--threads"));
        }
        for name in THREADS {
            let Some(text) = self.word(name) else { continue };
            // OMP_NUM_THREADS may be a list, one number a nesting level.
            match text.split(',').next().unwrap_or_default().trim().parse() {
                Ok(count) if count > 0 => return Some(Resolved::new(count, name)),
                _ => tracing::warn!("{name}={text} is not a number of threads and is ignored"),
            }
        }
        self.site.threads.map(|count| Resolved::new(usize::from(count.get()), SITE_FILE))
    }

    /// Returns the folders in which files are searched, with the source of the folders of materials.
    pub(crate) fn search(&self, flag: &MaterialsArgs) -> Resolved<SearchPaths> {
        let split = |text: &OsStr| -> Vec<PathBuf> {
            std::env::split_paths(text).filter(|path| !path.as_os_str().is_empty()).collect()
        };
        let folders = match (&flag.materials, (self.variable)(MATERIALS)) {
            (Some(text), _) => Resolved::new(split(text), "--materials"),
            (None, Some(text)) => Resolved::new(split(&text), MATERIALS),
            (None, None) => first_of(None, "", Some(self.site.materials.clone()).filter(|m| !m.is_empty()), Vec::new()),
        };
        let maps = self.site.paths.clone();
        Resolved::new(SearchPaths { maps, materials: folders.value }, folders.source)
    }

    /// A word of the site file.
    fn site_word<T: ValueEnum>(&self, key: &str, text: Option<&String>) -> Result<Option<T>, Failure> {
        let path = self.site_path.as_ref().map(|path| path.value.display().to_string()).unwrap_or_default();
        let read =
            |text: &String| word(text).map_err(|e| Failure::new(ExitCode::Scene, format!("{path}: `{key}`: {e}")));
        text.map(read).transpose()
    }
}

/// A word of a list, or what is wrong with it.
fn word<T: ValueEnum>(text: &str) -> Result<T, String> {
    T::from_str(text, false).map_err(|_| {
        let names: Vec<String> =
            T::value_variants().iter().filter_map(|v| Some(v.to_possible_value()?.get_name().to_owned())).collect();
        let help = match nearest(text, names.iter().map(String::as_str)) {
            Some(best) => format!("did you mean `{best}`?"),
            None => format!("use one of {}", names.join(", ")),
        };
        format!("unknown value `{text}`\n  help: {help}")
    })
}

/// A limit of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Limit {
    /// Counted from the start.
    After(Duration),
    /// A point of time: its key in a plan, and what a stop is then called.
    At(&'static str, Reason, SystemTime),
}

/// Settings of a run.
#[derive(Debug)]
pub(crate) struct RunSettings {
    pub(crate) progress: Resolved<ProgressStyle>,
    pub(crate) resumable_exit_code: Resolved<u8>,
    pub(crate) on_term: Resolved<OnTerm>,
    pub(crate) checkpoint_every: Resolved<Every>,
    pub(crate) keep: Resolved<u16>,
    /// The earliest counts.
    pub(crate) limits: Vec<Resolved<Limit>>,
}

impl RunSettings {
    /// Chooses each setting among flags, environment, site file and default.
    pub(crate) fn choose(args: &RunSettingsArgs, around: &Environment) -> Result<Self, Failure> {
        let usage =
            |name: &str, text: &str, error: String| Failure::new(ExitCode::Usage, format!("{name}={text}: {error}"));
        let site = &around.site;
        let mut progress = first_of(
            args.progress,
            "--progress",
            around.site_word("progress", site.progress.as_ref())?,
            ProgressStyle::Auto,
        );
        if let (None, Some(text)) = (args.progress, around.word(PROGRESS)) {
            progress = Resolved::new(word(&text).map_err(|error| usage(PROGRESS, &text, error))?, PROGRESS);
        }
        let mut limits = Vec::new();
        let max_wall = args.max_wall.map(|time| Resolved::new(time, "--max-wall"));
        if let Some(Resolved { value, source }) = max_wall.or(site.max_wall.map(|time| Resolved::new(time, SITE_FILE)))
        {
            limits.push(Resolved::new(Limit::After(value), source));
        }
        for (name, key, reason) in STOP_TIMES {
            if let Some(text) = around.word(name) {
                let at = parse_epoch(&text).map_err(|error| usage(name, &text, error.to_string()))?;
                limits.push(Resolved::new(Limit::At(key, reason, at), name));
            }
        }
        let on_term = around.site_word("on_term", site.on_term.as_ref())?;
        let (code, keep) = (site.resumable_exit_code, site.keep.map(std::num::NonZero::get));
        Ok(Self {
            progress,
            resumable_exit_code: first_of(
                args.resumable_exit_code,
                "--resumable-exit-code",
                code,
                ExitCode::Stopped as u8,
            ),
            on_term: first_of(args.on_term, "--on-term", on_term, OnTerm::Exit),
            checkpoint_every: first_of(args.checkpoint_every, "--checkpoint-every", site.checkpoint_every, Every::Auto),
            keep: first_of(args.keep, "--keep", keep, RunOptions::KEEP as u16),
            limits,
        })
    }

    /// The requests to stop that are known from the start.
    pub(crate) fn requests(&self) -> StopRequests {
        let (requests, now) = (StopRequests::default(), SystemTime::now());
        for limit in &self.limits {
            match limit.value {
                Limit::After(time) => requests.deadline(Reason::MaxWall, now + time, now),
                Limit::At(_, reason, at) => requests.deadline(reason, at, now),
            }
        }
        requests
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Surroundings with a site file in a folder that is kept beside them.
    fn around(site: &str, variable: fn(&str) -> Option<OsString>) -> (Environment, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("site.toml");
        std::fs::write(&path, site).unwrap();
        (Environment::with(Some(&path), variable).unwrap(), folder)
    }

    fn nothing(_: &str) -> Option<OsString> {
        None
    }

    #[test]
    fn the_flag_wins_over_the_environment_that_over_the_site_file_and_that_over_the_default() {
        let set = |name: &str| match name {
            "OMP_NUM_THREADS" => Some("3,2".into()),
            "CUE_THREADS" => Some("7".into()),
            "DRAPERY_PROGRESS" => Some("tr".into()),
            _ => None,
        };
        let (all, _kept) = around("threads = 9\nprogress = \"alf\"\nkeep = 7", set);
        assert_eq!(all.threads(Some(5)), Some(Resolved::new(5, "--threads")));
        assert_eq!(all.threads(None), Some(Resolved::new(3, "OMP_NUM_THREADS")));
        let flags = RunSettingsArgs { progress: Some(ProgressStyle::Json), keep: Some(2), ..Default::default() };
        let chosen = RunSettings::choose(&flags, &all).unwrap();
        assert_eq!(chosen.progress, Resolved::new(ProgressStyle::Json, "--progress"));
        assert_eq!(chosen.keep, Resolved::new(2, "--keep"));
        let chosen = RunSettings::choose(&RunSettingsArgs::default(), &all).unwrap();
        assert_eq!(chosen.progress, Resolved::new(ProgressStyle::Tr, "DRAPERY_PROGRESS"));
        assert_eq!(chosen.keep, Resolved::new(7, SITE_FILE));
        assert_eq!(chosen.resumable_exit_code, Resolved::new(75, DEFAULT));
        let (site, _kept) = around("threads = 9\nprogress = \"alf\"", nothing);
        assert_eq!(site.threads(None), Some(Resolved::new(9, SITE_FILE)));
        let chosen = RunSettings::choose(&RunSettingsArgs::default(), &site).unwrap();
        assert_eq!(chosen.progress, Resolved::new(ProgressStyle::Alf, SITE_FILE));
        let broken = |name: &str| (name == "DRAPERY_THREADS").then(|| "many".into());
        assert_eq!(around("", broken).0.threads(None), None);
    }

    #[test]
    fn limits_of_time_are_all_kept_and_the_earliest_counts() {
        let set = |name: &str| (name == "SLURM_JOB_END_TIME").then(|| "9999999999".into());
        let (around, _kept) = around("max_wall = \"1h\"", set);
        let chosen = RunSettings::choose(&RunSettingsArgs::default(), &around).unwrap();
        let sources: Vec<_> = chosen.limits.iter().map(|limit| limit.source).collect();
        assert_eq!(sources, [SITE_FILE, "SLURM_JOB_END_TIME"]);
        assert_eq!(chosen.requests().notice(SystemTime::now()).map(|n| n.reason), Some(Reason::MaxWall));
        let flag = RunSettingsArgs { max_wall: Some(Duration::from_secs(60)), ..Default::default() };
        let chosen = RunSettings::choose(&flag, &around).unwrap();
        assert_eq!(chosen.limits[0], Resolved::new(Limit::After(Duration::from_secs(60)), "--max-wall"));
    }
}
