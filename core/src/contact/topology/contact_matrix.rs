//! The matrix of contact: for each pair of objects whether they ignore each other, their friction and their thickness. It exists
//! only in scenes with rules.
//!
//! *Objects* are the garments, then the bodies.

use crate::scene::{ContactRule, ContactSide, SceneDescription};

/// Groups of objects that one mask can tell apart.
const GROUPS: usize = u64::BITS as usize;

/// Entry of two objects.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct ContactEntry {
    /// Whether they pass through each other.
    pub is_ignored: bool,
    /// Coulomb friction, where a rule says it.
    pub friction: Option<f64>,
    /// Thickness, where a rule says it [m].
    pub thickness: Option<f64>,
}

/// The matrix.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ContactMatrix {
    garments: usize,
    objects: usize,
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

/// Number of a garment or a body among the objects.
fn object(description: &SceneDescription, side: ContactSide) -> usize {
    match side {
        ContactSide::Garment(garment) => garment,
        ContactSide::Body(body) => description.garments.len() + body,
    }
}

impl ContactMatrix {
    /// The matrix of a scene; `None` if it has no rules.
    pub(crate) fn of(description: &SceneDescription) -> Option<Self> {
        let (garments, objects) = (description.garments.len(), description.garments.len() + description.bodies.len());
        let mut entries = vec![ContactEntry::default(); objects * objects];
        for ContactRule { between, ignore, friction, thickness } in &description.contacts {
            let [a, b] = between.map(|side| object(description, side));
            let entry = ContactEntry { is_ignored: *ignore, friction: *friction, thickness: *thickness };
            (entries[a * objects + b], entries[b * objects + a]) = (entry, entry);
        }
        (!description.contacts.is_empty()).then_some(Self { garments, objects, entries })
    }

    /// The entry of two objects.
    #[inline]
    pub(crate) fn between(&self, a: usize, b: usize) -> &ContactEntry {
        &self.entries[a * self.objects + b]
    }

    /// Number of a body among the objects.
    pub(crate) fn object_of_body(&self, body: usize) -> u32 {
        (self.garments + body) as u32
    }

    /// The entry of a garment and a body.
    pub(crate) fn on_body(&self, garment: usize, body: usize) -> &ContactEntry {
        self.between(garment, self.garments + body)
    }

    /// Whether a rule gives two garments, or one by itself, a thickness.
    pub(crate) fn has_cloth_thickness(&self) -> bool {
        (0..self.garments).any(|garment| self.largest_cloth_thickness(garment) > 0.0)
    }

    /// Largest thickness that a rule gives a garment with another one, or by itself [m]; zero without one.
    pub(crate) fn largest_cloth_thickness(&self, garment: usize) -> f64 {
        (0..self.garments).filter_map(|other| self.between(garment, other).thickness).fold(0.0, f64::max)
    }

    /// Largest thickness that a rule gives a body with a garment [m]; zero without one.
    pub(crate) fn largest_body_thickness(&self, body: usize) -> f64 {
        (0..self.garments).filter_map(|garment| self.on_body(garment, body).thickness).fold(0.0, f64::max)
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
