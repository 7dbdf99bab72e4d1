//! Properties of objects: compounds, and the samples of scalars and arrays.

use std::ops::Range;
use std::sync::Arc;

use super::open_file::{Budget, Shared};
use super::tables::sample_group_size;
use crate::error::{AlembicError, Fault};
use crate::metadata::MetaData;
use crate::murmur::murmur3_x64_128;
use crate::ogawa::{Group, Slot};
use crate::packed::{PackedSamples, unpack_properties};
use crate::property::{DataType, PodValue, decode, decode_strings};
use crate::time_sampling::TimeSampling;

/// Compounds may be nested this deep.
const DEEPEST: usize = 200;
/// Most samples that a property may have of which not all are stored: twelve hours at 24 frames per second.
const MOST_REPEATED: u32 = 1 << 20;
/// Bytes of the digest before every payload.
const DIGEST: u64 = 16;

/// Properties under a common name, in stored order.
#[derive(Debug, Clone, Default)]
pub struct Compound {
    properties: Vec<Property>,
}

/// One property of a compound.
#[derive(Debug, Clone)]
pub struct Property {
    name: String,
    metadata: MetaData,
    kind: PropertyKind,
}

/// Content of a property.
#[derive(Debug, Clone)]
pub enum PropertyKind {
    /// Further properties.
    Compound(Compound),
    /// One element a sample.
    Scalar(Samples),
    /// Any number of elements a sample.
    Array(Samples),
}

/// The samples of a scalar or array property; payloads are read when asked for.
#[derive(Debug, Clone)]
pub struct Samples {
    shared: Arc<Shared>,
    group: Group,
    header: PackedSamples,
    place: Arc<str>,
}

impl Compound {
    pub(super) fn of_group(shared: &Arc<Shared>, object: Group, path: &str) -> Result<Self, AlembicError> {
        let at = |fault: Fault| fault.at(&shared.source.path, path);
        if object.count == 0 {
            return Ok(Self::default());
        }
        let slot = shared.source.child(object, 0).map_err(at)?;
        if slot.is_data() {
            return Ok(Self::default()); // an object without properties whose only entry is the header blob
        }
        let group = shared.source.group(slot).map_err(at)?;
        let mut budget = Budget::for_file(shared.source.length);
        Self::read(shared, group, &format!("{path}:"), 0, &mut budget)
    }

    fn read(
        shared: &Arc<Shared>,
        group: Group,
        place: &str,
        depth: usize,
        budget: &mut Budget,
    ) -> Result<Self, AlembicError> {
        let source = &shared.source;
        let at = |fault: Fault| fault.at(&source.path, place);
        if depth > DEEPEST {
            return Err(at(Fault::damaged(format!("compounds are nested more than {DEEPEST} deep"))));
        }
        let slots = source.children(group).map_err(at)?;
        let Some((&last, slots)) = slots.split_last() else {
            return Ok(Self::default());
        };
        let blob = source.data(last).map_err(at)?;
        budget.spend(blob.len() + 8 * slots.len()).map_err(at)?;
        let headers = unpack_properties(&blob, &shared.tables.texts).map_err(at)?;
        if headers.len() > slots.len() {
            let reason = format!("{} property headers for {} properties", headers.len(), slots.len());
            return Err(at(Fault::Damaged(reason)));
        }
        let mut properties = Vec::with_capacity(headers.len());
        for (header, &slot) in headers.into_iter().zip(slots) {
            let place = format!("{place}{}", header.name);
            budget.spend(place.len()).map_err(at)?;
            let group = source.group(slot).map_err(|fault| fault.at(&source.path, &place))?;
            let kind = match header.samples {
                None => {
                    let inside = Self::read(shared, group, &format!("{place}/"), depth + 1, budget)?;
                    PropertyKind::Compound(inside)
                }
                Some(samples) => {
                    let samples = Samples::checked(shared, group, samples, &place)?;
                    if samples.header.is_array { PropertyKind::Array(samples) } else { PropertyKind::Scalar(samples) }
                }
            };
            properties.push(Property { name: header.name, metadata: MetaData::parse(&header.metadata), kind });
        }
        Ok(Self { properties })
    }

    /// All properties in stored order.
    pub fn iter(&self) -> impl Iterator<Item = &Property> {
        self.properties.iter()
    }

    /// The first property of this name.
    pub fn property(&self, name: &str) -> Option<&Property> {
        self.properties.iter().find(|property| property.name == name)
    }

    /// The compound of this name.
    pub fn compound(&self, name: &str) -> Option<&Compound> {
        match self.property(name)?.kind() {
            PropertyKind::Compound(compound) => Some(compound),
            _ => None,
        }
    }

    /// Checks the digests of all properties that do not change, with those in compounds inside.
    ///
    /// Fails at the first that is damaged.
    pub(super) fn check_constants(&self) -> Result<(), AlembicError> {
        self.properties.iter().try_for_each(|property| match property.kind() {
            PropertyKind::Compound(inside) => inside.check_constants(),
            PropertyKind::Scalar(samples) | PropertyKind::Array(samples)
                if samples.is_constant() && !samples.is_empty() =>
            {
                samples.check_digest(0)
            }
            PropertyKind::Scalar(_) | PropertyKind::Array(_) => Ok(()),
        })
    }

    /// The samples of the scalar or array property of this name.
    pub fn samples(&self, name: &str) -> Option<&Samples> {
        match self.property(name)?.kind() {
            PropertyKind::Compound(_) => None,
            PropertyKind::Scalar(samples) | PropertyKind::Array(samples) => Some(samples),
        }
    }
}

impl Property {
    /// Name, unique in its compound.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Metadata.
    pub fn metadata(&self) -> &MetaData {
        &self.metadata
    }

    /// Returns the content of the property.
    pub fn kind(&self) -> &PropertyKind {
        &self.kind
    }
}

impl Samples {
    fn checked(shared: &Arc<Shared>, group: Group, header: PackedSamples, place: &str) -> Result<Self, AlembicError> {
        let damaged = |reason: String| Err(Fault::Damaged(reason).at(&shared.source.path, place));
        if header.time_sampling as usize >= shared.tables.samplings.len() {
            return damaged(format!("time sampling {} is not in the archive", header.time_sampling));
        }
        let wanted = sample_group_size(&header);
        if group.count < wanted {
            return damaged(format!("{} slots are stored where {wanted} are needed", group.count));
        }
        // Equal samples at the end are stored once, so the number of samples may be far larger than what is stored.
        if header.count > MOST_REPEATED && header.count as usize > wanted {
            return damaged(format!("{} samples, of which {} are stored", header.count, header.stored_count()));
        }
        Ok(Self { shared: shared.clone(), group, header, place: place.into() })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.header.count as usize
    }

    /// True when there are no samples.
    pub fn is_empty(&self) -> bool {
        self.header.count == 0
    }

    /// True when all samples are equal, or there are none.
    pub fn is_constant(&self) -> bool {
        self.header.is_constant()
    }

    /// True for an array property.
    pub fn is_array(&self) -> bool {
        self.header.is_array
    }

    /// Type of the elements.
    pub fn data_type(&self) -> DataType {
        self.header.data_type
    }

    /// Index of the time sampling in the archive.
    pub fn time_sampling_index(&self) -> usize {
        self.header.time_sampling as usize
    }

    /// Times of the samples.
    pub fn time_sampling(&self) -> &TimeSampling {
        &self.shared.tables.samplings[self.time_sampling_index()].0 // checked on reading
    }

    /// Index of the sample that holds at `time` (s).
    pub fn floor_index(&self, time: f64) -> usize {
        self.time_sampling().floor_index(time, self.len())
    }

    /// The stored bytes of sample `index`: little-endian values, or strings each followed by a NUL.
    ///
    /// Fails when there is no such sample, and when the bytes are not whole elements.
    pub fn raw(&self, index: usize) -> Result<Vec<u8>, AlembicError> {
        let slot = self.slot(index)?;
        let at = |fault: Fault| fault.at(&self.shared.source.path, &self.place);
        let bytes = self.shared.source.data_after(slot, DIGEST).map_err(at)?;
        match self.header.data_type.count_elements(&bytes) {
            Some(count) if self.header.is_array || count == 1 => Ok(bytes),
            _ => {
                let reason = format!("sample {index} has {} bytes, which does not match its type", bytes.len());
                Err(at(Fault::Damaged(reason)))
            }
        }
    }

    /// Checks that the bytes of sample `index` are those whose digest is stored before them.
    ///
    /// Fails when they are not, and when there is no such sample.
    pub fn check_digest(&self, index: usize) -> Result<(), AlembicError> {
        let at = |fault: Fault| fault.at(&self.shared.source.path, &self.place);
        let whole = self.shared.source.data(self.slot(index)?).map_err(at)?;
        match whole.split_at_checked(DIGEST as usize) {
            Some((digest, payload)) if murmur3_x64_128(payload) == digest => Ok(()),
            _ if whole.is_empty() => Ok(()),
            _ => Err(at(Fault::damaged(format!("sample {index} differs from what was written")))),
        }
    }

    /// Number of elements in sample `index`; reads no payload unless the elements are text.
    pub fn element_count(&self, index: usize) -> Result<usize, AlembicError> {
        let slot = self.slot(index)?;
        let at = |fault: Fault| fault.at(&self.shared.source.path, &self.place);
        match self.header.data_type.element_size() {
            0 => Ok(self.header.data_type.count_elements(&self.raw(index)?).unwrap_or(0)), // `raw` has checked it
            size => {
                let bytes = self.shared.source.data_size(slot).map_err(at)?.saturating_sub(DIGEST) as usize;
                if bytes.is_multiple_of(size) {
                    return Ok(bytes / size);
                }
                let reason = format!("sample {index} has {bytes} bytes, which does not match its type");
                Err(at(Fault::Damaged(reason)))
            }
        }
    }

    /// The values of sample `index`, `extent` for each element. `T` has to be the stored type.
    pub fn values<T: PodValue>(&self, index: usize) -> Result<Vec<T>, AlembicError> {
        let stored = self.header.data_type.pod;
        if stored != T::POD {
            return Err(self.wrong_type(&format!("{} values", T::POD.name())));
        }
        Ok(decode(&self.raw(index)?))
    }

    /// Some of the values of sample `index`, counted from its first.
    pub fn values_in<T: PodValue>(&self, index: usize, range: Range<usize>) -> Result<Vec<T>, AlembicError> {
        if self.header.data_type.pod != T::POD {
            return Err(self.wrong_type(&format!("{} values", T::POD.name())));
        }
        let slot = self.slot(index)?;
        let [start, size] = [range.start, range.len()].map(|values| (values * size_of::<T>()) as u64);
        let bytes = self.shared.source.data_part(slot, DIGEST + start, size);
        Ok(decode(&bytes.map_err(|fault| fault.at(&self.shared.source.path, &self.place))?))
    }

    /// The elements of sample `index` of a property of `N` values each.
    pub fn elements<T: PodValue, const N: usize>(&self, index: usize) -> Result<Vec<[T; N]>, AlembicError> {
        if usize::from(self.header.data_type.extent) != N {
            return Err(self.wrong_type(&format!("{} × {N}", T::POD.name())));
        }
        let values = self.values::<T>(index)?;
        Ok(values.as_chunks::<N>().0.to_vec())
    }

    /// The strings of sample `index`.
    pub fn strings(&self, index: usize) -> Result<Vec<String>, AlembicError> {
        if !self.header.data_type.pod.is_text() {
            return Err(self.wrong_type("text"));
        }
        Ok(decode_strings(self.header.data_type.pod, &self.raw(index)?))
    }

    /// Slot of the payload of sample `index`.
    fn slot(&self, index: usize) -> Result<Slot, AlembicError> {
        let count = self.header.count;
        let Some(index) = u32::try_from(index).ok().filter(|&index| index < count) else {
            return Err(AlembicError::Missing {
                path: self.shared.source.path.clone(),
                place: self.place.to_string(),
                reason: format!("sample {index} is requested, but there are {count}"),
                help: "ask for a sample within the stored range".into(),
            });
        };
        let stored = self.header.stored_index(index) as usize * if self.header.is_array { 2 } else { 1 };
        self.shared.source.child(self.group, stored).map_err(|fault| fault.at(&self.shared.source.path, &self.place))
    }

    pub(super) fn damaged(&self, reason: String) -> AlembicError {
        Fault::Damaged(reason).at(&self.shared.source.path, &self.place)
    }

    pub(super) fn wrong_type(&self, wanted: &str) -> AlembicError {
        let DataType { pod, extent } = self.header.data_type;
        AlembicError::Missing {
            path: self.shared.source.path.clone(),
            place: self.place.to_string(),
            reason: format!("it holds {} × {extent}; {wanted} is expected", pod.name()),
            help: "export it with the standard type".into(),
        }
    }
}
