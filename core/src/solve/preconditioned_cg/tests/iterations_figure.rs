//! The figure of the preconditioner in `docs/theory/linear_solver.md`: residuals by iteration.

use super::{SheetSystem, What, impulses};
use crate::Vec3;
use crate::block_matrix::testing::Sheet;
use crate::parallel::ranks::Ranks;
use crate::parallel::simd4::Simd4;
use crate::solve::block_jacobi::BlockInverses;
use crate::solve::conjugate_gradient::Stop;
use crate::solve::preconditioned_cg::{BlockSystem, PreconditionedCg};
use crate::testing::{Axes, Figure};

/// The same cloth with meshes of several densities: vertices along a side, stiffness over the mass of a vertex, parts, words.
const SHEETS: [(usize, f64, usize, &str); 2] = [(24, 1e4, 4, "24 by 24 vertices"), (96, 16e4, 24, "96 by 96 vertices")];

/// Iterations that are drawn, and powers of ten that the residual falls by.
const ITERATIONS: usize = 800;
const POWERS: f64 = 6.0;

/// Data shared by the solves of the figure.
struct Solve<'a> {
    sheet: &'a Sheet,
    system: &'a BlockSystem<'a, SheetSystem>,
    cg: PreconditionedCg,
}

impl Solve<'_> {
    /// Largest |r_i|/m_i [m/s].
    fn residual(&self, r: &[Simd4]) -> f64 {
        let of_vertex = |(r, mass): (&Simd4, &f64)| Vec3::from(*r).norm() / mass;
        r.iter().zip(&self.sheet.masses).map(of_vertex).fold(0.0, f64::max)
    }

    /// Residuals after 0, 1, ... iterations with all levels, as the solver iterates.
    fn with_all_levels(&mut self) -> Vec<f64> {
        let b = impulses(self.sheet.x.len());
        let mut d = vec![Vec3::zeros(); b.len()];
        // Nothing but the start: d = 0, r = b.
        self.cg.solve(self.system, &b, &mut d, Stop { tolerance: 0.0, max_iterations: 0 });
        let (mut rho, mut residual) = self.cg.step(self.system, 0.0);
        let (mut rho_before, mut alpha) = (f64::INFINITY, 0.0);
        let mut residuals = vec![residual];
        for _ in 0..ITERATIONS {
            self.cg.direction(self.system, alpha, rho / rho_before);
            let curvature = self.cg.product(self.system);
            (rho_before, alpha) = (rho, rho / curvature);
            (rho, residual) = self.cg.step(self.system, alpha);
            residuals.push(residual);
        }
        residuals
    }

    /// diag(A)⁻¹ r.
    fn over_diagonal(&self, r: &[Simd4]) -> Vec<Simd4> {
        let blocks = self.cg.inverses.iter().flat_map(|part| part.blocks());
        r.iter().zip(blocks).map(|(r, block)| BlockInverses::times(block, *r)).collect()
    }

    /// The same with the diagonal blocks alone.
    fn with_diagonal(&mut self) -> Vec<f64> {
        let dot = |a: &[Simd4], b: &[Simd4]| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum() };
        let mut r: Vec<Simd4> = impulses(self.sheet.x.len()).iter().map(Simd4::from).collect();
        let mut s = self.over_diagonal(&r);
        let mut rho = dot(&r, &s);
        let mut residuals = vec![self.residual(&r)];
        for _ in 0..ITERATIONS {
            self.cg.s.copy_from_slice(&s);
            let alpha = rho / self.cg.product(self.system);
            r.iter_mut().zip(&self.cg.q).for_each(|(r, q)| *r -= *q * alpha);
            residuals.push(self.residual(&r));
            let w = self.over_diagonal(&r);
            let next = dot(&r, &w);
            s.iter_mut().zip(w).for_each(|(s, w)| *s = w + *s * (next / rho));
            rho = next;
        }
        residuals
    }
}

/// Powers of ten of the residual over that at the start, by iteration, down to the lowest that is drawn.
fn powers(residuals: &[f64]) -> Vec<[f64; 2]> {
    let of = |(iterations, r): (usize, &f64)| [iterations as f64, (r / residuals[0]).log10()];
    residuals.iter().enumerate().map(of).take_while(|[_, power]| *power >= -POWERS).collect()
}

/// Both curves of a sheet: all levels, the diagonal blocks alone.
fn curves(side: usize, stiffness: f64, parts: usize) -> [Vec<[f64; 2]>; 2] {
    let sheet = Sheet::new(side, stiffness, parts);
    let system = SheetSystem::new(&sheet, &Ranks::default(), What::Nothing);
    let mut solve = Solve { sheet: &sheet, system: &system.blocks(), cg: system.solver() };
    let residuals = [solve.with_all_levels(), solve.with_diagonal()];
    residuals.map(|residuals| powers(&residuals))
}

#[test]
fn the_figure_of_the_preconditioner_is_what_solves_do() {
    let mut figure = Figure::new("Residual by iteration, with and without coarse levels", [760.0, 380.0]);
    let axes = Axes { frame: [70.0, 740.0, 40.0, 320.0], x: [0.0, ITERATIONS as f64], y: [-POWERS, 0.5] };
    let hundreds = [(0.0, "0"), (200.0, "200"), (400.0, "400"), (600.0, "600"), (800.0, "800")];
    axes.mark_x(&mut figure, &hundreds, "iterations");
    let tens = [(0.0, "1"), (-2.0, "10⁻²"), (-4.0, "10⁻⁴"), (-6.0, "10⁻⁶")];
    axes.mark_y(&mut figure, &tens, "largest residual |r|/m, over that at the start");
    let colours = [["#7fb0e0", "#e09a9a"], ["#1c5fa8", "#b03030"]];
    let mut lengths = Vec::new();
    for (row, ((side, stiffness, parts, words), colours)) in SHEETS.into_iter().zip(colours).enumerate() {
        let names = ["all levels", "diagonal blocks alone"];
        for (column, curve) in curves(side, stiffness, parts).iter().enumerate() {
            axes.curve(&mut figure, curve, colours[column]);
            let y = 200.0 + 20.0 * (2 * column + row) as f64;
            figure.words([730.0, y], "end", colours[column], &format!("{}, {words}", names[column]));
            lengths.push(curve.len());
        }
    }
    // What the figure is for: sixteen times the vertices take less than twice the iterations, and many times those without levels.
    assert!(lengths[2] < 2 * lengths[0] && 3 * lengths[2] < lengths[3], "{lengths:?}");
    figure.assert_written("preconditioner.svg");
}
