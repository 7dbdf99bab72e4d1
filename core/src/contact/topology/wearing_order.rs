//! The order in which garments are worn: which of two is outside.

use std::cmp::Ordering;

use crate::geometry::crossings::Crossing;
use crate::scene::Scene;

/// Layers of garments, by the scene's numbers of their vertices.
#[derive(Debug, Clone)]
pub(crate) struct WearingOrder {
    /// First vertex of each garment, and the number of all at the end.
    starts: Vec<u32>,
    /// Layer of each garment.
    layers: Vec<Option<u32>>,
}

impl WearingOrder {
    /// The order of a scene; `None` if no two of its garments have different layers.
    pub(crate) fn of(scene: &Scene) -> Option<Self> {
        let layers: Vec<Option<u32>> = scene.description().garments.iter().map(|garment| garment.layer).collect();
        let mut known = layers.iter().flatten();
        let first = known.next()?;
        known.any(|layer| layer != first).then(|| {
            let partition = scene.parts().partition();
            let starts = partition.garments().iter().map(|garment| garment.start as u32);
            Self { starts: starts.chain([partition.vertex_count() as u32]).collect(), layers }
        })
    }

    /// Layer of the garment of a vertex; `None` for one without a layer, and for points of bodies.
    fn layer(&self, number: u32) -> Option<u32> {
        let garment = self.starts.partition_point(|start| *start <= number) - 1;
        *self.layers.get(garment)?
    }

    /// Whether the garment of the first vertex is worn outside or inside of that of the second; `None` where no order says so.
    pub(crate) fn compare(&self, a: u32, b: u32) -> Option<Ordering> {
        Some(self.layer(a)?.cmp(&self.layer(b)?)).filter(|order| order.is_ne())
    }

    /// Whether the order says which side a crossing is to come out on.
    pub(crate) fn decides(&self, crossing: &Crossing) -> bool {
        self.compare(crossing.edge[0], crossing.triangle[0]).is_some()
    }
}
