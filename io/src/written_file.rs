//! Files that stay open while they are written, looked at under their names: whether each still is the file that is written.
//!
//! Another program may remove, replace or cut such a file. The system does not object, and every later write succeeds: into a file
//! that nobody finds any more.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::Path;

use crate::error::IoError;
use crate::platform::FileIdentity;

/// Makes sure that `path` names a file with at least `length` bytes: the open `file` where it is still written, any where it was
/// closed.
///
/// # Errors
/// The file was removed, replaced or cut by another program; the system does not tell.
pub fn check<'a>(path: &Path, file: impl Into<Option<&'a File>>, length: u64) -> Result<(), IoError> {
    let failed = |error| IoError::writing(path, error);
    let changed = |what: String| Err(IoError::OutputChanged { path: path.to_owned(), what });
    let own = file.into().map(FileIdentity::of).transpose().map_err(failed)?;
    let identity = || own.is_some().then(|| FileIdentity::named(path)).transpose();
    match fs::metadata(path).and_then(|about| Ok((about.len(), identity()?))) {
        Err(error) if error.kind() == ErrorKind::NotFound => changed("has removed this file".to_owned()),
        Err(error) => Err(failed(error)),
        Ok((_, named)) if named != own => changed("has replaced this file".to_owned()),
        Ok((found, _)) if found < length => changed(format!("has truncated this file from {length} to {found} bytes")),
        Ok(_) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use crate::attributes::{PointAttributes, PointValues};
    use crate::cache::{CacheFrame, CachePlan, CacheWriter};
    use crate::error::IoErrorKind;
    use crate::formats::{FORMATS, by_extension};
    use crate::garment_mesh::GarmentMesh;
    use crate::mesh_data::MeshData;
    use crate::units::Units;
    use drapery_core::Vec3;
    use drapery_core::mesh::PolygonMesh;
    use drapery_core::scene::Timeline;

    /// A cache of which two frames are written, in a folder that it has for itself.
    fn begun(folder: &Path, extension: &str) -> (Box<dyn CacheWriter>, std::path::PathBuf) {
        let points = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
        let mesh = GarmentMesh::kept(MeshData::new(PolygonMesh::from_triangles(points, &[[0, 1, 2]])));
        let plan = CachePlan {
            sub_frames: &[],
            garment: "sheet",
            mesh: &mesh,
            units: Units::SI,
            origin: Vec3::zeros(),
            timeline: Timeline::default(),
            first_frame: 1,
            last_frame: 9,
            velocities: false,
            normals: false,
            crossings: false,
            attributes: PointAttributes::default(),
        };
        let path = folder.join(format!("sheet.{extension}"));
        let create = by_extension(extension).and_then(|format| format.create).expect("caches are written");
        let mut writer = create(&path, &plan).unwrap();
        (1..=2).for_each(|frame| write(writer.as_mut(), frame).unwrap());
        (writer, path)
    }

    fn write(writer: &mut dyn CacheWriter, frame: i64) -> Result<(), IoError> {
        let positions = [[0.0, frame as f32, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
        let (positions, none): (&[[f32; 3]], &[[f32; 3]]) = (&positions, &[]);
        let (crossings, values) = (None, PointValues::default());
        writer.write(&CacheFrame { frame, sub_frame: 0, positions, velocities: none, normals: none, crossings, values })
    }

    #[test]
    fn a_cache_that_is_removed_or_cut_is_missed_by_the_next_frame_at_a_checkpoint_and_at_the_end() {
        type Step = fn(&mut dyn CacheWriter) -> Result<(), IoError>;
        type Harm = fn(&Path);
        let steps: [(&str, Step); 3] =
            [("frame", |writer| write(writer, 3)), ("checkpoint", |w| w.sync()), ("end", |w| w.finish())];
        let harms: [(&str, Harm); 2] = [
            ("removed this file", |path| fs::remove_file(path).unwrap()),
            ("truncated this file", |path| File::options().write(true).open(path).unwrap().set_len(5).unwrap()),
        ];
        // Those that a run writes; a conversion puts a whole file in its place.
        let written = FORMATS.iter().filter(|format| format.create.is_some() && format.resume.is_some());
        for extension in written.map(|format| format.extension) {
            for (when, step) in steps {
                for (what, harm) in harms {
                    let folder = tempfile::tempdir().unwrap();
                    let (mut writer, path) = begun(folder.path(), extension);
                    harm(&path);
                    let error = step(writer.as_mut()).expect_err(&format!("{extension}, {when}, {what}"));
                    assert_eq!(error.kind(), IoErrorKind::Io, "{error}");
                    let words = error.to_string();
                    assert!(words.contains(what) && words.contains(&format!("sheet.{extension}")), "{when}: {words}");
                }
                // Left alone, it is as it should be.
                let folder = tempfile::tempdir().unwrap();
                step(begun(folder.path(), extension).0.as_mut()).unwrap();
            }
        }
    }

    #[test]
    fn a_clip_that_is_removed_is_missed_at_the_end() {
        if by_extension("usd").is_none() {
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let (mut writer, path) = begun(folder.path(), "usd");
        let clips = fs::read_dir(path.with_extension("clips")).unwrap().next().unwrap().unwrap().path();
        let clip = fs::read_dir(clips).unwrap().map(|entry| entry.unwrap().path());
        let clip = clip.filter(|path| path.extension().is_some_and(|e| e == "usdc")).min().expect("a clip");
        fs::remove_file(&clip).unwrap();
        assert!(writer.finish().unwrap_err().to_string().contains("has removed this file"), "{}", clip.display());
    }

    #[test]
    fn a_file_that_is_removed_replaced_or_cut_is_named_with_what_has_happened() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.abc");
        let written = || {
            let mut file = File::create(&path).unwrap();
            file.write_all(b"0123456789").unwrap();
            check(&path, &file, 10).unwrap();
            file
        };
        let words = |file: &File| check(&path, file, 10).unwrap_err().to_string();
        let file = written();
        file.set_len(4).unwrap();
        assert!(words(&file).contains("sheet.abc: another program has truncated this file from 10 to 4 bytes"));
        assert!(check(&path, None, 10).unwrap_err().to_string().contains("from 10 to 4 bytes"));
        let file = written();
        fs::remove_file(&path).unwrap();
        assert!(words(&file).contains("sheet.abc: another program has removed this file"));
        assert!(check(&path, None, 10).unwrap_err().to_string().contains("has removed this file"));
        fs::write(&path, "0123456789").unwrap();
        assert!(words(&file).contains("another program has replaced this file"));
        check(&path, None, 10).unwrap();
    }
}
