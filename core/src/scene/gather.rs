//! Values of a garment's vertices from all ranks, in the garment's own order, on rank 0.

use bytemuck::Pod;

use super::{MergedVertex, Scene};
use crate::Vec3;
use crate::parallel::message::codec;

/// The number in its garment of the vertex that follows another in a row.
struct MergedNumber {
    row: u32,
    number: u32,
}

/// Value that the vertex in a row takes from the vertex that it follows.
struct MergedValue {
    row: u32,
    /// Position [m], velocity [m/s], or a number in every component.
    value: Vec3,
}

codec!(struct MergedNumber { row, number });
codec!(struct MergedValue { row, value });

/// A field of the vertices of a garment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VertexField {
    /// Positions [m]: what goes with another vertex keeps its distance from it.
    Positions,
    /// Velocities [m/s].
    Velocities,
}

/// Values of the local vertices of a rank.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalValues<'a> {
    /// Field that the values belong to.
    pub(crate) field: VertexField,
    /// One for each local vertex.
    pub(crate) values: &'a [Vec3],
}

impl LocalValues<'_> {
    /// The value of a merged vertex, from that of the vertex that it goes with.
    fn of_merged(&self, merged: &MergedVertex, leader: usize) -> Vec3 {
        match self.field {
            VertexField::Positions => self.values[leader] + merged.offset,
            VertexField::Velocities => self.values[leader],
        }
    }
}

impl Scene {
    /// The values of a garment in its own order: on rank 0, `None` elsewhere. All ranks call it together.
    pub(crate) fn gather_garment<T: Pod>(
        &self,
        garment: usize,
        local: LocalValues<'_>,
        convert: &(dyn Fn(&Vec3) -> T + Sync),
    ) -> Option<Vec<T>> {
        let mut all = self.gather_own(garment, &|vertex| convert(&local.values[vertex]));
        self.put_merged_vertices(garment, &|merged, leader| local.of_merged(merged, leader), convert, &mut all);
        self.parts().ranks().is_first().then_some(all)
    }

    /// One number for each vertex of a garment in its own order, of one for each local vertex: on rank 0, `None` elsewhere. What
    /// goes with another vertex has the number of that one. All ranks call it together.
    pub(crate) fn gather_numbers(&self, garment: usize, local: &[f64]) -> Option<Vec<f32>> {
        let mut all = self.gather_own(garment, &|vertex| local[vertex] as f32);
        // In the message of vectors, each with the number in all components.
        let of_leader = |_: &MergedVertex, leader: usize| Vec3::repeat(local[leader]);
        self.put_merged_vertices(garment, &of_leader, &|number| number.x as f32, &mut all);
        self.parts().ranks().is_first().then_some(all)
    }

    /// Values of a garment's own vertices, given by their local numbers, in the garment's order; nothing but on rank 0.
    fn gather_own<T: Pod>(&self, garment: usize, of_vertex: &dyn Fn(usize) -> T) -> Vec<T> {
        let (parts, ranks) = (self.parts(), self.parts().ranks());
        let own = parts.own_of_garment(garment);
        let numbers = &parts.own_numbers()[own.clone()];
        let count = parts.partition().garments()[garment].len();
        let mut all = vec![T::zeroed(); if ranks.is_first() { count } else { 0 }];
        let mut put = |numbers: &[u32], values: &mut dyn Iterator<Item = T>| {
            numbers.iter().zip(values).for_each(|(number, value)| all[*number as usize] = value);
        };
        if ranks.is_first() {
            put(numbers, &mut own.clone().map(of_vertex));
        }
        if !ranks.is_alone() {
            // Rank after rank, so that rank 0 never holds more than what it hands on and the share of one.
            for rank in 1..ranks.count() {
                let here = rank == ranks.rank();
                let values: Vec<T> = if here { own.clone().map(of_vertex).collect() } else { Vec::new() };
                let numbers = ranks.send_to_root(rank, if here { numbers } else { &[] });
                let values = ranks.send_to_root(rank, &values);
                if ranks.is_first() {
                    put(&numbers, &mut values.into_iter());
                }
            }
        }
        all
    }

    /// Puts what takes no part to where the vertex is that it follows; `of_merged` is its value, from its leader's local number.
    fn put_merged_vertices<T>(
        &self,
        garment: usize,
        of_merged: &dyn Fn(&MergedVertex, usize) -> Vec3,
        convert: &(dyn Fn(&Vec3) -> T + Sync),
        all: &mut [T],
    ) {
        let (parts, ranks) = (self.parts(), self.parts().ranks());
        let of_scene = parts.partition().garments()[garment].clone();
        let of_garment = self.merged_vertices().iter().filter(|merged| of_scene.contains(&(merged.vertex as usize)));
        let merged_vertices: Vec<&MergedVertex> = of_garment.collect();
        if merged_vertices.is_empty() {
            return;
        }
        let own = parts.own();
        // The number of a merged vertex is known to its owner, and its value to that of its leader.
        let (mut numbers, mut values) = (Vec::new(), Vec::new());
        for (row, merged) in (0..).zip(merged_vertices.iter().copied()) {
            let own_index = |number: u32| parts.local(number).filter(|index| own.contains(index));
            let number = |index: usize| MergedNumber { row, number: parts.own_numbers()[index] };
            numbers.extend(own_index(merged.vertex).map(number));
            let value = |leader: usize| MergedValue { row, value: of_merged(merged, leader) };
            values.extend(own_index(merged.leader).map(value));
        }
        let mut number_of = vec![0; merged_vertices.len()];
        for MergedNumber { row, number } in ranks.all_gather_encoded("numbers of merged vertices", numbers) {
            number_of[row as usize] = number;
        }
        let values = ranks.all_gather_encoded("values of merged vertices", values);
        if ranks.is_first() {
            values.iter().for_each(|merged| all[number_of[merged.row as usize] as usize] = convert(&merged.value));
        }
    }
}
