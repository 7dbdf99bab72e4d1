//! Commits, killed writers and continued archives, on a mesh as a solver writes it.

use std::path::Path;

use drapery_alembic::*;

const VERTICES: usize = 20;

fn options() -> ArchiveOptions {
    ArchiveOptions { application: "test".into(), frames_per_second: Some(24.0), ..ArchiveOptions::default() }
}

fn positions(frame: usize) -> Vec<[f32; 3]> {
    (0..VERTICES).map(|v| [v as f32, (frame * v) as f32 * 0.01, 0.5]).collect()
}

/// Everything declared, in the same way for a new and a continued archive.
struct Shot {
    xform: XformWriter,
    mesh: PolyMeshWriter,
    sampling: u32,
}

impl Shot {
    fn declare(archive: &mut ArchiveWriter) -> Self {
        let sampling = archive.add_time_sampling(TimeSampling::frames(1001.0, 24.0).unwrap()).unwrap();
        let root = archive.root();
        let xform = XformWriter::declare(archive, root, "cloth", sampling).unwrap();
        let mesh = PolyMeshWriter::declare(archive, xform.object(), "clothShape", sampling).unwrap();
        write_face_set(archive, mesh.object(), "panel", &[0], true).unwrap();
        let user = mesh.user_properties(archive).unwrap();
        archive.write_static_string(user, "solver", "Drapery").unwrap();
        Self { xform, mesh, sampling }
    }

    fn write(&mut self, archive: &mut ArchiveWriter, frame: usize) {
        let indices: Vec<i32> = (0..VERTICES as i32).collect();
        let corner_uv: Vec<u32> = (0..VERTICES as u32).map(|corner| corner % 2).collect();
        let uv = Indexed {
            values: &[[0.0, 0.0], [1.0, 1.0]],
            indices: Some(&corner_uv),
            scope: Scope::FaceVarying,
            source_name: Some("map1"),
        };
        let positions = positions(frame);
        let mut matrix = IDENTITY;
        matrix[12] = frame as f64;
        self.xform.write(archive, &matrix).unwrap();
        let topology = Topology { face_counts: &[VERTICES as i32], face_indices: &indices };
        let sample = PolyMeshSample {
            topology: (frame == 0).then_some(topology),
            velocities: Some(&positions),
            uv: (frame == 0).then_some(uv),
            ..PolyMeshSample::of(&positions)
        };
        self.mesh.write(archive, &sample).unwrap();
        archive.write_archive_bounds(self.sampling, &[0.0; 6]).unwrap();
    }
}

fn write_frames(mut archive: ArchiveWriter, frames: std::ops::Range<usize>) {
    let mut shot = Shot::declare(&mut archive);
    for frame in frames {
        shot.write(&mut archive, frame);
        archive.commit(Durability::Flushed).unwrap();
    }
    archive.finish(Durability::Synced).unwrap();
}

fn check_frames(path: &Path, frames: usize) {
    let archive = Archive::open(path).unwrap();
    let mesh = PolyMesh::open(&archive, "/cloth/clothShape").unwrap();
    assert_eq!(mesh.sample_count(), frames);
    for frame in 0..frames {
        assert!((mesh.time(frame) - (1001.0 + frame as f64) / 24.0).abs() < 1e-12);
        assert_eq!(mesh.positions(frame).unwrap(), positions(frame));
        assert_eq!(mesh.velocities(frame).unwrap().unwrap(), positions(frame));
        assert_eq!(mesh.faces(frame).unwrap().face_counts, [VERTICES as u32]);
        assert_eq!(mesh.world_matrix_at(mesh.time(frame)).unwrap()[12], frame as f64);
        let expected = [0.0, 0.0, 0.5, 19.0, f64::from(positions(frame)[19][1]), 0.5];
        assert_eq!(mesh.bounds(frame).unwrap(), Some(expected));
        assert_eq!(mesh.uv().unwrap().expanded::<f32, 2>(frame).unwrap()[1], [1.0, 1.0]);
    }
    let moves = if frames > 1 { TopologyVariance::Homogeneous } else { TopologyVariance::Constant };
    assert_eq!(mesh.topology_variance(), moves);
    assert_eq!(mesh.uv().unwrap().source_name(), Some("map1"));
    assert_eq!(mesh.face_sets().unwrap(), [FaceSet { name: "panel".into(), faces: vec![0], exclusive: true }]);
    let solver = mesh.user_properties().unwrap().samples("solver").unwrap().strings(0).unwrap();
    assert_eq!(solver, ["Drapery"]);
}

#[test]
fn a_continued_archive_has_the_bytes_of_one_written_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole.abc", "parts.abc"].map(|name| folder.path().join(name));
    write_frames(ArchiveWriter::create(&whole, &options()).unwrap(), 0..6);
    write_frames(ArchiveWriter::create(&parts, &options()).unwrap(), 0..3);
    write_frames(ArchiveWriter::append(&parts).unwrap(), 3..6);
    check_frames(&parts, 6);
    assert!(std::fs::read(&whole).unwrap() == std::fs::read(&parts).unwrap());
}

#[test]
fn a_killed_writer_leaves_the_committed_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("killed.abc");
    let mut archive = ArchiveWriter::create(&path, &options()).unwrap();
    let mut shot = Shot::declare(&mut archive);
    shot.write(&mut archive, 0);
    assert!(matches!(Archive::open(&path), Err(AlembicError::Unfinished { .. })), "nothing was committed yet");
    for frame in 1..4 {
        archive.commit(Durability::Flushed).unwrap();
        shot.write(&mut archive, frame); // on the disk, but behind the commit
        check_frames(&path, frame);
    }
    drop(archive);
    check_frames(&path, 3);
    write_frames(ArchiveWriter::append(&path).unwrap(), 3..5);
    check_frames(&path, 5);
}

#[test]
fn an_archive_cut_off_anywhere_behind_the_last_commit_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.abc");
    write_frames(ArchiveWriter::create(&path, &options()).unwrap(), 0..3);
    let committed = std::fs::metadata(&path).unwrap().len();
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.extend([0x55; 300]);
    for end in (committed as usize..bytes.len()).step_by(37) {
        std::fs::write(&path, &bytes[..end]).unwrap();
        check_frames(&path, 3);
    }
}

#[test]
fn a_continued_archive_refuses_other_settings() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.abc");
    write_frames(ArchiveWriter::create(&path, &options()).unwrap(), 0..2);
    let mut archive = ArchiveWriter::append(&path).unwrap();
    let other_rate = archive.add_time_sampling(TimeSampling::frames(1001.0, 25.0).unwrap()).unwrap();
    let root = archive.root();
    let refused = XformWriter::declare(&mut archive, root, "cloth", other_rate).unwrap_err();
    assert!(refused.to_string().contains("/cloth:.xform/.inherits"), "{refused}");
    // What was refused has used the name.
    let mut archive = ArchiveWriter::append(&path).unwrap();
    let sampling = archive.add_time_sampling(TimeSampling::frames(1001.0, 24.0).unwrap()).unwrap();
    let root = archive.root();
    let cloth = XformWriter::declare(&mut archive, root, "cloth", sampling).unwrap().object();
    let mesh = PolyMeshWriter::declare(&mut archive, cloth, "clothShape", sampling).unwrap().object();
    assert!(write_face_set(&mut archive, mesh, "panel", &[1], true).is_err(), "other faces");
}

#[test]
fn the_layout_after_a_commit_does_not_depend_on_later_frames() {
    let folder = tempfile::tempdir().unwrap();
    let [short, long] = ["short.abc", "long.abc"].map(|name| folder.path().join(name));
    write_frames(ArchiveWriter::create(&short, &options()).unwrap(), 0..2);
    write_frames(ArchiveWriter::create(&long, &options()).unwrap(), 0..5);
    let [short, long] = [short, long].map(|path| std::fs::read(path).unwrap());
    assert!(short[16..] == long[16..short.len()], "only the root offset in the header may differ");
}

#[test]
fn object_hashes_follow_the_content_and_nothing_else() {
    /// The 32 hash bytes of the top object: the end of its last child.
    fn hash(path: &Path) -> Vec<u8> {
        let bytes = std::fs::read(path).unwrap();
        let u64_at = |offset: usize| {
            let mut word = [0; 8];
            word.copy_from_slice(&bytes[offset..offset + 8]);
            (u64::from_le_bytes(word) & !(1 << 63)) as usize
        };
        let top = u64_at(u64_at(8) + 8 + 2 * 8);
        let headers = u64_at(top + 8 * u64_at(top));
        let end = headers + 8 + u64_at(headers);
        bytes[end - 32..end].to_vec()
    }
    let folder = tempfile::tempdir().unwrap();
    let [often, once, other] = ["often.abc", "once.abc", "other.abc"].map(|name| folder.path().join(name));
    write_frames(ArchiveWriter::create(&often, &options()).unwrap(), 0..4);
    for (path, last) in [(&once, 3), (&other, 4)] {
        let mut archive = ArchiveWriter::create(path, &options()).unwrap();
        let mut shot = Shot::declare(&mut archive);
        for frame in [0, 1, 2, last] {
            shot.write(&mut archive, frame);
        }
        archive.finish(Durability::Flushed).unwrap();
    }
    assert_eq!(hash(&often), hash(&once), "other offsets, same content");
    assert_ne!(hash(&once), hash(&other));
}
