//! B.7: what bodies would meet in the next step goes with them.

use rayon::prelude::*;

use super::marks::{CHUNK, marked};
use super::{BodyCollision, BodyContact};
use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::friction::coulomb;

impl BodyCollision {
    /// B.7: no vertex approaches a body that it would touch in the next step, and friction acts with the full load.
    /// The look-ahead is relative to the body (`docs/theory/friction.md#corrections`). `x` and `v` are those of own vertices;
    /// `concerns` tells which of them, by their places in it, this is about.
    pub(crate) fn final_velocity(
        &self,
        (bodies, dt): (&Bodies, f64),
        concerns: &(impl Fn(usize) -> bool + Sync),
        (x, v): (&[Vec3], &mut [Vec3]),
    ) {
        let chunks = v.par_chunks_mut(CHUNK).zip(&self.contacts).zip(&self.marks).enumerate();
        chunks.for_each(|(c, ((v, contacts), marks))| {
            for i in marked(marks.near).filter(|i| concerns(c * CHUNK + i)) {
                let (x, v) = (&x[c * CHUNK + i], &mut v[i]);
                for hold in contacts[i].holds.iter().flatten() {
                    let ahead = hold.at.phi + dt * (*v - hold.at.velocity).dot(&hold.at.normal);
                    if ahead < hold.offset && hold.is_met(bodies, x, v) {
                        *v = coulomb(v, &hold.at.velocity, &hold.at.normal, hold.friction);
                    }
                }
            }
        });
    }
}

impl BodyContact {
    /// Whether a vertex at `x` [m] with the velocity `v` [m/s], which meets the tangent plane of the nearest place, meets the body
    /// there too.
    ///
    /// Close to the body the plane is the body. From farther away a fast body passes by what its planes sweep over: the nearest
    /// place of a box from the side is on an edge.
    fn is_met(&self, bodies: &Bodies, x: &Vec3, v: &Vec3) -> bool {
        let room = self.at.phi - self.offset;
        let swept = self.at.velocity.dot(&self.at.normal) * bodies.dt();
        if room <= self.offset || 2.0 * swept <= room {
            return true;
        }
        let relative = v - self.at.velocity;
        let meeting = x - relative * (room / relative.dot(&self.at.normal));
        let reach = self.offset + 0.5 * room;
        let nearest = bodies.closest(self.body, &meeting, &meeting, reach, Some(self.at.triangle));
        nearest.is_some_and(|at| at.phi <= reach)
    }
}
