//! Bodies that nodes of other ranks lie on.

use crate::Vec3;
use crate::contact::bodies::constraints::{BodyConstraint, BodyConstraints, MAX_BODY_CONTACTS};
use crate::contact::topology::nodes::ContactNodes;

/// Sends the supports and the positions `x` of own nodes to their ghosts. All ranks call it together.
pub(crate) fn send_to_ghosts(nodes: &ContactNodes, all: &mut [BodyConstraints], x: &mut Vec<Vec3>) {
    // Four numbers each; nothing has a normal of zero.
    let numbers = |support: &Option<BodyConstraint>| {
        support.map_or([0.0; 4], |BodyConstraint { normal, least }| [normal.x, normal.y, normal.z, least])
    };
    let mut rows: Vec<[[f64; 4]; MAX_BODY_CONTACTS]> =
        all.iter().map(|constraints| constraints.each_ref().map(numbers)).collect();
    nodes.update_all(&mut [&mut rows, x]);
    for node in nodes.ghost_places() {
        all[node] = rows[node].map(|[x, y, z, least]| {
            let normal = Vec3::new(x, y, z);
            (normal != Vec3::zeros()).then_some(BodyConstraint { normal, least })
        });
    }
}
