//! What is written is read back, whatever the tree, the types and the order of repeated samples.

use drapery_alembic::*;
use proptest::prelude::*;
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
            patterns.push(
                (0..length)
                    .map(|digit| code / 3_i32.pow(digit) % 3)
                    .collect::<Vec<i32>>(),
            );
        }
    }
    assert_eq!(patterns.len(), 1092);
    for (number, values) in patterns.iter().enumerate() {
        let scalar = archive
            .add_scalar_property(top, &format!("s{number}"), &none, INT, 0)
            .unwrap();
        let array = archive
            .add_array_property(top, &format!("a{number}"), &none, INT, 0)
            .unwrap();
        for &value in values {
            archive.write_sample(scalar, &[value]).unwrap();
            archive
                .write_sample(array, &vec![value; value as usize])
                .unwrap();
        }
    }
    let properties = reopened(archive).top().properties().unwrap();
    for (number, values) in patterns.iter().enumerate() {
        let scalar = properties.samples(&format!("s{number}")).unwrap();
        let array = properties.samples(&format!("a{number}")).unwrap();
        let constant = values.iter().all(|value| *value == values[0]);
        assert_eq!((scalar.len(), array.len()), (values.len(), values.len()));
        assert_eq!(
            (scalar.is_constant(), array.is_constant()),
            (constant, constant),
            "{values:?}"
        );
        for (index, &value) in values.iter().enumerate() {
            assert_eq!(
                scalar.values::<i32>(index).unwrap(),
                [value],
                "{values:?} {index}"
            );
            assert_eq!(
                array.values::<i32>(index).unwrap(),
                vec![value; value as usize],
                "{values:?} {index}"
            );
        }
    }
}

#[test]
fn more_samples_than_sixteen_bits_can_count_are_found_again() {
    let folder = folder();
    let mut archive = new_archive(&folder, "many.abc");
    let top = archive.top_compound(archive.root());
    let property = archive
        .add_scalar_property(top, "count", &MetaData::new(), INT, 0)
        .unwrap();
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
    let text =
        |number: usize| MetaData::new().with("number", &number.to_string().repeat(1 + number % 97));
    let name = |number: usize| format!("{number}_{}", "n".repeat(number));
    let root = archive.root();
    for number in 0..300 {
        archive
            .add_scalar_property(top, &name(number), &text(number), INT, 0)
            .unwrap();
        archive
            .add_object(root, &name(number), &text(number))
            .unwrap();
    }
    let long = MetaData::new().with("long", &"x".repeat(70_000));
    archive.add_compound(top, "long", &long).unwrap();
    let archive = reopened(archive);
    let properties = archive.top().properties().unwrap();
    for number in 0..300 {
        assert_eq!(
            properties.property(&name(number)).unwrap().metadata(),
            &text(number)
        );
        assert_eq!(
            archive.object(&name(number)).unwrap().metadata(),
            &text(number)
        );
    }
    assert_eq!(properties.property("long").unwrap().metadata(), &long);
}

#[test]
fn strings_keep_their_number_and_text() {
    let folder = folder();
    let mut archive = new_archive(&folder, "strings.abc");
    let top = archive.top_compound(archive.root());
    let text = DataType::new(PodType::String, 1);
    let array = archive
        .add_array_property(top, "array", &MetaData::new(), text, 0)
        .unwrap();
    let samples: [&[&str]; 4] = [&["wool", "", "Grüße"], &[], &[""], &["wool", "", "Grüße"]];
    for strings in samples {
        archive.write_string_sample(array, strings).unwrap();
    }
    archive.write_static_string(top, "scalar", "one").unwrap();
    assert!(archive.write_string_sample(array, &["a\0b"]).is_err());
    let properties = reopened(archive).top().properties().unwrap();
    for (index, strings) in samples.iter().enumerate() {
        assert_eq!(
            properties.samples("array").unwrap().strings(index).unwrap(),
            *strings
        );
    }
    assert_eq!(
        properties.samples("scalar").unwrap().strings(0).unwrap(),
        ["one"]
    );
}

#[test]
fn equal_payloads_are_stored_once() {
    let folder = folder();
    let sizes = [1, 50].map(|copies| {
        let mut archive = new_archive(&folder, "copies.abc");
        let top = archive.top_compound(archive.root());
        for copy in 0..copies {
            let name = format!("p{copy:02}");
            let property = archive
                .add_array_property(top, &name, &MetaData::new(), INT, 0)
                .unwrap();
            archive
                .write_sample(property, &[copy / 100; 10_000])
                .unwrap();
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
        assert_eq!(
            archive.add_time_sampling(form.clone()).unwrap(),
            index,
            "equal samplings share an index"
        );
        let property = archive
            .add_scalar_property(top, &format!("p{number}"), &MetaData::new(), INT, index)
            .unwrap();
        for value in 0..3 {
            archive.write_sample(property, &[value]).unwrap();
        }
        let fourth = archive.write_sample(property, &[3]);
        assert_eq!(
            fourth.is_err(),
            form.kind() == SamplingKind::Acyclic,
            "acyclic times are used up"
        );
    }
    let archive = reopened(archive);
    let stored: Vec<TimeSampling> = archive.time_samplings().skip(1).cloned().collect();
    assert_eq!(stored, forms);
    assert_eq!(
        [1, 2, 3].map(|index| archive.max_samples(index)),
        [Some(4), Some(4), Some(3)]
    );
}

#[test]
fn what_cannot_be_stored_is_refused_with_the_place() {
    let folder = folder();
    let mut archive = new_archive(&folder, "refused.abc");
    let (root, none) = (archive.root(), MetaData::new());
    let body = archive.add_object(root, "body", &none).unwrap();
    assert!(
        archive
            .add_object(root, "body", &none)
            .unwrap_err()
            .to_string()
            .contains("/body")
    );
    assert!(archive.add_object(root, "a/b", &none).is_err());
    assert!(archive.add_object(root, "", &none).is_err());
    let top = archive.top_compound(body);
    assert!(
        archive
            .add_scalar_property(top, "p", &none, INT, 5)
            .is_err(),
        "unknown time sampling"
    );
    let property = archive
        .add_scalar_property(top, "p", &none, INT, 0)
        .unwrap();
    let message = archive
        .write_sample(property, &[1_i32, 2])
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("/body:p") && message.contains("sample 0"),
        "{message}"
    );
    assert!(
        archive.write_sample(property, &[1.0_f32]).is_err(),
        "another type"
    );
    assert!(
        archive.set_same_as_previous(property).is_err(),
        "there is no previous sample"
    );
}

#[test]
fn a_mesh_that_contradicts_itself_is_refused_before_anything_is_stored() {
    let folder = folder();
    let mut archive = new_archive(&folder, "mesh.abc");
    let root = archive.root();
    let mut mesh = PolyMeshWriter::declare(&mut archive, root, "mesh", 0).unwrap();
    let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let good = Topology {
        face_counts: &[3],
        face_indices: &[0, 1, 2],
    };
    let sample = PolyMeshSample {
        topology: Some(good),
        ..PolyMeshSample::of(&positions)
    };
    let uv = Indexed {
        values: &[[0.0; 2]],
        indices: Some(&[0, 0]),
        scope: Scope::FaceVarying,
        source_name: None,
    };
    for (what, bad) in [
        (
            "no faces",
            PolyMeshSample {
                topology: None,
                ..sample
            },
        ),
        (
            "vertex 3",
            PolyMeshSample {
                topology: Some(Topology {
                    face_indices: &[0, 1, 3],
                    ..good
                }),
                ..sample
            },
        ),
        (
            "4 corners",
            PolyMeshSample {
                topology: Some(Topology {
                    face_counts: &[4],
                    ..good
                }),
                ..sample
            },
        ),
        (
            "velocities",
            PolyMeshSample {
                velocities: Some(&positions[..2]),
                ..sample
            },
        ),
        (
            "two UVs",
            PolyMeshSample {
                uv: Some(uv),
                ..sample
            },
        ),
    ] {
        assert!(mesh.write(&mut archive, &bad).is_err(), "{what}");
    }
    mesh.write(&mut archive, &sample).unwrap();
    let later = PolyMeshSample {
        velocities: Some(&positions),
        ..PolyMeshSample::of(&positions)
    };
    assert!(
        mesh.write(&mut archive, &later).is_err(),
        "velocities from the second sample on"
    );
    let mesh = PolyMesh::open(&reopened(archive), "/mesh").unwrap();
    assert_eq!(mesh.sample_count(), 1);
    assert_eq!(mesh.positions(0).unwrap(), positions);
}

/// A property of a random archive: owner, type and the samples as indices into a pool of payloads.
#[derive(Debug, Clone)]
struct RandomProperty {
    owner: usize,
    in_compound: bool,
    is_array: bool,
    type_code: usize,
    extent: u8,
    samples: Vec<u8>,
}

const PODS: [PodType; 14] = {
    use PodType::*;
    [
        Bool, U8, I8, U16, I16, U32, I32, U64, I64, F16, F32, F64, String, WideString,
    ]
};

impl RandomProperty {
    fn data_type(&self) -> DataType {
        DataType::new(PODS[self.type_code], self.extent)
    }

    /// Stored bytes of a sample; arrays of `value` elements, scalars of one, all bytes made from `value`.
    fn payload(&self, value: u8) -> Vec<u8> {
        let elements =
            if self.is_array { usize::from(value) } else { 1 } * usize::from(self.extent);
        match self.data_type().pod {
            PodType::String => [b'a' + value, 0].repeat(elements),
            PodType::WideString => [b'a' + value, 0, 0, 0, 0, 0, 0, 0].repeat(elements),
            pod => vec![value; elements * pod.size()],
        }
    }
}

fn random_property() -> impl Strategy<Value = RandomProperty> {
    let samples = prop::collection::vec(0..4_u8, 0..12);
    (
        0..20_usize,
        any::<bool>(),
        any::<bool>(),
        0..14_usize,
        1..5_u8,
        samples,
    )
        .prop_map(
            |(owner, in_compound, is_array, type_code, extent, samples)| RandomProperty {
                owner,
                in_compound,
                is_array,
                type_code,
                extent,
                samples,
            },
        )
}

#[derive(Debug, Clone)]
struct RandomArchive {
    /// Parent of each object, among the objects before it.
    parents: Vec<usize>,
    properties: Vec<RandomProperty>,
}

fn random_archive() -> impl Strategy<Value = RandomArchive> {
    (
        prop::collection::vec(0..20_usize, 0..12),
        prop::collection::vec(random_property(), 0..12),
    )
        .prop_map(|(parents, properties)| RandomArchive {
            parents,
            properties,
        })
}

impl RandomArchive {
    /// Declares everything, in an order that is not that of the tree.
    fn declare(&self, archive: &mut ArchiveWriter) -> Vec<PropertyId> {
        let none = MetaData::new();
        let mut objects = vec![archive.root()];
        for (number, parent) in self.parents.iter().enumerate() {
            let metadata = none.clone().with("number", &number.to_string());
            let parent = objects[parent % objects.len()];
            objects.push(
                archive
                    .add_object(parent, &format!("o{number}"), &metadata)
                    .unwrap(),
            );
        }
        let mut properties = Vec::new();
        for (number, property) in self.properties.iter().enumerate() {
            let mut parent = archive.top_compound(objects[property.owner % objects.len()]);
            if property.in_compound {
                parent = archive
                    .add_compound(parent, &format!("c{number}"), &none)
                    .unwrap();
            }
            let (name, data_type) = (format!("p{number}"), property.data_type());
            properties.push(if property.is_array {
                archive
                    .add_array_property(parent, &name, &none, data_type, 0)
                    .unwrap()
            } else {
                archive
                    .add_scalar_property(parent, &name, &none, data_type, 0)
                    .unwrap()
            });
        }
        properties
    }

    /// Writes the samples of one round to all properties that have so many.
    fn write_round(&self, archive: &mut ArchiveWriter, properties: &[PropertyId], round: usize) {
        for (property, &id) in self.properties.iter().zip(properties) {
            if let Some(&value) = property.samples.get(round) {
                archive
                    .write_raw_sample(id, &property.payload(value))
                    .unwrap();
            }
        }
        archive.commit(Durability::Flushed).unwrap();
    }

    fn check(&self, archive: &Archive) {
        assert_eq!(archive.objects().count(), self.parents.len());
        let object = |number: usize| match number {
            0 => archive.top(),
            _ => archive
                .objects()
                .find(|object| object.name() == format!("o{}", number - 1))
                .unwrap(),
        };
        for (number, parent) in self.parents.iter().enumerate() {
            let parent = object(parent % (number + 1));
            assert_eq!(object(number + 1).parent().unwrap().path(), parent.path());
            assert_eq!(
                object(number + 1).metadata().get("number"),
                Some(&*number.to_string())
            );
        }
        for (number, property) in self.properties.iter().enumerate() {
            let mut compound = object(property.owner % (self.parents.len() + 1))
                .properties()
                .unwrap();
            if property.in_compound {
                compound = compound.compound(&format!("c{number}")).unwrap().clone();
            }
            let samples = compound.samples(&format!("p{number}")).unwrap();
            assert_eq!(
                (samples.is_array(), samples.data_type()),
                (property.is_array, property.data_type())
            );
            assert_eq!(samples.len(), property.samples.len());
            for (index, &value) in property.samples.iter().enumerate() {
                assert_eq!(
                    samples.raw(index).unwrap(),
                    property.payload(value),
                    "{property:?} {index}"
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_archives_are_found_again_and_do_not_depend_on_interruptions(
        random in random_archive(),
        stop in 0..12_usize,
    ) {
        let folder = folder();
        let mut whole = new_archive(&folder, "whole.abc");
        let mut parts = new_archive(&folder, "parts.abc");
        let mut whole_ids = random.declare(&mut whole);
        let mut part_ids = random.declare(&mut parts);
        for round in 0..12 {
            random.write_round(&mut whole, &whole_ids, round);
            random.write_round(&mut parts, &part_ids, round);
            if round == stop {
                let path = parts.path().to_owned();
                drop(parts);
                // A killed writer may leave half a frame behind.
                let mut left = std::fs::read(&path).unwrap();
                left.extend([0xab; 77]);
                std::fs::write(&path, left).unwrap();
                parts = ArchiveWriter::append(&path).unwrap();
                part_ids = random.declare(&mut parts);
            }
        }
        whole_ids.clear();
        part_ids.clear();
        let bytes = [&whole, &parts].map(|archive| std::fs::read(archive.path()).unwrap());
        prop_assert!(bytes[0] == bytes[1], "the continued archive has other bytes");
        random.check(&reopened(whole));
    }
}
