//! Bodies that nodes of other ranks lie on.

use crate::Vec3;
use crate::contact::bodies::constraints::{HOLDS, Support, Supports};
use crate::contact::topology::nodes::ContactNodes;

/// Gives ghosts the supports of their owners. All ranks call it together.
pub(crate) fn tell_ghosts(nodes: &ContactNodes, all: &mut [Supports]) {
    // Four numbers each; nothing has a normal of zero.
    let numbers = |support: &Option<Support>| {
        support.map_or([0.0; 4], |Support { normal, least }| [normal.x, normal.y, normal.z, least])
    };
    let mut told: Vec<[[f64; 4]; HOLDS]> = all.iter().map(|supports| supports.each_ref().map(numbers)).collect();
    nodes.refresh(&mut told);
    for node in nodes.ghost_places() {
        all[node] = told[node].map(|[x, y, z, least]| {
            let normal = Vec3::new(x, y, z);
            (normal != Vec3::zeros()).then_some(Support { normal, least })
        });
    }
}
