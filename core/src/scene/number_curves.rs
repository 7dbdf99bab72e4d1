//! Numbers of a scene that change over time: curves by frame, and the places in a description that they drive.

use std::collections::BTreeMap;

use crate::scene::{
    BodyDescription, ContactRule, Described, ElasticDescription, GarmentDescription, Mass, PinDescription, PinHold,
    SceneDescription, SeamDescription,
};
use crate::settings::SettingValue;

/// Curve of a number, or of three, by frame: straight between keys, constant before the first and after the last.
pub type NumberCurve = Vec<(f64, SettingValue)>;

/// Curves by the path of their number: `gravity.acceleration`, `garment.skirt.stretch.stiffness`, `body.hero.friction`,
/// `garment.skirt.pin.0.stiffness`, `seam.1.rest_gap`, `contact.0.friction`.
pub type NumberCurves = BTreeMap<String, NumberCurve>;

/// Place of a number in a description.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum NumberPlace {
    /// Setting of the effect with this place in the list of effects.
    Effect(usize, String),
    /// Value of a garment.
    Garment(usize, String),
    /// Value of a pin.
    Pin(usize, String),
    /// Value of an elastic band.
    Elastic(usize, String),
    /// Value of a body.
    Body(usize, String),
    /// Value of a seam.
    Seam(usize, String),
    /// Value of a rule of contact.
    Contact(usize, String),
}

/// A description of which some numbers may change over time.
pub trait ChangingNumbers: Described {
    /// Names of their rows.
    const CHANGING: &'static [&'static str];

    /// Gives a number another value; returns whether that changes something, `None` if it has no such number.
    fn set(&mut self, key: &str, value: f64) -> Option<bool>;
}

/// Whether a number was another one before.
fn replace(number: &mut f64, value: f64) -> bool {
    std::mem::replace(number, value) != value
}

impl ChangingNumbers for GarmentDescription {
    const CHANGING: &'static [&'static str] = &["density", "total_mass", "thickness", "rest_scale"];

    fn set(&mut self, key: &str, value: f64) -> Option<bool> {
        let number = match (key, &mut self.mass) {
            ("density", Mass::Density(number)) | ("total_mass", Mass::UniformTotal(number)) => number,
            ("thickness", _) => &mut self.thickness,
            ("rest_scale", _) => &mut self.rest_scale,
            _ => return None,
        };
        Some(replace(number, value))
    }
}

impl ChangingNumbers for PinDescription {
    const CHANGING: &'static [&'static str] = &["stiffness", "damping_ratio", "break_force"];

    fn set(&mut self, key: &str, value: f64) -> Option<bool> {
        let PinHold::Spring { stiffness, damping_ratio, break_force } = &mut self.hold else { return None };
        Some(match key {
            "stiffness" => replace(stiffness, value),
            "damping_ratio" => replace(damping_ratio, value),
            // A pin that can break has a memory of it, which it cannot get later.
            "break_force" => replace(break_force.as_mut()?, value),
            _ => return None,
        })
    }
}

impl ChangingNumbers for ElasticDescription {
    const CHANGING: &'static [&'static str] = &["stiffness", "rest_scale", "damping_ratio"];

    fn set(&mut self, key: &str, value: f64) -> Option<bool> {
        let number = match key {
            "stiffness" => &mut self.stiffness,
            "rest_scale" => &mut self.rest_scale,
            "damping_ratio" => &mut self.damping_ratio,
            _ => return None,
        };
        Some(replace(number, value))
    }
}

impl ChangingNumbers for BodyDescription {
    const CHANGING: &'static [&'static str] = &["friction", "thickness", "max_push_speed"];

    fn set(&mut self, key: &str, value: f64) -> Option<bool> {
        let number = match key {
            "friction" => &mut self.friction,
            "thickness" => &mut self.thickness,
            "max_push_speed" => &mut self.max_push_speed,
            _ => return None,
        };
        Some(replace(number, value))
    }
}

impl ChangingNumbers for SeamDescription {
    const CHANGING: &'static [&'static str] = &["strength", "damping_ratio", "rest_gap", "break_force"];

    fn set(&mut self, key: &str, value: f64) -> Option<bool> {
        Some(match key {
            "strength" => replace(&mut self.stiffness, value),
            "damping_ratio" => replace(&mut self.damping_ratio, value),
            "rest_gap" => self.rest_gap.replace(value) != Some(value),
            "break_force" => replace(self.break_force.as_mut()?, value),
            _ => return None,
        })
    }
}

impl ChangingNumbers for ContactRule {
    const CHANGING: &'static [&'static str] = &["friction", "thickness"];

    fn set(&mut self, key: &str, value: f64) -> Option<bool> {
        let number = match key {
            "friction" => &mut self.friction,
            "thickness" => &mut self.thickness,
            _ => return None,
        };
        Some(number.replace(value) != Some(value))
    }
}

/// The value of a curve at a frame; `None` without keys.
pub(crate) fn at(curve: &NumberCurve, frame: f64) -> Option<SettingValue> {
    let next = curve.partition_point(|(key, _)| *key <= frame);
    let Some((after, right)) = curve.get(next) else { return Some(curve.last()?.1.clone()) };
    let Some((before, left)) = next.checked_sub(1).map(|last| &curve[last]) else { return Some(right.clone()) };
    let share = (frame - before) / (after - before);
    let between = |a: f64, b: f64| a + (b - a) * share;
    Some(match (left, right) {
        (SettingValue::Number(a), SettingValue::Number(b)) => SettingValue::Number(between(*a, *b)),
        (SettingValue::Vector(a), SettingValue::Vector(b)) => {
            SettingValue::Vector([0, 1, 2].map(|k| between(a[k], b[k])))
        }
        _ => left.clone(),
    })
}

impl SceneDescription {
    /// The place of the number at a path; `None` if the scene has none there.
    pub(crate) fn number_place(&self, path: &str) -> Option<NumberPlace> {
        let (owner, key) = path.rsplit_once('.')?;
        let key = key.to_owned();
        if let Some(name) = owner.strip_prefix("body.") {
            let body = self.bodies.iter().position(|body| body.name == name)?;
            return Some(NumberPlace::Body(body, key));
        }
        let numbered = |kind: &str, count: usize| {
            let number: usize = owner.strip_prefix(kind)?.parse().ok()?;
            (number < count).then_some(number)
        };
        if owner.starts_with("contact.") {
            return numbered("contact.", self.contacts.len()).map(|rule| NumberPlace::Contact(rule, key));
        }
        if owner.starts_with("seam.") {
            return numbered("seam.", self.seams.len()).map(|seam| NumberPlace::Seam(seam, key));
        }
        let garment_named = |name: &str| self.garments.iter().position(|garment| garment.name == name);
        let (garment, effect) = match owner.strip_prefix("garment.") {
            Some(owner) => {
                // Names may have dots.
                if let Some(garment) = garment_named(owner) {
                    return Some(NumberPlace::Garment(garment, key));
                }
                let (name, effect) = owner.rsplit_once('.')?;
                if let Some(garment) = name.strip_suffix(".elastic").and_then(garment_named) {
                    let mut bands = (0..self.elastics.len()).filter(|band| self.elastics[*band].garment == garment);
                    return bands.nth(effect.parse().ok()?).map(|band| NumberPlace::Elastic(band, key));
                }
                if let Some(garment) = name.strip_suffix(".pin").and_then(garment_named) {
                    let mut pins = (0..self.pins.len()).filter(|pin| self.pins[*pin].garment == garment);
                    return pins.nth(effect.parse().ok()?).map(|pin| NumberPlace::Pin(pin, key));
                }
                (Some(garment_named(name)?), effect)
            }
            None => (None, owner),
        };
        let is_asked = |request: &crate::scene::EffectRequest| request.effect == effect && request.garment == garment;
        self.effects.iter().position(is_asked).map(|place| NumberPlace::Effect(place, key))
    }

    /// Gives the number at a path this value, in its SI unit. Returns whether that changes something.
    ///
    /// # Errors
    /// The scene has no such number.
    pub(crate) fn set_number(&mut self, path: &str, value: &SettingValue) -> Result<bool, String> {
        let unknown = || format!("the scene has no number `{path}`");
        let place = self.number_place(path).ok_or_else(unknown)?;
        let SettingValue::Number(number) = *value else {
            let NumberPlace::Effect(effect, key) = place else { return Err(format!("`{path}` is one number")) };
            return Ok(self.set_effect(effect, key, value));
        };
        let changes = match place {
            NumberPlace::Effect(effect, key) => Some(self.set_effect(effect, key, value)),
            NumberPlace::Garment(garment, key) => self.garments[garment].set(&key, number),
            NumberPlace::Pin(pin, key) => self.pins[pin].set(&key, number),
            NumberPlace::Elastic(band, key) => self.elastics[band].set(&key, number),
            NumberPlace::Body(body, key) => self.bodies[body].set(&key, number),
            NumberPlace::Seam(seam, key) => self.seams[seam].set(&key, number),
            NumberPlace::Contact(rule, key) => self.contacts[rule].set(&key, number),
        };
        changes.ok_or_else(unknown)
    }

    /// The request for the effect that has the number at a path, by its place in the list; `None` for other numbers.
    pub(crate) fn effect_of_number(&self, path: &str) -> Option<usize> {
        match self.number_place(path)? {
            NumberPlace::Effect(effect, _) => Some(effect),
            _ => None,
        }
    }

    /// Gives a setting of an effect another value; returns whether that changes something.
    fn set_effect(&mut self, effect: usize, key: String, value: &SettingValue) -> bool {
        let settings = &mut self.effects[effect].settings;
        settings.insert(key, value.clone()).as_ref() != Some(value)
    }

    /// The same with the values that curves have at a frame. Curves of nothing are left to the checks.
    pub(crate) fn with_numbers_at(mut self, frame: i64) -> Self {
        for (path, value) in self.numbers_at(frame) {
            self.set_number(&path, &value).ok();
        }
        self
    }

    /// The same with the values and maps that curves have at the start frame.
    pub(crate) fn with_numbers_at_start(self) -> Self {
        let start = self.timeline.start;
        let mut description = self.with_numbers_at(start);
        description.garments.iter_mut().for_each(|garment| garment.set_maps_at(start as f64));
        description
    }

    /// Values of all curves at a frame, by their paths.
    pub(crate) fn numbers_at(&self, frame: i64) -> Vec<(String, SettingValue)> {
        let value = |(path, curve): (&String, &NumberCurve)| Some((path.clone(), at(curve, frame as f64)?));
        self.curves.iter().filter_map(value).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_straight_between_their_keys_and_constant_beyond() {
        let number = SettingValue::Number;
        let curve = vec![(10.0, number(2.0)), (20.0, number(4.0)), (21.5, number(1.0))];
        for (frame, expected) in
            [(-5.0, 2.0), (10.0, 2.0), (15.0, 3.0), (20.0, 4.0), (21.0, 2.0), (22.0, 1.0), (1e9, 1.0)]
        {
            assert_eq!(at(&curve, frame), Some(number(expected)), "{frame}");
        }
        let curve = vec![(0.0, SettingValue::Vector([0.0, -9.0, 2.0])), (2.0, SettingValue::Vector([1.0, 0.0, 2.0]))];
        assert_eq!(at(&curve, 1.0), Some(SettingValue::Vector([0.5, -4.5, 2.0])));
        assert_eq!(at(&Vec::new(), 1.0), None);
    }
}
