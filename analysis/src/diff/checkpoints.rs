//! Two checkpoints, section by section and array by array.

use std::io::Read;
use std::path::Path;

use drapery_core::snapshot::{Dataset, Section, Values};
use drapery_io::checkpoint::Checkpoint;
use drapery_io::error::IoError;
use drapery_io::input_file;

use super::{DatasetDifference, PartComparison, Verdict, WorstVertex};

/// First bytes of checkpoints, and of no other file: the seal is checked before the HDF5 library sees a byte of a
/// damaged file.
const SEAL: &[u8] = b"Drapery checkpoint ";

/// Array of positions: only its differences are distances.
const POSITIONS: &str = "state/positions";

/// Whether a file is a checkpoint.
pub(super) fn is_checkpoint(path: &Path) -> bool {
    let mut start = Vec::with_capacity(SEAL.len());
    let read = input_file::open(path).map(|file| file.take(SEAL.len() as u64).read_to_end(&mut start));
    matches!(read, Ok(Ok(_))) && start == SEAL
}

/// Compares everything that two checkpoints remember.
pub(super) fn compare(a: &Path, b: &Path, tolerance: f64) -> Result<PartComparison, IoError> {
    let (first, second) = (Checkpoint::read(a)?, Checkpoint::read(b)?);
    let mut part = PartComparison::new(a, b, Verdict::Equal);
    let places = [&first, &second].map(|checkpoint| (checkpoint.head.frame, checkpoint.head.sub_step));
    if places[0] != places[1] {
        let [(frame_a, step_a), (frame_b, step_b)] = places;
        part.notes
            .push(format!("frame {frame_a} + {step_a} steps in the first, frame {frame_b} + {step_b} in the second"));
    }
    if first.head.digests != second.head.digests {
        part.notes.push("the checkpoints belong to shots with different inputs, settings or versions".to_owned());
    }
    compare_sections(&first.snapshot.sections, &second.snapshot.sections, first.head.frame, &mut part);
    let largest = part.worst.as_ref().map_or(0.0, |worst| worst.distance);
    let only_positions = part.datasets.iter().all(|found| found.name == POSITIONS);
    part.verdict = match () {
        // A tolerance is a distance; it says nothing about what else a solver remembers.
        () if !part.notes.is_empty() || largest > tolerance || !only_positions => Verdict::Differs,
        () if !part.datasets.is_empty() => Verdict::WithinTolerance,
        () => Verdict::Equal,
    };
    Ok(part)
}

fn compare_sections(a: &[Section], b: &[Section], frame: i64, part: &mut PartComparison) {
    let names = |s: &[Section]| s.iter().map(|section| section.name.clone()).collect();
    for name in missing(names(a), names(b)) {
        part.notes.push(format!("section {name}"));
    }
    for (section, other) in a.iter().filter_map(|s| Some((s, b.iter().find(|other| other.name == s.name)?))) {
        if section.version != other.version {
            let (first, second) = (section.version, other.version);
            part.notes
                .push(format!("section {} has version {first} in the first, {second} in the second", section.name));
        }
        let names = |s: &Section| s.datasets.iter().map(|dataset| dataset.name.clone()).collect();
        for name in missing(names(section), names(other)) {
            part.notes.push(format!("array {}/{name}", section.name));
        }
        for dataset in &section.datasets {
            if let Some(like) = other.datasets.iter().find(|like| like.name == dataset.name) {
                compare_datasets(&section.name, dataset, like, frame, part);
            }
        }
    }
}

/// Lists the names that only one side has, with the side.
fn missing(a: Vec<String>, b: Vec<String>) -> Vec<String> {
    let only = |these: &[String], others: &[String], side: &str| -> Vec<String> {
        let lone = these.iter().filter(|name| !others.contains(name));
        lone.map(|name| format!("{name} exists only in the {side} checkpoint")).collect()
    };
    [only(&a, &b, "first"), only(&b, &a, "second")].concat()
}

fn compare_datasets(section: &str, a: &Dataset, b: &Dataset, frame: i64, part: &mut PartComparison) {
    let name = format!("{section}/{}", a.name);
    if a.shape != b.shape {
        part.notes.push(format!("array {name} has the shape {:?} in the first, {:?} in the second", a.shape, b.shape));
        return;
    }
    let Some(found) = differences(&a.values, &b.values) else {
        part.notes.push(format!("the values of array {name} differ in type"));
        return;
    };
    if found.count == 0 {
        return;
    }
    if let (true, Values::F64(p), Values::F64(q)) = (name == POSITIONS, &a.values, &b.values) {
        part.worst = farthest(&name, p, q, frame);
    }
    part.datasets.push(DatasetDifference { name, ..found });
}

/// The vertex that is farthest from its like, of positions one after the other [m].
fn farthest(name: &str, a: &[f64], b: &[f64], frame: i64) -> Option<WorstVertex> {
    let distance = |(p, q): (&[f64], &[f64])| p.iter().zip(q).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt();
    let distances = a.chunks(3).zip(b.chunks(3)).map(distance).enumerate();
    // What is not a number is farther than anything.
    let distances = distances.map(|(vertex, d)| (vertex, if d.is_nan() { f64::INFINITY } else { d }));
    let (vertex, distance) = distances.reduce(|best, next| if next.1 > best.1 { next } else { best })?;
    Some(WorstVertex { mesh: name.to_owned(), vertex, frame, behind: 0.0, distance })
}

/// Returns the number of values that differ, the first of them, and the largest difference; without a name. `None`
/// for other types.
fn differences(a: &Values, b: &Values) -> Option<DatasetDifference> {
    Some(match (a, b) {
        // Bits, not values: a state that goes on differs already if the sign of a zero does.
        (Values::F64(a), Values::F64(b)) => pairs(a, b, |x, y| x.to_bits() != y.to_bits(), |x, y| (x - y).abs()),
        (Values::U64(a), Values::U64(b)) => pairs(a, b, |x, y| x != y, |x, y| x.abs_diff(y) as f64),
        (Values::I64(a), Values::I64(b)) => pairs(a, b, |x, y| x != y, |x, y| x.abs_diff(y) as f64),
        (Values::U32(a), Values::U32(b)) => pairs(a, b, |x, y| x != y, |x, y| x.abs_diff(y).into()),
        (Values::U8(a), Values::U8(b)) => pairs(a, b, |x, y| x != y, |x, y| x.abs_diff(y).into()),
        _ => return None,
    })
}

fn pairs<T: Copy>(a: &[T], b: &[T], differ: fn(T, T) -> bool, away: fn(T, T) -> f64) -> DatasetDifference {
    let mut found = DatasetDifference { name: String::new(), count: 0, values: a.len(), max: 0.0, first: 0 };
    for (index, (x, y)) in a.iter().zip(b).enumerate().filter(|(_, (x, y))| differ(**x, **y)) {
        if found.count == 0 {
            found.first = index;
        }
        found.count += 1;
        let distance = away(*x, *y);
        found.max = found.max.max(if distance.is_nan() { f64::INFINITY } else { distance });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use drapery_core::snapshot::Snapshot;
    use drapery_io::checkpoint::{FORMAT_VERSION, Head};

    fn written(folder: &Path, name: &str, x: [f64; 6], marks: &[u8]) -> std::path::PathBuf {
        let head = Head {
            format_version: FORMAT_VERSION,
            application: "test".into(),
            shot: "s".into(),
            frame: 1010,
            sub_step: 0,
            time: 0.375,
            delivered: Some(1010),
            fps: [24, 1],
            digests: Default::default(),
            caches: Vec::new(),
        };
        let dataset = |name: &str, shape: &[usize], values| Dataset { name: name.into(), shape: shape.into(), values };
        let section = |name: &str, datasets| Section { name: name.into(), version: 1, datasets };
        let sections = vec![
            section("state", vec![dataset("positions", &[2, 3], Values::F64(x.into()))]),
            section("self_repulsion", vec![dataset("sides", &[marks.len()], Values::U8(marks.into()))]),
        ];
        let path = folder.join(name);
        Checkpoint { head, snapshot: Snapshot { sections } }.write(&path).unwrap();
        path
    }

    #[test]
    fn a_vertex_that_moved_in_a_checkpoint_is_named_with_its_distance() {
        let folder = tempfile::tempdir().unwrap();
        let x = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        let a = written(folder.path(), "a.h5", x, &[0, 1]);
        let mut moved = x;
        (moved[3], moved[4]) = (1.3, 1.4);
        let b = written(folder.path(), "b.h5", moved, &[0, 1]);
        assert!(is_checkpoint(&a));
        let found = super::super::compare(&a, &b, 0.0).unwrap();
        assert_eq!(found.verdict, Verdict::Differs);
        let worst = found.parts[0].worst.as_ref().unwrap();
        assert_eq!((worst.vertex, worst.frame), (1, 1010));
        assert!((worst.distance - 0.5).abs() < 1e-15, "{}", worst.distance);
        assert_eq!((found.parts[0].datasets[0].first, found.parts[0].datasets[0].count), (3, 2));
        assert_eq!(super::super::compare(&a, &b, 0.6).unwrap().verdict, Verdict::WithinTolerance);
        assert_eq!(super::super::compare(&a, &a, 0.0).unwrap().verdict, Verdict::ByteEqual);
    }

    #[test]
    fn no_tolerance_lets_another_memory_of_contacts_pass() {
        let folder = tempfile::tempdir().unwrap();
        let a = written(folder.path(), "a.h5", [0.0; 6], &[0, 1]);
        let b = written(folder.path(), "b.h5", [0.0; 6], &[1, 1]);
        let c = written(folder.path(), "c.h5", [0.0; 6], &[1, 1, 1]);
        let found = super::super::compare(&a, &b, 1.0).unwrap();
        assert_eq!(found.verdict, Verdict::Differs);
        assert_eq!(found.parts[0].datasets[0].name, "self_repulsion/sides");
        let found = super::super::compare(&a, &c, 1.0).unwrap();
        assert!(found.parts[0].notes[0].contains("the shape [2] in the first, [3]"), "{:?}", found.parts[0].notes);
    }
}
