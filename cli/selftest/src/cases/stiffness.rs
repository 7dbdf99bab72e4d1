//! H1 to H10: stiffness, mass and the time step.

use drapery_core::Vec3;
use drapery_core::scene::{EffectRequest, GarmentDescription, SceneDescription};

use crate::bench::{Bench, Frame, Record, Trial};
use crate::case::{Case, Figure};
use crate::scenes::*;

/// Largest distance between like vertices of the last frames of two runs [m].
pub(super) fn apart(a: &Record, b: &Record) -> f64 {
    let pairs = a.last().positions.iter().flatten().zip(b.last().positions.iter().flatten());
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// A sheet that hangs from two corners.
fn hanging(cells: usize, dx: f64, stiffness: f64) -> SceneDescription {
    let mut description = cloth(cells, dx, stiffness);
    add_weight(&mut description);
    add_pins(&mut description, vec![0, cells as u32]);
    description
}

pub(super) const H1: Case = Case {
    id: "H1",
    title: "membrane of 1e6 to 1e8 N/m",
    must: "the step is limited; nothing explodes",
    judge: |bench| {
        let mut figures = Vec::new();
        for (stiffness, fps) in [(1.8e6, 480), (1e8, 4800)] {
            let mut description = hanging(8, 0.02, stiffness);
            description.timeline.fps_numerator = fps;
            let record = bench.simulate(&Trial::still(description, 1))?;
            // All that the weight can do in the time is a fall of the whole sheet.
            let speed = GRAVITY / f64::from(fps);
            let mass: f64 = record.masses.concat().iter().sum();
            figures.push(Figure::at_most(format!("strain at {stiffness:e} N/m"), record.strain(), 1e-3));
            let share = record.kinetic() / (0.5 * mass * speed * speed);
            figures.push(Figure::at_most(
                format!("kinetic energy over the energy of the fall at {stiffness:e} N/m"),
                share,
                1.01,
            ));
        }
        Ok(figures)
    },
};

pub(super) const H2: Case = Case {
    id: "H2",
    title: "very soft cloth without bending",
    must: "it collapses without passing through itself",
    judge: |bench| {
        let cells = bench.by_tier(16, 64);
        let mesh = sheet(cells, cells, 0.32 / cells as f64);
        let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 24);
        description.garments[0].mesh.points.iter_mut().for_each(|p| *p = Vec3::new(p.x, p.z + 0.17, 0.02 * p.x));
        add_weight(&mut description);
        let stretch = EffectRequest::of_garment("stretch", 0).with("stiffness", 0.01);
        description.effects.push(stretch);
        add_floor(&mut description, 0.3);
        description.bodies[0].thickness = 0.001;
        add_self_contact(&mut description);
        let record = bench.simulate(&Trial::still(description, 12))?;
        let crossings: usize = record.frames.iter().map(|frame| frame.crossings).sum();
        let lowest = record.last().positions[0].iter().map(|x| x.y).fold(f64::INFINITY, f64::min);
        let highest = record.last().positions[0].iter().map(|x| x.y).fold(0.0, f64::max);
        Ok(vec![
            Figure::exactly("intersections in all frames", crossings as f64, 0.0),
            Figure::at_least("lowest vertex [m]", lowest, 0.0),
            Figure::at_most("highest vertex, from 0.33 m [m]", highest, 0.1),
        ])
    },
};

pub(super) const H3: Case = Case {
    id: "H3",
    title: "masses of 1 to 1e4 side by side",
    must: "conjugate gradients converge",
    judge: |bench| {
        // Columns of cells that get a hundred times wider: the masses of vertices are those of their areas.
        let (cells, side, growth) = (12, 0.24, 5.4_f64);
        let stretch = |u: f64| ((growth * u).exp() - 1.0) / (growth.exp() - 1.0);
        let share = |c: f64| side * stretch(c / side + 0.5) - 0.5 * side;
        // Long steps solve the even sheet in one iteration, the fewest there are, and no mass tells. There the even cells are those of the
        // lightest vertices.
        let width = side * bench.by_integrator(1.0 / cells as f64, stretch(1.0 / cells as f64));
        let even = hanging(cells, width, 100.0);
        let mut uneven = hanging(cells, side / cells as f64, 100.0);
        uneven.garments[0].mesh.points.iter_mut().for_each(|p| *p = Vec3::new(share(p.x), 0.0, share(p.z)));
        let mut run = |mut description: SceneDescription| {
            description.timeline.fps_numerator = 240;
            bench.simulate(&Trial::still(description, 3))
        };
        let (even, uneven) = (run(even)?, run(uneven)?);
        let masses = uneven.masses.concat();
        let ratio =
            masses.iter().fold(0.0, |a: f64, b| a.max(*b)) / masses.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        let per_step = |record: &Record| {
            let steps: u64 = record.frames.iter().map(|frame| frame.summary.steps).sum();
            record.counted("cg_iterations") / steps.max(1) as f64
        };
        Ok(vec![
            Figure::at_least("ratio of the masses", ratio, 1e4),
            Figure::at_most("iterations a step over those of even masses", per_step(&uneven) / per_step(&even), 5.0),
            Figure::exactly("solves above their tolerance", uneven.counted("cg_short"), 0.0),
        ])
    },
};

pub(super) const H4: Case = Case {
    id: "H4",
    title: "time steps 10 and 100 times too long",
    must: "the run completes by shorter steps where they are needed, and says so",
    judge: |bench| {
        let mut figures = Vec::new();
        let reference = bench.simulate(&Trial::still(hanging(10, 0.03, 200.0), 12))?;
        for factor in [10.0, 100.0] {
            let mut description = hanging(10, 0.03, 200.0);
            description.solver.cfl *= factor;
            let record = bench.simulate(&Trial::still(description, 12))?;
            let lowest = |record: &Record| record.last().positions[0].iter().map(|x| x.y).fold(0.0, f64::min);
            figures.push(Figure::at_most(format!("strain, {factor} times"), record.strain(), 3.0 * reference.strain()));
            let error = (lowest(&record) - lowest(&reference)).abs() / lowest(&reference).abs();
            figures.push(Figure::at_most(format!("error of the lowest vertex, {factor} times"), error, 0.1));
        }
        Ok(figures)
    },
};

pub(super) const H5: Case = Case {
    id: "H5",
    title: "a time step of 1e-7 s",
    must: "no stall, no loss of digits, the same motion",
    judge: |bench| {
        let run = |bench: &mut Bench<'_>, max_dt: f64| {
            let mut description = hanging(4, 0.03, 100.0);
            description.timeline.fps_numerator = 2000;
            description.garments[0].velocity = Vec3::new(0.1, 0.0, 0.3);
            description.solver.max_dt = Some(max_dt);
            bench.simulate_once(&Trial::still(description, 1))
        };
        let (fine, usual) = (run(bench, 1e-7)?, run(bench, 1e-5)?);
        let way = fine.last().positions[0].iter().zip(&fine.frames[0].positions[0]).map(|(a, b)| (a - b).norm());
        let way = way.fold(0.0, f64::max);
        Ok(vec![
            Figure::at_least("steps of the frame", fine.last().summary.steps as f64, 5000.0),
            Figure::at_most("difference from steps of 1e-5 s over the displacement", apart(&fine, &usual) / way, 1e-3),
        ])
    },
};

pub(super) const H6: Case = Case {
    id: "H6",
    title: "a limit of 1 % on the strain of cloth that its weight would stretch by 10 %",
    must: "the strain stays near the limit",
    judge: |bench| {
        let run = |bench: &mut Bench<'_>, limited: bool| {
            let mut description = cloth(8, 0.03, 5.0);
            add_weight(&mut description);
            add_pins(&mut description, (0..=8).collect());
            if limited {
                description.effects.push(EffectRequest::of_garment("strain_limit", 0).with("limit", 0.01));
            }
            bench.simulate(&Trial::still(description, 12))
        };
        let free = run(bench, false)?;
        let limited = run(bench, true)?;
        Ok(vec![
            Figure::at_least("strain without the limit", free.strain(), 0.05),
            Figure::at_most("strain with it", limited.strain(), 0.02),
        ])
    },
};

/// Step that resolves the fastest oscillation of the cloth of H7 more than a hundred times [s].
const RESOLVED: f64 = 3e-5;

pub(super) const H7: Case = Case {
    id: "H7",
    title: "no damping, and a thousand times critical",
    must: "undamped cloth keeps its energy, overdamped cloth never gains any",
    judge: |bench| {
        let run = |bench: &mut Bench<'_>, ratio: f64, max_dt: Option<f64>| {
            let mut description = cloth(6, 0.03, 100.0);
            description.effects.retain(|effect| effect.effect == "stretch");
            description.effects[0] = description.effects[0].clone().with("damping_ratio", ratio);
            let points = &mut description.garments[0].mesh.points;
            description.garments[0].start =
                Some(points.iter().map(|p| Vec3::new(1.02 * p.x, 0.0, 0.99 * p.z)).collect());
            description.timeline.fps_numerator = 100;
            description.solver.cfl = 1.0;
            description.solver.max_dt = max_dt;
            description.solver.cg_tolerance = max_dt.map(|_| 1e-10);
            bench.simulate(&Trial { is_isolated: ratio > 0.0, ..Trial::still(description, 20) })
        };
        let energy = |frame: &Frame| frame.summary.kinetic_energy + frame.summary.potential_energy;
        let drift = |record: &Record| (energy(record.last()) / energy(&record.frames[1]) - 1.0).abs();
        let growth = |record: &Record| {
            record.frames[1..].windows(2).map(|w| energy(&w[1]) / energy(&w[0]) - 1.0).fold(0.0, f64::max)
        };
        // An L-stable scheme damps motion that its steps do not resolve, and to third order motion that they do.
        let resolved = bench.by_integrator(None, Some(RESOLVED));
        let free = run(bench, 0.0, resolved)?;
        let mut figures = vec![Figure::at_most("drift of the energy in 0.2 s, undamped", drift(&free), 0.002)];
        if let Some(max_dt) = resolved {
            let coarse = run(bench, 0.0, Some(2.0 * max_dt))?;
            let ratio = drift(&coarse) / drift(&free);
            figures.push(Figure::at_least("the same in steps twice as long, over it", ratio, 6.0));
            figures.push(Figure::at_most("largest growth in a frame, undamped", growth(&coarse), 1e-9));
        }
        let stiff = run(bench, 1e3, None)?;
        figures.push(Figure::at_most("largest growth in a frame, overdamped", growth(&stiff), 1e-9));
        Ok(figures)
    },
};

pub(super) const H8: Case = Case {
    id: "H8",
    title: "cloth afloat without gravity for 1e4 steps",
    must: "nothing starts to move, momentum stays to rounding",
    judge: |bench| {
        let run = |bench: &mut Bench<'_>, velocity: Vec3| {
            let mut description = cloth(4, 0.03, 100.0);
            add_self_contact(&mut description);
            description.garments[0].velocity = velocity;
            description.solver.max_dt = Some(1.0 / 24.0 / 2500.0);
            bench.simulate_once(&Trial { is_isolated: true, ..Trial::still(description, 4) })
        };
        let (still, moving) = (run(bench, Vec3::zeros())?, run(bench, Vec3::new(1.0, 2.0, -0.5))?);
        let momentum = |frame: &crate::bench::Frame, masses: &[Vec<f64>]| -> Vec3 {
            frame.velocities[0].iter().zip(&masses[0]).map(|(v, m)| v * *m).sum()
        };
        let (first, last) = (momentum(&moving.frames[0], &moving.masses), momentum(moving.last(), &moving.masses));
        let steps: u64 = still.frames.iter().map(|frame| frame.summary.steps).sum();
        Ok(vec![
            Figure::at_least("steps", steps as f64, 1e4),
            Figure::at_most("kinetic energy of the cloth at rest [J]", still.kinetic(), 1e-12),
            Figure::at_most("drift of momentum, relative", (last - first).norm() / first.norm(), 1e-10),
        ])
    },
};

pub(super) const H9: Case = Case {
    id: "H9",
    title: "a material that pushes instead of pulling: negative stiffness",
    must: "refused by the name of the setting",
    judge: |bench| {
        let mut figures = Vec::new();
        for (effect, setting) in [("stretch", "stiffness"), ("bending", "stiffness"), ("membrane", "shear")] {
            let mut description = scene_of(GarmentDescription::new("sheet", sheet(4, 4, 0.02), 0.2), 24);
            description.effects.push(EffectRequest::of_garment(effect, 0).with(setting, -5.0));
            let refused = bench.simulate(&Trial::still(description, 1)).err().unwrap_or_default();
            let named = refused.contains("refused") && refused.contains(effect) && refused.contains(setting);
            figures.push(Figure::exactly(format!("{effect}.{setting} is refused"), f64::from(u8::from(named)), 1.0));
        }
        Ok(figures)
    },
};

pub(super) const H10: Case = Case {
    id: "H10",
    title: "conjugate gradients that cannot reach their tolerance",
    must: "the best iterate is taken and counted, energy does not grow",
    judge: |bench| {
        let mut description = cloth(12, 0.02, 200.0);
        for effect in &mut description.effects {
            *effect = effect.clone().with("damping_ratio", 500.0);
        }
        let mut random = Random::new(10);
        description.garments[0].start_velocities =
            Some((0..description.garments[0].mesh.points.len()).map(|_| random.vector() * 0.2).collect());
        (description.solver.cg_max_iterations, description.solver.cg_tolerance) = (1, Some(1e-10));
        let record = bench.simulate(&Trial { is_isolated: true, ..Trial::still(description, 6) })?;
        let energy: Vec<f64> = record.frames[1..].iter().map(|f| f.summary.kinetic_energy).collect();
        Ok(vec![
            Figure::at_least("solves above their tolerance, counted", record.counted("cg_short"), 1.0),
            Figure::at_most(
                "kinetic energy at the end over the first frame's",
                energy[energy.len() - 1] / energy[0],
                1.0,
            ),
        ])
    },
};
