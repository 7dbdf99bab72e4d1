//! Contacts that are added, and vertices that surfaces drag along.

use super::*;
use crate::block_matrix::testing::Sheet;
use crate::parallel::ranks::Ranks;

#[test]
fn free_contacts_are_dropped_also_where_nothing_is_met() {
    let parts = Sheet::new(3, 1.0, 1).parts(&Ranks::default());
    let contact = |vertex| ActiveContact::new(vertex, [Vec3::zeros(); 2], 0.3, Vec3::zeros(), 1e-3);
    let free = |vertex| ActiveContact { mode: ContactMode::Free, ..contact(vertex) };
    let vertices = |set: &ActiveSet| set.contacts().iter().map(|contact| contact.vertex).collect::<Vec<_>>();
    for (met, expected) in
        [(vec![], vec![2]), (vec![contact(1), contact(2)], vec![1, 2]), (vec![contact(4)], vec![2, 4])]
    {
        let mut set = ActiveSet::default();
        set.set(&parts, vec![free(1), contact(2)]);
        set.add(&parts, met);
        assert_eq!(vertices(&set), expected);
    }
}

#[test]
fn a_vertex_that_surfaces_drag_goes_with_them_but_for_what_pulls_at_it() {
    let parts = Sheet::new(3, 1.0, 1).parts(&Ranks::default());
    let (start, velocity, duration, masses) = (Vec3::z(), Vec3::new(0.2, 0.3, 0.0), 0.005, [0.5; 9]);
    let mut set = ActiveSet::default();
    let rests = ActiveContact::new(1, [Vec3::zeros(); 2], 0.3, Vec3::zeros(), 0.01).with_normal(Vec3::y());
    set.set(&parts, vec![rests]);
    set.add(&parts, vec![ActiveContact::dragged(1, velocity)]);
    assert_eq!(set.contacts().len(), 1, "it takes the place of the contact before");
    let mut direction = vec![Vec3::x(); 9];
    set.project(0, 0, &mut direction);
    assert_eq!(direction, vec![Vec3::x(); 9], "nothing is prescribed");
    // Backward Euler of m dv/dt = f - rate m (v - velocity) has v = (start + dt f/m + rate dt velocity)/(1 + rate dt).
    let (force, at) = (Vec3::new(0.0, -40.0, 0.0), StageDrag { duration, masses: &masses });
    let mut residual = vec![force * duration; 9];
    set.add_drag(0, 0, &at, &[start; 9], &mut residual);
    let heavy = set.masses_with_drag(&at);
    let found = start + residual[1] / heavy[1];
    let rate = PINCH_DRAG * duration;
    let expected = (start + force * (duration / 0.5) + velocity * rate) / (1.0 + rate);
    assert!((found - expected).norm() < 1e-12, "{found:?}, not {expected:?}");
    assert_eq!((residual[0], heavy[0]), (force * duration, 0.5), "other vertices feel none of it");
    // A reaction that no body could give.
    let trust = Trust { tolerance: 0.0, masses: &masses, settled: 0.01 };
    let before = residual.clone();
    let unsettled = set.update(&parts, (&mut residual, &before), trust, |_| Vec3::x());
    assert!(!unsettled.contains(&true) && set.is_settled() && residual == before);
}

#[test]
fn friction_in_a_solve_is_that_of_the_smaller_push() {
    let parts = Sheet::new(3, 1.0, 1).parts(&Ranks::default());
    let (masses, friction) = ([0.5; 9], 0.4);
    for (evaluated, solved) in [(6.0, 2.0), (2.0, 6.0), (3.0, -1.0)] {
        let mut set = ActiveSet::default();
        let slides = ActiveContact::new(4, [Vec3::zeros(); 2], friction, Vec3::x(), 0.01).with_normal(Vec3::y());
        set.set(&parts, vec![slides]);
        let [mut residual, solved_residual] = [evaluated, solved].map(|push| vec![-Vec3::y() * push; 9]);
        let trust = Trust { tolerance: 0.0, masses: &masses, settled: 0.01 };
        set.update(&parts, (&mut residual, &solved_residual), trust, |_| Vec3::zeros());
        let expected = -Vec3::x() * (friction * f64::min(evaluated, solved).max(0.0)) - Vec3::y() * evaluated;
        assert!((residual[4] - expected).norm() < 1e-12, "{evaluated} and {solved} N s: {:?}", residual[4]);
    }
}
