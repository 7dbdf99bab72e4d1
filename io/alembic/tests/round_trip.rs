//! Reading gives back all that was written, whatever the tree, the types and the order of repeated samples.

use drapery_alembic::*;
use tempfile::TempDir;

const INT: DataType = DataType::new(PodType::I32, 1);

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn new_archive(folder: &TempDir, name: &str) -> ArchiveWriter {
    ArchiveWriter::create(folder.path().join(name), &ArchiveOptions::default()).unwrap()
}

/// Finishes the archive and opens it again.
fn reopened(archive: ArchiveWriter) -> Archive {
    let path = archive.path().to_owned();
    archive.finish(Durability::Flushed).unwrap();
    Archive::open(path).unwrap()
}

#[test]
fn every_pattern_of_up_to_six_samples_over_three_values_is_found_again() {
    let folder = folder();
    let mut archive = new_archive(&folder, "patterns.abc");
    let top = archive.top_compound(archive.root());
    let none = MetaData::new();
    let mut patterns = Vec::new();
    for length in 1..=6_u32 {
        for code in 0..3_i32.pow(length) {
            patterns.push((0..length).map(|digit| code / 3_i32.pow(digit) % 3).collect::<Vec<i32>>());
        }
    }
    assert_eq!(patterns.len(), 1092);
    for (number, values) in patterns.iter().enumerate() {
        let scalar = archive.add_scalar_property(top, &format!("s{number}"), &none, INT, 0).unwrap();
        let array = archive.add_array_property(top, &format!("a{number}"), &none, INT, 0).unwrap();
        for &value in values {
            archive.write_sample(scalar, &[value]).unwrap();
            archive.write_sample(array, &vec![value; value as usize]).unwrap();
        }
    }
    let properties = reopened(archive).top().properties().unwrap();
    for (number, values) in patterns.iter().enumerate() {
        let scalar = properties.samples(&format!("s{number}")).unwrap();
        let array = properties.samples(&format!("a{number}")).unwrap();
        let constant = values.iter().all(|value| *value == values[0]);
        assert_eq!((scalar.len(), array.len()), (values.len(), values.len()));
        assert_eq!((scalar.is_constant(), array.is_constant()), (constant, constant), "{values:?}");
        for (index, &value) in values.iter().enumerate() {
            assert_eq!(scalar.values::<i32>(index).unwrap(), [value], "{values:?} {index}");
            assert_eq!(array.values::<i32>(index).unwrap(), vec![value; value as usize], "{values:?} {index}");
        }
    }
}

#[test]
fn more_samples_than_sixteen_bits_can_count_are_found_again() {
    let folder = folder();
    let mut archive = new_archive(&folder, "many.abc");
    let top = archive.top_compound(archive.root());
    let property = archive.add_scalar_property(top, "count", &MetaData::new(), INT, 0).unwrap();
    for index in 0..70_000 {
        archive.write_sample(property, &[index / 3]).unwrap();
    }
    let properties = reopened(archive).top().properties().unwrap();
    let samples = properties.samples("count").unwrap();
    assert_eq!(samples.len(), 70_000);
    for index in [0, 2, 3, 255, 256, 65_535, 65_536, 69_999] {
        assert_eq!(samples.values::<i32>(index).unwrap(), [index as i32 / 3]);
    }
}

#[test]
fn three_hundred_metadata_texts_and_long_names_are_found_again() {
    let folder = folder();
    let mut archive = new_archive(&folder, "texts.abc");
    let top = archive.top_compound(archive.root());
    let text = |number: usize| MetaData::new().with("number", &number.to_string().repeat(1 + number % 97));
    let name = |number: usize| format!("{number}_{}", "n".repeat(number));
    let root = archive.root();
    for number in 0..300 {
        archive.add_scalar_property(top, &name(number), &text(number), INT, 0).unwrap();
        archive.add_object(root, &name(number), &text(number)).unwrap();
    }
    let long = MetaData::new().with("long", &"x".repeat(70_000));
    archive.add_compound(top, "long", &long).unwrap();
    let archive = reopened(archive);
    let properties = archive.top().properties().unwrap();
    for number in 0..300 {
        assert_eq!(properties.property(&name(number)).unwrap().metadata(), &text(number));
        assert_eq!(archive.object(&name(number)).unwrap().metadata(), &text(number));
    }
    assert_eq!(properties.property("long").unwrap().metadata(), &long);
}

#[test]
fn strings_keep_their_number_and_text() {
    let folder = folder();
    let mut archive = new_archive(&folder, "strings.abc");
    let top = archive.top_compound(archive.root());
    let text = DataType::new(PodType::String, 1);
    let array = archive.add_array_property(top, "array", &MetaData::new(), text, 0).unwrap();
    let samples: [&[&str]; 4] = [&["wool", "", "Grüße"], &[], &[""], &["wool", "", "Grüße"]];
    for strings in samples {
        archive.write_string_sample(array, strings).unwrap();
    }
    archive.write_static_string(top, "scalar", "one").unwrap();
    assert!(archive.write_string_sample(array, &["a\0b"]).is_err());
    let properties = reopened(archive).top().properties().unwrap();
    for (index, strings) in samples.iter().enumerate() {
        assert_eq!(properties.samples("array").unwrap().strings(index).unwrap(), *strings);
    }
    assert_eq!(properties.samples("scalar").unwrap().strings(0).unwrap(), ["one"]);
}

#[test]
fn equal_payloads_are_stored_once() {
    let folder = folder();
    let sizes = [1, 50].map(|copies| {
        let mut archive = new_archive(&folder, "copies.abc");
        let top = archive.top_compound(archive.root());
        for copy in 0..copies {
            let name = format!("p{copy:02}");
            let property = archive.add_array_property(top, &name, &MetaData::new(), INT, 0).unwrap();
            archive.write_sample(property, &[copy / 100; 10_000]).unwrap();
        }
        let path = archive.path().to_owned();
        archive.finish(Durability::Flushed).unwrap();
        std::fs::metadata(path).unwrap().len()
    });
    assert!(sizes[1] < sizes[0] + 50 * 100, "{sizes:?}"); // headers and slots only
}

#[test]
fn all_forms_of_time_sampling_are_found_again() {
    let folder = folder();
    let mut archive = new_archive(&folder, "times.abc");
    let forms = [
        TimeSampling::frames(1001.0, 24.0).unwrap(),
        TimeSampling::cyclic(1.0 / 24.0, vec![0.0, 0.01, 0.02]).unwrap(),
        TimeSampling::acyclic(vec![-1.0, 0.0, 0.5]).unwrap(),
    ];
    let top = archive.top_compound(archive.root());
    for (number, form) in forms.iter().enumerate() {
        let index = archive.add_time_sampling(form.clone()).unwrap();
        assert_eq!(index as usize, number + 1);
        assert_eq!(archive.add_time_sampling(form.clone()).unwrap(), index, "equal samplings share an index");
        let property = archive.add_scalar_property(top, &format!("p{number}"), &MetaData::new(), INT, index).unwrap();
        for value in 0..3 {
            archive.write_sample(property, &[value]).unwrap();
        }
        let fourth = archive.write_sample(property, &[3]);
        assert_eq!(fourth.is_err(), form.kind() == SamplingKind::Acyclic, "acyclic times are used up");
    }
    let archive = reopened(archive);
    let top = archive.top().properties().unwrap();
    let sampling = |number: usize| top.samples(&format!("p{number}")).unwrap().time_sampling().clone();
    let stored: Vec<TimeSampling> = (0..forms.len()).map(sampling).collect();
    assert_eq!(stored, forms);
    assert_eq!([1, 2, 3].map(|index| archive.max_samples(index)), [Some(4), Some(4), Some(3)]);
}

#[test]
fn what_cannot_be_stored_is_refused_with_the_place() {
    let folder = folder();
    let mut archive = new_archive(&folder, "refused.abc");
    let (root, none) = (archive.root(), MetaData::new());
    let body = archive.add_object(root, "body", &none).unwrap();
    assert!(archive.add_object(root, "body", &none).unwrap_err().to_string().contains("/body"));
    assert!(archive.add_object(root, "a/b", &none).is_err());
    assert!(archive.add_object(root, "", &none).is_err());
    let top = archive.top_compound(body);
    assert!(archive.add_scalar_property(top, "p", &none, INT, 5).is_err(), "unknown time sampling");
    let property = archive.add_scalar_property(top, "p", &none, INT, 0).unwrap();
    let message = archive.write_sample(property, &[1_i32, 2]).unwrap_err().to_string();
    assert!(message.contains("/body:p") && message.contains("sample 0"), "{message}");
    assert!(archive.write_sample(property, &[1.0_f32]).is_err(), "another type");
    assert!(archive.set_same_as_previous(property).is_err(), "there is no previous sample");
}

/// Declares a transform with any list of operations; samples are its channels.
fn add_xform(
    archive: &mut ArchiveWriter,
    parent: ObjectId,
    name: &str,
    (ops, inherits): (&[u8], bool),
    samples: &[&[f64]],
) -> ObjectId {
    let metadata = MetaData::new().with("schema", "AbcGeom_Xform_v3");
    let object = archive.add_object(parent, name, &metadata).unwrap();
    let top = archive.top_compound(object);
    let compound = archive.add_compound(top, ".xform", &metadata).unwrap();
    archive.write_static_scalar(compound, ".inherits", &[inherits]).unwrap();
    archive.write_static_scalar(compound, ".ops", ops).unwrap();
    let channels = DataType::new(PodType::F64, samples[0].len() as u8);
    let sampling = archive.add_time_sampling(TimeSampling::uniform(0.0, 1.0).unwrap()).unwrap();
    let values = archive.add_scalar_property(compound, ".vals", &MetaData::new(), channels, sampling).unwrap();
    for sample in samples {
        archive.write_sample(values, sample).unwrap();
    }
    object
}

#[test]
fn a_transform_that_does_not_inherit_ignores_its_parents() {
    const TRANSLATE: u8 = 0x10;
    let folder = folder();
    let mut archive = new_archive(&folder, "inherits.abc");
    let root = archive.root();
    let parent = add_xform(&mut archive, root, "parent", (&[TRANSLATE], true), &[&[1.0, 0.0, 0.0]]);
    add_xform(&mut archive, parent, "follows", (&[TRANSLATE], true), &[&[0.0, 2.0, 0.0]]);
    add_xform(&mut archive, parent, "stays", (&[TRANSLATE], false), &[&[0.0, 2.0, 0.0]]);
    let archive = reopened(archive);
    let place = |path: &str| world_matrix_at(&archive.object(path).unwrap(), 0.0).unwrap()[12..15].to_vec();
    assert_eq!(place("/parent/follows"), [1.0, 2.0, 0.0]);
    assert_eq!(place("/parent/stays"), [0.0, 2.0, 0.0]);
}

#[test]
fn angles_are_interpolated_between_the_samples_of_a_transform() {
    const ROTATE_Z: u8 = 0x60;
    let folder = folder();
    let mut archive = new_archive(&folder, "turns.abc");
    let root = archive.root();
    add_xform(&mut archive, root, "turns", (&[ROTATE_Z], true), &[&[0.0], &[90.0]]);
    let archive = reopened(archive);
    let matrix = world_matrix_at(&archive.object("/turns").unwrap(), 0.5).unwrap();
    let turned = transform_point([1.0, 0.0, 0.0], &matrix);
    assert!((turned[0] - 0.5_f64.sqrt()).abs() < 1e-15 && (turned[1] - 0.5_f64.sqrt()).abs() < 1e-15, "{turned:?}");
}

#[test]
fn a_mesh_that_contradicts_itself_is_refused_before_anything_is_stored() {
    let folder = folder();
    let mut archive = new_archive(&folder, "mesh.abc");
    let root = archive.root();
    let mut mesh = PolyMeshWriter::declare(&mut archive, root, "mesh", 0).unwrap();
    let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let good = Topology { face_counts: &[3], face_indices: &[0, 1, 2] };
    let sample = PolyMeshSample { topology: Some(good), ..PolyMeshSample::of(&positions) };
    let uv = Indexed { values: &[[0.0; 2]], indices: Some(&[0, 0]), scope: Scope::FaceVarying, source_name: None };
    for (what, bad) in [
        ("no faces", PolyMeshSample { topology: None, ..sample }),
        ("vertex 3", PolyMeshSample { topology: Some(Topology { face_indices: &[0, 1, 3], ..good }), ..sample }),
        ("4 corners", PolyMeshSample { topology: Some(Topology { face_counts: &[4], ..good }), ..sample }),
        ("velocities", PolyMeshSample { velocities: Some(&positions[..2]), ..sample }),
        ("UV index 1 of 1", PolyMeshSample { uv: Some(Indexed { indices: Some(&[0, 0, 1]), ..uv }), ..sample }),
        ("two UVs", PolyMeshSample { uv: Some(uv), ..sample }),
    ] {
        assert!(mesh.write(&mut archive, &bad).is_err(), "{what}");
    }
    mesh.write(&mut archive, &sample).unwrap();
    let later = PolyMeshSample { velocities: Some(&positions), ..PolyMeshSample::of(&positions) };
    assert!(mesh.write(&mut archive, &later).is_err(), "velocities from the second sample on");
    let mesh = PolyMesh::open(&reopened(archive), "/mesh").unwrap();
    assert_eq!(mesh.sample_count(), 1);
    assert_eq!(mesh.positions(0).unwrap(), positions);
}
