use std::collections::BTreeSet;
use std::fs::File;

use drapery_core::snapshot::{Dataset, Section, SnapshotSink, SnapshotSource, ValueKind, Values};
use hdf5::types::VarLenUnicode;

use super::*;
use crate::checkpoint::seal::{self, FORMAT_VERSION};
use crate::error::IoErrorKind;

pub(crate) fn sample() -> Checkpoint {
    let dataset =
        |name: &str, shape: &[usize], values: Values| Dataset { name: name.into(), shape: shape.into(), values };
    let x = vec![0.1, -0.0, f64::MIN_POSITIVE / 3.0, f64::MAX, f64::INFINITY, 1.0 / 3.0];
    let simulation = vec![
        dataset("x", &[2, 3], Values::F64(x)),
        dataset("step", &[], Values::U64(vec![u64::MAX])),
        dataset("frame", &[1], Values::I64(vec![i64::MIN])),
        dataset("bonds", &[0, 2], Values::U32(Vec::new())),
    ];
    let contact = vec![
        dataset("pairs", &[2, 2], Values::U32(vec![0, 1, 2, u32::MAX])),
        dataset("a mark: 50% ü", &[3], Values::U8(vec![1, 0, 255])),
    ];
    let section = |name: &str, version, datasets| Section { name: name.into(), version, datasets };
    // Not in alphabetical order: the order is part of the content.
    let sections = vec![
        section("simulation", 3, simulation),
        section("self_repulsion", 1, contact),
        section("attachments", 7, Vec::new()),
    ];
    let head = Head {
        format_version: FORMAT_VERSION,
        application: "Drapery 0.1.0".into(),
        shot: "vestido_01 \"ñ\"".into(),
        frame: -12,
        sub_step: 5,
        time: 0.1 + 0.2,
        delivered: None,
        fps: [24000, 1001],
        digests: [("scene".to_owned(), "ab".to_owned())].into(),
        caches: vec![serde_json::json!({"file": "skirt.abc", "bytes": u64::MAX})],
    };
    Checkpoint { head, snapshot: Snapshot { sections } }
}

fn written(folder: &Path, name: &str, checkpoint: &Checkpoint) -> std::path::PathBuf {
    let path = folder.join(name);
    checkpoint.write(&path).unwrap();
    path
}

#[test]
fn what_is_read_is_what_was_written_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut checkpoint = sample();
    for delivered in [None, Some(1001)] {
        checkpoint.head.delivered = delivered;
        let path = written(folder.path(), "a.h5", &checkpoint);
        let read = Checkpoint::read(&path).unwrap();
        assert_eq!(read, checkpoint);
        // Equality does not tell -0 from 0.
        assert_eq!(read.content_hash(), checkpoint.content_hash());
    }
}

#[test]
fn every_time_keeps_its_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut checkpoint = Checkpoint { head: sample().head, snapshot: Snapshot::default() };
    for frame in 0..50 {
        checkpoint.head.time = f64::from(frame) * 1001.0 / 24000.0 + f64::EPSILON * f64::from(frame);
        let path = written(folder.path(), "a.h5", &checkpoint);
        assert_eq!(Checkpoint::read(&path).unwrap().head.time.to_bits(), checkpoint.head.time.to_bits());
    }
}

#[test]
fn equal_states_give_equal_bytes_and_any_change_gives_another_hash() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = sample();
    let first = std::fs::read(written(folder.path(), "a.h5", &checkpoint)).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1100)); // HDF5 counts times of change in seconds
    let second = std::fs::read(written(folder.path(), "b.h5", &checkpoint)).unwrap();
    assert!(first == second);

    type Change = fn(&mut Checkpoint);
    let changes: [Change; 8] = [
        |c| c.head.frame += 1,
        |c| c.head.time = c.head.time.next_up(),
        |c| c.snapshot.sections.swap(0, 1),
        |c| c.snapshot.sections[1].version += 1,
        |c| c.snapshot.sections[0].datasets.swap(0, 1),
        |c| c.snapshot.sections[0].datasets[0].shape = vec![3, 2],
        |c| c.snapshot.sections[0].datasets[1].values = Values::I64(vec![-1]),
        |c| c.snapshot.sections[0].datasets[0].values = Values::F64(vec![0.1, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ];
    let mut hashes = BTreeSet::from([checkpoint.content_hash()]);
    for change in changes {
        let mut changed = sample();
        change(&mut changed);
        hashes.insert(changed.content_hash());
    }
    assert_eq!(hashes.len(), 1 + changes.len());
}

#[test]
fn other_programs_find_head_sections_and_arrays_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let checkpoint = sample();
    let file = hdf5::File::open(written(folder.path(), "a.h5", &checkpoint)).unwrap();
    assert_eq!(file.attr("frame").unwrap().read_scalar::<i64>().unwrap(), -12);
    assert_eq!(file.attr("sub_step").unwrap().read_scalar::<u64>().unwrap(), 5);
    assert_eq!(file.attr("time").unwrap().read_scalar::<f64>().unwrap(), 0.1 + 0.2);
    let hash = file.attr("content_hash").unwrap().read_scalar::<VarLenUnicode>().unwrap();
    assert_eq!(hash.as_str(), checkpoint.content_hash());
    let pairs = file.dataset("self_repulsion/pairs").unwrap();
    assert_eq!((pairs.shape(), pairs.read_raw::<u32>().unwrap()), (vec![2, 2], vec![0, 1, 2, u32::MAX]));
    assert_eq!(file.group("simulation").unwrap().attr("version").unwrap().read_scalar::<u64>().unwrap(), 3);
}

#[test]
fn a_file_cut_off_anywhere_is_refused_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    let whole = std::fs::read(written(folder.path(), "a.h5", &sample())).unwrap();
    let path = folder.path().join("cut.h5");
    for length in (0..whole.len()).step_by(97).chain([whole.len() - 1, seal::LENGTH, seal::LENGTH - 1]) {
        std::fs::write(&path, &whole[..length]).unwrap();
        let error = Checkpoint::read(&path).unwrap_err();
        assert_eq!(error.kind(), IoErrorKind::BadInput, "{length}: {error}");
        let text = error.to_string();
        assert!(text.contains("cut.h5") && text.contains("--resume"), "{length}: {text}");
    }
    std::fs::write(&path, [whole.as_slice(), b"more"].concat()).unwrap();
    assert!(Checkpoint::read(&path).unwrap_err().to_string().contains("bytes, but"));
}

#[test]
fn a_flipped_bit_anywhere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let whole = std::fs::read(written(folder.path(), "a.h5", &sample())).unwrap();
    let path = folder.path().join("flipped.h5");
    let seal = 0..seal::LENGTH;
    for place in seal.chain((seal::LENGTH..whole.len()).step_by(37)) {
        let mut bytes = whole.clone();
        bytes[place] ^= 1 << (place % 8);
        std::fs::write(&path, bytes).unwrap();
        let error = Checkpoint::read(&path).expect_err("no byte is without meaning");
        assert_eq!(error.kind(), IoErrorKind::BadInput, "{place}: {error}");
    }
}

/// Changes a file and puts a new seal on it, as somebody would who knows how.
fn reseal(path: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = std::fs::read(path).unwrap();
    change(&mut bytes);
    std::fs::write(path, bytes).unwrap();
    seal::put(&mut File::options().read(true).write(true).open(path).unwrap()).unwrap();
}

#[test]
fn a_missing_section_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "a.h5", &sample());
    let file = hdf5::File::open_rw(&path).unwrap();
    file.unlink("self_repulsion").unwrap();
    file.close().unwrap();
    reseal(&path, |_| {});
    let error = Checkpoint::read(&path).unwrap_err().to_string();
    assert!(error.contains("content_hash") && error.contains("--resume"), "{error}");
}

#[test]
fn a_newer_version_is_refused_with_its_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), "a.h5", &sample());
    let mut bytes = std::fs::read(&path).unwrap();
    assert!(bytes.starts_with(b"Drapery checkpoint 1\n"));
    bytes[19] = b'2';
    std::fs::write(&path, bytes).unwrap();
    let error = Checkpoint::read(&path).unwrap_err().to_string();
    assert!(error.contains("version 2") && error.contains("newer program"), "{error}");
}

#[test]
fn what_is_no_checkpoint_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    assert_eq!(Checkpoint::read(&path).unwrap_err().kind(), IoErrorKind::MissingInput);
    for content in
        [vec![0; 4096], b"Drapery checkpoint 99999999999999999999\n".repeat(40), b"\x89HDF\r\n\x1a\n".repeat(99)]
    {
        std::fs::write(&path, content).unwrap();
        assert!(Checkpoint::read(&path).unwrap_err().to_string().contains("not a checkpoint"));
    }
    assert_eq!(Checkpoint::read(folder.path()).unwrap_err().kind(), IoErrorKind::BadInput);
}

#[test]
fn pieces_give_the_file_of_the_whole_and_are_read_as_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let rows: Vec<f64> = (0..3 * 100_000).map(|k| f64::from(k).sqrt()).collect();
    let whole = |name: &str| Dataset { name: name.into(), shape: vec![100_000, 3], values: Values::F64(rows.clone()) };
    let section = Section { name: "state".into(), version: 1, datasets: vec![whole("positions"), whole("velocities")] };
    let checkpoint = Checkpoint { head: sample().head, snapshot: Snapshot { sections: vec![section] } };
    let first = std::fs::read(written(folder.path(), "whole.h5", &checkpoint)).unwrap();
    let path = folder.path().join("pieces.h5");
    let mut writer = CheckpointWriter::create(&path, &checkpoint.head).unwrap();
    writer.section("state", 1);
    for name in ["positions", "velocities"] {
        writer.dataset(name, &[100_000, 3], ValueKind::F64);
        rows.chunks(3 * 7_001).for_each(|piece| writer.rows(Values::F64(piece.to_vec())));
    }
    let (_, hash) = writer.finish().unwrap();
    assert_eq!(hash, checkpoint.content_hash());
    assert!(std::fs::read(&path).unwrap() == first);
    let mut reader = CheckpointReader::open(&path).unwrap();
    assert_eq!((reader.version("state"), reader.rows_of("state", "velocities").unwrap()), (Some(1), 100_000));
    let piece = reader.values("state", "velocities", 99_998..100_000).unwrap();
    assert_eq!(piece, Values::F64(rows[3 * 99_998..].to_vec()));
    assert!(reader.values("state", "velocities", 99_998..100_001).is_err());
    assert!(reader.values("state", "masses", 0..1).is_err());
}
