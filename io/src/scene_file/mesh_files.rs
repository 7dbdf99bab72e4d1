//! Mesh files of a scene, and the units that they are read in.

use super::raw::FileUnits;
use super::resolve::{Resolver, written};
use super::tree::{Path, Segment};
use crate::mesh_source::MeshSource;
use crate::units::{self, InputUnits, Units};

/// Height of the first sample of a mesh, along the axis that is up [m].
fn height(source: &MeshSource) -> Option<f64> {
    let mut positions = Vec::new();
    // A file that cannot be read is reported by what asked for it.
    source.positions_at(source.first_time(), &mut positions).ok()?;
    let first = positions.first()?.y;
    let [low, high] = positions.iter().fold([first; 2], |[low, high], p| [low.min(p.y), high.max(p.y)]);
    Some(high - low)
}

impl Resolver<'_> {
    /// A mesh whose file states another unit of length than the scene, in the one that is meant; says so in place of `warning`.
    fn in_meant_unit(
        &mut self,
        source: MeshSource,
        general: Units,
        is_body: bool,
        warning: &mut Option<String>,
    ) -> MeshSource {
        let read_in = source.units();
        let why = if self.misstated == Some(read_in.metres) {
            Some(format!(
                "it is read in {}, because the file of a body states the same unit wrongly; if this file is right, set \
                 its `units`",
                general.length.plural()
            ))
        } else if is_body {
            height(&source).and_then(|height| units::why_meant_in(general, height, read_in))
        } else {
            None
        };
        if why.is_none() {
            return source;
        }
        *warning = why;
        self.misstated = Some(read_in.metres);
        source.read_in(InputUnits { metres: general.length.metres(), up: read_in.up })
    }

    /// Opens a mesh file, named relative to the scene file; problems point at `path`. Its units are those that `own` says, or
    /// itself, or the scene for all files. The size of a body tells whether its file states its unit rightly.
    pub(super) fn open(
        &mut self,
        path: &Path,
        file: &str,
        pattern: Option<&str>,
        own: Option<FileUnits>,
    ) -> Option<MeshSource> {
        if let Some(mesh) = self.scene.meshes.named(file) {
            let mesh = self.of_file(path, mesh)?;
            if pattern.is_some() {
                let help = "leave `path` out, or pass the meshes one by one".to_owned();
                self.error_with(path, "a mesh in memory is one object; none can be chosen by its path", help);
                return None;
            }
            return Some(MeshSource::in_memory(&mesh, own.map_or(Units::SI, written)));
        }
        let file = self.scene.folder.join(file);
        let (own, general) = (own.map(written), self.scene.document.units.map(written));
        let mut warning = None;
        let opened = MeshSource::open_stating(&file, pattern, |stated| match stated {
            None => own.or(general).map(InputUnits::from),
            Some(stated) => {
                let (units, said) = units::decide(stated, own, general);
                warning = said;
                Some(units)
            }
        });
        self.takes(file.clone());
        let Some(source) = self.of_file(path, opened)? else {
            let help = "add [units] with length = \"m\", \"cm\", \"mm\", \"in\" or \"ft\" and up = \"Y\" or \"Z\"";
            self.error_with(path, "the units of this file are unknown", help.to_owned());
            return None;
        };
        let stated = own.is_none() && source.states_length();
        let source = match general.filter(|general| stated && general.length.metres() != source.units().metres) {
            Some(general) => {
                let is_body = matches!(path.0.first(), Some(Segment::Key(key)) if key == "body");
                self.in_meant_unit(source, general, is_body, &mut warning)
            }
            None => source,
        };
        for file in source.other_files() {
            if !self.referred_files.contains(&file) {
                self.referred_files.push(file.clone());
            }
            self.takes(file);
        }
        for note in warning.into_iter().chain(source.notes()) {
            self.warn(&file.display().to_string(), &note);
        }
        Some(source)
    }
}
