//! The matrix of contact: for each pair of objects whether they ignore each other, their friction and their thickness. It exists
//! only in scenes with rules.
//!
//! *Objects* are the garments, then the bodies, then parts of garments that rules name.

use std::ops::Range;

use crate::scene::{ContactRule, ContactSide, Scene, SceneDescription};

/// Groups of objects that one mask can tell apart.
const GROUPS: usize = u64::BITS as usize;

/// In the place of the garment of a body.
const NO_GARMENT: u32 = u32::MAX;

/// Entry of two objects.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ContactEntry {
    /// Whether they pass through each other.
    pub is_ignored: bool,
    /// Coulomb friction, where a rule says it.
    pub friction: Option<f64>,
    /// Thickness, where a rule says it [m].
    pub thickness: Option<f64>,
}

/// The matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactMatrix {
    garments: usize,
    objects: usize,
    /// Garment of each object; none of bodies.
    garment_of: Vec<u32>,
    /// Entries of each object with each.
    entries: Vec<ContactEntry>,
}

/// Objects by whom they ignore: those that ignore the same ones are one group.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ContactGroups {
    /// Bit of the group of each object.
    of_object: Vec<u64>,
    /// Groups that each group may touch, one bit each.
    touched: Vec<u64>,
}

/// Numbers of the objects of a side: a garment and its parts, a part, or a body.
fn objects(description: &SceneDescription, side: ContactSide) -> Vec<usize> {
    let (garments, bodies) = (description.garments.len(), description.bodies.len());
    let first_part = |garment: usize| -> usize {
        garments + bodies + description.garments[..garment].iter().map(|garment| garment.parts.len()).sum::<usize>()
    };
    match side {
        ContactSide::Garment(garment) => {
            let first = first_part(garment);
            [garment].into_iter().chain(first..first + description.garments[garment].parts.len()).collect()
        }
        ContactSide::Part(garment, part) => vec![first_part(garment) + part],
        ContactSide::Body(body) => vec![garments + body],
    }
}

/// Pairs of objects that a rule speaks of. Where it names a part and its own garment, they are the part and the rest of the garment.
pub(crate) fn pairs_of_objects(description: &SceneDescription, rule: &ContactRule) -> Vec<[usize; 2]> {
    let [a, b] = rule.between;
    let is_own = |part: ContactSide, garment: ContactSide| matches!((part, garment), (ContactSide::Part(g, _), ContactSide::Garment(h)) if g == h);
    let is_with_rest = is_own(a, b) || is_own(b, a);
    let (these, those) = (objects(description, a), objects(description, b));
    let all = these.iter().flat_map(|a| those.iter().map(|b| [*a.min(b), *a.max(b)]));
    let mut pairs: Vec<[usize; 2]> = all.filter(|[a, b]| !(is_with_rest && a == b)).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Parts that a rule names: the more, the closer it describes its objects.
pub(crate) fn named_parts(rule: &ContactRule) -> usize {
    rule.between.iter().filter(|side| matches!(side, ContactSide::Part(..))).count()
}

/// The object of each own vertex of a rank: its garment, or a part of it.
pub(crate) fn objects_of_vertices(scene: &Scene) -> Vec<u32> {
    let (parts, description) = (scene.parts(), scene.description());
    let of_garment = |(garment, vertices): (usize, &Range<usize>)| {
        let named = &description.garments[garment].parts;
        let mut all = vec![garment as u32; if named.is_empty() { 0 } else { vertices.len() }];
        let numbers = objects(description, ContactSide::Garment(garment));
        for (object, vertices) in numbers[1..].iter().zip(named.values()) {
            vertices.iter().for_each(|vertex| all[*vertex as usize] = *object as u32);
        }
        all
    };
    let of_garments: Vec<Vec<u32>> = parts.partition().garments().iter().enumerate().map(of_garment).collect();
    let object = |vertex: usize| {
        let (garment, number) = parts.own_vertex(vertex);
        // Garments without parts have no list.
        of_garments[garment].get(number as usize).copied().unwrap_or(garment as u32)
    };
    parts.own().map(object).collect()
}

impl ContactMatrix {
    /// The matrix of a scene; `None` if it has no rules.
    pub fn of(description: &SceneDescription) -> Option<Self> {
        let (garments, bodies) = (description.garments.len(), description.bodies.len());
        let parts = (0..garments).flat_map(|garment| vec![garment as u32; description.garments[garment].parts.len()]);
        let bodies = (garments..garments + bodies).map(|_| NO_GARMENT);
        let garment_of: Vec<u32> = (0..garments as u32).chain(bodies).chain(parts).collect();
        let objects = garment_of.len();
        let mut entries = vec![ContactEntry::default(); objects * objects];
        let mut rules: Vec<&ContactRule> = description.contacts.iter().collect();
        rules.sort_by_key(|rule| named_parts(rule));
        for rule in rules {
            for [a, b] in pairs_of_objects(description, rule) {
                // What a closer rule leaves open is that of the rule for the whole garment.
                let wider = entries[a * objects + b];
                let entry = ContactEntry {
                    is_ignored: rule.ignore,
                    friction: rule.friction.or(wider.friction),
                    thickness: rule.thickness.or(wider.thickness),
                };
                (entries[a * objects + b], entries[b * objects + a]) = (entry, entry);
            }
        }
        (!description.contacts.is_empty()).then_some(Self { garments, objects, garment_of, entries })
    }

    /// The garment of an object; [`NO_GARMENT`] for a body.
    pub(crate) fn garment_of(&self, object: u32) -> u32 {
        self.garment_of.get(object as usize).copied().unwrap_or(NO_GARMENT)
    }

    /// Number of the objects.
    pub(crate) fn count(&self) -> usize {
        self.objects
    }

    /// Whether an object is cloth.
    pub(crate) fn is_cloth(&self, object: usize) -> bool {
        self.garment_of[object] != NO_GARMENT
    }

    /// Objects that are cloth.
    fn cloth(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.objects).filter(|object| self.is_cloth(*object))
    }

    /// The entry of two objects.
    #[inline]
    pub(crate) fn between(&self, a: usize, b: usize) -> &ContactEntry {
        &self.entries[a * self.objects + b]
    }

    /// The entry of two sides; of a garment, with what no rule for its parts speaks of.
    pub fn of_sides(&self, description: &SceneDescription, [a, b]: [ContactSide; 2]) -> &ContactEntry {
        self.between(objects(description, a)[0], objects(description, b)[0])
    }

    /// Number of a body among the objects.
    pub(crate) fn object_of_body(&self, body: usize) -> u32 {
        (self.garments + body) as u32
    }

    /// The entry of an object of cloth and a body.
    pub(crate) fn on_body(&self, object: usize, body: usize) -> &ContactEntry {
        self.between(object, self.garments + body)
    }

    /// Objects of the first of these sides, which are those of a rule, that have the thickness of the rule with the other: no closer rule
    /// sets another one.
    pub(crate) fn with_thickness_of(
        &self,
        description: &SceneDescription,
        rule: &ContactRule,
        [side, other]: [ContactSide; 2],
    ) -> Vec<usize> {
        let (pairs, others) = (pairs_of_objects(description, rule), objects(description, other));
        let is_by_rule = |a: usize, b: usize| {
            let entry = self.between(a, b);
            pairs.contains(&[a.min(b), a.max(b)]) && !entry.is_ignored && entry.thickness == rule.thickness
        };
        let mut all = objects(description, side);
        all.retain(|object| others.iter().any(|other| is_by_rule(*object, *other)));
        all
    }

    /// Whether a rule gives cloth a thickness on cloth.
    pub(crate) fn has_cloth_thickness(&self) -> bool {
        self.cloth().any(|object| self.largest_cloth_thickness(object) > 0.0)
    }

    /// Largest thickness that a rule gives an object of cloth with another one, or by itself [m]; zero without one.
    pub(crate) fn largest_cloth_thickness(&self, object: usize) -> f64 {
        self.cloth().filter_map(|other| self.between(object, other).thickness).fold(0.0, f64::max)
    }

    /// Largest thickness that a rule gives a body with a garment [m]; zero without one.
    pub(crate) fn largest_body_thickness(&self, body: usize) -> f64 {
        self.cloth().filter_map(|object| self.on_body(object, body).thickness).fold(0.0, f64::max)
    }

    /// The groups of the objects; `None` if no two ignore each other.
    ///
    /// Groups after the first 63 share the last bit, which touches everything: their pairs are sorted out one by one.
    pub(crate) fn groups(&self) -> Option<ContactGroups> {
        if !self.entries.iter().any(|entry| entry.is_ignored) {
            return None;
        }
        let row = |object: usize| {
            (0..self.objects).map(move |other| self.between(object, other).is_ignored).collect::<Vec<bool>>()
        };
        let mut rows: Vec<Vec<bool>> = Vec::new();
        let mut numbers = Vec::with_capacity(self.objects);
        for object in 0..self.objects {
            let own = row(object);
            let known = rows.iter().position(|other| *other == own);
            numbers.push(known.unwrap_or_else(|| {
                rows.push(own);
                rows.len() - 1
            }));
        }
        let bit = |group: usize| 1 << group.min(GROUPS - 1);
        let touches = |group: usize| {
            if group == GROUPS - 1 && rows.len() > GROUPS {
                return u64::MAX;
            }
            let is_touched = |object: &usize| !rows[group][*object];
            (0..self.objects).filter(is_touched).map(|object| bit(numbers[object])).fold(0, |all, bit| all | bit)
        };
        let mut touched: Vec<u64> = (0..rows.len().min(GROUPS)).map(touches).collect();
        if rows.len() > GROUPS {
            touched.iter_mut().for_each(|touched| *touched |= 1 << (GROUPS - 1));
        }
        Some(ContactGroups { of_object: numbers.into_iter().map(bit).collect(), touched })
    }
}

impl ContactGroups {
    /// Bit of the group of an object.
    #[inline]
    pub(crate) fn of_object(&self, object: u32) -> u64 {
        self.of_object[object as usize]
    }

    /// Whether anything of these groups may touch anything of those.
    #[inline]
    pub(crate) fn may_touch(&self, mut these: u64, those: u64) -> bool {
        while these != 0 {
            let group = these.trailing_zeros() as usize;
            if self.touched[group] & those != 0 {
                return true;
            }
            these &= these - 1;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec3;
    use crate::geometry::shapes::Shape;
    use crate::mesh::PolygonMesh;
    use crate::scene::{BodyDescription, BodyShape, GarmentDescription, RigidMotion};

    fn scene(garments: usize, ignored: &[[ContactSide; 2]]) -> SceneDescription {
        let mut description = SceneDescription::new("matrix");
        for g in 0..garments {
            let mesh = PolygonMesh::from_triangles(vec![Vec3::x(), Vec3::y(), Vec3::z()], &[[0, 1, 2]]);
            description.garments.push(GarmentDescription::new(&format!("g{g}"), mesh, 0.2));
        }
        let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.1 });
        description.bodies.push(BodyDescription::new("ball", ball, RigidMotion::at(Vec3::zeros())));
        let rule = |between: &[ContactSide; 2]| ContactRule { ignore: true, ..ContactRule::new(*between) };
        description.contacts = ignored.iter().map(rule).collect();
        description
    }

    #[test]
    fn groups_pass_over_what_all_of_them_ignore_and_nothing_else() {
        use ContactSide::{Body, Garment};
        // With more different rows than bits too: each garment ignores the next.
        let chain: Vec<[ContactSide; 2]> = (0..99).map(|g| [Garment(g), Garment(g + 1)]).collect();
        for (garments, ignored) in
            [(4, vec![[Garment(0), Garment(2)], [Garment(3), Garment(3)], [Garment(1), Body(0)]]), (100, chain)]
        {
            let matrix = ContactMatrix::of(&scene(garments, &ignored)).expect("there are rules");
            let groups = matrix.groups().expect("some are ignored");
            let mut passed_over = 0;
            for a in 0..=garments {
                for b in 0..=garments {
                    let may_touch = groups.may_touch(groups.of_object(a as u32), groups.of_object(b as u32));
                    assert!(may_touch || matrix.between(a, b).is_ignored, "{a} {b}");
                    passed_over += usize::from(!may_touch);
                    assert!(garments > 4 || may_touch != matrix.between(a, b).is_ignored, "{a} {b}");
                }
            }
            assert!(passed_over >= ignored.len(), "{passed_over}");
        }
        let none = ContactMatrix::of(&scene(2, &[])).is_none();
        assert!(none);
    }
}
