//! Contact of vertices with bodies and with other cloth, for caches.

use rayon::prelude::*;

use super::Simulation;

impl Simulation {
    /// Contact of the vertices of each garment in its own order, between 0 and 1 (`docs/reference/scene.md`): on rank 0, `None`
    /// elsewhere. It changes nothing of the simulation. All ranks call it together.
    pub fn contact(&self) -> Option<Vec<Vec<f32>>> {
        let (scene, x, bodies) = (self.scene(), &self.cloth.state.x, &self.prescribed.bodies);
        let own = scene.parts().own();
        let mut contact = vec![0.0; scene.parts().local_count()];
        if let Some(collision) = &self.contacts.bodies {
            let of_own = contact[own.clone()].par_iter_mut().zip(own.into_par_iter());
            of_own.for_each(|(contact, vertex)| *contact = collision.contact(bodies, vertex, &x[vertex]));
        }
        if let Some(cloth) = &self.contacts.cloth {
            cloth.raise_contact(x, bodies, &mut contact);
        }
        // All of them first: a rank that has nothing to give on must not leave out the garments that follow.
        let all: Vec<_> = (0..scene.meshes().len()).map(|garment| scene.gather_numbers(garment, &contact)).collect();
        all.into_iter().collect()
    }
}
