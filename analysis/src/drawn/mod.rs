//! Cloth and bodies of a run, as pages draw them: the contact sheet of the report, and the page of `drapery view`.

pub(crate) mod bodies;
pub(crate) mod cloth;

use drapery_io::scene_file::{self, SceneFileError};
use drapery_io::shot_description::ShotDescription;
use drapery_shot::run_record::RESOLVED;
use drapery_shot::run_record::folder::RunFolder;

/// The scene of a run with its files opened.
///
/// # Errors
/// It cannot be read any more, such as without its input files.
pub(crate) fn scene(folder: &RunFolder) -> Result<ShotDescription, Vec<SceneFileError>> {
    scene_file::load(&folder.path.join(RESOLVED), &[]).map_err(|error| vec![error])?.resolve()
}
