//! Numbers of a scene that change over time: curves by frame, and the places in a description that they drive.

use std::collections::BTreeMap;

use crate::scene::{ContactRule, SceneDescription};
use crate::settings::SettingValue;

/// Curve of a number, or of three, by frame: straight between keys, constant before the first and after the last.
pub type NumberCurve = Vec<(f64, SettingValue)>;

/// Curves by the path of their number: `gravity.acceleration`, `garment.skirt.stretch.stiffness`, `body.hero.friction`,
/// `contact.0.friction`.
pub type NumberCurves = BTreeMap<String, NumberCurve>;

/// Place of a number in a description.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum NumberPlace {
    /// Setting of the effect with this place in the list of effects.
    Effect(usize, String),
    /// Value of a body.
    Body(usize, String),
    /// Value of a rule of contact.
    Contact(usize, String),
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
        if let Some(number) = owner.strip_prefix("contact.") {
            let rule: usize = number.parse().ok()?;
            return (rule < self.contacts.len()).then_some(NumberPlace::Contact(rule, key));
        }
        let (garment, effect) = match owner.strip_prefix("garment.") {
            Some(owner) => {
                let (name, effect) = owner.rsplit_once('.')?;
                (Some(self.garments.iter().position(|garment| garment.name == name)?), effect)
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
        match (place, value) {
            (NumberPlace::Effect(effect, key), value) => {
                let settings = &mut self.effects[effect].settings;
                Ok(settings.insert(key, value.clone()).as_ref() != Some(value))
            }
            (NumberPlace::Body(body, key), SettingValue::Number(value)) => {
                let body = &mut self.bodies[body];
                let number = match key.as_str() {
                    "friction" => &mut body.friction,
                    "thickness" => &mut body.thickness,
                    "max_push_speed" => &mut body.max_push_speed,
                    _ => return Err(unknown()),
                };
                Ok(std::mem::replace(number, *value) != *value)
            }
            (NumberPlace::Contact(rule, key), SettingValue::Number(value)) => {
                let ContactRule { friction, thickness, .. } = &mut self.contacts[rule];
                let number = match key.as_str() {
                    "friction" => friction,
                    "thickness" => thickness,
                    _ => return Err(unknown()),
                };
                Ok(number.replace(*value) != Some(*value))
            }
            _ => Err(format!("`{path}` is one number")),
        }
    }

    /// The same with the values that curves have at the start frame. Curves of nothing are left to the checks.
    pub(crate) fn with_numbers_at_start(mut self) -> Self {
        for (path, value) in self.numbers_at(self.timeline.start) {
            self.set_number(&path, &value).ok();
        }
        self
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
