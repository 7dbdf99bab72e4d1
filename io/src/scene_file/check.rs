//! Parts of a scene file that only the rules of a scene look at.

use crate::rules::{RULES, find};
use crate::shot_description::CheckDescription;

use super::deserialize::suggestion;
use super::resolve::Resolver;
use super::tree::{Node, Origin, Path};

impl Resolver<'_> {
    /// Collects the data that the rules look at; refuses names that belong to no rule.
    pub(super) fn check_description(&mut self) -> CheckDescription {
        let silenced = self.scene.document.check.silence.clone();
        let here = Path::default().key("check").key("silence");
        for (index, name) in silenced.iter().enumerate().filter(|(_, name)| find(name).is_none()) {
            let names: Vec<&str> = RULES.iter().map(|rule| rule.name).collect();
            let help = suggestion(name, &names);
            self.error_with(&here.clone().index(index), format!("there is no rule `{name}`"), help);
        }
        let of_scene = |origin: &Origin| !matches!(origin, Origin::Default | Origin::Material(_));
        let friction = |index: usize| -> Option<&Node> {
            Path::default().key("body").index(index).find(&self.scene.root).as_table()?.get("friction")
        };
        let has_own_friction = (0..self.scene.document.body.len())
            .map(|index| friction(index).is_some_and(|node| of_scene(&node.origin)))
            .collect();
        CheckDescription { silenced, fabrics: self.scene.fabrics.clone(), has_own_friction }
    }
}
