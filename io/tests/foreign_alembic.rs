//! Alembic files of other programs as caches: frames follow from their times and a rate, and transforms that move are samples.

use std::fs;
use std::path::{Path, PathBuf};

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Durability, IDENTITY, MetaData, PolyMeshSample, PolyMeshWriter, TimeSampling,
    Topology, XformWriter,
};
use drapery_core::Vec3;
use drapery_io::cache_frames::CacheFrames;
use drapery_io::convert::{Conversion, Converted, convert};
use drapery_io::error::{IoError, IoErrorKind};
use drapery_io::mesh_source::MeshSource;
use drapery_io::units::{LengthUnit, Units, UpAxis};

const FORMATS: &[&str] = if cfg!(feature = "usd") { &["abc", "h5", "usd", "usdc"] } else { &["abc", "h5"] };

/// A triangle that rises by 1 a frame of 24 from one frame to another, one sample every `step` frames; under a parent that goes along
/// x by 10 a frame, if `moved`, and says so at these frames. `rate` is how the file tells its rate, if it does.
struct Foreign<'a> {
    frames: [f64; 2],
    step: f64,
    moved: Option<[f64; 2]>,
    rate: Option<(&'a str, &'a str)>,
}

impl Foreign<'_> {
    fn write(&self, path: &Path) -> PathBuf {
        let extra = self.rate.map_or(MetaData::new(), |(key, value)| MetaData::new().with(key, value));
        let options = ArchiveOptions { extra, ..ArchiveOptions::default() };
        let mut archive = ArchiveWriter::create(path, &options).unwrap();
        let root = archive.root();
        let parent = match self.moved {
            None => XformWriter::still(&mut archive, root, "set", None).unwrap(),
            Some([first, last]) => {
                let sampling = archive.add_time_sampling(TimeSampling::frames(first, 24.0).unwrap()).unwrap();
                let parent = XformWriter::declare(&mut archive, root, "set", sampling).unwrap();
                for frame in 0..=(last - first) as usize {
                    let mut matrix = IDENTITY;
                    matrix[12] = 10.0 * (first + frame as f64);
                    parent.write(&mut archive, &matrix).unwrap();
                }
                parent
            }
        };
        let [first, last] = self.frames;
        let times = TimeSampling::uniform(first / 24.0, self.step / 24.0).unwrap();
        let sampling = archive.add_time_sampling(times).unwrap();
        let mut mesh = PolyMeshWriter::declare(&mut archive, parent.object(), "cloth", sampling).unwrap();
        for sample in 0..=((last - first) / self.step).round() as usize {
            let y = (first + sample as f64 * self.step) as f32;
            let points = [[0.0, y, 0.0], [1.0, y, 0.0], [0.0, y, 1.0]];
            let topology = Some(Topology { face_counts: &[3], face_indices: &[0, 1, 2] });
            mesh.write(&mut archive, &PolyMeshSample { topology, ..PolyMeshSample::of(&points) }).unwrap();
        }
        archive.finish(Durability::Flushed).unwrap();
        path.to_owned()
    }
}

const BLENDER: Option<(&str, &str)> = Some(("FramesPerTimeUnit", "24.000000"));

fn converted(from: &Path, to: &Path, fps: Option<(u32, u32)>) -> Result<Converted, IoError> {
    convert(&Conversion { from: from.to_owned(), to: to.to_owned(), fps, ..Conversion::default() }, &mut |_| {})
}

/// Frame or sample between frames, and the first point there.
fn places(path: &Path) -> Vec<(f64, [f64; 3])> {
    let cache = CacheFrames::open(path).unwrap();
    let mesh = &cache.meshes[0];
    let between = mesh.between.iter().map(|at| at.frame as f64 + at.behind);
    let frames = mesh.frames.iter().map(|frame| *frame as f64).chain(between);
    let mut all: Vec<_> = frames.enumerate().map(|(k, at)| (at, cache.positions(0, k).unwrap()[0].into())).collect();
    all.sort_by(|a: &(f64, [f64; 3]), b| a.0.total_cmp(&b.0));
    all
}

#[test]
fn frames_are_those_of_the_times_from_any_source_of_the_rate() {
    let cases =
        [(BLENDER, None), (None, Some((24, 1))), (Some(("_ai_DCC_FPS", "24")), None), (BLENDER, Some((24_000, 1000)))];
    for (rate, fps) in cases {
        for to in FORMATS {
            let folder = tempfile::tempdir().unwrap();
            let file = Foreign { frames: [1001.0, 1005.0], step: 1.0, moved: None, rate };
            let from = file.write(&folder.path().join("from.abc"));
            let to = folder.path().join(format!("to.{to}"));
            assert_eq!(converted(&from, &to, fps).unwrap().frames, [1001, 1005]);
            let expected: Vec<_> = (1001..=1005).map(f64::from).map(|frame| (frame, [0.0, frame, 0.0])).collect();
            assert_eq!(places(&to), expected, "{rate:?} {fps:?}");
        }
    }
}

#[test]
fn the_unit_of_a_file_that_does_not_say_it_is_doubted_by_the_size_and_can_be_said() {
    let folder = tempfile::tempdir().unwrap();
    let from = folder.path().join("man.abc");
    // A man of 169 units with Z up, and nothing that says which units.
    let extra = MetaData::new().with("FramesPerTimeUnit", "24.000000");
    let mut archive = ArchiveWriter::create(&from, &ArchiveOptions { extra, ..ArchiveOptions::default() }).unwrap();
    let root = archive.root();
    let parent = XformWriter::still(&mut archive, root, "man", None).unwrap();
    let sampling = archive.add_time_sampling(TimeSampling::uniform(1.0 / 24.0, 1.0 / 24.0).unwrap()).unwrap();
    let mut mesh = PolyMeshWriter::declare(&mut archive, parent.object(), "skin", sampling).unwrap();
    let points = [[0.0, 0.0, 0.0], [40.0, 0.0, 0.0], [0.0, 20.0, 169.0]];
    let topology = Some(Topology { face_counts: &[3], face_indices: &[0, 1, 2] });
    mesh.write(&mut archive, &PolyMeshSample { topology, ..PolyMeshSample::of(&points) }).unwrap();
    archive.finish(Durability::Flushed).unwrap();
    for extension in FORMATS {
        let to = |name: &str| folder.path().join(format!("{name}.{extension}"));
        let asked = |name: &str| Conversion { from: from.clone(), to: to(name), ..Conversion::default() };
        let done = convert(&asked("plain"), &mut |_| {}).unwrap();
        let [unsaid, giant] = &done.doubts[..] else { panic!("{:?}", done.doubts) };
        assert!(unsaid.contains("states no unit and is read in metres; --from-length"), "{unsaid}");
        let words =
            "it is 169.000 m across when read as metres: looks like centimetres; if it is, set --from-length cm";
        assert!(giant.contains(words), "{giant}");
        // The same numbers, in another unit and with another axis.
        let said = Conversion { from_length: Some(LengthUnit::Centimetre), from_up: Some(UpAxis::Z), ..asked("said") };
        let done = convert(&said, &mut |_| {}).unwrap();
        assert_eq!((done.doubts, done.units), (vec![], Units { length: LengthUnit::Centimetre, up: UpAxis::Z }));
        let place = CacheFrames::open(&to("said")).unwrap().positions(0, 0).unwrap()[2];
        assert!((place - Vec3::new(0.0, 1.69, -0.2)).norm() < 1e-12, "{place}");
        // Other numbers, of the same man.
        let metres = Conversion { to: to("metres"), length: Some(LengthUnit::Metre), up: Some(UpAxis::Y), ..said };
        assert_eq!(convert(&metres, &mut |_| {}).unwrap().units, Units::SI);
        let stored = CacheFrames::open(&to("metres")).unwrap().stored_positions(0, 0).unwrap().unwrap();
        assert_eq!(stored.points[2], [0.0, 1.69, -0.2]);
        // What a cache of this program says of itself is overruled, too, and is doubted by its size alone.
        let again = Conversion { from: to("said"), from_length: Some(LengthUnit::Millimetre), ..asked("again") };
        let done = convert(&again, &mut |_| {}).unwrap();
        assert_eq!(done.units, Units { length: LengthUnit::Millimetre, up: UpAxis::Z });
        assert!(done.doubts.len() == 1 && done.doubts[0].contains("it is 0.169 m"), "{:?}", done.doubts);
    }
}

#[test]
fn samples_between_frames_stay_between_frames_and_what_is_behind_the_last_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let file = Foreign { frames: [1001.0, 1004.5], step: 0.5, moved: None, rate: BLENDER };
    let from = file.write(&folder.path().join("from.abc"));
    for to in FORMATS.iter().filter(|format| **format != "h5") {
        let to = folder.path().join(format!("to.{to}"));
        let done = converted(&from, &to, None).unwrap();
        assert_eq!(done.frames, [1001, 1004]);
        let expected = "/set/cloth: 1 samples before the first frame or after the last are left out";
        assert!(done.left_out.len() == 1 && done.left_out[0].starts_with(expected), "{:?}", done.left_out);
        let expected: Vec<_> =
            (0..=6).map(|half| 1001.0 + f64::from(half) / 2.0).map(|at| (at, [0.0, at, 0.0])).collect();
        assert_eq!(places(&to), expected);
    }
    // At a rate at which no sample is a frame there is nothing to write, and nothing is.
    let to = folder.path().join("none.abc");
    let file = Foreign { frames: [1001.25, 1003.25], step: 1.0, moved: None, rate: BLENDER };
    let odd = file.write(&folder.path().join("odd.abc"));
    let error = converted(&odd, &to, None).unwrap_err();
    assert_eq!(error.kind(), IoErrorKind::BadInput);
    let error = error.to_string();
    assert!(
        error.contains("/set/cloth") && error.contains("none of its 3 samples") && error.contains("--fps"),
        "{error}"
    );
    // Nor where nobody says the rate, whatever frames are asked for.
    let file = Foreign { frames: [1001.0, 1005.0], step: 1.0, moved: None, rate: None };
    let unknown = file.write(&folder.path().join("unknown.abc"));
    let asked = Conversion { from: unknown, to: to.clone(), frames: Some([1001, 1003]), ..Conversion::default() };
    let error = convert(&asked, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("does not state it") && error.contains("--fps"), "{error}");
    assert!(!to.exists());
}

#[test]
fn transforms_that_move_are_samples_of_the_mesh_below_them() {
    let still = Foreign { frames: [0.0, 0.0], step: 1.0, moved: Some([1001.0, 1004.0]), rate: BLENDER };
    // Samples of points every two frames, of the parent in every frame: points are linear between theirs.
    let both = Foreign { frames: [1001.0, 1005.0], step: 2.0, moved: Some([1001.0, 1005.0]), rate: BLENDER };
    for (file, last, rises) in [(still, 1004, 0.0), (both, 1005, 1.0)] {
        for to in FORMATS {
            let folder = tempfile::tempdir().unwrap();
            let from = file.write(&folder.path().join("from.abc"));
            let to = folder.path().join(format!("to.{to}"));
            assert_eq!(converted(&from, &to, None).unwrap().frames, [1001, last]);
            let at = |frame: i64| frame as f64;
            let expected: Vec<_> =
                (1001..=last).map(|frame| (at(frame), [10.0 * at(frame), rises * at(frame), 0.0])).collect();
            assert_eq!(places(&to), expected, "{}", to.display());
            assert_eq!(places(&from), expected, "the source");
        }
    }
}

#[test]
fn a_rate_that_would_move_frames_of_a_cache_in_time_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = Foreign { frames: [1.0, 3.0], step: 1.0, moved: None, rate: BLENDER };
    let from = file.write(&folder.path().join("from.abc"));
    for format in FORMATS {
        let cache = folder.path().join(format!("cache.{format}"));
        converted(&from, &cache, None).unwrap();
        let to = folder.path().join("out.abc");
        let error = converted(&cache, &to, Some((25, 1))).unwrap_err().to_string();
        assert!(error.contains("at 24 fps, not at 25") && !to.exists(), "{error}");
        converted(&cache, &to, Some((24, 1))).unwrap();
        fs::remove_file(to).unwrap();
    }
}

#[test]
fn faces_under_a_mirror_are_those_that_the_solver_reads() {
    let folder = tempfile::tempdir().unwrap();
    for mirror in [1.0, -1.0] {
        let path = folder.path().join("mirrored.abc");
        let mut archive = ArchiveWriter::create(&path, &ArchiveOptions::default()).unwrap();
        let root = archive.root();
        let mut matrix = IDENTITY;
        matrix[0] = mirror;
        let parent = XformWriter::still(&mut archive, root, "set", Some(&matrix)).unwrap();
        let mut mesh = PolyMeshWriter::declare(&mut archive, parent.object(), "cloth", 0).unwrap();
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [2.0, 0.0, 0.5]];
        let topology = Some(Topology { face_counts: &[4, 3], face_indices: &[0, 1, 2, 3, 1, 4, 2] });
        mesh.write(&mut archive, &PolyMeshSample { topology, ..PolyMeshSample::of(&points) }).unwrap();
        archive.finish(Durability::Flushed).unwrap();
        let cache = CacheFrames::open(&path).unwrap();
        let found = &cache.meshes[0];
        let read = MeshSource::open(&path, None, Units::SI).unwrap().mesh_at(0.0).unwrap().mesh;
        assert_eq!(found.faces.face_indices, read.face_indices, "{mirror}");
        // The faces are stored clockwise as seen from above, and so the mesh faces up, whatever the parent does.
        let points = cache.positions(0, 0).unwrap();
        let at = |v: u32| points[v as usize];
        let up = |&[a, b, c]: &[u32; 3]| (at(b) - at(a)).cross(&(at(c) - at(a))).y;
        assert!(found.triangles.len() == 3 && found.triangles.iter().all(|t| up(t) > 0.0), "{mirror}");
    }
}

#[test]
fn samples_of_which_none_is_at_a_whole_frame_keep_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let file = Foreign { frames: [1001.5, 1003.5], step: 1.0, moved: None, rate: BLENDER };
    let path = file.write(&folder.path().join("halves.abc"));
    let mesh = &CacheFrames::open(&path).unwrap().meshes[0];
    assert_eq!((mesh.frames.len(), mesh.points), (0, 3));
    let expected: Vec<_> = [1001.5, 1002.5, 1003.5].map(|at| (at, [0.0, at, 0.0])).into();
    assert_eq!(places(&path), expected);
}

#[test]
fn a_mesh_without_samples_is_refused_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let from = folder.path().join("empty.abc");
    let mut archive = ArchiveWriter::create(&from, &ArchiveOptions::default()).unwrap();
    let root = archive.root();
    PolyMeshWriter::declare(&mut archive, root, "cloth", 0).unwrap();
    archive.finish(Durability::Flushed).unwrap();
    for to in FORMATS {
        let to = folder.path().join(format!("to.{to}"));
        let error = converted(&from, &to, Some((24, 1))).unwrap_err();
        assert_eq!(error.kind(), IoErrorKind::BadInput, "{error}");
        assert!(error.to_string().contains("empty.abc") && !to.exists(), "{error}");
    }
}
