//! Surroundings of crossings between garments that are worn in an order: there one may pass through the other, to the side on which it
//! is worn.

use crate::contact::topology::pair::Pair;
use crate::contact::topology::surface::ContactSurface;
use crate::contact::topology::wearing_order::WearingOrder;
use crate::geometry::crossings::Crossing;

/// Rings of triangles around the crossings.
const RINGS: usize = 2;

/// Nodes close to crossings that the wearing order decides.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tangle {
    /// Numbers in the scene, ascending; alike on all ranks.
    nodes: Vec<u32>,
    order: Option<WearingOrder>,
}

impl Tangle {
    /// The surroundings of these crossings. All ranks call it together, with the same crossings.
    pub(crate) fn around(surface: &ContactSurface, crossings: &[Crossing]) -> Self {
        let Some(order) = surface.wearing_order() else { return Self::default() };
        let decided = crossings.iter().filter(|crossing| order.decides(crossing));
        let numbers: Vec<u32> = decided.flat_map(|c| c.edge.into_iter().chain(c.triangle)).collect();
        if numbers.is_empty() {
            return Self::default();
        }
        let nodes = surface.nodes();
        let mut marked = vec![0; nodes.count()];
        numbers.iter().filter_map(|number| nodes.local(*number)).for_each(|node| marked[node as usize] = 1);
        for _ in 0..RINGS {
            surface.grow(&mut marked);
            nodes.update(&mut marked);
        }
        let own: Vec<u32> =
            nodes.own().filter(|node| marked[*node] != 0).map(|node| nodes.number(node as u32)).collect();
        let mut all = nodes.ranks().all_gather_v(&own).concat();
        all.sort_unstable();
        Self { nodes: all, order: Some(order.clone()) }
    }

    /// Whether the two sides of a pair may pass through each other; its nodes have numbers of the scene.
    pub(crate) fn lets_pass(&self, pair: &Pair) -> bool {
        let is_decided = |order: &WearingOrder| order.compare(pair.nodes[0], pair.nodes[3]).is_some();
        self.order.as_ref().is_some_and(is_decided) && pair.nodes.iter().all(|number| self.contains(*number))
    }

    /// Whether a crossing is one that the order decides, of a line that was there before and may have come here.
    pub(crate) fn continues(&self, crossing: &Crossing) -> bool {
        self.order.as_ref().is_some_and(|order| order.decides(crossing))
            && crossing.edge.iter().chain(&crossing.triangle).all(|number| self.contains(*number))
    }

    fn contains(&self, number: u32) -> bool {
        self.nodes.binary_search(&number).is_ok()
    }
}
