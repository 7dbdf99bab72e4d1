//! The site file: defaults of a place where Drapery runs, in TOML. Every key may be left out.
//!
//! ```toml
//! threads = 16
//! progress = "tr"
//! resumable_exit_code = 99
//! on_term = "signal"
//! checkpoint_every = "10m"
//! keep = 5
//! max_wall = "11h50m"
//! materials = ["materials"]
//! [paths]
//! "X:/" = "/mnt/x/"
//! ```
//!
//! Nothing in it changes a result; `materials` and `paths` say where files are found. A word that is not known is an
//! error: a default that is passed over in silence would be missed only on the farm.

use std::collections::BTreeMap;
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::de::Error;
use serde::{Deserialize, Deserializer};

use crate::checkpoint::Every;
use crate::duration::parse_duration;
use crate::scene_file::{self, PathMaps, SceneFileError};

/// Content of a site file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SiteFile {
    /// Number of threads.
    pub threads: Option<NonZeroU16>,
    /// Word of the mode of progress; the command knows the words.
    pub progress: Option<String>,
    /// Exit code when stopped early at a checkpoint.
    pub resumable_exit_code: Option<u8>,
    /// Word for how a run ends that was stopped by SIGTERM; the command knows the words.
    pub on_term: Option<String>,
    /// Interval between checkpoints.
    #[serde(deserialize_with = "every")]
    pub checkpoint_every: Option<Every>,
    /// Number of the last checkpoints that are kept.
    pub keep: Option<NonZeroU16>,
    /// Time that a run may take.
    #[serde(deserialize_with = "duration")]
    pub max_wall: Option<Duration>,
    /// Folders of material files; relative ones begin at the folder of the site file.
    pub materials: Vec<PathBuf>,
    /// Maps of the paths of input files.
    #[serde(deserialize_with = "path_maps")]
    pub paths: PathMaps,
}

impl SiteFile {
    /// Reads a site file.
    ///
    /// # Errors
    /// It cannot be read, is not TOML, or holds a key or value that is not understood; the first such place.
    pub fn read(path: &Path) -> Result<Self, SceneFileError> {
        let mut site: Self = scene_file::read_table(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for materials in &mut site.materials {
            *materials = folder.join(&materials);
        }
        Ok(site)
    }
}

fn every<'de, D: Deserializer<'de>>(text: D) -> Result<Option<Every>, D::Error> {
    String::deserialize(text)?.parse().map(Some).map_err(D::Error::custom)
}

fn duration<'de, D: Deserializer<'de>>(text: D) -> Result<Option<Duration>, D::Error> {
    let text = String::deserialize(text)?;
    // The message is one line in an excerpt of the file.
    parse_duration(&text).map(Some).map_err(|error| D::Error::custom(error.to_string().replace("\n  help: ", "; ")))
}

fn path_maps<'de, D: Deserializer<'de>>(table: D) -> Result<PathMaps, D::Error> {
    PathMaps::new(BTreeMap::<String, String>::deserialize(table)?).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: &str = "threads = 16\nprogress = \"tr\"\nresumable_exit_code = 99\non_term = \"signal\"\n\
                       checkpoint_every = \"10m\"\nkeep = 5\nmax_wall = \"11h50m\"\nmaterials = [\"cloth\", \"/lib\"]\n\
                       [paths]\n\"X:/\" = \"/mnt/x/\"\n";

    fn read(text: &str) -> Result<SiteFile, SceneFileError> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("site.toml");
        std::fs::write(&path, text).expect("it can be written to");
        let mut site = SiteFile::read(&path)?;
        for materials in &mut site.materials {
            *materials = materials.strip_prefix(folder.path()).unwrap_or(materials).to_owned();
        }
        Ok(site)
    }

    #[test]
    fn every_key_is_read_and_every_key_may_be_left_out() {
        let site = read(ALL).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((site.threads.map(NonZeroU16::get), site.keep.map(NonZeroU16::get)), (Some(16), Some(5)));
        assert_eq!((site.progress.as_deref(), site.on_term.as_deref()), (Some("tr"), Some("signal")));
        assert_eq!((site.resumable_exit_code, site.checkpoint_every), (Some(99), Some(Every::Seconds(600.0))));
        assert_eq!(site.max_wall, Some(Duration::from_secs(42_600)));
        assert_eq!(site.materials, [PathBuf::from("cloth"), PathBuf::from("/lib")]);
        assert_eq!(site.paths.pairs(), [("X:".to_owned(), "/mnt/x".to_owned())]);
        assert_eq!(read("").unwrap_or_else(|error| panic!("{error}")), SiteFile::default());
    }

    #[test]
    fn what_is_not_understood_is_an_error_with_its_line() {
        for (from, to, words) in [
            ("threads", "treads", "site.toml:1:1: unknown key `treads`"),
            ("threads", "treads", "did you mean `threads`?"),
            ("= 16", "= 0", "from 1 to 65535"),
            ("= 99", "= 256", "from 0 to 255"),
            ("\"10m\"", "\"10\"", "has no unit"),
            ("\"11h50m\"", "\"11h50\"", "site.toml:7:12: `max_wall`: "),
            ("\"X:/\" =", "\"x/\" =", "not the start of an absolute path"),
            ("[paths]", "[path]", "did you mean `paths`?"),
            ("keep", "= keep", "not valid TOML"),
        ] {
            let text = read(&ALL.replace(from, to)).expect_err(to).to_string();
            assert!(text.contains(words), "`{words}` in\n{text}");
        }
    }
}
