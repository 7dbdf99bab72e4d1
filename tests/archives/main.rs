//! Random trees, types and sample patterns are read back, and interrupting the writer does not change a byte.

use drapery_alembic::*;
use proptest::prelude::*;
use tempfile::TempDir;

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
    [Bool, U8, I8, U16, I16, U32, I32, U64, I64, F16, F32, F64, String, WideString]
};

impl RandomProperty {
    fn data_type(&self) -> DataType {
        DataType::new(PODS[self.type_code], self.extent)
    }

    /// Stored bytes of a sample; arrays of `value` elements, scalars of one, all bytes made from `value`.
    fn payload(&self, value: u8) -> Vec<u8> {
        let elements = if self.is_array { usize::from(value) } else { 1 } * usize::from(self.extent);
        match self.data_type().pod {
            PodType::String => [b'a' + value, 0].repeat(elements),
            PodType::WideString => [b'a' + value, 0, 0, 0, 0, 0, 0, 0].repeat(elements),
            pod => vec![value; elements * pod.size()],
        }
    }
}

fn random_property() -> impl Strategy<Value = RandomProperty> {
    let samples = prop::collection::vec(0..4_u8, 0..12);
    (0..20_usize, any::<bool>(), any::<bool>(), 0..14_usize, 1..5_u8, samples).prop_map(
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
    (prop::collection::vec(0..20_usize, 0..12), prop::collection::vec(random_property(), 0..12))
        .prop_map(|(parents, properties)| RandomArchive { parents, properties })
}

impl RandomArchive {
    /// Declares everything, in an order that is not that of the tree.
    fn declare(&self, archive: &mut ArchiveWriter) -> Vec<PropertyId> {
        let none = MetaData::new();
        let mut objects = vec![archive.root()];
        for (number, parent) in self.parents.iter().enumerate() {
            let metadata = none.clone().with("number", &number.to_string());
            let parent = objects[parent % objects.len()];
            objects.push(archive.add_object(parent, &format!("o{number}"), &metadata).unwrap());
        }
        let mut properties = Vec::new();
        for (number, property) in self.properties.iter().enumerate() {
            let mut parent = archive.top_compound(objects[property.owner % objects.len()]);
            if property.in_compound {
                parent = archive.add_compound(parent, &format!("c{number}"), &none).unwrap();
            }
            let (name, data_type) = (format!("p{number}"), property.data_type());
            properties.push(if property.is_array {
                archive.add_array_property(parent, &name, &none, data_type, 0).unwrap()
            } else {
                archive.add_scalar_property(parent, &name, &none, data_type, 0).unwrap()
            });
        }
        properties
    }

    /// Writes the samples of one round to all properties that have as many.
    fn write_round(&self, archive: &mut ArchiveWriter, properties: &[PropertyId], round: usize) {
        for (property, &id) in self.properties.iter().zip(properties) {
            if let Some(&value) = property.samples.get(round) {
                archive.write_raw_sample(id, &property.payload(value)).unwrap();
            }
        }
        archive.commit(Durability::Flushed).unwrap();
    }

    fn check(&self, archive: &Archive) {
        assert_eq!(archive.objects().count(), self.parents.len());
        let object = |number: usize| match number {
            0 => archive.top(),
            _ => archive.objects().find(|object| object.name() == format!("o{}", number - 1)).unwrap(),
        };
        for (number, parent) in self.parents.iter().enumerate() {
            let parent = object(parent % (number + 1));
            assert_eq!(object(number + 1).parent().unwrap().path(), parent.path());
            assert_eq!(object(number + 1).metadata().get("number"), Some(&*number.to_string()));
        }
        for (number, property) in self.properties.iter().enumerate() {
            let mut compound = object(property.owner % (self.parents.len() + 1)).properties().unwrap();
            if property.in_compound {
                compound = compound.compound(&format!("c{number}")).unwrap().clone();
            }
            let samples = compound.samples(&format!("p{number}")).unwrap();
            assert_eq!((samples.is_array(), samples.data_type()), (property.is_array, property.data_type()));
            assert_eq!(samples.len(), property.samples.len());
            for (index, &value) in property.samples.iter().enumerate() {
                assert_eq!(samples.raw(index).unwrap(), property.payload(value), "{property:?} {index}");
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
        let whole_ids = random.declare(&mut whole);
        let mut part_ids = random.declare(&mut parts);
        for round in 0..12 {
            random.write_round(&mut whole, &whole_ids, round);
            random.write_round(&mut parts, &part_ids, round);
            if round == stop {
                let (path, end) = (parts.path().to_owned(), parts.mark().unwrap().end as usize);
                drop(parts);
                // A killed writer may leave half a frame behind.
                let mut left = std::fs::read(&path).unwrap();
                left[end..end + 77].fill(0xab);
                std::fs::write(&path, left).unwrap();
                parts = ArchiveWriter::append(&path).unwrap();
                part_ids = random.declare(&mut parts);
            }
        }
        let path = [&whole, &parts].map(|archive| archive.path().to_owned());
        parts.finish(Durability::Flushed).unwrap();
        let whole = reopened(whole);
        let bytes = path.each_ref().map(|path| std::fs::read(path).unwrap());
        prop_assert!(bytes[0] == bytes[1], "the continued archive has other bytes");
        random.check(&whole);
    }

    #[test]
    fn random_archives_do_not_depend_on_what_was_written_after_the_mark(
        random in random_archive(),
        back in 0..11_usize,
        further in 1..4_usize,
        other_values in any::<bool>(),
    ) {
        let folder = folder();
        let mut whole = new_archive(&folder, "whole.abc");
        let mut parts = new_archive(&folder, "parts.abc");
        let whole_ids = random.declare(&mut whole);
        let part_ids = random.declare(&mut parts);
        for round in 0..=back {
            random.write_round(&mut parts, &part_ids, round);
        }
        let mark = parts.mark().unwrap();
        for round in back + 1..=back + further {
            random.write_round(&mut parts, &part_ids, if other_values { back - back / 2 } else { round });
        }
        let path = parts.path().to_owned();
        drop(parts);
        let (mut parts, part_ids) =
            ArchiveWriter::resume(&path, &ArchiveOptions::default(), &mark, |archive| Ok(random.declare(archive)))
                .unwrap();
        for round in 0..12 {
            random.write_round(&mut whole, &whole_ids, round);
            if round > back {
                random.write_round(&mut parts, &part_ids, round);
            }
        }
        let marks = [&whole, &parts].map(|archive| archive.mark());
        prop_assert_eq!(marks[0], marks[1]);
        let path = [whole.path().to_owned(), path];
        whole.finish(Durability::Flushed).unwrap();
        parts.finish(Durability::Flushed).unwrap();
        let bytes = path.each_ref().map(|path| std::fs::read(path).unwrap());
        prop_assert!(bytes[0] == bytes[1], "the continued archive has other bytes");
        random.check(&Archive::open(&path[1]).unwrap());
    }
}
