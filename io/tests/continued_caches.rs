//! Caches of runs that stopped or were killed: cut back to a mark and continued they have the bytes of an unbroken run.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use drapery_alembic::{Archive, PodType, PolyMesh};
use drapery_core::Vec3;
use drapery_core::scene::Timeline;
use drapery_io::attributes::PointAttributes;
use drapery_io::cache::{CacheFrame, CacheMark, CachePlan, CacheWriter};
use drapery_io::cache_frames::CacheFrames;
use drapery_io::error::IoError;
use drapery_io::formats::{by_extension, folder_of, remove_folder};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::{DataType, MeshData, MeshParam, Scope};
use drapery_io::mesh_source::MeshSource;
use drapery_io::units::{LengthUnit, Units, UpAxis};

const FIRST: i64 = 1001;
const LAST: i64 = 1006;
const FORMATS: &[&str] = if cfg!(feature = "usd") { &["abc", "h5", "usd"] } else { &["abc", "h5"] };

/// A quad, a pentagon and a triangle with UVs and face sets.
const SOURCE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 3 0.5 0\nv 1.5 1.5 0\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
    usemtl front\nf 1/1 2/2 3/3 4/4\nf 2/1 5/2 6/3 8/1 3/4\nusemtl trim\nf 5/1 7/2 6/3\n";

struct Garment {
    folder: tempfile::TempDir,
    data: MeshData,
    mesh: GarmentMesh,
}

impl Garment {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("source.obj");
        fs::write(&path, SOURCE).unwrap();
        let mut mesh = MeshSource::open(&path, None, Units::SI).unwrap().mesh_at(0.0).unwrap();
        fs::remove_file(path).unwrap();
        mesh.object_path = "/garments/skirt/skirtShape".into();
        mesh.params.push(MeshParam {
            name: "panelId".into(),
            scope: Scope::Uniform,
            data_type: DataType::new(PodType::I32, 1),
            interpretation: String::new(),
            source_name: None,
            values: [7_i32, 8, 9].iter().flat_map(|v| v.to_le_bytes()).collect(),
            indices: None,
        });
        Self { folder, mesh: GarmentMesh::kept(mesh.clone()), data: mesh }
    }

    fn plan(&self) -> CachePlan<'_> {
        CachePlan {
            sub_frames: &[],
            garment: "skirt",
            mesh: &self.mesh,
            units: Units { length: LengthUnit::Centimetre, up: UpAxis::Z },
            origin: Vec3::zeros(),
            timeline: Timeline { fps_numerator: 24000, fps_denominator: 1001, ..Timeline::default() },
            first_frame: FIRST,
            last_frame: LAST,
            velocities: true,
            normals: false,
            crossings: true,
            attributes: Default::default(),
        }
    }

    fn path(&self, extension: &str) -> PathBuf {
        self.folder.path().join(format!("skirt.{extension}"))
    }

    fn create(&self, extension: &str) -> Box<dyn CacheWriter> {
        self.create_as(extension, &self.plan())
    }

    fn create_as(&self, extension: &str, plan: &CachePlan<'_>) -> Box<dyn CacheWriter> {
        let path = self.path(extension);
        self.remove(extension); // of an earlier case
        (by_extension(extension).unwrap().create.unwrap())(&path, plan).unwrap()
    }

    fn resume(&self, extension: &str, mark: &CacheMark) -> Box<dyn CacheWriter> {
        self.try_resume(extension, &self.plan(), mark).unwrap()
    }

    fn try_resume(
        &self,
        extension: &str,
        plan: &CachePlan<'_>,
        mark: &CacheMark,
    ) -> Result<Box<dyn CacheWriter>, IoError> {
        // Marks are kept in files.
        let kept: CacheMark = serde_json::from_str(&serde_json::to_string(mark).unwrap()).unwrap();
        let (format, path) = (by_extension(extension).unwrap(), self.path(extension));
        let checked = (format.check.unwrap())(&path, plan, &kept);
        let resumed = (format.resume.unwrap())(&path, plan, &kept);
        let in_words = |error: &IoError| error.to_string();
        assert_eq!(checked.as_ref().err().map(in_words), resumed.as_ref().err().map(in_words), "{extension}");
        resumed
    }

    /// The cloth of a frame. Frames 1003 and 1004 are equal, and 1005 is 1002 again; `take` is which shot it is.
    fn write(&self, writer: &mut dyn CacheWriter, frame: i64, take: i64) {
        let height = [1, 2, 3, 3, 2, 6, 7, 8, 9, 10, 11][(frame - FIRST) as usize] as f64 + 100.0 * take as f64;
        let positions: Vec<Vec3> = self.data.mesh.points.iter().map(|p| p + Vec3::z() * height).collect();
        let velocities = vec![Vec3::new(0.0, 0.5, height - 2.0); positions.len()];
        let crossings = Some(if frame == 1002 { 5 } else { take as u32 });
        let units = self.plan().units;
        let [positions, velocities] = [positions, velocities].map(|vectors| units.stored_all(&vectors));
        writer
            .write(&CacheFrame {
                frame,
                sub_frame: 0,
                positions: &positions,
                velocities: &velocities,
                normals: &[],
                crossings,
                values: Default::default(),
            })
            .unwrap();
    }

    fn write_all(&self, writer: &mut dyn CacheWriter, frames: impl Iterator<Item = i64>) {
        frames.for_each(|frame| self.write(writer, frame, 0));
    }

    /// Bytes of a cache that was written in one go up to a frame and finished; none when there is no file.
    fn unbroken(&self, extension: &str, plan: &CachePlan<'_>, last: i64) -> Option<Vec<u8>> {
        let mut writer = self.create_as(extension, plan);
        self.write_all(&mut *writer, FIRST..=last);
        writer.finish().unwrap();
        self.bytes(extension)
    }

    /// Bytes of the file, and of what is in the folder that belongs to it, with their names.
    fn bytes(&self, extension: &str) -> Option<Vec<u8>> {
        let mut bytes = fs::read(self.path(extension)).ok()?;
        let mut waiting: Vec<PathBuf> = folder_of(&self.path(extension)).into_iter().collect();
        while let Some(path) = waiting.pop() {
            bytes.extend(path.strip_prefix(self.folder.path()).unwrap().to_string_lossy().bytes());
            if path.is_dir() {
                let mut inside: Vec<PathBuf> =
                    fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()).collect();
                inside.sort();
                waiting.extend(inside);
            } else if path.exists() {
                bytes.extend(fs::read(path).unwrap());
            }
        }
        Some(bytes)
    }

    fn remove(&self, extension: &str) {
        let _ = fs::remove_file(self.path(extension));
        folder_of(&self.path(extension)).iter().for_each(|folder| remove_folder(folder).unwrap());
    }

    /// Returns the number of frames that a reader sees now.
    fn seen(&self, extension: &str) -> i64 {
        frames_seen(&self.path(extension))
    }
}

/// Number of complete frames in a cache, through a reader that opens it anew; 0 without a file.
fn frames_seen(path: &Path) -> i64 {
    if !path.exists() {
        return 0;
    }
    if path.extension().is_some_and(|extension| extension == "abc") {
        let mesh = PolyMesh::open(&Archive::open(path).unwrap(), "/garments/skirt/skirtShape").unwrap();
        let last = mesh.sample_count() - 1;
        assert_eq!(mesh.positions(last).unwrap().len(), 8);
        return mesh.sample_count() as i64;
    }
    if path.extension().is_some_and(|extension| extension == "usd") {
        let cache = CacheFrames::open(path).unwrap();
        assert_eq!(cache.positions(0, 0).unwrap().len(), 8);
        return cache.meshes[0].frames.len() as i64;
    }
    // A process opens a file in one manner, and the writer takes no locks.
    let file = hdf5::File::with_options().with_fapl(|access| access.file_locking(false)).open(path).unwrap();
    assert_eq!(file.dataset("positions").unwrap().shape()[1..], [8, 3]);
    let marks = file.dataset("committed").unwrap().read_raw::<u8>().unwrap();
    let complete = marks.iter().take_while(|mark| **mark == 1).count();
    assert!(marks[complete..].iter().all(|mark| *mark == 0), "{marks:?}");
    complete as i64
}

/// Leaves behind what a run killed in the middle of a write might: bytes of frames that are not complete.
fn tear(path: &Path, complete: i64) {
    if !path.exists() {
        return;
    }
    if let Some(folder) = folder_of(path) {
        let clips = fs::read_dir(folder).unwrap().next().unwrap().unwrap().path();
        fs::write(clips.join("1006.usdc.part"), b"half a clip").unwrap();
        return;
    }
    let mut places = Vec::new();
    if path.extension().is_some_and(|extension| extension == "h5") {
        let file = hdf5::File::open(path).unwrap();
        for (name, size) in [("positions", 96), ("velocities", 96), ("crossings", 4)] {
            let frames = file.dataset("committed").unwrap().size() as u64;
            let start = file.dataset(name).unwrap().offset().unwrap();
            places.extend((complete as u64..frames).map(|frame| start + frame * size));
        }
    } else {
        places.push(fs::metadata(path).unwrap().len() + 40);
    }
    let mut file = OpenOptions::new().write(true).open(path).unwrap();
    for place in places {
        file.seek(SeekFrom::Start(place)).unwrap();
        file.write_all(&[0x55; 4]).unwrap();
    }
}

/// A run that was killed `later` frames after it took its mark at `kept` frames.
fn killed(garment: &Garment, extension: &str, kept: i64, later: i64, take: i64) -> CacheMark {
    let mut writer = garment.create(extension);
    garment.write_all(&mut *writer, FIRST..FIRST + kept);
    writer.sync().unwrap();
    let mark = writer.mark();
    assert_eq!(mark.last_frame, (kept > 0).then_some(FIRST + kept - 1));
    for frame in FIRST + kept..(FIRST + kept + later).min(LAST + 1) {
        garment.write(&mut *writer, frame, take);
    }
    drop(writer);
    tear(&garment.path(extension), (kept + later).min(LAST + 1 - FIRST));
    mark
}

#[test]
fn a_continued_cache_has_the_bytes_of_one_without_a_break() {
    let garment = Garment::new();
    for extension in FORMATS {
        let whole = garment.unbroken(extension, &garment.plan(), LAST);
        for kept in 0..=LAST + 1 - FIRST {
            for (later, take) in [(0, 0), (2, 0), (1, 7), (6, 7)] {
                let mark = killed(&garment, extension, kept, later, take);
                let mut writer = garment.resume(extension, &mark);
                assert_eq!(garment.seen(extension), kept);
                assert_eq!(writer.mark().last_frame, mark.last_frame);
                for frame in FIRST + kept..=LAST {
                    garment.write(&mut *writer, frame, 0);
                    assert_eq!(garment.seen(extension), frame + 1 - FIRST);
                }
                writer.finish().unwrap();
                assert!(garment.bytes(extension) == whole, "{extension}: {kept} kept, {later} of take {take} behind");
            }
        }
        let files = 1 + usize::from(folder_of(&garment.path(extension)).is_some());
        assert_eq!(fs::read_dir(garment.folder.path()).unwrap().count(), files, "no other file is left");
        garment.remove(extension);
    }
}

#[test]
fn a_cache_that_is_cut_back_and_stops_again_looks_as_if_it_never_had_more() {
    let garment = Garment::new();
    for extension in FORMATS {
        for kept in 0..=LAST + 1 - FIRST {
            let short = garment.unbroken(extension, &garment.plan(), FIRST + kept - 1);
            let mark = killed(&garment, extension, kept, 3, 7);
            let mut writer = garment.resume(extension, &mark);
            writer.sync().unwrap();
            writer.finish().unwrap();
            assert!(garment.bytes(extension) == short, "{extension}: {kept} kept");
        }
    }
}

#[test]
fn caches_without_velocities_crossings_and_uvs_continue_too() {
    let mut garment = Garment::new();
    garment.data.uvs = None;
    garment.data.params.clear();
    garment.mesh = GarmentMesh::kept(garment.data.clone());
    for extension in FORMATS {
        for (velocities, crossings) in [(false, false), (true, false), (false, true)] {
            let plan = CachePlan { velocities, crossings, ..garment.plan() };
            let whole = garment.unbroken(extension, &plan, LAST);
            let mut writer = garment.create_as(extension, &plan);
            garment.write_all(&mut *writer, 1001..=1002);
            let mark = writer.mark();
            garment.write(&mut *writer, 1003, 7);
            drop(writer);
            let mut writer = garment.try_resume(extension, &plan, &mark).unwrap();
            garment.write_all(&mut *writer, 1003..=LAST);
            writer.finish().unwrap();
            assert!(garment.bytes(extension) == whole, "{extension}: {velocities} {crossings}");
        }
    }
}

#[test]
fn a_run_that_is_killed_while_it_continues_can_continue_again() {
    let garment = Garment::new();
    for extension in FORMATS {
        let whole = garment.unbroken(extension, &garment.plan(), LAST);
        let first = killed(&garment, extension, 2, 3, 7);
        let mut writer = garment.resume(extension, &first);
        garment.write(&mut *writer, 1003, 0);
        let second = writer.mark();
        garment.write(&mut *writer, 1004, 7);
        drop(writer);
        // From the later mark, then from the earlier one once more, then to the end.
        let mut writer = garment.resume(extension, &second);
        garment.write(&mut *writer, 1004, 7);
        drop(writer);
        drop(garment.resume(extension, &first));
        tear(&garment.path(extension), 2);
        let mut writer = garment.resume(extension, &first);
        garment.write_all(&mut *writer, 1003..=LAST);
        assert_eq!(garment.seen(extension), 6);
        writer.finish().unwrap();
        assert!(garment.bytes(extension) == whole, "{extension}");
        // Nothing is left to do: nothing changes.
        let done = writer.mark();
        garment.resume(extension, &done).finish().unwrap();
        assert!(garment.bytes(extension) == whole, "{extension}");
    }
}

#[test]
fn a_finished_range_is_extended_to_the_bytes_of_the_longer_run() {
    let garment = Garment::new();
    let longer = CachePlan { last_frame: LAST + 3, ..garment.plan() };
    for extension in FORMATS {
        let whole = garment.unbroken(extension, &longer, LAST + 3);
        for kept in [0, 4, 6] {
            let mark = killed(&garment, extension, kept, 6, 0);
            let mut writer = garment.try_resume(extension, &longer, &mark).unwrap();
            assert_eq!(garment.seen(extension), kept);
            garment.write_all(&mut *writer, FIRST + kept..=LAST + 3);
            writer.finish().unwrap();
            assert!(garment.bytes(extension) == whole, "{extension}: {kept} kept");
        }
        // A mark from before the extension still holds after it.
        let mark = killed(&garment, extension, 3, 0, 0);
        drop(garment.try_resume(extension, &longer, &mark).unwrap());
        let mut writer = garment.try_resume(extension, &longer, &mark).unwrap();
        garment.write_all(&mut *writer, FIRST + 3..=LAST + 3);
        writer.finish().unwrap();
        assert!(garment.bytes(extension) == whole, "{extension}: extended twice");
    }
}

#[test]
fn a_range_is_shortened_only_to_frames_that_the_cache_does_not_hold() {
    let garment = Garment::new();
    let shorter = CachePlan { last_frame: LAST - 2, ..garment.plan() };
    for extension in FORMATS {
        let whole = garment.unbroken(extension, &shorter, LAST - 2);
        let mark = killed(&garment, extension, 2, 1, 0);
        let mut writer = garment.try_resume(extension, &shorter, &mark).unwrap();
        garment.write_all(&mut *writer, FIRST + 2..=LAST - 2);
        writer.finish().unwrap();
        assert!(garment.bytes(extension) == whole, "{extension}");

        for kept in [2, 6] {
            let mark = killed(&garment, extension, kept, 3, 0);
            let before = garment.bytes(extension);
            let error = garment.try_resume(extension, &shorter, &mark).map(|_| ()).unwrap_err().to_string();
            let held = if kept == 2 { 1005 } else { 1006 };
            assert!(error.contains(&format!("holds frame {held}")) && error.contains("frame 1004"), "{error}");
            assert!(garment.bytes(extension) == before, "{extension}: the file was changed");
        }
    }
}

/// Resumes and expects a refusal that names the file, says `expected` and what to do, and leaves the file as it is.
fn expect_refusal(garment: &Garment, extension: &str, plan: &CachePlan<'_>, mark: &CacheMark, expected: &str) {
    let before = garment.bytes(extension);
    let error = garment.try_resume(extension, plan, mark).map(|_| ()).expect_err(expected).to_string();
    // No checkpoint brings back the frames of a file that is gone.
    let way = if before.is_some() { "--resume FRAME" } else { "put the file back" };
    for text in [expected, &format!("skirt.{extension}"), way, "--overwrite"] {
        assert!(error.contains(text), "{extension}: {text} is not in: {error}");
    }
    assert!(garment.bytes(extension) == before, "{extension}, {expected}: the file was changed");
    let files = fs::read_dir(garment.folder.path()).unwrap().count();
    let own =
        usize::from(before.is_some()) + usize::from(folder_of(&garment.path(extension)).is_some_and(|it| it.exists()));
    assert_eq!(files, own, "{extension}, {expected}: another file appeared");
}

#[test]
fn a_cache_that_is_missing_damaged_or_another_one_is_refused_and_left_alone() {
    let garment = Garment::new();
    let plan = garment.plan();
    for extension in ["abc", "h5"] {
        let path = garment.path(extension);
        let refused = |mark: &CacheMark, expected: &str| expect_refusal(&garment, extension, &plan, mark, expected);
        let mark = killed(&garment, extension, 3, 2, 0);
        let good = garment.bytes(extension).unwrap();
        fs::write(&path, &good[..mark.bytes as usize - 60]).unwrap();
        refused(&mark, "");
        fs::write(&path, b"").unwrap();
        refused(&mark, "");
        let mut flipped = good.clone();
        flipped[3] ^= 0x10;
        fs::write(&path, &flipped).unwrap();
        refused(&mark, "");
        fs::write(&path, &good).unwrap();
        refused(&CacheMark { digest: "7".repeat(32), ..mark.clone() }, "differs");
        refused(&CacheMark { digest: "none".into(), ..mark.clone() }, "");
        refused(&CacheMark { last_frame: Some(1005), ..mark.clone() }, "");
        refused(&CacheMark { last_frame: Some(1000), ..mark.clone() }, "begins at 1001");
        refused(&CacheMark { last_frame: Some(i64::MIN), ..mark.clone() }, "begins at 1001");
        refused(&CacheMark { file: "coat.abc".into(), ..mark.clone() }, "coat.abc");
        // The last frame of the mark was changed behind the program's back.
        let places: Vec<usize> = (0..good.len() - 4).filter(|&i| good[i..i + 4] == 300_f32.to_le_bytes()).collect();
        let mut flipped = good.clone();
        places.iter().for_each(|&place| flipped[place] ^= 1);
        fs::write(&path, &flipped).unwrap();
        refused(&mark, "was written");
        // Another run with the same plan.
        let other = killed(&garment, extension, 0, 4, 7);
        assert_eq!(other.last_frame, None);
        refused(&mark, "");
        fs::remove_file(&path).unwrap();
        refused(&mark, "missing");
    }
}

#[cfg(feature = "usd")]
#[test]
fn a_usd_cache_whose_files_are_missing_or_changed_is_refused_and_left_alone() {
    let garment = Garment::new();
    let plan = garment.plan();
    let mark = killed(&garment, "usd", 3, 2, 0);
    let refused = |mark: &CacheMark, expected: &str| expect_refusal(&garment, "usd", &plan, mark, expected);
    let clips = folder_of(&garment.path("usd")).unwrap();
    let clips = fs::read_dir(clips).unwrap().next().unwrap().unwrap().path();
    let cases = [
        ("1002.usdc", None, "the clip of frame 1002 is missing"),
        ("1003.usdc", None, "the clip of this frame is missing"),
        ("1003.usdc", Some(40), "differs from the one that was written"),
        ("topology.usdc", Some(60), "no longer the one that was written"),
        ("topology.usdc", None, "started with different settings"),
    ];
    for (name, flipped, expected) in cases {
        let path = clips.join(name);
        let good = fs::read(&path).unwrap();
        match flipped {
            None => fs::remove_file(&path).unwrap(),
            Some(place) => {
                let mut bad = good.clone();
                bad[place] ^= 1;
                fs::write(&path, bad).unwrap();
            }
        }
        refused(&mark, expected);
        fs::write(&path, good).unwrap();
    }
    refused(&CacheMark { digest: "7".repeat(32), ..mark.clone() }, "differs from the one that was written");
    refused(&CacheMark { last_frame: Some(1000), ..mark.clone() }, "begins at 1001");
    refused(&CacheMark { file: "coat.usd".into(), ..mark.clone() }, "coat.usd");
    fs::remove_file(garment.path("usd")).unwrap();
    refused(&mark, "missing");
}

#[test]
fn a_cache_of_another_plan_is_refused_and_left_alone() {
    let garment = Garment::new();
    let plan = garment.plan();
    let moved = MeshData { object_path: "/garments/coat/coatShape".into(), ..garment.data.clone() };
    let mut more_points = garment.data.clone();
    more_points.mesh.points.push(Vec3::zeros());
    let no_params = MeshData { params: Vec::new(), ..garment.data.clone() };
    let no_sets = MeshData { face_sets: Vec::new(), ..garment.data.clone() };
    let mut turned = garment.data.clone();
    turned.mesh.face_indices.swap(0, 1);
    let no_uvs = MeshData { uvs: None, ..garment.data.clone() };
    let mut other_uvs = garment.data.clone();
    other_uvs.uvs.as_mut().unwrap().values[1] = [0.5, 0.5];
    // The other diagonal of the quad is the shorter one then.
    let mut cut_otherwise = garment.data.clone();
    cut_otherwise.mesh.points[0].x -= 0.1;
    assert_ne!(cut_otherwise.mesh.triangulate(), garment.data.mesh.triangulate());
    let [moved, more_points, no_params, no_sets, turned, no_uvs, other_uvs, cut_otherwise] =
        [moved, more_points, no_params, no_sets, turned, no_uvs, other_uvs, cut_otherwise].map(GarmentMesh::kept);
    let rest = vec![[0.0; 3]; garment.data.mesh.points.len()].into();
    let plans = [
        CachePlan { garment: "coat", ..plan.clone() },
        CachePlan { units: Units::SI, ..plan.clone() },
        CachePlan { origin: Vec3::x(), ..plan.clone() },
        CachePlan { timeline: Timeline::default(), ..plan.clone() },
        CachePlan { first_frame: 1000, ..plan.clone() },
        CachePlan { velocities: false, ..plan.clone() },
        CachePlan { crossings: false, ..plan.clone() },
        CachePlan { attributes: PointAttributes { strain: true, ..PointAttributes::default() }, ..plan.clone() },
        CachePlan { attributes: PointAttributes { rest: Some(rest), ..PointAttributes::default() }, ..plan.clone() },
        CachePlan { mesh: &cut_otherwise, ..plan.clone() },
        CachePlan { mesh: &moved, ..plan.clone() },
        CachePlan { mesh: &more_points, ..plan.clone() },
        CachePlan { mesh: &turned, ..plan.clone() },
        CachePlan { mesh: &no_uvs, ..plan.clone() },
        CachePlan { mesh: &other_uvs, ..plan.clone() },
    ];
    for extension in FORMATS {
        let mark = killed(&garment, extension, 3, 1, 0);
        plans.iter().for_each(|plan| expect_refusal(&garment, extension, plan, &mark, ""));
        if *extension != "h5" {
            // HDF5 caches hold neither of them.
            expect_refusal(&garment, extension, &CachePlan { mesh: &no_params, ..plan.clone() }, &mark, "");
            expect_refusal(&garment, extension, &CachePlan { mesh: &no_sets, ..plan.clone() }, &mark, "");
        }
        assert!(garment.try_resume(extension, &plan, &mark).is_ok());
        garment.remove(extension);
    }
}

#[test]
fn a_program_that_has_a_cache_open_keeps_its_frames_while_the_run_goes_on_from_an_earlier_one() {
    for extension in FORMATS {
        let garment = Garment::new();
        let mut writer = garment.create(extension);
        garment.write_all(&mut *writer, 1001..=1003);
        let mark = writer.mark();
        garment.write_all(&mut *writer, 1004..=1006);
        drop(writer);
        let before = fs::read(garment.path(extension)).unwrap();
        let mut held = File::open(garment.path(extension)).unwrap();
        let mut writer = garment.resume(extension, &mark);
        (1004..=1005).for_each(|frame| garment.write(&mut *writer, frame, 1));
        writer.finish().unwrap();
        let mut seen = Vec::new();
        held.read_to_end(&mut seen).unwrap();
        assert!(seen == before, "{extension}");
        assert_eq!(garment.seen(extension), 5);
    }
}

#[test]
fn readers_never_meet_an_invalid_cache() {
    for extension in FORMATS {
        let garment = Garment::new();
        let path = garment.path(extension);
        let done = AtomicBool::new(false);
        let longer = CachePlan { last_frame: LAST + 3, ..garment.plan() };
        std::thread::scope(|scope| {
            let reader = scope.spawn(|| {
                let mut most = 0;
                while !done.load(Ordering::Relaxed) {
                    most = most.max(frames_seen(&path));
                }
                most
            });
            let mut writer = garment.create(extension);
            garment.write_all(&mut *writer, 1001..=1003);
            let mark = writer.mark();
            garment.write_all(&mut *writer, 1004..=1006);
            for round in 0..30 {
                let plan = if round % 2 == 0 { &longer } else { &garment.plan() };
                let mut writer = garment.try_resume(extension, plan, &mark).unwrap();
                garment.write_all(&mut *writer, 1004..=1005);
                let mut writer = garment.try_resume(extension, plan, &mark).unwrap();
                garment.write_all(&mut *writer, 1004..=1006);
                writer.finish().unwrap();
            }
            done.store(true, Ordering::Relaxed);
            assert!(reader.join().expect("the reader never failed") >= 3, "{extension}");
        });
    }
}
