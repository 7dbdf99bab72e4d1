//! A garment as it was read: an even share of its points and faces on each rank, where they are looked at before anybody has to
//! have what lies around them.

use std::borrow::Cow;

use crate::Vec3;
use crate::error::Problem;
use crate::mesh::{self, MeshStream, PolygonMesh};
use crate::parallel::message::{codec, is_broken};
use crate::parallel::problems::listed;
use crate::parallel::ranks::Ranks;
use crate::scene::{FARTHEST, is_possible};
use crate::setup::distribute::block_rows::{BlockDistribution, fetch, scatter_rows};

/// Share of a garment that a rank has, as it was read.
pub(crate) struct BlockOfMesh<'a> {
    pub(crate) points_of: BlockDistribution,
    pub(crate) faces_of: BlockDistribution,
    /// Rest positions [m].
    pub(crate) points: Cow<'a, [Vec3]>,
    /// Number of corners of each face.
    face_counts: Cow<'a, [u32]>,
    /// Corners of one face after the other.
    corners: Cow<'a, [u32]>,
}

/// Size of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MeshSize {
    pub(crate) points: usize,
    pub(crate) faces: usize,
}

codec!(struct MeshSize { points, faces });

impl<'a> BlockOfMesh<'a> {
    /// All of a mesh, for one rank.
    pub(crate) fn alone(mesh: &'a PolygonMesh) -> Self {
        let [points_of, faces_of] =
            [mesh.points.len(), mesh.face_counts.len()].map(|rows| BlockDistribution::new(rows, 1));
        let [face_counts, corners] = [&mesh.face_counts, &mesh.face_indices].map(|list| Cow::Borrowed(list.as_slice()));
        Self { points_of, faces_of, points: Cow::Borrowed(&mesh.points), face_counts, corners }
    }

    /// Reads a mesh of this size on rank 0, and spreads it. All ranks call it together.
    pub(crate) fn read(
        ranks: &Ranks,
        mesh: Option<&dyn MeshStream>,
        MeshSize { points, faces }: MeshSize,
        place: &str,
        problems: &mut Vec<Problem>,
    ) -> Self {
        let [points_of, faces_of] = [points, faces].map(|rows| BlockDistribution::new(rows, ranks.count()));
        let (mut read, mut given) = (Ok(()), [0, 0]);
        let [own_points] = scatter_rows(ranks, &points_of, |take| {
            let mut each = |points: &[Vec3]| {
                given[0] += points.len();
                points.iter().for_each(|point| take([std::slice::from_ref(point)]));
            };
            read = mesh.map_or(Ok(()), |mesh| mesh.points(&mut each));
        });
        let [face_counts, corners] = scatter_rows(ranks, &faces_of, |take| {
            let mut each = |counts: &[u32], corners: &[u32]| {
                for (count, face) in counts.iter().zip(mesh::faces(counts, corners)) {
                    given[1] += 1;
                    take([std::slice::from_ref(count), face]);
                }
            };
            read = std::mem::replace(&mut read, Ok(())).and(mesh.map_or(Ok(()), |mesh| mesh.faces(&mut each)));
        });
        if mesh.is_some() && read.is_ok() && given != [points, faces] {
            let [now_points, now_faces] = given;
            read = Err(format!(
                "it has changed while it was read: from {points} points and {faces} faces to {now_points} and \
                 {now_faces}"
            ));
        }
        if let Err(what) = read {
            problems.push(Problem::data(
                place,
                what,
                "export the mesh again, and do not change the file while it is read",
            ));
        }
        if face_counts.iter().map(|count| *count as usize).sum::<usize>() != corners.len() {
            is_broken(ranks.rank(), "rows that rank 0 reads", "corners do not fit the faces");
        }
        let [face_counts, corners] = [face_counts, corners].map(Cow::Owned);
        Self { points_of, faces_of, points: Cow::Owned(own_points), face_counts, corners }
    }

    /// Each face here, with its number in the garment.
    pub(crate) fn faces(&self, ranks: &Ranks) -> impl Iterator<Item = (u32, &[u32])> {
        let mut rest = &*self.corners;
        let faces = self.face_counts.iter().map_while(move |count| rest.split_off(..*count as usize));
        (self.faces_of.rows(ranks.rank()).start as u32..).zip(faces)
    }

    /// The rest positions of all corners of the faces here. All ranks call it together.
    pub(crate) fn positions(&self, ranks: &Ranks) -> FetchedValues<'_, Vec3> {
        let corners = self.faces(ranks).flat_map(|(_, corners)| corners).copied();
        FetchedValues::new(ranks, corners, &self.points_of, &self.points)
    }

    /// Numbers that are not finite, and faces that cannot be: what has to hold before anything can be derived.
    pub(crate) fn check(&self, ranks: &Ranks, place: &str, points: usize) -> Vec<Problem> {
        let first = self.points_of.rows(ranks.rank()).start as u32;
        let broken = (first..).zip(&*self.points).filter(|(_, p)| !is_possible(p));
        let bad = |corners: &[u32]| corners.len() < 3 || corners.iter().any(|v| *v as usize >= points);
        let impossible = self.faces(ranks).filter(|(_, corners)| bad(corners));
        let vertices = listed(ranks, broken.map(|(v, _)| [v; 2]).collect()).map(|list| {
            let what = format!("vertices {list} are not finite numbers, or beyond {FARTHEST:e} m");
            Problem::data(place, what, "repair these points and export the mesh again")
        });
        let faces = listed(ranks, impossible.map(|(f, _)| [f; 2]).collect()).map(|list| {
            let what = format!(
                "faces {list} have fewer than three corners or refer to a point that does not exist ({points} points)"
            );
            Problem::data(place, what, "export the mesh again")
        });
        vertices.into_iter().chain(faces).collect()
    }
}

/// Known values of some points that are in the block of any rank.
pub(crate) struct FetchedValues<'a, T: Copy> {
    /// Their numbers in the garment, ascending; one rank, which has all, needs none.
    vertices: Vec<u32>,
    values: Cow<'a, [T]>,
}

impl<'a, T: bytemuck::Pod> FetchedValues<'a, T> {
    /// Asks for these points, each once; `own` are the values of those that are in this rank's block. All ranks call it together.
    pub(crate) fn new(
        ranks: &Ranks,
        vertices: impl Iterator<Item = u32>,
        blocks: &BlockDistribution,
        own: &'a [T],
    ) -> Self {
        if ranks.is_alone() {
            return Self { vertices: Vec::new(), values: Cow::Borrowed(own) };
        }
        let mut vertices: Vec<u32> = vertices.collect();
        vertices.sort_unstable();
        vertices.dedup();
        let first = blocks.rows(ranks.rank()).start;
        let values = fetch(ranks, &vertices, |v| blocks.of(v as usize), |v| own[v as usize - first]);
        Self { vertices, values: Cow::Owned(values) }
    }

    /// Returns the known value of one of these points.
    pub(crate) fn at(&self, vertex: u32) -> T {
        let Some(lowest) = self.vertices.first() else { return self.values[vertex as usize] };
        // Where none between is missing, it is found at once.
        let guess = (vertex - lowest) as usize;
        let place = match self.vertices.get(guess) {
            Some(found) if *found == vertex => guess,
            _ => self.vertices.partition_point(|other| *other < vertex),
        };
        self.values[place]
    }
}

/// One list of all, without a copy if there is but one.
pub(crate) fn joined<T: Copy>(mut lists: Vec<Vec<T>>) -> Vec<T> {
    if lists.len() == 1 { lists.pop().unwrap_or_default() } else { lists.concat() }
}
