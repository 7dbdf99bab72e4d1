//! A scene as another program hands it over: a file, or text with meshes in memory, and what is set in it.

use std::path::{Path, PathBuf};

use drapery_io::memory_mesh::MemoryMeshes;
use drapery_io::scene_file::{self, SceneFile, SceneFileError, SearchPaths};

use crate::fault::Fault;
use crate::shot::Shot;

/// Source of a scene, and the values set in it. Nothing is read before somebody asks.
#[derive(Debug, Clone)]
pub struct SceneSource {
    text: Text,
    /// Values that are set in it: a parameter or a dotted key, and its value, as `--set` has them.
    pub settings: Vec<(String, String)>,
    /// Paths on which files that it names are found.
    pub search: SearchPaths,
    /// Meshes in memory, which it names `memory:NAME` in the place of files.
    pub meshes: MemoryMeshes,
}

#[derive(Debug, Clone)]
enum Text {
    File(PathBuf),
    Memory { text: String, name: String, folder: PathBuf },
}

impl SceneSource {
    /// The scene of a file.
    pub fn file(path: impl Into<PathBuf>) -> Self {
        Self::of(Text::File(path.into()))
    }

    /// A scene of this text. `name` is what messages call it, and the shot where it has none; files that it names are relative
    /// to `folder`.
    pub fn text(text: impl Into<String>, name: impl Into<String>, folder: impl Into<PathBuf>) -> Self {
        Self::of(Text::Memory { text: text.into(), name: name.into(), folder: folder.into() })
    }

    fn of(text: Text) -> Self {
        let (settings, search, meshes) = Default::default();
        Self { text, settings, search, meshes }
    }

    /// The file, if it is one.
    pub fn path(&self) -> Option<&Path> {
        match &self.text {
            Text::File(path) => Some(path),
            Text::Memory { .. } => None,
        }
    }

    /// Reads it, without the files that it names.
    ///
    /// # Errors
    /// The file cannot be read, or says something that is not understood.
    pub fn read(&self) -> Result<SceneFile, SceneFileError> {
        let scene = match &self.text {
            Text::File(path) => scene_file::load_with(path, &self.settings, &self.search),
            Text::Memory { text, name, folder } => {
                scene_file::parse_with(text, name, folder, &self.settings, &self.search)
            }
        }?;
        Ok(scene.with_meshes(self.meshes.clone()))
    }

    /// The shot, with all its inputs checked: ready to run, or to be stepped. `frames` are the first and last that are asked for.
    ///
    /// # Errors
    /// All problems of the scene, of its inputs and of its start.
    pub fn prepare(&self, frames: Option<[i64; 2]>) -> Result<Shot, Fault> {
        Ok(Shot::prepare(self.read()?.resolve()?, frames)?)
    }
}
