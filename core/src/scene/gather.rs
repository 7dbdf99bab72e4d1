//! Values of a garment's vertices from all ranks, in the garment's own order, on rank 0.

use bytemuck::Pod;

use super::{MergedVertex, Scene};
use crate::Vec3;

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
    /// What they are.
    pub(crate) field: VertexField,
    /// One for each local vertex.
    pub(crate) values: &'a [Vec3],
}

impl LocalValues<'_> {
    /// The value of a merged vertex, from that of the vertex that it goes with.
    fn of_follower(&self, follower: &MergedVertex, leader: usize) -> Vec3 {
        match self.field {
            VertexField::Positions => self.values[leader] + follower.offset,
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
        let (parts, ranks) = (self.parts(), self.parts().ranks());
        let own = parts.own_of_garment(garment);
        let values = &local.values[own.clone()];
        let numbers = &parts.own_numbers()[own];
        let count = parts.partition().garments()[garment].len();
        let mut all = vec![T::zeroed(); if ranks.is_first() { count } else { 0 }];
        let mut put = |numbers: &[u32], values: &mut dyn Iterator<Item = T>| {
            numbers.iter().zip(values).for_each(|(number, value)| all[*number as usize] = value);
        };
        if ranks.is_first() {
            put(numbers, &mut values.iter().map(convert));
        }
        if !ranks.is_alone() {
            // Rank after rank, so that rank 0 never holds more than what it hands on and the share of one.
            for rank in 1..ranks.count() {
                let here = rank == ranks.rank();
                let values: Vec<T> = if here { values.iter().map(convert).collect() } else { Vec::new() };
                let numbers = ranks.send_to_root(rank, if here { numbers } else { &[] });
                let values = ranks.send_to_root(rank, &values);
                if ranks.is_first() {
                    put(&numbers, &mut values.into_iter());
                }
            }
        }
        self.put_followers(garment, local, convert, &mut all);
        ranks.is_first().then_some(all)
    }

    /// Puts what takes no part to where the vertex is that it follows.
    fn put_followers<T>(
        &self,
        garment: usize,
        local: LocalValues<'_>,
        convert: &(dyn Fn(&Vec3) -> T + Sync),
        all: &mut [T],
    ) {
        let (parts, ranks) = (self.parts(), self.parts().ranks());
        let of_scene = parts.partition().garments()[garment].clone();
        let of_garment = self.followers().iter().filter(|follower| of_scene.contains(&(follower.vertex as usize)));
        let followers: Vec<&MergedVertex> = of_garment.collect();
        if followers.is_empty() {
            return;
        }
        let own = parts.own();
        // The row of a follower, its number in the garment where that is known, and the leader where that is.
        let (mut names, mut values) = (Vec::new(), Vec::new());
        for (row, follower) in followers.iter().enumerate() {
            let own_index = |number: u32| parts.local(number).filter(|index| own.contains(index));
            names.extend(own_index(follower.vertex).map(|index| [row as u32, parts.own_numbers()[index]]));
            values.extend(own_index(follower.leader).map(|leader| (row, local.of_follower(follower, leader))));
        }
        let names = ranks.all_gather_v(&names).concat();
        let rows: Vec<[f64; 3]> = values.iter().map(|(_, value)| (*value).into()).collect();
        let numbers: Vec<u32> = values.iter().map(|(row, _)| *row as u32).collect();
        let (numbers, rows) = (ranks.all_gather_v(&numbers).concat(), ranks.all_gather_v(&rows).concat());
        let mut of_rows = vec![0; followers.len()];
        names.iter().for_each(|[row, number]| of_rows[*row as usize] = *number);
        if ranks.is_first() {
            numbers.iter().zip(&rows).for_each(|(row, value)| {
                all[of_rows[*row as usize] as usize] = convert(&Vec3::from(*value));
            });
        }
    }
}
