//! Caches converted from one format to another: the same cloth, bit for bit where unit and axis stay.

use std::fs;
use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_io::cache::{CacheFrame, CachePlan};
use drapery_io::cache_frames::{CacheFrames, StoredFrame};
use drapery_io::convert::{Conversion, Converted, convert};
use drapery_io::error::IoErrorKind;
use drapery_io::formats::{by_extension, folder_of};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::MeshData;
use drapery_io::mesh_source::MeshSource;
use drapery_io::units::{LengthUnit, Units, UpAxis};

const FORMATS: &[&str] = if cfg!(feature = "usd") { &["abc", "h5", "usd"] } else { &["abc", "h5"] };

/// A quad that is cut along its longer diagonal in the first frame, a pentagon and a triangle, with UVs and face sets.
const SOURCE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 3 0.5 0\nv 1.5 1.5 0\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
    usemtl front\nf 1/1 2/2 3/3 4/4\nf 2/1 5/2 6/3 8/1 3/4\nusemtl trim\nf 5/1 7/2 6/3\n";

fn source(folder: &Path) -> MeshData {
    let path = folder.join("source.obj");
    fs::write(&path, SOURCE).unwrap();
    let mut data = MeshSource::open(&path, None, Units::SI).unwrap().mesh_at(0.0).unwrap();
    fs::remove_file(path).unwrap();
    data.object_path = "/garments/skirt/skirtShape".into();
    data
}

/// A cache of the frames 1001 to 1004, in centimetres with Z up, whose points are counted from far away.
fn write(folder: &Path, extension: &str, origin: Vec3) -> PathBuf {
    write_samples(folder, extension, (origin, &[]), f32::is_finite)
}

/// The same with samples between frames; the positions of a point are none of numbers where `takes` refuses what was planned.
fn write_samples(
    folder: &Path,
    extension: &str,
    (origin, sub_frames): (Vec3, &[f64]),
    takes: impl Fn(f32) -> bool,
) -> PathBuf {
    let data = source(folder);
    let plan = CachePlan {
        sub_frames,
        garment: "skirt",
        mesh: &GarmentMesh::kept(data.clone()),
        units: Units { length: LengthUnit::Centimetre, up: UpAxis::Z },
        origin,
        timeline: Timeline { fps_numerator: 24000, fps_denominator: 1001, ..Timeline::default() },
        first_frame: 1001,
        last_frame: 1004,
        velocities: true,
        normals: false,
        crossings: true,
        attributes: Default::default(),
    };
    let path = folder.join(format!("skirt.{extension}"));
    let mut writer = (by_extension(extension).unwrap().create.unwrap())(&path, &plan).unwrap();
    let behind = |frame: i64| if frame == 1004 { 0 } else { sub_frames.len() };
    for (frame, sub_frame) in (1001..=1004).flat_map(|frame| (0..=behind(frame)).map(move |number| (frame, number))) {
        let by = (frame - 1000) as f64 + sub_frame.checked_sub(1).map_or(0.0, |number| sub_frames[number]);
        let mut positions: Vec<Vec3> = data.mesh.points.iter().map(|p| p + origin + Vec3::z() * by / 7.0).collect();
        // The other diagonal of the quad would be the shorter one.
        positions[0] -= Vec3::new(0.3, 0.3, 0.0);
        let stored = positions.iter().map(|p| plan.units.stored_from(origin, *p));
        let positions: Vec<[f32; 3]> = stored.map(|p| p.map(|x| if takes(x) { x } else { f32::NAN })).collect();
        let velocities = plan.units.stored_all(&vec![Vec3::new(0.1, 0.2, by); positions.len()]);
        let crossings = Some(frame as u32);
        writer
            .write(&CacheFrame {
                frame,
                sub_frame,
                positions: &positions,
                velocities: &velocities,
                normals: &[],
                crossings,
                values: Default::default(),
            })
            .unwrap();
    }
    writer.finish().unwrap();
    path
}

fn converted(from: &Path, to: &Path) -> Converted {
    let conversion = Conversion { from: from.to_owned(), to: to.to_owned(), ..Conversion::default() };
    convert(&conversion, &mut |_| {}).unwrap()
}

#[test]
fn every_format_becomes_every_other_with_the_same_bits() {
    for origin in [Vec3::zeros(), Vec3::new(1e5, -300.0, 20.0)] {
        for from in FORMATS {
            for to in FORMATS {
                let folder = tempfile::tempdir().unwrap();
                let a = write(folder.path(), from, origin);
                let b = folder.path().join(format!("other.{to}"));
                assert_eq!(converted(&a, &b).frames, [1001, 1004]);
                let (a, b) = (CacheFrames::open(&a).unwrap(), CacheFrames::open(&b).unwrap());
                assert_eq!(a.meshes, b.meshes, "{from} to {to}");
                assert_eq!((a.units(), a.fps), (b.units(), b.fps), "{from} to {to}");
                for sample in 0..4 {
                    assert_eq!(
                        a.samples.frame(0, sample).unwrap(),
                        b.samples.frame(0, sample).unwrap(),
                        "{from} to {to}"
                    );
                    assert_eq!(a.positions(0, sample).unwrap(), b.positions(0, sample).unwrap(), "{from} to {to}");
                }
                let (a, b) = (a.attributes(0).unwrap(), b.attributes(0).unwrap());
                let uvs = |data: &MeshData| data.uvs.clone().map(|uvs| (uvs.values, uvs.indices));
                assert!(uvs(&a).is_some() && uvs(&a) == uvs(&b), "{from} to {to}");
                if *from != "h5" && *to != "h5" {
                    assert_eq!((a.face_sets.len(), a.face_sets), (2, b.face_sets), "{from} to {to}");
                }
            }
        }
    }
}

#[test]
fn unit_axis_and_frames_are_those_that_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let from = write(folder.path(), "abc", Vec3::zeros());
    for extension in FORMATS {
        let to = folder.path().join(format!("metres.{extension}"));
        let conversion = Conversion {
            from: from.clone(),
            to: to.clone(),
            frames: Some([1002, 1003]),
            length: Some(LengthUnit::Metre),
            up: Some(UpAxis::Y),
            ..Conversion::default()
        };
        let mut heard = Vec::new();
        assert_eq!(convert(&conversion, &mut |frame| heard.push(frame)).unwrap().units, Units::SI);
        assert_eq!(heard, [1002, 1003]);
        let (old, new) = (CacheFrames::open(&from).unwrap(), CacheFrames::open(&to).unwrap());
        assert_eq!(new.meshes[0].frames, [1002, 1003]);
        let stored = new.stored_positions(0, 0).unwrap().unwrap().points;
        for (p, expected) in stored.iter().zip(old.positions(0, 1).unwrap()) {
            // Rounded once as centimetres and once as metres, below 4 m.
            assert!((Vec3::from(p.map(f64::from)) - expected).norm() < 1e-6, "{extension}");
        }
        let rates = new.velocities(0, 1).unwrap().unwrap();
        assert!((rates[3] - Vec3::new(0.1, 0.2, 3.0)).norm() < 1e-6, "{extension}: {}", rates[3]);
    }
}

#[test]
fn what_is_there_is_replaced_only_when_asked_and_a_conversion_that_fails_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let from = write(folder.path(), "h5", Vec3::zeros());
    for extension in FORMATS {
        let to = folder.path().join(format!("other.{extension}"));
        let conversion = Conversion { from: from.clone(), to: to.clone(), ..Conversion::default() };
        convert(&conversion, &mut |_| {}).unwrap();
        let before = fs::read(&to).unwrap();
        let error = convert(&conversion, &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains("exists already") && error.contains("--overwrite"), "{error}");
        assert!(fs::read(&to).unwrap() == before);
        let metres = Conversion { length: Some(LengthUnit::Metre), overwrite: true, ..conversion.clone() };
        convert(&metres, &mut |_| {}).unwrap();
        assert_eq!(CacheFrames::open(&to).unwrap().units().length, LengthUnit::Metre);
        if let Some(clips) = folder_of(&to) {
            assert_eq!(fs::read_dir(clips).unwrap().count(), 1, "clips of the old form are left");
        }
        let asked = Conversion {
            frames: Some([1003, 1009]),
            to: folder.path().join(format!("none.{extension}")),
            ..conversion
        };
        let error = convert(&asked, &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains("frame 1009 is missing") && error.contains("1001-1004"), "{error}");
        let names = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let strange: Vec<String> = names.filter(|name| name.starts_with(['.', 'n'])).collect();
        assert!(strange.is_empty(), "{strange:?}");
    }
    let onto = Conversion { from: from.clone(), to: from.clone(), overwrite: true, ..Conversion::default() };
    assert!(convert(&onto, &mut |_| {}).unwrap_err().to_string().contains("are the same file"));
    let to_obj = Conversion { from, to: folder.path().join("a.obj"), ..Conversion::default() };
    assert!(convert(&to_obj, &mut |_| {}).unwrap_err().to_string().contains(".abc, .h5"));
}

/// Everything of all samples, frames first.
fn samples_of(cache: &CacheFrames) -> Vec<StoredFrame> {
    let mesh = &cache.meshes[0];
    (0..mesh.frames.len() + mesh.between.len()).map(|sample| cache.samples.frame(0, sample).unwrap()).collect()
}

#[test]
fn samples_between_frames_are_kept_where_the_format_holds_them_and_else_named() {
    let formats: Vec<&str> = FORMATS.iter().copied().filter(|format| *format != "h5").collect();
    for from in &formats {
        let folder = tempfile::tempdir().unwrap();
        let path = write_samples(folder.path(), from, (Vec3::zeros(), &[0.25, 0.7]), f32::is_finite);
        let a = CacheFrames::open(&path).unwrap();
        let between = [1001, 1002, 1003].map(|frame| [0.25, 0.7].map(|behind| (frame, behind))).concat();
        let found: Vec<(i64, f64)> = a.meshes[0].between.iter().map(|at| (at.frame, at.behind)).collect();
        assert_eq!(found.len(), between.len(), "{found:?}");
        let is_near = |((frame, behind), (expected, at)): (&(i64, f64), &(i64, f64))| {
            // Seconds of frame 1001 are good to 1e-14, and these are frames.
            frame == expected && (behind - at).abs() < 1e-11
        };
        assert!(found.iter().zip(&between).all(is_near), "{found:?}");
        for to in formats.iter().copied().chain(if formats.len() > 1 { Some("usdc") } else { None }) {
            let b = folder.path().join(format!("other.{to}"));
            assert_eq!(converted(&path, &b).left_out, [] as [String; 0]);
            let b = CacheFrames::open(&b).unwrap();
            assert_eq!(b.meshes[0].between.len(), 6, "{from} to {to}");
            assert_eq!(samples_of(&a), samples_of(&b), "{from} to {to}");
        }
        let b = folder.path().join("other.h5");
        let notes = converted(&path, &b).left_out;
        assert_eq!(notes.len(), 1);
        let expected =
            "/garments/skirt/skirtShape: 6 samples between frames are left out: the format holds whole frames";
        assert_eq!(notes[0], expected);
        assert_eq!(samples_of(&CacheFrames::open(&b).unwrap()), samples_of(&a)[..4]);
    }
}

#[test]
fn numbers_that_are_none_are_refused_by_frame_and_point() {
    for from in FORMATS {
        let folder = tempfile::tempdir().unwrap();
        // How far frame 1002 has moved.
        let path = write_samples(folder.path(), from, (Vec3::zeros(), &[]), |x| !(28.0..29.0).contains(&x.abs()));
        for to in FORMATS.iter().copied().chain(cfg!(feature = "usd").then_some("usdc")) {
            let to = folder.path().join(format!("other.{to}"));
            let conversion = Conversion { from: path.clone(), to: to.clone(), ..Conversion::default() };
            let error = convert(&conversion, &mut |_| {}).unwrap_err();
            assert_eq!(error.kind(), IoErrorKind::BadInput);
            let error = error.to_string();
            assert!(error.contains("frame 1002, point 0") && error.contains("not a finite number"), "{error}");
            assert!(!to.exists());
        }
    }
}
