//! Whether the order of convergence would tell of an error: planted ones of first order have to break the slope.

use super::*;
use crate::effects::force::{Force, PartMotion, PartView};
use crate::mesh::PolygonMesh;
use crate::parallel::simd4::Simd4;
use crate::scene::{EffectRequest, GarmentDescription, SceneDescription};

/// Error planted in a force.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Planted {
    /// Nothing: the control.
    Nothing,
    /// B.5 takes the forces of the start of the step instead of those of its middle.
    StaleForces,
    /// B.1 forgets the damping.
    LateDamping,
}

/// A force with something wrong in it.
struct Wrong {
    force: Box<dyn Force>,
    planted: Planted,
    /// Positions of the first solve.
    before: Vec<Vec3>,
    first_solve: bool,
}

impl Force for Wrong {
    fn update(&mut self, view: &PartView<'_>, own_x: &[Simd4], f: &mut [Simd4]) {
        self.first_solve = view.fraction == 0.0;
        if self.first_solve {
            self.before = view.x.to_vec();
        }
        if self.planted == Planted::StaleForces {
            let own: Vec<Simd4> = self.before[view.start..view.start + own_x.len()].iter().map(Simd4::from).collect();
            self.force.update(&PartView { x: &self.before, ..*view }, &own, f);
        } else {
            self.force.update(view, own_x, f);
        }
    }

    fn add_damping(&self, motion: &PartMotion<'_>, f: &mut [Simd4]) {
        if self.planted != Planted::LateDamping || !self.first_solve {
            self.force.add_damping(motion, f);
        }
    }
}

/// A sheet of 4 by 4 cells that swings from two corners: its vertices after a quarter of a second.
fn swung(steps_per_second: u32, planted: Planted) -> Vec<Vec3> {
    const N: u32 = 5;
    let at = |k: u32| Vec3::new(f64::from(k % N), 0.0, f64::from(k / N)) * 0.1;
    let corners = (0..(N - 1) * N).filter(|k| k % N < N - 1);
    let triangles: Vec<_> = corners.flat_map(|k| [[k, k + N, k + 1], [k + 1, k + N, k + 1 + N]]).collect();
    let mesh = PolygonMesh::from_triangles((0..N * N).map(at).collect(), &triangles);
    let mut description = SceneDescription::new("swing");
    description.timeline.fps_numerator = steps_per_second;
    description.solver.cg_tolerance = Some(f64::EPSILON);
    description.garments.push(GarmentDescription::new("sheet", mesh, 0.3));
    let springs = |effect: &str, stiffness: f64| {
        EffectRequest::of_garment(effect, 0).with("spring_stiffness", stiffness).with("damping_ratio", 0.3)
    };
    description.effects.push(EffectRequest::of_scene("gravity").with_vector("acceleration", [0.0, -9.81, 0.0]));
    description.effects.extend([springs("stretch", 5.0), springs("bending", 1.0)]);
    // Held by their mass instead of pins: nothing here is to depend on anything but the forces.
    let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
    let mut simulation =
        Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|problems| panic!("{problems}"));
    let wrong = |force| Box::new(Wrong { force, planted, before: Vec::new(), first_solve: true }) as Box<dyn Force>;
    for forces in &mut simulation.dynamics.forces {
        *forces = std::mem::take(forces).into_iter().map(wrong).collect();
    }
    // A push that stretches, shears and bends it.
    for (i, v) in simulation.cloth.state.v.iter_mut().enumerate() {
        let i = i as f64;
        *v = Vec3::new(libm::sin(0.7 * i), libm::cos(1.3 * i), libm::sin(2.1 * i));
    }
    for frame in 1..=i64::from(steps_per_second / 4) {
        let summary = simulation.advance(&FrameInput::to_frame(frame)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(summary.steps, 1, "the step is the frame: otherwise the slope means nothing");
    }
    simulation.cloth.state.x.clone()
}

/// Slope of log(error) over log(dt) at four step lengths.
fn order(planted: Planted) -> f64 {
    let finest = swung(12_800, Planted::Nothing);
    let error = |steps: u32| {
        let squares = swung(steps, planted).iter().zip(&finest).map(|(a, b)| (a - b).norm_squared()).sum::<f64>();
        libm::log2(squares.sqrt())
    };
    // Levels are a factor of two apart: -1.5, -0.5, 0.5 and 1.5 about their middle, with 5 as the sum of squares.
    let [a, b, c, d] = [400, 800, 1600, 3200].map(error);
    (1.5 * (a - d) + 0.5 * (b - c)) / 5.0
}

#[test]
fn a_planted_error_of_first_order_breaks_the_slope() {
    let control = order(Planted::Nothing);
    assert!((control - 2.0).abs() < 0.2, "slope {control} without an error");
    for planted in [Planted::StaleForces, Planted::LateDamping] {
        let slope = order(planted);
        assert!(
            (slope - 1.0).abs() < 0.2,
            "{planted:?} has the slope {slope}, and a test for 2 within 0.2 would pass it"
        );
    }
}
