//! The triangles, edges and vertices that can touch: all garments, then all bodies, in one numbering.
//!
//! *Nodes* are the cloth's vertices in solver order, followed by the points of the bodies (`nodes` says which of
//! them a rank knows). Of the cloth a rank has the triangles with a vertex of its own; of the bodies, all.

use std::ops::Range;

use rayon::prelude::*;

use crate::Vec3;
use crate::contact::bodies::Bodies;
use crate::contact::bodies::collision;
use crate::contact::topology::body_points::BodyPoints;
use crate::contact::topology::cloth_surface::LocalClothSurface;
use crate::contact::topology::common_rigid_motion::Samples;
use crate::contact::topology::faces::{Faces, Sides};
use crate::contact::topology::nodes::{ContactNodes, IndexMap};
use crate::contact::topology::pair::Pair;
use crate::contact::topology::pair_friction::{PairFriction, painted_sum};
use crate::contact::topology::wearing_order::WearingOrder;
use crate::geometry::crossings::Crossing;
use crate::parallel::halo::GhostedArray;
use crate::parallel::ranks::Ranks;
use crate::scene::contact_matrix::{ContactGroups, ContactMatrix};
use crate::scene::{BodyShape, Scene};

/// Nodes that one task looks at.
const CHUNK: usize = 4096;

/// Object of a node that is not known yet.
const UNKNOWN: u32 = u32::MAX;

/// The surfaces of a scene that can touch.
#[derive(Debug, Clone)]
pub(crate) struct ContactSurface {
    nodes: ContactNodes,
    /// Ghosts that are there always, by their numbers in the scene, ascending: the other corners of own triangles.
    corners: Vec<u32>,
    cloth: Faces,
    bodies: Faces,
    sides: [Sides; 2],
    /// Bodies with triangles and their first points, counted over all of them, in their order.
    first_points: Vec<(usize, u32)>,
    /// Repulsion of pairs by each of them in the solves, in the same order; empty if they do not repel.
    body_repulsion: Vec<BodyRepulsion>,
    /// Range of the own vertices in arrays over the scene's local vertices.
    place: Range<usize>,
    samples: Samples,
    /// Arrays over the nodes: thickness that repulsions keep, zero for bodies [m].
    thickness: Vec<f64>,
    /// Factor on the friction of cloth on cloth, and term added to it; `None` if it is nowhere painted.
    friction: Option<Vec<[f64; 2]>>,
    /// The same on the friction of bodies, which have none themselves.
    body_friction: Option<Vec<[f64; 2]>>,
    /// Positions at rest, zero for bodies [m].
    rest: Vec<Vec3>,
    /// Object of each node: garments, then bodies, then parts of garments.
    object: Vec<u32>,
    /// Rules of contact by pair; `None` in scenes without rules.
    rules: Option<Rules>,
    /// Order in which garments are worn; `None` if no two of them have a layer.
    wearing_order: Option<WearingOrder>,
    /// Mean rest length of the edges of each node [m]; of all cloth for bodies.
    edge_length: Vec<f64>,
    /// Inverse masses per axis, zero where held [1/kg].
    mobility: Vec<Vec3>,
    longest_edge: f64,
    /// Origin that positions are counted from where single precision stores them [m].
    origin: Vec3,
}

/// Repulsion of edges and faces of cloth by a body in the solves of long steps; the body's own contact
/// keeps the vertices away.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BodyRepulsion {
    /// Distance that is kept [m].
    pub thickness: f64,
    /// Coulomb friction coefficient.
    pub friction: f64,
}

/// Rules of contact by pair, as far as a surface needs them.
#[derive(Debug, Clone)]
struct Rules {
    matrix: ContactMatrix,
    /// Groups by what ignores what; `None` if nothing ignores anything.
    groups: Option<ContactGroups>,
    /// Largest thickness that short edges allow at each node, zero for bodies [m]; `None` where no rule gives cloth a thickness.
    largest_thickness: Option<Vec<f64>>,
}

/// Share of the thickness of a body that edges and faces keep. They cut corners where vertices lie on a round body at its thickness.
const OF_BODY_THICKNESS: f64 = 2.0 / 3.0;

/// Friction of what is not painted.
const PLAIN: [f64; 2] = [1.0, 0.0];

/// The triangles of a body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyFaces<'a> {
    /// Its number among the bodies.
    pub body: usize,
    /// Its triangles, by its own points.
    pub triangles: &'a [[u32; 3]],
    /// Number of its points.
    pub points: usize,
}

impl ContactSurface {
    /// The surfaces of a scene; `clamp` is the largest thickness of a vertex as a fraction of its shortest rest edge.
    pub(crate) fn new(scene: &Scene, clamp: f64) -> Self {
        let of_body = |(body, shape): (usize, _)| match shape {
            &BodyShape::Surface { ref triangles, point_count } => {
                Some(BodyFaces { body, triangles, points: point_count })
            }
            BodyShape::Rigid(_) => scene.shape_mesh(body).map(|mesh| BodyFaces {
                body,
                triangles: &mesh.triangles,
                points: mesh.points.len(),
            }),
        };
        let shapes = scene.description().bodies.iter().map(|body| &body.shape).enumerate();
        // Without their effect bodies are there only for pins to follow.
        let collide = scene.description().effects.iter().any(|request| request.effect == collision::EFFECT);
        let bodies: Vec<BodyFaces<'_>> = shapes.filter(|_| collide).filter_map(of_body).collect();
        let surface = Self::of_share(LocalClothSurface::of(scene, clamp), &bodies);
        let starts = scene.parts().partition().starts().iter().map(|start| *start as u32);
        Self { nodes: surface.nodes.with_parts(starts), origin: scene.origin(), ..surface }
    }

    /// The same, with bodies that repel edges and faces of cloth, as they do in the solves of long steps.
    pub(crate) fn with_repelling_bodies(self, scene: &Scene) -> Self {
        let repulsion = |(body, _): &(usize, u32)| {
            let description = &scene.description().bodies[*body];
            BodyRepulsion { thickness: OF_BODY_THICKNESS * description.thickness, friction: description.friction }
        };
        Self { body_repulsion: self.first_points.iter().map(repulsion).collect(), ..self }
    }

    /// The surfaces that a rank has. All ranks call it together.
    pub(crate) fn of_share(share: LocalClothSurface, bodies: &[BodyFaces<'_>]) -> Self {
        let LocalClothSurface { ranks, rank_starts, mut triangles, mean_edge, .. } = share;
        // Neighbours on the cloth become neighbours in memory, as the vertices are.
        triangles.sort_by_key(|t| t.iter().copied().min());
        let own = rank_starts[ranks.rank()]..rank_starts[ranks.rank() + 1];
        let mut corners: Vec<u32> = triangles.iter().flatten().copied().filter(|v| !own.contains(v)).collect();
        corners.sort_unstable();
        corners.dedup();
        let points = bodies.iter().map(|body| body.points).sum();
        let nodes = ContactNodes::new(&ranks, &rank_starts, corners.clone(), points);
        let local = |v: u32| nodes.local(v).expect("the corners of all triangles are own or ghosts");
        let triangles = triangles.iter().map(|t| t.map(local)).collect();
        let (cloth, cloth_sides) = Faces::new(triangles, |node| nodes.is_own(node));
        let (mut of_bodies, mut first_points, mut first) = (Vec::new(), Vec::new(), 0);
        for body in bodies {
            of_bodies.extend(body.triangles.iter().map(|t| t.map(|v| v + first + nodes.cloth() as u32)));
            first_points.push((body.body, first));
            first += body.points as u32;
        }
        let (of_bodies, body_sides) = Faces::new(of_bodies, |_| true);
        let longest = share.edge_length.iter().copied().fold(if points > 0 { mean_edge } else { 0.0 }, f64::max);
        let mobility: Vec<Vec3> = share.mobility.iter().map(|w| Vec3::repeat(*w)).collect();
        let rules = share.matrix.map(|matrix| Rules {
            groups: matrix.groups(),
            largest_thickness: share.largest_thickness.map(|largest| over_nodes(&nodes, largest, 0.0)),
            matrix,
        });
        let mut object = over_nodes(&nodes, share.object, UNKNOWN);
        if let Some(rules) = &rules {
            for (body, (number, first)) in bodies.iter().zip(&first_points) {
                let points = nodes.cloth() + *first as usize..nodes.cloth() + *first as usize + body.points;
                object[points].fill(rules.matrix.object_of_body(*number));
            }
        }
        let mut surface = Self {
            thickness: over_nodes(&nodes, share.thickness, 0.0),
            friction: share.friction.map(|painted| over_nodes(&nodes, painted, PLAIN)),
            body_friction: share.body_friction.map(|painted| over_nodes(&nodes, painted, [0.0; 2])),
            rest: over_nodes(&nodes, share.rest, Vec3::zeros()),
            object,
            rules,
            wearing_order: share.wearing_order,
            edge_length: over_nodes(&nodes, share.edge_length, mean_edge),
            mobility: over_nodes(&nodes, mobility, Vec3::zeros()),
            longest_edge: ranks.max(longest),
            origin: Vec3::zeros(),
            samples: Samples::new(&ranks, share.blocks, share.block_starts),
            nodes,
            corners,
            cloth,
            bodies: of_bodies,
            sides: [cloth_sides, body_sides],
            first_points,
            body_repulsion: Vec::new(),
            place: share.place,
        };
        surface.refresh();
        surface
    }

    /// Brings what is known of the ghosts to what their owners know.
    fn refresh(&mut self) {
        let Self { thickness, friction, body_friction, rest, object, rules, edge_length, mobility, .. } = self;
        let mut known: Vec<&mut dyn GhostedArray> = vec![thickness, rest, object, edge_length, mobility];
        known.extend([friction, body_friction].into_iter().flatten().map(|painted| painted as &mut dyn GhostedArray));
        if let Some(Rules { largest_thickness: Some(largest), .. }) = rules {
            known.push(largest);
        }
        self.nodes.update_all(&mut known);
    }

    /// Replaces the ghosts by these, and those without which there are no triangles; numbers of the scene, ascending. All ranks
    /// call it together. Returns what nodes are called now, unless nothing has changed on any rank.
    pub(crate) fn set_ghosts(&mut self, ghosts: Vec<u32>) -> Option<IndexMap> {
        let ranks = self.ranks().clone();
        if ranks.is_alone() {
            return None;
        }
        let ghosts = union(ghosts, &self.corners);
        if !ranks.any(ghosts != self.nodes.ghosts()) {
            return None;
        }
        let nodes = self.nodes.with_ghosts(ghosts);
        let renumber = self.set_nodes(nodes);
        self.refresh();
        Some(renumber)
    }

    /// Goes over to other nodes, among them the corners of all triangles. What is known of those that are new is yet to be
    /// fetched; where none is, this is no matter of other ranks.
    pub(crate) fn set_nodes(&mut self, nodes: ContactNodes) -> IndexMap {
        let renumber = IndexMap::between(&self.nodes, &nodes);
        [&mut self.cloth, &mut self.bodies].into_iter().for_each(|faces| faces.renumber(&renumber));
        let edges = self.sides.iter_mut().flatten().map(|(edge, _)| edge);
        renumber.renumber(edges.flatten());
        renumber.apply(&mut self.thickness, 0.0);
        for (painted, unknown) in [(&mut self.friction, PLAIN), (&mut self.body_friction, [0.0; 2])] {
            painted.iter_mut().for_each(|painted| renumber.apply(painted, unknown));
        }
        renumber.apply(&mut self.rest, Vec3::zeros());
        renumber.apply(&mut self.object, UNKNOWN);
        if let Some(Rules { largest_thickness: Some(largest), .. }) = &mut self.rules {
            renumber.apply(largest, 0.0);
        }
        renumber.apply(&mut self.edge_length, 0.0);
        renumber.apply(&mut self.mobility, Vec3::zeros());
        self.nodes = nodes;
        renumber
    }

    /// The nodes that this rank knows.
    pub(crate) fn nodes(&self) -> &ContactNodes {
        &self.nodes
    }

    /// Number of nodes here, ghosts and bodies included.
    pub(crate) fn node_count(&self) -> usize {
        self.nodes.count()
    }

    /// This rank and the others.
    pub(crate) fn ranks(&self) -> &Ranks {
        self.nodes.ranks()
    }

    /// Triangles of cloth with a node of this rank, and what is canonical here.
    pub(crate) fn cloth(&self) -> &Faces {
        &self.cloth
    }

    /// Triangles of the bodies.
    pub(crate) fn bodies(&self) -> &Faces {
        &self.bodies
    }

    /// Returns the nodes that stand for all in fits of common motion.
    pub(crate) fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Returns the range of the own vertices in arrays over the scene's local vertices.
    pub(crate) fn place(&self) -> Range<usize> {
        self.place.clone()
    }

    /// Thickness of each node, zero for bodies [m].
    pub(crate) fn thickness(&self) -> &[f64] {
        &self.thickness
    }

    /// Friction of cloth on cloth, as it is painted and as rules have it.
    pub(crate) fn friction(&self) -> PairFriction<'_> {
        let rules = self.rules.as_ref().map(|rules| (&rules.matrix, self.object.as_slice()));
        PairFriction { painted: self.friction.as_deref(), rules }
    }

    /// Friction of a pair of cloth with a body, as it is painted on the cloth where they touch.
    pub(crate) fn friction_on(&self, body: BodyRepulsion, nodes: [u32; 4], weights: [f64; 4]) -> f64 {
        let Some(painted) = &self.body_friction else { return body.friction };
        painted_sum(painted, body.friction, nodes.into_iter().zip(weights).filter(|(node, _)| !self.is_body(*node)))
    }

    /// The groups of objects by what ignores what; `None` if nothing ignores anything.
    pub(crate) fn groups(&self) -> Option<ObjectGroups<'_>> {
        let groups = self.rules.as_ref().and_then(|rules| rules.groups.as_ref())?;
        Some(ObjectGroups { groups, surface: self })
    }

    /// Whether two elements, by their nodes, are of objects that pass through each other.
    #[inline]
    pub(crate) fn is_ignored(&self, a: &[u32], b: &[u32]) -> bool {
        self.rules.as_ref().is_some_and(|_| self.ignores(self.object_of(a), self.object_of(b)))
    }

    /// The object of an edge or a triangle: of all its nodes, or the garment where they are of several of its parts.
    pub(crate) fn object_of(&self, nodes: &[u32]) -> u32 {
        self.common_object(nodes.iter().map(|node| self.object(*node)))
    }

    /// The object of an element whose nodes have these objects.
    pub(crate) fn common_object(&self, mut objects: impl Iterator<Item = u32>) -> u32 {
        let first = objects.next().unwrap_or(UNKNOWN);
        if objects.all(|object| object == first) { first } else { self.garment_of(first) }
    }

    /// The garment of a node of cloth.
    pub(crate) fn garment(&self, node: u32) -> u32 {
        self.garment_of(self.object(node))
    }

    fn garment_of(&self, object: u32) -> u32 {
        self.rules.as_ref().map_or(object, |rules| rules.matrix.garment_of(object))
    }

    /// Whether two objects pass through each other.
    pub(crate) fn ignores(&self, a: u32, b: u32) -> bool {
        self.rules.as_ref().is_some_and(|rules| rules.matrix.between(a as usize, b as usize).is_ignored)
    }

    /// Object of a node.
    pub(crate) fn object(&self, node: u32) -> u32 {
        self.object[node as usize]
    }

    /// The order in which garments are worn; `None` if no two of them have a layer.
    pub(crate) fn wearing_order(&self) -> Option<&WearingOrder> {
        self.wearing_order.as_ref()
    }

    /// Thickness of a pair of cloth with cloth [m] (`docs/theory/self_contact.md#repulsion-with-history`).
    pub(crate) fn pair_thickness(&self, pair: &Pair) -> f64 {
        let of_nodes = |thickness: &[f64]| {
            let [a, b] = pair.fold(thickness, f64::min);
            a.max(b)
        };
        let by_rule = |rules: &Rules| {
            let largest = of_nodes(rules.largest_thickness.as_ref()?);
            let [a, b] = [pair.nodes[0], pair.nodes[3]].map(|node| self.object[node as usize] as usize);
            Some(rules.matrix.between(a, b).thickness?.min(largest))
        };
        self.rules.as_ref().and_then(by_rule).unwrap_or_else(|| of_nodes(&self.thickness))
    }

    /// Nodes at rest, bodies at zero [m].
    pub(crate) fn rest(&self) -> &[Vec3] {
        &self.rest
    }

    /// Mean rest length of the edges of each node [m]; of all cloth for bodies.
    pub(crate) fn edge_length(&self) -> &[f64] {
        &self.edge_length
    }

    /// Longest entry of `edge_length` on any rank [m].
    pub(crate) fn longest_edge(&self) -> f64 {
        self.longest_edge
    }

    /// Inverse masses of the nodes per axis, zero where held [1/kg].
    pub(crate) fn mobility(&self) -> &[Vec3] {
        &self.mobility
    }

    /// One on the axes on which a node is free, zero where it is held.
    pub(crate) fn free_axes(&self, node: usize) -> Vec3 {
        self.mobility[node].map(|mobility| f64::from(u8::from(mobility > 0.0)))
    }

    /// Changes the inverse masses of own nodes. All ranks call it together.
    pub(crate) fn change_mobility(&mut self, change: impl FnOnce(&mut [Vec3])) {
        change(&mut self.mobility);
        self.nodes.update(&mut self.mobility);
    }

    /// Positions of all nodes [m]: cloth at `x`, over the scene's local vertices, bodies where they stand at the end of their
    /// step. All ranks call it together.
    pub(crate) fn gather(&self, x: &[Vec3], bodies: &Bodies, nodes: &mut Vec<Vec3>) {
        nodes.clear();
        nodes.resize(self.nodes.own().start, Vec3::zeros());
        nodes.extend_from_slice(&x[self.place.clone()]);
        nodes.resize(self.nodes.cloth(), Vec3::zeros());
        self.first_points.iter().for_each(|(body, _)| nodes.extend_from_slice(bodies.contact_positions(*body)));
        self.nodes.update(nodes);
    }

    /// Positions of all nodes after a duration [s] from a time [s] on, at which they are at `x`: of cloth as its velocities `v` have it, over
    /// the scene's local vertices [m/s], of bodies as they move. All ranks call it together.
    pub(crate) fn predict(&self, x: &[Vec3], v: &[Vec3], bodies: &Bodies, [time, duration]: [f64; 2]) -> Vec<Vec3> {
        let mut nodes = x[..self.nodes.cloth()].to_vec();
        for (x, v) in nodes[self.nodes.own()].iter_mut().zip(&v[self.place.clone()]) {
            *x += v * duration;
        }
        for (body, _) in &self.first_points {
            bodies.extend_with_contact_positions_at(*body, time + duration, &mut nodes);
        }
        self.nodes.update(&mut nodes);
        nodes
    }

    /// Longest way of a node between these two positions of all nodes [m], besides the motion that all have in common, as a share of its
    /// edges. All ranks call it together.
    pub(crate) fn largest_displacement(&self, [start, end]: [&[Vec3]; 2]) -> f64 {
        let centre = self.samples.centre(&self.nodes, start);
        let [common, _] = self.samples.fits(&self.nodes, start, centre, [end; 2]);
        let of_node = |((start, end), edge): ((&Vec3, &Vec3), &f64)| (end - common.apply(start)).norm() / edge;
        let nodes = start.par_iter().zip(end).zip(&self.edge_length).with_min_len(CHUNK);
        self.ranks().max(nodes.map(of_node).reduce(|| 0.0, f64::max))
    }

    /// Positions and velocities of all nodes at a fraction of a step [m], [m/s]: cloth has `x` and `v`, over the scene's local
    /// vertices. All ranks call it together.
    pub(crate) fn gather_stage(
        &self,
        [x, v]: [&[Vec3]; 2],
        bodies: &Bodies,
        fraction: f64,
        [nodes, velocities]: &mut [Vec<Vec3>; 2],
    ) {
        for (all, own) in [(&mut *nodes, x), (&mut *velocities, v)] {
            all.clear();
            all.resize(self.nodes.cloth(), Vec3::zeros());
            all[self.nodes.own()].copy_from_slice(&own[self.place.clone()]);
        }
        self.nodes.update_all(&mut [nodes, velocities]);
        for (body, _) in &self.first_points {
            let (path, dt) = (bodies.contact_path(*body), bodies.dt());
            for (start, end) in path[0].iter().zip(path[1]) {
                nodes.push(start + (end - start) * fraction);
                velocities.push((end - start) / dt);
            }
        }
    }

    /// Returns the origin that positions are counted from where single precision stores them [m].
    pub(crate) fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Whether all nodes of a pair are of one garment.
    pub(crate) fn is_one_garment(&self, pair: &Pair) -> bool {
        let [a, b, c, d] = pair.nodes.map(|node| self.garment(node));
        a == b && b == c && c == d
    }

    /// Largest distance that repulsions keep around a node [m].
    pub(crate) fn kept_distance(&self, node: usize) -> f64 {
        if node >= self.nodes.cloth() {
            return self.body_at(node as u32).map_or(0.0, |(body, repulsion)| {
                let by_rule = self.rules.as_ref().map_or(0.0, |rules| rules.matrix.largest_body_thickness(body));
                repulsion.thickness.max(OF_BODY_THICKNESS * by_rule)
            });
        }
        let by_rule = |rules: &Rules| {
            let largest = rules.largest_thickness.as_ref()?[node];
            Some(rules.matrix.largest_cloth_thickness(self.object[node] as usize).min(largest))
        };
        self.thickness[node].max(self.rules.as_ref().and_then(by_rule).unwrap_or(0.0))
    }

    /// Returns the repulsion by the body that a pair has a point of, if it has one and the body repels in the solves.
    pub(crate) fn body_of(&self, nodes: &[u32; 4]) -> Option<BodyRepulsion> {
        let point = nodes.iter().find(|&&node| self.is_body(node))?;
        let (body, repulsion) = self.body_at(*point)?;
        let Some(rules) = &self.rules else { return Some(*repulsion) };
        let cloth = nodes.iter().find(|&&node| !self.is_body(node))?;
        let entry = rules.matrix.on_body(self.object[*cloth as usize] as usize, body);
        Some(BodyRepulsion {
            thickness: entry.thickness.map_or(repulsion.thickness, |thickness| OF_BODY_THICKNESS * thickness),
            friction: entry.friction.unwrap_or(repulsion.friction),
        })
    }

    /// Returns the body that this point belongs to, and its repulsion in the solves.
    fn body_at(&self, node: u32) -> Option<(usize, &BodyRepulsion)> {
        let point = node - self.nodes.cloth() as u32;
        let last = self.first_points.partition_point(|(_, first)| *first <= point) - 1;
        Some((self.first_points[last].0, self.body_repulsion.get(last)?))
    }

    /// Whether repulsions act on a pair: between cloth and cloth; bodies have their own contact.
    pub(crate) fn repels(&self, pair: &Pair) -> bool {
        !pair.nodes.iter().any(|&node| self.is_body(node))
    }

    /// Whether a node belongs to a body.
    pub(crate) fn is_body(&self, node: u32) -> bool {
        self.nodes.is_body(node)
    }

    /// Whether an edge of cloth crosses a triangle of cloth, and no body has part in it. Crossings have numbers of the scene.
    pub(crate) fn is_cloth(&self, crossing: &Crossing) -> bool {
        !crossing.edge.iter().chain(&crossing.triangle).any(|&number| number >= self.nodes.global_cloth_count())
    }

    /// Whether cloth crosses a body where that body crosses itself. Crossings have numbers of the scene.
    pub(crate) fn is_pinched(&self, crossing: &Crossing, bodies: &Bodies) -> bool {
        let points = self.body_points();
        let mut numbers = crossing.edge.iter().chain(&crossing.triangle);
        numbers.any(|number| points.get(*number).is_some_and(|(body, point)| bodies.crosses_itself_at(body, point)))
    }

    /// The points of bodies by their numbers in the scene.
    pub(crate) fn body_points(&self) -> BodyPoints {
        BodyPoints::new(self.nodes.global_cloth_count(), &self.first_points)
    }

    /// Marks the corners of all triangles of cloth that have a marked corner; right for own nodes.
    pub(crate) fn grow(&self, marked: &mut [u8]) {
        let is_touched = |corners: &&[u32; 3]| corners.iter().any(|&node| marked[node as usize] != 0);
        let touched: Vec<u32> = self.cloth.triangles().iter().filter(is_touched).flatten().copied().collect();
        touched.iter().for_each(|&node| marked[node as usize] = 1);
    }

    /// The triangles that have an edge, given with its smaller node first; all of them on its canonical rank.
    pub(crate) fn triangles_of_edge(&self, edge: [u32; 2]) -> impl Iterator<Item = [u32; 3]> + '_ {
        let kind = usize::from(self.is_body(edge[0]));
        let (sides, triangles) = (&self.sides[kind], [&self.cloth, &self.bodies][kind].triangles());
        let first = sides.partition_point(|(e, _)| *e < edge);
        let same = sides[first..].iter().take_while(move |(e, _)| *e == edge);
        same.map(|(_, triangle)| triangles[*triangle as usize])
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        let sides = self.sides.iter().map(Vec::len).sum::<usize>() * size_of::<([u32; 2], u32)>();
        let traits = 2 * size_of::<f64>() + 2 * size_of::<Vec3>() + size_of::<u32>();
        let painted = [&self.friction, &self.body_friction].into_iter().flatten();
        let friction: usize = painted.map(|painted| size_of_val(painted.as_slice())).sum();
        let largest = self.rules.as_ref().and_then(|rules| rules.largest_thickness.as_ref());
        let rules = largest.map_or(0, |largest| size_of_val(largest.as_slice()));
        self.cloth.bytes() + self.bodies.bytes() + sides + self.nodes.count() * traits + friction + rules
    }
}

/// Groups of objects by what ignores what, for a search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ObjectGroups<'a> {
    groups: &'a ContactGroups,
    surface: &'a ContactSurface,
}

impl<'a> ObjectGroups<'a> {
    /// The groups.
    pub(crate) fn groups(&self) -> &'a ContactGroups {
        self.groups
    }

    /// Bit of the group of an element with these nodes.
    pub(crate) fn of_element(&self, nodes: &[u32]) -> u64 {
        self.groups.of_object(self.surface.object_of(nodes))
    }
}

/// An array over all nodes from one over own vertices, with `body` for points of bodies.
fn over_nodes<T: Clone>(nodes: &ContactNodes, own: Vec<T>, body: T) -> Vec<T> {
    if nodes.count() == own.len() {
        return own;
    }
    let mut all = vec![body; nodes.count()];
    all[nodes.own()].clone_from_slice(&own);
    all
}

/// Both lists in one, ascending.
fn union(mut a: Vec<u32>, b: &[u32]) -> Vec<u32> {
    a.extend_from_slice(b);
    a.sort_unstable();
    a.dedup();
    a
}
