//! Data that the writer keeps in memory: objects, compounds, properties and the slots of their stored samples.

use crate::murmur::murmur3_x64_128;
use crate::packed::PackedSamples;
use crate::property::DataType;

/// An object of the archive being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObjectId(pub(super) usize);

/// A compound property of the archive being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CompoundId(pub(super) usize);

/// A scalar or array property of the archive being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PropertyId(pub(super) usize);

#[derive(Debug)]
pub(super) struct ObjectNode {
    pub(super) name: String,
    /// Full path; `/` for the top object.
    pub(super) path: String,
    pub(super) metadata: String,
    pub(super) children: Vec<usize>,
    /// Top compound.
    pub(super) properties: usize,
    /// False for an object of a re-opened archive that the caller has not declared again yet.
    pub(super) declared: bool,
}

#[derive(Debug)]
pub(super) struct CompoundNode {
    pub(super) name: String,
    /// Object path and names of the compounds down to here, for messages.
    pub(super) place: String,
    pub(super) metadata: String,
    pub(super) members: Vec<Member>,
    pub(super) depth: usize,
    pub(super) declared: bool,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Member {
    Compound(usize),
    Property(usize),
}

/// Identity of a payload: byte count, digest, and whether it is text (0 numbers, 1 strings, 2 wide strings).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct SampleKey {
    pub(super) size: u64,
    pub(super) digest: [u8; 16],
    pub(super) text: u8,
}

/// Slots of one stored sample; `dimensions` is used by arrays only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StoredSample {
    pub(super) payload: u64,
    pub(super) dimensions: u64,
}

#[derive(Debug)]
pub(super) struct PropertyNode {
    pub(super) name: String,
    pub(super) place: String,
    pub(super) metadata: String,
    pub(super) is_array: bool,
    pub(super) data_type: DataType,
    pub(super) time_sampling: u32,
    pub(super) count: u32,
    pub(super) first_changed: u32,
    pub(super) last_changed: u32,
    /// Sample 0, then samples `first_changed..=last_changed`.
    pub(super) stored: Vec<StoredSample>,
    pub(super) previous: Option<SampleKey>,
    pub(super) previous_elements: u64,
    pub(super) scalar_like: bool,
    pub(super) homogeneous: bool,
    /// Digest over the digests of all stored samples in order.
    pub(super) content: [u8; 16],
    pub(super) declared: bool,
}

impl PropertyNode {
    /// Takes one more sample: `stored` and `key` of its payload, `elements` in it. Equal neighbours share a slot.
    pub(super) fn push(&mut self, sample: StoredSample, key: SampleKey, elements: u64) {
        if self.previous != Some(key) {
            if self.first_changed != 0 {
                self.fill_repeats();
            }
            self.remember(sample, &key.digest);
            if self.first_changed == 0 {
                self.first_changed = self.count; // stays 0 for the very first sample
            }
            self.last_changed = self.count;
            self.homogeneous &= self.count == 0 || elements == self.previous_elements;
            self.scalar_like &= elements == 1;
            self.previous = Some(key);
            self.previous_elements = elements;
        }
        self.count += 1;
    }

    /// Adds the previous sample once for every index since it was stored: between the first and the last change there
    /// is one slot for each index.
    fn fill_repeats(&mut self) {
        let (Some(&last), Some(key)) = (self.stored.last(), self.previous) else {
            return;
        };
        for _ in self.last_changed + 1..self.count {
            self.remember(last, &key.digest);
        }
    }

    fn remember(&mut self, sample: StoredSample, digest: &[u8; 16]) {
        self.stored.push(sample);
        self.content = chain(&self.content, digest);
    }

    pub(super) fn packed(&self) -> PackedSamples {
        PackedSamples {
            is_array: self.is_array,
            scalar_like: self.is_array && self.scalar_like && self.count > 0,
            homogeneous: self.homogeneous,
            data_type: self.data_type,
            count: self.count,
            first_changed: self.first_changed,
            last_changed: self.last_changed,
            time_sampling: self.time_sampling,
        }
    }
}

/// Digest of a digest sequence, one step.
pub(super) fn chain(so_far: &[u8; 16], next: &[u8; 16]) -> [u8; 16] {
    murmur3_x64_128(&[*so_far, *next].concat())
}
