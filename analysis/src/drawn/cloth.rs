//! The garments of a run, from their caches.

use drapery_core::Vec3;
use drapery_io::cache_frames::{CacheFrames, CacheMesh};
use drapery_io::error::IoError;
use drapery_shot::run_record::folder::RunFolder;
use drapery_shot::run_record::manifest::ManifestGarment;

/// Colours of garments: red, green and blue.
pub(crate) const COLOURS: [[u8; 3]; 6] =
    [[86, 148, 226], [228, 158, 66], [88, 190, 150], [214, 122, 160], [150, 134, 226], [202, 190, 92]];

/// A garment as it is drawn.
pub(crate) struct Garment {
    /// Its name.
    pub(crate) name: String,
    /// The cache that it is drawn from.
    pub(crate) cache: CacheFrames,
    /// Red, green and blue.
    pub(crate) colour: [u8; 3],
}

impl Garment {
    /// Positions of all its meshes at a frame [m].
    ///
    /// # Errors
    /// The cache has no such frame, or it cannot be read.
    pub(crate) fn positions(&self, frame: i64) -> Result<Vec<Vec<Vec3>>, IoError> {
        (0..self.cache.meshes.len()).map(|mesh| self.positions_of(mesh, frame)).collect()
    }

    /// Positions of one of its meshes at a frame [m].
    ///
    /// # Errors
    /// The cache has no such frame, or it cannot be read.
    pub(crate) fn positions_of(&self, mesh: usize, frame: i64) -> Result<Vec<Vec3>, IoError> {
        let CacheMesh { name, frames, .. } = &self.cache.meshes[mesh];
        let sample = frames.binary_search(&frame).map_err(|_| {
            let advice = "look at a frame that the run has written";
            IoError::data(&self.cache.path, name, format!("there is no frame {frame}"), advice)
        })?;
        self.cache.positions(mesh, sample)
    }
}

/// The garments, without render meshes, which would hide them.
pub(crate) fn simulated(folder: &RunFolder) -> impl Iterator<Item = &ManifestGarment> {
    folder.manifest.garments.iter().filter(|garment| garment.render_mesh_of.is_none())
}

/// The first cache of each garment that can be read, or the fault of the last one; nothing for garments without caches.
pub(crate) fn garments(folder: &RunFolder) -> Vec<Result<Garment, IoError>> {
    let listed = simulated(folder).zip(COLOURS.iter().cycle());
    let open = |(garment, colour): (&ManifestGarment, &[u8; 3])| {
        let mut found: Option<Result<Garment, IoError>> = None;
        for path in garment.files.iter().filter_map(|name| folder.cache(name)) {
            let opened = CacheFrames::open(&path);
            found = Some(opened.map(|cache| Garment { name: garment.name.clone(), cache, colour: *colour }));
            if matches!(found, Some(Ok(_))) {
                break;
            }
        }
        found
    };
    listed.filter_map(open).collect()
}

/// Frames that every garment has.
pub(crate) fn common_frames(garments: &[Garment]) -> Vec<i64> {
    let mut meshes = garments.iter().flat_map(|garment| &garment.cache.meshes);
    let Some(first) = meshes.next() else { return Vec::new() };
    let mut frames = first.frames.clone();
    for mesh in meshes {
        frames.retain(|frame| mesh.frames.binary_search(frame).is_ok());
    }
    frames
}
