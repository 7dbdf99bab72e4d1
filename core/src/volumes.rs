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
    /// The gas that it holds, once that is known.
    gas: Option<Gas>,
    /// For each own part the corners of the triangles that it counts, local vertices.
    triangles: Vec<Vec<[u32; 3]>>,
    sums: Vec<f64>,
    /// The last one [m³].
    value: f64,
}

/// A fixed amount of gas.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gas {
    /// Pressure outside [Pa].
    pub(crate) ambient: f64,
    /// Inside less outside at rest [Pa].
    pub(crate) overpressure: f64,
    /// Volume at rest [m³], negative if the faces look inwards.
    pub(crate) rest_volume: f64,
}

/// Share of its volume at rest below which gas is no longer squeezed: its pressure would leave the range of numbers.
const SQUEEZED: f64 = 0.01;

impl Gas {
    /// Volume over the volume at rest, where gas is squeezed.
    fn share(&self, volume: f64) -> f64 {
        (volume / self.rest_volume).max(SQUEEZED)
    }

    /// Inside less outside at this volume [Pa].
    #[cfg(feature = "effects")]
    pub(crate) fn pressure(&self, volume: f64) -> f64 {
        (self.ambient + self.overpressure) / self.share(volume) - self.ambient
    }

    /// Fall of the pressure with a volume that grows outwards [Pa/m³].
    pub(crate) fn stiffness(&self, volume: f64) -> f64 {
        let share = self.share(volume);
        let stiffness = (self.ambient + self.overpressure) / (share * share * self.rest_volume.abs());
        if share > SQUEEZED { stiffness.max(0.0) } else { 0.0 }
    }

    /// Work of the ambient air less the work of the gas since it was at rest [J].
    #[cfg(feature = "effects")]
    pub(crate) fn energy(&self, volume: f64) -> f64 {
        let share = self.share(volume);
        let work = self.ambient * (share - 1.0) - (self.ambient + self.overpressure) * libm::log(share);
        work * self.rest_volume.abs()
    }
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
        Self { garment, gas: None, triangles, sums: vec![0.0; parts.count()], value: 0.0 }
    }

    /// The volume at the last update [m³]; negative where faces are wound the wrong way.
    pub(crate) fn value(&self) -> f64 {
        self.value
    }

    /// Fills it with gas.
    pub(crate) fn fill(&mut self, gas: Gas) {
        self.gas = Some(gas);
    }

    /// Memory held [bytes].
    pub(crate) fn bytes(&self) -> usize {
        self.triangles.iter().map(|part| size_of_val(part.as_slice())).sum::<usize>()
            + size_of_val(self.sums.as_slice())
    }
}

impl Volume {
    /// The garment that encloses it.
    pub(crate) fn garment(&self) -> usize {
        self.garment
    }

    /// Fall of the pressure of its gas with its growth [Pa/m³], at the last update.
    pub(crate) fn stiffness(&self) -> f64 {
        self.gas.map_or(0.0, |gas| gas.stiffness(self.value))
    }

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
