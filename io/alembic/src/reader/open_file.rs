//! The opened file behind an archive, its objects and their properties.

use super::tables::Tables;
use crate::error::Fault;
use crate::metadata::MetaData;
use crate::ogawa::{ChunkSource, Group};

/// An opened file with its tables and objects.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) source: ChunkSource,
    pub(super) tables: Tables,
    pub(super) metadata: MetaData,
    pub(super) nodes: Vec<Node>,
}

/// An object after instances are expanded. Node 0 is the top object.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) name: String,
    pub(super) path: String,
    pub(super) metadata: MetaData,
    pub(super) parent: Option<usize>,
    pub(super) children: Vec<usize>,
    pub(super) group: Group,
    /// Path of the source when this is an instance.
    pub(super) instance_of: Option<String>,
}

/// Keeps a small damaged file from asking for a lot of memory: chunks that are shared between headers would.
pub(super) struct Budget {
    left: u64,
}

impl Budget {
    /// A budget for the headers of a file of this length [bytes].
    pub(super) fn for_file(length: u64) -> Self {
        Self { left: length.saturating_mul(16).saturating_add(4 << 20) }
    }

    /// Takes the memory of a header out of it [bytes].
    pub(super) fn spend(&mut self, bytes: usize) -> Result<(), Fault> {
        let left = self.left.checked_sub(bytes as u64);
        self.left = left.ok_or_else(|| Fault::damaged("the headers are larger than the file can hold"))?;
        Ok(())
    }
}
