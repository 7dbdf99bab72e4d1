//! Largest strains of each garment in a run, and those that its fabric does not take.

use drapery_io::shot_description::Fabric;

use super::reader::FrameRow;

/// A strain, and the frame in which it was reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Extension by rest length.
    pub strain: f64,
    /// The first frame that reached it.
    pub frame: i64,
}

/// Largest strains of a garment.
#[derive(Debug, Clone, PartialEq)]
pub struct WorstStrains {
    /// The garment.
    pub garment: String,
    /// Strain of its most stretched edge.
    pub largest: Peak,
    /// Strain that one edge in a thousand exceeds.
    pub p99_9: Peak,
}

impl WorstStrains {
    /// Collects the strains of garments over frames, in the order in which the garments appear.
    pub fn of<'a>(frames: impl IntoIterator<Item = &'a FrameRow>) -> Vec<Self> {
        let mut worst = Vec::new();
        frames.into_iter().for_each(|row| Self::add(&mut worst, row));
        worst
    }

    /// Whether the garment was stretched beyond this strain: the 99.9th percentile counts.
    pub fn exceeds(&self, limit: f64) -> bool {
        self.p99_9.strain > limit
    }

    /// Adds the strains of a frame.
    pub(crate) fn add(worst: &mut Vec<Self>, row: &FrameRow) {
        for found in &row.strains {
            let [largest, p99_9] = [found.largest, found.p99_9].map(|strain| Peak { strain, frame: row.frame });
            match worst.iter_mut().find(|known| known.garment == found.garment) {
                Some(known) => {
                    known.largest = known.largest.max(largest);
                    known.p99_9 = known.p99_9.max(p99_9);
                }
                None => worst.push(Self { garment: found.garment.clone(), largest, p99_9 }),
            }
        }
    }
}

impl Peak {
    /// The larger, or the earlier of two that are equal.
    fn max(self, later: Self) -> Self {
        if later.strain > self.strain { later } else { self }
    }
}

/// A garment that was stretched beyond the limit of its fabric.
#[derive(Debug, Clone, PartialEq)]
pub struct BeyondFabric {
    /// The garment.
    pub garment: String,
    /// Its fabric.
    pub fabric: Fabric,
    /// Strain that one edge in a thousand exceeds.
    pub p99_9: Peak,
}

/// The garments of a run that were stretched beyond the limits of their fabrics: by name and fabric, if they have one.
pub(crate) fn beyond_fabric(
    worst: &[WorstStrains],
    garments: &[String],
    fabrics: &[Option<Fabric>],
) -> Vec<BeyondFabric> {
    let of_garment = |found: &WorstStrains| {
        let fabric = fabrics.get(garments.iter().position(|name| *name == found.garment)?)?.as_ref()?;
        let beyond = || BeyondFabric { garment: found.garment.clone(), fabric: fabric.clone(), p99_9: found.p99_9 };
        found.exceeds(fabric.strain_limit).then(beyond)
    };
    worst.iter().filter_map(of_garment).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run_record::reader::GarmentStrainsRow;

    #[test]
    fn the_worst_frame_of_each_garment_counts_against_its_fabric() {
        let row = |frame, strains: &[(&str, f64, f64)]| FrameRow {
            frame,
            strains: strains
                .iter()
                .map(|&(garment, largest, p99_9)| GarmentStrainsRow { garment: garment.into(), largest, p99_9 })
                .collect(),
            ..FrameRow::default()
        };
        let rows = [
            row(1, &[("skirt", 0.3, 0.02), ("shirt", 0.1, 0.1), ("belt", 0.9, 0.9)]),
            row(2, &[("skirt", 0.2, 0.09), ("shirt", 0.1, 0.12), ("belt", 0.9, 0.9)]),
            row(3, &[("skirt", 0.2, 0.09)]),
        ];
        let worst = WorstStrains::of(&rows);
        let skirt = &worst[0];
        assert_eq!((skirt.largest, skirt.p99_9), (Peak { strain: 0.3, frame: 1 }, Peak { strain: 0.09, frame: 2 }));
        let fabric = |strain_limit| Some(Fabric { name: "wool".into(), friction: 0.3, strain_limit });
        let garments = ["shirt", "skirt", "belt"].map(str::to_owned);
        let beyond = beyond_fabric(&worst, &garments, &[fabric(0.134), fabric(0.085), None]);
        assert_eq!(beyond.iter().map(|found| (&*found.garment, found.p99_9.frame)).collect::<Vec<_>>(), [("skirt", 2)]);
    }
}
