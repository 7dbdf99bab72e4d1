"""Cost of self-contact on the twister and the spinning ball, with both effects and without one.

Also the time of each part of a frame.
"""

import math

from measure.page import Table
from measure.runs import run
from measure.scenes import sample, without_tables
from measure.speed import slope

PAGE = "dev/measurements/self-contact.md"
COUNTED = ["collision_hits", "zones"]

# How a scene is run: name, tables that are left out, settings.
VARIANTS = [
    ("both effects", [], []),
    ("collisions alone", ["self_repulsion"], []),
    ("both, collisions every step", [], ["self_collision.max_steps=1"]),
]

# Stages that are one part of a frame.
PARTS = {
    "A": ["A neighbours"],
    "B.1, B.5 velocity": ["B.1 velocity", "B.5 velocity"],
    "B.2, B.8 self-repulsion": ["B.2 self-repulsion", "B.8 self-repulsion"],
    "B.3, B.4, B.7 bodies": ["B.3 positions", "B.4 body collision", "B.7 body friction", "bodies and pins"],
    "C": ["C collisions"],
}
SIZES = {2 * cells * cells: cells for cells in (71, 224, 500)}


def history(scene):
    def line(name, left_out, settings):
        made = run(without_tables(sample(scene, resolution=40), left_out), (0, 240), settings)
        spent = [f"{made.spent(*PARTS[part]):.2f}" for part in ("A", "B.2, B.8 self-repulsion", "C")]
        counts = [made.count(name) for name in ("collision_steps", *COUNTED)]
        return [name, made.steps, counts[0], f"{made.simulated:.2f}", *spent, *counts[1:], made.crossings()]

    return lambda: [line(*variant) for variant in VARIANTS]


def ball(cells):
    return run(sample("spinning_ball", resolution=cells), (0, 60))


def shares(triangles):
    def measure():
        made = ball(SIZES[triangles])
        parts = [made.spent(*stages) / made.simulated for stages in PARTS.values()]
        cells = [len(made.frames), made.steps, f"{made.simulated:.2f}", f"{made.simulated / len(made.frames):.3f}"]
        cells += [f"{1e6 * made.simulated / made.steps / triangles:.2f}"]
        return [*cells, *(f"{100 * part:.0f} %" for part in [*parts, 1.0 - sum(parts)]), made.crossings()]

    return measure


def growth():
    runs = {triangles: ball(cells) for triangles, cells in SIZES.items()}
    power = slope([(math.log(triangles), math.log(made.simulated / made.steps)) for triangles, made in runs.items()])
    return ["", "", "", "", f"N^{power:.2f} a step", *[""] * (len(PARTS) + 2)]


TABLES = [
    Table(PAGE, "history", ["variant", "steps", "collision steps", "CPU s", "A s", "B.2, B.8 s", "C s",
                            *(name.replace("_", " ") for name in COUNTED), "crossings"],
          {scene: (f"{scene}, 40 cells, frames 0-240", history(scene)) for scene in ("twister", "spinning_ball")}),
    Table(PAGE, "shares", ["frames", "steps", "CPU s", "CPU s a frame", "µs a triangle and step", *PARTS, "the rest", "crossings"], {
        **{f"ball_{n // 1000}k": (f"{n:,} triangles", shares(n)) for n in SIZES},
        "growth": ("cost of a step by triangles", growth),
    }),
]
