//! Presets: settings that a study recommends, in a file that `--preset` takes.
//!
//! ```toml
//! drapery_preset = 1
//!
//! [set]
//! "solver.cfl" = "2"
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use drapery_io::error::IoError;
use drapery_io::scene_file::{SceneFileError, read_table};
use serde::Deserialize;

use crate::page::text;
use crate::study::analysis::{Analysis, Row};
use crate::study::record::Study;
use crate::study::table::error_words;

/// Version of presets that this program writes and reads.
const VERSION: u32 = 1;

/// Key by which a file is known to be a preset.
pub const KEY: &str = "drapery_preset";

/// A preset as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Preset {
    drapery_preset: u32,
    #[serde(default)]
    set: BTreeMap<String, String>,
}

/// The recommended settings as the text of a preset; `None` if nothing can be recommended.
pub fn text(study: &Study, analysis: &Analysis<'_>, budget: Option<f64>) -> Option<String> {
    let row: &Row<'_> = &analysis.rows[analysis.recommended(budget)?];
    let within =
        budget.map_or("at the knee of the front".to_owned(), |b| format!("within {} per frame", text::seconds(b)));
    let mut text = format!(
        "# Recommended by drapery study for {} {within}: {}\n# {} per frame on {}, error {} (RMS)\n\
         drapery_preset = {VERSION}\n\n[set]\n",
        study.scene.shot,
        row.sample.setting.label,
        text::seconds(row.seconds),
        text::threads(study.machine.threads),
        error_words(row.error.as_ref())
    );
    for (key, value) in &row.sample.setting.settings {
        // Keys and values are quoted as TOML wants it.
        text += &format!("{} = {}\n", toml::Value::from(key.as_str()), toml::Value::from(value.as_str()));
    }
    Some(text)
}

/// The `--set` arguments of a preset.
///
/// # Errors
/// The file cannot be read, or is none.
pub fn read(path: &Path) -> Result<Vec<(String, String)>, SceneFileError> {
    let preset: Preset = read_table(path)?;
    if preset.drapery_preset != VERSION {
        let what = format!("version {} is not supported; this program reads version {VERSION}", preset.drapery_preset);
        let error = IoError::data(path, KEY, what, "write it again with `drapery study --write-preset`");
        return Err(SceneFileError::of_file(None, &error));
    }
    Ok(preset.set.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::analysis::{analyse, tests::convergent};

    #[test]
    fn a_preset_comes_back_as_the_settings_that_were_recommended() {
        let study = convergent();
        let analysis = analyse(&study);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.toml");
        std::fs::write(&path, text(&study, &analysis, Some(2.5)).unwrap()).unwrap();
        assert_eq!(read(&path).unwrap(), [("solver.cfl".to_owned(), "2".to_owned())]);
        std::fs::write(&path, "drapery_preset = 2").unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("version 2"));
        std::fs::write(&path, "drapery_preset = 1\n[sett]\n").unwrap();
        assert!(read(&path).is_err());
    }
}
