//! Pairs that may pass through each other: those that cross, and close to crossings between garments that are worn in an order all of the
//! two, so that one passes to the side on which it is worn.

use crate::contact::intersections::exact::ignored_pairs;
use crate::contact::topology::pair::Pair;
use crate::contact::topology::surface::ContactSurface;
use crate::contact::topology::wearing_order::WearingOrder;
use crate::geometry::crossings::Crossing;

/// Rings of triangles around the crossings.
const RINGS: usize = 2;

/// Crossings as contact sees them, in numbers of the scene, alike on all ranks.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tangle {
    /// Pairs that cross, ascending.
    pairs: Vec<Pair>,
    /// Nodes close to crossings that the wearing order decides, ascending.
    nodes: Vec<u32>,
    /// The order, if it decides any.
    order: Option<WearingOrder>,
}

impl Tangle {
    /// The tangle of these crossings. All ranks call it together, with the same crossings.
    pub(crate) fn of(surface: &ContactSurface, crossings: &[Crossing]) -> Self {
        let pairs = ignored_pairs(crossings);
        let order = surface.wearing_order().filter(|order| crossings.iter().any(|crossing| order.decides(crossing)));
        let nodes = order.map(|order| surroundings(surface, crossings.iter().filter(|c| order.decides(c))));
        Self { pairs, nodes: nodes.unwrap_or_default(), order: order.cloned() }
    }

    /// Whether nothing crosses.
    pub(crate) fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Whether the two sides of a pair may pass through each other; its nodes have numbers of the scene.
    pub(crate) fn lets_pass(&self, pair: &Pair) -> bool {
        let is_decided = |order: &WearingOrder| order.compare(pair.nodes[0], pair.nodes[3]).is_some();
        let is_close = || pair.nodes.iter().all(|number| self.contains(*number));
        self.pairs.binary_search(pair).is_ok() || (self.order.as_ref().is_some_and(is_decided) && is_close())
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

/// Nodes within some rings of triangles around crossings, ascending.
fn surroundings<'a>(surface: &ContactSurface, crossings: impl Iterator<Item = &'a Crossing>) -> Vec<u32> {
    let nodes = surface.nodes();
    let mut marked = vec![0; nodes.count()];
    let numbers = crossings.flat_map(|c| c.edge.iter().chain(&c.triangle));
    numbers.filter_map(|number| nodes.local(*number)).for_each(|node| marked[node as usize] = 1);
    for _ in 0..RINGS {
        surface.grow(&mut marked);
        nodes.update(&mut marked);
    }
    let own: Vec<u32> = nodes.own().filter(|node| marked[*node] != 0).map(|node| nodes.number(node as u32)).collect();
    let mut all = nodes.ranks().all_gather_v(&own).concat();
    all.sort_unstable();
    all
}
