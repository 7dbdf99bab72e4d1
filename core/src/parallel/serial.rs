//! One rank alone.

use crate::parallel::communicator::{Communicator, Exchange, Expected, Message};

/// The only rank there is. It has nobody to speak with, so nothing here waits, copies or allocates but what is asked
/// for.
#[derive(Debug, Clone, Copy, Default)]
pub struct Serial;

impl Communicator for Serial {
    fn rank(&self) -> usize {
        0
    }

    fn ranks(&self) -> usize {
        1
    }

    fn barrier(&self) {}

    fn max(&self, _: &mut [f64]) {}

    fn broadcast(&self, _: &mut Vec<u8>) {}

    fn all_gather(&self, own: &[u8], lengths: &[usize]) -> Vec<u8> {
        assert_eq!(lengths, [own.len()], "a rank gives as many bytes as all ranks expect of it");
        own.to_vec()
    }

    fn gather(&self, own: Vec<u8>) -> Vec<Vec<u8>> {
        vec![own]
    }

    fn start(&self, messages: Vec<Message>, from: &[Expected]) -> Box<dyn Exchange + '_> {
        assert!(messages.is_empty() && from.is_empty(), "a rank alone has nobody to exchange messages with");
        Box::new(Nothing)
    }
}

/// No message on its way. A box of it takes no memory.
struct Nothing;

impl Exchange for Nothing {
    fn finish(self: Box<Self>) -> Vec<Vec<u8>> {
        Vec::new()
    }
}
