//! What travels between ranks where it is not plain: words of 64 bits, read in the order in which they were written.

use crate::Vec3;

/// Words to be sent.
#[derive(Debug, Default)]
pub(crate) struct Packed(Vec<u64>);

impl Packed {
    pub(crate) fn words(&self) -> &[u64] {
        &self.0
    }

    pub(crate) fn number(&mut self, number: impl Into<u64>) {
        self.0.push(number.into());
    }

    pub(crate) fn float(&mut self, number: f64) {
        self.0.push(number.to_bits());
    }

    pub(crate) fn vector(&mut self, vector: &Vec3) {
        vector.iter().for_each(|x| self.float(*x));
    }

    pub(crate) fn list<T>(&mut self, list: &[T], mut each: impl FnMut(&mut Self, &T)) {
        self.number(list.len() as u64);
        list.iter().for_each(|item| each(self, item));
    }
}

/// Words that were received.
pub(crate) struct Unpacked<'a>(&'a [u64]);

impl<'a> Unpacked<'a> {
    pub(crate) fn new(words: &'a [u64]) -> Self {
        Self(words)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn number(&mut self) -> u64 {
        let (first, rest) = self.0.split_first().expect("a message is read as it was written");
        self.0 = rest;
        *first
    }

    /// The number of a node.
    pub(crate) fn node(&mut self) -> u32 {
        self.number() as u32
    }

    pub(crate) fn flag(&mut self) -> bool {
        self.number() != 0
    }

    pub(crate) fn float(&mut self) -> f64 {
        f64::from_bits(self.number())
    }

    pub(crate) fn vector(&mut self) -> Vec3 {
        let [x, y, z] = [(); 3].map(|()| self.float());
        Vec3::new(x, y, z)
    }

    pub(crate) fn list<T>(&mut self, mut each: impl FnMut(&mut Self) -> T) -> Vec<T> {
        let count = self.number();
        (0..count).map(|_| each(self)).collect()
    }
}
