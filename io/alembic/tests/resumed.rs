//! Archives that go back to an earlier commit: same bytes later, valid all the time, untouched when refused.

use std::path::{Path, PathBuf};

use drapery_alembic::*;

const PATH: &str = "/cloth/clothShape";

fn options() -> ArchiveOptions {
    ArchiveOptions { application: "test".into(), frames_per_second: Some(24.0), ..ArchiveOptions::default() }
}

/// Heights of the three vertices. Some frames equal their neighbour, some an earlier frame; 100 and more are frames of
/// another shot.
fn positions(frame: usize) -> [[f32; 3]; 3] {
    let height = [0.0, 1.0, 1.0, 2.0, 1.0, 0.0, 5.0, 5.0].get(frame).map_or(frame as f32, |height| *height);
    [[0.0, height, 0.0], [1.0, height, 0.0], [0.0, height, 1.0]]
}

struct Shot {
    mesh: PolyMeshWriter,
    frame: PropertyId,
}

fn declare(archive: &mut ArchiveWriter) -> Result<Shot, AlembicError> {
    let sampling = archive.add_time_sampling(TimeSampling::frames(1001.0, 24.0)?)?;
    let root = archive.root();
    let xform = XformWriter::still(archive, root, "cloth", None)?;
    let mesh = PolyMeshWriter::declare(archive, xform.object(), "clothShape", sampling)?;
    let user = mesh.user_properties(archive)?;
    archive.write_static_string(user, "solver", "Drapery")?;
    let frame =
        archive.add_scalar_property(user, "frame", &MetaData::new(), DataType::new(PodType::U32, 1), sampling)?;
    Ok(Shot { mesh, frame })
}

impl Shot {
    fn write(&mut self, archive: &mut ArchiveWriter, frame: usize) {
        let positions = positions(frame);
        let topology = Topology { face_counts: &[3], face_indices: &[0, 1, 2] };
        let sample = PolyMeshSample { topology: (frame == 0).then_some(topology), ..PolyMeshSample::of(&positions) };
        self.mesh.write(archive, &sample).unwrap();
        archive.write_sample(self.frame, &[frame as u32]).unwrap();
        archive.commit(Durability::Flushed).unwrap();
    }
}

/// A file with these frames that was never finished, and the mark after each frame.
fn written(path: &Path, frames: &[usize]) -> Vec<ArchiveMark> {
    let mut archive = ArchiveWriter::create(path, &options()).unwrap();
    let mut shot = declare(&mut archive).unwrap();
    let write = |&frame: &usize| {
        shot.write(&mut archive, frame);
        archive.mark().unwrap()
    };
    frames.iter().map(write).collect()
}

fn finished(path: &Path, frames: &[usize]) {
    let mut archive = ArchiveWriter::create(path, &options()).unwrap();
    let mut shot = declare(&mut archive).unwrap();
    frames.iter().for_each(|frame| shot.write(&mut archive, *frame));
    archive.finish(Durability::Flushed).unwrap();
}

fn resumed(path: &Path, mark: &ArchiveMark) -> Result<(ArchiveWriter, Shot), AlembicError> {
    ArchiveWriter::resume(path, &options(), mark, declare)
}

fn sample_count(path: &Path) -> usize {
    PolyMesh::open(&Archive::open(path).unwrap(), PATH).unwrap().sample_count()
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

fn scratch() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole.abc", "parts.abc"].map(|name| folder.path().join(name));
    (folder, whole, parts)
}

#[test]
fn whatever_stood_behind_the_mark_the_bytes_are_those_of_an_unbroken_run() {
    let (_folder, whole, parts) = scratch();
    finished(&whole, &[0, 1, 2, 3, 4, 5, 6, 7]);
    for kept in 1..=8 {
        for later in [[].as_slice(), &[100], &[100, 101, 102, 103, 104, 105, 106, 107, 108, 109]] {
            let before: Vec<usize> = (0..kept).chain(later.iter().copied()).collect();
            let marks = written(&parts, &before);
            let mark = marks[kept - 1];
            let mut torn = bytes(&parts);
            let end = marks.last().unwrap().end as usize;
            torn[end..end + 333].fill(0x55);
            std::fs::write(&parts, torn).unwrap();
            let (mut archive, mut shot) = resumed(&parts, &mark).unwrap();
            assert_eq!((archive.mark(), sample_count(&parts)), (Some(mark), kept));
            for frame in kept..8 {
                shot.write(&mut archive, frame);
                assert_eq!(sample_count(&parts), frame + 1);
            }
            archive.finish(Durability::Flushed).unwrap();
            assert!(bytes(&whole) == bytes(&parts), "{kept} frames kept, {later:?} behind");
        }
    }
}

#[test]
fn a_run_that_dies_while_it_continues_can_continue_from_the_same_mark() {
    let (_folder, whole, parts) = scratch();
    finished(&whole, &[0, 1, 2, 3, 4, 5]);
    let mark = written(&parts, &[0, 1, 2, 3, 100])[2];
    drop(resumed(&parts, &mark).unwrap());
    assert_eq!(sample_count(&parts), 3);
    let (mut archive, mut shot) = resumed(&parts, &mark).unwrap();
    shot.write(&mut archive, 3);
    drop(archive);
    assert_eq!(sample_count(&parts), 4);
    let (mut archive, mut shot) = resumed(&parts, &mark).unwrap();
    (3..6).for_each(|frame| shot.write(&mut archive, frame));
    archive.finish(Durability::Synced).unwrap();
    assert!(bytes(&whole) == bytes(&parts));
}

#[test]
fn a_broken_root_in_the_header_does_not_matter() {
    // After a power cut the header may point to a commit that never reached the disk.
    let (_folder, whole, parts) = scratch();
    finished(&whole, &[0, 1, 2]);
    let mark = written(&parts, &[0, 1])[1];
    let mut torn = bytes(&parts);
    torn[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(&parts, torn).unwrap();
    assert!(Archive::open(&parts).is_err());
    let (mut archive, mut shot) = resumed(&parts, &mark).unwrap();
    shot.write(&mut archive, 2);
    archive.finish(Durability::Flushed).unwrap();
    assert!(bytes(&whole) == bytes(&parts));
}

#[test]
fn an_archive_that_was_opened_before_keeps_all_its_frames_whatever_is_written_in_their_place() {
    let (_folder, _, path) = scratch();
    // From here each time, with the same frames again, with others, and without any.
    for (later, finished) in [(2..5, true), (100..110, false), (0..0, true)] {
        let mark = written(&path, &[0, 1, 2, 3, 4])[1];
        let before = PolyMesh::open(&Archive::open(&path).unwrap(), PATH).unwrap();
        let all_right = || (0..5).all(|frame| before.positions(frame).unwrap() == positions(frame));
        let (mut archive, mut shot) = resumed(&path, &mark).unwrap();
        assert!(all_right());
        for frame in later {
            shot.write(&mut archive, frame);
            assert!(all_right());
        }
        if finished {
            archive.finish(Durability::Flushed).unwrap();
        }
        assert!(all_right());
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn an_archive_that_ends_with_its_mark_goes_on_without_a_copy() {
    let (_folder, _, path) = scratch();
    let mark = *written(&path, &[0, 1, 2]).last().unwrap();
    let before = std::fs::File::open(&path).unwrap();
    // What a process left that was killed while it copied.
    let left = path.with_file_name("parts.abc.part");
    std::fs::write(&left, b"half").unwrap();
    let (mut archive, mut shot) = resumed(&path, &mark).unwrap();
    assert!(!left.exists());
    shot.write(&mut archive, 3);
    archive.finish(Durability::Flushed).unwrap();
    assert_eq!(before.metadata().unwrap().len(), bytes(&path).len() as u64);
    std::fs::write(&left, b"half").unwrap();
    ArchiveWriter::remove(&path).unwrap();
    assert!(!left.exists() && !path.exists());
    ArchiveWriter::remove(&path).expect("nothing to remove is no error");
}

#[test]
fn an_archive_being_written_has_room_for_the_next_commits_at_all_times() {
    // Who maps it into memory has its length from before, and perhaps the root of a later commit.
    let (_folder, _, path) = scratch();
    let length = || std::fs::metadata(&path).unwrap().len();
    let marks = written(&path, &[0, 1, 2]);
    assert!(length() > marks[2].end + (1 << 19));
    for later in [[].as_slice(), &[3]] {
        let mark = *written(&path, &[0, 1, 2]).last().unwrap();
        let (mut archive, mut shot) = resumed(&path, &mark).unwrap();
        assert!(length() > mark.end + (1 << 19));
        later.iter().for_each(|frame| shot.write(&mut archive, *frame));
        let end = archive.mark().unwrap().end;
        assert!(length() > end + (1 << 19));
        archive.finish(Durability::Flushed).unwrap();
        assert_eq!(length(), end);
    }
}

#[test]
fn an_archive_that_cannot_be_copied_is_left_alone() {
    let (_folder, _, path) = scratch();
    let mark = written(&path, &[0, 1, 2, 3])[1];
    let before = bytes(&path);
    // A folder has the name of the copy.
    std::fs::create_dir(path.with_extension("abc.part")).unwrap();
    let error = resumed(&path, &mark).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("abc.part") && error.contains("copy"), "{error}");
    assert!(bytes(&path) == before);
}

#[test]
fn what_cannot_be_continued_is_refused_and_left_alone() {
    let (folder, _, path) = scratch();
    let mark = written(&path, &[0, 1, 2, 3])[1];
    let good = bytes(&path);
    let refused = |what: &str, content: &[u8], mark: &ArchiveMark, expected: &str| {
        std::fs::write(&path, content).unwrap();
        let error = resumed(&path, mark).map(|_| ()).expect_err(what).to_string();
        assert!(error.contains(expected) && error.contains("parts.abc"), "{what}: {error}");
        assert!(bytes(&path) == content, "{what}: the file was changed");
    };
    refused("cut off in the commit", &good[..mark.end as usize - 1], &mark, "root group");
    refused("cut off before it", &good[..mark.root as usize - 40], &mark, "bytes");
    refused("empty", &[], &mark, "not an Alembic Ogawa archive");
    let mut flipped = good.clone();
    flipped[2] ^= 1;
    refused("magic", &flipped, &mark, "not an Alembic Ogawa archive");
    let mut flipped = good.clone();
    flipped[mark.end as usize - 60] ^= 1;
    refused("tables", &flipped, &mark, "damaged");
    let payload: Vec<u8> = positions(1).as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    let start = good.windows(payload.len()).position(|window| window == payload).unwrap();
    let mut flipped = good.clone();
    flipped[start + 3] ^= 1;
    refused("last sample", &flipped, &mark, "differs from what was written");
    refused("root elsewhere", &good, &ArchiveMark { root: mark.root - 8, ..mark }, "damaged");
    refused("root behind the end", &good, &ArchiveMark { root: u64::MAX, ..mark }, "damaged");
    refused("another digest", &good, &ArchiveMark { digest: [7; 16], ..mark }, "differs from what was written there");
    written(&path, &[0, 100, 2, 3]);
    refused("another run", &bytes(&path), &mark, "differs from what was written there");
    std::fs::remove_file(&path).unwrap();
    assert!(resumed(&path, &mark).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn another_set_up_is_refused_and_the_file_left_alone() {
    let (_folder, _, path) = scratch();
    let mark = written(&path, &[0, 1, 2])[0];
    let good = bytes(&path);
    let declared = |declare_more: &dyn Fn(&mut ArchiveWriter) -> Result<(), AlembicError>| {
        let declare = |archive: &mut ArchiveWriter| declare(archive).and_then(|_| declare_more(archive));
        ArchiveWriter::resume(&path, &options(), &mark, declare).map(|_| ())
    };
    assert!(declared(&|archive| archive.add_time_sampling(TimeSampling::frames(1.0, 25.0)?).map(|_| ())).is_err());
    assert!(declared(&|archive| archive.add_object(archive.root(), "more", &MetaData::new()).map(|_| ())).is_err());
    let more_text = |archive: &mut ArchiveWriter| {
        let top = archive.top_compound(archive.root());
        archive.write_static_string(top, "text", "a payload that is nowhere in the file")
    };
    assert!(declared(&more_text).is_err());
    let less = ArchiveWriter::resume(&path, &options(), &mark, |archive| {
        let root = archive.root();
        XformWriter::still(archive, root, "cloth", None)
    });
    assert!(less.unwrap_err().to_string().contains("/cloth/clothShape: the file has it"));
    let other_rate = ArchiveOptions { frames_per_second: Some(25.0), ..options() };
    let error = ArchiveWriter::resume(&path, &other_rate, &mark, declare).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("different settings"), "{error}");
    assert!(bytes(&path) == good);
    // Another version of the program may go on.
    let other_version = ArchiveOptions { application: "test 2".into(), ..options() };
    assert!(ArchiveWriter::resume(&path, &other_version, &mark, declare).is_ok());
}

#[test]
fn a_continued_mesh_has_the_faces_and_the_members_it_was_begun_with() {
    let (_folder, _, path) = scratch();
    let mark = written(&path, &[0, 1])[1];
    let still = positions(0);
    let topology = Some(Topology { face_counts: &[3], face_indices: &[0, 1, 2] });
    let same = PolyMeshSample { topology, ..PolyMeshSample::of(&still) };
    let more = [still[0]; 4];
    let uv = Indexed { values: &[[0.0, 0.0]; 3], indices: None, scope: Scope::FaceVarying, source_name: None };
    let turned = Some(Topology { face_counts: &[3], face_indices: &[2, 1, 0] });
    let samples = [
        ("same", same, true),
        ("more vertices", PolyMeshSample { positions: &more, ..same }, false),
        ("turned faces", PolyMeshSample { topology: turned, ..same }, false),
        ("velocities", PolyMeshSample { velocities: Some(&still), ..same }, false),
        ("UVs", PolyMeshSample { uv: Some(uv), ..same }, false),
    ];
    for (what, sample, fits) in samples {
        let checked = ArchiveWriter::resume(&path, &options(), &mark, |archive| {
            let mut shot = declare(archive)?;
            shot.mesh.check_continued(archive, &sample)
        });
        assert_eq!(checked.is_ok(), fits, "{what}");
    }
}

#[test]
fn flipped_bytes_lead_to_no_panic_and_no_invalid_file() {
    let (_folder, _, path) = scratch();
    let marks = written(&path, &[0, 1, 2]);
    let mark = marks[1];
    let mut good = bytes(&path);
    good.truncate(marks[2].end as usize);
    // Not every byte, because each continuation waits for the disk; 7 meets all places in words of eight.
    for position in (0..good.len()).step_by(7) {
        let mut flipped = good.clone();
        flipped[position] ^= 0xff;
        std::fs::write(&path, &flipped).unwrap();
        match resumed(&path, &mark) {
            Ok((mut archive, mut shot)) => {
                shot.write(&mut archive, 2);
                assert_eq!(sample_count(&path), 3, "byte {position}");
            }
            Err(_) => assert!(bytes(&path) == flipped, "byte {position}: the file was changed"),
        }
    }
}
