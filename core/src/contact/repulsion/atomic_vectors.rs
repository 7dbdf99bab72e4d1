//! Velocities that many threads change at once, each a different node at a time.
//!
//! Pairs of one colour share no node, so no two threads touch the same entry; the compiler cannot know that. Relaxed atomic
//! loads and stores say it in safe code and cost what plain ones do.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::Vec3;

/// An array of 3-vectors with entries that can be changed through a shared reference.
#[derive(Debug)]
pub(crate) struct AtomicVectors(Vec<[AtomicU64; 3]>);

impl AtomicVectors {
    /// `count` zeros.
    pub(crate) fn new(count: usize) -> Self {
        Self((0..count).map(|_| Default::default()).collect())
    }

    /// Number of entries.
    pub(crate) fn count(&self) -> usize {
        self.0.len()
    }

    /// One entry.
    #[inline]
    pub(crate) fn get(&self, i: u32) -> Vec3 {
        let [x, y, z] = &self.0[i as usize];
        Vec3::new(f64::from_bits(x.load(Relaxed)), f64::from_bits(y.load(Relaxed)), f64::from_bits(z.load(Relaxed)))
    }

    /// Replaces one entry. Nobody else may work on it at the same time, or the answer is unknown (never unsafe).
    #[inline]
    pub(crate) fn set(&self, i: u32, value: &Vec3) {
        let [x, y, z] = &self.0[i as usize];
        x.store(value.x.to_bits(), Relaxed);
        y.store(value.y.to_bits(), Relaxed);
        z.store(value.z.to_bits(), Relaxed);
    }
}
