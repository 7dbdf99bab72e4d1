//! Arrays of every layout against what a snapshot has to hold, over ranks.

use super::elements::ElementRows;
use super::rows::{OwnTarget, TargetNumbers};
use super::saved_section::{Field, SavedSection, SectionId};
use super::*;
use crate::Vec3;
use crate::parallel::local_ranks::LocalRanks;
use crate::parallel::parts::{Partition, Parts};
use crate::parallel::ranks::Ranks;

/// Vertices of the cloth, of which every seventh is pinned, and points of bodies.
const CLOTH: u32 = 50;
const POINTS: usize = 2;
const ID: SectionId = SectionId { name: "room", version: 3 };

/// Six parts. A garment numbers its vertices the other way round.
fn parts(ranks: &Ranks, assignment: &[usize]) -> Parts {
    let partition = Partition::new(vec![0, 9, 14, 27, 31, 44, CLOTH as usize], std::iter::once(0..50).collect());
    let own = partition.starts()[assignment[ranks.rank()]]..partition.starts()[assignment[ranks.rank() + 1]];
    Parts::new(ranks.clone(), partition, assignment.to_vec(), Vec::new(), own.map(|v| own_number(v as u32)).collect())
}

fn own_number(vertex: u32) -> u32 {
    CLOTH - 1 - vertex
}

fn vector(own_number: u32) -> Vec3 {
    Vec3::new(f64::from(own_number), 0.5, -f64::from(own_number))
}

fn own_targets(parts: &Parts) -> Vec<OwnTarget> {
    let all = (0..CLOTH.div_ceil(7)).map(|number| OwnTarget { number, vertex: 7 * number });
    all.filter(|target| parts.local(target.vertex).is_some()).collect()
}

/// Elements of four vertices in a row, each at the rank that has the first; or all.
fn elements(parts: &Parts, all: bool) -> ElementRows {
    let here = [3_u32, 10, 40].into_iter().filter(|first| all || parts.local(*first).is_some());
    here.map(|v| ([v, v + 1, v + 2, v + 3], [f64::from(v), 0.25])).collect()
}

/// Section of a rank; after a move or a read it has the elements of all ranks.
fn section(parts: &Parts, all_elements: bool) -> SavedSection {
    let own: Vec<u32> = parts.own().map(|local| own_number(parts.number(local))).collect();
    let vectors: Vec<Vec3> = own.iter().map(|own| vector(*own)).collect();
    let points = [Vec3::x(), Vec3::y()];
    let marks = own_targets(parts).iter().map(|target| target.number as u8).collect();
    SavedSection::new(ID)
        .with("number", Field::single(0.5))
        .with("count", Field::single(7_u64))
        .with("vertices", Field::vertices(2, own.iter().flat_map(|own| [f64::from(*own), 1.0]).collect()))
        .with("vectors", Field::vectors(&vectors))
        .with("nodes", Field::nodes(POINTS, Some([&vectors, &points])))
        .with("no_nodes", Field::nodes(POINTS, None))
        .with("marks", Field::targets::<u8>(1, marks))
        .with("numbers", Field::numbers(2, vec![0, 49, CLOTH, 20]))
        .with("elements", Field::elements(&elements(parts, all_elements)))
}

/// The same without values, as the same scene has it at its start.
fn blank(parts: &Parts) -> SavedSection {
    let (none, own) = (vec![Vec3::zeros(); parts.own().len()], parts.own().len());
    SavedSection::new(ID)
        .with("number", Field::single(0.0))
        .with("count", Field::single(0_u64))
        .with("vertices", Field::vertices(2, vec![0.0; 2 * own]))
        .with("vectors", Field::vectors(&none))
        .with("nodes", Field::nodes(POINTS, None))
        .with("no_nodes", Field::nodes(POINTS, Some([&none, &[Vec3::zeros(); POINTS]])))
        .with("marks", Field::targets(1, vec![0_u8; own_targets(parts).len()]))
        .with("numbers", Field::numbers(2, Vec::new()))
        .with("elements", Field::elements(&ElementRows::new()))
}

/// Expected content of a snapshot, on any ranks.
fn expected() -> Snapshot {
    let vectors: Vec<f64> = (0..CLOTH).flat_map(|own| [f64::from(own), 0.5, -f64::from(own)]).collect();
    let nodes: Vec<f64> = vectors.iter().copied().chain([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).collect();
    let element = |v: u32| [own_number(v), own_number(v + 1), own_number(v + 2), own_number(v + 3)].map(f64::from);
    // In the order of the vertices' own numbers.
    let elements = [40, 10, 3].into_iter().flat_map(|v| element(v).into_iter().chain([f64::from(v), 0.25])).collect();
    let dataset =
        |name: &str, shape: &[usize], values: Values| Dataset { name: name.into(), shape: shape.to_vec(), values };
    let datasets = vec![
        dataset("number", &[1], Values::F64(vec![0.5])),
        dataset("count", &[1], Values::U64(vec![7])),
        dataset("vertices", &[50, 2], Values::F64((0..CLOTH).flat_map(|own| [f64::from(own), 1.0]).collect())),
        dataset("vectors", &[50, 3], Values::F64(vectors)),
        dataset("nodes", &[52, 3], Values::F64(nodes)),
        dataset("no_nodes", &[0, 3], Values::F64(Vec::new())),
        dataset("marks", &[8], Values::U8((0..8).collect())),
        dataset("numbers", &[2, 2], Values::U32(vec![49, 0, CLOTH, 29])),
        dataset("elements", &[3, 6], Values::F64(elements)),
    ];
    Snapshot { sections: vec![Section { name: "room".into(), version: 3, datasets }] }
}

/// Works on ranks of which the first has these parts, and so on.
fn on_ranks(assignment: &[usize], work: impl Fn(&Ranks, &Parts) + Sync) {
    let run = LocalRanks::run(assignment.len() - 1, 1, |communicator| {
        let ranks = Ranks::new(communicator);
        work(&ranks, &parts(&ranks, assignment));
    });
    run.expect("no rank ends early");
}

fn read(parts: &Parts, snapshot: &Snapshot) -> Result<SavedSection, SnapshotError> {
    let (targets, mut snapshot) = (own_targets(parts), snapshot.clone());
    let numbers: Vec<u32> = targets.iter().map(|target| target.number).collect();
    let mut section = blank(parts);
    let source = parts.ranks().is_first().then_some(&mut snapshot as &mut dyn SnapshotSource);
    section.read(parts, TargetNumbers { own: &numbers, all: 8 }, source).map(|()| section)
}

#[test]
fn every_array_is_written_alike_and_comes_back_on_any_ranks() {
    for assignment in [&[0, 6][..], &[0, 2, 6], &[0, 1, 1, 4, 6]] {
        on_ranks(assignment, |ranks, parts| {
            let numbers: Vec<u32> = own_targets(parts).iter().map(|target| target.number).collect();
            let mut snapshot = Snapshot::default();
            let sink = ranks.is_first().then_some(&mut snapshot as &mut dyn SnapshotSink);
            section(parts, false).write(parts, TargetNumbers { own: &numbers, all: 8 }, sink);
            assert!(!ranks.is_first() || snapshot == expected(), "{assignment:?}: {snapshot:?}");
            assert_eq!(read(parts, &expected()), Ok(section(parts, true)), "{assignment:?}");
        });
    }
}

#[test]
fn every_array_goes_where_its_vertices_go() {
    on_ranks(&[0, 1, 1, 4, 6], |ranks, old| {
        let new = parts(ranks, &[0, 0, 3, 4, 6]);
        let mut moved = section(old, false);
        moved.migrate(old, &new, &own_targets(old));
        assert_eq!(moved, section(&new, true));
    });
}

#[test]
fn an_array_that_does_not_fit_is_refused_on_all_ranks_with_the_row() {
    type Change = fn(&mut Dataset);
    let broken: [(usize, Change, &str); 5] = [
        (2, |array| array.shape[0] = 49, "`vertices` has 49 rows, not 50"),
        (2, |array| array.values = Values::U32(vec![0; 100]), "`vertices` is of another type or width"),
        (3, |array| array.values = Values::F64(vec![f64::NAN; 150]), "row 0 of `vectors` is not finite"),
        (
            8,
            |array| array.values = Values::F64([0.5, 1.0, 2.0, 99.0, f64::NAN, 0.0].repeat(3)),
            "`elements` has a vertex",
        ),
        (6, |array| array.shape = vec![7], "`marks` has 7 rows, not 8"),
    ];
    on_ranks(&[0, 1, 1, 4, 6], |_, parts| {
        for (dataset, change, words) in broken {
            let mut snapshot = expected();
            change(&mut snapshot.sections[0].datasets[dataset]);
            let error = read(parts, &snapshot).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
    });
}
