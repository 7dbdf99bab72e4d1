//! Layers on their way from the disk to `openusd`: regular files alone, read as a whole, looked at before they are decoded.

use std::fs;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use openusd::ar::{
    Asset, AssetBuffer, DefaultResolver, ResolvedPath, Resolver, SharedBuffer, is_package_relative_path,
    join_package_relative_path, split_package_relative_path_outer,
};
use openusd::usdz;

use super::classes::Classes;
use super::promises;

/// Record of the files that were opened, and of the layers that were refused.
#[derive(Debug, Default)]
pub(crate) struct Log {
    /// Files, in the order in which they were opened.
    pub(crate) files: Vec<PathBuf>,
    /// Layers that were not handed on, and why.
    pub(crate) refused: Vec<(String, String)>,
    /// Inheritance between prims, in all layers.
    classes: Classes,
}

/// Finds layers as `openusd` does by itself, and opens them with care.
pub(crate) struct Guard {
    inner: DefaultResolver,
    log: Arc<Mutex<Log>>,
}

impl Guard {
    /// A guard and what it will have seen.
    pub(crate) fn new() -> (Self, Arc<Mutex<Log>>) {
        let log = Arc::<Mutex<Log>>::default();
        (Self { inner: DefaultResolver::new(), log: Arc::clone(&log) }, log)
    }

    /// Returns the fault in the inheritance between prims, in this layer or together with the layers before, if there
    /// is one.
    fn circle(&self, layer: &SharedBuffer) -> Option<String> {
        if promises::has_classes(layer) { seen(&self.log).classes.take(layer) } else { None }
    }

    fn refuse(&self, layer: &str, what: String) -> io::Error {
        seen(&self.log).refused.push((layer.to_owned(), what.clone()));
        io::Error::new(io::ErrorKind::InvalidData, what)
    }

    fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        // Before it is opened: to open a pipe waits for a writer, and a device may have no end.
        if !fs::metadata(path)?.is_file() {
            return Err(self.refuse(&path.display().to_string(), "not a file".to_owned()));
        }
        let mut bytes = Vec::new();
        fs::File::open(path)?.read_to_end(&mut bytes)?;
        let mut log = seen(&self.log);
        if !log.files.iter().any(|known| known == path) {
            log.files.push(path.to_owned());
        }
        Ok(bytes)
    }
}

/// The log, also after a panic that was answered elsewhere.
pub(crate) fn seen(log: &Mutex<Log>) -> MutexGuard<'_, Log> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Resolver for Guard {
    fn create_identifier(&self, asset_path: &str, anchor: Option<&ResolvedPath>) -> String {
        self.inner.create_identifier(asset_path, anchor)
    }

    fn resolve(&self, asset_path: &str) -> Option<ResolvedPath> {
        if !is_package_relative_path(asset_path) {
            return self.inner.resolve(asset_path);
        }
        // Through this resolver, so that the package is opened with care too.
        let (package, inner) = split_package_relative_path_outer(asset_path)?;
        let package = self.inner.resolve(&package)?;
        let package = package.to_str()?;
        usdz::package_contains(self, package, &inner)
            .then(|| ResolvedPath::new(join_package_relative_path(package, &inner)))
    }

    fn resolve_for_new_asset(&self, asset_path: &str) -> Option<ResolvedPath> {
        self.inner.resolve_for_new_asset(asset_path)
    }

    fn open_asset(&self, resolved_path: &ResolvedPath) -> io::Result<Box<dyn Asset>> {
        let name = resolved_path.to_str().unwrap_or_default();
        let (bytes, extension) = match split_package_relative_path_outer(name) {
            Some((package, inner)) if is_package_relative_path(name) => {
                (usdz::package_entry(self, &package, &inner)?.into_shared(), extension(&inner))
            }
            _ => (SharedBuffer::new(self.read(resolved_path)?), extension(name)),
        };
        if matches!(extension.as_str(), "usd" | "usda" | "usdc")
            && let Some(what) = promises::problem(&bytes).or_else(|| self.circle(&bytes))
        {
            return Err(self.refuse(name, what));
        }
        Ok(Box::new(Cursor::new(AssetBuffer::Shared(bytes))))
    }

    fn is_context_dependent_path(&self, asset_path: &str) -> bool {
        self.inner.is_context_dependent_path(asset_path)
    }

    fn identity(&self) -> String {
        self.inner.identity()
    }

    fn cache_id(&self) -> Option<u64> {
        self.inner.cache_id()
    }
}

fn extension(name: &str) -> String {
    Path::new(name).extension().unwrap_or_default().to_string_lossy().to_lowercase()
}
