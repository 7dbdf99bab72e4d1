//! Parts of a scene file that only the rules of a scene look at.

use std::collections::BTreeMap;

use crate::rules::{RULES, find};
use crate::shot_description::{ChannelRate, CheckDescription};

use super::channels::ChannelFile;
use super::curves::Curve;
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
        let (fabrics, lines, channels) = (self.scene.fabrics.clone(), self.lines(), self.channel_rates());
        CheckDescription { silenced, fabrics, has_own_friction, lines, channels }
    }

    /// The frame rates of the channels that change.
    fn channel_rates(&self) -> Vec<ChannelRate> {
        let of_file = |curve: &Curve, ChannelFile { path, rate }: &ChannelFile| {
            Some(ChannelRate { object: curve.object(), path: path.clone(), rate: (*rate)? })
        };
        self.scene.curves.iter().filter_map(|curve| of_file(curve, curve.file.as_ref()?)).collect()
    }

    /// The lines of what messages name by number: seams, rules of contact, pins, elastic bands and curves.
    fn lines(&self) -> BTreeMap<String, String> {
        let (document, root) = (&self.scene.document, &self.scene.root);
        let at = |path: &Path| {
            let location = self.scene.sources.location(&path.place(root));
            format!("{}:{}", location.source_name, location.line_column().0)
        };
        let mut lines = BTreeMap::new();
        for (number, seam) in document.seam.iter().enumerate() {
            let (name, path) = (format!("seam {number}"), Path::default().key("seam").index(number));
            let [from, to] = [&seam.from, &seam.to].map(|side| &side.garment);
            lines.insert(name.clone(), format!("{}: garment \"{from}\" and garment \"{to}\", {name}", at(&path)));
        }
        let mut named = |name: String, path: &Path| lines.insert(name.clone(), format!("{}: {name}", at(path)));
        for number in 0..document.contact.len() {
            named(format!("contact {number}"), &Path::default().key("contact").index(number));
        }
        // Pins and bands are counted through all garments.
        let (mut pins, mut bands) = (0.., 0..);
        for (index, garment) in document.garment.iter().enumerate() {
            let path = |key: &str, own: usize| Path::default().key("garment").index(index).key(key).index(own);
            for (own, number) in (0..garment.pin.len()).zip(&mut pins) {
                named(format!("garment \"{}\", pin {number}", garment.name), &path("pin", own));
            }
            for (own, number) in (0..garment.elastic.len()).zip(&mut bands) {
                named(format!("garment \"{}\", elastic {number}", garment.name), &path("elastic", own));
            }
        }
        for curve in &self.scene.curves {
            named(curve.object(), &curve.path);
        }
        lines
    }
}
