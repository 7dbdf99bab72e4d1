//! Rules for pairs of objects that can touch: which ignore each other, and friction and thickness by pair.

use crate::scene::described::described;
use crate::scene::{LARGEST_THICKNESS, SceneDescription};

/// An object that takes part in contact.
///
/// ```
/// use drapery_core::ContactSide;
/// assert_ne!(ContactSide::Garment(0), ContactSide::Body(0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ContactSide {
    /// A garment, by its number.
    Garment(usize),
    /// A body, by its number.
    Body(usize),
    /// A part of a garment, by the garment's number and the part's number in the order of the names.
    Part(usize, usize),
}

impl ContactSide {
    /// The garment that it is, or is a part of.
    pub(crate) fn garment(self) -> Option<usize> {
        match self {
            Self::Garment(garment) | Self::Part(garment, _) => Some(garment),
            Self::Body(_) => None,
        }
    }
}

/// Contact of two garments, of a garment with a body, or of a garment with itself, where it differs from what the objects say. In the
/// place of a garment may be a part of it. A rule of a garment holds for its parts too, except where a rule names them.
///
/// ```
/// use drapery_core::{ContactRule, ContactSide};
/// let between = [ContactSide::Garment(0), ContactSide::Garment(1)];
/// let slippery = ContactRule { friction: Some(0.1), ..ContactRule::new(between) };
/// let lining = ContactRule { ignore: true, ..ContactRule::new(between) };
/// assert_eq!((slippery.ignore, lining.friction), (false, None));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactRule {
    /// The two objects; the same garment twice for its own layers.
    pub between: [ContactSide; 2],
    /// True if they pass through each other.
    pub ignore: bool,
    /// Coulomb friction coefficient between them.
    pub friction: Option<f64>,
    /// Distance that they keep [m]; short edges lower it between cloth and cloth, as they lower a garment's.
    pub thickness: Option<f64>,
}

impl ContactRule {
    /// A rule that says nothing yet.
    pub fn new(between: [ContactSide; 2]) -> Self {
        Self { between, ignore: false, friction: None, thickness: None }
    }

    /// The two objects, the smaller first.
    pub(crate) fn ordered(&self) -> [ContactSide; 2] {
        let [a, b] = self.between;
        [a.min(b), a.max(b)]
    }

    /// The body, if one takes part.
    pub(crate) fn body(&self) -> Option<usize> {
        self.between.into_iter().find_map(|side| if let ContactSide::Body(body) = side { Some(body) } else { None })
    }
}

impl SceneDescription {
    /// The rule for two objects, in whichever order it names them.
    pub fn contact_rule(&self, a: ContactSide, b: ContactSide) -> Option<&ContactRule> {
        let wanted = [a.min(b), a.max(b)];
        self.contacts.iter().find(|rule| rule.ordered() == wanted)
    }

    /// Whether some of one object passes through some of another by a rule, if only between parts of them.
    pub fn ignores_in_part(&self, a: ContactSide, b: ContactSide) -> bool {
        let whole = |side: ContactSide| {
            if let ContactSide::Part(garment, _) = side { ContactSide::Garment(garment) } else { side }
        };
        let is_theirs = |rule: &ContactRule| {
            let [c, d] = rule.between.map(whole);
            [c, d] == [a, b] || [d, c] == [a, b]
        };
        self.contacts.iter().any(|rule| rule.ignore && is_theirs(rule))
    }

    /// Whether two objects pass through each other by a rule.
    pub fn ignores(&self, a: ContactSide, b: ContactSide) -> bool {
        self.contact_rule(a, b).is_some_and(|rule| rule.ignore)
    }

    /// Drops the rules for which `keep` does not hold; curves follow the numbers of the others.
    pub(crate) fn retain_contacts(&mut self, mut keep: impl FnMut(&mut ContactRule) -> bool) {
        let kept: Vec<bool> = self.contacts.iter_mut().map(&mut keep).collect();
        let mut rules = kept.iter();
        self.contacts.retain(|_| rules.next().copied().unwrap_or(true));
        let place = |path: &str| {
            let (rule, key) = path.strip_prefix("contact.")?.split_once('.')?;
            let rule: usize = rule.parse().ok()?;
            let left = kept.get(..rule)?.iter().filter(|kept| **kept).count();
            Some((*kept.get(rule)?).then(|| format!("contact.{left}.{key}")))
        };
        let curves = std::mem::take(&mut self.curves);
        let renamed = curves.into_iter().filter_map(|(path, curve)| match place(&path) {
            Some(renamed) => Some((renamed?, curve)),
            None => Some((path, curve)),
        });
        self.curves = renamed.collect();
    }

    /// An object in words, as in `garment "skirt"`; its number if there is none.
    pub fn contact_side(&self, side: ContactSide) -> String {
        let words = |kind: &str, number: usize, name: Option<&String>| {
            name.map_or_else(|| format!("{kind} {number}"), |name| format!("{kind} \"{name}\""))
        };
        match side {
            ContactSide::Garment(g) => words("garment", g, self.garments.get(g).map(|garment| &garment.name)),
            ContactSide::Body(b) => words("body", b, self.bodies.get(b).map(|body| &body.name)),
            ContactSide::Part(g, p) => {
                let name = self.garments.get(g).and_then(|garment| garment.parts.keys().nth(p));
                format!("{} of {}", words("part", p, name), self.contact_side(ContactSide::Garment(g)))
            }
        }
    }
}

described! { ContactRule as rule {
    "friction", rule.friction => None, default Absent, range (0.0, 100.0),
        "Coulomb friction between the two; left out, that of the body; between cloth and cloth that of `[self_repulsion]`, or if it has \
         none the mean of both materials";
    "thickness", rule.thickness => Length, default Absent, range (0.0, LARGEST_THICKNESS),
        "distance that the two keep; left out, that of the body, or of the thicker garment";
} }
