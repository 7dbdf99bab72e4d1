//! Part of the repulsions between layers that is borne by the bodies on which the layers lie.

use rayon::prelude::*;

use super::marks::{CHUNK, marked};
use super::{BodyCollision, BodyContact};
use crate::contact::bodies::constraints::{BodyConstraint, BodyConstraints};

impl BodyCollision {
    /// Finds the bodies that own vertices lie on after B.4, one entry for each; `dt` is the length of the step [s].
    pub(crate) fn supports(&self, dt: f64, all: &mut [BodyConstraints]) {
        let chunks = all.par_chunks_mut(CHUNK).zip(&self.contacts).zip(&self.marks);
        chunks.for_each(|((all, contacts), marks)| {
            all.fill(BodyConstraints::default());
            for i in marked(marks.near) {
                all[i] = contacts[i].holds.map(|hold| hold.map(|hold| hold.support(dt)));
            }
        });
    }
}

impl BodyContact {
    /// Returns the constraint of this body: a vertex in contact may not approach, a vertex that is near may come as
    /// close as contact.
    fn support(&self, dt: f64) -> BodyConstraint {
        let normal = self.at.normal;
        let room = if self.constraint.is_some() { 0.0 } else { (self.at.phi - self.offset).max(0.0) };
        BodyConstraint { normal, least: self.at.velocity.dot(&normal) - room / dt }
    }
}
