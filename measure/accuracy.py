"""Costs and benefits of the choices of the method: repulsion with history, both integrators and the presets, friction."""

import math

import numpy as np

from measure.page import Table
from measure.runs import LONG, SHORT, run
from measure.scenes import sample, without_tables, woman

PAGE = "dev/measurements/accuracy.md"

# Kind of repulsion, and the tables of the scene that are left out.
HISTORY = {"history, every step": [], "collisions alone": ["self_repulsion"]}
# Beside what a converged run is made with: solves that leave nothing that counts.
TIGHT = ["solver.cg_tolerance=1e-6", "solver.cg_max_iterations=5000"]


def positions(made):
    """Positions of all garments at all frames [m]."""
    return np.concatenate([cache["positions"][:].astype(float) for cache in made.caches()], axis=1)


def repulsion(scene, cells, frames):
    """With repulsion in every step, and not at all."""

    def line(kind, left_out):
        made = run(without_tables(sample(scene, resolution=cells), left_out), frames)
        counts = [made.count(name) for name in ("collision_hits", "zones", "zone_nodes", "zone_fallbacks", "rewinds")]
        return [kind, made.steps, made.count("collision_steps"), f"{made.simulated:.2f}", *counts, made.crossings()]

    return lambda: [line(*kind) for kind in HISTORY.items()]


def presets(make, frames, steps, cfl):
    """Both integrators and all presets against converged runs: of long steps by their number, of short ones by their CFL number where
    cloth touches cloth or bodies, because contact acts otherwise in long steps."""

    def long(count):
        return [*LONG, f"solver.steps_per_frame={count}"]

    def measure():
        of = lambda *settings: run(make(), frames, settings)
        own = [of(*long(count), *TIGHT) for count in (steps, steps // 2)]
        short = [of(*SHORT, f"solver.cfl={number}", *TIGHT) for number in (cfl, 2 * cfl)] if cfl else own
        made = [(f"short, cfl {number}", of(*SHORT, f"solver.cfl={number}"), short[0]) for number in (4, 2)]
        made += [(f"long, {word}", of(f'solver.preset="{word}"'), own[0]) for word in ("preview", "production", "hero")]
        made += [("long, 32 steps", of(*long(32)), own[0])]
        known = horizon(own, made[3][1])
        over = lambda a, b: math.sqrt((distances(a, b)[1 : known + 1] ** 2).mean())
        lines = []
        for name, each, reference in made:
            n = len(each.frames)
            lines.append([name, f"{each.steps / n:.1f}", f"{each.count('cg_iterations') / n:.0f}", f"{each.simulated / n:.3f}",
                          f"{over(each, reference):.3f}", f"{distances(each, reference)[known]:.3f}", f"{known} frames"])
        lines.append([f"long, {steps} steps against half of them", "", "", "", f"{over(*own):.3f}", "", ""])
        if cfl:
            lines.append([f"short, cfl {cfl} against {2 * cfl}", "", "", "", f"{over(*short):.3f}", "", ""])
            lines.append(["converged, long against short", "", "", "", f"{over(own[0], short[0]):.3f}", "", ""])
        points = [(over(each, own[0]), each.simulated) for _, each, _ in made[2:]]
        if cpu := cpu_at(over(*made[0][1:]), points):
            lines.append(["time of long steps with the error of cfl 4, over its time", "", "", f"{cpu / made[0][1].simulated:.2f}", "", "", ""])
        return lines

    return measure


def distances(a, b):
    """RMS distance of all garments' vertices at every frame [mm]."""
    return 1e3 * np.sqrt(((positions(a) - positions(b)) ** 2).sum(axis=2).mean(axis=1))


def horizon(references, made):
    """The last frame up to which a converged run and one half as fine are nearer to each other than half of what a setting is off:
    beyond, nothing can be said."""
    is_known = distances(*references)[1:] <= 0.5 * distances(made, references[0])[1:]
    return int(np.argmin(is_known)) if not is_known.all() else len(is_known)


def cpu_at(error, points):
    """CPU seconds at an error, on straight lines between the logarithms of (error, seconds); None outside."""
    ordered = sorted(points)
    for (low, slow), (high, fast) in zip(ordered, ordered[1:]):
        if low <= error <= high and low < high:
            share = math.log(error / low) / math.log(high / low)
            return math.exp((1 - share) * math.log(slow) + share * math.log(fast))
    return None


def incline(mu):
    """Against Coulomb, at two lengths of the step; solved tightly: the automatic tolerance of the solves would show in the fourth digit."""

    def line(steps):
        settings = [f"friction={mu}", "resolution=10", "solver.cfl=4.0", "solver.cg_tolerance=1e-9",
                    f"solver.max_dt={1.000001 / 30.0 / steps:.9f}"]
        made = run(sample("incline"), (0, 30), settings)
        sin, cos = math.sin(math.radians(36)), math.cos(math.radians(36))
        x = positions(made)
        way = (x[-1] - x[0]).mean(axis=0) @ np.array([cos, -sin, 0.0])
        exact = 0.5 * 9.8 * max(0.0, sin - mu * cos)
        return [f"1/{made.steps} s", f"{made.simulated:.2f}", f"{abs(way):.6f} m", f"{exact:.6f} m"]

    return lambda: [line(steps) for steps in (1, 10)]


def turning_ball():
    """Row of the table for the angle by which the spinning ball turns the cloth on it."""
    made = run(sample("spinning_ball", resolution=40), (0, 240))
    return [made.steps, f"{made.simulated:.2f}", f"{turned(made):.0f}°", f"{45 * (len(made.frames) / 60.0 - 0.75):.0f}°",
            made.count("collision_hits"), made.count("zones"), made.crossings()]


def turned(made):
    """Angle by which the cloth around the top of the ball has turned the way that the ball spins [degrees]."""
    x = positions(made)
    near = np.hypot(x[0, :, 0], x[0, :, 2])
    top = (near > 0.05) & (near < 0.12)
    # The ball turns by -y: from x towards z.
    angles = np.unwrap(np.arctan2(x[:, top, 2], x[:, top, 0]), axis=0)
    return math.degrees((angles[-1] - angles[0]).mean())


TABLES = [
    Table(PAGE, "repulsion", ["repulsion", "steps", "`collision_steps`", "CPU s", "`collision_hits`", "`zones`", "`zone_nodes`",
                              "`zone_fallbacks`", "`rewinds`", "crossings"], {
        "twister": ("twister, 16 cells, frames 0-300", repulsion("twister", 16, (0, 300))),
        "spinning_ball": ("spinning_ball, 40 cells, frames 0-240", repulsion("spinning_ball", 40, (0, 240))),
    }),
    Table(PAGE, "presets", ["steps", "steps a frame", "CG iterations a frame", "CPU s a frame", "RMS error mm", "at the end", "over"], {
        "hanging_sheet": ("hanging_sheet, 72 cells", presets(lambda: sample("hanging_sheet", resolution=72), (1001, 1013), 64, None)),
        "drape_sphere": ("drape_sphere, 50 cells", presets(lambda: sample("drape_sphere", resolution=50), (1, 13), 64, 1)),
        "dressed_woman": ("dressed_woman, light garments", presets(lambda: woman("light"), (0, 24), 64, 1)),
    }),
    Table(PAGE, "incline", ["dt", "CPU s", "slid in 1 s", "Coulomb"], {
        f"incline_{mu}": (f"incline, μ {mu}", incline(mu)) for mu in (0.6, 0.8)}),
    Table(PAGE, "ball", ["steps", "CPU s", "cloth on top has turned", "the ball", "`collision_hits`", "`zones`",
                         "crossings"], {"friction_ball": ("spinning_ball, 40 cells, frames 0-240", turning_ball)}),
]
