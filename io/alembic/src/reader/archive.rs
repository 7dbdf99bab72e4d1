//! Opening an archive: the tree of objects is read at once, samples when asked for.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::object::Object;
use super::open_file::{Budget, Node, Shared};
use super::properties::{Compound, Samples};
use super::tables::{Tables, child_headers};
use crate::error::{AlembicError, Fault};
use crate::metadata::MetaData;
use crate::ogawa::{ChunkSource, Group};

/// Objects may be nested this deep.
const DEEPEST: usize = 1000;
/// An instance of an instance of ... : no real scene comes near.
const MOST_HOPS: usize = 32;
/// Most objects after instances are expanded.
const MOST_OBJECTS: usize = 1_000_000;

/// An open archive. Copies are cheap and share the file; reading is possible from several threads.
#[derive(Debug, Clone)]
pub struct Archive {
    pub(super) shared: Arc<Shared>,
}

impl Archive {
    /// Opens `path` and reads the tree of objects; instances appear with the content of their source.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, AlembicError> {
        let (source, root) = ChunkSource::open(path.as_ref())?;
        Self::read(source, root)
    }

    /// The same for the commit whose root group stands at `root` ([`crate::ArchiveMark::root`]), whatever was committed after it.
    pub fn open_at(path: impl AsRef<Path>, root: u64) -> Result<Self, AlembicError> {
        let (source, root) = ChunkSource::open_at(path.as_ref(), root)?;
        Self::read(source, root)
    }

    /// The same for an archive in memory; `name` stands for the path in messages.
    pub fn from_bytes(bytes: Vec<u8>, name: &str) -> Result<Self, AlembicError> {
        let (source, root) = ChunkSource::from_bytes(bytes, Path::new(name))?;
        Self::read(source, root)
    }

    fn read(source: ChunkSource, root: Group) -> Result<Self, AlembicError> {
        let tables = Tables::read(&source, root)?;
        let metadata = MetaData::parse(&tables.metadata);
        let nodes = read_stored(&source, &tables)?;
        let (mut shared, sources) = instance_sources(Shared { source, tables, metadata, nodes })?;
        shared.nodes = expand_instances(&shared.source, &shared.nodes, &sources)?;
        Ok(Self { shared: Arc::new(shared) })
    }

    /// The file, or the name given for bytes in memory.
    pub fn path(&self) -> &Path {
        &self.shared.source.path
    }

    /// All metadata of the archive.
    pub fn metadata(&self) -> &MetaData {
        &self.shared.metadata
    }

    /// Name and version of the program that asked for the file; empty when it did not say.
    pub fn application(&self) -> &str {
        self.shared.metadata.get("_ai_Application").unwrap_or_default()
    }

    /// Frames per second as noted by the writer: as `DCC_FPS`, or as `FramesPerTimeUnit`, which Blender writes. Sample times are in
    /// seconds and do not depend on it.
    pub fn frames_per_second_hint(&self) -> Option<f64> {
        let keys = ["_ai_DCC_FPS", "DCC_FPS", "_ai_FramesPerTimeUnit", "FramesPerTimeUnit"];
        let rate = |key: &str| self.shared.metadata.get(key)?.trim().parse().ok();
        keys.into_iter().filter_map(rate).find(|rate: &f64| rate.is_finite() && *rate > 0.0)
    }

    /// Version of the writing library as major·10000 + minor·100 + patch.
    pub fn library_version(&self) -> i32 {
        self.shared.tables.library_version
    }

    /// Largest number of samples of a property with this sampling, as noted by the writer.
    pub fn max_samples(&self, time_sampling: usize) -> Option<u32> {
        self.shared.tables.samplings.get(time_sampling).map(|(_, count)| *count)
    }

    /// The top object, whose path is `/`.
    pub fn top(&self) -> Object {
        Object { shared: self.shared.clone(), index: 0 }
    }

    /// All objects but the top one, depth first in stored order.
    pub fn objects(&self) -> impl Iterator<Item = Object> + '_ {
        (1..self.shared.nodes.len()).map(|index| Object { shared: self.shared.clone(), index })
    }

    /// The object with this full path, such as `/body/bodyShape`.
    pub fn object(&self, path: &str) -> Result<Object, AlembicError> {
        let mut object = self.top();
        for name in path.split('/').filter(|name| !name.is_empty()) {
            let child = object.children().find(|child| child.name() == name);
            object = child.ok_or_else(|| self.no_object(path))?;
        }
        Ok(object)
    }

    /// Checks that what does not change in any object (faces, texture coordinates, transforms, attributes) is stored as the
    /// digests say that stand beside it.
    ///
    /// Fails at the first property that is damaged, by its path.
    pub fn check_constants(&self) -> Result<(), AlembicError> {
        std::iter::once(self.top()).chain(self.objects()).try_for_each(|object| object.properties()?.check_constants())
    }

    /// World bounds of everything, when the writer stored them.
    pub fn bounds(&self) -> Result<Option<Samples>, AlembicError> {
        Ok(self.top().properties()?.samples(".childBnds").cloned())
    }

    fn no_object(&self, path: &str) -> AlembicError {
        let names: Vec<&str> = self.shared.nodes.iter().skip(1).take(8).map(|node| node.path.as_str()).collect();
        AlembicError::Missing {
            path: self.path().to_owned(),
            place: path.to_owned(),
            reason: "there is no such object".into(),
            help: format!("choose one that is in the file; the first are {}", names.join(", ")),
        }
    }
}

/// The objects as stored, parents before children.
fn read_stored(source: &ChunkSource, tables: &Tables) -> Result<Vec<Node>, AlembicError> {
    let mut budget = Budget::for_file(source.length);
    let mut nodes = vec![Node {
        name: "ABC".into(),
        path: "/".into(),
        metadata: MetaData::new(),
        parent: None,
        children: Vec::new(),
        group: tables.top,
        instance_of: None,
    }];
    let mut ancestors = vec![(0_usize, 0_usize)]; // node, depth
    while let Some((index, depth)) = ancestors.pop() {
        let path = nodes[index].path.clone();
        let at = |fault: Fault| fault.at(&source.path, &path);
        budget.spend(8 * nodes[index].group.count).map_err(at)?;
        let headers = child_headers(source, nodes[index].group, &tables.texts).map_err(at)?;
        if !headers.is_empty() && depth >= DEEPEST {
            return Err(at(Fault::damaged(format!("objects are nested more than {DEEPEST} deep"))));
        }
        let mut children = Vec::with_capacity(headers.len());
        for (header, slot) in headers {
            let child_path = format!("{}/{}", path.trim_end_matches('/'), header.name);
            budget.spend(child_path.len() + header.metadata.len() + 24).map_err(at)?;
            let group = source.group(slot).map_err(at)?;
            if group.count > 0 && has_ancestor(&nodes, index, group) {
                return Err(at(Fault::damaged(format!("child `{}` contains itself", header.name))));
            }
            children.push(nodes.len());
            nodes.push(Node {
                name: header.name,
                path: child_path,
                metadata: MetaData::parse(&header.metadata),
                parent: Some(index),
                children: Vec::new(),
                group,
                instance_of: None,
            });
        }
        ancestors.extend(children.iter().rev().map(|&child| (child, depth + 1)));
        nodes[index].children = children;
    }
    Ok(nodes)
}

fn has_ancestor(nodes: &[Node], start: usize, group: Group) -> bool {
    let mut next = Some(start);
    while let Some(index) = next {
        if nodes[index].group == group {
            return true;
        }
        next = nodes[index].parent;
    }
    false
}

/// Source path of every instance. Properties can only be read from a shared archive, so it goes in and comes back.
fn instance_sources(shared: Shared) -> Result<(Shared, HashMap<usize, String>), AlembicError> {
    let shared = Arc::new(shared);
    let mut sources = HashMap::new();
    for (index, node) in shared.nodes.iter().enumerate() {
        if node.metadata.get("isInstance") == Some("1") {
            let properties = Compound::of_group(&shared, node.group, &node.path)?;
            let text = properties.samples(".instanceSource").map(|samples| samples.strings(0)).transpose()?;
            sources.insert(index, text.and_then(|mut strings| strings.pop()).unwrap_or_default());
        }
    }
    let shared = Arc::into_inner(shared);
    // The compounds above, the only other owners, are gone.
    Ok((shared.expect("no other owner"), sources))
}

/// The tree, depth first, in which every instance has the metadata, properties and children of its source.
fn expand_instances(
    source: &ChunkSource,
    stored: &[Node],
    sources: &HashMap<usize, String>,
) -> Result<Vec<Node>, AlembicError> {
    let by_path: HashMap<&str, usize> =
        stored.iter().enumerate().map(|(index, node)| (node.path.as_str(), index)).collect();
    let mut nodes: Vec<Node> = Vec::with_capacity(stored.len());
    let mut budget = Budget::for_file(source.length.saturating_add(4 << 20)); // instances need more
    // Stored node, its parent in the new tree, depth.
    let mut waiting = vec![(0_usize, None::<usize>, 0_usize)];
    while let Some((index, parent, depth)) = waiting.pop() {
        let named = &stored[index];
        let above = parent.map(|parent| nodes[parent].path.trim_end_matches('/').to_owned());
        let path = above.map_or("/".to_owned(), |above| format!("{above}/{}", named.name));
        let at = |reason: String| Fault::Damaged(reason).at(&source.path, &path);
        let (mut content, mut hops) = (index, 0);
        while let Some(&next) = sources.get(&content).and_then(|source| by_path.get(source.as_str())) {
            (content, hops) = (next, hops + 1);
            if hops > MOST_HOPS {
                return Err(at("an instance whose sources are instances of each other".into()));
            }
        }
        let group = stored[content].group;
        if parent.is_some_and(|parent| group.count > 0 && has_ancestor(&nodes, parent, group)) {
            return Err(at(format!("an instance of `{}`, which contains it", stored[content].path)));
        }
        if nodes.len() >= MOST_OBJECTS || depth > DEEPEST {
            return Err(at("instances expand to more objects than can be kept".into()));
        }
        budget.spend(path.len()).map_err(|fault| fault.at(&source.path, &path))?;
        let new = nodes.len();
        nodes.push(Node {
            name: named.name.clone(),
            path,
            metadata: stored[content].metadata.clone(),
            parent,
            children: Vec::new(),
            group,
            instance_of: sources.get(&index).cloned(),
        });
        if let Some(parent) = parent {
            nodes[parent].children.push(new);
        }
        waiting.extend(stored[content].children.iter().rev().map(|&child| (child, Some(new), depth + 1)));
    }
    Ok(nodes)
}
