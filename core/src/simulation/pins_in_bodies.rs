//! Pinned vertices that a body covers: both motions are prescribed, so that no step can keep the cloth there free of intersections.

use super::start::depth_inside;
use super::{FrameInput, Simulation};
use crate::contact::bodies::Bodies;
use crate::error::Problems;
use crate::pins::HardPins;
use crate::scene::ContactSide;

/// The deepest of the pinned vertices that are inside a body at a frame and were outside of it at the start.
#[derive(Debug, Clone, PartialEq)]
pub struct PinInBody {
    /// Name of the garment.
    pub garment: String,
    /// Number of the vertex in its garment.
    pub vertex: u32,
    /// Name of the body.
    pub body: String,
    /// Depth below the surface of the body [m]; ten mean edges of the cloth where it is more.
    pub depth: f64,
    /// Pinned vertices that are inside a body.
    pub count: usize,
}

impl Simulation {
    /// True if a hard pin holds a vertex of this rank in all directions at some time and the scene has bodies.
    pub fn has_pins_near_bodies(&self) -> bool {
        let held = self.prescribed.pins.iter().flat_map(HardPins::fully_held).next().is_some();
        held && !self.scene.description().bodies.is_empty()
    }

    /// The deepest vertex that hard pins put into a body at the frame of `input`, of those that were outside of it at the start
    /// and not where the body crosses itself. For one rank, on which nothing has to be simulated for it.
    ///
    /// # Errors
    /// A body without a sample, or one whose sample does not fit.
    pub fn pins_inside_bodies_at(&self, input: &FrameInput) -> Result<Option<PinInBody>, Problems> {
        let Some(pins) = &self.prescribed.pins else { return Ok(None) };
        let time = self.scene.description().timeline.time(input.frame);
        let bodies = Bodies::new(&self.scene, &input.bodies, time)?;
        let mut deepest: Option<PinInBody> = None;
        let mut count = 0;
        for (vertex, target) in pins.fully_held() {
            let Some(x) = self.prescribed.targets.place_at(target, time, [&input.bodies, &input.tracks]) else {
                continue;
            };
            let start = &self.cloth.state.x[vertex];
            let was_outside = |body: usize| depth_inside(&self.scene, &self.prescribed.bodies, body, start).is_none();
            let garment = ContactSide::Garment(self.scene.parts().garment_of(vertex));
            let ignores = |body: usize| self.scene.description().ignores(garment, ContactSide::Body(body));
            let entered = (0..bodies.count())
                .filter(|body| !ignores(*body))
                .filter_map(|body| Some((depth_inside(&self.scene, &bodies, body, &x)?, body)))
                .filter(|(_, body)| !bodies.may_cross_itself(*body, &x, 0.0) && was_outside(*body));
            let Some((depth, body)) = entered.max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
            count += 1;
            if deepest.as_ref().is_none_or(|known| depth > known.depth) {
                let (garment, vertex) = self.scene.parts().own_vertex(vertex);
                let description = self.scene.description();
                let (garment, body) = (&description.garments[garment].name, &description.bodies[body].name);
                deepest = Some(PinInBody { garment: garment.clone(), vertex, body: body.clone(), depth, count: 0 });
            }
        }
        Ok(deepest.map(|deepest| PinInBody { count, ..deepest }))
    }
}
