//! Rules of contact: the objects that they name.

use drapery_core::scene::{ContactRule, ContactSide, Described};

use super::deserialize::suggestion;
use super::raw::Contact;
use super::resolve::Resolver;
use super::tree::Path;

/// Kinds of objects, as a name may say them.
const KINDS: [&str; 2] = ["garment", "body"];

impl Resolver<'_> {
    /// Resolves all rules.
    pub(super) fn contacts(&mut self) {
        let scene = self.scene;
        for (index, contact) in scene.document.contact.iter().enumerate() {
            self.contact(contact, &Path::default().key("contact").index(index));
        }
    }

    /// Resolves one rule. Problems are recorded, and the rule is then left out.
    fn contact(&mut self, contact: &Contact, path: &Path) {
        let path_of = |side: usize| path.clone().key("between").index(side);
        let [a, b] = [0, 1].map(|side| self.contact_side(&contact.between[side], &path_of(side)));
        let (Some(a), Some(b)) = (a, b) else { return };
        let settings = self.settings(path, ContactRule::FIELDS);
        self.description.contacts.push(ContactRule {
            between: [a, b],
            ignore: contact.ignore,
            friction: settings.optional("friction"),
            thickness: settings.optional("thickness"),
        });
    }

    /// The object of a name.
    fn contact_side(&mut self, name: &str, path: &Path) -> Option<ContactSide> {
        let document = &self.scene.document;
        let written = [
            document.garment.iter().map(|garment| garment.name.as_str()).collect::<Vec<_>>(),
            document.body.iter().map(|body| body.name.as_str()).collect(),
        ];
        let find = |kind: usize, name: &str| written[kind].iter().position(|other| *other == name);
        let kind = match [find(0, name), find(1, name)] {
            [Some(_), Some(_)] => {
                let help = format!("write \"garment.{name}\" or \"body.{name}\"");
                self.error_with(path, format!("a garment and a body have the name \"{name}\""), help);
                return None;
            }
            [Some(_), None] => Some((0, name)),
            [None, Some(_)] => Some((1, name)),
            [None, None] => KINDS.iter().enumerate().find_map(|(kind, word)| {
                let name = name.strip_prefix(word)?.strip_prefix('.')?;
                find(kind, name).map(|_| (kind, name))
            }),
        };
        if let (None, Some(part)) = (kind, self.part_named(name)) {
            return part;
        }
        let Some((kind, name)) = kind else {
            let of_parts = document
                .garment
                .iter()
                .flat_map(|garment| garment.part.iter().map(|part| format!("{}.{}", garment.name, part.name)));
            let of_parts: Vec<String> = of_parts.collect();
            let names: Vec<&str> = written.concat().into_iter().chain(of_parts.iter().map(String::as_str)).collect();
            let help = suggestion(name, &names);
            self.error_with(path, format!("there is no garment and no body \"{name}\""), help);
            return None;
        };
        // One that could not be read has been reported already.
        let (garments, bodies) = (&self.description.garments, &self.description.bodies);
        match kind {
            0 => garments.iter().position(|garment| garment.name == name).map(ContactSide::Garment),
            _ => bodies.iter().position(|body| body.name == name).map(ContactSide::Body),
        }
    }
}
