//! Fills the record with how far every run is from the reference and from the base.

use std::path::Path;

use drapery_core::Vec3;
use drapery_io::error::IoError;

use crate::study::cloth::{Cloth, FrameState};
use crate::study::distance::{self, MeshMap};
use crate::study::record::{Distance, Role, Sample, Study};
use crate::study::states::StatesReader;

/// All compared states of a run.
struct Run {
    cloth: Cloth,
    states: Vec<FrameState>,
}

impl Run {
    fn read(folder: &Path, sample: &Sample, frames: usize) -> Result<Self, IoError> {
        let mut reader = StatesReader::open(&folder.join(&sample.states))?;
        let states = (0..frames).map(|_| reader.frame()).collect::<Result<_, _>>()?;
        Ok(Self { cloth: reader.into_cloth(), states })
    }

    /// Returns the distance from another run at every frame, on the mesh of the other run.
    fn from(&self, other: &Self) -> Vec<Distance> {
        let frames = self.states.iter().zip(&other.states);
        let between = |own: &FrameState, other_state: &FrameState| Distance {
            normal_rms: distance::normals(&other.cloth, own, other_state),
            ..distance::between(&other.cloth.areas, own, other_state)
        };
        if self.cloth.is_like(&other.cloth) {
            return frames.map(|(own, other_state)| between(own, other_state)).collect();
        }
        // Without the same garments there is no correspondence, and nothing to say.
        let Some(map) = MeshMap::new(&self.cloth, &other.cloth) else { return Vec::new() };
        let at = |(own, other_state): (&FrameState, &FrameState)| {
            let carried = map.carry(&self.cloth, own);
            let surface = distance::surfaces((&self.cloth, own), (&other.cloth, other_state));
            Distance { surface: Some(surface), ..between(&carried, other_state) }
        };
        frames.map(at).collect()
    }
}

/// Least ratio of the steps of a finer run to those of a run that checks it.
const MORE_STEPS: f64 = 1.5;

/// Orders of convergence that a reference may be extrapolated with, and how far the measured order may be off.
const ORDERS: ([u32; 2], f64) = ([1, 2], 0.4);

/// Reference against which errors are measured.
#[derive(Default)]
struct Reference {
    run: Option<Run>,
    /// Own error at the compared frames [m]; empty where it was not checked.
    own_error: Vec<f64>,
    /// Order of the extrapolation at the compared frames; 0 for none.
    extrapolated: Vec<u32>,
}

/// Returns the reference against which errors are measured, at every compared frame, and its own error: the finest
/// run, or where three runs show that it converges with an order, their extrapolation to steps of zero length
/// (Richardson).
fn reference(study: &Study, folder: &Path) -> Result<Reference, IoError> {
    let frames = study.compared.len();
    let of_role = |role: Role| study.of_role(role).filter(|sample| !sample.states.is_empty());
    // Where the finest is missing, the next takes its place and is checked by the one after.
    let mut runs = [Role::Reference, Role::ReferenceCheck, Role::ReferenceCoarse].into_iter().filter_map(of_role);
    let runs = [runs.next(), runs.next(), runs.next()];
    let mut found = Reference { extrapolated: vec![0; frames], ..Reference::default() };
    let Some(finest) = study.reference().filter(|sample| !sample.states.is_empty()) else { return Ok(found) };
    let mut run = Run::read(folder, finest, frames)?;
    if let [Some(fine), Some(middle), coarse] = runs {
        let steps = |sample: &Sample| sample.cost.steps.max(1) as f64;
        let ratios = [steps(fine) / steps(middle), coarse.map_or(1.0, |coarse| steps(middle) / steps(coarse))];
        let middle = Run::read(folder, middle, frames)?;
        let coarse = coarse.map(|coarse| Run::read(folder, coarse, frames)).transpose()?;
        for (frame, fine) in run.states.iter_mut().enumerate() {
            let coarse = coarse.as_ref().map(|coarse| &coarse.states[frame]);
            let (own, order) = refine(&run.cloth.areas, fine, (&middle.states[frame], coarse), ratios);
            found.own_error.push(own);
            found.extrapolated[frame] = order;
        }
    }
    found.run = Some(run);
    Ok(found)
}

/// Extrapolates the fine state if it converges with an order; returns its own error [m] and that order, or 0.
fn refine(
    areas: &[f64],
    fine: &mut FrameState,
    (middle, coarse): (&FrameState, Option<&FrameState>),
    ratios: [f64; 2],
) -> (f64, u32) {
    let apart = distance::between(areas, fine, middle).rms;
    let Some(coarse) = coarse else { return (apart, 0) };
    let Some(order) = order_of([distance::between(areas, middle, coarse).rms, apart], ratios) else {
        return (apart, 0);
    };
    let factor = |ratio: f64, order: u32| ratio.powi(i32::try_from(order).unwrap_or(1));
    let better = extrapolate(fine, middle, factor(ratios[0], order));
    let worse = extrapolate(middle, coarse, factor(ratios[1], order));
    // What is left is of the next order.
    let left = distance::between(areas, &better, &worse).rms / (factor(ratios[0], order + 1) - 1.0);
    *fine = better;
    (apart.min(left), order)
}

/// The order with which three runs converge, given how far the coarser two and the finer two are apart and how many times as
/// many steps the finer of each took; `None` if it is none that one may extrapolate with.
fn order_of([coarser, finer]: [f64; 2], ratios: [f64; 2]) -> Option<u32> {
    if finer <= 0.0 || ratios.iter().any(|ratio| *ratio < MORE_STEPS) {
        return None;
    }
    let measured = (coarser / finer).ln() / ratios[0].ln();
    ORDERS.0.into_iter().find(|order| (measured - f64::from(*order)).abs() <= ORDERS.1)
}

/// Extrapolates two runs to steps of zero length, if `factor` times the error of the fine one is the error of the
/// coarse one.
fn extrapolate(fine: &FrameState, coarse: &FrameState, factor: f64) -> FrameState {
    let towards = |fine: &[Vec3], coarse: &[Vec3]| -> Vec<Vec3> {
        fine.iter().zip(coarse).map(|(fine, coarse)| fine + (fine - coarse) / (factor - 1.0)).collect()
    };
    FrameState {
        positions: towards(&fine.positions, &coarse.positions),
        velocities: towards(&fine.velocities, &coarse.velocities),
    }
}

/// Base and reference of a study, and how far every run is from them.
pub(super) struct Comparison<'a> {
    folder: &'a Path,
    base: Option<Run>,
    reference: Reference,
}

impl<'a> Comparison<'a> {
    /// Compares all runs of the study in `folder` whose states are there.
    ///
    /// # Errors
    /// States cannot be read.
    pub(super) fn of(study: &mut Study, folder: &'a Path) -> Result<Self, IoError> {
        let mut comparison = Self { folder, base: None, reference: Reference::default() };
        comparison.all(study)?;
        Ok(comparison)
    }

    /// Compares the latest run, or all of them if it is one that they are compared with.
    ///
    /// # Errors
    /// States cannot be read.
    pub(super) fn latest(&mut self, study: &mut Study) -> Result<(), IoError> {
        let is_measure = |sample: &Sample| {
            let roles = [Role::Base, Role::Reference, Role::ReferenceCheck, Role::ReferenceCoarse];
            sample.is_own() && roles.contains(&sample.role)
        };
        match study.samples.len().checked_sub(1) {
            Some(latest) if !is_measure(&study.samples[latest]) => self.one(study, latest),
            _ => self.all(study),
        }
    }

    fn all(&mut self, study: &mut Study) -> Result<(), IoError> {
        let base = study.base().filter(|base| !base.states.is_empty());
        self.base = base.map(|base| Run::read(self.folder, base, study.compared.len())).transpose()?;
        self.reference = reference(study, self.folder)?;
        study.own_error.clone_from(&self.reference.own_error);
        study.extrapolated.clone_from(&self.reference.extrapolated);
        (0..study.samples.len()).try_for_each(|number| self.one(study, number))
    }

    fn one(&self, study: &mut Study, number: usize) -> Result<(), IoError> {
        let sample = &study.samples[number];
        if sample.states.is_empty() {
            return Ok(());
        }
        let own = Run::read(self.folder, sample, study.compared.len())?;
        let from = |other: &Option<Run>| other.as_ref().map_or(Vec::new(), |other| own.from(other));
        let is_base = sample.role == Role::Base && sample.is_own();
        let from_base = if is_base { Vec::new() } else { from(&self.base) };
        // Where nothing was extrapolated, the finest run has no distance from itself.
        let extrapolated = self.reference.extrapolated.iter().any(|order| *order > 0);
        let is_finest = !extrapolated && study.reference().is_some_and(|finest| finest.states == sample.states);
        let skips = sample.copy > 0 || is_finest;
        let from_reference = if skips { Vec::new() } else { from(&self.reference.run) };
        let other_mesh = self.base.as_ref().is_some_and(|base| !own.cloth.is_like(&base.cloth));
        let sample = &mut study.samples[number];
        (sample.from_base, sample.from_reference) = (from_base, from_reference);
        if other_mesh && sample.role == Role::Model {
            sample.role = Role::Mesh;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extrapolation_of_two_runs_is_exact_where_errors_follow_the_order() {
        let exact = Vec3::new(1.0, 2.0, 3.0);
        for order in [1_u32, 2] {
            let at = |dt: f64| {
                let place = exact + Vec3::new(0.5, -0.25, 0.125) * dt.powi(order as i32);
                FrameState { positions: vec![place], velocities: vec![place * 2.0] }
            };
            let [coarse, middle, fine] = [0.4, 0.2, 0.1].map(at);
            let apart =
                [distance::between(&[1.0], &middle, &coarse).rms, distance::between(&[1.0], &fine, &middle).rms];
            assert_eq!(order_of(apart, [2.0, 2.0]), Some(order));
            let found = extrapolate(&fine, &middle, 2.0_f64.powi(order as i32));
            assert!((found.positions[0] - exact).norm() < 1e-14 && (found.velocities[0] - exact * 2.0).norm() < 1e-14);
        }
    }

    #[test]
    fn runs_that_do_not_converge_with_an_order_are_not_extrapolated() {
        assert_eq!(order_of([1.0, 1.0], [2.0, 2.0]), None);
        assert_eq!(order_of([1.0, 8.0], [2.0, 2.0]), None);
        assert_eq!(order_of([16.0, 1.0], [2.0, 2.0]), None);
        // The same number of steps tells nothing.
        assert_eq!(order_of([2.0, 1.0], [1.0, 2.0]), None);
        assert_eq!(order_of([1.0, 0.0], [2.0, 2.0]), None);
    }
}
