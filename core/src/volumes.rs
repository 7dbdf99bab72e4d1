//! Volumes that garments enclose: sums over all their triangles, joined over parts and ranks before forces need them.

#[cfg(feature = "effects")]
use std::ops::Range;

use crate::Vec3;
use crate::elements::at_corners;
#[cfg(feature = "effects")]
use crate::elements::part_triangles::PartTriangles;
use crate::parallel::for_each_part::PerPart;
use crate::parallel::parts::Parts;

/// The volume of one garment, in the positions of the last update.
#[derive(Debug)]
pub(crate) struct Volume {
    garment: usize,
    /// For each own part the corners of the triangles that it counts, local vertices.
    triangles: Vec<Vec<[u32; 3]>>,
    sums: Vec<f64>,
    /// The last one [m³].
    value: f64,
}

/// Six times the volume between a triangle and the origin [m³], positive where the origin lies behind it.
#[inline]
fn beneath([a, b, c]: &[Vec3; 3]) -> f64 {
    a.dot(&b.cross(c))
}

#[cfg(feature = "effects")]
impl Volume {
    /// The volume of a garment, from the triangles that its parts look at; nothing is known of it before the first update.
    pub(crate) fn new(parts: &Parts, garment: usize, of_parts: &[(usize, PartTriangles)]) -> Self {
        let mut triangles = vec![Vec::new(); parts.count()];
        for (part, all) in of_parts {
            triangles[*part] = all.corners().iter().copied().filter(|corners| all.counts(corners)).collect();
        }
        Self { garment, triangles, sums: vec![0.0; parts.count()], value: 0.0 }
    }

    /// The volume at the last update [m³]; negative where faces are wound the wrong way.
    pub(crate) fn value(&self) -> f64 {
        self.value
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        self.triangles.iter().map(|part| size_of_val(part.as_slice())).sum::<usize>()
            + size_of_val(self.sums.as_slice())
    }
}

impl Volume {
    /// Finds the volume at the positions `x` of all local vertices [m]. All ranks call it together.
    pub(crate) fn update(&mut self, parts: &Parts, x: &[Vec3]) {
        let triangles = &self.triangles;
        parts.for_each(PerPart(&mut self.sums), &|part, sum| {
            sum.0[0] = triangles[part].iter().map(|corners| beneath(&at_corners(corners, x))).sum::<f64>() / 6.0;
        });
        [self.value] = parts.join_parts(&[&self.sums]);
    }
}

/// Volumes of all garments whose forces ask for them.
#[derive(Debug, Default)]
pub struct Volumes(pub(crate) Vec<Volume>);

impl Volumes {
    /// Finds all volumes at the positions `x` of all local vertices [m]. All ranks call it together.
    pub fn update(&mut self, parts: &Parts, x: &[Vec3]) {
        self.0.iter_mut().for_each(|volume| volume.update(parts, x));
    }

    /// Volume of a garment at the last update [m³]; zero if nobody asked for it.
    pub fn of(&self, garment: usize) -> f64 {
        self.0.iter().find(|volume| volume.garment == garment).map_or(0.0, |volume| volume.value)
    }
}

/// Volume between the triangles of a part's range and the origin [m³].
#[cfg(feature = "effects")]
pub(crate) fn volume_of(corners: &[[u32; 3]], counts: impl Fn(&[u32; 3]) -> bool, x: &[Vec3]) -> f64 {
    corners.iter().filter(|c| counts(c)).map(|c| beneath(&at_corners(c, x))).sum::<f64>() / 6.0
}

/// Own vertices of a garment as numbers in its mesh.
#[cfg(feature = "effects")]
pub(crate) fn own_in_mesh(parts: &Parts, garment: usize) -> Range<u32> {
    let (all, own) = (parts.garment(garment), parts.own_of_garment(garment));
    (own.start - all.start) as u32..(own.end - all.start) as u32
}
