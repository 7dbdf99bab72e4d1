//! Do caches hold what the record of their run says?

use std::path::{Path, PathBuf};

use drapery_io::error::IoError;
use drapery_shot::recorded_frames::{Compared, RecordedCache};
use drapery_shot::run_record::RECORD;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::reader::in_words;

use super::Verification;

/// Faults of one cache that are reported one by one; what lies behind them is a number.
const SHOWN: usize = 8;

/// Compares every complete frame of caches with the record of the run in `folder`: of all caches that its manifest lists, or of
/// those in `files`, which may be copies elsewhere but have the names of the run's own.
///
/// # Errors
/// The folder holds no run; its manifest or record cannot be read; a file is none of the run's caches. What is wrong with a
/// cache is a failure, not an error.
pub fn recorded(folder: &Path, files: &[&Path]) -> Result<Verification, IoError> {
    let run = RunFolder::read(folder)?;
    let all: Vec<PathBuf> = listed(&run).filter_map(|(name, _)| run.cache(name)).collect();
    let files = if files.is_empty() { all.iter().map(PathBuf::as_path).collect() } else { files.to_vec() };
    let mut found = Verification::default();
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let Some((_, garment)) = listed_as(&run, &name) else {
            let caches = listed(&run).map(|(name, _)| name).collect::<Vec<_>>().join(", ");
            let what = format!("the run in {} has no cache of this name", folder.display());
            return Err(IoError::data(path, "name", what, format!("its caches are {caches}")));
        };
        check(&run, &RecordedCache { path, root: None, garment }, &mut found);
    }
    Ok(found)
}

/// Names of the caches of a run, each with its garment or belt.
fn listed(run: &RunFolder) -> impl Iterator<Item = (&str, &str)> {
    let garments = run.manifest.garments.iter().map(|garment| (&garment.name, &garment.files));
    let objects = garments.chain(run.manifest.bodies.iter().map(|body| (&body.name, &body.files)));
    objects.flat_map(|(name, files)| files.iter().map(|file| (file.as_str(), name.as_str())))
}

fn listed_as<'a>(run: &'a RunFolder, name: &str) -> Option<(&'a str, &'a str)> {
    listed(run).find(|(listed, _)| *listed == name)
}

/// Compares one cache.
fn check(run: &RunFolder, cache: &RecordedCache<'_>, found: &mut Verification) {
    let name = cache.path.display();
    let Some(last) = run.manifest.last_complete_frame else {
        found.facts.push(format!("{name}: the run has no complete frame yet"));
        return;
    };
    let frames = [run.manifest.first_frame, last];
    match cache.compare(&run.record, frames, false) {
        Err(error) => found.failures.push(error.to_string()),
        Ok(Compared { sound, unrecorded, faults }) => {
            found.facts.push(format!("{name}: {sound} of {} frames match the record", last - frames[0] + 1));
            if !unrecorded.is_empty() {
                let what = format!("cannot be verified: {RECORD} has no digests of them");
                // Nobody knows whether these frames are as recorded.
                found.failures.push(format!("{name}: {} {what}", in_words(&unrecorded)));
            }
            found.failures.extend(faults.iter().take(SHOWN).map(ToString::to_string));
            if faults.len() > SHOWN {
                let (next, more) = (faults[SHOWN].frame, faults.len() - SHOWN);
                found.failures.push(format!("{name}: {more} more frames differ from the record, from frame {next} on"));
            }
        }
    }
}
