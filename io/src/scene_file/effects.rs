//! Tables of effects. They are not known to serde: the solver's registry says what they may hold.

use drapery_core::effects::{EffectSpec, REGISTRY, Scope, lacking};
use drapery_core::scene::EffectRequest;

use super::deserialize::dotted;
use super::diagnostics::SceneFileError;
use super::fields::{self, EACH};
use super::tree::{Node, Origin, Path, Segment, Sources, Value};

/// Effects that have a table of this scope.
pub(super) fn with_table(scope: Scope) -> impl Iterator<Item = &'static EffectSpec> {
    REGISTRY.iter().copied().filter(move |spec| spec.scope == scope)
}

/// Names of the effect tables that may stand at a path: the top level, or one garment.
pub(super) fn names_at(path: &Path) -> Vec<&'static str> {
    use Segment::{Index, Key};
    match path.0.as_slice() {
        [] => with_table(Scope::Scene).map(|spec| spec.name).chain(["parameters"]).collect(),
        [Key(key), Index(_)] if key == "garment" => with_table(Scope::Garment).map(|spec| spec.name).collect(),
        _ => Vec::new(),
    }
}

/// All effect tables of the tree with their paths, scene effects first.
pub(super) fn tables(root: &Node) -> Vec<(&'static EffectSpec, Path)> {
    let found = |(scope, table): (Scope, &'static [&'static str])| {
        let paths = move |spec: &EffectSpec| fields::found(root, &[table, &[spec.name]].concat());
        with_table(scope).flat_map(move |spec| paths(spec).into_iter().map(move |path| (spec, path)))
    };
    [(Scope::Scene, &[][..]), (Scope::Garment, &["garment", EACH])].into_iter().flat_map(found).collect()
}

/// Checks every effect table against the fields of its effect and fills in the defaults.
///
/// # Errors
/// The first key or value of each table that does not fit; of unknown keys all.
pub(super) fn check_and_fill(root: &mut Node, sources: &Sources) -> Result<(), SceneFileError> {
    let mut refused: Option<SceneFileError> = None;
    for (spec, path) in tables(root) {
        let name = dotted(&path);
        let help = format!("write [{name}] and its settings below it, or remove it to switch the effect off");
        if let Err(error) = fields::check_table(path.find(root), spec.fields, &path, sources, help) {
            refused = Some(refused.take().map_or(error.clone(), |first| first.and(error)));
            continue;
        }
        let table = path.find_mut(root).and_then(|node| {
            let place = node.place.clone();
            node.as_table_mut().map(|table| (table, place))
        });
        let Some((table, place)) = table else { continue };
        for (name, value) in spec.fields.iter().filter_map(|field| Some((field.name, fields::default(field)?))) {
            table.fill(name, Value::from_toml(&value, &place), &place, Origin::Default);
        }
    }
    refused.map_or(Ok(()), Err)
}

/// Takes out the tables of effects that this build lacks, at the top level and under garments, before anyone takes them for
/// misspelt words.
///
/// # Errors
/// All of them.
pub(super) fn take_lacking(root: &mut Node, sources: &Sources) -> Result<(), SceneFileError> {
    let mut refused = Vec::new();
    let mut take = |node: &mut Node| {
        let Some(table) = node.as_table_mut() else { return };
        table.0.retain(|entry| {
            let problem = lacking(&entry.key);
            let is_here = problem.is_none();
            refused.extend(problem.map(|(what, advice)| sources.error(&entry.key_place, what, Some(advice))));
            is_here
        });
    };
    take(root);
    let garments = root.as_table_mut().and_then(|table| table.get_mut("garment"));
    if let Some(Value::Array(garments)) = garments.map(|node| &mut node.value) {
        garments.iter_mut().for_each(take);
    }
    refused.into_iter().reduce(SceneFileError::and).map_or(Ok(()), Err)
}

/// The requests that the tables of a checked tree make.
pub(super) fn requests(root: &Node) -> Vec<EffectRequest> {
    let request = |(spec, path): (&'static EffectSpec, Path)| {
        let node = path.find(root);
        let garment = path.0.iter().find_map(|segment| match segment {
            Segment::Index(garment) => Some(*garment),
            Segment::Key(_) => None,
        });
        let because = match &node.origin {
            Origin::Material(material) => format!("material {material} asks for it"),
            _ => format!("the scene has a table [{}]", dotted(&path)),
        };
        let settings = fields::written(node, spec.fields);
        let sources = fields::sources(node, spec.fields);
        EffectRequest { effect: spec.name.to_owned(), garment, settings, sources, because }
    };
    tables(root).into_iter().map(request).collect()
}
